//! Weak nodes hand their strength on.
//!
//! *Method*: the weakest nodes, which together hold a given share of Σ|Γ|, are dropped. Each gives its strength to the nearest nodes
//! that stay, in proportion to theirs. What impulse is lost by that in a block of nodes is given back to those of the block that
//! stay, as a turn about their middle: δΓ = |Γ| a × r, which adds nothing to ΣΓ. A weak node stays that has no neighbours which do,
//! or whose block cannot take the turn.

use super::remesh::Node;
use crate::{grid::Bricks, par};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// How far neighbours are at most [spacings]; nearer ones are asked first. M4′ widens a body by two.
const REACH: i32 = 3;

/// Nodes along the edge of a block. What is far apart must not share: a stray's lever would be all there is.
const BLOCK: i32 = 16;

/// The most that a strength may change by giving impulse back, of itself. Bodies change by less than a thousandth.
const MOST_CHANGE: f64 = 0.05;

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
pub(super) fn hand_on(nodes: Vec<Node>, share: f64) -> Thinned {
    let least = threshold(&nodes, share);
    let is_weak: Vec<bool> = nodes.iter().map(|node| node.strength.norm() < least).collect();
    let weak = is_weak.iter().filter(|&&weak| weak).count() as u32;
    if weak == 0 {
        return Thinned { nodes, dropped: 0, stayed: 0 };
    }

    // Everyone gives at once what it had at first.
    let strong = Strong::new(&nodes, &is_weak);
    let gifts = par::map_chunks(nodes.len(), par::CHUNK, |range| {
        range
            .filter(|&i| is_weak[i])
            .map(|i| Gift { from: i, takers: strong.takers(&nodes, i) })
            .collect::<Vec<_>>()
    });
    let mut blocks = BTreeMap::<[i32; 3], Block>::new();
    for gift in gifts.into_iter().flatten().filter(|gift| !gift.takers.is_empty()) {
        blocks.entry(block(&nodes[gift.from])).or_default().gifts.push(gift);
    }
    for i in (0..nodes.len()).filter(|&i| !is_weak[i]) {
        if let Some(block) = blocks.get_mut(&block(&nodes[i])) {
            block.strong.push(i);
        }
    }

    // Block by block, if it can take the impulse.
    let (mut left, mut gone) = (nodes.clone(), vec![false; nodes.len()]);
    for block in blocks.values() {
        let lost = block.gifts.iter().map(|gift| gift.lost(&nodes)).sum();
        let Some(changes) = block.turned(&nodes, lost) else { continue };
        for gift in &block.gifts {
            gone[gift.from] = true;
            gift.shares().for_each(|(q, part)| left[q].strength += nodes[gift.from].strength * part);
        }
        for (&i, change) in block.strong.iter().zip(changes) {
            left[i].strength += change;
        }
    }
    let mut is_gone = gone.iter();
    left.retain(|_| !is_gone.next().expect("one a node"));
    let dropped = (nodes.len() - left.len()) as u32;
    Thinned { nodes: left, dropped, stayed: weak - dropped }
}

/// What a weak node gives.
#[derive(Debug)]
struct Gift {
    from: usize,
    /// Who takes it, and in which proportion.
    takers: Vec<(u32, f64)>,
}

impl Gift {
    /// Who takes which part of it.
    fn shares(&self) -> impl Iterator<Item = (usize, f64)> {
        let whole: f64 = self.takers.iter().map(|(_, part)| part).sum();
        self.takers.iter().map(move |&(q, part)| (q as usize, part / whole))
    }

    /// Σ x × Γ that it loses.
    fn lost(&self, nodes: &[Node]) -> Vector3<f64> {
        let from = &nodes[self.from];
        self.shares().map(|(q, part)| (place(from) - place(&nodes[q])).cross(&(from.strength * part))).sum()
    }
}

/// Gifts from a block, and the nodes in it that stay.
#[derive(Debug, Default)]
struct Block {
    gifts: Vec<Gift>,
    strong: Vec<usize>,
}

impl Block {
    /// What to add to the strengths of those that stay so that Σ x × Γ grows by `impulse` and ΣΓ by nothing; `None` if they lie too
    /// near a line.
    fn turned(&self, nodes: &[Node], impulse: Vector3<f64>) -> Option<Vec<Vector3<f64>>> {
        let strong = || self.strong.iter().map(|&i| (place(&nodes[i]), nodes[i].strength.norm()));
        let whole: f64 = strong().map(|(_, size)| size).sum();
        let middle = strong().map(|(x, size)| x * size).sum::<Vector3<f64>>() / whole;
        // Σ r × |Γ| (a × r) = J a.
        let parts = strong().map(|(x, size)| {
            let r = x - middle;
            (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * size
        });
        let inertia: Matrix3<f64> = parts.sum();
        let turn = inertia.cholesky()?.solve(&impulse);
        // Rounding may let a singular J through, and nearly a line would have to turn far.
        let exact = (inertia * turn - impulse).norm() <= 1e-9 * impulse.norm();
        let little = strong().all(|(x, _)| turn.cross(&(x - middle)).norm() <= MOST_CHANGE);
        (exact && little).then(|| strong().map(|(x, size)| turn.cross(&(x - middle)) * size).collect())
    }
}

/// The block of a node.
fn block(node: &Node) -> [i32; 3] {
    node.at.map(|i| i.div_euclid(BLOCK))
}

/// Where a node is [spacings].
fn place(node: &Node) -> Vector3<f64> {
    Vector3::from(node.at.map(f64::from))
}

/// The strength below which nodes together hold at most `share` of all.
fn threshold(nodes: &[Node], share: f64) -> f64 {
    let mut sizes: Vec<f64> = nodes.iter().map(|node| node.strength.norm()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let most = share * sizes.iter().sum::<f64>();
    let mut held = 0.0;
    let stays = |size: &f64| {
        held += size;
        held > most
    };
    sizes.into_iter().find(stays).unwrap_or(0.0)
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

    /// Who takes the strength of node `i`, and in which proportion; nobody if no node that stays is near.
    fn takers(&self, nodes: &[Node], i: usize) -> Vec<(u32, f64)> {
        let within = |reach: i32| {
            let side = 2 * reach + 1;
            let steps = (0..side.pow(3)).map(move |k| [k % side, k / side % side, k / (side * side)]);
            let found = steps.filter_map(|step| {
                let at = std::array::from_fn(|axis| nodes[i].at[axis] + step[axis] - reach);
                let q = self.nodes[self.places.find(at)?];
                Some((q, nodes[q as usize].strength.norm()))
            });
            found.collect::<Vec<_>>()
        };
        (1..=REACH).map(within).find(|found| !found.is_empty()).unwrap_or_default()
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
        [
            nodes.iter().map(|node| node.strength).sum(),
            nodes.iter().map(|node| place(node).cross(&node.strength)).sum(),
        ]
    }

    #[test]
    fn what_goes_leaves_strength_and_impulse() {
        let block: Vec<[i32; 3]> = (0..64).map(|k| [k % 4, k / 4 % 4, k / 16]).collect();
        // Two layers on it, and a node alone.
        let layers: Vec<[i32; 3]> = (0..32).map(|k| [k % 4, k / 4 % 4, 4 + k / 16]).collect();
        let mut all = nodes(&block, 1.0);
        all.extend(nodes(&layers, 1e-5));
        all.extend(nodes(&[[40, 0, 0]], 1e-5));
        let before = moments(&all);
        let Thinned { nodes: left, dropped, stayed } = hand_on(all.clone(), 1e-3);
        assert_eq!((left.len(), dropped, stayed), (65, 32, 1));
        for (now, before) in moments(&left).iter().zip(before) {
            assert!((now - before).norm() < 1e-12 * before.norm(), "{now} {before}");
        }
        for (now, before) in left.iter().zip(&all) {
            assert!((now.strength - before.strength).norm() < 1e-3, "a little each");
        }
        assert_eq!(hand_on(all, 0.0).nodes.len(), 97);
    }

    #[test]
    fn a_line_takes_no_turn_about_itself() {
        let line: Vec<[i32; 3]> = (0..25).map(|k| [k, 0, 0]).collect();
        let mut all = nodes(&line, 1.0);
        all.extend(nodes(&[[2, 0, 1]], 1e-6));
        let thinned = hand_on(all, 1e-3);
        assert_eq!((thinned.nodes.len(), thinned.dropped, thinned.stayed), (26, 0, 1));
    }
}
