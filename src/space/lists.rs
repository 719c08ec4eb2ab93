//! Neighbour lists.

use super::CellGrid;
use crate::{math::Vec3, par};

/// Particles a task lists at once.
const CHUNK: usize = 512;

/// Candidates tested at once: their distances vectorise, and the hits are then packed without a branch.
const BATCH: usize = 64;

/// Every particle's neighbours, as one list and offsets into it.
#[derive(Debug, Default)]
pub struct Neighbours {
    start: Vec<usize>,
    list: Vec<u32>,
}

/// The coordinates of particles in cell order, one array an axis.
struct Sorted {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Neighbours {
    /// Lists, for every particle, the others closer than `radius` (≤ the grid's cell), in cell order.
    /// `positions` are those that the grid sorted.
    pub fn build(grid: &CellGrid, positions: &[Vec3], radius: f32) -> Self {
        debug_assert!(radius <= grid.cell());
        let order = grid.order();
        let axis = |axis: usize| {
            let mut values = vec![0.0; order.len()];
            par::fill(&mut values, |place| positions[order[place] as usize][axis]);
            values
        };
        let sorted = Sorted { x: axis(0), y: axis(1), z: axis(2) };
        let (stretches, cell_of) = layout(grid);
        let chunks = par::map_chunks(positions.len(), CHUNK, |range| {
            let mut starts = Vec::with_capacity(range.len());
            let mut list = Vec::with_capacity(range.len() * 40);
            for i in range {
                starts.push(list.len());
                gather(
                    &sorted,
                    order,
                    &stretches[cell_of[i] as usize],
                    positions[i],
                    i as u32,
                    radius,
                    &mut list,
                );
            }
            (starts, list)
        });
        joined(&chunks)
    }

    /// The neighbours of particle `i`.
    #[inline]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.list[self.start[i]..self.start[i + 1]]
    }
}

/// Every cell's stretches, and every particle's cell.
fn layout(grid: &CellGrid) -> (Vec<[[u32; 2]; 9]>, Vec<u32>) {
    let mut stretches = vec![[[0; 2]; 9]; grid.len()];
    par::for_chunks(&mut stretches, CHUNK, |start, chunk| {
        let mut ends = [[0; 2]; 9];
        for (offset, slot) in chunk.iter_mut().enumerate() {
            *slot = grid.stretches(start + offset, &mut ends);
        }
    });
    let mut cell_of = vec![0; grid.order().len()];
    for c in 0..grid.len() {
        for &i in &grid.order()[grid.places(c)] {
            cell_of[i as usize] = c as u32;
        }
    }
    (stretches, cell_of)
}

/// Appends the particles within `radius` of `x` to `list`, without particle `own`.
#[inline]
fn gather(
    sorted: &Sorted,
    order: &[u32],
    stretches: &[[u32; 2]; 9],
    x: Vec3,
    own: u32,
    radius: f32,
    list: &mut Vec<u32>,
) {
    let radius2 = radius * radius;
    let mut r2 = [0.0_f32; BATCH];
    let mut hits = [0_u32; 4 * BATCH];
    let mut found = 0;
    for &[first, last] in stretches {
        let (mut first, last) = (first as usize, last as usize);
        while first < last {
            let end = last.min(first + BATCH);
            let (xs, ys, zs) = (&sorted.x[first..end], &sorted.y[first..end], &sorted.z[first..end]);
            for (((r2, &px), &py), &pz) in r2.iter_mut().zip(xs).zip(ys).zip(zs) {
                let d = [px - x.x, py - x.y, pz - x.z];
                *r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            }
            if found > 3 * BATCH {
                list.extend_from_slice(&hits[..found]);
                found = 0;
            }
            for (&r2, &j) in r2.iter().zip(&order[first..end]) {
                hits[found % (4 * BATCH)] = j;
                found += usize::from((r2 < radius2) & (j != own));
            }
            first = end;
        }
    }
    list.extend_from_slice(&hits[..found]);
}

/// The chunks' lists as one.
fn joined(chunks: &[(Vec<usize>, Vec<u32>)]) -> Neighbours {
    let mut start = Vec::with_capacity(chunks.iter().map(|(starts, _)| starts.len()).sum::<usize>() + 1);
    let mut total = 0;
    for (starts, list) in chunks {
        start.extend(starts.iter().map(|first| total + first));
        total += list.len();
    }
    start.push(total);
    let mut list = vec![0; total];
    let mut rest = list.as_mut_slice();
    let mut slots = Vec::with_capacity(chunks.len());
    for (_, part) in chunks {
        let (slot, after) = rest.split_at_mut(part.len());
        slots.push((slot, part));
        rest = after;
    }
    par::for_chunks(&mut slots, 1, |_, slots| {
        for (slot, part) in slots {
            slot.copy_from_slice(part);
        }
    });
    Neighbours { start, list }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every list by trying all pairs.
    fn brute(positions: &[Vec3], radius: f32) -> Vec<Vec<u32>> {
        let near =
            |i: usize, j: usize| i != j && (positions[j] - positions[i]).norm_squared() < radius * radius;
        let all = 0..positions.len();
        all.clone().map(|i| all.clone().filter(|&j| near(i, j)).map(|j| j as u32).collect()).collect()
    }

    /// Checks lists and queries against all pairs.
    fn check(positions: &[Vec3], cell: f32, radius: f32) {
        let grid = CellGrid::new(positions, cell);
        let lists = Neighbours::build(&grid, positions, radius);
        for (i, expected) in brute(positions, radius).into_iter().enumerate() {
            let sorted = |mut list: Vec<u32>| {
                list.sort_unstable();
                list
            };
            assert_eq!(sorted(lists.of(i).to_vec()), expected, "list of {i}");
            let mut found = Vec::new();
            grid.for_each_within(positions, positions[i], radius, |j, r2| {
                assert_eq!(r2, (positions[j] - positions[i]).norm_squared());
                found.push(j as u32);
            });
            let place = found.iter().position(|&j| j == i as u32).expect("a point is within reach of itself");
            found.remove(place);
            assert_eq!(found, lists.of(i), "query and list agree in order");
        }
    }

    /// A cloud without order, the same on every run.
    fn cloud(count: usize, extent: f32) -> Vec<Vec3> {
        let at = |i: usize, k: u64| {
            let bits = (i as u64 * 3 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            (bits as f32 / (1 << 24) as f32 - 0.5) * extent
        };
        (0..count).map(|i| Vec3::new(at(i, 0), at(i, 1), at(i, 2))).collect()
    }

    #[test]
    fn lists_are_those_of_all_pairs() {
        check(&cloud(2000, 1.0), 0.17, 0.17);
        check(&cloud(500, 1.0), 0.3, 0.1);
        check(&cloud(300, 1.0), 5.0, 2.0);
    }

    #[test]
    fn lattices_whose_neighbours_lie_on_the_radius_are_exact() {
        let lattice: Vec<Vec3> = (0..1000)
            .map(|k| Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32) * 0.02)
            .collect();
        check(&lattice, 0.04, 0.04);
    }

    #[test]
    fn nothing_one_point_and_many_in_one_place_are_fine() {
        check(&[], 1.0, 1.0);
        CellGrid::new(&[], 1.0).for_each_within(&[], Vec3::zeros(), 1.0, |_, _| panic!("there is nothing"));
        check(&[Vec3::new(3.0, -1.0, 2.0)], 0.1, 0.1);
        check(&[Vec3::new(0.1, 0.2, 0.3); 300], 0.1, 0.1);
    }

    #[test]
    fn strays_cost_a_cell_each_and_are_found() {
        let mut positions = cloud(1000, 1.0);
        for far in [1e6, -1e6, 1e12, -1e12, 3e38] {
            positions.push(Vec3::new(far, 0.0, 0.0));
            positions.push(Vec3::new(0.0, far, far));
        }
        positions.push(Vec3::new(1e6, 0.0, 0.0));
        assert!(CellGrid::new(&positions, 0.2).len() <= 6 * 6 * 21 + 10);
        let finite = positions.len();
        check(&positions[..finite], 0.2, 0.2);
    }

    #[test]
    fn lists_have_the_same_order_on_any_number_of_threads() {
        let positions = cloud(5000, 1.0);
        let build = || Neighbours::build(&CellGrid::new(&positions, 0.1), &positions, 0.1);
        let one = par::with_threads(1, build);
        for threads in [2, 3] {
            let other = par::with_threads(threads, build);
            assert!(one.start == other.start && one.list == other.list);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn any_cloud_has_the_lists_of_all_pairs(
            points in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 0..120),
            cell in 0.05_f32..1.0,
            share in 0.2_f32..=1.0,
        ) {
            let positions: Vec<Vec3> = points.into_iter().map(Vec3::from).collect();
            check(&positions, cell, cell * share);
        }
    }
}
