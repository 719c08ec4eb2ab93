//! Points sorted along a Morton curve, and the cells of the octree over them.
//!
//! *Method*: points are sorted by the interleaved bits of their coordinates inside their bounding cube. A
//! cell is a range of that order, and its children are the ranges with equal bits up to the highest that
//! differ. Where one sort has no more bits, the range is sorted again by its own bounds. So a stray point, or
//! a million points in one cell, cost one more sort. The cells of a level are adjacent, parents before
//! children.

use crate::{
    math::Vec3,
    par::{self, Radix},
};
use std::ops::Range;

/// Levels that one sort resolves at most: three bits each, next to an index of 32 bits.
const MAX_LEVELS_PER_SORT: u32 = 10;

/// Points closer together than this [m] are coincident: a smaller distance squared underflows single
/// precision.
const MIN_DISTANCE: f32 = 1e-18;

/// Cells per task.
const CELLS_PER_TASK: usize = 64;

/// Index of a cell of an octree, not of a point or of a leaf among the leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct CellIndex(pub(super) u32);

impl CellIndex {
    /// The root of every octree.
    pub(super) const ROOT: Self = Self(0);

    /// The cell as an index into lists of cells.
    #[inline(always)]
    pub(super) fn at(self) -> usize {
        self.0 as usize
    }
}

/// A range of the order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// The centre of the bounds of the points [m].
    pub(super) center: Vec3,
    /// The largest distance of a point from the centre [m].
    pub(super) radius: f32,
    /// The unit of offsets in local expansions [m]: the radius, or that of the parent if it is zero.
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

    /// The points, as a range of the order.
    #[inline]
    pub(super) fn places(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// The number of points.
    #[inline]
    pub(super) fn count(&self) -> usize {
        self.places().len()
    }

    /// The children, as indices of cells.
    #[inline]
    pub(super) fn children(&self) -> Range<usize> {
        self.child as usize..(self.child + self.children) as usize
    }

    /// The children from the last to the first: on a stack the first comes out first.
    #[inline]
    pub(super) fn children_reversed(&self) -> impl Iterator<Item = CellIndex> + use<> {
        (self.child..self.child + self.children).rev().map(CellIndex)
    }

    /// Whether the cell has no children.
    #[inline]
    pub(super) fn is_leaf(&self) -> bool {
        self.children == 0
    }
}

/// The octree over points. Empty if there are none.
#[derive(Debug, Default)]
pub(super) struct Octree {
    /// The indices of the points in their order.
    pub(super) order: Vec<u32>,
    /// The cells, level by level from the root.
    pub(super) cells: Vec<Cell>,
    /// The end of each level in `cells`.
    pub(super) ends: Vec<usize>,
}

impl Octree {
    /// The octree over finite `points`. A leaf holds at most `max_leaf_points`, or coincident points.
    pub(super) fn new(points: &[Vec3], max_leaf_points: usize) -> Self {
        let mut sorter = Sorter {
            points,
            max_leaf_points,
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
        tree.set_bounds(points);
        tree.set_units();
        tree
    }

    /// The cells of every level, the deepest first.
    pub(super) fn levels_up(&self) -> impl Iterator<Item = Range<usize>> {
        (0..self.ends.len()).rev().map(|k| if k == 0 { 0 } else { self.ends[k - 1] }..self.ends[k])
    }

    /// Sorts coincident points by core, and returns the ranges of more than `max_leaf_points` with one core,
    /// in ascending order. One source can represent such a range.
    pub(super) fn group_coincident(&mut self, core: &[f32], max_leaf_points: usize) -> Vec<Range<usize>> {
        let is_coincident = |cell: &&Cell| cell.is_leaf() && cell.count() > max_leaf_points;
        let mut coincident = Vec::new();
        for places in self.cells.iter().filter(is_coincident).map(Cell::places) {
            let order = &mut self.order[places.clone()];
            order.sort_unstable_by_key(|&i| (core[i as usize].to_bits(), i));
            let mut at = places.start;
            for same in order.chunk_by(|&a, &b| core[a as usize].to_bits() == core[b as usize].to_bits()) {
                coincident.extend((same.len() > max_leaf_points).then(|| at..at + same.len()));
                at += same.len();
            }
        }
        coincident.sort_unstable_by_key(|range| range.start);
        coincident
    }

    /// Reduces a number over every cell: the `own` numbers of the points of leaves, those of the children of
    /// other cells.
    pub(super) fn reduce_up(
        &self,
        start: f32,
        fold: impl Fn(f32, f32) -> f32 + Sync,
        own: impl Fn(usize) -> f32 + Sync,
    ) -> Vec<f32> {
        let mut found = vec![start; self.cells.len()];
        for level in self.levels_up() {
            let (upper, lower) = found.split_at_mut(level.end);
            par::update(&mut upper[level.clone()], |k, found| {
                let cell = &self.cells[level.start + k];
                let points = self.order[cell.places()].iter().filter(|_| cell.is_leaf());
                let points = points.map(|&i| own(i as usize));
                *found = points.chain(cell.children().map(|c| lower[c - level.end])).fold(start, &fold);
            });
        }
        found
    }

    /// The leaves along the order, and the end of each in it.
    pub(super) fn leaves(&self) -> (Vec<CellIndex>, Vec<usize>) {
        let cells = (0..self.cells.len() as u32).map(CellIndex);
        let mut leaves: Vec<CellIndex> = cells.filter(|c| self.cells[c.at()].is_leaf()).collect();
        leaves.sort_unstable_by_key(|c| self.cells[c.at()].start);
        let ends = leaves.iter().map(|c| self.cells[c.at()].places().end).collect();
        (leaves, ends)
    }

    /// Sets centres and radii, from the leaves up.
    fn set_bounds(&mut self, points: &[Vec3]) {
        let mut boxes = vec![EMPTY; self.cells.len()];
        let levels: Vec<Range<usize>> = self.levels_up().collect();
        for level in levels {
            let (cells, order, known) = (&self.cells, &self.order, &boxes);
            let found = par::map_chunks(level.len(), CELLS_PER_TASK, |range| {
                let bounds = |k| bounds_of_cell(&cells[level.start + k], cells, known, order, points);
                range.map(bounds).collect::<Vec<_>>()
            });
            for (i, (bounds, center, radius)) in level.zip(found.into_iter().flatten()) {
                boxes[i] = bounds;
                (self.cells[i].center, self.cells[i].radius) = (center, radius);
            }
        }
    }

    /// Sets units, from the root down.
    fn set_units(&mut self) {
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

/// The ranges of `places` in which the first point of every range of `coincident`, which is ascending,
/// represents all of it.
pub(super) fn representatives(places: Range<usize>, coincident: &[Range<usize>]) -> Vec<Range<usize>> {
    let first = coincident.partition_point(|range| range.end <= places.start);
    let (mut ranges, mut from) = (Vec::new(), places.start);
    for range in coincident[first..].iter().take_while(|range| range.start < places.end) {
        ranges.push(from..range.start + 1);
        from = range.end;
    }
    ranges.push(from..places.end);
    ranges.retain(|range| !range.is_empty());
    ranges
}

/// Lowest and highest coordinates.
type Bounds = [Vec3; 2];

const EMPTY: Bounds = [
    Vec3::new(f32::INFINITY, f32::INFINITY, f32::INFINITY),
    Vec3::new(-f32::INFINITY, -f32::INFINITY, -f32::INFINITY),
];

fn joined(a: Bounds, b: Bounds) -> Bounds {
    [a[0].inf(&b[0]), a[1].sup(&b[1])]
}

fn bounds_of_points(order: &[u32], points: &[Vec3]) -> Bounds {
    order.iter().fold(EMPTY, |bounds, &i| joined(bounds, [points[i as usize]; 2]))
}

/// The bounds, centre and radius of a cell, from those of its children.
fn bounds_of_cell(
    cell: &Cell,
    cells: &[Cell],
    known: &[Bounds],
    order: &[u32],
    points: &[Vec3],
) -> (Bounds, Vec3, f32) {
    let order = &order[cell.places()];
    let bounds = match cell.is_leaf() {
        true => bounds_of_points(order, points),
        false => known[cell.children()].iter().copied().fold(EMPTY, joined),
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
    (bounds, center, if radius < MIN_DISTANCE { 0.0 } else { radius })
}

/// The sort of points into the order of an octree.
struct Sorter<'a> {
    points: &'a [Vec3],
    max_leaf_points: usize,
    order: Vec<u32>,
    /// The Morton key of each point of the order, from the last sort of its range.
    keys: Vec<u32>,
    radix: Radix,
}

impl Sorter<'_> {
    /// Adds the children of the range `places` to `cells`: none if it is small or coincident.
    fn divide(&mut self, places: Range<usize>, cells: &mut Vec<Cell>) {
        if places.len() <= self.max_leaf_points {
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

    /// Sorts a range by the Morton keys of its own bounds; false if all its points are coincident.
    fn sort(&mut self, places: Range<usize>) -> bool {
        let Self { points, max_leaf_points, order, keys, radix } = self;
        let order = &mut order[places.clone()];
        let [low, high] =
            par::map_chunks(order.len(), 1 << 14, |range| bounds_of_points(&order[range], points))
                .into_iter()
                .fold(EMPTY, joined);
        let edge = (high - low).max();
        if edge < MIN_DISTANCE {
            return false;
        }
        // Four levels more than an even cloud would have.
        let levels = ((order.len() / *max_leaf_points).ilog2() / 3 + 4).min(MAX_LEVELS_PER_SORT);
        let last = (1_u32 << levels) - 1;
        let scale = (last + 1) as f32 / edge;
        let before: &[u32] = order;
        radix.sort(before.len(), 32, 3 * levels, |at| {
            let cell = (points[before[at] as usize] - low) * scale;
            let key = cell.map(|c| interleaved((c as u32).min(last)));
            u64::from(key.x << 2 | key.y << 1 | key.z) << 32 | u64::from(before[at])
        });
        par::fill(order, |at| radix.get(at) as u32);
        par::fill(&mut keys[places], |at| (radix.get(at) >> 32) as u32);
        true
    }
}

/// The lowest ten bits, with two zeros between each.
fn interleaved(x: u32) -> u32 {
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

    /// Checks that every point is in one leaf, that children make up their parent, and that radii reach every
    /// point.
    fn check(points: &[Vec3], max_leaf_points: usize) -> Octree {
        let tree = Octree::new(points, max_leaf_points);
        let mut seen = tree.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(k, &i)| k == i as usize));
        let mut held = 0;
        for cell in &tree.cells {
            for &i in &tree.order[cell.places()] {
                let far = (points[i as usize] - cell.center).norm();
                assert!(far <= cell.radius * (1.0 + 1e-5) + MIN_DISTANCE, "{far} {}", cell.radius);
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
    fn coincident_points_are_one_leaf() {
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

    #[test]
    fn coincident_vortons_of_one_core_are_one_range() {
        // Thousands of coincident points with two cores and a few other cores, in a cloud.
        let mut points = points(9000);
        points[1000..8000].fill(Vec3::new(0.3, 0.4, 0.5));
        let core = |i: usize| {
            if i < 5000 {
                0.1
            } else if i < 7990 {
                0.2
            } else {
                i as f32
            }
        };
        let core: Vec<f32> = (0..points.len()).map(core).collect();
        let mut tree = Octree::new(&points, 16);
        let coincident = tree.group_coincident(&core, 16);
        assert_eq!(coincident.iter().map(Range::len).collect::<Vec<_>>(), [4000, 2990]);
        for range in &coincident {
            let order = &tree.order[range.clone()];
            let first = order[0] as usize;
            assert!(
                order.iter().all(|&i| points[i as usize] == points[first] && core[i as usize] == core[first])
            );
        }
        // One vorton represents each range; all others represent themselves.
        let ranges = representatives(0..points.len(), &coincident);
        assert_eq!(ranges.iter().map(Range::len).sum::<usize>(), 9000 - 4000 - 2990 + 2);
        let leaf = tree.cells.iter().find(|cell| cell.is_leaf() && cell.count() > 16).unwrap();
        let in_leaf: usize = representatives(leaf.places(), &coincident).iter().map(Range::len).sum();
        assert_eq!(in_leaf, 2 + 10);
        let all = representatives(5..9, &[]);
        assert!(all.len() == 1 && all[0] == (5..9), "{all:?}");
    }
}
