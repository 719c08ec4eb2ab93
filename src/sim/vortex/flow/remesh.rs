//! Putting vortons back onto a lattice.
//!
//! *Method*: [monaghan85]'s kernel M4′: the strength of every vorton goes to the 64 nodes around it with weights that keep ΣΓ and Σ x × Γ.
//! Nodes with strength are the new vortons, on whole multiples of the spacing in the world. Cores wider than new
//! ones are divided first (`pieces`). Weak nodes and those inside solids hand on what they have (`weak.rs`), and what has
//! divergence goes (`solenoidal.rs`). Only bricks that a vorton reaches exist, and only their nodes with strength are kept, so a
//! stray costs what a vorton costs.
//!
//! *Departs*: the weights keep Σ x × (x × Γ) too, the angular impulse; handing on and taking divergence out keep ΣΓ and Σ x × Γ only.

use super::super::Vortons;
use super::{
    Flow, Remesh,
    exchange::spreading,
    nodes::{self, Node},
    solenoidal, weak,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, MAX_BRICK, node_of, offset},
    math::{Vec3, nan_if_null},
    par,
    sim::Diverged,
};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Cores this many times as wide as new ones stay as they are: 27 parts of them would be lumps apart. Cores that grow are
/// divided before.
const WIDE: f32 = 2.2;

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// Air, where vorticity can be.
    Air,
    /// A solid: there is none, nodes hand on what they have, and no vortex line ends at its surface.
    Solid,
    /// What is beyond a plane that mirrors the air: there is none, but lines go on as their mirrored ones.
    Mirror,
}

/// What is at each place [m].
pub type MediumAt<'a> = &'a (dyn Fn(Vec3) -> Medium + Sync);

/// Bricks a task fills.
const TASK: usize = 16;

/// What remeshing did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RemeshReport {
    /// Vortons before.
    pub before: u32,
    /// Vortons after.
    pub after: u32,
    /// Weak nodes, and nodes inside solids, that handed their strength on.
    pub dropped: u32,
    /// What they had, of Σ|Γ|, 0..1; of several lattices the sum.
    #[serde(deserialize_with = "nan_if_null")]
    pub handed: f64,
    /// The size of the impulse Σ x × Γ that they lost and no node could take back [m⁴/s].
    #[serde(deserialize_with = "nan_if_null")]
    pub lost: f64,
    /// The part of all strength that had divergence and went, in the mean of squares, 0..1; of several lattices the largest.
    #[serde(deserialize_with = "nan_if_null")]
    pub divergence: f64,
    /// Vortons left alone, because their cores are more than 2.2 times as wide as the lattice's.
    pub wide: u32,
    /// The size of the change of the impulse Σ x × Γ by which no vortex line ends at a solid [m⁴/s]; 0 but for rounding without one.
    #[serde(deserialize_with = "nan_if_null")]
    pub turned: f64,
    /// Lattices of which more than a thousandth of that divergence was left after all rounds.
    pub unsolved: u32,
    /// The largest impulse that the strengths could have, Σ |x − x̄| |Γ| about their middle [m⁴/s]: what `lost` and `turned` are held
    /// against; of several lattices the largest.
    #[serde(deserialize_with = "nan_if_null")]
    pub reach: f64,
}

/// Strength at a place: a vorton, or a part of one.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// In spacings.
    at: Vector3<f64>,
    strength: Vector3<f64>,
}

impl Flow {
    /// Remeshes if the parameters say so and the flow has strained its vortons, or more than their share of strength has lost its
    /// overlap. To be called after every substep.
    ///
    /// # Errors
    /// [`Diverged`] if a vorton is too far off for the lattice; `substep` is for the message.
    pub fn tend(&mut self, substep: u32, medium: MediumAt<'_>) -> Result<Option<RemeshReport>, Diverged> {
        match &self.params.remesh {
            Some(wanted)
                if self.strained >= f64::from(wanted.strain)
                    || self.astray(wanted) > f64::from(wanted.share) =>
            {
                self.remesh(substep, medium).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Puts the vortons onto the lattice.
    ///
    /// # Errors
    /// As [`Flow::tend`].
    ///
    /// # Panics
    /// If the parameters name no lattice, or numbers run out.
    pub fn remesh(&mut self, substep: u32, medium: MediumAt<'_>) -> Result<RemeshReport, Diverged> {
        let wanted = self.params.remesh.clone().expect("the parameters name a lattice");
        let before = self.vortons.len() as u32;
        let core = wanted.core * wanted.spacing;
        self.check_reach(&wanted, substep)?;
        let wide: Vec<usize> =
            (0..self.vortons.len()).filter(|&i| wanted.is_wide(self.vortons.core[i])).collect();
        let pieces = self.pieces(&wanted);
        let nodes = deposit(&pieces);
        let spacing = f64::from(wanted.spacing);
        let at = |node: [i32; 3]| medium(position(node, spacing));
        let mut thinned = weak::hand_on(nodes, f64::from(wanted.weak), |node| at(node) != Medium::Air);
        let projected = solenoidal::project(&mut thinned.nodes, |node| at(node) == Medium::Solid);

        // The new vortons, all alike but for place and strength, behind those that stay.
        self.retain(|i| wide.binary_search(&i).is_ok());
        let count = thinned.nodes.len();
        let lattice = Vortons {
            position: thinned.nodes.iter().map(|node| position(node.at, spacing)).collect(),
            strength: thinned.nodes.iter().map(|node| node.strength.cast()).collect(),
            core: vec![core; count],
        };
        self.add(&lattice, &vec![wanted.spacing.powi(3); count]);
        self.strained = 0.0;
        Ok(RemeshReport {
            before,
            after: self.vortons.len() as u32,
            dropped: thinned.dropped,
            handed: thinned.handed,
            lost: thinned.lost * spacing,
            divergence: projected.part,
            wide: wide.len() as u32,
            turned: projected.turned * spacing,
            unsolved: u32::from(projected.unsolved),
            reach: reach(&thinned.nodes) * spacing,
        })
    }

    /// The vortons as places and strengths, those with wider cores than `core` [m] divided into 27: along each axis the three points of
    /// Gauss–Hermite quadrature, ⅙, ⅔, ⅙ at −√3, 0, √3 standard deviations of what their vorticity is wider by.
    fn pieces(&self, wanted: &Remesh) -> Vec<Piece> {
        let (spacing, core) = (wanted.spacing, wanted.core * wanted.spacing);
        let per_variance = 2.0 / f64::from(spreading(self.params.kernel));
        let parts = par::map_chunks(self.vortons.len(), par::CHUNK, |range| {
            let mut pieces = Vec::with_capacity(range.len());
            for i in range.filter(|&i| !wanted.is_wide(self.vortons.core[i])) {
                let at = self.vortons.position[i].cast() / f64::from(spacing);
                let strength = self.vortons.strength[i].cast();
                let wider = f64::from(self.vortons.core[i]).powi(2) - f64::from(core).powi(2);
                // Rounding is no width.
                if wider <= 1e-6 * f64::from(core).powi(2) {
                    pieces.push(Piece { at, strength });
                    continue;
                }
                let side = (3.0 * per_variance * wider).sqrt() / f64::from(spacing);
                for part in 0..27 {
                    let step = Vector3::new(part % 3, part / 3 % 3, part / 9).map(|k| f64::from(k - 1));
                    let weight: f64 =
                        step.iter().map(|k| if *k == 0.0 { 2.0 / 3.0 } else { 1.0 / 6.0 }).product();
                    pieces.push(Piece { at: at + step * side, strength: strength * weight });
                }
            }
            pieces
        });
        parts.concat()
    }

    /// That every vorton has its place among the bricks.
    fn check_reach(&self, wanted: &Remesh, substep: u32) -> Result<(), Diverged> {
        // A brick inwards of the last one, for pieces.
        let reach = f64::from(MAX_BRICK - 2) * BRICK as f64;
        let far = |i: usize| f64::from(self.vortons.position[i].amax()) / f64::from(wanted.spacing);
        match (0..self.vortons.len()).find(|&i| far(i).is_nan() || far(i) >= reach) {
            None => Ok(()),
            Some(i) => Err(Diverged {
                system: "smoke",
                substep,
                particle: self.id[i],
                what: format!("is {:.1e} spacings of the lattice from the origin", far(i)),
                try_next: "a larger remesh.spacing",
            }),
        }
    }
}

impl Remesh {
    /// Whether a core [m] is so wide that the lattice is not for it.
    pub(super) fn is_wide(&self, core: f32) -> bool {
        core > WIDE * self.core * self.spacing
    }
}

/// Σ |x − x̄| |Γ| about the middle of strengths [spacings · m³/s].
fn reach(nodes: &[Node]) -> f64 {
    let middle = nodes::middle(nodes);
    nodes.iter().map(|node| (node.place() - middle).norm() * node.strength.norm()).sum()
}

/// Where a node stands [m].
fn position(at: [i32; 3], spacing: f64) -> Vec3 {
    Vec3::from(at.map(|i| (f64::from(i) * spacing) as f32))
}

/// M4′ at the four nodes around a place, the first of them one below the node before it, from the place's fraction 0..1.
fn weights(fraction: f64) -> [f64; 4] {
    let inner = |x: f64| 1.0 - 2.5 * x * x + 1.5 * x * x * x; // |x| < 1, [monaghan85]
    let outer = |x: f64| 0.5 * (2.0 - x) * (2.0 - x) * (1.0 - x); // |x| < 2
    [outer(1.0 + fraction), inner(fraction), inner(1.0 - fraction), outer(2.0 - fraction)]
}

/// The first of the four nodes along each axis.
fn first(piece: &Piece) -> [i32; 3] {
    std::array::from_fn(|axis| piece.at[axis].floor() as i32 - 1)
}

/// The bricks that a piece reaches: up to eight.
fn reached(piece: &Piece) -> impl Iterator<Item = [i32; 3]> {
    let edge = BRICK as i32;
    let (low, high) =
        (first(piece).map(|i| i.div_euclid(edge)), first(piece).map(|i| (i + 3).div_euclid(edge)));
    (0..8).filter_map(move |corner| {
        let beyond: [bool; 3] = std::array::from_fn(|axis| corner >> axis & 1 == 1);
        let exists = (0..3).all(|axis| !beyond[axis] || high[axis] > low[axis]);
        exists.then(|| std::array::from_fn(|axis| if beyond[axis] { high[axis] } else { low[axis] }))
    })
}

/// The nodes that pieces give strength to, in the bricks' order.
fn deposit(pieces: &[Piece]) -> Vec<Node> {
    let coords = par::map_chunks(pieces.len(), par::CHUNK, |range| {
        let mut coords: Vec<[i32; 3]> = pieces[range].iter().flat_map(reached).collect();
        coords.sort_unstable();
        coords.dedup();
        coords
    });
    let bricks = Bricks::new(coords.concat());
    let givers = par::Groups::new(pieces.len(), bricks.len(), |i| {
        let mut places = [u32::MAX; 8];
        for (place, coord) in places.iter_mut().zip(reached(&pieces[i])) {
            *place = bricks.find(coord).expect("every brick that is reached exists") as u32;
        }
        places
    });
    let found = par::map_chunks(bricks.len(), TASK, |range| {
        let (mut sums, mut nodes) = (vec![Vector3::zeros(); BRICK_NODES], Vec::new());
        for brick in range {
            let coord = bricks.coords()[brick];
            sums.fill(Vector3::zeros());
            for &thing in givers.of(brick) {
                give(&pieces[thing as usize / 8], coord, &mut sums);
            }
            for (place, &strength) in sums.iter().enumerate().filter(|(_, sum)| **sum != Vector3::zeros()) {
                nodes.push(Node { at: node_of(coord, place), strength });
            }
        }
        nodes
    });
    found.concat()
}

/// Adds what a piece gives to the nodes of a brick.
fn give(piece: &Piece, brick: [i32; 3], sums: &mut [Vector3<f64>]) {
    let (low, edge) = (first(piece), BRICK as i32);
    let along: [[f64; 4]; 3] = std::array::from_fn(|axis| weights(piece.at[axis] - piece.at[axis].floor()));
    let local: [i32; 3] = std::array::from_fn(|axis| low[axis] - edge * brick[axis]);
    let inside = |axis: usize, k: usize| (0..edge).contains(&(local[axis] + k as i32));
    for z in (0..4).filter(|&z| inside(2, z)) {
        for y in (0..4).filter(|&y| inside(1, y)) {
            for x in (0..4).filter(|&x| inside(0, x)) {
                let place =
                    [(local[0], x), (local[1], y), (local[2], z)].map(|(at, k)| (at + k as i32) as usize);
                sums[offset(place)] += piece.strength * (along[0][x] * along[1][y] * along[2][z]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_keep_what_is_quadratic() {
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
    fn a_piece_reaches_the_bricks_of_its_nodes() {
        let bricks = |at: [f64; 3]| {
            reached(&Piece { at: Vector3::from(at), strength: Vector3::x() }).collect::<Vec<_>>()
        };
        assert_eq!(bricks([4.2, 3.0, 2.5]), [[0, 0, 0]]);
        assert_eq!(bricks([-0.5, 3.0, 2.5]), [[-1, 0, 0], [0, 0, 0]]);
        assert_eq!(bricks([0.5, 7.5, -8.0]).len(), 8);
    }
}
