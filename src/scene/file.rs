//! Where presets come from, and how text becomes a [`Scene`].

use super::{Quality, Scene};
use crate::{
    cache::{open_regular, read_bytes},
    export::vdb::VolumeParams,
    mesh::SurfaceParams,
    preset::{
        assets::{self, Home},
        builtin, check, model,
        problem::{Finding, SceneError, Source, Span, locate},
        tree::{self, Entry, Node, Value},
    },
    product::{self, ProductSettings},
    sim::{
        registry::{ALL, mesh_files},
        scene_check,
        whitewater::WhitewaterParams,
    },
};
use schemars::JsonSchema;
use serde::{Deserialize, de::DeserializeOwned};
use std::{collections::HashSet, io, path::Path};

/// The text of a preset, not yet read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Preset {
    /// The file or the built-in name, as messages call it.
    pub name: String,
    /// All of its text.
    pub text: String,
    /// Where the files are that it names.
    pub home: Home,
}

impl Preset {
    /// The quality tiers that it has tables for; none if its text cannot be read.
    pub fn tiers(&self) -> Vec<Quality> {
        let Ok(mut root) = tree::parse(0, &self.text) else { return Vec::new() };
        take_tiers(&mut root, &mut Vec::new()).into_iter().map(|(tier, _)| tier).collect()
    }
}

/// What the command line changes in a preset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// The quality tier to apply; `None` leaves the preset as written.
    pub quality: Option<Quality>,
    /// `key=value` arguments, applied in order after the tier.
    pub set: Vec<String>,
}

/// Finds a preset: a file if `preset` is one, ends in `.toml` or has a path separator; else a built-in name.
///
/// # Errors
/// [`SceneError::UnknownPreset`], [`SceneError::Unreadable`], or [`SceneError::Invalid`] if the file is not
/// UTF-8 text.
pub fn load(preset: &str) -> Result<Preset, SceneError> {
    let path = Path::new(preset);
    let names = || builtin::all().iter().map(|&(name, _)| name);
    if path.is_file() || preset.ends_with(".toml") || preset.contains(['/', std::path::MAIN_SEPARATOR]) {
        let bytes = read_preset(path).map_err(|cause| SceneError::Unreadable {
            path: path.to_owned(),
            cause,
            nearest: path.file_stem().and_then(|stem| check::nearest(&stem.to_string_lossy(), names())),
        })?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        return decode(preset, bytes, Home::Folder(folder));
    }
    match builtin::get(preset) {
        Some(text) => Ok(Preset { name: preset.to_owned(), text: text.to_owned(), home: Home::BuiltIn }),
        None => Err(SceneError::UnknownPreset {
            name: preset.to_owned(),
            nearest: check::nearest(preset, names()),
        }),
    }
}

/// The largest preset that is read [bytes]. Those that are built in have at most 5 kB.
const MAX_PRESET: u64 = 1 << 20;

/// The bytes of a preset's file: in a folder of a stranger a pipe may be called like it.
fn read_preset(path: &Path) -> io::Result<Vec<u8>> {
    let (file, length) = open_regular(path)?;
    if length > MAX_PRESET {
        let found = format!("found {length} bytes, expected at most {MAX_PRESET}");
        return Err(io::Error::new(io::ErrorKind::InvalidData, found));
    }
    read_bytes(file, length)
}

/// The file's bytes as text, without the byte order mark that some editors put first.
pub(crate) fn decode(name: &str, bytes: Vec<u8>, home: Home) -> Result<Preset, SceneError> {
    let name = name.to_owned();
    match String::from_utf8(bytes) {
        Ok(text) => {
            let text = text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned();
            Ok(Preset { name, text, home })
        }
        Err(error) => {
            let at = error.utf8_error().valid_up_to();
            let text = String::from_utf8_lossy(error.as_bytes()).into_owned();
            let found = format!("found the byte 0x{:02X}", error.as_bytes()[at]);
            let finding = Finding::new(
                Span { source: 0, start: at, end: at + '\u{fffd}'.len_utf8() },
                "",
                "the preset is not UTF-8 text",
                found,
            )
            .with_help("save the file as UTF-8 in a text editor");
            Err(SceneError::Invalid(locate(vec![finding], &[Source { name, text: text.into() }])))
        }
    }
}

impl Scene {
    /// Reads a preset, applies the overrides, and checks the values.
    ///
    /// Every quality tier that the preset has is checked too, so that a mistake in one is found before the
    /// night it is used.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] with every problem found.
    pub fn from_preset(preset: &Preset, overrides: &Overrides) -> Result<Self, SceneError> {
        let mut sources = vec![Source { name: preset.name.clone(), text: preset.text.as_str().into() }];
        let mut findings = Vec::new();
        let scene = read(preset, overrides, &mut sources, &mut findings);
        match scene {
            Some(scene) if findings.is_empty() => Ok(scene),
            _ => Err(SceneError::Invalid(locate(findings, &sources))),
        }
    }
}

fn read(
    preset: &Preset,
    overrides: &Overrides,
    sources: &mut Vec<Source>,
    findings: &mut Vec<Finding>,
) -> Option<Scene> {
    let mut root = match tree::parse(0, &preset.text) {
        Ok(root) => root,
        Err(errors) => {
            findings.extend(errors);
            return None;
        }
    };
    let model = Scene::model();
    let tiers = take_tiers(&mut root, findings);

    // Each tier that is not requested is checked on top of the preset; only what it adds is its fault.
    let mut known = Vec::new();
    interpret(&root, model, &preset.home, &mut known);
    let known: HashSet<Finding> = known.into_iter().collect();
    for (name, tier) in tiers.iter().filter(|(name, _)| Some(*name) != overrides.quality) {
        let mut shot = root.clone();
        shot.overlay(tier.clone());
        let mut found = Vec::new();
        interpret(&shot, model, &preset.home, &mut found);
        findings.extend(found.into_iter().filter(|finding| !known.contains(finding)).map(|finding| {
            Finding { message: format!("with quality `{name}`: {}", finding.message), ..finding }
        }));
    }

    // The requested shot: preset, then tier, then the arguments in order.
    if let Some(quality) = overrides.quality {
        match tiers.into_iter().find(|(name, _)| *name == quality) {
            Some((_, tier)) => root.overlay(tier),
            None if quality == Quality::Final => {}
            None => {
                sources.push(Source { name: "--quality".to_owned(), text: quality.to_string().into() });
                findings.push(missing_tier(quality, sources.len() - 1, preset));
            }
        }
    }
    for argument in &overrides.set {
        sources.push(Source { name: "--set".to_owned(), text: argument.as_str().into() });
        if let Err(finding) = tree::set(&mut root, sources.len() - 1, sources) {
            findings.push(*finding);
        }
    }
    let mut scene = interpret(&root, model, &preset.home, findings)?;
    match assets::read(&mesh_files(&scene), &preset.home) {
        Ok(assets) => scene.assets = assets,
        Err(finding) => findings.push(*finding),
    }
    Some(scene)
}

/// Parameters of a surface from a tier and `key=value` settings (`surface.voxel=0.25`), checked like a preset's. Without a tier they
/// start from the defaults.
///
/// # Errors
/// [`SceneError::Invalid`] with every problem found.
pub fn surface_params(quality: Option<Quality>, set: &[String]) -> Result<SurfaceParams, SceneError> {
    #[derive(Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Alone {
        #[serde(default)]
        surface: SurfaceParams,
    }
    alone(quality, set).map(|Alone { surface }| surface)
}

/// The settings of products that `key=value` arguments make of a tier of surfaces, for frames without a preset; without a tier, of
/// the defaults.
///
/// # Errors
/// [`SceneError::Invalid`] with every problem found.
pub(crate) fn product_settings(
    quality: Option<Quality>,
    set: &[String],
) -> Result<ProductSettings, SceneError> {
    #[derive(Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Alone {
        #[serde(default)]
        surface: SurfaceParams,
        #[serde(default)]
        volume: VolumeParams,
        #[serde(default)]
        whitewater: Option<WhitewaterParams>,
    }
    alone(quality, set).map(|Alone { surface, volume, whitewater }| ProductSettings {
        surface,
        volume,
        whitewater,
        ..ProductSettings::default()
    })
}

/// The tables that `--set` arguments make without a preset.
fn alone<T: JsonSchema + DeserializeOwned>(
    quality: Option<Quality>,
    set: &[String],
) -> Result<T, SceneError> {
    let settings = quality.map_or("", Quality::surface_settings);
    let mut sources = vec![Source { name: "preset".to_owned(), text: settings.into() }];
    let mut findings = Vec::new();
    let mut root =
        tree::parse(0, settings).unwrap_or_else(|_| unreachable!("settings of tiers are well formed"));
    for argument in set {
        sources.push(Source { name: "--set".to_owned(), text: argument.as_str().into() });
        if let Err(finding) = tree::set(&mut root, sources.len() - 1, &sources) {
            findings.push(*finding);
        }
    }
    let checked = check::check(&root, &model::of::<T>());
    findings.extend(checked.findings);
    if !findings.is_empty() {
        return Err(SceneError::Invalid(locate(findings, &sources)));
    }
    Ok(serde_json::from_value(checked.values).expect("values that fit the schema of a table make one"))
}

/// The scene of a tree, or findings of what is wrong with it.
fn interpret(root: &Node, model: &model::Field, home: &Home, findings: &mut Vec<Finding>) -> Option<Scene> {
    let checked = check::check(root, model);
    if !checked.findings.is_empty() {
        findings.extend(checked.findings);
        return None;
    }
    let mut scene: Scene =
        serde_json::from_value(checked.values).expect("values that fit the schema of Scene make a Scene");
    ALL.iter().for_each(|system| system.complete(&mut scene));
    let mut wrong = scene_check::check(&scene, &checked.places);
    product::check(&scene, &checked.places, &mut wrong);
    wrong.extend(assets::check(&mesh_files(&scene), home, &checked.places));
    let fine = wrong.is_empty();
    findings.extend(wrong);
    fine.then_some(scene)
}

/// Cuts the `quality` table out of the preset.
fn take_tiers(root: &mut Node, findings: &mut Vec<Finding>) -> Vec<(Quality, Node)> {
    let Value::Table(entries) = &mut root.value else { return Vec::new() };
    let Some(at) = entries.iter().position(|entry| entry.key == "quality") else { return Vec::new() };
    let Entry { node, .. } = entries.remove(at);
    let Value::Table(tiers) = node.value else {
        let label = format!("found {}, expected tables such as `[quality.draft]`", node.describe());
        findings.push(Finding::new(node.span, "quality", "`quality` holds the preset's tiers", label));
        return Vec::new();
    };
    let mut out = Vec::new();
    for Entry { key, key_span, node } in tiers {
        match (key.parse::<Quality>(), &node.value) {
            (Ok(quality), Value::Table(_)) => out.push((quality, node)),
            (Ok(_), _) => {
                let label = format!("found {}, expected a table", node.describe());
                let message = format!("`quality.{key}` is not a table");
                let help = format!("write the keys to change below `[quality.{key}]`");
                findings
                    .push(Finding::new(node.span, format!("quality.{key}"), message, label).with_help(help));
            }
            (Err(_), _) => {
                let names = Quality::ALL.map(Quality::name);
                let message = format!("there is no quality tier `{key}`");
                let mut finding =
                    Finding::new(key_span, format!("quality.{key}"), message, "expected a tier's name")
                        .with_help("the tiers are `draft`, `preview` and `final`");
                finding.nearest = check::nearest(&key, names);
                findings.push(finding);
            }
        }
    }
    out
}

fn missing_tier(quality: Quality, source: usize, preset: &Preset) -> Finding {
    let mut there: Vec<String> = preset.tiers().iter().map(|tier| format!("`{tier}`")).collect();
    if !there.iter().any(|tier| tier == "`final`") {
        there.push("`final` (the preset as written)".to_owned());
    }
    let end = quality.name().len();
    Finding::new(
        Span { source, start: 0, end },
        "quality",
        format!("the preset {} has no tier `{quality}`", preset.name),
        format!("expected {}", there.join(", ")),
    )
    .with_help(format!("add a `[quality.{quality}]` table with the keys to change, or name another tier"))
}
