//! Neighbour lists.

use super::{
    CellGrid, ONE_EDGE,
    gather::{Gather, Scratch, Sorted},
};
use crate::{
    math::Vec3,
    par::{self, Inverse},
    simd::{self, IndexList, IndexRows, Lanes},
};
use std::ops::Range;

/// Particles whose lists share one piece of memory, and which a task lists at once. Fewer repeat the candidates
/// of cells that the end cuts through; more leave threads idle in small shots.
const CHUNK: usize = 256;

/// The widest group of cells along x whose particles are tried against the same candidates. At 1 packing them for
/// each cell costs more than it saves (92 ns a particle against 79 at 2); at 4 there are a fifth more of them (86 ns).
const GROUP: i32 = 2;

/// Every particle's neighbours.
///
/// Lists lie in the grid's order, in blocks of 256 particles: none has to be moved when another grows, and all keep
/// their memory from one build to the next.
#[derive(Debug, Default)]
pub struct Neighbours {
    /// A particle's place in the grid's order.
    place: Inverse,
    chunks: Vec<Chunk>,
    /// Positions in the grid's order.
    sorted: Sorted,
}

/// The lists of up to [`CHUNK`] particles.
#[derive(Debug)]
struct Chunk {
    /// `list[start[k]..start[k + 1]]` are the neighbours of the chunk's particle `k`.
    start: [u32; CHUNK + 1],
    list: IndexList,
}

impl Neighbours {
    /// Lists, for every particle, the others closer than `radius` (≤ the grid's cell), in cell order.
    /// `positions` are those that the grid sorted.
    pub fn build(grid: &CellGrid, positions: &[Vec3], radius: f32) -> Self {
        let mut lists = Self::default();
        lists.rebuild(grid, positions, radius);
        lists
    }

    /// Does what [`Neighbours::build`] does, in the memory of the lists before.
    ///
    /// # Panics
    /// If `radius` is larger than the grid's cell.
    pub fn rebuild(&mut self, grid: &CellGrid, positions: &[Vec3], radius: f32) {
        assert!(radius <= grid.cell(), "neighbours are in adjacent cells");
        let order = grid.order();
        self.place.rebuild(order);
        self.sorted.rebuild(order, positions);
        let sorted = &self.sorted;
        let empty = || Chunk { start: [0; CHUNK + 1], list: IndexList::default() };
        self.chunks.resize_with(order.len().div_ceil(CHUNK), empty);
        par::for_chunks_with(&mut self.chunks, 1, Scratch::default, |scratch, index, chunk| {
            let [Chunk { start, list }] = chunk else { unreachable!("chunks of one") };
            let first = index * CHUNK;
            scratch.found = 0;
            let range = first..order.len().min(first + CHUNK);
            grid.for_each_group(range, GROUP, &ONE_EDGE, |places, stretches| {
                let ends = &mut start[places.start - first + 1..=places.end - first];
                let radius2 = radius * radius;
                simd::dispatch(Gather { sorted, order, stretches, places, radius2, scratch, ends });
            });
            let mut memory = std::mem::take(list).into_vec();
            keep(&mut memory, &scratch.hits[..scratch.found]);
            *list = IndexList::new(memory, order.len());
        });
    }

    /// The neighbours of particle `i`.
    #[inline]
    pub fn of(&self, i: usize) -> &[u32] {
        let (list, range) = self.place_of(i);
        &list.as_slice()[range]
    }

    /// The neighbours of particle `i` by eights; the last eight are filled up with `i`.
    #[inline(always)]
    pub fn rows<L: Lanes>(&self, i: usize) -> IndexRows<'_> {
        let (list, range) = self.place_of(i);
        list.rows::<L>(range, i)
    }

    /// The chunk that holds the list of particle `i`, and its range there.
    #[inline(always)]
    fn place_of(&self, i: usize) -> (&IndexList, Range<usize>) {
        let place = self.place.of(i);
        let Chunk { start, list } = &self.chunks[place / CHUNK];
        let k = place % CHUNK;
        (list, start[k] as usize..start[k + 1] as usize)
    }
}

/// Replaces the content of `list`, whose memory stays unless it is too small or an eighth too large.
fn keep(list: &mut Vec<u32>, hits: &[u32]) {
    let capacity = list.capacity();
    if capacity < hits.len() || capacity > hits.len() + hits.len() / 8 {
        // The old memory goes before the new one comes.
        *list = Vec::new();
        list.reserve_exact(hits.len() + hits.len() / 64);
    }
    list.clear();
    list.extend_from_slice(hits);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::tests::in_both_forms;
    use proptest::prelude::*;

    /// Every list by trying all pairs.
    fn brute(positions: &[Vec3], radius: f32) -> Vec<Vec<u32>> {
        let near =
            |i: usize, j: usize| i != j && (positions[j] - positions[i]).norm_squared() < radius * radius;
        let all = 0..positions.len();
        all.clone().map(|i| all.clone().filter(|&j| near(i, j)).map(|j| j as u32).collect()).collect()
    }

    /// Checks lists, with both forms of lanes, and queries against all pairs.
    fn check(positions: &[Vec3], cell: f32, radius: f32) {
        let grid = CellGrid::new(positions, cell);
        for lists in in_both_forms(|| Neighbours::build(&grid, positions, radius)) {
            check_lists(&lists, &grid, positions, radius);
        }
    }

    fn check_lists(lists: &Neighbours, grid: &CellGrid, positions: &[Vec3], radius: f32) {
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
    fn regular_grids_with_neighbours_on_the_radius_are_exact() {
        let grid: Vec<Vec3> = (0..1000)
            .map(|k| Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32) * 0.02)
            .collect();
        check(&grid, 0.04, 0.04);
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
            assert!(same(positions.len(), &one, &other));
        }
    }

    /// Whether two builds hold the same lists in the same order.
    fn same(count: usize, a: &Neighbours, b: &Neighbours) -> bool {
        (0..count).all(|i| a.of(i) == b.of(i))
    }

    #[test]
    fn both_forms_round_alike() {
        // A sphere around the first particle, on its radius give or take the last digit: a fused product or another
        // order of the sum would distinguish the forms.
        let cell = 0.1_f32;
        let mut positions = cloud(5000, 1.0);
        positions.iter_mut().for_each(|x| *x = x.normalize() * cell);
        positions[0] = Vec3::zeros();
        let grid = CellGrid::new(&positions, cell);
        let [scalar, fastest] = in_both_forms(|| Neighbours::build(&grid, &positions, cell));
        let inside = scalar.of(0).len();
        assert!((500..4500).contains(&inside), "{inside} of 5000");
        assert!(same(positions.len(), &scalar, &fastest));
    }

    #[test]
    fn the_memory_of_earlier_builds_leaves_no_trace() {
        let (mut grid, mut lists) = (CellGrid::default(), Neighbours::default());
        for (count, extent, cell) in
            [(3000, 1.0, 0.2), (5000, 1.0, 0.1), (0, 1.0, 1.0), (700, 2e9, 0.3), (2000, 0.3, 0.1)]
        {
            let positions = cloud(count, extent);
            grid.rebuild(&positions, cell);
            lists.rebuild(&grid, &positions, cell);
            let fresh = CellGrid::new(&positions, cell);
            assert_eq!(grid.order(), fresh.order());
            assert!(same(count, &lists, &Neighbours::build(&fresh, &positions, cell)));
        }
    }

    #[test]
    fn lists_take_no_more_memory_than_they_need() {
        let at = |k: usize| Vec3::new((k % 30) as f32, (k / 30 % 30) as f32, (k / 900) as f32);
        let noise = cloud(27_000, 0.8);
        let mut positions: Vec<Vec3> = noise.iter().enumerate().map(|(k, d)| at(k) + d).collect();
        let (mut grid, mut lists) = (CellGrid::default(), Neighbours::default());
        for _ in 0..5 {
            positions.iter_mut().zip(noise.iter().rev()).for_each(|(x, d)| *x += 0.2 * d);
            grid.rebuild(&positions, 2.2);
            lists.rebuild(&grid, &positions, 2.2);
            let bytes: usize =
                lists.chunks.iter().map(|c| size_of::<Chunk>() + 4 * c.list.capacity()).sum::<usize>();
            let entries: usize = (0..positions.len()).map(|i| lists.of(i).len()).sum();
            assert!(bytes <= 4 * entries * 17 / 16 + 6 * positions.len(), "{bytes} for {entries} entries");
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
