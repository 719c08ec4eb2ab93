//! Writes previews: `preview/frame_0001.png`, `preview/contact.png`, `preview/loop.webp`.

use super::{
    contact::{MAX_PICTURES, caption, contact_sheet},
    content::{Content, content, draft_surface},
    evenly,
    files::{ShownFile, ShownFiles},
    looped::shrunk_loop,
    settings::{ParticleLook, PreviewParams},
    stage::Stage,
};
use crate::{
    cache::{self, FrameInfo},
    control::printable_path,
    frame::{FrameIndex, StreamKind},
    image::{
        Canvas,
        render::{LeftOut, PICTURE_VERSION, picture_memory, render},
    },
    job::{
        Control, Failure, Manifest, OutputFiles, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameFiles, FrameOutcome, Ledger, ProductFolder,
            RequestedFrame, Source, Written, await_frame, state_key,
        },
        file_records::{FileRecord, FileRecords},
        memory::BASE_MEMORY,
        nonzero,
    },
    mesh::SURFACE_VERSION,
    product::{
        colliders::COLLIDER_VERSION,
        interface::Product,
        request::{ProductRequest, ProductSettings},
        sheet_mesh::SHEET_VERSION,
        surface::memory::{max_surface_memory, stream_memory},
    },
};
use std::{collections::BTreeSet, io, path::Path, time::Instant};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change gives the same frame another picture, but for changes of the renderer.
const PREVIEW_VERSION: u32 = 3;

/// What manifests call a picture.
const KIND: &str = "preview";

/// Longer side of the pictures of contact sheet and loop, at most [pixels].
const SMALL_SIDE: usize = 480;

/// Pictures of a loop at most.
const MAX_LOOP_FRAMES: usize = 48;

/// Memory of a particle as it is read and shown [bytes].
const PARTICLE_BYTES: f64 = 160.0;

/// Memory of a pixel of a loop: the picture, and its copy while it is written [bytes].
const LOOP_BYTES: usize = 6;

/// Pictures of frames, as jobs see them.
pub(in crate::product) struct Preview;

impl ProductFolder for Preview {
    fn name(&self) -> &'static str {
        "preview"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} files written ({mib:.1} MiB), {kept} up to date")
    }
}

impl Product for Preview {
    fn verb(&self) -> &'static str {
        "preview"
    }

    fn input(&self) -> &'static str {
        "particles, sheets, smoke or rigid bodies"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        use StreamKind::{MeshPoints, Particles, RigidBodies, Tracers};
        matches!(kind, Particles | Tracers | MeshPoints | RigidBodies)
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.preview.is_some()
    }

    fn arguments(&self, _: &ProductSettings) -> Vec<String> {
        Vec::new()
    }

    /// Contact sheet and loop have several frames.
    fn is_per_frame(&self) -> bool {
        false
    }

    fn is_of_selected_frames(&self) -> bool {
        true
    }

    fn max_memory(&self, settings: &ProductSettings, kind: StreamKind, entries: usize) -> f64 {
        let size = settings.preview.as_ref().map_or([0; 2], |params| params.size);
        let shown = entries as f64 * PARTICLE_BYTES + picture_memory(size, entries as u64) as f64;
        let surface =
            if kind == StreamKind::Particles { max_surface_memory(entries, &draft_surface()) } else { 0 };
        BASE_MEMORY + shown + surface as f64
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let (Source::Cache(shot), Some(params)) = (request.frames()?, &request.settings.preview) else {
            return Err(RunError::Request(
                "previews are made of a shot folder alone; `meniscus mesh` makes a shot folder of particle files".into(),
            ));
        };
        let source = Source::Cache(shot);
        let follows = request.batch.follow.is_some();
        let selected = match params.frames {
            true => source.frames(request.batch.selection.as_ref())?,
            false => Vec::new(),
        };
        // Frames that are still simulated have the files that they will have.
        let awaited = |(index, path): RequestedFrame| {
            let path = path.or_else(|| follows.then(|| cache::frame_path(&shot.cache(), index)));
            (index, path)
        };
        let selected: Vec<RequestedFrame> = selected.into_iter().map(awaited).collect();
        let (title, fps) = source.title(request.out, request.batch.fps)?;
        let mut writer = Writer::new(request, params, shot, &title, fps)?;
        let mut ledger = Ledger::new(request.out, self, control)?;
        let looped = looped_frames(&writer.present).len();
        control.reporter.begin(self.name(), selected.len() + looped);
        let mut failed = BTreeSet::new();
        let mut ended = writer.frames(&selected, source.absent(), &mut failed, &mut ledger, control);
        if ended.is_ok() {
            // What was followed has more frames now, which the camera of loop and contact sheet shows.
            if follows {
                writer = Writer::new(request, params, shot, &title, fps)?;
            }
            ended = writer.small(selected.len(), &failed, &mut ledger, control);
        }
        if ended.is_ok() {
            control.reporter.end();
        }
        let shown = looped_frames(&writer.present);
        let mut numbers: Vec<u32> = selected.iter().chain(&shown).map(|(index, _)| index.0).collect();
        numbers.sort_unstable();
        numbers.dedup();
        ledger.finish(&title, fps, &numbers, ended, control)
    }
}

/// Every nth of the frames, the first among them, so that they are at most [`MAX_LOOP_FRAMES`].
fn looped_frames(frames: &[RequestedFrame]) -> Vec<RequestedFrame> {
    let step = frames.len().div_ceil(MAX_LOOP_FRAMES).max(1);
    frames.iter().step_by(step).cloned().collect()
}

/// Writes the pictures of a shot.
struct Writer<'a> {
    shot: &'a ShotFolder,
    files: ShownFiles<'a>,
    keys: Option<cache::FrameKeys>,
    records: FileRecords,
    out: &'a ShotFolder,
    batch: &'a BatchRequest,
    stage: Stage,
    params: &'a PreviewParams,
    title: &'a str,
    fps: f64,
    /// Frames that are in the cache.
    present: Vec<RequestedFrame>,
}

/// A frame that is there, with the files made of it.
struct Shown {
    info: FrameInfo,
    files: Vec<ShownFile>,
    /// Identifies its picture, but for the size.
    text: String,
}

impl Shown {
    /// The simulated state that its picture shows.
    fn state(&self) -> Option<u64> {
        let stream = self.info.streams.first()?;
        Some(state_key(self.info.key, self.info.index, &stream.name))
    }
}

/// A file of several frames.
struct SequenceFile {
    output: OutputFiles,
    key: u64,
    /// The states of its frames.
    states: Vec<Option<u64>>,
    numbers: Vec<u32>,
    /// Whether it is up to date.
    is_kept: bool,
}

/// A picture of a frame.
struct Drawn {
    picture: Canvas,
    made_of: Vec<String>,
    notes: Vec<String>,
    /// Whether a file that it should show could not be read.
    is_incomplete: bool,
}

impl<'a> Writer<'a> {
    /// Prepares the pictures of a shot as far as it is simulated.
    ///
    /// # Errors
    /// If it has no frames, or nothing to show; if a list of files cannot be read.
    fn new(
        request: &ProductRequest<'a>,
        params: &'a PreviewParams,
        shot: &'a ShotFolder,
        title: &'a str,
        fps: f64,
    ) -> Result<Self, RunError> {
        let source = Source::Cache(shot);
        let present = source.frames(None)?;
        if present.is_empty() {
            return Err(RunError::Request("no frames in this cache; simulate the shot first".into()));
        }
        let manifest = Manifest::read(shot)?;
        let camera = manifest.as_ref().and_then(|manifest| manifest.camera);
        let (out, batch) = (request.out, request.batch);
        let stage = Stage::new(request.scene, camera, &present, params, batch.max_memory)?;
        let files = ShownFiles::of(shot, manifest.as_ref())?;
        let (keys, records) = (source.keys()?, FileRecords::read(out, Preview.name())?);
        Ok(Self { shot, files, keys, records, out, batch, stage, params, title, fps, present })
    }

    /// What decides the picture of a frame.
    fn shown(&self, path: &Path) -> Result<Shown, RunError> {
        let info = cache::read_header(path)?;
        if let Some(keys) = &self.keys {
            keys.expect(&info, path)?;
        }
        let files = match self.stage.particles {
            // Points of other products would hide particles.
            ParticleLook::Speed => Vec::new(),
            ParticleLook::Surface => self.files.of_frame(&info),
        };
        let sums: Vec<&str> = files.iter().map(|file| file.checksum.as_str()).collect();
        let (key, index, stage) = (info.key, info.index, &self.stage.text);
        let versions = [PREVIEW_VERSION, PICTURE_VERSION, SURFACE_VERSION, SHEET_VERSION, COLLIDER_VERSION];
        let text = format!("picture {versions:?} {key:016x} {index} {sums:?} {stage}");
        Ok(Shown { info, files, text })
    }

    /// Draws a frame.
    fn draw(
        &self,
        path: &Path,
        shown: &Shown,
        size: [usize; 2],
        control: Control,
    ) -> Result<Drawn, RunError> {
        let (frame, _) = cache::read_frame_within(path, self.batch.max_memory)?;
        let estimate = |enough: u64| {
            let entries: usize = frame.streams.iter().map(crate::frame::Stream::len).sum();
            let meshed = frame.streams.iter().filter(|stream| stream.kind == StreamKind::Particles);
            let meshed = meshed.filter_map(|stream| {
                Some(stream_memory(stream, stream.spacing()?, &draft_surface(), enough))
            });
            let held = entries as f64 * PARTICLE_BYTES + BASE_MEMORY;
            let files: u64 = shown.files.iter().map(ShownFile::memory).sum();
            // Pictures of the loop are held until it is written.
            let [width, height] = self.small_size();
            let pictures =
                if size == [width, height] { MAX_LOOP_FRAMES * width * height * LOOP_BYTES } else { 0 };
            let others = files + self.stage.props.memory() + pictures as u64;
            meshed.max().unwrap_or(0) + others + held as u64 + picture_memory(size, entries as u64)
        };
        self.batch.check_memory(None, estimate)?;
        let (cancel, max_memory) = (control.cancel, self.batch.max_memory);
        let made = content(&self.stage, &frame, &self.files, &shown.files, max_memory, cancel)?;
        let Content { model, made_of, mut notes, is_incomplete } = made;
        let (mut picture, left_out) = render(&model, &self.stage.view, size, cancel);
        if cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        caption(&mut picture, &self.stage, (frame.index, frame.time), self.fps);
        notes.extend(remark(left_out));
        Ok(Drawn { picture, made_of, notes, is_incomplete })
    }

    /// Writes the picture of each frame that is not up to date, and adds the numbers of those that failed to `failed`.
    fn frames(
        &self,
        frames: &[RequestedFrame],
        absent: &str,
        failed: &mut BTreeSet<FrameIndex>,
        ledger: &mut Ledger<'_>,
        control: Control,
    ) -> Result<(), RunError> {
        for (place, (index, path)) in frames.iter().enumerate() {
            if control.cancel.is_cancelled() {
                return Err(RunError::Interrupted);
            }
            if let Some(limit) = self.batch.follow {
                await_frame(self.shot, *index, limit, control)?;
            }
            let mut outcome = FrameOutcome::new(*index);
            match path {
                None => outcome.fail(absent.into(), Failure::Other),
                Some(path) => match self.frame(path, &mut outcome, control) {
                    Ok(()) => {}
                    Err(why) => fail(&mut outcome, path, why)?,
                },
            }
            outcome.record(self.out, Preview.name(), control)?;
            if outcome.has_failed() {
                failed.insert(*index);
            }
            ledger.add_frame(outcome, control);
            control.reporter.progress((place + 1) as f64);
        }
        Ok(())
    }

    fn frame(&self, path: &Path, outcome: &mut FrameOutcome, control: Control) -> Result<(), RunError> {
        let start = Instant::now();
        let shown = self.shown(path)?;
        let size = self.params.size;
        let key = xxh3_64(format!("{size:?} {}", shown.text).as_bytes());
        let mut target = FileTarget { index: outcome.index, name: "frame".into(), key, state: shown.state() };
        let output = OutputFiles::of(KIND, Preview.name(), &target.name, "png", target.index);
        let kept = FrameFiles { outputs: vec![output.clone()], written: None, stale: Vec::new() };
        if !self.batch.force && kept.are_recorded(self.out, &self.records, &target) {
            outcome.files.push(kept);
            if self.params.shows_kept {
                control.reporter.picture(&self.draw(path, &shown, size, control)?.picture);
            }
            return Ok(());
        }
        let Drawn { picture, made_of, notes, is_incomplete } = self.draw(path, &shown, size, control)?;
        // Another key, so that it is drawn again.
        target.key = if is_incomplete { !key } else { key };
        let index = outcome.index;
        outcome.notes.extend(notes.into_iter().map(|note| format!("frame {index}: {note}")));
        control.reporter.picture(&picture);
        let path = output.file(self.out, index.0);
        let file = picture.save(&path).map_err(|source| not_written(&path, source))?;
        let mut written = Written::of(&target);
        written.add(&output, file);
        let (seconds, made_of) = (start.elapsed().as_secs_f64(), made_of.join(", "));
        written.figures = format!("frame {index}  {made_of}  {seconds:.2} s");
        outcome.files.push(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() });
        Ok(())
    }

    /// Writes contact sheet and loop of the shot, unless they are up to date. Frames in `failed` are reported already.
    fn small(
        &self,
        done: usize,
        failed: &BTreeSet<FrameIndex>,
        ledger: &mut Ledger<'_>,
        control: Control,
    ) -> Result<(), RunError> {
        let frames = looped_frames(&self.present);
        let mut all = Vec::new();
        for (index, path) in &frames {
            let Some(path) = path else { continue };
            match self.shown(path) {
                Ok(found) => all.push((path.as_path(), found)),
                Err(why) => fail_once(*index, path, why, failed, ledger, control)?,
            }
        }
        let places = evenly(all.len(), MAX_PICTURES);
        let contact = self.sequence("contact", "png", places.iter().map(|&place| &all[place].1));
        let looped = self.sequence("loop", "webp", all.iter().map(|(_, shown)| shown));
        let (Some(contact), Some(looped)) = (contact, looped) else { return Ok(()) };
        let (is_loop_kept, is_contact_kept) = (looped.is_kept, contact.is_kept);
        // A caller that shows pictures of what is kept sees those of the contact sheet.
        let is_contact_drawn = !is_contact_kept || self.params.shows_kept && !self.params.frames;
        let is_drawn = |place: usize| !is_loop_kept || is_contact_drawn && places.contains(&place);
        let (mut drawn, mut incomplete): (Vec<(usize, Canvas)>, _) = (Vec::new(), BTreeSet::new());
        for (place, (path, shown)) in all.iter().enumerate().filter(|(place, _)| is_drawn(*place)) {
            match self.draw(path, shown, self.small_size(), control) {
                Ok(made) => {
                    for note in made.notes {
                        control.reporter.note(&format!("frame {}: {note}", shown.info.index));
                    }
                    if !self.params.frames {
                        control.reporter.picture(&made.picture);
                    }
                    if made.is_incomplete {
                        incomplete.insert(shown.info.index.0);
                    }
                    drawn.push((place, made.picture));
                }
                Err(why) => fail_once(shown.info.index, path, why, failed, ledger, control)?,
            }
            control.reporter.progress((done + place + 1) as f64);
        }
        let number = |place: usize| all[place].1.info.index.0;
        let of_contact = drawn.iter().filter(|(place, _)| places.contains(place));
        let pictures: Vec<&Canvas> = of_contact.clone().map(|(_, picture)| picture).collect();
        let numbers: Vec<u32> = of_contact.map(|&(place, _)| number(place)).collect();
        let page = || contact_sheet(self.title, &pictures).png();
        self.write_sequence(contact, (&numbers, &incomplete), page, ledger, control)?;
        let numbers: Vec<u32> = drawn.iter().map(|&(place, _)| number(place)).collect();
        let mut shown = numbers.clone();
        let pictures: Vec<Canvas> = drawn.into_iter().map(|(_, picture)| picture).collect();
        let animation = || {
            let (bytes, kept) = shrunk_loop(&pictures, &numbers, self.fps)?;
            shown = kept;
            Ok(bytes)
        };
        self.write_sequence(looped, (&numbers, &incomplete), animation, ledger, control)?;
        if !is_loop_kept && shown.len() < self.present.len() && !shown.is_empty() {
            let [width, height] = self.small_size();
            control.reporter.note(&format!(
                "the loop shows {} of {} frames, {width}x{height} pixels; --frames draws every frame in full size",
                shown.len(),
                self.present.len()
            ));
        }
        Ok(())
    }

    /// A file of these frames, and whether it is up to date; `None` without a frame.
    fn sequence<'b>(
        &self,
        name: &str,
        format: &str,
        frames: impl Iterator<Item = &'b Shown>,
    ) -> Option<SequenceFile> {
        let (texts, numbers, states): (Vec<&str>, Vec<u32>, Vec<Option<u64>>) =
            frames.map(|shown| (shown.text.as_str(), shown.info.index.0, shown.state())).collect();
        let first = FrameIndex(*numbers.first()?);
        let (size, title, fps) = (self.small_size(), self.title, self.fps);
        let key = xxh3_64(format!("{name} {size:?} {title:?} {fps} {texts:?}").as_bytes());
        let pattern = format!("{}/{name}.{format}", Preview.name());
        let output = OutputFiles::of(KIND, Preview.name(), name, format, first);
        let is_kept =
            !self.batch.force && self.records.confirm(self.out, std::slice::from_ref(&pattern), key);
        Some(SequenceFile { output: OutputFiles { pattern, ..output }, key, states, numbers, is_kept })
    }

    /// Writes a file of frames, some of them perhaps incomplete, unless it is up to date or there is none.
    fn write_sequence(
        &self,
        file: SequenceFile,
        (numbers, incomplete): (&[u32], &BTreeSet<u32>),
        bytes: impl FnOnce() -> io::Result<Vec<u8>>,
        ledger: &mut Ledger<'_>,
        control: Control,
    ) -> Result<(), RunError> {
        let SequenceFile { output, key, states, numbers: all, is_kept } = file;
        if is_kept {
            return ledger.add_sequence(output, &all, None, control);
        }
        let Some(&first) = numbers.first() else { return Ok(()) };
        let path = self.out.root().join(&output.pattern);
        let written = bytes().and_then(|bytes| cache::write_atomically(&path, |out| out.write_all(&bytes)));
        let written = written.map_err(|source| not_written(&path, source))?;
        // A file without some frame, or with an incomplete one, has another key, so that it is made again.
        let is_whole = numbers == all && numbers.iter().all(|number| !incomplete.contains(number));
        let key = if is_whole { key } else { !key };
        let state = all.iter().zip(states).find(|(number, _)| **number == first).and_then(|(_, state)| state);
        let mut record = FileRecord::new(FrameIndex(first), &output.name, key, state);
        record.add(output.pattern.clone(), written);
        ledger.add_sequence(output, numbers, Some(&record), control)
    }

    /// The size of pictures in contact sheet and loop [pixels], of the shape of the others.
    fn small_size(&self) -> [usize; 2] {
        small_size(self.params.size)
    }
}

/// The size of pictures of contact sheet and loop for pictures of frames of `size` [pixels].
fn small_size([width, height]: [usize; 2]) -> [usize; 2] {
    let longest = width.max(height);
    let small = SMALL_SIDE.min(longest);
    [width, height].map(|side| (side * small / longest).max(1))
}

/// Records why there is no picture of a frame.
///
/// # Errors
/// What ends the batch.
fn fail(outcome: &mut FrameOutcome, path: &Path, why: RunError) -> Result<(), RunError> {
    match why {
        RunError::Cache(why) => outcome.fail(why.to_string(), Failure::of(&why)),
        RunError::Import(why) => outcome.fail(why.to_string(), Failure::Other),
        why @ RunError::OverMemory { .. } => {
            outcome.fail(format!("{}: {why}", printable_path(path)), Failure::Memory);
        }
        why => return Err(why),
    }
    Ok(())
}

/// Records why a frame is not in contact sheet and loop, unless it is in `failed`.
///
/// # Errors
/// What ends the batch.
fn fail_once(
    index: FrameIndex,
    path: &Path,
    why: RunError,
    failed: &BTreeSet<FrameIndex>,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<(), RunError> {
    let mut outcome = FrameOutcome::new(index);
    fail(&mut outcome, path, why)?;
    if !failed.contains(&index) {
        ledger.add_frame(outcome, control);
    }
    Ok(())
}

fn not_written(path: &Path, source: std::io::Error) -> RunError {
    RunError::File {
        path: path.into(),
        source,
        next: "check that the folder can be written and the disk has free space",
    }
}

/// What a picture left out.
fn remark(left_out: LeftOut) -> Option<String> {
    let counts = nonzero(&[
        (left_out.triangles, "triangles left out, without finite places or with corners that do not exist"),
        (left_out.points, "points left out, without a finite place"),
        (left_out.at_camera, "points left out, around the camera or next to it"),
    ]);
    (!counts.is_empty()).then(|| counts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pictures_of_loops_are_evenly_chosen() {
        assert_eq!(evenly(100, 12), [0, 9, 18, 27, 36, 45, 54, 63, 72, 81, 90, 99]);
        assert_eq!((evenly(3, 12), evenly(1, 12), evenly(0, 12)), (vec![0, 1, 2], vec![0], vec![]));
        let frames: Vec<RequestedFrame> = (1..=100).map(|number| (FrameIndex(number), None)).collect();
        let chosen: Vec<u32> = looped_frames(&frames).iter().map(|(index, _)| index.0).collect();
        assert_eq!((chosen.len(), chosen[0], chosen[33]), (34, 1, 100));
    }

    #[test]
    fn small_pictures_are_bounded_on_both_sides() {
        let sizes = [[960, 540], [1080, 1920], [64, 36], [16, 4096]].map(small_size);
        assert_eq!(sizes, [[480, 270], [270, 480], [64, 36], [1, 480]]);
    }
}
