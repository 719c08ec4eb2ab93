//! The octree of the vortons, with the moments (multipole expansions) of every cell.

use super::{
    Vortons,
    accuracy::TreeSettings,
    expansion::{self, Expansions, monomials, stride},
    index::{MAX_COEFS, coefs},
    kernels::RadialKernel,
    octree::{Cell, CellIndex, Octree},
    pairs::{self, Source},
};
use crate::math::elementary::powf;
use crate::{
    math::Vec3,
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::ops::Range;

/// Cells per task.
const CELLS_PER_TASK: usize = 16;

/// The vortons as sources.
pub(super) struct Sources {
    pub(super) tree: Octree,
    /// The sources in the order of the tree. The first of a coincident range represents all of it.
    pub(super) sources: Vec<Source>,
    /// Ranges of coincident vortons in the order.
    pub(super) coincident: Vec<Range<usize>>,
    /// The moments of the cells in sequence.
    moments: Vec<f32>,
    stride: usize,
    cores: Vec<CellCore>,
}

/// The core of the vortons of a cell in its expansion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CellCore {
    /// The squared core that represents all vortons of the cell [m²].
    pub(super) s2: f32,
    /// The smallest distance from all vortons of the cell at which the expansion is valid [m].
    pub(super) gap: f32,
}

impl Sources {
    /// Sorts the vortons, and computes moments of the order that `settings` requests.
    pub(super) fn new<K: RadialKernel>(vortons: &Vortons, settings: &TreeSettings) -> Self {
        let mut tree = Octree::new(&vortons.position, settings.max_leaf_points);
        let coincident = tree.group_coincident(&vortons.core, settings.max_leaf_points);
        let mut sources = vec![Source::default(); vortons.len()];
        par::fill(&mut sources, |at| Source::new(vortons, tree.order[at] as usize));
        for range in &coincident {
            Source::merge(&mut sources[range.clone()]);
        }
        let stride = stride(settings.order);
        let moments = moments(&tree, &sources, settings.order, stride);
        let cores = cores::<K>(&tree, vortons, settings.error);
        Self { tree, sources, coincident, moments, stride, cores }
    }

    /// The moments of a cell, padded to a multiple of eight.
    #[inline(always)]
    pub(super) fn moments(&self, cell: CellIndex) -> &[f32] {
        &self.moments[cell.at() * self.stride..][..self.stride]
    }

    /// The core of a cell.
    #[inline(always)]
    pub(super) fn core(&self, cell: CellIndex) -> CellCore {
        self.cores[cell.at()]
    }
}

/// 1/length, or 0 if the length is 0: every offset is then 0 too.
fn inverse(length: f32) -> f32 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}

/// The moments of all cells: of leaves from their vortons, of others from their children.
fn moments(tree: &Octree, sources: &[Source], order: usize, stride: usize) -> Vec<f32> {
    let mut moments = vec![0.0; stride * tree.cells.len()];
    for level in tree.levels_up() {
        let (upper, lower) = moments.split_at_mut(level.end * stride);
        par::for_chunks(&mut upper[level.start * stride..], CELLS_PER_TASK * stride, |first, chunk| {
            let first = level.start + first / stride;
            for (cell, out) in tree.cells[first..].iter().zip(chunk.chunks_exact_mut(stride)) {
                if cell.is_leaf() {
                    simd::dispatch(LeafMoments { sources: &sources[cell.places()], cell, order, out });
                }
                let inverse = inverse(cell.radius);
                for c in cell.children() {
                    let child = &tree.cells[c];
                    let shift = (child.center - cell.center) * inverse;
                    let from = &lower[(c - level.end) * stride..][..stride];
                    let ratio = child.radius * inverse;
                    expansion::add_moments_to_parent(from, shift.into(), ratio, order, out);
                }
            }
        });
    }
    moments
}

/// Sums the moments of a leaf over its vortons.
struct LeafMoments<'a> {
    sources: &'a [Source],
    cell: &'a Cell,
    order: usize,
    out: &'a mut [f32],
}

impl Pass for LeafMoments<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let zero = splat::<L>(0.0);
        let mut sums: Expansions<L> = [zero; 3 * MAX_COEFS + LANES];
        let mut powers = [zero; MAX_COEFS];
        let (center, inverse) = (self.cell.center, splat::<L>(inverse(self.cell.radius)));
        for eight in self.sources.chunks(LANES) {
            let vector = |lane: usize, from: usize| -> Vec3 {
                eight
                    .get(lane)
                    .map_or(Vec3::zeros(), |Source(q)| Vec3::new(q[from], q[from + 1], q[from + 2]))
            };
            let x = pairs::columns::<L>(|lane| if lane < eight.len() { vector(lane, 0) } else { center });
            let g = pairs::columns::<L>(|lane| vector(lane, 3));
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

/// Sums over the cores of a cell.
#[derive(Clone, Copy, Debug)]
struct CoreSums {
    /// Σ|Γ|.
    weight: f64,
    /// Σ|Γ|σᵐ.
    weighted: f64,
    /// The smallest core [m].
    low: f32,
    /// The largest core [m].
    high: f32,
}

impl CoreSums {
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
fn cores<K: RadialKernel>(tree: &Octree, vortons: &Vortons, error: f32) -> Vec<CellCore> {
    let mut sums = vec![CoreSums::NONE; tree.cells.len()];
    for level in tree.levels_up() {
        let (upper, lower) = sums.split_at_mut(level.end);
        par::update(&mut upper[level.clone()], |k, sums| {
            let cell = &tree.cells[level.start + k];
            let own = tree.order[cell.places()].iter().filter(|_| cell.is_leaf()).map(|&i| {
                let (core, weight) =
                    (vortons.core[i as usize], f64::from(vortons.strength[i as usize].norm()));
                let weighted = weight * f64::from(core).powi(K::CORE_POWER);
                CoreSums { weight, weighted, low: core, high: core }
            });
            let of_children = cell.children().map(|c| lower[c - level.end]);
            *sums = own.chain(of_children).fold(CoreSums::NONE, CoreSums::with);
        });
    }
    let mut out = vec![CellCore::default(); sums.len()];
    par::fill(&mut out, |i| {
        let CoreSums { weight, weighted, low, high } = sums[i];
        let even = low == high || weight == 0.0;
        let mean = powf(weighted / weight, 2.0 / f64::from(K::CORE_POWER)) as f32;
        CellCore { s2: if even { high * high } else { mean }, gap: K::min_gap(low, high, error) }
    });
    out
}
