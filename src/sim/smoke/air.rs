//! What moves the air beside the vortons: the wind, and solids that it cannot enter.

use super::{
    params::SmokeParams,
    walls::{Placed, Sources, Walls},
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

/// What moves the air beside the vortons.
#[derive(Debug)]
pub(super) struct Air {
    wind: Vec3,
    kernel: Kernel,
    method: Method,
    pub(super) walls: Option<Walls>,
    /// When the step began [s].
    pub(super) now: f64,
    /// The longest step in which the wind carries nothing past a vorton [s].
    longest: f64,
}

/// The air at an instant: vortons, and the sources in solids that go with them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant<'a> {
    pub(super) vortons: &'a Vortons,
    pub(super) sources: &'a Sources,
}

impl Air {
    pub(super) fn new(params: &SmokeParams, world: &World) -> Self {
        let walls = Walls::new(&world.solids, params.spacing);
        let wind = params.wind.map_or(Vec3::zeros(), Vec3::from);
        let wind = walls.as_ref().map_or(wind, |walls| walls.along(wind));
        let flow = &params.flow;
        let method = flow.method();
        let longest = f64::from(params.core()) / f64::from(wind.norm());
        Self { wind, kernel: flow.kernel, method, walls, now: 0.0, longest }
    }

    /// The sources in solids, where they are at `time` [s], that go with `vortons`.
    ///
    /// # Errors
    /// If a vorton or a panel is outside what the sums can hold.
    pub(super) fn sources(&self, vortons: &Vortons, time: f64) -> Result<Sources, Unfit> {
        let Some(walls) = &self.walls else { return Ok(Sources::default()) };
        let panels = walls.placed(time);
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
        let sources = self.sources(vortons, self.now + now.seconds)?;
        sources.add_velocity(&vortons.position, &mut rates.velocity);
        sources.add_gradient(&vortons.position, &mut rates.gradient);
        sources.add_velocity(now.passengers, &mut rates.passengers);
        Ok(())
    }

    fn longest(&self) -> f64 {
        self.longest
    }
}
