//! Clear liquid and glass in front of the opaque part of a picture.
//!
//! *Method*: of the liquid the nearest face and the thickness along the view are drawn, the sum of the distances of its backs less those of
//! its fronts, as far as they are in front of what is opaque. The surface mirrors the surroundings by Fresnel's factor (Schlick 1994) and shows what
//! is behind it where a refracted ray of that length ends in the picture, tinted by absorption (Beer–Lambert).
//!
//! *Limits*: one refraction; what is hidden in the picture is not seen through the liquid; glass mirrors and dims, and does not refract.

use super::{
    camera::Projection,
    light::Light,
    model::{LeftOut, Model},
    opaque::{self, Samples},
    raster::{self, TILE, Tile, Triangle, tiles},
};
use crate::{
    control::CancelToken,
    math::{Vec3, elementary::exp},
    par,
};
use nalgebra::Vector3;

/// Refractive index of water.
const INDEX: f32 = 1.33;

/// Absorption of red, green and blue over the diagonal of what is shown: not that of water, of which a cup would be colourless and a
/// harbour black.
const ABSORPTION: [f32; 3] = [6.0, 2.1, 1.2];

/// Colour of deep liquid, lit from above.
const DEEP: [f32; 3] = [0.03, 0.20, 0.27];

/// Colour of a veil over the surface, lit by its normals, and its part: without it, waves in front of a plain ground are hardly seen.
const VEIL: [f32; 3] = [0.42, 0.62, 0.70];
const VEIL_PART: f32 = 0.16;

/// Longest refracted ray, in parts of the diagonal of what is shown: what is deeper is tinted, not displaced further.
const MAX_REFRACTED: f32 = 0.25;

/// Part of the light that a face of glass takes away.
const GLASS_DIMS: f32 = 0.035;

/// The liquid at a sample.
#[derive(Clone, Copy, Debug)]
struct Layer {
    /// Distance of the nearest face along the view direction of the camera [m].
    front: f32,
    normal: [f32; 3],
    /// Along the view direction of the camera [m].
    thickness: f32,
}

/// Draws the liquid of a model over the opaque part of its picture. Depths are then those of its surface.
pub(super) fn draw_water(
    model: &Model,
    camera: &Projection,
    light: &Light,
    picture: &mut Samples,
    cancel: &CancelToken,
) -> LeftOut {
    let mut left_out = LeftOut::default();
    if model.water.iter().all(|surface| surface.triangles.is_empty()) {
        return left_out;
    }
    let frustum = opaque::frustum(camera);
    let blank = Layer { front: f32::INFINITY, normal: [0.0; 3], thickness: 0.0 };
    let mut drawn = tiles(camera.size, (f32::INFINITY, blank));
    let width = camera.size[0];
    par::for_chunks(&mut drawn, 1, |_, tile| {
        let Tile { corner, size, samples } = &mut tile[0];
        for (place, (behind, _)) in samples.iter_mut().enumerate() {
            *behind = picture.depths[(corner[1] + place / size[0]) * width + corner[0] + place % size[0]];
        }
    });
    for surface in &model.water {
        let prepare =
            |i: usize, list: &mut Vec<Triangle>| opaque::prepare(camera, &frustum, (0, surface), i, list);
        let visit = |samples: &mut [(f32, Layer)], triangle: &Triangle, place: usize, weights: [f32; 3]| {
            let (depth, normal) = opaque::interpolated(triangle, weights);
            let (behind, layer) = &mut samples[place];
            let reached = depth.min(*behind);
            layer.thickness += if triangle.is_back { reached } else { -reached };
            if depth < layer.front && depth < *behind {
                let sign = if triangle.is_back { -1.0 } else { 1.0 };
                (layer.front, layer.normal) = (depth, normal.map(|x| sign * x));
            }
        };
        let count = surface.triangles.len();
        left_out.add(raster::draw(&mut drawn, camera.size, count, cancel, prepare, visit));
    }
    let water = Water { camera, light, extent: model.bounds.size() as f32, behind: &*picture };
    let shaded = par::map_chunks(picture.colours.len(), width, |range| {
        let y = range.start / width;
        let across = width.div_ceil(TILE);
        let mut row = Vec::with_capacity(width);
        for tile in &drawn[y / TILE * across..][..across] {
            let first = y % TILE * tile.size[0];
            for (x, (_, layer)) in tile.samples[first..first + tile.size[0]].iter().enumerate() {
                row.push(water.seen(tile.corner[0] + x, y, layer));
            }
        }
        row
    });
    let shaded: Vec<[f32; 3]> = shaded.concat();
    picture.colours = shaded;
    par::for_chunks(&mut picture.depths, width, |first, row| {
        let y = first / width;
        for (x, depth) in row.iter_mut().enumerate() {
            let tile = &drawn[y / TILE * width.div_ceil(TILE) + x / TILE];
            let layer = &tile.samples[y % TILE * tile.size[0] + x % TILE].1;
            *depth = depth.min(layer.front);
        }
    });
    left_out
}

/// What decides how liquid looks.
struct Water<'a> {
    camera: &'a Projection,
    light: &'a Light,
    /// Diagonal of what is shown [m].
    extent: f32,
    /// The opaque part of the picture.
    behind: &'a Samples,
}

impl Water<'_> {
    /// Light of a sample with this liquid in front.
    fn seen(&self, x: usize, y: usize, layer: &Layer) -> [f32; 3] {
        let place = y * self.camera.size[0] + x;
        if layer.front == f32::INFINITY {
            return self.behind.colours[place];
        }
        let ray = self.camera.to_world(self.camera.ray(x, y));
        let at = self.camera.eye + ray * f64::from(layer.front);
        let slant = ray.norm() as f32;
        let d: Vec3 = ray.cast::<f32>() / slant;
        let normal = Vec3::from(layer.normal).try_normalize(0.0).unwrap_or(-d);
        // Interpolated normals may look away at silhouettes.
        let away = normal.dot(&d);
        let normal = if away > -1e-3 { (normal - d * (away + 1e-3)).normalize() } else { normal };
        let facing = -normal.dot(&d);
        let grazing = 1.0 - facing;
        let mirrored = 0.02 + 0.98 * grazing * grazing * grazing * grazing * grazing;
        let reflected = self.light.mirrored(d + normal * (2.0 * facing));
        let thickness = (layer.thickness * slant).clamp(0.0, 4.0 * self.extent);
        let through = self.refracted(place, at, d, normal, facing, thickness);
        let reaching = self.light.reaching(at, normal);
        let lit = self.light.matte(Vec3::z(), 0.35 + 0.65 * reaching);
        let veil = self.light.matte(normal, reaching);
        std::array::from_fn(|k| {
            let kept = exp(-ABSORPTION[k] * thickness / self.extent);
            let inside = through[k] * kept + DEEP[k] * lit[k] * (1.0 - kept);
            let inside = inside + VEIL_PART * (VEIL[k] * veil[k] - inside);
            mirrored * reflected[k] + (1.0 - mirrored) * inside
        })
    }

    /// The opaque picture where the refracted ray ends, or straight behind if something is in front of the liquid there.
    fn refracted(
        &self,
        place: usize,
        at: Vector3<f64>,
        d: Vec3,
        normal: Vec3,
        facing: f32,
        thickness: f32,
    ) -> [f32; 3] {
        let ratio = 1.0 / INDEX;
        // Snell's law; into the denser medium there is always a refracted ray.
        let cosine = (1.0 - ratio * ratio * (1.0 - facing * facing)).max(0.0).sqrt();
        let bent = d * ratio + normal * (ratio * facing - cosine);
        let length = thickness.min(MAX_REFRACTED * self.extent);
        let end = self.camera.to_view(at + (bent * length).cast::<f64>());
        let straight = self.behind.colours[place];
        if end[2] <= self.camera.near {
            return straight;
        }
        let [x, y] = self.camera.to_screen(end);
        let [width, height] = self.camera.size;
        if !(0.0..width as f64).contains(&x) || !(0.0..height as f64).contains(&y) {
            return straight;
        }
        let there = y as usize * width + x as usize;
        let front = self.camera.to_view(at)[2] as f32;
        if self.behind.depths[there] < front { straight } else { self.behind.colours[there] }
    }
}

/// The glass at a sample.
#[derive(Clone, Copy, Debug)]
struct Glass {
    /// Distance of what is behind along the view direction of the camera [m].
    behind: f32,
    /// Part of the light from behind that passes.
    passed: f32,
    /// Light that it mirrors.
    mirrored: [f32; 3],
}

/// Draws the glass of a model over its picture: each face in front of what is opaque or liquid mirrors a little and dims a little.
pub(super) fn draw_glass(
    model: &Model,
    camera: &Projection,
    light: &Light,
    picture: &mut Samples,
    cancel: &CancelToken,
) -> LeftOut {
    let mut left_out = LeftOut::default();
    if model.glass.iter().all(|surface| surface.triangles.is_empty()) {
        return left_out;
    }
    let frustum = opaque::frustum(camera);
    let width = camera.size[0];
    let mut drawn = tiles(camera.size, Glass { behind: 0.0, passed: 1.0, mirrored: [0.0; 3] });
    par::for_chunks(&mut drawn, 1, |_, tile| {
        let Tile { corner, size, samples } = &mut tile[0];
        for (place, glass) in samples.iter_mut().enumerate() {
            glass.behind =
                picture.depths[(corner[1] + place / size[0]) * width + corner[0] + place % size[0]];
        }
    });
    // The view direction at a sample is nearly that at the triangle: that of its first corner decides what it mirrors.
    for surface in &model.glass {
        let prepare = |i: usize, list: &mut Vec<Triangle>| {
            opaque::prepare(camera, &frustum, (i as u32, surface), i, list)
        };
        let visit = |samples: &mut [Glass], triangle: &Triangle, place: usize, weights: [f32; 3]| {
            let (depth, normal) = opaque::interpolated(triangle, weights);
            if depth >= samples[place].behind {
                return;
            }
            let Some([corner, ..]) = surface.corners(triangle.surface as usize) else { return };
            let d = (corner - camera.eye).normalize().cast::<f32>();
            let mut normal = Vec3::from(normal).try_normalize(0.0).unwrap_or(-d);
            if normal.dot(&d) > 0.0 {
                normal = -normal;
            }
            let facing = -normal.dot(&d);
            let grazing = 1.0 - facing;
            let part = 0.04 + 0.96 * grazing * grazing * grazing * grazing * grazing;
            let mirrored = light.mirrored(d + normal * (2.0 * facing));
            let glass = &mut samples[place];
            glass.passed *= 1.0 - (GLASS_DIMS + part).min(1.0);
            (0..3).for_each(|k| glass.mirrored[k] += part * mirrored[k]);
        };
        let count = surface.triangles.len();
        left_out.add(raster::draw(&mut drawn, camera.size, count, cancel, prepare, visit));
    }
    par::for_chunks(&mut picture.colours, width, |first, row| {
        let y = first / width;
        for (x, colour) in row.iter_mut().enumerate() {
            let tile = &drawn[y / TILE * width.div_ceil(TILE) + x / TILE];
            let glass = &tile.samples[y % TILE * tile.size[0] + x % TILE];
            *colour = std::array::from_fn(|k| colour[k] * glass.passed + glass.mirrored[k].min(1.5));
        }
    });
    left_out
}
