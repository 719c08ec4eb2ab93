//! Weak nodes hand their strength on.
//!
//! *Method*: a node is weak if what it moves is next to nothing beside what stronger ones move where it stands. Around a cube of
//! nodes 2^l bricks wide, the largest strength Γ' in it and in the 26 cubes beside it is felt by 1/4^l, as velocity falls with the
//! square of the distance; a node weaker than a given part of that, for any l, gives all it has to the nearest nodes that are
//! not, in proportion to theirs, or, where none is within three spacings, to the one that is felt. So the fringe that each
//! remeshing grows goes, and a small body of its own stays, even beside one that is far stronger. Where much that turns the
//! same way would come together in one node from far, it stays.
//!
//! What impulse strength loses on its way is given back to the nodes of the cube where it arrives, as a turn about their middle:
//! δΓ = |Γ| a × r, which adds nothing to ΣΓ. A cube whose nodes cannot take it leaves it to the cube around it, of twice the edge.
//!
//! *Source*: none; particle methods drop what is below a part of the largest vorticity, and what that loses with it.

use super::nodes::{Node, Places};
use crate::{
    grid::{BRICK, Bricks},
    par,
};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// How far neighbours are at most [spacings]; nearer ones are asked first. M4′ widens a body by two.
const REACH: i32 = 3;

/// Nodes along the edge of the cubes that impulse is first given back to. Smaller, and more of them cannot take it and leave it to
/// the next larger; larger, and what is far apart shares: a stray's lever would be all there is. Little hangs on it: with 4 the draft
/// ring keeps 0.15 % more energy over 36 frames and 80 lattices, and its impulse drifts by 0.08 % instead of 0.07 %; 64 is as 16;
/// nothing is lost with any.
const CUBE: i32 = 16;

/// The most that a strength may change by giving impulse back, of itself. Smaller, and more impulse finds no taker and is lost; larger,
/// and few vortons swirl for what many had. Bodies change by less than a thousandth: on the draft ring, over 80 lattices, 0.001 loses
/// nothing either, and the energy differs by 0.01 %.
const MOST_CHANGE: f64 = 0.05;

/// The most that may come to a node from beyond [`REACH`], as a vector and of itself. Fringes cancel; a broad weak body does not, and
/// larger lets one strong node swallow it.
const MOST_TAKEN: f64 = 0.05;

/// The nodes that are left.
#[derive(Debug)]
pub(super) struct Thinned {
    pub(super) nodes: Vec<Node>,
    /// Nodes that went.
    pub(super) dropped: u32,
    /// What they had, of Σ|Γ|, 0..1.
    pub(super) handed: f64,
    /// The impulse Σ x × Γ that nobody could take back, its size [spacings · m³/s].
    pub(super) lost: f64,
}

/// Drops the nodes that are weaker than `part` of what is felt where they stand, and those where `is_solid` says that there is no
/// air. The latter stay if nobody is near to take what they have.
pub(super) fn hand_on(nodes: Vec<Node>, part: f64, is_solid: impl Fn([i32; 3]) -> bool + Sync) -> Thinned {
    let mut solid = vec![false; nodes.len()];
    par::fill(&mut solid, |i| is_solid(nodes[i].at));
    let felt = Felt::new(&nodes, &solid);
    let mut above = vec![None; nodes.len()];
    par::fill(&mut above, |i| {
        let peak = felt.at(&nodes[i]);
        (nodes[i].strength.norm() < part * peak.strength).then_some(peak.node)
    });
    let is_strong = |i: usize| above[i].is_none() && !solid[i];
    if (0..nodes.len()).all(is_strong) {
        return Thinned { nodes, dropped: 0, handed: 0.0, lost: 0.0 };
    }

    // Everyone gives at once what it had at first.
    let strong = Places::new(&nodes, is_strong);
    let gifts = par::map_chunks(nodes.len(), par::CHUNK, |range| {
        let given = range.filter(|&i| !is_strong(i)).filter_map(|i| match takers(&nodes, &strong, i) {
            none if none.is_empty() => {
                let chief = chief(&above, i);
                is_strong(chief as usize).then(|| Gift { from: i, takers: vec![(chief, 1.0)], is_far: true })
            }
            takers => Some(Gift { from: i, takers, is_far: false }),
        });
        given.collect::<Vec<_>>()
    });
    let gifts = bearable(&nodes, &solid, gifts.concat());
    let (mut left, mut gone) = (nodes.clone(), vec![false; nodes.len()]);
    let mut debts = BTreeMap::<[i32; 3], Vector3<f64>>::new();
    for gift in &gifts {
        let from = &nodes[gift.from];
        gone[gift.from] = true;
        for (taker, share) in gift.shares() {
            let strength = from.strength * share;
            left[taker].strength += strength;
            let lost = (from.place() - nodes[taker].place()).cross(&strength);
            *debts.entry(nodes[taker].at.map(|v| v.div_euclid(CUBE))).or_default() += lost;
        }
    }
    let lost = give_back(&nodes, |i| !gone[i] && !solid[i], debts, &mut left);
    let mut is_gone = gone.iter();
    left.retain(|_| !is_gone.next().expect("one a node"));
    let size = |i: usize| nodes[i].strength.norm();
    let whole: f64 = (0..nodes.len()).map(size).sum();
    let handed = gifts.iter().map(|gift| size(gift.from)).sum::<f64>() / whole;
    Thinned { nodes: left, dropped: gifts.len() as u32, handed, lost }
}

/// Those gifts that do not change one that takes from far by more than [`MOST_TAKEN`]: the smallest first, so that fringes go even
/// where what they grow on stays. What is in solids must go.
fn bearable(nodes: &[Node], solid: &[bool], mut gifts: Vec<Gift>) -> Vec<Gift> {
    let size = |gift: &Gift| nodes[gift.from].strength.norm();
    let mut order: Vec<usize> =
        (0..gifts.len()).filter(|&g| gifts[g].is_far && !solid[gifts[g].from]).collect();
    order.sort_by(|&a, &b| size(&gifts[a]).total_cmp(&size(&gifts[b])).then(a.cmp(&b)));
    let mut come = BTreeMap::<u32, Vector3<f64>>::new();
    let mut refused = vec![false; gifts.len()];
    for g in order {
        let taker = gifts[g].takers[0].0;
        let so_far = come.entry(taker).or_default();
        let then = *so_far + nodes[gifts[g].from].strength;
        refused[g] = then.norm() > MOST_TAKEN * nodes[taker as usize].strength.norm();
        if !refused[g] {
            *so_far = then;
        }
    }
    let mut refused = refused.into_iter();
    gifts.retain(|_| !refused.next().expect("one a gift"));
    gifts
}

/// The first of those above a weak node that is not weak itself; each is stronger than the one below.
fn chief(above: &[Option<u32>], mut i: usize) -> u32 {
    while let Some(next) = above[i] {
        i = next as usize;
    }
    i as u32
}

/// What stronger nodes are felt by.
#[derive(Clone, Copy, Debug)]
struct Peak {
    /// Its strength, by how far it is [m³/s].
    strength: f64,
    /// Who it is.
    node: u32,
}

/// The strongest that is felt in each brick.
struct Felt {
    bricks: Bricks,
    peaks: Vec<Peak>,
}

impl Felt {
    /// Of what is in the air: what is in solids goes.
    fn new(nodes: &[Node], solid: &[bool]) -> Self {
        let brick = |node: &Node| node.at.map(|v| v.div_euclid(BRICK as i32));
        let of_nodes = nodes.iter().zip(0..).filter(|(_, i)| !solid[*i as usize]);
        let mut inside: Vec<([i32; 3], Peak)> = of_nodes
            .map(|(node, i)| (brick(node), Peak { strength: node.strength.norm(), node: i }))
            .collect();
        let bricks = Bricks::new(nodes.iter().map(brick).collect());
        let mut peaks = vec![Peak { strength: -1.0, node: u32::MAX }; bricks.len()];
        for level in 0.. {
            let cubes = Bricks::new(inside.iter().map(|&(coord, _)| coord).collect());
            let mut largest = vec![Peak { strength: -1.0, node: u32::MAX }; cubes.len()];
            for (coord, peak) in &inside {
                larger(&mut largest[cubes.find(*coord).expect("it was put there")], *peak);
            }
            let scale = 0.25_f64.powi(level); // 1/4^l
            par::update(&mut peaks, |at, most| {
                let own = bricks.coords()[at].map(|v| v >> level);
                for k in 0..27 {
                    let step = [k % 3, k / 3 % 3, k / 9];
                    if let Some(cube) = cubes.find(std::array::from_fn(|axis| own[axis] + step[axis] - 1)) {
                        larger(most, Peak { strength: largest[cube].strength * scale, ..largest[cube] });
                    }
                }
            });
            // The origin is a corner of cubes of every size, so up to eight are left.
            if cubes.coords().iter().all(|&coord| is_last(coord)) {
                break;
            }
            inside = cubes.coords().iter().map(|coord| coord.map(|v| v >> 1)).zip(largest).collect();
        }
        Self { bricks, peaks }
    }

    fn at(&self, node: &Node) -> Peak {
        let brick = self.bricks.find(node.at.map(|v| v.div_euclid(BRICK as i32)));
        self.peaks[brick.expect("every node is in a brick")]
    }
}

/// Whether a cube touches the origin, so that it stays where it is when it grows.
fn is_last(coord: [i32; 3]) -> bool {
    coord.iter().all(|v| (-1..=0).contains(v))
}

/// Replaces `most` by a larger one.
fn larger(most: &mut Peak, other: Peak) {
    if other.strength > most.strength {
        *most = other;
    }
}

/// What a weak node gives.
#[derive(Clone, Debug)]
struct Gift {
    from: usize,
    /// Who takes it, and in which proportion.
    takers: Vec<(u32, f64)>,
    /// Whether that is one beyond [`REACH`].
    is_far: bool,
}

impl Gift {
    /// Who takes which part of it.
    fn shares(&self) -> impl Iterator<Item = (usize, f64)> {
        let whole: f64 = self.takers.iter().map(|(_, part)| part).sum();
        self.takers.iter().map(move |&(q, part)| (q as usize, part / whole))
    }
}

/// Gives the impulses that cubes lost back to those in them who stay, and returns what could not be.
fn give_back(
    nodes: &[Node],
    stays: impl Fn(usize) -> bool,
    mut debts: BTreeMap<[i32; 3], Vector3<f64>>,
    left: &mut [Node],
) -> f64 {
    let own = |node: &Node| node.at.map(|v| v.div_euclid(CUBE));
    // The origin is a corner of cubes of every size: the up to eight largest make one in the end.
    let largest = (0..).find(|level| nodes.iter().all(|node| is_last(own(node).map(|v| v >> level))));
    let largest = largest.expect("shifted often enough every number is 0 or −1");
    for level in 0..=largest + 1 {
        let around = |coord: [i32; 3]| if level > largest { [0; 3] } else { coord.map(|v| v >> level) };
        let mut owed = BTreeMap::<[i32; 3], (Vector3<f64>, Vec<usize>)>::new();
        for (&coord, impulse) in &debts {
            owed.entry(around(coord)).or_default().0 += impulse;
        }
        for i in (0..nodes.len()).filter(|&i| stays(i)) {
            if let Some((_, members)) = owed.get_mut(&around(own(&nodes[i]))) {
                members.push(i);
            }
        }
        owed.retain(|_, (impulse, members)| match turned(nodes, members, *impulse) {
            Some(changes) => {
                members.iter().zip(changes).for_each(|(&i, change)| left[i].strength += change);
                false
            }
            None => true,
        });
        debts.retain(|&coord, _| owed.contains_key(&around(coord)));
    }
    debts.values().sum::<Vector3<f64>>().norm()
}

/// What to add to the strengths of `members` so that Σ x × Γ grows by `impulse` and ΣΓ by nothing; `None` if they lie too near
/// a line, or would have to change by more than [`MOST_CHANGE`].
fn turned(nodes: &[Node], members: &[usize], impulse: Vector3<f64>) -> Option<Vec<Vector3<f64>>> {
    let each = || members.iter().map(|&i| (nodes[i].place(), nodes[i].strength.norm()));
    let whole: f64 = each().map(|(_, size)| size).sum();
    let middle = each().map(|(x, size)| x * size).sum::<Vector3<f64>>() / whole;
    // Σ r × |Γ| (a × r) = J a.
    let parts = each().map(|(x, size)| {
        let r = x - middle;
        (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * size
    });
    let inertia: Matrix3<f64> = parts.sum();
    let turn = inertia.cholesky()?.solve(&impulse);
    // Rounding may let a singular J through, and nearly a line would have to turn far.
    let exact = (inertia * turn - impulse).norm() <= 1e-9 * impulse.norm();
    let little = each().all(|(x, _)| turn.cross(&(x - middle)).norm() <= MOST_CHANGE);
    (exact && little).then(|| each().map(|(x, size)| turn.cross(&(x - middle)) * size).collect())
}

/// Who of `strong` takes the strength of a node, and in which proportion; nobody if none is near.
fn takers(nodes: &[Node], strong: &Places, i: usize) -> Vec<(u32, f64)> {
    let within = |reach: i32| {
        let side = 2 * reach + 1;
        let steps = (0..side.pow(3)).map(move |k| [k % side, k / side % side, k / (side * side)]);
        let found = steps.filter_map(|step| {
            let q = strong.find(std::array::from_fn(|axis| nodes[i].at[axis] + step[axis] - reach))?;
            Some((q, nodes[q as usize].strength.norm()))
        });
        found.collect::<Vec<_>>()
    };
    (1..=REACH).map(within).find(|found| !found.is_empty()).unwrap_or_default()
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
            nodes.iter().map(|node| node.place().cross(&node.strength)).sum(),
        ]
    }

    fn assert_kept(left: &[Node], all: &[Node]) {
        for (now, before) in moments(left).iter().zip(moments(all)) {
            assert!((now - before).norm() < 1e-12 * before.norm(), "{now} {before}");
        }
    }

    #[test]
    fn what_goes_leaves_strength_and_impulse() {
        let mut all = block([0; 3], 1.0);
        // Two layers on it; a node beyond their reach, in a cube without a strong one; and one that is far away.
        all.extend(&block([0, 0, 4], 1e-4)[..32]);
        all.extend(nodes(&[[-12, 0, 0], [100_000, 0, 0]], 1e-4));
        let Thinned { nodes: left, dropped, lost, handed } = hand_on(all.clone(), 1e-3, |_| false);
        assert_eq!((left.len(), dropped, lost), (65, 33, 0.0));
        assert!((handed - 33e-4 / 64.0034).abs() < 1e-9, "{handed}");
        assert_kept(&left, &all);
        for (now, before) in left.iter().zip(&all).take(64) {
            assert!((now.strength - before.strength).norm() < 5e-3, "a little each");
        }
        assert_eq!(left[64].strength, all[97].strength, "what is far away is a body of its own");
        assert_eq!(hand_on(all, 0.0, |_| false).nodes.len(), 98);
    }

    #[test]
    fn a_small_body_stays_where_a_strong_one_is_hardly_felt() {
        for (distance, stays) in [(12, false), (100, true)] {
            let mut all = block([0; 3], 1.0);
            all.extend(block([distance, 0, 0], 1e-4));
            let thinned = hand_on(all.clone(), 1e-3, |_| false);
            assert_eq!(thinned.nodes.len(), if stays { 128 } else { 64 }, "{distance}");
            assert_kept(&thinned.nodes, &all);
        }
    }

    #[test]
    fn one_strong_node_does_not_swallow_what_is_broad() {
        // A field of 16³ nodes and beside it one that is 400 times as strong, which makes the nearer half of them weak.
        let at = |k: i32| [k % 16, k / 16 % 16, k / 256];
        let field = nodes(&(0..4096).map(at).collect::<Vec<_>>(), 2.5e-3);
        let mut all = field.clone();
        all.extend(nodes(&[[-1, 8, 8]], 1.0));
        let Thinned { nodes: left, .. } = hand_on(all.clone(), 3e-3, |_| false);
        assert_kept(&left, &all);
        // Those within reach of it go (7 × 7 × 3), and of the half that is not weak (3 × 16 × 16); not the rest of the weak half,
        // but as many of it as make a twentieth of the strong one: 20 of 2.5e-3.
        assert!((4097 - 147 - 768 - 20..4097 - 147 - 768 - 15).contains(&left.len()), "{}", left.len());
        assert!(left.iter().all(|node| node.strength.norm() < 2.0 * 1.25_f64.sqrt()));
        // Where they cancel, all of that half goes.
        for (k, node) in all.iter_mut().enumerate().take(4096) {
            node.strength *= if (k / 16 + k / 256) % 2 == 0 { 1.0 } else { -1.0 };
        }
        assert_eq!(hand_on(all, 3e-3, |_| false).nodes.len(), 1 + 2048);
    }

    #[test]
    fn what_is_in_a_solid_comes_out() {
        let mut all = block([0; 3], 1.0);
        all.iter_mut().filter(|node| node.at[0] == 0).for_each(|node| node.strength *= 0.01);
        let left = hand_on(all.clone(), 0.0, |at| at[0] == 0);
        assert_eq!((left.nodes.len(), left.dropped, left.lost), (48, 16, 0.0));
        assert!(left.nodes.iter().all(|node| node.at[0] > 0));
        assert_kept(&left.nodes, &all);
        // What is strong in there does not make the air beside it weak.
        let mut thin = block([0; 3], 1.0);
        thin.iter_mut().filter(|node| node.at[0] > 0).for_each(|node| node.strength *= 0.01);
        assert_eq!(hand_on(thin, 0.05, |at| at[0] == 0).nodes.len(), 48);
        // Too much for them to take: the impulse is lost, and said.
        let much = hand_on(block([0; 3], 1.0), 0.0, |at| at[0] == 0);
        assert!(much.nodes.len() == 48 && much.lost > 1.0);
        // Nobody is near: it stays, to be put out.
        let within = hand_on(all, 0.0, |_| true);
        assert_eq!((within.nodes.len(), within.dropped), (64, 0));
    }

    #[test]
    fn a_line_leaves_its_impulse_to_what_is_around() {
        let mut all = nodes(&(0..16).map(|k| [k, 0, 0]).collect::<Vec<_>>(), 1.0);
        all.extend(nodes(&[[2, 0, 1]], 1e-6));
        let alone = hand_on(all.clone(), 1e-3, |_| false);
        // A line takes no turn about itself: the impulse (0, 0, 1) × 1e-6 (1, ½, 0) has lost its way.
        assert_eq!((alone.nodes.len(), alone.dropped), (16, 1));
        assert!((alone.lost - 1.25_f64.sqrt() * 1e-6).abs() < 1e-12, "{}", alone.lost);
        all.extend(block([20, 0, 0], 1.0));
        let both = hand_on(all.clone(), 1e-3, |_| false);
        assert_eq!((both.nodes.len(), both.dropped, both.lost), (80, 1, 0.0));
        assert_kept(&both.nodes, &all);
    }
}
