//! Artificial pressure: repulsion of particles that are too close.
//!
//! *Method*: s_corr of [pbf] Eq. 13 in the sum of Eq. 14. *Departs from the paper*: there the term is part of every
//! iteration, so that its effect grows with their number and, as a displacement, with 1/Δt². Here it is an acceleration,
//! applied once a substep before the density solve: its effect per second depends neither on iterations nor on substeps, and
//! relative to gravity not on the spacing. The unit of s_corr is the λ that corrects C = 1 on the filled seeding lattice, over
//! τ² with τ = √(spacing/[`UNIT_ACCELERATION`]).
//!
//! Limits: explicit; a substep moves a particle by at most half a spacing, and shortened displacements are counted.

use super::{
    ArtificialPressure, Kernel,
    calibration::RestState,
    correction::limit,
    lanes::{self, Node},
    pair::{Pair, Poly6Spiky},
    pass::{self, NeighbourPass},
};
use crate::{math::Vec3, par, simd::Lanes, space::Neighbours};

/// Acceleration at strength 1 [m/s²]. With it, two particles half a spacing apart separate with about ten g at the paper's
/// k = 0.1. A tenth of it leaves an equality-constrained dam break clumping and gaining energy in every substep; ten times
/// as much boils.
const UNIT_ACCELERATION: f32 = 981.0;

/// Artificial pressure and its buffer.
#[derive(Debug)]
pub(super) struct Repulsion {
    params: ArtificialPressure,
    /// Displacement per Δt² for s_corr over its strength = 1 and a slope of 1 [m/s²].
    scale: f32,
    /// Displacements [m].
    push: Vec<Vec3>,
}

impl Repulsion {
    /// Artificial pressure for `rest`, measured with the paper's kernels regardless of the solver's.
    pub(super) fn new(params: ArtificialPressure, rest: &RestState) -> Self {
        let paper = RestState::new(Kernel::Poly6Spiky, rest.spacing, rest.support / rest.spacing);
        let lambda = params.strength * UNIT_ACCELERATION / paper.spacing / paper.rest_gradient2;
        Self { params, scale: lambda * paper.gradient_scale, push: Vec::new() }
    }

    /// Moves the predicted positions `p`, which are also in `nodes`, by the repulsion over `dt` [s]. Returns the number of
    /// shortened displacements.
    pub(super) fn apply(
        &mut self,
        rest: &RestState,
        lists: &Neighbours,
        nodes: &[Node],
        p: &mut [Vec3],
        dt: f32,
    ) -> u64 {
        self.push.resize(p.len(), Vec3::zeros());
        let inv_w_reference = 1.0 / (1.0 - self.params.reference.powi(2));
        let (power, scale) = (3 * self.params.exponent, self.scale * dt * dt);
        par::for_chunks(&mut self.push, par::CHUNK, |start, push| {
            pass::run(
                rest.kernel,
                RepulsionPass { lists, nodes, start, inv_w_reference, power, scale, push },
            );
        });
        let push = &self.push;
        let shortened = par::sum(p.len(), |i| f64::from(u8::from(limit(push[i], rest.spacing).1)));
        par::update(p, |i, x| *x += limit(push[i], rest.spacing).0);
        shortened as u64
    }
}

/// Displacements of a chunk of particles.
struct RepulsionPass<'a> {
    lists: &'a Neighbours,
    nodes: &'a [Node],
    start: usize,
    /// 1/W(|Δq|), before the power.
    inv_w_reference: f32,
    /// 3n, since W is a cube.
    power: u32,
    scale: f32,
    push: &'a mut [Vec3],
}

impl NeighbourPass for RepulsionPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        let inv_w = L::splat(self.inv_w_reference);
        for (offset, push) in self.push.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.nodes[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = self.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let (d, q2) = lanes::offset(own, lanes::gather::<L>(self.nodes, index));
                let w = (L::splat(1.0) - q2).positive_part() * inv_w;
                let s_corr = power(w, self.power); // s_corr over its strength, [pbf] Eq. 13
                sum = lanes::plus(sum, d, s_corr * Poly6Spiky::slope(q2.sqrt()));
            }
            *push = lanes::total(sum) * self.scale; // the last term of [pbf] Eq. 14, times Δt²/τ²
        }
    }
}

/// `base` raised to `exponent`, which is at least 1.
#[inline(always)]
fn power<L: Lanes>(base: L, exponent: u32) -> L {
    let (mut result, mut square, mut left) = (L::splat(1.0), base, exponent);
    while left > 0 {
        if left & 1 == 1 {
            result = result * square;
        }
        square = square * square;
        left >>= 1;
    }
    result
}
