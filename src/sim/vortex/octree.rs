//! Points sorted along a Morton curve, and the cells of the octree over them.
//!
//! *Method*: points are sorted by the interleaved bits of their coordinates inside their bounding cube; a cell is a stretch of
//! that order, and its children are the stretches that differ in the highest bits that differ at all. Where one sort has no more
//! bits, the stretch is sorted anew by its own bounds, so a stray point, or a million in what was one cell, cost one more
//! sort. Cells of a level stand together, parents before children.

use crate::{
    math::Vec3,
    par::{self, Radix},
};
use std::ops::Range;

/// The most levels that one sort resolves: three bits each beside a number of 32.
const LEVELS: u32 = 10;

/// Points closer together than this [m] are at one place: squares of less leave single precision.
const TOGETHER: f32 = 1e-18;

/// Cells a task works on.
const TASK: usize = 64;

/// A stretch of the order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// The middle of its points' bounds [m].
    pub(super) center: Vec3,
    /// How far its points are from there at most [m].
    pub(super) radius: f32,
    /// What offsets in it are measured in [m]: its radius, or its parent's if that is zero.
    pub(super) unit: f32,
    start: u32,
    end: u32,
    child: u32,
    children: u32,
}

impl Cell {
    fn new(places: Range<usize>) -> Self {
        Self {
            center: Vec3::zeros(),
            radius: 0.0,
            unit: 1.0,
            start: places.start as u32,
            end: places.end as u32,
            child: 0,
            children: 0,
        }
    }

    /// Its points, as places of the order.
    #[inline]
    pub(super) fn places(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// How many points it has.
    #[inline]
    pub(super) fn count(&self) -> usize {
        self.places().len()
    }

    /// Its children, as numbers of cells.
    #[inline]
    pub(super) fn children(&self) -> Range<usize> {
        self.child as usize..(self.child + self.children) as usize
    }

    /// Whether it has no children.
    #[inline]
    pub(super) fn is_leaf(&self) -> bool {
        self.children == 0
    }
}

/// The octree over points. Empty if there are none.
#[derive(Debug, Default)]
pub(super) struct Octree {
    /// The points in their order.
    pub(super) order: Vec<u32>,
    /// The root first, a level after the other.
    pub(super) cells: Vec<Cell>,
    /// Where each level ends.
    pub(super) ends: Vec<usize>,
}

impl Octree {
    /// The octree over `points`, finite, whose leaves hold `leaf` of them at most, or those of one place.
    pub(super) fn new(points: &[Vec3], leaf: usize) -> Self {
        let mut sorter = Sorter {
            points,
            leaf,
            order: (0..points.len() as u32).collect(),
            keys: vec![0; points.len()],
            radix: Radix::default(),
        };
        let mut cells = vec![Cell::new(0..points.len())];
        let (mut ends, mut first) = (Vec::new(), 0);
        while first < cells.len() {
            let end = cells.len();
            for i in first..end {
                cells[i].child = cells.len() as u32;
                sorter.divide(cells[i].places(), &mut cells);
                cells[i].children = cells.len() as u32 - cells[i].child;
            }
            ends.push(end);
            first = end;
        }
        let mut tree = Self { order: sorter.order, cells, ends };
        tree.bound(points);
        tree.measure();
        tree
    }

    /// The cells of every level, the deepest first.
    pub(super) fn levels_up(&self) -> impl Iterator<Item = Range<usize>> {
        (0..self.ends.len()).rev().map(|k| if k == 0 { 0 } else { self.ends[k - 1] }..self.ends[k])
    }

    /// Centres and radii, from the leaves up.
    fn bound(&mut self, points: &[Vec3]) {
        let mut boxes = vec![NOWHERE; self.cells.len()];
        let levels: Vec<Range<usize>> = self.levels_up().collect();
        for level in levels {
            let (cells, order, known) = (&self.cells, &self.order, &boxes);
            let found = par::map_chunks(level.len(), TASK, |part| {
                let bounds = |k| bounds_of(&cells[level.start + k], cells, known, order, points);
                part.map(bounds).collect::<Vec<_>>()
            });
            for (i, (bounds, center, radius)) in level.zip(found.into_iter().flatten()) {
                boxes[i] = bounds;
                (self.cells[i].center, self.cells[i].radius) = (center, radius);
            }
        }
    }

    /// Units, from the root down.
    fn measure(&mut self) {
        for i in 0..self.cells.len() {
            let Cell { radius, unit, .. } = self.cells[i];
            let unit = if radius > 0.0 { radius } else { unit };
            self.cells[i].unit = unit;
            for child in self.cells[i].children() {
                self.cells[child].unit = unit;
            }
        }
    }
}

/// Lowest and highest coordinates.
type Bounds = [Vec3; 2];

const NOWHERE: Bounds = [
    Vec3::new(f32::INFINITY, f32::INFINITY, f32::INFINITY),
    Vec3::new(-f32::INFINITY, -f32::INFINITY, -f32::INFINITY),
];

fn joined(a: Bounds, b: Bounds) -> Bounds {
    [a[0].inf(&b[0]), a[1].sup(&b[1])]
}

fn around(order: &[u32], points: &[Vec3]) -> Bounds {
    order.iter().fold(NOWHERE, |bounds, &i| joined(bounds, [points[i as usize]; 2]))
}

/// A cell's bounds, centre and radius, if those of its children are known.
fn bounds_of(
    cell: &Cell,
    cells: &[Cell],
    known: &[Bounds],
    order: &[u32],
    points: &[Vec3],
) -> (Bounds, Vec3, f32) {
    let order = &order[cell.places()];
    let bounds = match cell.is_leaf() {
        true => around(order, points),
        false => known[cell.children()].iter().copied().fold(NOWHERE, joined),
    };
    if order.is_empty() {
        return (bounds, Vec3::zeros(), 0.0);
    }
    let center = bounds[0] * 0.5 + bounds[1] * 0.5;
    let reach = |x: Vec3| (x - center).norm();
    let radius = match cell.is_leaf() {
        true => order.iter().map(|&i| reach(points[i as usize])).fold(0.0, f32::max),
        false => {
            let spheres = cells[cell.children()].iter().map(|child| reach(child.center) + child.radius);
            spheres.fold(0.0, f32::max).min(reach(bounds[0]).max(reach(bounds[1])))
        }
    };
    (bounds, center, if radius < TOGETHER { 0.0 } else { radius })
}

/// Points on their way into an order.
struct Sorter<'a> {
    points: &'a [Vec3],
    leaf: usize,
    order: Vec<u32>,
    /// The bits of the point at each place of the order, of the last sort of the stretch that it is in.
    keys: Vec<u32>,
    radix: Radix,
}

impl Sorter<'_> {
    /// Adds the children of the stretch `places` to `cells`: none if it is small or all in one place.
    fn divide(&mut self, places: Range<usize>, cells: &mut Vec<Cell>) {
        if places.len() <= self.leaf {
            return;
        }
        if self.keys[places.start] == self.keys[places.end - 1] && !self.sort(places.clone()) {
            return;
        }
        let keys = &self.keys[places.clone()];
        let highest = (keys[0] ^ keys[keys.len() - 1]).ilog2();
        let shift = highest - highest % 3;
        let mut at = 0;
        while at < keys.len() {
            let digit = keys[at] >> shift;
            let count = keys[at..].partition_point(|key| key >> shift == digit);
            cells.push(Cell::new(places.start + at..places.start + at + count));
            at += count;
        }
    }

    /// Sorts a stretch by the Morton keys of its own bounds; false if all its points are in one place.
    fn sort(&mut self, places: Range<usize>) -> bool {
        let Self { points, leaf, order, keys, radix } = self;
        let order = &mut order[places.clone()];
        let [low, high] = par::map_chunks(order.len(), 1 << 14, |part| around(&order[part], points))
            .into_iter()
            .fold(NOWHERE, joined);
        let edge = (high - low).max();
        if edge < TOGETHER {
            return false;
        }
        // Four levels more than an even cloud would have.
        let levels = ((order.len() / *leaf).ilog2() / 3 + 4).min(LEVELS);
        let last = (1_u32 << levels) - 1;
        let scale = (last + 1) as f32 / edge;
        let before: &[u32] = order;
        radix.sort(before.len(), 32, 3 * levels, |at| {
            let cell = (points[before[at] as usize] - low) * scale;
            let key = cell.map(|c| spread((c as u32).min(last)));
            u64::from(key.x << 2 | key.y << 1 | key.z) << 32 | u64::from(before[at])
        });
        par::fill(order, |at| radix.get(at) as u32);
        par::fill(&mut keys[places], |at| (radix.get(at) >> 32) as u32);
        true
    }
}

/// The lowest ten bits, two zeros between each.
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00ff;
    let x = (x | x << 8) & 0x0300_f00f;
    let x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(i: u64) -> f32 {
        let mut x = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((x ^ (x >> 27)) >> 40) as f32 / (1 << 24) as f32
    }

    fn points(count: u64) -> Vec<Vec3> {
        (0..count).map(|i| Vec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2))).collect()
    }

    /// Every point is in one leaf, children are their parent, and radii reach every point.
    fn check(points: &[Vec3], leaf: usize) -> Octree {
        let tree = Octree::new(points, leaf);
        let mut seen = tree.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(k, &i)| k == i as usize));
        let mut held = 0;
        for cell in &tree.cells {
            for &i in &tree.order[cell.places()] {
                let far = (points[i as usize] - cell.center).norm();
                assert!(far <= cell.radius * (1.0 + 1e-5) + TOGETHER, "{far} {}", cell.radius);
            }
            let mut at = cell.places().start;
            for child in &tree.cells[cell.children()] {
                assert!(
                    child.places().start == at && child.count() > 0 && child.radius <= cell.radius * 1.000_01
                );
                at = child.places().end;
            }
            if cell.is_leaf() {
                held += cell.count();
            } else {
                assert!(at == cell.places().end && cell.children().len() > 1, "no chains of single children");
            }
        }
        assert_eq!(held, points.len());
        tree
    }

    #[test]
    fn cells_hold_their_points() {
        for (count, leaf) in [(0, 8), (1, 8), (2, 1), (8, 8), (9, 8), (1000, 1), (20_000, 32)] {
            let tree = check(&points(count), leaf);
            assert!(tree.cells.iter().all(|cell| !cell.is_leaf() || cell.count() <= leaf));
        }
    }

    #[test]
    fn points_of_one_place_are_one_leaf() {
        let tree = check(&vec![Vec3::new(1.0, 2.0, 3.0); 100], 8);
        assert_eq!(tree.cells.len(), 1);
        let two: Vec<Vec3> = (0..100).map(|i| Vec3::repeat((i % 2) as f32)).collect();
        assert_eq!(check(&two, 8).cells.len(), 3);
    }

    #[test]
    fn a_stray_and_a_deep_cluster_cost_one_more_sort() {
        let mut cloud = points(5000);
        cloud.push(Vec3::repeat(1e6));
        let tree = check(&cloud, 16);
        assert!(tree.cells.iter().all(|cell| !cell.is_leaf() || cell.count() <= 16));
        assert!(tree.ends.len() < 14, "{} levels", tree.ends.len());
        let nested: Vec<Vec3> =
            points(4000).iter().enumerate().map(|(i, x)| x * 10.0_f32.powi(-(i as i32 % 30))).collect();
        check(&nested, 16);
    }

    #[test]
    fn the_order_does_not_depend_on_the_threads() {
        let cloud = points(50_000);
        let order = |threads| par::with_threads(threads, || Octree::new(&cloud, 32).order);
        let one = order(1);
        assert!([2, 3, 8].iter().all(|&threads| order(threads) == one));
    }
}
