//! Which half-edges leave each vertex.
//!
//! Half-edge 3·t + k runs in triangle t from its vertex k to the next one.

use super::Mesh;

/// The half-edge after `h` in its triangle.
#[inline]
pub(super) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The half-edge before `h` in its triangle.
#[inline]
pub(super) fn previous(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// The half-edges that leave every vertex, in the order of the triangles.
pub(super) struct Links {
    start: Vec<u32>,
    list: Vec<u32>,
}

impl Links {
    /// The half-edges of the triangles of `mesh` that `counts`, by a counting sort.
    ///
    /// # Panics
    /// If there are 2³² half-edges or more.
    pub(super) fn new(mesh: &Mesh, counts: impl Fn(usize) -> bool) -> Self {
        assert!(mesh.triangles.len() < u32::MAX as usize / 3, "fewer than 2³² half-edges");
        let mut start = vec![0_u32; mesh.positions.len() + 1];
        for (_, triangle) in mesh.triangles.iter().enumerate().filter(|&(t, _)| counts(t)) {
            triangle.iter().for_each(|&v| start[v as usize] += 1);
        }
        // Each start is first the end of its vertex, and goes down as the half-edges are put in, last first.
        let mut end = 0;
        for start in &mut start {
            end += *start;
            *start = end;
        }
        let mut list = vec![0; end as usize];
        for t in (0..mesh.triangles.len()).rev().filter(|&t| counts(t)) {
            for k in [2, 1, 0] {
                let start = &mut start[mesh.triangles[t][k] as usize];
                *start -= 1;
                list[*start as usize] = (3 * t + k) as u32;
            }
        }
        Self { start, list }
    }

    /// The half-edges that leave `v`.
    #[inline]
    pub(super) fn of(&self, v: usize) -> &[u32] {
        &self.list[self.range(v)]
    }

    /// Where those of `v` stand among all.
    pub(super) fn range(&self, v: usize) -> std::ops::Range<usize> {
        self.start[v] as usize..self.start[v + 1] as usize
    }

    /// How many half-edges there are.
    pub(super) fn len(&self) -> usize {
        self.list.len()
    }
}
