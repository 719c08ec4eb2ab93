//! Names of systems and products outside their folders.
//!
//! Jobs, scenes and the command line loop over the registries: a file that names a system or product has to be changed for
//! the next one. Identifiers count, and string literals that are a name or key; messages and help texts do not.

use super::imports::{Sources, strip};

/// A system or product, with the files that may name it.
struct Owner {
    /// Words of identifiers that name it.
    words: &'static [&'static str],
    /// Its folders and the couplings.
    folders: &'static [&'static str],
}

/// The systems and the products. Surface, volume and points are also words of geometry, so types name those products.
const OWNERS: [Owner; 12] = [
    Owner { words: &["liquid"], folders: &["src/sim/liquid/", "src/sim/coupling/"] },
    Owner {
        words: &["smoke", "vorton", "vortons"],
        folders: &["src/sim/smoke/", "src/sim/vortex/", "src/sim/coupling/"],
    },
    Owner { words: &["sheet", "sheets"], folders: &["src/sim/sheet/", "src/sim/coupling/"] },
    Owner {
        words: &["BodyParams", "BodySeeds", "BodyRecord"],
        folders: &["src/sim/rigid/", "src/sim/coupling/"],
    },
    Owner { words: &["coupling", "couplings"], folders: &["src/sim/coupling/"] },
    Owner { words: &["SurfaceMesh"], folders: &["src/product/surface/"] },
    Owner { words: &["PointCache"], folders: &["src/product/point_cache/"] },
    Owner { words: &["TracerPoints"], folders: &["src/product/points/"] },
    Owner { words: &["VolumeFile"], folders: &["src/product/volume/"] },
    Owner { words: &["ColliderMeshes"], folders: &["src/product/colliders/"] },
    Owner { words: &["WhitewaterPoints"], folders: &["src/product/whitewater/"] },
    Owner { words: &["UsdStage"], folders: &["src/product/usd/"] },
];

/// The registries and the composition of systems in presets, records and simulations.
const COMPOSITION: [&str; 10] = [
    "src/sim/mod.rs",
    "src/sim/registry.rs",
    "src/sim/record.rs",
    "src/sim/scene.rs",
    "src/sim/scene_check.rs",
    "src/sim/scene_query.rs",
    "src/sim/setup.rs",
    "src/sim/simulation.rs",
    "src/product/mod.rs",
    "src/product/registry.rs",
];

/// Other files that may name one, with the reason.
const ALLOWED: [(&str, &str, &str); 27] = [
    ("src/untrusted/", "sheet", "the importer of meshes with painted values, for sheets"),
    ("src/frame/kind.rs", "vortons", "a kind of streams"),
    ("src/cache/format.rs", "liquid", "streams of version 1 have no kind, which their names imply"),
    ("src/cache/format.rs", "smoke", "streams of version 1 have no kind, which their names imply"),
    ("src/cache/format.rs", "sheet", "streams of version 1 have no kind, which their names imply"),
    ("src/cache/format.rs", "vortons", "a kind of streams"),
    ("src/import/mod.rs", "sheet", "the importer of meshes with painted values, for sheets"),
    ("src/import/triangles.rs", "sheet", "the importer of meshes with painted values, for sheets"),
    ("src/export/mod.rs", "sheet", "the formats of the product `sheet`"),
    ("src/export/format.rs", "sheet", "the formats of the product `sheet`"),
    ("src/cli/product_args.rs", "sheet", "the formats of the product `sheet`"),
    ("src/cli/values.rs", "sheet", "the formats of the product `sheet`"),
    ("src/cli/export.rs", "sheet", "the formats of the product `sheet`"),
    ("src/sim/smoke/shed.rs", "sheet", "a vortex sheet"),
    ("src/mesh/shell.rs", "sheet", "a mesh without thickness"),
    ("src/product/point_cache/", "sheet", "the product `sheet`"),
    ("src/product/sheet_mesh/", "sheet", "the product `sheet`"),
    ("src/product/preview/", "sheet", "the meshes of the product `sheet` are drawn"),
    ("src/product/volume/", "smoke", "velocity and retiming of tracers are those of the smoke's air"),
    ("src/product/points/", "smoke", "the velocity of tracers is that of the smoke's air"),
    ("src/cli/volume.rs", "smoke", "the key that `--reseed` needs"),
    ("src/sim/rigid/", "liquid", "bodies share the substeps of a liquid"),
    ("src/sim/rigid/job/check.rs", "smoke", "bodies do not act on smoke"),
    ("src/sim/rigid/job/check.rs", "sheet", "bodies act on sheets or on a liquid"),
    ("src/sim/whitewater/", "liquid", "whitewater is emitted and moved by a liquid"),
    ("src/product/colliders/bodies.rs", "bodyparams", "bodies are written like colliders"),
    ("src/product/whitewater/", "liquid", "whitewater is computed from frames of a liquid"),
];

/// Every name of a system or product in a file that is not its own, as "file: word".
pub(crate) fn named_outside(sources: &Sources) -> Vec<String> {
    let mut found = Vec::new();
    for (path, text) in sources {
        if COMPOSITION.contains(&path.as_str()) || path.ends_with("/tests.rs") || path.contains("/tests/") {
            continue;
        }
        for (word, is_whole) in words(&strip(text, true)) {
            let lower = word.to_lowercase();
            // Systems are named by words, products by their types.
            let names = |name: &str| if is_type(name) { is_whole && name == word } else { name == lower };
            let owner = OWNERS.iter().find(|owner| owner.words.iter().any(|name| names(name)));
            let Some(owner) = owner else { continue };
            let is_own = owner.folders.iter().any(|folder| path.starts_with(folder));
            let is_allowed =
                ALLOWED.iter().any(|&(place, name, _)| path.starts_with(place) && lower.starts_with(name));
            if !is_own && !is_allowed {
                found.push(format!("{path}: {word}"));
            }
        }
    }
    found.dedup();
    found
}

/// Files of the list that name nothing they may.
pub(crate) fn needless_exceptions(sources: &Sources) -> Vec<&'static str> {
    let names = |path: &str, name: &str| {
        let texts = sources.iter().filter(|(file, _)| file.starts_with(path));
        let mut words = texts.flat_map(|(_, text)| words(&strip(text, true)));
        words.any(|(word, _)| word.to_lowercase().starts_with(name))
    };
    ALLOWED.iter().filter(|(path, name, _)| !names(path, name)).map(|&(path, ..)| path).collect()
}

fn is_type(name: &str) -> bool {
    name.starts_with(char::is_uppercase)
}

/// All identifiers, and the words that they and literals with names or keys consist of, by underscores and capitals; whether it
/// is a whole identifier.
fn words(code: &str) -> Vec<(String, bool)> {
    let mut found = Vec::new();
    for (place, part) in code.split('"').enumerate() {
        let is_literal = place % 2 == 1;
        let is_key = !part.is_empty() && part.chars().all(|c| c.is_ascii_lowercase() || "._".contains(c));
        if is_literal && !is_key {
            continue;
        }
        for identifier in part.split(|c: char| !(c.is_alphanumeric() || c == '_')) {
            found.push((identifier.to_owned(), true));
            let mut word = String::new();
            for c in identifier.chars() {
                if (c == '_' || c.is_uppercase()) && !word.is_empty() {
                    found.push((std::mem::take(&mut word), false));
                }
                if c != '_' {
                    word.push(c);
                }
            }
            found.push((word, false));
        }
    }
    found.retain(|(word, _)| !word.is_empty());
    found
}
