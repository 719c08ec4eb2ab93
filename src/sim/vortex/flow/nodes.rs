//! The nodes of the remeshing grid that have strength.

use crate::grid::Bricks;
use nalgebra::Vector3;

/// A node of the grid with strength.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Integer coordinates [spacings].
    pub(super) at: [i32; 3],
    /// Γ [m³/s].
    pub(super) strength: Vector3<f64>,
}

impl Node {
    /// The position of the node [spacings].
    pub(super) fn position(&self) -> Vector3<f64> {
        Vector3::from(self.at.map(f64::from))
    }
}

/// The centre of nodes, weighted by |Γ| [spacings]; the origin if they have no strength.
pub(super) fn center(nodes: &[Node]) -> Vector3<f64> {
    let each = || nodes.iter().map(|node| (node.position(), node.strength.norm()));
    let whole: f64 = each().map(|(_, size)| size).sum();
    if whole > 0.0 {
        each().map(|(x, size)| x * size).sum::<Vector3<f64>>() / whole
    } else {
        Vector3::zeros()
    }
}

/// A map from coordinates to nodes.
pub(super) struct NodeIndex {
    /// The coordinates of the nodes; bricks serve as a map from coordinates only.
    coordinates: Bricks,
    /// The index of the node at each of the coordinates.
    nodes: Vec<u32>,
}

impl NodeIndex {
    /// The map of those of `nodes` for which `is_member` is true.
    pub(super) fn new(nodes: &[Node], is_member: impl Fn(usize) -> bool) -> Self {
        let members = || (0..nodes.len()).filter(|&i| is_member(i));
        let coordinates = Bricks::new(members().map(|i| nodes[i].at).collect());
        let mut indices = vec![0; coordinates.len()];
        for i in members() {
            indices[coordinates.find(nodes[i].at).expect("every member has its coordinates")] = i as u32;
        }
        Self { coordinates, nodes: indices }
    }

    /// The index of the node at these coordinates.
    pub(super) fn find(&self, at: [i32; 3]) -> Option<u32> {
        self.coordinates.find(at).map(|k| self.nodes[k])
    }
}
