//! The corpus that fuzzing left, read again.

use super::*;
use crate::scene;
use std::{
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    time::{Duration, Instant},
};

/// The longest time that a file of the corpus may take. They take milliseconds; a reader whose time grows with the square of the
/// bytes, minutes.
const MAX_TIME: Duration = Duration::from_secs(20);

/// The largest corpus of all readers together \[bytes\].
const MAX_CORPUS: u64 = 300_000;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/fuzz/corpus")
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap_or_else(|why| panic!("{}: {why}", folder.display()));
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Reads bytes and compares memory and time with the reader's limits.
fn replay(reader: &Reader, bytes: &[u8]) -> Result<(), String> {
    let (clock, mut outcome) = (Instant::now(), Ok(()));
    let took = allocation_counter::measure(|| {
        outcome = catch_unwind(AssertUnwindSafe(|| (reader.read)(bytes)));
    });
    let (taken, max) = (took.bytes_max, reader.max_memory(bytes.len()));
    match outcome {
        Err(_) => Err("panicked".into()),
        Ok(()) if taken > max => {
            Err(format!("took {taken} bytes of memory for {} bytes, at most {max}", bytes.len()))
        }
        Ok(()) if clock.elapsed() > MAX_TIME => Err(format!("took {:?}", clock.elapsed())),
        Ok(()) => Ok(()),
    }
}

#[test]
fn the_corpus_of_every_reader_is_read_within_its_limits() {
    let folders = names(&corpus());
    let mut expected: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
    expected.sort_unstable();
    assert_eq!(folders, expected, "a folder for each reader");
    let (mut failed, mut total) = (Vec::new(), 0);
    for reader in READERS {
        let folder = corpus().join(reader.name);
        let files = names(&folder);
        assert!(!files.is_empty(), "{} has no corpus", reader.name);
        for file in files {
            let bytes = fs::read(folder.join(&file)).unwrap();
            total += bytes.len() as u64;
            failed.extend(replay(&reader, &bytes).err().map(|why| format!("{}/{file}: {why}", reader.name)));
        }
    }
    assert_eq!(failed, [""; 0]);
    assert!(total <= MAX_CORPUS, "the corpus has {total} bytes: minimise it");
}

#[test]
fn a_reader_that_panics_or_takes_too_much_memory_is_found() {
    let panics = row("a", |_| panic!("planted"), 1 << 20, 64);
    assert_eq!(replay(&panics, b"1"), Err("panicked".into()));
    let takes = |reader: &Reader| replay(reader, b"1").unwrap_err();
    let greedy = row("b", |_| drop(std::hint::black_box(vec![0_u8; 2 << 20])), 1 << 20, 64);
    assert!(takes(&greedy).contains("at most 1048640"));
    assert_eq!(replay(&Reader { fixed: 3 << 20, ..greedy }, b"1"), Ok(()));
}
/// The scene of a preset's text.
fn preset(text: &str) -> Result<Scene, SceneError> {
    let preset = Preset { name: "shot.toml".into(), text: text.into(), home: Home::BuiltIn };
    Scene::from_preset(&preset, &Overrides::default())
}

#[test]
fn a_preset_of_very_many_mistakes_is_read_in_time_that_grows_with_its_size() {
    // Comparing each with all before it, or counting the lines in front of it, would take minutes.
    let keys = |first: u32| (first..first + 60_000).map(|i| format!("k{i} = 0\n")).collect::<String>();
    let text = keys(0) + "[quality.draft]\n" + &keys(100_000);
    // Two keys are missing, which is reported in front of all lines.
    let problems = preset(&text).unwrap_err();
    let problems = problems.problems();
    assert_eq!((problems.len(), problems[99].line), (101, 98));
    assert_eq!(problems[100].message, "119902 more problems are not listed");
    let text: String = (0..60_000).map(|i| format!("k{i} =\n")).collect();
    let broken = preset(&text).unwrap_err();
    assert_eq!(broken.problems().len(), 101);
    assert!(diagnostic(&broken).contains("59900 more problems are not listed"));
    // The distance of a word from the valid keys takes the memory of their product.
    let word = "w".repeat(500_000);
    let took = allocation_counter::measure(|| assert!(preset(&format!("{word} = 0")).is_err()));
    assert!(took.bytes_max < 64 << 20, "{} bytes", took.bytes_max);
}

#[test]
fn presets_are_regular_files_of_a_bounded_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.toml");
    std::fs::write(&path, vec![b'#'; (1 << 20) + 1]).unwrap();
    let why = scene::load(path.to_str().unwrap()).unwrap_err().to_string();
    assert!(why.contains("found 1048577 bytes, expected at most 1048576"), "{why}");
    std::fs::write(&path, vec![b'#'; 1 << 20]).unwrap();
    assert!(scene::load(path.to_str().unwrap()).is_ok());
}
