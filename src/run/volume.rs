//! The job that turns particles into volume files.

use super::{
    Control, Failure, OutputFiles, RunError, ShotFolder, Source,
    job::{self, Job, Make, Part, Target},
    ledger::{Done, Made, Piece, Work},
    plan::Product,
    remarks, simulate,
    smoke_grids::{NoGrids, SmokeGrids},
    solids,
    volume_grids::VolumeGrids,
};
use crate::{
    export::{
        ExportError,
        vdb::{self, VolumeGrid, VolumeParams},
    },
    field::Anisotropy,
    frame::{Frame, FrameIndex, Stream},
    mesh::{self, DistanceParams, SurfaceError, SurfaceParams},
    scene::Scene,
    sim::{
        SetupError, World, sheet,
        smoke::{self, FrameAir, ShotAir, Smoke, TRACERS},
    },
};
use serde::Serialize;
use std::{path::Path, time::Instant};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a volume holds gives the same particles and settings another file. Changes of the
/// surface raise [`mesh::SURFACE_VERSION`].
const VOLUME_VERSION: u32 = 2;

/// The same for smoke.
const SMOKE_VERSION: u32 = 3;

/// What is made of every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeSettings {
    /// How particles become a density.
    pub surface: SurfaceParams,
    /// How grids are stored.
    pub volume: VolumeParams,
    /// Which grids a file has; at least one.
    pub grids: Vec<VolumeGrid>,
    /// What moves the smoke of the shot, if it has any: without it, smoke has no velocities.
    pub smoke: Option<Surroundings>,
}

/// What moves smoke beside its vortons.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// What the preset says of it.
    pub smoke: Smoke,
    /// What is around it.
    pub world: World,
}

impl Surroundings {
    /// What moves the air beside vortons, for all frames.
    pub(super) fn air(&self) -> ShotAir {
        ShotAir::new(&self.smoke, &self.world)
    }
}

impl VolumeSettings {
    /// What moves the air beside vortons, for all frames: walls, if there are solids. `None` if no velocity is asked for, which nothing
    /// else needs.
    fn air(&self) -> Option<ShotAir> {
        let around = self.smoke.as_ref().filter(|_| self.grids.contains(&VolumeGrid::Velocity));
        around.map(Surroundings::air)
    }
}

/// What moves the smoke of a shot; `None` if it has none. Samples of meshes are looked for in `folder`, and left there.
///
/// # Errors
/// If a mesh cannot be sampled.
pub fn surroundings(
    scene: &Scene,
    folder: &ShotFolder,
    control: Control,
) -> Result<Option<Surroundings>, RunError> {
    if scene.smoke.is_none() {
        return Ok(None);
    }
    let scene = solids::fill(scene, Some(folder), control.reporter)?;
    let world = simulate::world(&scene);
    Ok(scene.systems().smoke.map(|smoke| Surroundings { smoke, world }))
}

/// Makes volumes of the frames of `source` in `out`, several at once where memory allows.
///
/// Frames are numbered, kept, left out and told as by [`surface`](super::surface::surface); one without particles gives
/// a file with empty grids.
///
/// # Errors
/// As [`surface`](super::surface::surface).
pub fn volume(
    source: Source,
    out: &ShotFolder,
    settings: &VolumeSettings,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let wanted = |there: &[VolumeGrid]| -> Vec<VolumeGrid> {
        settings.grids.iter().copied().filter(|grid| there.contains(grid)).collect()
    };
    let (liquid, smoke) = (wanted(&VolumeGrid::LIQUID), wanted(&VolumeGrid::SMOKE));
    if liquid.is_empty() && (smoke.is_empty() || settings.smoke.is_none()) {
        let known: Vec<&str> = VolumeGrid::LIQUID.into_iter().map(VolumeGrid::name).collect();
        return Err(RunError::Request(format!(
            "no grid that particles have is asked for; expected {}, or a shot of smoke",
            known.join(", ")
        )));
    }
    let text = decisive(settings, &liquid);
    let air = settings.air();
    job::run(source, out, &Volumes { out, settings, liquid, smoke, text, air }, job, control)
}

/// All that decides what the volumes of a state hold, as text: not how a mesh of it is cleaned up.
fn decisive(settings: &VolumeSettings, grids: &[VolumeGrid]) -> String {
    #[derive(Serialize)]
    struct Decisive<'a> {
        voxel: f32,
        kernel_radius: f32,
        anisotropy: &'a Option<Anisotropy>,
        distance: Option<DistanceParams>,
        volume: &'a VolumeParams,
        grids: &'a [VolumeGrid],
    }
    let VolumeSettings { surface, volume, .. } = settings;
    let SurfaceParams { voxel, kernel_radius, anisotropy, distance, .. } = surface;
    let (voxel, kernel_radius, distance) = (*voxel, *kernel_radius, *distance);
    serde_json::to_string(&Decisive { voxel, kernel_radius, anisotropy, distance, volume, grids })
        .expect("settings are plain data")
}

/// Makes volumes.
struct Volumes<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    /// The grids of liquids, and of smoke.
    liquid: Vec<VolumeGrid>,
    smoke: Vec<VolumeGrid>,
    /// What decides the content of those of liquids, as text.
    text: String,
    /// What moves the smoke, if that is to be told.
    air: Option<ShotAir>,
}

impl Make for Volumes<'_> {
    const PRODUCT: Product = Product::Volumes;

    fn params(&self) -> &SurfaceParams {
        &self.settings.surface
    }

    fn takes(&self, stream: &str) -> bool {
        match stream {
            smoke::NAME => false,
            TRACERS => !self.smoke.is_empty(),
            sheet if sheet::is_sheet_stream(sheet) => false,
            _ => !self.liquid.is_empty(),
        }
    }

    fn nothing(&self) -> String {
        let names =
            |grids: &[VolumeGrid]| grids.iter().map(|grid| grid.name()).collect::<Vec<_>>().join(", ");
        format!(
            "nothing in this cache has a grid that is asked for ({}); expected {} of smoke, or {} of a liquid",
            names(&self.settings.grids),
            names(&VolumeGrid::SMOKE),
            names(&VolumeGrid::LIQUID)
        )
    }

    fn key(&self, stream: &str, state: u64, spacing: f32) -> u64 {
        if stream == TRACERS {
            return smoke_key(self.settings, &self.smoke, state);
        }
        let versions = [VOLUME_VERSION, mesh::SURFACE_VERSION];
        xxh3_64(format!("{versions:?} {state:016x} {spacing} {}", self.text).as_bytes())
    }

    fn kept(&self, target: &Target) -> Option<Piece> {
        kept(self.out, target)
    }

    fn make(
        &self,
        part: Part<'_>,
        spacing: f32,
        target: &Target,
        made: &mut Made,
        control: Control,
    ) -> Result<(), RunError> {
        if part.stream.name == TRACERS {
            let settings = self.settings;
            let air = self.air.as_ref().map(|air| air.frame(part.streams, part.time)).transpose();
            let air = match air {
                Ok(air) => air,
                Err(why) => {
                    made.fail(no_air(&why), Failure::Other);
                    return Ok(());
                }
            };
            let (tracers, air, wanted) = (part.stream, air.as_ref(), &self.smoke[..]);
            let smoke = SmokeFrame { tracers, air, spacing, wanted, slower: 1.0 };
            return write_smoke(self.out, settings, smoke, target, made, control);
        }
        let stream = part.stream;
        let start = Instant::now();
        let keep_going = || !(control.interrupted)();
        let VolumeSettings { surface, volume, .. } = self.settings;
        let wanted = &self.liquid;
        let grids = match VolumeGrids::new(stream, spacing, surface, wanted, &keep_going) {
            Ok(found) if found.names().is_empty() => {
                let why = "the particles have no velocities, and no other grid is asked for";
                made.fail(why.into(), Failure::Other);
                return Ok(());
            }
            Ok(found) => found,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                made.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let mut output = output(target);
        let bytes = match grids.write(&output.file(self.out, target.index.0), volume, target.key) {
            Ok(bytes) => bytes,
            Err(why @ ExportError::Volume { .. }) => {
                made.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
            Err(why) => return Err(why.into()),
        };
        output.grids = grids.names().into_iter().map(|grid| grid.name().into()).collect();
        let lacking = wanted.len() > output.grids.len();
        let figures = figures(target.index, &grids, lacking, bytes, start.elapsed().as_secs_f64());
        let work = Some(Work { bytes, triangles: 0, figures, record: None });
        made.pieces.push(Piece { outputs: vec![output], work, stale: Vec::new() });
        Ok(())
    }
}

/// The file of a target, if it is there and has its key.
pub(super) fn kept(out: &ShotFolder, target: &Target) -> Option<Piece> {
    let mut output = output(target);
    let (key, grids) = vdb::made_from(&output.file(out, target.index.0))?;
    if key != target.key {
        return None;
    }
    // Which grids were made depends on the frame's particles, too.
    output.grids = grids;
    Some(Piece { outputs: vec![output], work: None, stale: Vec::new() })
}

/// The smoke of a frame.
pub(super) struct SmokeFrame<'a> {
    pub(super) tracers: &'a Stream,
    pub(super) air: Option<&'a FrameAir>,
    /// Distance at which the tracers were seeded [m].
    pub(super) spacing: f32,
    pub(super) wanted: &'a [VolumeGrid],
    /// How many times slower than it was simulated it is shown.
    pub(super) slower: f64,
}

/// Identifies the volume of smoke that is made of `state`.
pub(super) fn smoke_key(settings: &VolumeSettings, grids: &[VolumeGrid], state: u64) -> u64 {
    let VolumeSettings { surface: SurfaceParams { voxel, kernel_radius, .. }, volume, .. } = settings;
    let air = settings.smoke.is_some();
    xxh3_64(
        format!("smoke {SMOKE_VERSION} {state:016x} {voxel} {kernel_radius} {volume:?} {grids:?} {air}")
            .as_bytes(),
    )
}

/// Makes and writes the volume of the smoke of a frame. What cannot be made is remembered in `made`.
///
/// # Errors
/// What a folder or disk refuses; [`RunError::Interrupted`].
pub(super) fn write_smoke(
    out: &ShotFolder,
    settings: &VolumeSettings,
    smoke: SmokeFrame<'_>,
    target: &Target,
    made: &mut Made,
    control: Control,
) -> Result<(), RunError> {
    let start = Instant::now();
    let keep_going = || !(control.interrupted)();
    let shutter = settings.smoke.as_ref().map_or(0.0, |around| 1.0 / around.smoke.fps) as f32;
    let shutter = shutter / smoke.slower as f32;
    let grids = SmokeGrids::new(&smoke, shutter, &settings.surface, &keep_going);
    let grids = match grids {
        Ok(grids) => grids,
        Err(NoGrids::Interrupted) => return Err(RunError::Interrupted),
        Err(NoGrids::Missing(what)) => {
            made.fail(format!("the tracers have no {what}; simulate the shot again"), Failure::Other);
            return Ok(());
        }
        Err(NoGrids::OutOfRange(error)) => {
            made.fail(no_air(&SetupError::from(error)), Failure::Other);
            return Ok(());
        }
    };
    let mut output = output(target);
    let bytes = match grids.write(&output.file(out, target.index.0), &settings.volume, target.key) {
        Ok(bytes) => bytes,
        Err(why @ ExportError::Volume { .. }) => {
            made.fail(why.to_string(), Failure::Other);
            return Ok(());
        }
        Err(why) => return Err(why.into()),
    };
    output.grids = grids.names().iter().map(|grid| grid.name().into()).collect();
    let names = output.grids.join(", ");
    let (bricks, mib) = (grids.stats.bricks, bytes as f64 / f64::from(1 << 20));
    let mut figures = format!(
        "frame {}  {names}  {bricks} bricks  {mib:.2} MiB  {:.2} s",
        target.index,
        start.elapsed().as_secs_f64()
    );
    for remark in remarks::of_smoke_volume(&grids.stats) {
        figures += &format!("  {remark}");
    }
    let work = Some(Work { bytes, triangles: 0, figures, record: None });
    made.pieces.push(Piece { outputs: vec![output], work, stale: Vec::new() });
    Ok(())
}

/// Why a cached frame has no velocities of the air.
pub(super) fn no_air(why: &(dyn std::error::Error + 'static)) -> String {
    match why.downcast_ref() {
        Some(SetupError::OutOfRange(error)) => {
            format!("the air's velocity cannot be computed: {error}; simulate the shot again")
        }
        _ => why.to_string(),
    }
}

/// What the volume of a frame took.
pub(super) struct Tried {
    /// The file [bytes].
    pub(super) bytes: u64,
    /// Wall-clock time [s].
    pub(super) seconds: f64,
}

/// Makes the volume of the smoke of a frame below `folder`, only to see what that takes. `None` if there is none to make.
///
/// # Errors
/// As [`write_smoke`].
pub(super) fn try_smoke(
    frame: &Frame,
    settings: &VolumeSettings,
    folder: &Path,
    control: Control,
) -> Result<Option<Tried>, RunError> {
    let wanted: Vec<_> =
        settings.grids.iter().copied().filter(|grid| VolumeGrid::SMOKE.contains(grid)).collect();
    let (Some(Surroundings { smoke: around, .. }), Some(tracers), false) =
        (&settings.smoke, frame.stream(TRACERS), wanted.is_empty())
    else {
        return Ok(None);
    };
    let start = Instant::now();
    let air = settings.air().map(|air| air.frame(&frame.streams, frame.time)).transpose()?;
    let spacing = around.params.tracer_spacing();
    let shown = SmokeFrame { tracers, air: air.as_ref(), spacing, wanted: &wanted, slower: 1.0 };
    let out = ShotFolder::new(folder);
    ShotFolder::create(&out.volumes())?;
    let target = Target { index: frame.index, name: smoke::NAME.into(), key: 0 };
    let mut made = Made::new(frame.index);
    write_smoke(&out, settings, shown, &target, &mut made, control)?;
    let bytes = made.pieces.iter().filter_map(|piece| piece.work.as_ref()).map(|work| work.bytes).sum();
    Ok(Some(Tried { bytes, seconds: start.elapsed().as_secs_f64() }))
}

/// The output that the volume of a target belongs to, with its frame alone.
fn output(target: &Target) -> OutputFiles {
    OutputFiles::of("volume", "volume", &target.name, "vdb", target.index)
}

/// One line about a frame; `lacking` velocities that were asked for.
fn figures(index: FrameIndex, grids: &VolumeGrids, lacking: bool, bytes: u64, seconds: f64) -> String {
    let names: Vec<&str> = grids.names().into_iter().map(VolumeGrid::name).collect();
    let mib = bytes as f64 / f64::from(1 << 20);
    let bricks = grids.stats.bricks;
    let mut line =
        format!("frame {index}  {}  {bricks} bricks  {mib:.2} MiB  {seconds:.2} s", names.join(", "));
    if lacking {
        line += "  the particles have no velocities";
    }
    for remark in remarks::of_volume(&grids.stats) {
        line += &format!("  {remark}");
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn walls_and_air_are_made_for_velocities_alone() {
        let params = toml::from_str("spacing = 0.1").unwrap();
        let smoke = Smoke { params, fps: 24.0, first: 1 };
        let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
        let settings = |grids: &[VolumeGrid]| VolumeSettings {
            surface: SurfaceParams::default(),
            volume: VolumeParams::default(),
            grids: grids.to_vec(),
            smoke: Some(Surroundings { smoke: smoke.clone(), world: world.clone() }),
        };
        assert!(settings(&[VolumeGrid::Density, VolumeGrid::Temperature]).air().is_none());
        assert!(settings(&[VolumeGrid::Density, VolumeGrid::Velocity]).air().is_some());
    }
}
