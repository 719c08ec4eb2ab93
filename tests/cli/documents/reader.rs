//! An empty folder with a shell, in which documents are followed.

use super::super::*;

/// A folder in which the program is on the path, and what its users would have there.
pub(super) struct Reader {
    desk: Desk,
}

impl Reader {
    /// An empty folder, but for the programs in `.bin/`.
    pub(super) fn new() -> Self {
        let desk = Desk::new();
        fs::remove_file(desk.path("small.toml")).unwrap();
        fs::create_dir(desk.path(".bin")).unwrap();
        Self { desk }
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.desk.path(name)
    }

    /// Writes a file, and the folders above it.
    pub(super) fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        self.desk.write(name, text);
    }

    /// Adds a program to the path, a script of the shell.
    pub(super) fn add_program(&self, name: &str, script: &str) {
        use std::os::unix::fs::PermissionsExt;
        let path = self.path(".bin").join(name);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Runs lines of the shell, and returns the exit code and what was printed: results, then messages.
    pub(super) fn shell(&self, lines: &str) -> (i32, String) {
        let program = assert_cmd::cargo::cargo_bin("meniscus");
        let mut path = vec![self.path(".bin"), program.parent().unwrap().to_owned()];
        path.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap()));
        let output = std::process::Command::new("sh")
            .args(["-ec", &format!("{lines}\nwait")])
            .current_dir(self.path("."))
            .env("PATH", std::env::join_paths(path).unwrap())
            .env("HOME", self.path("."))
            .output()
            .unwrap();
        let [out, messages] =
            [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
        (output.status.code().unwrap_or(-1), out + &messages)
    }

    /// Runs lines of the shell, which are to end with an exit code.
    pub(super) fn expect(&self, place: &str, lines: &str, code: i32) -> String {
        let (found, printed) = self.shell(lines);
        assert_eq!(found, code, "{place}: {lines}\n{printed}");
        printed
    }
}
