//! What moves the air beside the vortons: the wind, and solids that it cannot enter.

use super::{
    params::SmokeParams,
    sources::Sources,
    walls::{Placed, Walls},
};
use crate::{
    math::Vec3,
    par,
    sim::{
        World,
        vortex::{
            Induced, Kernel, Method, Quantity, Targets, Unfit, Vortons,
            flow::{Moment, Outside, Rates},
            induced,
        },
    },
};
use std::sync::Arc;

/// What moves the air beside the vortons.
#[derive(Clone, Debug)]
pub(super) struct Air {
    wind: Vec3,
    /// The part of the wind that a plane keeps out [m/s].
    pub(super) across: f32,
    kernel: Kernel,
    method: Method,
    /// The same for all frames, whose poses they take.
    pub(super) walls: Option<Arc<Walls>>,
    /// When the step began, and when it ends at the latest [s].
    pub(super) span: [f64; 2],
    /// The longest step in which the wind carries nothing past a vorton [s].
    longest: f64,
    /// How far a solid may move in a step [m].
    stride: f32,
}

/// The air at an instant: vortons, and the sources in solids that go with them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant<'a> {
    pub(super) vortons: &'a Vortons,
    pub(super) sources: &'a Sources,
}

impl Air {
    pub(super) fn new(params: &SmokeParams, world: &World) -> Self {
        let walls = Walls::new(&world.solids, params.spacing).map(Arc::new);
        let blows = params.wind.map_or(Vec3::zeros(), Vec3::from);
        let wind = walls.as_ref().map_or(blows, |walls| walls.along(blows));
        // Rounding is no wind.
        let across =
            Some((blows - wind).norm()).filter(|across| *across > 1e-5 * blows.norm()).unwrap_or(0.0);
        let flow = &params.flow;
        let method = flow.method();
        let longest = f64::from(params.core()) / f64::from(wind.norm());
        let stride = walls.as_ref().map_or(f32::INFINITY, |walls| walls.stride(params.core()));
        Self { wind, across, kernel: flow.kernel, method, walls, span: [0.0; 2], longest, stride }
    }

    /// The longest step between two times [s] in which no solid jumps past smoke [s].
    pub(super) fn unjumped(&self, [from, to]: [f64; 2]) -> f64 {
        let fastest = self.walls.as_ref().map_or(0.0, |walls| walls.fastest(from, to));
        // What stands still allows any length.
        f64::from(self.stride) / fastest
    }

    /// The sources in solids, where they are at `time` [s], that go with `vortons`.
    ///
    /// # Errors
    /// If a vorton or a panel is outside what the sums can hold.
    pub(super) fn sources(&self, vortons: &Vortons, time: f64) -> Result<Sources, Unfit> {
        let Some(walls) = &self.walls else { return Ok(Sources::default()) };
        let panels = walls.sourced(time);
        let at: Vec<Vec3> = panels.iter().map(|placed| placed.panel.x).collect();
        Ok(walls.solve(&panels, &self.free(vortons, &at)?))
    }

    /// The velocity at points [m/s].
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub(super) fn velocity(&self, instant: Instant<'_>, points: &[Vec3]) -> Result<Vec<Vec3>, Unfit> {
        let mut velocity = self.free(instant.vortons, points)?;
        instant.sources.add_velocity(points, &mut velocity);
        Ok(velocity)
    }

    /// The part of it that does not come from sources.
    fn free(&self, vortons: &Vortons, points: &[Vec3]) -> Result<Vec<Vec3>, Unfit> {
        if points.is_empty() {
            return Ok(Vec::new());
        }
        let mut velocity = self.induced(vortons, points, Quantity::Velocity)?.velocity;
        self.mirror(vortons, points, &mut velocity)?;
        self.blow(&mut velocity);
        Ok(velocity)
    }

    fn induced(&self, vortons: &Vortons, points: &[Vec3], quantity: Quantity) -> Result<Induced, Unfit> {
        induced(vortons, Targets::Points(points), quantity, self.kernel, self.method)
    }

    /// Adds what the mirrored vortons induce at points.
    fn mirror(&self, vortons: &Vortons, points: &[Vec3], velocity: &mut [Vec3]) -> Result<(), Unfit> {
        let walls = self.walls.as_ref();
        if let Some((walls, mirrored)) = walls.and_then(|walls| Some((walls, walls.mirrored(points)?))) {
            let found = self.induced(vortons, &mirrored, Quantity::Velocity)?.velocity;
            par::update(velocity, |i, v| *v += walls.turn(found[i]));
        }
        Ok(())
    }

    fn blow(&self, velocity: &mut [Vec3]) {
        let wind = self.wind;
        if wind != Vec3::zeros() {
            par::update(velocity, |_, v| *v += wind);
        }
    }

    /// How much of the air's speed along the normals of the solids is left between their panels: root mean squares of what goes
    /// through there over what would without sources. `None` without solids, or if nothing would.
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub(super) fn through(&self, instant: Instant<'_>, time: f64) -> Result<Option<f64>, Unfit> {
        let Some(walls) = &self.walls else { return Ok(None) };
        let witnesses = walls.witnesses(time);
        let at: Vec<Vec3> = witnesses.iter().map(|placed| placed.panel.x).collect();
        let square = |air: &[Vec3]| {
            let along = |(Placed { panel, velocity }, air): (&Placed, &Vec3)| {
                f64::from(panel.normal.dot(&(air - velocity))).powi(2)
            };
            witnesses.iter().zip(air).map(along).sum::<f64>()
        };
        let free = square(&self.free(instant.vortons, &at)?);
        let left = square(&self.velocity(instant, &at)?);
        Ok((free > 0.0).then(|| (left / free).sqrt()))
    }
}

impl Outside for Air {
    fn act(&mut self, now: Moment<'_>, rates: &mut Rates) -> Result<(), Unfit> {
        let vortons = now.vortons;
        self.blow(&mut rates.velocity);
        self.blow(&mut rates.passengers);
        let Some(walls) = &self.walls else { return Ok(()) };
        if let Some(mirrored) = walls.mirrored(&vortons.position) {
            let found = self.induced(vortons, &mirrored, Quantity::VelocityAndGradient)?;
            par::update(&mut rates.velocity, |i, v| *v += walls.turn(found.velocity[i]));
            par::update(&mut rates.gradient, |i, g| *g += walls.turn_gradient(&found.gradient[i]));
            self.mirror(vortons, now.passengers, &mut rates.passengers)?;
        }
        let sources = self.sources(vortons, self.span[0] + now.seconds)?;
        sources.add_velocity(&vortons.position, &mut rates.velocity);
        sources.add_gradient(&vortons.position, &mut rates.gradient);
        sources.add_velocity(now.passengers, &mut rates.passengers);
        Ok(())
    }

    fn longest(&self) -> f64 {
        self.longest.min(self.unjumped(self.span))
    }
}
