//! The choice of a grid for a set of vortons.
//!
//! *Method*: the grid represents cores of one size S, and its spacing is S over a ratio that follows from the
//! error. Where all vortons have one core that the grid can represent, S is that core. Otherwise S minimises
//! the cost of nodes and pairs together (`near_correction.rs`). The box contains the vortons except strays,
//! which are far from nearly all others. Its margin has space for the stencils of differences and deposit,
//! and for the vorticity of the cores.

use super::{differences::STENCIL_REACH, fourier, transforms::GridKernel, uniform::UniformGrid};
use crate::math::elementary::{cbrt, ln, powf};
use crate::{
    math::Vec3,
    par,
    sim::vortex::{ERRORS, Vortons, quantities::GRADIENT},
};

/// Nodes of a grid at most: about 1.2 GB for velocities, and twice that with gradients.
pub(in crate::sim::vortex) const MAX_NODES: usize = 1 << 25;

/// The cost of a node that the choice of a grid assumes [ns]. Known to a factor of two, which is enough: the
/// cost is flat around the minimum.
const NODE_NANOSECONDS: f64 = 50.0;

/// Positions that are sampled to find the bulk of a cloud.
const MAX_BULK_SAMPLES: usize = 4096;

/// The settings of a grid that follow from the error.
#[derive(Clone, Copy, Debug)]
pub(super) struct GridSettings {
    /// The error that the settings are for.
    pub(super) error: f32,
    /// S over the spacing.
    pub(super) core_in_spacings: f32,
    /// The margin from the vortons to the boundary, over S.
    pub(super) margin: f32,
    /// The error of the near correction.
    pub(super) near_error: f32,
    /// The error of the tree on the boundary.
    pub(super) boundary_error: f32,
    /// Cells between the samples of the tree on the boundary.
    pub(super) boundary_step: usize,
}

impl GridSettings {
    /// The settings of a kernel for a `requested` error of [`grid_errors`](super::grid_errors), and for the
    /// `error` that [`eased`](crate::sim::vortex::coherence::eased) makes of it.
    pub(super) fn new<K: GridKernel>(requested: f32, error: f32) -> Self {
        let core_in_spacings = interpolated(K::CORE_IN_SPACINGS, error);
        // Boundary values of five times the error, and a cubic through nodes four cells apart, add less than
        // a tenth of it.
        let boundary_error = (5.0 * error).min(*ERRORS.end());
        // The omitted pairs have one sign, and add up as the whole velocity does.
        let near_error = requested / 3.0;
        Self { error, core_in_spacings, margin: K::MARGIN, near_error, boundary_error, boundary_step: 4 }
    }
}

/// The entry of a table at an error, interpolated over the logarithm of the error.
fn interpolated(table: &[[f32; 2]], error: f32) -> f32 {
    let next = table.partition_point(|row| row[0] > error).clamp(1, table.len() - 1);
    let ([high, coarse], [low, fine]) = (table[next - 1], table[next]);
    coarse + (fine - coarse) * (ln(high / error) / ln(high / low))
}

/// A grid for a set of vortons.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) grid: UniformGrid,
    /// S: the core that the grid represents [m].
    pub(super) grid_core: f32,
    /// Whether pairs have to add the difference of cores.
    pub(super) needs_correction: bool,
    /// The vortons inside the box.
    pub(super) bulk: Vortons,
    /// The vortons outside the box.
    pub(super) strays: Vortons,
}

/// Cells from the boundary within which no point is interpolated: splines reach two nodes, and each
/// difference three.
pub(super) fn margin(quantity: usize) -> usize {
    1 + STENCIL_REACH * quantity.min(GRADIENT)
}

impl Plan {
    /// The cheapest grid, if one costs less than all pairs of vortons and `targets`.
    pub(super) fn new<K: GridKernel>(
        vortons: &Vortons,
        targets: usize,
        quantity: usize,
        settings: &GridSettings,
    ) -> Option<Self> {
        let (bulk, strays) = split_strays(vortons);
        let (low, high) = bounds(&bulk.position);
        let (min_core, max_core) =
            bulk.core.iter().fold((f32::INFINITY, 0.0_f32), |(a, b), &s| (a.min(s), b.max(s)));
        let even = K::IS_SMOOTH && min_core == max_core;
        let mean = mean_core(&bulk);
        let density = Density::new(&bulk.position, low, high);
        let all_pairs = vortons.len() as f64 * targets as f64;
        let (mut best, mut cheapest) = (None, 0.5 * K::PAIR_NANOSECONDS * all_pairs);
        for k in 0..20 {
            let grid_core = if even { min_core } else { 0.4 * mean } * powf(2.0_f32, k as f32 / 3.0);
            let grid = grid_around(low, high, grid_core, quantity, settings);
            let Some(grid) = grid else { continue };
            let needs_correction = !(even && grid_core == min_core);
            let reach = if needs_correction { K::reach(mean, grid_core, settings.near_error) } else { 0.0 };
            let cost = NODE_NANOSECONDS * grid.nodes() as f64
                + K::PAIR_NANOSECONDS * density.pairs(reach) * targets as f64;
            if cost < cheapest {
                cheapest = cost;
                best = Some((grid, grid_core, needs_correction));
            }
        }
        best.map(|(grid, grid_core, needs_correction)| Self {
            grid,
            grid_core,
            needs_correction,
            bulk,
            strays,
        })
    }
}

/// A grid around a box. `None` if it would be too large, or if the spacing is below the precision of
/// coordinates.
fn grid_around(
    low: Vec3,
    high: Vec3,
    grid_core: f32,
    quantity: usize,
    settings: &GridSettings,
) -> Option<UniformGrid> {
    let spacing = grid_core / settings.core_in_spacings;
    let margin = (settings.margin * settings.core_in_spacings).ceil().max(margin(quantity) as f32 + 1.0);
    let mut cells = [0; 3];
    for k in 0..3 {
        let wanted = (high[k] - low[k]) / spacing + 2.0 * margin;
        if wanted > MAX_NODES as f32 {
            return None;
        }
        // The smallest number of cells that sine transforms support.
        let supported = (wanted.ceil() as usize..).find(|&n| fourier::is_supported(n));
        cells[k] = supported.expect("powers of two are supported");
    }
    let half = Vec3::from_fn(|k, _| cells[k] as f32) * (0.5 * spacing);
    let grid = UniformGrid { low: (low + high) * 0.5 - half, spacing, cells };
    let coarse = low.amax().max(high.amax()) * f32::EPSILON > 0.01 * spacing;
    (!coarse && grid.nodes() <= MAX_NODES).then_some(grid)
}

/// The vortons of the bulk, and the strays: those farther from the middle 96 % of coordinates than the
/// largest extent of these.
fn split_strays(vortons: &Vortons) -> (Vortons, Vortons) {
    let points = &vortons.position;
    let samples = points.len().min(MAX_BULK_SAMPLES);
    let [low, high] = [0.02, 0.98].map(|quantile| {
        Vec3::from_fn(|k, _| {
            let mut sampled: Vec<f32> = (0..samples).map(|i| points[i * points.len() / samples][k]).collect();
            let at = (quantile * samples as f64) as usize;
            if sampled.is_empty() { 0.0 } else { *sampled.select_nth_unstable_by(at, f32::total_cmp).1 }
        })
    });
    let grown = Vec3::repeat((high - low).amax());
    let (low, high) = (low - grown, high + grown);
    let is_bulk = |x: Vec3| (0..3).all(|k| x[k] >= low[k] && x[k] <= high[k]);
    let mut all =
        par::map_chunks(points.len(), par::CHUNK, |range| points[range].iter().all(|&x| is_bulk(x)))
            .into_iter();
    let (mut bulk, mut strays) = (Vortons::default(), Vortons::default());
    if all.all(|all| all) {
        return (vortons.clone(), strays);
    }
    for (i, &x) in points.iter().enumerate() {
        let set = if is_bulk(x) { &mut bulk } else { &mut strays };
        set.position.push(x);
        set.strength.push(vortons.strength[i]);
        set.core.push(vortons.core[i]);
    }
    (bulk, strays)
}

/// The box around points [m].
pub(in crate::sim::vortex) fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let none = (Vec3::repeat(f32::INFINITY), Vec3::repeat(f32::NEG_INFINITY));
    let chunks = par::map_chunks(points.len(), 1 << 14, |range| {
        points[range].iter().fold(none, |(low, high), x| (low.inf(x), high.sup(x)))
    });
    chunks.into_iter().fold(none, |(low, high), (l, h)| (low.inf(&l), high.sup(&h)))
}

/// The mean core, weighted by |Γ| [m].
pub(in crate::sim::vortex) fn mean_core(vortons: &Vortons) -> f32 {
    let weight = |i: usize| f64::from(vortons.strength[i].norm());
    let whole = par::sum(vortons.len(), weight);
    let mean = par::sum(vortons.len(), |i| weight(i) * f64::from(vortons.core[i])) / whole;
    if whole > 0.0 { mean as f32 } else { vortons.core.iter().copied().fold(0.0, f32::max) }
}

/// The density of vortons around a vorton.
struct Density {
    /// The mean number of vortons in the cell of a vorton.
    in_own_cell: f64,
    /// The edge of cells [m].
    edge: f64,
}

impl Density {
    /// Counts in up to 32 cells along each axis.
    fn new(points: &[Vec3], low: Vec3, high: Vec3) -> Self {
        const CELLS: usize = 32;
        let edge = ((high - low).max() / CELLS as f32).max(1e-12);
        let counted = par::map_chunks(points.len(), 1 << 15, |range| {
            let mut counts = vec![0_u32; CELLS * CELLS * CELLS];
            for x in &points[range] {
                let at: [usize; 3] =
                    std::array::from_fn(|k| (((x[k] - low[k]) / edge) as usize).min(CELLS - 1));
                counts[at[0] + CELLS * (at[1] + CELLS * at[2])] += 1;
            }
            counts
        });
        let count = |cell: usize| counted.iter().map(|counts| f64::from(counts[cell])).sum::<f64>();
        let squares: f64 = (0..CELLS * CELLS * CELLS).map(|cell| count(cell).powi(2)).sum();
        Self { in_own_cell: squares / points.len().max(1) as f64, edge: f64::from(edge) }
    }

    /// Vortons that a leaf of targets sums if the near correction reaches this far [m].
    fn pairs(&self, reach: f32) -> f64 {
        if reach == 0.0 {
            return 0.0;
        }
        // Leaves of targets and of vortons have about thirty points each.
        let leaf = self.edge * cbrt(30.0 / self.in_own_cell);
        self.in_own_cell
            * (4.2 * (f64::from(reach) + 0.6 * leaf).powi(3) / self.edge.powi(3)).max(30.0 / self.in_own_cell)
    }
}
