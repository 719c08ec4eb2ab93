//! Weak nodes hand their strength on.
//!
//! *Method*: the weakest nodes, which together hold a given share of Σ|Γ|, are dropped. Each gives its strength to the nodes that stay
//! within three spacings, with the smallest weights w that keep ΣΓ and Σ x × Γ: Σ w = 1 and Σ w (x_q − x_p) = 0, the minimum of
//! Σ w² |x_q − x_p|⁴. A node whose neighbours cannot take it so, since they are too few, lie in a plane, or would have to give and take
//! much more than there is, stays.

use super::remesh::Node;
use crate::{grid::Bricks, par};
use nalgebra::{Matrix4, Vector3, Vector4};

/// How far neighbours are at most [spacings]; nearer ones are asked first.
const REACH: i32 = 3;

/// The largest Σ|w|. Linear extrapolation by one layer has 3, by two 5; smaller leaves a haze around bodies, larger adds noise to
/// their surface.
const MOST: f64 = 6.0;

/// The nodes that are left.
#[derive(Debug)]
pub(super) struct Thinned {
    pub(super) nodes: Vec<Node>,
    /// Nodes that went.
    pub(super) dropped: u32,
    /// Weak nodes that stayed.
    pub(super) stayed: u32,
}

/// Drops the weakest of `nodes` that hold `share` of all strength.
pub(super) fn hand_on(mut nodes: Vec<Node>, share: f64) -> Thinned {
    let least = threshold(&nodes, share);
    let is_weak: Vec<bool> = nodes.iter().map(|node| node.strength.norm() < least).collect();
    if !is_weak.contains(&true) {
        return Thinned { nodes, dropped: 0, stayed: 0 };
    }
    let strong = Strong::new(&nodes, &is_weak);

    // What each weak node would give to whom.
    let gifts = par::map_chunks(nodes.len(), par::CHUNK, |range| {
        let weak = range.filter(|&i| is_weak[i]);
        weak.map(|i| (i, (1..=REACH).find_map(|reach| strong.shares(nodes[i].at, reach)))).collect::<Vec<_>>()
    });
    let (mut gone, mut stayed) = (vec![false; nodes.len()], 0);
    for (i, gift) in gifts.into_iter().flatten() {
        let Some(gift) = gift else {
            stayed += 1;
            continue;
        };
        gone[i] = true;
        let strength = nodes[i].strength;
        for (q, w) in gift {
            nodes[q as usize].strength += strength * w;
        }
    }
    let mut is_gone = gone.iter();
    nodes.retain(|_| !is_gone.next().expect("one a node"));
    Thinned { dropped: (gone.len() - nodes.len()) as u32, stayed, nodes }
}

/// The strength below which nodes together hold at most `share` of all.
fn threshold(nodes: &[Node], share: f64) -> f64 {
    let mut sizes: Vec<f64> = nodes.iter().map(|node| node.strength.norm()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let most = share * sizes.iter().sum::<f64>();
    let mut held = 0.0;
    sizes
        .into_iter()
        .find(|size| {
            held += size;
            held > most
        })
        .unwrap_or(0.0)
}

/// The nodes that stay, by their place.
struct Strong {
    places: Bricks,
    /// The node at each place.
    nodes: Vec<u32>,
}

impl Strong {
    fn new(nodes: &[Node], is_weak: &[bool]) -> Self {
        let strong = || (0..nodes.len()).filter(|&i| !is_weak[i]);
        // Of all that bricks can do, only to be found by coordinates.
        let places = Bricks::new(strong().map(|i| nodes[i].at).collect());
        let mut numbers = vec![0; places.len()];
        for i in strong() {
            numbers[places.find(nodes[i].at).expect("it was put there")] = i as u32;
        }
        Self { places, nodes: numbers }
    }

    /// Whom of those within `reach` the node at `at` gives which part; `None` if they cannot take it.
    fn shares(&self, at: [i32; 3], reach: i32) -> Option<Vec<(u32, f64)>> {
        let side = 2 * reach + 1;
        let mut around = Vec::new();
        for k in 0..side.pow(3) {
            let step = [k % side - reach, k / side % side - reach, k / (side * side) - reach];
            if let Some(place) = self.places.find(std::array::from_fn(|axis| at[axis] + step[axis])) {
                let d = Vector3::from(step.map(f64::from));
                let weight = d.norm_squared().powi(-2);
                around.push((self.nodes[place], Vector4::new(1.0, d.x, d.y, d.z), weight));
            }
        }
        // Lagrange: w = g λ·(1, d) with M λ = (1, 0, 0, 0), M = Σ g (1, d)(1, d)ᵀ.
        let matrix: Matrix4<f64> = around.iter().map(|(_, d, g)| d * d.transpose() * *g).sum();
        let lambda = matrix.cholesky()?.solve(&Vector4::x());
        let shares: Vec<(u32, f64)> = around.iter().map(|(q, d, g)| (*q, g * lambda.dot(d))).collect();
        // Rounding may let a singular matrix through.
        let given: Vector4<f64> = around.iter().zip(&shares).map(|((_, d, _), (_, w))| d * *w).sum();
        let most: f64 = shares.iter().map(|(_, w)| w.abs()).sum();
        ((given - Vector4::x()).amax() < 1e-9 && most < MOST).then_some(shares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(at: &[[i32; 3]], strength: f64) -> Vec<Node> {
        at.iter().map(|&at| Node { at, strength: Vector3::new(strength, 0.5 * strength, 0.0) }).collect()
    }

    /// ΣΓ and Σ x × Γ.
    fn moments(nodes: &[Node]) -> [Vector3<f64>; 2] {
        let x = |node: &Node| Vector3::from(node.at.map(f64::from));
        [nodes.iter().map(|n| n.strength).sum(), nodes.iter().map(|n| x(n).cross(&n.strength)).sum()]
    }

    #[test]
    fn what_goes_leaves_strength_and_impulse() {
        let block: Vec<[i32; 3]> = (0..64).map(|k| [k % 4, k / 4 % 4, k / 16]).collect();
        // A layer on it, a second one, and a node alone.
        let layer: Vec<[i32; 3]> = (0..32).map(|k| [k % 4, k / 4 % 4, 4 + k / 16]).collect();
        let mut all = nodes(&block, 1.0);
        all.extend(nodes(&layer, 1e-4));
        all.extend(nodes(&[[40, 0, 0]], 1e-4));
        let before = moments(&all);
        let Thinned { nodes: left, dropped, stayed } = hand_on(all.clone(), 1e-3);
        assert_eq!((left.len(), dropped, stayed), (65, 32, 1));
        for (now, before) in moments(&left).iter().zip(before) {
            assert!((now - before).norm() < 1e-12 * before.norm(), "{now} {before}");
        }
        assert_eq!(hand_on(all, 0.0).nodes.len(), 97);
    }

    #[test]
    fn neighbours_in_a_plane_take_nothing_from_above() {
        let plane: Vec<[i32; 3]> = (0..25).map(|k| [k % 5, k / 5, 0]).collect();
        let mut all = nodes(&plane, 1.0);
        all.extend(nodes(&[[2, 2, 1]], 1e-6));
        let thinned = hand_on(all, 1e-3);
        assert_eq!((thinned.nodes.len(), thinned.stayed), (26, 1));
    }
}
