//! What becomes of the frames: files, pictures, figures. Every output appears only when it is complete.

use super::keep_volume::Kept;
use super::plot;
use super::statistics::{self, Frame};
use crate::animation::figures::Rest;
use crate::animation::sink::Sink;
use crate::cmd::output::Format;
use crate::file::{self, Fault};
use crate::render::animation::write_apng;
use crate::render::{Camera, Image, Style, Up, View, contact_sheet, draw};
use crate::report::rows::Rows;
use crate::vector::Vector;
use anyhow::{Context, ensure};
use indicatif::ProgressBar;
use lapsolve::mesh::TriangleMesh;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// Where frames, pictures and figures go.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Output")]
pub struct OutputArgs {
    /// The animation: a .glb file (one morph target per frame), a .npy file (frames x vertices x 3), or a folder, which
    /// gets frame_0000.ply and so on
    #[arg(long, value_name = "FILE.glb|FILE.npy|FOLDER")]
    pub out: Option<PathBuf>,
    /// Contact sheet: poses evenly spaced, the template above the target
    #[arg(long, value_name = "FILE.png")]
    pub sheet: Option<PathBuf>,
    /// Animated PNG, which browsers play
    #[arg(long, value_name = "FILE.png")]
    pub preview: Option<PathBuf>,
    /// Latency, volume and edge lengths of every frame
    #[arg(long, value_name = "FILE.csv")]
    pub statistics: Option<PathBuf>,
    /// The same as a plot
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Take every N-th frame of the motion
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Frames per second of the result [default: as captured; 30 where the motion does not say]
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub fps: Option<f64>,
    /// Poses on the contact sheet
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=160))]
    pub pictures: u32,
    /// Width and height in pixels of one picture
    #[arg(long, value_name = "WxH", default_value = "240x320", value_parser = crate::cmd::render::size)]
    pub size: (usize, usize),
    /// Where the viewer stands
    #[arg(long, value_enum, default_value_t = View::ThreeQuarter)]
    pub view: View,
    /// Which axis points up
    #[arg(long, value_enum, default_value_t)]
    pub up: Up,
    /// Form of the summary on stdout
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Parses a rate in starts per second.
pub fn rate(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|hz| (0.1..=1000.0).contains(hz)).ok_or("expected 0.1 to 1000".to_owned())
}

/// Something that moves.
pub trait Animation {
    /// Number of frames.
    fn frames(&self) -> usize;
    /// What moves, at rest.
    fn mesh(&self) -> &TriangleMesh;
    /// What moves it, where that is another mesh.
    fn template(&self) -> Option<&TriangleMesh>;
    /// Positions of the template in the frame made last.
    fn template_pose(&self) -> &[Vector];
    /// Makes frame `k`.
    fn make(&mut self, k: usize, positions: &mut [Vector]) -> anyhow::Result<Made>;
}

/// What making a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Made {
    /// From the template's positions in memory to the target's, nanoseconds.
    pub latency_ns: u64,
    /// Marks and vertices whose rotation was replaced, because a triangle collapsed or an average vanished.
    pub replaced: usize,
    /// What keeping the volume took, where it was asked for.
    pub kept: Option<Kept>,
}

/// Lowest and highest corner.
type Bounds = (Vector, Vector);

impl OutputArgs {
    /// Index of the axis that points up.
    pub fn up_axis(&self) -> usize {
        match self.up {
            Up::Y => 1,
            Up::Z => 2,
        }
    }

    /// Whether anything is to be made.
    pub fn is_wanted(&self) -> bool {
        [&self.out, &self.sheet, &self.preview, &self.statistics, &self.plot]
            .iter()
            .any(|path| path.is_some())
    }

    /// Makes all frames once and writes what is asked for; `captured` is the rate of the motion, if it has one, before
    /// frames are left out.
    ///
    /// # Errors
    /// A frame that cannot be solved, a place that is not writable.
    pub fn write(&self, animation: &mut dyn Animation, captured: Option<f64>) -> anyhow::Result<Vec<Frame>> {
        let rate = self.fps.or(captured.map(|hz| hz / f64::from(self.every))).unwrap_or(30.0);
        let count = animation.frames();
        let mut sink = match &self.out {
            Some(out) => Some(Sink::new(out, animation.mesh(), count, rate)?),
            None => None,
        };
        for path in [&self.sheet, &self.preview, &self.statistics, &self.plot].into_iter().flatten() {
            place_for(path)?;
        }
        let mut stage = Stage::new(self, animation);
        let rest = Rest::of(animation.mesh());
        let mut positions = animation.mesh().positions().to_vec();
        animation.make(0, &mut positions)?; // pages are touched for the first time
        let mut frames = Vec::with_capacity(count);
        let progress = progress(count, "frames");
        for k in 0..count {
            let made = animation.make(k, &mut positions).with_context(|| format!("frame {k}"))?;
            stage.see(k, animation, &positions);
            if let Some(sink) = &mut sink {
                sink.push(&positions)?;
            }
            frames.push(Frame { made, figures: rest.compare(&positions) });
            progress.inc(1);
        }
        progress.finish_and_clear();
        if let Some(sink) = sink {
            sink.finish()?;
        }
        if let Some(path) = &self.statistics {
            let text = statistics::rows(&frames).render(Format::Csv);
            file::write_atomically(path, |out| out.write_all(text.as_bytes()))?;
        }
        if let Some(path) = &self.plot {
            plot::write(path, &frames)?;
        }
        if let Some(path) = &self.sheet {
            stage.sheet(animation)?.write_png(path)?;
        }
        if let Some(path) = &self.preview {
            self.write_preview(path, &stage, animation, rate)?;
        }
        Ok(frames)
    }

    /// All frames once more, at no more than 30 a second, drawn.
    fn write_preview(
        &self,
        path: &Path,
        stage: &Stage<'_>,
        animation: &mut dyn Animation,
        rate: f64,
    ) -> anyhow::Result<()> {
        const FASTEST: f64 = 30.0; // pictures a second: larger files show no more
        let step = (rate / FASTEST).ceil().max(1.0) as usize;
        let count = animation.frames().div_ceil(step);
        let mut positions = animation.mesh().positions().to_vec();
        let progress = progress(count, "pictures");
        let mut failed = Ok(());
        write_apng(count as u32, (rate / step as f64).round().max(1.0) as u16, path, |k| {
            progress.inc(1);
            let k = k as usize * step;
            if failed.is_ok() {
                failed = animation.make(k, &mut positions).map(|_| ());
            }
            stage.picture(k, animation, &positions)
        })?;
        progress.finish_and_clear();
        failed
    }

    /// Prints rows of figures.
    ///
    /// # Errors
    /// Any failure of stdout but a reader that has gone away.
    pub fn print(&self, rows: &Rows) -> anyhow::Result<()> {
        let text = match self.format {
            Format::Json => {
                let object: serde_json::Map<String, serde_json::Value> =
                    rows.rows.iter().map(|row| (row[0].clone(), row[1].clone().into())).collect();
                serde_json::to_string_pretty(&object)?
            }
            format => rows.render(format),
        };
        Ok(crate::cmd::output::print(&text)?)
    }
}

/// Whether a file can be put there, found out before the work begins.
fn place_for(path: &Path) -> anyhow::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let writable = tempfile::Builder::new().prefix(".lapbench-").tempfile_in(folder);
    writable.map(drop).map_err(|error| {
        Fault::new(format!("cannot be written ({error})"), "check its folder and permissions").in_file(path)
    })?;
    ensure!(!path.is_dir(), "{} is a folder; name a file in it", path.display());
    Ok(())
}

fn progress(count: usize, what: &'static str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(count as u64);
    bar.set_message(what);
    bar.set_style(
        indicatif::ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}, {eta} left")
            .expect("a template"),
    );
    bar
}

/// Everything that is drawn: the template, if there is one, and the target.
struct Stage<'a> {
    args: &'a OutputArgs,
    /// Box of template and target in every frame.
    boxes: Vec<[Bounds; 2]>,
    /// Frames on the contact sheet, with both poses.
    chosen: Vec<(usize, [Vec<Vector>; 2])>,
    wanted: Vec<usize>,
}

impl<'a> Stage<'a> {
    fn new(args: &'a OutputArgs, animation: &dyn Animation) -> Self {
        let count = animation.frames();
        let pictures = if args.sheet.is_some() { count.min(args.pictures as usize) } else { 0 };
        let wanted = (0..pictures).map(|i| i * count / pictures).collect();
        Self { args, boxes: Vec::with_capacity(count), chosen: Vec::new(), wanted }
    }

    fn see(&mut self, k: usize, animation: &dyn Animation, positions: &[Vector]) {
        self.boxes.push([bounds(animation.template_pose()), bounds(positions)]);
        if self.wanted.contains(&k) {
            self.chosen.push((k, [animation.template_pose().to_vec(), positions.to_vec()]));
        }
    }

    /// The whole motion in one frame; where it travels farther than the figure is wide, the camera goes along.
    fn camera(&self, subject: usize, k: usize) -> Camera {
        let up = self.args.up_axis();
        let boxes = || self.boxes.iter().map(|both| both[subject]);
        let hull = boxes().reduce(join).expect("frames");
        let widest: Vector = std::array::from_fn(|i| boxes().map(|b| b.1[i] - b.0[i]).fold(0.0, f64::max));
        let across = (0..3).filter(|&i| i != up).map(|i| widest[i]).fold(0.0, f64::max).max(0.5 * widest[up]);
        let (low, high) = self.boxes[k][subject];
        let mut framed = hull;
        for i in (0..3).filter(|&i| i != up && hull.1[i] - hull.0[i] > 1.5 * across) {
            let middle = 0.5 * (low[i] + high[i]);
            (framed.0[i], framed.1[i]) = (middle - 0.5 * widest[i], middle + 0.5 * widest[i]);
        }
        Camera::framing_box(framed, self.args.view, self.args.up)
    }

    fn draw(&self, subject: usize, k: usize, mesh: &TriangleMesh, pose: &[Vector]) -> Image {
        const TEMPLATE: [u8; 3] = [150, 172, 196];
        let mut style = Style { size: self.args.size, ..Style::default() };
        if subject == 0 {
            style.colouring = crate::render::Colouring::Plain(TEMPLATE);
        }
        match mesh.with_positions(pose.to_vec()) {
            Ok(mesh) => draw(&mesh, &style, &self.camera(subject, k)),
            Err(_) => Image::new(style.size.0, style.size.1, style.background), // not finite: nothing to see
        }
    }

    fn sheet(&self, animation: &dyn Animation) -> anyhow::Result<Image> {
        const COLUMNS: usize = 8;
        let blank = || Image::new(self.args.size.0, self.args.size.1, [255; 3]);
        let columns = self.chosen.len().clamp(1, COLUMNS);
        let mut pictures = Vec::new();
        for part in self.chosen.chunks(columns) {
            let subjects = [animation.template(), Some(animation.mesh())];
            for (subject, mesh) in subjects.into_iter().enumerate() {
                let Some(mesh) = mesh else { continue };
                pictures.extend(part.iter().map(|(k, poses)| self.draw(subject, *k, mesh, &poses[subject])));
                pictures.extend((part.len()..columns).map(|_| blank()));
            }
        }
        contact_sheet(&pictures, columns, 4, [255; 3])
            .context("the sheet is too large; lower --size or --pictures")
    }

    /// Template and target side by side.
    fn picture(&self, k: usize, animation: &dyn Animation, positions: &[Vector]) -> Image {
        let own = self.draw(1, k, animation.mesh(), positions);
        let Some(template) = animation.template() else { return own };
        let both = [self.draw(0, k, template, animation.template_pose()), own];
        contact_sheet(&both, 2, 0, [255; 3]).expect("two pictures of a size that was checked")
    }
}

fn bounds(points: &[Vector]) -> Bounds {
    let empty = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    points.iter().fold(empty, |all, &p| join(all, (p, p)))
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    (std::array::from_fn(|i| a.0[i].min(b.0[i])), std::array::from_fn(|i| a.1[i].max(b.1[i])))
}
