//! Forecast of the sheets.
//!
//! *Method*: the shot's own first frames are run, as many as time allows. Sheets have the same points in every frame, so later
//! frames are assumed to cost what the later half of these did.
//! Limits: substeps that become shorter where a sheet collides with fast solids late in the shot are not seen.

use crate::{
    frame::StreamKind,
    job::{RunError, scratch::Scratch},
    preset::Frames,
    sim::{
        Simulation, Systems,
        forecast::{
            CalibrationLimits, ElementCount, ForecastJob, ProductForecast, ProductSample, SystemForecast,
            calibrate, failures,
        },
        scene::Scene,
    },
};

/// Longest time for the first frames [s].
const SECONDS: f64 = 10.0;

/// Relative error that the time may have [–].
const UNCERTAINTY: f64 = 0.5;

/// Memory of simulating [bytes/point]: 360 to 410 were measured on grids of 160 000 and a million points, by the implicit
/// integrator and with repulsion …
const POINT_BYTES: f64 = 410.0;

/// … in addition with bending [bytes/point]: 1030 to 1040, with shear …
const BENDING_BYTES: f64 = 1050.0;

/// … and with contact [bytes/point]: bounding boxes and lists of pairs. `falling-sheets` took 3 300 a point, and 6 250 with
/// twice the cells, where each point had 25 pairs.
const CONTACT_BYTES: f64 = 6500.0;

/// Memory of so many points [bytes].
pub(super) fn memory(scene: &Scene, points: f64) -> f64 {
    let named = |is_named: bool, bytes: f64| if is_named { bytes } else { 0.0 };
    let has_contact = scene.sheets.as_ref().is_some_and(|common| common.contact.is_some());
    let bends = scene.sheet.iter().any(|sheet| sheet.bending.is_some());
    points * (POINT_BYTES + named(bends, BENDING_BYTES) + named(has_contact, CONTACT_BYTES))
}

/// Memory of simulating the sheets of a scene, without building them [bytes].
pub(super) fn seeding_memory(scene: &Scene) -> f64 {
    memory(scene, scene.sheet.iter().map(|sheet| sheet.shape.points()).sum())
}

/// Element counts of sheets, which are constant.
pub(super) fn counts(points: u32) -> Vec<ElementCount> {
    vec![ElementCount::constant("points", StreamKind::MeshPoints, points.into())]
}

/// Substeps, iterations, seconds and bytes of a frame.
type FrameCosts = [f64; 4];

/// Forecasts the sheets of a scene with its rigid bodies, without the systems that they are coupled with otherwise.
///
/// # Errors
/// As [`System::forecast`](crate::sim::system::System::forecast).
pub(super) fn forecast(job: &ForecastJob) -> Result<SystemForecast, RunError> {
    let frames = job.simulated();
    let Systems { sheets, bodies, forces, timeline, .. } = job.scene.systems();
    let systems = Systems { sheets, bodies, forces, timeline, ..Systems::default() };
    let mut simulation = Simulation::new(job.scene.surroundings(), systems)?;
    let points = simulation.seeded().sheets.unwrap_or_default().points;
    let (mut costs, mut first_bytes): (Vec<FrameCosts>, f64) = (Vec::new(), 0.0);
    let (scratch, mut last) = (Scratch::new()?, job.scene.frames.first());
    let shot = scratch.shot()?;
    let limits = CalibrationLimits { seconds: SECONDS, min_frames: 0, keeps_frames: true };
    let ended = calibrate(job, &mut simulation, &shot, limits, &mut |frame| {
        if frame.number > 0 {
            let record = frame.record.sheets.unwrap_or_default();
            let counts = [record.substeps, record.iterations].map(f64::from);
            costs.push([counts[0], counts[1], frame.seconds, frame.bytes]);
        } else {
            first_bytes = frame.bytes;
        }
        last = frame.frame.index;
        Ok(())
    })?;
    // A point cache holds all frames, and the mesh that it moves once.
    let all = Frames::from_first_to_last(job.scene.frames.first(), last).expect("frames ascend");
    let products = job.products.sample(job.scene, &shot, &all, job.control)?;
    let mut remarks = Vec::new();
    if let Some(why) = ended.and_then(|ended| ended.diverged) {
        remarks.push(format!("the shot itself diverged in the calibration of the sheets: {why}"));
    }
    if costs.is_empty() && frames > 0 {
        remarks.push(
            "the first frame takes longer than the calibration; the time and files of the sheets are not known"
                .into(),
        );
    } else if costs.len() < frames {
        remarks.push(format!(
            "the calibration of the sheets reached {} of {frames} frames; later ones are assumed to be like them",
            costs.len()
        ));
    }
    remarks.extend(failures(&products));
    let [substeps, iterations, seconds, bytes] = [0, 1, 2, 3].map(|k| total(&costs, frames, k));
    let stored = job.stored() as f64;
    let sampled = all.count() as f64;
    let product = |sample: &ProductSample| ProductForecast {
        name: sample.name,
        bytes: sample.bytes / sampled * stored,
        seconds: sample.seconds / sampled * stored,
        memory: sample.memory,
    };
    Ok(SystemForecast {
        name: "sheets",
        counts: counts(points),
        substeps,
        iterations,
        cache: (first_bytes + bytes) / (frames + 1) as f64 * stored,
        seconds,
        uncertainty: UNCERTAINTY,
        products: products.iter().map(product).collect(),
        totals: Vec::new(),
        remarks,
    })
}

/// A quantity of all frames.
fn total(costs: &[FrameCosts], frames: usize, k: usize) -> f64 {
    let own: f64 = costs.iter().map(|costs| costs[k]).sum();
    let late = &costs[costs.len() / 2..];
    let mean = late.iter().map(|costs| costs[k]).sum::<f64>() / late.len().max(1) as f64;
    own + mean * frames.saturating_sub(costs.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_frames_cost_as_much_as_the_later_half_of_the_calibrated_ones() {
        let costs = [[9.0, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [4.0, 0.0, 0.0, 0.0]];
        assert_eq!(total(&costs, 4, 0), 18.0);
        assert_eq!(total(&costs, 10, 0), 18.0 + 6.0 * 3.0);
        assert_eq!(total(&[], 10, 0), 0.0);
    }
}
