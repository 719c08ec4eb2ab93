//! How runs are made, measured and compared, and what is kept of them.

use super::folder::{Made, RunFolder};
use crate::{
    frame::{Frame, FrameIndex},
    job::{
        Control, RunError, ShotFolder,
        tradeoff::{About, Column, Setting},
    },
    preset::Frames,
    sim::{FrameRecord, scene::Scene},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{collections::BTreeMap, rc::Rc};

/// How runs are made, measured and compared.
pub(crate) trait Measure: Sized + 'static {
    /// What is measured of a frame. Runs whose samples are equal gave the same frames.
    type Sample: Clone + PartialEq + Serialize + DeserializeOwned;
    /// A frame's entry in the log.
    type Logged: Serialize + DeserializeOwned;
    /// The distance from the reference, as far as it takes more than samples and log.
    type Distance: Clone + Default + Serialize + DeserializeOwned;

    /// Raised when records hold something else, so that older runs are repeated; with the subject's name.
    const VERSION: &str;

    /// Whether kept frames stay on disk; if not, the distance is kept instead.
    const KEEPS_FRAMES: bool = true;

    /// The scene that is run for a setting.
    fn scene(&self, scene: &Scene) -> Scene {
        scene.clone()
    }

    /// Everything that decides a run and what is measured of it, but for tool, version, last frame and threads.
    fn decisive(&self, scene: &Scene) -> String;

    /// Runs with a larger figure come first.
    fn coarseness(&self, _: &Scene) -> f32 {
        0.0
    }

    /// Fills the cache of `shot`, from the start if it is a repeat.
    fn make(
        &self,
        folder: &RunFolder,
        shot: &ShotFolder,
        is_repeat: bool,
        control: Control,
    ) -> Result<Made<Self::Logged>, RunError> {
        folder.simulate(shot, is_repeat, Self::logged, control)
    }

    /// The system's part of a frame's record.
    fn logged(_: FrameRecord) -> Option<Self::Logged> {
        None
    }

    /// Measures a frame, and returns what is kept of it to compare; `is_end` if it is the run's first or last.
    fn sample(
        &self,
        folder: &RunFolder,
        frame: &Frame,
        is_end: bool,
        control: Control,
    ) -> Result<(Self::Sample, Frame), RunError>;

    /// Times what is made of the run's last frame, `repeats` times; `None` if nothing is.
    fn product(&self, _: &RunFolder, _repeats: usize, _: Control) -> Result<Option<ProductRecord>, RunError> {
        Ok(None)
    }

    /// Looks at the reference and its refinement before runs are compared.
    fn prepare(&mut self, _reference: &Run<Self>, _refined: &Run<Self>) -> Result<(), RunError> {
        Ok(())
    }

    /// The distance of a run from the reference over some frames.
    fn distance(
        &self,
        run: &Run<Self>,
        reference: &Run<Self>,
        frames: &Frames,
    ) -> Result<Self::Distance, RunError>;

    /// How many times its seconds a run is shown to take, and how many times a whole shot takes.
    fn scales(&self, folder: &RunFolder, base: &Scene) -> [f64; 2] {
        let first = base.frames.first().0;
        let [slice, shot] = [folder.last, base.frames.last()].map(|last| f64::from(last.0 - first));
        [1.0, shot / slice.max(1.0)]
    }

    /// The columns of the table.
    fn columns(&self) -> Vec<Column<ComparedRun<Self>>>;

    /// Adds what the table has in addition to the rows. The last runs are the reference and its refinement.
    fn describe(&self, runs: &[Rc<Run<Self>>], by: &str, about: &mut About);
}

/// What was measured of a run; kept on disk.
#[derive(Serialize, Deserialize)]
#[serde(bound = "")]
pub(crate) struct RunRecord<M: Measure> {
    /// Every frame.
    pub frames: Vec<FrameSample<M>>,
    /// The cached frames [bytes].
    pub bytes: u64,
    /// Wall-clock times of the passes [s], once per repeat.
    pub passes: Vec<Vec<(String, f64)>>,
    /// Processor time of all threads [s], once per repeat that was not interrupted, where the system reports it.
    pub cpu_seconds: Vec<f64>,
    /// Peak memory of the process [bytes], minimum of the repeats, where the system reports it.
    pub memory: Option<u64>,
    /// Why the run ended before its last frame, if it did.
    pub diverged: Option<String>,
    /// A hash of the frames' files: a repeat must give the same.
    pub frames_hash: u64,
    /// Distances from references, by the names of their folders; only if frames are not kept.
    pub distances: BTreeMap<String, M::Distance>,
}

/// What was measured of a frame.
#[derive(Serialize, Deserialize)]
#[serde(bound = "")]
pub(crate) struct FrameSample<M: Measure> {
    /// Frame number.
    pub frame: u32,
    /// What is measured of the frame.
    pub sample: M::Sample,
    /// The frame's entry in the log; a shot's first frame has none.
    pub logged: Option<M::Logged>,
}

/// What was made of a run's last frame; kept on disk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ProductRecord {
    /// Wall-clock time [s], once per repeat.
    pub seconds: Vec<f64>,
    /// The file [bytes].
    pub bytes: u64,
    /// Peak memory of the process [bytes], minimum of the repeats, where the system reports it.
    pub memory: Option<u64>,
    /// Error of the product, which needs no reference.
    pub error: Option<f64>,
}

/// A finished run.
pub(crate) struct Run<M: Measure> {
    /// Changes of the preset.
    pub setting: Setting,
    /// Folder of the run.
    pub folder: RunFolder,
    /// What was measured.
    pub record: RunRecord<M>,
    /// What was made of its last frame.
    pub product: Option<ProductRecord>,
}

/// A run next to the reference: what columns are measured from.
pub(crate) struct ComparedRun<M: Measure> {
    /// How runs are measured.
    pub measure: Rc<M>,
    /// The run.
    pub run: Rc<Run<M>>,
    /// The reference; `None` if the run cannot be compared with it, or is the reference itself.
    pub reference: Option<Rc<Run<M>>>,
    /// Distance from the reference.
    pub distance: M::Distance,
    /// The frames that are compared.
    pub frames: Frames,
}

impl<M: Measure> ComparedRun<M> {
    /// What was measured of the compared frames.
    pub(crate) fn samples(&self) -> impl DoubleEndedIterator<Item = &FrameSample<M>> {
        self.run.record.frames.iter().filter(|sample| self.frames.contains(FrameIndex(sample.frame)))
    }

    /// Log entries of the compared frames.
    pub(crate) fn logged(&self) -> impl Iterator<Item = &M::Logged> {
        self.samples().filter_map(|sample| sample.logged.as_ref())
    }

    /// The sum of a logged figure over the compared frames.
    pub(crate) fn sum(&self, figure: impl Fn(&M::Logged) -> f64) -> Option<f64> {
        Some(self.logged().map(figure).sum())
    }

    /// The mean of a logged figure over the compared frames.
    pub(crate) fn mean(&self, figure: impl Fn(&M::Logged) -> f64) -> Option<f64> {
        Some(self.sum(figure)? / self.logged().count().max(1) as f64)
    }

    /// The largest of a logged figure over the compared frames, and 0.
    pub(crate) fn max(&self, figure: impl Fn(&M::Logged) -> f64) -> Option<f64> {
        Some(self.logged().map(figure).fold(0.0, f64::max))
    }

    /// The root mean square, over the compared frames that the reference has too, of a difference between the two.
    pub(crate) fn rms(
        &self,
        difference: impl Fn(&FrameSample<M>, &FrameSample<M>) -> Option<f64>,
    ) -> Option<f64> {
        let reference = self.reference.as_ref()?;
        rms(pairs(&self.run, reference, &self.frames).filter_map(|(a, b)| difference(a, b)))
    }

    /// The largest of a figure over all frames of the reference; `None` if it is not above zero.
    pub(crate) fn reference_max(&self, figure: impl Fn(&FrameSample<M>) -> Option<f64>) -> Option<f64> {
        let frames = &self.reference.as_ref()?.record.frames;
        Some(frames.iter().filter_map(figure).fold(0.0, f64::max)).filter(|&most| most > 0.0)
    }
}

/// The frames among `frames` that two runs have.
pub(crate) fn pairs<'a, M: Measure>(
    run: &'a Run<M>,
    reference: &'a Run<M>,
    frames: &'a Frames,
) -> impl Iterator<Item = (&'a FrameSample<M>, &'a FrameSample<M>)> {
    let chosen = run.record.frames.iter().filter(|sample| frames.contains(FrameIndex(sample.frame)));
    chosen.filter_map(|sample| {
        Some((sample, reference.record.frames.iter().find(|other| other.frame == sample.frame)?))
    })
}

/// The root of the mean square; `None` of nothing.
pub(crate) fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value * value, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sim::forecast::ProductSample;
    use serde_json::{Value as Json, json};
    use std::path::{Path, PathBuf};

    /// Jobs that make nothing.
    struct NoJobs;

    impl super::super::Jobs for NoJobs {
        fn simulate(
            &self,
            _: &Scene,
            _: &ShotFolder,
            _: &Frames,
            _: bool,
            _: Control,
        ) -> Result<usize, RunError> {
            Ok(0)
        }

        fn sample_products(
            &self,
            _: &Scene,
            _: &Frame,
            _: &Path,
            _: Control,
        ) -> Result<Vec<ProductSample>, RunError> {
            Ok(Vec::new())
        }
    }

    /// The values of some columns for a run next to a reference, whose frames are given as JSON.
    pub(crate) fn values<M: Measure, const N: usize>(
        measure: M,
        records: [&Json; 2],
        frames: &str,
        keys: [&str; N],
    ) -> [Option<f64>; N] {
        let scene: Scene = serde_json::from_value(json!({ "title": "t", "frames": "1-4" })).unwrap();
        let [run, reference] = records.map(|frames| {
            let record = json!({
                "frames": frames, "bytes": 0, "passes": [[["solve", 1.0]]], "cpu_seconds": [], "memory": null,
                "diverged": null, "frames_hash": 0, "distances": {},
            });
            let setting = Setting { label: String::new(), quality: None, set: Vec::new() };
            let folder =
                RunFolder { scene: scene.clone(), last: FrameIndex(4), path: PathBuf::new(), jobs: &NoJobs };
            Rc::new(Run { setting, folder, record: serde_json::from_value(record).unwrap(), product: None })
        });
        let (frames, distance) = (frames.parse().unwrap(), M::Distance::default());
        let columns = measure.columns();
        let run =
            ComparedRun { measure: Rc::new(measure), run, reference: Some(reference), distance, frames };
        keys.map(|key| {
            let column = columns.iter().find(|column| column.info.key == key).unwrap();
            column.of(&run).map(|spread| spread.median)
        })
    }
}
