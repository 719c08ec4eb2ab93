//! `meniscus info` and `meniscus verify`.

use super::{args::InfoArgs, output::print};
use crate::run::{
    self, FailedFrame, FrameState, Info, OutputInfo, RunError, ShotFolder, Stage, Verification, frame_ranges,
};
use std::collections::BTreeMap;

/// Lists what is in a shot folder.
pub(super) fn info(args: &InfoArgs) -> Result<(), RunError> {
    let info = run::info(&ShotFolder::around(&args.folder))?;
    if args.json {
        print(&serde_json::to_string_pretty(&info).expect("facts are plain data"));
    } else {
        print(&describe(&info));
    }
    let failed: Vec<FailedFrame> = info
        .frames
        .iter()
        .filter_map(|frame| {
            let why = frame.fault.clone()?;
            Some(FailedFrame { name: format!("frame {:04}", frame.frame), why, kind: frame.failure? })
        })
        .collect();
    match failed.is_empty() {
        true => Ok(()),
        false => Err(RunError::SomeFailed { failed, requested: info.frames.len() }),
    }
}

/// Reads every file of a shot folder, and reports what is not as it was made.
pub(super) fn verify(args: &InfoArgs) -> Result<(), RunError> {
    let found = run::verify(&ShotFolder::around(&args.folder))?;
    if args.json {
        print(&serde_json::to_string_pretty(&found).expect("facts are plain data"));
    } else {
        print(&summary(&found));
    }
    found.failed().map_or(Ok(()), Err)
}

/// How many files are valid and how many are not, a line for each stage.
fn summary(found: &Verification) -> String {
    let line = |stage: &Stage| {
        let mut others = BTreeMap::new();
        for fault in &stage.faults {
            *others.entry(fault.state.name()).or_insert(0_u64) += 1;
        }
        if stage.missing > 0 {
            others.insert("missing", stage.missing);
        }
        let others: String = others.into_iter().map(|(name, count)| format!(", {count} {name}")).collect();
        format!("{:<10} {} valid{others}: {}", stage.stage, stage.valid, stage.pattern)
    };
    [found.title.clone()].into_iter().chain(found.stages.iter().map(line)).collect::<Vec<_>>().join("\n")
}

/// What people read.
fn describe(info: &Info) -> String {
    let sound: Vec<&FrameState> = info.frames.iter().filter(|frame| frame.fault.is_none()).collect();
    let bytes: u64 = sound.iter().map(|frame| frame.bytes).sum();
    let mut lines = vec![info.title.clone()];
    lines.push(format!(
        "frames     {} present, {} missing{}{}",
        sound.len(),
        info.missing_count,
        match info.missing.len() {
            0 => String::new(),
            all if all as u64 == info.missing_count => format!(" ({})", frame_ranges(&info.missing)),
            _ => format!(" ({},…)", frame_ranges(&info.missing)),
        },
        info.span.map_or_else(String::new, |span| format!(
            ", of {}-{} at {} fps",
            span.first, span.last, info.fps
        ))
    ));
    if let Some(last) = sound.last() {
        lines.push(format!("particles  {} in frame {}", last.particles, last.frame));
    }
    lines.push(format!("cache      {:.1} MiB", bytes as f64 / f64::from(1 << 20)));
    lines.extend(info.total_lines());
    for output in &info.outputs {
        let OutputInfo { kind, format, pattern, is_per_frame, present, missing, .. } = output;
        lines.push(match (is_per_frame, present) {
            (true, _) => format!("{kind:<10} {present} {format} files, {missing} missing: {pattern}"),
            (false, 0) => format!("{kind:<10} {format} missing: {pattern}"),
            (false, frames) => format!("{kind:<10} {format} of {frames} frames: {pattern}"),
        });
    }
    lines.extend(info.product_lines.iter().cloned());
    lines.join("\n")
}
