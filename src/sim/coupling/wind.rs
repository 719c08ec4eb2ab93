//! One-way wind coupling: the air of the smoke exerts drag on sheets.
//!
//! *Method*: the air's velocity is evaluated at the centre of every face, from vortons, wind and sources in solids. The difference from
//! the face's own velocity gives drag across and along the face, each proportional to its square. The corners share the drag. The smoke
//! is advanced by a whole frame first and stores the air of each of its steps. Between two steps the air is interpolated in time, at
//! the faces' positions when the earlier step begins.
//! *Departs from the paper*: [gourlay19] part 13 has such forces on rigid bodies; there they act on the vortons too.
//!
//! Symbols: u → `slip` [m/s]; ρ, C, C_t → [`Drag`].
//! Limits: there is no added mass of air, so light sheets flutter too fast; sheets shed no vorticity. Where a sheet is folded, both
//! layers feel the whole wind.

use super::{Drag, WindRecord, liquid_sheet::ExternalForces};
use crate::{
    math::Vec3,
    par,
    sim::{
        Diverged,
        clock::Clock,
        sheet::{self, Sheets},
        smoke::FrameAir,
    },
};

/// Largest part of a face's speed relative to the air that drag removes in a substep. Beyond 1 the drag would reverse the motion.
const MAX_SPEED_FRACTION: f32 = 0.5;

/// The corners of a face, as indices of points of all sheets; a triangle repeats its last.
type Face = [u32; 4];

/// The faces that feel the air, and the parameters of their drag.
#[derive(Debug)]
pub(in crate::sim) struct WindCoupling {
    faces: Vec<Face>,
    /// Parameters of each face.
    drag: Vec<Drag>,
    /// Mass of each face [kg]: equal shares of the mass of its points, constant under stretch.
    mass: Vec<f32>,
}

impl WindCoupling {
    /// The coupling of the sheets with these indices.
    pub(in crate::sim) fn new(sheets: &Sheets, coupled: &[(usize, Drag)]) -> Self {
        let (mut faces, mut drag) = (Vec::new(), Vec::new());
        for &(sheet, of) in coupled {
            let start = sheets.ranges()[sheet].start as u32;
            faces.extend(sheets.faces(sheet).iter().map(|face| face.map(|i| i + start)));
            drag.resize(faces.len(), of);
        }
        let mut around = vec![0_u32; sheets.len()];
        faces.iter().flat_map(corners).for_each(|&i| around[i as usize] += 1);
        let share = |&i: &u32| sheets.mass(i as usize) / around[i as usize] as f32;
        let mass = faces.iter().map(|face| corners(face).iter().map(share).sum()).collect();
        Self { faces, drag, mass }
    }
}

/// Drag of the air on sheets during one frame.
pub(in crate::sim) struct FrameWind<'a> {
    coupling: &'a WindCoupling,
    /// The air after each step of the smoke, in order of time.
    steps: Vec<FrameAir>,
    /// Index of the step before the current time, and the air's velocities at the faces at this and the next step [m/s].
    interval: Option<(usize, [Vec<Vec3>; 2])>,
    /// Forces on the points [N].
    forces: Vec<Vec3>,
    pub(in crate::sim) record: WindRecord,
}

impl<'a> FrameWind<'a> {
    /// Drag by the air at the steps of the smoke in a frame, its start and end included.
    pub(in crate::sim) fn new(coupling: &'a WindCoupling, steps: Vec<FrameAir>) -> Self {
        let record = WindRecord { faces: coupling.faces.len() as u64, ..WindRecord::default() };
        Self { coupling, steps, interval: None, forces: Vec::new(), record }
    }

    /// Evaluates the air at the two steps around `now` [s].
    fn sample_air(&mut self, sheets: &Sheets, now: f64) -> Result<(), Diverged> {
        let last = self.steps.len().saturating_sub(2);
        let step = self.steps.iter().skip(1).take_while(|air| air.time() <= now).count().min(last);
        if self.interval.as_ref().is_some_and(|(known, _)| *known == step) {
            return Ok(());
        }
        let faces = &self.coupling.faces;
        let middle = |f: usize| mean(faces[f], |i| sheets.point(i)[0]);
        let mut places = vec![Vec3::zeros(); faces.len()];
        par::fill(&mut places, middle);
        let at = |number: usize| {
            let air = &self.steps[number.min(self.steps.len() - 1)];
            air.velocity(&places).map_err(|error| Diverged {
                system: sheet::NAME,
                substep: 0,
                particle: error.index as u32,
                what: format!("is a face where the air cannot be record: {error}"),
                try_next: "a smaller coupling.drag or a larger smoke.flow.max_substeps",
            })
        };
        let both = [at(step)?, at(step + 1)?];
        let max_speed =
            |air: &Vec<Vec3>| par::max(air.len(), |i| air[i].norm()).map_or(0.0, |(_, u)| f64::from(u));
        self.record.max_speed = both.iter().map(max_speed).fold(self.record.max_speed, f64::max);
        self.interval = Some((step, both));
        Ok(())
    }
}

impl ExternalForces for FrameWind<'_> {
    fn apply(&mut self, sheets: &mut Sheets, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged> {
        clock.time("coupling_air", || {
            self.sample_air(sheets, now)?;
            let Some((step, [then, later])) = &self.interval else { return Ok(()) };
            let from = self.steps[*step].time();
            let until = self.steps.get(step + 1).map_or(from, FrameAir::time);
            let fraction =
                if until > from { ((now - from) / (until - from)).clamp(0.0, 1.0) as f32 } else { 0.0 };
            let WindCoupling { faces, drag: drags, mass: masses } = self.coupling;
            let known = &*sheets;
            let mut found = vec![(Vec3::zeros(), false); faces.len()];
            par::fill(&mut found, |f| {
                let air = then[f] * (1.0 - fraction) + later[f] * fraction;
                force(known, faces[f], drags[f], air, MAX_SPEED_FRACTION * masses[f] / dt as f32)
            });
            self.forces.clear();
            self.forces.resize(sheets.len(), Vec3::zeros());
            for (face, (force, limited)) in faces.iter().zip(&found) {
                let corners = corners(face);
                let share = force / corners.len() as f32;
                corners.iter().for_each(|&i| self.forces[i as usize] += share);
                self.record.limited += u64::from(*limited);
                for axis in 0..3 {
                    self.record.impulse[axis] += f64::from(force[axis]) * dt;
                }
            }
            sheets.set_external_forces(std::mem::take(&mut self.forces));
            Ok(())
        })
    }
}

/// Drag on a face [N], and whether its coefficient was limited to `max_coefficient` [N s/m].
fn force(sheets: &Sheets, face: Face, drag: Drag, air: Vec3, max_coefficient: f32) -> (Vec3, bool) {
    let [a, b, c, d] = face.map(|i| sheets.point(i as usize)[0]);
    let own = mean(face, |i| sheets.point(i)[1]);
    // Half the cross product of the diagonals is the area of a quad, and of a triangle whose last corner is repeated.
    let cross = (c - a).cross(&(d - b));
    let double_area = cross.norm();
    if double_area <= 0.0 {
        return (Vec3::zeros(), false);
    }
    let n = cross / double_area;
    let slip = air - own;
    let across = n * n.dot(&slip);
    let along = slip - across;
    let half = 0.25 * drag.density * double_area; // ½ ρ A
    let [k, k_t] = [(drag.across, across), (drag.along, along)].map(|(c, u)| half * c * u.norm());
    let limited = k.max(k_t) > max_coefficient;
    (across * k.min(max_coefficient) + along * k_t.min(max_coefficient), limited)
}

/// The distinct corners of a face.
fn corners(face: &Face) -> &[u32] {
    if face[2] == face[3] { &face[..3] } else { face }
}

/// Mean over the corners of a face.
fn mean(face: Face, of: impl Fn(usize) -> Vec3) -> Vec3 {
    let corners = corners(&face);
    corners.iter().map(|&i| of(i as usize)).sum::<Vec3>() / corners.len() as f32
}
