//! Smoke blows sheets about, and does not feel them.
//!
//! *Method*: the air's velocity is asked for at the middle of every face, from vortons, wind and sources in solids, as smoke itself asks. What
//! differs from the face's own velocity drags at it, across and along it, each with its square; the corners share the drag. Smoke
//! goes ahead by a frame and leaves the air of each of its steps; between two of them the air is interpolated in time, at places that are
//! the faces' when the earlier one begins.
//! *Departs from the paper*: [gourlay19] part 13 has forces like these on rigid bodies; there they act on the vortons too.
//!
//! Symbols: u → `slip` [m/s]; ρ, C, C_t → [`Drag`].
//! Limits: no mass of air moves along, so that light sheets flutter too fast; the sheet sheds no swirls. Where a sheet is folded both
//! layers feel the whole wind.

use super::{Drag, SmokeOnSheets, liquid::Outside};
use crate::{
    math::Vec3,
    par,
    sim::{
        Diverged,
        record::Clock,
        sheet::{self, Sheets},
        smoke::FrameAir,
    },
};

/// Drag may take this part of a face's speed relative to the air in a substep. Beyond 1 it would turn it round.
const MOST: f32 = 0.5;

/// The corners of a face among the points of all sheets; a triangle names its last twice.
type Face = [u32; 4];

/// Which faces feel the air.
#[derive(Debug)]
pub(in crate::sim) struct Blown {
    faces: Vec<Face>,
    /// Of every face.
    drag: Vec<Drag>,
    /// What goes with every face [kg]: equal shares of its points, which stay as they are when it stretches.
    mass: Vec<f32>,
}

impl Blown {
    /// Sheets by number, with their drag.
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

/// The air of a frame at the sheets.
pub(in crate::sim) struct Wind<'a> {
    blown: &'a Blown,
    /// The air at the steps of the smoke, in order of time.
    airs: Vec<FrameAir>,
    /// The number of the earlier one of two steps, and the velocities of the air at the faces then and at the later one [m/s].
    between: Option<(usize, [Vec<Vec3>; 2])>,
    /// Forces on the points [N].
    forces: Vec<Vec3>,
    pub(in crate::sim) told: SmokeOnSheets,
}

impl<'a> Wind<'a> {
    /// Of the air at the steps of the smoke in a frame, its start and its end among them.
    pub(in crate::sim) fn new(blown: &'a Blown, airs: Vec<FrameAir>) -> Self {
        let told = SmokeOnSheets { faces: blown.faces.len() as u64, ..SmokeOnSheets::default() };
        Self { blown, airs, between: None, forces: Vec::new(), told }
    }

    /// Asks for the air between the two steps around `now` [s].
    fn ask(&mut self, sheets: &Sheets, now: f64) -> Result<(), Diverged> {
        let last = self.airs.len().saturating_sub(2);
        let step = self.airs.iter().skip(1).take_while(|air| air.time() <= now).count().min(last);
        if self.between.as_ref().is_some_and(|(known, _)| *known == step) {
            return Ok(());
        }
        let faces = &self.blown.faces;
        let middle = |f: usize| mean(faces[f], |i| sheets.point(i)[0]);
        let mut places = vec![Vec3::zeros(); faces.len()];
        par::fill(&mut places, middle);
        let at = |number: usize| {
            let air = &self.airs[number.min(self.airs.len() - 1)];
            air.velocity(&places).map_err(|error| Diverged {
                system: sheet::NAME,
                substep: 0,
                particle: error.index as u32,
                what: format!("is a face where the air cannot be told: {error}"),
                try_next: "a smaller coupling.drag or a larger smoke.flow.max_substeps",
            })
        };
        let both = [at(step)?, at(step + 1)?];
        let fastest =
            |air: &Vec<Vec3>| par::max(air.len(), |i| air[i].norm()).map_or(0.0, |(_, u)| f64::from(u));
        self.told.fastest = both.iter().map(fastest).fold(self.told.fastest, f64::max);
        self.between = Some((step, both));
        Ok(())
    }
}

impl Outside for Wind<'_> {
    fn act(&mut self, sheets: &mut Sheets, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged> {
        clock.time("coupling_air", || {
            self.ask(sheets, now)?;
            let Some((step, [then, later])) = &self.between else { return Ok(()) };
            let from = self.airs[*step].time();
            let until = self.airs.get(step + 1).map_or(from, FrameAir::time);
            let part =
                if until > from { ((now - from) / (until - from)).clamp(0.0, 1.0) as f32 } else { 0.0 };
            let Blown { faces, drag: drags, mass: masses } = self.blown;
            let known = &*sheets;
            let mut found = vec![(Vec3::zeros(), false); faces.len()];
            par::fill(&mut found, |f| {
                let air = then[f] * (1.0 - part) + later[f] * part;
                force(known, faces[f], drags[f], air, MOST * masses[f] / dt as f32)
            });
            self.forces.clear();
            self.forces.resize(sheets.len(), Vec3::zeros());
            for (face, (force, cut)) in faces.iter().zip(&found) {
                let corners = corners(face);
                let share = force / corners.len() as f32;
                corners.iter().for_each(|&i| self.forces[i as usize] += share);
                self.told.cut += u64::from(*cut);
                for axis in 0..3 {
                    self.told.impulse[axis] += f64::from(force[axis]) * dt;
                }
            }
            sheets.set_external_forces(std::mem::take(&mut self.forces));
            Ok(())
        })
    }
}

/// The drag on a face [N], and whether it was cut to `most` times the speed [N s/m].
fn force(sheets: &Sheets, face: Face, drag: Drag, air: Vec3, most: f32) -> (Vec3, bool) {
    let [a, b, c, d] = face.map(|i| sheets.point(i as usize)[0]);
    let own = mean(face, |i| sheets.point(i)[1]);
    // Half the product of the diagonals is the area of a quad, and of a triangle whose last corner is there twice.
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
    let cut = k.max(k_t) > most;
    (across * k.min(most) + along * k_t.min(most), cut)
}

/// The corners of a face, each once.
fn corners(face: &Face) -> &[u32] {
    if face[2] == face[3] { &face[..3] } else { face }
}

/// The mean over the corners of a face.
fn mean(face: Face, of: impl Fn(usize) -> Vec3) -> Vec3 {
    let corners = corners(&face);
    corners.iter().map(|&i| of(i as usize)).sum::<Vec3>() / corners.len() as f32
}
