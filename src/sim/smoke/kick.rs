//! Vorticity from impulses that act on the air.
//!
//! *Method*: each is a change of velocity J on a grid. For heat and weight over a step J = Δt ln(ρ/ρ₀) g, whose curl is the
//! baroclinic term Δt (1/ρ) ∇ρ × g of [gourlay19]. For smoke emitted with a velocity it is the velocity that the air lacks, times
//! the smoke's volume fraction. The vorticity is ∇ × J by central differences: its sum is zero, and its impulse that of J.
//! *Departs from the paper*: g is the physical vector, which points down, so that hot smoke rises; ρ₀/ρ = T/T₀ as in an ideal gas
//! keeps ln ρ finite for any heat.
//!
//! Symbols: J → `push` [m/s], h → `spacing` [m], ω → `omega` [1/s].
//! Limits: first order in time; differences over 2 h do not resolve anything finer.

use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, node_of},
    math::Vec3,
    par,
    space::CellGrid,
};

/// Part of the largest vorticity below which a node is left out: it would become a vorton that induces next to nothing.
const MIN_VORTICITY: f32 = 2e-3;

/// Values at the nodes of a sparse grid, summed from points.
pub(super) struct Grid {
    spacing: f32,
    bricks: Bricks,
    /// [`BRICK_NODES`] a brick.
    values: Vec<Vec3>,
}

/// Support of the cubic B-spline, and one node more for differences [nodes].
const REACH: i32 = 3;

impl Grid {
    /// A grid of `spacing` [m] around points, with zeros.
    pub(super) fn around(points: &[&[Vec3]], spacing: f32) -> Self {
        let mut coords: Vec<[i32; 3]> = Vec::new();
        for x in points.iter().copied().flatten() {
            let node = x.map(|v| (v / spacing).floor() as i32);
            let brick = |v: i32| v.div_euclid(BRICK as i32);
            let low = node.map(|v| brick(v.saturating_add(1 - REACH)));
            let high = node.map(|v| brick(v.saturating_add(REACH)));
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    coords.extend((low.x..=high.x).map(|x| [x, y, z]));
                }
            }
            // Points of a neighbourhood are in the same few bricks.
            if coords.len() > 1 << 20 {
                coords.sort_unstable();
                coords.dedup();
            }
        }
        let bricks = Bricks::new(coords);
        let values = vec![Vec3::zeros(); bricks.len() * BRICK_NODES];
        Self { spacing, bricks, values }
    }

    /// Adds Σ W(x − x_p) v_p · `volume`/h³ at every node, W being the cubic B-spline, which is nowhere negative.
    pub(super) fn deposit(&mut self, positions: &[Vec3], values: &[Vec3], volume: f32) {
        let (h, bricks) = (self.spacing, &self.bricks);
        let cells = CellGrid::new(positions, 4.0 * h);
        let scale = volume / h.powi(3);
        par::for_chunks(&mut self.values, BRICK_NODES, |start, nodes| {
            let first = node_of(bricks.coords()[start / BRICK_NODES], 0);
            let low = Vec3::from_fn(|axis, _| first[axis] as f32 - 2.0) * h;
            let high = Vec3::from_fn(|axis, _| (first[axis] + BRICK as i32) as f32 + 1.0) * h;
            cells.for_each_stretch(low, high, |places| {
                for &p in &cells.order()[places] {
                    splat(positions[p as usize] / h, first, values[p as usize] * scale, nodes);
                }
            });
        });
    }

    /// Replaces every value by `f` of it.
    pub(super) fn map(&mut self, f: impl Fn(Vec3) -> Vec3 + Sync) {
        par::update(&mut self.values, |_, value| *value = f(*value));
    }

    /// The value at the node nearest to a point.
    pub(super) fn nearest(&self, x: Vec3) -> Vec3 {
        self.at([0, 1, 2].map(|axis| (x[axis] / self.spacing).round() as i32))
    }

    fn at(&self, node: [i32; 3]) -> Vec3 {
        let coord = node.map(|v| v.div_euclid(BRICK as i32));
        let local = node.map(|v| v.rem_euclid(BRICK as i32) as usize);
        self.bricks.find(coord).map_or(Vec3::zeros(), |brick| {
            self.values[brick * BRICK_NODES + local[0] + BRICK * (local[1] + BRICK * local[2])]
        })
    }

    /// Nodes with vorticity, and its strength ω h³ [m³/s], where the grid holds J.
    pub(super) fn curl(&self) -> Vec<(Vec3, Vec3)> {
        let found = par::map_chunks(self.bricks.len(), 1, |range| {
            let coord = self.bricks.coords()[range.start];
            let strength = |place: usize| {
                let node = node_of(coord, place);
                let slope = |axis: usize| {
                    let neighbour = |by: i32| {
                        let mut other = node;
                        other[axis] += by;
                        self.at(other)
                    };
                    (neighbour(1) - neighbour(-1)) * (0.5 / self.spacing)
                };
                let (dx, dy, dz) = (slope(0), slope(1), slope(2));
                let omega = Vec3::new(dy.z - dz.y, dz.x - dx.z, dx.y - dy.x); // ω = ∇ × J
                let x = Vec3::from(node.map(|v| v as f32)) * self.spacing;
                (x, omega * self.spacing.powi(3))
            };
            (0..BRICK_NODES).map(strength).filter(|(_, g)| *g != Vec3::zeros()).collect::<Vec<_>>()
        });
        let all: Vec<(Vec3, Vec3)> = found.into_iter().flatten().collect();
        let max = par::max(all.len(), |i| all[i].1.norm()).map_or(0.0, |(_, max)| max);
        // NaN stays, and is reported when the vortons move.
        let is_small = |strength: &Vec3| strength.norm() < MIN_VORTICITY * max;
        all.into_iter().filter(|(_, strength)| !is_small(strength)).collect()
    }
}

/// Adds `value` to the nodes in the support of the B-spline around `p` [nodes], in the brick that begins at `first`.
fn splat(p: Vec3, first: [i32; 3], value: Vec3, nodes: &mut [Vec3]) {
    let base: [f32; 3] = [p.x.floor(), p.y.floor(), p.z.floor()];
    let weights: [[f32; 4]; 3] = std::array::from_fn(|axis| spline(p[axis] - base[axis]));
    let start: [i32; 3] = std::array::from_fn(|axis| (base[axis] as i32).wrapping_sub(1 + first[axis]));
    let inside = |v: i32| (0..BRICK as i32).contains(&v);
    for (k, wz) in weights[2].iter().enumerate() {
        let z = start[2] + k as i32;
        for (j, wy) in weights[1].iter().enumerate().filter(|_| inside(z)) {
            let y = start[1] + j as i32;
            for (i, wx) in weights[0].iter().enumerate().filter(|_| inside(y)) {
                let x = start[0] + i as i32;
                if inside(x) {
                    nodes[x as usize + BRICK * (y as usize + BRICK * z as usize)] += value * (wx * wy * wz);
                }
            }
        }
    }
}

/// The cubic B-spline at the nodes −1, 0, 1, 2 for a point at `t`, 0 to 1.
fn spline(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - 0.5 * t),
        2.0 / 3.0 - s * s * (1.0 - 0.5 * s),
        t * t * t / 6.0,
    ]
}

/// Strengths assigned to existing and to new vortons.
#[derive(Debug, Default)]
pub(super) struct Assigned {
    /// Indices of existing vortons and what is added to their strength.
    pub(super) added: Vec<(u32, Vec3)>,
    /// New vortons: position and strength.
    pub(super) new: Vec<(Vec3, Vec3)>,
}

/// Assigns each strength to the nearest of the vortons at `positions` within half a cell's diagonal, or to a new vorton.
pub(super) fn assign(sources: &[(Vec3, Vec3)], positions: &[Vec3], spacing: f32) -> Assigned {
    let cells = CellGrid::new(positions, spacing);
    let radius = 0.866 * spacing;
    let nearest = par::map_chunks(sources.len(), 256, |range| {
        let find = |i: usize| cells.nearest_within(positions, sources[i].0, radius, |_| true);
        range.map(find).collect::<Vec<_>>()
    });
    let mut assigned = Assigned::default();
    for (&(x, strength), nearest) in sources.iter().zip(nearest.into_iter().flatten()) {
        match nearest {
            Some(j) => assigned.added.push((j as u32, strength)),
            None => assigned.new.push((x, strength)),
        }
    }
    assigned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_impulse_becomes_vorticity_of_zero_sum_and_of_that_impulse() {
        let (h, push) = (0.1, Vec3::new(0.3, -0.2, 2.0));
        let position = [Vec3::new(0.431, -0.777, 0.05), Vec3::new(0.6, -0.7, 0.0)];
        let mut grid = Grid::around(&[&position], h);
        grid.deposit(&position, &[push, push], 0.002);
        let sources = grid.curl();
        let sum: Vec3 = sources.iter().map(|(_, g)| g).sum();
        let impulse: Vec3 = sources.iter().map(|(x, g)| x.cross(g) * 0.5).sum();
        // What was left out is small.
        assert!(sum.norm() < 5e-5, "{sum}");
        assert!((impulse - push * 0.004).norm() < 2e-3 * 0.008, "{impulse}");
    }

    #[test]
    fn splines_sum_to_one_about_their_point() {
        for t in [0.0, 0.1, 0.5, 0.99] {
            let w = spline(t);
            assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            let mean: f32 = w.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * x).sum();
            assert!((mean - t).abs() < 1e-6);
        }
    }

    #[test]
    fn strengths_go_to_the_nearest_vorton_or_make_one() {
        let existing = [Vec3::zeros(), Vec3::new(0.05, 0.0, 0.0)];
        let at = |x: f32| (Vec3::new(x, 0.0, 0.0), Vec3::z());
        let assigned = assign(&[at(0.04), at(-0.02), at(0.3)], &existing, 0.1);
        assert_eq!(assigned.added, [(1, Vec3::z()), (0, Vec3::z())]);
        assert_eq!(assigned.new, [at(0.3)]);
    }
}
