//! Normals of corners, so that programs show edges above 30° sharp and all others smooth.

use crate::{
    math::Vec3,
    mesh::{Mesh, try_unit},
};

/// Cosine of the smallest angle between two faces that meet in a sharp edge: 30°, as the Blender extension has it.
const SHARP_COSINE: f32 = 0.866_025_4;

/// Faces around a vertex above which its corners have the normals of their faces: the time grows with the square of it. Tips of round
/// shapes have 128.
const MAX_FACES: usize = 256;

/// A unit normal for each corner of each triangle: the mean of the faces at its vertex that are within 30° of its own, by area.
///
/// # Panics
/// If a triangle names a vertex that does not exist.
pub(super) fn corner_normals(mesh: &Mesh) -> Vec<Vec3> {
    let areas: Vec<Vec3> = mesh.triangles.iter().map(|triangle| area(mesh, triangle)).collect();
    let units: Vec<Vec3> = areas.iter().map(|area| try_unit(area).unwrap_or_else(Vec3::z)).collect();
    let mut around = vec![Vec::new(); mesh.positions.len()];
    for (face, triangle) in mesh.triangles.iter().enumerate() {
        triangle.iter().for_each(|&vertex| around[vertex as usize].push(face));
    }
    let corner = |face: usize, vertex: u32| {
        let faces = &around[vertex as usize];
        if faces.len() > MAX_FACES {
            return units[face];
        }
        let smooth = faces.iter().filter(|&&other| units[face].dot(&units[other]) >= SHARP_COSINE);
        try_unit(&smooth.map(|&other| areas[other]).sum()).unwrap_or(units[face])
    };
    let corners = mesh.triangles.iter().enumerate();
    corners.flat_map(|(face, triangle)| triangle.map(|vertex| corner(face, vertex))).collect()
}

/// Twice the area of a triangle along its normal.
fn area(mesh: &Mesh, triangle: &[u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares that share an edge along y, the second one raised by `height` at its end.
    fn bent(height: f32) -> Vec<Vec3> {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let positions = vec![
            at(-1.0, 0.0, 0.0),
            at(0.0, 0.0, 0.0),
            at(0.0, 1.0, 0.0),
            at(-1.0, 1.0, 0.0),
            at(1.0, 0.0, height),
            at(1.0, 1.0, height),
        ];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]];
        corner_normals(&Mesh { positions, triangles, ..Mesh::default() })
    }

    #[test]
    fn edges_above_30_degrees_are_sharp() {
        let sharp = bent(1.0);
        assert!(sharp[..6].iter().all(|normal| (normal - Vec3::z()).norm() < 1e-6), "{sharp:?}");
        let slope = Vec3::new(-1.0, 0.0, 1.0).normalize();
        assert!(sharp[6..].iter().all(|normal| (normal - slope).norm() < 1e-6), "{sharp:?}");
        let smooth = bent(0.2);
        // The corner of the first triangle at the edge, and that of the third there.
        assert!(
            smooth[1].x < -0.05 && smooth[6].x > -0.19 && (smooth[1].norm() - 1.0).abs() < 1e-6,
            "{smooth:?}"
        );
        assert!((smooth[0] - Vec3::z()).norm() < 1e-6, "away from it");
    }

    #[test]
    fn areas_that_overflow_give_unit_normals() {
        let far = 1e30;
        let positions = vec![Vec3::zeros(), Vec3::x() * far, Vec3::y() * far, Vec3::z() * far];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 3, 2]];
        let normals = corner_normals(&Mesh { positions, triangles, ..Mesh::default() });
        assert!(normals.iter().all(|normal| (normal.norm() - 1.0).abs() < 1e-6), "{normals:?}");
    }

    #[test]
    fn degenerate_and_crowded_vertices_have_unit_normals() {
        let positions = vec![Vec3::zeros(); 3];
        let flat = corner_normals(&Mesh { positions, triangles: vec![[0, 1, 2]; 1000], ..Mesh::default() });
        assert_eq!(flat, vec![Vec3::z(); 3000]);
    }
}
