//! Opening files in a folder that a stranger may have filled.
//!
//! A symbolic link there may lead to any file of the user, so what is written is never opened through one. A pipe or a device
//! named like a file never ends or never begins, so only regular files are read.

use super::WrittenFile;
use crate::control::fallible;
use std::{
    fs::{self, File, OpenOptions},
    io::{self, ErrorKind, Read},
    path::Path,
};
use xxhash_rust::xxh3::Xxh3;

/// The largest text file that is read whole \[bytes\]: the log of a million frames has 300 MB.
const MAX_TEXT: u64 = 1 << 30;

/// Opens a regular file for reading, and returns its length \[bytes\].
///
/// # Errors
/// If it is a folder, a pipe or a device, or what the system reports.
pub(crate) fn open_regular(path: &Path) -> io::Result<(File, u64)> {
    let mut options = OpenOptions::new();
    options.read(true);
    // Else opening a pipe waits for its writer.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, flags(rustix::fs::OFlags::NONBLOCK));
    let file = regular(options.open(path)?)?;
    let length = file.metadata()?.len();
    Ok((file, length))
}

/// Opens a regular file for reading as [`open_regular`] does, if it is in `folder` or below it.
///
/// # Errors
/// As [`open_regular`]; if it is a symbolic link that leads elsewhere: a stranger's link may lead to any file of the user.
pub(super) fn open_inside(folder: &Path, path: &Path) -> io::Result<(File, u64)> {
    if leads_out(folder, path) {
        let found = "found a symbolic link that leads out of the shot's folder, expected a file in it: remove the link";
        return Err(io::Error::new(ErrorKind::InvalidInput, found));
    }
    open_regular(path)
}

/// Whether a file that lies in `folder` by its path is elsewhere, behind symbolic links.
pub(crate) fn leads_out(folder: &Path, path: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    real(path).zip(real(folder)).is_some_and(|(file, folder)| !file.starts_with(folder))
}

/// Reads a regular file to the length that it has when it is opened.
///
/// # Errors
/// As [`open_regular`]; [`ErrorKind::OutOfMemory`] if there is no memory for it.
pub(crate) fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let (file, length) = open_regular(path)?;
    read_bytes(file, length)
}

/// Reads at most `length` bytes of a file.
///
/// # Errors
/// Those of the system; [`ErrorKind::OutOfMemory`] if there is no memory for them.
pub(crate) fn read_bytes(file: File, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let capacity = usize::try_from(length).map_err(|_| ErrorKind::OutOfMemory)?;
    fallible(|| bytes.try_reserve_exact(capacity)).map_err(|_| ErrorKind::OutOfMemory)?;
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Opens a file to write at its end and to read, and makes it if it is not there.
///
/// # Errors
/// If it is a symbolic link or no regular file, or what the system reports.
pub(crate) fn open_to_append(path: &Path) -> io::Result<File> {
    open_own(path, OpenOptions::new().read(true).append(true).create(true))
}

/// Opens a file with these options, not through a symbolic link.
///
/// # Errors
/// If it is a symbolic link or no regular file, or what the system reports.
pub(super) fn open_own(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    refuse_link(path, "a file")?;
    // A link may take the file's place after that look.
    #[cfg(unix)]
    let options = {
        let exact = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
        std::os::unix::fs::OpenOptionsExt::custom_flags(options, flags(exact))
    };
    regular(options.open(path)?)
}

/// Reads a text file whole; bytes that are no UTF-8 become U+FFFD, so that a damaged line leaves the others readable.
///
/// # Errors
/// As [`read_regular`], or if it has more than a gibibyte.
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    within(open_regular(path)?, MAX_TEXT)
}

/// Reads a text file as [`read_text`] does, if it has at most `max` bytes and no link leads out of its folder.
///
/// # Errors
/// As [`open_inside`], or if it has more.
pub(crate) fn read_text_within(path: &Path, max: u64) -> io::Result<String> {
    within(open_inside(path.parent().unwrap_or(Path::new("")), path)?, max)
}

/// The text of a file with at most `max` bytes.
fn within((file, length): (File, u64), max: u64) -> io::Result<String> {
    if length > max {
        let found = format!("found {length} bytes, expected at most {max}");
        return Err(io::Error::new(ErrorKind::InvalidData, found));
    }
    let bytes = read_bytes(file, length)?;
    Ok(String::from_utf8(bytes)
        .unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
}

/// The size and the checksum of a file.
///
/// # Errors
/// If it is no regular file, or what the system reports.
pub(crate) fn checksum(path: &Path) -> io::Result<WrittenFile> {
    let (mut file, _) = open_regular(path)?;
    let (mut hash, mut buffer, mut bytes) = (Xxh3::new(), vec![0; 1 << 20], 0);
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(WrittenFile { bytes, checksum: hash.digest() }),
            Ok(count) => {
                hash.update(&buffer[..count]);
                bytes += count as u64;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Makes sure that the folder `path` exists and is no symbolic link.
///
/// # Errors
/// If it is a link, or cannot be made.
pub(crate) fn create_own_folder(path: &Path) -> io::Result<()> {
    refuse_link(path, "a folder")?;
    fs::create_dir_all(path)
}

fn refuse_link(path: &Path, expected: &str) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.file_type().is_symlink() => Err(io::Error::new(
            ErrorKind::InvalidInput,
            format!("found a symbolic link, expected {expected} of the shot's own: remove the link"),
        )),
        _ => Ok(()),
    }
}

#[cfg(unix)]
fn flags(flags: rustix::fs::OFlags) -> i32 {
    flags.bits().cast_signed()
}

/// The file, if it is a regular one.
fn regular(file: File) -> io::Result<File> {
    let kind = file.metadata()?.file_type();
    if kind.is_file() {
        return Ok(file);
    }
    let found = if kind.is_dir() { "it is a folder" } else { "it is a pipe or a device" };
    Err(io::Error::new(ErrorKind::InvalidInput, format!("{found}, not a regular file")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_with_a_damaged_line_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log");
        fs::write(&path, b"good\nbad \xff\ngood").unwrap();
        assert_eq!(read_text(&path).unwrap(), "good\nbad \u{fffd}\ngood");
        let folder = read_text(dir.path()).unwrap_err();
        assert!(folder.to_string().contains("it is a folder"), "{folder}");
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_written_through_a_link() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::write(place("precious"), "kept").unwrap();
        symlink(place("precious"), place("link")).unwrap();
        symlink(place("new"), place("dangling")).unwrap();
        symlink(dir.path(), place("folder")).unwrap();
        for name in ["link", "dangling", "folder"] {
            let refused = open_to_append(&place(name)).unwrap_err();
            assert!(refused.to_string().contains("found a symbolic link"), "{refused}");
            assert!(create_own_folder(&place(name)).is_err());
        }
        assert_eq!(fs::read(place("precious")).unwrap(), b"kept");
        assert!(!place("new").exists());
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_read_through_a_link_out_of_the_folder() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let shot = dir.path().join("shot");
        fs::create_dir(&shot).unwrap();
        fs::write(dir.path().join("precious"), "secret").unwrap();
        fs::write(shot.join("own"), "shown").unwrap();
        for (target, name) in [("../precious", "out"), ("own", "in"), ("..", "up")] {
            symlink(target, shot.join(name)).unwrap();
        }
        for name in ["own", "in"] {
            assert_eq!(read_text_within(&shot.join(name), 9).unwrap(), "shown");
        }
        let refused = read_text_within(&shot.join("out"), 9).unwrap_err().to_string();
        assert!(refused.contains("leads out of the shot's folder"), "{refused}");
        assert!(leads_out(&shot, &shot.join("up/precious")) && !leads_out(&shot, &shot.join("up/shot/own")));
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frame_0001.mcf");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        for refused in [open_regular(&path).map(|(file, _)| file), open_to_append(&path)] {
            let refused = refused.unwrap_err();
            assert!(
                refused.to_string().contains("a pipe or a device") || refused.raw_os_error().is_some(),
                "{refused}"
            );
        }
    }
}
