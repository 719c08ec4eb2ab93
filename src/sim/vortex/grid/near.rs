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
        octree::Octree,
        pairs::{self, SUMS, Source, Sums},
    },
};
use std::marker::PhantomData;

/// Points of a leaf at most.
const LEAF: usize = 32;

/// Vortons whose differences are summed.
pub(super) struct Near {
    tree: Octree,
    /// With their own kernel and core, and with the lattice's and −Γ, in the order of the tree.
    own: Vec<Source>,
    lattice: Vec<Source>,
    /// How far the vortons of each cell reach [m].
    reach: Vec<f32>,
}

impl Near {
    /// For a lattice that carries cores of `smooth` [m].
    pub(super) fn new<K: Spread>(vortons: &Vortons, smooth: f32, error: f32) -> Self {
        let tree = Octree::new(&vortons.position, LEAF);
        let source = |at: usize| Source::new(vortons, tree.order[at] as usize);
        let (mut own, mut lattice) =
            (vec![Source::default(); vortons.len()], vec![Source::default(); vortons.len()]);
        par::fill(&mut own, source);
        par::fill(&mut lattice, |at| {
            let Source([x, y, z, gx, gy, gz, ..]) = source(at);
            Source([x, y, z, -gx, -gy, -gz, smooth * smooth, 0.0])
        });
        let mut reach = vec![0.0_f32; tree.cells.len()];
        par::fill(&mut reach, |c| {
            let reaches = tree.order[tree.cells[c].places()].iter().map(|&i| {
                let core = vortons.core[i as usize];
                if K::ITSELF && core == smooth { 0.0 } else { K::reach(core, smooth, error) }
            });
            reaches.fold(0.0, f32::max)
        });
        Self { tree, own, lattice, reach }
    }

    /// Adds the differences at `points` to `out`.
    pub(super) fn add<K: Spread, const Q: usize, const N: usize>(
        &self,
        points: &[Vec3],
        out: &mut [[Vec3; N]],
    ) {
        let targets = Octree::new(points, LEAF);
        let leaves: Vec<usize> = (0..targets.cells.len()).filter(|&c| targets.cells[c].is_leaf()).collect();
        let found = par::map_chunks(leaves.len(), 4, |part| {
            let mut stretches = Vec::new();
            part.flat_map(|leaf| {
                let cell = &targets.cells[leaves[leaf]];
                self.around(cell.center, cell.radius, &mut stretches);
                let order = &targets.order[cell.places()];
                lanes::run(Leaf::<K, Q, N> {
                    near: self,
                    stretches: &stretches,
                    order,
                    points,
                    kernel: PhantomData,
                })
            })
            .collect::<Vec<_>>()
        });
        let order = leaves.iter().flat_map(|&leaf| &targets.order[targets.cells[leaf].places()]);
        for (&i, more) in order.zip(found.iter().flatten()) {
            for (out, more) in out[i as usize].iter_mut().zip(more) {
                *out += more;
            }
        }
    }

    /// The stretches of vortons that reach into a ball.
    fn around(&self, center: Vec3, radius: f32, stretches: &mut Vec<[usize; 2]>) {
        stretches.clear();
        let mut stack = vec![0];
        while let Some(c) = stack.pop() {
            let cell = &self.tree.cells[c];
            if self.reach[c] == 0.0 || (cell.center - center).norm() > radius + cell.radius + self.reach[c] {
                continue;
            }
            if cell.is_leaf() {
                let places = cell.places();
                match stretches.last_mut() {
                    Some(last) if last[1] == places.start => last[1] = places.end,
                    _ => stretches.push([places.start, places.end]),
                }
            } else {
                stack.extend(cell.children().rev());
            }
        }
    }
}

/// The sums at the points of a leaf.
struct Leaf<'a, K, const Q: usize, const N: usize> {
    near: &'a Near,
    stretches: &'a [[usize; 2]],
    order: &'a [u32],
    points: &'a [Vec3],
    kernel: PhantomData<K>,
}

impl<K: Spread, const Q: usize, const N: usize> Pass for Leaf<'_, K, Q, N> {
    type Out = Vec<[Vec3; N]>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Out {
        let mut out = Vec::with_capacity(self.order.len());
        for order in self.order.chunks(LANES) {
            let x = pairs::columns::<L>(|lane| self.points[order[lane.min(order.len() - 1)] as usize]);
            let mut sums: Sums<L> = [splat(0.0); SUMS];
            for &[start, end] in self.stretches {
                // Two sums of each stretch: what they share cancels before it is large.
                pairs::add_pairs::<L, K, Q>(x, &self.near.own[start..end], &mut sums);
                pairs::add_pairs::<L, K::Smooth, Q>(x, &self.near.lattice[start..end], &mut sums);
            }
            let rows = sums.map(L::row);
            for lane in 0..order.len() {
                out.push(pairs::vectors::<Q, N>(rows.map(|row| row[lane])));
            }
        }
        out
    }
}
