//! Cells that do whole frames of `transfer`.

use super::Running;
use super::process::read_block;
use crate::engine::array_file::ArrayFile;
use crate::engine::protocol::{Request, Timed, Trace};
use crate::engine::session::Failure;
use crate::engine::task::Frames;
use crate::engine::task::frames::Answer;
use crate::record::names::Status;
use std::path::PathBuf;

/// Bytes of template positions that are written ahead for one request: frames of large templates come in several.
const AHEAD: usize = 64 << 20;

impl Running<'_> {
    /// The frame that is known exactly, checked; its time.
    pub(super) fn known_frame(&mut self, frames: &Frames) -> Result<u64, Failure> {
        let timed = self.frames(&frames.checked, 0)?;
        self.count(&timed);
        self.check_frame(frames, frames.setting.motion.checked_frame())?;
        Ok(timed.samples_ns[0])
    }

    /// The next `times` frames of the motion; those of the warm-up come before them.
    pub(super) fn steady_frames(&mut self, frames: &Frames, warmup: u32, times: u32) -> Result<(), Failure> {
        let most = AHEAD / (24 * frames.setting.template.positions().len()).max(1);
        let count = (warmup as usize + times as usize).min(most.max(2));
        let template = self.write_frames(frames, count)?;
        let last = self.next_frame + count - 1;
        self.next_frame += count;
        let timed = self.frames(&template, warmup)?;
        self.count(&timed);
        self.keep(timed);
        self.check_frame(frames, last)
    }

    /// The known frame once more, after all others; then memory and frames on a schedule.
    pub(super) fn last_frames(&mut self, frames: &Frames) -> Result<(), Failure> {
        self.known_frame(frames)?;
        self.memory()?;
        let size = 24 * frames.setting.template.positions().len();
        let count = (AHEAD / size.max(1)).clamp(2, frames.setting.motion.len().max(2));
        let template = self.write_frames(frames, count)?;
        self.open_loops(&template)
    }

    fn write_frames(&self, frames: &Frames, count: usize) -> Result<ArrayFile, Failure> {
        let path = self.solution.with_extension("template");
        frames
            .setting
            .write_frames(&path, self.next_frame, count)
            .map_err(|error| Failure::new(Status::Error, format!("cannot write frames: {error}")))
    }

    fn frames(&mut self, template: &ArrayFile, warmup: u32) -> Result<Timed, Failure> {
        for path in [&self.solution, &self.trace().field, &self.trace().rhs] {
            let _ = std::fs::remove_file(path); // old answers must not pass for new ones
        }
        let times = template.rows as u32 - warmup;
        let request = Request::Frame {
            template: template.clone(),
            warmup,
            solution: self.solution.clone(),
            trace: Some(self.trace()),
        };
        self.timed(request, times)
    }

    fn trace(&self) -> Trace {
        let path = |extension: &str| -> PathBuf { self.solution.with_extension(extension) };
        Trace { field: path("field"), rhs: path("rhs") }
    }

    /// Checks the last answer, which is to frame `k`.
    fn check_frame(&mut self, frames: &Frames, k: usize) -> Result<(), Failure> {
        let n = frames.setting.target.positions().len();
        let positions = read_block(&self.solution, n, 3)?;
        let files = self.trace();
        let trace = match (read_block(&files.field, n, 4), read_block(&files.rhs, n, 3)) {
            (Ok(field), Ok(rhs)) => Some((field, rhs)),
            _ => None, // a solver need not keep them
        };
        let answer = Answer { positions: positions.as_chunks().0.to_vec(), trace };
        let mut pose = frames.setting.template.positions().to_vec();
        frames.setting.motion.write(k, &mut pose);
        let known = k % frames.setting.motion.len() == frames.setting.motion.checked_frame();
        let checked = frames
            .check
            .frame(&pose, known, &answer, &self.limits)
            .map_err(|error| Failure::new(Status::Error, format!("{error:#}")))?;
        self.judge(checked)?;
        self.verified = positions;
        Ok(())
    }
}
