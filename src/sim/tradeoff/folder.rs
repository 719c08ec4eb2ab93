//! Where a run is kept, and how a scene is simulated there.

use crate::{
    cache,
    frame::{Frame, FrameIndex},
    job::{
        Control, RunError, ShotFolder, log,
        usage::{Meter, Peak},
    },
    preset::Frames,
    sim::{FrameRecord, forecast::ProductSample, scene::Scene},
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Jobs that runs are made of.
pub(crate) trait Jobs: Sync {
    /// Simulates frames of a scene into the cache of a shot, from the start if `force` is set. Returns how many were there already.
    fn simulate(
        &self,
        scene: &Scene,
        shot: &ShotFolder,
        frames: &Frames,
        force: bool,
        control: Control,
    ) -> Result<usize, RunError>;

    /// Makes the products that the scene requests of a frame in `folder`, and measures them.
    fn sample_products(
        &self,
        scene: &Scene,
        frame: &Frame,
        folder: &Path,
        control: Control,
    ) -> Result<Vec<ProductSample>, RunError>;
}

/// Where a run is kept, and what is run.
#[derive(Clone)]
pub(crate) struct RunFolder {
    /// The scene.
    pub scene: Scene,
    /// The last frame.
    pub last: FrameIndex,
    /// Folder of the run's files.
    pub path: PathBuf,
    /// Jobs that simulate the scene.
    pub jobs: &'static dyn Jobs,
}

/// Resources that a run used, and its log.
pub(crate) struct Made<L> {
    /// Wall-clock times of the passes [s].
    pub passes: Vec<(String, f64)>,
    /// Processor time of all threads [s], where the system reports it.
    pub cpu_seconds: Option<f64>,
    /// Peak memory of the process [bytes], where the system reports it.
    pub memory: Option<u64>,
    /// Why the run ended before its last frame, if it did.
    pub diverged: Option<String>,
    /// Entries of the log, by frame.
    pub logged: BTreeMap<FrameIndex, L>,
}

impl RunFolder {
    pub(super) fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// What was kept of a frame to compare it; `None` if the run did not come so far.
    pub(crate) fn kept(&self, frame: u32) -> Result<Option<Frame>, RunError> {
        self.read(KEPT, FrameIndex(frame))
    }

    /// The frame that was written below `folder`.
    pub(crate) fn read(&self, folder: &str, frame: FrameIndex) -> Result<Option<Frame>, RunError> {
        let path = cache::frame_path(&self.path.join(folder), frame);
        if !path.exists() {
            return Ok(None);
        }
        Ok(Some(cache::read_frame(&path)?.0))
    }

    /// Writes a frame below `folder`.
    pub(crate) fn write(&self, folder: &str, frame: &Frame) -> Result<(), RunError> {
        ShotFolder::create(&self.path.join(folder))?;
        cache::write_frame(&self.path.join(folder), frame, 0)?;
        Ok(())
    }

    /// Simulates the scene up to the last frame; `logged` picks what is needed of the log.
    pub(super) fn simulate<L>(
        &self,
        shot: &ShotFolder,
        is_repeat: bool,
        logged: impl Fn(FrameRecord) -> Option<L>,
        control: Control,
    ) -> Result<Made<L>, RunError> {
        let frames = Frames::from_first_to_last(self.scene.frames.first(), self.last)
            .expect("the selection was checked to begin at the first frame or later");
        let (peak, meter) = (Peak::since_now(), Meter::new());
        let (kept, diverged) = match self.jobs.simulate(&self.scene, shot, &frames, is_repeat, control) {
            Ok(kept) => (kept, None),
            Err(RunError::Diverged { frame, diverged }) => (0, Some(format!("frame {frame}: {diverged}"))),
            Err(other) => return Err(other),
        };
        // The time of a run that went on from kept frames is not its own.
        let (cpu_seconds, memory) = (meter.cpu().filter(|_| kept == 0 && diverged.is_none()), peak.bytes());
        let log = log::read::<FrameRecord>(shot)?;
        let passes = log.values().flat_map(|line| &line.record.seconds);
        let passes = passes.map(|(name, seconds)| (name.to_string(), *seconds)).collect();
        let logged =
            log.into_iter().filter_map(|(frame, line)| Some((frame, logged(line.record)?))).collect();
        Ok(Made { passes, cpu_seconds, memory, diverged, logged })
    }
}

/// The folder of what is kept of frames.
pub(super) const KEPT: &str = "sample";

/// Deletes a folder that is not needed any more. One that cannot be deleted only takes space.
pub(crate) fn remove(folder: &Path) {
    let _ = std::fs::remove_dir_all(folder);
}
