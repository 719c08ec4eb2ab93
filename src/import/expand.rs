//! From the patterns of a command line to a sequence of files.

use super::{ImportError, Sequence, sequence::natural};
use crate::control::printable;
use std::path::{Component, Path, PathBuf};

/// Characters that make a name a pattern.
const WILD: [char; 4] = ['*', '#', '?', '['];

/// The files that `patterns` name, sorted by the numbers in their names, each once.
///
/// A pattern is a path, or a path whose file name has wildcards: `*` (any characters), `?` (any one), `[0-4x]` or `[!a-z]` (one of
/// these, or none of them), or runs of `#` (a number of at least as many digits). Examples: `frame_*.vtk`, `frame_####.bgeo`. An
/// existing file of exactly this name is taken as it is. Hidden files match only a pattern that starts with a dot. A single run
/// of `#` without any `*` marks the number of the frame.
///
/// # Errors
/// [`ImportError::NotFound`] if a path is not there or a pattern matches nothing,
/// [`ImportError::Unsupported`] if a folder holds a wildcard.
pub fn expand(patterns: &[String]) -> Result<Sequence, ImportError> {
    let mut found = Vec::new();
    for pattern in patterns {
        let path = Path::new(pattern);
        if path.is_file() {
            found.push((path.to_path_buf(), None));
        } else {
            found.extend(matching(path)?);
        }
    }
    Ok(Sequence::new(found))
}

/// Folders that a pattern may match, far above the shots of a show.
const MAX_FOLDERS: usize = 1 << 16;

/// The folders that match the pattern `whole`, any part of which may have wildcards, sorted by the numbers in their names.
///
/// # Errors
/// [`ImportError::NotFound`] if there are more than 65 536.
pub(crate) fn folders(whole: &str) -> Result<Vec<PathBuf>, ImportError> {
    let mut found = vec![PathBuf::new()];
    for part in Path::new(whole).components() {
        let name = part.as_os_str();
        let text = name.to_string_lossy();
        let is_pattern = matches!(part, Component::Normal(_)) && text.contains(WILD);
        let pattern = Pattern::new(&text);
        let mut deeper = Vec::new();
        for folder in found {
            let own = folder.join(name);
            if !is_pattern || own.is_dir() {
                deeper.push(own);
                continue;
            }
            let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
            // A folder that cannot be listed has none for this user.
            for entry in std::fs::read_dir(listed).into_iter().flatten().flatten() {
                let inner = folder.join(entry.file_name());
                if pattern.fits(&entry.file_name().to_string_lossy()) && inner.is_dir() {
                    deeper.push(inner);
                }
            }
            if deeper.len() > MAX_FOLDERS {
                return Err(ImportError::NotFound {
                    path: whole.into(),
                    found: format!("more than {MAX_FOLDERS} folders"),
                    expected: "a pattern of fewer folders".into(),
                });
            }
        }
        found = deeper;
    }
    found.retain(|folder| folder.is_dir());
    found.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b)));
    Ok(found)
}

/// The files that match a pattern in the last part of `path`, each with the number that it marks.
fn matching(path: &Path) -> Result<Vec<(PathBuf, Option<u32>)>, ImportError> {
    let wild = |text: &str| text.contains(WILD);
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let missing = |found: String, expected: String| {
        let [found, expected] = [found, expected].map(|text| printable(&text).into_owned());
        Err(ImportError::NotFound { path: path.to_path_buf(), found, expected })
    };
    if path.is_dir() {
        return missing("a folder".into(), format!("a file, for example {}", path.join("*.vtk").display()));
    }
    if wild(&folder.to_string_lossy()) && !folder.is_dir() {
        let found = format!("a wildcard in the folder {}", folder.display());
        return Err(ImportError::unsupported(path, found, "* # ? and [ in the file's name only"));
    }
    if !wild(&name) {
        let found = if path.exists() { "a pipe or a device" } else { "nothing there" };
        return missing(found.into(), "a file".into());
    }
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return missing(format!("no folder {}", folder.display()), "a folder with particle files".into());
        }
        entries => entries.map_err(|error| ImportError::from_io(folder, "list the folder", error))?,
    };
    let (pattern, mut files, mut seen) = (Pattern::new(&name), Vec::new(), 0);
    for entry in entries {
        let entry = entry.map_err(|error| ImportError::from_io(folder, "list the folder", error))?;
        let file = path.with_file_name(entry.file_name());
        if file.is_file() {
            seen += 1;
            let name = entry.file_name().to_string_lossy().into_owned();
            if pattern.fits(&name) {
                files.push((file, pattern.number(&name)));
            }
        }
    }
    if files.is_empty() {
        return missing(
            format!("none of the {seen} files in {}", folder.display()),
            format!("files named like {name}"),
        );
    }
    Ok(files)
}

/// A part of a pattern.
#[derive(Clone, Debug, PartialEq)]
enum Token {
    /// This character.
    Char(char),
    /// Any one character.
    One,
    /// A character inside of one of the ranges, or outside of all.
    Of { ranges: Vec<(char, char)>, outside: bool },
    /// At least so many digits.
    Digits(usize),
    /// Any characters.
    Any,
}

/// What names of files look like.
struct Pattern {
    parts: Vec<Token>,
    with_hidden: bool,
}

impl Pattern {
    fn new(text: &str) -> Self {
        let characters: Vec<char> = text.chars().collect();
        let (mut parts, mut at) = (Vec::new(), 0);
        while at < characters.len() {
            let rest = &characters[at..];
            let (part, length) = match rest[0] {
                '*' => (Token::Any, 1),
                '?' => (Token::One, 1),
                '#' => {
                    let run = rest.iter().take_while(|&&character| character == '#').count();
                    (Token::Digits(run), run)
                }
                '[' => set(rest).unwrap_or((Token::Char('['), 1)),
                other => (Token::Char(other), 1),
            };
            parts.push(part);
            at += length;
        }
        Self { parts, with_hidden: text.starts_with('.') }
    }

    /// Whether a file's name fits.
    ///
    /// Token by token: `reach[i]` holds whether the pattern so far can end before character i of the name. A search with backtracking
    /// would take exponential time on `*a*a*a*`.
    fn fits(&self, name: &str) -> bool {
        if name.starts_with('.') && !self.with_hidden {
            return false;
        }
        let name: Vec<char> = name.chars().collect();
        let mut reach = vec![false; name.len() + 1];
        reach[0] = true;
        for part in &self.parts {
            let mut next = vec![false; name.len() + 1];
            for start in (0..=name.len()).filter(|&start| reach[start]) {
                let rest = &name[start..];
                match part {
                    Token::Any => next[start..].fill(true),
                    Token::Digits(least) => {
                        let digits = rest.iter().take_while(|character| character.is_ascii_digit()).count();
                        (*least..=digits).for_each(|length| next[start + length] = true);
                    }
                    one => {
                        if rest.first().is_some_and(|&character| one.takes(character)) {
                            next[start + 1] = true;
                        }
                    }
                }
            }
            reach = next;
        }
        reach[name.len()]
    }

    /// What the one run of `#` stands for in a name that fits; `None` if that is not certain.
    fn number(&self, name: &str) -> Option<u32> {
        let mut places = (0..self.parts.len()).filter(|&place| matches!(self.parts[place], Token::Digits(_)));
        let (Some(place), None) = (places.next(), places.next()) else { return None };
        if self.parts.contains(&Token::Any) {
            return None;
        }
        // All other parts are one character each.
        let behind = self.parts.len() - 1 - place;
        let digits: String = name.chars().take(name.chars().count() - behind).skip(place).collect();
        digits.parse().ok()
    }
}

impl Token {
    /// Whether a part of one character is this one.
    fn takes(&self, character: char) -> bool {
        match self {
            Self::Char(own) => *own == character,
            Self::Of { ranges, outside } => {
                ranges.iter().any(|&(first, last)| (first..=last).contains(&character)) != *outside
            }
            Self::One | Self::Any | Self::Digits(_) => true,
        }
    }
}

/// The set at the front of `text`, which starts with `[`, and its length; `None` if it has no end.
fn set(text: &[char]) -> Option<(Token, usize)> {
    let outside = matches!(text.get(1), Some('!' | '^'));
    let first = if outside { 2 } else { 1 };
    // A bracket right at the start is one of the characters.
    let length = text.iter().skip(first + 1).position(|&character| character == ']')? + 1;
    let mut inside = &text[first..first + length];
    let mut ranges = Vec::new();
    while let [from, rest @ ..] = inside {
        let (range, rest) = match rest {
            ['-', to, rest @ ..] => ((*from, *to), rest),
            _ => ((*from, *from), rest),
        };
        ranges.push(range);
        inside = rest;
    }
    Some((Token::Of { ranges, outside }, first + length + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_fit_names() {
        for (pattern, name) in [
            ("frame_*.vtk", "frame_1.vtk"),
            ("frame_####.bgeo", "frame_0001.bgeo"),
            ("frame_####.bgeo", "frame_12345.bgeo"),
            ("*", "anything"),
            ("a*b*c", "axxbyybzzc"),
            ("#_#", "12_7"),
            ("*#.ply", "x10.ply"),
            (".*", ".hidden"),
            ("f_?.vtk", "f_x.vtk"),
            ("f_[0-4x].vtk", "f_3.vtk"),
            ("f_[0-4x].vtk", "f_x.vtk"),
            ("f_[!0-4].vtk", "f_5.vtk"),
            ("f_[]-].vtk", "f_].vtk"),
            ("f_[]-].vtk", "f_-.vtk"),
            ("f_[1.vtk", "f_[1.vtk"),
        ] {
            assert!(Pattern::new(pattern).fits(name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("frame_*.vtk", "frame_1.vtk.bak"),
            ("frame_####.bgeo", "frame_001.bgeo"),
            ("frame_#.bgeo", "frame_x.bgeo"),
            ("*", ".hidden"),
            ("a*b*c", "acb"),
            ("", "x"),
            ("f_?.vtk", "f_.vtk"),
            ("f_[0-4x].vtk", "f_5.vtk"),
            ("f_[!0-4].vtk", "f_4.vtk"),
        ] {
            assert!(!Pattern::new(pattern).fits(name), "{pattern} {name}");
        }
        assert!(!Pattern::new(&"*a".repeat(40)).fits(&"a".repeat(39)), "and the answer comes at once");
    }

    #[test]
    fn hashes_mark_the_number_of_the_frame() {
        let number = |pattern: &str, name: &str| {
            let pattern = Pattern::new(pattern);
            assert!(pattern.fits(name));
            pattern.number(name)
        };
        assert_eq!(number("v2_frame_####.bgeo", "v2_frame_0017.bgeo"), Some(17));
        assert_eq!(number("#.vtk", "12345.vtk"), Some(12345));
        assert_eq!(number("é_?_##_[ab].vtk", "é_1_07_b.vtk"), Some(7));
        assert_eq!(number("*_##.vtk", "a_07.vtk"), None, "which digits are meant is not certain");
        assert_eq!(number("##_##.vtk", "01_07.vtk"), None);
        assert_eq!(number("#.vtk", "99999999999.vtk"), None);
        assert_eq!(number("f_7.vtk", "f_7.vtk"), None);
    }

    #[test]
    fn a_sequence_is_sorted_by_number_and_each_file_comes_once() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["f_10.vtk", "f_9.vtk", "f_100.vtk", "f_08.vtk", "g_1.vtk", "f_9.ply", ".f_1.vtk"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        std::fs::create_dir(dir.path().join("f_7.vtk")).unwrap();
        let pattern = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let names = |patterns: &[&str]| {
            let patterns: Vec<_> = patterns.iter().map(|name| pattern(name)).collect();
            let sequence = expand(&patterns).unwrap();
            sequence
                .files()
                .iter()
                .map(|file| file.file_name().unwrap().to_str().unwrap().to_owned())
                .collect::<Vec<_>>()
        };
        assert_eq!(names(&["f_*.vtk"]), ["f_08.vtk", "f_9.vtk", "f_10.vtk", "f_100.vtk"]);
        assert_eq!(
            names(&["f_##.vtk", "f_10.vtk", "g_1.vtk"]),
            ["f_08.vtk", "f_10.vtk", "f_100.vtk", "g_1.vtk"]
        );
        assert!(names(&[]).is_empty());
    }

    #[test]
    fn patterns_of_folders_may_have_wildcards_anywhere() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a/w_10", "a/w_9/deep", "b/w_9", "b/x", ".c/w_9", "odd[1]/w_1", "odd1/w_2"] {
            std::fs::create_dir_all(dir.path().join(name)).unwrap();
        }
        std::fs::write(dir.path().join("a/w_8"), "").unwrap();
        let found = |pattern: &str| -> Vec<String> {
            let found = folders(dir.path().join(pattern).to_str().unwrap()).unwrap();
            let inside =
                |path: &PathBuf| path.strip_prefix(dir.path()).unwrap().to_string_lossy().into_owned();
            found.iter().map(inside).collect()
        };
        assert_eq!(found("a/w_*"), ["a/w_9", "a/w_10"]);
        assert_eq!(found("?/w_#"), ["a/w_9", "a/w_10", "b/w_9"]);
        assert_eq!(found("*/*/d*"), ["a/w_9/deep"]);
        assert_eq!(found("b/x"), ["b/x"]);
        assert_eq!(found("odd[1]/*"), ["odd[1]/w_1"], "a folder of exactly this name is taken as it is");
        assert!(found("a/y_*").is_empty() && found("none/*").is_empty() && found("a/w_8").is_empty());
    }

    #[test]
    fn the_pattern_searched_for_is_named() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.ply"), "").unwrap();
        let message = |name: &str| {
            let pattern = dir.path().join(name).to_str().unwrap().to_owned();
            expand(&[pattern]).unwrap_err().to_string()
        };
        assert!(message("frame_####.bgeo").contains("none of the 1 files"), "{}", message("frame_####.bgeo"));
        assert!(message("frame_####.bgeo").contains("named like frame_####.bgeo"));
        assert!(message("b.ply").contains("b.ply: nothing there"));
        assert!(message("missing/*.ply").contains("no folder"));
        assert!(message("*/a.ply").contains("a wildcard in the folder"));
        assert!(message("").contains("a folder"));
    }
}
