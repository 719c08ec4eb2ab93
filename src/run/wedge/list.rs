//! `wedges.json`: which variants of a shot a folder holds.

use crate::{
    cache::{self, CacheError},
    control::printable_path,
    job::{RunError, ShotFolder, is_file_name},
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeSet,
    io::{Error, ErrorKind},
    path::{Path, PathBuf},
};

/// The list of wedges in a folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct WedgeList {
    /// Always "meniscus-wedges".
    pub format: String,
    /// Version of this format.
    pub version: u32,
    /// The shot's name.
    pub title: String,
    /// The keys that differ, in the order in which they were given.
    pub keys: Vec<String>,
    /// All settings in the order in which they were given: those that differ by their key, the others as `KEY=VALUE`. None if all differ.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// The wedges, the last key varying fastest.
    pub wedges: Vec<Wedge>,
}

/// A variant of the shot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Wedge {
    /// Its shot folder, below the folder of the list.
    pub folder: String,
    /// The values of the keys.
    pub values: Vec<String>,
}

const FORMAT: &str = "meniscus-wedges";

const VERSION: u32 = 1;

/// Length that a list may have [bytes].
const MAX_BYTES: u64 = 4 << 20;

/// Characters of a key or a value.
const MAX_CHARACTERS: usize = 200;

/// Settings that a list may have.
const MAX_SETTINGS: usize = 1000;

/// Length of a setting that is the same in all [bytes].
const MAX_SETTING: usize = 100_000;

/// Wedges that a folder may have: each is a shot.
pub(crate) const MAX_WEDGES: usize = 1000;

impl WedgeList {
    /// The list of a shot's wedges.
    pub(crate) fn new(title: &str, keys: Vec<String>, wedges: Vec<Wedge>) -> Self {
        Self { format: FORMAT.into(), version: VERSION, title: title.into(), keys, set: Vec::new(), wedges }
    }

    /// Where the list of a folder is.
    pub(crate) fn path(folder: &Path) -> PathBuf {
        folder.join("wedges.json")
    }

    /// The list of a folder; `None` if the folder has none.
    ///
    /// # Errors
    /// If it cannot be read, or is none.
    pub(crate) fn read(folder: &Path) -> Result<Option<Self>, RunError> {
        let path = Self::path(folder);
        let fail = |source| RunError::File {
            path: path.clone(),
            source,
            next: "restore the file, or run `meniscus wedge` again with the same arguments",
        };
        let text = match cache::read_text_within(&path, MAX_BYTES) {
            Ok(text) => text,
            Err(absent) if matches!(absent.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(None);
            }
            Err(source) => return Err(fail(source)),
        };
        let invalid = |found: String| fail(Error::new(ErrorKind::InvalidData, found));
        let list = Self::parse(&text).map_err(invalid)?;
        if list.version != VERSION {
            let (path, found) = (path.clone(), list.version);
            return Err(CacheError::Version { path, found, expected: VERSION }.into());
        }
        Ok(Some(list))
    }

    /// The list that a text describes, of any version.
    ///
    /// # Errors
    /// What was found instead of a list.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let list: Self = serde_json::from_str(text).map_err(|why| why.to_string())?;
        if list.format != FORMAT {
            return Err(format!("found format {:?}, expected {FORMAT:?}", list.format));
        }
        list.check()?;
        Ok(list)
    }

    /// Whether the list can be written, read and drawn.
    ///
    /// # Errors
    /// What is wrong.
    pub(crate) fn check(&self) -> Result<(), String> {
        if self.wedges.is_empty() || self.wedges.len() > MAX_WEDGES {
            return Err(format!("found {} wedges, expected 1 to {MAX_WEDGES}", self.wedges.len()));
        }
        let texts = self.keys.iter().chain(self.wedges.iter().flat_map(|wedge| &wedge.values));
        if self.set.len() > MAX_SETTINGS || self.set.iter().any(|set| set.len() > MAX_SETTING) {
            return Err(format!(
                "found more than {MAX_SETTINGS} settings, or one of more than {MAX_SETTING} bytes"
            ));
        }
        let varied = self.set.iter().filter(|set| !set.contains('='));
        if !self.set.is_empty() && !varied.eq(&self.keys) {
            return Err("found settings that vary other than the keys".to_owned());
        }
        if let Some(text) = texts.map(|text| text.chars().count()).find(|count| *count > MAX_CHARACTERS) {
            return Err(format!(
                "found a key or value of {text} characters, expected at most {MAX_CHARACTERS}"
            ));
        }
        let mut folders = BTreeSet::new();
        for Wedge { folder, values } in &self.wedges {
            // A dash at the start would be an option of the commands that a farm runs.
            if !is_file_name(folder) || folder.starts_with('-') {
                return Err(format!(
                    "found the folder {folder:?}, expected a name in this folder that does not begin with a dash"
                ));
            }
            // Some file systems do not distinguish capitals from small letters.
            if !folders.insert(folder.to_ascii_lowercase()) {
                return Err(format!("found the folder {folder:?} twice"));
            }
            if values.len() != self.keys.len() {
                let (values, keys) = (values.len(), self.keys.len());
                return Err(format!("{folder}: found {values} values for {keys} keys"));
            }
        }
        Ok(())
    }

    /// The shot folders of the list in a folder.
    ///
    /// # Errors
    /// [`RunError::Request`] if one is a link that leads out.
    pub(crate) fn shots(&self, root: &Path) -> Result<Vec<ShotFolder>, RunError> {
        let shot = |wedge: &Wedge| {
            let path = root.join(&wedge.folder);
            if cache::leads_out(root, &path) {
                return Err(RunError::Request(format!(
                    "{}: found a link that leads out of the folder of the wedges, expected a folder in it; move the shot there",
                    printable_path(&path)
                )));
            }
            Ok(ShotFolder::new(path))
        };
        self.wedges.iter().map(shot).collect()
    }

    /// Replaces the list of a folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(self).expect("a list is plain data") + "\n";
        ShotFolder::write(Self::path(folder), &text)
    }

    /// The settings of a wedge, as `--set` takes them.
    pub(crate) fn settings(&self, wedge: &Wedge) -> Vec<String> {
        let mut varied = self.keys.iter().zip(&wedge.values).map(|(key, value)| format!("{key}={value}"));
        if self.set.is_empty() {
            return varied.collect();
        }
        let setting = |given: &String| match given.contains('=') {
            true => Some(given.clone()),
            false => varied.next(),
        };
        self.set.iter().filter_map(setting).collect()
    }

    /// The number of a wedge, and what distinguishes it: `wedge 2, liquid.cfl=0.4`.
    pub(crate) fn numbered(&self, place: usize) -> String {
        format!("wedge {}, {}", place + 1, self.label(&self.wedges[place]))
    }

    /// What distinguishes a wedge, in words: `liquid.cfl=0.4  liquid.spacing=0.05`.
    pub(crate) fn label(&self, wedge: &Wedge) -> String {
        let part = |(key, value): (&String, &String)| format!("{key}={value}");
        let parts: Vec<String> = self.keys.iter().zip(&wedge.values).map(part).collect();
        if parts.is_empty() { "as written".into() } else { parts.join("  ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_reads_as_written_and_crafted_ones_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(WedgeList::read(dir.path()).unwrap(), None);
        let wedge = Wedge { folder: "cfl-0p4".into(), values: vec!["0.4".into()] };
        let list = WedgeList::new("Dam", vec!["liquid.cfl".into()], vec![wedge.clone()]);
        list.write(dir.path()).unwrap();
        assert_eq!(WedgeList::read(dir.path()).unwrap(), Some(list.clone()));
        assert_eq!(list.label(&wedge), "liquid.cfl=0.4");
        let crafted = |text: &str| {
            std::fs::write(WedgeList::path(dir.path()), text).unwrap();
            WedgeList::read(dir.path()).unwrap_err().to_string()
        };
        let good = serde_json::to_string(&list).unwrap();
        assert!(crafted(&good.replace("cfl-0p4", "../evil")).contains("../evil"));
        assert!(crafted(&good.replace("meniscus-wedges", "x")).contains("expected"));
        assert!(crafted(&good.replace("\"version\":1", "\"version\":2")).contains('2'));
        assert!(crafted(&good.replace("[\"0.4\"]", "[]")).contains("0 values for 1 keys"));
        assert!(crafted("{").contains("wedges.json"));
        assert!(
            crafted(&good.replace("\"0.4\"", &format!("\"{}\"", "4".repeat(201)))).contains("201 characters")
        );
        assert!(crafted(&good.replace("cfl-0p4", "-cfl")).contains("a dash"));
        assert!(
            crafted(&good.replace("\"wedges\"", "\"set\":[\"a=1\"],\"wedges\""))
                .contains("other than the keys")
        );
        let wedge = "{\"folder\":\"cfl-0p4\",\"values\":[\"0.4\"]}";
        let twice = format!("{wedge},{}", wedge.replace("cfl", "CFL"));
        assert!(crafted(&good.replace(wedge, &twice)).contains("twice"));
        assert!(crafted(&good.replace("Dam", &"x".repeat(5 << 20))).contains("at most 4194304"));
    }
}
