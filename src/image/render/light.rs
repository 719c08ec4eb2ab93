//! Light: a key light with a shadow map, a hemisphere of sky and ground, and the surroundings that water and glass mirror.

use super::{
    camera::Projection,
    clip::Corner,
    model::{LeftOut, Model, is_place},
    raster::{self, TILE, Tile, Triangle, tiles},
};
use crate::{control::CancelToken, math::Vec3};
use nalgebra::Vector3;

/// Side of the shadow map [samples]. At 512, shadows of drops are blocks; 2048 takes four times as long for hardly another picture.
const SIDE: usize = 1024;

/// The key light in the camera's level directions: right, towards the camera, up. From the upper left, a little in front.
const KEY: [f64; 3] = [-0.55, 0.42, 0.85];

/// Distance along the normal from which shadows are looked up [samples of the map]: smaller, and surfaces shade themselves in stripes;
/// larger, and shadows detach from thin bodies.
const BIAS: f64 = 1.6;

/// Light that the liquid lets through to what is below it.
const WATER_SHADOW: f32 = 0.45;

/// Irradiance of the key light, the sky and the ground, over π.
const KEY_COLOUR: [f32; 3] = [0.92, 0.87, 0.78];
const SKY_COLOUR: [f32; 3] = [0.36, 0.41, 0.48];
const FLOOR_COLOUR: [f32; 3] = [0.22, 0.21, 0.20];

/// Brightness of the surroundings where they are dark.
const DARK: f32 = 0.09;

/// Light in a shot.
pub(super) struct Light {
    /// Direction towards the key light.
    pub(super) key: Vec3,
    /// Right and upper direction of the shadow map.
    across: [Vector3<f64>; 2],
    toward: Vector3<f64>,
    middle: Vector3<f64>,
    /// Samples of the map per metre.
    scale: f64,
    /// Distance of the first opaque surface from the plane through the middle, against the light [m]; row by row.
    solids: Vec<f32>,
    /// Distance of the first surface of the liquid, likewise.
    water: Vec<f32>,
    is_dark: bool,
}

impl Light {
    /// The light of a model for this camera, with the shadows of all that casts some.
    pub(super) fn new(model: &Model, camera: &Projection, cancel: &CancelToken) -> Self {
        let level = Vector3::new(camera.axes[0].x, camera.axes[0].y, 0.0);
        let right = level.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let toward_camera = right.cross(&Vector3::z());
        let toward = (right * KEY[0] + toward_camera * KEY[1] + Vector3::z() * KEY[2]).normalize();
        let u = toward.cross(&Vector3::z()).normalize();
        let across = [u, u.cross(&toward)];
        let radius = 0.6 * model.bounds.size();
        let mut light = Self {
            key: toward.cast(),
            across,
            toward,
            middle: model.bounds.middle(),
            scale: 0.5 * SIDE as f64 / radius,
            solids: Vec::new(),
            water: Vec::new(),
            is_dark: model.is_dark,
        };
        let mut nearest = tiles([SIDE; 2], f32::INFINITY);
        light.cast(&model.solids, &mut nearest, cancel);
        light.cast_balls(model, &mut nearest, cancel);
        light.solids = joined(&nearest);
        let mut nearest = tiles([SIDE; 2], f32::INFINITY);
        light.cast(&model.water, &mut nearest, cancel);
        light.water = joined(&nearest);
        light
    }

    /// Place on the map [samples] and distance against the light [m].
    fn to_map(&self, x: Vector3<f64>) -> ([f64; 2], f64) {
        let x = x - self.middle;
        (self.across.map(|axis| axis.dot(&x) * self.scale + 0.5 * SIDE as f64), -self.toward.dot(&x))
    }

    /// Draws surfaces on the map. What they leave out is counted where they are drawn in the picture.
    fn cast(&self, surfaces: &[super::Surface], nearest: &mut [Tile<f32>], cancel: &CancelToken) {
        for surface in surfaces {
            let prepare = |i: usize, list: &mut Vec<Triangle>| {
                let Some(corners) = surface.corners(i) else { return LeftOut::default() };
                let placed = corners.map(|x| self.to_map(x));
                // Far outside of the map, integers of samples would overflow.
                let limit = 64.0 * SIDE as f64;
                if placed.iter().any(|(at, _)| at.iter().any(|x| x.abs() > limit)) {
                    return LeftOut::default();
                }
                let blank = Corner { at: [0.0; 3], normal: [0.0; 3] };
                let depth = placed.map(|(_, depth)| depth as f32);
                list.extend(Triangle::new(placed.map(|(at, _)| at), depth, [&blank; 3], 0));
                LeftOut::default()
            };
            let visit = |samples: &mut [f32], triangle: &Triangle, place: usize, weights: [f32; 3]| {
                let depth = (0..3).map(|k| weights[k] * triangle.depth[k]).sum::<f32>();
                samples[place] = samples[place].min(depth);
            };
            raster::draw(nearest, [SIDE; 2], surface.triangles.len(), cancel, prepare, visit);
        }
    }

    /// Draws balls on the map as discs, a sample wide at least.
    fn cast_balls(&self, model: &Model, nearest: &mut [Tile<f32>], cancel: &CancelToken) {
        let across = SIDE / TILE;
        for balls in &model.balls {
            for (i, x) in balls.positions.iter().enumerate().filter(|(_, x)| is_place(x)) {
                if i % 1024 == 0 && cancel.is_cancelled() {
                    return;
                }
                let (at, depth) = self.to_map(x.cast());
                let radius = (f64::from(balls.radius(i)) * self.scale).clamp(0.5, 64.0);
                let range = |x: f64| {
                    let last = SIDE as f64 - 1.0;
                    ((x - radius).clamp(0.0, last) as usize)..=((x + radius).clamp(0.0, last) as usize)
                };
                if at.iter().any(|&x| x < -radius || x > SIDE as f64 + radius) {
                    continue;
                }
                for y in range(at[1]) {
                    for x in range(at[0]) {
                        let [dx, dy] = [x as f64 + 0.5 - at[0], y as f64 + 0.5 - at[1]];
                        if dx * dx + dy * dy <= radius * radius {
                            let tile = &mut nearest[y / TILE * across + x / TILE];
                            let place = y % TILE * TILE + x % TILE;
                            tile.samples[place] = tile.samples[place].min(depth as f32);
                        }
                    }
                }
            }
        }
    }

    /// Part of the key light that reaches a point with this normal [m].
    pub(super) fn reaching(&self, x: Vector3<f64>, normal: Vec3) -> f32 {
        let step = BIAS / self.scale;
        let (at, depth) = self.to_map(x + normal.cast::<f64>() * step + self.toward * step);
        let [u, v] = at.map(|x| x - 0.5);
        if !(1.0..(SIDE - 3) as f64).contains(&u) || !(1.0..(SIDE - 3) as f64).contains(&v) {
            return 1.0;
        }
        let (column, row) = (u as usize, v as usize);
        let (fu, fv) = ((u - column as f64) as f32, (v - row as f64) as f32);
        // A box of three by three samples, moved by parts of a sample.
        let (wu, wv) = ([1.0 - fu, 1.0, 1.0, fu], [1.0 - fv, 1.0, 1.0, fv]);
        let (mut solid, mut water) = (0.0_f32, 0.0_f32);
        for (j, wv) in wv.into_iter().enumerate() {
            for (i, wu) in wu.into_iter().enumerate() {
                let place = (row + j - 1) * SIDE + column + i - 1;
                let weight = wu * wv / 9.0;
                let depth = depth as f32;
                solid += if self.solids[place] < depth { weight } else { 0.0 };
                water += if self.water[place] < depth { weight } else { 0.0 };
            }
        }
        (1.0 - solid) * (1.0 - WATER_SHADOW * water)
    }

    /// Light that a matte surface of white reflects, by its normal and the part of the key light that reaches it.
    pub(super) fn matte(&self, normal: Vec3, reaching: f32) -> [f32; 3] {
        let facing = normal.dot(&self.key).max(0.0) * reaching;
        let up = 0.5 + 0.5 * normal.z;
        let dim = if self.is_dark { 0.45 } else { 1.0 };
        std::array::from_fn(|k| {
            KEY_COLOUR[k] * facing + dim * (up * SKY_COLOUR[k] + (1.0 - up) * FLOOR_COLOUR[k])
        })
    }

    /// The surroundings in a direction, as water and glass mirror them: a sky that is brighter at the horizon, the ground, and a large
    /// soft light around the key light.
    pub(super) fn mirrored(&self, direction: Vec3) -> [f32; 3] {
        let up = direction.z;
        let sky = background(up, self.is_dark);
        let facing = direction.dot(&self.key);
        // Within about 25 degrees, soft at its edge.
        let soft = ((facing - 0.88) / 0.06).clamp(0.0, 1.0);
        let lamp = 2.4 * soft * soft * (3.0 - 2.0 * soft);
        std::array::from_fn(|k| sky[k] + lamp * KEY_COLOUR[k])
    }
}

/// The surroundings behind everything, by the upward component of the direction.
pub(super) fn background(up: f32, is_dark: bool) -> [f32; 3] {
    let height = (up * 2.2).clamp(0.0, 1.0);
    let [horizon, zenith, floor] = [[0.40, 0.45, 0.51], [0.17, 0.25, 0.36], [0.22, 0.23, 0.25]];
    let depth = (-up * 3.0).clamp(0.0, 1.0);
    let scale = if is_dark { DARK } else { 1.0 };
    std::array::from_fn(|k| {
        let sky: f32 = horizon[k] + height * (zenith[k] - horizon[k]);
        scale * (sky + depth * (floor[k] - sky))
    })
}

/// The tiles as rows of the map.
fn joined(tiles: &[Tile<f32>]) -> Vec<f32> {
    let across = SIDE / TILE;
    crate::par::map_chunks(SIDE * SIDE, SIDE, |range| {
        let y = range.start / SIDE;
        let row = y % TILE * TILE;
        let tiles = &tiles[y / TILE * across..][..across];
        tiles.iter().flat_map(|tile| tile.samples[row..row + TILE].iter().copied()).collect::<Vec<f32>>()
    })
    .concat()
}
