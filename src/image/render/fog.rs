//! Fog of points, such as the tracers of smoke.
//!
//! *Method*: every point adds its optical depth to the pixels around it, with a kernel as wide as its distance from its neighbours, and its
//! light in proportion. The light of a point is what a grid along the key light lets through: optical depths are summed slice by
//! slice. So the order of the points does not matter, and fog shades itself.
//!
//! *Limits*: fog in front of fog has the mean light of both.

use super::{
    camera::Projection,
    light::Light,
    model::{Fog, LeftOut, Model, is_place},
    opaque::Samples,
};
use crate::{
    control::CancelToken,
    math::{Vec3, elementary::exp},
    par,
};
use nalgebra::Vector3;

/// Full fog of this thickness lets 1/e of the light through [diagonals of what is shown].
const MEAN_FREE_PATH: f64 = 0.05;

/// Part of the absorption that counts towards the key light: multiple scattering brightens the far side.
const SELF_SHADOW: f32 = 0.8;

/// Largest number of cells of the light's grid along an axis.
const MAX_CELLS: usize = 96;

/// Radius of a point's kernel [distances between points]. Smaller, and points show; larger, and thin fog is blurred.
const KERNEL: f64 = 1.5;

/// Largest and smallest radius of a kernel [pixels], which bound the time.
const MAX_RADIUS: f64 = 40.0;
const MIN_RADIUS: f64 = 1.0;

/// Side of a tile [pixels].
const TILE: usize = 32;

/// Light that fog reflects of the key light and of the surroundings.
const KEY: [f32; 3] = [0.66, 0.63, 0.58];
const SKY: [f32; 3] = [0.10, 0.12, 0.15];

/// A point on the picture.
#[derive(Clone, Copy)]
struct Splat {
    at: [f32; 2],
    radius: f32,
    depth: f32,
    /// Optical depth in the middle of its kernel.
    peak: f32,
    /// Part of the key light that reaches it.
    lit: f32,
}

/// Optical depth of a pixel, and its sum times the light of the points.
type Column = [f32; 2];

/// Draws the fog of a model over a picture with one sample a pixel; `depths` are those of what hides it.
pub(super) fn draw(
    model: &Model,
    camera: &Projection,
    light: &Light,
    picture: &mut Samples,
    cancel: &CancelToken,
) -> LeftOut {
    let mut left_out = LeftOut::default();
    let extent = model.bounds.size();
    let mut splats = Vec::new();
    for fog in &model.fog {
        if cancel.is_cancelled() {
            return left_out;
        }
        let grid = LightGrid::new(fog, light, extent);
        let placed = par::map_chunks(fog.positions.len(), par::CHUNK, |range| {
            let with_place = range.filter(|&i| is_place(&fog.positions[i]));
            let placed: Vec<(usize, Option<Splat>)> =
                with_place.map(|i| (i, splat(fog, i, camera, &grid, extent))).collect();
            placed
        });
        let placed: Vec<(usize, Option<Splat>)> = placed.concat();
        left_out.points += (fog.positions.len() - placed.len()) as u64;
        splats.extend(placed.into_iter().filter_map(|(_, splat)| splat));
    }
    if splats.is_empty() {
        return left_out;
    }
    let columns = columns(&splats, camera.size, &picture.depths, (KERNEL * 0.02 * extent) as f32);
    let [width, _] = camera.size;
    let across = width.div_ceil(TILE);
    par::for_chunks(&mut picture.colours, width, |first, row| {
        let y = first / width;
        for (x, colour) in row.iter_mut().enumerate() {
            let [depth, lit] = columns[y / TILE * across + x / TILE][y % TILE * TILE + x % TILE];
            if depth > 0.0 {
                let passed = exp(-depth);
                let lit = lit / depth;
                *colour =
                    std::array::from_fn(|k| colour[k] * passed + (1.0 - passed) * (KEY[k] * lit + SKY[k]));
            }
        }
    });
    left_out
}

/// A point on the picture; `None` if it is not in front of the camera, or has no density.
fn splat(fog: &Fog, i: usize, camera: &Projection, grid: &LightGrid, extent: f64) -> Option<Splat> {
    let x = camera.to_view(fog.positions[i].cast());
    let density = fog.density(i);
    if x[2] <= camera.near || density == 0.0 {
        return None;
    }
    let pixel = x[2] / camera.focal;
    let radius = (KERNEL * f64::from(fog.spacing) / pixel).clamp(MIN_RADIUS, MAX_RADIUS);
    // The kernel (1 − q²)² has the integral π r²/3.
    let volume = f64::from(fog.spacing).powi(3) * f64::from(density);
    let area = std::f64::consts::PI * (radius * pixel) * (radius * pixel) / 3.0;
    let peak = volume / area / (MEAN_FREE_PATH * extent);
    let at = camera.to_screen(x).map(|x| x as f32);
    let lit = grid.reaching(&fog.positions[i]);
    Some(Splat { at, radius: radius as f32, depth: x[2] as f32, peak: peak.min(1e6) as f32, lit })
}

/// The optical depths of all pixels, tile by tile. `softness` is the depth over which what hides fog fades it [m].
fn columns(splats: &[Splat], size: [usize; 2], depths: &[f32], softness: f32) -> Vec<Vec<Column>> {
    let counts = size.map(|side| side.div_ceil(TILE));
    let mut lists: Vec<Vec<u32>> = vec![Vec::new(); counts[0] * counts[1]];
    for (number, splat) in splats.iter().enumerate() {
        let span = |side: usize| {
            let last = size[side] as f32 - 1.0;
            let (low, high) = (splat.at[side] - splat.radius, splat.at[side] + splat.radius);
            (high >= 0.0 && low <= last)
                .then(|| (low.max(0.0) as usize / TILE)..=(high.min(last) as usize / TILE))
        };
        let (Some(columns), Some(rows)) = (span(0), span(1)) else { continue };
        for row in rows {
            for column in columns.clone() {
                lists[row * counts[0] + column].push(number as u32);
            }
        }
    }
    par::map(lists.len(), |number| {
        let mut tile = vec![[0.0; 2]; TILE * TILE];
        let corner = [number % counts[0] * TILE, number / counts[0] * TILE];
        for &i in &lists[number] {
            add(&splats[i as usize], corner, size, depths, softness, &mut tile);
        }
        tile
    })
}

/// Adds a point to the pixels of a tile.
fn add(
    splat: &Splat,
    corner: [usize; 2],
    size: [usize; 2],
    depths: &[f32],
    softness: f32,
    tile: &mut [Column],
) {
    let own = |side: usize| {
        let low = (splat.at[side] - splat.radius - 0.5).ceil().max(corner[side] as f32) as usize;
        let end = (corner[side] + TILE).min(size[side]);
        let high = (splat.at[side] + splat.radius - 0.5).floor() + 1.0;
        low..(high.max(0.0) as usize).min(end)
    };
    let inverse = 1.0 / (splat.radius * splat.radius);
    for y in own(1) {
        for x in own(0) {
            let [dx, dy] = [x as f32 + 0.5 - splat.at[0], y as f32 + 0.5 - splat.at[1]];
            let q = 1.0 - (dx * dx + dy * dy) * inverse;
            if q <= 0.0 {
                continue;
            }
            let in_front = ((depths[y * size[0] + x] - splat.depth) / softness + 0.5).clamp(0.0, 1.0);
            let depth = splat.peak * q * q * in_front;
            let column = &mut tile[(y - corner[1]) * TILE + x - corner[0]];
            column[0] += depth;
            column[1] += depth * splat.lit;
        }
    }
}

/// Optical depths towards the key light, on a grid in its directions.
struct LightGrid {
    axes: [Vector3<f64>; 3],
    low: [f64; 3],
    cell: f64,
    counts: [usize; 3],
    /// From the light to the middle of each cell; x fastest, then y.
    depths: Vec<f32>,
}

impl LightGrid {
    fn new(fog: &Fog, light: &Light, extent: f64) -> Self {
        let toward = light.key.cast::<f64>();
        let u = toward.cross(&Vector3::z()).normalize();
        let axes = [u, u.cross(&toward), -toward];
        let place = |x: &Vec3| axes.map(|axis| axis.dot(&x.cast::<f64>()));
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in fog.positions.iter().filter(|x| is_place(x)) {
            let at = place(x);
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(at[k]), high[k].max(at[k]));
            }
        }
        let longest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let cell = (longest / (MAX_CELLS - 2) as f64).max(f64::from(fog.spacing)).max(1e-12);
        let counts =
            std::array::from_fn(
                |k| {
                    if low[k] <= high[k] { ((high[k] - low[k]) / cell) as usize + 2 } else { 1 }
                },
            );
        let mut made = Self { axes, low, cell, counts, depths: vec![0.0; counts.iter().product()] };
        // A point in a cell: its volume over the cell's cross-section.
        let each = f64::from(fog.spacing).powi(3) / (cell * cell) / (MEAN_FREE_PATH * extent);
        for (i, x) in fog.positions.iter().enumerate().filter(|(_, x)| is_place(x)) {
            let share = (each * f64::from(fog.density(i))) as f32;
            for (cell, weight) in made.around(place(x)) {
                made.depths[cell] += share * weight;
            }
        }
        let slice = counts[0] * counts[1];
        let mut sum = vec![0.0_f32; slice];
        for layer in made.depths.chunks_mut(slice) {
            for (sum, depth) in sum.iter_mut().zip(layer) {
                // Half of its own cell is between it and the light.
                let own = *depth;
                *depth = *sum + 0.5 * own;
                *sum += own;
            }
        }
        made
    }

    /// The eight cells around a place, with their weights.
    fn around(&self, at: [f64; 3]) -> [(usize, f32); 8] {
        let at: [f64; 3] = std::array::from_fn(|k| {
            ((at[k] - self.low[k]) / self.cell).clamp(0.0, (self.counts[k] - 1) as f64)
        });
        let first = at.map(|x| x as usize);
        let part: [f32; 3] = std::array::from_fn(|k| (at[k] - first[k] as f64) as f32);
        std::array::from_fn(|i| {
            let (mut place, mut weight) = ([0; 3], 1.0);
            for k in 0..3 {
                let is_next = i >> k & 1 == 1;
                place[k] = (first[k] + usize::from(is_next)).min(self.counts[k] - 1);
                weight *= if is_next { part[k] } else { 1.0 - part[k] };
            }
            ((place[2] * self.counts[1] + place[1]) * self.counts[0] + place[0], weight)
        })
    }

    /// Part of the key light that reaches a place.
    fn reaching(&self, x: &Vec3) -> f32 {
        let at = self.axes.map(|axis| axis.dot(&x.cast::<f64>()));
        let depth: f32 = self.around(at).into_iter().map(|(cell, weight)| weight * self.depths[cell]).sum();
        exp(-SELF_SHADOW * depth)
    }
}
