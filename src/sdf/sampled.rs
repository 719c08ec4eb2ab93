//! Signed distance sampled on a dense grid, and its interpolation.

use crate::math::Vec3;

/// Signed distance on a grid of nodes about one closed surface: negative inside.
///
/// Node (i, j, k) lies at `origin` + (i, j, k) · `voxel`; x runs fastest. Invariants: every axis has at least
/// two nodes, every value is finite, and every node on the grid's outside lies outside the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampled {
    /// Position of the first node.
    pub origin: Vec3,
    /// Distance between nodes, above 0.
    pub voxel: f32,
    /// Nodes along each axis.
    pub nodes: [u32; 3],
    /// The distances, in the unit of `voxel`.
    pub values: Vec<f32>,
}

/// Where a mesh is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SampledGrid {
    pub(crate) origin: Vec3,
    pub(crate) voxel: f32,
    pub(crate) nodes: [u32; 3],
}

impl SampledGrid {
    /// Number of nodes.
    pub(crate) fn count(&self) -> usize {
        self.nodes.iter().map(|&n| n as usize).product()
    }
}

impl Sampled {
    /// What shows that these are no distances to a closed surface on the grid, if anything does: a value that is not finite or larger than the
    /// grid, a node at the edge of the grid that is inside, or no node inside.
    pub(crate) fn fault(&self) -> Option<String> {
        let [nx, ny, nz] = self.nodes.map(|n| n as usize);
        let expected = nx.checked_mul(ny).and_then(|nodes| nodes.checked_mul(nz));
        if self.nodes.iter().any(|&n| n < 2) || expected != Some(self.values.len()) {
            return Some(format!("{} values for {:?} nodes", self.values.len(), self.nodes));
        }
        if let Some(i) = self.values.iter().position(|value| !value.is_finite()) {
            return Some(format!("{} at node {:?}", self.values[i], self.place(i)));
        }
        // Twice the sum of the sides: distances by sweeps are a little longer than the diagonal.
        let longest = 2.0 * self.voxel * self.nodes.iter().map(|&n| n as f32).sum::<f32>();
        if let Some(i) = self.values.iter().position(|value| value.abs() > longest) {
            return Some(format!("{} at node {:?}, longer than the grid", self.values[i], self.place(i)));
        }
        if self.values.iter().all(|&value| value >= 0.0) {
            return Some("no node inside".to_owned());
        }
        let is_edge =
            |[i, j, k]: [usize; 3]| [(i, nx), (j, ny), (k, nz)].iter().any(|&(i, n)| i == 0 || i + 1 == n);
        let inside = (0..self.values.len()).find(|&i| self.values[i] < 0.0 && is_edge(self.place(i)));
        inside.map(|i| format!("{} at node {:?}, at the edge of the grid", self.values[i], self.place(i)))
    }

    /// Place of a value's node along each axis.
    fn place(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.nodes.map(|n| n as usize);
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Position of a value's node.
    pub(crate) fn node(&self, index: usize) -> Vec3 {
        self.origin + Vec3::from(self.place(index).map(|i| i as f32)) * self.voxel
    }

    /// Position of the last node.
    pub fn end(&self) -> Vec3 {
        self.origin + Vec3::from(self.nodes.map(|n| (n - 1) as f32)) * self.voxel
    }

    /// Signed distance at `x` and its normalised gradient; the gradient is [`Vec3::z`] where it vanishes.
    ///
    /// On the grid both are those of the trilinear interpolation. Off the grid they belong to the surface
    /// point nearest to the projection of `x` onto the grid's box: exact on that ray, else an upper bound.
    #[inline]
    pub fn sample(&self, x: Vec3) -> (f32, Vec3) {
        let held = x.sup(&self.origin).inf(&self.end());
        let (d, gradient) = self.trilinear(held);
        let n = gradient.try_normalize(1e-6).unwrap_or_else(Vec3::z);
        let beyond = x - held;
        if beyond == Vec3::zeros() {
            return (d, n);
        }
        let away = beyond + n * d;
        // Scaled, so that the squares neither overflow nor underflow.
        let scale = away.amax();
        let length = (away / scale).norm();
        if length.is_finite() { (scale * length, away / scale / length) } else { (d, n) }
    }

    /// Signed distance at `x`; off the grid a lower bound of it.
    #[inline]
    pub fn distance(&self, x: Vec3) -> f32 {
        let held = x.sup(&self.origin).inf(&self.end());
        let d = self.trilinear(held).0;
        let beyond = (x - held).norm();
        if beyond > 0.0 { d.max(beyond) } else { d }
    }

    /// Trilinear interpolation of the value and its gradient in the cell that contains `x`, a point on the
    /// grid.
    #[inline]
    fn trilinear(&self, x: Vec3) -> (f32, Vec3) {
        let at = (x - self.origin) / self.voxel;
        let [nx, ny, nz] = self.nodes.map(|n| n as usize);
        // A NaN becomes node 0; the last cell holds the grid's far side.
        let cell = |axis: usize, n: usize| (at[axis].max(0.0) as usize).min(n - 2);
        let (i, j, k) = (cell(0, nx), cell(1, ny), cell(2, nz));
        let (u, v, w) = (at.x - i as f32, at.y - j as f32, at.z - k as f32);
        let first = i + nx * (j + ny * k);
        let pair = |row: usize| (self.values[first + row], self.values[first + row + 1]);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;

        // Along x, then y, then z, with the slopes.
        let rows = [pair(0), pair(nx), pair(nx * ny), pair(nx * ny + nx)];
        let value_x = rows.map(|(a, b)| mix(a, b, u));
        let slope_x = rows.map(|(a, b)| b - a);
        let (low, high) = (mix(value_x[0], value_x[1], v), mix(value_x[2], value_x[3], v));
        let slope = Vec3::new(
            mix(mix(slope_x[0], slope_x[1], v), mix(slope_x[2], slope_x[3], v), w),
            mix(value_x[1] - value_x[0], value_x[3] - value_x[2], w),
            high - low,
        );
        (mix(low, high, w), slope / self.voxel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball() -> Sampled {
        let (origin, voxel, nodes) = (Vec3::new(-1.5, -1.4, -1.6), 0.1, [31, 30, 33]);
        let values = (0..31 * 30 * 33)
            .map(|i| {
                let node = Vec3::new((i % 31) as f32, (i / 31 % 30) as f32, (i / (31 * 30)) as f32);
                (origin + node * voxel).norm() - 1.0
            })
            .collect();
        Sampled { origin, voxel, nodes, values }
    }

    #[test]
    fn samples_follow_the_distance_on_the_grid_and_off_it() {
        let ball = ball();
        for i in 0..4000_u32 {
            let part = |shift: u32| (i.wrapping_mul(2_654_435_761) >> shift & 255) as f32 / 42.0 - 3.0;
            let x = Vec3::new(part(0), part(8), part(16));
            let exact = x.norm() - 1.0;
            let (d, n) = ball.sample(x);
            if x.norm() > 0.3 {
                assert!((d - exact).abs() < 0.03 + 0.05 * exact.max(0.0), "{x:?}: {d}, exact {exact}");
                assert!((n - x.normalize()).norm() < 0.17, "{x:?} {n:?}");
            }
            assert!(ball.distance(x) <= d.max(exact) + 1e-5);
            assert!((ball.distance(x) > 0.03) <= (exact > 0.0));
        }
    }

    #[test]
    fn every_query_has_a_unit_normal() {
        let ball = ball();
        for x in [Vec3::repeat(f32::NAN), Vec3::repeat(1e30), Vec3::zeros(), ball.end(), ball.origin] {
            assert!((ball.sample(x).1.norm() - 1.0).abs() < 1e-4, "{x:?}");
        }
    }
}
