//! Lines over a picture, such as the edges of a tank.

use super::{
    camera::Projection,
    model::{Model, is_place},
    opaque::Samples,
};

/// Width of a line [samples]: one and a half pixels.
const WIDTH: f64 = 3.0;

/// Opacity of a line in front of everything, and of one that is hidden.
const OPACITY: f32 = 0.8;
const HIDDEN_OPACITY: f32 = 0.2;

/// Part of its distance by which what lies on a line does not hide it.
const TOLERANCE: f64 = 2e-3;

/// Linear colours.
const DARK_LINE: [f32; 3] = [0.02, 0.05, 0.09];
const BRIGHT_LINE: [f32; 3] = [0.35, 0.40, 0.46];

/// Draws the lines of a model. Returns how many have an end without a finite place.
pub(super) fn draw(model: &Model, camera: &Projection, picture: &mut Samples) -> u64 {
    let colour = if model.is_dark { BRIGHT_LINE } else { DARK_LINE };
    let mut without_place = 0;
    for line in &model.lines {
        if !line.iter().all(is_place) {
            without_place += 1;
            continue;
        }
        let [mut a, mut b] = line.map(|x| camera.to_view(x.cast()));
        if a[2] < b[2] {
            std::mem::swap(&mut a, &mut b);
        }
        if a[2] <= camera.near {
            continue;
        }
        if b[2] < camera.near {
            let t = (a[2] - camera.near) / (a[2] - b[2]);
            b = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
        }
        stroke(camera, [a, b], colour, picture);
    }
    without_place
}

/// Draws a line between two places in front of the camera, in its directions [m].
fn stroke(camera: &Projection, ends: [[f64; 3]; 2], colour: [f32; 3], picture: &mut Samples) {
    let [from, to] = ends.map(|end| camera.to_screen(end));
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    // Steps along the longer side; the width is measured across the line.
    let (along, across) = if dx.abs() >= dy.abs() { (0, 1) } else { (1, 0) };
    let length = [dx, dy][along];
    let slope = if length == 0.0 { 0.0 } else { [dx, dy][across] / length };
    let half = 0.5 * WIDTH * (1.0 + slope * slope).sqrt();
    let (low, high) = (from[along].min(to[along]), from[along].max(to[along]));
    let last = camera.size[along] as f64 - 1.0;
    if high < 0.0 || low > last {
        return;
    }
    let inverse = ends.map(|end| 1.0 / end[2]);
    for step in (low.max(0.0) as usize)..=(high.min(last) as usize) {
        let t =
            if length == 0.0 { 0.0 } else { ((step as f64 + 0.5 - from[along]) / length).clamp(0.0, 1.0) };
        let depth = 1.0 / (inverse[0] + t * (inverse[1] - inverse[0]));
        let middle = from[across] + t * length * slope;
        let first = (middle - half - 0.5).ceil().max(0.0);
        let end = (middle + half - 0.5).floor().min(camera.size[across] as f64 - 1.0);
        let mut other = first;
        while other <= end {
            let place = match along {
                0 => other as usize * camera.size[0] + step,
                _ => step * camera.size[0] + other as usize,
            };
            let is_hidden = f64::from(picture.depths[place]) < depth * (1.0 - TOLERANCE);
            let opacity = if is_hidden { HIDDEN_OPACITY } else { OPACITY };
            let below = &mut picture.colours[place];
            *below = std::array::from_fn(|k| below[k] + opacity * (colour[k] - below[k]));
            other += 1.0;
        }
    }
}
