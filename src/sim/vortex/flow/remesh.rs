//! Remeshing: replacement of vortons by new ones on the nodes of a grid.
//!
//! *Method*: [monaghan85]'s kernel M4′: the strength of every vorton is distributed to the 64 nodes around
//! it, with weights that conserve ΣΓ and Σ x × Γ. Nodes with strength become the new vortons, at multiples of
//! the spacing in the world. Wider cores than the new ones are split first (`split`). Redistribution removes
//! low-circulation nodes and those inside solids (`population.rs`), and solenoidal projection removes
//! divergence (`solenoidal.rs`). Only bricks that a vorton reaches exist, and only their nodes with strength
//! are kept, so a stray costs no more than any vorton.
//!
//! *Departs from the paper*: the weights conserve the angular impulse Σ x × (x × Γ) too; redistribution and
//! projection conserve ΣΓ and Σ x × Γ only.

use super::super::Vortons;
use super::{
    Flow, Remesh,
    exchange::core_spreading_rate,
    nodes::{self, Node},
    population, solenoidal,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, MAX_BRICK, node_of, offset},
    math::{Vec3, nan_if_null},
    par,
    sim::Diverged,
};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Vortons with cores this many times as wide as new ones are not remeshed: 27 parts of one would be too far
/// apart to overlap. Cores that grow are split before.
const MAX_CORE_RATIO: f32 = 2.2;

/// The medium at a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// Air, where vorticity can be.
    Air,
    /// A solid, without vorticity: strength is redistributed from nodes inside, and no vortex line ends at
    /// its surface.
    Solid,
    /// The space beyond a plane of symmetry, without vorticity: vortex lines continue as their mirror images.
    Mirror,
}

/// The medium as a function of the position [m].
pub(crate) type MediumAt<'a> = &'a (dyn Fn(Vec3) -> Medium + Sync);

/// Bricks per task.
const BRICKS_PER_TASK: usize = 16;

/// The report on a remeshing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct RemeshReport {
    /// Vortons before.
    pub before: u32,
    /// Vortons after.
    pub after: u32,
    /// Low-circulation nodes and nodes inside solids, whose strength was redistributed.
    #[serde(rename = "dropped")]
    pub removed: u32,
    /// Strength of the removed nodes, as a fraction of Σ|Γ|, 0..1; the sum over several remeshings.
    #[serde(rename = "handed", deserialize_with = "nan_if_null")]
    pub redistributed: f64,
    /// The size of the impulse Σ x × Γ that redistribution lost [m⁴/s].
    #[serde(rename = "lost", deserialize_with = "nan_if_null")]
    pub lost_impulse: f64,
    /// The fraction of all strength that had divergence and was removed, as root mean squares, 0..1; the
    /// largest of several remeshings.
    #[serde(deserialize_with = "nan_if_null")]
    pub divergence: f64,
    /// Vortons that were not remeshed, because their cores are more than 2.2 times as wide as new ones.
    pub wide: u32,
    /// The size of the change of the impulse Σ x × Γ by the projection at solids [m⁴/s]; 0 except for
    /// rounding without solids.
    #[serde(rename = "turned", deserialize_with = "nan_if_null")]
    pub impulse_change_at_solids: f64,
    /// Remeshings whose projection did not converge: more than a thousandth of that divergence remained.
    #[serde(rename = "unsolved")]
    pub unconverged: u32,
    /// The largest possible impulse of the strengths, Σ |x − x̄| |Γ| about their centre [m⁴/s]: the scale for
    /// `lost_impulse` and `impulse_change_at_solids`; the largest of several remeshings.
    #[serde(rename = "reach", deserialize_with = "nan_if_null")]
    pub impulse_scale: f64,
}

/// The strength of a vorton, or of a part of one, at a point.
#[derive(Clone, Copy, Debug)]
struct PointStrength {
    /// The position [spacings].
    at: Vector3<f64>,
    strength: Vector3<f64>,
}

impl Flow {
    /// Remeshes if the parameters request it, and if the strain has reached its limit or too much strength
    /// has lost its overlap. To be called after every substep.
    ///
    /// # Errors
    /// [`Diverged`] if a vorton is too far away for the grid; `substep` is for the message.
    pub fn remesh_if_needed(
        &mut self,
        substep: u32,
        medium: MediumAt<'_>,
    ) -> Result<Option<RemeshReport>, Diverged> {
        match &self.params.remesh {
            Some(remesh)
                if self.strained >= f64::from(remesh.strain)
                    || self.fraction_outside_overlap(remesh) > f64::from(remesh.share) =>
            {
                self.remesh(substep, medium).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Replaces the vortons by new ones on the nodes of the grid.
    ///
    /// # Errors
    /// As [`Flow::remesh_if_needed`].
    ///
    /// # Panics
    /// If the parameters have no `remesh`, or there would be 2³² vortons or more.
    pub fn remesh(&mut self, substep: u32, medium: MediumAt<'_>) -> Result<RemeshReport, Diverged> {
        let params = self.params.remesh.clone().expect("the parameters request remeshing");
        let before = self.vortons.len() as u32;
        let core = params.core * params.spacing;
        self.check_extent(&params, substep)?;
        let wide: Vec<usize> =
            (0..self.vortons.len()).filter(|&i| params.is_wide(self.vortons.core[i])).collect();
        let nodes = deposit(&self.split(&params));
        let spacing = f64::from(params.spacing);
        let at = |node: [i32; 3]| medium(position(node, spacing));
        let is_outside = |node: [i32; 3]| at(node) != Medium::Air;
        let mut found = population::redistribute(nodes, f64::from(params.weak), is_outside);
        let projection = solenoidal::project(&mut found.nodes, |node| at(node) == Medium::Solid);

        // The new vortons differ in position and strength only; they follow those that are not remeshed.
        self.retain(|i| wide.binary_search(&i).is_ok());
        let count = found.nodes.len();
        let new = Vortons {
            position: found.nodes.iter().map(|node| position(node.at, spacing)).collect(),
            strength: found.nodes.iter().map(|node| node.strength.cast()).collect(),
            core: vec![core; count],
        };
        self.add(&new, &vec![params.spacing.powi(3); count]);
        self.strained = 0.0;
        Ok(RemeshReport {
            before,
            after: self.vortons.len() as u32,
            removed: found.removed,
            redistributed: found.fraction,
            lost_impulse: found.lost_impulse * spacing,
            divergence: projection.fraction,
            wide: wide.len() as u32,
            impulse_change_at_solids: projection.impulse_change * spacing,
            unconverged: u32::from(projection.is_unconverged),
            impulse_scale: impulse_scale(&found.nodes) * spacing,
        })
    }

    /// The vortons as point strengths. Those with wider cores than new ones are split into 27: along each
    /// axis the three points of Gauss–Hermite quadrature, ⅙, ⅔, ⅙ at −√3, 0, √3 standard deviations of the
    /// excess of their vorticity.
    fn split(&self, params: &Remesh) -> Vec<PointStrength> {
        let (spacing, core) = (params.spacing, params.core * params.spacing);
        let per_variance = 2.0 / f64::from(core_spreading_rate(self.params.kernel));
        let chunks = par::map_chunks(self.vortons.len(), par::CHUNK, |range| {
            let mut points = Vec::with_capacity(range.len());
            for i in range.filter(|&i| !params.is_wide(self.vortons.core[i])) {
                let at = self.vortons.position[i].cast() / f64::from(spacing);
                let strength = self.vortons.strength[i].cast();
                let excess = f64::from(self.vortons.core[i]).powi(2) - f64::from(core).powi(2);
                // Rounding errors do not count as an excess.
                if excess <= 1e-6 * f64::from(core).powi(2) {
                    points.push(PointStrength { at, strength });
                    continue;
                }
                let side = (3.0 * per_variance * excess).sqrt() / f64::from(spacing);
                for part in 0..27 {
                    let step = Vector3::new(part % 3, part / 3 % 3, part / 9).map(|k| f64::from(k - 1));
                    let weight: f64 =
                        step.iter().map(|k| if *k == 0.0 { 2.0 / 3.0 } else { 1.0 / 6.0 }).product();
                    points.push(PointStrength { at: at + step * side, strength: strength * weight });
                }
            }
            points
        });
        chunks.concat()
    }

    /// Checks that every vorton is inside the range of bricks.
    fn check_extent(&self, params: &Remesh, substep: u32) -> Result<(), Diverged> {
        // One brick less than the range, for the parts of split vortons.
        let limit = f64::from(MAX_BRICK - 2) * BRICK as f64;
        let distance = |i: usize| f64::from(self.vortons.position[i].amax()) / f64::from(params.spacing);
        match (0..self.vortons.len()).find(|&i| distance(i).is_nan() || distance(i) >= limit) {
            None => Ok(()),
            Some(i) => Err(Diverged {
                system: "smoke",
                substep,
                particle: self.id[i],
                what: format!("is {:.1e} spacings of the remeshing grid from the origin", distance(i)),
                try_next: "a larger remesh.spacing",
            }),
        }
    }
}

impl Remesh {
    /// Whether a core is too wide for remeshing; `core` in m.
    pub(super) fn is_wide(&self, core: f32) -> bool {
        core > MAX_CORE_RATIO * self.core * self.spacing
    }
}

/// Σ |x − x̄| |Γ| about the centre of strengths [spacings · m³/s].
fn impulse_scale(nodes: &[Node]) -> f64 {
    let center = nodes::center(nodes);
    nodes.iter().map(|node| (node.position() - center).norm() * node.strength.norm()).sum()
}

/// The position of a node [m].
fn position(at: [i32; 3], spacing: f64) -> Vec3 {
    Vec3::from(at.map(|i| (f64::from(i) * spacing) as f32))
}

/// M4′ at the four nodes around a point, from the position of the point between the middle two, 0..1.
fn weights(fraction: f64) -> [f64; 4] {
    let inner = |x: f64| 1.0 - 2.5 * x * x + 1.5 * x * x * x; // |x| < 1, [monaghan85]
    let outer = |x: f64| 0.5 * (2.0 - x) * (2.0 - x) * (1.0 - x); // |x| < 2
    [outer(1.0 + fraction), inner(fraction), inner(1.0 - fraction), outer(2.0 - fraction)]
}

/// The first of the four nodes along each axis.
fn first(point: &PointStrength) -> [i32; 3] {
    std::array::from_fn(|axis| point.at[axis].floor() as i32 - 1)
}

/// The bricks that contain the nodes around a point: up to eight.
fn bricks_around(point: &PointStrength) -> impl Iterator<Item = [i32; 3]> {
    let edge = BRICK as i32;
    let (low, high) =
        (first(point).map(|i| i.div_euclid(edge)), first(point).map(|i| (i + 3).div_euclid(edge)));
    (0..8).filter_map(move |corner| {
        let beyond: [bool; 3] = std::array::from_fn(|axis| corner >> axis & 1 == 1);
        let exists = (0..3).all(|axis| !beyond[axis] || high[axis] > low[axis]);
        exists.then(|| std::array::from_fn(|axis| if beyond[axis] { high[axis] } else { low[axis] }))
    })
}

/// Deposits the strength of points on nodes, in the order of the bricks.
fn deposit(points: &[PointStrength]) -> Vec<Node> {
    let coords = par::map_chunks(points.len(), par::CHUNK, |range| {
        let mut coords: Vec<[i32; 3]> = points[range].iter().flat_map(bricks_around).collect();
        coords.sort_unstable();
        coords.dedup();
        coords
    });
    let bricks = Bricks::new(coords.concat());
    let by_brick = par::Groups::new(points.len(), bricks.len(), |i| {
        let mut own = [u32::MAX; 8];
        for (brick, coord) in own.iter_mut().zip(bricks_around(&points[i])) {
            *brick = bricks.find(coord).expect("every brick around a point exists") as u32;
        }
        own
    });
    let found = par::map_chunks(bricks.len(), BRICKS_PER_TASK, |range| {
        let (mut sums, mut nodes) = (vec![Vector3::zeros(); BRICK_NODES], Vec::new());
        for brick in range {
            let coord = bricks.coords()[brick];
            sums.fill(Vector3::zeros());
            for &entry in by_brick.of(brick) {
                deposit_in_brick(&points[entry as usize / 8], coord, &mut sums);
            }
            for (place, &strength) in sums.iter().enumerate().filter(|(_, sum)| **sum != Vector3::zeros()) {
                nodes.push(Node { at: node_of(coord, place), strength });
            }
        }
        nodes
    });
    found.concat()
}

/// Adds the strength of a point to the nodes of a brick.
fn deposit_in_brick(point: &PointStrength, brick: [i32; 3], sums: &mut [Vector3<f64>]) {
    let (low, edge) = (first(point), BRICK as i32);
    let along: [[f64; 4]; 3] = std::array::from_fn(|axis| weights(point.at[axis] - point.at[axis].floor()));
    let local: [i32; 3] = std::array::from_fn(|axis| low[axis] - edge * brick[axis]);
    let inside = |axis: usize, k: usize| (0..edge).contains(&(local[axis] + k as i32));
    for z in (0..4).filter(|&z| inside(2, z)) {
        for y in (0..4).filter(|&y| inside(1, y)) {
            for x in (0..4).filter(|&x| inside(0, x)) {
                let place =
                    [(local[0], x), (local[1], y), (local[2], z)].map(|(at, k)| (at + k as i32) as usize);
                sums[offset(place)] += point.strength * (along[0][x] * along[1][y] * along[2][z]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_reproduce_quadratic_functions() {
        for k in 0..=20 {
            let fraction = f64::from(k) / 20.0;
            let w = weights(fraction);
            let moment =
                |power: i32| (0..4).map(|i| w[i] * (i as f64 - 1.0 - fraction).powi(power)).sum::<f64>();
            assert!((moment(0) - 1.0).abs() < 1e-12, "{fraction}");
            assert!(moment(1).abs() < 1e-12 && moment(2).abs() < 1e-12, "{fraction}");
        }
    }

    #[test]
    fn the_bricks_around_a_point_are_those_of_its_nodes() {
        let bricks = |at: [f64; 3]| {
            let point = PointStrength { at: Vector3::from(at), strength: Vector3::x() };
            bricks_around(&point).collect::<Vec<_>>()
        };
        assert_eq!(bricks([4.2, 3.0, 2.5]), [[0, 0, 0]]);
        assert_eq!(bricks([-0.5, 3.0, 2.5]), [[-1, 0, 0], [0, 0, 0]]);
        assert_eq!(bricks([0.5, 7.5, -8.0]).len(), 8);
    }
}
