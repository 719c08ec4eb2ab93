//! Near correction of the grid: the difference between the kernel of a vorton and the one that the grid
//! represents.
//!
//! *Method*: particle–particle, particle–mesh (P³M) [hockney88]: every leaf of targets sums pairs with the
//! leaves of vortons that are closer than the reach of the difference. It sums once with the kernel and core
//! of the vortons, and once with those of the grid and the opposite strength.

use super::transforms::GridKernel;
use crate::{
    math::Vec3,
    par,
    sim::vortex::{
        Vortons,
        octree::{CellIndex, Octree, representatives},
        pairs::{self, SUMS, Source, Sums},
    },
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::{marker::PhantomData, ops::Range};

/// Points per leaf at most.
const MAX_LEAF_POINTS: usize = 32;

/// Leaves per task.
const LEAVES_PER_TASK: usize = 4;

/// Vortons whose kernels differ from those of the grid.
pub(super) struct NearCorrection<'a> {
    points: &'a [Vec3],
    tree: Octree,
    /// The vortons with their own kernel and core, in the order of the tree.
    exact: Vec<Source>,
    /// The vortons with the kernel and core of the grid and −Γ, in the order of the tree.
    on_grid: Vec<Source>,
    /// Ranges of coincident vortons in the order. The first vorton of a range represents all of it.
    coincident: Vec<Range<usize>>,
    /// The largest distance at which the vortons of each cell need a correction [m].
    reach: Vec<f32>,
}

impl<'a> NearCorrection<'a> {
    /// For a grid that represents cores of `grid_core` [m].
    pub(super) fn new<K: GridKernel>(vortons: &'a Vortons, grid_core: f32, error: f32) -> Self {
        let mut tree = Octree::new(&vortons.position, MAX_LEAF_POINTS);
        let coincident = tree.group_coincident(&vortons.core, MAX_LEAF_POINTS);
        let source = |at: usize| Source::new(vortons, tree.order[at] as usize);
        let (mut exact, mut on_grid) =
            (vec![Source::default(); vortons.len()], vec![Source::default(); vortons.len()]);
        par::fill(&mut exact, source);
        par::fill(&mut on_grid, |at| {
            let Source([x, y, z, gx, gy, gz, ..]) = source(at);
            Source([x, y, z, -gx, -gy, -gz, grid_core * grid_core, 0.0])
        });
        for range in &coincident {
            Source::merge(&mut exact[range.clone()]);
            Source::merge(&mut on_grid[range.clone()]);
        }
        let far = |core: f32| match K::IS_SMOOTH && core == grid_core {
            true => 0.0,
            false => K::reach(core, grid_core, error),
        };
        let reach = tree.reduce_up(0.0, f32::max, |i| far(vortons.core[i]));
        Self { points: &vortons.position, tree, coincident, exact, on_grid, reach }
    }

    /// Adds the differences at `points` to `out`.
    pub(super) fn add<K: GridKernel, const Q: usize, const N: usize>(
        &self,
        points: &[Vec3],
        out: &mut [[Vec3; N]],
    ) {
        let other = (points != self.points).then(|| Octree::new(points, MAX_LEAF_POINTS));
        let targets = other.as_ref().unwrap_or(&self.tree);
        let (leaves, ends) = targets.leaves();
        let mut sorted = par::repeated([Vec3::zeros(); N], points.len());
        par::for_parts(&mut sorted, &ends, LEAVES_PER_TASK, |leaf, out| {
            let cell = &targets.cells[leaves[leaf].at()];
            let ranges = &self.ranges_near(cell.center, cell.radius);
            let order = &targets.order[cell.places()];
            simd::dispatch(LeafCorrection::<K, Q, N> {
                vortons: self,
                ranges,
                order,
                points,
                out,
                kernel: PhantomData,
            });
        });
        let mut inverse = par::Inverse::default();
        inverse.rebuild(&targets.order);
        par::update(out, |i, out| {
            for (out, more) in out.iter_mut().zip(&sorted[inverse.of(i)]) {
                *out += more;
            }
        });
    }

    /// The ranges of vortons in the order of the tree that need a correction somewhere in a ball.
    fn ranges_near(&self, center: Vec3, radius: f32) -> Vec<[usize; 2]> {
        let (mut ranges, mut stack) = (Vec::<[usize; 2]>::new(), vec![CellIndex::ROOT]);
        while let Some(c) = stack.pop() {
            let (cell, reach) = (&self.tree.cells[c.at()], self.reach[c.at()]);
            if reach == 0.0 || (cell.center - center).norm() > radius + cell.radius + reach {
                continue;
            }
            if cell.is_leaf() {
                for places in representatives(cell.places(), &self.coincident) {
                    match ranges.last_mut() {
                        Some(last) if last[1] == places.start => last[1] = places.end,
                        _ => ranges.push([places.start, places.end]),
                    }
                }
            } else {
                stack.extend(cell.children_reversed());
            }
        }
        ranges
    }
}

/// The correction at the points of a leaf.
struct LeafCorrection<'a, K, const Q: usize, const N: usize> {
    vortons: &'a NearCorrection<'a>,
    ranges: &'a [[usize; 2]],
    order: &'a [u32],
    points: &'a [Vec3],
    out: &'a mut [[Vec3; N]],
    kernel: PhantomData<K>,
}

impl<K: GridKernel, const Q: usize, const N: usize> Pass for LeafCorrection<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (order, out) in self.order.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let x = pairs::columns::<L>(|lane| self.points[order[lane.min(order.len() - 1)] as usize]);
            let mut sums: Sums<L> = [splat(0.0); SUMS];
            for &[start, end] in self.ranges {
                // Both sums range by range: what they share cancels before it is large.
                pairs::add_pairs::<L, K, Q>(x, &self.vortons.exact[start..end], &mut sums);
                pairs::add_pairs::<L, K::Smooth, Q>(x, &self.vortons.on_grid[start..end], &mut sums);
            }
            let rows = sums.map(L::to_array);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = pairs::vectors::<Q, N>(rows.map(|row| row[lane]));
            }
        }
    }
}
