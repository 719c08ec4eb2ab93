//! The fast multipole method: expansions between well-separated cells, pairs between near ones.
//!
//! *Method*: [dehnen02]'s dual tree traversal, from the targets' side. A target cell inherits the source
//! cells that were near its parent. The acceptance criterion of a source cell is that the sum of both radii
//! is less than θ of the distance. An accepted cell adds its moments to the local expansion. Otherwise the
//! larger of the two cells is divided, down to leaves, whose pairs are summed. The local expansion of a cell
//! is translated to its children and evaluated at the points of leaves.
//!
//! The order of an expansion is the lowest that is accurate enough at the distance (`accuracy.rs`). A leaf
//! sums pairs where that costs less. Each task traverses its cells in a fixed order, so the number of threads
//! does not change the result.

use super::{
    Targets, Vortons,
    accuracy::TreeSettings,
    expansion::{self, Expansions, SourceCells, monomials, stride},
    index::{ADD, MAX_COEFS, MAX_ORDER, coefs},
    kernels::RadialKernel,
    moments::Sources,
    octree::{Cell, CellIndex, Octree, representatives},
    pairs::{self, SUMS, Sums},
    quantities::{GRADIENT, POTENTIAL},
};
use crate::{
    math::Vec3,
    par::{self, Inverse},
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::{marker::PhantomData, ops::Range};

/// Tasks into which the targets are divided, about. More tasks balance threads better, but one thread visits
/// all cells above those of the tasks.
const TASKS: usize = 128;

/// Targets per task at least, unless there are fewer.
const MIN_TARGETS_PER_TASK: usize = 512;

/// The quantity `Q` that `vortons` induce at `targets`.
pub(super) fn rows<K: RadialKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    settings: TreeSettings,
) -> Vec<[Vec3; N]> {
    let points = targets.positions(vortons);
    if points.is_empty() || vortons.is_empty() {
        return vec![[Vec3::zeros(); N]; points.len()];
    }
    let sources = Sources::new::<K>(vortons, &settings);
    let own = match targets {
        Targets::Vortons => None,
        Targets::Points(points) => Some(Octree::new(points, settings.max_leaf_points)),
    };
    let targets = own.as_ref().unwrap_or(&sources.tree);
    let traversal =
        Traversal::<K, Q, N> { sources: &sources, targets, points, settings, kernel: PhantomData };
    let sorted = traversal.rows();
    let mut inverse = Inverse::default();
    inverse.rebuild(&targets.order);
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    par::fill(&mut out, |i| sorted[inverse.of(i)]);
    out
}

struct Traversal<'a, K, const Q: usize, const N: usize> {
    sources: &'a Sources,
    targets: &'a Octree,
    points: &'a [Vec3],
    settings: TreeSettings,
    kernel: PhantomData<K>,
}

/// The state of a target cell that its children inherit: its local expansion, with centre and unit, and the
/// source cells near it.
#[derive(Clone)]
struct CellState {
    local: Vec<f32>,
    center: Vec3,
    unit: f32,
    near: Vec<CellIndex>,
}

/// Source cells whose expansions a target cell accepts, by order.
type AcceptedCells = [Vec<CellIndex>; MAX_ORDER + 1];

impl<K: RadialKernel, const Q: usize, const N: usize> Traversal<'_, K, Q, N> {
    /// The sums at all targets, in the order of their tree.
    fn rows(&self) -> Vec<[Vec3; N]> {
        let root = &self.targets.cells[0];
        let above = CellState {
            local: vec![0.0; stride(self.settings.order)],
            center: root.center,
            unit: root.unit,
            near: vec![CellIndex::ROOT],
        };
        let mut tasks = Vec::new();
        self.split(root, above, (self.points.len() / TASKS).max(MIN_TARGETS_PER_TASK), &mut tasks);
        let ends: Vec<usize> = tasks.iter().map(|(cell, _)| cell.places().end).collect();
        let mut out = vec![[Vec3::zeros(); N]; self.points.len()];
        par::for_parts(&mut out, &ends, 1, |task, out| {
            let (cell, above) = &tasks[task];
            self.visit(cell, above, cell.places().start, out);
        });
        out
    }

    /// Visits the cells above those of at most `max_targets` targets, and lists the latter with the state of
    /// their parents.
    fn split<'s>(
        &'s self,
        cell: &'s Cell,
        above: CellState,
        max_targets: usize,
        tasks: &mut Vec<(&'s Cell, CellState)>,
    ) {
        if cell.count() <= max_targets || cell.is_leaf() {
            tasks.push((cell, above));
            return;
        }
        let state = self.state(cell, &above);
        for child in &self.targets.cells[cell.children()] {
            self.split(child, state.clone(), max_targets, tasks);
        }
    }

    /// Sums at the targets of a cell; `out` starts with the target `first` of the order.
    fn visit(&self, cell: &Cell, above: &CellState, first: usize, out: &mut [[Vec3; N]]) {
        let state = self.state(cell, above);
        if cell.is_leaf() {
            let out = &mut out[cell.places().start - first..cell.places().end - first];
            simd::dispatch(LeafTargets { traversal: self, cell, state: &state, out });
        }
        for child in &self.targets.cells[cell.children()] {
            self.visit(child, &state, first, out);
        }
    }

    /// The local expansion of a cell and the source cells near it.
    fn state(&self, cell: &Cell, above: &CellState) -> CellState {
        let mut accepted = AcceptedCells::default();
        let mut near = Vec::with_capacity(2 * above.near.len());
        self.separate(cell, &above.near, &mut accepted, &mut near);
        let order = self.settings.order;
        let mut local = vec![0.0; stride(order)];
        let shift = (cell.center - above.center) / above.unit;
        let ratio = cell.unit / above.unit;
        expansion::local_of_child(&above.local, shift.into(), ratio, order, &mut local);
        if accepted.iter().any(|list| !list.is_empty()) {
            simd::dispatch(AddAccepted { traversal: self, cell, accepted: &accepted, local: &mut local });
        }
        CellState { local, center: cell.center, unit: cell.unit, near }
    }

    /// Separates the source cells near the parent of a cell into those whose expansions it accepts and those
    /// near it.
    fn separate(
        &self,
        cell: &Cell,
        candidates: &[CellIndex],
        accepted: &mut AcceptedCells,
        near: &mut Vec<CellIndex>,
    ) {
        let break_even_pairs = &self.settings.break_even_pairs;
        let mut stack: Vec<CellIndex> = candidates.iter().rev().copied().collect();
        while let Some(c) = stack.pop() {
            let source = &self.sources.tree.cells[c.at()];
            let order = self.accepted_order(cell, source, self.sources.core(c).gap);
            match order {
                Some(order) if !cell.is_leaf() || source.count() * cell.count() > break_even_pairs[order] => {
                    accepted[order].push(c);
                }
                None if !source.is_leaf() && (cell.is_leaf() || source.radius > cell.radius) => {
                    stack.extend(source.children_reversed());
                }
                _ => near.push(c),
            }
        }
    }

    /// The acceptance criterion: the lowest order with which `cell` accepts the expansion of `source`, if
    /// any.
    #[inline(always)]
    fn accepted_order(&self, cell: &Cell, source: &Cell, gap: f32) -> Option<usize> {
        let squared = |order: usize| self.settings.squared_angles[order];
        let distance2 = (cell.center - source.center).norm_squared();
        let radii = cell.radius + source.radius;
        let highest = self.settings.order;
        let accepts = |order| radii * radii < squared(order) * distance2;
        if !accepts(highest) || distance2 < (radii + gap) * (radii + gap) {
            return None;
        }
        let mut order = highest;
        while accepts(order - 1) {
            order -= 1;
        }
        Some(order)
    }
}

/// Adds accepted source cells to a local expansion, eight of one order at a time.
struct AddAccepted<'a, K, const Q: usize, const N: usize> {
    traversal: &'a Traversal<'a, K, Q, N>,
    cell: &'a Cell,
    accepted: &'a AcceptedCells,
    local: &'a mut [f32],
}

impl<K: RadialKernel, const Q: usize, const N: usize> Pass for AddAccepted<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (sources, highest) = (self.traversal.sources, self.traversal.settings.order);
        let zero = splat::<L>(0.0);
        let from = usize::from(Q != POTENTIAL);
        let mut sums: Expansions<L> = [zero; 3 * MAX_COEFS + LANES];
        let mut moments: Expansions<L> = [zero; 3 * MAX_COEFS + LANES];
        let mut derivatives = [[zero; 256]; 2];
        let lists = self.accepted.iter().enumerate();
        for (order, list) in lists.flat_map(|(order, list)| list.chunks(LANES).map(move |list| (order, list)))
        {
            // The last eight are padded with the first cell, without its moments.
            let mut cells = [list[0]; LANES];
            let mut weights = [0.0; LANES];
            for (lane, &c) in list.iter().enumerate() {
                (cells[lane], weights[lane]) = (c, 1.0);
            }
            let d =
                pairs::columns::<L>(|lane| self.cell.center - sources.tree.cells[cells[lane].at()].center);
            let (mut s2, mut radius) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                s2[lane] = sources.core(cells[lane]).s2;
                radius[lane] = sources.tree.cells[cells[lane].at()].radius;
            }
            let source_cells = SourceCells { d, s2: L::load(&s2), radius: L::load(&radius) };
            let count = 3 * coefs(order);
            for first in (0..count).step_by(LANES) {
                let row = |lane: usize| -> &[f32; LANES] {
                    sources.moments(cells[lane])[first..].first_chunk().expect("padded to eight")
                };
                let eight = L::transpose([row(0), row(1), row(2), row(3), row(4), row(5), row(6), row(7)]);
                moments[first..first + LANES].copy_from_slice(&eight);
            }
            if list.len() < LANES {
                let weights = L::load(&weights);
                for m in &mut moments[..count] {
                    *m = *m * weights;
                }
            }
            let unit = self.cell.unit;
            expansion::add_moments_to_local::<L, K>(
                &source_cells,
                &mut moments,
                unit,
                order,
                from,
                &mut derivatives,
                &mut sums,
            );
        }

        // Points that are all at the centre need the first two derivatives only, and units may overflow the
        // others.
        let read = if self.cell.radius > 0.0 { highest } else { highest.min(GRADIENT) };
        for (local, sum) in self.local.iter_mut().zip(&sums[..3 * coefs(read)]) {
            *local += sum.sum();
        }
    }
}

/// Evaluates the local expansion of a leaf at its targets, eight at a time, and adds the pairs with near
/// cells.
struct LeafTargets<'a, K, const Q: usize, const N: usize> {
    traversal: &'a Traversal<'a, K, Q, N>,
    cell: &'a Cell,
    state: &'a CellState,
    out: &'a mut [[Vec3; N]],
}

impl<K: RadialKernel, const Q: usize, const N: usize> Pass for LeafTargets<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Traversal { sources, targets, points, settings, .. } = self.traversal;
        let order = &targets.order[self.cell.places()];
        let ranges = source_ranges(sources, &self.state.near);
        let scale = splat::<L>(1.0 / self.cell.unit);
        let mut powers = [splat::<L>(0.0); MAX_COEFS];
        for (order, out) in order.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let x = pairs::columns::<L>(|lane| points[order[lane.min(order.len() - 1)] as usize]);

            // The local expansion.
            let mut a = [splat::<L>(0.0); 3];
            for k in 0..3 {
                a[k] = (x[k] - splat(self.cell.center[k])) * scale;
            }
            monomials(a, settings.order, &mut powers);
            let far = evaluate::<L, Q, N>(&self.state.local, &powers, settings.order, scale);

            // The pairs with near cells.
            let mut sums: Sums<L> = [splat(0.0); SUMS];
            for &[start, end] in &ranges {
                pairs::add_pairs::<L, K, Q>(x, &sources.sources[start as usize..end as usize], &mut sums);
            }

            let mut rows = [[0.0; SUMS]; LANES];
            for k in 0..SUMS {
                let row = sums[k].to_array();
                for lane in 0..LANES {
                    rows[lane][k] = row[lane];
                }
            }
            for (out, sums) in out.iter_mut().zip(rows) {
                *out = pairs::vectors::<Q, N>(sums);
            }
            for n in 0..N {
                for k in 0..3 {
                    let row = far[n][k].to_array();
                    for (out, far) in out.iter_mut().zip(row) {
                        out[n][k] += far;
                    }
                }
            }
        }
    }
}

/// The ranges of the order that the cells `near` hold, with adjacent ranges joined and coincident vortons
/// represented.
fn source_ranges(sources: &Sources, near: &[CellIndex]) -> Vec<[u32; 2]> {
    let mut out: Vec<[u32; 2]> = Vec::with_capacity(near.len());
    let mut add = |places: Range<usize>| {
        let (start, end) = (places.start as u32, places.end as u32);
        match out.last_mut() {
            Some(last) if last[1] == start => last[1] = end,
            _ => out.push([start, end]),
        }
    };
    for &c in near {
        let places = sources.tree.cells[c.at()].places();
        match sources.coincident.is_empty() {
            true => add(places),
            false => representatives(places, &sources.coincident).into_iter().for_each(&mut add),
        }
    }
    out
}

/// Evaluates A, u, or u and the rows of ∇u from a local expansion and the powers of the offset; `scale` is
/// one over its unit.
#[inline(always)]
fn evaluate<L: Lanes, const Q: usize, const N: usize>(
    local: &[f32],
    powers: &[L; MAX_COEFS],
    order: usize,
    scale: L,
) -> [[L; 3]; N] {
    let mut out = [[splat::<L>(0.0); 3]; N];
    if Q == POTENTIAL {
        for b in 0..coefs(order) {
            for k in 0..3 {
                out[0][k] += splat::<L>(local[3 * b + k]) * powers[b];
            }
        }
        return out;
    }

    // The coefficients of ∇ × A are differences of those of A one degree higher.
    for (b, &power) in powers.iter().enumerate().take(coefs(order - 1)) {
        let curl = curl(local, b);
        for k in 0..3 {
            out[0][k] += splat::<L>(curl[k]) * power;
        }
    }
    if Q == GRADIENT {
        for b in 0..coefs(order - 2) {
            for j in 0..3 {
                let curl = curl(local, usize::from(ADD[b][1 + j]));
                for i in 0..3 {
                    out[1 + i][j] += splat::<L>(curl[i]) * powers[b];
                }
            }
        }
        for row in &mut out[1..] {
            for slope in row {
                *slope = *slope * (scale * scale);
            }
        }
    }
    for component in &mut out[0] {
        *component = *component * scale;
    }
    out
}

/// The coefficient of ∇ × A at the multi-index with index `b`.
#[inline(always)]
fn curl(local: &[f32], b: usize) -> [f32; 3] {
    let along = |axis: usize, k: usize| local[3 * usize::from(ADD[b][1 + axis]) + k];
    [along(1, 2) - along(2, 1), along(2, 0) - along(0, 2), along(0, 1) - along(1, 0)]
}

#[cfg(test)]
mod tests {
    use crate::{
        math::Vec3,
        sim::vortex::{Kernel, Method, Quantity, Targets, Vortons, induced},
        simd::tests::in_both_forms,
    };

    #[test]
    fn both_forms_of_lanes_give_the_same_bits() {
        let noise = |i: usize| ((i * 7919) % 10_007) as f32 / 10_007.0;
        let vector = |i: usize| Vec3::new(noise(3 * i), noise(5 * i + 1), noise(11 * i + 2));
        let vortons = Vortons {
            position: (0..1500).map(vector).collect(),
            strength: (0..1500).map(|i| vector(i + 3000) - Vec3::repeat(0.5)).collect(),
            core: (0..1500).map(|i| 0.02 + 0.03 * noise(i)).collect(),
        };
        for kernel in [Kernel::Ball, Kernel::RosenheadMoore, Kernel::WinckelmansLeonard, Kernel::Gaussian] {
            for method in [Method::Direct, Method::Tree { error: 1e-2 }] {
                for quantity in [Quantity::Potential, Quantity::VelocityAndGradient] {
                    let [scalar, fastest] = in_both_forms(|| {
                        induced(&vortons, Targets::Vortons, quantity, kernel, method).expect("it is fit")
                    });
                    assert!(scalar == fastest, "{kernel:?} {method:?} {quantity:?}");
                }
            }
        }
    }
}
