//! The sum over cells: expansions between what is far apart, pairs between what is near.
//!
//! *Method*: [dehnen02]'s walk of two trees, from the targets' side. A cell of targets inherits the cells of sources its
//! parent was near. One whose radii together are less than θ of the distance sends its moments; else the larger of the two is
//! divided, until leaves are left, whose pairs are summed. What a cell received is handed down to its children and evaluated at
//! its points.
//!
//! The order of an expansion is the lowest that serves the distance (`accuracy.rs`), and a leaf takes the pairs where those cost
//! less. Cells are walked in a fixed order by one task each, so threads leave no trace in the result.

use super::{
    GRADIENT, POTENTIAL, Targets, Vortons,
    accuracy::Setting,
    chain::Chain,
    expansion::{self, Expansions, Senders, monomials, stride},
    index::{ADD, COEFS, MAX_ORDER, coefs},
    lanes::{self, LANES, Lanes, Pass, splat},
    moments::Sources,
    octree::{Cell, Octree, standing},
    pairs::{self, SUMS, Sums},
};
use crate::{
    math::Vec3,
    par::{self, Inverse},
};
use std::{marker::PhantomData, ops::Range};

/// Targets of a task: of many targets this share, and of few this number. Fewer spread better over threads, but what is above
/// a task's cell is done by one.
const SHARE: usize = 128;
const FEWEST: usize = 512;

/// What `vortons` induce at `targets`, with expansions as `setting` says.
pub(super) fn rows<K: Chain, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    setting: Setting,
) -> Vec<[Vec3; N]> {
    let points = targets.positions(vortons);
    if points.is_empty() || vortons.is_empty() {
        return vec![[Vec3::zeros(); N]; points.len()];
    }
    let sources = Sources::new::<K>(vortons, &setting);
    let own = match targets {
        Targets::Vortons => None,
        Targets::Points(points) => Some(Octree::new(points, setting.leaf)),
    };
    let targets = own.as_ref().unwrap_or(&sources.tree);
    let walk = Walk::<K, Q, N> { sources: &sources, targets, points, setting, kernel: PhantomData };
    let sorted = walk.all();
    let mut inverse = Inverse::default();
    inverse.rebuild(&targets.order);
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    par::fill(&mut out, |i| sorted[inverse.of(i)]);
    out
}

struct Walk<'a, K, const Q: usize, const N: usize> {
    sources: &'a Sources,
    targets: &'a Octree,
    points: &'a [Vec3],
    setting: Setting,
    kernel: PhantomData<K>,
}

/// A cell of targets from above: the local expansion of its parent, with its centre and unit, and the cells its parent is near.
#[derive(Clone)]
struct Inherited {
    local: Vec<f32>,
    center: Vec3,
    unit: f32,
    near: Vec<u32>,
}

/// Cells whose expansions serve a cell, by order.
type Far = [Vec<u32>; MAX_ORDER + 1];

impl<K: Chain, const Q: usize, const N: usize> Walk<'_, K, Q, N> {
    /// The sums of all targets, in the order of their tree.
    fn all(&self) -> Vec<[Vec3; N]> {
        let root = &self.targets.cells[0];
        let above = Inherited {
            local: vec![0.0; stride(self.setting.order)],
            center: root.center,
            unit: root.unit,
            near: vec![0],
        };
        let mut tasks = Vec::new();
        self.cut(root, above, (self.points.len() / SHARE).max(FEWEST), &mut tasks);
        let ends: Vec<usize> = tasks.iter().map(|(cell, _)| cell.places().end).collect();
        let mut out = vec![[Vec3::zeros(); N]; self.points.len()];
        par::for_parts(&mut out, &ends, 1, |task, out| {
            let (cell, above) = &tasks[task];
            self.visit(cell, above, cell.places().start, out);
        });
        out
    }

    /// Walks what is above cells of at most `most` targets, and lists those with what they inherit.
    fn cut<'s>(
        &'s self,
        cell: &'s Cell,
        above: Inherited,
        most: usize,
        tasks: &mut Vec<(&'s Cell, Inherited)>,
    ) {
        if cell.count() <= most || cell.is_leaf() {
            tasks.push((cell, above));
            return;
        }
        let here = self.receive(cell, &above);
        for child in &self.targets.cells[cell.children()] {
            self.cut(child, here.clone(), most, tasks);
        }
    }

    /// Sums at the targets of a cell; `out` begins with the target at place `first`.
    fn visit(&self, cell: &Cell, above: &Inherited, first: usize, out: &mut [[Vec3; N]]) {
        let here = self.receive(cell, above);
        if cell.is_leaf() {
            let out = &mut out[cell.places().start - first..cell.places().end - first];
            lanes::run(Leaf { walk: self, cell, here: &here, out });
        }
        for child in &self.targets.cells[cell.children()] {
            self.visit(child, &here, first, out);
        }
    }

    /// The local expansion of a cell and the cells it is near.
    fn receive(&self, cell: &Cell, above: &Inherited) -> Inherited {
        let mut far = Far::default();
        let mut near = Vec::with_capacity(2 * above.near.len());
        self.sort(cell, &above.near, &mut far, &mut near);
        let mut local = vec![0.0; stride(self.setting.order)];
        let shift = (cell.center - above.center) / above.unit;
        let ratio = cell.unit / above.unit;
        expansion::to_child(&above.local, shift.into(), ratio, self.setting.order, &mut local);
        if far.iter().any(|list| !list.is_empty()) {
            lanes::run(Receive { walk: self, cell, far: &far, local: &mut local });
        }
        Inherited { local, center: cell.center, unit: cell.unit, near }
    }

    /// Sorts the cells of sources that a cell's parent is near into those whose expansions serve it and those it is near.
    fn sort(&self, cell: &Cell, candidates: &[u32], far: &mut Far, near: &mut Vec<u32>) {
        let mut stack: Vec<u32> = candidates.iter().rev().copied().collect();
        while let Some(c) = stack.pop() {
            let source = &self.sources.tree.cells[c as usize];
            let order = self.order(cell, source, self.sources.cores(c as usize).gap);
            match order {
                Some(order) if !cell.is_leaf() || source.count() * cell.count() > self.setting.few[order] => {
                    far[order].push(c);
                }
                None if !source.is_leaf() && (cell.is_leaf() || source.radius > cell.radius) => {
                    stack.extend(source.children().rev().map(|child| child as u32));
                }
                _ => near.push(c),
            }
        }
    }

    /// The lowest order of an expansion of `source` that serves `cell`, if any does.
    #[inline(always)]
    fn order(&self, cell: &Cell, source: &Cell, gap: f32) -> Option<usize> {
        let squared = |order: usize| self.setting.squared_angles[order];
        let distance2 = (cell.center - source.center).norm_squared();
        let radii = cell.radius + source.radius;
        let highest = self.setting.order;
        let serves = |order| radii * radii < squared(order) * distance2;
        if !serves(highest) || distance2 < (radii + gap) * (radii + gap) {
            return None;
        }
        let mut order = highest;
        while serves(order - 1) {
            order -= 1;
        }
        Some(order)
    }
}

/// Adds to a local expansion what far cells send, eight of one order at a time.
struct Receive<'a, K, const Q: usize, const N: usize> {
    walk: &'a Walk<'a, K, Q, N>,
    cell: &'a Cell,
    far: &'a Far,
    local: &'a mut [f32],
}

impl<K: Chain, const Q: usize, const N: usize> Pass for Receive<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (sources, highest) = (self.walk.sources, self.walk.setting.order);
        let zero = splat::<L>(0.0);
        let from = usize::from(Q != POTENTIAL);
        let mut sums: Expansions<L> = [zero; 3 * COEFS + LANES];
        let mut moments: Expansions<L> = [zero; 3 * COEFS + LANES];
        let mut derivatives = [[zero; 256]; 2];
        let lists = self.far.iter().enumerate();
        for (order, list) in lists.flat_map(|(order, list)| list.chunks(LANES).map(move |list| (order, list)))
        {
            // The last eight are filled up with the first cell, which then has no moments.
            let mut cells = [list[0] as usize; LANES];
            let mut meant = [0.0; LANES];
            for (lane, &c) in list.iter().enumerate() {
                (cells[lane], meant[lane]) = (c as usize, 1.0);
            }
            let d = pairs::columns::<L>(|lane| self.cell.center - sources.tree.cells[cells[lane]].center);
            let (mut s2, mut radius) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                s2[lane] = sources.cores(cells[lane]).s2;
                radius[lane] = sources.tree.cells[cells[lane]].radius;
            }
            let senders = Senders { d, s2: L::load(&s2), radius: L::load(&radius) };
            let count = 3 * coefs(order);
            for first in (0..count).step_by(LANES) {
                let row = |lane: usize| -> &[f32; LANES] {
                    sources.moments(cells[lane])[first..].first_chunk().expect("filled up to eights")
                };
                let eight = L::columns([row(0), row(1), row(2), row(3), row(4), row(5), row(6), row(7)]);
                moments[first..first + LANES].copy_from_slice(&eight);
            }
            if list.len() < LANES {
                let meant = L::load(&meant);
                for m in &mut moments[..count] {
                    *m = *m * meant;
                }
            }
            let unit = self.cell.unit;
            expansion::add_local::<L, K>(
                &senders,
                &mut moments,
                unit,
                order,
                from,
                &mut derivatives,
                &mut sums,
            );
        }

        // Points all at the centre read no more than the second derivative, and units may overflow what is beyond.
        let read = if self.cell.radius > 0.0 { highest } else { highest.min(GRADIENT) };
        for (local, sum) in self.local.iter_mut().zip(&sums[..3 * coefs(read)]) {
            *local += sum.sum();
        }
    }
}

/// Evaluates the local expansion of a leaf at its targets, eight at a time, and adds the pairs with what is near.
struct Leaf<'a, K, const Q: usize, const N: usize> {
    walk: &'a Walk<'a, K, Q, N>,
    cell: &'a Cell,
    here: &'a Inherited,
    out: &'a mut [[Vec3; N]],
}

impl<K: Chain, const Q: usize, const N: usize> Pass for Leaf<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Walk { sources, targets, points, setting, .. } = self.walk;
        let order = &targets.order[self.cell.places()];
        let stretches = stretches(sources, &self.here.near);
        let scale = splat::<L>(1.0 / self.cell.unit);
        let mut powers = [splat::<L>(0.0); COEFS];
        for (order, out) in order.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let x = pairs::columns::<L>(|lane| points[order[lane.min(order.len() - 1)] as usize]);

            // What is far.
            let mut a = [splat::<L>(0.0); 3];
            for k in 0..3 {
                a[k] = (x[k] - splat(self.cell.center[k])) * scale;
            }
            monomials(a, setting.order, &mut powers);
            let far = evaluate::<L, Q, N>(&self.here.local, &powers, setting.order, scale);

            // What is near.
            let mut sums: Sums<L> = [splat(0.0); SUMS];
            for &[start, end] in &stretches {
                pairs::add_pairs::<L, K, Q>(x, &sources.sources[start as usize..end as usize], &mut sums);
            }

            let mut rows = [[0.0; SUMS]; LANES];
            for k in 0..SUMS {
                let row = sums[k].row();
                for lane in 0..LANES {
                    rows[lane][k] = row[lane];
                }
            }
            for (out, sums) in out.iter_mut().zip(rows) {
                *out = pairs::vectors::<Q, N>(sums);
            }
            for n in 0..N {
                for k in 0..3 {
                    let row = far[n][k].row();
                    for (out, far) in out.iter_mut().zip(row) {
                        out[n][k] += far;
                    }
                }
            }
        }
    }
}

/// The stretches of places of the cells `near`, those that follow one another as one; of a heap its first.
fn stretches(sources: &Sources, near: &[u32]) -> Vec<[u32; 2]> {
    let mut out: Vec<[u32; 2]> = Vec::with_capacity(near.len());
    let mut add = |places: Range<usize>| {
        let (start, end) = (places.start as u32, places.end as u32);
        match out.last_mut() {
            Some(last) if last[1] == start => last[1] = end,
            _ => out.push([start, end]),
        }
    };
    for &c in near {
        let places = sources.tree.cells[c as usize].places();
        match sources.heaps.is_empty() {
            true => add(places),
            false => standing(places, &sources.heaps).into_iter().for_each(&mut add),
        }
    }
    out
}

/// A, u, or u and the rows of ∇u of a local expansion, from the powers of the offset; `scale` is one over its unit.
#[inline(always)]
fn evaluate<L: Lanes, const Q: usize, const N: usize>(
    local: &[f32],
    powers: &[L; COEFS],
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

/// The coefficient of ∇ × A at the multi-index of place `b`.
#[inline(always)]
fn curl(local: &[f32], b: usize) -> [f32; 3] {
    let along = |axis: usize, k: usize| local[3 * usize::from(ADD[b][1 + axis]) + k];
    [along(1, 2) - along(2, 1), along(2, 0) - along(0, 2), along(0, 1) - along(1, 0)]
}

#[cfg(test)]
mod tests {
    use crate::{
        math::Vec3,
        par,
        sim::vortex::{Kernel, Method, Quantity, Targets, Vortons, induced, lanes::tests::REFERENCE_ONLY},
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
                    // On a pool of one thread, which then is the thread of every pass.
                    let find = |reference_only| {
                        par::with_threads(1, || {
                            REFERENCE_ONLY.set(reference_only);
                            induced(&vortons, Targets::Vortons, quantity, kernel, method).expect("it is fit")
                        })
                    };
                    assert!(find(true) == find(false), "{kernel:?} {method:?} {quantity:?}");
                }
            }
        }
    }
}
