//! What a report shows of a shot folder.

use super::plot::{Plot, Series};
use crate::{
    cache,
    control::{printable, printable_path, shell_path},
    frame::FrameIndex,
    job::{
        Manifest, RunError, ShotFolder,
        file_records::{FileRecords, FileState},
        log::{self, LogLine},
    },
    product,
    run::{
        info::{Info, frame_ranges, info},
        recorded_scene,
        verify::requested_frames,
    },
    sim::{FrameRecord, registry},
};
use std::collections::BTreeMap;

/// Warnings that a report lists.
const MAX_WARNINGS: usize = 100;

/// Passes with a line of their own; the others are one line.
const MAX_PASSES: usize = 7;

/// The sub-folder of previews.
pub(super) const FOLDER: &str = "preview";

/// The report, which does not list itself.
pub(super) const FILE: &str = "preview/report.html";

/// Bytes of a mebibyte.
const MIB: f64 = (1 << 20) as f64;

/// The loop that a report shows, as far as it is not longer than this [bytes].
const MAX_LOOP: u64 = 32 << 20;

/// What a report shows.
pub(super) struct Figures {
    pub(super) title: String,
    pub(super) subtitle: String,
    /// The loop as a WebP file.
    pub(super) looped: Option<Vec<u8>>,
    pub(super) warnings: Vec<String>,
    pub(super) plots: Vec<Plot>,
    /// Frames of the longest series.
    pub(super) longest: usize,
    pub(super) summary: Vec<String>,
    /// Kind, format, number and pattern of files.
    pub(super) files: Vec<Vec<String>>,
    /// The command that makes the shot again.
    pub(super) command: String,
    /// The preset with every default.
    pub(super) settings: String,
}

/// A log in the order of its frames.
type Log = BTreeMap<FrameIndex, LogLine<FrameRecord>>;

impl Figures {
    /// What is known of a shot, whose previews are in `out`.
    ///
    /// # Errors
    /// If there is neither a cache nor a manifest, or a list of files cannot be read.
    pub(super) fn of(shot: &ShotFolder, out: &ShotFolder) -> Result<Self, RunError> {
        let info = info(shot)?;
        let manifest = Manifest::read(shot)?;
        let log = log::read::<FrameRecord>(shot)?;
        let settings = cache::read_text(&shot.preset())
            .unwrap_or_else(|why| format!("{} cannot be read: {why}", printable_path(&shot.preset())));
        let present: Vec<u32> = info.frames.iter().map(|frame| frame.frame).collect();
        let mut plots = system_plots(&log);
        plots.push(seconds(&log));
        plots.push(disk(shot, out, &info)?);
        plots.push(memory(shot, &info));
        let longest = plots.iter().flat_map(|plot| &plot.series).map(|series| series.points.len()).max();
        let frames = manifest.as_ref().map(requested_frames).unwrap_or_default();
        let frames: Vec<u32> = frames.into_iter().collect();
        let preset = shell_path(&shot.preset());
        let command = match frames.is_empty() {
            true => format!("meniscus shot {preset} -o NEW_FOLDER"),
            false => format!("meniscus shot {preset} -o NEW_FOLDER --frames {}", frame_ranges(&frames)),
        };
        let last = info.frames.iter().rev().find(|frame| frame.fault.is_none());
        let particles = last.map(|last| format!(" · {} particles in frame {}", last.particles, last.frame));
        let subtitle = format!(
            "{} frames ({}) at {} fps{} · Meniscus {}",
            present.len(),
            frame_ranges(&present),
            info.fps,
            particles.unwrap_or_default(),
            env!("CARGO_PKG_VERSION"),
        );
        Ok(Self {
            title: info.title.clone(),
            subtitle,
            looped: looped(out)?,
            warnings: warnings(shot, &log, &info),
            plots,
            longest: longest.unwrap_or(0),
            summary: info.total_lines().chain(info.product_lines.iter().cloned()).collect(),
            files: files(&info),
            command,
            settings,
        })
    }
}

/// The figures that systems plot, with those of the same title in one plot.
fn system_plots(log: &Log) -> Vec<Plot> {
    let mut plots: Vec<Plot> = Vec::new();
    for line in log.values() {
        for figure in registry::ALL.iter().flat_map(|system| system.plotted(&line.record)) {
            let plot = match plots.iter().position(|plot| plot.title == figure.plot) {
                Some(place) => &mut plots[place],
                None => {
                    let (title, unit) = (figure.plot.to_owned(), figure.unit.to_owned());
                    plots.push(Plot { title, unit, series: Vec::new() });
                    plots.last_mut().expect("one was added")
                }
            };
            add(&mut plot.series, figure.series, line.frame, figure.value);
        }
    }
    plots
}

/// Adds a point to the series of a name.
fn add(series: &mut Vec<Series>, name: &str, frame: FrameIndex, value: f64) {
    match series.iter_mut().find(|series| series.name == name) {
        Some(known) => known.points.push((frame.0, value)),
        None => series.push(Series { name: name.into(), points: vec![(frame.0, value)] }),
    }
}

/// Wall-clock time of the passes that take longest, of all others, and of all.
fn seconds(log: &Log) -> Plot {
    let mut sums: BTreeMap<&str, f64> = BTreeMap::new();
    for (pass, seconds) in log.values().flat_map(|line| &line.record.seconds) {
        *sums.entry(pass.as_ref()).or_default() += seconds.max(0.0);
    }
    let mut passes: Vec<(&str, f64)> = sums.into_iter().collect();
    passes.sort_by(|a, b| b.1.total_cmp(&a.1));
    let named: Vec<&str> = passes.iter().take(MAX_PASSES - 1).map(|(pass, _)| *pass).collect();
    let mut series = Vec::new();
    for line in log.values() {
        add(&mut series, "all", line.frame, line.record.total_seconds());
        for &pass in &named {
            let own = line.record.seconds.iter().filter(|(name, _)| name.as_ref() == pass);
            add(&mut series, pass, line.frame, own.map(|(_, seconds)| seconds).sum());
        }
        if passes.len() > named.len() {
            let others = line.record.seconds.iter().filter(|(name, _)| !named.contains(&name.as_ref()));
            add(&mut series, "others", line.frame, others.map(|(_, seconds)| seconds).sum());
        }
    }
    Plot { title: "Time by pass".into(), unit: "s".into(), series }
}

/// Bytes of the files of each frame, in the cache and of each product.
fn disk(shot: &ShotFolder, out: &ShotFolder, info: &Info) -> Result<Plot, RunError> {
    let mut series = Vec::new();
    for frame in &info.frames {
        add(&mut series, "cache", FrameIndex(frame.frame), frame.bytes as f64 / MIB);
    }
    for product in product::ALL {
        let folder = if product.name() == FOLDER { out } else { shot };
        let records = FileRecords::read(folder, product.name())?;
        for (frame, bytes) in records.bytes_by_frame() {
            add(&mut series, product.name(), frame, bytes as f64 / MIB);
        }
    }
    Ok(Plot { title: "Disk".into(), unit: "MiB a frame".into(), series })
}

/// Memory of the state of each frame.
fn memory(shot: &ShotFolder, info: &Info) -> Plot {
    let mut series = Vec::new();
    for frame in info.frames.iter().filter(|frame| frame.fault.is_none()) {
        let path = cache::frame_path(&shot.cache(), FrameIndex(frame.frame));
        if let Ok(header) = cache::read_header(&path) {
            add(&mut series, "state", header.index, header.unpacked_bytes() as f64 / MIB);
        }
    }
    Plot { title: "Memory of the frame's state".into(), unit: "MiB".into(), series }
}

/// The loop of a folder, if it is as it was written.
fn looped(out: &ShotFolder) -> Result<Option<Vec<u8>>, RunError> {
    let records = FileRecords::read(out, FOLDER)?;
    let file = format!("{}/loop.webp", FOLDER);
    if records.state(out, &file) != FileState::Valid {
        return Ok(None);
    }
    let path = out.root().join(&file);
    let is_short = std::fs::metadata(&path).is_ok_and(|about| about.len() <= MAX_LOOP);
    Ok(is_short.then(|| cache::read_regular(&path).ok()).flatten())
}

/// The warnings of all frames and of the shot, and frames that cannot be read.
fn warnings(shot: &ShotFolder, log: &Log, info: &Info) -> Vec<String> {
    let mut found = Vec::new();
    match recorded_scene(shot, &[]) {
        Ok(Some(scene)) => {
            let frames: Vec<(FrameIndex, FrameRecord)> =
                log.values().map(|line| (line.frame, line.record.clone())).collect();
            found.extend(registry::ALL.iter().flat_map(|system| system.shot_warnings(&scene, &frames)));
        }
        Ok(None) => found.push("warnings of the whole shot are not known: its preset.toml is missing".into()),
        Err(why) => found.push(format!("warnings of the whole shot are not known: {why}")),
    }
    if info.missing_count > 0 {
        let listed = frame_ranges(&info.missing);
        found.push(format!("{} requested frames are missing: {listed}", info.missing_count));
    }
    found.extend(info.frames.iter().filter_map(|frame| frame.fault.clone()));
    for line in log.values() {
        let own = registry::ALL.iter().flat_map(|system| system.warnings(&line.record));
        found.extend(own.map(|warning| format!("frame {}: {warning}", line.frame)));
    }
    let more = found.len().saturating_sub(MAX_WARNINGS);
    found.truncate(MAX_WARNINGS);
    if more > 0 {
        found.push(format!("{more} more warnings, which {} has", printable(&shot.log().to_string_lossy())));
    }
    found
}

/// Kind, format, number and pattern of the outputs.
fn files(info: &Info) -> Vec<Vec<String>> {
    let row = |output: &crate::run::info::OutputInfo| {
        let count = match output.missing {
            0 => output.present.to_string(),
            missing => format!("{}, {missing} missing", output.present),
        };
        vec![output.kind.clone(), output.format.clone(), count, output.pattern.clone()]
    };
    info.outputs.iter().filter(|output| output.pattern != FILE).map(row).collect()
}
