//! Whitewater, as jobs see it.

use super::{
    chain::{Chain, LIQUID_BYTES, PARTICLE_BYTES},
    folder::WhitewaterPoints,
    log,
    points::FileSettings,
};
use crate::{
    cache::CacheError,
    frame::{FrameIndex, StreamKind},
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{BatchSummary, FrameOutcome, Ledger, ProductFolder, Source},
        file_records::FileRecords,
        memory::BASE_MEMORY,
        nonzero,
    },
    preset::{check::Places, problem::Finding},
    product::{
        interface::Product,
        request::{ProductInfo, ProductRequest, ProductSettings},
    },
    sim::{
        scene::Scene,
        whitewater::{Whitewater, WhitewaterFormat},
    },
};
use std::time::Instant;

impl Product for WhitewaterPoints {
    fn verb(&self) -> &'static str {
        "whitewater"
    }

    fn input(&self) -> &'static str {
        "particles"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::Particles
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.whitewater.is_some()
    }

    fn arguments(&self, _: &ProductSettings) -> Vec<String> {
        Vec::new()
    }

    /// Each frame follows from the one before.
    fn is_per_frame(&self) -> bool {
        false
    }

    fn uses_solids(&self, _: &ProductSettings) -> bool {
        true
    }

    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        Some(("whitewater", "[whitewater]"))
    }

    fn check(
        &self,
        settings: &ProductSettings,
        _: &[StreamKind],
        places: &Places,
        findings: &mut Vec<Finding>,
    ) {
        let Some(params) = &settings.whitewater else { return };
        if let Some((key, [min, max])) = params.bad_range() {
            let path = format!("whitewater.{key}");
            let label = format!(
                "found {min} and {max}, expected two numbers from 0 to 10000, of which the second is larger by 0.001 or more"
            );
            let message = format!("`{path}` is no range");
            findings.push(
                Finding::new(places.of(&path), &path, message, label)
                    .with_help("the first value emits nothing, the second emits at the full rate"),
            );
        }
        if params.files.is_empty()
            || params.files.iter().enumerate().any(|(i, f)| params.files[..i].contains(f))
        {
            let path = "whitewater.files";
            let label = "expected one or more of \"ply\", \"vdb\" and \"npz\", each once";
            let message = "`whitewater.files` names no file, or one twice";
            findings.push(
                Finding::new(places.of(path), path, message, label)
                    .with_help("remove `[whitewater]` for a shot without whitewater"),
            );
        }
        if cfg!(not(feature = "npz")) && params.files.contains(&WhitewaterFormat::Npz) {
            let path = "whitewater.files";
            let label = "found \"npz\", which this build lacks";
            findings.push(
                Finding::new(places.of(path), path, "this build writes no NPZ files", label)
                    .with_help("build it with the feature `npz`, or write \"ply\""),
            );
        }
        if params.max_amount.is_some_and(|most| most < params.amount) {
            let path = "whitewater.max_amount";
            let label =
                format!("found less than `amount`, which is {}, expected at least as much", params.amount);
            findings.push(
                Finding::new(places.of(path), path, "`amount` is above `max_amount`", label)
                    .with_help("raise `max_amount`, or leave it out"),
            );
        }
    }

    fn max_memory(&self, settings: &ProductSettings, _: StreamKind, particles: usize) -> f64 {
        let limit = settings.whitewater.as_ref().map_or(0, |params| params.max_particles);
        // Shots that were looked at have at most twenty times the particles of their liquid.
        let emitted = f64::from(limit).min(20.0 * particles as f64);
        BASE_MEMORY + emitted * PARTICLE_BYTES + particles as f64 * LIQUID_BYTES
    }

    fn info(&self, folder: &ShotFolder) -> Result<ProductInfo, RunError> {
        log::info(folder)
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let (Source::Cache(shot), Some(scene)) = (request.frames()?, request.scene) else {
            return Err(RunError::Request("whitewater is made of the shot folder of a liquid alone".into()));
        };
        let Some(params) = &request.settings.whitewater else {
            return Err(RunError::Request(
                "found no parameters of whitewater, expected `[whitewater]`".into(),
            ));
        };
        let records = &FileRecords::read(request.out, self.name())?;
        let settings =
            FileSettings { params, volume: &request.settings.volume, request: request.batch, records };
        whitewater(scene, settings, shot, request.out, control)
    }
}

/// Writes the whitewater of the liquid cached in `shot` to `out`. Files that were made of the same frames with the same parameters are
/// kept, unless the request forces them; of what is missing in between, frames are computed and stored.
///
/// # Errors
/// A frame that cannot be read or written makes all later ones fail, which are reported together at the end
/// ([`RunError::SomeFailed`]); [`RunError::Request`] if the preset is not the one that was simulated; a full disk ends the batch.
fn whitewater(
    scene: &Scene,
    settings: FileSettings,
    shot: &ShotFolder,
    out: &ShotFolder,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let FileSettings { params, request, .. } = settings;
    let source = Source::Cache(shot);
    if source.keys()?.is_some_and(|keys| keys != scene.frame_keys()) {
        return Err(RunError::Request(format!(
            "{}: found other settings than those of the cached frames, expected the liquid that was simulated; restore the file, or \
             simulate the shot again",
            shot.preset().display()
        )));
    }
    let requested: Vec<u32> =
        source.frames(request.selection.as_ref())?.into_iter().map(|(index, _)| index.0).collect();
    let Some(&last) = requested.last() else {
        return Err(RunError::Request("no frames in this cache; simulate the shot first".into()));
    };
    let (title, fps) = source.title(out, request.fps)?;
    let mut ledger = Ledger::new(out, &WhitewaterPoints, control)?;
    let folder = out.subfolder(WhitewaterPoints.name());
    let chain = Chain::new(scene, params, shot, folder, FrameIndex(last), request)?;
    let mut writer = Writer { chain, settings, out, force: request.force };
    let ended = writer.frames(&requested, source.absent(), &mut ledger, control);
    ledger.finish(&title, fps, &requested, ended, control)
}

/// Writes the files of a chain of frames.
struct Writer<'a> {
    chain: Chain<'a>,
    settings: FileSettings<'a>,
    out: &'a ShotFolder,
    force: bool,
}

impl Writer<'_> {
    /// Writes the `requested` frames, and computes those that they follow from.
    fn frames(
        &mut self,
        requested: &[u32],
        absent: &str,
        ledger: &mut Ledger<'_>,
        control: Control,
    ) -> Result<(), RunError> {
        let numbers: Vec<u32> = self.chain.frames().iter().map(|(index, _)| index.0).collect();
        for &missing in requested.iter().filter(|number| numbers.binary_search(number).is_err()) {
            let mut outcome = FrameOutcome::new(FrameIndex(missing));
            outcome.fail(absent.into(), Failure::Other);
            ledger.add_frame(outcome, control);
        }
        control.reporter.begin(WhitewaterPoints.name(), numbers.len());
        let mut failed = None;
        for (place, &number) in numbers.iter().enumerate() {
            let is_requested = requested.binary_search(&number).is_ok();
            let mut outcome = FrameOutcome::new(FrameIndex(number));
            match (&failed, self.frame(place, is_requested, &mut outcome, control)) {
                (_, Ok(())) => {}
                (_, Err(RunError::Cache(why))) if !matches!(why, CacheError::Full { .. }) => {
                    failed = Some(number);
                    outcome.fail(why.to_string(), Failure::of(&why));
                }
                (_, Err(why @ RunError::OverMemory { .. })) => {
                    failed = Some(number);
                    outcome.fail(why.to_string(), Failure::Memory);
                }
                (_, Err(why)) => return Err(why),
            }
            outcome.record(self.out, WhitewaterPoints.name(), control)?;
            ledger.add_frame(outcome, control);
            if let Some(first) = failed {
                for &later in requested.iter().filter(|&&later| later > number && numbers.contains(&later)) {
                    let mut outcome = FrameOutcome::new(FrameIndex(later));
                    outcome.fail(format!("it follows from frame {}", FrameIndex(first)), Failure::Other);
                    ledger.add_frame(outcome, control);
                }
                break;
            }
            control.reporter.progress((place + 1) as f64);
        }
        control.reporter.end();
        Ok(())
    }

    /// Computes the frame at `place` unless it is stored, and writes its file if it is requested and not up to date.
    fn frame(
        &mut self,
        place: usize,
        is_requested: bool,
        outcome: &mut FrameOutcome,
        control: Control,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let state = self.chain.state(place);
        let known = state.as_ref().map_or(None, |state| *state);
        let target = self.settings.target(outcome.index, self.chain.key(place), known);
        let kept = || self.settings.up_to_date(self.out, &target);
        if !self.force && self.chain.is_stored(place) {
            if !is_requested {
                return Ok(());
            }
            if let Some(files) = kept() {
                outcome.files.push(files);
                return Ok(());
            }
        }
        let frame = self.chain.frame(place, self.force, control)?;
        if frame.is_new {
            outcome.notes.extend(remark(outcome.index, frame.whitewater));
        }
        if is_requested {
            // Of files whose record has no state it would never show that they are stale.
            state?;
            let (files, too_far) = self.settings.write(&frame, self.out, &target, start)?;
            outcome.files.push(files);
            if too_far > 0 {
                let index = outcome.index;
                outcome
                    .notes
                    .push(format!("frame {index}: {too_far} particles too far away for the volume's voxel"));
            }
        }
        Ok(())
    }
}

/// What was left out of a frame.
fn remark(index: FrameIndex, whitewater: &Whitewater) -> Option<String> {
    let record = &whitewater.record;
    let counts = nonzero(&[
        (record.over_limit, "particles not emitted, above `whitewater.max_particles`"),
        (record.stuck, "particles removed between solids"),
        (
            record.left_out,
            "particles of the liquid left out, without a finite place or with the id of another",
        ),
    ]);
    (!counts.is_empty()).then(|| format!("frame {index}: {}", counts.join(", ")))
}
