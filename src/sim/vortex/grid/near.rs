//! What the lattice leaves out near a vorton: the difference of its own kernel and of the one that the lattice carries.
//!
//! *Method*: particle–particle, particle–mesh [hockney88]: every leaf of targets sums the pairs with the leaves of vortons that come
//! closer than the difference reaches, once with the vortons' kernel and core, once with the lattice's and the strength
//! turned round.

use super::spread::Spread;
use crate::{
    math::Vec3,
    par,
    sim::vortex::{
        Vortons,
        lanes::{self, LANES, Lanes, Pass, splat},
        octree::{Octree, standing},
        pairs::{self, SUMS, Source, Sums},
    },
};
use std::{marker::PhantomData, ops::Range};

/// Points of a leaf at most.
const LEAF: usize = 32;

/// Leaves a task works on.
const TASK: usize = 4;

/// Vortons whose differences are summed.
pub(super) struct Near<'a> {
    points: &'a [Vec3],
    tree: Octree,
    /// With their own kernel and core, and with the lattice's and −Γ, in the order of the tree.
    own: Vec<Source>,
    lattice: Vec<Source>,
    /// Vortons of one place and core, more than a leaf has: stretches of the order, of which the first stands for all.
    heaps: Vec<Range<usize>>,
    /// How far the vortons of each cell reach [m].
    reach: Vec<f32>,
}

impl<'a> Near<'a> {
    /// For a lattice that carries cores of `smooth` [m].
    pub(super) fn new<K: Spread>(vortons: &'a Vortons, smooth: f32, error: f32) -> Self {
        let mut tree = Octree::new(&vortons.position, LEAF);
        let heaps = tree.heap(&vortons.core, LEAF);
        let source = |at: usize| Source::new(vortons, tree.order[at] as usize);
        let (mut own, mut lattice) =
            (vec![Source::default(); vortons.len()], vec![Source::default(); vortons.len()]);
        par::fill(&mut own, source);
        par::fill(&mut lattice, |at| {
            let Source([x, y, z, gx, gy, gz, ..]) = source(at);
            Source([x, y, z, -gx, -gy, -gz, smooth * smooth, 0.0])
        });
        for heap in &heaps {
            Source::gather(&mut own[heap.clone()]);
            Source::gather(&mut lattice[heap.clone()]);
        }
        let far = |core: f32| if K::ITSELF && core == smooth { 0.0 } else { K::reach(core, smooth, error) };
        let reach = tree.upwards(0.0, f32::max, |i| far(vortons.core[i]));
        Self { points: &vortons.position, tree, heaps, own, lattice, reach }
    }

    /// Adds the differences at `points` to `out`.
    pub(super) fn add<K: Spread, const Q: usize, const N: usize>(
        &self,
        points: &[Vec3],
        out: &mut [[Vec3; N]],
    ) {
        let other = (points != self.points).then(|| Octree::new(points, LEAF));
        let targets = other.as_ref().unwrap_or(&self.tree);
        let (leaves, ends) = targets.leaves();
        let mut sorted = par::repeated([Vec3::zeros(); N], points.len());
        par::for_parts(&mut sorted, &ends, TASK, |leaf, out| {
            let cell = &targets.cells[leaves[leaf] as usize];
            let stretches = &self.around(cell.center, cell.radius);
            let order = &targets.order[cell.places()];
            lanes::run(Leaf::<K, Q, N> { near: self, stretches, order, points, out, kernel: PhantomData });
        });
        let mut inverse = par::Inverse::default();
        inverse.rebuild(&targets.order);
        par::update(out, |i, out| {
            for (out, more) in out.iter_mut().zip(&sorted[inverse.of(i)]) {
                *out += more;
            }
        });
    }

    /// The stretches of vortons that reach into a ball.
    fn around(&self, center: Vec3, radius: f32) -> Vec<[usize; 2]> {
        let (mut stretches, mut stack) = (Vec::<[usize; 2]>::new(), vec![0]);
        while let Some(c) = stack.pop() {
            let cell = &self.tree.cells[c];
            if self.reach[c] == 0.0 || (cell.center - center).norm() > radius + cell.radius + self.reach[c] {
                continue;
            }
            if cell.is_leaf() {
                for places in standing(cell.places(), &self.heaps) {
                    match stretches.last_mut() {
                        Some(last) if last[1] == places.start => last[1] = places.end,
                        _ => stretches.push([places.start, places.end]),
                    }
                }
            } else {
                stack.extend(cell.children().rev());
            }
        }
        stretches
    }
}

/// The sums at the points of a leaf.
struct Leaf<'a, K, const Q: usize, const N: usize> {
    near: &'a Near<'a>,
    stretches: &'a [[usize; 2]],
    order: &'a [u32],
    points: &'a [Vec3],
    out: &'a mut [[Vec3; N]],
    kernel: PhantomData<K>,
}

impl<K: Spread, const Q: usize, const N: usize> Pass for Leaf<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (order, out) in self.order.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let x = pairs::columns::<L>(|lane| self.points[order[lane.min(order.len() - 1)] as usize]);
            let mut sums: Sums<L> = [splat(0.0); SUMS];
            for &[start, end] in self.stretches {
                // Two sums of each stretch: what they share cancels before it is large.
                pairs::add_pairs::<L, K, Q>(x, &self.near.own[start..end], &mut sums);
                pairs::add_pairs::<L, K::Smooth, Q>(x, &self.near.lattice[start..end], &mut sums);
            }
            let rows = sums.map(L::row);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = pairs::vectors::<Q, N>(rows.map(|row| row[lane]));
            }
        }
    }
}
