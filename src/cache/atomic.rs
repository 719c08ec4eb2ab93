//! Files that are there whole or not at all.
//!
//! Bytes go to a temporary name in the same folder, are synced to the disk, and only then take the final name;
//! a reader therefore sees the old file or the new one, never a part. A run that is killed leaves at most a
//! temporary behind, which [`remove_temporaries`] deletes.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::par;
use xxhash_rust::xxh3::Xxh3;

/// How every temporary ends; nothing else in a folder of ours does.
const SUFFIX: &str = ".meniscus-tmp";

/// Bytes gathered before each write to the system. At 8 KiB (the default of the standard library) small writes
/// of a text mesh cost a system call each 200 vertices. Not tuned beyond that.
const BUFFER: usize = 1 << 20;

/// Bytes that are sent to the disk at a time. A million particles' mesh of 190 MB is written 0.06 s sooner so, on two threads of
/// 1.3 s. Fewer, and the file system's own book-keeping is written again and again; more, and more is left for the end.
const SYNCED: usize = 16 << 20;

/// A file that was written whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct WrittenFile {
    /// Size of the file \[bytes\].
    pub bytes: u64,
    /// xxh3-64 of the bytes.
    pub checksum: u64,
}

/// Writes the file `path` through `write`, whole or not at all.
///
/// The folder must exist. The temporary is named `.NAME.PID-N.meniscus-tmp`; it is removed if anything fails,
/// and an older file at `path` then stays as it was.
///
/// # Errors
/// Whatever `write` or the system reports; a full disk is [`io::ErrorKind::StorageFull`].
pub(crate) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> io::Result<WrittenFile> {
    prepare(path, write)?.commit()
}

/// A file whose bytes are on the disk, under a temporary name. It is removed on drop unless it was committed.
pub(crate) struct PreparedFile {
    temporary: Temporary,
    path: PathBuf,
    written: WrittenFile,
}

/// Writes the file `path` through `write` under a temporary name. What has to be recorded of it before it is there is recorded
/// between this and [`PreparedFile::commit`].
///
/// # Errors
/// As [`write_atomically`].
pub(crate) fn prepare(
    path: &Path,
    write: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> io::Result<PreparedFile> {
    let (file, temporary) = create_temporary(path)?;
    let mut hash = Xxh3::new();
    let (written, synced) = par::aside(
        || file.sync_data(),
        |sync| {
            let early = Early { out: &file, sync, unsynced: 0, hash: &mut hash };
            let mut writer = BufWriter::with_capacity(BUFFER, early);
            write(&mut writer)?;
            writer.flush()
        },
    );
    // The system reports a failure once: at the end it would be lost.
    written.and(synced)?;
    file.sync_all()?;
    let written = WrittenFile { bytes: file.metadata()?.len(), checksum: hash.digest() };
    Ok(PreparedFile { temporary, path: path.into(), written })
}

impl PreparedFile {
    /// What was written.
    pub(crate) fn written(&self) -> WrittenFile {
        self.written
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// Whatever the system reports.
    pub(crate) fn commit(self) -> io::Result<WrittenFile> {
        self.temporary.rename(&self.path)?;
        sync_folder(folder_of(&self.path))?;
        Ok(self.written)
    }
}

/// A file whose bytes are sent to the disk while more are written: else the disk stands still until the end, and all threads wait
/// for it then.
struct Early<'a, W> {
    out: W,
    /// Called when there is enough to send.
    sync: &'a mut (dyn FnMut() + Send),
    unsynced: usize,
    /// Of all bytes so far.
    hash: &'a mut Xxh3,
}

impl<W: Write> Write for Early<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.hash.update(&bytes[..count]);
        self.unsynced += count;
        if self.unsynced >= SYNCED {
            self.unsynced = 0;
            (self.sync)();
        }
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Removes the temporaries that crashed runs left in `dir` and returns their paths, sorted.
///
/// It cannot distinguish a crashed run from a live one, since process numbers repeat between machines and containers. So
/// the caller holds the folder's [`Lock`](super::Lock), or knows otherwise that no process writes there.
///
/// # Errors
/// If the folder cannot be listed or a temporary cannot be removed.
pub(crate) fn remove_temporaries(dir: &Path) -> io::Result<Vec<PathBuf>> {
    let mut removed = Vec::new();
    for entry in fs::read_dir(dir)? {
        let entry = entry?;
        let name = entry.file_name();
        let ours = name.to_str().is_some_and(|name| name.starts_with('.') && name.ends_with(SUFFIX));
        if ours && entry.file_type()?.is_file() {
            fs::remove_file(entry.path())?;
            removed.push(entry.path());
        }
    }
    removed.sort();
    Ok(removed)
}

/// A temporary file's name; the file is removed on drop unless it was renamed.
struct Temporary {
    path: Option<PathBuf>,
}

impl Temporary {
    /// Gives the file its final name.
    fn rename(mut self, to: &Path) -> io::Result<()> {
        if let Some(path) = &self.path {
            fs::rename(path, to)?;
        }
        self.path = None;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // A failure here is not the one to report: the write has already failed for a reason of its own.
            let _ = fs::remove_file(path);
        }
    }
}

/// Opens a fresh temporary next to `path`.
fn create_temporary(path: &Path) -> io::Result<(File, Temporary)> {
    let Some(name) = path.file_name() else {
        let message = format!("{}: expected the name of a file at the end of the path", path.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    };
    let pid = std::process::id();
    let mut number = 0_u32;
    loop {
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{pid}-{number}{SUFFIX}"));
        let temporary = folder_of(path).join(hidden);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((file, Temporary { path: Some(temporary) })),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && number < u32::MAX => number += 1,
            Err(error) => return Err(error),
        }
    }
}

/// The folder that holds `path`.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Makes a rename in `dir` survive a power cut.
#[cfg(unix)]
fn sync_folder(dir: &Path) -> io::Result<()> {
    match File::open(dir)?.sync_all() {
        // Some network file systems have no sync of folders; they order renames themselves.
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => {
            Ok(())
        }
        result => result,
    }
}

/// Folders cannot be opened for syncing here; the file system journals renames itself.
#[cfg(not(unix))]
fn sync_folder(_dir: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(dir)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_appears_whole_and_replaces_the_old_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let old = write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        assert_eq!((old.bytes, old.checksum), (3, xxhash_rust::xxh3::xxh3_64(b"old")));
        let written = write_atomically(&path, |out| {
            out.write_all(b"new ")?;
            // Until the end the old content is what a reader sees.
            assert_eq!(fs::read(&path).unwrap(), b"old");
            out.write_all(&[7; 3_000_000])
        })
        .unwrap();
        let found = fs::read(&path).unwrap();
        assert_eq!((written.bytes, found.len()), (3_000_004, 3_000_004));
        assert_eq!(written.checksum, xxhash_rust::xxh3::xxh3_64(&found));
        assert_eq!(names(dir.path()), ["a.bin"]);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        let failed = write_atomically(&path, |out| {
            out.write_all(b"new")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert_eq!(failed.unwrap_err().kind(), io::ErrorKind::StorageFull);
        let panicked =
            std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("a bug in the writer")));
        assert!(panicked.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.bin"]);
    }

    #[test]
    fn a_prepared_file_has_its_name_only_when_it_is_committed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        drop(prepare(&path, |out| out.write_all(b"new")).unwrap());
        assert!(names(dir.path()).is_empty());
        let prepared = prepare(&path, |out| out.write_all(b"new")).unwrap();
        assert!(!path.exists());
        assert_eq!(prepared.written().bytes, 3);
        prepared.commit().unwrap();
        assert_eq!(names(dir.path()), ["a.bin"]);
    }

    #[test]
    fn bytes_are_sent_to_the_disk_while_more_are_written() {
        let (mut out, mut synced, mut hash) = (Vec::new(), 0, Xxh3::new());
        let mut sync = || synced += 1;
        let mut early = Early { out: &mut out, sync: &mut sync, unsynced: 0, hash: &mut hash };
        let chunk = vec![7; SYNCED / 4 + 1];
        for _ in 0..9 {
            early.write_all(&chunk).unwrap();
        }
        assert_eq!((synced, out.len()), (2, 9 * chunk.len()));
    }

    #[test]
    fn temporaries_are_distinguished_from_other_files() {
        let dir = tempfile::tempdir().unwrap();
        let (_file, temporary) = create_temporary(&dir.path().join("frame.mcf")).unwrap();
        let (_second, other) = create_temporary(&dir.path().join("frame.mcf")).unwrap();
        assert!(names(dir.path())[0].contains(&std::process::id().to_string()));
        fs::write(dir.path().join("notes.meniscus-tmp"), "not hidden").unwrap();
        fs::write(dir.path().join(".hidden"), "not a temporary").unwrap();
        assert_eq!(remove_temporaries(dir.path()).unwrap().len(), 2);
        assert_eq!(names(dir.path()), [".hidden", "notes.meniscus-tmp"]);
        drop((temporary, other));
    }

    #[test]
    fn a_path_without_a_name_or_folder_is_refused() {
        assert_eq!(
            write_atomically(Path::new("/"), |_| Ok(())).unwrap_err().kind(),
            io::ErrorKind::InvalidInput
        );
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing").join("a.bin");
        assert_eq!(write_atomically(&path, |_| Ok(())).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
