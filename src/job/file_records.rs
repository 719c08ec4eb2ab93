//! `mesh.jsonl`, `volume.jsonl` and so on: one line about the files that a product made of a frame, with their checksums.
//!
//! A file that no line describes, or that differs from its line, is not up to date: it is made again, and `verify` reports it.
//! Lines are appended under the folder's lock as soon as their files have their names. A crash between both leaves a file without a
//! line, or with the line of the file that it replaced.

use super::{Manifest, RunError, ShotFolder, report::Control};
use crate::{
    cache::{self, WrittenFile},
    frame::FrameIndex,
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::{ErrorKind, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

/// One line: the files that were made of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FileRecord {
    /// The frame; the first of a file that has several.
    pub(crate) frame: FrameIndex,
    /// The stream or object that they show.
    pub(crate) name: String,
    /// Key of what they were made from and with which settings; 16 hexadecimal digits.
    pub(crate) key: String,
    /// The simulated state that they were made from, where it is that of one frame; 16 hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) state: Option<String>,
    /// The files.
    #[serde(default)]
    pub(crate) files: Vec<RecordedFile>,
}

/// A file as it was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RecordedFile {
    /// Its path in the shot folder, with `/` between folders.
    pub(crate) file: String,
    /// Size of the file [bytes].
    pub(crate) bytes: u64,
    /// xxh3-64 of the bytes; 16 hexadecimal digits.
    pub(crate) xxh3: String,
}

impl FileRecord {
    /// The record of files that are not written yet.
    pub(crate) fn new(frame: FrameIndex, name: &str, key: u64, state: Option<u64>) -> Self {
        let (key, state) = (hex(key), state.map(hex));
        Self { frame, name: name.into(), key, state, files: Vec::new() }
    }

    /// Adds a file that was written.
    pub(crate) fn add(&mut self, file: String, written: WrittenFile) {
        self.files.push(RecordedFile { file, bytes: written.bytes, xxh3: hex(written.checksum) });
    }

    /// The bytes of all files.
    pub(crate) fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// The line, with the product's own figures.
    fn line(&self, figures: &Map<String, Value>) -> String {
        #[derive(Serialize)]
        struct RecordLine<'a> {
            #[serde(flatten)]
            record: &'a FileRecord,
            #[serde(flatten)]
            figures: &'a Map<String, Value>,
        }
        serde_json::to_string(&RecordLine { record: self, figures }).expect("a record is plain data") + "\n"
    }
}

/// A hash as it is written in records.
pub(crate) fn hex(hash: u64) -> String {
    format!("{hash:016x}")
}

/// How a file compares with its record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum FileState {
    /// As it was written.
    Valid,
    /// Not there.
    Missing,
    /// Other bytes than were written: which, in words.
    Damaged(String),
    /// Not written by this product under this name: why, in words.
    Foreign(String),
}

/// The newest line about every file of a product.
pub(crate) struct FileRecords {
    records: Vec<FileRecord>,
    /// The place of a file's record, and of the file in it.
    by_file: BTreeMap<String, (usize, usize)>,
    /// A file with these bytes: their number and checksum.
    by_content: BTreeMap<(u64, String), String>,
}

impl FileRecords {
    /// The records of the product whose files are in the sub-folder `product` of `out`; none if nothing was recorded. Lines that
    /// are not of this form, as one that a crash cut short, are left out.
    ///
    /// # Errors
    /// If the file is there and cannot be read.
    pub(crate) fn read(out: &ShotFolder, product: &str) -> Result<Self, RunError> {
        Ok(Self::parse(&read_lines(&path(out, product))?))
    }

    /// The records in the text of such a file.
    pub(crate) fn parse(text: &str) -> Self {
        let records: Vec<FileRecord> =
            text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let (mut by_file, mut by_content) = (BTreeMap::new(), BTreeMap::new());
        for (place, record) in records.iter().enumerate() {
            for (file, recorded) in record.files.iter().enumerate() {
                by_file.insert(recorded.file.clone(), (place, file));
                by_content.insert((recorded.bytes, recorded.xxh3.clone()), recorded.file.clone());
            }
        }
        Self { records, by_file, by_content }
    }

    /// The record of a file.
    pub(crate) fn of(&self, file: &str) -> Option<(&FileRecord, &RecordedFile)> {
        let &(record, place) = self.by_file.get(file)?;
        let record = &self.records[record];
        Some((record, &record.files[place]))
    }

    /// The files that have a record, each with the first of its frames.
    pub(crate) fn files(&self) -> impl Iterator<Item = (FrameIndex, &str)> {
        self.by_file.iter().map(|(file, &(record, _))| (self.records[record].frame, file.as_str()))
    }

    /// The frames that have a record.
    pub(crate) fn frames(&self) -> impl Iterator<Item = u32> {
        self.records.iter().map(|record| record.frame.0)
    }

    /// The frames whose file, of this name, has a record; a frame may occur several times.
    pub(crate) fn frames_with(&self, name: impl Fn(u32) -> String) -> impl Iterator<Item = u32> {
        self.frames().filter(move |&frame| self.of(&name(frame)).is_some())
    }

    /// Bytes of the files of each frame that has some, without files of several frames.
    pub(crate) fn bytes_by_frame(&self) -> BTreeMap<FrameIndex, u64> {
        let mut sums = BTreeMap::new();
        for &(record, place) in self.by_file.values() {
            let record = &self.records[record];
            let recorded = &record.files[place];
            // Only files of one frame have its number.
            if recorded.file.contains(&format!("_{}.", record.frame)) {
                *sums.entry(record.frame).or_default() += recorded.bytes;
            }
        }
        sums
    }

    /// Whether every one of these files is in `out` as it was written with `key`.
    pub(crate) fn confirm(&self, out: &ShotFolder, files: &[String], key: u64) -> bool {
        let key = hex(key);
        files.iter().all(|file| {
            self.of(file).is_some_and(|(record, _)| record.key == key)
                && self.state(out, file) == FileState::Valid
        })
    }

    /// Compares a file in `out` with its record.
    pub(crate) fn state(&self, out: &ShotFolder, file: &str) -> FileState {
        let path = out.root().join(file);
        if std::fs::symlink_metadata(&path).is_err_and(|error| error.kind() == ErrorKind::NotFound) {
            return FileState::Missing;
        }
        if cache::leads_out(out.root(), &path) {
            return FileState::Foreign("a symbolic link leads out of the shot's folder".into());
        }
        let Some((_, recorded)) = self.of(file) else {
            return FileState::Foreign(
                "no record of its checksum: another program or version wrote it, or the job was stopped"
                    .into(),
            );
        };
        let found = match cache::checksum(&path) {
            Ok(found) => found,
            Err(error) => return FileState::Damaged(error.to_string()),
        };
        let sum = hex(found.checksum);
        if (found.bytes, &sum) == (recorded.bytes, &recorded.xxh3) {
            return FileState::Valid;
        }
        match self.by_content.get(&(found.bytes, sum.clone())) {
            Some(other) => FileState::Foreign(format!("these are the bytes of {other}")),
            None if found.bytes != recorded.bytes => {
                FileState::Damaged(format!("found {} bytes, expected {}", found.bytes, recorded.bytes))
            }
            None => FileState::Damaged(format!("found checksum {sum}, expected {}", recorded.xxh3)),
        }
    }
}

/// The file of a product's records.
pub(crate) fn path(out: &ShotFolder, product: &str) -> PathBuf {
    out.root().join(format!("{product}.jsonl"))
}

/// The text of a file of lines; empty if it is not there.
pub(crate) fn read_lines(path: &Path) -> Result<String, RunError> {
    match cache::read_text(path) {
        Err(absent) if matches!(absent.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            Ok(String::new())
        }
        read => read.map_err(|source| RunError::File {
            path: path.into(),
            source,
            next: "check that the file can be read, or remove it and make the files again",
        }),
    }
}

/// Adds the line of a record with the product's own figures.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn append(
    out: &ShotFolder,
    product: &str,
    record: &FileRecord,
    figures: &Map<String, Value>,
    control: Control,
) -> Result<(), RunError> {
    /// Frames of one process are recorded one after the other: they would wait for each other's lock of the folder.
    static IN_PROCESS: Mutex<()> = Mutex::new(());
    let _turn = IN_PROCESS.lock().unwrap_or_else(PoisonError::into_inner);
    let _lock = Manifest::lock(out, control)?;
    append_line(&path(out, product), &record.line(figures))
}

/// Adds a line to a file. What a crash left of an earlier line is ended first.
///
/// # Errors
/// If the file cannot be written; then it is as long as before, as far as the disk allows.
pub(crate) fn append_line(path: &Path, line: &str) -> Result<(), RunError> {
    let append = || {
        let mut file = cache::open_to_append(path)?;
        let before = file.metadata()?.len();
        let mut last = [b'\n'];
        if before > 0 {
            file.seek(SeekFrom::End(-1))?;
            file.read_exact(&mut last)?;
        }
        let end = if last == [b'\n'] { "" } else { "\n" };
        let written = file.write_all(format!("{end}{line}").as_bytes()).and_then(|()| file.sync_data());
        if written.is_err() {
            // A part of a line would hide the next one; a failure to remove it is not the one to report.
            let _ = file.set_len(before);
        }
        written
    };
    append().map_err(|source| ShotFolder::not_written(path, source))
}

/// Keeps the newest line about every file, sorted, so that the lines neither grow in number with each run nor depend on the order
/// in which frames were made.
///
/// # Errors
/// If the file cannot be read or written.
pub(crate) fn compact(out: &ShotFolder, product: &str, control: Control) -> Result<(), RunError> {
    let _lock = Manifest::lock(out, control)?;
    let path = path(out, product);
    let text = read_lines(&path)?;
    let (mut newest, mut described) = (BTreeSet::<String>::new(), BTreeSet::new());
    let mut kept = Vec::new();
    for line in text.lines().rev() {
        let Ok(mut record) = serde_json::from_str::<FileRecord>(line) else { continue };
        let files = record.files.len();
        record.files.retain(|file| newest.insert(file.file.clone()));
        // Earlier versions recorded no files.
        let is_new = described.insert((record.name.clone(), record.frame)) && files == 0;
        // Lines are sorted below: an outdated entry could follow the newer one and win.
        let line = match record.files.len() {
            0 if !is_new => continue,
            left if left == files => line.to_owned(),
            _ => with_files(line, &record.files),
        };
        kept.push((record.name, record.frame, line));
    }
    kept.reverse();
    kept.sort_by(|a, b| (&a.0, a.1).cmp(&(&b.0, b.1)));
    let kept: String = kept.into_iter().map(|(_, _, line)| format!("{line}\n")).collect();
    if kept == text { Ok(()) } else { ShotFolder::write(path, &kept) }
}

/// The line of a record with other files.
fn with_files(line: &str, files: &[RecordedFile]) -> String {
    let mut fields: Map<String, Value> = serde_json::from_str(line).expect("the line is a record");
    fields.insert("files".into(), serde_json::to_value(files).expect("a record is plain data"));
    serde_json::to_string(&fields).expect("a record is plain data")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{control::CancelToken, job::report::Silent};
    use std::fs;

    fn made(out: &ShotFolder, frame: u32, name: &str, bytes: &[u8]) -> FileRecord {
        let mut record = FileRecord::new(FrameIndex(frame), "liquid", 7, Some(9));
        fs::create_dir_all(out.subfolder("mesh")).unwrap();
        let file = format!("mesh/{name}");
        let written = cache::write_atomically(&out.root().join(&file), |to| to.write_all(bytes)).unwrap();
        record.add(file, written);
        append(out, "mesh", &record, &Map::new(), Control::new(&Silent, &CancelToken::new())).unwrap();
        record
    }

    #[test]
    fn files_are_compared_with_their_newest_line() {
        let dir = tempfile::tempdir().unwrap();
        let out = ShotFolder::new(dir.path());
        let state = |file: &str| FileRecords::read(&out, "mesh").unwrap().state(&out, file);
        assert_eq!(state("mesh/a.ply"), FileState::Missing);
        made(&out, 1, "a.ply", b"old");
        made(&out, 1, "a.ply", b"a mesh");
        made(&out, 2, "b.ply", b"b mesh");
        assert_eq!(state("mesh/a.ply"), FileState::Valid);
        let place = |name: &str| out.subfolder("mesh").join(name);
        fs::write(place("a.ply"), "a mess").unwrap();
        assert!(matches!(state("mesh/a.ply"), FileState::Damaged(why) if why.contains("checksum")));
        fs::write(place("a.ply"), "a me").unwrap();
        assert!(matches!(state("mesh/a.ply"), FileState::Damaged(why) if why.contains("found 4 bytes")));
        fs::copy(place("b.ply"), place("a.ply")).unwrap();
        assert!(matches!(state("mesh/a.ply"), FileState::Foreign(why) if why.contains("mesh/b.ply")));
        fs::write(place("c.ply"), "c mesh").unwrap();
        assert!(matches!(state("mesh/c.ply"), FileState::Foreign(why) if why.contains("no record")));
        fs::remove_file(place("b.ply")).unwrap();
        assert_eq!(state("mesh/b.ply"), FileState::Missing);
    }

    #[test]
    fn files_are_confirmed_with_their_key_only() {
        let dir = tempfile::tempdir().unwrap();
        let out = ShotFolder::new(dir.path());
        let record = made(&out, 1, "a.ply", b"a mesh");
        assert_eq!((record.bytes(), record.key.as_str()), (6, "0000000000000007"));
        let records = FileRecords::read(&out, "mesh").unwrap();
        assert!(records.confirm(&out, &["mesh/a.ply".into()], 7));
        assert!(!records.confirm(&out, &["mesh/a.ply".into()], 8));
        assert!(!records.confirm(&out, &["mesh/a.ply".into(), "mesh/b.ply".into()], 7));
    }

    #[test]
    fn compacting_keeps_the_newest_lines_sorted_and_drops_others() {
        let dir = tempfile::tempdir().unwrap();
        let out = ShotFolder::new(dir.path());
        for (frame, name, bytes) in [(2, "b.ply", b"bb"), (1, "a.ply", b"aa"), (2, "b.ply", b"cc")] {
            made(&out, frame, name, bytes);
        }
        let line = "{\"frame\":9,\"name\":\"liquid\",\"key\":\"7\",\"volume\":1.0}\n";
        append_line(&path(&out, "mesh"), line).unwrap();
        append_line(&path(&out, "mesh"), "{\"frame\":3,\"na").unwrap();
        made(&out, 4, "d.ply", b"dd");
        compact(&out, "mesh", Control::new(&Silent, &CancelToken::new())).unwrap();
        let text = read_lines(&path(&out, "mesh")).unwrap();
        let frames: Vec<_> =
            text.lines().map(|line| serde_json::from_str::<FileRecord>(line).unwrap().frame.0).collect();
        assert_eq!(
            frames,
            [1, 2, 4, 9],
            "a line that was cut short hides no other, and figures of earlier versions stay"
        );
        assert_eq!(FileRecords::read(&out, "mesh").unwrap().state(&out, "mesh/b.ply"), FileState::Valid);
    }

    #[test]
    fn a_file_of_several_frames_has_one_line_whichever_frame_is_its_first() {
        let dir = tempfile::tempdir().unwrap();
        let out = ShotFolder::new(dir.path());
        let cancel = CancelToken::new();
        let control = Control::new(&Silent, &cancel);
        for (first, bytes) in [(2, b"2-4"), (1, b"1-4"), (3, b"3-4"), (1, b"1-5")] {
            made(&out, first, "cloth.pc2", bytes);
            compact(&out, "mesh", control).unwrap();
            assert_eq!(
                FileRecords::read(&out, "mesh").unwrap().state(&out, "mesh/cloth.pc2"),
                FileState::Valid,
                "made from frame {first}"
            );
            assert_eq!(read_lines(&path(&out, "mesh")).unwrap().lines().count(), 1);
        }
        // A line of two files, of which one was made again.
        let mut both = made(&out, 4, "loop.webp", b"loop");
        both.files.push(made(&out, 4, "contact.png", b"contact").files.remove(0));
        append(&out, "mesh", &both, &Map::new(), control).unwrap();
        made(&out, 1, "loop.webp", b"another");
        compact(&out, "mesh", control).unwrap();
        for file in ["mesh/loop.webp", "mesh/contact.png", "mesh/cloth.pc2"] {
            assert_eq!(
                FileRecords::read(&out, "mesh").unwrap().state(&out, file),
                FileState::Valid,
                "{file}"
            );
        }
    }
}
