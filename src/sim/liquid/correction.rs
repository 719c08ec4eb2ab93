//! Position corrections Δp and collisions with the solids, eight particles at a time.
//!
//! *Method*: [pbf] Eq. 12 and Algorithm 1, lines 14 and 17. *Departs from the paper*: a correction is at most half a
//! spacing, and every shortened one is counted. Coincident particles are separated along a direction derived from their
//! indices, since no gradient separates them. Directions between particles may be those of earlier positions than x*
//! (docs/decisions/022), which the neighbour sums then have; those of solids, which are at their poses at the end of the
//! substep, and of images in rigid bodies are at x*.

use super::{density::Chunk, images::PairSample, lanes, pair::Pair, pass::NeighbourPass};
use crate::{
    math::Vec3,
    par,
    simd::{LANES, Lanes},
};

/// Largest correction of one iteration, in spacings: beyond it the linearised constraint and the lists are invalid. 0.1
/// slows the stop of a block that hits a floor; 1 lets it throw particles through their neighbours.
const MAX_CORRECTION: f32 = 0.5;

/// Result of the corrections of a chunk.
#[derive(Clone, Copy, Default)]
pub(super) struct CorrectionSummary {
    /// Largest squared displacement since the lists were built [m²].
    pub(super) farthest2: f32,
    pub(super) shortened: u64,
    /// Particles still in contact with a solid after the last iteration.
    pub(super) unresolved_contacts: u64,
    /// Work of moving solids, by mass over dt² [m²].
    pub(super) work: f64,
}

/// Correction of a chunk of particles.
pub(super) struct CorrectionPass<'a> {
    pub(super) at: Chunk<'a>,
    pub(super) p: &'a mut [Vec3],
    pub(super) built_at: &'a [Vec3],
    /// Sums of the displacements by solids [m]; empty unless a solid has friction or restitution.
    pub(super) wall_push: &'a mut [Vec3],
    /// Projections by solids [m]; empty without rigid bodies.
    pub(super) projection: &'a mut [Vec3],
}

impl NeighbourPass for CorrectionPass<'_> {
    type Out = CorrectionSummary;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> CorrectionSummary {
        let (mut total, setup) = (CorrectionSummary::default(), self.at.setup);
        let has_moving_solids = setup.walls.has_moving_solids();
        self.projection.fill(Vec3::zeros());
        let blocks = self.p.chunks_mut(LANES).zip(self.built_at.chunks(LANES)).enumerate();
        for (block, (p, built_at)) in blocks {
            let first = self.at.start + block * LANES;
            let Corrections { deltas, by_solids } = corrections::<L, P>(&self.at, first, p);
            for (k, (x, built_at)) in p.iter_mut().zip(built_at).enumerate() {
                let i = first + k;
                let (delta, short) = limit(deltas[k], setup.rest.spacing);
                let mut moved = *x + delta; // x* + Δp, [pbf] Alg. 1, line 17
                let mut displacement2 = (moved - built_at).norm_squared();
                let may_touch = setup.is_near_solid(self.at.clearance[i], displacement2)
                    && !self.at.samples.excludes_contact(i, setup, delta.norm(), displacement2);
                if may_touch {
                    let (free, touching) = self.at.samples.collide(i, [*x, moved], setup.walls); // [pbf] Alg. 1, line 14
                    if has_moving_solids {
                        total.work += setup.walls.work(moved, free);
                    }
                    if let Some(push) = self.wall_push.get_mut(block * LANES + k) {
                        *push += free - moved;
                    }
                    if let Some(projection) = self.projection.get_mut(block * LANES + k) {
                        *projection = free - moved;
                    }
                    moved = free;
                    displacement2 = (moved - built_at).norm_squared();
                    total.unresolved_contacts += u64::from(touching);
                }
                if has_moving_solids {
                    total.work += setup.walls.pressure_work(*x, self.at.nodes[i].value());
                }
                if let Some(push) = self.wall_push.get_mut(block * LANES + k) {
                    *push += by_solids[k];
                }
                *x = moved;
                total.farthest2 = total.farthest2.max(displacement2);
                total.shortened += u64::from(short);
            }
        }
        total
    }
}

/// Corrections of eight particles [m].
struct Corrections {
    /// Δp.
    deltas: [Vec3; LANES],
    /// The part that solids take up: of their density, and of images in rigid bodies.
    by_solids: [Vec3; LANES],
}

/// Δp of up to eight particles with consecutive indices from `first`, whose positions are `p`.
#[inline(always)]
fn corrections<L: Lanes, P: Pair>(at: &Chunk<'_>, first: usize, p: &[Vec3]) -> Corrections {
    let zero = L::splat(0.0);
    let (mut delta, mut coincident) = ([[zero; LANES]; 3], [zero; LANES]);
    let mut padded = [0.0; LANES];
    for k in 0..p.len() {
        let i = first + k;
        let own = lanes::spread::<L>(at.nodes[i]);
        let mut neighbours = at.lists.rows::<L>(i);
        padded[k] = neighbours.padding() as f32;
        let (mut sum, mut in_one_place) = ([zero; 3], zero);
        while let Some(index) = neighbours.next() {
            let other = lanes::gather::<L>(at.nodes, index);
            let (d, q2) = lanes::offset(own, other);
            let weight = (own[3] + other[3]) * P::slope(q2.sqrt());
            sum = lanes::plus(sum, d, weight);
            in_one_place += q2.zero_indicator();
        }
        coincident[k] = in_one_place;
        [delta[0][k], delta[1][k], delta[2][k]] = sum;
    }
    let [x, y, z] = [L::sums(&delta[0]), L::sums(&delta[1]), L::sums(&delta[2])];
    let coincident = L::sums(&coincident);
    let scale = at.setup.rest.gradient_scale;
    let (mut deltas, mut by_solids) = ([Vec3::zeros(); LANES], [Vec3::zeros(); LANES]);
    for k in 0..p.len() {
        let i = first + k;
        let mut sum = -Vec3::new(x[k], y[k], z[k]);
        if coincident[k] > padded[k] {
            sum += coincident_sum(at, i);
        }
        deltas[k] = sum * scale; // Δp_i, [pbf] Eq. 12
        let lambda = at.nodes[i].value();
        if lambda != 0.0 {
            by_solids[k] = at.boundary_density(i, p[k]).1 * lambda;
            deltas[k] += by_solids[k];
        }
        for PairSample { push, .. } in at.samples.of(i) {
            deltas[k] += push.by_neighbours + push.by_body;
            by_solids[k] += push.by_body;
        }
    }
    Corrections { deltas, by_solids }
}

/// Contribution of coincident neighbours to the sum of [`corrections`].
#[cold]
fn coincident_sum(at: &Chunk<'_>, i: usize) -> Vec3 {
    let own = at.nodes[i];
    let mut sum = Vec3::zeros();
    for &j in at.lists.of(i) {
        let other = at.nodes[j as usize];
        let d = own.vector() - other.vector();
        if d.norm_squared() == 0.0 {
            sum -= separation_direction(i as u32, j) * (own.value() + other.value());
        }
    }
    sum
}

/// Unit direction in which particle `i` separates from a coincident `j`; opposite for the other of the pair.
fn separation_direction(i: u32, j: u32) -> Vec3 {
    let (low, high) = (i.min(j), i.max(j));
    let mut bits = (u64::from(low) << 32 | u64::from(high)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits ^= bits >> 29;
    bits = bits.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let part = |shift: u32| ((bits >> shift & 0xffff) as f32 + 0.5) / 32768.0 - 1.0;
    let direction = Vec3::new(part(0), part(16), part(32)).normalize();
    if i < j { direction } else { -direction }
}

/// `delta` shortened to at most [`MAX_CORRECTION`], and whether it was longer.
#[inline]
pub(super) fn limit(delta: Vec3, spacing: f32) -> (Vec3, bool) {
    let longest = MAX_CORRECTION * spacing;
    let length2 = delta.norm_squared();
    if length2 > longest * longest { (delta * (longest / length2.sqrt()), true) } else { (delta, false) }
}

/// Runs `job` over chunks of positions, with those of the displacements by solids where these are needed: `projection` needs
/// `wall_push`.
pub(super) fn map_columns<T: Send>(
    p: &mut [Vec3],
    wall_push: &mut [Vec3],
    projection: &mut [Vec3],
    job: impl Fn(usize, &mut [Vec3], &mut [Vec3], &mut [Vec3]) -> T + Sync,
) -> Vec<T> {
    match (wall_push.is_empty(), projection.is_empty()) {
        (true, true) => par::map_chunks_mut([p], par::CHUNK, |start, [p]| job(start, p, &mut [], &mut [])),
        (false, true) => {
            par::map_chunks_mut([p, wall_push], par::CHUNK, |start, [p, push]| job(start, p, push, &mut []))
        }
        (true, false) => par::map_chunks_mut([p, projection], par::CHUNK, |start, [p, projection]| {
            job(start, p, &mut [], projection)
        }),
        (false, false) => {
            par::map_chunks_mut([p, wall_push, projection], par::CHUNK, |start, [p, push, projection]| {
                job(start, p, push, projection)
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coincident_particles_separate_in_opposite_directions() {
        assert_eq!(separation_direction(3, 8), -separation_direction(8, 3));
        assert!((separation_direction(0, 1).norm() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn long_corrections_are_shortened_and_reported() {
        let (delta, short) = limit(Vec3::new(3.0, 4.0, 0.0), 1.0);
        assert!(short && (delta.norm() - 0.5).abs() < 1e-6);
        assert_eq!(limit(Vec3::new(0.3, 0.0, 0.0), 1.0), (Vec3::new(0.3, 0.0, 0.0), false));
    }
}
