//! Bounding volume hierarchy (BVH) over moving triangles, and the pairs of them that may come close.
//!
//! *Method*: a binary tree of axis-aligned bounding boxes. Triangles are ordered along Morton's curve by
//! their positions at the start. The tree's shape stays; its boxes are refitted for each search. A swept box
//! bounds positions at the start of a span of time and, apart from them, the displacements during it.
//! Triangles that move together are therefore not taken for boxes that sweep over the whole path
//! ([hubbard95]'s swept boxes, in relative coordinates).
//!
//! Limits: a sheet that is turned inside out keeps its initial order. Its boxes grow with the distance
//! between triangles that were neighbours.

use super::collision_mesh::{CollisionMesh, TriangleIndex};
use crate::{math::Vec3, par, sim::sheet::vectors::Vectors};

/// Triangles of a leaf.
const LEAF_SIZE: usize = 4;

/// Leaves that a task searches.
const LEAVES_PER_TASK: usize = 16;

/// Bounds of positions and of displacements.
#[derive(Clone, Copy, Debug)]
pub(super) struct SweptBox {
    low: Vec3,
    high: Vec3,
    min_displacement: Vec3,
    max_displacement: Vec3,
}

impl SweptBox {
    /// Empty bounds.
    fn empty() -> Self {
        let all = Vec3::repeat(f32::INFINITY);
        Self { low: all, high: -all, min_displacement: all, max_displacement: -all }
    }

    /// Bounds of a point and its displacement.
    #[inline]
    pub(super) fn of_point([x, displacement]: MovingPoint) -> Self {
        Self { low: x, high: x, min_displacement: displacement, max_displacement: displacement }
    }

    #[inline]
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
            min_displacement: self.min_displacement.inf(&other.min_displacement),
            max_displacement: self.max_displacement.sup(&other.max_displacement),
        }
    }

    /// Whether the two can come within `reach` of each other along every axis.
    #[inline]
    pub(super) fn overlaps(&self, other: &Self, reach: f32) -> bool {
        let mut separated = false;
        for axis in 0..3 {
            let one = self.low[axis] - other.high[axis]
                + (self.min_displacement[axis] - other.max_displacement[axis]).min(0.0);
            let two = other.low[axis] - self.high[axis]
                + (other.min_displacement[axis] - self.max_displacement[axis]).min(0.0);
            separated |= one.max(two) > reach;
        }
        !separated
    }
}

/// A position and a displacement.
pub(super) type MovingPoint = [Vec3; 2];

/// All points, each with its position next to its displacement, since they are read at random.
pub(super) fn moving_points(x: &Vectors, displacement: impl Fn(usize) -> Vec3 + Sync) -> Vec<MovingPoint> {
    let mut out = par::repeated([Vec3::zeros(); 2], x.len());
    par::fill(&mut out, |i| [x.get(i), displacement(i)]);
    out
}

/// The shape of the hierarchy.
#[derive(Debug)]
pub(super) struct Bvh {
    /// Triangles in the order of the leaves.
    order: Vec<TriangleIndex>,
}

/// The boxes of a hierarchy at a time.
#[derive(Debug)]
pub(super) struct Boxes {
    /// Boxes of the triangles, in their order.
    triangles: Vec<SweptBox>,
    /// Boxes of the nodes. The root is 1, the children of k are 2 k and 2 k + 1; the second half are the
    /// leaves.
    nodes: Vec<SweptBox>,
}

impl Bvh {
    /// Builds the hierarchy from the triangles' positions at the start.
    pub(super) fn new(mesh: &CollisionMesh) -> Self {
        let all = mesh.rest_positions.iter().copied();
        let low = all.clone().fold(Vec3::repeat(f32::INFINITY), |low, x| low.inf(&x));
        let high = all.fold(Vec3::repeat(f32::NEG_INFINITY), |high, x| high.sup(&x));
        let scale = f64::from(1 << 20) / f64::from((high - low).max()).max(f64::from(f32::MIN_POSITIVE));
        let mut keys: Vec<(u64, TriangleIndex)> = Vec::with_capacity(mesh.triangles().len());
        for triangle in mesh.triangles() {
            let corners = mesh.corners(triangle);
            let centre = corners.map(|i| mesh.rest_positions[i as usize] - low).iter().sum::<Vec3>() / 3.0;
            let cell = centre.map(|v| (f64::from(v) * scale) as u64);
            keys.push((spread_bits(cell.x) | spread_bits(cell.y) << 1 | spread_bits(cell.z) << 2, triangle));
        }
        par::sort_by_key(&mut keys, |&key| key);
        Self { order: keys.into_iter().map(|(_, triangle)| triangle).collect() }
    }

    /// Refits the boxes to positions and displacements.
    pub(super) fn refit(&self, mesh: &CollisionMesh, points: &[MovingPoint]) -> Boxes {
        let swept = |i: u32| SweptBox::of_point(points[i as usize]);
        let mut triangles = par::repeated(SweptBox::empty(), self.order.len());
        par::fill(&mut triangles, |k| {
            let [a, b, c] = mesh.corners(self.order[k]);
            swept(a).union(swept(b)).union(swept(c))
        });
        let leaves = self.order.len().div_ceil(LEAF_SIZE);
        let mut level = leaves.next_power_of_two();
        let mut nodes = par::repeated(SweptBox::empty(), 2 * level);
        par::fill(&mut nodes[level..level + leaves], |leaf| {
            let own = &triangles[leaf * LEAF_SIZE..triangles.len().min((leaf + 1) * LEAF_SIZE)];
            own.iter().fold(SweptBox::empty(), |all, one| all.union(*one))
        });
        while level > 1 {
            let (above, own) = nodes.split_at_mut(level);
            par::fill(&mut above[level / 2..], |k| own[2 * k].union(own[2 * k + 1]));
            level /= 2;
        }
        Boxes { triangles, nodes }
    }

    /// Marks the leaves with a triangle that has a selected corner.
    pub(super) fn leaves_with_selected(
        &self,
        mesh: &CollisionMesh,
        is_selected: impl Fn(u32) -> bool,
    ) -> Vec<bool> {
        let has = |&triangle: &TriangleIndex| mesh.corners(triangle).into_iter().any(&is_selected);
        self.order.chunks(LEAF_SIZE).map(|leaf| leaf.iter().any(has)).collect()
    }

    /// Calls `f(found, triangles, boxes)` for every pair of triangles that may come within `reach`. With
    /// `selected`, only pairs with one in a selected leaf. Returns what `f` found, in an order that does not
    /// depend on the threads.
    pub(super) fn overlapping_pairs<T: Send>(
        &self,
        boxes: &Boxes,
        reach: f32,
        selected: Option<&[bool]>,
        f: impl Fn(&mut Vec<T>, [TriangleIndex; 2], [&SweptBox; 2]) + Sync,
    ) -> Vec<Vec<T>> {
        let leaves = boxes.nodes.len() / 2;
        par::map_chunks(self.order.len().div_ceil(LEAF_SIZE), LEAVES_PER_TASK, |range| {
            let (mut found, mut stack) = (Vec::new(), Vec::new());
            let is_selected = |leaf: usize| selected.is_none_or(|selected| selected[leaf]);
            for leaf in range.filter(|&leaf| is_selected(leaf)) {
                let own = &boxes.nodes[leaves + leaf];
                stack.push((1, leaves));
                while let Some((node, under)) = stack.pop() {
                    // The last leaf under the node comes before this one, and has searched for the pair
                    // itself.
                    let is_past = (node + 1) * under - leaves <= leaf
                        && (selected.is_none() || (under == 1 && is_selected(node - leaves)));
                    if is_past || !own.overlaps(&boxes.nodes[node], reach) {
                        continue;
                    }
                    if under > 1 {
                        stack.push((2 * node + 1, under / 2));
                        stack.push((2 * node, under / 2));
                    } else {
                        self.leaf_pairs(boxes, reach, [leaf, node - leaves], &f, &mut found);
                    }
                }
            }
            found
        })
    }

    fn leaf_pairs<T>(
        &self,
        boxes: &Boxes,
        reach: f32,
        [one, two]: [usize; 2],
        f: &impl Fn(&mut Vec<T>, [TriangleIndex; 2], [&SweptBox; 2]),
        found: &mut Vec<T>,
    ) {
        let of = |leaf: usize| leaf * LEAF_SIZE..self.order.len().min((leaf + 1) * LEAF_SIZE);
        for i in of(one) {
            for j in of(two).filter(|&j| one != two || j > i) {
                let both = [&boxes.triangles[i], &boxes.triangles[j]];
                if both[0].overlaps(both[1], reach) {
                    f(found, [self.order[i], self.order[j]], both);
                }
            }
        }
    }
}

/// Spreads 21 bits to every third bit.
fn spread_bits(v: u64) -> u64 {
    let mut v = v & 0x1f_ffff;
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        v = (v | v << shift) & mask;
    }
    v
}
