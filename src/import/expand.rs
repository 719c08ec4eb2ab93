//! From the patterns of a command line to a sequence of files.

use super::ImportError;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// The files that `patterns` name, sorted by the numbers in their names, each once.
///
/// A pattern is a path, or a path whose file name holds `*` (any characters) or runs of `#` (a number of at
/// least as many digits): `frame_*.vtk`, `frame_####.bgeo`. A file that is really named so is taken as it is.
/// Hidden files match only a pattern that starts with a dot.
///
/// # Errors
/// [`ImportError::NotFound`] if a path is not there or a pattern matches nothing,
/// [`ImportError::Unsupported`] if a folder holds a wildcard.
pub fn expand(patterns: &[String]) -> Result<Vec<PathBuf>, ImportError> {
    let mut files = Vec::new();
    for pattern in patterns {
        let path = Path::new(pattern);
        if path.is_file() {
            files.push(path.to_path_buf());
        } else {
            files.extend(matching(path)?);
        }
    }
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b)));
    files.dedup();
    Ok(files)
}

/// The files that match a pattern in the last part of `path`.
fn matching(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let wild = |text: &str| text.contains(['*', '#']);
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let missing = |found: String, expected: String| {
        Err(ImportError::NotFound { path: path.to_path_buf(), found, expected })
    };
    if path.is_dir() {
        return missing("a folder".into(), format!("a file, for example {}", path.join("*.vtk").display()));
    }
    if wild(&folder.to_string_lossy()) && !folder.is_dir() {
        let found = format!("a wildcard in the folder {}", folder.display());
        return Err(ImportError::unsupported(path, found, "* and # in the file's name only"));
    }
    if !wild(&name) {
        return missing("nothing there".into(), "a file".into());
    }
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return missing(format!("no folder {}", folder.display()), "a folder with particle files".into());
        }
        entries => entries.map_err(|error| ImportError::from_io(folder, "list the folder", error))?,
    };
    let (mut files, mut seen) = (Vec::new(), 0);
    for entry in entries {
        let entry = entry.map_err(|error| ImportError::from_io(folder, "list the folder", error))?;
        let file = path.with_file_name(entry.file_name());
        if file.is_file() {
            seen += 1;
            if fits(&name, &entry.file_name().to_string_lossy()) {
                files.push(file);
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

/// Whether a file's name fits a pattern.
fn fits(pattern: &str, name: &str) -> bool {
    let hidden = name.starts_with('.') && !pattern.starts_with('.');
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    !hidden && fits_rest(&pattern, &name)
}

/// Row by row: `reach[i]` says whether the pattern so far can end before character i of the name. A search with
/// backtracking would take exponential time on `*a*a*a*`.
fn fits_rest(pattern: &[char], name: &[char]) -> bool {
    let mut reach = vec![false; name.len() + 1];
    reach[0] = true;
    let mut at = 0;
    while at < pattern.len() {
        let mut next = vec![false; name.len() + 1];
        let run = pattern[at..].iter().take_while(|&&character| character == '#').count();
        for start in (0..=name.len()).filter(|&start| reach[start]) {
            if pattern[at] == '*' {
                next[start..].fill(true);
            } else if run > 0 {
                let digits = name[start..].iter().take_while(|character| character.is_ascii_digit()).count();
                for length in run..=digits {
                    next[start + length] = true;
                }
            } else if name.get(start) == Some(&pattern[at]) {
                next[start + 1] = true;
            }
        }
        at += run.max(1);
        reach = next;
    }
    reach[name.len()]
}

/// Compares names with each run of digits as one number, however long.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    while !a.is_empty() && !b.is_empty() {
        let (first, second) = (piece(&mut a), piece(&mut b));
        let order = if is_number(first) && is_number(second) {
            let (first, second) = (first.trim_start_matches('0'), second.trim_start_matches('0'));
            first.len().cmp(&second.len()).then_with(|| first.cmp(second))
        } else {
            first.cmp(second)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

fn is_number(text: &str) -> bool {
    text.starts_with(|character: char| character.is_ascii_digit())
}

/// Cuts the longest run of digits, or of other characters, off the front.
fn piece<'a>(text: &mut &'a str) -> &'a str {
    let number = is_number(text);
    let end = text.find(|character: char| character.is_ascii_digit() != number).unwrap_or(text.len());
    let (front, rest) = text.split_at(end);
    *text = rest;
    front
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
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("frame_*.vtk", "frame_1.vtk.bak"),
            ("frame_####.bgeo", "frame_001.bgeo"),
            ("frame_#.bgeo", "frame_x.bgeo"),
            ("*", ".hidden"),
            ("a*b*c", "acb"),
            ("", "x"),
        ] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
        assert!(!fits(&"*a".repeat(40), &"a".repeat(39)), "and the answer comes at once");
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
            let files = expand(&patterns).unwrap();
            files
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
    fn what_was_looked_for_is_named() {
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
