//! Shaded pictures of surfaces, balls and fog, by a rasteriser on the processor.
//!
//! *Method*: a depth buffer of two by two samples a pixel (`raster.rs`) holds what is opaque, lit by a key light with a shadow map
//! and a hemisphere (`light.rs`); liquid and glass are drawn over it (`clear.rs`), then lines, and fog by the pixel (`fog.rs`). Why not
//! a library: `docs/decisions/038-preview.md`. The bytes are the same for any number of threads.

mod camera;
mod clear;
mod clip;
mod fog;
mod ground;
mod light;
mod lines;
mod model;
mod opaque;
mod raster;

#[cfg(test)]
mod tests;

pub(crate) use camera::Viewpoint;
pub(crate) use ground::grid_cell;
pub(crate) use model::{Balls, Bounds, Fog, LeftOut, Model, Surface};

use super::Canvas;
use crate::{control::CancelToken, math::srgb, par};
use camera::Projection;
use light::Light;
use opaque::Samples;

/// Raised whenever a change gives the same model another picture, so that pictures are made again.
pub(crate) const PICTURE_VERSION: u32 = 1;

/// Samples of a pixel along each side.
const SAMPLES: usize = 2;

/// Bytes that a picture takes while it is drawn, for each pixel: the opaque samples, those of the liquid, light and depth of each.
const PIXEL_BYTES: u64 = (SAMPLES * SAMPLES) as u64 * (28 + 24 + 16 + 12) + 32;

/// Memory of the shadow map and of lists [bytes].
const BASE_BYTES: u64 = 48 << 20;

/// Memory of a drawn triangle in the lists of a batch is bounded; of a ball or a point of fog it is this [bytes].
const POINT_BYTES: u64 = 120;

/// The memory that drawing a model takes, without the model [bytes].
pub(crate) fn picture_memory(size: [usize; 2], points: u64) -> u64 {
    (size[0] * size[1]) as u64 * PIXEL_BYTES + BASE_BYTES + points * POINT_BYTES
}

/// Draws a model in an image of `size` pixels. Returns also what has no place in it.
///
/// # Panics
/// If the bounds of the model do not exist, or the camera is not valid.
pub(crate) fn render(
    model: &Model,
    view: &Viewpoint,
    size: [usize; 2],
    cancel: &CancelToken,
) -> (Canvas, LeftOut) {
    assert!(model.bounds.exists() && view.is_valid(), "callers check bounds and camera");
    let extent = model.bounds.size();
    let camera = Projection::new(view, size.map(|side| side * SAMPLES), extent);
    let light = Light::new(model, &camera, cancel);
    let (mut samples, mut left_out) = opaque::draw(model, &camera, &light, cancel);
    left_out.add(clear::draw_water(model, &camera, &light, &mut samples, cancel));
    left_out.add(clear::draw_glass(model, &camera, &light, &mut samples, cancel));
    left_out.points += lines::draw(model, &camera, &mut samples);
    let mut pixels = averaged(&samples, size);
    left_out.add(fog::draw(model, &Projection::new(view, size, extent), &light, &mut pixels, cancel));
    (developed(&pixels, size), left_out)
}

/// The mean light of the samples of each pixel, and the nearest depth.
fn averaged(samples: &Samples, size: [usize; 2]) -> Samples {
    let width = size[0] * SAMPLES;
    let of_pixel = |place: usize| {
        let first = place / size[0] * SAMPLES * width + place % size[0] * SAMPLES;
        (0..SAMPLES * SAMPLES).map(move |i| first + i / SAMPLES * width + i % SAMPLES)
    };
    let share = 1.0 / (SAMPLES * SAMPLES) as f32;
    let mut colours = par::repeated([0.0_f32; 3], size[0] * size[1]);
    par::fill(&mut colours, |place| {
        let mut sum = [0.0_f32; 3];
        for i in of_pixel(place) {
            // Bright reflections would leave steps at edges.
            (0..3).for_each(|k| sum[k] += share * samples.colours[i][k].min(2.0));
        }
        sum
    });
    let mut depths = par::repeated(0.0_f32, size[0] * size[1]);
    par::fill(&mut depths, |place| of_pixel(place).map(|i| samples.depths[i]).fold(f32::INFINITY, f32::min));
    Samples { colours, depths }
}

/// Steps of the table from linear light to bytes.
const STEPS: usize = 4096;

/// An image of linear light: a film curve (Narkowicz 2015), then sRGB.
fn developed(pixels: &Samples, size: [usize; 2]) -> Canvas {
    let table: Vec<u8> = (0..=STEPS).map(|step| srgb::to_byte(step as f32 / STEPS as f32)).collect();
    let mut bytes = par::repeated([0_u8; 3], pixels.colours.len());
    par::fill(&mut bytes, |place| {
        pixels.colours[place].map(|x| {
            let x = 0.8 * x.max(0.0);
            let film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
            table[(film.min(1.0) * STEPS as f32) as usize]
        })
    });
    Canvas::of_pixels(size[0], size[1], bytes)
}
