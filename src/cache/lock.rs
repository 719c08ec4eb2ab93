//! One writer per cache.

use super::CacheError;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The right to write a cache folder, held until dropped.
///
/// The lock is the operating system's, on the file `.lock` in the folder; it ends with the process, however the
/// process ends, so a crash never leaves a folder locked. The file stays, its text names the process that holds
/// the lock now.
#[derive(Debug)]
pub struct Lock {
    file: File,
}

impl Lock {
    /// Makes `dir` if it is not there and takes its lock.
    ///
    /// # Errors
    /// [`CacheError::Locked`] with the holder's process number, or what the system reports.
    pub fn acquire(dir: &Path) -> Result<Self, CacheError> {
        let (mut file, path) = open(dir)?;
        let failed = |error| CacheError::from_io(&path, "take the lock", error);
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(CacheError::Locked { pid: holder(&mut file), path }),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        sign(&mut file).map_err(failed)?;
        Ok(Self { file })
    }

    /// As [`Lock::acquire`], but waits while another process holds the lock: for what is held for moments only.
    ///
    /// # Errors
    /// What the system reports.
    pub fn wait(dir: &Path) -> Result<Self, CacheError> {
        let (mut file, path) = open(dir)?;
        file.lock()
            .and_then(|()| sign(&mut file))
            .map_err(|error| CacheError::from_io(&path, "take the lock", error))?;
        Ok(Self { file })
    }
}

/// Opens the file of a folder's lock; makes both if they are not there.
fn open(dir: &Path) -> Result<(File, PathBuf), CacheError> {
    fs::create_dir_all(dir).map_err(|error| CacheError::from_io(dir, "make the folder", error))?;
    let path = dir.join(".lock");
    let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
    let file = opened.map_err(|error| CacheError::from_io(&path, "take the lock", error))?;
    Ok((file, path))
}

impl Drop for Lock {
    fn drop(&mut self) {
        // The text is advice for people; closing the file releases the lock whether or not this succeeds.
        let _ = self.file.set_len(0);
    }
}

/// Writes this process's number into the lock file.
fn sign(file: &mut File) -> io::Result<()> {
    file.set_len(0)?;
    file.seek(SeekFrom::Start(0))?;
    writeln!(file, "{}", std::process::id())
}

/// The process number in a lock file, as far as it can be read.
fn holder(file: &mut File) -> String {
    let mut text = Vec::new();
    let pid = match file.take(64).read_to_end(&mut text) {
        Ok(_) => String::from_utf8_lossy(&text).trim().to_owned(),
        Err(_) => String::new(),
    };
    if !pid.is_empty() && pid.bytes().all(|byte| byte.is_ascii_digit()) { pid } else { "unknown".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_is_refused_and_the_first_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("shot").join("cache");
        let first = Lock::acquire(&folder).unwrap();
        let Err(CacheError::Locked { pid, path }) = Lock::acquire(&folder) else { panic!("locked twice") };
        assert_eq!(pid, std::process::id().to_string());
        assert_eq!(path, folder.join(".lock"));
        crate::par::with_threads(2, || {
            crate::par::join(|| drop(Lock::wait(&folder).unwrap()), move || drop(first));
        });
        drop(Lock::acquire(&folder).unwrap());
    }

    #[test]
    fn an_old_lock_file_does_not_lock() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".lock"), "999999999999 and more text that a longer process name left")
            .unwrap();
        let lock = Lock::acquire(dir.path()).unwrap();
        assert_eq!(
            fs::read_to_string(dir.path().join(".lock")).unwrap(),
            format!("{}\n", std::process::id())
        );
        drop(lock);
    }

    #[test]
    fn a_file_where_the_folder_should_be_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cache");
        fs::write(&path, "").unwrap();
        let error = Lock::acquire(&path).unwrap_err();
        assert!(matches!(&error, CacheError::Io { path: place, .. } if *place == path), "{error}");
    }
}
