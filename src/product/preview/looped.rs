//! The loop of a preview: durations of its pictures, and fewer of them where it would be too long.

use crate::image::{Canvas, LoopFrame, animation};
use std::io;

/// Bytes of a loop, at most: a page with it opens at once, and a chat accepts it.
const MAX_LOOP_BYTES: usize = 6 << 20;

/// A loop of pictures of the frames `numbers`, of which every second is left out until it is short enough; and the frames that it shows.
pub(super) fn shrunk_loop(pictures: &[Canvas], numbers: &[u32], fps: f64) -> io::Result<(Vec<u8>, Vec<u32>)> {
    let mut step = 1;
    loop {
        let kept: Vec<usize> = (0..pictures.len()).step_by(step).collect();
        let shown: Vec<u32> = kept.iter().map(|&place| numbers[place]).collect();
        let durations = durations(&shown, fps);
        let frame =
            |(&place, duration): (&usize, u32)| LoopFrame { picture: pictures[place].clone(), duration };
        let frames: Vec<LoopFrame> = kept.iter().zip(durations).map(frame).collect();
        let bytes = animation(&frames)?;
        if bytes.len() <= MAX_LOOP_BYTES || kept.len() <= 2 {
            return Ok((bytes, shown));
        }
        step *= 2;
    }
}

/// How long each frame is shown [ms]: until the next, and the last as long as the one before. Rounding does not add up.
fn durations(numbers: &[u32], fps: f64) -> Vec<u32> {
    let at = |number: u32| (1000.0 * f64::from(number - numbers[0]) / fps).round();
    let mut found: Vec<u32> =
        numbers.windows(2).map(|pair| (at(pair[1]) - at(pair[0])).clamp(1.0, 1e7) as u32).collect();
    found.push(found.last().copied().unwrap_or(1000));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_last_as_long_as_the_shot() {
        let numbers: Vec<u32> = (5..=29).collect();
        let found = durations(&numbers, 24.0);
        assert_eq!(found[..24].iter().sum::<u32>(), 1000);
        assert!(found.iter().all(|ms| (41..=42).contains(ms)));
        assert_eq!((durations(&[7], 24.0), durations(&[1, 4], 30.0)), (vec![1000], vec![100, 100]));
    }

    #[test]
    fn a_loop_that_is_too_long_loses_every_second_picture() {
        // Noise, which does not compress: 480 × 270 × 3 bytes each.
        let mut state = 1_u32;
        let mut noise = || {
            let mut pixel = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            };
            let pixels = (0..480 * 270).map(|_| [pixel(), pixel(), pixel()]).collect();
            Canvas::of_pixels(480, 270, pixels)
        };
        let pictures: Vec<Canvas> = (0..20).map(|_| noise()).collect();
        let numbers: Vec<u32> = (1..=20).collect();
        let (bytes, shown) = shrunk_loop(&pictures, &numbers, 24.0).unwrap();
        assert!(bytes.len() <= MAX_LOOP_BYTES, "{}", bytes.len());
        assert_eq!(shown, (1..=20).step_by(2).collect::<Vec<u32>>());
    }
}
