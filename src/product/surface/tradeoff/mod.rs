//! The tradeoff of surfaces: which voxel, clean-up and distance are worth their time on the user's own particles.
//!
//! *Method*: particles of a cache or of any solver's files are surfaced with every setting of a sweep. Each surface is compared
//! with that of the reference, a finer voxel of the same particles: symmetric surface distance ([`crate::mesh::surface_distance`]),
//! normals, volume. The signed distance is also compared with the exact distance to its own zero: orders, bands and
//! blocks change it without moving the surface.
//!
//! Limits: the reference resolves the surface that the preset defines. Whether that surface looks better is not compared.

mod source;

use super::{
    memory::{max_surface_memory, stream_memory},
    solids::{Colliders, no_colliders},
};
use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream, StreamKind},
    job::{
        Control, RunError, ShotFolder,
        memory::refuse_memory,
        tradeoff::{About, Column, Shown, Spread, Table, Unit, Wording},
        usage::{Meter, Peak},
    },
    mesh::{
        DistanceParams, Mesh, PlacedSolid, SURFACE_VERSION, Surface, marching_cubes, reconstruct_at_solids,
        surface_distance::{Distance, Target, distance},
    },
    par,
    preset::Frames,
    product::colors::StreamColors,
    sdf::{Order, SignedDistance},
    sim::{
        scene::Scene,
        tradeoff::{
            self, Axis, Change, ComparedRun, FrameSample, Knob, Made, Measure, ProductRuns, ProductSource,
            Run, RunFolder, Runs, Subject, Sweep, TradeoffJob, multiples,
        },
    },
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use source::Sample;
use std::{collections::BTreeMap, rc::Rc};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// The tradeoff of surfaces.
pub(in crate::product) static SUBJECT: Subject = Subject {
    name: "surface",
    wording: &WORDING,
    columns: || COLUMNS.map(|column| column.info).to_vec(),
    knobs: |_| KNOBS.to_vec(),
    defaults,
    one_by_one: false,
    table: "surface.",
    refuse: |key| {
        let why =
            "does not change a surface, expected surface.…; leave out --of surface to vary the simulation";
        (!key.starts_with("surface.")).then_some(why)
    },
    key: |scene| {
        let text = serde_json::to_string(&scene.surface).expect("settings are plain data");
        xxh3_64(text.as_bytes())
    },
    runs: Runs::Product(ProductRuns {
        memory: |particles, scene| max_surface_memory(particles, &scene.surface),
        uses_solids: |scene| scene.surface.contact.is_some(),
        run,
    }),
};

const WORDING: Wording = Wording {
    whole: "all frames",
    seconds: "wall-clock time of a frame's passes, without reading and writing",
    same: "the same meshes as",
    criterion: "distance",
    limit: "an RMS distance of at most {} of a spacing",
    incomparable: Some("a surface is empty where the reference's is not"),
};

type SurfaceColumn = Column<ComparedRun<SurfaceRuns>>;

const COLUMNS: [SurfaceColumn; 15] = [
    SurfaceColumn::data("vertices", Unit::Mean, |run| Some(size(run, 0))),
    SurfaceColumn::new("triangles", "triangles", Unit::Mean, |run| Some(size(run, 1))).meaning("of a frame"),
    SurfaceColumn::data("pieces", Unit::Mean, |run| per_frame(run, |surface| surface.components as f64)),
    SurfaceColumn::data("volume", Unit::Of("m³"), |run| per_frame(run, |surface| surface.volume)),
    SurfaceColumn::data("area", Unit::Of("m²"), |run| per_frame(run, |surface| surface.area)),
    SurfaceColumn::data("unsound", Unit::Count, |run| {
        run.sum(|surface| f64::from(u8::from(!surface.is_sound)))
    })
    .remark("meshes are not closed, manifold and oriented"),
    SurfaceColumn::new("distance", "rms", Unit::Spacings, |run| Some(both(run)?.rms()))
        .meaning("symmetric distance between the surface and the reference's, in particle spacings: RMS")
        .against_reference()
        .criterion("distance"),
    SurfaceColumn::new("hausdorff", "largest", Unit::Spacings, |run| Some(both(run)?.largest))
        .meaning("largest of these distances (Hausdorff distance)")
        .against_reference()
        .criterion("hausdorff"),
    SurfaceColumn::data("beyond", Unit::Spacings, |run| Some(run.distance?[0].largest)).against_reference(),
    SurfaceColumn::data("missing", Unit::Spacings, |run| Some(run.distance?[1].largest)).against_reference(),
    SurfaceColumn::new("normals", "normals", Unit::Degrees, |run| Some(both(run)?.angle().to_degrees()))
        .meaning("angle between the normals of nearest points: RMS over both surfaces")
        .against_reference()
        .criterion("normals"),
    SurfaceColumn::new("volume", "volume", Unit::Change, |run| {
        let reference = Some(volume(run.reference.as_ref()?)).filter(|&volume| volume > 0.0)?;
        Some(volume(&run.run) / reference - 1.0)
    })
    .meaning("volume of all frames together, against the reference's")
    .against_reference()
    .criterion("volume"),
    SurfaceColumn::new("field.mean", "field", Unit::Voxels, |run| {
        let errors: Vec<f64> = run.logged().filter_map(|surface| Some(surface.field?.mean)).collect();
        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    })
    .meaning("signed distance against the exact one to its own zero: mean over the band, in voxels")
    .criterion("field")
    .timed_by("field_seconds"),
    SurfaceColumn::data("field.largest", Unit::Voxels, |run| {
        run.logged().filter_map(|surface| Some(surface.field?.largest)).reduce(f64::max)
    }),
    SurfaceColumn::times("field_seconds", "field time", field_seconds).shown(Shown::Page),
];

/// Vertices (0) or triangles (1) of a frame, on average.
fn size(run: &ComparedRun<SurfaceRuns>, what: usize) -> f64 {
    let sum: usize = run.samples().map(|FrameSample { sample, .. }| sample.size[what]).sum();
    sum as f64 / run.measure.frames.len() as f64
}

/// The sum of a logged figure over all surfaces of a frame, mean of the frames.
fn per_frame(run: &ComparedRun<SurfaceRuns>, figure: impl Fn(&LoggedSurface) -> f64) -> Option<f64> {
    Some(run.sum(figure)? / run.measure.frames.len() as f64)
}

fn volume(run: &Run<SurfaceRuns>) -> f64 {
    run.record.frames.iter().filter_map(|sample| Some(sample.logged.as_ref()?.volume)).sum()
}

/// The symmetric distance of two surfaces.
fn both(run: &ComparedRun<SurfaceRuns>) -> Option<Distance> {
    run.distance.map(|[there, back]| there.joined(back))
}

/// Times of the signed distance of a frame [s].
fn field_seconds(run: &ComparedRun<SurfaceRuns>) -> Option<Spread> {
    let frames = run.measure.frames.len() as f64;
    let seconds = |passes: &Vec<(String, f64)>| {
        passes.iter().filter(|(name, _)| name == "distance").map(|(_, seconds)| seconds / frames).sum()
    };
    Spread::of(&run.run.record.passes.iter().map(seconds).collect::<Vec<_>>())
}

const VOXEL: Knob = Knob::new("surface.voxel", |scene, _| Some(&mut scene.surface.voxel));

const KNOBS: [Knob; 5] = [
    VOXEL.times(2.0 / 3.0).always(),
    Knob::choice("surface.distance", |scene| {
        scene.surface.distance.get_or_insert_default();
        Some("{}")
    }),
    Knob::new("surface.distance.band", |scene, _| Some(&mut scene.surface.distance.as_mut()?.band)).largest(),
    Knob::choice("surface.distance.order", |scene| {
        scene.surface.distance.get_or_insert_default().order = Order::Second;
        Some("second")
    }),
    Knob::choice("surface.decimation", |scene| {
        scene.surface.decimation = None;
        Some("none")
    }),
];

/// What is varied by default: the voxel, and whether the surface is cut from the signed distance.
fn defaults(scene: &Scene) -> Vec<Axis> {
    let distance = |text: &str, distance: Option<DistanceParams>| {
        let apply = move |scene: &mut Scene| scene.surface.distance = distance;
        vec![Change::new(format!("surface.distance={text}"), apply)]
    };
    let distances = vec![distance("none", None), distance("{}", Some(DistanceParams::default()))];
    vec![multiples(scene, &[(VOXEL, [0.0, f64::MAX])], [0.6, 0.8, 1.0, 1.4, 2.0]), distances]
}

/// Makes the surfaces that are not there yet, compares them and tabulates everything. What needs too much memory is refused
/// before anything is made.
fn run(
    sweep: &Sweep,
    from: &ProductSource<'_>,
    job: &TradeoffJob<'_>,
    control: Control,
) -> Result<Table, RunError> {
    let frames: Vec<u32> = job.frames.iter().map(|index| index.0).collect();
    let samples = source::samples(&from.source, job.frames, from.max_memory)?;
    let Some(last) = samples.len().checked_sub(1) else {
        return Err(RunError::Request(
            "the frames hold no particles of any system; expected some to mesh".into(),
        ));
    };
    let mut scenes = sweep.rows.iter().chain([&sweep.reference, &sweep.refined]);
    let colliders = match from.scene {
        Some(scene) => Colliders::of_scene(scene),
        None if scenes.any(|(_, scene)| scene.surface.contact.is_some()) => {
            return Err(no_colliders("particles without a preset"));
        }
        None => Colliders::default(),
    };
    if let Some(allowed) = from.max_memory {
        for sample in &samples {
            let (particles, _) = sample.read()?;
            for (_, scene) in sweep.rows.iter().chain([&sweep.reference, &sweep.refined]) {
                refuse_memory(stream_memory(&particles, sample.spacing, &scene.surface, allowed), allowed)?;
            }
        }
    }
    let measure = SurfaceRuns { samples, colliders, frames, shot_frames: from.shot_frames };
    let all = Frames::from_first_to_last(FrameIndex(0), FrameIndex(last as u32)).expect("0 is the first");
    tradeoff::tradeoff(&WORDING, measure, sweep, &TradeoffJob { frames: &all, ..*job }, control)
}

/// How surfaces are made, measured and compared. Each sample is a frame of the run.
struct SurfaceRuns {
    samples: Vec<Sample>,
    colliders: Colliders,
    /// The frames that the samples are of.
    frames: Vec<u32>,
    shot_frames: u64,
}

/// What is measured of a surface.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct SurfaceSample {
    /// Vertices and triangles.
    size: [usize; 2],
    /// A hash of the mesh.
    mesh: u64,
}

/// Record of making a surface.
#[derive(Serialize, Deserialize)]
struct LoggedSurface {
    /// Connected components.
    components: usize,
    /// Enclosed volume [m³].
    volume: f64,
    /// Area [m²].
    area: f64,
    /// Whether the mesh is closed, manifold and oriented, without degenerate triangles.
    is_sound: bool,
    /// How exact the signed distance is.
    field: Option<FieldError>,
}

/// Largest part of a triangle that is sampled as one, in voxels of its surface: those of marching cubes are smaller.
const MAX_SAMPLE: f32 = 2.0;

impl Measure for SurfaceRuns {
    type Sample = SurfaceSample;
    type Logged = LoggedSurface;
    /// To the reference and back, over all samples; `None` where one of two surfaces is empty.
    type Distance = Option<[Distance; 2]>;

    const VERSION: &str = "surface 3";
    const KEEPS_FRAMES: bool = false;

    fn decisive(&self, scene: &Scene) -> String {
        let settings = serde_json::to_string(&scene.surface).expect("settings are plain data");
        let states =
            self.samples.iter().map(|sample| (sample.frame.0, sample.state, sample.spacing.to_bits()));
        let colliders = if scene.surface.contact.is_some() { &*self.colliders.text } else { "" };
        format!("{SURFACE_VERSION} {settings} {:?} {colliders}", states.collect::<Vec<_>>())
    }

    /// Coarse surfaces come first: what the allocator keeps of one run then shows least in the memory of the next.
    fn coarseness(&self, scene: &Scene) -> f32 {
        scene.surface.voxel
    }

    /// Makes the surfaces as `mesh` does.
    fn make(
        &self,
        folder: &RunFolder,
        shot: &ShotFolder,
        is_repeat: bool,
        control: Control,
    ) -> Result<Made<LoggedSurface>, RunError> {
        ShotFolder::create(&shot.cache())?;
        let mut made = Made {
            passes: Vec::new(),
            cpu_seconds: Some(0.0),
            memory: None,
            diverged: None,
            logged: BTreeMap::new(),
        };
        for (place, sample) in self.samples.iter().enumerate() {
            let index = FrameIndex(place as u32);
            let (peak, (particles, time)) = (Peak::since_now(), sample.read()?);
            let meter = Meter::new();
            let solids = PlacedSolid::at(&self.colliders.solids, time);
            let params = &folder.scene.surface;
            let colors = StreamColors::of(Some(&folder.scene));
            let colors = colors.for_surface(&particles, params).map_err(RunError::Request)?;
            let particles = colors.with(&particles);
            let surface = reconstruct_at_solids(&particles, sample.spacing, params, &solids, control.cancel);
            let Surface { mesh, distance, check, stats, .. } = surface.map_err(RunError::from)?;
            made.cpu_seconds = made.cpu_seconds.zip(meter.cpu()).map(|(sum, cpu)| sum + cpu);
            made.memory = made.memory.max(peak.bytes());
            made.passes.extend(stats.seconds.iter().map(|(name, seconds)| ((*name).to_owned(), *seconds)));
            if !is_repeat {
                let logged = LoggedSurface {
                    components: check.components,
                    volume: check.volume,
                    area: check.area,
                    is_sound: check.is_sound(),
                    field: distance.as_ref().and_then(field_error),
                };
                made.logged.insert(index, logged);
            }
            cache::write_frame(&shot.cache(), &as_frame(mesh, index), 0)?;
            control.reporter.progress((place + 1) as f64);
        }
        Ok(made)
    }

    fn sample(
        &self,
        _: &RunFolder,
        frame: &Frame,
        _: bool,
        _: Control,
    ) -> Result<(SurfaceSample, Frame), RunError> {
        let mut hash = Xxh3::new();
        let mesh = as_mesh(frame).unwrap_or_default();
        let numbers = mesh.positions.iter().chain(&mesh.normals).flat_map(|x| x.iter());
        numbers.for_each(|v| hash.update(&v.to_le_bytes()));
        mesh.triangles.iter().flatten().for_each(|v| hash.update(&v.to_le_bytes()));
        let size = [mesh.positions.len(), mesh.triangles.len()];
        Ok((SurfaceSample { size, mesh: hash.digest() }, frame.clone()))
    }

    fn distance(
        &self,
        run: &Run<Self>,
        reference: &Run<Self>,
        _: &Frames,
    ) -> Result<Option<[Distance; 2]>, RunError> {
        let mut all = [Distance::default(); 2];
        let mesh = |run: &Run<Self>, sample: u32| -> Result<Mesh, RunError> {
            let kept = run.folder.kept(sample)?;
            Ok(kept.as_ref().and_then(as_mesh).expect("frames of surfaces are kept until they are compared"))
        };
        for (number, sample) in (0..).zip(&self.samples) {
            let (own, other) = (mesh(run, number)?, mesh(reference, number)?);
            let step = |run: &Run<Self>| MAX_SAMPLE * run.folder.scene.surface.voxel * sample.spacing;
            match (Target::new(&own), Target::new(&other)) {
                (Some(own_target), Some(target)) => {
                    all[0] = all[0].joined(distance(&own, &target, step(run)));
                    all[1] = all[1].joined(distance(&other, &own_target, step(reference)));
                }
                (None, None) => {}
                _ => return Ok(None),
            }
        }
        Ok(Some(all))
    }

    /// Times are those of a frame.
    fn scales(&self, _: &RunFolder, _: &Scene) -> [f64; 2] {
        [1.0, self.shot_frames as f64].map(|frames| frames / self.frames.len() as f64)
    }

    fn columns(&self) -> Vec<SurfaceColumn> {
        COLUMNS.into()
    }

    fn describe(&self, _: &[Rc<Run<Self>>], _: &str, about: &mut About) {
        let spacing = self.samples[0].spacing;
        let particles = self.samples.iter().map(|sample| sample.particles as f64).sum::<f64>();
        let particles = particles / self.samples.len() as f64;
        let frames = self.frames.iter().map(u32::to_string).collect::<Vec<_>>().join(",");
        about.frames = format!("frames {frames}, about {particles:.0} particles of spacing {spacing} m");
        about.spacing = spacing.into();
        about.facts = vec![
            ("frames", json!(self.frames)),
            ("shot_frames", json!(self.shot_frames)),
            ("particles", json!(particles)),
            ("spacing", json!(spacing)),
        ];
    }
}

/// Channels of a kept mesh's triangles.
const CORNERS: [&str; 3] = ["a", "b", "c"];

/// A mesh in the container of the cache, which is checked when it is read.
fn as_frame(mesh: Mesh, index: FrameIndex) -> Frame {
    let mesh = mesh.in_world_frame();
    let corner = |place: usize| mesh.triangles.iter().map(|t| t[place]).collect::<Vec<u32>>();
    let mut triangles = Stream::new("triangles", StreamKind::Unknown, mesh.triangles.len());
    for (place, name) in CORNERS.iter().enumerate() {
        triangles = triangles.with(*name, corner(place));
    }
    let vertices = Stream::new("vertices", StreamKind::Unknown, mesh.positions.len());
    let vertices = vertices.with("position", mesh.positions).with("normal", mesh.normals);
    Frame { index, time: 0.0, streams: vec![vertices, triangles] }
}

/// The mesh in a frame.
fn as_mesh(frame: &Frame) -> Option<Mesh> {
    let (vertices, triangles) = (frame.stream("vertices")?, frame.stream("triangles")?);
    let [a, b, c] = CORNERS.map(|corner| triangles.u32(corner));
    let corners = a?.iter().zip(b?).zip(c?);
    Some(Mesh {
        origin: nalgebra::Vector3::zeros(),
        positions: vertices.vec3("position")?.to_vec(),
        normals: vertices.vec3("normal")?.to_vec(),
        triangles: corners.map(|((a, b), c)| [*a, *b, *c]).collect(),
        attributes: Vec::new(),
    })
}

/// Error of a signed distance against the exact distance to its own zero, over the nodes within the band [voxels].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct FieldError {
    /// Mean of its absolute value.
    mean: f64,
    /// The largest.
    largest: f64,
}

/// Nodes at which the error of a distance is sampled: its mean is then known to 1 %.
const SAMPLED_NODES: usize = 1 << 16;

/// The error of a signed distance; `None` if it has no zero.
fn field_error(distance: &SignedDistance) -> Option<FieldError> {
    let cut = marching_cubes(&distance.grid).0;
    let target = Target::new(&cut)?;
    let grid = &distance.grid;
    // An odd stride samples every place of a brick equally often.
    let stride = (grid.values.len() / SAMPLED_NODES).max(1) | 1;
    let seen = par::map_chunks(grid.values.len().div_ceil(stride), par::CHUNK, |range| {
        let (mut sum, mut guess) = ((0.0, 0.0_f64, 0_usize), 0);
        for slot in range.map(|i| i * stride) {
            let found = grid.values[slot].abs();
            if found < distance.band {
                let (triangle, exact) = target.nearest(grid.position_of(slot), guess);
                guess = triangle;
                let error = f64::from((found - exact).abs() / grid.voxel);
                sum = (sum.0 + error, sum.1.max(error), sum.2 + 1);
            }
        }
        sum
    });
    let add = |a: (f64, f64, usize), b: (f64, f64, usize)| (a.0 + b.0, a.1.max(b.1), a.2 + b.2);
    let (sum, largest, count) = seen.into_iter().fold((0.0, 0.0, 0), add);
    (count > 0).then(|| FieldError { mean: sum / count as f64, largest })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        grid::SparseGrid,
        math::Vec3,
        sdf::{Order, SdfParams, from_density},
    };

    #[test]
    fn a_higher_order_shows_in_the_error_of_the_distance() {
        let reach = Vec3::repeat(20.0);
        let field = SparseGrid::sample(1.0, -reach, reach, |x| (1.0 - (x.norm() - 11.3) / 20.0).max(0.0));
        let error = |order, band| {
            field_error(&from_density(&field, 1.0, &SdfParams { order, band, ..SdfParams::default() }))
                .unwrap()
        };
        let (first, second) = (error(Order::First, 8.0), error(Order::Second, 8.0));
        println!("{first:?} {second:?}");
        assert!(first.mean > 0.05 && second.mean < 0.5 * first.mean, "{first:?} {second:?}");
        assert!(error(Order::First, 2.0).mean < 0.5 * first.mean && first.largest >= first.mean);
        let empty = SparseGrid::sample(1.0, -reach, reach, |_| 0.0);
        assert!(field_error(&from_density(&empty, 1.0, &SdfParams::default())).is_none());
    }
}
