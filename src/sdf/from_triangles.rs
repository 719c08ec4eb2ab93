//! Signed distance to the surface of a triangle mesh.
//!
//! *Method*: inside is where the winding number [jacobson13], summed over a tree [barill18], is beyond ½ in size.
//! Cubes of nodes are split from bricks down to single nodes where the surface is near or the winding number
//! undecided; single nodes get the distance to the nearest triangle. [`dense::sweep`] carries it on.
//!
//! *Departs from the papers*: the size of the winding number decides, so that a part that is wound inside out is
//! still solid. Where the winding number crosses ½ without a triangle, in a hole, a cap is put there: its nodes are
//! pinned by the plane through the crossings. Triangles with the same side before and behind them, within a solid
//! that parts of the mesh overlap in, or on loose sheets, count for nothing.
//!
//! Symbols: w winding number [1]; d distance [voxels]; r half a cube's diagonal [voxels].
//!
//! Limits: a part thinner than a voxel may have no node inside; it still repels from both sides. Across a hole that
//! takes half the surface, no side is the inside.

use super::{Sampled, Triangles, dense, tree::TriangleTree};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, beside, node_of},
    math::Vec3,
    par,
};

/// Raised whenever a change gives the same mesh other samples, so that stored ones are built again.
pub const SAMPLED_VERSION: u32 = 2;

/// Free nodes around the mesh's box, so that the distance has a gradient beyond the surface.
const MARGIN: u32 = 4;

/// How far from a triangle nodes get its exact distance [voxels]. The sweeps' first-order error, up to a third of a
/// voxel on a sphere, begins there; twice as far costs twice the time and moves it out of a contact's sight at any
/// usual spacing only for coarse grids.
const EXACT: f32 = 3.0;

/// How near a node is pinned to a triangle where the mesh has holes [voxels]: farther out a cap may be nearer.
const BESIDE: f32 = 1.2;

/// A node this near to a triangle stands on it [voxels].
const TOUCHING: f32 = 1e-3;

/// There the winding number is between that of the two sides, or either; beyond this in size, both are inside.
const BURIED: f32 = 1.25;

/// How far the summed winding number may be from the exact one.
const SUMMED: f32 = 0.03;

/// Beyond this winding number a node is inside: ½, and a little that rounding does not reach, since on a loose sheet it
/// is ½.
const INSIDE: f32 = 0.501;

/// The smallest distance of a pinned node [voxels]: keeps every value on its own side of zero.
const NEAREST: f32 = 1e-6;

/// A mesh's distances, and how sound the mesh is.
#[derive(Clone, Debug, PartialEq)]
pub struct Solidified {
    /// The distances, in the mesh's units.
    pub field: Sampled,
    /// Nodes inside.
    pub inside: usize,
    /// Nodes beside a cap that closes a hole.
    pub caps: usize,
}

/// A node's distance to the nearest triangle [voxels], ∞ if none is near, and what the winding number says.
#[derive(Clone, Copy, Debug)]
struct Seen {
    distance: f32,
    winding: f32,
    /// Whether the nearest triangle parts inside from outside.
    parts: bool,
}

/// The signed distance to `mesh`, sampled with `resolution` (≥ 1) voxels along the longest side of its box.
///
/// `None` if the mesh has no triangle or no extent.
pub fn from_triangles(mesh: &Triangles, resolution: u32) -> Option<Solidified> {
    let (low, high) = mesh.bounds()?;
    let size = high - low;
    let voxel = size.amax() / resolution as f32;
    if !(voxel.is_finite() && voxel > 0.0) {
        return None;
    }
    let cells = size.map(|side| (side / voxel).ceil());
    let nodes: [u32; 3] = std::array::from_fn(|axis| cells[axis] as u32 + 1 + 2 * MARGIN);
    let half = Vec3::from(nodes.map(|n| (n - 1) as f32)) * 0.5;
    let origin = (low + high) * 0.5 - half * voxel;

    // The tree works in voxels from the first node, where single precision has its digits.
    let mut local = mesh.clone();
    par::update(&mut local.positions, |_, x| *x = (*x - origin) / voxel);
    let tree = TriangleTree::new(&local);
    let counts = nodes.map(|n| n.div_ceil(BRICK as u32) as i32);
    let all = (0..counts[0] * counts[1] * counts[2])
        .map(|i| [i % counts[0], i / counts[0] % counts[1], i / (counts[0] * counts[1])]);
    let bricks = Bricks::new(all.collect());
    let seen: Vec<Seen> = par::map(bricks.len(), |brick| look(&tree, bricks.coords()[brick])).concat();

    let (seeds, caps) = seeds(&bricks, &seen);
    let box_nodes = counts.map(|n| n as usize * BRICK);
    let node = |i: usize| {
        let [nx, ny, _] = box_nodes;
        [i % nx, i / nx % ny, i / (nx * ny)]
    };
    let mut laid_out = vec![0.0; seeds.len()];
    par::fill(&mut laid_out, |i| seeds[place(&bricks, counts, node(i))]);
    let swept = dense::sweep(box_nodes, &laid_out, f32::INFINITY, dense::BLOCK).distance;
    let [nx, ny, _] = nodes.map(|n| n as usize);
    let mut values = vec![0.0; nodes.iter().map(|&n| n as usize).product()];
    par::fill(&mut values, |i| {
        let node = [i % nx, i / nx % ny, i / (nx * ny)];
        let seen = seen[place(&bricks, counts, node)];
        let exact = if seen.parts { seen.distance } else { f32::INFINITY };
        // A mesh without a surface that parts anything leaves every node unreached, and outside.
        let distance = swept[node[0] + box_nodes[0] * (node[1] + box_nodes[1] * node[2])]
            .abs()
            .min(exact)
            .clamp(NEAREST, 1e9)
            * voxel;
        if seen.inside() { -distance } else { distance }
    });
    let inside = par::sum(values.len(), |i| f64::from(u8::from(values[i] < 0.0))) as usize;
    Some(Solidified { field: Sampled { origin, voxel, nodes, values }, inside, caps })
}

/// Where a node of the dense grid stands among the bricks' nodes.
fn place(bricks: &Bricks, counts: [i32; 3], node: [usize; 3]) -> usize {
    let brick = node.map(|n| n / BRICK);
    let [nx, ny, _] = counts.map(|n| n as usize);
    let index = brick[0] + nx * (brick[1] + ny * brick[2]);
    debug_assert_eq!(bricks.coords()[index], brick.map(|b| b as i32), "bricks ascend with x fastest");
    let inner = node.map(|n| n % BRICK);
    index * BRICK_NODES + inner[0] + BRICK * (inner[1] + BRICK * inner[2])
}

impl Seen {
    /// Whether the node lies in the solid.
    fn inside(&self) -> bool {
        self.winding.abs() > if self.distance < TOUCHING { BURIED } else { INSIDE }
    }
}

/// What the nodes of a brick see.
fn look(tree: &TriangleTree, coord: [i32; 3]) -> Vec<Seen> {
    let mut seen = vec![Seen { distance: f32::INFINITY, winding: 0.0, parts: false }; BRICK_NODES];
    let all = Cube { first: [0; 3], size: BRICK, bound: f32::INFINITY, winding: None };
    split(tree, coord, all, &mut seen);
    seen
}

/// A cube of a brick's nodes, and what is known of it.
struct Cube {
    first: [usize; 3],
    size: usize,
    /// Some triangle is no farther than this from its middle.
    bound: f32,
    /// The winding number, where it is known to be on the same side of ½ at all nodes.
    winding: Option<f32>,
}

/// Whether a winding number stays on its side of ½ within `radius` of where it is `winding`, with no triangle within
/// `distance`. It is harmonic there, and what is left of it to the next whole number grows by (1 + ρ)/(1 − ρ)² at
/// most, with ρ = radius/distance (Harnack's inequality).
fn decided(winding: f32, radius: f32, distance: f32) -> bool {
    let left = (winding - winding.round()).abs().max(SUMMED);
    let ratio = radius / distance;
    ratio < 1.0 && left * (1.0 + ratio) / (1.0 - ratio).powi(2) < 0.5 - SUMMED
}

/// Looks from the middle of a cube of nodes, and from its eighths where that does not settle it.
fn split(tree: &TriangleTree, coord: [i32; 3], cube: Cube, seen: &mut [Seen]) {
    let Cube { first, size, bound, winding: known } = cube;
    let half = (size - 1) as f32 * 0.5;
    let corner = node_of(coord, first[0] + BRICK * (first[1] + BRICK * first[2]));
    let middle = Vec3::from(corner.map(|c| c as f32)) + Vec3::repeat(half);
    let nearest = tree.nearest(middle, bound * bound);
    let distance = nearest.map_or(bound, |nearest| nearest.distance2.sqrt());
    let winding = known.unwrap_or_else(|| tree.winding(middle));
    let radius = half * 3.0_f32.sqrt();
    if size == 1 {
        // Behind the nearest triangle the winding number is one more, or one less. On it, it is anything between.
        let across = winding + nearest.map_or(0.0, |nearest| 1.0_f32.copysign(nearest.side));
        let parts = if distance < TOUCHING {
            winding.abs() < BURIED
        } else {
            (winding.abs() > INSIDE) != (across.abs() > INSIDE)
        };
        seen[first[0] + BRICK * (first[1] + BRICK * first[2])] = Seen { distance, winding, parts };
        return;
    }
    let decided = known.is_some() || decided(winding, radius, distance);
    if distance > radius + EXACT && decided {
        for (x, y, z) in places(size) {
            let at = first[0] + x + BRICK * (first[1] + y + BRICK * (first[2] + z));
            seen[at] = Seen { distance: f32::INFINITY, winding, parts: false };
        }
        return;
    }
    // No node of the cube is farther from the middle of its eighth than that from the middle of the whole.
    let step = size / 2;
    let bound = (distance + 0.5 * step as f32 * 3.0_f32.sqrt()) * (1.0 + 1e-5) + 1e-4;
    let winding = decided.then_some(winding);
    for (x, y, z) in places(2) {
        let first = [first[0] + x * step, first[1] + y * step, first[2] + z * step];
        split(tree, coord, Cube { first, size: step, bound, winding }, seen);
    }
}

/// The places of a cube.
fn places(size: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..size).flat_map(move |z| (0..size).flat_map(move |y| (0..size).map(move |x| (x, y, z))))
}

/// The pinned distances as the sweeps take them, and how many nodes stand beside a cap.
fn seeds(bricks: &Bricks, seen: &[Seen]) -> (Vec<f32>, usize) {
    // The distance of every node to a cap: the plane through the crossings of ½ that no triangle makes.
    let mut caps = vec![f32::INFINITY; seen.len()];
    par::for_chunks(&mut caps, BRICK_NODES, |start, caps| {
        let brick = start / BRICK_NODES;
        let around = bricks.around(bricks.coords()[brick]);
        for (at, cap) in caps.iter_mut().enumerate() {
            *cap = cap_distance(seen, brick, &around, at);
        }
    });
    let count = par::sum(caps.len(), |i| f64::from(u8::from(caps[i].is_finite()))) as usize;
    let reach = if count > 0 { BESIDE } else { EXACT };
    let mut seeds = vec![f32::INFINITY; seen.len()];
    par::fill(&mut seeds, |i| {
        let exact = if seen[i].parts && seen[i].distance <= reach { seen[i].distance } else { f32::INFINITY };
        let pinned = exact.min(caps[i]);
        if pinned.is_finite() { -pinned.max(NEAREST) } else { f32::INFINITY }
    });
    (seeds, count)
}

/// The distance of a node to the cap beside it; ∞ if there is none.
fn cap_distance(seen: &[Seen], brick: usize, around: &[Option<usize>; 6], at: usize) -> f32 {
    let own = seen[brick * BRICK_NODES + at];
    if own.distance <= 1.0 {
        return f32::INFINITY; // a triangle may make the crossing
    }
    let mut inverse2 = 0.0;
    for axis in 0..3 {
        let mut nearest = f32::INFINITY;
        for face in [2 * axis, 2 * axis + 1] {
            let other = match beside(at, face) {
                (place, true) => around[face].map(|other| other * BRICK_NODES + place),
                (place, false) => Some(brick * BRICK_NODES + place),
            };
            let Some(other) = other.map(|other| seen[other]) else { continue };
            if other.inside() != own.inside() && other.distance > 1.0 {
                let along = (own.winding.abs() - INSIDE) / (own.winding.abs() - other.winding.abs());
                nearest = nearest.min(along.max(NEAREST));
            }
        }
        inverse2 += 1.0 / (nearest * nearest);
    }
    1.0 / inverse2.sqrt() // the plane Σ xₖ/dₖ = 1
}
