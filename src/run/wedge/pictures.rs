//! The contact sheet: a picture of every wedge at the same frames, from the same place.

use super::{
    faults::{self, Fault},
    list::WedgeList,
    table::WedgeRow,
};
use crate::{
    cache::{self, CacheError},
    control::printable,
    frame::{Frame, FrameIndex},
    image::{Canvas, View, draw, extent, text_lines},
    job::{Control, FailedFrame, Failure, RunError, ShotFolder},
    preset::Frames,
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Frames of a wedge that a contact sheet shows at most.
pub(crate) const MAX_FRAMES: u64 = 12;

/// Sizes of a picture, from the largest [pixels].
const TILES: [[usize; 2]; 4] = [[480, 360], [320, 240], [240, 180], [160, 120]];

/// Pixels that the pictures of a sheet have at most: 120 MB in memory, and the page as much again.
const MAX_PIXELS: usize = 40_000_000;

/// Most pictures of a sheet, by the smallest.
const MAX_PICTURES: usize = MAX_PIXELS / (TILES[TILES.len() - 1][0] * TILES[TILES.len() - 1][1]);

/// Lines of a label.
const MAX_LABEL_LINES: usize = 6;

/// Shape of a sheet: width over height.
const ASPECT: f64 = 1.6;

const MARGIN: usize = 12;

/// Pixels between the pictures of a wedge.
const GAP: usize = 4;

const PAPER: [u8; 3] = [20, 21, 24];
const INK: [u8; 3] = [230, 230, 230];
const FAINT: [u8; 3] = [150, 152, 158];

/// A picture of a wedge, or why there is none.
enum Tile {
    Drawn(Canvas),
    Missing(String),
}

/// The contact sheet.
pub(crate) struct ContactPage {
    /// Where the sheet was written.
    pub(crate) path: PathBuf,
    /// Particles outside the pictures.
    pub(crate) outside: u64,
    /// Wedges with frames that cannot be read, each with the first of them.
    pub(crate) unread: Vec<FailedFrame>,
}

/// Draws the wedges of a list at some frames into `contact-sheet.png`; by default at three frames, the last among them. Wedges that
/// hold another shot than the list has are not drawn.
///
/// # Errors
/// If no frame can be drawn, or the file cannot be written.
pub(crate) fn draw_wedges(
    root: &Path,
    list: &WedgeList,
    rows: &[WedgeRow],
    at: Option<&Frames>,
    max_memory: Option<u64>,
    control: Control,
) -> Result<ContactPage, RunError> {
    let shots = list.shots(root)?;
    let maximum = MAX_PICTURES / shots.len().max(1);
    let frames = match at {
        Some(at) => at.iter().collect(),
        None => thirds(&shots, maximum),
    };
    if frames.len() > maximum {
        return Err(RunError::Request(format!(
            "--at: found {} frames, expected at most {maximum} of {} wedges, which fill a sheet",
            frames.len(),
            shots.len()
        )));
    }
    if frames.is_empty() {
        return Err(RunError::Request(format!(
            "{}: found no frames of these wedges; run `meniscus wedge` without --prepare, or their farm job",
            root.display()
        )));
    }
    // The same view for all: first what they fill, then the pictures.
    let mut view: Option<View> = None;
    control.reporter.begin("compare", 2 * shots.len() * frames.len());
    let mut done = 0.0;
    // Of another shot, or perhaps of one.
    let foreign = |place: usize| {
        let is_foreign = |fault: &&FailedFrame| matches!(fault.kind, Failure::Foreign | Failure::Missing);
        let fault = rows[place].fault.as_ref().filter(is_foreign)?;
        Some((fault.kind, fault.why.clone()))
    };
    let mut each = |act: &mut dyn FnMut(usize, Result<Frame, Fault>)| {
        for (place, shot) in shots.iter().enumerate() {
            for &index in &frames {
                if control.cancel.is_cancelled() {
                    return Err(RunError::Interrupted);
                }
                let frame = match foreign(place) {
                    Some(fault) => Err(fault),
                    None => read(shot, index, max_memory),
                };
                act(place, frame);
                done += 1.0;
                control.reporter.progress(done);
            }
        }
        Ok(())
    };
    each(&mut |_, frame| {
        let found = frame.ok().as_ref().and_then(extent);
        view = found.map(|found| view.map_or(found, |view| view.union(found))).or(view);
    })?;
    let size = tile_size(shots.len() * frames.len());
    let mut tiles: Vec<Vec<Tile>> = shots.iter().map(|_| Vec::new()).collect();
    let (mut outside, mut unread) = (0, BTreeMap::new());
    each(&mut |place, frame| {
        let tile = match (frame, view) {
            (Ok(frame), Some(view)) => {
                let (canvas, left_out) = draw(&frame, view, size);
                outside += left_out;
                Tile::Drawn(canvas)
            }
            (Ok(_), None) => Tile::Missing("nothing to draw".into()),
            (Err((kind, why)), _) => {
                if kind != Failure::Missing {
                    unread.entry(place).or_insert_with(|| faults::named(list, place, (kind, why.clone())));
                }
                Tile::Missing(why)
            }
        };
        tiles[place].push(tile);
    })?;
    let canvas = compose(list, &frames, &tiles, size);
    let path = root.join("contact-sheet.png");
    canvas.save(&path).map_err(|source| RunError::File {
        path: path.clone(),
        source,
        next: "check that the folder can be written and the disk has free space",
    })?;
    control.reporter.end();
    Ok(ContactPage { path, outside, unread: unread.into_values().collect() })
}

/// A third, two thirds and the end of the frames that some shot has; the last of them if there is no place for more.
fn thirds(shots: &[ShotFolder], maximum: usize) -> Vec<FrameIndex> {
    let listed = shots.iter().filter_map(|shot| cache::list(&shot.cache()).ok());
    let longest = listed.max_by_key(Vec::len).unwrap_or_default();
    let Some(last) = longest.len().checked_sub(1) else { return Vec::new() };
    let mut places = vec![last / 3, 2 * last / 3, last];
    places.dedup();
    places.drain(..places.len().saturating_sub(maximum));
    places.into_iter().map(|place| longest[place].0).collect()
}

fn read(shot: &ShotFolder, index: FrameIndex, max_memory: Option<u64>) -> Result<Frame, Fault> {
    match cache::read_frame_within(&cache::frame_path(&shot.cache(), index), max_memory) {
        Ok((frame, _)) => Ok(frame),
        Err(CacheError::NotFound { .. }) => Err((Failure::Missing, "not simulated".into())),
        Err(why) => Err((Failure::of(&why), why.to_string())),
    }
}

fn tile_size(count: usize) -> [usize; 2] {
    let fits = |size: &&[usize; 2]| count.saturating_mul(size[0] * size[1]) <= MAX_PIXELS;
    *TILES.iter().find(fits).unwrap_or(&TILES[TILES.len() - 1])
}

/// Puts the pictures with their labels on a sheet, a block for each wedge.
fn compose(list: &WedgeList, frames: &[FrameIndex], tiles: &[Vec<Tile>], size: [usize; 2]) -> Canvas {
    let width = frames.len() * (size[0] + GAP);
    let label = |place: usize| {
        let text = format!("{} {}", place + 1, list.label(&list.wedges[place]));
        let mut lines = text_lines(&printable(&text), width);
        lines.truncate(MAX_LABEL_LINES);
        lines
    };
    let lines = (0..tiles.len()).map(|place| label(place).len()).max().unwrap_or(1);
    let block = [width + MARGIN, (lines + 1) * Canvas::LINE + size[1] + MARGIN];
    let columns = columns(tiles.len(), block);
    let rows = tiles.len().div_ceil(columns);
    let heading = Canvas::LINE + 2 * MARGIN;
    let mut page = Canvas::new(columns * block[0] + MARGIN, rows * block[1] + heading, PAPER);
    let title = text_lines(&printable(&list.title), columns * block[0]).swap_remove(0);
    page.write(&title, MARGIN, MARGIN, INK);
    for (place, tiles) in tiles.iter().enumerate() {
        let (left, top) = (MARGIN + place % columns * block[0], heading + place / columns * block[1]);
        for (number, line) in label(place).iter().enumerate() {
            page.write(line, left, top + number * Canvas::LINE, INK);
        }
        let top = top + lines * Canvas::LINE;
        for (column, (tile, index)) in tiles.iter().zip(frames).enumerate() {
            let left = left + column * (size[0] + GAP);
            match tile {
                Tile::Drawn(picture) => page.paste(picture, left, top),
                Tile::Missing(why) => {
                    for (number, line) in text_lines(&printable(why), size[0]).iter().take(4).enumerate() {
                        page.write(line, left, top + (number + 1) * Canvas::LINE, FAINT);
                    }
                }
            }
            page.write(&format!("frame {index}"), left, top + size[1] + 2, FAINT);
        }
    }
    page
}

/// Columns that give the sheet about its shape.
fn columns(count: usize, block: [usize; 2]) -> usize {
    let ideal = (ASPECT * count as f64 * block[1] as f64 / block[0] as f64).sqrt();
    (ideal.round() as usize).clamp(1, count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_wide_and_small_enough() {
        assert_eq!(columns(1, [1000, 300]), 1);
        assert_eq!(columns(9, [900, 300]), 2);
        assert_eq!(columns(100, [960, 300]), 7);
        assert_eq!((tile_size(9), tile_size(300), tile_size(12_000)), ([480, 360], [320, 240], [160, 120]));
        const { assert!(MAX_PICTURES > 2 * super::super::list::MAX_WEDGES, "two frames of every list") }
    }
}
