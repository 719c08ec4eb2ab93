//! Vortons onto the nodes of a lattice, and nodes' numbers to points.
//!
//! *Method*: [monaghan85]'s M₄′ over four nodes an axis, W(t) = 1 − ⁵⁄₂t² + ³⁄₂t³ for t < 1 and ½(2 − t)²(1 − t) for t < 2: it
//! keeps the strength, the impulse and the angular impulse of what it spreads, and gives back quadratic functions. Where the
//! transform of the shares is divided out, [essmann95]'s cubic splines over the same four nodes do better: their waves of more
//! than half a turn a node, which no lattice can tell from slower ones, are weaker by a power. Or [gourlay19]'s linear shares
//! of two nodes.
//!
//! Vortons are sorted by the plane of z below them; a plane of nodes takes its shares from the four planes of vortons around it, in
//! their order, so threads leave no trace.

use super::lattice::{Field, Lattice};
use crate::{
    math::Vec3,
    par::{self, Groups},
};

/// Points a task gathers for: a plane of nodes may hold most of them.
const TASK: usize = 1 << 10;

/// How a vorton is shared out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shares {
    /// Cubic splines.
    Spline,
    /// M₄′.
    Smooth,
    /// Linear.
    Linear,
}

impl Shares {
    /// The weights of the nodes −1, 0, 1, 2 of a point between nodes 0 and 1.
    #[inline(always)]
    pub(super) fn of(self, t: f32) -> [f32; 4] {
        match self {
            Shares::Spline => four(
                t,
                |t| 2.0 / 3.0 + t * t * (0.5 * t - 1.0),
                |t| (2.0 - t) * (2.0 - t) * (2.0 - t) * (1.0 / 6.0),
            ),
            Shares::Smooth => {
                four(t, |t| 1.0 + t * t * (1.5 * t - 2.5), |t| 0.5 * (2.0 - t) * (2.0 - t) * (1.0 - t))
            }
            Shares::Linear => four(t, |t| 1.0 - t, |_| 0.0),
        }
    }

    /// The transform of the weights at θ: what is deposited and gathered is multiplied by its square, for each axis.
    pub(super) fn transform(self, theta: f64) -> f64 {
        let u = theta / 2.0;
        let s = if u == 0.0 { 1.0 } else { u.sin() / u };
        match self {
            Shares::Spline => s.powi(4),
            Shares::Smooth => s.powi(3) * (3.0 * s - 2.0 * u.cos()),
            Shares::Linear => s * s,
        }
    }
}

/// Weights at −1, 0, 1 and 2 of what is `near` at distances below 1, and `far` from there to 2.
#[inline(always)]
fn four(t: f32, near: impl Fn(f32) -> f32, far: impl Fn(f32) -> f32) -> [f32; 4] {
    [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
}

/// Points sorted by the plane of nodes below them.
pub(super) fn by_plane(lattice: &Lattice, points: &[Vec3]) -> Groups {
    Groups::new(points.len(), lattice.cells[2], |i| [lattice.cell(points[i]).0[2] as u32])
}

/// Adds the strengths of vortons, each at least two cells from the boundary, to the nodes around them.
pub(super) fn deposit(field: &mut Field, position: &[Vec3], strength: &[Vec3], shares: Shares) {
    let lattice = field.lattice;
    let planes = by_plane(&lattice, position);
    let [x, y, z] = &mut field.values;
    par::map_chunks_mut([x, y, z].map(|v| &mut v[..]), lattice.plane(), |first, mut values| {
        let plane = first / lattice.plane();
        for below in plane.saturating_sub(2)..=(plane + 1).min(lattice.cells[2] - 1) {
            let k = plane + 1 - below;
            for &i in planes.of(below) {
                let (at, t) = lattice.cell(position[i as usize]);
                let [wx, wy, wz] = t.map(|t| shares.of(t));
                let g = strength[i as usize] * wz[k];
                for (j, wy) in wy.iter().enumerate() {
                    let from = (at[1] + j - 1) * lattice.row() + at[0] - 1;
                    for (values, g) in values.iter_mut().zip(g.iter()) {
                        for (value, wx) in values[from..from + 4].iter_mut().zip(wx) {
                            *value += wx * (wy * g);
                        }
                    }
                }
            }
        }
    });
}

/// The numbers of `fields` at points, each at least two cells from the boundary, in the order of `planes`.
pub(super) fn gather<const N: usize>(
    fields: &[Field; N],
    points: &[Vec3],
    planes: &Groups,
    shares: Shares,
) -> Vec<[Vec3; N]> {
    let lattice = fields[0].lattice;
    let mut out = par::repeated([Vec3::zeros(); N], planes.len());
    par::for_chunks(&mut out, TASK, |first, out| {
        for (&i, out) in planes.all()[first..].iter().zip(out) {
            let (at, t) = lattice.cell(points[i as usize]);
            let [wx, wy, wz] = t.map(|t| shares.of(t));
            for (k, wz) in wz.iter().enumerate() {
                for (j, wy) in wy.iter().enumerate() {
                    let from = lattice.place([at[0] - 1, at[1] + j - 1, at[2] + k - 1]);
                    let w = wz * wy;
                    for (field, out) in fields.iter().zip(out.iter_mut()) {
                        for (values, out) in field.values.iter().zip(out.iter_mut()) {
                            let row = &values[from..from + 4];
                            *out += w * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
                        }
                    }
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_keep_their_moments() {
        for (shares, kept) in [(Shares::Spline, 2), (Shares::Smooth, 3), (Shares::Linear, 2)] {
            for t in [0.0, 0.1, 0.37, 0.5, 0.93] {
                let w = shares.of(t);
                for power in 0..kept {
                    let moment: f32 = (0..4).map(|k| w[k] * (k as f32 - 1.0 - t).powi(power)).sum();
                    let expected = f32::from(u8::from(power == 0));
                    assert!((moment - expected).abs() < 1e-6, "{shares:?} {t} {power}: {moment}");
                }
            }
        }
        // The first that is not kept: the second of linear shares is t(1 − t), that of splines ⅓ everywhere.
        let second = |shares: Shares, t: f32| {
            (0..4).map(|k| shares.of(t)[k] * (k as f32 - 1.0 - t).powi(2)).sum::<f32>()
        };
        assert_eq!(second(Shares::Linear, 0.5), 0.25);
        assert!([0.1, 0.7].iter().all(|&t| (second(Shares::Spline, t) - 1.0 / 3.0).abs() < 1e-6));
    }

    #[test]
    fn the_transform_of_shares_is_their_sum_over_waves() {
        for shares in [Shares::Spline, Shares::Smooth, Shares::Linear] {
            for theta in [0.0_f64, 0.3, 1.0, 2.0, 3.1] {
                // ∫ W cos θt dt: cells of the weights at 0 <= t < 1, by the middle rule.
                let n = 2000;
                let cell = |i: usize| {
                    let t = (i as f64 + 0.5) / n as f64;
                    let w = shares.of(t as f32);
                    (0..4).map(|k| f64::from(w[k]) * (theta * (k as f64 - 1.0 - t)).cos()).sum::<f64>()
                };
                let whole = (0..n).map(cell).sum::<f64>() / n as f64;
                assert!((whole - shares.transform(theta)).abs() < 1e-6, "{shares:?} {theta}");
            }
        }
    }

    #[test]
    fn what_is_deposited_is_all_there_and_quadratics_are_gathered_exactly() {
        let lattice = Lattice { low: Vec3::new(-1.0, 2.0, 0.5), spacing: 0.25, cells: [9, 11, 8] };
        let position: Vec<Vec3> = (0..40)
            .map(|i| lattice.low + Vec3::from_fn(|k, _| 0.5 + 0.031 * ((i * (7 + k)) % 29) as f32))
            .collect();
        let strength: Vec<Vec3> = (0..40).map(|i| Vec3::new(1.0, (i % 3) as f32, -0.1 * i as f32)).collect();
        let mut field = Field::new(lattice);
        deposit(&mut field, &position, &strength, Shares::Smooth);
        let (mut sum, mut impulse) = (Vec3::zeros(), Vec3::zeros());
        let mut wave = Field::new(lattice);
        let quadratic = |x: Vec3| Vec3::new(x.x * x.y, 1.0 + x.z * x.z, x.x - 2.0 * x.y * x.z);
        for z in 0..=8 {
            for y in 0..=11 {
                for x in 0..=9 {
                    let at = [x, y, z];
                    sum += field.at(at);
                    impulse += lattice.node(at).cross(&field.at(at));
                    wave.set(at, quadratic(lattice.node(at)));
                }
            }
        }
        let whole: Vec3 = strength.iter().sum();
        let turned: Vec3 = position.iter().zip(&strength).map(|(x, g)| x.cross(g)).sum();
        assert!((sum - whole).norm() < 1e-4 && (impulse - turned).norm() < 1e-3);
        let planes = by_plane(&lattice, &position);
        let found = gather(&[wave], &position, &planes, Shares::Smooth);
        for (&i, [found]) in planes.all().iter().zip(&found) {
            assert!((found - quadratic(position[i as usize])).norm() < 1e-4);
        }
    }
}
