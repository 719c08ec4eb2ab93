//! Loops of pictures as animated WebP files, without loss.
//!
//! *Method*: the library `image-webp` encodes single pictures; their `VP8L` chunks become the frames of an animation in the container of the
//! WebP specification (chunks `VP8X`, `ANIM`, `ANMF`). From the second frame on only the rectangle that changes is stored, in which pixels that
//! do not change are transparent.

use super::Canvas;
use crate::par;
use std::{io, ops::Range};

/// Longest time of a frame in the format [ms].
const MAX_DURATION: u32 = (1 << 24) - 1;

/// Longest side of a picture in an animation [pixels].
const MAX_SIDE: usize = 1 << 14;

/// A picture of a loop.
#[derive(Clone, Debug)]
pub(crate) struct LoopFrame {
    pub(crate) picture: Canvas,
    /// How long it is shown [ms].
    pub(crate) duration: u32,
}

/// An endless animation of pictures of one size, as the bytes of a file.
///
/// # Errors
/// If there is no picture, sizes differ, or a side is longer than 16384 pixels.
pub(crate) fn animation(frames: &[LoopFrame]) -> io::Result<Vec<u8>> {
    let size = frames.first().map(|frame| frame.picture.size());
    let size = size.filter(|size| size.iter().all(|side| (1..=MAX_SIDE).contains(side)));
    let size = size.filter(|size| frames.iter().all(|frame| frame.picture.size() == *size));
    let Some([width, height]) = size else {
        return Err(io::Error::other("a loop needs pictures of one size, of at most 16384 pixels on a side"));
    };
    let encoded = par::map(frames.len(), |i| {
        let before = i.checked_sub(1).map(|before| &frames[before].picture);
        encode(&frames[i], before)
    });
    let mut body = b"WEBP".to_vec();
    // Animation and transparency; then a size less one in 24 bits each.
    let mut header = vec![0b0001_0010, 0, 0, 0];
    header.extend(int24(width - 1));
    header.extend(int24(height - 1));
    chunk(&mut body, *b"VP8X", &header);
    // Background colour, and how often the loop runs: without end.
    chunk(&mut body, *b"ANIM", &[0, 0, 0, 255, 0, 0]);
    for frame in encoded {
        chunk(&mut body, *b"ANMF", &frame?);
    }
    let mut file = b"RIFF".to_vec();
    let too_long = |_| io::Error::other("a loop has at most 4 GiB");
    file.extend(u32::try_from(body.len()).map_err(too_long)?.to_le_bytes());
    file.extend(body);
    Ok(file)
}

/// The content of the chunk of a frame that follows `before`.
fn encode(frame: &LoopFrame, before: Option<&Canvas>) -> io::Result<Vec<u8>> {
    let [columns, rows] = changed(&frame.picture, before);
    let (width, height) = (columns.len(), rows.len());
    let mut pixels = Vec::with_capacity(4 * width * height);
    let across = frame.picture.size()[0];
    for y in rows.clone() {
        for place in (y * across + columns.start)..(y * across + columns.end) {
            let colour = frame.picture.pixels()[place];
            match before.is_some_and(|before| before.pixels()[place] == colour) {
                true => pixels.extend([0; 4]),
                false => pixels.extend([colour[0], colour[1], colour[2], 255]),
            }
        }
    }
    let mut still = Vec::new();
    let encoder = image_webp::WebPEncoder::new(&mut still);
    encoder
        .encode(&pixels, width as u32, height as u32, image_webp::ColorType::Rgba8)
        .map_err(io::Error::other)?;
    let mut content = Vec::new();
    content.extend(int24(columns.start / 2));
    content.extend(int24(rows.start / 2));
    content.extend(int24(width - 1));
    content.extend(int24(height - 1));
    content.extend(int24(frame.duration.min(MAX_DURATION) as usize));
    // What is transparent shows the frame before, which is kept.
    content.push(0);
    chunk(&mut content, *b"VP8L", picture_chunk(&still)?);
    Ok(content)
}

/// The columns and rows that change, which begin at even numbers; one pixel if none does.
fn changed(picture: &Canvas, before: Option<&Canvas>) -> [Range<usize>; 2] {
    let [width, height] = picture.size();
    let Some(before) = before else { return [0..width, 0..height] };
    let differs = |x: usize, y: usize| picture.pixels()[y * width + x] != before.pixels()[y * width + x];
    let rows: Vec<usize> = (0..height).filter(|&y| (0..width).any(|x| differs(x, y))).collect();
    let columns: Vec<usize> = (0..width).filter(|&x| rows.iter().any(|&y| differs(x, y))).collect();
    [columns, rows].map(|places| match (places.first(), places.last()) {
        (Some(first), Some(last)) => first / 2 * 2..last + 1,
        _ => 0..1,
    })
}

/// The content of the first chunk of a file with a single picture without loss.
fn picture_chunk(file: &[u8]) -> io::Result<&[u8]> {
    let length = file.get(16..20).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
    let content =
        length.filter(|_| &file[12..16] == b"VP8L").and_then(|length| file.get(20..20 + length as usize));
    content
        .ok_or_else(|| io::Error::other("the encoder wrote another file than one with a single VP8L chunk"))
}

/// Adds a chunk with its name, its length and a byte that makes it even.
fn chunk(out: &mut Vec<u8>, name: [u8; 4], content: &[u8]) {
    out.extend(name);
    out.extend((content.len() as u32).to_le_bytes());
    out.extend(content);
    if content.len() % 2 == 1 {
        out.push(0);
    }
}

/// A number in 24 bits.
fn int24(number: usize) -> [u8; 3] {
    let [a, b, c, _] = (number as u32).to_le_bytes();
    [a, b, c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// A square that moves over a pattern.
    fn pictures() -> Vec<LoopFrame> {
        let picture = |i: usize| {
            let mut picture = Canvas::new(51, 33, [40, 50, 60]);
            for x in 0..51 {
                picture.set(x, x % 33, [x as u8 * 5, 7, 200]);
            }
            for y in 0..9 {
                (0..9).for_each(|x| picture.set(3 + 5 * i + x, 5 + 3 * i + y, [250, 10 * i as u8, 90]));
            }
            picture
        };
        // The last is that before.
        let frame =
            |(i, shown): (usize, usize)| LoopFrame { picture: picture(shown), duration: 41 + i as u32 };
        [0, 1, 2, 5, 5].into_iter().enumerate().map(frame).collect()
    }

    /// Pictures and times of the frames of a file, put together as the specification has it.
    fn played(file: &[u8]) -> Vec<(Vec<[u8; 3]>, u32)> {
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        let three = |at: usize| word(at) & 0xff_ffff;
        assert_eq!((&file[..4], word(4), &file[8..16]), (&b"RIFF"[..], file.len() - 8, &b"WEBPVP8X"[..]));
        assert_eq!(file[20] & 0b10, 0b10, "an animation");
        let [width, height] = [three(24) + 1, three(27) + 1];
        let (mut canvas, mut found) = (vec![[0; 3]; width * height], Vec::new());
        let mut at = 30;
        while at < file.len() {
            let length = word(at + 4);
            if &file[at..at + 4] == b"ANMF" {
                let start = at + 8;
                let [x, y] = [2 * three(start), 2 * three(start + 3)];
                let [w, h] = [three(start + 6) + 1, three(start + 9) + 1];
                assert!(x + w <= width && y + h <= height);
                let mut still = b"RIFF".to_vec();
                still.extend((4 + length as u32 - 16).to_le_bytes());
                still.extend(b"WEBP");
                still.extend(&file[start + 16..start + length]);
                let mut decoder = image_webp::WebPDecoder::new(Cursor::new(still)).unwrap();
                assert_eq!(decoder.dimensions(), (w as u32, h as u32));
                let mut bytes = vec![0; decoder.output_buffer_size().unwrap()];
                decoder.read_image(&mut bytes).unwrap();
                for (i, pixel) in bytes.as_chunks::<4>().0.iter().enumerate() {
                    match pixel[3] {
                        255 => canvas[(y + i / w) * width + x + i % w] = [pixel[0], pixel[1], pixel[2]],
                        alpha => assert_eq!(alpha, 0),
                    }
                }
                found.push((canvas.clone(), three(start + 12) as u32));
            }
            at += 8 + length + length % 2;
        }
        assert_eq!(at, file.len());
        found
    }

    #[test]
    fn every_picture_is_shown_for_its_time_without_loss() {
        let frames = pictures();
        let file = animation(&frames).unwrap();
        let found = played(&file);
        assert_eq!(found.len(), frames.len());
        for ((picture, duration), frame) in found.iter().zip(&frames) {
            assert!(picture == frame.picture.pixels() && *duration == frame.duration);
        }
    }

    #[test]
    fn a_decoder_reads_the_animation() {
        let frames = pictures();
        let file = animation(&frames).unwrap();
        let mut decoder = image_webp::WebPDecoder::new(Cursor::new(&file)).unwrap();
        assert_eq!((decoder.dimensions(), decoder.num_frames()), ((51, 33), 5));
        assert_eq!(decoder.loop_count(), image_webp::LoopCount::Forever);
        assert!(decoder.has_alpha());
        for frame in &frames {
            let mut bytes = vec![0; decoder.output_buffer_size().unwrap()];
            assert_eq!(decoder.read_frame(&mut bytes).unwrap(), frame.duration);
            let pixels = bytes.as_chunks::<4>().0.iter().zip(frame.picture.pixels());
            // Opaque pixels lose a level in this decoder, in libwebp they do not.
            assert!(
                pixels.clone().all(|(found, expected)| (0..3).all(|k| found[k].abs_diff(expected[k]) <= 1))
            );
            assert!(bytes.iter().skip(3).step_by(4).all(|alpha| *alpha == 255));
        }
    }

    #[test]
    fn what_does_not_change_takes_hardly_any_bytes() {
        let frames = pictures();
        let length = |count: usize| animation(&frames[..count]).unwrap().len();
        let first = length(1);
        let last = length(5) - length(4);
        assert!(last < 80, "{last} bytes for a picture that does not change, {first} for the first");
        assert_eq!(changed(&frames[4].picture, Some(&frames[3].picture)), [0..1, 0..1]);
        assert_eq!(changed(&frames[1].picture, Some(&frames[0].picture)), [2..17, 4..17]);
    }

    #[test]
    fn pictures_of_several_sizes_are_refused() {
        let mut frames = pictures();
        frames[2].picture = Canvas::new(50, 33, [0; 3]);
        assert!(animation(&frames).is_err() && animation(&[]).is_err());
    }
}
