//! Which settings a tradeoff compares, and what it compares them with.

use crate::{
    job::{RunError, tradeoff::Setting},
    run::vary::{Vary, combinations},
    scene::{Overrides, Preset, Quality, Scene, SceneError, surface_params},
    sim::scene::plain_values,
    sim::tradeoff::{Axis, Change, Subject, Sweep, refine, refined},
};
use std::slice;

/// The changes of each value of a key.
fn axis(vary: &Vary) -> Axis {
    let change = |text| Change { text, apply: None };
    vary.assignments().into_iter().map(|assignments| assignments.into_iter().map(change).collect()).collect()
}

/// Base that settings change.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Origin<'a> {
    /// A preset.
    Preset(&'a Preset),
    /// Particles without a preset: only their surface is changed.
    Particles(&'a Scene),
}

impl Origin<'_> {
    /// The scene with the changes.
    ///
    /// # Errors
    /// With every problem found.
    pub(crate) fn scene(&self, overrides: &Overrides) -> Result<Scene, SceneError> {
        match self {
            Self::Preset(preset) => Scene::from_preset(preset, overrides),
            Self::Particles(scene) => {
                Ok(Scene { surface: surface_params(overrides.quality, &overrides.set)?, ..(*scene).clone() })
            }
        }
    }

    /// Checks a scene whose values were set by knobs, as if it had been written so.
    fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        match self {
            Self::Preset(preset) => {
                let written = Preset { text: scene.to_toml(), ..(*preset).clone() };
                Scene::from_preset(&written, &Overrides::default()).map(drop)
            }
            Self::Particles(_) => {
                let table = toml::Value::try_from(plain_values(&scene.surface));
                let table = table.expect("settings have only values that TOML can hold");
                surface_params(None, &[format!("surface={table}")]).map(drop)
            }
        }
    }

    /// The tiers of the preset; the final tier is the preset as written unless it has one of that name.
    fn tiers(&self) -> Vec<Quality> {
        let written = if let Self::Preset(preset) = self { preset.tiers() } else { Vec::new() };
        Quality::ALL.into_iter().filter(|tier| *tier == Quality::Final || written.contains(tier)).collect()
    }

    /// The scene of `base` with some changes, and what they set.
    fn changed(&self, base: &Overrides, changes: &[Change]) -> Result<(Overrides, Scene), SceneError> {
        let mut overrides = base.clone();
        overrides.set.extend(changes.iter().filter(|change| change.apply.is_none()).map(|c| c.text.clone()));
        let mut scene = self.scene(&overrides)?;
        let typed: Vec<_> =
            changes.iter().filter_map(|change| Some((change, change.apply.as_ref()?))).collect();
        for (change, apply) in &typed {
            apply(&mut scene);
            overrides.set.push(change.text.clone());
        }
        if !typed.is_empty() {
            self.check(&scene)?;
        }
        Ok((overrides, scene))
    }
}

/// What the user wants to compare.
#[derive(Clone, Debug, Default)]
pub(crate) struct Request {
    /// The preset's tier and `--set` arguments that every run shares.
    pub base: Overrides,
    /// The keys to vary; empty: see [`Subject::defaults`].
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
    pub(crate) fn sweep(&self, subject: &Subject, origin: Origin<'_>) -> Result<Sweep, RunError> {
        let base = origin.scene(&self.base)?;
        let by_default = self.vary.is_empty();
        let mut axes: Vec<Axis> =
            if by_default { (subject.defaults)(&base) } else { self.vary.iter().map(axis).collect() };
        axes.iter_mut().for_each(|axis| axis.dedup_by_key(|changes| change_texts(changes)));
        let keys = keys(&axes);
        for key in keys.iter().map(String::as_str).chain(self.reference.iter().map(|set| set.trim_start())) {
            if let Some(why) = (subject.refuse)(key) {
                return Err(RunError::Request(format!("{key}: found a key that {why}")));
            }
        }
        let one_by_one = by_default && subject.one_by_one;
        let combined: Vec<Vec<Change>> = if one_by_one {
            axes.iter().flat_map(|axis| combinations(slice::from_ref(axis))).collect()
        } else {
            combinations(&axes)
        };
        let mut wanted = vec![("as written".to_owned(), self.base.clone(), Vec::new())];
        wanted.extend(combined.into_iter().map(|changes| {
            let mut words: Vec<&str> = changes.iter().map(|change| short(subject, &change.text)).collect();
            // The same change of several sheets is printed once.
            words.dedup();
            (words.join(" "), self.base.clone(), changes)
        }));
        let tiers = origin.tiers().into_iter().filter(|_| self.tiers);
        wanted.extend(tiers.map(|tier| {
            let overrides = Overrides { quality: Some(tier), ..self.base.clone() };
            (tier.name().to_owned(), overrides, Vec::new())
        }));
        let mut rows: Vec<(Setting, Scene)> = Vec::new();
        for (label, overrides, changes) in wanted {
            let is_tier = self.tiers && overrides.quality != self.base.quality;
            let (overrides, scene) = origin.changed(&overrides, &changes)?;
            // Two names for one run are one row. The preset itself is one of the values of every key.
            match rows.iter_mut().find(|(_, other)| (subject.key)(other) == (subject.key)(&scene)) {
                Some(_) if one_by_one && !is_tier => {}
                Some((known, _)) => known.label = format!("{} = {label}", known.label),
                None => rows.push((setting(label, overrides), scene)),
            }
        }

        // The reference, and the reference refined.
        let all = (subject.knobs)(&base);
        let mut knobs = refined(&all, &keys);
        if knobs.is_empty() {
            knobs = refined(&all, &self::keys(&(subject.defaults)(&base)));
        }
        let finer = |overrides: &Overrides, scene: &Scene, than: &[&Scene]| {
            let (mut overrides, mut scene) = (overrides.clone(), scene.clone());
            overrides.set.extend(refine(&mut scene, &all, &knobs, than));
            origin.check(&scene).map(|()| (overrides, scene))
        };
        let (overrides, reference) = if self.reference.is_empty() {
            finer(&self.base, &base, &rows.iter().map(|(_, scene)| scene).collect::<Vec<_>>())?
        } else {
            let set = [&self.base.set[..], &self.reference].concat();
            let overrides = Overrides { set, ..self.base.clone() };
            let scene = origin.scene(&overrides)?;
            (overrides, scene)
        };
        let (again, refined) = finer(&overrides, &reference, &[&reference])?;
        if (subject.key)(&refined) == (subject.key)(&reference) {
            let keys: Vec<String> = knobs.iter().map(|knob| knob.key()).collect();
            return Err(RunError::Request(format!(
                "the reference cannot be refined: the preset has no number at {}",
                keys.join(", ")
            )));
        }
        let reference = (setting("reference".into(), overrides), reference);
        Ok(Sweep { rows, reference, refined: (setting("reference refined".into(), again), refined), base })
    }
}

fn setting(label: String, overrides: Overrides) -> Setting {
    Setting { label, quality: overrides.quality.map(Quality::name), set: overrides.set }
}

/// Every key that is varied.
fn keys(axes: &[Axis]) -> Vec<String> {
    let first = axes.iter().filter_map(|axis| axis.first());
    first.flatten().filter_map(|change| Some(change.text.split_once('=')?.0.trim().to_owned())).collect()
}

fn change_texts(changes: &[Change]) -> Vec<String> {
    changes.iter().map(|change| change.text.clone()).collect()
}

/// A change as texts have it: without its table, or of an entry of a list only its last key.
fn short<'a>(subject: &Subject, change: &'a str) -> &'a str {
    let key = change.split('=').next().unwrap_or_default();
    let is_number = |word: &str| word.parse::<usize>().is_ok();
    match change.strip_prefix(subject.table) {
        Some(short) => short,
        None if key.split('.').any(is_number) => &change[key.rfind('.').map_or(0, |dot| dot + 1)..],
        None => change,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        run::tradeoff::{subjects, systems},
        scene::load,
        sdf::Order,
    };

    fn request(vary: &[&str]) -> Request {
        Request { vary: vary.iter().map(|v| v.parse().unwrap()).collect(), ..Request::default() }
    }

    fn subject(name: &str) -> &'static Subject {
        subjects().find(|subject| subject.name == name).unwrap()
    }

    fn labels(sweep: &Sweep) -> Vec<&str> {
        sweep.rows.iter().map(|(setting, _)| setting.label.as_str()).collect()
    }

    #[test]
    fn combinations_tiers_and_the_preset_itself_are_rows_once() {
        let preset = load("dam-break").unwrap();
        let sweep = request(&["liquid.cfl=0.2,0.8", "liquid.density_dev=0.3%,3%"])
            .sweep(subject("liquid"), Origin::Preset(&preset))
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
            .sweep(subject("liquid"), Origin::Preset(&preset))
            .unwrap();
        assert_eq!(labels(&tiers), ["as written = final", "cfl=0.2", "draft", "preview"]);
        assert!(request(&["liquid.cflx=1"]).sweep(subject("liquid"), Origin::Preset(&preset)).is_err());
    }

    #[test]
    fn the_reference_is_finer_than_every_row_and_its_refinement_finer_still() {
        let preset = load("dam-break").unwrap();
        let sweep = request(&[]).sweep(subject("liquid"), Origin::Preset(&preset)).unwrap();
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
        let sweep = counts.sweep(subject("liquid"), Origin::Preset(&preset)).unwrap();
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().iterations;
        assert_eq!((iterations(&sweep.reference.1), iterations(&sweep.refined.1)), (Some(16), Some(32)));
        let named = Request { reference: vec!["liquid.cfl=0.3".into()], ..request(&["liquid.cfl=0.4"]) };
        let sweep = named.sweep(subject("liquid"), Origin::Preset(&preset)).unwrap();
        assert_eq!((of(&sweep.reference.1).1, of(&sweep.refined.1).1), (0.3, 0.15));
        let other = request(&["liquid.softening=0.01,0.1"])
            .sweep(subject("liquid"), Origin::Preset(&preset))
            .unwrap();
        assert!(of(&other.refined.1) < of(&other.reference.1));
    }

    #[test]
    fn surfaces_are_swept_without_a_preset_and_refer_to_a_finer_voxel() {
        let scene = load("dam-break").map(|preset| Scene::from_preset(&preset, &Overrides::default()));
        let bare = Scene { liquid: None, ..scene.unwrap().unwrap() };
        let sweep = |vary: &[&str]| request(vary).sweep(subject("surface"), Origin::Particles(&bare));
        let found = sweep(&[]).unwrap();
        assert_eq!(labels(&found)[0], "as written = voxel=0.5 distance=none");
        assert_eq!(found.rows.len(), 10, "five voxels, two methods");
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
            assert!(format!("{why:?}").contains(word), "{why:?}");
        }
    }

    #[test]
    fn settings_as_text_reproduce_the_scene_of_a_knob() {
        // A preset of each system and of a coupling.
        for name in ["dam-break", "smoke-over-sphere", "sheet-corners", "water-on-cloth"] {
            let preset = load(name).unwrap();
            let base = Scene::from_preset(&preset, &Overrides::default()).unwrap();
            for subject in systems(&base).chain([subject("surface")]) {
                let Sweep { rows, reference, refined, .. } =
                    Request::default().sweep(subject, Origin::Preset(&preset)).unwrap();
                for (setting, scene) in rows.iter().chain([&reference, &refined]) {
                    let written = Overrides { quality: None, set: setting.set.clone() };
                    let written = Scene::from_preset(&preset, &written).unwrap();
                    assert_eq!((subject.key)(&written), (subject.key)(scene), "{name}: {:?}", setting.set);
                }
            }
        }
    }

    #[test]
    fn presets_at_the_limits_of_their_keys_can_be_swept() {
        let preset = load("dam-break").unwrap();
        let swept = |set: &[&str], vary: &[&str]| {
            let base = Overrides { quality: None, set: set.iter().map(|&word| word.into()).collect() };
            Request { base, ..request(vary) }.sweep(subject("liquid"), Origin::Preset(&preset)).unwrap()
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
        let halved = swept(&["liquid.density_dev=none", "liquid.iterations=1"], &[]);
        assert_eq!(halved.rows.len(), 2 * 2 * 3, "half of one is one");

        // A reference may take as much as any row.
        let iterations = |scene: &Scene| scene.liquid.as_ref().unwrap().max_iterations;
        let patient = swept(&["liquid.max_iterations=5000"], &[]);
        assert_eq!((iterations(&patient.reference.1), iterations(&patient.refined.1)), (5000, 5000));
        let varied = swept(&[], &["liquid.cfl=0.4", "liquid.max_substeps=50,5000"]);
        assert_eq!((steps(&varied.reference.1).2, steps(&varied.refined.1).2), (5000, 5000));
    }
}
