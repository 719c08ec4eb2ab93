//! The tradeoff of the liquid: which settings of the solver are worth their time.
//!
//! Limits: splashing liquid is chaotic, so paths of particles diverge after some frames. Extents and energies are compared
//! over all frames, particles only as long as the reference agrees with its own refinement.

use super::volume::MAX_VOLUME_CHANGE;
use crate::{
    frame::{Frame, Stream},
    job::{
        Control, RunError,
        tradeoff::{About, Column, Shown, Unit, Wording},
    },
    mesh,
    preset::Frames,
    sim::{
        FrameRecord, Observable,
        liquid::{LiquidParams, LiquidRecord, SolverKind},
        scene::Scene,
        tradeoff::{
            self, Axis, Change, ComparedRun, FrameSample, Knob, Measure, Run, RunFolder, Runs, Subject,
            SystemRuns, multiples, rms,
        },
    },
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::rc::Rc;

/// The tradeoff of the liquid.
pub(super) static SUBJECT: Subject = Subject {
    name: "liquid",
    wording: &WORDING,
    columns: || COLUMNS.map(|column| column.info).to_vec(),
    knobs: |_| KNOBS.to_vec(),
    defaults,
    one_by_one: false,
    table: "liquid.",
    refuse: |_| None,
    key: Scene::simulation_key,
    runs: Runs::System(SystemRuns {
        size: |scene| format!("spacing {} m", scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing)),
        run: |sweep, job, control| {
            let observable = sweep.base.tradeoff.clone().unwrap_or_default().observable;
            tradeoff::tradeoff(&WORDING, LiquidRuns { observable, horizon: None }, sweep, job, control)
        },
    }),
};

const WORDING: Wording = Wording {
    whole: "the shot",
    seconds: "wall-clock time of simulating these frames",
    same: "the same frames as",
    criterion: "density",
    limit: "a mean density deviation of at most {}",
    incomparable: None,
};

type LiquidColumn = Column<ComparedRun<LiquidRuns>>;

/// Largest two-sided density deviation of the bulk with which a setting is recommended, mean over the frames. Settings of built-in
/// presets with `density_dev` up to 1 % have 0.3 to 1.2 %; at 2 % a metre of water is lower by two centimetres.
const MAX_DENSITY_DEVIATION: f64 = 0.02;

/// Largest RMS difference of mechanical energy with which a setting is recommended, relative to the reference's largest kinetic
/// energy. Settings of one spacing differ by up to 3 %, previews of half the particles along each axis by 3 to 15 %.
const MAX_ENERGY_DIFFERENCE: f64 = 0.1;

const COLUMNS: [LiquidColumn; 16] = [
    LiquidColumn::data("particles", Unit::Count, |run| {
        Some(run.samples().next_back()?.sample.particles as f64)
    }),
    LiquidColumn::data("substeps", Unit::Mean, |run| run.mean(|line| line.substeps.into())),
    LiquidColumn::data("iterations", Unit::Mean, |run| run.mean(|line| line.iterations.into())),
    LiquidColumn::data("unconverged", Unit::Count, |run| run.sum(|line| line.unconverged.into()))
        .remark("substeps stopped at max_iterations"),
    LiquidColumn::data("density_dev_avg", Unit::Percent, |run| run.mean(|line| line.density_dev_avg)),
    LiquidColumn::new("density", "density", Unit::Percent, |run| run.mean(LiquidRecord::bulk_dev_avg))
        .meaning("compression and dilation of the bulk together, mean over particles and frames")
        .criterion("density")
        .bound(MAX_DENSITY_DEVIATION),
    LiquidColumn::new("compression", "compression", Unit::Percent, |run| {
        run.mean(|line| line.compression_avg)
    })
    .meaning("of the bulk, mean over particles and frames"),
    LiquidColumn::new("dilation", "dilation", Unit::Percent, |run| run.mean(|line| line.dilation_avg))
        .meaning("the same of dilation"),
    LiquidColumn::new("density_dev_largest", "largest", Unit::Percent, |run| {
        run.max(|line| line.density_dev_max)
    })
    .meaning("largest density deviation of any particle in any frame")
    .shown(Shown::Page),
    LiquidColumn::new("volume_change", "volume", Unit::Change, |run| {
        run.logged().map(|line| line.volume_change).max_by(|a, b| a.abs().total_cmp(&b.abs()))
    })
    .meaning("volume of the particles over their volume at rest: the largest change in any frame")
    .bound(MAX_VOLUME_CHANGE),
    LiquidColumn::new("mesh_volume", "mesh", Unit::Change, |run| {
        let last = run.run.record.frames.iter().rev().find(|frame| frame.sample.volume.is_some())?;
        let particles = last.logged.as_ref()?.volume;
        Some(last.sample.volume? / particles - 1.0).filter(|change| change.is_finite())
    })
    .meaning("volume inside the surface over that of the particles, in the last frame")
    .shown(Shown::Page),
    LiquidColumn::new("isolated", "isolated", Unit::Mean, |run| run.mean(|line| line.isolated.into()))
        .meaning("particles with fewer than five neighbours, mean over the frames")
        .shown(Shown::Page),
    LiquidColumn::new("components", "components", Unit::Mean, |run| run.mean(|line| line.components.into()))
        .meaning("connected components, mean over the frames")
        .shown(Shown::Page),
    LiquidColumn::new("energy", "energy", Unit::Percent, |run| {
        let scale =
            run.reference_max(|frame| Some(frame.logged.as_ref()?.kinetic_energy * per_volume(frame)))?;
        Some(run.rms(|a, b| Some(mechanical(a)? - mechanical(b)?))? / scale)
    })
    .meaning("mechanical energy: RMS over the frames, relative to the reference's largest kinetic energy")
    .against_reference()
    .criterion("energy")
    .bound(MAX_ENERGY_DIFFERENCE),
    LiquidColumn::new("observable", "observable", Unit::Of("m"), |run| {
        let place = Observable::ALL.iter().position(|known| *known == run.measure.observable)?;
        run.rms(|a, b| Some(a.sample.observables.get(place)? - b.sample.observables.get(place)?))
    })
    .meaning("what the preset's [tradeoff] names: RMS over the frames")
    .against_reference()
    .criterion("observable"),
    LiquidColumn::new("position", "positions", Unit::Of("m"), |run| run.distance)
        .meaning("distance of particles of the same number: RMS over the frames up to the horizon")
        .against_reference(),
];

const MAX_ITERATIONS: &str = "liquid.max_iterations";
const MAX_SUBSTEPS: &str = "liquid.max_substeps";

const ITERATIONS: Knob = Knob::new("liquid.iterations", |scene, _| {
    let liquid = scene.liquid.as_mut()?;
    // One excludes the other.
    liquid.density_dev = None;
    Some(&mut liquid.iterations)
});
const CFL: Knob = Knob::new("liquid.cfl", |scene, _| Some(&mut scene.liquid.as_mut()?.cfl));
const MIN_SUBSTEPS: Knob =
    Knob::new("liquid.min_substeps", |scene, _| Some(&mut scene.liquid.as_mut()?.min_substeps));
const ITERATION_LIMIT: Knob =
    Knob::new(MAX_ITERATIONS, |scene, _| Some(&mut scene.liquid.as_mut()?.max_iterations));

const KNOBS: [Knob; 8] = [
    Knob::new("liquid.density_dev", |scene, _| Some(&mut scene.liquid.as_mut()?.density_dev))
        .times(0.5)
        .opens(MAX_ITERATIONS),
    ITERATIONS.times(2.0),
    ITERATION_LIMIT.times(2.0),
    CFL.times(0.5).opens(MAX_SUBSTEPS),
    MIN_SUBSTEPS.times(2.0).opens(MAX_SUBSTEPS),
    Knob::new("liquid.spacing", |scene, _| Some(&mut scene.liquid.as_mut()?.spacing)).times(2.0 / 3.0),
    ITERATION_LIMIT.limit(|_| MIN_REFERENCE_LIMIT),
    // Never below the fewest substeps.
    Knob::new(MAX_SUBSTEPS, |scene, _| Some(&mut scene.liquid.as_mut()?.max_substeps)).limit(|scene| {
        let fewest = scene.liquid.as_ref().map_or(0.0, |liquid| liquid.min_substeps.into());
        MIN_REFERENCE_LIMIT.max(fewest)
    }),
];

/// Iterations and substeps that a reference may take at least: it shows what the knobs do, not what the limits do. Ten
/// times what the defaults allow; more would let a target that is never reached take days.
const MIN_REFERENCE_LIMIT: f64 = 1000.0;

/// The largest `liquid.cfl` that a preset may have.
const MAX_CFL: f64 = 10.0;

/// What is varied by default: when a substep's iterations end, how long substeps are, and the solver.
///
/// The length of substeps has two limits, the CFL rule and `min_substeps`. Where one decides, the other does nothing, so
/// both are moved together, as far as a preset may.
fn defaults(scene: &Scene) -> Vec<Axis> {
    let Some(LiquidParams { iterations, max_substeps, .. }) = scene.liquid else { return Vec::new() };
    let liquid = |text: String, apply: fn(&mut LiquidParams, f32), value: f32| {
        vec![Change::new(text, move |scene| scene.liquid.iter_mut().for_each(|liquid| apply(liquid, value)))]
    };
    let solvers = vec![
        liquid("liquid.solver=accelerated".into(), |liquid, _| liquid.solver = SolverKind::Accelerated, 0.0),
        liquid("liquid.solver=jacobi".into(), |liquid, _| liquid.solver = SolverKind::Jacobi, 0.0),
    ];
    let ends = match iterations {
        Some(_) => multiples(scene, &[(ITERATIONS, [1.0, f64::MAX])], [0.5, 1.0, 2.0]),
        None => [("0.1%", 0.001), ("0.3%", 0.003), ("1%", 0.01)]
            .map(|(text, value)| {
                let set = |liquid: &mut LiquidParams, value| liquid.density_dev = Some(value);
                liquid(format!("liquid.density_dev={text}"), set, value)
            })
            .to_vec(),
    };
    let steps = [0.5, 1.0, 2.0].iter().filter_map(|factor| {
        let cfl = CFL.change(scene, |cfl| (cfl * factor).min(MAX_CFL))?;
        Some(vec![cfl, MIN_SUBSTEPS.change(scene, |n| (n / factor).min(max_substeps.into()))?])
    });
    vec![solvers, ends, steps.collect()]
}

/// How runs of the liquid are measured and compared.
#[derive(Debug)]
struct LiquidRuns {
    observable: Observable,
    /// The last frame up to which particles of the reference and its refinement stay within a spacing of each other (RMS). Beyond it their
    /// paths have diverged and are no measure of accuracy.
    horizon: Option<u32>,
}

/// What is measured of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LiquidSample {
    particles: usize,
    /// Distance between them at rest [m].
    spacing: f32,
    /// Every observable, in the order of [`Observable::ALL`].
    observables: Vec<f64>,
    /// Volume inside the surface [m³], of the first and the last frame.
    volume: Option<f64>,
}

/// Particles that are kept of every frame to compare positions: enough that the mean of their distances is known to 2 %.
const KEPT_PARTICLES: usize = 4096;

impl Measure for LiquidRuns {
    type Sample = LiquidSample;
    type Logged = LiquidRecord;
    type Distance = Option<f64>;

    const VERSION: &str = "liquid 4";

    fn decisive(&self, scene: &Scene) -> String {
        let surface = serde_json::to_string(&scene.surface).expect("settings are plain data");
        format!("{} {surface}", scene.simulation_key())
    }

    fn logged(record: FrameRecord) -> Option<LiquidRecord> {
        record.liquid
    }

    fn sample(
        &self,
        folder: &RunFolder,
        frame: &Frame,
        is_end: bool,
        control: Control,
    ) -> Result<(LiquidSample, Frame), RunError> {
        let spacing = folder.scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing);
        let Some(stream) = frame.streams.first() else {
            let sample = LiquidSample { particles: 0, spacing, observables: Vec::new(), volume: None };
            return Ok((sample, Frame { streams: Vec::new(), ..*frame }));
        };
        // Without the fit to colliders: the volume is to depend on the particles alone.
        let params = mesh::SurfaceParams { attributes: Some(Vec::new()), ..folder.scene.surface.clone() };
        let surface = is_end.then(|| mesh::reconstruct(stream, spacing, &params, control.cancel));
        let volume = surface.transpose().map_err(RunError::from)?.map(|surface| surface.check.volume);
        let observables = Observable::ALL.iter().filter_map(|what| what.of(stream)).collect();
        let sample = LiquidSample { particles: stream.len(), spacing, observables, volume };
        Ok((sample, thinned(frame, stream)))
    }

    fn prepare(&mut self, reference: &Run<Self>, refined: &Run<Self>) -> Result<(), RunError> {
        for FrameSample { frame, sample, .. } in &reference.record.frames {
            match particle_distance(reference, refined, *frame)? {
                Some(rms) if rms <= f64::from(sample.spacing) => self.horizon = Some(*frame),
                _ => break,
            }
        }
        Ok(())
    }

    /// RMS distance of the particles over the frames up to the horizon [m].
    fn distance(&self, run: &Run<Self>, reference: &Run<Self>, _: &Frames) -> Result<Option<f64>, RunError> {
        let Some(horizon) = self.horizon else { return Ok(None) };
        let mut distances = Vec::new();
        for FrameSample { frame, .. } in
            reference.record.frames.iter().filter(|sample| sample.frame <= horizon)
        {
            match particle_distance(run, reference, *frame)? {
                Some(distance) => distances.push(distance),
                None => return Ok(None),
            }
        }
        Ok(rms(distances.into_iter()))
    }

    fn columns(&self) -> Vec<LiquidColumn> {
        let mut columns = Vec::from(COLUMNS);
        for column in columns.iter_mut().filter(|column| column.info.key == "observable") {
            (column.info.heading, column.info.unit) =
                (self.observable.name(), Unit::Of(self.observable.unit()));
        }
        columns
    }

    fn describe(&self, runs: &[Rc<Run<Self>>], by: &str, about: &mut About) {
        about.facts.extend([("observable", json!(self.observable)), ("horizon", json!(self.horizon))]);
        let [settings @ .., reference, _] = runs else { return };
        let last = reference.record.frames.last().map(|frame| frame.frame);
        let horizon = match self.horizon {
            None => "none: the reference and its refinement do not have the same particles".into(),
            horizon if horizon == last => "particles are compared in all frames".into(),
            Some(frame) => {
                format!(
                    "particles are compared up to frame {frame}; then their paths differ by more than a spacing"
                )
            }
        };
        about.remarks.push(("horizon", horizon));
        let particles = |run: &Run<Self>| run.record.frames.last().map(|frame| frame.sample.particles);
        if by == "density" && settings.iter().any(|run| particles(run) != particles(reference)) {
            let note = "the settings differ in particles, so their densities cannot be compared; use --by observable or \
                        --by energy";
            about.remarks.push(("note", note.into()));
        }
    }
}

/// Energies are logged for the whole liquid. Its mass is density × volume, and runs of different spacing differ in mass by
/// what the seeding lattice leaves over.
fn per_volume(frame: &FrameSample<LiquidRuns>) -> f64 {
    1.0 / (frame.sample.particles as f64 * f64::from(frame.sample.spacing).powi(3))
}

fn mechanical(frame: &FrameSample<LiquidRuns>) -> Option<f64> {
    let logged = frame.logged.as_ref()?;
    Some((logged.kinetic_energy + logged.potential_energy) * per_volume(frame))
}

/// RMS distance of the kept particles of two runs in a frame [m]; `None` if they are not the same ones.
fn particle_distance(a: &Run<LiquidRuns>, b: &Run<LiquidRuns>, frame: u32) -> Result<Option<f64>, RunError> {
    let seeding = |run: &Run<LiquidRuns>| {
        let sample = &run.record.frames.first()?.sample;
        Some((sample.particles, sample.spacing.to_bits()))
    };
    if seeding(a) != seeding(b) {
        return Ok(None);
    }
    let (Some(a), Some(b)) = (a.folder.kept(frame)?, b.folder.kept(frame)?) else { return Ok(None) };
    let (Some(a), Some(b)) = (a.streams.first(), b.streams.first()) else { return Ok(None) };
    let (Some(x), Some(y)) = (a.vec3("position"), b.vec3("position")) else { return Ok(None) };
    if a.u32("id") != b.u32("id") {
        return Ok(None);
    }
    Ok(rms(x.iter().zip(y).map(|(x, y)| f64::from((x - y).norm()))))
}

/// About [`KEPT_PARTICLES`] of a frame, in order of their ids: the same in every run of as many particles.
fn thinned(frame: &Frame, stream: &Stream) -> Frame {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::tradeoff::values;
    use serde_json::Value as Json;

    /// Kinetic energies of 2 and 4 J, times `scale`, in frames 2 and 4.
    fn record(particles: usize, scale: f64, height: f64) -> Json {
        let frame = |frame: u32| {
            let observables = vec![height * f64::from(frame); Observable::ALL.len()];
            json!({
                "frame": frame,
                "sample": { "particles": particles, "spacing": 0.5, "observables": observables, "volume": null },
                "logged": { "kinetic_energy": scale * f64::from(frame), "potential_energy": scale },
            })
        };
        json!([frame(2), frame(4)])
    }

    #[test]
    fn energies_are_compared_by_volume_and_over_the_requested_frames() {
        let errors = |own: Json, frames: &str| {
            let measure = LiquidRuns { observable: Observable::Height, horizon: None };
            values(measure, [&own, &record(8, 1.0, 1.0)], frames, ["energy", "observable"])
        };
        // Half of everything in half of the particles.
        assert_eq!(errors(record(4, 0.5, 1.0), "1-4"), [Some(0.0); 2]);
        let near = |found: [Option<f64>; 2], expected: [f64; 2]| {
            let off = |k: usize| (found[k].unwrap() - expected[k]).abs();
            assert!(off(0) < 1e-12 && off(1) < 1e-12, "{found:?}");
        };
        // 3 and 5 J too much, over a largest kinetic energy of 4 J.
        near(errors(record(8, 2.0, 1.5), "1-4"), [17.0_f64.sqrt() / 4.0, 2.5_f64.sqrt()]);
        near(errors(record(8, 2.0, 1.5), "3-4"), [5.0 / 4.0, 2.0]);
        assert_eq!(errors(record(8, 2.0, 1.5), "5"), [None; 2]);
    }
}
