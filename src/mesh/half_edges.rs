//! Half-edges of a mesh, by the vertex they leave.

use super::Mesh;
use crate::{math::Vec3, par};
use bytemuck::{Pod, Zeroable};

/// Index of a half-edge: 3·t + k runs in triangle t from its vertex k to the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct HalfEdge(pub(super) u32);

impl HalfEdge {
    /// No half-edge.
    pub(super) const NONE: Self = Self(u32::MAX);

    /// The half-edge as an index into lists of half-edges.
    #[inline]
    pub(super) fn at(self) -> usize {
        self.0 as usize
    }

    /// The triangle it runs in.
    #[inline]
    pub(super) fn triangle(self) -> u32 {
        self.0 / 3
    }

    /// The half-edge after it in its triangle.
    #[inline]
    pub(super) fn next(self) -> Self {
        Self(if self.0 % 3 == 2 { self.0 - 2 } else { self.0 + 1 })
    }

    /// The half-edge before it in its triangle.
    #[inline]
    pub(super) fn previous(self) -> Self {
        Self(if self.0.is_multiple_of(3) { self.0 + 2 } else { self.0 - 1 })
    }
}

/// The half-edges that leave every vertex, in the order of the triangles.
pub(super) struct HalfEdges(par::Groups);

impl HalfEdges {
    /// The half-edges of the triangles of `mesh` that `counts` selects.
    ///
    /// # Panics
    /// If there are 2³² half-edges or more.
    pub(super) fn new(mesh: &Mesh, counts: impl Fn(usize) -> bool + Sync) -> Self {
        let vertices = |t: usize| if counts(t) { mesh.triangles[t] } else { [u32::MAX; 3] };
        Self(par::Groups::new(mesh.triangles.len(), mesh.positions.len(), vertices))
    }

    /// The half-edges that leave `v`.
    #[inline]
    pub(super) fn of(&self, v: usize) -> &[HalfEdge] {
        bytemuck::cast_slice(self.0.of(v))
    }

    /// The vertices at the other ends of the half-edges of `v`.
    #[inline]
    pub(super) fn neighbours<'a>(&'a self, mesh: &'a Mesh, v: usize) -> impl Iterator<Item = u32> + 'a {
        self.of(v).iter().map(|&h| mesh.triangles[h.triangle() as usize][h.next().at() % 3])
    }

    /// Area-weighted normal of the faces around `v`, not normalised [m²].
    #[inline]
    pub(super) fn normal(&self, mesh: &Mesh, v: usize) -> Vec3 {
        self.of(v).iter().fold(Vec3::zeros(), |sum, &h| {
            let [a, b, c] = mesh.triangles[h.triangle() as usize].map(|v| mesh.positions[v as usize]);
            sum + (b - a).cross(&(c - a))
        })
    }

    /// [`HalfEdges::normal`] of every vertex.
    pub(super) fn normals(&self, mesh: &Mesh) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); mesh.positions.len()];
        par::fill(&mut normals, |v| self.normal(mesh, v));
        normals
    }
}
