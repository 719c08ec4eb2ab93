//! Work against precision of surfaces: which voxel, clean-up and distance are worth their time on the user's own particles.
//!
//! *Method*: particles that are there, of a cache or of any solver's files, are surfaced with every setting of a sweep
//! (`row`). Each surface is compared with that of the reference, a finer voxel of the same particles: distances both ways
//! ([`crate::mesh::surface_distance`]), normals, volume; and the reference with its own refinement, which tells how small an error
//! can be seen at all. The signed distance is also judged by itself, against the exact distance to its own zero: orders,
//! bands and blocks change it without moving the surface.
//!
//! Limits: the reference resolves what the preset defines; whether that definition is the better picture, it does not
//! say.

mod files;
mod row;
mod source;

#[cfg(test)]
mod tests;

pub use files::write;
pub use row::FieldError;

use super::{
    Compared, Spread,
    sweep::{Setting, Sweep},
};
use crate::{
    cache::Lock,
    job::memory::refuse_memory,
    mesh::{
        SurfaceParams,
        surface_distance::{Distance, Target},
    },
    product::surface::{max_surface_memory, stream_memory},
    run::{Control, RunError, ShotFolder, Source},
    scene::Scene,
};
use row::{Place, Row};
use serde::Serialize;
use source::Sample;
use std::path::Path;

/// The error that decides which settings are on the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// Distance from the reference, root mean square.
    Distance,
    /// Largest distance from the reference.
    Hausdorff,
    /// Normals against the reference's.
    Normals,
    /// Volume against the reference's.
    Volume,
    /// The signed distance against the exact one, for the time that it takes alone: needs no reference.
    Field,
}

impl By {
    /// Every one.
    pub const ALL: [Self; 5] = [Self::Distance, Self::Hausdorff, Self::Normals, Self::Volume, Self::Field];
}

/// Distances between the surfaces of two settings, over all frames; `None` where one of two surfaces is empty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Apart {
    /// Root mean square over both surfaces [m].
    pub distance: Option<f64>,
    /// The largest, both ways [m].
    pub hausdorff: Option<f64>,
    /// The largest from this surface to the other [m]: what it has too much.
    pub beyond: Option<f64>,
    /// The largest from the other to this one [m]: what it lacks.
    pub missing: Option<f64>,
    /// Angle between the normals of nearest points: root mean square over both surfaces [deg].
    pub normals: Option<f64>,
    /// The volume of all frames over the other's, less one.
    pub volume: Option<f64>,
}

/// Surfaces, and what their table says besides the lines.
#[derive(Clone, Debug, Serialize)]
pub struct Surfaces {
    /// The frames that were compared.
    pub frames: Vec<u32>,
    /// Frames that are there or planned.
    pub shot_frames: u64,
    /// Particles of a frame, on average.
    pub particles: f64,
    /// Distance between them at rest [m].
    pub spacing: f32,
}

/// A setting of surfaces. Times are those of a frame, without reading and writing.
pub type Line = super::Line<Surfaces>;

/// The result of a tradeoff.
pub type Table = super::Table<Surfaces>;

/// What surfaces tell by themselves.
#[derive(Clone, Debug, Serialize)]
pub struct Told {
    /// Wall-clock time of a frame's signed distance alone [s].
    pub field_seconds: Option<Spread>,
    /// Every pass and its time a frame, the mean of the repeats [s].
    pub passes: Vec<(String, f64)>,
    /// The most memory that the process held [bytes].
    pub memory: Option<u64>,
    /// Vertices of a frame, on average.
    pub vertices: f64,
    /// Triangles of a frame, on average.
    pub triangles: f64,
    /// Pieces of a frame, on average.
    pub pieces: f64,
    /// Volume of a frame, on average [m³].
    pub volume: f64,
    /// Area of a frame, on average [m²].
    pub area: f64,
    /// Frames whose mesh is not closed, manifold and oriented.
    pub unsound: usize,
    /// The error of the signed distance: mean of the frames, and the largest.
    pub field: Option<FieldError>,
}

impl Compared for Surfaces {
    type By = By;
    type Told = Told;
    type Apart = Apart;

    const LIMITED: By = By::Distance;
    const WITHOUT_REFERENCE: &'static str = "name another with --reference";
    const INCOMPARABLE: Option<&'static str> = Some("no surface to compare");

    fn needs_reference(by: By) -> bool {
        by != By::Field
    }

    fn error(by: By, told: &Told, apart: &Apart) -> Option<f64> {
        match by {
            By::Distance => apart.distance,
            By::Hausdorff => apart.hausdorff,
            By::Normals => apart.normals,
            By::Volume => apart.volume.map(f64::abs),
            By::Field => told.field.map(|field| field.mean),
        }
    }

    fn seconds(by: By, line: &Line) -> Option<Spread> {
        if by == By::Field { line.told.field_seconds } else { Some(line.seconds) }
    }

    fn unit(&self) -> f64 {
        self.spacing.into()
    }

    fn limit(most: f64) -> String {
        format!("a distance of {}% of a spacing", 100.0 * most)
    }
}

/// What is to be done.
#[derive(Clone, Debug)]
pub struct Job {
    /// The frames to compare, all of which are there.
    pub frames: Vec<u32>,
    /// How many frames a setting would be used on.
    pub shot_frames: u64,
    /// How often every setting is timed.
    pub repeats: usize,
    /// The error that decides.
    pub by: By,
    /// Refuse if a surface needs about more than this [bytes].
    pub max_memory: Option<u64>,
}

/// About the most memory that a setting needs on a frame of `particles`, before anything is known of how they lie [bytes].
pub fn memory_at_most(particles: usize, params: &SurfaceParams) -> u64 {
    max_surface_memory(particles, params)
}

/// The reference, its refinement, then the rows.
fn settings(sweep: &Sweep) -> Vec<&(Setting, Scene)> {
    [&sweep.reference, &sweep.refined].into_iter().chain(&sweep.rows).collect()
}

/// Makes the surfaces that are not there yet, compares them and tabulates everything. Rows live in `folder`, a folder
/// each.
///
/// # Errors
/// Whatever stops the surfacing; [`RunError::OverMemory`] before any. Finished rows are kept.
pub fn tradeoff(
    sweep: &Sweep,
    source: &Source<'_>,
    job: &Job,
    folder: &Path,
    control: Control,
) -> Result<Table, RunError> {
    let rows_folder = folder.join("rows");
    ShotFolder::create(&rows_folder)?;
    let _lock = Lock::acquire(&rows_folder)?;
    let samples = source.samples(&job.frames)?;
    if samples.is_empty() {
        return Err(RunError::Request(
            "the frames hold no particles of any system; expected some to mesh".into(),
        ));
    }
    let settings = settings(sweep);
    if let Some(allowed) = job.max_memory {
        refuse_what_needs_more(&settings, &samples, allowed)?;
    }
    let place =
        |setting: usize, sample: usize| Place::new(folder, &settings[setting].1.surface, &samples[sample]);
    let places: Vec<Vec<Place<'_>>> =
        (0..settings.len()).map(|i| (0..samples.len()).map(|j| place(i, j)).collect()).collect();
    let rows = Work { settings: &settings, samples: &samples, places: &places, job, control }.run()?;
    Ok(tabulate(sweep, job, &samples, &places[0], &rows))
}

fn refuse_what_needs_more(
    settings: &[&(Setting, Scene)],
    samples: &[Sample],
    allowed: u64,
) -> Result<(), RunError> {
    for sample in samples {
        let particles = sample.read()?;
        for (_, scene) in settings {
            refuse_memory(stream_memory(&particles, sample.spacing, &scene.surface, allowed), allowed)?;
        }
    }
    Ok(())
}

/// The runs of a tradeoff. The reference comes first among the settings, its refinement second.
struct Work<'a> {
    settings: &'a [&'a (Setting, Scene)],
    samples: &'a [Sample],
    places: &'a [Vec<Place<'a>>],
    job: &'a Job,
    control: Control<'a>,
}

impl Work<'_> {
    /// Makes and compares; a list a setting, a row a sample.
    fn run(&self) -> Result<Vec<Vec<Row>>, RunError> {
        let reporter = self.control.reporter;
        let known: Vec<Vec<Option<Row>>> =
            self.places.iter().map(|places| places.iter().map(Place::load).collect()).collect();
        let is_apart = |setting: usize, sample: usize| {
            let row = known[setting][sample].as_ref();
            row.is_some_and(|row| row.apart.contains_key(&self.places[0][sample].name))
        };
        let to_compare = |sample: usize| (1..self.settings.len()).any(|setting| !is_apart(setting, sample));
        let wants_mesh = |setting: usize, sample: usize| {
            if setting == 0 { to_compare(sample) } else { !is_apart(setting, sample) }
        };

        // Coarse ones first: what the allocator keeps of one run then shows least in the memory of the next.
        let mut order: Vec<usize> = (0..self.settings.len()).collect();
        let voxel = |&i: &usize| self.settings[i].1.surface.voxel;
        order.sort_by(|a, b| voxel(b).total_cmp(&voxel(a)));
        let total = self.settings.len() * self.samples.len();
        reporter.begin("tradeoff", 2 * total);
        let mut rows: Vec<Vec<Option<Row>>> = vec![vec![None; self.samples.len()]; self.settings.len()];
        let mut done = 0;
        for setting in order {
            for (sample, of) in self.samples.iter().enumerate() {
                let place = &self.places[setting][sample];
                let repeats = if setting < 2 { 1 } else { self.job.repeats };
                let (row, is_new) = place.complete(repeats, wants_mesh(setting, sample), self.control)?;
                let seconds = Spread::of(&row.seconds(None)).expect("a row has been timed");
                let what = if is_new { format!("{:.2} s", seconds.median) } else { "was there".into() };
                done += 1;
                let label = &self.settings[setting].0.label;
                reporter.frame(&format!("{done} of {total}  {label}, frame {}: {what}", of.frame));
                reporter.progress(done as f64);
                rows[setting][sample] = Some(row);
            }
        }
        let mut rows: Vec<Vec<Row>> =
            rows.into_iter().map(|rows| rows.into_iter().flatten().collect()).collect();
        for sample in 0..self.samples.len() {
            if to_compare(sample) {
                let missing = |&setting: &usize| !is_apart(setting, sample);
                self.compare(sample, (1..self.settings.len()).filter(missing).collect(), &mut rows)?;
            }
            reporter.progress((total + (sample + 1) * self.settings.len()) as f64);
        }
        reporter.end();
        Ok(rows)
    }

    /// Compares some settings with the reference on one sample.
    fn compare(&self, sample: usize, missing: Vec<usize>, rows: &mut [Vec<Row>]) -> Result<(), RunError> {
        let reference = &self.places[0][sample];
        let mesh = reference.mesh().expect("the reference's mesh is kept until all are compared with it");
        let target = Target::new(&mesh).map(|target| (&mesh, target));
        for setting in missing {
            if (self.control.interrupted)() {
                return Err(RunError::Interrupted);
            }
            self.places[setting][sample].compare(&mut rows[setting][sample], reference, target.as_ref())?;
        }
        reference.give_up_mesh();
        Ok(())
    }
}

/// Puts the rows into lines. `references` are the places of the reference.
fn tabulate(
    sweep: &Sweep,
    job: &Job,
    samples: &[Sample],
    references: &[Place<'_>],
    rows: &[Vec<Row>],
) -> Table {
    let apart = |of: &[Row]| apart(of, &rows[0], references);
    let at = |(setting, _): &(Setting, Scene), rows: &[Row]| line(setting, rows, job, samples);
    let shown = |rows: &[Row]| rows.iter().map(|row| row.mesh).collect::<Vec<_>>();
    let own = &rows[2..];
    let lines = sweep.rows.iter().zip(own).enumerate().map(|(place, (setting, rows))| {
        let same_as = own[..place].iter().position(|other| shown(other) == shown(rows));
        Line { apart: apart(rows), same_as, ..at(setting, rows) }
    });
    let about = Surfaces {
        frames: job.frames.clone(),
        shot_frames: job.shot_frames,
        particles: samples.iter().map(|sample| sample.particles as f64).sum::<f64>() / samples.len() as f64,
        spacing: samples[0].spacing,
    };
    let refined = Line { apart: apart(&rows[1]), ..at(&sweep.refined, &rows[1]) };
    let references = [at(&sweep.reference, &rows[0]), refined];
    Table::new(&sweep.base.title, about, job.by, lines.collect(), references)
}

/// How far the surfaces of some rows are from the reference's, whose places are `references`.
fn apart(rows: &[Row], reference: &[Row], references: &[Place<'_>]) -> Apart {
    let of = |(row, place): (&Row, &Place<'_>)| row.apart.get(&place.name).copied().flatten();
    let pairs: Option<Vec<[Distance; 2]>> = rows.iter().zip(references).map(of).collect();
    let total = |rows: &[Row]| rows.iter().map(|row| row.volume).sum::<f64>();
    let volume = Some(total(reference)).filter(|&volume| volume > 0.0).map(|all| total(rows) / all - 1.0);
    let Some(pairs) = pairs else { return Apart { volume, ..Apart::default() } };
    let join = |way: usize| pairs.iter().map(|pair| pair[way]).fold(Distance::default(), Distance::joined);
    let (there, back) = (join(0), join(1));
    let both = there.joined(back);
    Apart {
        distance: Some(both.rms()),
        hausdorff: Some(both.largest),
        beyond: Some(there.largest),
        missing: Some(back.largest),
        normals: Some(both.angle().to_degrees()),
        volume,
    }
}

/// What a setting's rows say without the reference.
fn line(setting: &Setting, rows: &[Row], job: &Job, samples: &[Sample]) -> Line {
    let frames = job.frames.len() as f64;
    let mean = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).sum::<f64>() / frames;
    // Samples of several streams may share a frame; a repeat counts if every sample has it.
    let times = |of: &dyn Fn(&Row) -> Vec<f64>| {
        let all: Vec<Vec<f64>> = rows.iter().map(of).collect();
        let repeats = all.iter().map(Vec::len).min().unwrap_or(0);
        let repeat = |r: usize| all.iter().map(|times| times[r]).sum::<f64>() / frames;
        Spread::of(&(0..repeats).map(repeat).collect::<Vec<_>>())
    };
    let timed = |pass: Option<&'static str>| times(&move |row: &Row| row.seconds(pass));
    let mut passes: Vec<(String, f64)> = Vec::new();
    for row in rows {
        for (name, seconds) in row.passes.iter().flatten() {
            let seconds = seconds / row.passes.len() as f64 / frames;
            match passes.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += seconds,
                None => passes.push((name.clone(), seconds)),
            }
        }
    }
    let fields: Vec<FieldError> = rows.iter().filter_map(|row| row.field).collect();
    let seconds = timed(None);
    debug_assert_eq!(rows.len(), samples.len(), "a row a sample");
    let memory = rows.iter().map(|row| row.memory).collect::<Option<Vec<_>>>();
    let told = Told {
        field_seconds: timed(Some("distance")),
        passes,
        memory: memory.and_then(|bytes| bytes.into_iter().max()),
        vertices: mean(&|row| row.size[0] as f64),
        triangles: mean(&|row| row.size[1] as f64),
        pieces: mean(&|row| row.pieces as f64),
        volume: mean(&|row| row.volume),
        area: mean(&|row| row.area),
        unsound: rows.iter().filter(|row| !row.is_sound).count(),
        field: (!fields.is_empty()).then(|| FieldError {
            mean: fields.iter().map(|field| field.mean).sum::<f64>() / fields.len() as f64,
            largest: fields.iter().map(|field| field.largest).fold(0.0, f64::max),
        }),
    };
    let whole = seconds.map_or(0.0, |spread| spread.median) * job.shot_frames as f64;
    Line::new(setting, [seconds, times(&|row| row.cpu_seconds.clone())], whole, told)
}
