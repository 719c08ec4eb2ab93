//! The tool as its users meet it: commands in, files, streams and exit codes out.

mod attributes;
mod bad_input;
mod batch;
mod bodies;
mod branch;
mod colliders;
mod couplings;
mod deforming;
#[cfg(unix)]
mod documents;
mod farm;
mod forces;
mod inflow;
// Windows has no signals that a test could send.
#[cfg(unix)]
mod interrupt;
mod manners;
mod meshing;
mod plan;
mod preview;
mod resume;
mod sheet_scenes;
mod sheet_tradeoff;
mod sheets;
mod shot;
mod smoke;
mod smoke_again;
mod smoke_faults;
mod smoke_tradeoff;
mod solids;
mod surface_extremes;
mod surface_tradeoff;
mod surfacing;
mod tradeoff;
mod trust;
mod untrusted;
mod usd;
mod volumes;
mod wedge;
mod whitewater;

use assert_cmd::Command;
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// A shot small enough to run many times: 512 particles that splash into a tank.
const SMALL: &str = r#"
title = "Small dam"
frames = "1-5"

[[world.collider]]
shape = { tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] } }

[liquid]
spacing = 0.1
iterations = 6
[liquid.xsph]
[liquid.vorticity]
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = [0.8, 0.8, 0.8] } }

[output]
mesh = ["ply"]
"#;

/// Whether the long studies run too (`tools/soak/run`): otherwise shots that take long are drafts.
fn is_soak() -> bool {
    std::env::var_os("MENISCUS_SOAK").is_some()
}

/// An empty folder with the small preset in it.
struct Desk {
    folder: TempDir,
}

impl Desk {
    fn new() -> Self {
        let desk = Self { folder: tempfile::tempdir().unwrap() };
        desk.write("small.toml", SMALL);
        desk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path(name), text).unwrap();
    }

    /// The tool, about to run in the folder.
    fn tool(&self, line: &str) -> Command {
        let mut command = Command::cargo_bin("meniscus").unwrap();
        command.current_dir(self.folder.path()).args(line.split_whitespace());
        command
    }

    /// Runs the tool, expects `code`, and returns (stdout, stderr).
    fn run(&self, line: &str, code: i32) -> (String, String) {
        let output = self.tool(line).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, talk) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "meniscus {line}\n{out}\n{talk}");
        (out, talk)
    }

    /// The bytes of every file in a folder, by name.
    fn bytes(&self, folder: &str) -> Vec<(String, Vec<u8>)> {
        let mut files: Vec<_> = fs::read_dir(self.path(folder))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| !name(path).starts_with('.'))
            .map(|path| (name(&path), fs::read(&path).unwrap()))
            .collect();
        files.sort();
        files
    }

    fn names(&self, folder: &str) -> Vec<String> {
        self.bytes(folder).into_iter().map(|(name, _)| name).collect()
    }
}

/// A path as messages have it: with the system's separators.
fn shown(path: &str) -> String {
    path.replace('/', std::path::MAIN_SEPARATOR_STR)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}
