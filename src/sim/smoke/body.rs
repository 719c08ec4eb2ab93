//! A solid in the air: its shape and panels at any time.
//!
//! *Method*: a solid that keeps its shape has one set of panels, which its pose moves. Where its size changes they are those of the largest
//! size, made smaller. A mesh whose vertices move has new panels at each time, of the width that its largest area allows; their grid
//! moves with the mean of its vertices. Panels move as the surface does, along it too.
//!
//! Limits: a mesh without sources at its largest area has points at other times, which leak more than tiles where it then has edges. Panels of a
//! mesh that turns or bends by its vertices change from stage to stage of a step, and with them what leaks between them.
//! Where such a mesh gets too thin for sources it lets the air through, which the frame's leakage shows.

use super::{
    emit::VELOCITY_TIME_STEP,
    mirror,
    panels::{Panel, PanelGrid, SourceKind},
    sources::Source,
    widths::panels_within,
};
use crate::{
    math::Vec3,
    solid::{MeshShape, Motion, Pose, Shape, Solid, SurfaceVelocity, angular_velocity},
};
use std::{
    borrow::Cow,
    sync::{Arc, Mutex, PoisonError},
};

/// Most panels of a mesh whose vertices move, over those at its largest area: their number depends on how the surface lies in the grid.
const MAX_PANEL_RATIO: f32 = 1.25;

/// Panels above that ratio which a mesh may have, as one of a few panels varies more.
const EXTRA_PANELS: usize = 8;

/// Times of which results are kept: the three stages of a step, and its end.
const RECENT: usize = 4;

/// A solid in the air.
#[derive(Debug)]
pub(super) struct Body {
    solid: Solid,
    /// Shape and panels of a solid that keeps them.
    kept: Option<Arc<Form>>,
    /// Panels at its largest size and area.
    largest: Vec<Panel>,
    forms: Recent<Arc<Form>>,
    angular_velocities: Recent<Vec3>,
}

/// Results of the times that were requested last.
#[derive(Debug)]
struct Recent<T>(Mutex<Vec<(f64, T)>>);

impl<T: Clone> Recent<T> {
    fn new() -> Self {
        Self(Mutex::new(Vec::with_capacity(RECENT)))
    }

    /// The result of `time` [s].
    fn get(&self, time: f64, make: impl FnOnce() -> T) -> T {
        let recent = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, found)) = recent().iter().find(|(of, _)| *of == time) {
            return found.clone();
        }
        // Without the lock: a thread that waits for parts of the work may take over work that needs the lock.
        let made = make();
        let mut recent = recent();
        if recent.len() == RECENT {
            recent.remove(0);
        }
        recent.push((time, made.clone()));
        made
    }
}

/// Shape and panels of a solid at a time, in its own axes.
#[derive(Debug)]
pub(super) struct Form {
    pub(super) shape: Shape,
    pub(super) panels: Vec<Panel>,
    /// Centre of its surface [m].
    middle: Vec3,
    inner_radius: f32,
    /// Change of a solid that deforms.
    change: Option<Change>,
}

/// Change of a solid's shape and size at a time.
#[derive(Debug)]
struct Change {
    /// Rate of growth over its size [1/s].
    growth: f32,
    /// Velocity of the surface of a mesh whose vertices move.
    surface: Option<SurfaceVelocity>,
}

impl Form {
    fn new(shape: Shape, panels: Vec<Panel>, change: Option<Change>) -> Self {
        let (middle, inner_radius) = (middle(&panels), shape.inner_radius());
        Self { shape, panels, middle, inner_radius, change }
    }

    /// Velocity of the solid near `x` by its change of shape and size [m/s].
    fn velocity(&self, x: Vec3) -> Option<Vec3> {
        let Change { growth, surface } = self.change.as_ref()?;
        Some(surface.as_ref().map_or(Vec3::zeros(), |surface| surface.at(x)) + x * *growth)
    }
}

/// A panel in its solid's pose at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) panel: Panel,
    /// Velocity of the solid there [m/s].
    pub(super) velocity: Vec3,
    /// Offset from the centre of the solid's surface [m].
    pub(super) arm: Vec3,
}

/// A solid where it is at a time, with the shape it then has.
pub(super) struct PlacedForm {
    pub(super) form: Arc<Form>,
    moving: Option<Moving>,
}

impl PlacedForm {
    /// Where a point is in the solid's own axes [m].
    pub(super) fn to_local(&self, x: Vec3) -> Vec3 {
        self.moving.as_ref().map_or(x, |moving| moving.pose.to_local(x))
    }

    /// Whether a point is in it.
    pub(super) fn contains(&self, x: Vec3) -> bool {
        self.form.shape.signed_distance(self.to_local(x)) < 0.0
    }

    /// Whether it is a plane.
    pub(super) fn is_plane(&self) -> bool {
        matches!(self.form.shape, Shape::Plane { .. })
    }

    /// A direction of the solid in the world.
    pub(super) fn turned(&self, direction: Vec3) -> Vec3 {
        self.moving.as_ref().map_or(direction, |moving| moving.pose.rotation * direction)
    }

    /// Velocity of the solid at the point `local` of its own axes [m/s].
    pub(super) fn velocity(&self, local: Vec3) -> Vec3 {
        let moved = self.moving.as_ref().map_or(Vec3::zeros(), |moving| moving.velocity(local));
        self.form.velocity(local).map_or(moved, |deformed| moved + self.turned(deformed))
    }

    /// A panel of the solid, in the world.
    fn placed_panel(&self, panel: &Panel) -> Panel {
        self.moving.as_ref().map_or(*panel, |Moving { pose, .. }| Panel {
            x: pose.to_world(panel.x),
            normal: pose.rotation * panel.normal,
            source: panel.source.map(|source| source.placed(pose)),
            ..*panel
        })
    }

    /// `panels` of the solid, in the world.
    pub(super) fn placed(&self, panels: &[Panel]) -> Vec<Placed> {
        let placed = |panel: &Panel| Placed {
            panel: self.placed_panel(panel),
            velocity: self.velocity(panel.x),
            arm: self.turned(panel.x - self.form.middle),
        };
        panels.iter().map(placed).collect()
    }

    /// Whether one of its panels has a source in the air.
    pub(super) fn has_source_in_air(&self, mirror: Option<(Vec3, f32)>) -> bool {
        let in_air = |panel: &Panel| mirror::source_in_air(&self.placed_panel(panel), mirror).is_some();
        self.form.panels.iter().any(in_air)
    }
}

impl Body {
    /// A solid with the panels of its [`largest_shape`].
    pub(super) fn new(solid: &Solid, shape: &Shape, panels: Vec<Panel>) -> Self {
        let kept = (!changes_shape(solid)).then(|| Arc::new(Form::new(shape.clone(), panels.clone(), None)));
        let (forms, angular_velocities) = (Recent::new(), Recent::new());
        Self { solid: solid.clone(), kept, largest: panels, forms, angular_velocities }
    }

    /// Whether it is a plane.
    pub(super) fn is_plane(&self) -> bool {
        matches!(self.solid.shape, Shape::Plane { .. })
    }

    /// Whether it stands still and keeps its shape.
    pub(super) fn is_still(&self) -> bool {
        self.solid.motion.is_none() && self.kept.is_some()
    }

    /// Whether its shape or size changes.
    pub(super) fn is_deforming(&self) -> bool {
        self.kept.is_none()
    }

    /// Whether it has a source where it is largest, or may have one at other times.
    pub(super) fn may_have_sources(&self) -> bool {
        let may_come = deforming_mesh(&self.solid).is_some() && !self.largest.is_empty();
        may_come || self.largest.iter().any(|panel| panel.source.is_some())
    }

    /// Its panels where it is largest.
    pub(super) fn largest_panels(&self) -> &[Panel] {
        &self.largest
    }

    /// Width of its panels at `time` [s] [m], and, if it moves, the radius of the largest ball in it.
    pub(super) fn lengths(&self, time: f64) -> impl Iterator<Item = f32> + use<> {
        let form = self.form(time);
        let radius = (!self.is_still()).then_some(form.inner_radius);
        radius.into_iter().chain(form.panels.first().map(|panel| panel.width))
    }

    /// Upper bound of the speed of its surface between two times [s] [m/s].
    pub(super) fn fastest(&self, from: f64, to: f64) -> f64 {
        // A plane does not move.
        if self.solid.shape.reach().is_finite() { self.solid.fastest(from, to) } else { 0.0 }
    }

    /// Where it is at `time` [s], and its shape.
    pub(super) fn at(&self, time: f64) -> PlacedForm {
        let moving = self.solid.motion.as_ref().map(|motion| Moving::new(motion, time));
        PlacedForm { form: self.form(time), moving }
    }

    /// Panels of the solid at `time` [s].
    pub(super) fn panels(&self, time: f64) -> Vec<Placed> {
        let solid = self.at(time);
        solid.placed(&solid.form.panels)
    }

    /// Angular velocity at `time` [1/s].
    pub(super) fn angular_velocity(&self, time: f64) -> Vec3 {
        let moving = self.solid.motion.as_ref().map(|motion| Moving::new(motion, time));
        let turned = moving.as_ref().map_or(Vec3::zeros(), Moving::angular_velocity);
        let Some(mesh) = deforming_mesh(&self.solid) else { return turned };
        let own = self.angular_velocities.get(time, || angular_velocity(mesh, time, VELOCITY_TIME_STEP));
        turned + moving.map_or(own, |moving| moving.pose.rotation * own)
    }

    /// Shape and panels at `time` [s].
    fn form(&self, time: f64) -> Arc<Form> {
        match &self.kept {
            Some(form) => form.clone(),
            None => self.forms.get(time, || Arc::new(self.changed_form(time))),
        }
    }

    /// Shape and panels of a solid that deforms, at `time` [s].
    fn changed_form(&self, time: f64) -> Form {
        let shape = self.solid.shape_at(time).into_owned();
        let scale_at = |time: f64| self.solid.motion.as_ref().map_or(1.0, |motion| motion.scale(time));
        let scale = scale_at(time);
        let factor = scale / largest_scale(&self.solid);
        let surface = match &shape {
            Shape::Mesh(mesh) => SurfaceVelocity::new(mesh, time, VELOCITY_TIME_STEP),
            _ => None,
        };
        let panels = match (&surface, self.largest.first()) {
            (Some(surface), Some(widest)) => {
                let grid = PanelGrid { step: widest.width * factor, origin: surface.middle() };
                let limit = (self.largest.len() as f32 * MAX_PANEL_RATIO) as usize + EXTRA_PANELS;
                // One kind at all times: sources that change from one to the other would move the air. Points suit every shape.
                let kind = SourceKind::of(&self.largest).unwrap_or(SourceKind::Points);
                panels_within(&shape, grid, kind, limit)
            }
            _ => self.largest.iter().map(|panel| panel.scaled(factor)).collect(),
        };
        let change = scale_at(time + VELOCITY_TIME_STEP) - scale_at(time - VELOCITY_TIME_STEP);
        let growth = change / (2.0 * VELOCITY_TIME_STEP) as f32 / scale;
        Form::new(shape, panels, Some(Change { growth, surface }))
    }
}

/// The shape of a solid at its largest size and area.
pub(super) fn largest_shape(solid: &Solid) -> Cow<'_, Shape> {
    let shape = match deforming_mesh(solid).and_then(MeshShape::deformation) {
        Some(deformation) => solid.shape.at(deformation.time_of_largest_area()),
        None => Cow::Borrowed(&solid.shape),
    };
    let scale = largest_scale(solid);
    if scale == 1.0 { shape } else { Cow::Owned(shape.scaled(scale)) }
}

/// The largest size of a solid over that of its shape as written.
fn largest_scale(solid: &Solid) -> f32 {
    solid.scales()[1]
}

/// Whether the shape or the size of a solid changes.
fn changes_shape(solid: &Solid) -> bool {
    let [smallest, largest] = solid.scales();
    solid.shape.is_deforming() || smallest != largest
}

/// The mesh of a solid, if its vertices move.
fn deforming_mesh(solid: &Solid) -> Option<&MeshShape> {
    match &solid.shape {
        Shape::Mesh(mesh) if mesh.deformation().is_some() => Some(mesh),
        _ => None,
    }
}

impl Panel {
    /// This panel of a solid that is `scale` times as large.
    fn scaled(&self, scale: f32) -> Self {
        Self {
            x: self.x * scale,
            normal: self.normal,
            area: self.area * scale * scale,
            width: self.width * scale,
            source: self.source.map(|source: Source| source.scaled(scale)),
        }
    }
}

/// A moving solid at a time.
struct Moving {
    pose: Pose,
    /// Poses [`VELOCITY_TIME_STEP`] seconds before and after.
    before_after: [Pose; 2],
}

impl Moving {
    fn new(motion: &Motion, time: f64) -> Self {
        Self {
            pose: motion.pose(time),
            before_after: [time - VELOCITY_TIME_STEP, time + VELOCITY_TIME_STEP]
                .map(|time| motion.pose(time)),
        }
    }

    /// Velocity of the solid's point `local` [m/s].
    fn velocity(&self, local: Vec3) -> Vec3 {
        let [before, after] = &self.before_after;
        (after.to_world(local) - before.to_world(local)) / (2.0 * VELOCITY_TIME_STEP) as f32
    }

    /// Angular velocity [1/s]: exactly 0 for a translation.
    fn angular_velocity(&self) -> Vec3 {
        let [before, after] = self.before_after.map(|pose| pose.rotation);
        let change = (after - before) / (2.0 * VELOCITY_TIME_STEP) as f32;
        // Σ e × (Ω × e) = 2Ω of its three axes.
        let axis = |axis: usize| self.pose.rotation.column(axis).cross(&change.column(axis)) * 0.5;
        axis(0) + axis(1) + axis(2)
    }
}

/// Area-weighted centre of panels [m].
fn middle(panels: &[Panel]) -> Vec3 {
    let area: f32 = panels.iter().map(|panel| panel.area).sum();
    if area == 0.0 {
        return Vec3::zeros();
    }
    panels.iter().map(|panel| panel.x * (panel.area / area)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::walls::{Spun, Walls};
    use super::*;
    use crate::solid::{Deformation, Interpolation, Keyframe, Solid};

    /// Radii of an ellipsoid [m].
    const RADII: [f32; 3] = [0.4, 0.3, 0.25];

    /// A ball of radius 1, or what `placed` makes of it, at each of `times` [s].
    fn mesh(times: &[f64], placed: impl Fn(Vec3, f64) -> Vec3) -> Solid {
        let (mut corners, mut faces) = (Vec::new(), Vec::new());
        let n = 12_u32;
        for (axis, up) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0_f32)]) {
            let first = corners.len() as u32;
            for (j, i) in (0..=n).flat_map(|j| (0..=n).map(move |i| (j, i))) {
                let [a, b] = [i, j].map(|k| 2.0 * k as f32 / n as f32 - 1.0);
                let x =
                    Vec3::ith(axis, up) + Vec3::ith((axis + 1) % 3, a * up) + Vec3::ith((axis + 2) % 3, b);
                corners.push(x.normalize());
            }
            for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
                let [a, b] = [first + j * (n + 1) + i, first + (j + 1) * (n + 1) + i];
                faces.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
            }
        }
        let samples = times.iter().map(|&t| corners.iter().map(|&x| placed(x, t)).collect()).collect();
        let motion = Deformation::new(faces, samples, times.to_vec(), 48).unwrap();
        let mut shape = MeshShape::new("made here");
        shape.fill_deforming(Arc::new(motion));
        Solid::fixed(Shape::Mesh(shape))
    }

    fn key(frame: u32, position: [f32; 3], angle: f32, scale: f32) -> Keyframe {
        Keyframe { frame, position, rotation: [0.0, 0.0, angle], quaternion: None, scale }
    }

    /// The shape with a motion, one keyframe a second.
    fn moving(solid: Solid, keys: &[Keyframe]) -> Solid {
        Solid { motion: Motion::new(keys, Interpolation::Linear, 1.0, 0), ..solid }
    }

    /// Velocity at points of air that only solids move.
    fn velocity(walls: &Walls, points: &[Vec3], time: f64) -> Vec<Vec3> {
        let panels = walls.sourced(time);
        let sources = walls.solve(&panels, &vec![Vec3::zeros(); panels.len()]);
        assert!(sources.residual < 3e-3, "{}", sources.residual);
        let mut velocity = vec![Vec3::zeros(); points.len()];
        sources.add_velocity(points, &mut velocity);
        velocity
    }

    #[test]
    fn what_grows_pushes_the_air_away_by_its_volume() {
        let ball = Solid::fixed(Shape::Sphere { center: [0.0; 3], radius: 0.3 });
        let by_size = moving(ball, &[key(0, [0.0; 3], 0.0, 1.0), key(1, [0.0; 3], 0.0, 2.0)]);
        let by_vertices = mesh(&[0.0, 0.4, 1.0], |x, t| x * (0.3 + 0.3 * t as f32));
        let both = moving(
            mesh(&[0.0, 1.0], |x, t| x * (0.2 + 0.02 * t as f32)),
            &[key(0, [0.0; 3], 0.0, 1.5), key(1, [0.0; 3], 0.0, 2.4)],
        );
        // Radius and its rate at half a second.
        for (solid, radius, rate) in [
            (by_size, 0.45, 0.3),
            (by_vertices, 0.45, 0.3),
            (both, 0.21 * 1.95, 0.02 * 1.95 + 0.21 * 0.9_f32),
        ] {
            assert!(!Body::new(&solid, &solid.shape, Vec::new()).is_still());
            let walls = Walls::new(&[solid], 0.05).unwrap();
            let points =
                [[0.7, 0.0, 0.1], [0.0, -0.5, 0.2], [-0.3, 0.3, -0.3], [2.0, 1.0, -1.0]].map(Vec3::from);
            for (x, v) in points.iter().zip(velocity(&walls, &points, 0.5)) {
                let exact = x * (rate * radius * radius / x.norm().powi(3));
                assert!((v - exact).norm() < 0.02 * exact.norm(), "{x}: {v} for {exact}");
            }
            // Inside, the air has the velocity of the surface.
            let mut inside = [Vec3::zeros()];
            walls.set_solid_velocity(&[Vec3::x() * (0.9 * radius)], &mut inside, 0.5);
            assert!((inside[0].x / rate - 0.95).abs() < 0.06, "{inside:?} for {rate}");
            assert!(walls.fastest(0.0, 1.0) >= f64::from(rate) - 1e-6);
            assert_eq!(walls.fastest(1.0, 2.0), 0.0);
            let mut near = [Vec3::x() * (0.9 * radius)];
            assert_eq!(walls.project_out(&mut near, 0.01, 0.5), 1);
            assert!((near[0].norm() - radius - 0.01).abs() < 0.006, "{near:?}");
        }
    }

    #[test]
    fn vertices_that_move_rigidly_move_the_air_as_keyframes_do() {
        let ellipsoid = |x: Vec3| x.component_mul(&Vec3::from(RADII));
        let keys = [key(0, [0.0; 3], 0.0, 1.0), key(1, [0.6, 0.2, 0.0], 60.0, 1.0)];
        let pose = |t: f64| {
            moving(Solid::fixed(Shape::Sphere { center: [0.0; 3], radius: 1.0 }), &keys)
                .motion
                .unwrap()
                .pose(t)
        };
        let times: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
        let by_vertices = mesh(&times, |x, t| pose(t).to_world(ellipsoid(x)));
        let by_keys = moving(Solid::fixed(Shape::Ellipsoid { center: [0.0; 3], radii: RADII }), &keys);
        let [by_vertices, by_keys] = [by_vertices, by_keys].map(|solid| Walls::new(&[solid], 0.06).unwrap());
        let around = [[0.6, 0.0, 0.1], [0.0, -0.4, 0.2], [-0.1, 0.4, -0.3], [1.0, 1.0, -1.0]].map(Vec3::from);
        for time in [0.3, 0.525] {
            let points = around.map(|x| x + pose(time).position);
            let [found, expected] = [&by_vertices, &by_keys].map(|walls| velocity(walls, &points, time));
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).norm() < 0.05 * expected.norm() + 2e-3, "{found} for {expected}");
            }
            let omega = 60.0_f32.to_radians();
            for walls in [&by_vertices, &by_keys] {
                let turning = &walls.turning(time, Spun::at(0.25), 0.0)[0];
                for spin in [turning.spin, turning.before] {
                    assert!((spin - Vec3::z() * omega).norm() < 0.01 * omega, "{spin}");
                }
                // Along the surface too: at the ends and in the middle.
                for placed in &turning.panels {
                    let exact = Vec3::new(0.6, 0.2, 0.0)
                        + (Vec3::z() * omega).cross(&(placed.panel.x - pose(time).position));
                    assert!((placed.velocity - exact).norm() < 0.02, "{} for {exact}", placed.velocity);
                }
            }
        }
    }

    #[test]
    fn sources_may_come_where_the_largest_shape_has_none() {
        // A ball that becomes a plate too thin for sources, and its growth along one axis before.
        let plate = || {
            mesh(&[0.0, 0.5, 1.0], |x, t| match t {
                0.0 => x * 0.2,
                0.5 => x.component_mul(&Vec3::new(0.3, 0.2, 0.2)),
                _ => x.component_mul(&Vec3::new(0.8, 0.8, 0.03)),
            })
        };
        let points = [[0.6, 0.1, 0.0], [-0.1, 0.5, 0.2]].map(Vec3::from);
        let walls = Walls::new(&[plate()], 0.08).unwrap();
        assert!(walls.sourced(1.0).is_empty() && !walls.turning(0.1, Spun::at(0.0), 0.0).is_empty());
        velocity(&walls, &points, 0.1);
        let found = velocity(&walls, &points, 0.4);
        assert_eq!(found, velocity(&Walls::new(&[plate()], 0.08).unwrap(), &points, 0.4));
        assert!(found[0].x > 0.008, "{found:?}");
        // The largest shape has none for good where it only changes its size.
        let ball = Solid::fixed(Shape::Sphere { center: [0.0; 3], radius: 0.01 });
        let small = moving(ball, &[key(0, [0.0; 3], 0.0, 1.0), key(1, [0.0; 3], 0.0, 2.0)]);
        let walls = Walls::new(&[small], 0.08).unwrap();
        assert!(walls.sourced(0.5).is_empty() && walls.sourceless() == [0]);
    }

    #[test]
    fn one_size_at_all_times_is_no_change() {
        let ball = Solid::fixed(Shape::Sphere { center: [0.1, 0.0, 0.0], radius: 0.2 });
        let twice = moving(ball, &[key(0, [0.0; 3], 0.0, 2.0), key(1, [1.0, 0.0, 0.0], 0.0, 2.0)]);
        let by_hand = moving(
            Solid::fixed(Shape::Sphere { center: [0.2, 0.0, 0.0], radius: 0.4 }),
            &[key(0, [0.0; 3], 0.0, 1.0), key(1, [1.0, 0.0, 0.0], 0.0, 1.0)],
        );
        let [twice, by_hand] = [twice, by_hand].map(|solid| Walls::new(&[solid], 0.1).unwrap());
        assert!(!twice.is_deforming(0));
        for (a, b) in twice.placed(0.5).iter().zip(&by_hand.placed(0.5)) {
            assert_eq!((a.panel.x, a.velocity, a.arm), (b.panel.x, b.velocity, b.arm));
        }
    }

    #[test]
    fn panels_move_with_a_mesh() {
        // A bar that becomes four times as long, in wind of which the panels keep out most at each length.
        let bar = mesh(&[0.0, 1.0], |x, t| x.component_mul(&Vec3::new(0.3 + 0.9 * t as f32, 0.3, 0.3)));
        let walls = Walls::new(&[bar], 0.02).unwrap();
        let counts = [0.0, 0.5, 1.0].map(|time| walls.placed(time).len());
        assert!(counts[0] > 300 && counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
        // Those of a mesh that only moves keep their places on it.
        let gliding = mesh(&[0.0, 1.0], |x, t| x * 0.4 + Vec3::new(0.7, 0.0, 0.3) * t as f32);
        let walls = Walls::new(&[gliding], 0.08).unwrap();
        let [first, second] = [0.0, 0.37].map(|time| walls.placed(time));
        assert_eq!(first.len(), second.len());
        for (a, b) in first.iter().zip(&second) {
            let moved = b.panel.x - a.panel.x - Vec3::new(0.7, 0.0, 0.3) * 0.37;
            assert!(moved.norm() < 0.02, "{moved}");
        }
    }
}
