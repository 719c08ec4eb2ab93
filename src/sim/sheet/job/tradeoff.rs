//! The tradeoff of the sheets: which integrator, which substeps and which cells are worth their time.
//!
//! *Method*: positions are compared at the same points of the cloth, whatever its cells: those that the preset as written
//! has, interpolated bilinearly between the points of other grids, as a picture shows them. The whole shot is run,
//! because what is coupled to sheets moves them.
//!
//! Limits: folds of thin cloth are chaotic, and then no two runs agree on them; the line *certainty* shows it.

use crate::{
    frame::{Frame, Stream, StreamKind},
    job::{
        Control, RunError,
        tradeoff::{About, Column, Unit, Wording},
    },
    math::Vec3,
    preset::Frames,
    sim::{
        FrameRecord,
        scene::Scene,
        sheet::{Integrator, Select, SheetRecord, SheetShape, SheetSolver, sheet_of, stream},
        tradeoff::{
            self, Axis, Change, ComparedRun, FrameSample, Knob, Measure, Run, RunFolder, Runs, Subject,
            SystemRuns, multiples, pairs,
        },
    },
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::rc::Rc;
use xxhash_rust::xxh3::xxh3_64;

/// The tradeoff of the sheets.
pub(super) static SUBJECT: Subject = Subject {
    name: "sheets",
    wording: &WORDING,
    columns: || COLUMNS.map(|column| column.info).to_vec(),
    knobs: |scene| KNOBS.into_iter().chain(grids(scene).map(|sheet| CELLS.at(sheet))).collect(),
    defaults,
    one_by_one: true,
    table: "sheets.solver.",
    refuse: |key| {
        let why = "does not change a sheet, expected sheets.solver.… or sheet.0.…; compare surfaces with --of surface";
        key.starts_with("surface.").then_some(why)
    },
    key: |scene| in_use(scene).simulation_key(),
    runs: Runs::System(SystemRuns {
        size: |scene| format!("{} points", scene.sheet.iter().map(|sheet| sheet.shape.points()).sum::<f64>()),
        run: |sweep, job, control| {
            tradeoff::tradeoff(&WORDING, SheetRuns::new(&sweep.base), sweep, job, control)
        },
    }),
};

const WORDING: Wording = Wording {
    whole: "the shot",
    seconds: "wall-clock time of simulating these frames, with everything in the shot",
    same: "the same frames as",
    criterion: "distance",
    limit: "points off by at most {} of their spacing",
    incomparable: None,
};

type SheetColumn = Column<ComparedRun<SheetRuns>>;

const COLUMNS: [SheetColumn; 11] = [
    SheetColumn::new("points", "points", Unit::Count, |run| Some(run.samples().next_back()?.sample.points as f64)),
    SheetColumn::new("substeps", "substeps", Unit::Mean, |run| run.mean(|line| line.substeps.into()))
        .meaning("of a frame"),
    SheetColumn::new("iterations", "iterations", Unit::Mean, |run| run.mean(|line| line.iterations.into()))
        .meaning("of the conjugate gradients, of a frame"),
    SheetColumn::data("unconverged", Unit::Count, |run| run.sum(|line| line.unconverged.into()))
        .remark("substeps stopped at max_iterations"),
    SheetColumn::data("overshot", Unit::Count, |run| run.sum(|line| line.overshot.into()))
        .remark("substeps were too long for one linearisation"),
    SheetColumn::new("strain", "strain", Unit::Percent, |run| run.max(|line| line.strain_max))
        .meaning("largest strain of a spring at the end of any frame"),
    SheetColumn::data("caught", Unit::Count, |run| run.sum(|line| line.projected_out as f64)),
    SheetColumn::data("inside", Unit::Count, |run| run.sum(|line| line.inside_solids as f64))
        .remark("points were inside solids at the ends of frames"),
    SheetColumn::new("distance", "distance", Unit::Millimetres, |run| run.distance[0])
        .meaning("between the same points of the cloth and the reference's: RMS over points and frames")
        .against_reference()
        .criterion("distance"),
    SheetColumn::new("farthest", "farthest", Unit::Millimetres, |run| run.distance[1])
        .meaning("largest of these distances")
        .against_reference()
        .criterion("farthest"),
    SheetColumn::new("energy", "energy", Unit::Percent, |run| {
        let inner = |line: &SheetRecord| line.kinetic_energy + line.elastic_energy;
        let whole = |sample: &FrameSample<SheetRuns>| {
            sample.logged.as_ref().map(|line| inner(line) + line.potential_energy)
        };
        let scale = run.reference_max(|sample| sample.logged.as_ref().map(inner))?;
        Some(run.rms(|a, b| Some(whole(a)? - whole(b)?))? / scale)
    })
    .meaning(
        "kinetic, elastic and potential energy: RMS over the frames, relative to the reference's largest kinetic and elastic \
         energy",
    )
    .against_reference()
    .criterion("energy"),
];

const INTEGRATOR: &str = "sheets.solver.integrator";
const MAX_SUBSTEPS: &str = "sheets.solver.max_substeps";
const MAX_ITERATIONS: &str = "sheets.solver.max_iterations";

/// The solver, which presets need not mention.
fn solver(scene: &mut Scene) -> Option<&mut SheetSolver> {
    (!scene.sheet.is_empty()).then(|| &mut scene.sheets.get_or_insert_default().solver)
}

const COURANT: Knob = Knob::new("sheets.solver.courant", |scene, _| Some(&mut solver(scene)?.courant));
const SUBSTEPS: Knob = Knob::new("sheets.solver.substeps", |scene, _| Some(&mut solver(scene)?.substeps));
const TOLERANCE: Knob = Knob::new("sheets.solver.tolerance", |scene, _| Some(&mut solver(scene)?.tolerance));

/// One and a half times the cells: with twice as many, reference and refinement would take 8 and 64 times as long, since
/// substeps become shorter with the cells.
const CELLS: Knob =
    Knob::new("sheet.#.shape.grid.cells", |scene, sheet| match &mut scene.sheet.get_mut(sheet)?.shape {
        SheetShape::Grid { cells, .. } => Some(cells),
        SheetShape::Mesh(_) => None,
    })
    .times(1.5);

/// Steps are refined whatever is varied: what other keys do has to show, not what the steps do.
const KNOBS: [Knob; 6] = [
    Knob::choice(INTEGRATOR, |scene| {
        solver(scene)?.integrator = Integrator::Symplectic;
        Some("symplectic")
    })
    .opens(MAX_SUBSTEPS),
    COURANT.times_down_to(0.5, MIN_COURANT).opens(MAX_SUBSTEPS).always(),
    SUBSTEPS.times(2.0).opens(MAX_SUBSTEPS).always(),
    TOLERANCE.times_down_to(0.1, MIN_TOLERANCE).opens(MAX_ITERATIONS).always(),
    Knob::new(MAX_SUBSTEPS, |scene, _| Some(&mut solver(scene)?.max_substeps)).limit(|_| 1e6),
    Knob::new(MAX_ITERATIONS, |scene, _| Some(&mut solver(scene)?.max_iterations)).limit(|_| 1000.0),
];

/// The smallest `sheets.solver.courant` that a preset may have.
const MIN_COURANT: f64 = 0.01;

/// The smallest `sheets.solver.tolerance` of a reference: near to what single precision keeps of a residual.
const MIN_TOLERANCE: f64 = 1e-6;

/// The sheets that are grids.
fn grids(scene: &Scene) -> impl Iterator<Item = usize> {
    let is_grid = |sheet: &usize| matches!(scene.sheet[*sheet].shape, SheetShape::Grid { .. });
    (0..scene.sheet.len()).filter(is_grid)
}

/// What is varied by default: the integrator with its steps, the tolerance of the implicit one, and the cells of all grids,
/// unless points are named by their numbers, which other cells would change.
fn defaults(scene: &Scene) -> Vec<Axis> {
    let with = |integrator: Integrator, axis: Axis| -> Axis {
        let name = if integrator == Integrator::Implicit { "implicit" } else { "symplectic" };
        let choice = Change::new(format!("{INTEGRATOR}={name}"), move |scene| {
            solver(scene).into_iter().for_each(|solver| solver.integrator = integrator);
        });
        axis.into_iter().map(|changes| [vec![choice.clone()], changes].concat()).collect()
    };
    let courants = [Some(0.9), None, Some(0.25)]
        .map(|other| COURANT.change(scene, |courant| other.unwrap_or(courant)).into_iter().collect());
    let substeps = multiples(scene, &[(SUBSTEPS, [1.0, f64::MAX])], [0.5, 1.0, 4.0]);
    let tolerances = multiples(scene, &[(TOLERANCE, [MIN_TOLERANCE, 0.5])], [100.0, 0.1]);
    let mut axes = vec![
        with(Integrator::Symplectic, courants.to_vec()),
        with(Integrator::Implicit, substeps),
        with(Integrator::Implicit, tolerances),
    ];
    let joints = scene.sheets.iter().flat_map(|common| &common.joint).flat_map(|joint| &joint.at);
    let mut named = scene.sheet.iter().flat_map(|sheet| &sheet.pin).map(|pin| &pin.at).chain(joints);
    let cells: Vec<_> = grids(scene).map(|sheet| (CELLS.at(sheet), [0.0, f64::MAX])).collect();
    if !cells.is_empty() && !named.any(|at| matches!(at, Select::Points(_))) {
        axes.push(multiples(scene, &cells, [0.5, 0.75]));
    }
    axes
}

/// The scene with defaults for what its integrator does not read.
fn in_use(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let solver = &mut scene.sheets.get_or_insert_default().solver;
    let SheetSolver { substeps, tolerance, max_iterations, courant, .. } = SheetSolver::default();
    match solver.integrator {
        Integrator::Symplectic => {
            (solver.substeps, solver.tolerance, solver.max_iterations) =
                (substeps, tolerance, max_iterations);
        }
        Integrator::Implicit => solver.courant = courant,
    }
    scene
}

/// How runs of sheets are measured and compared.
#[derive(Debug)]
struct SheetRuns {
    /// Where each sheet is compared: at the corners of so many cells, or without them at its points.
    sheets: Vec<(String, Option<[u32; 2]>)>,
}

/// What is measured of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SheetSample {
    /// Points of all sheets.
    points: u64,
    /// Mean distance between them [m].
    spacing: f64,
    /// A hash of where all points are.
    places: u64,
}

/// Cells of the comparison grid along each direction at most: enough to see what 129² points do.
const MAX_COMPARED_CELLS: u32 = 128;

/// Points of a mesh that are compared, about.
const COMPARED_POINTS: usize = 16_384;

impl SheetRuns {
    /// Sheets are compared at the points of the scene as written.
    fn new(scene: &Scene) -> Self {
        let cells = |shape: &SheetShape| match shape {
            SheetShape::Grid { cells, .. } => Some(cells.map(|n| n.min(MAX_COMPARED_CELLS))),
            SheetShape::Mesh(_) => None,
        };
        Self { sheets: scene.sheet.iter().map(|sheet| (sheet.name.clone(), cells(&sheet.shape))).collect() }
    }

    /// The positions at which the sheets of a frame are compared, a stream per sheet.
    fn kept(&self, scene: &Scene, frame: &Frame) -> Frame {
        let mut streams = Vec::new();
        for (name, compared) in &self.sheets {
            let points = frame.stream(&stream(name)).and_then(|stream| stream.vec3("position"));
            let sheet = scene.sheet.iter().find(|sheet| sheet.name == *name);
            let (Some(points), Some(sheet)) = (points, sheet) else { continue };
            let places: Vec<Vec3> = match (compared, &sheet.shape) {
                (Some(compared), SheetShape::Grid { cells, .. }) => interpolated(points, *cells, *compared),
                _ => points.iter().step_by(points.len().div_ceil(COMPARED_POINTS).max(1)).copied().collect(),
            };
            streams.push(
                Stream::new(stream(name), StreamKind::MeshPoints, places.len()).with("position", places),
            );
        }
        Frame { streams, ..*frame }
    }
}

/// The corners of `compared` cells over a grid of points that has `cells`, by bilinear interpolation between its points.
fn interpolated(points: &[Vec3], cells: [u32; 2], compared: [u32; 2]) -> Vec<Vec3> {
    // The point before a corner, and how far beyond it: exact where a corner is a point.
    let place = |axis: usize, corner: u32| {
        let (all, parts) = (u64::from(corner) * u64::from(cells[axis]), u64::from(compared[axis].max(1)));
        ((all / parts) as usize, (all % parts) as f32 / parts as f32)
    };
    let point = |i: usize, j: usize| {
        let [i, j] = [i.min(cells[0] as usize), j.min(cells[1] as usize)];
        points[i + (cells[0] as usize + 1) * j]
    };
    let mix = |a: Vec3, b: Vec3, part: f32| a + (b - a) * part;
    let mut out = Vec::new();
    for (j, v) in (0..=compared[1]).map(|corner| place(1, corner)) {
        for (i, u) in (0..=compared[0]).map(|corner| place(0, corner)) {
            let [near, far] = [j, j + 1].map(|j| mix(point(i, j), point(i + 1, j), u));
            out.push(mix(near, far, v));
        }
    }
    out
}

impl Measure for SheetRuns {
    type Sample = SheetSample;
    type Logged = SheetRecord;
    /// Between points [m]: root mean square and largest.
    type Distance = [Option<f64>; 2];

    const VERSION: &str = "sheets 2";

    fn decisive(&self, scene: &Scene) -> String {
        format!("{} {:?}", scene.simulation_key(), self.sheets)
    }

    fn logged(record: FrameRecord) -> Option<SheetRecord> {
        record.sheets
    }

    fn sample(
        &self,
        folder: &RunFolder,
        frame: &Frame,
        _: bool,
        _: Control,
    ) -> Result<(SheetSample, Frame), RunError> {
        let sheets = || frame.streams.iter().filter(|stream| sheet_of(&stream.name).is_some());
        let area = |stream: &Stream| stream.len() as f64 * stream.scalar("spacing").unwrap_or(0.0).powi(2);
        let points: usize = sheets().map(Stream::len).sum();
        let places = sheets().filter_map(|stream| stream.vec3("position"));
        let hashes: Vec<u64> = places.map(|places| xxh3_64(bytemuck::cast_slice(places))).collect();
        let sample = SheetSample {
            points: points as u64,
            spacing: (sheets().map(area).sum::<f64>() / points.max(1) as f64).sqrt(),
            places: xxh3_64(bytemuck::cast_slice(&hashes)),
        };
        Ok((sample, self.kept(&folder.scene, frame)))
    }

    fn distance(
        &self,
        run: &Run<Self>,
        reference: &Run<Self>,
        frames: &Frames,
    ) -> Result<[Option<f64>; 2], RunError> {
        let (mut sum, mut count, mut largest) = (0.0, 0_usize, 0.0_f64);
        for (FrameSample { frame, .. }, _) in pairs(run, reference, frames) {
            let (a, b) = (run.folder.kept(*frame)?, reference.folder.kept(*frame)?);
            let (Some(a), Some(b)) = (a, b) else { continue };
            let Some(squares) = squared_distances(&a, &b) else { return Ok([None; 2]) };
            sum += squares.iter().sum::<f64>();
            count += squares.len();
            largest = squares.iter().copied().fold(largest, f64::max);
        }
        let found = |square: f64| (count > 0).then(|| square.sqrt());
        Ok([found(sum / count.max(1) as f64), found(largest)])
    }

    fn columns(&self) -> Vec<SheetColumn> {
        COLUMNS.into()
    }

    fn describe(&self, runs: &[Rc<Run<Self>>], _: &str, about: &mut About) {
        let as_written = runs.first().and_then(|run| run.record.frames.last());
        about.spacing = as_written.map_or(0.0, |frame| frame.sample.spacing);
        about.facts.push(("spacing", json!(about.spacing)));
        let spacing = Unit::Millimetres.show(about.spacing, 3, 1.0);
        about.remarks.push(("spacing", format!("{spacing} between the points of the sheets as written")));
    }
}

/// Squares of the distances between the same points [m²]; `None` if they are not the same.
fn squared_distances(a: &Frame, b: &Frame) -> Option<Vec<f64>> {
    let mut out = Vec::new();
    if a.streams.len() != b.streams.len() {
        return None;
    }
    for (a, b) in a.streams.iter().zip(&b.streams) {
        let (x, y) = (a.vec3("position")?, b.vec3("position")?);
        if a.name != b.name || x.len() != y.len() {
            return None;
        }
        out.extend(x.iter().zip(y).map(|(x, y)| (x.cast::<f64>() - y.cast()).norm_squared()));
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::FrameIndex, sim::tradeoff::values};
    use serde_json::Value as Json;

    /// Points of a grid over the unit square, on this surface.
    fn points(cells: [u32; 2], height: impl Fn(f32, f32) -> f32) -> Vec<Vec3> {
        let part = |i: u32, n: u32| i as f32 / n.max(1) as f32;
        let at = |i, j| (part(i, cells[0]), part(j, cells[1]));
        let all = (0..=cells[1]).flat_map(|j| (0..=cells[0]).map(move |i| (i, j)));
        all.map(|(i, j)| at(i, j)).map(|(u, v)| Vec3::new(u, v, height(u, v))).collect()
    }

    #[test]
    fn grids_of_any_cells_are_compared_at_the_same_places() {
        let twisted = |u: f32, v: f32| 2.0 * u - 3.0 * v + 4.0 * u * v;
        for cells in [[4, 4], [8, 4], [3, 7], [16, 12]] {
            let found = interpolated(&points(cells, twisted), cells, [4, 4]);
            for (a, b) in found.iter().zip(points([4, 4], twisted)) {
                assert!((a - b).amax() < 2e-6, "{cells:?}: {a:?} {b:?}");
            }
        }
        // Where the corners are points they are these points, to the last digit.
        let rough = |u: f32, v: f32| (17.0 * u + 5.0 * v).sin();
        let fine = points([12, 8], rough);
        let every: Vec<Vec3> =
            (0..=2).flat_map(|j| (0..=4).map(move |i| 3 * i + 13 * 4 * j)).map(|k| fine[k]).collect();
        assert_eq!(interpolated(&fine, [12, 8], [4, 2]), every);
        assert_eq!(interpolated(&fine, [12, 8], [12, 8]), fine);
        // Chains and single points.
        let chain = points([5, 0], |u, _| u);
        assert_eq!(interpolated(&chain, [5, 0], [5, 0]), chain);
        assert_eq!(interpolated(&[Vec3::x()], [0, 0], [0, 0]), [Vec3::x()]);
    }

    #[test]
    fn distances_are_between_the_same_points_of_the_same_sheets() {
        let frame = |sheets: &[(&str, Vec<Vec3>)]| Frame {
            streams: sheets
                .iter()
                .map(|(name, places)| {
                    Stream::new(*name, StreamKind::MeshPoints, places.len()).with("position", places.clone())
                })
                .collect(),
            index: FrameIndex(1),
            time: 0.0,
        };
        let flat = points([1, 1], |_, _| 0.0);
        let up: Vec<Vec3> = flat.iter().map(|x| x + Vec3::new(0.0, 0.0, 0.5)).collect();
        let (a, b) = (frame(&[("sheet.a", flat.clone())]), frame(&[("sheet.a", up.clone())]));
        assert_eq!(squared_distances(&a, &b), Some(vec![0.25; 4]));
        assert_eq!(squared_distances(&a, &frame(&[("sheet.b", up.clone())])), None);
        assert_eq!(squared_distances(&a, &frame(&[("sheet.a", up[..3].to_vec())])), None);
        assert_eq!(squared_distances(&a, &frame(&[("sheet.a", flat.clone()), ("sheet.b", up)])), None);
    }

    #[test]
    fn energies_are_relative_to_kinetic_and_elastic_energy() {
        let record = |kinetic: f64, height: f64| {
            let logged =
                json!({ "kinetic_energy": kinetic, "elastic_energy": 1.0, "potential_energy": height });
            let sample = json!({ "points": 4, "spacing": 0.1, "places": 7 });
            json!([
                { "frame": 1, "sample": sample, "logged": null },
                { "frame": 2, "sample": sample, "logged": logged },
            ])
        };
        let energy = |own: Json, frames: &str| {
            let measure = SheetRuns { sheets: Vec::new() };
            values(measure, [&own, &record(3.0, -50.0)], frames, ["energy"])[0]
        };
        assert_eq!(energy(record(3.0, -50.0), "1-2"), Some(0.0));
        assert_eq!(energy(record(4.0, -51.0), "1-2"), Some(0.0), "one becomes the other");
        assert_eq!(energy(record(5.0, -50.0), "1-2"), Some(0.5));
        assert_eq!(energy(record(5.0, -50.0), "1"), None);
    }
}
