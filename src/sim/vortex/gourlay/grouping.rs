//! The grouping rule of [gourlay19]: the vortons of distant cells are summed as one.
//!
//! *Method*: [gourlay19]. Layers of a uniform grid, the finest with about one vorton per cell, each coarser
//! one with half as many cells along each axis. Every cell is a vorton of its own. A point descends from the
//! one cell of the coarsest layer into the cell that holds it. All other children count as one vorton each,
//! and the children of the last step as the vortons in them.
//!
//! *Departs from the paper*: the strength of a cell is the sum over its vortons, its position their centre of
//! |Γ|, its squared core their mean by |Γ|. A point outside the grid descends towards the nearest cell.
//!
//! *Limits*: 30 to 80 % of the velocity is error, since a cell across a boundary of a coarse layer counts as
//! one vorton however near it is. Cells divide the box of all vortons evenly, so that a stray puts all others into one cell, whose
//! sums cost as much as all pairs.

use crate::{
    math::{Vec3, elementary::cbrt},
    par,
    sim::vortex::{Vortons, direct, kernels::RadialKernel},
};

/// Points per task.
const POINTS_PER_TASK: usize = 256;

/// The layers, the finest first.
struct Layers<'a> {
    low: Vec3,
    /// The edge of the finest cells [m].
    edge: f32,
    layers: Vec<Layer>,
    vortons: &'a Vortons,
    /// Indices of the vortons sorted by their cell of the finest layer, and where each cell starts.
    order: Vec<usize>,
    starts: Vec<usize>,
}

/// The cells of one layer.
struct Layer {
    counts: [usize; 3],
    cells: Vortons,
}

impl Layer {
    fn place(&self, at: [usize; 3]) -> usize {
        at[0] + self.counts[0] * (at[1] + self.counts[1] * at[2])
    }
}

/// The quantity `Q` that `vortons` induce at `points`.
pub(in crate::sim::vortex) fn rows<K: RadialKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    points: &[Vec3],
) -> Vec<[Vec3; N]> {
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    if vortons.is_empty() {
        return out;
    }
    let layers = Layers::new(vortons);
    par::for_chunks(&mut out, POINTS_PER_TASK, |first, out| {
        let mut sources = Vortons::default();
        for (x, out) in points[first..].iter().zip(out) {
            layers.gather(*x, &mut sources);
            *out = direct::rows::<K, Q, N>(&sources, std::slice::from_ref(x))[0];
        }
    });
    out
}

impl<'a> Layers<'a> {
    fn new(vortons: &'a Vortons) -> Self {
        let low = vortons.position.iter().fold(Vec3::repeat(f32::INFINITY), |a, b| a.inf(b));
        let high = vortons.position.iter().fold(Vec3::repeat(f32::NEG_INFINITY), |a, b| a.sup(b));
        // About one vorton per cubic cell, whose edge is at least a millionth of the box.
        let size = (high - low).max().max(1e-20);
        let sides = ((high - low) / size).map(|side| side.max(1e-3));
        let edge = size * cbrt(f64::from(sides.product()) / vortons.len() as f64) as f32;
        let counts: [usize; 3] = std::array::from_fn(|k| ((high - low)[k] / edge) as usize + 1);
        let mut finest = Layer { counts, cells: Vortons::default() };
        let mut members = vec![Vec::new(); counts.iter().product()];
        for (i, &x) in vortons.position.iter().enumerate() {
            members[finest.place(cell(x, low, edge, counts))].push(i);
        }
        let mut starts = vec![0];
        for members in &members {
            push_merged(&mut finest.cells, vortons, members);
            starts.push(starts[starts.len() - 1] + members.len());
        }
        let mut layers = vec![finest];
        while layers[layers.len() - 1].cells.len() > 1 {
            layers.push(coarser(&layers[layers.len() - 1]));
        }
        Self { low, edge, layers, vortons, order: members.concat(), starts }
    }

    /// Replaces `sources` by the vortons and cells that the rule sums at a point.
    fn gather(&self, x: Vec3, sources: &mut Vortons) {
        sources.position.clear();
        sources.strength.clear();
        sources.core.clear();
        let own = cell(x, self.low, self.edge, self.layers[0].counts);
        if self.layers.len() == 1 {
            (0..self.vortons.len()).for_each(|i| push(sources, self.vortons, i));
        }
        for (depth, layer) in self.layers.iter().enumerate().rev().skip(1) {
            let parent = own.map(|c| c >> (depth + 1));
            for child in 0..8 {
                let at: [usize; 3] = std::array::from_fn(|k| 2 * parent[k] + (child >> k & 1));
                if (0..3).any(|k| at[k] >= layer.counts[k]) {
                    continue;
                }
                let place = layer.place(at);
                if depth == 0 {
                    let members = &self.order[self.starts[place]..self.starts[place + 1]];
                    members.iter().for_each(|&i| push(sources, self.vortons, i));
                } else if at != own.map(|c| c >> depth) {
                    push(sources, &layer.cells, place);
                }
            }
        }
    }
}

/// The cell that holds a point, or the nearest.
fn cell(x: Vec3, low: Vec3, edge: f32, counts: [usize; 3]) -> [usize; 3] {
    std::array::from_fn(|k| (((x[k] - low[k]) / edge) as usize).min(counts[k] - 1))
}

/// The layer with half as many cells along each axis.
fn coarser(fine: &Layer) -> Layer {
    let counts = fine.counts.map(|count| count.div_ceil(2));
    let mut layer = Layer { counts, cells: Vortons::default() };
    let mut members = vec![Vec::new(); counts.iter().product()];
    for place in 0..fine.cells.len() {
        let [nx, ny, _] = fine.counts;
        let at = [place % nx, place / nx % ny, place / (nx * ny)];
        members[layer.place(at.map(|c| c / 2))].push(place);
    }
    members.iter().for_each(|members| push_merged(&mut layer.cells, &fine.cells, members));
    layer
}

/// Appends vorton `i` of another set.
fn push(to: &mut Vortons, from: &Vortons, i: usize) {
    to.position.push(from.position[i]);
    to.strength.push(from.strength[i]);
    to.core.push(from.core[i]);
}

/// Appends `members` of another set as one vorton.
fn push_merged(to: &mut Vortons, from: &Vortons, members: &[usize]) {
    let mut strength = nalgebra::Vector3::<f64>::zeros();
    let (mut center, mut squared_core, mut weight) = (strength, 0.0, 0.0);
    for &i in members {
        let own = f64::from(from.strength[i].norm());
        strength += from.strength[i].cast::<f64>();
        center += from.position[i].cast::<f64>() * own;
        squared_core += own * f64::from(from.core[i]).powi(2);
        weight += own;
    }
    to.strength.push(strength.cast());
    to.position.push(if weight > 0.0 { (center / weight).cast() } else { Vec3::zeros() });
    to.core.push(if weight > 0.0 { (squared_core / weight).sqrt() as f32 } else { 1.0 });
}
