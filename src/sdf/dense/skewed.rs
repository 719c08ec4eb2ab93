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

use crate::{
    sdf::godunov::update_lanes,
    simd::{self, F32x8, LANES, Lanes, Pass},
};

/// A block, mirrored and skewed.
pub(super) struct Skewed {
    /// Nodes along each axis.
    size: [usize; 3],
    /// Groups of eight rows, the last perhaps partly empty.
    groups: usize,
    /// Vectors per group of rows.
    steps: usize,
    /// The vectors of layer z + 1 and of its groups, one after the other; an empty layer makes their number
    /// even.
    cells: Vec<F32x8>,
    /// For each layer the rows before the first and after the last, which lane 0 and lane 7 read.
    low: Vec<f32>,
    high: Vec<f32>,
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
    /// Skews a block of `size` for a sweep in `order`; `around` are the distances and sizes of the blocks
    /// beyond its six faces.
    pub(super) fn gather(
        own: &[f32],
        size: [usize; 3],
        order: [i32; 3],
        around: [Option<(&[f32], [usize; 3])>; 6],
    ) -> Self {
        let [sx, sy, sz] = size;
        let (groups, steps) = (sy.div_ceil(LANES), sx + SKEW_STEPS);
        let layers = sz.next_multiple_of(2);
        let mut skewed = Self {
            size,
            groups,
            steps,
            cells: vec![[f32::NEG_INFINITY; LANES]; (layers + 2) * groups * steps],
            low: vec![f32::INFINITY; layers * steps],
            high: vec![f32::INFINITY; layers * steps],
        };
        let mirrored = |axis: usize, i: usize| if order[axis] > 0 { i } else { size[axis] - 1 - i };

        // The block's own rows keep their signs.
        for z in 0..sz {
            for y in 0..sy {
                let row = &own[sx * (mirrored(1, y) + sy * mirrored(2, z))..][..sx];
                let at = skewed.place(z + 1, y);
                let cells = &mut skewed.cells.as_flattened_mut()[at..][..LANES * (sx - 1) + 1];
                if order[0] > 0 {
                    cells.iter_mut().step_by(LANES).zip(row).for_each(|(to, from)| *to = *from);
                } else {
                    cells.iter_mut().step_by(LANES).zip(row.iter().rev()).for_each(|(to, from)| *to = *from);
                }
            }
        }

        // The facing layers of the neighbours.
        for axis in 0..3 {
            for behind in [false, true] {
                let face = 2 * axis + usize::from(behind == (order[axis] > 0));
                let Some((other, other_size)) = around[face] else { continue };
                // The neighbour's layer that faces this block.
                let layer = if face % 2 == 0 { other_size[axis] - 1 } else { 0 };
                let [ox, oy, _] = other_size;
                let magnitude = |x: usize, y: usize, z: usize| other[x + ox * (y + oy * z)].abs();
                match axis {
                    0 => {
                        for z in 0..sz {
                            for y in 0..sy {
                                let at = skewed.place(z + 1, y);
                                let at = if behind { at + LANES * sx } else { at - LANES };
                                skewed.cells.as_flattened_mut()[at] =
                                    -magnitude(layer, mirrored(1, y), mirrored(2, z));
                            }
                        }
                    }
                    1 => {
                        for z in 0..sz {
                            for x in 0..sx {
                                let value = magnitude(mirrored(0, x), layer, mirrored(2, z));
                                if !behind {
                                    skewed.low[z * steps + x + 1] = value;
                                } else if sy.is_multiple_of(LANES) {
                                    skewed.high[z * steps + x + LANES] = value;
                                } else {
                                    let at = skewed.place(z + 1, sy) + LANES * x;
                                    skewed.cells.as_flattened_mut()[at] = -value;
                                }
                            }
                        }
                    }
                    _ => {
                        for y in 0..sy {
                            let at = skewed.place(if behind { sz + 1 } else { 0 }, y);
                            for x in 0..sx {
                                skewed.cells.as_flattened_mut()[at + LANES * x] =
                                    -magnitude(mirrored(0, x), mirrored(1, y), layer);
                            }
                        }
                    }
                }
            }
        }
        skewed
    }

    /// Writes the distances to where [`Skewed::gather`] read them; returns which faces' layers changed.
    pub(super) fn scatter(&self, own: &mut [f32], order: [i32; 3]) -> [bool; 6] {
        let [sx, sy, sz] = self.size;
        let mirrored = |axis: usize, i: usize| if order[axis] > 0 { i } else { self.size[axis] - 1 - i };
        let mut faces = [false; 6];
        for z in 0..sz {
            for y in 0..sy {
                let (to_y, to_z) = (mirrored(1, y), mirrored(2, z));
                let row = &mut own[sx * (to_y + sy * to_z)..][..sx];
                let cells = &self.cells.as_flattened()[self.place(z + 1, y)..][..LANES * (sx - 1) + 1];
                let ends = [row[0], row[sx - 1]];
                let mut changed = false;
                let mut put = |to: &mut f32, from: f32| {
                    changed |= *to != from;
                    *to = from;
                };
                if order[0] > 0 {
                    row.iter_mut().zip(cells.iter().step_by(LANES)).for_each(|(to, from)| put(to, *from));
                } else {
                    row.iter_mut()
                        .rev()
                        .zip(cells.iter().step_by(LANES))
                        .for_each(|(to, from)| put(to, *from));
                }
                if changed {
                    faces[0] |= row[0] != ends[0];
                    faces[1] |= row[sx - 1] != ends[1];
                    faces[2] |= to_y == 0;
                    faces[3] |= to_y == sy - 1;
                    faces[4] |= to_z == 0;
                    faces[5] |= to_z == sz - 1;
                }
            }
        }
        faces
    }

    /// The index among all distances of the first node of row `y` in `layer`, which is z + 1.
    #[inline]
    fn place(&self, layer: usize, y: usize) -> usize {
        let lane = y % LANES;
        ((layer * self.groups + y / LANES) * self.steps + 1 + lane) * LANES + lane
    }

    /// Lowers the free distances by one ascending pass; returns whether any changed.
    pub(super) fn relax(&mut self, band: f32) -> bool {
        self.for_each_group(|rows| simd::dispatch(Relax { rows, band }))
    }

    /// Calls `f` for all groups of rows in ascending order, two layers at a time; returns whether any call
    /// returned true.
    #[inline(always)]
    fn for_each_group(&mut self, mut f: impl FnMut(Rows<'_>) -> bool) -> bool {
        let Self { size: [sx, _, sz], groups, steps, ref mut cells, ref low, ref high } = *self;
        let layer = groups * steps;
        let mut low_rows = [vec![f32::INFINITY; steps], vec![f32::INFINITY; steps]];
        let mut high_rows = low_rows.clone();
        let mut changed = false;
        for z in (0..sz).step_by(2) {
            for group in 0..groups {
                let start = ((z + 1) * groups + group) * steps;
                // The neighbouring rows belong to the neighbouring groups.
                for (above, (low_row, high_row)) in low_rows.iter_mut().zip(&mut high_rows).enumerate() {
                    let (z, start) = (z + above, start + above * layer);
                    if group == 0 {
                        low_row.copy_from_slice(&low[z * steps..(z + 1) * steps]);
                    } else {
                        for x in 0..sx {
                            low_row[x + 1] = cells[start - steps + x + LANES][LANES - 1].abs();
                        }
                    }
                    if group + 1 == groups {
                        high_row.copy_from_slice(&high[z * steps..(z + 1) * steps]);
                    } else {
                        for x in 0..sx {
                            high_row[x + LANES] = cells[start + steps + x + 1][0].abs();
                        }
                    }
                }
                let (head, rest) = cells.split_at_mut(start);
                let (lower, rest) = rest.split_at_mut(layer);
                let (upper, behind) = rest.split_at_mut(layer);
                changed |= f(Rows {
                    before: &head[start - layer..][..steps],
                    own: [&mut lower[..steps], &mut upper[..steps]],
                    behind: &behind[..steps],
                    low: [&low_rows[0], &low_rows[1]],
                    high: [&high_rows[0], &high_rows[1]],
                });
            }
        }
        changed
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
