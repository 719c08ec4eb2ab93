//! Artificial pressure: particles that come too close repel each other.
//!
//! *Method*: s_corr of [pbf] Eq. 13 in the sum of Eq. 14. *Departs from the paper*: there the term joins every
//! iteration, so that its effect grows with their number and, as a displacement, with 1/Δt². Here it is an
//! acceleration, applied once a substep before the density solve: what it does in a second depends neither on
//! the iterations nor on the substeps, and relative to gravity not on the spacing either. s_corr is measured in
//! the λ that would undo C = 1 on the filled lattice, over τ² with τ = √(spacing/[`SCALE`]).
//!
//! Limits: explicit; a substep moves a particle by at most half a spacing, counted when it would be more.

use super::{
    ArtificialPressure, Kernel,
    correction::limit,
    lanes::{self, Node},
    pair::{Pair, Poly6Spiky},
    pass::{self, NeighbourPass},
    rest::Rest,
};
use crate::{math::Vec3, par, simd::Lanes, space::Neighbours};

/// Acceleration that stands for strength 1 [m/s²]. With it, two particles half a spacing apart part with about ten g
/// at the paper's k = 0.1. A tenth of it leaves an equality-constrained dam break clumping and gaining energy in
/// every substep; ten times as much boils.
const SCALE: f32 = 981.0;

/// The term and its buffer.
#[derive(Debug)]
pub(super) struct Repulsion {
    params: ArtificialPressure,
    /// Push per Δt² for s_corr over its strength = 1 and a slope of 1 [m/s²].
    scale: f32,
    /// Displacements [m].
    push: Vec<Vec3>,
}

impl Repulsion {
    /// The term for `rest`, measured with the paper's kernels whatever the solver's are.
    pub(super) fn new(params: ArtificialPressure, rest: &Rest) -> Self {
        let paper = Rest::new(Kernel::Poly6Spiky, rest.spacing, rest.support / rest.spacing);
        let lambda = params.strength * SCALE / paper.spacing / paper.lattice_gradient2;
        Self { params, scale: lambda * paper.gradient_scale, push: Vec::new() }
    }

    /// Moves the predicted positions `p`, which `nodes` hold too, apart for a substep of `dt` [s]; returns how many
    /// pushes were cut short.
    pub(super) fn apply(
        &mut self,
        rest: &Rest,
        lists: &Neighbours,
        nodes: &[Node],
        p: &mut [Vec3],
        dt: f32,
    ) -> u64 {
        self.push.resize(p.len(), Vec3::zeros());
        let inv_w_reference = 1.0 / (1.0 - self.params.reference.powi(2));
        let (power, scale) = (3 * self.params.exponent, self.scale * dt * dt);
        par::for_chunks(&mut self.push, par::CHUNK, |start, push| {
            pass::run(rest.kernel, Push { lists, nodes, start, inv_w_reference, power, scale, push });
        });
        let push = &self.push;
        let shortened = par::sum(p.len(), |i| f64::from(u8::from(limit(push[i], rest.spacing).1)));
        par::update(p, |i, x| *x += limit(push[i], rest.spacing).0);
        shortened as u64
    }
}

/// The pushes on a chunk of particles.
struct Push<'a> {
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

impl NeighbourPass for Push<'_> {
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

/// `base` to the `exponent`, at least 1.
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
