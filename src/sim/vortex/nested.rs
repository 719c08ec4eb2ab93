//! The source text's tree rule, for comparison.
//!
//! *Method*: [gourlay19]. Layers of a uniform grid, the finest with about one vorton a cell, each coarser one of half as many
//! cells an axis; every cell is a vorton of its own. A point descends from the one cell of the coarsest layer into the cell that
//! holds it; all other children count as one vorton each, and the children of the last step as the vortons in them.
//!
//! *Departs from the paper*: a cell's strength is the sum of its vortons', its place their centre of |Γ|, its core the mean by
//! |Γ|; a point outside the grid descends towards the nearest cell.

use super::{
    Vortons,
    chain::Chain,
    lanes::{self, Lanes, Pass, splat},
    pairs::{self, SUMS, Source, Sums},
};
use crate::{math::Vec3, par};
use std::marker::PhantomData;

/// Targets a task works on.
const TASK: usize = 256;

/// The layers, the finest first.
struct Layers {
    low: Vec3,
    /// The edge of the finest cells [m].
    edge: f32,
    layers: Vec<Layer>,
    /// The vortons by their cell of the finest layer, and where each cell's begin.
    vortons: Vec<Source>,
    starts: Vec<u32>,
}

/// The cells of one layer.
struct Layer {
    counts: [usize; 3],
    cells: Vec<Source>,
}

impl Layer {
    fn place(&self, at: [usize; 3]) -> usize {
        at[0] + self.counts[0] * (at[1] + self.counts[1] * at[2])
    }
}

/// What `vortons` induce at `points` by the text's rule.
pub(super) fn rows<K: Chain, const Q: usize, const N: usize>(
    vortons: &Vortons,
    points: &[Vec3],
) -> Vec<[Vec3; N]> {
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    if vortons.is_empty() {
        return out;
    }
    let layers = Layers::new(vortons);
    par::for_chunks(&mut out, TASK, |first, out| {
        let mut sources = Vec::new();
        for (x, out) in points[first..].iter().zip(out) {
            sources.clear();
            layers.gather(*x, &mut sources);
            let sums = lanes::run(One::<K, Q> { x: *x, sources: &sources, kernel: PhantomData });
            *out = pairs::vectors::<Q, N>(sums);
        }
    });
    out
}

impl Layers {
    fn new(vortons: &Vortons) -> Self {
        let low = vortons.position.iter().fold(Vec3::repeat(f32::INFINITY), |a, b| a.inf(b));
        let high = vortons.position.iter().fold(Vec3::repeat(f32::NEG_INFINITY), |a, b| a.sup(b));
        // About one vorton a cell, in cubes, of at least a millionth of the whole.
        let size = (high - low).max().max(1e-20);
        let sides = ((high - low) / size).map(|side| side.max(1e-3));
        let edge = size * (sides.product() / vortons.len() as f32).cbrt();
        let counts: [usize; 3] = std::array::from_fn(|k| ((high - low)[k] / edge) as usize + 1);
        let mut finest = Layer { counts, cells: Vec::new() };
        let mut order: Vec<(usize, usize)> = vortons
            .position
            .iter()
            .enumerate()
            .map(|(i, &x)| (finest.place(cell(x, low, edge, counts)), i))
            .collect();
        order.sort_unstable();
        let mut starts = vec![0_u32; counts.iter().product::<usize>() + 1];
        for &(c, _) in &order {
            starts[c + 1] += 1;
        }
        for c in 1..starts.len() {
            starts[c] += starts[c - 1];
        }
        let sources: Vec<Source> = order.iter().map(|&(_, i)| Source::new(vortons, i)).collect();
        finest.cells = starts.windows(2).map(|w| merged(&sources[w[0] as usize..w[1] as usize])).collect();
        let mut layers = vec![finest];
        while layers[layers.len() - 1].cells.len() > 1 {
            layers.push(coarser(&layers[layers.len() - 1]));
        }
        Self { low, edge, layers, vortons: sources, starts }
    }

    /// What the rule sums at a point.
    fn gather(&self, x: Vec3, sources: &mut Vec<Source>) {
        let own = cell(x, self.low, self.edge, self.layers[0].counts);
        if self.layers.len() == 1 {
            sources.extend(&self.vortons);
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
                    sources
                        .extend(&self.vortons[self.starts[place] as usize..self.starts[place + 1] as usize]);
                } else if at != own.map(|c| c >> depth) {
                    sources.push(layer.cells[place]);
                }
            }
        }
    }
}

/// The cell that holds a point, or the nearest.
fn cell(x: Vec3, low: Vec3, edge: f32, counts: [usize; 3]) -> [usize; 3] {
    std::array::from_fn(|k| (((x[k] - low[k]) / edge) as usize).min(counts[k] - 1))
}

/// The layer of half as many cells an axis.
fn coarser(fine: &Layer) -> Layer {
    let counts = fine.counts.map(|count| count.div_ceil(2));
    let mut parts = vec![Vec::new(); counts.iter().product()];
    let layer = Layer { counts, cells: Vec::new() };
    for (place, cell) in fine.cells.iter().enumerate() {
        let at = [
            place % fine.counts[0],
            place / fine.counts[0] % fine.counts[1],
            place / (fine.counts[0] * fine.counts[1]),
        ];
        parts[layer.place(at.map(|c| c / 2))].push(*cell);
    }
    Layer { cells: parts.iter().map(|parts| merged(parts)).collect(), ..layer }
}

/// Vortons as one.
fn merged(parts: &[Source]) -> Source {
    let mut sums = [0.0_f64; 8];
    for Source(q) in parts {
        let weight = f64::from(Vec3::new(q[3], q[4], q[5]).norm());
        for k in [0, 1, 2, 6] {
            sums[k] += weight * f64::from(q[k]);
        }
        for k in 3..6 {
            sums[k] += f64::from(q[k]);
        }
        sums[7] += weight;
    }
    let (mut out, weight) = ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], sums[7]);
    if weight > 0.0 {
        for k in 0..7 {
            out[k] = (if (3..6).contains(&k) { sums[k] } else { sums[k] / weight }) as f32;
        }
    }
    Source(out)
}

/// The sums at one point.
struct One<'a, K, const Q: usize> {
    x: Vec3,
    sources: &'a [Source],
    kernel: PhantomData<K>,
}

impl<K: Chain, const Q: usize> Pass for One<'_, K, Q> {
    type Out = [f32; SUMS];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f32; SUMS] {
        let x = pairs::columns::<L>(|_| self.x);
        let mut sums: Sums<L> = [splat(0.0); SUMS];
        pairs::add_pairs::<L, K, Q>(x, self.sources, &mut sums);
        let mut out = [0.0; SUMS];
        for k in 0..SUMS {
            out[k] = sums[k].row()[0];
        }
        out
    }
}
