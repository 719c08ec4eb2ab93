//! One writer per cache, and several of products that share a folder.

use super::{CacheError, open::open_own};
use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, ErrorKind, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// The right to write a folder, held until dropped.
///
/// The lock is the operating system's, on the file `.lock` in the folder; it ends with the process, however the
/// process ends, so a crash never leaves a folder locked. The file stays; its text names the process that took
/// the lock last: process number, host, and seconds since 1970.
///
/// Some network file systems have no locks. There the folder is written all the same.
#[derive(Debug)]
pub struct Lock {
    file: File,
    is_held: bool,
    is_shared: bool,
}

/// How a process waits for a lock that another one holds.
pub(crate) trait Patience {
    /// The longest time to wait.
    fn limit(&self) -> Duration;
    /// Gets a line, once, when the wait has lasted [`ANNOUNCE`] or half of the limit.
    fn announce(&self, line: &str);
    /// Whether to wait no longer.
    fn is_over(&self) -> bool;
}

/// Time after which a process that waits for a lock reports it.
const ANNOUNCE: Duration = Duration::from_secs(2);

/// Time between two attempts.
const PAUSE: Duration = Duration::from_millis(20);

/// Time between two looks whether a process holds a lock.
const PROBE: Duration = Duration::from_millis(500);

/// Time for which [`Lock::acquire_past_probes`] tries again: a look takes a lock for microseconds.
const PROBE_GRACE: Duration = Duration::from_millis(200);

/// What became of a file that another process was expected to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// The file is there.
    There,
    /// It is not, and no process holds the folder's lock.
    Abandoned,
    /// It is not, although a process holds the folder's lock.
    Late,
    /// The wait was cancelled.
    Cancelled,
}

/// Waits for the file at `path`, which the process that holds the lock of `dir` writes: at most for `limit`, and at most as long as
/// the caller's patience without such a process.
///
/// # Errors
/// If the lock cannot be looked at.
pub(crate) fn await_file(
    path: &Path,
    dir: &Path,
    limit: Duration,
    patience: &dyn Patience,
) -> Result<Arrival, CacheError> {
    let (start, mut last_probe, mut abandoned, mut is_announced) = (Instant::now(), None, None, false);
    loop {
        if path.is_file() {
            return Ok(Arrival::There);
        }
        if patience.is_over() {
            return Ok(Arrival::Cancelled);
        }
        let now = Instant::now();
        if last_probe.is_none_or(|last| now - last >= PROBE) {
            last_probe = Some(now);
            abandoned = if is_taken(dir)? { None } else { abandoned.or(Some(now)) };
            // What was written between the two looks.
            if path.is_file() {
                return Ok(Arrival::There);
            }
        }
        if let Some(since) = abandoned {
            if now - since >= patience.limit() {
                return Ok(Arrival::Abandoned);
            }
            if now - since >= ANNOUNCE && !is_announced {
                is_announced = true;
                patience.announce(&format!(
                    "{}: no process writes this folder; waiting for one, {} s at most (--wait)",
                    dir.display(),
                    patience.limit().as_secs()
                ));
            }
        } else if now - start >= limit {
            return Ok(Arrival::Late);
        }
        thread::sleep(PAUSE);
    }
}

/// Whether a process holds the lock of a folder alone. Where there are no locks, none does.
fn is_taken(dir: &Path) -> Result<bool, CacheError> {
    let path = dir.join(".lock");
    let file = match open_own(&path, OpenOptions::new().read(true)) {
        Ok(file) => file,
        Err(absent) if matches!(absent.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(false);
        }
        Err(error) => return Err(CacheError::from_io(&path, "look at the lock", error)),
    };
    match file.try_lock_shared() {
        Ok(()) => Ok(false),
        Err(TryLockError::WouldBlock) => Ok(true),
        Err(TryLockError::Error(error)) if has_no_locks(&error) => Ok(false),
        Err(TryLockError::Error(error)) => Err(CacheError::from_io(&path, "look at the lock", error)),
    }
}

impl Lock {
    /// Makes `dir` if it is not there and takes its lock, which no other process then holds.
    ///
    /// # Errors
    /// [`CacheError::Locked`] with the holder, or what the system reports.
    pub fn acquire(dir: &Path) -> Result<Self, CacheError> {
        Self::take(dir, false)
    }

    /// As [`Lock::acquire`], and tries again for a moment: a process that only looks at the lock ([`await_file`]) keeps no other
    /// from taking it.
    ///
    /// # Errors
    /// As [`Lock::acquire`].
    pub(crate) fn acquire_past_probes(dir: &Path) -> Result<Self, CacheError> {
        let start = Instant::now();
        loop {
            match Self::take(dir, false) {
                Err(CacheError::Locked { .. }) if start.elapsed() < PROBE_GRACE => thread::sleep(PAUSE),
                taken => return taken,
            }
        }
    }

    /// As [`Lock::wait`], but other processes may share the lock.
    ///
    /// # Errors
    /// As [`Lock::acquire`].
    pub(crate) fn share(dir: &Path, patience: &dyn Patience) -> Result<Self, CacheError> {
        Self::wait_for(dir, true, patience)
    }

    /// As [`Lock::acquire`], but waits while another process holds the lock: for what is held for moments only.
    ///
    /// # Errors
    /// As [`Lock::acquire`].
    pub(crate) fn wait(dir: &Path, patience: &dyn Patience) -> Result<Self, CacheError> {
        Self::wait_for(dir, false, patience)
    }

    fn wait_for(dir: &Path, is_shared: bool, patience: &dyn Patience) -> Result<Self, CacheError> {
        let start = Instant::now();
        let limit = patience.limit();
        // A job that was cancelled before records what it has finished all the same.
        let was_over = patience.is_over();
        let mut is_announced = false;
        loop {
            match Self::take(dir, is_shared) {
                Err(CacheError::Locked { path, holder })
                    if start.elapsed() < limit && (was_over || !patience.is_over()) =>
                {
                    if start.elapsed() >= ANNOUNCE.min(limit / 2) && !is_announced {
                        is_announced = true;
                        patience.announce(&format!(
                            "{}: waiting for {holder} to release this lock, {} s at most (--wait)",
                            path.display(),
                            limit.as_secs()
                        ));
                    }
                    thread::sleep(PAUSE);
                }
                taken => return taken,
            }
        }
    }

    /// Whether other processes are kept out: false where the file system has no locks.
    pub(crate) fn is_held(&self) -> bool {
        self.is_held
    }

    fn take(dir: &Path, is_shared: bool) -> Result<Self, CacheError> {
        let (mut file, path) = open(dir)?;
        let failed = |error| CacheError::from_io(&path, "take the lock", error);
        let taken = if is_shared { file.try_lock_shared() } else { file.try_lock() };
        let is_held = match taken {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => {
                return Err(CacheError::Locked { holder: holder(&mut file), path });
            }
            Err(TryLockError::Error(error)) if has_no_locks(&error) => false,
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        };
        // The text is advice for people. Where a lock is shared, some systems refuse all writes.
        if !is_shared {
            let _ = sign(&mut file);
        }
        Ok(Self { file, is_held, is_shared })
    }
}

/// Opens the file of a folder's lock; makes both if they are not there.
fn open(dir: &Path) -> Result<(File, PathBuf), CacheError> {
    fs::create_dir_all(dir).map_err(|error| CacheError::from_io(dir, "make the folder", error))?;
    let path = dir.join(".lock");
    let opened = open_own(&path, OpenOptions::new().read(true).write(true).create(true).truncate(false));
    let file = opened.map_err(|error| CacheError::from_io(&path, "take the lock", error))?;
    Ok((file, path))
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Closing the file releases the lock whether or not this succeeds.
        if !self.is_shared {
            let _ = self.file.set_len(0);
        }
    }
}

/// Whether the file system has no locks, as some that are mounted from other hosts.
fn has_no_locks(error: &io::Error) -> bool {
    #[cfg(unix)]
    let is_out_of_locks = error.raw_os_error() == Some(rustix::io::Errno::NOLCK.raw_os_error());
    #[cfg(not(unix))]
    let is_out_of_locks = false;
    is_out_of_locks || error.kind() == ErrorKind::Unsupported
}

/// Writes into the lock file which process holds it.
fn sign(file: &mut File) -> io::Result<()> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    file.set_len(0)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(format!("{} {} {since}\n", std::process::id(), host()).as_bytes())
}

/// The name of this computer, without characters that are none of a name.
fn host() -> String {
    #[cfg(unix)]
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    #[cfg(not(unix))]
    let name = std::env::var("COMPUTERNAME").unwrap_or_default();
    let plain: String = name.chars().filter(|&c| is_of_name(c)).take(64).collect();
    if plain.is_empty() { "unknown".into() } else { plain }
}

fn is_of_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || "-._".contains(c)
}

/// The process that a lock file names, as far as it can be read.
fn holder(file: &mut File) -> String {
    let mut text = Vec::new();
    let read = file.seek(SeekFrom::Start(0)).and_then(|_| file.take(256).read_to_end(&mut text));
    let text = String::from_utf8_lossy(&text);
    let is_number = |field: &&str| !field.is_empty() && field.bytes().all(|byte| byte.is_ascii_digit());
    let fields: Vec<&str> = text.split_whitespace().collect();
    match *fields {
        [pid, host, since] if read.is_ok() && is_number(&pid) && host.chars().all(is_of_name) => {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
            let age = since.parse::<u64>().ok().and_then(|since| now.checked_sub(since));
            format!(
                "process {pid} on {host}{}",
                age.map_or_else(String::new, |age| format!(", since {age} s"))
            )
        }
        _ => "an unknown process".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par;
    use std::sync::{
        Mutex,
        atomic::{AtomicBool, Ordering::Relaxed},
    };

    struct Caller {
        limit: Duration,
        lines: Mutex<Vec<String>>,
        is_over: AtomicBool,
    }

    impl Patience for Caller {
        fn limit(&self) -> Duration {
            self.limit
        }
        fn announce(&self, line: &str) {
            self.lines.lock().unwrap().push(line.to_owned());
        }
        fn is_over(&self) -> bool {
            self.is_over.load(Relaxed)
        }
    }

    fn caller(limit: Duration) -> Caller {
        Caller { limit, lines: Mutex::default(), is_over: AtomicBool::new(false) }
    }

    const MINUTE: Duration = Duration::from_secs(60);

    #[test]
    fn a_second_holder_is_refused_and_the_first_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("shot").join("cache");
        let first = Lock::acquire(&folder).unwrap();
        assert!(first.is_held());
        let Err(CacheError::Locked { holder, path }) = Lock::acquire(&folder) else { panic!("locked twice") };
        assert!(holder.starts_with(&format!("process {} on ", std::process::id())), "{holder}");
        assert!(holder.ends_with(" s"), "{holder}");
        assert_eq!(path, folder.join(".lock"));
        par::with_threads(2, || {
            par::join(|| drop(Lock::wait(&folder, &caller(MINUTE)).unwrap()), move || drop(first));
        });
        drop(Lock::acquire(&folder).unwrap());
    }

    #[test]
    fn a_wait_is_announced_once_and_ends() {
        let dir = tempfile::tempdir().unwrap();
        let _first = Lock::acquire(dir.path()).unwrap();
        let patience = caller(10 * PAUSE);
        let waited = Lock::wait(dir.path(), &patience);
        assert!(matches!(waited, Err(CacheError::Locked { .. })), "{waited:?}");
        let lines = patience.lines.into_inner().unwrap();
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains(&format!("waiting for process {} on", std::process::id())), "{lines:?}");
    }

    #[test]
    fn a_wait_that_is_cancelled_ends_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let _first = Lock::acquire(dir.path()).unwrap();
        let patience = caller(MINUTE);
        let start = Instant::now();
        par::with_threads(2, || {
            par::join(
                || assert!(matches!(Lock::wait(dir.path(), &patience), Err(CacheError::Locked { .. }))),
                || {
                    thread::sleep(2 * PAUSE);
                    patience.is_over.store(true, Relaxed);
                },
            );
        });
        assert!(start.elapsed() < MINUTE / 2);
    }

    #[test]
    fn a_job_that_was_cancelled_before_still_waits() {
        let dir = tempfile::tempdir().unwrap();
        let first = Lock::acquire(dir.path()).unwrap();
        let patience = caller(MINUTE);
        patience.is_over.store(true, Relaxed);
        par::with_threads(2, || {
            par::join(
                || drop(Lock::wait(dir.path(), &patience).unwrap()),
                move || {
                    thread::sleep(2 * PAUSE);
                    drop(first);
                },
            );
        });
    }

    #[test]
    fn a_file_is_awaited_while_its_writer_lives() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let waited = |limit, patience: &Caller| await_file(&path, dir.path(), limit, patience).unwrap();
        let impatient = caller(3 * PAUSE);
        assert_eq!(waited(MINUTE, &impatient), Arrival::Abandoned);
        let writer = Lock::acquire(dir.path()).unwrap();
        assert_eq!(waited(5 * PAUSE, &impatient), Arrival::Late, "longer than the patience without a writer");
        impatient.is_over.store(true, Relaxed);
        assert_eq!(waited(MINUTE, &impatient), Arrival::Cancelled);
        let start = Instant::now();
        par::with_threads(2, || {
            par::join(
                || assert_eq!(waited(MINUTE, &caller(3 * PAUSE)), Arrival::There),
                || {
                    thread::sleep(10 * PAUSE);
                    fs::write(&path, "").unwrap();
                },
            );
        });
        assert!(start.elapsed() < MINUTE / 2);
        drop(writer);
        fs::remove_file(&path).unwrap();
        // The writer dies after the wait has begun.
        let writer = Lock::acquire(dir.path()).unwrap();
        par::with_threads(2, || {
            par::join(
                || assert_eq!(waited(MINUTE, &caller(3 * PAUSE)), Arrival::Abandoned),
                || {
                    thread::sleep(5 * PAUSE);
                    drop(writer);
                },
            );
        });
        assert!(start.elapsed() < MINUTE / 2);
    }

    #[test]
    fn a_look_at_a_lock_keeps_no_process_from_taking_it() {
        let dir = tempfile::tempdir().unwrap();
        let look = Lock::share(dir.path(), &caller(MINUTE)).unwrap();
        par::with_threads(2, || {
            par::join(
                || drop(Lock::acquire_past_probes(dir.path()).unwrap()),
                move || {
                    thread::sleep(2 * PAUSE);
                    drop(look);
                },
            );
        });
        let _writer = Lock::acquire(dir.path()).unwrap();
        assert!(matches!(Lock::acquire_past_probes(dir.path()), Err(CacheError::Locked { .. })));
    }

    #[test]
    fn several_share_a_lock_that_one_alone_cannot_take() {
        let dir = tempfile::tempdir().unwrap();
        let both = [0, 1].map(|_| Lock::share(dir.path(), &caller(MINUTE)).unwrap());
        assert!(matches!(Lock::acquire(dir.path()), Err(CacheError::Locked { .. })));
        drop(both);
        let _one = Lock::acquire(dir.path()).unwrap();
        assert!(matches!(Lock::take(dir.path(), true), Err(CacheError::Locked { .. })));
    }

    #[test]
    fn an_old_lock_file_does_not_lock() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(".lock");
        fs::write(&path, "999999999999 and more text that a longer process name left").unwrap();
        let lock = Lock::acquire(dir.path()).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.starts_with(&format!("{} ", std::process::id())) && text.len() < 100, "{text}");
        drop(lock);
        assert_eq!(fs::read(&path).unwrap(), b"");
    }

    #[test]
    fn what_a_lock_file_names_is_shown_only_if_it_is_a_process() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(".lock");
        let named = |text: &[u8]| {
            fs::write(&path, text).unwrap();
            holder(&mut File::open(&path).unwrap())
        };
        assert_eq!(named(b"12 render-7.farm 99999999999999999"), "process 12 on render-7.farm");
        for odd in [&b"12"[..], b"x y 5", b"12 \x1b[31mred 5", b"\xff\xfe", b"12 a b 5"] {
            assert_eq!(named(odd), "an unknown process");
        }
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
