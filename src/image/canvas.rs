//! Pixels, labels, and the PNG file that they become.

use super::font::{ADVANCE, LINE, glyph};
use crate::cache::{WrittenFile, write_atomically};
use std::{io, path::Path};

/// An image of red, green and blue bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

/// Pixels of the image for one of a letter.
const SCALE: usize = 2;

impl Canvas {
    /// Height of a line of text [pixels].
    pub(crate) const LINE: usize = LINE * SCALE;

    /// Width of a letter with the gap behind it [pixels].
    pub(crate) const ADVANCE: usize = ADVANCE * SCALE;

    /// An image of one colour.
    pub(crate) fn new(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Self { width, height, pixels: vec![colour; width * height] }
    }

    /// An image of these pixels, row by row.
    ///
    /// # Panics
    /// If there are not as many as the image has.
    pub(crate) fn of_pixels(width: usize, height: usize, pixels: Vec<[u8; 3]>) -> Self {
        assert_eq!(pixels.len(), width * height, "every pixel has a colour");
        Self { width, height, pixels }
    }

    /// Width and height [pixels].
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The pixels, row by row.
    pub(crate) fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// Sets a pixel, if it is in the image.
    pub(crate) fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Puts another image into this one, as far as it fits, with its upper left corner at (x, y).
    pub(crate) fn paste(&mut self, other: &Self, x: usize, y: usize) {
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x + column, y + row, other.pixels[row * other.width + column]);
            }
        }
    }

    /// Writes a line with its upper left corner at (x, y).
    pub(crate) fn write(&mut self, text: &str, x: usize, y: usize, colour: [u8; 3]) {
        for (place, letter) in text.chars().enumerate() {
            for (column, bits) in glyph(letter).into_iter().enumerate() {
                for row in (0..8).filter(|row| bits >> row & 1 == 1) {
                    let left = x + (place * ADVANCE + column) * SCALE;
                    for pixel in 0..SCALE * SCALE {
                        self.set(left + pixel % SCALE, y + row * SCALE + pixel / SCALE, colour);
                    }
                }
            }
        }
    }

    /// Writes the image as a PNG file, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn save(&self, path: &Path) -> io::Result<WrittenFile> {
        let bytes = self.png()?;
        write_atomically(path, |out| out.write_all(&bytes))
    }

    /// The image as the bytes of a PNG file.
    ///
    /// # Errors
    /// If it has more pixels than such a file can.
    pub(crate) fn png(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let too_large = |_| io::Error::other("the image has more than 2^31 pixels on a side");
        let (width, height) =
            (u32::try_from(self.width).map_err(too_large)?, u32::try_from(self.height).map_err(too_large)?);
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer.write_image_data(self.pixels.as_flattened()).map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)?;
        Ok(bytes)
    }
}

/// A text in lines of at most `width` pixels, broken at blanks where there are some.
pub(crate) fn text_lines(text: &str, width: usize) -> Vec<String> {
    let letters = (width / (ADVANCE * SCALE)).max(1);
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let mut word: Vec<char> = word.chars().collect();
        loop {
            let line = lines.last_mut().expect("there is always one");
            let used = line.chars().count();
            let gap = usize::from(used > 0);
            if used + gap + word.len() <= letters {
                line.extend(std::iter::repeat_n(' ', gap).chain(word));
                break;
            }
            if used > 0 {
                lines.push(String::new());
            } else {
                line.extend(word.drain(..letters));
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_broken_at_blanks_and_long_words_anywhere() {
        let lines = |text: &str| text_lines(text, 5 * ADVANCE * SCALE);
        assert_eq!(lines("ab cd ef"), ["ab cd", "ef"]);
        assert_eq!(lines("abcdefgh ij"), ["abcde", "fgh", "ij"]);
        assert_eq!(lines(""), [""]);
    }

    #[test]
    fn an_image_reads_as_it_was_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.png");
        let mut canvas = Canvas::new(40, 30, [1, 2, 3]);
        canvas.write("A", 0, 0, [255; 3]);
        let mut small = Canvas::new(3, 2, [9, 9, 9]);
        small.set(1, 1, [7, 8, 9]);
        canvas.paste(&small, 38, 29);
        canvas.save(&path).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        assert_eq!(bytes, canvas.pixels.as_flattened());
        let pixel = |x: usize, y: usize| canvas.pixels[y * 40 + x];
        assert_eq!([pixel(38, 29), pixel(39, 29), pixel(37, 29)], [[9; 3], [9; 3], [1, 2, 3]]);
        // The left stroke of the letter, which is two pixels wide, and nothing right of it.
        assert_eq!([pixel(0, 6), pixel(1, 6), pixel(11, 6)], [[255; 3], [255; 3], [1, 2, 3]]);
    }
}
