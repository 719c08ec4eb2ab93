//! The interface between a system and jobs.
//!
//! A system is one folder below `src/sim/`: its solver in the folder itself, and in `job/` everything that jobs need of it. Jobs,
//! scenes and the command line name no system; they loop over [`ALL`](super::registry::ALL).

use super::{
    SetupError,
    forecast::{ElementCount, ForecastJob, SystemForecast},
    record::{FrameRecord, SeedReport},
    scene::Scene,
    tradeoff::Subject,
};
use crate::{
    cache::StreamInfo,
    frame::{FrameIndex, StreamKind},
    job::{RunError, Total},
    math::Vec3,
    preset::{check::Places, problem::Finding},
    solid::Shape,
};

/// A simulated system, as jobs see it.
pub(crate) trait System: Sync {
    /// Its name in presets and reports.
    fn name(&self) -> &'static str;

    /// The table of presets that adds the system, and what it holds at least; `None`: it needs another system.
    fn preset_table(&self) -> Option<(&'static str, &'static str)> {
        None
    }

    /// Whether the preset names the system.
    fn is_present(&self, scene: &Scene) -> bool;

    /// Keys of presets that a branch cannot change, since they decide how the system starts or how its streams are laid out; `*` is
    /// any index of a list.
    fn fixed_at_branches(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether the force fields of a preset act on it.
    fn feels_forces(&self) -> bool {
        false
    }

    /// What `tradeoff` compares of it; `None`: nothing.
    fn tradeoff(&self) -> Option<&'static Subject> {
        None
    }

    /// The kinds of the streams that it has in frames.
    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[]
    }

    /// Reports everything about the system that contradicts itself or cannot be simulated.
    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>);

    /// Fills in defaults that depend on other keys of the preset.
    fn complete(&self, _scene: &mut Scene) {}

    /// The mesh files that the system's tables name, each with its dotted key.
    fn mesh_files<'a>(&self, _scene: &'a Scene) -> Vec<(String, &'a str)> {
        Vec::new()
    }

    /// The shapes of the system's tables, whose meshes are to be filled with sampled distances.
    fn shapes_mut<'a>(&self, _scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        Vec::new()
    }

    /// Reads files that are not shapes, and checks what can only be checked once the shapes are filled.
    ///
    /// # Errors
    /// If a file cannot be read, or the system cannot be simulated.
    fn finish_meshes(&self, _scene: &mut Scene) -> Result<(), RunError> {
        Ok(())
    }

    /// The numbers of its elements, with a bound of those at the shot's end.
    fn counts(&self, _scene: &Scene, _seeds: &SeedReport) -> Vec<ElementCount> {
        Vec::new()
    }

    /// Memory of simulating so many elements, without that of the program and of sampled meshes [bytes].
    fn memory(&self, _scene: &Scene, _counts: &[ElementCount]) -> f64 {
        0.0
    }

    /// Memory that seeding takes at least, known before it starts [bytes].
    fn seeding_memory(&self, _scene: &Scene) -> f64 {
        0.0
    }

    /// Forecasts what the system and the products of its frames need, by calibration; `None`: nothing of its own.
    ///
    /// # Errors
    /// If the system cannot start, diverges in its first frame or needs too much memory; if cancelled.
    fn forecast(&self, _job: &ForecastJob) -> Result<Option<SystemForecast>, RunError> {
        Ok(None)
    }

    /// What seeding left out or could not do, as warnings.
    fn seeding_warnings(&self, _seeds: &SeedReport) -> Vec<String> {
        Vec::new()
    }

    /// What the progress line of a simulated frame shows of the system; `None` if the frame has nothing of it.
    fn progress(&self, record: &FrameRecord) -> Option<String>;

    /// The limits that changed a frame, as warnings.
    fn warnings(&self, record: &FrameRecord) -> Vec<String>;

    /// Warnings that need all simulated frames of a shot together.
    fn shot_warnings(&self, _scene: &Scene, _frames: &[(FrameIndex, FrameRecord)]) -> Vec<String> {
        Vec::new()
    }

    /// Figures of a frame that reports plot over frames.
    fn plotted(&self, _record: &FrameRecord) -> Vec<PlottedFigure> {
        Vec::new()
    }

    /// Colours of its particles, for surfaces and pictures; `None`: they have none.
    fn colors(&self, _scene: &Scene) -> Option<ChannelColors> {
        None
    }

    /// Named numbers that the header of a cached frame holds, for `info`.
    fn frame_figures(&self, _streams: &[StreamInfo]) -> Vec<(&'static str, f64)> {
        Vec::new()
    }

    /// Sums and extremes over cached frames, for `info`.
    fn totals(&self, _frames: &[CachedFrame]) -> Vec<Total> {
        Vec::new()
    }
}

/// A figure of a frame in a plot over frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlottedFigure {
    /// Title of the plot; figures with the same are in one.
    pub(crate) plot: &'static str,
    /// Unit of its values.
    pub(crate) unit: &'static str,
    /// Name of the line.
    pub(crate) series: &'static str,
    pub(crate) value: f64,
}

impl PlottedFigure {
    /// The figures of one plot.
    pub(crate) fn of<const N: usize>(
        plot: &'static str,
        unit: &'static str,
        series: [(&'static str, f64); N],
    ) -> [Self; N] {
        series.map(|(series, value)| Self { plot, unit, series, value })
    }
}

/// Colours of a stream by the numbers in one of its channels, so that they can be changed without a new simulation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ChannelColors {
    /// Name of the stream.
    pub(crate) stream: &'static str,
    /// Name of its channel of integers.
    pub(crate) channel: &'static str,
    /// Linear red, green and blue of each number from 0 on, from 0 to 1.
    pub(crate) colors: Vec<Vec3>,
}

/// What is known of a cached frame without its channels.
#[derive(Clone, Debug, Default)]
pub(crate) struct CachedFrame {
    /// Number of the frame.
    pub(crate) index: FrameIndex,
    /// The streams in its header.
    pub(crate) streams: Vec<StreamInfo>,
    /// Its record in the log; `None` of a frame that is not logged, as the first.
    pub(crate) record: Option<FrameRecord>,
}

impl From<SetupError> for RunError {
    fn from(why: SetupError) -> Self {
        Self::Setup(Box::new(why))
    }
}

/// The files of a shape, if it is a mesh, each with its dotted key.
pub(crate) fn mesh_files((key, shape): (String, &Shape)) -> impl Iterator<Item = (String, &str)> {
    let mesh = if let Shape::Mesh(mesh) = shape { Some(mesh) } else { None };
    let cache = mesh.and_then(|mesh| mesh.point_cache.as_deref());
    let cache = cache.map(|file| (format!("{key}.mesh.point_cache"), file));
    mesh.map(|mesh| (format!("{key}.mesh.file"), mesh.file.as_str())).into_iter().chain(cache)
}
