//! Pictures as text for terminals that show them.
//!
//! *Method*: the graphics protocol of kitty, which takes PNG files in base64, and sixel (DEC VT340), with a cube of 216 colours and ordered
//! dithering (Bayer 1973).

use super::Canvas;
use base64::{Engine, engine::general_purpose::STANDARD};
use std::{fmt::Write, io};

/// Bytes of a part of a picture that kitty accepts.
const PART: usize = 4096;

/// Steps of red, green and blue of sixel colours.
const STEPS: usize = 6;

/// Rows of a band of sixels.
const BAND: usize = 6;

/// Thresholds of ordered dithering, in sixteenths.
const BAYER: [[u32; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// How a terminal shows pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TerminalPictures {
    /// The graphics protocol of kitty.
    Kitty,
    /// Sixel.
    Sixel,
}

impl TerminalPictures {
    /// The protocol of a terminal, by its environment: `TERM`, `TERM_PROGRAM`, `KITTY_WINDOW_ID`, `TMUX` and `STY`, as `variable` gives them; `None` if it
    /// declares none.
    pub(crate) fn of(variable: impl Fn(&str) -> Option<String>) -> Option<Self> {
        let term = variable("TERM").unwrap_or_default();
        let program = variable("TERM_PROGRAM").unwrap_or_default();
        // Multiplexers pass neither on.
        let is_multiplexed = program == "tmux" || ["TMUX", "STY"].iter().any(|name| variable(name).is_some());
        if is_multiplexed || ["screen", "tmux", "dumb", "linux"].iter().any(|name| term.starts_with(name)) {
            return None;
        }
        let is_kitty = ["xterm-kitty", "xterm-ghostty"].contains(&term.as_str())
            || ["ghostty", "WezTerm"].contains(&program.as_str())
            || variable("KITTY_WINDOW_ID").is_some();
        let has_sixel = term.contains("sixel")
            || ["foot", "mlterm", "contour", "yaft"].iter().any(|name| term.starts_with(name));
        match (is_kitty, has_sixel) {
            (true, _) => Some(Self::Kitty),
            (false, true) => Some(Self::Sixel),
            (false, false) => None,
        }
    }

    /// The text that shows a picture, with a line break behind it.
    ///
    /// # Errors
    /// If the picture has more pixels than a PNG file can.
    pub(crate) fn text(self, picture: &Canvas) -> io::Result<String> {
        Ok(match self {
            Self::Kitty => kitty(&picture.png()?),
            Self::Sixel => sixel(picture),
        })
    }
}

/// A PNG file in the protocol of kitty, in parts.
fn kitty(png: &[u8]) -> String {
    let encoded = STANDARD.encode(png);
    let parts: Vec<&[u8]> = encoded.as_bytes().chunks(PART).collect();
    let mut out = String::with_capacity(encoded.len() + 32 * parts.len());
    for (number, part) in parts.iter().enumerate() {
        // Transmit and show a PNG file; the terminal answers nothing.
        let keys = if number == 0 { "a=T,f=100,q=2," } else { "" };
        let more = u8::from(number + 1 < parts.len());
        let text = std::str::from_utf8(part).expect("base64 is ASCII");
        write!(out, "\x1b_G{keys}m={more};{text}\x1b\\").expect("a string grows");
    }
    out + "\n"
}

/// The colour of the cube for a pixel.
fn in_cube(colour: [u8; 3], x: usize, y: usize) -> usize {
    let threshold = BAYER[y % 4][x % 4];
    colour.iter().fold(0, |number, &value| {
        // Between two steps the threshold decides.
        let scaled = u32::from(value) * (STEPS as u32 - 1) * 16;
        let step = (scaled + threshold * 255 + 127) / (255 * 16);
        number * STEPS + (step as usize).min(STEPS - 1)
    })
}

/// A picture in sixel.
fn sixel(picture: &Canvas) -> String {
    let [width, height] = picture.size();
    let mut out = format!("\x1bPq\"1;1;{width};{height}");
    for number in 0..STEPS * STEPS * STEPS {
        let [r, g, b] = [number / STEPS / STEPS, number / STEPS % STEPS, number % STEPS]
            .map(|step| step * 100 / (STEPS - 1));
        write!(out, "#{number};2;{r};{g};{b}").expect("a string grows");
    }
    for top in (0..height).step_by(BAND) {
        // For each colour of the band, the rows of each column in which it is.
        let mut columns: Vec<Vec<u8>> = vec![Vec::new(); STEPS * STEPS * STEPS];
        for y in top..(top + BAND).min(height) {
            for x in 0..width {
                let column = &mut columns[in_cube(picture.pixels()[y * width + x], x, y)];
                column.resize(column.len().max(width), 0);
                column[x] |= 1 << (y - top);
            }
        }
        for (number, column) in columns.iter().enumerate().filter(|(_, column)| !column.is_empty()) {
            write!(out, "#{number}").expect("a string grows");
            for run in column.chunk_by(|a, b| a == b) {
                let rows = char::from(63 + run[0]);
                match run.len() {
                    1..=3 => out.extend(std::iter::repeat_n(rows, run.len())),
                    length => write!(out, "!{length}{rows}").expect("a string grows"),
                }
            }
            out.push('$');
        }
        out.push('-');
    }
    out + "\x1b\\\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Canvas {
        let mut picture = Canvas::new(70, 45, [20, 90, 160]);
        let mut state = 1_u32;
        for y in 0..45 {
            // Blue does not compress, so that the picture has several parts.
            let mut blue = |_: usize| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            };
            (0..70).for_each(|x| picture.set(x, y, [(3 * x) as u8, (5 * y) as u8, blue(x)]));
        }
        picture.write("frame", 2, 3, [255; 3]);
        picture
    }

    #[test]
    fn the_parts_of_kitty_are_the_png_file() {
        let picture = picture();
        let text = TerminalPictures::Kitty.text(&picture).unwrap();
        let mut encoded = String::new();
        let parts: Vec<&str> = text.trim_end().split("\x1b\\").filter(|part| !part.is_empty()).collect();
        for (number, part) in parts.iter().enumerate() {
            let (keys, content) = part.strip_prefix("\x1b_G").unwrap().split_once(';').unwrap();
            assert!(
                content.len() <= PART && keys.ends_with(if number + 1 < parts.len() { "m=1" } else { "m=0" })
            );
            assert_eq!(keys.starts_with("a=T,f=100,q=2,"), number == 0);
            encoded += content;
        }
        assert!(parts.len() > 1, "{} parts", parts.len());
        let png = STANDARD.decode(encoded).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        assert!(bytes == picture.pixels().as_flattened());
    }

    /// The pixels of a sixel text, as colours of per cent.
    fn decoded(text: &str) -> (usize, usize, Vec<Option<[u32; 3]>>) {
        let body = text.strip_prefix("\x1bPq\"1;1;").unwrap().strip_suffix("\x1b\\\n").unwrap();
        let (mut at, bytes) = (0, body.as_bytes());
        let number = |at: &mut usize| {
            let first = *at;
            while bytes.get(*at).is_some_and(u8::is_ascii_digit) {
                *at += 1;
            }
            body[first..*at].parse::<u32>().unwrap()
        };
        let width = number(&mut at) as usize;
        at += 1;
        let height = number(&mut at) as usize;
        let mut palette = std::collections::BTreeMap::new();
        let mut pixels = vec![None; width * height];
        let (mut x, mut top, mut colour) = (0, 0, 0);
        while at < bytes.len() {
            let mark = bytes[at];
            at += 1;
            match mark {
                b'#' => {
                    colour = number(&mut at);
                    if bytes[at] == b';' {
                        let parts: Vec<u32> = (0..4)
                            .map(|_| {
                                at += 1;
                                number(&mut at)
                            })
                            .collect();
                        assert_eq!(parts[0], 2);
                        palette.insert(colour, [parts[1], parts[2], parts[3]]);
                    }
                }
                b'$' => x = 0,
                b'-' => (x, top) = (0, top + BAND),
                b'!' | 63..=126 => {
                    let (count, rows) = match mark {
                        b'!' => {
                            let count = number(&mut at);
                            at += 1;
                            (count, bytes[at - 1])
                        }
                        rows => (1, rows),
                    };
                    for _ in 0..count {
                        for row in (0..BAND).filter(|row| (rows - 63) >> row & 1 == 1) {
                            assert_eq!(pixels[(top + row) * width + x], None, "a pixel is drawn once");
                            pixels[(top + row) * width + x] = Some(palette[&colour]);
                        }
                        x += 1;
                    }
                }
                other => panic!("{other} at {at}"),
            }
        }
        (width, height, pixels)
    }

    #[test]
    fn sixels_are_the_picture_but_for_a_step_of_colour() {
        let picture = picture();
        let (width, height, pixels) = decoded(&TerminalPictures::Sixel.text(&picture).unwrap());
        assert_eq!([width, height], picture.size());
        let mut sums = [0.0; 3];
        for (found, expected) in pixels.iter().zip(picture.pixels()) {
            let found = found.expect("every pixel has a colour").map(|part| f64::from(part) * 2.55);
            for k in 0..3 {
                let off = found[k] - f64::from(expected[k]);
                assert!(off.abs() <= 52.0, "{found:?} {expected:?}");
                sums[k] += off;
            }
        }
        // Dithering keeps the mean.
        assert!(sums.iter().all(|sum| (sum / pixels.len() as f64).abs() < 4.0), "{sums:?}");
    }

    #[test]
    fn terminals_show_pictures_only_if_they_declare_it() {
        let of = |known: &[(&str, &str)]| {
            TerminalPictures::of(|name| {
                known.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
            })
        };
        assert_eq!(of(&[("TERM", "xterm-kitty")]), Some(TerminalPictures::Kitty));
        assert_eq!(
            of(&[("TERM", "xterm-256color"), ("TERM_PROGRAM", "WezTerm")]),
            Some(TerminalPictures::Kitty)
        );
        assert_eq!(of(&[("TERM", "foot")]), Some(TerminalPictures::Sixel));
        assert_eq!(of(&[("TERM", "yaft-256color")]), Some(TerminalPictures::Sixel));
        for known in [
            &[][..],
            &[("TERM", "xterm-256color")],
            &[("TERM", "tmux-256color"), ("KITTY_WINDOW_ID", "1")],
            &[("TERM", "xterm-kitty"), ("TMUX", "/run/tmux,1,0")],
            &[("TERM", "foot"), ("STY", "1.pts-0")],
            &[("TERM", "xterm-kitty"), ("TERM_PROGRAM", "tmux")],
        ] {
            assert_eq!(of(known), None, "{known:?}");
        }
    }
}
