//! Population control: redistribution of the strength of low-circulation nodes.
//!
//! *Method*: a node has low circulation if the velocity it induces is negligible compared with that of other
//! nodes at its position. For a cube of nodes 2^l bricks wide, the influence is the largest strength Γ' in it
//! and in its 26 neighbours, times 1/4^l because velocity decays with the squared distance. A node with less
//! than a given fraction of the influence, for any l, transfers its strength to the nearest other nodes, in
//! proportion to theirs. If no such receiver is within three spacings, the dominant node receives it. So the
//! fringe that every remeshing adds is removed, and a small separate body remains, even near one of much
//! higher circulation. A node keeps its strength where too much of one direction would be transferred to one
//! distant receiver.
//!
//! The impulse that transfers lose is restored at the nodes of the cube that receives, as a rotation about
//! their centre: δΓ = |Γ| a × r, which adds nothing to ΣΓ. If the nodes of a cube cannot take it, the cube of
//! twice the edge around it does.
//!
//! *Source*: none. Other particle methods drop nodes below a fraction of the largest vorticity, and lose
//! their moments.

use super::nodes::{Node, NodeIndex};
use crate::{
    grid::{BRICK, Bricks},
    par,
};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// The largest distance of a receiver along each axis [spacings]; the nearest receivers are preferred. M4′
/// widens a body by two.
const MAX_RECEIVER_DISTANCE: i32 = 3;

/// Nodes along the edge of the smallest cubes in which impulse is restored. With smaller cubes, more of them
/// cannot take it and pass it to the next larger. With larger ones distant nodes take part, and a stray
/// vorton with its long lever arm would take all of it. The effect is small. With 4 the draft ring keeps 0.15
/// % more energy over 36 frames and 80 remeshings, and its impulse drifts by 0.08 % instead of 0.07 %; 64 is
/// like 16; none loses impulse.
const CUBE_NODES: i32 = 16;

/// The largest relative change of a strength by restored impulse. Smaller, and more impulse is lost; larger,
/// and few vortons take the impulse of many. Strengths of bodies change by less than a thousandth: on the
/// draft ring, over 80 remeshings, 0.001 loses nothing either, and the energy differs by 0.01 %.
const MAX_RELATIVE_CHANGE: f64 = 0.05;

/// The largest sum of transfers to a node from beyond [`MAX_RECEIVER_DISTANCE`], as a vector, relative to its
/// strength. The strengths of fringes cancel. Those of a broad low-circulation body do not, and a larger
/// limit would let one node absorb it.
const MAX_DISTANT_TRANSFER: f64 = 0.05;

/// The nodes after redistribution.
#[derive(Debug)]
pub(super) struct Redistributed {
    pub(super) nodes: Vec<Node>,
    /// The number of removed nodes.
    pub(super) removed: u32,
    /// Strength of the removed nodes, as a fraction of Σ|Γ|, 0..1.
    pub(super) fraction: f64,
    /// The size of the impulse Σ x × Γ that could not be restored [spacings · m³/s].
    pub(super) lost_impulse: f64,
}

/// Removes low-circulation nodes, those below `fraction` of the influence at their position, and nodes inside
/// solids, and redistributes their strength. A node inside a solid stays if it has no receiver.
pub(super) fn redistribute(
    nodes: Vec<Node>,
    fraction: f64,
    is_solid: impl Fn([i32; 3]) -> bool + Sync,
) -> Redistributed {
    let mut solid = vec![false; nodes.len()];
    par::fill(&mut solid, |i| is_solid(nodes[i].at));
    let influences = InfluenceMap::new(&nodes, &solid);
    let mut dominating = vec![None; nodes.len()];
    par::fill(&mut dominating, |i| {
        let influence = influences.at(&nodes[i]);
        (nodes[i].strength.norm() < fraction * influence.strength).then_some(influence.node)
    });
    let is_receiver = |i: usize| dominating[i].is_none() && !solid[i];
    if (0..nodes.len()).all(is_receiver) {
        return Redistributed { nodes, removed: 0, fraction: 0.0, lost_impulse: 0.0 };
    }

    // All transfers are simultaneous: they move the strengths of the start.
    let index = NodeIndex::new(&nodes, is_receiver);
    let transfers = par::map_chunks(nodes.len(), par::CHUNK, |range| {
        let found = range.filter(|&i| !is_receiver(i)).filter_map(|i| match receivers(&nodes, &index, i) {
            none if none.is_empty() => {
                let dominant = dominant_node(&dominating, i);
                let receivers = vec![(dominant, 1.0)];
                is_receiver(dominant as usize).then_some(Transfer { from: i, receivers, is_distant: true })
            }
            receivers => Some(Transfer { from: i, receivers, is_distant: false }),
        });
        found.collect::<Vec<_>>()
    });
    let transfers = limit_distant_transfers(&nodes, &solid, transfers.concat());
    let (mut remaining, mut is_removed) = (nodes.clone(), vec![false; nodes.len()]);
    let mut lost = BTreeMap::<[i32; 3], Vector3<f64>>::new();
    for transfer in &transfers {
        let from = &nodes[transfer.from];
        is_removed[transfer.from] = true;
        for (receiver, share) in transfer.shares() {
            let strength = from.strength * share;
            remaining[receiver].strength += strength;
            let impulse = (from.position() - nodes[receiver].position()).cross(&strength);
            *lost.entry(nodes[receiver].at.map(|v| v.div_euclid(CUBE_NODES))).or_default() += impulse;
        }
    }
    let lost_impulse = restore_impulse(&nodes, |i| !is_removed[i] && !solid[i], lost, &mut remaining);
    let mut removed = is_removed.iter();
    remaining.retain(|_| !removed.next().expect("one per node"));
    let size = |i: usize| nodes[i].strength.norm();
    let whole: f64 = (0..nodes.len()).map(size).sum();
    let fraction = transfers.iter().map(|transfer| size(transfer.from)).sum::<f64>() / whole;
    Redistributed { nodes: remaining, removed: transfers.len() as u32, fraction, lost_impulse }
}

/// The transfers that keep the limit [`MAX_DISTANT_TRANSFER`] of every distant receiver. The smallest take
/// precedence, so that fringes are removed even where their body stays. Transfers from solids are not
/// limited.
fn limit_distant_transfers(nodes: &[Node], solid: &[bool], mut transfers: Vec<Transfer>) -> Vec<Transfer> {
    let size = |transfer: &Transfer| nodes[transfer.from].strength.norm();
    let mut order: Vec<usize> =
        (0..transfers.len()).filter(|&t| transfers[t].is_distant && !solid[transfers[t].from]).collect();
    order.sort_by(|&a, &b| size(&transfers[a]).total_cmp(&size(&transfers[b])).then(a.cmp(&b)));
    let mut received = BTreeMap::<u32, Vector3<f64>>::new();
    let mut rejected = vec![false; transfers.len()];
    for t in order {
        let receiver = transfers[t].receivers[0].0;
        let so_far = received.entry(receiver).or_default();
        let sum = *so_far + nodes[transfers[t].from].strength;
        rejected[t] = sum.norm() > MAX_DISTANT_TRANSFER * nodes[receiver as usize].strength.norm();
        if !rejected[t] {
            *so_far = sum;
        }
    }
    let mut rejected = rejected.into_iter();
    transfers.retain(|_| !rejected.next().expect("one per transfer"));
    transfers
}

/// The dominant node of a low-circulation node: the end of the chain of dominating nodes, each stronger than
/// the last.
fn dominant_node(dominating: &[Option<u32>], mut i: usize) -> u32 {
    while let Some(next) = dominating[i] {
        i = next as usize;
    }
    i as u32
}

/// The influence of a node at a distance.
#[derive(Clone, Copy, Debug)]
struct Influence {
    /// The strength of the node, reduced by the squared distance [m³/s].
    strength: f64,
    /// The index of the node.
    node: u32,
}

/// The largest influence in each brick.
struct InfluenceMap {
    bricks: Bricks,
    largest: Vec<Influence>,
}

impl InfluenceMap {
    /// The map of the nodes outside solids.
    fn new(nodes: &[Node], solid: &[bool]) -> Self {
        let brick = |node: &Node| node.at.map(|v| v.div_euclid(BRICK as i32));
        let of_nodes = nodes.iter().zip(0..).filter(|(_, i)| !solid[*i as usize]);
        let mut inside: Vec<([i32; 3], Influence)> = of_nodes
            .map(|(node, i)| (brick(node), Influence { strength: node.strength.norm(), node: i }))
            .collect();
        let bricks = Bricks::new(nodes.iter().map(brick).collect());
        let none = Influence { strength: -1.0, node: u32::MAX };
        let mut largest = vec![none; bricks.len()];
        for level in 0.. {
            let cubes = Bricks::new(inside.iter().map(|&(coord, _)| coord).collect());
            let mut in_cubes = vec![none; cubes.len()];
            for (coord, influence) in &inside {
                let cube = cubes.find(*coord).expect("every influence has its cube");
                raise(&mut in_cubes[cube], *influence);
            }
            let scale = 0.25_f64.powi(level); // 1/4^l
            par::update(&mut largest, |at, largest| {
                let own = bricks.coords()[at].map(|v| v >> level);
                for k in 0..27 {
                    let step = [k % 3, k / 3 % 3, k / 9];
                    if let Some(cube) = cubes.find(std::array::from_fn(|axis| own[axis] + step[axis] - 1)) {
                        let strength = in_cubes[cube].strength * scale;
                        raise(largest, Influence { strength, ..in_cubes[cube] });
                    }
                }
            });
            // The origin is a corner of cubes of every size, so up to eight cubes remain.
            if cubes.coords().iter().all(|&coord| touches_origin(coord)) {
                break;
            }
            inside = cubes.coords().iter().map(|coord| coord.map(|v| v >> 1)).zip(in_cubes).collect();
        }
        Self { bricks, largest }
    }

    fn at(&self, node: &Node) -> Influence {
        let brick = self.bricks.find(node.at.map(|v| v.div_euclid(BRICK as i32)));
        self.largest[brick.expect("every node is in a brick")]
    }
}

/// Whether a cube touches the origin, so that halving its coordinates does not change them.
fn touches_origin(coord: [i32; 3]) -> bool {
    coord.iter().all(|v| (-1..=0).contains(v))
}

/// Replaces `largest` by a larger influence.
fn raise(largest: &mut Influence, other: Influence) {
    if other.strength > largest.strength {
        *largest = other;
    }
}

/// The transfer of the strength of a node that is removed.
#[derive(Clone, Debug)]
struct Transfer {
    from: usize,
    /// The receivers, and the proportion in which they receive.
    receivers: Vec<(u32, f64)>,
    /// Whether the receiver is beyond [`MAX_RECEIVER_DISTANCE`].
    is_distant: bool,
}

impl Transfer {
    /// The receivers, and the share of each.
    fn shares(&self) -> impl Iterator<Item = (usize, f64)> {
        let whole: f64 = self.receivers.iter().map(|(_, part)| part).sum();
        self.receivers.iter().map(move |&(q, part)| (q as usize, part / whole))
    }
}

/// Restores the impulses that cubes have `lost` at the remaining nodes in them. Returns the size of what
/// could not be restored.
fn restore_impulse(
    nodes: &[Node],
    remains: impl Fn(usize) -> bool,
    mut lost: BTreeMap<[i32; 3], Vector3<f64>>,
    remaining: &mut [Node],
) -> f64 {
    let own = |node: &Node| node.at.map(|v| v.div_euclid(CUBE_NODES));
    // The origin is a corner of cubes of every size: in the end the up to eight largest make one.
    let last = (0..).find(|level| nodes.iter().all(|node| touches_origin(own(node).map(|v| v >> level))));
    let last = last.expect("shifted often enough every number is 0 or −1");
    for level in 0..=last + 1 {
        let cube = |coord: [i32; 3]| if level > last { [0; 3] } else { coord.map(|v| v >> level) };
        let mut cubes = BTreeMap::<[i32; 3], (Vector3<f64>, Vec<usize>)>::new();
        for (&coord, impulse) in &lost {
            cubes.entry(cube(coord)).or_default().0 += impulse;
        }
        for i in (0..nodes.len()).filter(|&i| remains(i)) {
            if let Some((_, members)) = cubes.get_mut(&cube(own(&nodes[i]))) {
                members.push(i);
            }
        }
        cubes.retain(|_, (impulse, members)| match changes_for_impulse(nodes, members, *impulse) {
            Some(changes) => {
                members.iter().zip(changes).for_each(|(&i, change)| remaining[i].strength += change);
                false
            }
            None => true,
        });
        lost.retain(|&coord, _| cubes.contains_key(&cube(coord)));
    }
    lost.values().sum::<Vector3<f64>>().norm()
}

/// The changes of the strengths of `members` that add `impulse` to Σ x × Γ and nothing to ΣΓ. `None` if the
/// nodes are nearly on a line, or if a strength would change by more than [`MAX_RELATIVE_CHANGE`].
fn changes_for_impulse(
    nodes: &[Node],
    members: &[usize],
    impulse: Vector3<f64>,
) -> Option<Vec<Vector3<f64>>> {
    let each = || members.iter().map(|&i| (nodes[i].position(), nodes[i].strength.norm()));
    let whole: f64 = each().map(|(_, size)| size).sum();
    let center = each().map(|(x, size)| x * size).sum::<Vector3<f64>>() / whole;
    // Σ r × |Γ| (a × r) = J a.
    let terms = each().map(|(x, size)| {
        let r = x - center;
        (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * size
    });
    let inertia: Matrix3<f64> = terms.sum();
    let rotation = inertia.cholesky()?.solve(&impulse);
    // Rounding may make a singular J pass, and nodes nearly on a line would have to rotate far.
    let is_exact = (inertia * rotation - impulse).norm() <= 1e-9 * impulse.norm();
    let is_small = each().all(|(x, _)| rotation.cross(&(x - center)).norm() <= MAX_RELATIVE_CHANGE);
    (is_exact && is_small).then(|| each().map(|(x, size)| rotation.cross(&(x - center)) * size).collect())
}

/// The receivers of the strength of node `i` among those of `index`, and their proportions; empty if none is
/// near.
fn receivers(nodes: &[Node], index: &NodeIndex, i: usize) -> Vec<(u32, f64)> {
    let within = |distance: i32| {
        let side = 2 * distance + 1;
        let steps = (0..side.pow(3)).map(move |k| [k % side, k / side % side, k / (side * side)]);
        let found = steps.filter_map(|step| {
            let q = index.find(std::array::from_fn(|axis| nodes[i].at[axis] + step[axis] - distance))?;
            Some((q, nodes[q as usize].strength.norm()))
        });
        found.collect::<Vec<_>>()
    };
    (1..=MAX_RECEIVER_DISTANCE).map(within).find(|found| !found.is_empty()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(at: &[[i32; 3]], strength: f64) -> Vec<Node> {
        at.iter().map(|&at| Node { at, strength: Vector3::new(strength, 0.5 * strength, 0.0) }).collect()
    }

    /// A block of 4³ nodes at `corner`.
    fn block(corner: [i32; 3], strength: f64) -> Vec<Node> {
        let at = |k: i32| [corner[0] + k % 4, corner[1] + k / 4 % 4, corner[2] + k / 16];
        nodes(&(0..64).map(at).collect::<Vec<_>>(), strength)
    }

    /// ΣΓ and Σ x × Γ.
    fn moments(nodes: &[Node]) -> [Vector3<f64>; 2] {
        [
            nodes.iter().map(|node| node.strength).sum(),
            nodes.iter().map(|node| node.position().cross(&node.strength)).sum(),
        ]
    }

    fn assert_moments_kept(now: &[Node], before: &[Node]) {
        for (now, before) in moments(now).iter().zip(moments(before)) {
            assert!((now - before).norm() < 1e-12 * before.norm(), "{now} {before}");
        }
    }

    #[test]
    fn redistribution_keeps_strength_and_impulse() {
        let mut all = block([0; 3], 1.0);
        // Two layers on the block; a node without receivers within reach, in a cube without others; and a
        // distant node.
        all.extend(&block([0, 0, 4], 1e-4)[..32]);
        all.extend(nodes(&[[-12, 0, 0], [100_000, 0, 0]], 1e-4));
        let Redistributed { nodes: remaining, removed, lost_impulse, fraction } =
            redistribute(all.clone(), 1e-3, |_| false);
        assert_eq!((remaining.len(), removed, lost_impulse), (65, 33, 0.0));
        assert!((fraction - 33e-4 / 64.0034).abs() < 1e-9, "{fraction}");
        assert_moments_kept(&remaining, &all);
        for (now, before) in remaining.iter().zip(&all).take(64) {
            assert!((now.strength - before.strength).norm() < 5e-3, "each changes a little");
        }
        assert_eq!(remaining[64].strength, all[97].strength, "the distant node is a separate body");
        assert_eq!(redistribute(all, 0.0, |_| false).nodes.len(), 98);
    }

    #[test]
    fn a_small_body_remains_where_the_influence_of_a_large_one_is_small() {
        for (distance, remains) in [(12, false), (100, true)] {
            let mut all = block([0; 3], 1.0);
            all.extend(block([distance, 0, 0], 1e-4));
            let found = redistribute(all.clone(), 1e-3, |_| false);
            assert_eq!(found.nodes.len(), if remains { 128 } else { 64 }, "{distance}");
            assert_moments_kept(&found.nodes, &all);
        }
    }

    #[test]
    fn one_dominant_node_does_not_absorb_a_broad_body() {
        // A body of 16³ nodes, and next to it one of 400 times their circulation, which dominates the nearer
        // half of them.
        let at = |k: i32| [k % 16, k / 16 % 16, k / 256];
        let body = nodes(&(0..4096).map(at).collect::<Vec<_>>(), 2.5e-3);
        let mut all = body.clone();
        all.extend(nodes(&[[-1, 8, 8]], 1.0));
        let remaining = redistribute(all.clone(), 3e-3, |_| false).nodes;
        assert_moments_kept(&remaining, &all);
        // Removed: the nodes within reach of the dominant one (7 × 7 × 3) and of the other half (3 × 16 ×
        // 16). Of the others of the nearer half, only as many as sum up to a twentieth of the dominant one:
        // 20 of 2.5e-3.
        let count = remaining.len();
        assert!((4097 - 147 - 768 - 20..4097 - 147 - 768 - 15).contains(&count), "{count}");
        assert!(remaining.iter().all(|node| node.strength.norm() < 2.0 * 1.25_f64.sqrt()));
        // Where strengths cancel, all of the nearer half is removed.
        for (k, node) in all.iter_mut().enumerate().take(4096) {
            node.strength *= if (k / 16 + k / 256) % 2 == 0 { 1.0 } else { -1.0 };
        }
        assert_eq!(redistribute(all, 3e-3, |_| false).nodes.len(), 1 + 2048);
    }

    #[test]
    fn nodes_inside_solids_transfer_their_strength_to_the_air() {
        let mut all = block([0; 3], 1.0);
        all.iter_mut().filter(|node| node.at[0] == 0).for_each(|node| node.strength *= 0.01);
        let found = redistribute(all.clone(), 0.0, |at| at[0] == 0);
        assert_eq!((found.nodes.len(), found.removed, found.lost_impulse), (48, 16, 0.0));
        assert!(found.nodes.iter().all(|node| node.at[0] > 0));
        assert_moments_kept(&found.nodes, &all);
        // Nodes inside a solid have no influence on the air next to it.
        let mut thin = block([0; 3], 1.0);
        thin.iter_mut().filter(|node| node.at[0] > 0).for_each(|node| node.strength *= 0.01);
        assert_eq!(redistribute(thin, 0.05, |at| at[0] == 0).nodes.len(), 48);
        // The impulse is too large to be restored: its loss is reported.
        let large = redistribute(block([0; 3], 1.0), 0.0, |at| at[0] == 0);
        assert!(large.nodes.len() == 48 && large.lost_impulse > 1.0);
        // Without receivers the nodes remain.
        let inside = redistribute(all, 0.0, |_| true);
        assert_eq!((inside.nodes.len(), inside.removed), (64, 0));
    }

    #[test]
    fn the_impulse_of_a_line_is_restored_around_it() {
        let mut all = nodes(&(0..16).map(|k| [k, 0, 0]).collect::<Vec<_>>(), 1.0);
        all.extend(nodes(&[[2, 0, 1]], 1e-6));
        let alone = redistribute(all.clone(), 1e-3, |_| false);
        // A line cannot rotate about itself: the impulse (0, 0, 1) × 1e-6 (1, ½, 0) is lost.
        assert_eq!((alone.nodes.len(), alone.removed), (16, 1));
        assert!((alone.lost_impulse - 1.25_f64.sqrt() * 1e-6).abs() < 1e-12, "{}", alone.lost_impulse);
        all.extend(block([20, 0, 0], 1.0));
        let both = redistribute(all.clone(), 1e-3, |_| false);
        assert_eq!((both.nodes.len(), both.removed, both.lost_impulse), (80, 1, 0.0));
        assert_moments_kept(&both.nodes, &all);
    }
}
