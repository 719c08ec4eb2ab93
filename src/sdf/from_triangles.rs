//! Signed distance to a triangle mesh.
//!
//! *Method*: inside is where the generalised winding number [jacobson13], summed over a tree [barill18],
//! exceeds ½ in magnitude. Cubes of nodes are split from bricks down to single nodes where the surface is
//! near or the winding number is undecided. Single nodes get the distance to the nearest triangle.
//! [`dense::sweep`] extends it.
//!
//! *Departs from the papers*: the magnitude of the winding number decides, so that a part with inverted
//! winding is still solid. Where the winding number crosses ½ without a triangle, in a hole, the hole is
//! closed by a cap: its nodes are pinned by the plane through the crossings. Triangles with the same side in
//! front of and behind them are ignored: those within a solid where parts of the mesh overlap, and those of
//! loose sheets.
//!
//! Symbols: w winding number [1]; d distance [voxels]; r half a cube's diagonal [voxels].
//!
//! Limits: a part thinner than a voxel may have no node inside; it still repels from both sides. Across a
//! hole that takes half the surface, no side is the inside.

use super::{Sampled, SampledGrid, Triangles, bvh::TriangleBvh, dense};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, neighbour, node_of},
    math::Vec3,
    par,
};

/// Version of the samples: raised whenever a change gives the same mesh other samples, so that stored ones
/// are rebuilt.
pub(crate) const SAMPLED_VERSION: u32 = 3;

/// Nodes around the mesh's bounding box, so that the distance has a gradient beyond the surface.
pub(crate) const MARGIN_NODES: u32 = 4;

/// How far from a triangle nodes get its exact distance [voxels]. The sweeps' first-order error, up to a
/// third of a voxel on a sphere, begins there. Twice as far costs twice the time, and at usual spacings moves
/// that error out of the range of contacts only for coarse grids.
const EXACT_REACH: f32 = 3.0;

/// How far from a triangle nodes are pinned where the mesh has holes [voxels]: farther out a cap may be
/// nearer.
const EXACT_REACH_WITH_HOLES: f32 = 1.2;

/// A node within this distance of a triangle lies on it [voxels].
const ON_TRIANGLE: f32 = 1e-3;

/// Winding number beyond which a node on a triangle is inside: there it is between the values of the two
/// sides, or either of them, and beyond this magnitude both sides are inside.
const INSIDE_WINDING_ON_TRIANGLE: f32 = 1.25;

/// Error of the winding number that the tree sums.
const WINDING_ERROR: f32 = 0.03;

/// Winding number beyond which a node is inside: ½ and a margin for rounding, since it is ½ on a loose sheet.
const INSIDE_WINDING: f32 = 0.501;

/// The smallest distance of a pinned node [voxels]: keeps every value on its own side of zero.
const MIN_DISTANCE: f32 = 1e-6;

/// Signed distance to a mesh, and how sound the mesh is.
#[derive(Clone, Debug, PartialEq)]
pub struct Solidified {
    /// The distances, in the mesh's units.
    pub field: Sampled,
    /// Number of nodes inside.
    pub inside: usize,
    /// Number of nodes next to a cap that closes a hole.
    pub caps: usize,
}

/// A node's distance to the nearest triangle [voxels], ∞ if none is near, and its winding number.
#[derive(Clone, Copy, Debug)]
struct NodeSample {
    distance: f32,
    winding: f32,
    /// Whether the nearest triangle separates inside from outside.
    separates: bool,
}

/// The grid on which [`from_triangles`] samples `mesh`; `None` where it does not.
pub(crate) fn sampled_grid(mesh: &Triangles, resolution: u32) -> Option<SampledGrid> {
    let (low, high) = mesh.bounds()?;
    let size = high - low;
    let voxel = size.amax() / resolution as f32;
    if !(voxel.is_finite() && voxel > 0.0) {
        return None;
    }
    let cells = size.map(|side| (side / voxel).ceil());
    let nodes: [u32; 3] = std::array::from_fn(|axis| cells[axis] as u32 + 1 + 2 * MARGIN_NODES);
    let half = Vec3::from(nodes.map(|n| (n - 1) as f32)) * 0.5;
    Some(SampledGrid { origin: (low + high) * 0.5 - half * voxel, voxel, nodes })
}

/// The signed distance to `mesh`, sampled with `resolution` (≥ 1) voxels along the longest side of its box.
///
/// `None` if the mesh has no triangle or no extent.
pub fn from_triangles(mesh: &Triangles, resolution: u32) -> Option<Solidified> {
    Some(on_grid(mesh, sampled_grid(mesh, resolution)?))
}

/// The signed distance to `mesh`, sampled on `grid`, which reaches at least a node beyond the mesh on every side.
pub(crate) fn on_grid(mesh: &Triangles, grid: SampledGrid) -> Solidified {
    let SampledGrid { origin, voxel, nodes } = grid;
    // The tree works in voxels from the first node, where single precision is best.
    let mut local = mesh.clone();
    par::update(&mut local.positions, |_, x| *x = (*x - origin) / voxel);
    let bvh = TriangleBvh::new(&local);
    let counts = nodes.map(|n| n.div_ceil(BRICK as u32) as i32);
    let all = (0..counts[0] * counts[1] * counts[2])
        .map(|i| [i % counts[0], i / counts[0] % counts[1], i / (counts[0] * counts[1])]);
    let all: Vec<[i32; 3]> = all.collect();
    let bricks = Bricks::new(all.clone());
    assert!(bricks.coords() == all, "bricks ascend with x fastest");
    let samples: Vec<NodeSample> =
        par::map(bricks.len(), |brick| sample_brick(&bvh, bricks.coords()[brick])).concat();

    let (seeds, caps) = seeds(&bricks, &samples);
    let box_nodes = counts.map(|n| n as usize * BRICK);
    let node = |i: usize| {
        let [nx, ny, _] = box_nodes;
        [i % nx, i / nx % ny, i / (nx * ny)]
    };
    let mut dense_seeds = vec![0.0; seeds.len()];
    par::fill(&mut dense_seeds, |i| seeds[place(counts, node(i))]);
    let swept = dense::sweep(box_nodes, &dense_seeds, f32::INFINITY, dense::BLOCK).distance;
    let [nx, ny, _] = nodes.map(|n| n as usize);
    let mut values = vec![0.0; grid.count()];
    par::fill(&mut values, |i| {
        let node = [i % nx, i / nx % ny, i / (nx * ny)];
        let sample = samples[place(counts, node)];
        let exact = if sample.separates { sample.distance } else { f32::INFINITY };
        // A mesh without a surface that separates sides leaves every node unreached, and outside.
        let distance = swept[node[0] + box_nodes[0] * (node[1] + box_nodes[1] * node[2])]
            .abs()
            .min(exact)
            .clamp(MIN_DISTANCE, 1e9)
            * voxel;
        if sample.inside() { -distance } else { distance }
    });
    let inside = par::sum(values.len(), |i| f64::from(u8::from(values[i] < 0.0))) as usize;
    Solidified { field: Sampled { origin, voxel, nodes, values }, inside, caps }
}

/// The index of a dense grid's node among the bricks' nodes.
fn place(counts: [i32; 3], node: [usize; 3]) -> usize {
    let brick = node.map(|n| n / BRICK);
    let [nx, ny, _] = counts.map(|n| n as usize);
    let index = brick[0] + nx * (brick[1] + ny * brick[2]);
    let inner = node.map(|n| n % BRICK);
    index * BRICK_NODES + inner[0] + BRICK * (inner[1] + BRICK * inner[2])
}

impl NodeSample {
    /// Whether the node is inside the solid.
    fn inside(&self) -> bool {
        self.winding.abs()
            > if self.distance < ON_TRIANGLE { INSIDE_WINDING_ON_TRIANGLE } else { INSIDE_WINDING }
    }
}

/// Distance and winding number at the nodes of a brick.
fn sample_brick(bvh: &TriangleBvh, coord: [i32; 3]) -> Vec<NodeSample> {
    let unknown = NodeSample { distance: f32::INFINITY, winding: 0.0, separates: false };
    let mut samples = vec![unknown; BRICK_NODES];
    let all = Cube { first: [0; 3], size: BRICK, bound: f32::INFINITY, winding: None };
    sample_cube(bvh, coord, all, &mut samples);
    samples
}

/// A cube of a brick's nodes, with bounds for its nodes.
struct Cube {
    first: [usize; 3],
    size: usize,
    /// A triangle is no farther than this from the cube's centre.
    bound: f32,
    /// The winding number, where it is known to be on the same side of ½ at all nodes.
    winding: Option<f32>,
}

/// Whether a winding number stays on its side of ½ within `radius` of a point where it is `winding`, with no
/// triangle within `distance`. It is harmonic there, and its difference from the next whole number grows by
/// at most (1 + ρ)/(1 − ρ)², with ρ = radius/distance (Harnack's inequality).
fn decided(winding: f32, radius: f32, distance: f32) -> bool {
    let difference = (winding - winding.round()).abs().max(WINDING_ERROR);
    let ratio = radius / distance;
    ratio < 1.0 && difference * (1.0 + ratio) / (1.0 - ratio).powi(2) < 0.5 - WINDING_ERROR
}

/// Samples a cube of nodes at its centre, and recurses into its octants where that does not decide all nodes.
fn sample_cube(bvh: &TriangleBvh, coord: [i32; 3], cube: Cube, samples: &mut [NodeSample]) {
    let Cube { first, size, bound, winding: known } = cube;
    let half = (size - 1) as f32 * 0.5;
    let corner = node_of(coord, first[0] + BRICK * (first[1] + BRICK * first[2]));
    let center = Vec3::from(corner.map(|c| c as f32)) + Vec3::repeat(half);
    let nearest = bvh.nearest(center, bound * bound);
    let distance = nearest.map_or(bound, |nearest| nearest.distance2.sqrt());
    let winding = known.unwrap_or_else(|| bvh.winding(center));
    let radius = half * 3.0_f32.sqrt();
    if size == 1 {
        // Behind the nearest triangle the winding number is one more, or one less. On the triangle it is in
        // between.
        let across = winding + nearest.map_or(0.0, |nearest| 1.0_f32.copysign(nearest.side));
        let separates = if distance < ON_TRIANGLE {
            winding.abs() < INSIDE_WINDING_ON_TRIANGLE
        } else {
            (winding.abs() > INSIDE_WINDING) != (across.abs() > INSIDE_WINDING)
        };
        samples[first[0] + BRICK * (first[1] + BRICK * first[2])] =
            NodeSample { distance, winding, separates };
        return;
    }
    let decided = known.is_some() || decided(winding, radius, distance);
    if distance > radius + EXACT_REACH && decided {
        for (x, y, z) in cube_nodes(size) {
            let at = first[0] + x + BRICK * (first[1] + y + BRICK * (first[2] + z));
            samples[at] = NodeSample { distance: f32::INFINITY, winding, separates: false };
        }
        return;
    }
    // The centres of the octants are this far from the centre of the cube.
    let step = size / 2;
    let bound = (distance + 0.5 * step as f32 * 3.0_f32.sqrt()) * (1.0 + 1e-5) + 1e-4;
    let winding = decided.then_some(winding);
    for (x, y, z) in cube_nodes(2) {
        let first = [first[0] + x * step, first[1] + y * step, first[2] + z * step];
        sample_cube(bvh, coord, Cube { first, size: step, bound, winding }, samples);
    }
}

/// The nodes of a cube, x fastest.
fn cube_nodes(size: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..size).flat_map(move |z| (0..size).flat_map(move |y| (0..size).map(move |x| (x, y, z))))
}

/// The pinned distances in the form of the sweeps' input, and the number of nodes next to a cap.
fn seeds(bricks: &Bricks, samples: &[NodeSample]) -> (Vec<f32>, usize) {
    // The distance of every node to a cap: the plane through the crossings of ½ without a triangle.
    let mut caps = vec![f32::INFINITY; samples.len()];
    par::for_chunks(&mut caps, BRICK_NODES, |start, caps| {
        let brick = start / BRICK_NODES;
        let around = bricks.around(bricks.coords()[brick]);
        for (at, cap) in caps.iter_mut().enumerate() {
            *cap = cap_distance(samples, brick, &around, at);
        }
    });
    let count = par::sum(caps.len(), |i| f64::from(u8::from(caps[i].is_finite()))) as usize;
    let reach = if count > 0 { EXACT_REACH_WITH_HOLES } else { EXACT_REACH };
    let mut seeds = vec![f32::INFINITY; samples.len()];
    par::fill(&mut seeds, |i| {
        let NodeSample { distance, separates, .. } = samples[i];
        let exact = if separates && distance <= reach { distance } else { f32::INFINITY };
        let pinned = exact.min(caps[i]);
        if pinned.is_finite() { -pinned.max(MIN_DISTANCE) } else { f32::INFINITY }
    });
    (seeds, count)
}

/// The distance of a node to the cap next to it; ∞ if there is none.
fn cap_distance(samples: &[NodeSample], brick: usize, around: &[Option<usize>; 6], at: usize) -> f32 {
    let own = samples[brick * BRICK_NODES + at];
    if own.distance <= 1.0 {
        return f32::INFINITY; // a triangle may make the crossing
    }
    let mut inverse2 = 0.0;
    for axis in 0..3 {
        let mut nearest = f32::INFINITY;
        for face in [2 * axis, 2 * axis + 1] {
            let other = match neighbour(at, face) {
                (place, true) => around[face].map(|other| other * BRICK_NODES + place),
                (place, false) => Some(brick * BRICK_NODES + place),
            };
            let Some(other) = other.map(|other| samples[other]) else { continue };
            if other.inside() != own.inside() && other.distance > 1.0 {
                let along = (own.winding.abs() - INSIDE_WINDING) / (own.winding.abs() - other.winding.abs());
                nearest = nearest.min(along.max(MIN_DISTANCE));
            }
        }
        inverse2 += 1.0 / (nearest * nearest);
    }
    1.0 / inverse2.sqrt() // the plane Σ xₖ/dₖ = 1
}
