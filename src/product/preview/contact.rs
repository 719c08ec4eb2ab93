//! Captions of pictures, and the contact sheet.

use super::{colours::legend, settings::ParticleLook, stage::Stage};
use crate::{
    control::printable,
    frame::FrameIndex,
    image::{Canvas, render::grid_cell, text_lines},
};

/// Pictures of a contact sheet, at most.
pub(super) const MAX_PICTURES: usize = 12;

/// Pictures next to each other.
const COLUMNS: usize = 3;

const MARGIN: usize = 12;
const PAPER: [u8; 3] = [20, 21, 24];
const INK: [u8; 3] = [230, 230, 230];

/// Height and width of the legend of speeds [pixels].
const LEGEND: [usize; 2] = [10, 96];

/// Writes number, time and scale of a frame into its picture; times of successive frames, `fps` a second, differ.
pub(super) fn caption(picture: &mut Canvas, stage: &Stage, (index, time): (FrameIndex, f64), fps: f64) {
    let [width, height] = picture.size();
    let grid = length(grid_cell(stage.bounds.size()));
    let scale = stage.ground.map(|_| format!(" | grid {grid}")).unwrap_or_default();
    let text = format!("{index} | {}{scale}", duration(time, fps));
    let line = text_lines(&text, width.saturating_sub(2 * MARGIN)).swap_remove(0);
    let top = height.saturating_sub(Canvas::LINE + MARGIN / 2);
    outlined(picture, &line, MARGIN, top);
    if stage.particles == ParticleLook::Speed {
        speeds(picture, stage.speed);
    }
}

/// A time [s] in the unit and with the digits that frames of `fps` a second need.
fn duration(time: f64, fps: f64) -> String {
    let milliseconds = 1000.0 * time;
    match fps {
        fps if fps <= 100.0 => format!("{time:.2} s"),
        fps if fps <= 1e3 => format!("{milliseconds:.0} ms"),
        fps if fps <= 1e4 => format!("{milliseconds:.1} ms"),
        _ => format!("{milliseconds:.4} ms"),
    }
}

/// Writes the legend of speeds up to the largest [m/s] into the upper right corner, if there is space.
fn speeds(picture: &mut Canvas, largest: f32) {
    let text = match largest {
        x if x < 1e5 => format!("{x:.2} m/s"),
        x => format!("{x:.1e} m/s"),
    };
    let width = LEGEND[1] + MARGIN + Canvas::ADVANCE * text.len();
    let Some(left) = picture.size()[0].checked_sub(width + MARGIN).filter(|left| *left >= MARGIN) else {
        return;
    };
    for x in 0..LEGEND[1] {
        let colour = legend(x as f64 / (LEGEND[1] - 1) as f64);
        (0..LEGEND[0]).for_each(|y| picture.set(left + x, MARGIN + 3 + y, colour));
    }
    outlined(picture, &text, left + LEGEND[1] + MARGIN, MARGIN);
}

/// Writes a line that is readable on bright and on dark.
fn outlined(picture: &mut Canvas, text: &str, x: usize, y: usize) {
    picture.write(text, x + 2, y + 2, PAPER);
    picture.write(text, x, y, [245; 3]);
}

/// A length in metres, centimetres or millimetres.
fn length(metres: f64) -> String {
    let rounded = |x: f64| format!("{}", (x * 1000.0).round() / 1000.0);
    match metres {
        m if m >= 0.999 => format!("{} m", rounded(m)),
        m if m >= 0.009_99 => format!("{} cm", rounded(100.0 * m)),
        m => format!("{} mm", rounded(1000.0 * m)),
    }
}

/// Pictures of the same size on a sheet with a title.
pub(super) fn contact_sheet(title: &str, pictures: &[&Canvas]) -> Canvas {
    let [width, height] = pictures.first().map_or([0; 2], |picture| picture.size());
    let columns = COLUMNS.min(pictures.len()).max(1);
    let rows = pictures.len().div_ceil(columns);
    let heading = Canvas::LINE + 2 * MARGIN;
    let page_width = columns * (width + MARGIN) + MARGIN;
    let mut page = Canvas::new(page_width, rows * (height + MARGIN) + heading, PAPER);
    let title = text_lines(&printable(title), page_width.saturating_sub(2 * MARGIN)).swap_remove(0);
    page.write(&title, MARGIN, MARGIN, INK);
    for (place, picture) in pictures.iter().enumerate() {
        let (column, row) = (place % columns, place / columns);
        page.paste(picture, MARGIN + column * (width + MARGIN), heading + row * (height + MARGIN));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units_that_are_read_at_a_glance() {
        let texts = [2.0, 1.0, 0.5, 0.01, 0.002, 200.0, 0.05].map(length);
        assert_eq!(texts, ["2 m", "1 m", "50 cm", "1 cm", "2 mm", "200 m", "5 cm"]);
    }

    #[test]
    fn successive_frames_have_different_times() {
        let texts = [(1.5, 24.0), (0.02, 100.0), (0.002, 960.0), (0.0104, 4000.0), (1.25e-5, 8e4)];
        let found = texts.map(|(time, fps)| duration(time, fps));
        assert_eq!(found, ["1.50 s", "0.02 s", "2 ms", "10.4 ms", "0.0125 ms"]);
        for fps in [12.0, 24.0, 48.0, 100.0, 240.0, 960.0, 3000.0, 2e4] {
            let successive = [4.0, 5.0].map(|frame| duration(frame / fps, fps));
            assert!(successive[0] != successive[1], "{fps}: {successive:?}");
        }
    }

    #[test]
    fn the_legend_is_above_the_caption_and_within_the_picture_for_any_speed() {
        let lower = |picture: &Canvas| {
            let [width, height] = picture.size();
            picture.pixels()[(height - Canvas::LINE - MARGIN / 2) * width..].to_vec()
        };
        for width in [16, 96, 480, 960] {
            for speed in [0.0, 1.5, 3e24, f32::MAX, f32::INFINITY, f32::NAN] {
                let blank = Canvas::new(width, 108, [100; 3]);
                let mut picture = blank.clone();
                speeds(&mut picture, speed);
                assert!(lower(&picture) == lower(&blank), "{width} {speed}");
                assert_eq!(picture != blank, width >= 480, "{width} {speed}");
            }
        }
    }

    #[test]
    fn pictures_are_in_rows_of_three_under_the_title() {
        let picture = |colour| Canvas::new(40, 20, colour);
        let pictures = [[9; 3], [50; 3], [90; 3], [130; 3]].map(picture);
        let page = contact_sheet("<a>\u{1b}", &pictures.each_ref());
        let [width, height] = page.size();
        assert_eq!([width, height], [3 * 52 + 12, 2 * 32 + Canvas::LINE + 24]);
        let at = |x: usize, y: usize| page.pixels()[y * width + x];
        let top = Canvas::LINE + 24;
        assert_eq!(
            [at(12, top), at(64, top), at(116, top), at(12, top + 32)],
            [[9; 3], [50; 3], [90; 3], [130; 3]]
        );
        assert_eq!([at(0, 0), at(64, top + 32)], [PAPER; 2]);
        let narrow = Canvas::new(1, 48, [9; 3]);
        assert_eq!(contact_sheet("title", &[&narrow]).size()[0], 25);
        assert!(!text_lines("0001 | 0.04 s", 0).is_empty());
    }
}
