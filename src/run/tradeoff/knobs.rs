//! The keys whose finer direction is known, of what a tradeoff can be about.

use super::{cells, sweep::Vary};
use crate::{
    run::RunError,
    scene::{Overrides, Scene, choices},
    sim::{
        sheet::{Integrator, SheetSolver},
        vortex::{ERRORS, flow::Sum, grid_errors},
    },
};
use serde_json::Value as Json;
use std::ops::RangeInclusive;
use xxhash_rust::xxh3::xxh3_64;

/// What a tradeoff is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The liquid's simulation.
    Liquid,
    /// The surfaces of particles that are there.
    Surface,
    /// The smoke's simulation, and its volumes.
    Smoke,
    /// The simulation of sheets.
    Sheets,
}

/// A key whose finer direction is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knob {
    pub(super) key: &'static str,
    finer: Finer,
    /// The limit that has to give way: a finer knob must not only run into it.
    opens: Option<&'static str>,
    /// Whether it is finer in a reference whatever is varied.
    always: bool,
}

/// How a value becomes finer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Finer {
    /// Times this.
    Times(f64),
    /// The largest of the rows, once and for all.
    Largest,
    /// This word.
    Word(&'static str),
}

const LIQUID: [Knob; 6] = [
    Knob {
        key: "liquid.density_dev",
        finer: Finer::Times(0.5),
        opens: Some("liquid.max_iterations"),
        always: false,
    },
    Knob { key: "liquid.iterations", finer: Finer::Times(2.0), opens: None, always: false },
    Knob { key: "liquid.max_iterations", finer: Finer::Times(2.0), opens: None, always: false },
    Knob { key: "liquid.cfl", finer: Finer::Times(0.5), opens: Some("liquid.max_substeps"), always: false },
    Knob {
        key: "liquid.min_substeps",
        finer: Finer::Times(2.0),
        opens: Some("liquid.max_substeps"),
        always: false,
    },
    Knob { key: "liquid.spacing", finer: Finer::Times(2.0 / 3.0), opens: None, always: false },
];

const SURFACE: [Knob; 5] = [
    Knob { key: VOXEL, finer: Finer::Times(2.0 / 3.0), opens: None, always: true },
    Knob { key: "surface.distance", finer: Finer::Word("{}"), opens: None, always: false },
    Knob { key: "surface.distance.band", finer: Finer::Largest, opens: None, always: false },
    Knob { key: "surface.distance.order", finer: Finer::Word("second"), opens: None, always: false },
    Knob { key: "surface.decimation", finer: Finer::Word("none"), opens: None, always: false },
];

/// Steps of seven tenths take 1.4 times as long and have a third of the error, which is of the third order; spacings of four
/// fifths take twice the vortons. Finer ones would tell more: a reference that is refined once more then takes hours.
const SMOKE: [Knob; 6] = [
    Knob { key: SUM, finer: Finer::Word("tree"), opens: None, always: true },
    Knob { key: ERROR, finer: Finer::Times(0.5), opens: None, always: true },
    Knob { key: STEP[0], finer: Finer::Times(0.7), opens: Some(STEPS), always: true },
    Knob { key: STEP[1], finer: Finer::Times(0.7), opens: Some(STEPS), always: true },
    Knob { key: "smoke.spacing", finer: Finer::Times(0.8), opens: None, always: false },
    Knob { key: "smoke.tracers", finer: Finer::Times(0.8), opens: None, always: false },
];

/// Steps are refined whatever is varied: what other keys do is to be seen, not what the steps do.
const SHEETS: [Knob; 4] = [
    Knob { key: INTEGRATOR, finer: Finer::Word("symplectic"), opens: Some(SHEET_STEPS), always: false },
    Knob { key: COURANT, finer: Finer::Times(0.5), opens: Some(SHEET_STEPS), always: true },
    Knob { key: SUBSTEPS, finer: Finer::Times(2.0), opens: Some(SHEET_STEPS), always: true },
    Knob { key: TOLERANCE, finer: Finer::Times(0.1), opens: Some(SHEET_ROUNDS), always: true },
];

const INTEGRATOR: &str = "sheets.solver.integrator";
const COURANT: &str = "sheets.solver.courant";
const SUBSTEPS: &str = "sheets.solver.substeps";
const TOLERANCE: &str = "sheets.solver.tolerance";
const SHEET_STEPS: &str = "sheets.solver.max_substeps";
const SHEET_ROUNDS: &str = "sheets.solver.max_iterations";

const SUM: &str = "smoke.flow.sum";
const ERROR: &str = "smoke.flow.error";
const STEP: [&str; 2] = ["smoke.flow.strain", "smoke.flow.displacement"];
const STEPS: &str = "smoke.flow.max_substeps";

/// Vortons and tracers at the start up to which sums over all pairs are a default: more take too long to wait for.
const FEW: f64 = 20_000.0;

/// The voxel of surfaces, and of the volumes of smoke.
const VOXEL: &str = "surface.voxel";

/// What the default voxels are of the preset's.
const VOXELS: [f64; 5] = [0.6, 0.8, 1.0, 1.4, 2.0];

impl Subject {
    fn knobs(self) -> &'static [Knob] {
        match self {
            Self::Liquid => &LIQUID,
            Self::Surface => &SURFACE,
            Self::Smoke => &SMOKE,
            Self::Sheets => &SHEETS,
        }
    }

    /// Whether the keys of [`Subject::defaults`] are varied one by one, and not in every combination: smoke and sheets have too many.
    pub(super) fn varies_one_by_one(self) -> bool {
        matches!(self, Self::Smoke | Self::Sheets)
    }

    /// The table of nearly every key.
    fn table(self) -> &'static str {
        match self {
            Self::Liquid => "liquid.",
            Self::Surface => "surface.",
            Self::Smoke => "smoke.",
            Self::Sheets => "sheets.solver.",
        }
    }

    /// The keys that a reference is refined by.
    pub(super) fn refined_keys(self) -> Vec<&'static str> {
        self.knobs()
            .iter()
            .filter(|knob| matches!(knob.finer, Finer::Times(_)))
            .map(|knob| knob.key)
            .collect()
    }

    /// `liquid.cfl=0.2` without its table.
    pub(super) fn short(self, change: &str) -> &str {
        if let Some(short) = cells::short(change) {
            return short;
        }
        change.strip_prefix(self.table()).unwrap_or(change)
    }

    /// Tells scenes apart whose runs differ.
    pub(super) fn key(self, scene: &Scene) -> u64 {
        match self {
            Self::Liquid => scene.simulation_key(),
            Self::Sheets => in_use(scene).simulation_key(),
            Self::Surface => {
                let text = serde_json::to_string(&scene.surface).expect("settings are plain data");
                xxh3_64(text.as_bytes())
            }
            Self::Smoke => {
                let Scene { surface, volume, output, .. } = scene;
                let text = serde_json::to_string(&(scene.simulation_key(), surface, volume, &output.volume));
                xxh3_64(text.expect("settings are plain data").as_bytes())
            }
        }
    }

    /// Refuses keys that change nothing of the surfaces, the smoke or the sheets.
    pub(super) fn refuse_others(self, vary: &[Vary], reference: &[String]) -> Result<(), RunError> {
        let keys = vary.iter().flat_map(|vary| &vary.keys).chain(reference);
        let (wrong, expected) = match self {
            Self::Liquid => return Ok(()),
            Self::Surface => (
                (|key: &str| !key.starts_with("surface.")) as fn(&str) -> bool,
                "does not change a surface, expected surface.…; leave out --surface to vary the simulation",
            ),
            Self::Smoke => (
                (|key: &str| key.starts_with("liquid.")) as fn(&str) -> bool,
                "does not change the smoke, expected smoke.… or surface.voxel; leave out --smoke to vary the liquid",
            ),
            Self::Sheets => (
                (|key: &str| key.starts_with("surface.")) as fn(&str) -> bool,
                "does not change a sheet, expected sheets.solver.… or sheet.0.…; a liquid's surface is compared with --surface",
            ),
        };
        match keys.map(|key| key.trim_start()).find(|key| wrong(key)) {
            Some(other) => Err(RunError::Request(format!("{other}: found a key that {expected}"))),
            None => Ok(()),
        }
    }

    /// The keys to sweep if none are named. Of a liquid: when a substep's iterations end, how long substeps are, and the
    /// solver if the preset can choose one. Of a surface: the voxel, and whether it is cut from the
    /// signed distance. Of smoke: the error, the method, the steps, the cores and the voxel of volumes. Of sheets: the integrator with its
    /// steps, the tolerance of the implicit one, and the cells.
    ///
    /// The length of substeps has two limits, the CFL rule and `min_substeps`; where one decides, the other does
    /// nothing, so both are moved together, as far as a preset may.
    pub fn defaults(self, scene: &Scene) -> Vec<Vary> {
        let one = |key: &str, values: Vec<String>| Vary {
            keys: vec![key.into()],
            values: values.into_iter().map(|value| vec![value]).collect(),
        };
        let words = |key: &str| Some(choices(key)).filter(|words| !words.is_empty()).map(|w| one(key, w));
        let multiples = |key: &str, factors: &[f64], n: f64| {
            one(key, factors.iter().map(|f| plain(key, n * f)).collect())
        };
        let mut vary: Vec<Vary> = match self {
            Self::Surface => {
                let voxel = number(scene, VOXEL).map(|voxel| multiples(VOXEL, &VOXELS, voxel));
                let distance = one("surface.distance", ["none", "{}"].map(String::from).to_vec());
                voxel.into_iter().chain([distance]).collect()
            }
            Self::Liquid => {
                let iterating = match number(scene, "liquid.iterations") {
                    Some(n) => multiples("liquid.iterations", &[0.5, 1.0, 2.0], n),
                    None => one("liquid.density_dev", ["0.1%", "0.3%", "1%"].map(String::from).to_vec()),
                };
                let keys = ["liquid.cfl", "liquid.min_substeps"];
                let most = number(scene, "liquid.max_substeps").unwrap_or(f64::INFINITY);
                let step = |cfl: f64, least: f64| {
                    vec![plain(keys[0], cfl.min(LARGEST_CFL)), plain(keys[1], least.min(most))]
                };
                let steps = number(scene, keys[0]).zip(number(scene, keys[1])).map(|(cfl, least)| Vary {
                    keys: keys.map(String::from).to_vec(),
                    values: [0.5, 1.0, 2.0].map(|f| step(cfl * f, least / f)).to_vec(),
                });
                words("liquid.solver").into_iter().chain([iterating]).chain(steps).collect()
            }
            Self::Smoke => smoke(scene),
            Self::Sheets => sheets(scene),
        };
        vary.iter_mut().for_each(|vary| vary.values.dedup());
        vary
    }
}

/// What is varied of smoke if nothing is named.
fn smoke(scene: &Scene) -> Vec<Vary> {
    let Some(smoke) = &scene.smoke else { return Vec::new() };
    let among = |range: &RangeInclusive<f32>, value: f32| value.clamp(*range.start(), *range.end());
    let flow = &smoke.flow;
    let of_lattices = grid_errors(flow.kernel);
    let lattice = of_lattices.contains(&flow.error);
    let range = if flow.sum == Sum::Grid { of_lattices } else { ERRORS };
    let errors = [3.0, 1.0, 0.3].map(|factor| vec![format!("{}", among(&range, flow.error * factor))]);
    let few = scene.few_vortons(FEW);
    let methods = [("tree", true), ("grid", lattice), ("direct", few)];
    let methods = methods.iter().filter(|(_, serves)| *serves).map(|(name, _)| vec![(*name).to_owned()]);
    let step =
        |factor: f32| [flow.strain, flow.displacement].map(|most| format!("{}", (most * factor).min(100.0)));
    let core = |factor: f32| {
        let own = format!("{}", among(&CORES[0], smoke.overlap * factor));
        let again = flow.remesh.as_ref().map(|remesh| format!("{}", among(&CORES[1], remesh.core * factor)));
        [Some(own), again].into_iter().flatten().collect()
    };
    let cores = ["smoke.overlap", "smoke.flow.remesh.core"];
    let cores = if flow.remesh.is_some() { &cores[..] } else { &cores[..1] };
    let voxel = |factor: f32| vec![format!("{}", among(&SIDES, scene.surface.voxel * factor))];
    let named = |keys: &[&str], values: Vec<Vec<String>>| Vary {
        keys: keys.iter().map(|&key| key.into()).collect(),
        values,
    };
    let voxels = named(&[VOXEL], [0.7, 1.0, 1.5].map(voxel).to_vec());
    let mut vary = vec![
        named(&[ERROR], errors.to_vec()),
        named(&[SUM], methods.collect()),
        named(&STEP, [0.5, 1.0, 2.0].map(|factor| step(factor).to_vec()).to_vec()),
        named(cores, [0.8, 1.0, 1.25].map(core).to_vec()),
    ];
    vary.extend(Some(voxels).filter(|_| !scene.output.volume.is_empty()));
    vary
}

/// The scene with defaults for what its integrator does not read.
fn in_use(scene: &Scene) -> Scene {
    let mut sheets = scene.sheets.clone().unwrap_or_default();
    let (solver, usual) = (&mut sheets.solver, SheetSolver::default());
    match solver.integrator {
        Integrator::Symplectic => {
            (solver.substeps, solver.tolerance, solver.max_iterations) =
                (usual.substeps, usual.tolerance, usual.max_iterations);
        }
        Integrator::Implicit => solver.courant = usual.courant,
    }
    Scene { sheets: Some(sheets), ..scene.clone() }
}

/// What is varied of sheets if nothing is named.
fn sheets(scene: &Scene) -> Vec<Vary> {
    let solver = scene.sheets.clone().unwrap_or_default().solver;
    let with = |way: &str, key: &str, values: Vec<f64>| Vary {
        keys: vec![INTEGRATOR.into(), key.into()],
        values: values.into_iter().map(|value| vec![way.into(), plain(key, value)]).collect(),
    };
    let substeps = [0.5, 1.0, 4.0].map(|factor| f64::from(solver.substeps) * factor);
    let tolerance =
        [100.0, 0.1].map(|factor| (f64::from(solver.tolerance) * factor).clamp(FINEST_RESIDUAL, 0.5));
    let mut vary = vec![
        with("symplectic", COURANT, vec![0.9, f64::from(solver.courant), 0.25]),
        with("implicit", SUBSTEPS, substeps.to_vec()),
        with("implicit", TOLERANCE, tolerance.to_vec()),
    ];
    vary.extend(cells::vary(scene, &[0.5, 0.75]));
    vary
}

/// The smallest `sheets.solver.tolerance` that a reference asks for: near to what single precision keeps of a residual.
const FINEST_RESIDUAL: f64 = 1e-6;

/// The smallest `sheets.solver.courant`.
const SHORTEST: f64 = 0.01;

/// The ranges of cores, in spacings: where vortons are seeded, and on lattices.
const CORES: [RangeInclusive<f32>; 2] = [0.8..=4.0, 1.0..=2.5];

/// The range of `surface.voxel`.
const SIDES: RangeInclusive<f32> = 0.05..=10.0;

/// The varied knobs that can be refined, and those that always are; those of the defaults if there are none.
pub(super) fn refinable(subject: Subject, vary: &[Vary], scene: &Scene) -> Vec<Knob> {
    let among = |vary: &[Vary]| -> Vec<Knob> {
        let is = |key: &str, knob: &Knob| {
            key.strip_prefix(knob.key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let is_varied = |knob: &Knob| vary.iter().any(|vary| vary.keys.iter().any(|key| is(key, knob)));
        let knobs = subject.knobs().iter().copied();
        // Sums over all pairs are finer than any other.
        let is_exact = |knob: &Knob| knob.key == SUM && scene.value(SUM) == Some(Json::from("direct"));
        knobs.filter(|knob| (knob.always && !is_exact(knob)) || is_varied(knob)).collect()
    };
    let knobs = among(vary);
    if knobs.is_empty() { among(&subject.defaults(scene)) } else { knobs }
}

/// The finest value of each knob in any of the scenes; none where it is no number.
pub(super) fn finest<'a>(
    knobs: &[Knob],
    scenes: impl Iterator<Item = &'a Scene> + Clone,
) -> Vec<Option<f64>> {
    let finer = |knob: &Knob, a: f64, b: f64| match knob.finer {
        Finer::Times(factor) if factor < 1.0 => a.min(b),
        _ => a.max(b),
    };
    let of = |knob: &Knob| {
        let values = scenes.clone().filter_map(|scene| number(scene, knob.key));
        values.reduce(|a, b| finer(knob, a, b))
    };
    knobs.iter().map(of).collect()
}

/// The limits that finer knobs may run into, each with its largest value in any scene.
pub(super) fn limits<'a>(scenes: impl Iterator<Item = &'a Scene> + Clone) -> [(&'static str, f64); 5] {
    ["liquid.max_iterations", "liquid.max_substeps", STEPS, SHEET_STEPS, SHEET_ROUNDS]
        .map(|limit| (limit, scenes.clone().filter_map(|scene| number(scene, limit)).fold(0.0, f64::max)))
}

/// The overrides with every knob finer than its value, and the limits behind them wider.
pub(super) fn refine(
    base: &Overrides,
    knobs: &[Knob],
    values: &[Option<f64>],
    limits: &[(&'static str, f64)],
) -> Overrides {
    let finer = |key: &str| {
        let (knob, value) = knobs.iter().zip(values).find(|(knob, _)| knob.key == key)?;
        match knob.finer {
            Finer::Times(factor) => {
                let least = match knob.key {
                    ERROR => f64::from(*ERRORS.start()),
                    TOLERANCE => FINEST_RESIDUAL,
                    COURANT => SHORTEST,
                    _ => 0.0,
                };
                value.map(|value| (value * factor).max(least))
            }
            Finer::Largest => *value,
            Finer::Word(_) => None,
        }
    };
    let set = |key: &str, value: f64| format!("{key}={}", plain(key, value));
    let refined = knobs.iter().filter_map(|knob| match knob.finer {
        Finer::Word(word) => Some(format!("{}={word}", knob.key)),
        _ => Some(set(knob.key, finer(knob.key)?)),
    });

    // A limit that is no knob itself gives way, and never falls below the fewest substeps.
    let opened = limits
        .iter()
        .filter(|(limit, _)| finer(limit).is_none() && knobs.iter().any(|knob| knob.opens == Some(limit)));
    let opened = opened.map(|&(limit, most)| {
        let fewest = finer("liquid.min_substeps").filter(|_| limit == "liquid.max_substeps");
        let least = if limit == SHEET_STEPS { SHEET_REFERENCE_LIMIT } else { REFERENCE_LIMIT };
        set(limit, most.max(least).max(fewest.unwrap_or(0.0)))
    });
    Overrides { set: base.set.iter().cloned().chain(refined).chain(opened).collect(), ..base.clone() }
}

/// Iterations and substeps that a reference may take at least: it shows what the knobs do, not what the limits do. Ten
/// times what the defaults allow; more would let a target that is never reached take days.
const REFERENCE_LIMIT: f64 = 1000.0;

/// The same of substeps of sheets, which are short and cheap.
const SHEET_REFERENCE_LIMIT: f64 = 1e6;

/// The largest `liquid.cfl` that a preset may have.
const LARGEST_CFL: f64 = 10.0;

/// A number as a preset takes it: whole where the key counts something.
fn plain(key: &str, value: f64) -> String {
    let counts = ["iterations", "substeps"].iter().any(|word| key.ends_with(word));
    // Digits that single precision has, and no more.
    let short: f64 = format!("{value:.5e}").parse().expect("a number is one");
    if counts { format!("{}", value.round().max(1.0)) } else { format!("{short}") }
}

/// The number at a key of the scene; that of the defaults where sheets have no table of their own.
pub(super) fn number(scene: &Scene, key: &str) -> Option<f64> {
    let own = scene.value(key);
    let of_solver = key.strip_prefix("sheets.solver.").filter(|_| own.is_none() && !scene.sheet.is_empty());
    let default =
        of_solver.and_then(|key| serde_json::to_value(SheetSolver::default()).ok()?.get(key).cloned());
    own.or(default).as_ref().and_then(Json::as_f64)
}
