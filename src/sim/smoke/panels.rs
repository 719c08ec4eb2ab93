//! The surfaces of solids as panels.
//!
//! *Method*: nodes of a lattice that are nearer to a surface than a lattice step p are moved onto it along the normal, each with the
//! area p² (1 − |d|/p), which over a smooth surface sums to its area. Those that fall into one cell become one panel. A panel's
//! source stands inside the solid, about one and a half steps below it: its field is smooth on the surface.

use crate::{math::Vec3, solid::Shape};
use std::collections::BTreeMap;

/// How deep a source stands below its panel, in lattice steps. Nearer, the air between panels feels single sources; deeper, the
/// equations for them can hardly be told apart, and take more iterations.
const DEPTH: f32 = 1.5;

/// Where the lattice stands [steps].
const OFFSET: Vec3 = Vec3::new(0.37, 0.29, 0.43);

/// A piece of a surface, about the solid's own origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    /// Its middle [m].
    pub(super) x: Vec3,
    /// Out of the solid.
    pub(super) normal: Vec3,
    /// [m²].
    pub(super) area: f32,
    /// Where its source is [m].
    pub(super) source: Vec3,
}

/// The panels of a shape about `step` [m] wide; none for a plane.
pub(super) fn panels(shape: &Shape, step: f32) -> Vec<Panel> {
    let bounds = match shape {
        Shape::Tank { min, max } => Some((Vec3::from(*min), Vec3::from(*max))),
        _ => shape.bounds(),
    };
    let Some((low, high)) = bounds else { return Vec::new() };
    let first = low.map(|v| (v / step).floor() as i64 - 1);
    let last = high.map(|v| (v / step).ceil() as i64 + 1);

    // Area and middle by cell.
    let mut cells: BTreeMap<[i64; 3], (f32, Vec3)> = BTreeMap::new();
    for k in first.z..=last.z {
        for j in first.y..=last.y {
            for i in first.x..=last.x {
                // Off the origin, so that it does not fall into the faces of shapes of round numbers.
                let node = (Vec3::new(i as f32, j as f32, k as f32) + OFFSET) * step;
                let (distance, normal) = shape.contact(node);
                if distance.abs() >= step {
                    continue;
                }
                let area = step * step * (1.0 - distance.abs() / step);
                let x = node - normal * distance;
                let cell = cells
                    .entry([0, 1, 2].map(|axis| (x[axis] / step - OFFSET[axis]).floor() as i64))
                    .or_default();
                cell.0 += area;
                cell.1 += x * area;
            }
        }
    }
    let panel = |(area, sum): (f32, Vec3)| {
        let middle = sum / area;
        // The nearest point of the middle; its normal is asked from outside, where it has one at edges too.
        let (distance, out) = shape.contact(middle);
        let x = middle - out * distance;
        let (_, normal) = shape.contact(x + out * (0.05 * step));
        let mut depth = DEPTH * step;
        // Thin parts have their sources in their middle.
        for _ in 0..4 {
            if shape.signed_distance(x - normal * depth) < -0.6 * depth {
                break;
            }
            depth *= 0.6;
        }
        Panel { x, normal, area, source: x - normal * depth }
    };
    cells.into_values().filter(|(area, _)| *area > 0.1 * step * step).map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_have_the_area_and_the_normals_of_their_shape() {
        let step = 0.05;
        let sphere = Shape::Sphere { center: [0.1, 0.0, -0.2], radius: 0.4 };
        let cuboid = Shape::Box { min: [0.0, 0.0, 0.0], max: [0.5, 0.4, 0.3] };
        let tank = Shape::Tank { min: [0.0, 0.0, 0.0], max: [0.5, 0.4, 0.3] };
        for (shape, area, flux) in
            [(sphere, 4.0 * std::f32::consts::PI * 0.16, 0.02), (cuboid, 0.94, 0.08), (tank, 0.94, 0.2)]
        {
            let made = panels(&shape, step);
            let sum: f32 = made.iter().map(|panel| panel.area).sum();
            assert!((sum / area - 1.0).abs() < 0.1, "{shape:?}: {sum} for {area}");
            let closed: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
            assert!(closed.norm() < flux * area, "{shape:?}: {closed}");
            // Edges have no single normal, and panels there lean either way.
            let smooth = matches!(shape, Shape::Sphere { .. });
            for panel in made.iter().filter(|_| smooth) {
                assert!(shape.signed_distance(panel.x).abs() < 1e-4, "{shape:?} {panel:?}");
                assert!(shape.signed_distance(panel.source) < -0.2 * step, "{shape:?} {panel:?}");
                assert!(shape.signed_distance(panel.x + panel.normal * step) > 0.5 * step);
            }
        }
        assert!(panels(&Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] }, step).is_empty());
    }
}
