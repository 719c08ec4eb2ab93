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
    /// The half-edges of `mesh`, by a counting sort.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let mut start = vec![0_u32; mesh.positions.len() + 1];
        for &v in mesh.triangles.iter().flatten() {
            start[v as usize + 1] += 1;
        }
        for v in 0..mesh.positions.len() {
            start[v + 1] += start[v];
        }
        let mut place = start.clone();
        let mut list = vec![0; 3 * mesh.triangles.len()];
        for (h, &v) in (0..).zip(mesh.triangles.iter().flatten()) {
            list[place[v as usize] as usize] = h;
            place[v as usize] += 1;
        }
        Self { start, list }
    }

    /// The half-edges that leave `v`.
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
