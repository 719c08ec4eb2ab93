//! The tradeoff of the smoke: which settings of its motion and of its volumes are worth their time.
//!
//! *Method*: the velocity is also compared with the sum over all pairs, at sampled vortons of every frame, and the volume of
//! the last frame with the sum over its tracers: these two errors need no reference.
//!
//! Turbulent smoke is chaotic, so nothing is compared tracer by tracer. Compared are densities on a grid of two spacings, where the
//! smoke is as a whole, and the invariants of its motion.
//!
//! Limits: eddies smaller than the cells of the comparison grid do not show.

use crate::{
    export::vdb::VolumeGrid,
    field::{TracerFieldParams, TracerFields, tracer_fields, tracer_fields_at},
    frame::{Frame, Stream, StreamKind},
    grid::{BRICK_NODES, SparseGrid, node_of},
    job::{
        Control, RunError, ShotFolder,
        tradeoff::{About, Column, Shown, Spread, Unit, Wording},
        usage::Peak,
    },
    math::Vec3,
    mesh::SurfaceParams,
    par,
    preset::Frames,
    sim::{
        FrameRecord,
        scene::Scene,
        smoke::{self, SmokeParams, SmokeRecord},
        tradeoff::{
            self, Axis, Change, ComparedRun, FrameSample, Knob, Measure, ProductRecord, Run, RunFolder, Runs,
            Subject, SystemRuns, multiples, pairs,
        },
        vortex::{
            ERRORS, Invariants,
            flow::{FlowParams, Sum},
            grid_errors,
        },
    },
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::rc::Rc;
use xxhash_rust::xxh3::xxh3_64;

/// The tradeoff of the smoke.
pub(super) static SUBJECT: Subject = Subject {
    name: "smoke",
    wording: &WORDING,
    columns: || COLUMNS.map(|column| column.info).to_vec(),
    knobs: |_| KNOBS.to_vec(),
    defaults,
    one_by_one: true,
    table: "smoke.",
    refuse: |key| {
        let why =
            "does not change the smoke, expected smoke.… or surface.voxel; compare other systems with --of";
        let table = key.split(['.', '=']).next().unwrap_or(key);
        (!["smoke", "surface", "volume", "world", "fps"].contains(&table)).then_some(why)
    },
    key: |scene| {
        let Scene { surface, volume, output, .. } = scene;
        let text = serde_json::to_string(&(scene.simulation_key(), surface, volume, &output.volume));
        xxh3_64(text.expect("settings are plain data").as_bytes())
    },
    runs: Runs::System(SystemRuns {
        size: |scene| format!("spacing {} m", spacing(scene)),
        run: |sweep, job, control| {
            let measure = SmokeRuns { cell: CELL * spacing(&sweep.base) };
            tradeoff::tradeoff(&WORDING, measure, sweep, job, control)
        },
    }),
};

fn spacing(scene: &Scene) -> f32 {
    scene.smoke.as_ref().map_or(0.0, |smoke| smoke.spacing)
}

const WORDING: Wording = Wording {
    whole: "the shot",
    seconds: "wall-clock time of simulating these frames",
    same: "the same motion as",
    criterion: "density",
    limit: "at most {} of the smoke displaced",
    incomparable: None,
};

type SmokeColumn = Column<ComparedRun<SmokeRuns>>;

const COLUMNS: [SmokeColumn; 17] = [
    SmokeColumn::times("volume_seconds", "volume time", |run| Spread::of(&run.run.product.as_ref()?.seconds))
        .meaning("wall-clock time of the volume of the last frame"),
    SmokeColumn::data("cache", Unit::Count, |run| Some(run.run.record.bytes as f64)),
    SmokeColumn::new("volume", "MB a volume", Unit::Megabytes, |run| Some(run.run.product.as_ref()?.bytes as f64))
        .shown(Shown::Page),
    SmokeColumn::new("vortons", "vortons", Unit::Count, |run| Some(run.samples().next_back()?.sample.counts[0] as f64)),
    SmokeColumn::data("tracers", Unit::Count, |run| Some(run.samples().next_back()?.sample.counts[1] as f64)),
    SmokeColumn::data("substeps", Unit::Mean, |run| run.mean(|line| line.flow.substeps.into())),
    SmokeColumn::data("capped", Unit::Count, |run| run.sum(|line| line.flow.capped.into()))
        .remark("substeps were longer than their limits"),
    SmokeColumn::data("clamped", Unit::Count, |run| run.sum(|line| line.flow.clamped as f64))
        .remark("strengths were clamped"),
    SmokeColumn::new("velocity", "velocity", Unit::Percent, |run| {
        run.logged().filter_map(|line| line.account.error).reduce(f64::max)
    })
    .meaning("error against the sum over all pairs, at sampled vortons: largest of the frames")
    .criterion("velocity"),
    SmokeColumn::new("density", "density", Unit::Percent, |run| run.distance)
        .meaning("displaced fraction of the smoke: Σ|ρ − ρ′| / Σ(ρ + ρ′) on the comparison grid, mean of the frames")
        .against_reference()
        .criterion("density"),
    SmokeColumn::new("center", "centre", Unit::Percent, |run| {
        run.rms(|a, b| {
            let (a, b) = (a.sample.body?, b.sample.body.filter(|b| b.size > 0.0)?);
            Some(distance(a.center, b.center) / b.size)
        })
    })
    .meaning("between the centres of the smoke, in its sizes: RMS over the frames")
    .against_reference()
    .criterion("center"),
    SmokeColumn::new("extent", "extent", Unit::Percent, |run| {
        run.rms(|a, b| {
            let (a, b) = (a.sample.body?, b.sample.body.filter(|b| b.size > 0.0)?);
            Some(a.size / b.size - 1.0)
        })
    })
    .meaning("size of the smoke: RMS over the frames")
    .against_reference()
    .criterion("extent"),
    SmokeColumn::new("energy", "energy", Unit::Percent, |run| {
        let scale = run.reference_max(|sample| Some(invariants(sample)?.energy))?;
        Some(run.rms(|a, b| Some(invariants(a)?.energy - invariants(b)?.energy))? / scale)
    })
    .meaning("kinetic energy of the air: RMS over the frames, relative to the reference's largest")
    .against_reference()
    .criterion("energy"),
    SmokeColumn::new("impulse", "impulse", Unit::Percent, |run| {
        let scale = run.reference_max(|sample| Some(sample.sample.push))?;
        Some(run.rms(|a, b| Some(distance(invariants(a)?.impulse, invariants(b)?.impulse)))? / scale)
    })
    .meaning("impulse of the air: RMS over the frames, relative to that of vortons which all push one way")
    .against_reference()
    .criterion("impulse"),
    SmokeColumn::new("voxel", "voxel", Unit::Percent, |run| run.run.product.as_ref()?.error)
        .meaning("the volume's density between its nodes against the sum over tracers, mean")
        .criterion("voxel")
        .timed_by("volume_seconds"),
    SmokeColumn::new("drift.energy", "energy drift", Unit::Change, |run| {
        let (start, end) = ends(run)?;
        let [start, end] = [invariants(start)?.energy, invariants(end)?.energy];
        (start > 0.0).then(|| end / start - 1.0)
    })
    .meaning("energy of the air at the end against the start; only without buoyancy, viscosity and solids it should be 0")
    .shown(Shown::Page),
    SmokeColumn::new("drift.impulse", "impulse drift", Unit::Percent, |run| {
        let (start, end) = ends(run)?;
        let change = distance(invariants(start)?.impulse, invariants(end)?.impulse);
        (start.sample.push > 0.0).then(|| change / start.sample.push)
    })
    .meaning("the same of its impulse")
    .shown(Shown::Page),
];

/// First and last frame of the log.
fn ends(run: &ComparedRun<SmokeRuns>) -> Option<(&FrameSample<SmokeRuns>, &FrameSample<SmokeRuns>)> {
    let mut logged = run.run.record.frames.iter().filter(|sample| sample.logged.is_some());
    let first = logged.next()?;
    Some((first, logged.next_back().unwrap_or(first)))
}

fn invariants(sample: &FrameSample<SmokeRuns>) -> Option<&Invariants> {
    sample.logged.as_ref().map(|logged| &logged.account.invariants)
}

fn flow(scene: &mut Scene) -> Option<&mut FlowParams> {
    scene.smoke.as_mut().map(|smoke| &mut smoke.flow)
}

const SUM: &str = "smoke.flow.sum";
const MAX_SUBSTEPS: &str = "smoke.flow.max_substeps";

// The other sums keep no requested error.
const ERROR: Knob = Knob::new("smoke.flow.error", |scene, _| {
    Some(&mut flow(scene).filter(|flow| [Sum::Tree, Sum::Grid].contains(&flow.sum))?.error)
});
const STRAIN: Knob = Knob::new("smoke.flow.strain", |scene, _| Some(&mut flow(scene)?.strain));
const DISPLACEMENT: Knob =
    Knob::new("smoke.flow.displacement", |scene, _| Some(&mut flow(scene)?.displacement));
const OVERLAP: Knob = Knob::new("smoke.overlap", |scene, _| Some(&mut scene.smoke.as_mut()?.overlap));
const REMESH_CORE: Knob =
    Knob::new("smoke.flow.remesh.core", |scene, _| Some(&mut flow(scene)?.remesh.as_mut()?.core));
const VOXEL: Knob = Knob::new("surface.voxel", |scene, _| Some(&mut scene.surface.voxel));

/// Steps of seven tenths take 1.4 times as long and have a third of the error, which is of third order; spacings of four
/// fifths take twice the vortons. Finer ones would show more, but a reference that is refined once more then takes hours.
const KNOBS: [Knob; 7] = [
    // Sums over all pairs are finer than any other.
    Knob::choice(SUM, |scene| {
        let flow = flow(scene).filter(|flow| flow.sum != Sum::Direct)?;
        flow.sum = Sum::Tree;
        Some("tree")
    })
    .always(),
    ERROR.times_down_to(0.5, MIN_ERROR).always(),
    STRAIN.times(0.7).opens(MAX_SUBSTEPS).always(),
    DISPLACEMENT.times(0.7).opens(MAX_SUBSTEPS).always(),
    Knob::new("smoke.spacing", |scene, _| Some(&mut scene.smoke.as_mut()?.spacing)).times(0.8),
    Knob::new("smoke.tracers", |scene, _| Some(&mut scene.smoke.as_mut()?.tracers)).times(0.8),
    Knob::new(MAX_SUBSTEPS, |scene, _| Some(&mut flow(scene)?.max_substeps)).limit(|_| 1000.0),
];

/// The smallest error that sums can be requested to keep.
const MIN_ERROR: f64 = 1e-5;

/// Vortons and tracers at the start up to which sums over all pairs are a default: more take too long to wait for.
const MAX_DIRECT: f64 = 20_000.0;

/// What is varied by default: the error, the method, the steps, the cores, and the voxel of volumes; as far as a preset may.
fn defaults(scene: &Scene) -> Vec<Axis> {
    let Some(SmokeParams { flow, .. }) = &scene.smoke else { return Vec::new() };
    let of_grid = grid_errors(flow.kernel);
    let errors = if flow.sum == Sum::Grid { &of_grid } else { &ERRORS };
    let errors = [*errors.start(), *errors.end()].map(f64::from);
    let sum = |name: &str, sum: Sum| {
        let apply = move |scene: &mut Scene| scene.smoke.iter_mut().for_each(|smoke| smoke.flow.sum = sum);
        vec![Change::new(format!("{SUM}={name}"), apply)]
    };
    let grid = of_grid.contains(&flow.error).then(|| sum("grid", Sum::Grid));
    let direct = scene.few_vortons(MAX_DIRECT).then(|| sum("direct", Sum::Direct));
    let mut axes = vec![
        multiples(scene, &[(ERROR, errors)], [3.0, 1.0, 0.3]),
        [Some(sum("tree", Sum::Tree)), grid, direct].into_iter().flatten().collect(),
        multiples(scene, &[(STRAIN, [0.0, 100.0]), (DISPLACEMENT, [0.0, 100.0])], [0.5, 1.0, 2.0]),
        multiples(scene, &[(OVERLAP, [0.8, 4.0]), (REMESH_CORE, [1.0, 2.5])], [0.8, 1.0, 1.25]),
    ];
    if !scene.output.volume.is_empty() {
        axes.push(multiples(scene, &[(VOXEL, [0.05, 10.0])], [0.7, 1.0, 1.5]));
    }
    axes
}

/// Cells of the comparison grid, in spacings of the preset's vortons: finer ones would distinguish eddies that no setting
/// of a shot places the same way twice.
const CELL: f32 = 2.0;

/// Support of the kernel that makes a density of tracers, in cells: smooth enough that it does not matter where between nodes a
/// tracer is.
const REACH: f32 = 2.0;

/// How runs of smoke are measured and compared.
#[derive(Debug)]
struct SmokeRuns {
    /// Cells of the comparison grid [m].
    cell: f32,
}

/// What is measured of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SmokeSample {
    /// Vortons and tracers.
    counts: [usize; 2],
    /// Where the smoke is, if there is any.
    body: Option<Body>,
    /// ½ Σ |x − c| |Γ| about the centre of |Γ| [m⁴/s]: what the impulse would be if all vortons pushed one way.
    push: f64,
}

/// Where smoke is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Body {
    /// Centre, weighted by density [m].
    center: [f64; 3],
    /// Root mean square of the distance to the centre, by density [m].
    size: f64,
}

/// A node of the comparison grid, and the density there.
type Node = ([i32; 3], f32);

/// The folder of a run's last frame.
const LAST: &str = "last";

impl Measure for SmokeRuns {
    type Sample = SmokeSample;
    type Logged = SmokeRecord;
    /// The displaced fraction of the smoke, mean of the frames.
    type Distance = Option<f64>;

    const VERSION: &str = "smoke 2";

    fn decisive(&self, scene: &Scene) -> String {
        format!("{} {}", scene.simulation_key(), self.cell)
    }

    /// The smoke alone, with the error of its velocity sampled in every frame.
    fn scene(&self, scene: &Scene) -> Scene {
        let mut alone = scene.smoke_alone();
        alone.smoke.iter_mut().for_each(|smoke| smoke.sample_every = 1);
        alone
    }

    fn logged(record: FrameRecord) -> Option<SmokeRecord> {
        record.smoke
    }

    fn sample(
        &self,
        folder: &RunFolder,
        frame: &Frame,
        _: bool,
        _: Control,
    ) -> Result<(SmokeSample, Frame), RunError> {
        if frame.index == folder.last {
            folder.write(LAST, frame)?;
        }
        let count = |name: &str| frame.stream(name).map_or(0, Stream::len);
        let body = tracers(frame).and_then(|(positions, density, _)| {
            let weight = |i: usize| f64::from(density[i]);
            let (center, size) = spread(positions, &weight)?;
            Some(Body { center, size })
        });
        let vortons =
            frame.stream(smoke::NAME).and_then(|s| Some((s.vec3("position")?, s.vec3("strength")?)));
        let push = vortons.and_then(|(positions, strength)| {
            let weight = |i: usize| f64::from(strength[i].norm());
            let (center, _) = spread(positions, &weight)?;
            let arm = |i: usize| distance(positions[i].map(f64::from).into(), center);
            Some(0.5 * par::sum(positions.len(), |i| weight(i) * arm(i)))
        });
        let counts = [smoke::NAME, smoke::TRACERS].map(count);
        Ok((SmokeSample { counts, body, push: push.unwrap_or(0.0) }, self.compared(frame)))
    }

    /// Volumes of the last frame; none if the shot makes none of smoke.
    fn product(
        &self,
        folder: &RunFolder,
        repeats: usize,
        control: Control,
    ) -> Result<Option<ProductRecord>, RunError> {
        let Scene { surface, volume, output, .. } = &folder.scene;
        let is_requested = output.volume.iter().any(|grid| VolumeGrid::OF_TRACERS.contains(grid));
        let Some(frame) = folder.read(LAST, folder.last)?.filter(|_| is_requested) else { return Ok(None) };
        let text = format!("2 {} {} {volume:?} {:?}", surface.voxel, surface.kernel_radius, output.volume);
        let path = folder.path.join(format!("volume-{:016x}.json", xxh3_64(text.as_bytes())));
        let text = std::fs::read_to_string(&path).ok();
        let mut record: Option<ProductRecord> = text.and_then(|text| serde_json::from_str(&text).ok());
        while record.as_ref().is_none_or(|record| record.seconds.len() < repeats) {
            if control.cancel.is_cancelled() {
                return Err(RunError::Interrupted);
            }
            let (peak, scratch) = (Peak::since_now(), folder.path.join("volume"));
            let made = folder.jobs.sample_products(&folder.scene, &frame, &scratch, control)?;
            let memory = peak.bytes();
            tradeoff::remove(&scratch);
            if let Some(why) = made.iter().find_map(|product| product.failed.as_ref()) {
                return Err(RunError::Request(format!("frame {}: {why}", folder.last)));
            }
            if made.is_empty() {
                return Ok(None);
            }
            let seconds: f64 = made.iter().map(|product| product.seconds).sum();
            let bytes = made.iter().map(|product| product.bytes as u64).sum();
            let mut now = record.take().unwrap_or_else(|| {
                let error = voxel_error(&frame, surface);
                ProductRecord { seconds: Vec::new(), bytes, memory, error }
            });
            now.seconds.push(seconds);
            now.memory = [now.memory, memory].into_iter().flatten().min();
            let text = serde_json::to_string_pretty(&now).expect("figures are plain data") + "\n";
            ShotFolder::write(path.clone(), &text)?;
            record = Some(now);
        }
        Ok(record)
    }

    fn distance(
        &self,
        run: &Run<Self>,
        reference: &Run<Self>,
        frames: &Frames,
    ) -> Result<Option<f64>, RunError> {
        let (mut sum, mut count) = (0.0, 0_usize);
        for (FrameSample { frame, .. }, _) in pairs(run, reference, frames) {
            let (a, b) = (run.folder.kept(*frame)?, reference.folder.kept(*frame)?);
            let Some(fraction) = a.zip(b).and_then(|(a, b)| displaced(&nodes(&a), &nodes(&b))) else {
                continue;
            };
            (sum, count) = (sum + fraction, count + 1);
        }
        Ok((count > 0).then(|| sum / count as f64))
    }

    fn columns(&self) -> Vec<SmokeColumn> {
        COLUMNS.into()
    }

    fn describe(&self, _: &[Rc<Run<Self>>], _: &str, about: &mut About) {
        about.facts.push(("cell", json!(self.cell)));
        about.remarks.push(("grid", format!("densities are compared on cells of {} m", self.cell)));
    }
}

impl SmokeRuns {
    /// The density of a frame on the comparison grid, as a stream of nodes that have smoke, in their order.
    fn compared(&self, frame: &Frame) -> Frame {
        let mut nodes: Vec<Node> = Vec::new();
        if let Some((positions, density, spacing)) = tracers(frame) {
            let Self { cell } = *self;
            let params = TracerFieldParams { spacing, radius: REACH * cell, voxel: cell, padding: 0 };
            let TracerFields { bricks, values: [values], .. } = tracer_fields(positions, [density], &params);
            let node = |slot: usize| node_of(bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES);
            let filled = values.iter().enumerate().filter(|(_, value)| **value > 0.0);
            nodes.extend(filled.map(|(slot, &value)| (node(slot), value)));
            nodes.sort_unstable_by_key(|(node, _)| *node);
        }
        let places: Vec<Vec3> = nodes.iter().map(|(node, _)| Vec3::from(node.map(|k| k as f32))).collect();
        let density: Vec<f32> = nodes.iter().map(|(_, value)| *value).collect();
        let stream = Stream::new("lattice", StreamKind::Unknown, nodes.len())
            .with("node", places)
            .with("density", density);
        Frame { streams: vec![stream], ..*frame }
    }
}

/// The nodes of a comparison grid that were kept.
fn nodes(kept: &Frame) -> Vec<Node> {
    let columns = kept.streams.first().and_then(|s| Some((s.vec3("node")?, s.f32("density")?)));
    let (nodes, density) = columns.unwrap_or_default();
    nodes.iter().map(|x| [0, 1, 2].map(|axis| x[axis] as i32)).zip(density.iter().copied()).collect()
}

/// Σ|ρ − ρ′| / Σ(ρ + ρ′) of densities at nodes, each in order of the nodes; `None` if there is no smoke in either.
fn displaced(a: &[Node], b: &[Node]) -> Option<f64> {
    let (mut i, mut j, mut off, mut whole) = (0, 0, 0.0, 0.0);
    while i < a.len() || j < b.len() {
        let next = [a.get(i), b.get(j)].into_iter().flatten().map(|(node, _)| *node).min();
        let take = |list: &[Node], at: &mut usize| match list.get(*at) {
            Some((node, value)) if Some(*node) == next => {
                *at += 1;
                f64::from(*value)
            }
            _ => 0.0,
        };
        let (x, y) = (take(a, &mut i), take(b, &mut j));
        off += (x - y).abs();
        whole += x + y;
    }
    (whole > 0.0).then(|| off / whole)
}

/// Positions and densities of a frame's tracers, and the distance at which they were seeded [m]; `None` without any.
fn tracers(frame: &Frame) -> Option<(&[Vec3], &[f32], f32)> {
    let stream = frame.stream(smoke::TRACERS).filter(|stream| !stream.is_empty())?;
    let spacing = stream.spacing()?;
    Some((stream.vec3("position")?, stream.f32("density")?, spacing))
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// The centre of points by `weight`, and the root of their mean square distance to it; `None` if nothing weighs anything.
fn spread(points: &[Vec3], weight: &(dyn Fn(usize) -> f64 + Sync)) -> Option<([f64; 3], f64)> {
    let whole = par::sum(points.len(), weight);
    if whole <= 0.0 {
        return None;
    }
    let center = [0, 1, 2].map(|k| par::sum(points.len(), |i| weight(i) * f64::from(points[i][k])) / whole);
    let arm = |i: usize| distance(points[i].map(f64::from).into(), center);
    let square = par::sum(points.len(), |i| weight(i) * arm(i).powi(2));
    Some((center, (square / whole).sqrt()))
}

/// Tracers at which the voxel's error is sampled: its mean is then known to 2 %.
const SAMPLED_TRACERS: usize = 4096;

/// Difference between the density of the grid, read between its nodes, and the sum over the tracers themselves: mean at the
/// tracers, relative to the mean density there. `None` without smoke.
fn voxel_error(frame: &Frame, surface: &SurfaceParams) -> Option<f64> {
    let (positions, density, spacing) = tracers(frame)?;
    let (voxel, radius) = (surface.voxel * spacing, surface.kernel_radius * spacing);
    let params = TracerFieldParams { spacing, radius, voxel, padding: 0 };
    let TracerFields { bricks, values: [values], .. } = tracer_fields(positions, [density], &params);
    let grid = SparseGrid::of(voxel, bricks, values);
    let sampled = positions.iter().step_by(positions.len().div_ceil(SAMPLED_TRACERS));
    let points: Vec<Vec3> = sampled.copied().collect();
    let exact = tracer_fields_at(&points, positions, density, spacing, radius);
    let off = points.iter().zip(&exact).map(|(&x, &exact)| f64::from((grid.trilinear(x) - exact).abs()));
    let (off, whole) = (off.sum::<f64>(), exact.iter().map(|&v| f64::from(v)).sum::<f64>());
    (whole > 0.0).then(|| off / whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::FrameIndex, sim::tradeoff::values};
    use serde_json::Value as Json;

    /// A run whose centre is at height `z`, of this size, energy and impulse, in frames 2 and 4.
    fn record(z: f64, size: f64, energy: f64, impulse: f64) -> Json {
        let frame = |frame: u32| {
            let part = f64::from(frame) / 2.0;
            json!({
                "frame": frame,
                "sample": { "counts": [10, 20], "body": { "center": [0, 0, z], "size": size }, "push": 2.0 },
                "logged": { "invariants": {
                    "strength": [0, 0, 0], "impulse": [0, 0, impulse * part], "angular_impulse": [0, 0, 0],
                    "energy": energy * part, "helicity": 0,
                } },
            })
        };
        json!([frame(2), frame(4)])
    }

    #[test]
    fn errors_are_relative_to_size_energy_and_push() {
        let found = |own: Json, frames: &str| {
            let keys = ["center", "extent", "energy", "impulse", "drift.energy", "drift.impulse"];
            values(SmokeRuns { cell: 0.2 }, [&own, &record(1.0, 0.5, 1.0, 0.5)], frames, keys)
        };
        let same = found(record(1.0, 0.5, 1.0, 0.5), "1-4");
        assert_eq!(same, [Some(0.0), Some(0.0), Some(0.0), Some(0.0), Some(1.0), Some(0.25)]);
        let other = found(record(1.1, 0.6, 1.5, 0.7), "1-4");
        // Energies of 0.5 and 1 too much, of 2 at most; impulses of 0.2 and 0.4, of 2.
        let expected = [0.2, 0.2, 0.625_f64.sqrt() / 2.0, 0.1_f64.sqrt() / 2.0];
        for (found, expected) in other.iter().zip(expected) {
            assert!((found.unwrap() - expected).abs() < 1e-12, "{other:?}");
        }
        assert_eq!(found(record(1.1, 0.6, 1.5, 0.7), "5")[..4], [None; 4]);
    }

    #[test]
    fn the_displaced_fraction_goes_from_none_to_all() {
        let at = |x: i32, value: f32| ([x, 0, 0], value);
        let a = [at(-1, 1.0), at(2, 3.0)];
        assert_eq!(displaced(&a, &a), Some(0.0));
        assert_eq!(displaced(&a, &[at(0, 4.0), at(5, 1.0)]), Some(1.0));
        assert_eq!(displaced(&a, &[at(-1, 1.0), at(0, 1.0), at(2, 2.0)]), Some(0.25));
        assert_eq!((displaced(&a, &[]), displaced(&[], &[])), (Some(1.0), None));
    }

    #[test]
    fn a_cube_that_moves_by_less_than_a_cell_is_displaced_by_that_part_of_its_edge() {
        let frame = |shift: f32| {
            let points: Vec<Vec3> = (0..8000)
                .map(|i| [i % 20, i / 20 % 20, i / 400].map(|v| 0.05 * v as f32))
                .map(|x| Vec3::from(x) + Vec3::x() * shift)
                .collect();
            let stream = Stream::new(smoke::TRACERS, StreamKind::Tracers, points.len());
            let mut stream = stream.with("density", vec![1.0_f32; points.len()]).with("position", points);
            stream.scalars = vec![("spacing".into(), 0.05)];
            Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] }
        };
        let kept = |shift: f32| nodes(&SmokeRuns { cell: 0.2 }.compared(&frame(shift)));
        for exact in [0.05, 0.1, 0.2, 0.4] {
            let found = displaced(&kept(0.0), &kept(exact)).unwrap();
            assert!((found / f64::from(exact) - 1.0).abs() < 0.2, "{found} of {exact}");
        }
        let moved = frame(0.0);
        let (positions, density, _) = tracers(&moved).unwrap();
        let (center, size) = spread(positions, &|i| f64::from(density[i])).unwrap();
        assert!((center[1] - 0.475).abs() < 1e-6 && (size - 0.499).abs() < 1e-3, "{center:?} {size}");
    }
}
