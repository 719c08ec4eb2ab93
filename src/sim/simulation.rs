//! Simulation of all systems of a shot, advanced together frame by frame.

use super::{
    CancelToken, FrameRecord, SeedReport, Stop, Watch,
    clock::{Clock, Seconds},
    coupling::{
        self, CoupledSheets, Coupling, CouplingRecord, ExternalForces, FrameWind, LiquidSheetCoupling,
        PresentSystems, ResolvedCouplings, WindCoupling, advance_bodies_and_sheets,
    },
    force::{ForceParams, Forces},
    liquid::{self, CoupledBodies, Liquid, LiquidParams, Partners},
    rigid::{BodyParams, RigidBodies},
    setup::{SetupError, Timeline, World},
    sheet::{self, SheetRecord, Sheets},
    smoke::{self, Smoke},
    substep::advance_frame,
};
use crate::frame::{Frame, FrameIndex};

/// Parameters of the systems to simulate; an absent system is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Systems {
    /// The liquid.
    pub liquid: Option<LiquidParams>,
    /// The smoke.
    pub smoke: Option<Smoke>,
    /// The sheets.
    pub sheets: Option<sheet::Shot>,
    /// Rigid bodies.
    pub bodies: Vec<BodyParams>,
    /// Couplings between the systems.
    pub couplings: Vec<Coupling>,
    /// Force fields.
    pub forces: Vec<ForceParams>,
    /// Times of the frames that the liquid's emitters and outflows and the forces name.
    pub timeline: Timeline,
}

impl From<Option<LiquidParams>> for Systems {
    fn from(liquid: Option<LiquidParams>) -> Self {
        Self { liquid, ..Self::default() }
    }
}

/// The systems of a shot and their current state.
#[derive(Debug)]
pub struct Simulation {
    liquid: Option<Liquid>,
    smoke: Option<smoke::System>,
    sheets: Option<Sheets>,
    bodies: Option<RigidBodies>,
    /// Contact of the liquid with sheets.
    liquid_sheets: Option<LiquidSheetCoupling>,
    /// Drag of the smoke's air on sheets.
    wind: Option<WindCoupling>,
    time: f64,
}

impl Simulation {
    /// Seeds every system that is present.
    ///
    /// # Errors
    /// If there is no system, or the sources of one hold no particle or too many.
    pub fn new(world: World, systems: impl Into<Systems>) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets, bodies, couplings, forces, timeline } = present(systems.into())?;
        let density = liquid.as_ref().map(|liquid| [liquid.spacing, liquid.density]);
        let bodies = (!bodies.is_empty()).then(|| RigidBodies::new(&bodies, &world)).transpose()?;
        let solids = bodies.as_ref().map(RigidBodies::as_solids).unwrap_or_default();
        let liquid = liquid.map(|params| Liquid::seed(params, &world, solids, timeline)).transpose()?;
        let smoke = smoke.map(|smoke| smoke::System::seed(smoke, &world)).transpose()?;
        let sheets = sheets.map(|sheets| Sheets::new(sheets, &world)).transpose()?;
        Self { liquid, smoke, sheets, bodies, liquid_sheets: None, wind: None, time: 0.0 }
            .with_forces(&forces, timeline)
            .coupled(&couplings, density)
    }

    /// Restores the state from a frame of [`Simulation::frame`]. The following frames have the same bits as in the run that
    /// wrote it.
    ///
    /// # Errors
    /// If there is no system, or the frame lacks its state.
    pub fn restore(world: World, systems: impl Into<Systems>, frame: &Frame) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets, bodies, couplings, forces, timeline } = present(systems.into())?;
        let density = liquid.as_ref().map(|liquid| [liquid.spacing, liquid.density]);
        let bodies = (!bodies.is_empty()).then(|| RigidBodies::restore(&bodies, &world, &frame.streams));
        let bodies = bodies.transpose()?;
        let solids = bodies.as_ref().map(RigidBodies::as_solids).unwrap_or_default();
        let liquid = liquid.map(|params| {
            let missing = SetupError::Missing { stream: liquid::NAME, what: "particles" };
            let stream = frame.stream(liquid::NAME).ok_or(missing)?;
            Liquid::restore(params, &world, solids, stream, (timeline, frame.time))
        });
        let smoke = smoke.map(|smoke| smoke::System::restore(smoke, &world, &frame.streams));
        let sheets = sheets.map(|sheets| Sheets::restore(sheets, &world, &frame.streams, frame.time));
        let (liquid, smoke, sheets) = (liquid.transpose()?, smoke.transpose()?, sheets.transpose()?);
        Self { liquid, smoke, sheets, bodies, liquid_sheets: None, wind: None, time: frame.time }
            .with_forces(&forces, timeline)
            .coupled(&couplings, density)
    }

    /// The same state with other settings, as the first of a branch: energies that bound the systems change by what the settings add.
    ///
    /// # Errors
    /// If the settings need state that the frame does not hold.
    pub fn branch(
        frame: &Frame,
        before: (World, impl Into<Systems>),
        after: (World, impl Into<Systems>),
    ) -> Result<Self, SetupError> {
        // One after the other, for their memory.
        let energies =
            Self::restore(before.0, before.1, frame)?.liquid.map(|mut liquid| liquid.restored_energy());
        let mut branched = Self::restore(after.0, after.1, frame)?;
        if let (Some(liquid), Some(energies)) = (&mut branched.liquid, energies) {
            liquid.take_over_energy(energies);
        }
        Ok(branched)
    }

    /// Gives every system the forces that act on it.
    fn with_forces(mut self, forces: &[ForceParams], timeline: Timeline) -> Self {
        if let Some(liquid) = &mut self.liquid {
            liquid.set_forces(Forces::on("liquid", forces, timeline));
        }
        if let Some(sheets) = &mut self.sheets {
            sheets.set_forces(Forces::on("sheets", forces, timeline));
        }
        if let Some(bodies) = &mut self.bodies {
            bodies.set_forces(Forces::on("bodies", forces, timeline));
        }
        self
    }

    /// Adds the couplings, with the spacing and density of the liquid.
    fn coupled(mut self, couplings: &[Coupling], density: Option<[f32; 2]>) -> Result<Self, SetupError> {
        let names = self.sheets.as_ref().map(Sheets::names).unwrap_or_default();
        let present =
            PresentSystems { liquid: self.liquid.is_some(), smoke: self.smoke.is_some(), sheets: names };
        let ResolvedCouplings { liquid, smoke } = coupling::resolve(couplings, &present)?;
        if let (Some([spacing, density]), Some(sheets), false) = (density, &self.sheets, liquid.is_empty()) {
            self.liquid_sheets = Some(LiquidSheetCoupling::new(sheets, &liquid, spacing, density));
        }
        if self.bodies.is_some()
            && self.liquid.is_some()
            && self.sheets.is_some()
            && self.liquid_sheets.is_none()
        {
            return Err(SetupError::BodiesBetween);
        }
        if let (Some(sheets), false) = (&self.sheets, smoke.is_empty()) {
            self.wind = Some(WindCoupling::new(sheets, &smoke));
        }
        Ok(self)
    }

    /// Report of the seeding.
    pub fn seeded(&self) -> SeedReport {
        SeedReport {
            liquid: self.liquid.as_ref().map(Liquid::seeded),
            smoke: self.smoke.as_ref().map(smoke::System::seeded),
            sheets: self.sheets.as_ref().map(|sheets| {
                let inside = |bodies: &RigidBodies| {
                    let (surfaces, states) = bodies.surfaces();
                    sheets.count_inside_bodies((&surfaces, states))
                };
                let inside_bodies = self.bodies.as_ref().map_or(0, inside);
                sheet::SheetSeeds { inside_bodies, ..sheets.seeded() }
            }),
            bodies: self.bodies.as_ref().map(RigidBodies::seeded),
        }
    }

    /// The state as a frame, in memory order.
    ///
    /// Stream "liquid" has `position` [m], `velocity` [m/s], `id` and the channels that the preset names. Stream "smoke" has the
    /// vortons' `position` [m], `strength` [m³/s], `core` [m], `volume` [m³] and `id`, stream "smoke_tracers" has `position` [m],
    /// `density`, `temperature` [K] and `id`. Each sheet has a stream "sheet.NAME" with `position` [m] and `velocity` [m/s], and
    /// "sheet.NAME.faces" with the corners `a`, `b`, `c`, `d` of its faces. Stream "bodies" has the `position` of the origins of their shapes [m],
    /// `rotation` and `rotation_w`, a quaternion, `velocity` [m/s] and `angular_velocity` [rad/s].
    pub fn frame(&self, index: FrameIndex) -> Frame {
        let liquid = self.liquid.iter().map(|liquid| liquid.stream(self.time));
        let smoke = self.smoke.iter().flat_map(smoke::System::streams);
        let sheets = self.sheets.iter().flat_map(Sheets::streams);
        let bodies = self.bodies.iter().map(RigidBodies::stream);
        Frame { index, time: self.time, streams: liquid.chain(smoke).chain(sheets).chain(bodies).collect() }
    }

    /// Advances by a frame of `frame_seconds` [s] (> 0) and returns its record.
    ///
    /// # Errors
    /// [`Stop`]; the state is then inside the frame and not to be continued from.
    pub fn advance(&mut self, frame_seconds: f64, watch: &mut dyn Watch) -> Result<FrameRecord, Stop> {
        let has_bodies_alone = self.bodies.is_some() && self.liquid.is_none() && self.sheets.is_none();
        let systems = [self.liquid.is_some(), self.smoke.is_some(), self.sheets.is_some(), has_bodies_alone];
        let share = 1.0 / systems.into_iter().filter(|&is_present| is_present).count() as f64;
        let span = [self.time, frame_seconds];
        let mut from = 0.0;
        let mut next_part = |share: f64| {
            from += share;
            (from - share, share)
        };

        // The smoke is advanced first, because it does not depend on the others and they may need its air.
        let mut air_steps = self.wind.as_ref().map(|_| Vec::new());
        let mut smoke_frame = None;
        if let Some(smoke) = &mut self.smoke {
            let (from, share) = next_part(share);
            let mut part = PartialProgress { watch: &mut *watch, from, share };
            smoke_frame = Some(smoke.advance(self.time, frame_seconds, air_steps.as_mut(), &mut part)?);
        }
        let mut wind =
            self.wind.as_ref().zip(air_steps).map(|(coupling, steps)| FrameWind::new(coupling, steps));
        let external = wind.as_mut().map(|wind| wind as &mut dyn ExternalForces);

        // The liquid and the sheets, together if they are coupled.
        let (mut record, mut sheet_frame) = (FrameRecord::default(), None);
        if let Some(bodies) = &mut self.bodies {
            bodies.begin_frame();
        }
        let (mut bodies, has_liquid) = (self.bodies.as_mut(), self.liquid.is_some());
        match (&mut self.liquid, &mut self.sheets, &self.liquid_sheets) {
            (Some(liquid), Some(sheets), Some(coupling)) => {
                let (from, share) = next_part(2.0 * share);
                let mut part = PartialProgress { watch, from, share };
                let sheets = CoupledSheets::new(coupling, sheets, external);
                record = advance_coupled(liquid, sheets, bodies.as_deref_mut(), span, &mut part)?;
            }
            (liquid, sheets, _) => {
                if let Some(liquid) = liquid {
                    let (from, share) = next_part(share);
                    let mut part = PartialProgress { watch: &mut *watch, from, share };
                    let floating = bodies.as_deref_mut().map(as_coupled);
                    let (found, seconds) = liquid.advance(self.time, frame_seconds, floating, &mut part)?;
                    (record.liquid, record.seconds) = (Some(found), seconds);
                }
                if let Some(sheets) = sheets {
                    let (from, share) = next_part(share);
                    let mut part = PartialProgress { watch: &mut *watch, from, share };
                    sheet_frame = Some(match (external, bodies.as_deref_mut().filter(|_| !has_liquid)) {
                        (Some(external), _) => advance_with_wind(sheets, external, span, &mut part)?,
                        (None, Some(bodies)) => {
                            let frame = advance_bodies_and_sheets(sheets, bodies, span, &mut part)?;
                            record.bodies = Some(frame.bodies);
                            record.coupling.get_or_insert_default().bodies = Some(frame.contact);
                            (frame.sheets, frame.seconds)
                        }
                        (None, None) => sheets.advance(self.time, frame_seconds, &mut part)?,
                    });
                }
            }
        }

        if let (Some(bodies), None) = (bodies, &record.bodies) {
            record.bodies = Some(if self.liquid.is_some() {
                bodies.end_frame(self.time + frame_seconds)?
            } else {
                let (from, share) = next_part(share);
                let mut part = PartialProgress { watch, from, share };
                let (found, seconds) = bodies.advance(span, &mut part)?;
                record.seconds.extend(seconds);
                found
            });
        }

        // The record, in order of the passes.
        if let Some((smoke, seconds)) = smoke_frame {
            record.smoke = Some(smoke);
            record.seconds.extend(seconds);
        }
        if let Some((sheets, seconds)) = sheet_frame {
            record.sheets = Some(sheets);
            record.seconds.extend(seconds);
        }
        if let Some(wind) = wind {
            record.coupling.get_or_insert_default().smoke = Some(wind.record);
        }
        self.time += frame_seconds;
        Ok(record)
    }

    /// The passes that run, in order: only what the preset names.
    pub fn passes(&self) -> Vec<&'static str> {
        let liquid = self.liquid.as_ref().map(Liquid::passes).unwrap_or_default();
        let smoke = self.smoke.as_ref().map(smoke::System::passes).unwrap_or_default();
        let sheets = self.sheets.as_ref().map(Sheets::passes).unwrap_or_default();
        let coupling = coupling_passes(self.liquid_sheets.is_some(), self.wind.is_some());
        let bodies = match (&self.bodies, &self.liquid, &self.sheets) {
            (Some(_), None, None) => RigidBodies::passes(),
            (Some(_), None, Some(_)) => coupling::BODY_PASSES.to_vec(),
            // The first is one of the liquid's.
            (Some(_), Some(_), Some(_)) => coupling::BODY_PASSES[1..].to_vec(),
            _ => Vec::new(),
        };
        liquid.into_iter().chain(smoke).chain(sheets).chain(bodies).chain(coupling).collect()
    }
}

/// The passes of the couplings that are present.
fn coupling_passes(liquid_sheets: bool, wind: bool) -> Vec<&'static str> {
    let contact = if liquid_sheets { &coupling::LIQUID_PASSES[..] } else { &[] };
    wind.then_some(coupling::WIND_PASS).into_iter().chain(contact.iter().copied()).collect()
}

/// Bodies as partners of the liquid.
fn as_coupled(bodies: &mut RigidBodies) -> &mut dyn CoupledBodies {
    bodies
}

/// Advances a liquid, sheets and bodies that share their substeps by a frame; `start` and `seconds` are its time and length [s].
fn advance_coupled(
    liquid: &mut Liquid,
    mut coupled: CoupledSheets<'_>,
    mut bodies: Option<&mut RigidBodies>,
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
) -> Result<FrameRecord, Stop> {
    let contact = coupling_passes(true, coupled.external.is_some());
    let body_contact = bodies.as_ref().map_or(&[][..], |_| &coupling::BODY_PASSES[1..]);
    let passes = [liquid.passes(), coupled.sheets.passes(), contact, body_contact.to_vec()];
    let mut clock = Clock::new(&passes.concat());
    let partners = Partners { system: Some(&mut coupled), bodies: bodies.as_deref_mut().map(as_coupled) };
    let liquid = liquid.advance_with(partners, [start, seconds], &mut clock, watch)?;
    let CoupledSheets { sheets, mut sheet_record, record: contact, body_record, .. } = coupled;
    let placed: Vec<_> = bodies.as_ref().map_or_else(Vec::new, |bodies| {
        let (surfaces, states) = bodies.surfaces();
        surfaces.into_iter().zip(states.iter().map(|body| body.pose())).collect()
    });
    clock.time("sheet_account", || sheets.end_frame(start + seconds, &placed, &mut sheet_record));
    Ok(FrameRecord {
        liquid: Some(liquid),
        sheets: Some(sheet_record),
        coupling: Some(CouplingRecord {
            liquid: Some(contact),
            bodies: body_record,
            ..CouplingRecord::default()
        }),
        seconds: clock.into_totals(),
        ..FrameRecord::default()
    })
}

/// Advances sheets with the wind as an external force by a frame.
fn advance_with_wind(
    sheets: &mut Sheets,
    wind: &mut dyn ExternalForces,
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
) -> Result<(SheetRecord, Seconds), Stop> {
    let mut clock = Clock::new(&[sheets.passes(), coupling_passes(false, true)].concat());
    let mut record = sheets.begin_frame();
    advance_frame([start, seconds], watch, |progress, _| {
        let (now, left) = (progress.now(), progress.left);
        let dt = left / f64::from(sheets.substeps_left(now, left, seconds, record.substeps)?);
        wind.apply(sheets, now, dt, &mut clock)?;
        sheets.advance_substep(now, dt, &mut clock, &mut record)?;
        Ok(dt)
    })?;
    clock.time("sheet_account", || sheets.end_frame(start + seconds, &[], &mut record));
    Ok((record, clock.into_totals()))
}

/// The systems, if there is one.
fn present(systems: Systems) -> Result<Systems, SetupError> {
    let none = Systems { timeline: systems.timeline, forces: systems.forces.clone(), ..Systems::default() };
    if systems == none { Err(SetupError::NoSystem) } else { Ok(systems) }
}

/// Reports the progress of one system as its part of the frame's.
struct PartialProgress<'a> {
    watch: &'a mut dyn Watch,
    from: f64,
    share: f64,
}

impl Watch for PartialProgress<'_> {
    fn token(&self) -> Option<&CancelToken> {
        self.watch.token()
    }

    fn substep(&mut self, done: f64) {
        self.watch.substep(self.from + self.share * done);
    }
}
