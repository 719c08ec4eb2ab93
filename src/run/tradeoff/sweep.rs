//! Which settings a tradeoff compares, and what it compares them with.

use super::{
    cells,
    knobs::{Subject, finest, limits, number, refinable, refine},
};
use crate::{
    run::RunError,
    scene::{Overrides, Preset, Quality, Scene, SceneError, surface_alone},
};
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

/// What settings are changes of.
#[derive(Clone, Copy, Debug)]
pub enum Ground<'a> {
    /// A preset.
    Preset(&'a Preset),
    /// Particles without one: only its surface is changed.
    Bare(&'a Scene),
}

impl Ground<'_> {
    /// The scene with the changes.
    ///
    /// # Errors
    /// With every problem found.
    pub fn scene(&self, overrides: &Overrides) -> Result<Scene, SceneError> {
        match self {
            Self::Preset(preset) => Scene::from_preset(preset, overrides),
            Self::Bare(scene) => Ok(Scene { surface: surface_alone(&overrides.set)?, ..(*scene).clone() }),
        }
    }

    fn has_tier(&self, tier: Option<Quality>) -> bool {
        let words = |tier: Quality| format!("[quality.{}", tier.name());
        match self {
            Self::Preset(preset) => tier.is_none_or(|tier| preset.text.contains(&words(tier))),
            Self::Bare(_) => false,
        }
    }
}

/// What the user asked to compare.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// The preset's tier and `--set` arguments that every run shares.
    pub base: Overrides,
    /// The keys to vary; empty: sensible ones, see [`Subject::defaults`].
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
    /// If one of them is not a valid preset, the reference cannot be refined, or a key has nothing to do with the subject.
    pub fn sweep(&self, subject: Subject, ground: Ground<'_>) -> Result<Sweep, RunError> {
        let base = ground.scene(&self.base)?;
        let vary = if self.vary.is_empty() { subject.defaults(&base) } else { self.vary.clone() };
        subject.refuse_others(&vary, &self.reference)?;
        let one_by_one = self.vary.is_empty() && subject.varies_one_by_one();
        let mut rows: Vec<(Setting, Scene)> = Vec::new();
        let mut settings = vec![Setting { label: "as written".into(), overrides: self.base.clone() }];
        if one_by_one {
            let alone = vary.chunks(1).flat_map(|vary| combinations(&self.base, vary, subject));
            settings.extend(alone);
        } else {
            settings.extend(combinations(&self.base, &vary, subject));
        }
        if self.tiers {
            settings.extend(Quality::ALL.map(|tier| Setting {
                label: tier.name().into(),
                overrides: Overrides { quality: Some(tier), set: self.base.set.clone() },
            }));
        }
        for setting in settings {
            let is_tier = self.tiers && setting.overrides.quality != self.base.quality;
            let scene = match ground.scene(&setting.overrides) {
                Err(_) if is_tier && !ground.has_tier(setting.overrides.quality) => continue,
                scene => scene?,
            };
            // Two names for one run are one row. The preset itself is one of the values of every key.
            match rows.iter_mut().find(|(_, other)| subject.key(other) == subject.key(&scene)) {
                Some(_) if one_by_one && !is_tier => {}
                Some((known, _)) => known.label = format!("{} = {}", known.label, setting.label),
                None => rows.push((setting, scene)),
            }
        }

        // The reference, and the reference refined.
        let knobs = refinable(subject, &vary, &base);
        let scenes = rows.iter().map(|(_, scene)| scene);
        let reference = match &self.reference[..] {
            [] => {
                let finer =
                    refine(&self.base, &knobs, &finest(&knobs, scenes.clone()), &limits(scenes.clone()));
                cells::refine(finer, &vary, scenes)
            }
            given => Overrides { set: [&self.base.set[..], given].concat(), ..self.base.clone() },
        };
        let checked = |name: &str, overrides: Overrides| -> Result<(Setting, Scene), RunError> {
            let scene = ground.scene(&overrides)?;
            Ok((Setting { label: name.into(), overrides }, scene))
        };
        let reference = checked("reference", reference)?;
        let values: Vec<Option<f64>> = knobs.iter().map(|knob| number(&reference.1, knob.key)).collect();
        let once = [&reference.1].into_iter();
        let finer = refine(&reference.0.overrides, &knobs, &values, &limits(once.clone()));
        let finer = cells::refine(finer, &vary, once);
        let refined = checked("reference refined", finer)?;
        if subject.key(&refined.1) == subject.key(&reference.1) {
            return Err(RunError::Request(format!(
                "the reference cannot be refined: the preset has no number at {}",
                subject.refined_keys().join(", ")
            )));
        }
        Ok(Sweep { rows, reference, refined, base })
    }
}

/// Every combination, the last key varying fastest.
fn combinations(base: &Overrides, vary: &[Vary], subject: Subject) -> Vec<Setting> {
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
        label: label(set.iter().map(|change| subject.short(change)).collect()),
        overrides: Overrides { set: [&base.set[..], &set].concat(), ..base.clone() },
    };
    sets.into_iter().map(setting).collect()
}

/// Words side by side; the same of several sheets is said once.
fn label(mut words: Vec<&str>) -> String {
    words.dedup();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{scene::load, sdf::Order};

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
        let sweep = request(&["liquid.cfl=0.2,0.8", "liquid.density_dev=0.3%,3%"])
            .sweep(Subject::Liquid, Ground::Preset(&preset))
            .unwrap();
        assert_eq!(
            labels(&sweep),
            [
                "as written = cfl=0.8 density_dev=0.3%",
                "cfl=0.2 density_dev=0.3%",
                "cfl=0.2 density_dev=3%",
                "cfl=0.8 density_dev=3%"
            ]
        );
        let tiers = Request { tiers: true, ..request(&["liquid.cfl=0.2"]) }
            .sweep(Subject::Liquid, Ground::Preset(&preset))
            .unwrap();
        assert_eq!(labels(&tiers), ["as written = final", "cfl=0.2", "draft", "preview"]);
        assert!(request(&["liquid.cflx=1"]).sweep(Subject::Liquid, Ground::Preset(&preset)).is_err());
    }

    #[test]
    fn the_reference_is_finer_than_every_row_and_its_refinement_finer_still() {
        let preset = load("dam-break").unwrap();
        let sweep = request(&[]).sweep(Subject::Liquid, Ground::Preset(&preset)).unwrap();
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
        let sweep = counts.sweep(Subject::Liquid, Ground::Preset(&preset)).unwrap();
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().iterations;
        assert_eq!((iterations(&sweep.reference.1), iterations(&sweep.refined.1)), (Some(16), Some(32)));
        let named = Request { reference: vec!["liquid.cfl=0.3".into()], ..request(&["liquid.cfl=0.4"]) };
        let sweep = named.sweep(Subject::Liquid, Ground::Preset(&preset)).unwrap();
        assert_eq!((of(&sweep.reference.1).1, of(&sweep.refined.1).1), (0.3, 0.15));
        let other =
            request(&["liquid.softening=0.01,0.1"]).sweep(Subject::Liquid, Ground::Preset(&preset)).unwrap();
        assert!(of(&other.refined.1) < of(&other.reference.1));
    }

    #[test]
    fn surfaces_are_swept_without_a_preset_and_refer_to_a_finer_voxel() {
        let scene = load("dam-break").map(|preset| Scene::from_preset(&preset, &Overrides::default()));
        let bare = Scene { liquid: None, ..scene.unwrap().unwrap() };
        let sweep = |vary: &[&str]| request(vary).sweep(Subject::Surface, Ground::Bare(&bare));
        let found = sweep(&[]).unwrap();
        assert_eq!(labels(&found)[0], "as written = voxel=0.5 distance=none");
        assert_eq!(found.rows.len(), 10, "five voxels, two ways");
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        let (reference, refined) = (&found.reference.1.surface, &found.refined.1.surface);
        assert!(near(reference.voxel, 0.2) && near(refined.voxel, 0.2 / 1.5));
        assert!(reference.distance.is_some() && refined.distance.is_some());

        // Tables come and go by name; what only leaves triangles out is not in the reference.
        let found = sweep(&["surface.smoothing=none,{}", "surface.decimation.fraction=0.5,0.2"]).unwrap();
        assert_eq!(found.rows.len(), 5);
        let has = |scene: &Scene| (scene.surface.smoothing.is_some(), scene.surface.decimation.is_some());
        assert_eq!(has(&found.rows[3].1), (true, true));
        assert_eq!((has(&found.reference.1), has(&found.refined.1)), ((false, false), (false, false)));
        assert!(near(found.reference.1.surface.voxel, 1.0 / 3.0));
        let wide = sweep(&["surface.distance.band=1,2,6", "surface.distance.order=first,second"]).unwrap();
        let found =
            [&wide.reference, &wide.refined].map(|row| row.1.surface.distance.map(|d| (d.band, d.order)));
        assert_eq!(found, [Some((6.0, Order::Second)); 2]);
        for (vary, word) in [("surface.voxl=1", "voxel"), ("liquid.cfl=0.2", "surface.")] {
            let why = sweep(&[vary]).unwrap_err();
            let told = match &why {
                RunError::Scene(SceneError::Invalid(problems)) => format!("{problems:?}"),
                other => other.to_string(),
            };
            assert!(told.contains(word), "{told}");
        }
    }

    #[test]
    fn presets_at_the_limits_of_their_keys_can_be_swept() {
        let preset = load("dam-break").unwrap();
        let swept = |set: &[&str], vary: &[&str]| {
            let base = Overrides { quality: None, set: set.iter().map(|&word| word.into()).collect() };
            Request { base, ..request(vary) }.sweep(Subject::Liquid, Ground::Preset(&preset)).unwrap()
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
        let once = Subject::Liquid.defaults(&fixed.base);
        assert!(once.iter().any(|vary| vary.values == [["1"], ["2"]]), "half of one is one: {once:?}");

        // A reference may take as much as any row.
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().max_iterations;
        let patient = swept(&["liquid.max_iterations=5000"], &[]);
        assert_eq!((iterations(&patient.reference.1), iterations(&patient.refined.1)), (5000, 5000));
        let varied = swept(&[], &["liquid.cfl=0.4", "liquid.max_substeps=50,5000"]);
        assert_eq!((steps(&varied.reference.1).2, steps(&varied.refined.1).2), (5000, 5000));
    }
}
