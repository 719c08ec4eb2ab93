//! What the volumes of a run cost, and what their voxel loses: of the run's last frame, kept on disk.

use super::row::{last, tracers};
use crate::{
    export::vdb::VolumeGrid,
    field::{TracerFieldParams, TracerFields, tracer_fields, tracer_fields_at},
    frame::Frame,
    grid::SparseGrid,
    math::Vec3,
    product::volume::{VolumeSettings, try_tracers},
    run::{
        Control, RunError, ShotFolder, solids,
        tradeoff::runs::{Place, Row},
        usage::Peak,
    },
};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

/// What a volume cost and what it lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Grids {
    /// Wall-clock time [s], once a repeat.
    pub seconds: Vec<f64>,
    /// The file [bytes].
    pub bytes: u64,
    /// The most memory that the process held [bytes], least of the repeats, where the system tells.
    pub memory: Option<u64>,
    /// See [`voxel_error`].
    pub error: Option<f64>,
}

/// Makes the volume of the last frame of a run until it has been timed `repeats` times; `None` if the shot makes none, or the run
/// did not come so far.
///
/// # Errors
/// Whatever stops the making of volumes.
pub(super) fn complete<F>(
    place: &Place<'_>,
    row: &Row<F>,
    repeats: usize,
    control: Control,
) -> Result<Option<Grids>, RunError> {
    let settings = settings(place, control)?;
    let wanted = settings.grids.iter().any(|grid| VolumeGrid::OF_TRACERS.contains(grid));
    let Some(frame) = last(place)?.filter(|_| wanted && row.diverged.is_none()) else { return Ok(None) };
    let path = place.folder.join(format!("volume-{:016x}.json", key(&settings)));
    let text = std::fs::read_to_string(&path).ok();
    let mut grids: Option<Grids> = text.and_then(|text| serde_json::from_str(&text).ok());
    while grids.as_ref().is_none_or(|grids| grids.seconds.len() < repeats) {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        let (peak, scratch) = (Peak::since_now(), place.folder.join("volume"));
        let Some(tried) = try_tracers(&frame, &settings, &scratch, control)? else { return Ok(None) };
        let memory = peak.bytes();
        // Only its size was wanted; what cannot be removed only takes room.
        let _ = std::fs::remove_dir_all(&scratch);
        let mut now = grids.take().unwrap_or_else(|| Grids {
            seconds: Vec::new(),
            bytes: tried.bytes,
            memory,
            error: voxel_error(&frame, &settings),
        });
        now.seconds.push(tried.seconds);
        now.memory = [now.memory, memory].into_iter().flatten().min();
        let text = serde_json::to_string_pretty(&now).expect("figures are plain data") + "\n";
        ShotFolder::write(path.clone(), &text)?;
        grids = Some(now);
    }
    Ok(grids)
}

fn settings(place: &Place<'_>, control: Control) -> Result<VolumeSettings, RunError> {
    let scene = solids::fill(place.scene, Some(&ShotFolder::new(&place.folder)), control.reporter)?;
    Ok(VolumeSettings::of(&scene))
}

fn key(settings: &VolumeSettings) -> u64 {
    let VolumeSettings { surface, volume, grids, .. } = settings;
    let text = format!("1 {} {} {volume:?} {grids:?}", surface.voxel, surface.kernel_radius);
    xxh3_64(text.as_bytes())
}

/// Tracers at which the voxel's error is seen: its mean is then known to 2 %.
const SEEN: usize = 4096;

/// How far the density of the grid, read between its nodes, is from the sum over the tracers itself: mean at the tracers, over the
/// mean density there. `None` without smoke.
fn voxel_error(frame: &Frame, settings: &VolumeSettings) -> Option<f64> {
    let (positions, density, spacing) = tracers(frame)?;
    let (voxel, radius) = (settings.surface.voxel * spacing, settings.surface.kernel_radius * spacing);
    let params = TracerFieldParams { spacing, radius, voxel, padding: 0 };
    let TracerFields { bricks, values: [values], .. } = tracer_fields(positions, [density], &params);
    let grid = SparseGrid::of(voxel, bricks, values);
    let points: Vec<Vec3> = positions.iter().step_by(positions.len().div_ceil(SEEN)).copied().collect();
    let exact = tracer_fields_at(&points, positions, density, spacing, radius);
    let off = points.iter().zip(&exact).map(|(&x, &exact)| f64::from((grid.trilinear(x) - exact).abs()));
    let (off, whole) = (off.sum::<f64>(), exact.iter().map(|&v| f64::from(v)).sum::<f64>());
    (whole > 0.0).then(|| off / whole)
}
