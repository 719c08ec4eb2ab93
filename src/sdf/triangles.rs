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
        bounds(&self.triangles, &self.positions)
    }
}

/// The lowest and highest corner of the box around triangles; `None` without one.
pub(crate) fn bounds(triangles: &[[u32; 3]], positions: &[Vec3]) -> Option<(Vec3, Vec3)> {
    let corners = triangles.iter().flatten().map(|&corner| positions[corner as usize]);
    corners.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))
}

/// Part of a triangle in the volume that a closed mesh encloses: that of the tetrahedron with `origin`, positive if the triangle is
/// counter-clockwise seen from outside.
pub(crate) fn volume_below([a, b, c]: [Vec3; 3], origin: Vec3) -> f64 {
    let [a, b, c] = [a, b, c].map(|x| x.cast::<f64>() - origin.cast());
    a.dot(&b.cross(&c)) / 6.0
}
