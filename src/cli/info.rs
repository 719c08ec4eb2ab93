//! `meniscus info` and `meniscus verify`.

use super::{args::InfoArgs, output::print};
use crate::run::{self, FailedFrame, FrameState, Info, RunError, ShotFolder};

/// Lists what is in a shot folder; `whole` reads every frame to its last byte.
pub(super) fn info(args: &InfoArgs, whole: bool) -> Result<(), RunError> {
    let info = run::info(&ShotFolder::around(&args.folder), whole)?;
    if args.json {
        print(&serde_json::to_string_pretty(&info).expect("facts are plain data"))?;
    } else {
        print(&describe(&info, whole))?;
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

/// What people read.
fn describe(info: &Info, whole: bool) -> String {
    let sound: Vec<&FrameState> = info.frames.iter().filter(|frame| frame.fault.is_none()).collect();
    let bytes: u64 = sound.iter().map(|frame| frame.bytes).sum();
    let mut lines = vec![info.title.clone()];
    lines.push(format!(
        "frames     {} {}, {} missing{}{}",
        sound.len(),
        if whole { "verified" } else { "present" },
        info.missing_count,
        match info.missing.len() {
            0 => String::new(),
            all if all as u64 == info.missing_count => format!(" ({})", ranges(&info.missing)),
            _ => format!(" ({},…)", ranges(&info.missing)),
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
        lines.push(format!(
            "{:<10} {} {} files, {} missing: {}",
            output.kind, output.present, output.format, output.missing, output.pattern
        ));
    }
    lines.extend(info.product_lines.iter().cloned());
    lines.join("\n")
}

/// Ascending frame numbers as `--frames` takes them: `3,5-9`.
fn ranges(frames: &[u32]) -> String {
    let runs = frames.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run[0].to_string(),
    });
    runs.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_are_listed_as_ranges() {
        assert_eq!(ranges(&[1, 3, 4, 5, 9, 10]), "1,3-5,9-10");
        assert_eq!(ranges(&[]), "");
    }
}
