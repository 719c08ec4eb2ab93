//! What is measured of a run of smoke.

use crate::{
    cache,
    field::{TracerFieldParams, TracerFields, tracer_fields},
    frame::{Frame, FrameIndex, Stream, StreamKind},
    grid::{BRICK_NODES, node_of},
    job::log,
    math::Vec3,
    par,
    run::{
        Control, RunError, ShotFolder,
        tradeoff::runs::{self, Measure, Place},
    },
    sim::{
        FrameRecord,
        smoke::{self, SmokeRecord},
    },
};
use serde::{Deserialize, Serialize};

/// What came out of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Figures {
    /// What was seen in every frame.
    pub frames: Vec<Seen>,
    /// The cached frames [bytes].
    pub cache: u64,
}

/// A run of smoke: what it cost and what came out.
pub(super) type Row = runs::Row<Figures>;

/// What was seen in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Its number.
    pub frame: u32,
    /// Vortons and tracers.
    pub counts: [usize; 2],
    /// Where the smoke is; `None`: there is none.
    pub body: Option<Body>,
    /// ½ Σ |x − c| |Γ| about the centre of |Γ| [m⁴/s]: what the impulse would be if all vortons pushed one way.
    pub push: f64,
    /// What the simulation's log says; the first frame has none.
    pub logged: Option<SmokeRecord>,
}

/// Where smoke is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Body {
    /// Its centre, by density [m].
    pub center: [f64; 3],
    /// Root of the mean square of the distance to that, by density [m].
    pub size: f64,
}

/// Measures runs of smoke, whose density is compared on a lattice of cells of this length [m].
pub(super) struct Smoky {
    pub(super) cell: f32,
}

/// Reach of the kernel by which tracers become a density to compare, in cells: smooth enough that it does not matter where between
/// nodes a tracer is.
const REACH: f32 = 2.0;

impl Measure for Smoky {
    type Found = Figures;

    const VERSION: &str = "smoke 1";

    fn measure(&self, place: &Place<'_>, shot: &ShotFolder, _: Control) -> Result<Figures, RunError> {
        let samples = place.folder.join("sample");
        ShotFolder::create(&samples)?;
        let mut log = log::read::<FrameRecord>(shot)?;
        let present = cache::list(&shot.cache())?;
        let mut found = Figures { frames: Vec::new(), cache: log.values().map(|line| line.bytes).sum() };
        for (number, (index, path)) in present.iter().enumerate() {
            let (frame, _) = cache::read_frame(path)?;
            let logged = log.remove(index).and_then(|line| line.record.smoke);
            found.frames.push(seen(&frame, logged));
            cache::write_frame(&samples, &self.lattice(&frame), 0)?;
            if number + 1 == present.len() {
                // Volumes of it may be asked for later.
                ShotFolder::create(&place.folder.join(LAST))?;
                cache::write_frame(&place.folder.join(LAST), &frame, 0)?;
            }
        }
        Ok(found)
    }
}

/// The folder of a run's last frame.
const LAST: &str = "last";

/// The last frame of a run; `None` if it gave none.
///
/// # Errors
/// If it cannot be read.
pub(super) fn last(place: &Place<'_>) -> Result<Option<Frame>, RunError> {
    let path = cache::frame_path(&place.folder.join(LAST), place.last);
    if !path.exists() {
        return Ok(None);
    }
    Ok(Some(cache::read_frame(&path)?.0))
}

/// A node of the lattice, and the density there.
pub(super) type Node = ([i32; 3], f32);

/// Nodes of the lattice that have smoke, and how much, in order of the nodes.
///
/// # Errors
/// If they cannot be read; without the frame, `None`.
pub(super) fn sampled(place: &Place<'_>, frame: u32) -> Result<Option<Vec<Node>>, RunError> {
    let path = cache::frame_path(&place.folder.join("sample"), FrameIndex(frame));
    if !path.exists() {
        return Ok(None);
    }
    let (frame, _) = cache::read_frame(&path)?;
    let columns =
        frame.streams.first().and_then(|stream| Some((stream.vec3("node")?, stream.f32("density")?)));
    let (nodes, density) = columns.unwrap_or_default();
    let node = |x: &Vec3| [0, 1, 2].map(|k| x[k] as i32);
    Ok(Some(nodes.iter().map(node).zip(density.iter().copied()).collect()))
}

impl Smoky {
    /// The density of a frame on the lattice, as a stream of nodes.
    fn lattice(&self, frame: &Frame) -> Frame {
        let mut nodes: Vec<Node> = Vec::new();
        if let Some((positions, density, spacing)) = tracers(frame) {
            let Self { cell } = *self;
            let params = TracerFieldParams { spacing, radius: REACH * cell, voxel: cell, padding: 0 };
            let TracerFields { bricks, values: [values], .. } = tracer_fields(positions, [density], &params);
            let node = |slot: usize| node_of(bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES);
            let filled = values.iter().enumerate().filter(|(_, value)| **value > 0.0);
            nodes.extend(filled.map(|(slot, &value)| (node(slot), value)));
            nodes.sort_unstable_by_key(|(node, _)| *node);
        }
        let places: Vec<Vec3> = nodes.iter().map(|(node, _)| Vec3::from(node.map(|k| k as f32))).collect();
        let density: Vec<f32> = nodes.iter().map(|(_, value)| *value).collect();
        let stream = Stream::new("lattice", StreamKind::Unknown, nodes.len())
            .with("node", places)
            .with("density", density);
        Frame { streams: vec![stream], ..*frame }
    }
}

/// Places and densities of a frame's tracers, and the distance at which they were seeded [m]; `None` without any.
pub(super) fn tracers(frame: &Frame) -> Option<(&[Vec3], &[f32], f32)> {
    let stream = frame.stream(smoke::TRACERS).filter(|stream| !stream.is_empty())?;
    let spacing = stream.scalar("spacing")? as f32;
    Some((stream.vec3("position")?, stream.f32("density")?, spacing))
}

fn seen(frame: &Frame, logged: Option<SmokeRecord>) -> Seen {
    let count = |name: &str| frame.stream(name).map_or(0, Stream::len);
    let body = tracers(frame).and_then(|(positions, density, _)| {
        let weight = |i: usize| f64::from(density[i]);
        let (center, size) = spread(positions, &weight)?;
        Some(Body { center, size })
    });
    let vortons = frame.stream(smoke::NAME).and_then(|s| Some((s.vec3("position")?, s.vec3("strength")?)));
    let push = vortons.and_then(|(positions, strength)| {
        let weight = |i: usize| f64::from(strength[i].norm());
        let (center, _) = spread(positions, &weight)?;
        Some(0.5 * par::sum(positions.len(), |i| weight(i) * distance(positions[i], center)))
    });
    Seen {
        frame: frame.index.0,
        counts: [count(smoke::NAME), count(smoke::TRACERS)],
        body,
        push: push.unwrap_or(0.0),
        logged,
    }
}

fn distance(x: Vec3, center: [f64; 3]) -> f64 {
    (0..3).map(|k| (f64::from(x[k]) - center[k]).powi(2)).sum::<f64>().sqrt()
}

/// The centre of points by `weight`, and the root of their mean square distance to it; `None` if nothing weighs anything.
fn spread(points: &[Vec3], weight: &(dyn Fn(usize) -> f64 + Sync)) -> Option<([f64; 3], f64)> {
    let whole = par::sum(points.len(), weight);
    if whole <= 0.0 {
        return None;
    }
    let center = [0, 1, 2].map(|k| par::sum(points.len(), |i| weight(i) * f64::from(points[i][k])) / whole);
    let square = par::sum(points.len(), |i| weight(i) * distance(points[i], center).powi(2));
    Some((center, (square / whole).sqrt()))
}
