//! The report of a shot: `preview/report.html`, one page with the loop, plots over frames, warnings, settings and the command.

mod figures;
mod page;
mod plot;

use super::{Control, Manifest, OutputFiles, RunError, ShotFolder};
use crate::{
    cache,
    frame::FrameIndex,
    job::{
        FrameSpan,
        batch::{Ledger, state_key},
        file_records::FileRecord,
    },
    product,
};
use figures::{FILE, FOLDER, Figures};
use std::path::PathBuf;
use xxhash_rust::xxh3::xxh3_64;

/// Writes the report of a shot to `out`, which has its previews, and returns its path.
///
/// # Errors
/// If there is neither a cache nor a manifest, a list of files cannot be read, or the page cannot be written.
pub(crate) fn report(shot: &ShotFolder, out: &ShotFolder, control: Control) -> Result<PathBuf, RunError> {
    let text = page::html(&Figures::of(shot, out)?);
    let product = product::ALL.into_iter().find(|product| product.name() == FOLDER);
    let product = product.expect("previews are a product");
    let known = Manifest::read(shot)?;
    let frames: Vec<u32> = cache::list(&shot.cache())?.into_iter().map(|(index, _)| index.0).collect();
    let span = FrameSpan::of(&frames);
    let Some(first) = span.map(|span| span.first) else {
        return Err(RunError::Request("no frames in this cache; simulate the shot first".into()));
    };
    let mut ledger = Ledger::new(out, product, control)?;
    let output = OutputFiles {
        pattern: FILE.into(),
        ..OutputFiles::of("report", FOLDER, "report", "html", FrameIndex(first))
    };
    let path = out.root().join(&output.pattern);
    let written = cache::write_atomically(&path, |to| to.write_all(text.as_bytes()));
    let written = written.map_err(|source| RunError::File {
        path: path.clone(),
        source,
        next: "check that the folder can be written and the disk has free space",
    })?;
    let shown = cache::read_header(&cache::frame_path(&shot.cache(), FrameIndex(first))).ok();
    let state = shown.and_then(|info| Some(state_key(info.key, info.index, &info.streams.first()?.name)));
    let mut record = FileRecord::new(FrameIndex(first), "report", xxh3_64(text.as_bytes()), state);
    record.add(output.pattern.clone(), written);
    let added = ledger.add_sequence(output, &frames, Some(&record), control);
    let (title, fps) = known.map_or(("Untitled".into(), 24.0), |known| (known.title, known.fps));
    ledger.finish(&title, fps, &frames, added, control)?;
    Ok(path)
}
