//! The opaque part of a picture: surfaces, balls and the ground in a depth buffer, shaded where they are nearest.

use super::{
    camera::Projection,
    clip::{Corner, Frustum},
    ground::Ground,
    light::{Light, background},
    model::{Balls, LeftOut, Model, Surface, is_place},
    raster::{self, Span, TILE, Tile, Triangle, tiles},
};
use crate::{control::CancelToken, math::Vec3, par};

/// Samples that surfaces may reach beyond the picture before they are cut, in widths and heights of it.
const GUARD: f64 = 4.0;

/// The smallest radius of a drawn ball [samples]: smaller ones would fall between samples.
const MIN_RADIUS: f64 = 0.75;

/// What is nearest at a sample.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    /// Distance along the view direction of the camera [m].
    depth: f32,
    /// In the world's directions, of any length.
    normal: [f32; 3],
    colour: [f32; 3],
}

/// A picture of samples, row by row.
#[derive(Clone, Debug)]
pub(super) struct Samples {
    /// Linear light.
    pub(super) colours: Vec<[f32; 3]>,
    /// Distance of what is nearest along the view direction of the camera [m]; infinite: the background.
    pub(super) depths: Vec<f32>,
}

/// The part of space that triangles are cut at.
pub(super) fn frustum(camera: &Projection) -> Frustum {
    let slope = |side: usize| GUARD * 0.5 * camera.size[side] as f64 / camera.focal;
    Frustum::new(camera.near, [slope(0), slope(1)])
}

/// Adds the parts of a triangle of a surface that can be drawn to a list.
pub(super) fn prepare(
    camera: &Projection,
    frustum: &Frustum,
    surface: (u32, &Surface),
    triangle: usize,
    list: &mut Vec<Triangle>,
) -> LeftOut {
    let (number, surface) = surface;
    let Some(places) = surface.corners(triangle) else {
        return LeftOut { triangles: 1, ..LeftOut::default() };
    };
    let normals = surface.normals_at(triangle);
    let corners: [Corner; 3] =
        std::array::from_fn(|k| Corner { at: camera.to_view(places[k]), normal: normals[k] });
    // Most triangles are smaller than a picture, and need no cutting.
    let mut polygon = Vec::new();
    frustum.clip(&corners, &mut polygon);
    for k in 2..polygon.len() {
        let part = [&polygon[0], &polygon[k - 1], &polygon[k]];
        let at = part.map(|corner| camera.to_screen(corner.at));
        list.extend(Triangle::new(at, part.map(|corner| (1.0 / corner.at[2]) as f32), part, number));
    }
    LeftOut::default()
}

/// Depth and normal of a sample of a triangle.
pub(super) fn interpolated(triangle: &Triangle, weights: [f32; 3]) -> (f32, [f32; 3]) {
    let parts: [f32; 3] = std::array::from_fn(|k| weights[k] * triangle.depth[k]);
    let normal = std::array::from_fn(|axis| (0..3).map(|k| parts[k] * triangle.normals[k][axis]).sum());
    (1.0 / (parts[0] + parts[1] + parts[2]), normal)
}

/// Draws and shades everything opaque.
pub(super) fn draw(
    model: &Model,
    camera: &Projection,
    light: &Light,
    cancel: &CancelToken,
) -> (Samples, LeftOut) {
    let blank = Nearest { depth: f32::INFINITY, normal: [0.0; 3], colour: [0.0; 3] };
    let mut nearest = tiles(camera.size, blank);
    let mut left_out = LeftOut::default();
    let frustum = frustum(camera);
    for surface in &model.solids {
        let prepare =
            |i: usize, list: &mut Vec<Triangle>| prepare(camera, &frustum, (i as u32, surface), i, list);
        let visit = |samples: &mut [Nearest], triangle: &Triangle, place: usize, weights: [f32; 3]| {
            let (depth, normal) = interpolated(triangle, weights);
            if depth < samples[place].depth {
                let normal = if triangle.is_back { normal.map(|x| -x) } else { normal };
                let colour = surface.colour(triangle.surface as usize, triangle.is_back);
                samples[place] = Nearest { depth, normal, colour };
            }
        };
        left_out.add(raster::draw(
            &mut nearest,
            camera.size,
            surface.triangles.len(),
            cancel,
            prepare,
            visit,
        ));
    }
    for balls in &model.balls {
        left_out.add(draw_balls(balls, camera, &mut nearest, cancel));
    }
    let ground = model.ground.map(|height| Ground::new(height, model, camera));
    (shade(nearest, camera, light, ground.as_ref(), model.is_dark), left_out)
}

/// A ball with its place on the picture.
struct PlacedBall {
    center: [f64; 3],
    radius: f64,
    colour: [f32; 3],
    span: Span,
}

/// Draws balls as they are seen in perspective.
fn draw_balls(
    balls: &Balls,
    camera: &Projection,
    nearest: &mut [Tile<Nearest>],
    cancel: &CancelToken,
) -> LeftOut {
    let placed = par::map_chunks(balls.positions.len(), par::CHUNK, |range| {
        let mut list = Vec::with_capacity(range.len());
        let mut left_out = LeftOut::default();
        for i in range {
            match is_place(&balls.positions[i]).then(|| place(balls, i, camera)) {
                Some(Placed::Seen(ball)) => list.push(ball),
                Some(Placed::Outside) => {}
                Some(Placed::AtCamera) => left_out.at_camera += 1,
                None => left_out.points += 1,
            }
        }
        (list, left_out)
    });
    let mut left_out = LeftOut::default();
    placed.iter().for_each(|(_, counted)| left_out.add(*counted));
    let placed: Vec<PlacedBall> = placed.into_iter().flat_map(|(list, _)| list).collect();
    let across = camera.size[0].div_ceil(TILE);
    let mut rest = &placed[..];
    while !rest.is_empty() && !cancel.is_cancelled() {
        let (lists, used) =
            raster::tile_lists(rest.iter().map(|ball| Some(ball.span)), nearest.len(), across);
        par::for_chunks(nearest, 1, |number, tile| {
            for &i in &lists[number] {
                draw_ball(&rest[i as usize], camera, &mut tile[0]);
            }
        });
        rest = &rest[used..];
    }
    left_out
}

/// Where a ball is.
enum Placed {
    Seen(PlacedBall),
    /// Behind the camera or outside the picture.
    Outside,
    /// Around the camera or its near plane, so that it has no outline.
    AtCamera,
}

/// Where a ball is on the picture.
fn place(balls: &Balls, i: usize, camera: &Projection) -> Placed {
    let center = camera.to_view(balls.positions[i].cast());
    let pixel = center[2] / camera.focal;
    let radius = f64::from(balls.radius(i)).max(MIN_RADIUS * pixel);
    if center[2] + radius <= camera.near {
        return Placed::Outside;
    }
    if center[2] - radius <= camera.near {
        return Placed::AtCamera;
    }
    let mut span = [[0; 2]; 2];
    for side in 0..2 {
        // The two tangents from the camera, in the plane of this side and the view direction.
        let (x, z) = (center[side], center[2]);
        let root = radius * (x * x + z * z - radius * radius).sqrt();
        let scale = 1.0 / (z * z - radius * radius);
        let middle = 0.5 * camera.size[side] as f64;
        let low = middle + camera.focal * (x * z - root) * scale - 0.5;
        let high = middle + camera.focal * (x * z + root) * scale - 0.5;
        let last = camera.size[side] as f64 - 1.0;
        if high < 0.0 || low > last {
            return Placed::Outside;
        }
        span[side] = [low.max(0.0).floor() as usize, high.min(last).ceil() as usize];
        span[side][1] = span[side][1].min(camera.size[side] - 1);
    }
    Placed::Seen(PlacedBall { center, radius, colour: balls.colour(i), span })
}

/// Draws a ball in a tile.
fn draw_ball(ball: &PlacedBall, camera: &Projection, tile: &mut Tile<Nearest>) {
    let own = |side: usize| {
        let first = ball.span[side][0].max(tile.corner[side]);
        first..(ball.span[side][1] + 1).min(tile.corner[side] + tile.size[side])
    };
    let c = ball.center;
    let beyond = c.iter().map(|x| x * x).sum::<f64>() - ball.radius * ball.radius;
    for y in own(1) {
        for x in own(0) {
            // The nearer of the two places where |t d − c| = r.
            let d = camera.ray(x, y);
            let along = d[0] * c[0] + d[1] * c[1] + c[2];
            let square = d[0] * d[0] + d[1] * d[1] + 1.0;
            let root = along * along - square * beyond;
            if root < 0.0 {
                continue;
            }
            let depth = (along - root.sqrt()) / square;
            let sample = &mut tile.samples[(y - tile.corner[1]) * tile.size[0] + x - tile.corner[0]];
            if (depth as f32) < sample.depth {
                let normal = camera.to_world(std::array::from_fn(|k| d[k] * depth - c[k]));
                let normal = normal.cast::<f32>().into();
                *sample = Nearest { depth: depth as f32, normal, colour: ball.colour };
            }
        }
    }
}

/// Light of every sample.
fn shade(
    nearest: Vec<Tile<Nearest>>,
    camera: &Projection,
    light: &Light,
    ground: Option<&Ground>,
    is_dark: bool,
) -> Samples {
    let [width, height] = camera.size;
    let across = width.div_ceil(TILE);
    let mut colours = par::repeated([0.0_f32; 3], width * height);
    let mut depths = par::repeated(0.0_f32, width * height);
    let row_of = |y: usize, number: usize| {
        let tile = &nearest[y / TILE * across + number];
        let first = y % TILE * tile.size[0];
        &tile.samples[first..first + tile.size[0]]
    };
    par::for_chunks(&mut depths, width, |first, row| {
        let y = first / width;
        let samples = (0..across).flat_map(|number| row_of(y, number));
        for (x, (slot, sample)) in row.iter_mut().zip(samples).enumerate() {
            let ray = camera.to_world(camera.ray(x, y));
            let floor = ground.and_then(|ground| ground.depth(ray)).unwrap_or(f32::INFINITY);
            *slot = sample.depth.min(floor);
        }
    });
    par::for_chunks(&mut colours, width, |first, row| {
        let y = first / width;
        let samples = (0..across).flat_map(|number| row_of(y, number));
        for (x, (slot, sample)) in row.iter_mut().zip(samples).enumerate() {
            let ray = camera.to_world(camera.ray(x, y));
            let floor = ground.and_then(|ground| Some((ground, ground.depth(ray)?)));
            *slot = match floor.filter(|(_, depth)| *depth < sample.depth) {
                Some((ground, depth)) => ground.colour(ray, depth, light),
                None if sample.depth == f32::INFINITY => background(ray.normalize().z as f32, is_dark),
                None => {
                    let at = camera.eye + ray * f64::from(sample.depth);
                    let normal = Vec3::from(sample.normal);
                    let normal = normal.try_normalize(0.0).unwrap_or_else(Vec3::z);
                    // Interpolated normals may look away at silhouettes.
                    let ray = ray.cast::<f32>();
                    let away = normal.dot(&ray) / ray.norm_squared();
                    let normal = if away > 0.0 { (normal - ray * away).normalize() } else { normal };
                    let lit = light.matte(normal, light.reaching(at, normal));
                    std::array::from_fn(|k| sample.colour[k] * lit[k])
                }
            };
        }
    });
    Samples { colours, depths }
}
