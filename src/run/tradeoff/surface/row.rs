//! One setting on one frame: what its surface cost and how it came out, kept on disk so that it is never made twice.

use super::source::Sample;
use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream, StreamKind},
    mesh::{
        self, Mesh, SURFACE_VERSION, Surface, SurfaceParams, marching_cubes,
        surface_distance::{Distance, Target, distance},
    },
    par,
    run::{
        Control, RunError, ShotFolder,
        usage::{Meter, Peak},
    },
    sdf::SignedDistance,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// What a surface cost and how it came out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// Vertices and triangles.
    pub size: [usize; 2],
    /// Pieces that share no vertex.
    pub pieces: usize,
    /// Enclosed volume [m³].
    pub volume: f64,
    /// Area [m²].
    pub area: f64,
    /// Whether the mesh is closed, manifold and oriented, without degenerate triangles.
    pub is_sound: bool,
    /// Wall-clock time of every pass [s], once a repeat.
    pub passes: Vec<Vec<(String, f64)>>,
    /// Processor time of all threads [s], once a repeat, where the system tells.
    pub cpu_seconds: Vec<f64>,
    /// The most memory that the process held [bytes], least of the repeats, where the system tells.
    pub memory: Option<u64>,
    /// How exact the signed distance is.
    pub field: Option<FieldError>,
    /// A hash of the mesh: a repeat must give the same.
    pub mesh: u64,
    /// How far it is from other surfaces of the frame and they from it, by the names of their rows. `None`: one of the two
    /// is empty.
    pub apart: BTreeMap<String, Option<[Distance; 2]>>,
}

/// How far the signed distance is from the exact distance to its own zero, over the nodes within the band [voxels].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldError {
    /// The mean of its size.
    pub mean: f64,
    /// The largest seen.
    pub largest: f64,
}

impl Row {
    /// Seconds of each repeat: of one pass, or of all.
    pub(super) fn seconds(&self, pass: Option<&str>) -> Vec<f64> {
        let counts = |name: &str| pass.is_none_or(|pass| pass == name);
        let of =
            |passes: &Vec<(String, f64)>| passes.iter().filter(|(name, _)| counts(name)).map(|p| p.1).sum();
        self.passes.iter().map(of).collect()
    }
}

/// Where a row is kept, and of what it is.
#[derive(Clone, Debug)]
pub(super) struct Place<'a> {
    pub(super) params: &'a SurfaceParams,
    pub(super) sample: &'a Sample,
    /// Its row's name: a hash of all that decides the surface and its time.
    pub(super) name: String,
    folder: PathBuf,
}

/// Raised when rows hold something else, so that older ones are made again.
const VERSION: u32 = 1;

/// What is kept of a mesh until it has been compared, as a frame of this number.
const KEPT: FrameIndex = FrameIndex(0);

impl<'a> Place<'a> {
    /// The place of a row below `root`.
    pub(super) fn new(root: &Path, params: &'a SurfaceParams, sample: &'a Sample) -> Self {
        let settings = serde_json::to_string(params).expect("settings are plain data");
        // Two frames of the same particles are two rows all the same: each has its mesh to compare.
        let Sample { frame, state, spacing, .. } = sample;
        let (tool, threads) = (env!("CARGO_PKG_VERSION"), par::threads());
        let text =
            format!("{VERSION} {tool} {SURFACE_VERSION} {frame} {state:016x} {spacing} {threads} {settings}");
        let name = format!("{:016x}", xxh3_64(text.as_bytes()));
        Self { params, sample, folder: root.join("rows").join(&name), name }
    }

    /// The row that an earlier run left here.
    pub(super) fn load(&self) -> Option<Row> {
        serde_json::from_str(&std::fs::read_to_string(self.folder.join("row.json")).ok()?).ok()
    }

    /// Makes the surface until it has been timed `repeats` times, and once more if its mesh is wanted and not there.
    /// Says whether anything had to be made.
    ///
    /// # Errors
    /// Whatever stops the surfacing.
    pub(super) fn complete(
        &self,
        repeats: usize,
        with_mesh: bool,
        control: Control,
    ) -> Result<(Row, bool), RunError> {
        let mut kept = self.load();
        let mut wants_mesh = with_mesh && self.mesh().is_none();
        let mut is_new = false;
        loop {
            if let Some(row) = kept.take_if(|row| row.passes.len() >= repeats && !wants_mesh) {
                return Ok((row, is_new));
            }
            let (surface, cost) = self.make(control)?;
            let row = self.join(kept.take(), &surface, cost)?;
            ShotFolder::create(&self.folder)?;
            if wants_mesh {
                cache::write_frame(&self.folder, &as_frame(surface.mesh), 0)?;
                wants_mesh = false;
            }
            self.keep(&row)?;
            kept = Some(row);
            is_new = true;
        }
    }

    /// Makes the surface as `mesh` does, and measures that.
    fn make(&self, control: Control) -> Result<(Surface, Cost), RunError> {
        let peak = Peak::since_now();
        let particles = self.sample.read()?;
        let keep_going = || !(control.interrupted)();
        let meter = Meter::new();
        let surface = mesh::reconstruct(&particles, self.sample.spacing, self.params, &keep_going)?;
        Ok((surface, Cost { cpu: meter.cpu(), memory: peak.bytes() }))
    }

    /// Adds a further run to what is known.
    fn join(&self, known: Option<Row>, surface: &Surface, cost: Cost) -> Result<Row, RunError> {
        let Surface { mesh, distance, check, stats, .. } = surface;
        let found = hash(mesh);
        let mut row = known.unwrap_or_else(|| Row {
            size: [mesh.positions.len(), mesh.triangles.len()],
            pieces: check.components,
            volume: check.volume,
            area: check.area,
            is_sound: check.is_sound(),
            passes: Vec::new(),
            cpu_seconds: Vec::new(),
            memory: None,
            field: distance.as_ref().and_then(field_error),
            mesh: found,
            apart: BTreeMap::new(),
        });
        if row.mesh != found {
            return Err(RunError::Request(format!(
                "{}: a second run gave another mesh than the first; expected the same: please report this with the \
                 particles, and check the machine's memory",
                self.folder.display()
            )));
        }
        row.passes.push(stats.seconds.iter().map(|(name, seconds)| ((*name).into(), *seconds)).collect());
        row.cpu_seconds.extend(cost.cpu);
        row.memory = [row.memory, cost.memory].into_iter().flatten().min();
        Ok(row)
    }

    /// Measures how far the kept mesh is from that of `reference`, which is at `target` (`None`: it is empty).
    ///
    /// # Errors
    /// If the row cannot be written.
    ///
    /// # Panics
    /// If [`Place::complete`] kept no mesh.
    pub(super) fn compare(
        &self,
        row: &mut Row,
        reference: &Place<'_>,
        target: Option<&(&Mesh, Target<'_>)>,
    ) -> Result<(), RunError> {
        let own = self.mesh().expect("the mesh is kept until it is compared");
        let step = |place: &Place<'_>| STEP * place.params.voxel * place.sample.spacing;
        let both = match (Target::new(&own), target) {
            (Some(own_target), Some((mesh, target))) => {
                Some([distance(&own, target, step(self)), distance(mesh, &own_target, step(reference))])
            }
            (None, None) => Some([Distance::default(); 2]),
            _ => None,
        };
        row.apart.insert(reference.name.clone(), both);
        self.keep(row)?;
        self.give_up_mesh();
        Ok(())
    }

    /// The mesh that is kept.
    pub(super) fn mesh(&self) -> Option<Mesh> {
        let (frame, _) = cache::read_frame(&cache::frame_path(&self.folder, KEPT)).ok()?;
        let (vertices, triangles) = (frame.stream("vertices")?, frame.stream("triangles")?);
        let [a, b, c] = CORNERS.map(|corner| triangles.u32(corner));
        let corners = a?.iter().zip(b?).zip(c?);
        Some(Mesh {
            positions: vertices.vec3("position")?.to_vec(),
            normals: vertices.vec3("normal")?.to_vec(),
            triangles: corners.map(|((a, b), c)| [*a, *b, *c]).collect(),
            attributes: Vec::new(),
        })
    }

    /// Gives up what is no longer needed; what cannot be removed only takes room.
    pub(super) fn give_up_mesh(&self) {
        let _ = std::fs::remove_file(cache::frame_path(&self.folder, KEPT));
    }

    fn keep(&self, row: &Row) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(row).expect("a row is plain data") + "\n";
        ShotFolder::write(self.folder.join("row.json"), &text)
    }
}

/// What a run took, beside the time of its passes.
struct Cost {
    cpu: Option<f64>,
    memory: Option<u64>,
}

/// The parts that triangles are looked at in, in voxels of their surface: those that marching cubes makes are smaller.
const STEP: f32 = 2.0;

/// Channels of a kept mesh's triangles.
const CORNERS: [&str; 3] = ["a", "b", "c"];

/// A mesh in the container of the cache, which is checked when it is read.
fn as_frame(mesh: Mesh) -> Frame {
    let corner = |place: usize| mesh.triangles.iter().map(|t| t[place]).collect::<Vec<u32>>();
    let mut triangles = Stream::new("triangles", StreamKind::Unknown, mesh.triangles.len());
    for (place, name) in CORNERS.iter().enumerate() {
        triangles = triangles.with(*name, corner(place));
    }
    let vertices = Stream::new("vertices", StreamKind::Unknown, mesh.positions.len());
    let vertices = vertices.with("position", mesh.positions).with("normal", mesh.normals);
    Frame { index: KEPT, time: 0.0, streams: vec![vertices, triangles] }
}

fn hash(mesh: &Mesh) -> u64 {
    let mut hash = Xxh3::new();
    let numbers = mesh.positions.iter().chain(&mesh.normals).flat_map(|x| x.iter());
    numbers.for_each(|v| hash.update(&v.to_le_bytes()));
    mesh.triangles.iter().flatten().for_each(|v| hash.update(&v.to_le_bytes()));
    hash.digest()
}

/// Nodes that the error of a distance is seen at: the mean is then known to 1 %.
const NODES: usize = 1 << 16;

/// The error of a signed distance; `None` if it has no zero.
fn field_error(distance: &SignedDistance) -> Option<FieldError> {
    let cut = marching_cubes(&distance.grid).0;
    let target = Target::new(&cut)?;
    let grid = &distance.grid;
    // An odd stride is at every place of a brick equally often.
    let stride = (grid.values.len() / NODES).max(1) | 1;
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
