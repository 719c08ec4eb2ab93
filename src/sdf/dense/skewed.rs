//! One block in a skewed layout that lets a sweep advance eight rows together, one vector at a time.
//!
//! *Method*: a node of a Gauss–Seidel sweep reads new distances before it and old ones after it along every
//! axis. If row j runs j steps behind row 0, the nodes of eight rows at one step do not read each other:
//! their predecessors in x and y belong to the previous step, their successors to the next one. So eight rows
//! are stored skewed, node x of row j at step x + 1 + j in lane j, and a step is one vector. This changes the
//! time at which a node is visited, not what it reads: the bits are those of the sequential sweep.
//!
//! A step depends on the one before it. So two layers advance together, the upper one a step behind the
//! lower: their steps are independent, and the processor works on both.
//!
//! The block is mirrored so that every sweep ascends. Nodes that must not change hold negative numbers, whose
//! magnitude neighbours read: pinned nodes, the facing layers of the neighbouring blocks, and −∞ where there
//! is none.

use super::lines::Lines;
use crate::{
    sdf::godunov::update_lanes,
    simd::{self, F32x8, LANES, Lanes, Pass},
};

/// The distances of a block.
pub(super) struct BlockValues {
    /// All nodes, x fastest.
    pub(super) nodes: Vec<f32>,
    /// The first and the last node of each row. The neighbours along x read these: in `nodes` each of them is in a cache line
    /// of its own.
    pub(super) ends: Vec<[f32; 2]>,
}

impl BlockValues {
    /// Nodes in rows of `row`.
    pub(super) fn new(nodes: Vec<f32>, row: usize) -> Self {
        let ends = nodes.chunks_exact(row).map(|row| [row[0], row[row.len() - 1]]).collect();
        Self { nodes, ends }
    }
}

/// What a pass over a block reads.
pub(super) struct Source<'a> {
    pub(super) own: &'a BlockValues,
    /// The direction of the sweep along each axis.
    pub(super) order: [i32; 3],
    /// The blocks beyond the six faces, and their sizes.
    pub(super) around: [Option<(&'a BlockValues, [usize; 3])>; 6],
}

impl<'a> Source<'a> {
    /// The neighbour before or behind this block along an axis, its size, and its layer that faces this block.
    fn facing(&self, axis: usize, behind: bool) -> Option<(&'a BlockValues, [usize; 3], usize)> {
        let face = 2 * axis + usize::from(behind == (self.order[axis] > 0));
        let (other, size) = self.around[face]?;
        Some((other, size, if face.is_multiple_of(2) { size[axis] - 1 } else { 0 }))
    }
}

/// A block, mirrored and skewed. Its unit is a group of eight rows in two layers: only units that could change are copied and
/// passed over.
pub(super) struct Skewed {
    /// Nodes along each axis.
    size: [usize; 3],
    order: [i32; 3],
    /// Groups of eight rows, the last perhaps partly empty.
    groups: usize,
    /// Vectors per group of rows.
    steps: usize,
    /// The vectors of layer z + 1 and of its groups, one after the other; an empty layer makes their number
    /// even.
    cells: Vec<F32x8>,
    /// Whether a unit is in `cells`; first and last the facing layers of the neighbours along z.
    gathered: Vec<bool>,
    /// Whether a pass over the unit could change it.
    due: Vec<bool>,
    changed: Vec<bool>,
    lines: Lines,
    /// In both layers of a unit the rows before the first and after the last, as lane 0 and lane 7 read them at each step.
    low: [Vec<f32>; 2],
    high: [Vec<f32>; 2],
}

/// The vectors that one group of rows, in two layers, reads and writes.
struct Rows<'a> {
    /// The layer before the two.
    before: &'a [F32x8],
    own: [&'a mut [F32x8]; 2],
    /// The layer after the two.
    behind: &'a [F32x8],
    /// The row before the first of each layer, as lane 0 reads it at each step.
    low: [&'a [f32]; 2],
    /// The row after the last of each layer, as lane 7 reads it at each step.
    high: [&'a [f32]; 2],
}

/// Vectors of a group of rows beyond the number of nodes of a row.
const SKEW_STEPS: usize = LANES + 1;

impl Skewed {
    /// A block of `size` for a sweep in `order`; `due(y, z)` is whether a pass over that row could change it.
    pub(super) fn new(size: [usize; 3], order: [i32; 3], due: impl Fn(usize, usize) -> bool) -> Self {
        let [sx, sy, sz] = size;
        let (groups, pairs, steps) = (sy.div_ceil(LANES), sz.div_ceil(2), sx + SKEW_STEPS);
        let mut skewed = Self {
            size,
            order,
            groups,
            steps,
            cells: vec![[f32::NEG_INFINITY; LANES]; 2 * (pairs + 1) * groups * steps],
            gathered: vec![false; (pairs + 2) * groups],
            due: vec![false; pairs * groups],
            changed: vec![false; pairs * groups],
            lines: Lines::new(sx),
            low: [vec![f32::INFINITY; steps], vec![f32::INFINITY; steps]],
            high: [vec![f32::INFINITY; steps], vec![f32::INFINITY; steps]],
        };
        for z in 0..sz {
            for y in 0..sy {
                if due(y, z) {
                    let unit = skewed.unit(y, z);
                    skewed.due[unit] = true;
                }
            }
        }
        skewed
    }

    fn mirrored(&self, axis: usize, i: usize) -> usize {
        if self.order[axis] > 0 { i } else { self.size[axis] - 1 - i }
    }

    /// The unit that holds a row of the block.
    fn unit(&self, y: usize, z: usize) -> usize {
        self.mirrored(2, z) / 2 * self.groups + self.mirrored(1, y) / LANES
    }

    /// Whether another pass could change a row of the block.
    pub(super) fn is_due(&self, y: usize, z: usize) -> bool {
        self.due[self.unit(y, z)]
    }

    /// The first vector of a group in `layer`, which is z + 1.
    fn start(&self, layer: usize, group: usize) -> usize {
        (layer * self.groups + group) * self.steps
    }

    /// Lowers the free distances by one ascending pass over the units that are due; returns whether any changed.
    pub(super) fn relax(&mut self, source: &Source<'_>, band: f32) -> bool {
        let (groups, pairs) = (self.groups, self.size[2].div_ceil(2));
        let mut any = false;
        for pair in 0..pairs {
            for group in 0..groups {
                let unit = pair * groups + group;
                if !self.due[unit] {
                    continue;
                }
                // The unit and the four that it reads; those along z are before and behind it in `gathered`.
                for place in [unit, unit + groups, unit + 2 * groups] {
                    self.gather(source, place);
                }
                if group > 0 {
                    self.gather(source, unit + groups - 1);
                }
                if group + 1 < groups {
                    self.gather(source, unit + groups + 1);
                }
                self.fill_sides(source, pair, group);
                self.due[unit] = simd::dispatch(Relax { rows: self.rows(pair, group), band });
                if !self.due[unit] {
                    continue;
                }
                // Units that read this one: later ones are passed over in this pass, earlier ones in the next.
                (any, self.changed[unit]) = (true, true);
                let adjacent = [
                    (pair > 0).then(|| unit - groups),
                    (pair + 1 < pairs).then_some(unit + groups),
                    (group > 0).then(|| unit - 1),
                    (group + 1 < groups).then_some(unit + 1),
                ];
                adjacent.into_iter().flatten().for_each(|other| self.due[other] = true);
            }
        }
        any
    }

    /// Copies what is at a place of `gathered` to `cells`, unless it is there.
    fn gather(&mut self, source: &Source<'_>, place: usize) {
        if std::mem::replace(&mut self.gathered[place], true) {
            return;
        }
        let [sx, sy, sz] = self.size;
        let (pair, group) = (place / self.groups, place % self.groups);
        let ys = group * LANES..sy.min((group + 1) * LANES);
        let (direction, steps) = (self.order[0], self.steps);
        let y_of = |y: usize| if self.order[1] > 0 { y } else { sy - 1 - y };
        if pair == 0 || pair > sz.div_ceil(2) {
            let Some((other, [ox, oy, _], layer)) = source.facing(2, pair > 0) else { return };
            let row = |y: usize| (&other.nodes[ox * (y_of(y) + oy * layer)..][..sx], [f32::INFINITY; 2]);
            self.lines.fill(ys, direction, row);
            self.lines.pin();
            let start = self.start(if pair == 0 { 0 } else { sz + 1 }, group);
            self.lines.skew(&mut self.cells[start..start + steps]);
            return;
        }
        // Own rows keep their signs; the nodes before and behind them belong to the neighbours along x.
        let beyond = [false, true].map(|behind| source.facing(0, behind));
        for z in 2 * (pair - 1)..sz.min(2 * pair) {
            let to_z = self.mirrored(2, z);
            self.lines.fill(ys.clone(), direction, |y| {
                let row = y_of(y) + sy * to_z;
                let ends = beyond.map(|other| {
                    other.map_or(f32::INFINITY, |(other, _, layer)| {
                        other.ends[row][usize::from(layer > 0)].abs()
                    })
                });
                (&source.own.nodes[sx * row..][..sx], ends)
            });
            let start = self.start(z + 1, group);
            self.lines.skew(&mut self.cells[start..start + steps]);
            // The row after the last, where it is not beyond lane 7.
            if ys.end == sy
                && !sy.is_multiple_of(LANES)
                && let Some((other, [ox, oy, _], layer)) = source.facing(1, true)
            {
                let (row, lane) = (&other.nodes[ox * (layer + oy * to_z)..][..sx], sy % LANES);
                for x in 0..sx {
                    let value = row[self.mirrored(0, x)].abs();
                    self.cells[start + 1 + lane + x][lane] = -value;
                }
            }
        }
    }

    /// Fills the rows next to a unit, `low` and `high`.
    fn fill_sides(&mut self, source: &Source<'_>, pair: usize, group: usize) {
        let [sx, sy, sz] = self.size;
        for above in 0..2 {
            let z = 2 * pair + above;
            let start = self.start(z + 1, group);
            let facing = |behind: bool| {
                let (other, [ox, oy, _], layer) = source.facing(1, behind).filter(|_| z < sz)?;
                Some(&other.nodes[ox * (layer + oy * self.mirrored(2, z))..][..sx])
            };
            let low = (group == 0).then(|| facing(false));
            let high = (group + 1 == self.groups).then(|| facing(true).filter(|_| sy.is_multiple_of(LANES)));
            let to = &mut self.low[above][1..=sx];
            match low {
                Some(row) => copy_magnitudes(to, row, self.order[0]),
                None => {
                    let cells = &self.cells[start - self.steps + LANES..][..sx];
                    to.iter_mut().zip(cells).for_each(|(to, cell)| *to = cell[LANES - 1].abs());
                }
            }
            let to = &mut self.high[above][LANES..LANES + sx];
            match high {
                Some(row) => copy_magnitudes(to, row, self.order[0]),
                None => {
                    let cells = &self.cells[start + self.steps + 1..][..sx];
                    to.iter_mut().zip(cells).for_each(|(to, cell)| *to = cell[0].abs());
                }
            }
        }
    }

    /// What a pass over a unit reads and writes.
    fn rows(&mut self, pair: usize, group: usize) -> Rows<'_> {
        let (steps, layer) = (self.steps, self.groups * self.steps);
        let start = self.start(2 * pair + 1, group);
        let (head, rest) = self.cells.split_at_mut(start);
        let (lower, rest) = rest.split_at_mut(layer);
        let (upper, behind) = rest.split_at_mut(layer);
        Rows {
            before: &head[start - layer..][..steps],
            own: [&mut lower[..steps], &mut upper[..steps]],
            behind: &behind[..steps],
            low: [&self.low[0], &self.low[1]],
            high: [&self.high[0], &self.high[1]],
        }
    }

    /// Writes the distances to where they were read; calls `changed(y, z, ends)` for every row that changed, and whether its
    /// first and its last node did.
    pub(super) fn scatter(
        &mut self,
        own: &mut BlockValues,
        mut changed: impl FnMut(usize, usize, [bool; 2]),
    ) {
        let [sx, sy, sz] = self.size;
        for z in 0..sz {
            for group in 0..self.groups {
                if !self.changed[z / 2 * self.groups + group] {
                    continue;
                }
                let start = self.start(z + 1, group);
                self.lines.unskew(&self.cells[start..start + self.steps]);
                for y in group * LANES..sy.min((group + 1) * LANES) {
                    let (to_y, to_z) = (self.mirrored(1, y), self.mirrored(2, z));
                    let at = to_y + sy * to_z;
                    let row = &mut own.nodes[sx * at..][..sx];
                    if self.lines.copy_to(row, y % LANES, self.order[0]) {
                        let ends = [row[0], row[sx - 1]];
                        changed(to_y, to_z, [0, 1].map(|end| own.ends[at][end] != ends[end]));
                        own.ends[at] = ends;
                    }
                }
            }
        }
    }
}

/// Copies the magnitudes of a row, which descends if `direction` is negative; ∞ where there is none.
fn copy_magnitudes(to: &mut [f32], row: Option<&[f32]>, direction: i32) {
    match row {
        None => to.fill(f32::INFINITY),
        Some(row) if direction > 0 => to.iter_mut().zip(row).for_each(|(to, from)| *to = from.abs()),
        Some(row) => to.iter_mut().zip(row.iter().rev()).for_each(|(to, from)| *to = from.abs()),
    }
}

/// One ascending pass over a group of rows in two layers.
struct Relax<'a> {
    rows: Rows<'a>,
    band: f32,
}

impl Pass for Relax<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        let Self { rows: Rows { before, own: [lower, upper], behind, low, high }, band } = self;
        let steps = before.len();
        assert!([lower.len(), upper.len(), behind.len()] == [steps; 3], "layers are alike");
        assert!(low.iter().chain(&high).all(|row| row.len() == steps), "rows are alike");
        let mut changed = false;
        // Of each layer the magnitudes of the step before, and the step that is next.
        let mut previous = [L::load(&lower[0]).abs(), L::load(&upper[0]).abs()];
        let mut here = [L::load(&lower[1]), L::load(&upper[1])];
        for step in 1..steps {
            let mut new = here[0];
            if step + 1 < steps {
                let next = L::load(&lower[step + 1]);
                let z = L::load(&before[step]).abs().min(L::load(&upper[step]).abs());
                let nearest = nearest(previous[0], next.abs(), low[0][step], high[0][step], z);
                if let Some(lowered) = update_lanes(here[0], nearest, band) {
                    lower[step] = lowered.to_array();
                    (new, changed) = (lowered, true);
                }
                here[0] = next;
            }
            // The upper layer is a step behind: `previous` is what the lower one holds there.
            if step > 1 {
                let step = step - 1;
                let next = L::load(&upper[step + 1]);
                let z = previous[0].min(L::load(&behind[step]).abs());
                let nearest = nearest(previous[1], next.abs(), low[1][step], high[1][step], z);
                let mut new = here[1];
                if let Some(lowered) = update_lanes(here[1], nearest, band) {
                    upper[step] = lowered.to_array();
                    (new, changed) = (lowered, true);
                }
                previous[1] = new.abs();
                here[1] = next;
            }
            previous[0] = new.abs();
        }
        changed
    }
}

/// The smaller neighbour of each axis, of magnitudes: `low` and `high` are what the outer lanes read.
#[inline(always)]
fn nearest<L: Lanes>(previous: L, next: L, low: f32, high: f32, z: L) -> [L; 3] {
    [previous.min(next), previous.shifted_up(low).min(next.shifted_down(high)), z]
}
