//! What is measured of a run of sheets.

use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream, StreamKind},
    job::log,
    math::Vec3,
    run::{
        Control, RunError, ShotFolder,
        tradeoff::runs::{self, Measure, Place},
    },
    scene::Scene,
    sim::{
        FrameRecord,
        sheet::{SheetRecord, SheetShape, stream},
    },
};
use serde::{Deserialize, Serialize};
use std::fmt;
use xxhash_rust::xxh3::xxh3_64;

/// What came out of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Figures {
    /// Points of all sheets.
    pub points: u64,
    /// Mean distance between them [m].
    pub spacing: f64,
    /// What was seen in every frame.
    pub frames: Vec<Seen>,
}

/// A run of sheets: what it cost and what came out.
pub(super) type Row = runs::Row<Figures>;

/// What was seen in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Its number.
    pub frame: u32,
    /// A hash of where all points are.
    pub places: u64,
    /// What the simulation's log says; the first frame has none.
    pub logged: Option<SheetRecord>,
}

/// Whether all frames of both have the same points at the same places.
pub(super) fn show_the_same(a: &Row, b: &Row) -> bool {
    let shown = |row: &Row| row.found.frames.iter().map(|seen| (seen.frame, seen.places)).collect::<Vec<_>>();
    shown(a) == shown(b)
}

/// Cells of the lattice on which a grid is compared, along each direction at most: enough to see what 129² points do.
const MOST_CELLS: u32 = 128;

/// Points of a mesh that are compared, about.
const MOST_POINTS: usize = 16_384;

/// Where the sheets of a shot are compared.
#[derive(Clone, Debug)]
pub(super) struct Woven {
    sheets: Vec<(String, Lattice)>,
}

/// Where one sheet is compared.
#[derive(Clone, Copy, Debug)]
enum Lattice {
    /// At the corners of so many cells.
    Grid([u32; 2]),
    /// At its points.
    Mesh,
}

impl Woven {
    /// The sheets of a scene as written, whose points they are compared at.
    pub(super) fn new(scene: &Scene) -> Self {
        let lattice = |shape: &SheetShape| match shape {
            SheetShape::Grid { cells, .. } => Lattice::Grid(cells.map(|n| n.min(MOST_CELLS))),
            SheetShape::Mesh(_) => Lattice::Mesh,
        };
        Self { sheets: scene.sheet.iter().map(|sheet| (sheet.name.clone(), lattice(&sheet.shape))).collect() }
    }

    /// The places at which the sheets of a frame are compared, a stream a sheet.
    fn sample(&self, scene: &Scene, frame: &Frame) -> Frame {
        let mut streams = Vec::new();
        for (name, lattice) in &self.sheets {
            let points = frame.stream(&stream(name)).and_then(|stream| stream.vec3("position"));
            let sheet = scene.sheet.iter().find(|sheet| sheet.name == *name);
            let (Some(points), Some(sheet)) = (points, sheet) else { continue };
            let places: Vec<Vec3> = match (lattice, &sheet.shape) {
                (Lattice::Grid(at), SheetShape::Grid { cells, .. }) => between(points, *cells, *at),
                _ => points.iter().step_by(points.len().div_ceil(MOST_POINTS).max(1)).copied().collect(),
            };
            streams.push(
                Stream::new(stream(name), StreamKind::MeshPoints, places.len()).with("position", places),
            );
        }
        Frame { streams, ..*frame }
    }
}

impl fmt::Display for Woven {
    /// All that decides what is kept of a frame.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.sheets)
    }
}

/// The corners of `at` cells over a grid of points that has `cells`, between its points by bilinear interpolation.
pub(super) fn between(points: &[Vec3], cells: [u32; 2], at: [u32; 2]) -> Vec<Vec3> {
    // The point before a corner, and how far beyond it: exact where a corner is a point.
    let place = |k: usize, corner: u32| {
        let (all, parts) = (u64::from(corner) * u64::from(cells[k]), u64::from(at[k].max(1)));
        ((all / parts) as usize, (all % parts) as f32 / parts as f32)
    };
    let point = |i: usize, j: usize| {
        let [i, j] = [i.min(cells[0] as usize), j.min(cells[1] as usize)];
        points[i + (cells[0] as usize + 1) * j]
    };
    let mix = |a: Vec3, b: Vec3, part: f32| a + (b - a) * part;
    let mut out = Vec::new();
    for (j, v) in (0..=at[1]).map(|corner| place(1, corner)) {
        for (i, u) in (0..=at[0]).map(|corner| place(0, corner)) {
            let [near, far] = [j, j + 1].map(|j| mix(point(i, j), point(i + 1, j), u));
            out.push(mix(near, far, v));
        }
    }
    out
}

impl Measure for Woven {
    type Found = Figures;

    const VERSION: &str = "sheets 1";

    fn measure(&self, place: &Place<'_>, shot: &ShotFolder, _: Control) -> Result<Figures, RunError> {
        let samples = place.folder.join("sample");
        ShotFolder::create(&samples)?;
        let mut log = log::read::<FrameRecord>(shot)?;
        let mut found = Figures { points: 0, spacing: 0.0, frames: Vec::new() };
        for (index, path) in cache::list(&shot.cache())? {
            let (frame, _) = cache::read_frame(&path)?;
            let sheets = || frame.streams.iter().filter(|stream| stream.kind == StreamKind::MeshPoints);
            let area =
                |stream: &Stream| stream.len() as f64 * stream.scalar("spacing").unwrap_or(0.0).powi(2);
            let count: usize = sheets().map(Stream::len).sum();
            found.points = count as u64;
            found.spacing = (sheets().map(area).sum::<f64>() / count.max(1) as f64).sqrt();
            let places = sheets().filter_map(|stream| stream.vec3("position"));
            let hashes: Vec<u64> = places.map(|places| xxh3_64(bytemuck::cast_slice(places))).collect();
            let logged = log.remove(&index).and_then(|line| line.record.sheets);
            let places = xxh3_64(bytemuck::cast_slice(&hashes));
            found.frames.push(Seen { frame: index.0, places, logged });
            cache::write_frame(&samples, &self.sample(place.scene, &frame), 0)?;
        }
        Ok(found)
    }
}

/// The places that were kept of a frame, a list a sheet.
///
/// # Errors
/// If they cannot be read; without the frame, `None`.
pub(super) fn sampled(place: &Place<'_>, frame: u32) -> Result<Option<Frame>, RunError> {
    let path = cache::frame_path(&place.folder.join("sample"), FrameIndex(frame));
    if !path.exists() {
        return Ok(None);
    }
    Ok(Some(cache::read_frame(&path)?.0))
}
