//! Strengths without divergence.
//!
//! *Why*: vorticity is a curl, so vortex lines do not end. Stretching of vortons, what is pushed and what is cut off let them
//! end; the transpose form then turns the part that has divergence into energy, the faster the finer it is, and eddies that
//! stretch each other burst.
//!
//! *Method*: the divergence in a cell of eight nodes is the sum of its corners' outward strengths, DΓ. The least change with which it
//! is gone is −Dᵀλ, where (D Dᵀ + ε²) λ = DΓ; ε screens what is longer than 1/ε spacings, so that a line whose end is meant, or
//! was cut off by the edge of a body, is not taken apart from there. Conjugate gradients need some fifteen rounds for that.
//! Only cells with all eight nodes count: what each changes then adds nothing to ΣΓ and nothing to Σ x × Γ. At a solid, corners
//! inside it count as nodes without strength: no vortex line ends there either, or what lies along the solid bursts; there ΣΓ and
//! Σ x × Γ do change.
//!
//! *Source*: none; least squares in place of the Poisson equation that [winckelmans93] names for the same end, so that nothing spreads
//! beyond the nodes that are there.
//!
//! Symbols: λ → `potential`, ε → [`SCREEN`].

use super::nodes::{Node, Places, middle};
use crate::par;
use nalgebra::Vector3;

/// ε [1/spacings]. Turbulence that bursts otherwise keeps its energy with 0.1 to 0.8; 0.1 takes three times as many rounds.
const SCREEN: f64 = 0.4;

/// The part of the divergence that may be left by the equations, in the mean of squares.
const LEFT: f64 = 1e-3;

/// Rounds at most: three times what is needed.
const ROUNDS: usize = 50;

/// Stands for no cell, or no node.
const NONE: u32 = u32::MAX;

/// What taking divergence out did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Projected {
    /// Which part of the strengths it was, 0..1, in the mean of squares.
    pub(super) part: f64,
    /// The size of the change of Σ x × Γ, which cells beside solids make [spacings · m³/s].
    pub(super) turned: f64,
    /// Whether more than a thousandth of the divergence that can go is left after all rounds.
    pub(super) unsolved: bool,
}

/// Takes the divergence out of the strengths of `nodes`, beside solids where `is_solid` says so.
pub(super) fn project(nodes: &mut [Node], is_solid: impl Fn([i32; 3]) -> bool + Sync) -> Projected {
    let cells = Cells::new(nodes, is_solid);
    let mut residual = cells.divergence(|i| nodes[i].strength);
    let first = squares(&residual);
    let whole = par::sum(nodes.len(), |i| nodes[i].strength.norm_squared());
    if first == 0.0 || !whole.is_finite() {
        return Projected::default();
    }
    let (mut potential, mut way) = (vec![0.0; residual.len()], residual.clone());
    let (mut left, mut unsolved) = (first, true);
    for _ in 0..ROUNDS {
        let slope = cells.slope(&way);
        let mut image = cells.divergence(|i| slope[i]);
        par::update(&mut image, |c, image| *image += SCREEN * SCREEN * way[c]);
        let step = left / par::sum(way.len(), |c| way[c] * image[c]);
        par::update(&mut potential, |c, potential| *potential += step * way[c]);
        par::update(&mut residual, |c, residual| *residual -= step * image[c]);
        let now = squares(&residual);
        if now <= LEFT * LEFT * first {
            unsolved = false;
            break;
        }
        par::update(&mut way, |c, way| *way = residual[c] + now / left * *way);
        left = now;
    }
    let change = cells.slope(&potential);
    par::update(nodes, |i, node| node.strength -= change[i]);
    let part = (par::sum(change.len(), |i| change[i].norm_squared()) / whole).sqrt();
    // About their middle: beside solids ΣΓ changes, and its lever must not be the way to the world's origin.
    let middle = middle(nodes);
    let turned: Vector3<f64> =
        nodes.iter().zip(&change).map(|(node, change)| (node.place() - middle).cross(change)).sum();
    Projected { part, turned: turned.norm(), unsolved }
}

fn squares(values: &[f64]) -> f64 {
    par::sum(values.len(), |c| values[c] * values[c])
}

/// The cells all of whose corners are nodes or inside solids. Corner k of a cell is at (k & 1, k >> 1 & 1, k >> 2).
struct Cells {
    /// The nodes at the corners, or [`NONE`].
    corners: Vec<[u32; 8]>,
    /// The cells of which each node is corner 0 … 7, or [`NONE`].
    of_node: Vec<[u32; 8]>,
}

impl Cells {
    fn new(nodes: &[Node], is_solid: impl Fn([i32; 3]) -> bool + Sync) -> Self {
        let places = Places::new(nodes, |_| true);
        let found = par::map_chunks(nodes.len(), par::CHUNK, |range| {
            // The cell of which node i is corner `own`, unless a corner before that one is a node, whose cell it is then.
            let cell = |i: usize, own: usize| {
                let mut corners = [NONE; 8];
                for (k, corner) in corners.iter_mut().enumerate() {
                    let at = std::array::from_fn(|axis| {
                        nodes[i].at[axis] + (k >> axis & 1) as i32 - (own >> axis & 1) as i32
                    });
                    match places.find(at) {
                        Some(_) if k < own => return None,
                        Some(node) => *corner = node,
                        None if !is_solid(at) => return None,
                        None => {}
                    }
                }
                Some(corners)
            };
            range.flat_map(|i| (0..8).filter_map(move |own| cell(i, own))).collect::<Vec<_>>()
        });
        let corners = found.concat();
        let mut of_node = vec![[NONE; 8]; nodes.len()];
        for (cell, corners) in corners.iter().enumerate() {
            for (k, &node) in corners.iter().enumerate().filter(|(_, node)| **node != NONE) {
                of_node[node as usize][k] = cell as u32;
            }
        }
        Self { corners, of_node }
    }

    /// D: of strengths by node, the divergence of every cell.
    fn divergence(&self, strength: impl Fn(usize) -> Vector3<f64> + Sync) -> Vec<f64> {
        let mut sums = vec![0.0; self.corners.len()];
        par::fill(&mut sums, |cell| {
            let corners = self.corners[cell].iter().enumerate().filter(|(_, node)| **node != NONE);
            corners.map(|(k, &node)| outward(k).dot(&strength(node as usize))).sum()
        });
        sums
    }

    /// Dᵀ: of potentials by cell, minus their slope at every node.
    fn slope(&self, potential: &[f64]) -> Vec<Vector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.of_node.len()];
        par::fill(&mut sums, |node| {
            let cells = self.of_node[node].iter().enumerate().filter(|(_, cell)| **cell != NONE);
            cells.map(|(k, &cell)| outward(k) * potential[cell as usize]).sum()
        });
        sums
    }
}

/// The weights of corner k in the divergence of a cell: differences along an edge, the mean of four [1/spacing].
fn outward(k: usize) -> Vector3<f64> {
    Vector3::from([k & 1, k >> 1 & 1, k >> 2].map(|upper| if upper == 1 { 0.25 } else { -0.25 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes in a cube of 16³ with the strengths that `f` says.
    fn cube(f: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<Node> {
        let mut nodes: Vec<Node> = (0..4096)
            .map(|k| Node { at: [k % 16 - 8, k / 16 % 16 - 8, k / 256 - 8], strength: Vector3::zeros() })
            .collect();
        nodes.iter_mut().for_each(|node| node.strength = f(node.place()));
        nodes
    }

    fn rms(nodes: &[Node]) -> f64 {
        (nodes.iter().map(|node| node.strength.norm_squared()).sum::<f64>() / nodes.len() as f64).sqrt()
    }

    #[test]
    fn what_is_a_curl_stays_and_what_is_a_slope_goes() {
        let gauss = |x: Vector3<f64>, width: f64| (-x.norm_squared() / (2.0 * width * width)).exp();
        let mut turns = cube(|x| Vector3::new(-x.y, x.x, 0.0) * gauss(x, 2.5));
        let before = turns.clone();
        let Projected { part, unsolved, .. } = project(&mut turns, |_| false);
        assert!(part < 0.01 && !unsolved);
        turns.iter_mut().zip(&before).for_each(|(now, before)| now.strength -= before.strength);
        assert!(rms(&turns) < 0.01 * rms(&before));
        // Of the slope of a hill, what is narrow goes, what is as wide as the screen in part.
        for (width, least, most) in [(1.0, 0.1, 0.2), (3.0, 0.4, 0.55)] {
            let mut slope = cube(|x| x * gauss(x, width));
            let before = rms(&slope);
            project(&mut slope, |_| false);
            assert!((least..most).contains(&(rms(&slope) / before)), "{width}: {}", rms(&slope) / before);
        }
    }

    #[test]
    fn strength_and_impulse_stay() {
        let random = crate::math::Random::new([7, 0, 0]);
        let mut nodes = cube(|_| Vector3::zeros());
        nodes.iter_mut().zip(0..).for_each(|(node, i)| node.strength = random.vector(i).cast());
        let moments = |nodes: &[Node]| {
            let sum: Vector3<f64> = nodes.iter().map(|node| node.strength).sum();
            (sum, nodes.iter().map(|node| node.place().cross(&node.strength)).sum::<Vector3<f64>>())
        };
        let (before, size) = (moments(&nodes), nodes.iter().map(|node| node.strength.norm()).sum::<f64>());
        let Projected { part, turned, .. } = project(&mut nodes, |_| false);
        assert!(part > 0.1 && turned < 1e-11 * size);
        let after = moments(&nodes);
        assert!((after.0 - before.0).norm() < 1e-12 * size && (after.1 - before.1).norm() < 1e-11 * size);
    }

    #[test]
    fn what_a_solid_turns_is_about_the_middle_wherever_it_all_is() {
        // A solid beside half of the face, so that what it takes has a lever.
        let before = cube(|_| Vector3::x());
        let turned = |shift: i32| {
            let mut nodes = before.clone();
            nodes.iter_mut().for_each(|node| node.at[1] += shift);
            let turned = project(&mut nodes, |at| at[0] < -8 && at[1] > shift).turned;
            (turned, nodes)
        };
        let (here, nodes) = turned(0);
        let about = middle(&nodes);
        let changed =
            |(now, before): (&Node, &Node)| (now.place() - about).cross(&(now.strength - before.strength));
        let impulse: Vector3<f64> = nodes.iter().zip(&before).map(changed).sum();
        assert!(here > 0.1 && (here - impulse.norm()).abs() < 1e-9 * here, "{here}");
        let (far, _) = turned(10_000);
        assert!((far - here).abs() < 1e-6 * here, "{far} {here}");
    }

    #[test]
    fn at_a_solid_no_line_ends() {
        // Lines across the face of a solid, which ends the cube at x = −8.
        let across = |_| Vector3::x();
        let (mut free, mut beside) = (cube(across), cube(across));
        assert_eq!(project(&mut free, |_| false).part, 0.0);
        assert!(project(&mut beside, |at| at[0] < -8).part > 0.1);
        let at_face = |node: &&Node| node.at[0] == -8 && node.at[1].abs() < 4 && node.at[2].abs() < 4;
        assert!(beside.iter().filter(at_face).all(|node| node.strength.x < 0.5));
        assert!(beside.iter().filter(|node| node.at[0] > 4).all(|node| (node.strength.x - 1.0).abs() < 0.02));
    }

    #[test]
    fn nothing_to_do_is_nothing_done() {
        assert_eq!(project(&mut [], |_| false), Projected::default());
        let mut alone = [Node { at: [0; 3], strength: Vector3::x() }];
        assert_eq!((project(&mut alone, |_| false).part, alone[0].strength), (0.0, Vector3::x()));
        let mut still = cube(|_| Vector3::zeros());
        assert_eq!(project(&mut still, |_| false), Projected::default());
    }
}
