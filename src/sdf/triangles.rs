//! Triangle meshes as they come from files.

use crate::math::Vec3;

/// A triangle mesh, closed or not: a triangle soup is accepted.
///
/// Invariant: every index is below the number of positions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// Corner positions, in the mesh's own units.
    pub positions: Vec<Vec3>,
    /// Three indices into `positions` per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Triangles {
    /// The corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|corner| self.positions[corner as usize])
    }

    /// The lowest and highest corner of the triangles' bounding box; `None` without a triangle.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let corners = self.triangles.iter().flatten().map(|&corner| self.positions[corner as usize]);
        corners.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))
    }
}
