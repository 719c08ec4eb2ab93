//! What the liquid emits: the potentials of trapped air, wave crests and kinetic energy.
//!
//! *Method*: [ihmsen12] Eqs. 2–7 with W = 1 − r/h: trapped air Σ (|v_ij| − v_ij · x̂_ij) W, wave crests Σ (1 − n̂_i · n̂_j) W over
//! neighbours below the tangent plane of a particle that moves outwards, kinetic energy ½ v². Each potential is clamped to [0, 1] by
//! Φ(I, a, b) = (min(I, b) − min(I, a))/(b − a).
//! *Departs from the paper*: the sum of trapped air is divided by Σ W of filled space, so that its limits are speeds; kinetic energy is
//! that of a unit of mass; rates are per area of liquid, so that a finer spacing emits as much; normals count at the surface alone,
//! where the gradient of the colour field is at least half of that of a flat surface, and not towards a solid.
//!
//! Symbols: v_ij, x_ij differences of velocity and place; n̂ outward unit normal; h → `SUPPORT` spacings.

use super::{params::WhitewaterParams, walls::Walls};
use crate::{math::Vec3, par, space::CellGrid};
use std::f32::consts::PI;

/// Radius within which neighbours are counted and averaged, in spacings: thresholds of [ihmsen12] are for it.
pub(super) const SUPPORT: f32 = 2.0;

/// Σ W over filled space of one particle per cubed spacing.
const FILLED: f32 = PI * SUPPORT * SUPPORT * SUPPORT / 3.0;

/// |Σ W x̂| at a flat surface.
const FLAT: f32 = PI * SUPPORT * SUPPORT * SUPPORT / 12.0;

/// Length of the normal, relative to a flat surface's, from which a particle is at the surface. Below, normals of the bulk are
/// noise; at 0.8 and more, crests of thin sheets are left out.
const AT_SURFACE: f32 = 0.5;

/// Cosine of the largest angle between velocity and normal at a crest ([ihmsen12] Eq. 5).
const OUTWARDS: f32 = 0.6;

/// Emission of the liquid of a shot.
pub(crate) struct Rates<'a> {
    params: &'a WhitewaterParams,
    walls: &'a Walls,
}

impl<'a> Rates<'a> {
    /// The emission that parameters describe, next to these solids.
    pub(crate) fn new(params: &'a WhitewaterParams, walls: &'a Walls) -> Self {
        Self { params, walls }
    }

    /// Emission of each particle at amount 1 [1/s].
    pub(super) fn of(&self, x: &[Vec3], v: &[Vec3], spacing: f32, time: f64) -> Vec<f32> {
        let WhitewaterParams {
            trapped_air, trapped_air_speed, wave_crests, wave_crest_curvature, speed, ..
        } = self.params;
        let radius = SUPPORT * spacing;
        let grid = CellGrid::new(x, radius);
        let solids = self.walls.at(time);
        let mut normals = par::repeated(Vec3::zeros(), x.len());
        par::fill(&mut normals, |i| {
            let mut sum = Vec3::zeros();
            grid.for_each_within(x, x[i], radius, |j, r2| {
                if j != i && r2 > 0.0 {
                    let r = r2.sqrt();
                    sum += (x[i] - x[j]) * ((1.0 - r / radius) / r);
                }
            });
            let length = sum.norm();
            if length < AT_SURFACE * FLAT {
                return Vec3::zeros();
            }
            let n = sum / length;
            // Next to a solid neighbours are missing, too.
            if Walls::distance(&solids, x[i] + n * spacing) < 0.5 * spacing { Vec3::zeros() } else { n }
        });
        let area = spacing * spacing;
        let energy = |speed: f32| 0.5 * speed * speed;
        let mut rate = par::repeated(0.0, x.len());
        par::fill(&mut rate, |i| {
            let moving = clamped(energy(v[i].norm()), speed.map(energy)); // Φ_k
            if moving <= 0.0 {
                return 0.0;
            }
            let is_crest = normals[i].dot(&v[i]) >= OUTWARDS * v[i].norm() && normals[i] != Vec3::zeros();
            let (mut trapped, mut curvature) = (0.0, 0.0);
            grid.for_each_within(x, x[i], radius, |j, r2| {
                if j == i || r2 <= 0.0 {
                    return;
                }
                let r = r2.sqrt();
                let w = 1.0 - r / radius;
                let (dx, dv) = (x[i] - x[j], v[i] - v[j]);
                trapped += (dv.norm() - dv.dot(&dx) / r) * w;
                if is_crest && normals[j] != Vec3::zeros() && dx.dot(&normals[i]) > 0.0 {
                    curvature += (1.0 - normals[i].dot(&normals[j])) * w;
                }
            });
            let by_air = trapped_air * area * clamped(trapped / FILLED, *trapped_air_speed);
            let by_crest = wave_crests * area * clamped(curvature, *wave_crest_curvature);
            (by_air + by_crest) * moving
        });
        rate
    }
}

/// Φ(I, a, b) of [ihmsen12] Eq. 1.
pub(super) fn clamped(value: f32, [min, max]: [f32; 2]) -> f32 {
    (value.min(max) - value.min(min)) / (max - min)
}
