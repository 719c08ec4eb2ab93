//! The job that turns other solvers' particle files into meshes.

use super::{Control, Failure, RunError, ShotFolder, Surfaced, surface::Writer};
use crate::{
    export::MeshFormat,
    frame::FrameIndex,
    import::{self, ImportError},
    mesh::SurfaceParams,
};
use std::path::{Path, PathBuf};

/// How particle files are meshed.
#[derive(Clone, Debug)]
pub struct FileSettings {
    /// Distance between particles at rest [m]; the files do not say.
    pub spacing: f32,
    /// How particles become a surface.
    pub params: SurfaceParams,
    /// Frames a second of the sequence.
    pub fps: f64,
}

/// Meshes every file of `files` into `out`, in every format.
///
/// Files of a sequence keep their numbers: the one number in their names that differs. Files are always meshed anew.
///
/// # Errors
/// A file without particles gives an empty mesh: a sequence may start before its liquid does. If it is the only
/// file, that is [`ImportError::NoParticles`].
///
/// A file that cannot be read is left out and named at the end ([`RunError::SomeFailed`]), or is the job's error
/// if it is the only one; a folder or disk that refuses to be written ends the job at once.
pub fn surface_files(
    files: &[PathBuf],
    out: &ShotFolder,
    settings: &FileSettings,
    formats: &[MeshFormat],
    control: Control,
) -> Result<Surfaced, RunError> {
    let numbers = numbers(files);
    let mut writer = Writer::new(out, &settings.params, formats, true)?;
    let outcome = surface_each(files, &numbers, settings.spacing, &mut writer, control);
    let title = files.first().map_or_else(String::new, |file| stem(file).to_owned());
    writer.finish(&title, settings.fps, &numbers, outcome)
}

/// Meshes one file after the other.
fn surface_each(
    files: &[PathBuf],
    numbers: &[u32],
    spacing: f32,
    writer: &mut Writer,
    control: Control,
) -> Result<(), RunError> {
    control.reporter.begin("mesh", files.len());
    for (place, (file, &number)) in files.iter().zip(numbers).enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        match import::read_particles(file) {
            Ok(imported) if imported.stream.is_empty() && files.len() == 1 => {
                return Err(ImportError::NoParticles { path: file.clone() }.into());
            }
            Ok(imported) => {
                if imported.stream.is_empty() {
                    control.reporter.note(&format!("{}: no particles, so its mesh is empty", file.display()));
                }
                for line in &imported.ignored {
                    control.reporter.note(&format!("{}: {line}", file.display()));
                }
                writer.mesh(&imported.stream, spacing, FrameIndex(number), 0, control)?;
            }
            Err(why) if files.len() == 1 => return Err(why.into()),
            Err(why) => {
                writer.fail(file.display().to_string(), why.to_string(), Failure::Other);
            }
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// The frame number of every file: the one number in the names that differs from file to file, if there is one
/// and no two files share it; otherwise 1, 2, 3, …
pub(super) fn numbers(files: &[PathBuf]) -> Vec<u32> {
    let in_order = || (1..=files.len() as u32).collect();
    let runs: Vec<Vec<&str>> = files.iter().map(|file| digit_runs(stem(file))).collect();
    let Some(first) = runs.first() else { return Vec::new() };
    if files.len() == 1 || runs.iter().any(|run| run.len() != first.len()) {
        return in_order();
    }
    let differing: Vec<usize> =
        (0..first.len()).filter(|&place| runs.iter().any(|run| run[place] != first[place])).collect();
    let [place] = differing[..] else { return in_order() };
    let numbers: Option<Vec<u32>> = runs.iter().map(|run| run[place].parse().ok()).collect();
    match numbers {
        Some(numbers) if numbers.windows(2).all(|pair| pair[0] < pair[1]) => numbers,
        _ => in_order(),
    }
}

pub(super) fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("")
}

fn digit_runs(text: &str) -> Vec<&str> {
    text.split(|c: char| !c.is_ascii_digit()).filter(|run| !run.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_keep_the_one_number_that_differs() {
        let of = |names: &[&str]| numbers(&names.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["a/frame_0007.vtk", "a/frame_0009.vtk"]), [7, 9]);
        assert_eq!(of(&["dam2_3_p500.vtk", "dam2_4_p500.vtk"]), [3, 4]);
        assert_eq!(of(&["frame_23_24389_particles.bgeo"]), [1]);
        assert_eq!(of(&["f_1_10.vtk", "f_2_20.vtk"]), [1, 2]);
        assert_eq!(of(&["left.vtk", "right.vtk"]), [1, 2]);
        assert_eq!(of(&["f_1.vtk", "f_01.vtk"]), [1, 2]);
        assert_eq!(of(&[]), [0; 0]);
    }
}
