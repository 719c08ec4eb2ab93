//! The steps of a batch, independent of the engine that runs them.

use crate::{
    cache::leads_out,
    control::printable_path,
    job::{FrameSpan, RunError, ShotFolder},
    preset::Frames,
    product::{self, ProductSettings},
    run::{frame_ranges, wedge::WedgeList},
    scene::{self, Overrides, Scene},
};
use std::path::{Path, PathBuf};

/// What a job is made of.
pub(crate) struct Request<'a> {
    /// A shot folder with its preset, or a folder of wedges.
    pub folder: &'a Path,
    /// The frames; `None`: those of the preset.
    pub frames: Option<&'a Frames>,
    /// Frames of a task that makes meshes or volumes.
    pub chunk: u32,
    /// Threads of a task; 0: all that the machine has.
    pub threads: u16,
    /// Memory of a task [bytes].
    pub max_memory: Option<u64>,
    /// The program on the machines that run the tasks.
    pub command: &'a str,
}

/// A batch as a job.
#[derive(Debug)]
pub(crate) struct FarmJob {
    /// The shot's name.
    pub(super) title: String,
    /// The folder, as an absolute path.
    pub(super) root: PathBuf,
    /// The shot folders below it, by names without special characters; empty: the folder is a shot itself.
    pub(super) shots: Vec<String>,
    /// All frames as `--frames` takes them.
    pub(super) frames: String,
    /// Frames of a chunk.
    pub(super) chunk: u32,
    /// The frames of each chunk as `--frames` takes them.
    pub(super) chunks: Vec<String>,
    /// The steps, sorted by stage.
    pub(super) steps: Vec<Step>,
    /// Threads of a task; 0: all that the machine has.
    pub(super) threads: u16,
    /// Memory that a task may take [bytes].
    pub(super) max_memory: Option<u64>,
    /// The program.
    pub(super) command: String,
}

/// Commands of one kind.
#[derive(Debug)]
pub(super) struct Step {
    /// Name of the step, unique in the job.
    pub(super) name: String,
    /// A step begins when all of earlier stages have ended.
    pub(super) stage: usize,
    /// How many tasks it has.
    pub(super) scope: Scope,
    /// The command line after the program.
    pub(super) words: Vec<Word>,
}

/// Number of tasks of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scope {
    /// One for each shot.
    Shot,
    /// One for each chunk of each shot.
    Chunk,
    /// One for all shots.
    All,
}

/// A word of a command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Word {
    /// Text of letters, digits and `-,.=`, which no engine and no shell takes for something else.
    Plain(String),
    /// The folder of the task's shot.
    Shot,
    /// The preset in that folder.
    Preset,
    /// The frames of the task's chunk.
    Chunk,
    /// The folder of all shots.
    Root,
}

/// The form of a job for an engine.
pub(super) struct JobFiles {
    /// Names and texts of its files.
    pub(super) files: Vec<(&'static str, String)>,
    /// The command that submits it.
    pub(super) submit: String,
}

/// What every file of a job has, so that no file of the user is replaced.
pub(super) const MARK: &str = "Written by meniscus farm";

/// The step that fills the cache.
const SIMULATE: usize = 0;

/// Steps that make products of frames.
pub(super) const MAKE: usize = 1;

/// The step that reads everything again.
const VERIFY: usize = 2;

/// The step that draws the wedges of a folder.
const COMPARE: usize = 3;

/// Chunks of a job: Slurm's arrays have 1000 tasks unless the site allows more, and Open Job Description's lists 1024 values.
const MAX_CHUNKS: u64 = 1000;

/// Frames of a job, also in `flamenco.js`.
const MAX_FRAMES: u64 = 1_000_000;

/// Characters of the frames of a chunk, which Open Job Description limits.
const MAX_CHUNK_TEXT: usize = 1024;

impl FarmJob {
    /// Lays out the steps of a shot or of wedges.
    ///
    /// # Errors
    /// If the folder holds neither; if wedges differ in their frames or outputs; if there are too many chunks.
    pub(crate) fn new(request: &Request) -> Result<Self, RunError> {
        let folder = request.folder;
        let absolute = std::path::absolute(folder).map_err(|source| RunError::File {
            path: folder.into(),
            source,
            next: "name the folder by its full path",
        })?;
        if absolute.to_str().is_none() {
            return Err(RunError::Request(format!(
                "{}: found a path that is not UTF-8, which job files cannot hold; rename the folder",
                printable_path(folder)
            )));
        }
        let (title, shots) = match WedgeList::read(folder)? {
            Some(list) => {
                list.shots(folder)?;
                (Some(list.title), list.wedges.into_iter().map(|wedge| wedge.folder).collect())
            }
            None => (None, Vec::new()),
        };
        let first = shots.first().map_or_else(|| folder.to_owned(), |shot: &String| folder.join(shot));
        let scene = recorded(&first)?;
        for shot in shots.iter().skip(1) {
            let other = recorded(&folder.join(shot))?;
            let differs =
                [("frames", other.frames != scene.frames), ("output", other.output != scene.output)];
            if let Some((key, _)) = differs.iter().find(|(_, differs)| *differs) {
                return Err(RunError::Request(format!(
                    "{shot}: found another `{key}` than in {}, which one job cannot have; run `meniscus farm` on the folder \
                     of each wedge",
                    shots[0]
                )));
            }
        }
        let frames = request.frames.unwrap_or(&scene.frames);
        if frames.first() < scene.frames.first() {
            return Err(RunError::Request(format!(
                "--frames: frame {} is before the shot's first, {}; choose frames from there on",
                frames.first(),
                scene.frames.first()
            )));
        }
        let title = title.unwrap_or_else(|| scene.title.clone());
        Ok(Self {
            title,
            root: absolute,
            frames: frames.to_string(),
            chunk: request.chunk,
            chunks: chunks(frames, request.chunk)?,
            steps: steps(&scene, frames, !shots.is_empty(), request.max_memory),
            shots,
            threads: request.threads,
            max_memory: request.max_memory,
            command: request.command.into(),
        })
    }

    /// Words after those of any step: threads, where they are limited.
    pub(super) fn common_words(&self) -> Vec<String> {
        match self.threads {
            0 => Vec::new(),
            threads => vec!["--threads".into(), threads.to_string()],
        }
    }

    /// The memory to reserve for a task [MiB]: a quarter more than it may take, since that is an estimate.
    pub(super) fn reserved_mebibytes(&self) -> Option<u64> {
        self.max_memory.map(|bytes| (bytes + bytes / 4).div_ceil(1 << 20))
    }

    /// The names of the steps in the stage before that of a step.
    pub(super) fn before(&self, stage: usize) -> Vec<&Step> {
        let last = self.steps.iter().map(|step| step.stage).filter(|&other| other < stage).max();
        self.steps.iter().filter(|step| Some(step.stage) == last).collect()
    }
}

/// The scene that a shot folder's preset describes.
fn recorded(folder: &Path) -> Result<Scene, RunError> {
    let preset = ShotFolder::new(folder).preset();
    if leads_out(folder, &preset) {
        return Err(RunError::Request(format!(
            "{}: found a link that leads out of the shot's folder, expected a preset in it; copy the preset there",
            printable_path(&preset)
        )));
    }
    if !preset.exists() {
        return Err(RunError::Request(format!(
            "{}: found no preset.toml and no wedges.json; name the shot with --preset, or lay out wedges with `meniscus wedge`",
            printable_path(folder)
        )));
    }
    let preset = scene::load(&preset.to_string_lossy())?;
    Ok(Scene::from_preset(&preset, &Overrides::default())?)
}

/// The steps of a scene.
fn steps(scene: &Scene, frames: &Frames, are_wedges: bool, max_memory: Option<u64>) -> Vec<Step> {
    let plain = |text: &str| Word::Plain(text.into());
    let memory = max_memory.map(|bytes| [plain("--max-memory"), Word::Plain(format!("{bytes}B"))]);
    let mut steps = Vec::new();
    let mut add = |name: String, stage, scope, words: Vec<Word>| {
        let limit = memory.iter().flatten().filter(|_| stage <= MAKE).cloned();
        steps.push(Step { name, stage, scope, words: words.into_iter().chain(limit).collect() });
    };
    let words = vec![plain("simulate"), Word::Preset, plain("-o"), Word::Shot, plain("--frames")];
    let all = Word::Plain(frames.to_string());
    add("simulate".into(), SIMULATE, Scope::Shot, [words, vec![all.clone()]].concat());
    let settings = &ProductSettings::of(scene);
    for product in product::ALL.into_iter().filter(|product| product.is_requested(settings)) {
        let (scope, name, frames) = match product.is_per_frame() {
            true => (Scope::Chunk, product.verb().to_owned(), Word::Chunk),
            false => (Scope::Shot, format!("{}-whole", product.verb()), all.clone()),
        };
        let mut words = vec![plain(product.verb()), Word::Shot];
        words.extend(product.arguments(settings).into_iter().map(Word::Plain));
        words.extend([plain("--frames"), frames]);
        add(name, MAKE, scope, words);
    }
    add("verify".into(), VERIFY, Scope::Shot, vec![plain("verify"), Word::Shot]);
    if are_wedges {
        add("compare".into(), COMPARE, Scope::All, vec![plain("wedge"), Word::Root]);
    }
    steps
}

/// The frames of each chunk.
fn chunks(frames: &Frames, chunk: u32) -> Result<Vec<String>, RunError> {
    if frames.count() > MAX_FRAMES {
        let found = frames.count();
        return Err(RunError::Request(format!(
            "--frames: found {found} frames, expected at most {MAX_FRAMES}"
        )));
    }
    let count = frames.count().div_ceil(chunk.into());
    if count > MAX_CHUNKS {
        return Err(RunError::Request(format!(
            "--chunk {chunk}: found {count} chunks, expected at most {MAX_CHUNKS}, which is what engines take; use --chunk {} \
             or more",
            frames.count().div_ceil(MAX_CHUNKS)
        )));
    }
    let numbers: Vec<u32> = frames.iter().map(|frame| frame.0).collect();
    let texts: Vec<String> = numbers.chunks(chunk as usize).map(frame_text).collect();
    match texts.iter().find(|text| text.len() > MAX_CHUNK_TEXT) {
        Some(text) => Err(RunError::Request(format!(
            "--chunk {chunk}: the list of the frames of a chunk has {} characters, expected at most {MAX_CHUNK_TEXT}; use a \
             smaller chunk, or a range such as 1-240x2",
            text.len()
        ))),
        None => Ok(texts),
    }
}

/// Ascending frames as `--frames` takes them: as a range with a step where they are one.
fn frame_text(frames: &[u32]) -> String {
    match FrameSpan::of(frames) {
        Some(FrameSpan { first, last, step })
            if step > 1 && (last - first) / step + 1 == frames.len() as u32 =>
        {
            format!("{first}-{last}x{step}")
        }
        _ => frame_ranges(frames),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_have_every_frame_once() {
        let chunks = |text: &str, chunk| chunks(&text.parse().unwrap(), chunk).unwrap();
        assert_eq!(chunks("1-10", 4), ["1-4", "5-8", "9-10"]);
        assert_eq!(chunks("1-10", 100), ["1-10"]);
        assert_eq!(chunks("1-9x2,20", 3), ["1-5x2", "7,9,20"]);
        assert_eq!(chunks("5", 1), ["5"]);
        for (text, chunk) in [("1-240x7,1000-1010", 3), ("3,5,9-12,13-40x3", 4), ("1-999", 1)] {
            let frames: Frames = text.parse().unwrap();
            let again = chunks(text, chunk)
                .iter()
                .flat_map(|text| text.parse::<Frames>().unwrap().iter().collect::<Vec<_>>())
                .collect::<Vec<_>>();
            assert_eq!(again, frames.iter().collect::<Vec<_>>(), "{text}");
        }
    }

    #[test]
    fn too_many_chunks_are_refused_with_the_shortest_length() {
        let refused = |text: &str, chunk| chunks(&text.parse().unwrap(), chunk).unwrap_err().to_string();
        assert!(
            refused("1-10000", 9).contains("found 1112 chunks")
                && refused("1-10000", 9).contains("--chunk 10 or")
        );
        assert!(refused("1-1000000", 1).contains("--chunk 1000 or"));
        assert!(refused("0-4294967295", 4_294_968).contains("at most 1000000"));
        let scattered: Vec<String> = (0..400).map(|i| (i * i).to_string()).collect();
        assert!(refused(&scattered.join(","), 400).contains("smaller chunk"));
    }
}
