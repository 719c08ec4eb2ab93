//! Sheets (cloth): membranes of points and springs ([gudukbay97]).
//!
//! *Method*: the equations of motion M ẍ + C ẋ = f − f_spr ([gudukbay97] Eq. 4), with spring forces that each
//! point gathers from its neighbours (`springs.rs`). Pins and joints (`pins_and_joints.rs`) and solids
//! (`solids.rs`) add their forces. Time advances by symplectic (`explicit.rs`) or implicit Euler
//! (`implicit.rs`). Contact between sheets follows each time step (`contact/`). All sheets are one set of
//! points.
//! *Departs from the paper*: see the files of the parts.
//!
//! Symbols: x → `x` [m], v → `v` [m/s], M → `mass` [kg], C/M → `drag` [1/s].
//! Limits: first order in time; positions are single precision, so the strain of a spring of 1 mm at 1 m from
//! the origin is resolved to 6e-5.

mod body_contacts;
mod check;
mod constraints;
mod contact;
mod coupled_frame;
mod error;
mod exact_joints;
mod explicit;
mod face_contacts;
mod force_field;
mod forced;
mod free_translation;
mod implicit;
#[cfg(feature = "presets")]
pub(crate) mod job;
mod model;
mod overshoot;
mod params;
mod pins_and_joints;
mod record;
mod sliced_ellpack;
mod solids;
mod springs;
mod stable_step;
mod state;
mod substep;
mod vectors;

pub(in crate::sim) use body_contacts::{BodyContacts, MAX_SOLVES};
pub use check::check;
pub use error::SheetError;
pub(in crate::sim) use face_contacts::{CoupledSubstep, FaceContact, FaceContacts};
pub use params::{
    Contact, Integrator, Joint, Pin, Region, Repulsion, Select, SheetMesh, SheetParams, SheetShape,
    SheetSolver, SheetsCommon, SheetsParams,
};
pub use record::{ContactRecord, SheetRecord, SheetSeeds};
pub use state::stream;
pub(crate) use state::{CORNER_CHANNELS, faces_stream, sheet_of};

use super::{
    Diverged, Stop, Watch, World,
    clock::{Clock, Seconds},
    substep::advance_frame,
};
use crate::{
    math::Vec3,
    par,
    simd::{F32x8, LANES},
    solid::Solid,
};
use constraints::{JointPair, PinnedPoint};
use exact_joints::ExactJoints;
use force_field::ForceField;
use model::Model;
use sliced_ellpack::{Entry, SlicedEllpack};
use solids::VertexFaces;
use stable_step::RowSums;
use std::ops::Range;
use vectors::Vectors;

/// Name of the system; its streams are called `sheet.` and the sheet's name.
pub const NAME: &str = "sheet";

/// A coordinate [m] or speed [m/s] beyond this counts as diverged: positions there resolve 8 m.
const DIVERGENCE_LIMIT: f32 = 1e8;

/// The sheets of a preset, and the times of the frames that their pins name.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Parameters of the preset.
    pub params: SheetsParams,
    /// Frames per second.
    pub fps: f64,
    /// The frame at time 0.
    pub first: u32,
}

/// Sheets and their state.
#[derive(Debug)]
pub struct Sheets {
    params: SheetsParams,
    gravity: Vec3,
    solids: Vec<Solid>,
    /// Points of each sheet.
    ranges: Vec<Range<usize>>,
    /// Faces of each sheet; points count from the sheet's first.
    faces: Vec<Vec<[u32; 4]>>,
    x: Vectors,
    v: Vectors,
    /// Buffers of the next positions, and of the next velocities if springs are damped.
    next_x: Vectors,
    next_v: Option<Vectors>,
    force: Vectors,
    /// Rounding errors of positions since the frame began [m].
    low: Vectors,
    area: Vec<f32>,
    mass: Vec<F32x8>,
    /// 1/mass, zero for points that are held exactly.
    inverse: Vec<F32x8>,
    /// `None`: no sheet is damped.
    drag: Option<Vec<F32x8>>,
    springs: SlicedEllpack,
    plates: Option<SlicedEllpack>,
    pins: Vec<PinnedPoint>,
    joints: Vec<JointPair>,
    /// The exact joints that hold now.
    exact_joints: ExactJoints,
    /// The parts that no pin holds now.
    free_parts: Vec<implicit::FreePart>,
    /// Faces around points, for repulsion; `None` without it.
    vertex_faces: Option<VertexFaces>,
    /// `None`: sheets pass through each other.
    contact: Option<Box<contact::SheetContact>>,
    /// External forces [N]; empty: none.
    external_forces: Vec<Vec3>,
    /// Force fields; `None`: there are none.
    forces: Option<Box<ForceField>>,
    /// The longest stable time step [s], the point that limits it, and which pins and joints hold in this
    /// state.
    max_stable_step: (f64, usize),
    active_holds: Option<Vec<bool>>,
}

impl Sheets {
    /// Sheets at the start of a shot.
    ///
    /// # Errors
    /// If parameters are out of range; see [`SheetError`].
    pub fn new(shot: Shot, world: &World) -> Result<Self, SheetError> {
        let Shot { params, fps, first } = shot;
        check(&params)?;
        let models: Vec<Model> = params.sheet.iter().map(model::model).collect();
        let mut end = 0;
        let ranges: Vec<Range<usize>> = models
            .iter()
            .map(|model| {
                let start = end;
                end += model.points.len();
                start..end
            })
            .collect();
        if end >= 1 << 31 {
            return Err(SheetError::TooMany { requested: end as f64 });
        }
        let time = [fps, f64::from(first)];
        let pins = pins_and_joints::pinned_points(&params, &models, &ranges, &world.solids, time)?;
        let joints = pins_and_joints::joint_pairs(&params, &models, &ranges, time)?;
        pins_and_joints::check_held_once(&pins, &joints, &ranges)?;
        let (mass, drag) = point_masses(&params, &models)?;
        let points: Vec<Vec3> = models.iter().flat_map(|model| model.points.iter().copied()).collect();
        let velocity: Vec<Vec3> = params
            .sheet
            .iter()
            .zip(&ranges)
            .flat_map(|(sheet, range)| vec![Vec3::from(sheet.velocity); range.len()])
            .collect();
        let shifted = |(model, range): (&Model, &Range<usize>)| {
            let start = range.start as u32;
            model.faces.iter().map(|face| face.map(|i| i + start)).collect::<Vec<_>>()
        };
        let faces: Vec<[u32; 4]> = models.iter().zip(&ranges).flat_map(shifted).collect();
        let bends = models.iter().any(|model| !model.plates.is_empty());
        let springs = SlicedEllpack::new(end, spring_entries(&models, &ranges));
        let contact = |contact| Box::new(contact::SheetContact::new(contact, &params, &models, &ranges));
        let contact = params.common.contact.as_ref().map(contact);
        let mut sheets = Self {
            contact,
            gravity: world.gravity,
            solids: world.solids.clone(),
            x: Vectors::of(&points),
            v: Vectors::of(&velocity),
            force: Vectors::zeros(end),
            low: Vectors::zeros(end),
            area: models.iter().flat_map(|model| model.area.iter().map(|&a| a as f32)).collect(),
            inverse: Vec::new(),
            next_x: Vectors::zeros(end),
            next_v: springs.is_damped().then(|| Vectors::zeros(end)),
            springs,
            plates: bends.then(|| SlicedEllpack::new(end, plate_entries(&models, &ranges))),
            vertex_faces: params.common.repulsion.is_some().then(|| VertexFaces::new(end, &faces)),
            faces: models.into_iter().map(|model| model.faces).collect(),
            external_forces: Vec::new(),
            forces: None,
            max_stable_step: (f64::INFINITY, 0),
            active_holds: None,
            params,
            ranges,
            mass,
            drag,
            pins,
            joints,
            exact_joints: ExactJoints::default(),
            free_parts: Vec::new(),
        };
        sheets.update_holds(0.0);
        Ok(sheets)
    }

    /// What seeding did.
    pub(in crate::sim) fn seeded(&self) -> SheetSeeds {
        SheetSeeds { points: self.len() as u32, crossings: self.crossings(), inside_bodies: 0 }
    }

    /// Points of all sheets.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The range of points of each sheet.
    pub fn ranges(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// The faces of a sheet, counter-clockwise about the normal. Points count from the sheet's first;
    /// triangles repeat their last corner.
    pub fn faces(&self, sheet: usize) -> &[[u32; 4]] {
        &self.faces[sheet]
    }

    /// The faces of each sheet, and its first point.
    fn all_faces(&self) -> impl Iterator<Item = (&[[u32; 4]], u32)> {
        let starts = self.ranges().iter().map(|range| range.start as u32);
        self.faces.iter().map(Vec::as_slice).zip(starts)
    }

    /// Positions of all points [m].
    pub fn positions(&self) -> Vec<Vec3> {
        self.x.to_vec()
    }

    /// Velocities of all points [m/s].
    pub fn velocities(&self) -> Vec<Vec3> {
        self.v.to_vec()
    }

    /// Mass of a point [kg].
    pub fn mass(&self, point: usize) -> f32 {
        self.mass[point / LANES][point % LANES]
    }

    /// The longest stable time step [s]; infinite without springs.
    pub fn max_stable_step(&self) -> f64 {
        self.max_stable_step.0
    }

    /// Sets the external forces [N], one per point of all sheets. They act until they are set again; empty:
    /// none.
    ///
    /// # Panics
    /// If the number of forces is neither zero nor that of points.
    pub fn set_external_forces(&mut self, forces: Vec<Vec3>) {
        assert!(forces.is_empty() || forces.len() == self.len(), "one force a point");
        self.external_forces = forces;
    }

    /// The passes of a substep, in order.
    pub fn passes(&self) -> Vec<&'static str> {
        let optional = |present: bool, name| present.then_some(name);
        let contact = self.contact.is_some();
        let passes = [
            Some("sheet_step"),
            optional(!self.solids.is_empty(), "sheet_solids"),
            optional(contact, "sheet_search"),
            optional(contact, "sheet_contact"),
            Some("sheet_account"),
        ];
        passes.into_iter().flatten().collect()
    }

    /// Advances from `start` [s] by one frame of `seconds`. Returns the record and the seconds of each pass.
    ///
    /// # Errors
    /// [`Stop`]; the state is then inside the frame and only good for inspection.
    pub fn advance(
        &mut self,
        start: f64,
        seconds: f64,
        watch: &mut dyn Watch,
    ) -> Result<(SheetRecord, Seconds), Stop> {
        let mut clock = Clock::new(&self.passes());
        let mut record = SheetRecord { points: self.len() as u64, ..SheetRecord::default() };
        // A frame stores the whole state: rounding errors do not continue into the next.
        self.low.clear();
        self.begin_contact(&mut record);
        advance_frame([start, seconds], watch, |progress, _| {
            let now = progress.now();
            self.update_holds(now);
            let dt = self.next_substep(now, progress.left, seconds, &mut clock, &mut record)?;
            record.substeps += 1;
            self.substep(now, dt, &mut clock, &mut record)?.count(&mut record);
            Ok(dt)
        })?;
        self.end_contact(&mut clock, &mut record);
        clock.time("sheet_account", || self.complete_record(start + seconds, &[], &mut record));
        Ok((record, clock.into_totals()))
    }

    /// Advances from `now` [s] by one substep of `dt` [s], stable or not, without the record at the end of a
    /// frame.
    ///
    /// # Errors
    /// If a point diverges.
    pub fn step(&mut self, now: f64, dt: f64) -> Result<SheetRecord, Diverged> {
        let mut record = SheetRecord { points: self.len() as u64, substeps: 1, ..SheetRecord::default() };
        self.update_holds(now);
        self.begin_contact(&mut record);
        let mut clock = Clock::new(&self.passes());
        self.max_contact_substep(now, [dt, dt], &mut clock, &mut record);
        self.substep(now, dt, &mut clock, &mut record)?.count(&mut record);
        Ok(record)
    }

    /// Length of the next substep [s], with `left` [s] left of a frame of `seconds`.
    fn next_substep(
        &mut self,
        now: f64,
        left: f64,
        seconds: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<f64, Diverged> {
        let done = record.substeps;
        let solver = &self.params.common.solver;
        let longest = match solver.integrator {
            Integrator::Symplectic => self.max_stable_step.0 * f64::from(solver.courant),
            Integrator::Implicit => seconds / f64::from(solver.substeps),
        };
        // Forces that would need more substeps than there are left are limited instead.
        let shortest = left / f64::from(solver.max_substeps.saturating_sub(done).max(1));
        let longest = longest.min(self.longest_forced_substep(now, shortest));
        let (max_travel_time, fastest) = self.max_travel_time(now, left);
        let (approach, closing) =
            self.max_contact_substep(now, [longest.min(max_travel_time), left], clock, record);
        let solver = &self.params.common.solver;
        let count = (left / longest.min(max_travel_time).min(approach) - 1e-6).ceil().max(1.0);
        if count + f64::from(done) > f64::from(solver.max_substeps) {
            let (particle, what, try_next) = if approach < longest.min(max_travel_time) {
                let what = format!(
                    "would need {count:.1e} substeps to keep approaches within sheets.contact.thickness"
                );
                let remedy =
                    "a larger sheets.contact.thickness or sheets.solver.max_substeps, or slower motion";
                (closing, what, remedy)
            } else if max_travel_time < longest {
                let what = format!("would need {count:.1e} substeps to not pass through solids");
                (fastest, what, "a larger sheets.solver.max_substeps or slower motion")
            } else {
                let (purpose, remedy) = match solver.integrator {
                    Integrator::Symplectic => (
                        " to be stable",
                        "sheets.solver.integrator = \"implicit\", a lower stiffness, or a larger \
                         sheets.solver.max_substeps",
                    ),
                    Integrator::Implicit => {
                        ("", "a sheets.solver.max_substeps of sheets.solver.substeps or more")
                    }
                };
                let what = format!("would need {count:.1e} substeps of {longest:.1e} s{purpose}");
                (self.max_stable_step.1, what, remedy)
            };
            return Err(self.diverged(done, particle, what, try_next));
        }
        Ok(left / count)
    }

    /// Time within which no point travels through half the thinnest solid [s], and the fastest point.
    fn max_travel_time(&self, now: f64, left: f64) -> (f64, usize) {
        let thinnest = self
            .solids
            .iter()
            .map(|solid| solid.shape.inner_radius() * solid.scales()[0])
            .fold(f32::INFINITY, f32::min);
        if thinnest == f32::INFINITY {
            return (f64::INFINITY, 0);
        }
        let (point, square) = par::max(self.len(), |i| self.v.get(i).norm_squared()).unwrap_or((0, 0.0));
        let solids = self.solids.iter().map(|solid| solid.fastest(now, now + left)).fold(0.0, f64::max);
        (f64::from(thinnest) / (f64::from(square.sqrt()) + solids), point)
    }

    /// Updates what depends on which pins and joints pins_and_joints, if that has changed.
    fn update_holds(&mut self, time: f64) {
        let pins = self.pins.iter().map(|pin| pin.holds(time));
        let holds: Vec<bool> = pins.chain(self.joints.iter().map(|joint| joint.holds(time))).collect();
        if self.active_holds.as_ref() == Some(&holds) {
            return;
        }
        self.active_holds = Some(holds);
        let len = self.len();
        self.inverse = self.mass.clone();
        for (i, value) in self.inverse.as_flattened_mut().iter_mut().enumerate() {
            *value = if i < len { 1.0 / *value } else { 0.0 };
        }
        for pin in self.pins.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(time)) {
            self.inverse[pin.point as usize / LANES][pin.point as usize % LANES] = 0.0;
        }
        self.exact_joints = ExactJoints::new(&self.joints, &self.pins, time);
        for i in self.exact_joints.followers() {
            self.inverse[i / LANES][i % LANES] = 0.0;
        }
        let holds = self.joints.iter().filter(|joint| joint.holds(time));
        self.free_parts = free_translation::free_parts(&self.ranges, holds, &self.inverse);
        self.set_contact_seams(time);
        let mut rows = RowSums::new(&self.springs, self.plates.as_ref(), len);
        rows.add_pins_and_joints(&self.pins, &self.joints, time);
        if let Some(repulsion) = &self.params.common.repulsion {
            rows.add_repulsion(repulsion, self.solids.len(), &self.area);
        }
        self.max_stable_step =
            rows.max_stable_step(&self.mass.as_flattened()[..len], self.inverse.as_flattened());
    }

    /// The error for a point that diverged.
    fn diverged(&self, substep: u32, point: usize, what: String, try_next: &'static str) -> Diverged {
        let sheet = self.ranges.iter().position(|range| range.contains(&point)).unwrap_or(0);
        let name = self.params.sheet.get(sheet).map_or("", |sheet| &sheet.name);
        let first = self.ranges.get(sheet).map_or(0, |range| range.start);
        let what = format!("of sheet '{name}' {what}");
        Diverged { system: NAME, substep, particle: (point - first) as u32, what, try_next }
    }
}

/// Masses of points [kg] and their damping rates [1/s], by eights.
fn point_masses(
    params: &SheetsParams,
    models: &[Model],
) -> Result<(Vec<F32x8>, Option<Vec<F32x8>>), SheetError> {
    let (mut mass, mut drag) = (Vec::new(), Vec::new());
    for (i, (sheet, model)) in params.sheet.iter().zip(models).enumerate() {
        let dense = model::densities(sheet, &model.points);
        let damped = model::dampings(sheet, &model.points);
        for k in 0..model.points.len() {
            let kilograms = (model.area[k] * f64::from(sheet.density) * dense[k]) as f32;
            if !(kilograms.is_normal() && (1.0 / kilograms).is_finite()) {
                return Err(SheetError::NoArea { key: format!("sheet.{i}.shape") });
            }
            mass.push(kilograms);
            drag.push((f64::from(sheet.damping.unwrap_or(0.0)) * damped[k]) as f32);
        }
    }
    let drags = drag.iter().any(|&rate| rate > 0.0);
    Ok((eights(&mass, 1.0), drags.then(|| eights(&drag, 0.0))))
}

fn eights(values: &[f32], filler: f32) -> Vec<F32x8> {
    let wide = |part: &[f32]| std::array::from_fn(|lane| part.get(lane).copied().unwrap_or(filler));
    values.chunks(LANES).map(wide).collect()
}

fn spring_entries(models: &[Model], ranges: &[Range<usize>]) -> Vec<Entry> {
    let mut out = Vec::new();
    for (model, range) in models.iter().zip(ranges) {
        for spring in &model.springs {
            let [a, b] = spring.ends.map(|i| i + range.start as u32);
            let entry = |of, to| Entry {
                of,
                to,
                stiffness: spring.stiffness as f32,
                rest: spring.rest as f32,
                damping: spring.damping as f32,
            };
            out.extend([entry(a, b), entry(b, a)]);
        }
    }
    out
}

/// Plates as linear terms between points: −∂²E/∂x_i∂x_j, summed over plates.
fn plate_entries(models: &[Model], ranges: &[Range<usize>]) -> Vec<Entry> {
    let mut all: Vec<([u32; 2], f64)> = Vec::new();
    for (model, range) in models.iter().zip(ranges) {
        let start = range.start as u32;
        for plate in &model.plates {
            for (i, a) in plate.points.iter().zip(&plate.weights) {
                for (j, b) in plate.points.iter().zip(&plate.weights) {
                    if i != j && a * b != 0.0 {
                        all.push(([i + start, j + start], -plate.rigidity * a * b));
                    }
                }
            }
        }
    }
    // Equal keys are sorted by the bits of their values, so that the result does not depend on the sort.
    par::sort_by_key(&mut all, |(key, k)| (*key, k.to_bits()));
    let sums = all.chunk_by(|a, b| a.0 == b.0).map(|part| {
        let stiffness = part.iter().map(|(_, k)| k).sum::<f64>() as f32;
        let [of, to] = part[0].0;
        Entry { of, to, stiffness, rest: 0.0, damping: 0.0 }
    });
    sums.collect()
}
