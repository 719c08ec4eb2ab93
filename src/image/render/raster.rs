//! Triangles on a grid of samples.
//!
//! *Method*: edge functions in integers of 1/256 of a sample with the top-left rule, so that triangles that share an edge cover every
//! sample along it once (Pineda 1988); tiles of samples in parallel, in each the triangles in their order. So the result does not
//! depend on the number of threads, and sums over faces neither miss nor repeat any.

use super::{clip::Corner, model::LeftOut};
use crate::{control::CancelToken, par};

/// Side of a tile [samples].
pub(super) const TILE: usize = 64;

/// Parts of a sample that places are rounded to.
const SUBSAMPLES: f64 = 256.0;

/// Triangles that are prepared at a time, which bounds their memory.
const BATCH: usize = 1 << 16;

/// Entries in the lists of all tiles, which bound their memory: 16 MiB.
const MAX_LISTED: usize = 1 << 22;

/// A tile of samples with what a pass keeps of each.
#[derive(Clone, Debug)]
pub(super) struct Tile<T> {
    /// The first sample.
    pub(super) corner: [usize; 2],
    /// Samples of each row, and rows.
    pub(super) size: [usize; 2],
    /// Row by row.
    pub(super) samples: Vec<T>,
}

/// Tiles that cover a grid of samples.
pub(super) fn tiles<T: Clone + Send + Sync>(size: [usize; 2], empty: T) -> Vec<Tile<T>> {
    let counts = size.map(|side| side.div_ceil(TILE));
    par::map(counts[0] * counts[1], |number| {
        let corner = [number % counts[0] * TILE, number / counts[0] * TILE];
        let own = [0, 1].map(|side| TILE.min(size[side] - corner[side]));
        Tile { corner, size: own, samples: vec![empty.clone(); own[0] * own[1]] }
    })
}

/// A triangle that is ready to be drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    /// Corners [1/256 samples], clockwise as seen in the picture.
    at: [[i32; 2]; 3],
    /// What is interpolated linearly over the picture: 1/z in perspective, z in a parallel projection.
    pub(super) depth: [f32; 3],
    /// Normals at the corners.
    pub(super) normals: [[f32; 3]; 3],
    /// Whether it is seen from its back.
    pub(super) is_back: bool,
    /// A number of the caller: of the surface that it belongs to, or of the triangle in it.
    pub(super) surface: u32,
}

impl Triangle {
    /// A triangle with its corners on the picture [samples]; `None` if it covers no sample.
    pub(super) fn new(
        at: [[f64; 2]; 3],
        depth: [f32; 3],
        corners: [&Corner; 3],
        surface: u32,
    ) -> Option<Self> {
        let fixed = at.map(|at| at.map(|x| (x * SUBSAMPLES).round() as i32));
        let mut made =
            Self { at: fixed, depth, normals: corners.map(|corner| corner.normal), is_back: false, surface };
        let area = made.area();
        if area == 0 {
            return None;
        }
        // With y downwards, what is counter-clockwise seen from its front is counter-clockwise to the eye: of negative area.
        made.is_back = area > 0;
        if area < 0 {
            made.at.swap(1, 2);
            made.depth.swap(1, 2);
            made.normals.swap(1, 2);
        }
        Some(made)
    }

    fn area(&self) -> i64 {
        edge(self.at[0], self.at[1], self.at[2])
    }

    /// First and last sample of its columns or rows, on a side of `length` samples; `None`: none.
    fn span(&self, side: usize, length: usize) -> Option<[usize; 2]> {
        let places = self.at.map(|at| at[side]);
        let (low, high) = (places.iter().min()?, places.iter().max()?);
        // The middle of sample i is at 256 i + 128.
        let first = (i64::from(*low) - 128).div_euclid(256).max(0);
        let last = (i64::from(*high) - 128).div_euclid(256).min(length as i64 - 1);
        (first <= last).then_some([first as usize, last as usize])
    }

    /// Calls `visit(place in the tile, weights of the corners)` for every sample of a tile that it covers.
    fn cover(&self, corner: [usize; 2], size: [usize; 2], mut visit: impl FnMut(usize, [f32; 3])) {
        let own = |side: usize| {
            let span = self.span(side, corner[side] + size[side])?;
            let first = span[0].max(corner[side]);
            (first <= span[1]).then_some([first, span[1]])
        };
        let (Some([left, right]), Some([top, bottom])) = (own(0), own(1)) else { return };
        let [a, b, c] = self.at;
        let inverse = 1.0 / self.area() as f32;
        let middle = |x: usize, y: usize| [(256 * x + 128) as i32, (256 * y + 128) as i32];
        let sides = [(b, c), (c, a), (a, b)];
        let steps = sides.map(|(from, to)| {
            let [dx, dy] = [i64::from(to[0]) - i64::from(from[0]), i64::from(to[1]) - i64::from(from[1])];
            [-dy * 256, dx * 256]
        });
        // The top-left rule: samples on other edges belong to the neighbour.
        let bias = sides.map(|(from, to)| {
            let is_top_left = to[1] < from[1] || (to[1] == from[1] && to[0] > from[0]);
            i64::from(!is_top_left)
        });
        let start = middle(left, top);
        let mut row = sides.map(|(from, to)| edge(from, to, start));
        for y in top..=bottom {
            let mut at = row;
            let first = (y - corner[1]) * size[0];
            for x in left..=right {
                if at[0] >= bias[0] && at[1] >= bias[1] && at[2] >= bias[2] {
                    visit(first + x - corner[0], at.map(|e| e as f32 * inverse));
                }
                for k in 0..3 {
                    at[k] += steps[k][0];
                }
            }
            for k in 0..3 {
                row[k] += steps[k][1];
            }
        }
    }
}

/// Twice the area of the triangle a, b, p: positive if it is clockwise as seen in the picture.
fn edge(a: [i32; 2], b: [i32; 2], p: [i32; 2]) -> i64 {
    let [ax, ay, bx, by] = [a[0], a[1], b[0], b[1]].map(i64::from);
    (bx - ax) * (i64::from(p[1]) - ay) - (by - ay) * (i64::from(p[0]) - ax)
}

/// Draws `count` triangles, which `prepare(number, list)` adds to a list, on a grid of `size` samples. `visit` gets the samples of a tile,
/// the triangle, the place in the tile and the weights of the corners.
pub(super) fn draw<T: Send>(
    tiles: &mut [Tile<T>],
    size: [usize; 2],
    count: usize,
    cancel: &CancelToken,
    prepare: impl Fn(usize, &mut Vec<Triangle>) -> LeftOut + Sync,
    visit: impl Fn(&mut [T], &Triangle, usize, [f32; 3]) + Sync,
) -> LeftOut {
    let mut left_out = LeftOut::default();
    let across = size[0].div_ceil(TILE);
    for first in (0..count).step_by(BATCH) {
        if cancel.is_cancelled() {
            break;
        }
        let batch = BATCH.min(count - first);
        let prepared = par::map_chunks(batch, par::CHUNK, |range| {
            let mut list = Vec::with_capacity(range.len());
            let mut left_out = LeftOut::default();
            for i in range {
                left_out.add(prepare(first + i, &mut list));
            }
            (list, left_out)
        });
        let mut triangles = Vec::with_capacity(batch);
        for (list, counted) in prepared {
            triangles.extend(list);
            left_out.add(counted);
        }
        let mut rest = &triangles[..];
        while !rest.is_empty() && !cancel.is_cancelled() {
            let spans =
                rest.iter().map(|triangle| Some([triangle.span(0, size[0])?, triangle.span(1, size[1])?]));
            let (lists, used) = tile_lists(spans, tiles.len(), across);
            par::for_chunks(tiles, 1, |number, tile| {
                let Tile { corner, size, samples } = &mut tile[0];
                for &i in &lists[number] {
                    let triangle = &rest[i as usize];
                    triangle.cover(*corner, *size, |place, weights| visit(samples, triangle, place, weights));
                }
            });
            rest = &rest[used..];
        }
    }
    left_out
}

/// First and last column, first and last row of what is drawn [samples].
pub(super) type Span = [[usize; 2]; 2];

/// The numbers of what each tile shows, in their order, as many as fit; and how many were looked at. `spans` has `None` for what is outside.
pub(super) fn tile_lists(
    spans: impl Iterator<Item = Option<Span>>,
    count: usize,
    across: usize,
) -> (Vec<Vec<u32>>, usize) {
    let mut lists = vec![Vec::new(); count];
    let (mut listed, mut seen) = (0, 0);
    for (number, span) in spans.enumerate() {
        if let Some(span) = span {
            let [columns, rows] = span.map(|span| span.map(|x| x / TILE));
            listed += (columns[1] - columns[0] + 1) * (rows[1] - rows[0] + 1);
            if listed > MAX_LISTED && number > 0 {
                break;
            }
            for row in rows[0]..=rows[1] {
                for column in columns[0]..=columns[1] {
                    lists[row * across + column].push(number as u32);
                }
            }
        }
        seen = number + 1;
    }
    (lists, seen)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNER: Corner = Corner { at: [0.0; 3], normal: [0.0; 3] };

    fn covered(shapes: &[[[f64; 2]; 3]], size: [usize; 2]) -> Vec<u32> {
        let mut drawn = tiles(size, 0_u32);
        let prepare = |i: usize, list: &mut Vec<Triangle>| {
            list.extend(Triangle::new(shapes[i], [1.0; 3], [&CORNER; 3], 0));
            LeftOut::default()
        };
        draw(&mut drawn, size, shapes.len(), &CancelToken::new(), prepare, |samples, _, place, weights| {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{weights:?}");
            samples[place] += 1;
        });
        let mut whole = vec![0; size[0] * size[1]];
        for tile in drawn {
            for (place, count) in tile.samples.into_iter().enumerate() {
                let (x, y) = (tile.corner[0] + place % tile.size[0], tile.corner[1] + place / tile.size[0]);
                whole[y * size[0] + x] = count;
            }
        }
        whole
    }

    #[test]
    fn a_fan_of_triangles_covers_every_sample_once() {
        let size = [200, 150];
        let mut fan = Vec::new();
        let rim = |i: usize| {
            let a = i as f64 * 0.1 * std::f64::consts::PI;
            [97.3 + 300.0 * a.cos(), 71.8 + 300.0 * a.sin()]
        };
        for i in 0..20 {
            // Of both orientations.
            let pair = if i % 2 == 0 { [rim(i), rim(i + 1)] } else { [rim(i + 1), rim(i)] };
            fan.push([[97.3, 71.8], pair[0], pair[1]]);
        }
        let whole = covered(&fan, size);
        assert!(whole.iter().all(|&count| count == 1), "{:?}", whole.iter().max());
    }

    #[test]
    fn squares_along_samples_share_none_and_miss_none() {
        // Edges through the middles of samples, where the rule alone decides.
        let square = |x: f64, y: f64, side: f64| {
            let [a, b, c, d] = [[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
            [[a, b, c], [a, c, d]]
        };
        let mut all = Vec::new();
        for i in 0..4 {
            for j in 0..4 {
                all.extend(square(0.5 + 10.0 * f64::from(i), 0.5 + 10.0 * f64::from(j), 10.0));
            }
        }
        let whole = covered(&all, [70, 70]);
        assert_eq!(whole.iter().sum::<u32>(), 40 * 40);
        assert!(whole.iter().all(|&count| count <= 1));
    }

    #[test]
    fn lists_of_tiles_are_bounded_and_nothing_is_lost() {
        // Each in every tile of 512: more entries than fit at once.
        let size = [2048, 1024];
        let large = [[-10.0, -10.0], [9000.0, -10.0], [-10.0, 9000.0]];
        let triangle = Triangle::new(large, [1.0; 3], [&CORNER; 3], 0).unwrap();
        let span = Some([triangle.span(0, size[0]).unwrap(), triangle.span(1, size[1]).unwrap()]);
        let spans = std::iter::repeat_n(span, 10_000);
        let (lists, used) = tile_lists(spans, 512, 32);
        assert_eq!(used, MAX_LISTED / 512);
        assert!(lists.iter().all(|list| list.len() == used));
    }
}
