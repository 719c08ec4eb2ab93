//! The folder in which shots are made: space, speed, locks.

use super::problem::{Problem, sized};
use crate::cache::{CacheError, Lock, write_atomically};
use serde::Serialize;
use std::{
    fs, io,
    path::{Path, PathBuf},
    time::Instant,
};

/// What a folder can do.
#[derive(Debug, Serialize)]
pub(super) struct Folder {
    path: PathBuf,
    /// Space that this user may fill \[bytes\]; absent where the system does not report it.
    free: Option<u64>,
    /// Speed of a large file, until it is on the disk \[bytes/s\]; absent if it could not be written.
    write_speed: Option<f64>,
    /// Time until a small file is on the disk, median of five \[s\].
    small_file: Option<f64>,
    /// Whether one process can keep others out of a folder.
    has_locks: Option<bool>,
}

/// Size of the large file \[bytes\]: a second on a disk of 64 MiB/s.
const LARGE: usize = 64 << 20;

/// Fewer than this, and a shot of 96 frames of 100 000 particles does not fit.
const LITTLE_SPACE: u64 = 4 << 30;

/// Frames of 100 000 particles take longer to write than to mesh below this speed \[bytes/s\].
const SLOW: f64 = 30e6;

/// Seconds for a small file above which `shot.json` and the log delay every frame.
const LATE: f64 = 0.1;

impl Folder {
    /// Writes, locks and removes files in a folder of its own below `path`.
    pub(super) fn examine(path: &Path, problems: &mut Vec<Problem>) -> Self {
        let mut found = Self {
            path: path.into(),
            free: free(path),
            write_speed: None,
            small_file: None,
            has_locks: None,
        };
        if let Err(why) = found.try_out() {
            problems.push(Problem::stops(
                format!("files cannot be written: {why}"),
                "name a folder that exists and can be written, `meniscus doctor DIR`, or raise what limits it",
            ));
        }
        found.judge(problems);
        found
    }

    fn try_out(&mut self) -> io::Result<()> {
        let probe = Probe::new(&self.path)?;
        let bytes: Vec<u8> = (0..LARGE).map(|at| (at.wrapping_mul(0x9e37_79b1) >> 13) as u8).collect();
        let start = Instant::now();
        write_atomically(&probe.0.join("large"), |out| out.write_all(&bytes))?;
        self.write_speed = Some(LARGE as f64 / start.elapsed().as_secs_f64());
        let mut times = [0.0; 5];
        for time in &mut times {
            let start = Instant::now();
            write_atomically(&probe.0.join("small"), |out| out.write_all(&bytes[..4096]))?;
            *time = start.elapsed().as_secs_f64();
        }
        times.sort_by(f64::total_cmp);
        self.small_file = Some(times[2]);
        let first = Lock::acquire(&probe.0).map_err(io::Error::other)?;
        let second = Lock::acquire(&probe.0);
        self.has_locks = Some(first.is_held() && matches!(second, Err(CacheError::Locked { .. })));
        Ok(())
    }

    fn judge(&self, problems: &mut Vec<Problem>) {
        if let Some(free) = self.free.filter(|&free| free < LITTLE_SPACE) {
            problems.push(Problem::slows(
                format!("{} are free in {}", sized(free), self.path.display()),
                "`meniscus plan PRESET` reports what a shot needs",
            ));
        }
        if let Some(speed) = self.write_speed.filter(|&speed| speed < SLOW) {
            problems.push(Problem::slows(
                format!("the disk writes {:.0} MB/s", speed / 1e6),
                "use a local disk for caches; several threads do not help",
            ));
        }
        if let Some(seconds) = self.small_file.filter(|&seconds| seconds > LATE) {
            problems.push(Problem::slows(
                format!("a small file takes {:.0} ms to reach the disk", seconds * 1e3),
                "use a local disk for caches",
            ));
        }
        if self.has_locks == Some(false) {
            problems.push(Problem::slows(
                "the file system has no locks",
                "shots are made all the same, but never let two processes write one folder",
            ));
        }
    }

    pub(super) fn lines(&self) -> Vec<String> {
        let free = self.free.map_or_else(|| "unknown space".into(), sized);
        let speed =
            self.write_speed.map_or_else(|| "not written".into(), |speed| format!("{:.0} MB/s", speed / 1e6));
        let small = self
            .small_file
            .map_or_else(String::new, |time| format!(", a small file in {:.1} ms", time * 1e3));
        let locks = match self.has_locks {
            Some(true) => ", locks",
            Some(false) => ", no locks",
            None => "",
        };
        vec![
            format!("folder     {}", self.path.display()),
            format!("disk       {free} free; writes {speed}{small}{locks}"),
        ]
    }
}

/// A folder of this process, removed on drop.
struct Probe(PathBuf);

impl Probe {
    fn new(parent: &Path) -> io::Result<Self> {
        let path = parent.join(format!(".meniscus-doctor-{}", std::process::id()));
        fs::create_dir(&path)?;
        Ok(Self(path))
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        // What is left is named after this command; there is no one to report it to.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Free space \[bytes\].
#[cfg(unix)]
fn free(path: &Path) -> Option<u64> {
    let facts = rustix::fs::statvfs(path).ok()?;
    facts.f_bavail.checked_mul(facts.f_frsize)
}

/// Free space \[bytes\].
#[cfg(not(unix))]
fn free(_: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_left_as_it_was_and_its_faults_are_problems() {
        let place = tempfile::tempdir().unwrap();
        let mut problems = Vec::new();
        let found = Folder::examine(place.path(), &mut problems);
        assert!(found.write_speed.unwrap() > 0.0 && found.small_file.unwrap() > 0.0);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
        assert!(problems.iter().all(|problem| !problem.stops), "{problems:?}");

        problems.clear();
        let absent = Folder::examine(&place.path().join("absent"), &mut problems);
        assert!(problems[0].stops && problems[0].what.contains("cannot be written"), "{problems:?}");
        assert!(absent.lines()[1].contains("not written"));

        let bad = Folder {
            path: "a".into(),
            free: Some(1 << 20),
            write_speed: Some(1e6),
            small_file: Some(1.0),
            has_locks: Some(false),
        };
        problems.clear();
        bad.judge(&mut problems);
        let all: Vec<&str> = problems.iter().map(|problem| problem.what.as_str()).collect();
        let expected = [
            "1.0 MiB are free in a",
            "the disk writes 1 MB/s",
            "a small file takes 1000 ms to reach the disk",
            "the file system has no locks",
        ];
        assert_eq!(all, expected);
    }
}
