//! The liquid's state: seeded, restored from a frame, and written to one.

use super::{
    FlowTotals, Liquid, LiquidChannel, LiquidParams, LiquidSeeds, NAME, ThinSolid,
    accelerated::Momentum,
    calibration::RestState,
    flow::BIRTH,
    inflow::Inflow,
    micropolar::Microrotation,
    outflow::Outflow,
    record::FRAME_FIGURES,
    repulsion::Repulsion,
    seed,
    solve::Solver,
    submerged::{FREE_KERNEL_RADIUS, submerged_body},
    surface_tension::Tension,
    viscosity::ViscositySolver,
    vorticity::Confinement,
    walls::Walls,
};
use crate::{
    frame::{Stream, StreamKind},
    math::Vec3,
    par,
    sim::{SetupError, Timeline, World},
    solid::{RigidBody, Solid},
};

/// Kinematic viscosity with which eddies fade without viscosity, over speed times spacing: 0.5 to 1.1 for four eddies in a
/// square of 0.4 m at 1 m/s, 1 and 2 cm spacing, after the first 0.1 s (docs/decisions/018).
const EDDY_DISSIPATION: f64 = 0.5;

/// Name of the channel of the microrotation.
const MICROROTATION: &str = "microrotation";

/// The solids that are thinner than the kernel reaches between particles half a spacing from both of their sides.
fn thin_solids(rest: &RestState, colliders: &[Solid], bodies: &[Solid]) -> Vec<ThinSolid> {
    let sufficient = rest.support - rest.spacing;
    let thin = |solids: &[Solid], is_body: bool| {
        let thickness =
            solids.iter().map(|solid| 2.0 * solid.shape.inner_radius() * solid.scales()[0]).enumerate();
        let thin = thickness.filter(|&(_, thickness)| thickness < 0.999 * sufficient);
        let of = |(index, thickness): (usize, f32)| ThinSolid {
            index: index as u32,
            is_body,
            thickness: f64::from(thickness),
            sufficient_thickness: f64::from(sufficient),
        };
        thin.map(of).collect::<Vec<_>>()
    };
    [thin(colliders, false), thin(bodies, true)].concat()
}

/// Resolution of positions above which slow motion stops, in spacings: gravity moves a particle at rest by about 0.003 spacings in a
/// substep of 5 ms at a spacing of 10 cm, and displacements below half of the resolution are lost.
const MAX_RESOLUTION: f64 = 1e-3;

impl Liquid {
    /// Fills the sources with particles.
    pub(in crate::sim) fn seed(
        params: LiquidParams,
        world: &World,
        bodies: (&[Solid], &[RigidBody]),
        timeline: Timeline,
    ) -> Result<Self, SetupError> {
        let mut liquid = Self::empty(params, world, bodies, timeline)?;
        let seeds = seed::seed(&liquid.params, &liquid.rest, &liquid.walls)?;
        if seeds.positions.is_empty() && !liquid.inflow.as_ref().is_some_and(Inflow::has_columns) {
            return Err(SetupError::NoParticles);
        }
        liquid.id = (0..seeds.report.particles).collect();
        (liquid.x, liquid.v, liquid.seeded) = (seeds.positions, seeds.velocities, seeds.report);
        liquid.start_flow(timeline);
        liquid.seeded.thin_solids = thin_solids(&liquid.rest, &world.solids, bodies.0);
        liquid.seeded.precise_distance =
            MAX_RESOLUTION * f64::from(liquid.rest.spacing) / f64::from(f32::EPSILON);
        let farthest = par::max(liquid.x.len(), |i| liquid.x[i].amax()).map_or(0.0, |(_, at)| f64::from(at));
        if farthest > liquid.seeded.precise_distance {
            liquid.seeded.far_from_origin = farthest;
        }
        if liquid.has_sources {
            for (source, &end) in (0..).zip(&seeds.ends) {
                liquid.source.resize(end as usize, source);
            }
        }
        if let Some(microrotation) = &mut liquid.microrotation {
            microrotation.spin = vec![Vec3::zeros(); liquid.x.len()];
        }
        liquid.first_energy = liquid.state_energy();
        let viscosities = liquid.params.viscosities();
        if !viscosities.is_empty() {
            let speed = liquid.expected_speed();
            liquid.seeded.rows_hold_bodies =
                liquid.walls.rigid_bodies() > 0 && liquid.params.kernel_radius < FREE_KERNEL_RADIUS;
            liquid.seeded.viscosity = f64::from(viscosities.into_iter().fold(0.0, f32::max));
            liquid.seeded.speed = speed;
            liquid.seeded.solver_viscosity = f64::from(liquid.params.density)
                * EDDY_DISSIPATION
                * speed
                * f64::from(liquid.params.spacing);
        }
        if liquid.seeded.viscosity <= liquid.seeded.solver_viscosity {
            liquid.seeded.submerged_body = submerged_body(&liquid.params, bodies);
        }
        Ok(liquid)
    }

    /// Dynamic viscosity of each particle [Pa·s].
    fn viscosities(&self) -> Vec<f32> {
        let by_source = self.params.viscosities();
        match &self.params.viscosity {
            Some(viscosity) if !self.has_sources => vec![viscosity.dynamic; self.x.len()],
            _ => self.source.iter().map(|&source| by_source[source as usize]).collect(),
        }
    }

    /// Largest speed of the particles plus that of falling through their height [m/s].
    fn expected_speed(&self) -> f64 {
        let (x, v, g) = (&self.x, &self.v, self.gravity);
        let largest = |f: &(dyn Fn(usize) -> f32 + Sync)| par::max(x.len(), f).map_or(0.0, |(_, most)| most);
        let fall = largest(&|i| g.dot(&x[i])) + largest(&|i| -g.dot(&x[i]));
        f64::from(largest(&|i| v[i].norm())) + f64::from(2.0 * fall.max(0.0)).sqrt()
    }

    /// Restores the state from a frame's stream, at `time` since the shot's start [s].
    pub(in crate::sim) fn restore(
        params: LiquidParams,
        world: &World,
        bodies: (&[Solid], &[RigidBody]),
        stream: &Stream,
        (timeline, time): (Timeline, f64),
    ) -> Result<Self, SetupError> {
        let missing = |what| SetupError::Missing { stream: NAME, what };
        let mut liquid = Self::empty(params, world, bodies, timeline)?;
        liquid.walls.place_at(time);
        liquid.x = stream.vec3("position").ok_or(missing("position"))?.to_vec();
        liquid.v = stream.vec3("velocity").ok_or(missing("velocity"))?.to_vec();
        liquid.id = stream.u32("id").ok_or(missing("id"))?.to_vec();
        if liquid.has_sources {
            let name = LiquidChannel::Source.name();
            let count = (liquid.params.source.len() + liquid.params.emitter.len()) as u32;
            let is_valid = |source: &&[u32]| source.iter().all(|&source| source < count);
            liquid.source = stream.u32(name).filter(is_valid).ok_or(missing(name))?.to_vec();
        }
        liquid.restore_flow(stream)?;
        if let Some(microrotation) = &mut liquid.microrotation {
            microrotation.spin = stream.vec3(MICROROTATION).ok_or(missing(MICROROTATION))?.to_vec();
        }
        liquid.first_energy = stream.scalar("first_energy").ok_or(missing("first_energy"))?;
        let count = |name| stream.scalar(name).map(|value| value as u32).ok_or(missing(name));
        liquid.seeded = LiquidSeeds {
            particles: liquid.x.len() as u32,
            skipped_in_solids: count("skipped_in_solids")?,
            skipped_overlapping: count("skipped_overlapping")?,
            ..LiquidSeeds::default()
        };
        let figures = FRAME_FIGURES.map(|(name, _)| stream.scalar(name));
        liquid.figures = figures.iter().all(Option::is_some).then(|| figures.map(Option::unwrap_or_default));
        let is_flowing = liquid.inflow.is_some() || liquid.outflow.is_some();
        if liquid.x.is_empty() && !is_flowing { Err(SetupError::NoParticles) } else { Ok(liquid) }
    }

    /// A liquid without particles, with rigid bodies as solids.
    fn empty(
        params: LiquidParams,
        world: &World,
        (solids, bodies): (&[Solid], &[RigidBody]),
        timeline: Timeline,
    ) -> Result<Self, SetupError> {
        let rest = RestState::new(params.kernel, params.spacing, params.kernel_radius);
        let mut walls = Walls::new(&world.solids, &rest);
        walls.add_rigid_bodies(solids, |number| bodies[number].density() / f64::from(params.density));
        let inflow = Inflow::new(&params, &rest, timeline)?;
        let has_channel = |channel| params.channels.contains(&channel);
        let needs_pushes = walls.has_friction_or_restitution();
        let mut liquid = Self {
            rest,
            v_before: needs_pushes.then(Vec::new),
            walls,
            gravity: world.gravity,
            forces: None,
            mass: f64::from(params.density) * f64::from(params.spacing).powi(3),
            first_energy: 0.0,
            figures: None,
            seeded: LiquidSeeds::default(),
            has_sources: has_channel(LiquidChannel::Source) || params.needs_sources(),
            has_births: inflow.is_some() && has_channel(LiquidChannel::Age),
            source: Vec::new(),
            birth: Vec::new(),
            id: Vec::new(),
            next_id: 0,
            nozzle: Vec::new(),
            inflow,
            outflow: Outflow::new(&params, timeline),
            flow_totals: FlowTotals::default(),
            x: Vec::new(),
            v: Vec::new(),
            solver: Solver::default(),
            momentum: Momentum::new(match &params.surface_tension {
                Some(tension) if world.gravity.norm() > 0.0 => tension.internal_pressure(&params),
                _ => 0.0,
            }),
            repulsion: params.artificial_pressure.clone().map(|params| Repulsion::new(params, &rest)),
            tension: params
                .surface_tension
                .as_ref()
                .map(|tension| Tension::new(tension, &params, world, solids)),
            viscosity: params
                .viscosity
                .as_ref()
                .map(|viscosity| ViscositySolver::new(viscosity, &params, &rest)),
            confinement: params.vorticity.as_ref().map(Confinement::new),
            microrotation: params.micropolar.as_ref().map(|params| Microrotation::new(params, &rest)),
            motion: Vec::new(),
            params,
        };
        liquid.place_bodies(bodies);
        Ok(liquid)
    }

    /// The state at `time` since the shot's start [s] as named columns, with everything that [`Liquid::restore`] needs.
    pub(in crate::sim) fn stream(&self, time: f64) -> Stream {
        let mut stream = Stream::new(NAME, StreamKind::Particles, self.x.len())
            .with("position", self.x.clone())
            .with("velocity", self.v.clone())
            .with("id", self.id.clone());
        for channel in self.params.frame_channels() {
            stream = match channel {
                LiquidChannel::Age if self.has_births => {
                    let age = |&birth: &f32| (time - f64::from(birth)) as f32;
                    let ages: Vec<f32> = self.birth.iter().map(age).collect();
                    stream.with(channel.name(), ages).with(BIRTH, self.birth.clone())
                }
                LiquidChannel::Age => stream.with(channel.name(), vec![time as f32; self.x.len()]),
                LiquidChannel::Source => stream.with(channel.name(), self.source.clone()),
                LiquidChannel::Viscosity => stream.with(channel.name(), self.viscosities()),
            };
        }
        if let Some(microrotation) = &self.microrotation {
            stream = stream.with(MICROROTATION, microrotation.spin.clone());
        }
        stream.scalars = vec![
            ("spacing".into(), f64::from(self.params.spacing)),
            ("first_energy".into(), self.first_energy),
            ("skipped_in_solids".into(), f64::from(self.seeded.skipped_in_solids)),
            ("skipped_overlapping".into(), f64::from(self.seeded.skipped_overlapping)),
        ];
        stream = self.with_flow(stream);
        let figures = FRAME_FIGURES.iter().zip(self.figures.iter().flatten());
        stream.scalars.extend(figures.map(|((name, _), value)| ((*name).into(), *value)));
        stream
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, LiquidSource},
        solid::Shape,
    };

    #[test]
    fn solids_thinner_than_the_kernel_reaches_are_listed() {
        let plate = |thickness: f32| Shape::Box { min: [-1.0, -1.0, 0.0], max: [1.0, 1.0, thickness] };
        let ball = |radius: f32| Shape::Sphere { center: [0.0; 3], radius };
        let tank = Shape::Tank { min: [0.0; 3], max: [1.0; 3] };
        let shapes = [tank, plate(0.15), plate(0.05), ball(0.08), ball(0.04)];
        let world = World { gravity: Vec3::zeros(), solids: shapes.map(Solid::fixed).into() };
        // Particles rest half a spacing from either side, so that h less a spacing separates them.
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.5);
        let thin = thin_solids(&rest, &world.solids, &world.solids[1..3]);
        let listed: Vec<_> =
            thin.iter().map(|solid| (solid.index, solid.is_body, solid.thickness as f32)).collect();
        assert_eq!(listed, [(2, false, 0.05), (4, false, 0.08), (1, true, 0.05)]);
        assert!(thin.iter().all(|solid| (solid.sufficient_thickness - 0.15).abs() < 1e-6), "{thin:?}");
    }

    #[test]
    fn liquid_is_far_where_positions_are_coarser_than_a_thousandth_of_the_spacing() {
        for (at, far) in [(0.0, false), (800.0, false), (-900.0, true), (1e5, true)] {
            let shape = Shape::Box { min: [at, 0.0, 0.0], max: [at + 0.8, 0.8, 0.8] };
            let source =
                LiquidSource { shape, velocity: [0.0; 3], jitter: None, viscosity: None, color: None };
            let params = LiquidParams { source: vec![source], ..LiquidParams::new(0.1) };
            let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
            let liquid = Liquid::seed(params, &world, (&[], &[]), Timeline::default());
            let seeded = liquid.expect("the source holds particles").seeded;
            assert_eq!(seeded.far_from_origin > 0.0, far, "{at} m: {seeded:?}");
        }
    }
}
