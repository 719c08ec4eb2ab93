//! The ground: an unbounded plane with a grid, which fades into the background.

use super::{
    camera::Projection,
    light::{Light, background},
    model::Model,
};
use crate::math::Vec3;
use nalgebra::Vector3;

/// Cells of the grid along the diagonal of what is shown, at most.
const MAX_CELLS: f64 = 12.0;

/// Width of a line, in cells.
const LINE: f64 = 0.018;

/// Distance at which the ground is half faded, in diagonals of what is shown.
const FADE: f64 = 4.0;

/// Linear colours.
const FLOOR: [f32; 3] = [0.31, 0.33, 0.35];
const LINES: [f32; 3] = [0.15, 0.17, 0.20];
const DARK_FLOOR: [f32; 3] = [0.055, 0.058, 0.065];
const DARK_LINES: [f32; 3] = [0.10, 0.105, 0.12];

/// The ground of a model.
pub(super) struct Ground {
    height: f64,
    eye: Vector3<f64>,
    middle: Vector3<f64>,
    /// Distance at which it is half faded [m].
    fade: f64,
    /// Side of a cell [m].
    cell: f64,
    /// Samples per unit of tangent.
    focal: f64,
    is_dark: bool,
}

/// Side of a cell of the ground's grid [m]: 1, 2 or 5 times a power of ten.
pub(crate) fn grid_cell(extent: f64) -> f64 {
    let smallest = extent / MAX_CELLS;
    let mut decade = 1.0;
    while decade > smallest {
        decade /= 10.0;
    }
    while decade * 10.0 < smallest {
        decade *= 10.0;
    }
    [1.0, 2.0, 5.0]
        .map(|step| step * decade)
        .into_iter()
        .find(|cell| *cell >= smallest)
        .unwrap_or(10.0 * decade)
}

impl Ground {
    /// The ground at a height [m], as this camera sees it.
    pub(super) fn new(height: f64, model: &Model, camera: &Projection) -> Self {
        let size = model.bounds.size();
        let (eye, middle, focal) = (camera.eye, model.bounds.middle(), camera.focal);
        Self { height, eye, middle, fade: FADE * size, cell: grid_cell(size), focal, is_dark: model.is_dark }
    }

    /// Distance along the view direction at which a ray meets the ground, whose part along that direction is 1 [m]; `None` if it does
    /// not, or from below.
    pub(super) fn depth(&self, ray: Vector3<f64>) -> Option<f32> {
        let above = self.eye.z - self.height;
        (above > 0.0 && ray.z < 0.0).then(|| (above / -ray.z) as f32).filter(|depth| *depth < 1e9)
    }

    /// Light from the ground where a ray meets it.
    pub(super) fn colour(&self, ray: Vector3<f64>, depth: f32, light: &Light) -> [f32; 3] {
        let at = self.eye + ray * f64::from(depth);
        let from_middle = (at - self.middle).xy().norm_squared();
        let faded = (from_middle / (from_middle + self.fade * self.fade)) as f32;
        // Size of a sample on the ground, at its longest.
        let sample = f64::from(depth) / self.focal * ray.norm() / -ray.z;
        let line = [at.x, at.y].map(|x| {
            let off = (x / self.cell - (x / self.cell).round()).abs() * self.cell;
            let half = 0.5 * LINE * self.cell;
            let covered = ((half + 0.5 * sample - off) / sample).clamp(0.0, 1.0);
            covered * (2.0 * half / sample).min(1.0)
        });
        let line = (line[0].max(line[1]) * (1.0 - (2.0 * sample / self.cell).min(1.0))) as f32;
        let (floor, lines) = if self.is_dark { (DARK_FLOOR, DARK_LINES) } else { (FLOOR, LINES) };
        let reaching = light.reaching(at, Vec3::z());
        let lit = light.matte(Vec3::z(), reaching);
        let far = background((ray.normalize().z as f32).max(0.0), self.is_dark);
        std::array::from_fn(|k| {
            let near = (floor[k] + line * (lines[k] - floor[k])) * lit[k];
            near + faded * (far[k] - near)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::grid_cell;

    #[test]
    fn cells_are_round_and_few() {
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
        for (extent, cell) in
            [(3.9, 0.5), (12.0, 1.0), (0.1, 0.01), (0.31, 0.05), (1300.0, 200.0), (1.0, 0.1)]
        {
            assert!(close(grid_cell(extent), cell), "{extent}: {}", grid_cell(extent));
        }
    }
}
