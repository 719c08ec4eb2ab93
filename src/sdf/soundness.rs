//! What is unsound about a triangle mesh from a file: open edges, edges of three and more triangles, triangles that face the other way
//! or pass through others.
//!
//! Vertices at the same place are one, so that a triangle soup whose triangles fit is closed.

use super::{Triangles, crossings::crossing, volume_below};
use crate::par;

/// Counts of what makes a mesh no closed, oriented surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Soundness {
    /// Edges of one triangle alone.
    pub(crate) open_edges: usize,
    /// Edges of more than two triangles.
    pub(crate) crowded_edges: usize,
    /// Edges whose two triangles run along them in the same direction: one of them faces the other way.
    pub(crate) flipped_edges: usize,
    /// Triangles with two corners at one place.
    pub(crate) degenerate: usize,
    /// Triangles that pass through others; at least so many of a very tangled mesh.
    pub(crate) crossing: usize,
    /// Whether it encloses a negative volume, as if it were seen from inside.
    pub(crate) is_inside_out: bool,
}

impl Soundness {
    /// Counts the faults of a mesh.
    pub(crate) fn of(mesh: &Triangles) -> Self {
        // First, while no list of edges is held.
        let crossing = crossing(mesh);
        let welded = welded(mesh);
        let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
        let mut degenerate = 0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|corner| welded[corner as usize]);
            if a == b || b == c || c == a {
                degenerate += 1;
                continue;
            }
            // Ascending ends, then whether the triangle runs along it upwards.
            let edge = |a: u32, b: u32| (a.min(b), a.max(b), a < b);
            edges.extend([edge(a, b), edge(b, c), edge(c, a)]);
        }
        par::sort_by_key(&mut edges, |&edge| edge);
        let mut found = Self { degenerate, crossing, is_inside_out: volume(mesh) < 0.0, ..Self::default() };
        for same in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            match *same {
                [_] => found.open_edges += 1,
                [a, b] => found.flipped_edges += usize::from(a.2 == b.2),
                _ => found.crowded_edges += 1,
            }
        }
        found
    }

    /// The counts in words, with what becomes of each; `None` if there is nothing to report.
    pub(crate) fn report(&self) -> Option<String> {
        let counted = [
            (self.open_edges, "open edges, whose holes are closed"),
            (self.crowded_edges, "edges of more than two triangles, taken as parts that touch"),
            (self.flipped_edges, "edges at which the faces turn to the other side, which does not matter"),
            (self.degenerate, "triangles without an area, left out"),
            (self.crossing, "triangles that pass through others, taken as parts of one solid"),
        ];
        let mut parts: Vec<String> = counted
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        if self.is_inside_out {
            parts.push("faces that look inwards, taken as a solid all the same".to_owned());
        }
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// For each vertex the first one at its place.
fn welded(mesh: &Triangles) -> Vec<u32> {
    // Adding 0 turns −0 into 0.
    let place = |i: u32| mesh.positions[i as usize].map(|c| (c + 0.0).to_bits());
    let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    par::sort_by_key(&mut order, |&i| (<[u32; 3]>::from(place(i)), i));
    let mut first = vec![0; order.len()];
    for same in order.chunk_by(|&a, &b| place(a) == place(b)) {
        same.iter().for_each(|&i| first[i as usize] = same[0]);
    }
    first
}

/// Volume that the triangles enclose, in the mesh's units.
fn volume(mesh: &Triangles) -> f64 {
    let origin = mesh.positions.first().copied().unwrap_or_default();
    par::sum(mesh.triangles.len(), |i| volume_below(mesh.corners(i), origin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn tetrahedron() -> Triangles {
        let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        Triangles { positions, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] }
    }

    #[test]
    fn a_closed_mesh_is_sound_with_shared_vertices_and_without() {
        assert_eq!(Soundness::of(&tetrahedron()), Soundness::default());
        assert_eq!(Soundness::of(&tetrahedron()).report(), None);
        let mesh = tetrahedron();
        let positions: Vec<Vec3> = (0..4).flat_map(|i| mesh.corners(i)).collect();
        let triangles = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert_eq!(Soundness::of(&Triangles { positions, triangles }), Soundness::default());
    }

    #[test]
    fn each_fault_is_counted() {
        let mut open = tetrahedron();
        open.triangles.pop();
        assert_eq!(Soundness::of(&open), Soundness { open_edges: 3, ..Soundness::default() });
        let mut flipped = tetrahedron();
        flipped.triangles[3].swap(0, 1);
        assert_eq!(Soundness::of(&flipped).flipped_edges, 3);
        let mut inwards = tetrahedron();
        inwards.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
        assert_eq!(Soundness::of(&inwards), Soundness { is_inside_out: true, ..Soundness::default() });
        let mut fin = tetrahedron();
        fin.positions.push(Vec3::new(-1.0, -1.0, 0.5));
        fin.triangles.extend([[0, 3, 4], [2, 2, 4]]);
        let found = Soundness::of(&fin);
        assert_eq!((found.crowded_edges, found.open_edges, found.degenerate), (1, 2, 1));
        let words = found.report().unwrap();
        assert!(words.starts_with("2 open edges") && words.contains("1 edges of more than two"), "{words}");
    }
}
