//! What is measured of a run of a liquid.

use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream},
    job::log,
    mesh,
    run::{
        Control, RunError, ShotFolder,
        tradeoff::runs::{self, Measure, Place},
    },
    sim::{FrameRecord, Observable, liquid::LiquidRecord},
};
use serde::{Deserialize, Serialize};

/// What came out of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Figures {
    /// Particles.
    pub particles: usize,
    /// Distance between them at rest [m].
    pub spacing: f32,
    /// What was seen in every frame.
    pub frames: Vec<Seen>,
    /// The surface's volume in the last frame over that in the first, less one.
    pub volume_change: Option<f64>,
}

/// A run of a liquid: what it cost and what came out.
pub(super) type Row = runs::Row<Figures>;

/// What was seen in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Its number.
    pub frame: u32,
    /// Every observable, in the order of [`Observable::ALL`].
    pub observables: Vec<f64>,
    /// What the simulation's log says; the first frame has none.
    pub logged: Option<LiquidRecord>,
}

/// Whether every observable has the same values to the last digit in all frames of both, as it has if they show the same
/// particles. No if one of them diverged.
pub(super) fn show_the_same(a: &Row, b: &Row) -> bool {
    let shown = |row: &Row| {
        let frames = row.found.frames.iter();
        frames.map(|seen| (seen.frame, seen.observables.clone())).collect::<Vec<_>>()
    };
    a.diverged.is_none() && b.diverged.is_none() && shown(a) == shown(b)
}

/// Particles that are kept of every frame to compare positions with: enough that the mean of their distances is known
/// to 2 %.
const KEPT_PARTICLES: usize = 4096;

/// Measures runs of a liquid.
pub(super) struct Particles;

impl Measure for Particles {
    type Found = Figures;

    const VERSION: &str = "liquid 2";

    fn measure(&self, place: &Place<'_>, shot: &ShotFolder, control: Control) -> Result<Figures, RunError> {
        let samples = place.folder.join("sample");
        ShotFolder::create(&samples)?;
        let mut log = log::read::<FrameRecord>(shot)?;
        let mut found = Figures {
            particles: 0,
            spacing: place.scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing),
            frames: Vec::new(),
            volume_change: None,
        };
        let present = cache::list(&shot.cache())?;
        let mut volumes = Vec::new();
        for (number, (index, path)) in present.iter().enumerate() {
            let (frame, _) = cache::read_frame(path)?;
            let Some(stream) = frame.streams.first() else { continue };
            found.particles = stream.len();
            let observables = Observable::ALL.iter().filter_map(|what| what.of(stream)).collect();
            let logged = log.remove(index).and_then(|line| line.record.liquid);
            found.frames.push(Seen { frame: index.0, observables, logged });
            cache::write_frame(&samples, &sample(&frame, stream), 0)?;
            if number == 0 || number + 1 == present.len() {
                volumes.push(volume(place, stream, found.spacing, control)?);
            }
        }
        if let [first, last] = volumes[..] {
            found.volume_change = Some(last / first - 1.0);
        }
        Ok(found)
    }
}

/// The volume of the surface [m³].
fn volume(place: &Place<'_>, stream: &Stream, spacing: f32, control: Control) -> Result<f64, RunError> {
    let keep_going = || !(control.interrupted)();
    mesh::reconstruct(stream, spacing, &place.scene.surface, &keep_going)
        .map(|surface| surface.check.volume)
        .map_err(RunError::from)
}

/// The kept particles of a frame, in order of their ids.
///
/// # Errors
/// If they cannot be read; without the frame, `None`.
pub(super) fn sampled(place: &Place<'_>, frame: u32) -> Result<Option<Stream>, RunError> {
    let path = cache::frame_path(&place.folder.join("sample"), FrameIndex(frame));
    if !path.exists() {
        return Ok(None);
    }
    Ok(cache::read_frame(&path)?.0.streams.into_iter().next())
}

/// About [`KEPT_PARTICLES`] of a frame, the same in every run of as many particles.
fn sample(frame: &Frame, stream: &Stream) -> Frame {
    let (Some(x), Some(id)) = (stream.vec3("position"), stream.u32("id")) else {
        return Frame { streams: Vec::new(), ..*frame };
    };
    let every = stream.len().div_ceil(KEPT_PARTICLES) as u32;
    let mut kept: Vec<usize> = (0..id.len()).filter(|&i| id[i].is_multiple_of(every)).collect();
    kept.sort_by_key(|&i| id[i]);
    let positions: Vec<_> = kept.iter().map(|&i| x[i]).collect();
    let ids: Vec<_> = kept.iter().map(|&i| id[i]).collect();
    let stream =
        Stream::new(&stream.name, stream.kind, kept.len()).with("position", positions).with("id", ids);
    Frame { streams: vec![stream], ..*frame }
}
