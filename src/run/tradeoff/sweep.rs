//! Which settings a tradeoff compares, and what it compares them with.

use crate::{
    run::RunError,
    scene::{Overrides, Preset, Quality, Scene, choices},
};
use serde_json::Value as Json;
use std::str::FromStr;

/// Some keys of the preset that vary together, and the values to try, as the command line writes them:
/// `liquid.cfl=0.2,0.4`, or `liquid.cfl+liquid.min_substeps=0.2+16,0.4+8`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vary {
    /// The dotted keys, at least one.
    pub keys: Vec<String>,
    /// At least one list of values, each with a value a key.
    pub values: Vec<Vec<String>>,
}

impl FromStr for Vary {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected KEY=VALUE,VALUE,…, such as liquid.cfl=0.2,0.4,0.8";
        let (keys, values) = text.split_once('=').ok_or(expected)?;
        let parts =
            |text: &str, mark| split_outside(text, mark).iter().map(|part| part.trim().into()).collect();
        let keys: Vec<String> = parts(keys, '+');
        // A single key takes its values as they are: they may hold a plus.
        let together =
            |value: &str| if keys.len() == 1 { vec![value.trim().into()] } else { parts(value, '+') };
        let values: Vec<Vec<String>> = split_outside(values, ',').into_iter().map(together).collect();
        if keys.iter().chain(values.iter().flatten()).any(String::is_empty) {
            return Err(expected.into());
        }
        match values.iter().find(|value| value.len() != keys.len()) {
            None => Ok(Self { keys, values }),
            Some(value) => Err(format!(
                "found {} for {} keys; expected a value for each, joined by +, such as \
                 liquid.cfl+liquid.min_substeps=0.2+16,0.4+8",
                value.join("+"),
                keys.len()
            )),
        }
    }
}

/// The parts between the marks that stand outside brackets and quotes.
fn split_outside(text: &str, mark: char) -> Vec<&str> {
    let (mut depth, mut quoted) = (0_i32, false);
    let at_mark = |c: char| {
        match c {
            '[' | '{' => depth += 1,
            ']' | '}' => depth -= 1,
            '"' => quoted = !quoted,
            _ => {}
        }
        c == mark && depth == 0 && !quoted
    };
    text.split(at_mark).collect()
}

/// What a run changes in the preset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// What people call it: the keys it changes.
    pub label: String,
    /// The changes.
    pub overrides: Overrides,
}

/// The runs of a tradeoff, checked: every one of them is a valid scene.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The settings to compare.
    pub rows: Vec<(Setting, Scene)>,
    /// What they are compared with.
    pub reference: (Setting, Scene),
    /// The reference once more refined, to see how far it can be trusted.
    pub refined: (Setting, Scene),
    /// The preset as given, which the frames and the observable are taken from.
    pub base: Scene,
}

/// What the user asked to compare.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// The preset's tier and `--set` arguments that every run shares.
    pub base: Overrides,
    /// The keys to vary; empty: sensible ones, see [`defaults`].
    pub vary: Vec<Vary>,
    /// Changes that make the reference; empty: the finest value of every knob, refined once.
    pub reference: Vec<String>,
    /// Whether the preset's tiers are rows too.
    pub tiers: bool,
}

impl Request {
    /// Lays out every run.
    ///
    /// # Errors
    /// If one of them is not a valid preset, or the reference cannot be refined.
    pub fn sweep(&self, preset: &Preset) -> Result<Sweep, RunError> {
        let base = Scene::from_preset(preset, &self.base)?;
        let vary = if self.vary.is_empty() { defaults(&base) } else { self.vary.clone() };
        let mut rows: Vec<(Setting, Scene)> = Vec::new();
        let mut settings = vec![Setting { label: "as written".into(), overrides: self.base.clone() }];
        settings.extend(combinations(&self.base, &vary));
        if self.tiers {
            settings.extend(Quality::ALL.map(|tier| Setting {
                label: tier.name().into(),
                overrides: Overrides { quality: Some(tier), set: self.base.set.clone() },
            }));
        }
        for setting in settings {
            let is_tier = self.tiers && setting.overrides.quality != self.base.quality;
            let scene = match Scene::from_preset(preset, &setting.overrides) {
                Err(_) if is_tier && !has_tier(preset, setting.overrides.quality) => continue,
                scene => scene?,
            };
            // Two names for one run are one row.
            match rows.iter_mut().find(|(_, other)| other.simulation_key() == scene.simulation_key()) {
                Some((known, _)) => known.label = format!("{} = {}", known.label, setting.label),
                None => rows.push((setting, scene)),
            }
        }

        // The reference, and the reference refined.
        let knobs = refinable(&vary, &base);
        let reference = match &self.reference[..] {
            [] => refine(&self.base, &knobs, &finest(&knobs, &rows), &limits(rows.iter().map(|row| &row.1))),
            given => Overrides { set: [&self.base.set[..], given].concat(), ..self.base.clone() },
        };
        let reference = checked(preset, "reference", reference)?;
        let values: Vec<Option<f64>> = knobs.iter().map(|knob| number(&reference.1, knob.key)).collect();
        let finer = refine(&reference.0.overrides, &knobs, &values, &limits([&reference.1].into_iter()));
        let refined = checked(preset, "reference refined", finer)?;
        if refined.1.simulation_key() == reference.1.simulation_key() {
            return Err(RunError::Request(
                "the reference cannot be refined: the preset has neither liquid.density_dev nor liquid.iterations \
                 nor liquid.cfl"
                    .into(),
            ));
        }
        Ok(Sweep { rows, reference, refined, base })
    }
}

fn checked(preset: &Preset, name: &str, overrides: Overrides) -> Result<(Setting, Scene), RunError> {
    let scene = Scene::from_preset(preset, &overrides)?;
    Ok((Setting { label: name.into(), overrides }, scene))
}

fn has_tier(preset: &Preset, tier: Option<Quality>) -> bool {
    let words = |tier: Quality| format!("[quality.{}", tier.name());
    tier.is_none_or(|tier| preset.text.contains(&words(tier)))
}

/// A knob whose finer direction is known.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Knob {
    key: &'static str,
    /// What a value is multiplied with to be finer.
    finer: f64,
    /// The limit that has to give way: a finer knob must not only run into it.
    opens: Option<&'static str>,
}

/// Every knob that can be refined.
const KNOBS: [Knob; 6] = [
    Knob { key: "liquid.density_dev", finer: 0.5, opens: Some("liquid.max_iterations") },
    Knob { key: "liquid.iterations", finer: 2.0, opens: None },
    Knob { key: "liquid.max_iterations", finer: 2.0, opens: None },
    Knob { key: "liquid.cfl", finer: 0.5, opens: Some("liquid.max_substeps") },
    Knob { key: "liquid.min_substeps", finer: 2.0, opens: Some("liquid.max_substeps") },
    Knob { key: "liquid.spacing", finer: 2.0 / 3.0, opens: None },
];

/// The knobs to sweep if none are named: when a substep's iterations end, how long substeps are, and the solver if the
/// preset can choose one.
///
/// The length of substeps has two limits, the CFL rule and `min_substeps`; where one decides, the other does nothing, so
/// both are moved together, as far as a preset may.
pub fn defaults(scene: &Scene) -> Vec<Vary> {
    let solvers = choices("liquid.solver").into_iter().map(|solver| vec![solver]).collect::<Vec<_>>();
    let solver = (!solvers.is_empty()).then(|| Vary { keys: vec!["liquid.solver".into()], values: solvers });
    let one = |key: &str, values: Vec<String>| Vary {
        keys: vec![key.into()],
        values: values.into_iter().map(|value| vec![value]).collect(),
    };
    let iterating = match number(scene, "liquid.iterations") {
        Some(n) => {
            one("liquid.iterations", [0.5, 1.0, 2.0].map(|f| plain("liquid.iterations", n * f)).to_vec())
        }
        None => one("liquid.density_dev", ["0.1%", "0.3%", "1%"].map(String::from).to_vec()),
    };
    let keys = ["liquid.cfl", "liquid.min_substeps"];
    let most = number(scene, "liquid.max_substeps").unwrap_or(f64::INFINITY);
    let steps = number(scene, keys[0]).zip(number(scene, keys[1])).map(|(cfl, least)| Vary {
        keys: keys.map(String::from).to_vec(),
        values: [0.5, 1.0, 2.0]
            .map(|f| vec![plain(keys[0], (cfl * f).min(LARGEST_CFL)), plain(keys[1], (least / f).min(most))])
            .to_vec(),
    });
    let mut vary: Vec<Vary> = solver.into_iter().chain([iterating]).chain(steps).collect();
    vary.iter_mut().for_each(|vary| vary.values.dedup());
    vary
}

/// The largest `liquid.cfl` that a preset may have.
const LARGEST_CFL: f64 = 10.0;

/// Every combination, the last key varying fastest.
fn combinations(base: &Overrides, vary: &[Vary]) -> Vec<Setting> {
    let mut sets: Vec<Vec<String>> = vec![Vec::new()];
    for Vary { keys, values } in vary {
        let changes = |values: &Vec<String>| -> Vec<String> {
            keys.iter().zip(values).map(|(key, value)| format!("{key}={value}")).collect()
        };
        sets = sets
            .into_iter()
            .flat_map(|set| values.iter().map(move |values| [&set[..], &changes(values)].concat()))
            .collect();
    }
    let setting = |set: Vec<String>| Setting {
        label: set.iter().map(|change| short(change)).collect::<Vec<_>>().join(" "),
        overrides: Overrides { set: [&base.set[..], &set].concat(), ..base.clone() },
    };
    sets.into_iter().map(setting).collect()
}

/// `liquid.cfl=0.2` without its table: the table is that of nearly every key.
fn short(change: &str) -> &str {
    change.strip_prefix("liquid.").unwrap_or(change)
}

/// The varied knobs that can be refined; those of the defaults if there are none.
fn refinable(vary: &[Vary], scene: &Scene) -> Vec<Knob> {
    let among = |vary: &[Vary]| -> Vec<Knob> {
        let is_varied = |knob: &Knob| vary.iter().any(|vary| vary.keys.iter().any(|key| key == knob.key));
        KNOBS.into_iter().filter(is_varied).collect()
    };
    let knobs = among(vary);
    if knobs.is_empty() { among(&defaults(scene)) } else { knobs }
}

/// The finest value of each knob in any row.
fn finest(knobs: &[Knob], rows: &[(Setting, Scene)]) -> Vec<Option<f64>> {
    let finer = |knob: &Knob, a: f64, b: f64| if knob.finer < 1.0 { a.min(b) } else { a.max(b) };
    let of = |knob: &Knob| {
        rows.iter().filter_map(|(_, scene)| number(scene, knob.key)).reduce(|a, b| finer(knob, a, b))
    };
    knobs.iter().map(of).collect()
}

/// The limits that finer knobs may run into, each with its largest value in any scene.
fn limits<'a>(scenes: impl Iterator<Item = &'a Scene> + Clone) -> [(&'static str, f64); 2] {
    ["liquid.max_iterations", "liquid.max_substeps"]
        .map(|limit| (limit, scenes.clone().filter_map(|scene| number(scene, limit)).fold(0.0, f64::max)))
}

/// The overrides with every knob finer than its value, and the limits behind them wider.
fn refine(
    base: &Overrides,
    knobs: &[Knob],
    values: &[Option<f64>],
    limits: &[(&'static str, f64)],
) -> Overrides {
    let finer = |key: &str| {
        let (knob, value) = knobs.iter().zip(values).find(|(knob, _)| knob.key == key)?;
        value.map(|value| value * knob.finer)
    };
    let set = |key: &str, value: f64| format!("{key}={}", plain(key, value));
    let refined = knobs.iter().filter_map(|knob| Some(set(knob.key, finer(knob.key)?)));

    // A limit that is no knob itself gives way, and never falls below the fewest substeps.
    let opened = limits
        .iter()
        .filter(|(limit, _)| finer(limit).is_none() && knobs.iter().any(|knob| knob.opens == Some(limit)));
    let opened = opened.map(|&(limit, most)| {
        let fewest = finer("liquid.min_substeps").filter(|_| limit == "liquid.max_substeps");
        set(limit, most.max(REFERENCE_LIMIT).max(fewest.unwrap_or(0.0)))
    });
    Overrides { set: base.set.iter().cloned().chain(refined).chain(opened).collect(), ..base.clone() }
}

/// Iterations and substeps that a reference may take at least: it shows what the knobs do, not what the limits do. Ten
/// times what the defaults allow; more would let a target that is never reached take days.
const REFERENCE_LIMIT: f64 = 1000.0;

/// A number as a preset takes it: whole where the key counts something.
fn plain(key: &str, value: f64) -> String {
    let counts = ["iterations", "substeps"].iter().any(|word| key.ends_with(word));
    if counts { format!("{}", value.round().max(1.0)) } else { format!("{}", value as f32) }
}

/// The number at a key of the scene.
fn number(scene: &Scene, key: &str) -> Option<f64> {
    scene.value(key).as_ref().and_then(Json::as_f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::load;

    fn request(vary: &[&str]) -> Request {
        Request { vary: vary.iter().map(|v| v.parse().unwrap()).collect(), ..Request::default() }
    }

    fn labels(sweep: &Sweep) -> Vec<&str> {
        sweep.rows.iter().map(|(setting, _)| setting.label.as_str()).collect()
    }

    #[test]
    fn values_are_split_outside_lists_and_quotes() {
        let values = |text: &str| text.parse::<Vary>().unwrap().values;
        assert_eq!(values("liquid.source.0.velocity=[0,0,-1],[0,0,-2]"), [["[0,0,-1]"], ["[0,0,-2]"]]);
        assert_eq!(values("a=\"1, 2\",3+4"), [["\"1, 2\""], ["3+4"]]);
        let together: Vary = "liquid.cfl + liquid.min_substeps=0.2+16,0.4+8".parse().unwrap();
        assert_eq!(together.keys, ["liquid.cfl", "liquid.min_substeps"]);
        assert_eq!(together.values, [["0.2", "16"], ["0.4", "8"]]);
        for wrong in ["", "a", "=1", "a=", "a=1,,2", "a+b=1+2,3", "a+=1+2"] {
            assert!(wrong.parse::<Vary>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn combinations_tiers_and_the_preset_itself_are_rows_once() {
        let preset = load("dam-break").unwrap();
        let sweep = request(&["liquid.cfl=0.2,0.8", "liquid.density_dev=0.3%,3%"]).sweep(&preset).unwrap();
        assert_eq!(
            labels(&sweep),
            [
                "as written = cfl=0.8 density_dev=0.3%",
                "cfl=0.2 density_dev=0.3%",
                "cfl=0.2 density_dev=3%",
                "cfl=0.8 density_dev=3%"
            ]
        );
        let tiers = Request { tiers: true, ..request(&["liquid.cfl=0.2"]) }.sweep(&preset).unwrap();
        assert_eq!(labels(&tiers), ["as written = final", "cfl=0.2", "draft", "preview"]);
        assert!(request(&["liquid.cflx=1"]).sweep(&preset).is_err());
    }

    #[test]
    fn the_reference_is_finer_than_every_row_and_its_refinement_finer_still() {
        let preset = load("dam-break").unwrap();
        let sweep = request(&[]).sweep(&preset).unwrap();
        assert_eq!(sweep.rows.len(), 18, "three tolerances, three steps, two solvers");
        let of = |scene: &Scene| {
            let liquid = scene.liquid.clone().unwrap();
            (liquid.density_dev.unwrap(), liquid.cfl, liquid.min_substeps, liquid.max_iterations)
        };
        assert_eq!(of(&sweep.reference.1), (0.0005, 0.2, 32, 1000));
        assert_eq!(of(&sweep.refined.1), (0.000_25, 0.1, 64, 1000));

        // Counts become larger, named references are taken as they are, unknown keys leave the defaults refined.
        let counts = Request {
            base: Overrides { quality: None, set: vec!["liquid.density_dev=none".into()] },
            ..request(&["liquid.iterations=2,8"])
        };
        let sweep = counts.sweep(&preset).unwrap();
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().iterations;
        assert_eq!((iterations(&sweep.reference.1), iterations(&sweep.refined.1)), (Some(16), Some(32)));
        let named = Request { reference: vec!["liquid.cfl=0.3".into()], ..request(&["liquid.cfl=0.4"]) };
        let sweep = named.sweep(&preset).unwrap();
        assert_eq!((of(&sweep.reference.1).1, of(&sweep.refined.1).1), (0.3, 0.15));
        let other = request(&["liquid.softening=0.01,0.1"]).sweep(&preset).unwrap();
        assert!(of(&other.refined.1) < of(&other.reference.1));
    }

    #[test]
    fn presets_at_the_limits_of_their_keys_can_be_swept() {
        let preset = load("dam-break").unwrap();
        let swept = |set: &[&str], vary: &[&str]| {
            let base = Overrides { quality: None, set: set.iter().map(|&word| word.into()).collect() };
            Request { base, ..request(vary) }.sweep(&preset).unwrap()
        };
        let steps = |scene: &Scene| {
            let liquid = scene.liquid.as_ref().unwrap();
            (liquid.cfl, liquid.min_substeps, liquid.max_substeps)
        };
        // Twice 60 substeps are more than the 100 that the preset allows, twice a CFL number of 6 more than 10.
        let many = swept(&["liquid.min_substeps=60"], &[]);
        let fewest: Vec<u32> = many.rows.iter().map(|(_, scene)| steps(scene).1).collect();
        assert!(fewest.contains(&100) && fewest.iter().all(|&least| least <= 100), "{fewest:?}");
        assert_eq!((steps(&many.reference.1), steps(&many.refined.1)), ((0.2, 200, 1000), (0.1, 400, 1000)));
        let more = swept(&["liquid.min_substeps=400", "liquid.max_substeps=400"], &[]);
        assert_eq!((steps(&more.reference.1).2, steps(&more.refined.1).2), (1000, 1600));
        let long = swept(&["liquid.cfl=6"], &[]);
        assert!(long.rows.iter().any(|(_, scene)| steps(scene).0 == 10.0));
        let fixed = swept(&["liquid.density_dev=none", "liquid.iterations=1"], &["liquid.cfl=0.4"]);
        assert_eq!(fixed.rows.len(), 2);
        let once = defaults(&fixed.base);
        assert!(once.iter().any(|vary| vary.values == [["1"], ["2"]]), "half of one is one: {once:?}");

        // A reference may take as much as any row.
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().max_iterations;
        let patient = swept(&["liquid.max_iterations=5000"], &[]);
        assert_eq!((iterations(&patient.reference.1), iterations(&patient.refined.1)), (5000, 5000));
        let varied = swept(&[], &["liquid.cfl=0.4", "liquid.max_substeps=50,5000"]);
        assert_eq!((steps(&varied.reference.1).2, steps(&varied.refined.1).2), (5000, 5000));
    }
}
