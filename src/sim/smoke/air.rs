//! Air velocity of a shot: vortons, wind, and solids without normal flow.

use super::{
    body::{Placed, PlacedForm},
    params::SmokeParams,
    sources::Sources,
    walls::{Spun, Turning, Walls},
};
use crate::{
    math::Vec3,
    par,
    sim::{
        World,
        vortex::{
            ElementKind, Gradient, Kernel, Method, OutOfRange, Quantity, Targets, Vortons,
            flow::{ExternalEffects, Rates, Stage},
            induced, induced_both,
        },
    },
};
use std::sync::Arc;

/// Wind and solids of a shot, and how induced velocities are summed.
#[derive(Clone, Debug)]
pub(super) struct Air {
    wind: Vec3,
    /// Component of the wind normal to a plane, which is removed [m/s].
    pub(super) across: f32,
    kernel: Kernel,
    method: Method,
    /// Solids; they are the same for all frames, at other poses.
    pub(super) walls: Option<Arc<Walls>>,
    /// Start of the step, and its end at the latest [s].
    pub(super) span: [f64; 2],
    /// Longest step in which the wind does not advect a vorton past another [s].
    longest: f64,
    /// Core of new vortons [m].
    core: f32,
    /// Thickness of the layer in which air slips along solids that shed [m].
    pub(super) layer: Option<f32>,
}

/// Vortons at an instant, and the sources in solids for them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant<'a> {
    pub(super) vortons: &'a Vortons,
    pub(super) sources: &'a Sources,
}

/// Leakage of a solid: RMS of the air's normal velocity at its surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leak {
    /// Index of the solid.
    pub(super) body: usize,
    /// RMS without sources [m/s].
    free: f64,
    /// RMS with sources, as a fraction of `free`.
    pub(super) part: f64,
}

/// Fraction of the largest normal velocity of any solid below which a solid's leakage is not reported. Smaller, and the figure is the
/// residual of the equations, 1e-4 of all; larger, and leakage where the air is slow is not seen.
const MIN_NORMAL_FLOW: f64 = 0.01;

impl Air {
    pub(super) fn new(params: &SmokeParams, world: &World) -> Self {
        let walls = Walls::new(&world.solids, params.spacing).map(Arc::new);
        let given = params.wind.map_or(Vec3::zeros(), Vec3::from);
        let wind = walls.as_ref().map_or(given, |walls| walls.along(given));
        // A rounding error is no wind.
        let across =
            Some((given - wind).norm()).filter(|across| *across > 1e-5 * given.norm()).unwrap_or(0.0);
        let flow = &params.flow;
        let method = flow.method();
        let longest = f64::from(params.core()) / f64::from(wind.norm());
        let sheds = params.shedding.as_ref().filter(|shedding| shedding.strength > 0.0 && walls.is_some());
        Self {
            wind,
            across,
            kernel: flow.kernel,
            method,
            walls,
            span: [0.0; 2],
            longest,
            core: params.core(),
            layer: sheds.map(|shedding| shedding.layer * params.spacing),
        }
    }

    /// The solids where they are at `time` [s].
    pub(super) fn solids(&self, time: f64) -> Vec<PlacedForm> {
        self.walls.as_ref().map_or_else(Vec::new, |walls| walls.at(time))
    }

    /// Whether a point is outside all solids at `time` [s].
    pub(super) fn outside_solids(&self, time: f64) -> impl Fn(Vec3) -> bool + use<> {
        let solids = self.solids(time);
        move |x| !solids.iter().any(|solid| solid.contains(x))
    }

    /// The longest step between two times [s] in which no solid passes over smoke [s].
    pub(super) fn max_step_for_solids(&self, [from, to]: [f64; 2]) -> f64 {
        let Some(walls) = &self.walls else { return f64::INFINITY };
        let fastest = walls.fastest(from, to);
        if fastest > 0.0 {
            f64::from(walls.max_displacement(self.core, from)) / fastest
        } else {
            f64::INFINITY
        }
    }

    /// The sources in solids at `time` [s] for `vortons`, which contain the opposite of the angular velocity `spun`. The sources include
    /// the solids' own vorticity for `spun`: one without the other would turn all the air.
    ///
    /// # Errors
    /// If a vorton or a panel is outside what the sums can hold.
    pub(super) fn sources(&self, vortons: &Vortons, time: f64, spun: Spun) -> Result<Sources, OutOfRange> {
        let Some(walls) = &self.walls else { return Ok(Sources::default()) };
        let panels = walls.sourced(time);
        let at: Vec<Vec3> = panels.iter().map(|placed| placed.panel.x).collect();
        let spin = self.spin(time, spun);
        spin.check().map_err(|error| OutOfRange { kind: ElementKind::Panels, ..error })?;
        let mut free = self.free(vortons, &at)?;
        self.add(&spin, &at, &mut free)?;
        Ok(Sources { spin, ..walls.solve(&panels, &free) })
    }

    /// The velocity of the air at points [m/s].
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub(super) fn velocity(&self, instant: Instant<'_>, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        let mut velocity = self.free(instant.vortons, points)?;
        self.add(&instant.sources.spin, points, &mut velocity)?;
        instant.sources.add_velocity(points, &mut velocity);
        Ok(velocity)
    }

    /// The velocity without that of sources [m/s].
    fn free(&self, vortons: &Vortons, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        let mut velocity = vec![Vec3::zeros(); points.len()];
        self.add(vortons, points, &mut velocity)?;
        self.add_wind(&mut velocity);
        Ok(velocity)
    }

    /// Vorticity of solids with the angular velocity of `spun` at `time` [s], as vortons on their panels. The vortex sheet n × (Ω × r)
    /// induces outside what the 2Ω inside does, except for what the sources cancel. None without shedding: air slips along then.
    fn spin(&self, time: f64, spun: Spun) -> Vortons {
        let mut spin = Vortons::default();
        let (Some(walls), Some(layer)) = (&self.walls, self.layer) else { return spin };
        for Turning { panels, before, .. } in walls.turning(time, spun, 0.5 * layer) {
            for Placed { panel, arm, .. } in panels.iter().filter(|_| before != Vec3::zeros()) {
                spin.position.push(panel.x);
                spin.strength.push(panel.normal.cross(&before.cross(arm)) * panel.area);
                spin.core.push(self.core.max(panel.width));
            }
        }
        spin
    }

    /// Adds the velocity that `vortons` and their mirror images induce at points.
    fn add(&self, vortons: &Vortons, points: &[Vec3], velocity: &mut [Vec3]) -> Result<(), OutOfRange> {
        if vortons.is_empty() || points.is_empty() {
            return Ok(());
        }
        let found = self.induced(vortons, points)?;
        par::update(velocity, |i, v| *v += found[i]);
        self.add_images(vortons, points, velocity)
    }

    /// Adds velocity and gradient that `moving` induces at vortons and tracers. With `mirror` the positions are mirror images, and what is
    /// induced there is reflected.
    fn add_induced_rates(
        &self,
        moving: &Vortons,
        [vortons, passengers]: [&[Vec3]; 2],
        mirror: Option<&Walls>,
        rates: &mut Rates,
    ) -> Result<(), OutOfRange> {
        if moving.is_empty() {
            return Ok(());
        }
        let at = Targets::Points(vortons);
        let (found, along) = induced_both(moving, at, passengers, self.kernel, self.method)?;
        let reflect = |v: Vec3| mirror.map_or(v, |walls| walls.reflect(v));
        let reflect_gradient = |g: &Gradient| mirror.map_or(*g, |walls| walls.reflect_gradient(g));
        par::update(&mut rates.velocity, |i, v| *v += reflect(found.velocity[i]));
        par::update(&mut rates.gradient, |i, g| *g += reflect_gradient(&found.gradient[i]));
        par::update(&mut rates.tracers, |i, v| *v += reflect(along[i]));
        Ok(())
    }

    fn induced(&self, vortons: &Vortons, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        Ok(induced(vortons, Targets::Points(points), Quantity::Velocity, self.kernel, self.method)?.velocity)
    }

    /// Adds the vector potential of `vortons` and their mirror images at points [m²/s].
    pub(super) fn add_vector_potential(
        &self,
        vortons: &Vortons,
        points: &[Vec3],
        potential: &mut [Vec3],
    ) -> Result<(), OutOfRange> {
        if vortons.is_empty() || points.is_empty() {
            return Ok(());
        }
        let find = |points: &[Vec3]| {
            induced(vortons, Targets::Points(points), Quantity::Potential, self.kernel, self.method)
        };
        let found = find(points)?.potential;
        par::update(potential, |i, a| *a += found[i]);
        let walls = self.walls.as_ref();
        if let Some((walls, mirrored)) = walls.and_then(|walls| Some((walls, walls.mirrored(points)?))) {
            // A reflection turns the sense of rotation, so an axial vector is reflected and reversed.
            let found = find(&mirrored)?.potential;
            par::update(potential, |i, a| *a -= walls.reflect(found[i]));
        }
        Ok(())
    }

    /// Adds the velocity that the mirror images of `vortons` induce at points: the velocity at mirrored points, reflected.
    fn add_images(
        &self,
        vortons: &Vortons,
        points: &[Vec3],
        velocity: &mut [Vec3],
    ) -> Result<(), OutOfRange> {
        let walls = self.walls.as_ref();
        if let Some((walls, mirrored)) = walls.and_then(|walls| Some((walls, walls.mirrored(points)?))) {
            let found = self.induced(vortons, &mirrored)?;
            par::update(velocity, |i, v| *v += walls.reflect(found[i]));
        }
        Ok(())
    }

    fn add_wind(&self, velocity: &mut [Vec3]) {
        let wind = self.wind;
        if wind != Vec3::zeros() {
            par::update(velocity, |_, v| *v += wind);
        }
    }

    /// The largest leakage of any solid, relative to the normal flow without sources. `None` without solids, or without normal flow. Solids
    /// with a small normal flow do not count.
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub(super) fn max_leakage(&self, instant: Instant<'_>, time: f64) -> Result<Option<Leak>, OutOfRange> {
        let found = self.leaks(instant, time)?;
        let largest = found.iter().map(|leak| leak.free).fold(0.0, f64::max);
        // NaN counts, as the largest leakage.
        let relevant =
            found.into_iter().filter(|leak| leak.free.is_nan() || leak.free > MIN_NORMAL_FLOW * largest);
        let badness = |leak: &Leak| if leak.part.is_nan() { f64::INFINITY } else { leak.part };
        Ok(relevant.max_by(|a, b| badness(a).total_cmp(&badness(b))))
    }

    /// The leakage of every solid with panels.
    fn leaks(&self, instant: Instant<'_>, time: f64) -> Result<Vec<Leak>, OutOfRange> {
        let Some(walls) = &self.walls else { return Ok(Vec::new()) };
        let witnesses = walls.leakage_points(time);
        let at: Vec<Vec3> = witnesses.iter().flatten().map(|placed| placed.panel.x).collect();
        let (mut free, left) = (self.free(instant.vortons, &at)?, self.velocity(instant, &at)?);
        self.add(&instant.sources.spin, &at, &mut free)?;
        let mut start = 0;
        let mut found = Vec::new();
        for (body, witnesses) in witnesses.iter().enumerate().filter(|(_, witnesses)| !witnesses.is_empty()) {
            let end = start + witnesses.len();
            let mean = |air: &[Vec3]| {
                let along = |(Placed { panel, velocity, .. }, air): (&Placed, &Vec3)| {
                    f64::from(panel.normal.dot(&(air - velocity))).powi(2)
                };
                (witnesses.iter().zip(air).map(along).sum::<f64>() / witnesses.len() as f64).sqrt()
            };
            let free = mean(&free[start..end]);
            found.push(Leak { body, free, part: mean(&left[start..end]) / free });
            start = end;
        }
        Ok(found)
    }
}

impl ExternalEffects for Air {
    fn add_rates(&mut self, now: Stage<'_>, rates: &mut Rates) -> Result<(), OutOfRange> {
        let vortons = now.vortons;
        self.add_wind(&mut rates.velocity);
        self.add_wind(&mut rates.tracers);
        let Some(walls) = &self.walls else { return Ok(()) };
        let time = self.span[0] + now.seconds;
        let sources = self.sources(vortons, time, Spun::at(self.span[0]))?;
        self.add_induced_rates(&sources.spin, [&vortons.position, now.tracers], None, rates)?;
        if let Some((at, along)) = walls.mirrored(&vortons.position).zip(walls.mirrored(now.tracers)) {
            for moving in [vortons, &sources.spin] {
                self.add_induced_rates(moving, [&at, &along], Some(walls), rates)?;
            }
        }
        sources.add_velocity(&vortons.position, &mut rates.velocity);
        sources.add_gradient(&vortons.position, &mut rates.gradient);
        sources.add_velocity(now.tracers, &mut rates.tracers);
        // Air sticks to solids that shed: towards the surface of their layer, stretching goes to zero as the
        // velocity along the solid does.
        if let Some(layer) = self.layer {
            let heights = walls.heights(&vortons.position, layer, time);
            par::update(&mut rates.gradient, |i, g| *g *= (heights[i].0 / layer).max(0.0));
        }
        Ok(())
    }

    fn max_time_step(&self) -> f64 {
        self.longest.min(self.max_step_for_solids(self.span))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sdf::Sampled,
        solid::{Interpolation, Keyframe, MeshShape, Motion, Shape, Solid},
    };

    /// Leakage of each of some solids in wind, and the one that is reported.
    fn leaks(shapes: &[Shape], spacing: f32) -> (Vec<Leak>, Leak) {
        leaks_with(&Vortons::default(), shapes, spacing)
    }

    fn leaks_with(vortons: &Vortons, shapes: &[Shape], spacing: f32) -> (Vec<Leak>, Leak) {
        let solids = shapes.iter().map(|shape| Solid::fixed(shape.clone())).collect();
        let params = crate::from_toml(&format!("spacing = {spacing}\nwind = [1, 0.5, 0]"));
        let air = Air::new(&params, &World { gravity: Vec3::zeros(), solids });
        let sources = air.sources(vortons, 0.0, Spun::at(0.0)).unwrap();
        assert!(sources.residual < 0.01, "{}", sources.residual);
        let instant = Instant { vortons, sources: &sources };
        (air.leaks(instant, 0.0).unwrap(), air.max_leakage(instant, 0.0).unwrap().unwrap())
    }

    #[test]
    fn a_small_ball_next_to_a_large_box_keeps_air_out() {
        let floor = Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] };
        let ball = Shape::Sphere { center: [0.0, 0.0, 1.0], radius: 0.1 };
        let (alone, _) = leaks(std::slice::from_ref(&ball), 0.025);
        let (both, reported) = leaks(&[ball, floor], 0.025);
        assert!(alone[0].part < 0.01, "{alone:?}");
        // Next to the box the air is not uniform: the box turns it, and leaks between its panels, each as wide as six such balls.
        assert!(both[0].part < 0.05, "{both:?}");
        assert_eq!((reported.body, reported.part), (1, both[1].part), "the edges of the box are the worst");
    }

    /// The air in a wind of 1 m/s along x above a floor, with a solid.
    fn air_over_floor(solid: Solid) -> Air {
        let floor = Solid::fixed(Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] });
        let params = crate::from_toml("spacing = 0.08\nwind = [1, 0, 0]");
        Air::new(&params, &World { gravity: Vec3::zeros(), solids: vec![solid, floor] })
    }

    /// Velocities there at points at a time, and the sources.
    fn over_floor(air: &Air, time: f64, points: &[Vec3]) -> (Vec<Vec3>, Sources) {
        let vortons = Vortons::default();
        let sources = air.sources(&vortons, time, Spun::at(time)).unwrap();
        let instant = Instant { vortons: &vortons, sources: &sources };
        (air.velocity(instant, points).unwrap(), sources)
    }

    #[test]
    fn solids_have_no_sources_below_the_floor() {
        let ball =
            |height| air_over_floor(Solid::fixed(Shape::Sphere { center: [0.0, 0.0, height], radius: 0.5 }));
        // Half of a ball on a floor is a whole ball in potential flow: 1 + R³/(2 r³) above it.
        let (half, sources) = over_floor(&ball(0.0), 0.0, &[Vec3::new(0.0, 0.0, 0.6)]);
        let exact = 1.0 + 0.5_f32.powi(3) / (2.0 * 0.6_f32.powi(3));
        assert!((half[0].x / exact - 1.0).abs() < 0.02 && sources.residual < 1e-3, "{half:?} {exact}");

        // A cap of 20 cm keeps the air out. One of 2 cm is too flat for sources and shed vorticity, and is reported; the image of the
        // rest of its ball would be 98 cm high.
        let (cap, vortons) = (ball(-0.3), Vortons::default());
        let (_, sources) = over_floor(&cap, 0.0, &[]);
        let leak = cap.leaks(Instant { vortons: &vortons, sources: &sources }, 0.0).unwrap();
        assert!(leak[0].part < 0.25 && !sources.points.is_empty(), "{leak:?}");
        let (flat, points) = (ball(-0.48), [Vec3::new(0.0, 0.0, 0.3), Vec3::new(-0.5, 0.0, 0.3)]);
        let (velocity, _) = over_floor(&flat, 0.0, &points);
        assert!(velocity.iter().all(|v| (v - Vec3::x()).norm() < 0.01), "{velocity:?}");
        let walls = flat.walls.unwrap();
        assert!(walls.sourceless() == [0] && walls.turning(0.0, Spun::at(0.0), 0.04).is_empty());
        assert_eq!(walls.heights(&[Vec3::new(0.0, 0.0, 0.06)], 1.0, 0.0), [(1.0, 0)]);
        assert!(ball(-0.6).walls.unwrap().sourceless().is_empty(), "it is not in the air");
    }

    #[test]
    fn faces_in_the_floor_have_no_sources() {
        // Flush with the floor, and standing on it: five faces of 5 × 5 panels or fewer.
        let cuboid =
            |low: f32| Solid::fixed(Shape::Box { min: [-0.2, -0.2, low], max: [0.2, 0.2, low + 0.4] });
        let (velocity, sources) = over_floor(&air_over_floor(cuboid(-0.4)), 0.0, &[Vec3::new(0.0, 0.0, 0.1)]);
        assert!(sources.tiles.is_empty() && velocity[0] == Vec3::x());
        let (_, sources) = over_floor(&air_over_floor(cuboid(0.0)), 0.0, &[]);
        assert!(sources.residual < 1e-3 && sources.tiles.iter().all(|(tile, _)| tile.axes[2].z > -0.5));
    }

    #[test]
    fn coefficients_are_kept_for_solids_that_stand_still_alone() {
        let shape = Shape::Sphere { center: [0.0, 0.0, 0.6], radius: 0.3 };
        let key = |frame, x| Keyframe {
            frame,
            position: [x, 0.0, 0.0],
            rotation: [0.0; 3],
            quaternion: None,
            scale: 1.0,
        };
        let motion = Motion::new(&[key(0, 0.0), key(2, 2.0)], Interpolation::Linear, 1.0, 0);
        let moving = Solid { motion, ..Solid::fixed(shape.clone()) };
        let points = [Vec3::new(0.5, 0.0, 0.9), Vec3::new(1.5, 0.2, 0.9)];
        for solid in [Solid::fixed(shape), moving] {
            let air = air_over_floor(solid.clone());
            let [first, second] = [0.0, 1.0].map(|time| over_floor(&air, time, &points).0);
            assert_eq!(second, over_floor(&air_over_floor(solid.clone()), 1.0, &points).0);
            assert_eq!(first == second, solid.motion.is_none());
        }
    }

    /// A ring of vortons about the z axis.
    fn ring(height: f32) -> Vortons {
        let angle = |n: usize| std::f32::consts::TAU * n as f32 / 200.0;
        let at = |n: usize| Vec3::new(angle(n).cos(), angle(n).sin(), 0.0);
        Vortons {
            position: (0..200).map(|n| at(n) + Vec3::new(0.0, 0.0, height)).collect(),
            strength: (0..200).map(|n| Vec3::z().cross(&at(n)) * 0.3).collect(),
            core: vec![0.1; 200],
        }
    }

    #[test]
    fn boxes_of_any_size_over_the_spacing_keep_air_out() {
        let large = Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] };
        for spacing in [0.06, 1.1, 1.36, 1.5, 2.5, 5.0] {
            for vortons in [Vortons::default(), ring(3.0)] {
                let (found, _) = leaks_with(&vortons, std::slice::from_ref(&large), spacing);
                let allowed = if spacing < 4.0 { 0.35 } else { 0.5 };
                assert!(found[0].part < allowed, "{spacing}: {found:?}");
            }
        }
        // As thin as some panels are wide.
        for (thick, allowed) in [(0.5, 0.9), (1.0, 0.7), (2.0, 0.5), (3.0, 0.45), (4.0, 0.4)] {
            let plate = Shape::Box { min: [0.0, -6.0, -6.0], max: [thick, 6.0, 6.0] };
            let (found, _) = leaks(&[plate], 1.0);
            assert!(found[0].part < allowed, "{thick}: {found:?}");
        }
    }

    /// Samples of the union of boxes, 0.25 m apart, as a mesh of them has.
    fn sampled(boxes: &[Shape], rotate: [f32; 3]) -> Shape {
        let (nodes, voxel, origin) = ([53_u32, 37, 37], 0.25, Vec3::repeat(-4.5));
        let at = |n: u32| Vec3::new((n % 53) as f32, (n / 53 % 37) as f32, (n / 53 / 37) as f32);
        let distance = |n: u32| {
            let x = at(n) * voxel + origin;
            boxes.iter().map(|shape| shape.signed_distance(x)).fold(f32::INFINITY, f32::min)
        };
        let values = (0..nodes.iter().product()).map(distance).collect();
        let mut mesh = MeshShape::new("boxes.ply");
        mesh.rotate = rotate;
        mesh.fill(Arc::new(Sampled { origin, voxel, nodes, values }));
        Shape::Mesh(mesh)
    }

    #[test]
    fn sampled_boxes_keep_air_out_at_any_angle() {
        let cuboid = Shape::Box { min: [-4.0; 3], max: [4.0; 3] };
        let meshes =
            [[0.0; 3], [20.0, 0.0, 70.0]].map(|rotate| sampled(std::slice::from_ref(&cuboid), rotate));
        for spacing in [0.48, 0.5, 0.53, 0.55, 0.6, 0.66, 0.75, 0.8, 0.9] {
            for mesh in &meshes {
                let (found, _) = leaks(std::slice::from_ref(mesh), spacing);
                assert!(found[0].part < 0.45, "{spacing}: {found:?}");
            }
        }
    }

    #[test]
    fn fins_of_meshes_leak_less_than_without_sources() {
        let cuboid = Shape::Box { min: [-4.0; 3], max: [4.0; 3] };
        for thick in [0.45, 0.5, 0.55, 0.6, 0.8, 1.2, 2.0] {
            // The grid's position determines which panels have sources.
            for aside in [0.0, 0.15, 0.45] {
                let (low, high) = (aside - 0.5 * thick, aside + 0.5 * thick);
                let fin = Shape::Box { min: [3.9, low, -3.0], max: [7.5, high, 3.0] };
                let (found, _) = leaks(&[sampled(&[cuboid.clone(), fin], [0.0; 3])], 1.0);
                assert!(found[0].part < 0.8, "{thick} {aside}: {found:?}");
            }
        }
    }

    #[test]
    fn thin_parts_of_a_figure_have_no_sources_that_cancel() {
        // With panels of this width two sides of a hand have nearly the same equation: three times the wind was left.
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("presets/assets/walker.ply");
        let mesh = crate::import::parse_triangles(&file, &std::fs::read(&file).unwrap()).unwrap();
        let mut shape = MeshShape::new("walker.ply");
        shape.fill(Arc::new(crate::sdf::from_triangles(&mesh, 128).unwrap().field));
        let (_, found) = leaks(&[Shape::Mesh(shape)], 0.05);
        assert!(found.part < 0.6, "{found:?}");
    }

    #[test]
    fn ellipsoids_have_no_edges() {
        for radii in [[6.0, 2.2, 2.2], [7.0, 2.5, 4.0]] {
            let (found, _) = leaks(&[Shape::Ellipsoid { center: [0.0; 3], radii }], 1.0);
            assert!(found[0].part < 0.1, "{radii:?}: {found:?}");
        }
    }

    #[test]
    fn a_ball_without_sources_is_the_worst_and_is_named() {
        let large = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
        let tiny = Shape::Sphere { center: [3.0, 0.0, 0.0], radius: 0.005 };
        let solids = vec![Solid::fixed(large.clone()), Solid::fixed(tiny.clone())];
        let walls = Walls::new(&solids, 0.1).unwrap();
        assert_eq!(walls.sourceless(), [1]);
        let (_, found) = leaks(&[large, tiny], 0.1);
        assert!(found.body == 1 && found.part > 0.9, "{found:?}");
    }
}
