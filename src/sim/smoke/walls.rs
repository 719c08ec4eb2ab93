//! Solids as boundaries of the air: no flow through their surfaces.
//!
//! *Method*: a source panel method for bodies, the method of images for a plane. The strengths of sources inside the solids, or
//! on the faces of boxes (`panels.rs`), solve Σ_j q_j n_i·(x_i − y_j)/(4π r³) = −n_i·(u − u_solid) by GMRES: at each panel's
//! centre the air moves with the solid along its normal. Unknowns are strengths over squared panel widths, so that
//! wide and narrow panels weigh the same (`influence.rs`). The sources induce no vorticity. None is in the air, except corners of square panels
//! at edges (`tiles.rs`). A plane is exact: vortons and sources have mirror images beyond it.
//! There is leakage between panels; the frame's record has it. Vortons and tracers that get into a solid are projected out of it
//! and counted. Steps are short enough ([`Walls::max_displacement`]) that a moving solid does not pass over smoke. Inside a solid
//! the velocity is the solid's.
//!
//! Symbols: q → `strength` [m³/s], x → `panel`, y → `source` [m], n → `normal`.
//! Limits: panels are at least one spacing wide, and at most 1600 in all at the solids' largest (`widths.rs`); a plane is
//! taken to stand still. A turning solid that loses its last source leaves the opposite of its own vorticity in the air, and
//! releases it once more if it gets sources again.

use super::{
    body::{Body, Placed, PlacedForm, largest_shape},
    influence::Influence,
    mirror,
    panels::Panel,
    sources::{Source, Sources, reflect},
    widths::distribute_panels,
};
use crate::{
    math::{Vec3, gmres},
    par,
    sim::vortex::Gradient,
    solid::{Pose, Shape, Solid},
};
use std::{borrow::Cow, sync::OnceLock};

/// Residual of the normal flow at the panels at which the equations count as solved.
const RESIDUAL: f64 = 1e-4;

/// Limit of GMRES iterations. The residual that is left is in the frame's record (`unsolved`).
const MAX_ITERATIONS: usize = 60;

/// Solids as boundaries of the air.
#[derive(Debug)]
pub(super) struct Walls {
    bodies: Vec<Body>,
    /// A plane's unit normal and offset [m].
    mirror: Option<(Vec3, f32)>,
    /// The coefficients, once they are known, of solids that stand still. [`Self::solve`] must not be called by a parallel loop, which
    /// could enter it a second time while it is computed.
    still: OnceLock<Influence>,
}

/// Angular velocity of solids whose opposite the vortons contain: a blend of two times.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spun {
    /// The two times [s].
    pub(super) times: [f64; 2],
    /// Weight of the second time's angular velocity, 0 to 1.
    pub(super) part: f32,
}

impl Spun {
    /// The angular velocity at `time` [s].
    pub(super) fn at(time: f64) -> Self {
        Self { times: [time; 2], part: 0.0 }
    }
}

/// A solid and its angular velocity at a time.
#[derive(Debug)]
pub(super) struct Turning {
    /// Index of the solid.
    pub(super) body: usize,
    pub(super) panels: Vec<Placed>,
    /// Normal of the mirror, if that cuts through the solid.
    pub(super) cut: Option<Vec3>,
    /// Angular velocity whose opposite the vortons contain [1/s].
    pub(super) before: Vec3,
    /// Angular velocity [1/s].
    pub(super) spin: Vec3,
}

impl Walls {
    /// Walls of `solids` for vortons `spacing` [m] apart; `None` without solids.
    pub(super) fn new(solids: &[Solid], spacing: f32) -> Option<Self> {
        if solids.is_empty() {
            return None;
        }
        let mirror = solids.iter().find_map(|solid| match solid.shape {
            Shape::Plane { point, normal } => {
                let pose = solid.motion.as_ref().map_or(Pose::identity(), |motion| motion.pose(0.0));
                let n = Vec3::from(normal).normalize();
                Some((n, n.dot(&(Vec3::from(point) + pose.position))))
            }
            _ => None,
        });
        let shapes: Vec<Cow<'_, Shape>> = solids.iter().map(largest_shape).collect();
        let shapes: Vec<&Shape> = shapes.iter().map(AsRef::as_ref).collect();
        let panels = distribute_panels(&shapes, spacing);
        let body = |((solid, shape), panels): ((&Solid, &&Shape), _)| Body::new(solid, shape, panels);
        let bodies = solids.iter().zip(&shapes).zip(panels).map(body).collect();
        Some(Self { bodies, mirror, still: OnceLock::new() })
    }

    /// The solids where they are at `time` [s].
    pub(super) fn at(&self, time: f64) -> Vec<PlacedForm> {
        self.bodies.iter().map(|body| body.at(time)).collect()
    }

    /// Indices of the solids without a source, which let the air through. A plane needs none, nor does a solid below it.
    pub(super) fn sourceless(&self) -> Vec<usize> {
        let is_bare = |body: &Body| {
            let panels = body.largest_panels();
            let has_sources = || panels.iter().any(|panel| panel.source.is_some());
            let is_sourced = if body.is_still() { self.is_sourced(body, 0.0) } else { has_sources() };
            let is_in_air =
                panels.is_empty() || panels.iter().any(|panel| mirror::is_before(panel, self.mirror));
            is_in_air && !(body.is_plane() || is_sourced)
        };
        (0..self.bodies.len()).filter(|&number| is_bare(&self.bodies[number])).collect()
    }

    /// Panels with a source in the air, at `time` [s]. Panels beyond the mirror have none: their images would be walls in the air, or,
    /// where a solid is its own image, make the equations singular.
    pub(super) fn sourced(&self, time: f64) -> Vec<Placed> {
        let in_air = |placed: Placed| {
            let source = Some(mirror::source_in_air(&placed.panel, self.mirror)?);
            Some(Placed { panel: Panel { source, ..placed.panel }, ..placed })
        };
        self.placed(time).into_iter().filter_map(in_air).collect()
    }

    /// Whether a solid has a source in the air at `time` [s].
    fn is_sourced(&self, body: &Body, time: f64) -> bool {
        body.may_have_sources() && body.at(time).has_source_in_air(self.mirror)
    }

    /// All panels at `time` [s].
    pub(super) fn placed(&self, time: f64) -> Vec<Placed> {
        self.bodies.iter().flat_map(|body| body.panels(time)).collect()
    }

    /// Solves for the sources that cancel the normal flow of `air` [m/s] at the panels of [`Self::sourced`].
    pub(super) fn solve(&self, panels: &[Placed], air: &[Vec3]) -> Sources {
        let mirror = self.mirror;
        if panels.is_empty() {
            return Sources { mirror, ..Sources::default() };
        }
        let entering =
            |(placed, air): (&Placed, &Vec3)| -f64::from(placed.panel.normal.dot(&(air - placed.velocity)));
        let right: Vec<f64> = panels.iter().zip(air).map(entering).collect();
        let coefficients = || {
            let panels: Vec<Panel> = panels.iter().map(|placed| placed.panel).collect();
            Influence::new(&panels, mirror)
        };
        let moved;
        let influence = if self.bodies.iter().all(|body| body.is_still() || !body.may_have_sources()) {
            self.still.get_or_init(coefficients)
        } else {
            moved = coefficients();
            &moved
        };
        assert_eq!(right.len(), influence.unknowns.len(), "coefficients of other panels");
        let (q, residual) = gmres(&right, RESIDUAL, MAX_ITERATIONS, |q| influence.product(q));
        let mut sources = Sources { mirror, residual, ..Sources::default() };
        for (&(source, square), q) in influence.unknowns.iter().zip(q) {
            match source {
                Source::Point(y) => sources.points.push((y, q as f32 * square)),
                Source::Tile(tile) => sources.tiles.push((tile, q as f32)),
            }
        }
        sources
    }

    /// Solids with sources at `time` [s], and their angular velocity at the times of `spun`. Panels whose vorticity would be shed beyond
    /// the mirror, `height` [m] above them, are left out, as are those on which a solid stands.
    pub(super) fn turning(&self, time: f64, spun: Spun, height: f32) -> Vec<Turning> {
        let is_before = |placed: &Placed| {
            let Panel { x, normal, width, .. } = placed.panel;
            self.mirror.is_none_or(|(n, offset)| {
                n.dot(&x) + (n.dot(&normal) * height).min(0.0) > offset + mirror::TOLERANCE * width
            })
        };
        let turned = |(number, body): (usize, &Body)| {
            let mut panels = body.panels(time);
            let all = panels.len();
            panels.retain(is_before);
            let cut = self.mirror.filter(|_| panels.len() < all).map(|(n, _)| n);
            // At the start of the shot no vorticity has been shed.
            let [first, second] =
                spun.times.map(|time| if time == 0.0 { Vec3::zeros() } else { body.angular_velocity(time) });
            let before = first * (1.0 - spun.part) + second * spun.part;
            Turning { body: number, panels, cut, before, spin: body.angular_velocity(time) }
        };
        self.with_sources(time).map(turned).collect()
    }

    /// Whether the shape or the size of solid number `body` changes.
    pub(super) fn is_deforming(&self, body: usize) -> bool {
        self.bodies[body].is_deforming()
    }

    /// The solids with sources in the air at `time` [s], and their indices.
    fn with_sources(&self, time: f64) -> impl Iterator<Item = (usize, &Body)> {
        self.bodies.iter().enumerate().filter(move |(_, body)| self.is_sourced(body, time))
    }

    /// Mirror images of points, if there is a plane.
    pub(super) fn mirrored(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let mirror = self.mirror?;
        Some(points.iter().map(|&x| reflect(x, mirror)).collect())
    }

    /// A velocity reflected in the plane.
    pub(super) fn reflect(&self, v: Vec3) -> Vec3 {
        self.mirror.map_or(v, |(n, _)| v - n * (2.0 * n.dot(&v)))
    }

    /// A velocity gradient reflected in the plane.
    pub(super) fn reflect_gradient(&self, gradient: &Gradient) -> Gradient {
        self.mirror.map_or(*gradient, |(n, _)| {
            let m = Gradient::identity() - n * n.transpose() * 2.0;
            m * gradient * m
        })
    }

    /// The component of a wind along the plane.
    pub(super) fn along(&self, wind: Vec3) -> Vec3 {
        self.mirror.map_or(wind, |(n, _)| wind - n * n.dot(&wind))
    }

    /// Projects points that are inside a solid, or nearer to one than `gap` [m], to that distance; returns how many were inside.
    pub(super) fn project_out(&self, points: &mut [Vec3], gap: f32, time: f64) -> u64 {
        let placed = self.at(time);
        let counts = par::map_chunks_mut([points], par::CHUNK, |_, [points]| {
            let mut inside = 0;
            for x in points {
                let mut was = false;
                for solid in &placed {
                    let (distance, normal) = solid.form.shape.contact(solid.to_local(*x));
                    if distance < gap {
                        was |= distance < 0.0;
                        *x += solid.turned(normal) * (gap - distance);
                    }
                }
                inside += u64::from(was);
            }
            inside
        });
        counts.into_iter().sum()
    }

    /// Distance of points from the nearest solid with sources at `time` [s], up to `max` [m], and that solid's index among them; 0 for
    /// none.
    pub(super) fn heights(&self, points: &[Vec3], max: f32, time: f64) -> Vec<(f32, usize)> {
        let placed: Vec<PlacedForm> = self.with_sources(time).map(|(_, body)| body.at(time)).collect();
        let mut heights = vec![(max, 0); points.len()];
        par::update(&mut heights, |i, nearest| {
            for (number, solid) in placed.iter().enumerate() {
                let height = solid.form.shape.signed_distance(solid.to_local(points[i]));
                if height < nearest.0 {
                    *nearest = (height, number);
                }
            }
        });
        heights
    }

    /// Sets the velocity of points inside solids to that of the solid at `time` [m/s]: what the sources induce there means nothing.
    pub(super) fn set_solid_velocity(&self, points: &[Vec3], velocity: &mut [Vec3], time: f64) {
        for body in &self.bodies {
            let solid = body.at(time);
            par::update(velocity, |i, v| {
                let local = solid.to_local(points[i]);
                if solid.form.shape.signed_distance(local) < 0.0 {
                    *v = solid.velocity(local);
                }
            });
        }
    }

    /// Upper bound of the speed of any point of a solid between two times [s] [m/s].
    pub(super) fn fastest(&self, from: f64, to: f64) -> f64 {
        self.bodies.iter().map(|body| body.fastest(from, to)).fold(0.0, f64::max)
    }

    /// Largest displacement of a solid in a step from `time` [s], for vortons of this core [m]: a core, a panel, or the radius of the largest
    /// ball in the smallest solid that moves. Farther, and it passes over smoke without moving it.
    pub(super) fn max_displacement(&self, core: f32, time: f64) -> f32 {
        self.bodies.iter().flat_map(|body| body.lengths(time)).fold(core, f32::min)
    }

    /// The width of the widest panel [m].
    pub(super) fn widest(&self) -> f32 {
        let panels = self.bodies.iter().flat_map(|body| body.largest_panels());
        panels.map(|panel| panel.width).fold(0.0, f32::max)
    }

    /// Points on the surface of each solid between its panels, at which leakage is measured.
    pub(super) fn leakage_points(&self, time: f64) -> Vec<Vec<Placed>> {
        let mut numbers = 0..;
        let mut between = |body: &Body| {
            let solid = body.at(time);
            let shape = &solid.form.shape;
            let witness = |panel: &Panel| {
                let number = numbers.next()?;
                if let (Some(Source::Tile(tile)), Shape::Box { .. }) = (panel.source, shape) {
                    return Some(Panel { x: tile.near_border(number), ..*panel });
                }
                // Half a panel off its centre, in directions that vary.
                let aside = panel.normal.cross(&Vec3::ith(number % 3, 1.0));
                if aside.norm() < 0.3 {
                    return None;
                }
                let x = panel.x + aside.normalize() * (0.5 * panel.width);
                let (distance, normal) = shape.contact(x);
                Some(Panel { x: x - normal * distance, normal, ..*panel })
            };
            let found: Vec<Panel> = solid.form.panels.iter().filter_map(witness).collect();
            let mut placed = solid.placed(&found);
            placed.retain(|Placed { panel, .. }| mirror::is_before(panel, self.mirror));
            placed
        };
        self.bodies.iter().map(&mut between).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{Interpolation, Keyframe, Motion};

    #[test]
    fn wind_flows_around_a_sphere_as_potential_flow() {
        let (radius, wind) = (0.3, Vec3::new(2.0, 0.0, 0.0));
        let sphere = Solid::fixed(Shape::Sphere { center: [0.0; 3], radius });
        for (spacing, allowed) in [(0.06, 0.02), (0.03, 0.004)] {
            let walls = Walls::new(std::slice::from_ref(&sphere), spacing).unwrap();
            let panels = walls.sourced(0.0);
            let sources = walls.solve(&panels, &vec![wind; panels.len()]);
            assert!(sources.residual <= RESIDUAL, "{}", sources.residual);
            let points: Vec<Vec3> = [[0.0, 0.45, 0.0], [0.4, 0.2, 0.1], [-0.5, 0.0, 0.0], [0.0, 0.0, 0.32]]
                .map(Vec3::from)
                .into();
            let mut velocity = vec![wind; points.len()];
            sources.add_velocity(&points, &mut velocity);
            for (x, v) in points.iter().zip(&velocity) {
                // u = U + a³/2 (U/r³ − 3 (U·x) x/r⁵).
                let r = x.norm();
                let exact =
                    wind + (wind / r.powi(3) - x * (3.0 * wind.dot(x) / r.powi(5))) * (radius.powi(3) / 2.0);
                assert!((v - exact).norm() < allowed * wind.norm(), "{x}: {v} for {exact}");
            }
        }
    }

    #[test]
    fn the_velocity_inside_a_solid_is_the_solids() {
        let turn = |frame: u32, angle: f32| Keyframe {
            frame,
            position: [0.5 * frame as f32, 0.0, 0.0],
            rotation: [0.0, 0.0, angle],
            quaternion: None,
            scale: 1.0,
        };
        let motion = Motion::new(&[turn(0, 0.0), turn(2, 90.0)], Interpolation::Linear, 1.0, 0);
        let shape = Shape::Box { min: [-0.2, -0.2, -0.2], max: [0.2, 0.2, 0.2] };
        let still = Solid::fixed(Shape::Sphere { center: [5.0, 0.0, 0.0], radius: 0.5 });
        let floor = Solid::fixed(Shape::Plane { point: [0.0, 0.0, -1.0], normal: [0.0, 0.0, 1.0] });
        let solids = [Solid { motion, ..Solid::fixed(shape) }, still, floor];
        let walls = Walls::new(&solids, 0.1).unwrap();
        // At one second the box is at 0.5 m, an eighth of a turn on; it spins with 45° a second.
        let points = [[0.5, 0.1, 0.05], [0.5, 0.25, 0.0], [0.5, 0.4, 0.0], [5.1, 0.0, 0.0], [3.0, 0.0, -1.5]];
        let points = points.map(Vec3::from);
        let wild = Vec3::new(9.0, 9.0, 9.0);
        let mut velocity = [wild; 5];
        walls.set_solid_velocity(&points, &mut velocity, 1.0);
        let spin = |r: f32| Vec3::new(0.5 - std::f32::consts::FRAC_PI_4 * r, 0.0, 0.0);
        let expected = [spin(0.1), spin(0.25), wild, Vec3::zeros(), Vec3::zeros()];
        for (found, expected) in velocity.iter().zip(expected) {
            assert!((found - expected).norm() < 1e-3, "{found} for {expected}");
        }
        // The bound is the speed of the corners; the displacement that of a core, a panel or half the width.
        let fastest = walls.fastest(0.0, 2.0);
        assert!((fastest - (0.5 + 0.12_f64.sqrt() * std::f64::consts::FRAC_PI_4)).abs() < 1e-4, "{fastest}");
        assert_eq!(walls.fastest(2.0, 3.0), 0.0);
        assert_eq!((walls.max_displacement(0.05, 0.0), walls.max_displacement(9.0, 0.0)), (0.05, 0.1));
        let walls = Walls::new(&solids, 9.0).unwrap();
        assert_eq!(walls.max_displacement(9.0, 0.0), 0.2);
    }

    #[test]
    fn thin_solids_leak_less_than_the_wind_or_have_no_sources() {
        let wind = Vec3::new(3.0, 0.4, 0.2);
        let ball = |radius| Shape::Sphere { center: [0.1, 0.0, 0.0], radius };
        let wire = |radius| Shape::Capsule { from: [0.0, 0.0, -0.5], to: [0.0, 0.1, 0.5], radius };
        let slanted = |radius| Shape::Capsule { from: [-0.3, -0.25, -0.3], to: [0.3, 0.25, 0.3], radius };
        // Whether there are sources, and the largest leakage.
        let cases = [
            (ball(0.005), false, 0.0),
            (wire(0.005), false, 0.0),
            (slanted(0.02), false, 0.0),
            (slanted(0.045), true, 0.5),
            (ball(0.025), false, 0.0),
            (wire(0.025), true, 1.0),
            (ball(0.035), true, 0.8),
            (wire(0.035), true, 0.8),
            (ball(0.045), true, 0.5),
            (wire(0.045), true, 0.5),
            (ball(0.06), true, 0.3),
            (wire(0.06), true, 0.3),
            (ball(0.075), true, 0.2),
            (wire(0.075), true, 0.2),
            (ball(0.1), true, 0.1),
            (wire(0.1), true, 0.1),
        ];
        for (shape, has_sources, allowed) in cases {
            let walls = Walls::new(&[Solid::fixed(shape.clone())], 0.05).unwrap();
            let panels = walls.sourced(0.0);
            assert_eq!(!panels.is_empty(), has_sources, "{shape:?}");
            if !has_sources {
                assert_eq!(walls.sourceless(), [0]);
                continue;
            }
            let sources = walls.solve(&panels, &vec![wind; panels.len()]);
            assert!(sources.residual < 0.01, "{shape:?}: {}", sources.residual);
            // All over the surface, as near to it as vortons can be.
            let gap = 0.05 * 0.05;
            let around = panels.iter().flat_map(|placed| (0..40).map(move |n| (placed.panel, n)));
            let place = |(panel, n): (Panel, u32)| {
                let aside =
                    Vec3::new((n % 5) as f32 - 2.0, (n / 5 % 4) as f32 - 1.5, (n / 20) as f32 * 3.0 - 1.5);
                let x = panel.x + aside * (0.25 * panel.width);
                let (distance, normal) = shape.contact(x);
                (x + normal * (gap - distance), normal)
            };
            let (at, normals): (Vec<Vec3>, Vec<Vec3>) = around.map(place).unzip();
            let mut velocity = vec![wind; at.len()];
            sources.add_velocity(&at, &mut velocity);
            let square = |along: &[f32]| along.iter().map(|v| v * v).sum::<f32>().sqrt();
            let through: Vec<f32> = normals.iter().zip(&velocity).map(|(n, v)| n.dot(v)).collect();
            let free: Vec<f32> = normals.iter().map(|n| n.dot(&wind)).collect();
            let part = square(&through) / square(&free);
            assert!(part < allowed, "{shape:?}: {part}");
            let fastest = velocity.iter().map(|v| v.norm()).fold(0.0, f32::max);
            assert!(fastest < 2.1 * wind.norm(), "{shape:?}: {fastest}");
        }
    }

    #[test]
    fn boxes_keep_wind_out_for_all_their_edges() {
        let wind = Vec3::new(1.0, 0.6, 0.3);
        for (low, high, spacing) in [
            ([-0.3, -0.3, -0.3], [0.3, 0.3, 0.3], 0.06),
            ([-0.3, -0.3, -0.3], [0.3, 0.3, 0.3], 0.045),
            ([-0.5, -0.13, -0.32], [0.5, 0.13, 0.3], 0.06),
        ] {
            let cuboid = Solid::fixed(Shape::Box { min: low, max: high });
            let walls = Walls::new(&[cuboid], spacing).unwrap();
            let panels = walls.sourced(0.0);
            let sources = walls.solve(&panels, &vec![wind; panels.len()]);
            assert!(sources.residual < 0.01, "{spacing}: {}", sources.residual);
            // Between the panels, at least two of them from any edge.
            let square = |along: &[f32]| along.iter().map(|v| v * v).sum::<f32>().sqrt();
            let inner =
                walls.leakage_points(0.0).concat().into_iter().map(|placed| placed.panel).filter(|panel| {
                    let aside = |axis: usize| {
                        panel.normal[axis].abs() > 0.5
                            || (panel.x[axis] - low[axis]).min(high[axis] - panel.x[axis]) > 2.0 * panel.width
                    };
                    (0..3).all(aside)
                });
            let inner: Vec<Panel> = inner.collect();
            let at: Vec<Vec3> = inner.iter().map(|panel| panel.x).collect();
            let mut velocity = vec![wind; at.len()];
            sources.add_velocity(&at, &mut velocity);
            let left: Vec<f32> = inner.iter().zip(&velocity).map(|(p, v)| p.normal.dot(v)).collect();
            let free: Vec<f32> = inner.iter().map(|p| p.normal.dot(&wind)).collect();
            let part = square(&left) / square(&free);
            assert!(part < 0.2, "{spacing}: {part} of {} points", inner.len());
        }
    }
}
