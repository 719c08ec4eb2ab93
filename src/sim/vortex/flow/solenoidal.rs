//! Solenoidal projection: removal of the divergence of strengths.
//!
//! *Why*: vorticity is a curl, so vortex lines do not end. Vortex stretching, external effects and removed
//! vortons create ends of vortex lines. The transpose form then converts the part with divergence into
//! energy, faster the finer it is, and eddies that stretch each other become unstable.
//!
//! *Method*: the divergence in a cell of eight nodes is the sum of the outward strengths of its corners, DΓ.
//! The smallest change that removes it is −Dᵀλ, where (D Dᵀ + ε²) λ = DΓ. ε screens scales longer than 1/ε
//! spacings, so that a line that ends on purpose, or at the edge of a body, is not removed from its end on.
//! The method of conjugate gradients solves this in about fifteen iterations. Only cells with all eight nodes
//! are included: their changes then conserve ΣΓ and Σ x × Γ. At a solid, corners inside count as nodes
//! without strength: no vortex line ends there either, otherwise vorticity along the solid becomes unstable.
//! There ΣΓ and Σ x × Γ do change.
//!
//! *Source*: none. Least squares replace the Poisson equation that [winckelmans93] proposes for the same
//! purpose, so that no vorticity appears at other nodes.
//!
//! Symbols: λ → `potential`, ε → [`SCREENING`].

use super::nodes::{Node, NodeIndex, center};
use crate::par;
use nalgebra::Vector3;

/// ε [1/spacings]. With 0.1 to 0.8, turbulence that would be unstable otherwise keeps its energy; 0.1 takes
/// three times as many iterations.
const SCREENING: f64 = 0.4;

/// The tolerance of the residual, relative to its start, as root mean squares.
const RESIDUAL_TOLERANCE: f64 = 1e-3;

/// Iterations at most: three times the usual number.
const MAX_ITERATIONS: usize = 50;

/// The index of a missing cell or node.
const NONE: u32 = u32::MAX;

/// The result of a projection.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Projection {
    /// The fraction of the strengths that was removed, 0..1, as root mean squares.
    pub(super) fraction: f64,
    /// The size of the change of Σ x × Γ, which cells at solids cause [spacings · m³/s].
    pub(super) impulse_change: f64,
    /// Whether the residual is above its tolerance after all iterations.
    pub(super) is_unconverged: bool,
}

/// Removes the divergence of the strengths of `nodes`, also in cells with corners inside solids.
pub(super) fn project(nodes: &mut [Node], is_solid: impl Fn([i32; 3]) -> bool + Sync) -> Projection {
    let cells = Cells::new(nodes, is_solid);
    let mut residual = cells.divergence(|i| nodes[i].strength);
    let first = squared_norm(&residual);
    let whole = par::sum(nodes.len(), |i| nodes[i].strength.norm_squared());
    if first == 0.0 || !whole.is_finite() {
        return Projection::default();
    }
    // Conjugate gradients: `direction` is the search direction.
    let (mut potential, mut direction) = (vec![0.0; residual.len()], residual.clone());
    let (mut last, mut is_unconverged) = (first, true);
    for _ in 0..MAX_ITERATIONS {
        let gradient = cells.gradient(&direction);
        let mut image = cells.divergence(|i| gradient[i]);
        par::update(&mut image, |c, image| *image += SCREENING * SCREENING * direction[c]);
        let step = last / par::sum(direction.len(), |c| direction[c] * image[c]);
        par::update(&mut potential, |c, potential| *potential += step * direction[c]);
        par::update(&mut residual, |c, residual| *residual -= step * image[c]);
        let now = squared_norm(&residual);
        if now <= RESIDUAL_TOLERANCE * RESIDUAL_TOLERANCE * first {
            is_unconverged = false;
            break;
        }
        par::update(&mut direction, |c, direction| *direction = residual[c] + now / last * *direction);
        last = now;
    }
    let change = cells.gradient(&potential);
    par::update(nodes, |i, node| node.strength -= change[i]);
    let fraction = (par::sum(change.len(), |i| change[i].norm_squared()) / whole).sqrt();
    // About the centre: ΣΓ changes at solids, and the lever arm must not depend on the origin of the world.
    let center = center(nodes);
    let impulse: Vector3<f64> =
        nodes.iter().zip(&change).map(|(node, change)| (node.position() - center).cross(change)).sum();
    Projection { fraction, impulse_change: impulse.norm(), is_unconverged }
}

fn squared_norm(values: &[f64]) -> f64 {
    par::sum(values.len(), |c| values[c] * values[c])
}

/// The cells all of whose corners are nodes or inside solids. Corner k of a cell is at (k & 1, k >> 1 & 1, k
/// >> 2).
struct Cells {
    /// The nodes at the corners, or [`NONE`].
    corners: Vec<[u32; 8]>,
    /// The cells of which each node is corner 0 … 7, or [`NONE`].
    of_node: Vec<[u32; 8]>,
}

impl Cells {
    fn new(nodes: &[Node], is_solid: impl Fn([i32; 3]) -> bool + Sync) -> Self {
        let index = NodeIndex::new(nodes, |_| true);
        let found = par::map_chunks(nodes.len(), par::CHUNK, |range| {
            // The cell of which node i is corner `own`, unless an earlier corner is a node, which then finds
            // the cell.
            let cell = |i: usize, own: usize| {
                let mut corners = [NONE; 8];
                for (k, corner) in corners.iter_mut().enumerate() {
                    let at = std::array::from_fn(|axis| {
                        nodes[i].at[axis] + (k >> axis & 1) as i32 - (own >> axis & 1) as i32
                    });
                    match index.find(at) {
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

    /// D: the divergence of the strengths of nodes in every cell.
    fn divergence(&self, strength: impl Fn(usize) -> Vector3<f64> + Sync) -> Vec<f64> {
        let mut sums = vec![0.0; self.corners.len()];
        par::fill(&mut sums, |cell| {
            let corners = self.corners[cell].iter().enumerate().filter(|(_, node)| **node != NONE);
            corners.map(|(k, &node)| outward(k).dot(&strength(node as usize))).sum()
        });
        sums
    }

    /// Dᵀ: minus the gradient of the potentials of cells at every node.
    fn gradient(&self, potential: &[f64]) -> Vec<Vector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.of_node.len()];
        par::fill(&mut sums, |node| {
            let cells = self.of_node[node].iter().enumerate().filter(|(_, cell)| **cell != NONE);
            cells.map(|(k, &cell)| outward(k) * potential[cell as usize]).sum()
        });
        sums
    }
}

/// The weights of corner k in the divergence of a cell: differences along an edge, the mean of four
/// [1/spacing].
fn outward(k: usize) -> Vector3<f64> {
    Vector3::from([k & 1, k >> 1 & 1, k >> 2].map(|upper| if upper == 1 { 0.25 } else { -0.25 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes in a cube of 16³ with strengths `f`.
    fn cube(f: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<Node> {
        let mut nodes: Vec<Node> = (0..4096)
            .map(|k| Node { at: [k % 16 - 8, k / 16 % 16 - 8, k / 256 - 8], strength: Vector3::zeros() })
            .collect();
        nodes.iter_mut().for_each(|node| node.strength = f(node.position()));
        nodes
    }

    fn rms(nodes: &[Node]) -> f64 {
        (nodes.iter().map(|node| node.strength.norm_squared()).sum::<f64>() / nodes.len() as f64).sqrt()
    }

    #[test]
    fn a_curl_is_kept_and_a_gradient_is_removed() {
        let gauss = |x: Vector3<f64>, width: f64| (-x.norm_squared() / (2.0 * width * width)).exp();
        let mut curl = cube(|x| Vector3::new(-x.y, x.x, 0.0) * gauss(x, 2.5));
        let before = curl.clone();
        let Projection { fraction, is_unconverged, .. } = project(&mut curl, |_| false);
        assert!(fraction < 0.01 && !is_unconverged);
        curl.iter_mut().zip(&before).for_each(|(now, before)| now.strength -= before.strength);
        assert!(rms(&curl) < 0.01 * rms(&before));
        // The gradient of a narrow Gaussian is removed, that of one as wide as the screening in part.
        for (width, low, high) in [(1.0, 0.1, 0.2), (3.0, 0.4, 0.55)] {
            let mut gradient = cube(|x| x * gauss(x, width));
            let before = rms(&gradient);
            project(&mut gradient, |_| false);
            let remaining = rms(&gradient) / before;
            assert!((low..high).contains(&remaining), "{width}: {remaining}");
        }
    }

    #[test]
    fn strength_and_impulse_are_conserved_without_solids() {
        let random = crate::math::Random::new([7, 0, 0]);
        let mut nodes = cube(|_| Vector3::zeros());
        nodes.iter_mut().zip(0..).for_each(|(node, i)| node.strength = random.vector(i).cast());
        let moments = |nodes: &[Node]| {
            let sum: Vector3<f64> = nodes.iter().map(|node| node.strength).sum();
            (sum, nodes.iter().map(|node| node.position().cross(&node.strength)).sum::<Vector3<f64>>())
        };
        let (before, size) = (moments(&nodes), nodes.iter().map(|node| node.strength.norm()).sum::<f64>());
        let Projection { fraction, impulse_change, .. } = project(&mut nodes, |_| false);
        assert!(fraction > 0.1 && impulse_change < 1e-11 * size);
        let after = moments(&nodes);
        assert!((after.0 - before.0).norm() < 1e-12 * size && (after.1 - before.1).norm() < 1e-11 * size);
    }

    #[test]
    fn the_impulse_change_at_a_solid_does_not_depend_on_the_origin() {
        // A solid at half of the face, so that the removed strength has a lever arm.
        let before = cube(|_| Vector3::x());
        let projected = |shift: i32| {
            let mut nodes = before.clone();
            nodes.iter_mut().for_each(|node| node.at[1] += shift);
            (project(&mut nodes, |at| at[0] < -8 && at[1] > shift).impulse_change, nodes)
        };
        let (near, nodes) = projected(0);
        let center = center(&nodes);
        let change = |(now, before): (&Node, &Node)| {
            (now.position() - center).cross(&(now.strength - before.strength))
        };
        let impulse: Vector3<f64> = nodes.iter().zip(&before).map(change).sum();
        assert!(near > 0.1 && (near - impulse.norm()).abs() < 1e-9 * near, "{near}");
        let (far, _) = projected(10_000);
        assert!((far - near).abs() < 1e-6 * near, "{far} {near}");
    }

    #[test]
    fn no_vortex_line_ends_at_a_solid() {
        // Lines normal to the face of a solid, which bounds the cube at x = −8.
        let normal = |_| Vector3::x();
        let (mut free, mut bounded) = (cube(normal), cube(normal));
        assert_eq!(project(&mut free, |_| false).fraction, 0.0);
        assert!(project(&mut bounded, |at| at[0] < -8).fraction > 0.1);
        let at_face = |node: &&Node| node.at[0] == -8 && node.at[1].abs() < 4 && node.at[2].abs() < 4;
        assert!(bounded.iter().filter(at_face).all(|node| node.strength.x < 0.5));
        assert!(
            bounded.iter().filter(|node| node.at[0] > 4).all(|node| (node.strength.x - 1.0).abs() < 0.02)
        );
    }

    #[test]
    fn nodes_without_cells_or_strength_are_not_changed() {
        assert_eq!(project(&mut [], |_| false), Projection::default());
        let mut alone = [Node { at: [0; 3], strength: Vector3::x() }];
        assert_eq!((project(&mut alone, |_| false).fraction, alone[0].strength), (0.0, Vector3::x()));
        let mut zero = cube(|_| Vector3::zeros());
        assert_eq!(project(&mut zero, |_| false), Projection::default());
    }
}
