//! The octree of the vortons, with the moments of every cell.

use super::{
    Vortons,
    accuracy::Setting,
    chain::Chain,
    expansion::{self, Expansions, monomials, stride},
    index::{COEFS, coefs},
    lanes::{self, LANES, Lanes, Pass, splat},
    octree::{Cell, Octree},
    pairs::{self, Source},
};
use crate::{math::Vec3, par};
use std::ops::Range;

/// Cells a task works on.
const TASK: usize = 16;

/// The vortons as sources.
pub(super) struct Sources {
    pub(super) tree: Octree,
    /// In the order of the tree; the first of a heap stands for all of it.
    pub(super) sources: Vec<Source>,
    /// Vortons of one place and core, more than a leaf has: stretches of the order.
    pub(super) heaps: Vec<Range<usize>>,
    /// Expansions of the cells, one after the other.
    moments: Vec<f32>,
    stride: usize,
    cores: Vec<Cores>,
}

/// What cores do to the expansion of a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cores {
    /// The square of the core that all its vortons count with [m²].
    pub(super) s2: f32,
    /// How far from all its vortons the expansion serves [m].
    pub(super) gap: f32,
}

impl Sources {
    /// The vortons, sorted, with moments as `setting` says.
    pub(super) fn new<K: Chain>(vortons: &Vortons, setting: &Setting) -> Self {
        let mut tree = Octree::new(&vortons.position, setting.leaf);
        let heaps = tree.heap(&vortons.core, setting.leaf);
        let mut sources = vec![Source::default(); vortons.len()];
        par::fill(&mut sources, |at| Source::new(vortons, tree.order[at] as usize));
        for heap in &heaps {
            Source::gather(&mut sources[heap.clone()]);
        }
        let stride = stride(setting.order);
        let moments = moments(&tree, &sources, setting.order, stride);
        let cores = cores::<K>(&tree, vortons, setting.error);
        Self { tree, sources, heaps, moments, stride, cores }
    }

    /// The moments of a cell, filled up to eights.
    #[inline(always)]
    pub(super) fn moments(&self, cell: usize) -> &[f32] {
        &self.moments[cell * self.stride..][..self.stride]
    }

    #[inline(always)]
    pub(super) fn cores(&self, cell: usize) -> Cores {
        self.cores[cell]
    }
}

/// 1/length, or 0 of 0: what is measured in it is then 0 too.
fn inverse(length: f32) -> f32 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}

/// The expansions of all cells: of leaves from their vortons, of others from their children.
fn moments(tree: &Octree, sources: &[Source], order: usize, stride: usize) -> Vec<f32> {
    let mut moments = vec![0.0; stride * tree.cells.len()];
    for level in tree.levels_up() {
        let (upper, lower) = moments.split_at_mut(level.end * stride);
        par::for_chunks(&mut upper[level.start * stride..], TASK * stride, |first, chunk| {
            let first = level.start + first / stride;
            for (cell, out) in tree.cells[first..].iter().zip(chunk.chunks_exact_mut(stride)) {
                if cell.is_leaf() {
                    lanes::run(OfVortons { sources: &sources[cell.places()], cell, order, out });
                }
                let inverse = inverse(cell.radius);
                for c in cell.children() {
                    let child = &tree.cells[c];
                    let shift = (child.center - cell.center) * inverse;
                    let from = &lower[(c - level.end) * stride..][..stride];
                    expansion::to_parent(from, shift.into(), child.radius * inverse, order, out);
                }
            }
        });
    }
    moments
}

struct OfVortons<'a> {
    sources: &'a [Source],
    cell: &'a Cell,
    order: usize,
    out: &'a mut [f32],
}

impl Pass for OfVortons<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let zero = splat::<L>(0.0);
        let mut sums: Expansions<L> = [zero; 3 * COEFS + LANES];
        let mut powers = [zero; COEFS];
        let (center, inverse) = (self.cell.center, splat::<L>(inverse(self.cell.radius)));
        for eight in self.sources.chunks(LANES) {
            let part = |lane: usize, from: usize| -> Vec3 {
                eight
                    .get(lane)
                    .map_or(Vec3::zeros(), |Source(q)| Vec3::new(q[from], q[from + 1], q[from + 2]))
            };
            let x = pairs::columns::<L>(|lane| if lane < eight.len() { part(lane, 0) } else { center });
            let g = pairs::columns::<L>(|lane| part(lane, 3));
            let mut minus_b = [zero; 3];
            for k in 0..3 {
                minus_b[k] = (splat::<L>(center[k]) - x[k]) * inverse;
            }
            monomials(minus_b, self.order, &mut powers);
            for a in 0..coefs(self.order) {
                for k in 0..3 {
                    sums[3 * a + k] += g[k] * powers[a];
                }
            }
        }
        for (out, sum) in self.out.iter_mut().zip(&sums[..3 * coefs(self.order)]) {
            *out = sum.sum();
        }
    }
}

/// Strengths and cores of a cell, on the way up.
#[derive(Clone, Copy, Debug)]
struct Mix {
    /// Σ|Γ| and Σ|Γ|σᵐ.
    weight: f64,
    weighted: f64,
    low: f32,
    high: f32,
}

impl Mix {
    const NONE: Self = Self { weight: 0.0, weighted: 0.0, low: f32::INFINITY, high: 0.0 };

    fn with(self, other: Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            weighted: self.weighted + other.weighted,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

/// The cores of all cells, from the leaves up.
fn cores<K: Chain>(tree: &Octree, vortons: &Vortons, error: f32) -> Vec<Cores> {
    let mut mixes = vec![Mix::NONE; tree.cells.len()];
    for level in tree.levels_up() {
        let (upper, lower) = mixes.split_at_mut(level.end);
        par::update(&mut upper[level.clone()], |k, mix| {
            let cell = &tree.cells[level.start + k];
            let own = tree.order[cell.places()].iter().filter(|_| cell.is_leaf()).map(|&i| {
                let (core, weight) =
                    (vortons.core[i as usize], f64::from(vortons.strength[i as usize].norm()));
                Mix { weight, weighted: weight * f64::from(core).powi(K::POWER), low: core, high: core }
            });
            let inherited = cell.children().map(|c| lower[c - level.end]);
            *mix = own.chain(inherited).fold(Mix::NONE, Mix::with);
        });
    }
    let mut out = vec![Cores::default(); mixes.len()];
    par::fill(&mut out, |i| {
        let Mix { weight, weighted, low, high } = mixes[i];
        let even = low == high || weight == 0.0;
        let mean = (weighted / weight).powf(2.0 / f64::from(K::POWER)) as f32;
        Cores { s2: if even { high * high } else { mean }, gap: K::gap(low, high, error) }
    });
    out
}
