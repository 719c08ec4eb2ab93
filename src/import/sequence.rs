//! Files of a sequence and the numbers of their frames.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Files in the order of their frames.
///
/// Invariant: one number a file, and the numbers ascend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sequence {
    files: Vec<PathBuf>,
    numbers: Vec<u32>,
}

impl Sequence {
    /// Sorts files by the numbers in their names, each once, and numbers them.
    ///
    /// The number of a frame is that in place of the pattern's `#`, which comes with each file. Without it, it is the one number in the
    /// names that differs from file to file. Where two files would share a number, all are numbered 1, 2, 3, ….
    pub(super) fn new(mut found: Vec<(PathBuf, Option<u32>)>) -> Self {
        found.sort_by(|(a, _), (b, _)| {
            natural(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b))
        });
        found.dedup_by(|(later, number), (earlier, kept)| {
            let same = later == earlier;
            if same {
                *kept = kept.or(*number);
            }
            same
        });
        let (files, marked): (Vec<PathBuf>, Vec<Option<u32>>) = found.into_iter().unzip();
        let ascend = |numbers: &Vec<u32>| numbers.is_sorted_by(|a, b| a < b);
        let marked: Option<Vec<u32>> = marked.into_iter().collect();
        let numbers = marked
            .filter(ascend)
            .or_else(|| differing(&files).filter(ascend))
            .unwrap_or_else(|| (1..=files.len() as u32).collect());
        Self { files, numbers }
    }

    /// The files.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// The number of each file's frame.
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }
}

/// The one number in the names that differs from file to file, if there is one.
fn differing(files: &[PathBuf]) -> Option<Vec<u32>> {
    let runs: Vec<Vec<&str>> = files.iter().map(|file| digit_runs(stem(file))).collect();
    let first = runs.first()?;
    if runs.iter().any(|run| run.len() != first.len()) {
        return None;
    }
    let mut places = (0..first.len()).filter(|&place| runs.iter().any(|run| run[place] != first[place]));
    let (Some(place), None) = (places.next(), places.next()) else { return None };
    runs.iter().map(|run| run[place].parse().ok()).collect()
}

fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("")
}

fn digit_runs(text: &str) -> Vec<&str> {
    text.split(|c: char| !c.is_ascii_digit()).filter(|run| !run.is_empty()).collect()
}

/// Compares names with each run of digits as one number, however long.
pub(super) fn natural(a: &str, b: &str) -> Ordering {
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
    fn files_keep_the_one_number_that_differs() {
        let of = |names: &[&str]| {
            Sequence::new(names.iter().map(|name| (PathBuf::from(name), None)).collect()).numbers
        };
        assert_eq!(of(&["a/frame_0007.vtk", "a/frame_0009.vtk"]), [7, 9]);
        assert_eq!(of(&["dam2_3_p500.vtk", "dam2_4_p500.vtk"]), [3, 4]);
        assert_eq!(of(&["frame_23_24389_particles.bgeo"]), [1]);
        assert_eq!(of(&["f_1_10.vtk", "f_2_20.vtk"]), [1, 2]);
        assert_eq!(of(&["left.vtk", "right.vtk"]), [1, 2]);
        assert_eq!(of(&["f_1.vtk", "f_01.vtk"]), [1, 2]);
        assert_eq!(of(&[]), [0; 0]);
    }

    #[test]
    fn the_digits_that_a_pattern_marks_are_the_number() {
        let of = |found: &[(&str, Option<u32>)]| {
            Sequence::new(found.iter().map(|&(name, number)| (name.into(), number)).collect())
        };
        assert_eq!(of(&[("f_0007.vtk", Some(7))]).numbers, [7]);
        assert_eq!(of(&[("f_2_10.vtk", Some(10)), ("f_1_9.vtk", Some(9))]).numbers, [9, 10]);
        let twice = of(&[("f_2.vtk", None), ("f_7.vtk", Some(7)), ("f_2.vtk", Some(2))]);
        assert_eq!((twice.files.len(), twice.numbers), (2, vec![2, 7]));
        assert_eq!(of(&[("a_7.vtk", Some(7)), ("b_7.vtk", Some(7))]).numbers, [1, 2]);
    }
}
