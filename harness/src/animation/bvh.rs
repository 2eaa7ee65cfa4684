//! BVH motion files: a hierarchy of joints, then one line of numbers per frame.
//!
//! Own reader: no well-kept crate reads them. Rotations are degrees, applied in the order of the channels (the first is the
//! outermost). A position channel takes the place of the offset's coordinate. Nesting is followed without recursion.

use super::clip::{Channel, Clip, Joint};
use crate::file::{self, Fault, FileError};
use crate::mesh_io::text::{Line, Lines, shown};
use std::path::Path;

/// Most joints of a hierarchy: a hundred times what characters have.
const MOST_JOINTS: usize = 10_000;

/// Reads a BVH file.
///
/// # Errors
/// [`FileError`] naming the line: a joint without channels, a frame with too few or too many numbers, a number that is not
/// finite, frames missing or promised in another number, no frame at all.
pub fn read(path: &Path) -> Result<Clip, FileError> {
    parse(&file::read(path)?).map_err(|fault| fault.in_file(path))
}

/// See [`read`].
///
/// # Errors
/// A fault naming the line.
pub fn parse(bytes: &[u8]) -> Result<Clip, Fault> {
    let mut lines = Lines::new(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), 1);
    let joints = hierarchy(&mut lines)?;
    let (count, frame_time) = motion_header(&mut lines)?;
    let width: usize = joints.iter().map(|joint| joint.channels.len()).sum();
    if width == 0 {
        return Err(Fault::new("has no channels, so nothing moves", "export it with rotation channels"));
    }
    let mut values = Vec::new();
    let mut rows = 0;
    while let Some(line) = lines.next_filled() {
        let before = values.len();
        for token in line.tokens() {
            values.push(line.finite(Some(token), "channel value")?);
        }
        let found = values.len() - before;
        if found != width {
            let problem = format!("{found} numbers, but the channels of all joints are {width}");
            return Err(line.fault(problem, "one line is one frame; export the motion again"));
        }
        rows += 1;
    }
    if rows == 0 {
        return Err(Fault::new("has no frames", "export a motion, not only a skeleton"));
    }
    if rows != count {
        let problem = format!("promises {count} frames, but {rows} follow");
        return Err(Fault::new(problem, "it was cut off, or correct the number after `Frames:`"));
    }
    Ok(Clip { joints, frame_time, values })
}

/// What stands around a line of the hierarchy.
struct Open {
    /// The joint, or the one whose end site this is.
    joint: usize,
    is_end: bool,
    has_offset: bool,
    has_channels: bool,
    line: usize,
}

fn hierarchy(lines: &mut Lines<'_>) -> Result<Vec<Joint>, Fault> {
    let no_hierarchy = || Fault::new("is no BVH file (it does not begin with HIERARCHY)", "export it as BVH");
    let first = lines.next_filled().ok_or_else(no_hierarchy)?;
    if !first.text.trim_ascii().eq_ignore_ascii_case(b"HIERARCHY") {
        return Err(no_hierarchy());
    }
    let mut joints: Vec<Joint> = Vec::new();
    let mut open: Vec<Open> = Vec::new();
    loop {
        let Some(line) = lines.next_filled() else {
            return Err(Fault::new("ends within its hierarchy", "it was cut off; export it again"));
        };
        // A brace may stand at the end of the line that it belongs to.
        let text = line.text.trim_ascii();
        let text = text.strip_suffix(b"{").unwrap_or(text).trim_ascii();
        let word = text.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        let rest = text[word.len()..].trim_ascii();
        match word.to_ascii_uppercase().as_slice() {
            b"" => {}
            b"ROOT" | b"JOINT" => {
                let parent = open.last().filter(|scope| !scope.is_end).map(|scope| scope.joint);
                if parent.is_none() != joints.is_empty() {
                    let problem = "a joint outside of the one tree that begins at ROOT";
                    return Err(line.fault(problem, "export one skeleton"));
                }
                if joints.len() == MOST_JOINTS {
                    return Err(line.fault(format!("more than {MOST_JOINTS} joints"), "simplify it"));
                }
                let name = String::from_utf8_lossy(rest).into_owned();
                joints.push(Joint { name, parent, offset: [0.0; 3], channels: Vec::new(), end: None });
                open.push(Open::new(joints.len() - 1, false, line.number));
            }
            b"END" => {
                let joint = open.last().ok_or_else(|| line.fault("an end site of no joint", "remove it"))?;
                open.push(Open::new(joint.joint, true, line.number));
            }
            b"OFFSET" => {
                let scope =
                    open.last_mut().ok_or_else(|| line.fault("an offset of no joint", "remove it"))?;
                let offset = line.point(&mut line.tokens().skip(1))?;
                scope.has_offset = true;
                match scope.is_end {
                    true => joints[scope.joint].end = Some(offset),
                    false => joints[scope.joint].offset = offset,
                }
            }
            b"CHANNELS" => {
                let scope = open.last_mut().filter(|scope| !scope.is_end);
                let scope = scope.ok_or_else(|| line.fault("channels of no joint", "remove them"))?;
                scope.has_channels = true;
                joints[scope.joint].channels = channels(&line)?;
            }
            b"}" => {
                let scope = open.pop().ok_or_else(|| line.fault("a brace closes nothing", "remove it"))?;
                scope.check(&joints)?;
            }
            b"MOTION" => {
                if let Some(scope) = open.last() {
                    let problem = format!("MOTION before the joint of line {} is closed", scope.line);
                    return Err(line.fault(problem, "close it with a brace"));
                }
                if joints.is_empty() {
                    return Err(line.fault("MOTION of no joints", "export the skeleton, too"));
                }
                return Ok(joints);
            }
            _ => {
                let problem = format!("`{}` is no keyword of a hierarchy", shown(word));
                return Err(line.fault(problem, "correct the line"));
            }
        }
    }
}

impl Open {
    fn new(joint: usize, is_end: bool, line: usize) -> Self {
        Self { joint, is_end, has_offset: false, has_channels: false, line }
    }

    /// Whether all that a joint must say has been said.
    fn check(&self, joints: &[Joint]) -> Result<(), Fault> {
        let name = &joints[self.joint].name;
        let missing = match (self.has_offset, self.is_end || self.has_channels) {
            (false, _) => "OFFSET",
            (_, false) => "CHANNELS",
            _ => return Ok(()),
        };
        let place = file::Place::Line(self.line);
        Err(Fault::at(place, format!("joint `{}` has no {missing}", shown(name.as_bytes())), "add the line"))
    }
}

/// `CHANNELS 3 Zrotation Xrotation Yrotation`.
fn channels(line: &Line<'_>) -> Result<Vec<Channel>, Fault> {
    let mut tokens = line.tokens().skip(1);
    let count = line.integer(tokens.next(), "number of channels")?;
    let axis = |letter: u8| b"XYZ".iter().position(|&axis| axis == letter.to_ascii_uppercase());
    let mut channels = Vec::new();
    for token in tokens {
        let channel = token.split_first().and_then(|(&letter, kind)| {
            let axis = axis(letter)?;
            match kind.to_ascii_lowercase().as_slice() {
                b"position" => Some(Channel::Position(axis)),
                b"rotation" => Some(Channel::Rotation(axis)),
                _ => None,
            }
        });
        let Some(channel) = channel else {
            let problem = format!("`{}` is no channel", shown(token));
            return Err(line.fault(problem, "channels are Xposition ... Zrotation"));
        };
        if channels.contains(&channel) {
            return Err(line.fault(format!("channel `{}` twice", shown(token)), "remove one"));
        }
        channels.push(channel);
    }
    if channels.len() as i64 != count {
        let problem = format!("{count} channels promised, {} named", channels.len());
        return Err(line.fault(problem, "name every channel"));
    }
    Ok(channels)
}

/// `Frames: N` and `Frame Time: T`.
fn motion_header(lines: &mut Lines<'_>) -> Result<(usize, f64), Fault> {
    let mut value = |key: &str| {
        let missing = || Fault::new(format!("has no line `{key} ...` after MOTION"), "export it again");
        let line = lines.next_filled().ok_or_else(missing)?;
        let text = line.text.trim_ascii();
        let fits = text.get(..key.len()).is_some_and(|start| start.eq_ignore_ascii_case(key.as_bytes()));
        if !fits {
            let problem = format!("`{}` where `{key} ...` is expected", shown(text));
            return Err(line.fault(problem, "correct the line"));
        }
        let token = text[key.len()..].trim_ascii();
        Ok((line, token))
    };
    let (line, token) = value("Frames:")?;
    let count = line.integer(Some(token), "number of frames")?;
    let count =
        usize::try_from(count).map_err(|_| line.fault("a negative number of frames", "correct it"))?;
    let (line, token) = value("Frame Time:")?;
    let frame_time = line.finite(Some(token), "seconds per frame")?;
    if !(1e-6..=1e6).contains(&frame_time) {
        return Err(line.fault(format!("a frame cannot last {frame_time} seconds"), "give 0.0333 or so"));
    }
    Ok((count, frame_time))
}

/// Writes a clip as BVH, six decimals. Atomic, see [`file::write_atomically`].
///
/// # Errors
/// [`FileError`] when the file cannot be written.
pub fn write(path: &Path, clip: &Clip) -> Result<(), FileError> {
    file::write_atomically(path, |out| {
        writeln!(out, "HIERARCHY")?;
        let children = |j: usize| (0..clip.joints.len()).filter(move |&c| clip.joints[c].parent == Some(j));
        // What is still to be written, last first: joints to open, braces to close.
        let mut pending: Vec<(Option<usize>, usize)> = vec![(Some(0), 0)];
        while let Some((joint, depth)) = pending.pop() {
            let indent = "\t".repeat(depth);
            let Some(j) = joint else {
                writeln!(out, "{indent}}}")?;
                continue;
            };
            let Joint { name, parent, offset, channels, end } = &clip.joints[j];
            let kind = if parent.is_none() { "ROOT" } else { "JOINT" };
            writeln!(out, "{indent}{kind} {name}\n{indent}{{")?;
            writeln!(out, "{indent}\tOFFSET {:.6} {:.6} {:.6}", offset[0], offset[1], offset[2])?;
            let names: Vec<String> = channels.iter().map(|&channel| channel_name(channel)).collect();
            writeln!(out, "{indent}\tCHANNELS {} {}", names.len(), names.join(" "))?;
            if let Some(end) = end {
                writeln!(out, "{indent}\tEnd Site\n{indent}\t{{")?;
                writeln!(out, "{indent}\t\tOFFSET {:.6} {:.6} {:.6}\n{indent}\t}}", end[0], end[1], end[2])?;
            }
            pending.push((None, depth));
            let mut below: Vec<usize> = children(j).collect();
            below.reverse();
            pending.extend(below.into_iter().map(|c| (Some(c), depth + 1)));
        }
        writeln!(out, "MOTION\nFrames: {}\nFrame Time: {:.7}", clip.len(), clip.frame_time)?;
        for k in 0..clip.len() {
            let row: Vec<String> = clip.frame(k).iter().map(|x| format!("{x:.6}")).collect();
            writeln!(out, "{}", row.join(" "))?;
        }
        Ok(())
    })
}

fn channel_name(channel: Channel) -> String {
    let (axis, kind) = match channel {
        Channel::Position(axis) => (axis, "position"),
        Channel::Rotation(axis) => (axis, "rotation"),
    };
    format!("{}{kind}", ["X", "Y", "Z"][axis])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::animation::clip::tests::leg;

    const FILE: &str = "HIERARCHY\r\nROOT Left Hip {\r\n OFFSET 0 0 0\r\n CHANNELS 6 Xposition Yposition Zposition \
        Zrotation Xrotation Yrotation\r\n JOINT knee\r\n {\r\n OFFSET 0 -1 0\r\n CHANNELS 3 Zrotation Xrotation \
        Yrotation\r\n End Site\r\n {\r\n OFFSET 0 -1 0\r\n }\r\n }\r\n}\r\nMOTION\r\nFrames: 2\r\nFrame Time:\t.01\r\n\
        1 2 3 4 5 6 7 8 9\r\n9 8 7 6 5 4 3 2 1\r\n";

    #[test]
    fn reads_and_writes() {
        let clip = parse(FILE.as_bytes()).unwrap();
        let mut expected = leg(vec![
            1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0,
        ]);
        expected.joints[0].name = "Left Hip".into();
        assert_eq!(clip, expected);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        write(&path, &clip).unwrap();
        assert_eq!(read(&path).unwrap(), clip);
    }

    #[test]
    fn faults_name_line_and_remedy() {
        for (from, to, part) in [
            ("HIERARCHY", "HIER", "does not begin with HIERARCHY"),
            ("CHANNELS 3 Zrotation Xrotation Yrotation", "", "joint `knee` has no CHANNELS"),
            (" OFFSET 0 -1 0\r\n CHANNELS 3", " CHANNELS 3", "line 5: joint `knee` has no OFFSET"),
            ("CHANNELS 3", "CHANNELS 4", "4 channels promised, 3 named"),
            ("Zrotation Xrotation Yrotation\r\n End", "Zrotation Wrotation Yrotation\r\n End", "`Wrotation`"),
            ("Zrotation Xrotation Yrotation\r\n End", "Zrotation Zrotation Yrotation\r\n End", "twice"),
            ("1 2 3 4 5 6 7 8 9", "1 2 3 4 5 6 7 8", "8 numbers, but the channels of all joints are 9"),
            ("1 2 3 4 5 6 7 8 9", "1 2 3 4 nan 6 7 8 9", "not finite"),
            ("Frames: 2", "Frames: 3", "promises 3 frames, but 2 follow"),
            ("Frame Time:\t.01", "Frame Time: 0", "cannot last"),
            ("1 2 3 4 5 6 7 8 9\r\n9 8 7 6 5 4 3 2 1\r\n", "", "has no frames"),
            ("}\r\nMOTION", "MOTION", "before the joint of line 2 is closed"),
            ("MOTION", "}\r\nMOTION", "closes nothing"),
            ("End Site", "Effector", "`Effector` is no keyword"),
            (" }\r\n }\r\n}", "", "is closed"),
        ] {
            assert!(FILE.contains(from), "{from}");
            let fault = parse(FILE.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
            assert!(fault.contains(part), "{from} -> {to}: {fault}");
        }
        for cut in 0..FILE.len() - 2 {
            assert!(parse(&FILE.as_bytes()[..cut]).is_err(), "cut at {cut}");
        }
        let deep = format!("HIERARCHY\nROOT a\n{}", "{\nOFFSET 0 0 0\nCHANNELS 0\nJOINT b\n".repeat(20_000));
        assert!(parse(deep.as_bytes()).unwrap_err().to_string().contains("more than 10000 joints"));
    }
}
