//! The nodes of a lattice that have strength.

use crate::grid::Bricks;
use nalgebra::Vector3;

/// A node of the lattice with strength.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// In spacings.
    pub(super) at: [i32; 3],
    /// [m³/s]
    pub(super) strength: Vector3<f64>,
}

impl Node {
    /// Where it is [spacings].
    pub(super) fn place(&self) -> Vector3<f64> {
        Vector3::from(self.at.map(f64::from))
    }
}

/// The middle of nodes by |Γ| [spacings]; the origin if they have no strength.
pub(super) fn middle(nodes: &[Node]) -> Vector3<f64> {
    let each = || nodes.iter().map(|node| (node.place(), node.strength.norm()));
    let whole: f64 = each().map(|(_, size)| size).sum();
    if whole > 0.0 {
        each().map(|(x, size)| x * size).sum::<Vector3<f64>>() / whole
    } else {
        Vector3::zeros()
    }
}

/// Nodes by where they are.
pub(super) struct Places {
    /// Of all that bricks can do, only to be found by coordinates.
    places: Bricks,
    /// The node at each place.
    nodes: Vec<u32>,
}

impl Places {
    /// Of those of `nodes` that `chosen` names.
    pub(super) fn new(nodes: &[Node], chosen: impl Fn(usize) -> bool) -> Self {
        let numbers = || (0..nodes.len()).filter(|&i| chosen(i));
        let places = Bricks::new(numbers().map(|i| nodes[i].at).collect());
        let mut at = vec![0; places.len()];
        for i in numbers() {
            at[places.find(nodes[i].at).expect("it was put there")] = i as u32;
        }
        Self { places, nodes: at }
    }

    /// The number of the node at a place.
    pub(super) fn find(&self, at: [i32; 3]) -> Option<u32> {
        self.places.find(at).map(|place| self.nodes[place])
    }
}
