//! Which lattice serves a set of vortons.
//!
//! *Method*: the lattice carries cores of one size S, and its spacing is that over a ratio that the error asks for. Where all vortons
//! have a core that the lattice can carry, S is that core; else it is what makes nodes and pairs together cost least
//! (`near.rs`). The box holds the vortons, but for those that are far from nearly all others, with room around them for
//! differences, shares, and what a kernel spreads beyond its core.

use super::{fourier, lattice::Lattice, slopes::REACH, spread::Spread};
use crate::{
    math::Vec3,
    par,
    sim::vortex::{ERRORS, GRADIENT, Vortons},
};

/// Nodes of a lattice at most: about 1.2 GB while velocities are found, and twice that with gradients.
const LARGEST: usize = 1 << 25;

/// Nanoseconds of a node, as the choice of a lattice weighs them. Known to a factor of two, which is enough: around the cheapest
/// lattice the cost is flat.
const NODE: f64 = 50.0;

/// Of how many coordinates the bulk of a cloud is told.
const SAMPLES: usize = 4096;

/// What an error asks of the lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    /// The error that it is for.
    pub(super) error: f32,
    /// S over the spacing.
    pub(super) ratio: f32,
    /// Cells from the vortons to the boundary, over that ratio.
    pub(super) room: f32,
    /// The error of what pairs add.
    pub(super) near: f32,
    /// The error of the tree on the boundary, and cells between its nodes there.
    pub(super) boundary: f32,
    pub(super) step: usize,
}

impl Setting {
    /// Of a kernel, for an error of [`grid_errors`](super::grid_errors), and vortons that
    /// [`eased`](crate::sim::vortex::coherence::eased) it.
    pub(super) fn new<K: Spread>(asked: f32, error: f32) -> Self {
        let ratio = between(K::RATIOS, error);
        // Boundary values of five times the error, and a cubic through nodes four cells apart, add less than a tenth of it.
        let boundary = (5.0 * error).min(*ERRORS.end());
        // What pairs leave out has one sign, and adds up as the whole does.
        Self { error, ratio, room: K::ROOM, near: asked / 3.0, boundary, step: 4 }
    }
}

/// A ratio between those of two errors, by the error's logarithm.
fn between(table: &[[f32; 2]], error: f32) -> f32 {
    let next = table.partition_point(|row| row[0] > error).clamp(1, table.len() - 1);
    let ([high, coarse], [low, fine]) = (table[next - 1], table[next]);
    coarse + (fine - coarse) * ((high / error).ln() / (high / low).ln())
}

/// A lattice for a set of vortons.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) lattice: Lattice,
    /// S: the cores it carries [m].
    pub(super) smooth: f32,
    /// Whether pairs have to add what cores differ.
    pub(super) near: bool,
    /// The vortons it holds, and those it does not.
    pub(super) inner: Vortons,
    pub(super) outer: Vortons,
}

/// Cells from the boundary at which numbers are gathered: M₄′ reaches two nodes, and each difference three.
pub(super) fn margin(quantity: usize) -> usize {
    1 + REACH * quantity.min(GRADIENT)
}

impl Plan {
    /// The cheapest lattice, if there is one that costs less than all pairs of vortons and `targets`.
    pub(super) fn new<K: Spread>(
        vortons: &Vortons,
        targets: usize,
        quantity: usize,
        setting: &Setting,
    ) -> Option<Self> {
        let (inner, outer) = parts(vortons);
        let (low, high) = bounds(&inner.position);
        let (least, most) =
            inner.core.iter().fold((f32::INFINITY, 0.0_f32), |(a, b), &s| (a.min(s), b.max(s)));
        let even = K::ITSELF && least == most;
        let mean = mean_core(&inner);
        let density = Density::new(&inner.position, low, high);
        let (mut best, mut cheapest) = (None, 0.5 * K::PAIR * vortons.len() as f64 * targets as f64);
        for k in 0..20 {
            let smooth = if even { least } else { 0.4 * mean } * 2.0_f32.powf(k as f32 / 3.0);
            let lattice = lattice(low, high, smooth, quantity, setting);
            let Some(lattice) = lattice else { continue };
            let near = !(even && smooth == least);
            let reach = if near { K::reach(mean, smooth, setting.near) } else { 0.0 };
            let cost = NODE * lattice.nodes() as f64 + K::PAIR * density.pairs(reach) * targets as f64;
            if cost < cheapest {
                cheapest = cost;
                best = Some((lattice, smooth, near));
            }
        }
        best.map(|(lattice, smooth, near)| Self { lattice, smooth, near, inner, outer })
    }
}

/// A lattice around a box, unless it would be too large. `None` too if coordinates cannot tell its nodes apart.
fn lattice(low: Vec3, high: Vec3, smooth: f32, quantity: usize, setting: &Setting) -> Option<Lattice> {
    let spacing = smooth / setting.ratio;
    let room = (setting.room * setting.ratio).ceil().max(margin(quantity) as f32 + 1.0);
    let mut cells = [0; 3];
    for k in 0..3 {
        let wanted = (high[k] - low[k]) / spacing + 2.0 * room;
        if wanted > LARGEST as f32 {
            return None;
        }
        // The smallest number that sines can be taken of.
        cells[k] = (wanted.ceil() as usize..).find(|&n| fourier::serves(n)).expect("powers of two are");
    }
    let half = Vec3::from_fn(|k, _| cells[k] as f32) * (0.5 * spacing);
    let lattice = Lattice { low: (low + high) * 0.5 - half, spacing, cells };
    let coarse = low.amax().max(high.amax()) * f32::EPSILON > 0.01 * spacing;
    (!coarse && lattice.nodes() <= LARGEST).then_some(lattice)
}

/// The vortons of the bulk, and those far from it: beyond the middle 96 % of coordinates by more than the largest extent of
/// these.
fn parts(vortons: &Vortons) -> (Vortons, Vortons) {
    let points = &vortons.position;
    let samples = points.len().min(SAMPLES);
    let [low, high] = [0.02, 0.98].map(|part| {
        Vec3::from_fn(|k, _| {
            let mut sampled: Vec<f32> = (0..samples).map(|i| points[i * points.len() / samples][k]).collect();
            let at = (part * samples as f64) as usize;
            if sampled.is_empty() { 0.0 } else { *sampled.select_nth_unstable_by(at, f32::total_cmp).1 }
        })
    });
    let grown = Vec3::repeat((high - low).amax());
    let (low, high) = (low - grown, high + grown);
    let is_inner = |x: Vec3| (0..3).all(|k| x[k] >= low[k] && x[k] <= high[k]);
    let mut all = par::map_chunks(points.len(), par::CHUNK, |part| points[part].iter().all(|&x| is_inner(x)))
        .into_iter();
    let (mut inner, mut outer) = (Vortons::default(), Vortons::default());
    if all.all(|all| all) {
        return (vortons.clone(), outer);
    }
    for (i, &x) in points.iter().enumerate() {
        let part = if is_inner(x) { &mut inner } else { &mut outer };
        part.position.push(x);
        part.strength.push(vortons.strength[i]);
        part.core.push(vortons.core[i]);
    }
    (inner, outer)
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let none = (Vec3::repeat(f32::INFINITY), Vec3::repeat(f32::NEG_INFINITY));
    let parts = par::map_chunks(points.len(), 1 << 14, |part| {
        points[part].iter().fold(none, |(low, high), x| (low.inf(x), high.sup(x)))
    });
    parts.into_iter().fold(none, |(low, high), (l, h)| (low.inf(&l), high.sup(&h)))
}

/// The mean core by |Γ| [m].
fn mean_core(vortons: &Vortons) -> f32 {
    let weight = |i: usize| f64::from(vortons.strength[i].norm());
    let whole = par::sum(vortons.len(), weight);
    let mean = par::sum(vortons.len(), |i| weight(i) * f64::from(vortons.core[i])) / whole;
    if whole > 0.0 { mean as f32 } else { vortons.core.iter().copied().fold(0.0, f32::max) }
}

/// How many others a vorton has around it.
struct Density {
    /// The mean number of vortons in the cell that a vorton is in, and that cell's edge [m].
    beside: f64,
    edge: f64,
}

impl Density {
    /// Counted in up to 32 cells an axis.
    fn new(points: &[Vec3], low: Vec3, high: Vec3) -> Self {
        const CELLS: usize = 32;
        let edge = ((high - low).max() / CELLS as f32).max(1e-12);
        let counted = par::map_chunks(points.len(), 1 << 15, |part| {
            let mut counts = vec![0_u32; CELLS * CELLS * CELLS];
            for x in &points[part] {
                let at: [usize; 3] =
                    std::array::from_fn(|k| (((x[k] - low[k]) / edge) as usize).min(CELLS - 1));
                counts[at[0] + CELLS * (at[1] + CELLS * at[2])] += 1;
            }
            counts
        });
        let count = |cell: usize| counted.iter().map(|counts| f64::from(counts[cell])).sum::<f64>();
        let squares: f64 = (0..CELLS * CELLS * CELLS).map(|cell| count(cell).powi(2)).sum();
        Self { beside: squares / points.len().max(1) as f64, edge: f64::from(edge) }
    }

    /// Vortons that a leaf of targets sums, if differences reach this far [m].
    fn pairs(&self, reach: f32) -> f64 {
        if reach == 0.0 {
            return 0.0;
        }
        // Leaves of about thirty at both ends.
        let leaf = self.edge * (30.0 / self.beside).cbrt();
        self.beside
            * (4.2 * (f64::from(reach) + 0.6 * leaf).powi(3) / self.edge.powi(3)).max(30.0 / self.beside)
    }
}
