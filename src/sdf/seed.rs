//! Distances of the nodes next to the surface, directly from the field.
//!
//! *Method* [gourlay17], "Finding Surfaces Using the Indicator Function" and "Signed Distance Function".
//! *Departs from the paper*: the plane through the crossings of all axes replaces the nearest crossing alone,
//! which remains as [`SeedRule::NearestEdge`]; the field's values on both sides of an edge place a crossing, instead of the value
//! inside alone, which remains as [`SeedRule::DensityRatio`]. The indicator is stored as one bit per node, so that crossings
//! are found 64 nodes at a time.
//!
//! An axis without a crossing within a voxel takes the place where the field's slope would cross. Without
//! that the plane is tilted: on a sphere of radius 10 voxels the worst error was 0.41 voxel instead of 0.04,
//! and the mean 0.043 instead of 0.014 (nearest crossing alone: 0.41 and 0.079).
//!
//! Limits: exact for a plane in a field that is linear across it. On a surface of curvature κ the error is at
//! most κ/2 voxels. Where another surface is within a voxel, the plane mixes the two.

use super::SdfParams;
use crate::grid::{BRICK, BRICK_NODES, Bricks, FACES, NodeMask, SparseGrid, mask_of, neighbour};
use crate::par;
use serde::{Deserialize, Serialize};

/// How a node next to the surface gets its distance from the crossings on its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum SeedRule {
    /// The distance to the plane through the nearest crossing of each axis, on or beyond the node's edges.
    #[default]
    Plane,
    /// The distance to the nearest crossing, as [gourlay17] has it: never too small, up to √3 too large.
    NearestEdge,
    /// Both rules of [gourlay17]: the nearest crossing, and each crossing at the part A/M of the edge from the node
    /// inside, whose density is A; M is the density 1 of a full cell. The threshold gives the side of a node alone.
    DensityRatio,
}

/// The smallest distance of a pinned node [voxels].
///
/// It keeps every value on its own side of zero. Below 1e-7 it would be lost to rounding when a mesh vertex
/// is placed between two nodes; at 1e-3 a surface that passes exactly through nodes would show steps.
pub(super) const MIN_DISTANCE: f32 = 1e-6;

/// The nodes next to a surface and their distances, on the bricks within a band of it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Seeds {
    /// Every brick within the band.
    pub bricks: Bricks,
    /// 512 numbers per brick [voxels]: pinned distances as negative numbers, ∞ at all other nodes.
    pub distance: Vec<f32>,
    /// The indicator of every brick: the nodes inside.
    pub inside: Vec<NodeMask>,
    /// How many nodes are pinned.
    pub pinned: usize,
    /// How many of them were nearer to the surface than the smallest stored distance.
    pub on_surface: usize,
}

/// Pins the nodes next to the surface where `field` crosses `threshold`; `params` as for
/// [`from_density`](super::from_density).
///
/// # Panics
/// If the band is below one voxel, or finite and above 10⁸.
pub fn seeds(field: &SparseGrid, threshold: f32, params: &SdfParams) -> Seeds {
    assert!(params.band >= 1.0, "the band holds the nodes next to the surface");
    assert!(params.band <= 1e8 || params.band.is_infinite(), "a band beyond 10⁸ voxels is infinite");
    let indicator = Indicator { field, masks: indicator(field, threshold) };
    let bricks = bricks_in_band(&indicator, params.band);

    // Every brick of the band gets its indicator and its pinned distances.
    let mut distance = vec![f32::INFINITY; bricks.len() * BRICK_NODES];
    par::for_chunks(&mut distance, BRICK_NODES, |start, values| {
        let stencil = indicator.stencil(bricks.coords()[start / BRICK_NODES]);
        for_each_bit(&stencil.adjacent(), |place| {
            values[place] = -stencil.distance(place, threshold, params.seed).max(MIN_DISTANCE);
        });
    });
    let mut inside = vec![NodeMask::default(); bricks.len()];
    par::fill(&mut inside, |brick| indicator.mask(bricks.coords()[brick]));
    let [pinned, on_surface] = count(&distance);
    Seeds { bricks, distance, inside, pinned, on_surface }
}

/// How many nodes are pinned, and how many of these have the smallest distance.
pub(super) fn count(distance: &[f32]) -> [usize; 2] {
    let count = |condition: fn(f32) -> bool| {
        let counts = par::map_chunks(distance.len(), par::CHUNK, |range| {
            distance[range].iter().filter(|&&d| condition(d)).count()
        });
        counts.into_iter().sum()
    };
    [count(|d| d < 0.0), count(|d| d == -MIN_DISTANCE)]
}

/// The indicator of every brick of `field`: inside is at or above the threshold.
fn indicator(field: &SparseGrid, threshold: f32) -> Vec<NodeMask> {
    let mut masks = vec![NodeMask::default(); field.bricks.len()];
    par::fill(&mut masks, |brick| mask_of(field.brick(brick), |&value| value >= threshold));
    masks
}

/// The bricks that the narrow band around the surface reaches. For an infinite band: the field's own and
/// those that the cells on the surface reach.
///
/// Every cell on the surface has a node in a brick of the field, so the field's bricks are enough to start
/// from. A node closer to the surface than the band is at most ⌈band⌉ nodes from such a node along each axis.
fn bricks_in_band(indicator: &Indicator, band: f32) -> Bricks {
    let bricks = &indicator.field.bricks;
    let reach = if band.is_finite() { band.ceil() as i32 } else { 1 };
    let mut coords: Vec<[i32; 3]> = par::map_chunks(bricks.len(), 64, |range| {
        let mut reached = Vec::new();
        for coord in bricks.coords()[range].iter().copied() {
            let Some((low, high)) = indicator.stencil(coord).extent() else { continue };
            let first = low.map(|v| (v - reach).div_euclid(BRICK as i32));
            let last = high.map(|v| (v + reach).div_euclid(BRICK as i32));
            for z in first[2]..=last[2] {
                for y in first[1]..=last[1] {
                    reached.extend((first[0]..=last[0]).map(|x| [coord[0] + x, coord[1] + y, coord[2] + z]));
                }
            }
        }
        // Neighbouring bricks reach the same ones: most duplicates are removed here, on all threads.
        reached.sort_unstable();
        reached.dedup();
        reached
    })
    .concat();
    if band.is_infinite() {
        coords.extend(bricks.coords().iter().chain(indicator.field.filled.coords()));
    }
    Bricks::new(coords)
}

/// A field with its indicator.
struct Indicator<'a> {
    field: &'a SparseGrid,
    masks: Vec<NodeMask>,
}

impl Indicator<'_> {
    /// The nodes inside of the brick at `coord`.
    fn mask(&self, coord: [i32; 3]) -> NodeMask {
        match self.field.bricks.find(coord) {
            Some(brick) => self.masks[brick],
            None if self.field.filled.find(coord).is_some() => [u64::MAX; BRICK],
            None => [0; BRICK],
        }
    }

    /// The field in and around the brick at `coord`.
    fn stencil(&self, coord: [i32; 3]) -> BrickStencil<'_> {
        let around = FACES.map(|step| std::array::from_fn(|axis| coord[axis] + step[axis]));
        let values = |coord: [i32; 3]| self.field.bricks.find(coord).map(|brick| self.field.brick(brick));
        BrickStencil {
            own: values(coord),
            around: around.map(values),
            inside: self.mask(coord),
            inside_around: around.map(|coord| self.mask(coord)),
        }
    }
}

/// One brick of a field and its six neighbours; a missing one is 1 everywhere if it is filled, else zero.
struct BrickStencil<'a> {
    own: Option<&'a [f32]>,
    around: [Option<&'a [f32]>; 6],
    inside: NodeMask,
    inside_around: [NodeMask; 6],
}

/// The bits of a mask word with x = 0.
const X_LOW: u64 = 0x0101_0101_0101_0101;

impl BrickStencil<'_> {
    /// The nodes whose neighbour across `face` lies on the other side of the threshold.
    fn crossed(&self, face: usize) -> NodeMask {
        let (own, other) = (&self.inside, &self.inside_around[face]);
        std::array::from_fn(|z| {
            let neighbour = match face {
                0 => (own[z] & !(X_LOW << 7)) << 1 | (other[z] >> 7 & X_LOW),
                1 => (own[z] & !X_LOW) >> 1 | (other[z] & X_LOW) << 7,
                2 => own[z] << 8 | other[z] >> 56,
                3 => own[z] >> 8 | other[z] << 56,
                4 if z > 0 => own[z - 1],
                4 => other[BRICK - 1],
                _ if z + 1 < BRICK => own[z + 1],
                _ => other[0],
            };
            own[z] ^ neighbour
        })
    }

    /// The nodes with a neighbour on the other side of the threshold.
    fn adjacent(&self) -> NodeMask {
        (0..6)
            .map(|face| self.crossed(face))
            .fold(NodeMask::default(), |a, b| std::array::from_fn(|z| a[z] | b[z]))
    }

    /// The lowest and highest node next to the surface, in nodes from the brick's first.
    fn extent(&self) -> Option<([i32; 3], [i32; 3])> {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for_each_bit(&self.adjacent(), |place| {
            for (axis, v) in [place % 8, place / 8 % 8, place / 64].into_iter().enumerate() {
                low[axis] = low[axis].min(v as i32);
                high[axis] = high[axis].max(v as i32);
            }
        });
        (low[0] <= high[0]).then_some((low, high))
    }

    /// The field at a node and at its neighbour across `face`.
    fn pair(&self, place: usize, face: usize) -> (f32, f32) {
        let value = |brick: Option<&[f32]>, mask: &NodeMask, place: usize| {
            brick.map_or(if mask[0] == 0 { 0.0 } else { 1.0 }, |values| values[place])
        };
        let within = |place: usize| value(self.own, &self.inside, place);
        let own = within(place);
        let other = match neighbour(place, face) {
            (place, true) => value(self.around[face], &self.inside_around[face], place),
            (place, false) => within(place),
        };
        (own, other)
    }

    /// The distance of a node next to the surface [voxels].
    fn distance(&self, place: usize, threshold: f32, rule: SeedRule) -> f32 {
        rule.distance(std::array::from_fn(|face| self.pair(place, face)), threshold)
    }
}

impl SeedRule {
    /// The distance [voxels] of a node next to the surface, from the field there and at its neighbour beyond
    /// each of the faces −x, +x, −y, +y, −z, +z. A missing neighbour has the node's own value.
    pub fn distance(self, pairs: [(f32, f32); 6], threshold: f32) -> f32 {
        // Along each axis the nearest crossing, and where the field would cross beyond the neighbour.
        let (mut crossing, mut beyond) = ([f32::INFINITY; 3], [f32::INFINITY; 3]);
        for (face, (own, other)) in pairs.into_iter().enumerate() {
            let along = ((threshold - own) / (other - own)).max(MIN_DISTANCE);
            if (own >= threshold) != (other >= threshold) {
                let along =
                    if self == SeedRule::DensityRatio { density_ratio(own, other, threshold) } else { along };
                crossing[face / 2] = along.min(crossing[face / 2]);
            } else if along >= 1.0 {
                beyond[face / 2] = along.min(beyond[face / 2]);
            }
        }
        match self {
            SeedRule::NearestEdge | SeedRule::DensityRatio => crossing[0].min(crossing[1]).min(crossing[2]),
            SeedRule::Plane => {
                let d: [f32; 3] = std::array::from_fn(|axis| crossing[axis].min(beyond[axis]));
                1.0 / d.map(|d| 1.0 / (d * d)).iter().sum::<f32>().sqrt() // the plane Σ xₖ/dₖ = 1
            }
        }
    }
}

/// The part of an edge from a node to the crossing, of which the density inside alone decides.
fn density_ratio(own: f32, other: f32, threshold: f32) -> f32 {
    if own >= threshold {
        own.min(1.0) // z = x + h (A/M), [gourlay17] Figure 3
    } else {
        (1.0 - other).max(MIN_DISTANCE) // z = x + h (1 − A/M), [gourlay17] Figure 3
    }
}

/// Calls `f` with the place of every bit that is set, ascending.
fn for_each_bit(mask: &NodeMask, mut f: impl FnMut(usize)) {
    for (z, &word) in mask.iter().enumerate() {
        let mut left = word;
        while left != 0 {
            f(z * 64 + left.trailing_zeros() as usize);
            left &= left - 1;
        }
    }
}
