//! Sheets: membranes of points and springs ([gudukbay97]).
//!
//! *Method*: the equations of motion M ẍ + C ẋ = f − f_spr ([gudukbay97] Eq. 4), with springs as forces that points gather
//! from their neighbours (`springs.rs`); what holds points (`hold.rs`) and solids (`solids.rs`) add theirs. Time advances by the symplectic
//! (`explicit.rs`) or the implicit (`implicit.rs`) Euler rule. All sheets are one set of points.
//! *Departs from the paper*: see the files of the parts.
//!
//! Symbols: x → `x` [m], v → `v` [m/s], M → `mass` [kg], C/M → `drag` [1/s].
//! Limits: first order in time; positions are single precision, so a spring of 1 mm at 1 m from the origin knows its strain to 6e-5.

mod attached;
mod bonds;
mod bound;
mod check;
mod contact;
mod drive;
mod error;
mod explicit;
mod free;
mod hold;
mod implicit;
pub(crate) mod job;
mod lanes;
mod model;
mod overshoot;
mod params;
mod record;
mod solids;
mod springs;
mod state;
mod step;
mod table;

pub(in crate::sim) use attached::{Leaning, Touch, Touches};
pub use check::check;
pub use error::SheetError;
pub use params::{
    Contact, Integrator, Joint, Pin, Region, Repulsion, Select, SheetMesh, SheetParams, SheetShape,
    SheetSolver, SheetsCommon, SheetsParams,
};
pub use record::{ContactRecord, SheetRecord};
pub use state::{CORNERS, faces_stream, is_part, sheet_of, stream};

use super::{
    Diverged, Stop, Watch, World,
    record::{Clock, Seconds},
    substep::advance_frame,
};
use crate::{
    math::{
        Vec3,
        wide::{WIDTH, Wide},
    },
    par,
    solid::Solid,
};
use bonds::Bonds;
use bound::Rows;
use hold::{Held, Joined};
use lanes::Vectors;
use model::Model;
use solids::Around;
use std::ops::Range;
use table::{Entry, Table};

/// Its name as a system; streams are called `sheet.` and the sheet's name.
pub const NAME: &str = "sheet";

/// Beyond this coordinate [m] or speed [m/s] a state is called diverged: positions there resolve 8 m.
const ABSURD: f32 = 1e8;

/// Sheets as a preset says them, and what frames mean to their pins.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// What the preset says.
    pub params: SheetsParams,
    /// Frames a second.
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
    /// Faces of each, whose points count from 0.
    faces: Vec<Vec<[u32; 4]>>,
    x: Vectors,
    v: Vectors,
    /// Where the next positions are written, and the next velocities if springs are damped.
    next_x: Vectors,
    next_v: Option<Vectors>,
    force: Vectors,
    /// What rounding took from positions since the frame began [m].
    low: Vectors,
    area: Vec<f32>,
    mass: Vec<Wide>,
    /// 1/mass, zero for points that are held exactly.
    inverse: Vec<Wide>,
    /// `None`: no sheet has any.
    drag: Option<Vec<Wide>>,
    springs: Table,
    plates: Option<Table>,
    held: Vec<Held>,
    joined: Vec<Joined>,
    /// Of the joints that hold exactly now.
    bonds: Bonds,
    /// What moves as a whole now.
    parts: Vec<free::Part>,
    /// For the push of solids; `None` without it.
    around: Option<Around>,
    /// `None`: sheets pass through each other.
    contact: Option<Box<contact::SheetContact>>,
    /// Forces from outside [N]; empty: none.
    outside: Vec<Vec3>,
    /// The longest stable substep [s], the point that asks for it, and for which of the holds that is so.
    longest: (f64, usize),
    holding: Option<Vec<bool>>,
}

impl Sheets {
    /// Sheets at the start of a shot.
    ///
    /// # Errors
    /// If the parameters have no meaning; see [`SheetError`].
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
            return Err(SheetError::TooMany { asked: end as f64 });
        }
        let time = [fps, f64::from(first)];
        let held = hold::held(&params, &models, &ranges, &world.solids, time)?;
        let joined = hold::joined(&params, &models, &ranges, time)?;
        hold::once(&held, &joined, &ranges)?;
        let (mass, drag) = masses(&params, &models)?;
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
        let springs = Table::new(end, spring_entries(&models, &ranges));
        let meets = |meets| Box::new(contact::SheetContact::new(meets, &params, &models, &ranges));
        let contact = params.common.contact.as_ref().map(meets);
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
            plates: bends.then(|| Table::new(end, plate_entries(&models, &ranges))),
            around: params.common.repulsion.is_some().then(|| Around::new(end, &faces)),
            faces: models.into_iter().map(|model| model.faces).collect(),
            outside: Vec::new(),
            longest: (f64::INFINITY, 0),
            holding: None,
            params,
            ranges,
            mass,
            drag,
            held,
            joined,
            bonds: Bonds::default(),
            parts: Vec::new(),
        };
        sheets.settle(0.0);
        Ok(sheets)
    }

    /// Points of all sheets.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The points of each sheet, among those of all.
    pub fn ranges(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// The faces of a sheet, counter-clockwise about the normal; points count from the sheet's first, a triangle names its last twice.
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
        self.mass[point / WIDTH][point % WIDTH]
    }

    /// The longest substep that is stable [s]; infinite where nothing swings.
    pub fn longest_stable(&self) -> f64 {
        self.longest.0
    }

    /// Sets the forces from outside [N], one a point of all sheets, which act until they are set again; empty: none.
    ///
    /// # Panics
    /// If there are neither as many as points nor none.
    pub fn set_outside(&mut self, forces: Vec<Vec3>) {
        assert!(forces.is_empty() || forces.len() == self.len(), "one force a point");
        self.outside = forces;
    }

    /// The passes of a substep, in order.
    pub fn passes(&self) -> Vec<&'static str> {
        let optional = |present: bool, name| present.then_some(name);
        let meets = self.contact.is_some();
        let passes = [
            Some("sheet_step"),
            optional(!self.solids.is_empty(), "sheet_solids"),
            optional(meets, "sheet_search"),
            optional(meets, "sheet_contact"),
            Some("sheet_account"),
        ];
        passes.into_iter().flatten().collect()
    }

    /// Advances from `start` [s] by one frame of `seconds`. Returns what happened and the seconds of the passes.
    ///
    /// # Errors
    /// [`Stop`]; the state is then somewhere inside the frame and good only to look at.
    pub fn advance(
        &mut self,
        start: f64,
        seconds: f64,
        watch: &mut dyn Watch,
    ) -> Result<(SheetRecord, Seconds), Stop> {
        let mut clock = Clock::new(&self.passes());
        let mut record = SheetRecord { points: self.len() as u64, ..SheetRecord::default() };
        // A frame holds the whole state: what rounding took is not carried over.
        self.low.clear();
        self.begin_contact(&mut record);
        advance_frame([start, seconds], watch, |progress, _| {
            let now = progress.now();
            self.settle(now);
            let dt = self.substep_length(now, progress.left, seconds, &mut clock, &mut record)?;
            record.substeps += 1;
            self.substep(now, dt, &mut clock, &mut record)?;
            Ok(dt)
        })?;
        self.end_contact(&mut clock, &mut record);
        clock.time("sheet_account", || self.account(start + seconds, &mut record));
        Ok((record, clock.into_totals()))
    }

    /// Advances from `now` [s] by one substep of `dt` [s], whether or not it is stable, and without the account of a frame.
    ///
    /// # Errors
    /// If a point leaves what can be computed.
    pub fn step(&mut self, now: f64, dt: f64) -> Result<SheetRecord, Diverged> {
        let mut record = SheetRecord { points: self.len() as u64, substeps: 1, ..SheetRecord::default() };
        self.settle(now);
        self.begin_contact(&mut record);
        let mut clock = Clock::new(&self.passes());
        self.max_contact_substep(now, [dt, dt], &mut clock, &mut record);
        self.substep(now, dt, &mut clock, &mut record)?;
        Ok(record)
    }

    /// The next substep [s], of `left` that are left of a frame of `seconds`.
    fn substep_length(
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
            Integrator::Symplectic => self.longest.0 * f64::from(solver.courant),
            Integrator::Implicit => seconds / f64::from(solver.substeps),
        };
        let (travel, fastest) = self.travel(now, left);
        let (approach, closing) = self.max_contact_substep(now, [longest.min(travel), left], clock, record);
        let solver = &self.params.common.solver;
        let count = (left / longest.min(travel).min(approach) - 1e-6).ceil().max(1.0);
        if count + f64::from(done) > f64::from(solver.max_substeps) {
            let (particle, what, try_next) = if approach < longest.min(travel) {
                let what =
                    format!("would need {count:.1e} substeps to meet others within sheets.contact.thickness");
                let remedy =
                    "a larger sheets.contact.thickness or sheets.solver.max_substeps, or slower motion";
                (closing, what, remedy)
            } else if travel < longest {
                let what = format!("would need {count:.1e} substeps to not fly through solids");
                (fastest, what, "a larger sheets.solver.max_substeps or slower motion")
            } else {
                let (so_that, remedy) = match solver.integrator {
                    Integrator::Symplectic => (
                        " to be stable",
                        "sheets.solver.integrator = \"implicit\", a lower stiffness, or a larger \
                         sheets.solver.max_substeps",
                    ),
                    Integrator::Implicit => {
                        ("", "a sheets.solver.max_substeps of sheets.solver.substeps or more")
                    }
                };
                let what = format!("would need {count:.1e} substeps of {longest:.1e} s{so_that}");
                (self.longest.1, what, remedy)
            };
            return Err(self.diverged(done, particle, what, try_next));
        }
        Ok(left / count)
    }

    /// Within how long no point goes through half the thinnest solid [s], and the fastest point.
    fn travel(&self, now: f64, left: f64) -> (f64, usize) {
        let thinnest =
            self.solids.iter().map(|solid| solid.shape.inner_radius()).fold(f32::INFINITY, f32::min);
        if thinnest == f32::INFINITY {
            return (f64::INFINITY, 0);
        }
        let (point, square) = par::max(self.len(), |i| self.v.get(i).norm_squared()).unwrap_or((0, 0.0));
        let moves = |solid: &Solid| {
            let reach = solid.shape.reach();
            solid.motion.as_ref().map_or(0.0, |motion| motion.fastest(now, now + left, reach))
        };
        let solids = self.solids.iter().map(moves).fold(0.0, f64::max);
        (f64::from(thinnest) / (f64::from(square.sqrt()) + solids), point)
    }

    /// Finds again what depends on which points are held, if that has changed.
    fn settle(&mut self, time: f64) {
        let pins = self.held.iter().map(|pin| pin.holds(time));
        let holding: Vec<bool> = pins.chain(self.joined.iter().map(|joint| joint.holds(time))).collect();
        if self.holding.as_ref() == Some(&holding) {
            return;
        }
        self.holding = Some(holding);
        let len = self.len();
        self.inverse = self.mass.clone();
        for (i, value) in self.inverse.as_flattened_mut().iter_mut().enumerate() {
            *value = if i < len { 1.0 / *value } else { 0.0 };
        }
        for pin in self.held.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(time)) {
            self.inverse[pin.point as usize / WIDTH][pin.point as usize % WIDTH] = 0.0;
        }
        self.bonds = Bonds::new(&self.joined, &self.held, time);
        for i in self.bonds.led() {
            self.inverse[i / WIDTH][i % WIDTH] = 0.0;
        }
        let holding = self.joined.iter().filter(|joint| joint.holds(time));
        self.parts = free::parts(&self.ranges, holding, &self.inverse);
        self.set_contact_seams(time);
        let mut rows = Rows::new(&self.springs, self.plates.as_ref(), len);
        rows.hold(&self.held, &self.joined, time);
        if let Some(repulsion) = &self.params.common.repulsion {
            rows.repel(repulsion, self.solids.len(), &self.area);
        }
        self.longest = rows.longest(&self.mass.as_flattened()[..len], self.inverse.as_flattened());
    }

    /// Says which point left what can be computed.
    fn diverged(&self, substep: u32, point: usize, what: String, try_next: &'static str) -> Diverged {
        let sheet = self.ranges.iter().position(|range| range.contains(&point)).unwrap_or(0);
        let name = self.params.sheet.get(sheet).map_or("", |sheet| &sheet.name);
        let first = self.ranges.get(sheet).map_or(0, |range| range.start);
        let what = format!("of sheet '{name}' {what}");
        Diverged { system: NAME, substep, particle: (point - first) as u32, what, try_next }
    }
}

/// Masses of points [kg] and their damping [1/s], by eights.
fn masses(params: &SheetsParams, models: &[Model]) -> Result<(Vec<Wide>, Option<Vec<Wide>>), SheetError> {
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

fn eights(values: &[f32], filler: f32) -> Vec<Wide> {
    let wide = |part: &[f32]| std::array::from_fn(|lane| part.get(lane).copied().unwrap_or(filler));
    values.chunks(WIDTH).map(wide).collect()
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

/// Plates as pulls between points: −∂²E/∂x_i∂x_j, summed over plates.
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
    // A stable order of equal keys is theirs of coming; bits of the values make it one of any sort.
    par::sort_by_key(&mut all, |(key, k)| (*key, k.to_bits()));
    let sums = all.chunk_by(|a, b| a.0 == b.0).map(|part| {
        let stiffness = part.iter().map(|(_, k)| k).sum::<f64>() as f32;
        let [of, to] = part[0].0;
        Entry { of, to, stiffness, rest: 0.0, damping: 0.0 }
    });
    sums.collect()
}
