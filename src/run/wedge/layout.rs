//! The wedges of a preset.

use super::list::{MAX_WEDGES, Wedge, WedgeList};
use crate::{
    job::RunError,
    run::vary::{Vary, combinations},
    scene::{Overrides, Preset, Quality, Scene},
};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::xxh3_64;

/// The wedges of a preset, in their order.
pub(crate) struct Layout {
    /// The list of the wedges.
    pub(crate) list: WedgeList,
    /// The scene of each.
    pub(crate) scenes: Vec<Scene>,
}

/// Characters of a folder's name.
const MAX_NAME: usize = 63;

/// Lays out a wedge for every combination of the values of `set`; keys with one value are the same in all.
///
/// # Errors
/// If one of them is not a valid preset, two are the same shot, or there are too many.
pub(crate) fn lay_out(preset: &Preset, quality: Option<Quality>, set: &[Vary]) -> Result<Layout, RunError> {
    let count = set.iter().try_fold(1_usize, |count, vary| count.checked_mul(vary.values.len()));
    if count.is_none_or(|count| count > MAX_WEDGES) {
        return Err(RunError::Request(format!(
            "--set: found {} combinations, expected at most {MAX_WEDGES}; give fewer values",
            count.map_or_else(|| "more than 10^19".into(), |count| count.to_string())
        )));
    }
    let varied: Vec<bool> =
        set.iter().flat_map(|vary| vary.keys.iter().map(|_| vary.values.len() > 1)).collect();
    let keys: Vec<String> = set.iter().flat_map(|vary| vary.keys.clone()).collect();
    let of_varied = |all: &[String]| -> Vec<String> {
        all.iter().zip(&varied).filter(|(_, varied)| **varied).map(|(text, _)| text.clone()).collect()
    };
    let values = combinations(&set.iter().map(|vary| vary.values.clone()).collect::<Vec<_>>());
    let mut scenes: Vec<Scene> = Vec::new();
    for chosen in &values {
        let set = keys.iter().zip(chosen).map(|(key, value)| format!("{key}={value}")).collect();
        let scene = Scene::from_preset(preset, &Overrides { quality, set })?;
        if let Some(same) = scenes.iter().position(|other| *other == scene) {
            let texts = [same, scenes.len()].map(|place| of_varied(&values[place]).join(" "));
            return Err(RunError::Request(format!(
                "--set: the wedges {:?} and {:?} are the same shot; leave one of the values out",
                texts[0], texts[1]
            )));
        }
        scenes.push(scene);
    }
    let varied_keys = of_varied(&keys);
    let all: Vec<Vec<String>> = values.iter().map(|values| of_varied(values)).collect();
    let folders = folders(&varied_keys, &all);
    let wedges = folders.into_iter().zip(all).map(|(folder, values)| Wedge { folder, values }).collect();
    let title = scenes.first().map_or("", |scene| &scene.title);
    let mut list = WedgeList::new(title, varied_keys, wedges);
    if varied.contains(&false) {
        let setting = |(place, key): (usize, &String)| match varied[place] {
            true => key.clone(),
            false => format!("{key}={}", values[0][place]),
        };
        list.set = keys.iter().enumerate().map(setting).collect();
    }
    list.check()
        .map_err(|found| RunError::Request(format!("--set: {found}; put long values into a preset")))?;
    Ok(Layout { list, scenes })
}

/// A folder for each wedge, called by its keys and values, so that more values of the same keys later leave those that are there as
/// they are. Where a name does not hold all of its values, their hash follows.
fn folders(keys: &[String], all: &[Vec<String>]) -> Vec<String> {
    let name = |values: &Vec<String>| {
        let part = |(key, value): (&String, &String)| {
            let key = key.rsplit('.').next().unwrap_or(key);
            format!("{}-{}", plain(key), plain(value))
        };
        let parts: Vec<String> = keys.iter().zip(values).map(part).collect();
        if parts.is_empty() { "as-written".into() } else { parts.join("_") }
    };
    let names: Vec<String> = all.iter().map(name).collect();
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    let is_whole = |values: &[String]| values.iter().all(|value| is_plain(value));
    for (name, _) in names.iter().zip(all).filter(|(_, values)| is_whole(values)) {
        *uses.entry(name.to_ascii_lowercase()).or_default() += 1;
    }
    let unique = |(name, values): (&String, &Vec<String>)| {
        if is_whole(values) && name.len() <= MAX_NAME && uses[&name.to_ascii_lowercase()] == 1 {
            return name.clone();
        }
        let hash = xxh3_64(values.join("\n").as_bytes());
        format!("{}-{hash:016x}", &name[..name.len().min(MAX_NAME - 17)])
    };
    names.iter().zip(all).map(unique).collect()
}

/// Whether no other text has the same [`plain`] form, in capitals or not.
fn is_plain(text: &str) -> bool {
    let chars: Vec<char> = text.chars().collect();
    let is_digit =
        |place: Option<usize>| place.and_then(|place| chars.get(place)).is_some_and(char::is_ascii_digit);
    let is_kept = |(place, c): (usize, &char)| {
        let is_between_digits = is_digit(place.checked_sub(1)) && is_digit(Some(place + 1));
        match c {
            '.' => is_between_digits,
            'p' => !is_between_digits,
            c => c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(*c),
        }
    };
    chars.iter().enumerate().all(is_kept)
}

/// A text as part of a name: a point becomes `p`, other special characters dashes.
fn plain(text: &str) -> String {
    let plain = |c: char| match c {
        '.' => 'p',
        c if c.is_ascii_alphanumeric() || c == '_' => c,
        _ => '-',
    };
    text.chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{job::is_file_name, scene::load};

    fn of(set: &[&str]) -> Result<Layout, RunError> {
        let set: Vec<Vary> = set.iter().map(|set| set.parse().unwrap()).collect();
        lay_out(&load("dam-break").unwrap(), None, &set)
    }

    #[test]
    fn every_combination_has_a_folder_and_its_scene() {
        let Layout { list, scenes } =
            of(&["liquid.cfl=0.4,0.8", "fps=25", "liquid.iterations+liquid.density_dev=4+none,9+none"])
                .unwrap();
        assert_eq!(list.keys, ["liquid.cfl", "liquid.iterations", "liquid.density_dev"]);
        let folders: Vec<&str> = list.wedges.iter().map(|wedge| wedge.folder.as_str()).collect();
        assert_eq!(folders[0], "cfl-0p4_iterations-4_density_dev-none");
        assert_eq!(folders.len(), 4);
        let liquid = |place: usize| scenes[place].liquid.clone().unwrap();
        assert_eq!((liquid(1).cfl, liquid(1).iterations, scenes[1].fps), (0.4, Some(9), 25.0));
        assert_eq!((liquid(2).cfl, liquid(2).iterations), (0.8, Some(4)));
        for (place, wedge) in list.wedges.iter().enumerate() {
            let settings = list.settings(wedge);
            assert!(settings.len() == 4 && settings[1] == "fps=25", "{settings:?}");
            let preset = load("dam-break").unwrap();
            let scene = Scene::from_preset(&preset, &Overrides { quality: None, set: settings }).unwrap();
            assert_eq!(scene, scenes[place]);
        }
        let plain = of(&[]).unwrap();
        assert_eq!((plain.list.wedges[0].folder.as_str(), plain.scenes.len()), ("as-written", 1));
    }

    #[test]
    fn names_are_plain_short_and_different() {
        let keys = vec!["a.b".to_owned()];
        let long = "x".repeat(90);
        let all: Vec<Vec<String>> = ["1.5", "1p5", "A", "a", "[0, 1]", "../x", "é", &long]
            .iter()
            .map(|v| vec![(*v).to_owned()])
            .collect();
        let names = folders(&keys, &all);
        assert!(names.iter().all(|name| is_file_name(name)), "{names:?}");
        let lower: std::collections::BTreeSet<String> =
            names.iter().map(|name| name.to_lowercase()).collect();
        assert_eq!(lower.len(), all.len(), "{names:?}");
        assert!(names[4].starts_with("b--0--1--") && names[0] == "b-1p5" && names[3] == "b-a", "{names:?}");
        // More values leave the others where they are, also those that look alike.
        for place in 0..all.len() {
            assert_eq!(folders(&keys, &all[place..=place]), names[place..=place]);
        }
    }

    #[test]
    fn wedges_that_are_the_same_or_too_many_are_refused() {
        let refused = |set: &[&str]| of(set).err().unwrap().to_string();
        assert!(refused(&["liquid.cfl=0.4,0.40"]).contains("same shot"));
        let many = (1..=40).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
        let many = format!("liquid.iterations={many}");
        assert!(refused(&[&many, &many]).contains("found 1600 combinations"));
        let axes = vec![many.as_str(); 20];
        assert!(refused(&axes).contains("more than"));
        assert!(of(&["liquid.cflx=1,2"]).is_err());
    }
}
