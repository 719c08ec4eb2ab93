//! The frames of whitewater, each computed from the one before it and from two frames of the liquid.
//!
//! A frame's key identifies the simulation, the parameters and all frames of the cache up to it, so that frames that were computed from
//! others are recognised. Those that are there are read; the others follow from the last one before them.

use crate::{
    cache::{self, CacheError, FrameKeys},
    frame::{Frame, FrameIndex, Stream, StreamKind},
    job::{
        Control, RunError, ShotFolder,
        batch::{BatchRequest, state_key},
        memory::BASE_MEMORY,
    },
    math::Vec3,
    sim::{
        scene::Scene,
        whitewater::{
            LiquidFrame, LiquidInterval, Rates, STREAM, Walls, Whitewater, WhitewaterParams, advance,
            births_bound,
        },
    },
};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change gives the same liquid other whitewater.
const WHITEWATER_VERSION: u32 = 2;

/// Memory of a particle of whitewater while it moves, of one that may be born, and of one of the liquid in two frames and between them
/// [bytes].
pub(super) const PARTICLE_BYTES: f64 = 350.0;
const BIRTH_BYTES: f64 = 150.0;
pub(super) const LIQUID_BYTES: f64 = 320.0;

/// What whitewater is computed from.
pub(super) struct Chain<'a> {
    /// The cached frames of the liquid, up to the last that is needed.
    frames: Vec<(FrameIndex, PathBuf)>,
    /// The key of whitewater in each.
    keys: Vec<u64>,
    /// The folder of the frames of whitewater.
    folder: PathBuf,
    /// The keys that the cached frames have to have.
    cached: FrameKeys,
    params: &'a WhitewaterParams,
    walls: Walls,
    /// Lower and upper corner of the liquid's domain [m], outside of which particles are removed.
    domain: Option<[Vec3; 2]>,
    /// The first frame of the shot, and frames a second.
    first: f64,
    fps: f64,
    request: &'a BatchRequest,
    /// The whitewater in memory, the place of its frame, and the liquid's spacing [m].
    state: Option<(usize, Whitewater, f32)>,
    /// The liquid in memory, and the place of its frame.
    liquid: Option<(usize, LiquidFrame)>,
}

/// The whitewater of a frame.
pub(super) struct ChainFrame<'a> {
    pub(super) whitewater: &'a Whitewater,
    /// Distance between particles of the liquid at rest [m].
    pub(super) spacing: f32,
    /// Whether it was computed now.
    pub(super) is_new: bool,
}

impl<'a> Chain<'a> {
    /// The chain of the frames of `shot` up to `last`, stored in `out`.
    ///
    /// # Errors
    /// If the cache cannot be listed.
    pub(super) fn new(
        scene: &Scene,
        params: &'a WhitewaterParams,
        shot: &ShotFolder,
        folder: PathBuf,
        last: FrameIndex,
        request: &'a BatchRequest,
    ) -> Result<Self, RunError> {
        let mut frames = cache::list(&shot.cache())?;
        frames.retain(|(index, _)| *index <= last);
        let cached = scene.frame_keys();
        let settings = serde_json::to_string(&params.simulated()).expect("parameters are plain data");
        let walls = Walls::new(&scene.surroundings(), &scene.force, scene.timeline());
        // Their parameters are in the key of the liquid.
        let forces = if walls.has_forces() { " forces 1" } else { "" };
        let text = format!("whitewater {WHITEWATER_VERSION} {:016x} {settings}{forces}", cached.own());
        let mut key = xxh3_64(text.as_bytes());
        let mut keys = Vec::with_capacity(frames.len());
        for (index, _) in &frames {
            key = xxh3_64(format!("{key:016x} {index}").as_bytes());
            keys.push(key);
        }
        let domain = scene.domain_of_whitewater();
        let (first, fps) = (f64::from(scene.frames.first().0), f64::from(scene.fps));
        let (state, liquid) = (None, None);
        Ok(Self { frames, keys, folder, cached, params, walls, domain, first, fps, request, state, liquid })
    }

    /// The cached frames.
    pub(super) fn frames(&self) -> &[(FrameIndex, PathBuf)] {
        &self.frames
    }

    /// The key of the whitewater in the frame at `place`.
    pub(super) fn key(&self, place: usize) -> u64 {
        self.keys[place]
    }

    /// The state of the liquid in the frame at `place`; `None` if it has no liquid.
    ///
    /// # Errors
    /// If its header cannot be read.
    pub(super) fn state(&self, place: usize) -> Result<Option<u64>, CacheError> {
        let (index, path) = &self.frames[place];
        let info = cache::read_header(path)?;
        let liquid = info.streams.iter().find(|stream| stream.kind == StreamKind::Particles);
        Ok(liquid.map(|liquid| state_key(info.key, *index, &liquid.name)))
    }

    /// The file with the whitewater of the frame at `place`.
    fn path(&self, place: usize) -> PathBuf {
        cache::frame_path(&self.folder, self.frames[place].0)
    }

    /// Whether the whitewater of the frame at `place` is there already.
    pub(super) fn is_stored(&self, place: usize) -> bool {
        cache::read_header(&self.path(place)).is_ok_and(|info| info.key == self.keys[place])
    }

    /// The whitewater of the frame at `place`; computed, and stored, unless it is there. A stored frame that is damaged is computed
    /// again, from the last one before it that is not.
    ///
    /// # Errors
    /// If a frame of the liquid cannot be read, or one of whitewater cannot be written, or takes more memory than allowed.
    pub(super) fn frame(
        &mut self,
        place: usize,
        force: bool,
        control: Control,
    ) -> Result<ChainFrame<'_>, RunError> {
        let is_stored = !force && self.restore(place, control)?;
        if !is_stored {
            let mut first = place;
            while first > 0 && !self.restore(first - 1, control)? {
                first -= 1;
            }
            for place in first..=place {
                self.compute(place, control)?;
            }
        }
        let (_, whitewater, spacing) = self.state.as_ref().expect("it was read or computed");
        Ok(ChainFrame { whitewater, spacing: *spacing, is_new: !is_stored })
    }

    /// Whether the whitewater of the frame at `place` is in memory now; `false` if it must be computed.
    fn restore(&mut self, place: usize, control: Control) -> Result<bool, RunError> {
        if self.state.as_ref().is_some_and(|(known, ..)| *known == place) {
            return Ok(true);
        }
        if !self.is_stored(place) {
            return Ok(false);
        }
        match self.read(place) {
            Ok(()) => Ok(true),
            Err(RunError::Cache(why @ CacheError::Corrupt { .. })) => {
                control.reporter.note(&format!("frame {} is computed again: {why}", self.frames[place].0));
                Ok(false)
            }
            Err(why) => Err(why),
        }
    }

    /// Computes the whitewater of the frame at `place` from the one before it.
    fn compute(&mut self, place: usize, control: Control) -> Result<(), RunError> {
        if control.cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        let mut whitewater = Whitewater::default();
        if place > 0 {
            if self.liquid.as_ref().is_none_or(|(known, _)| known + 1 != place) {
                self.load(place - 1)?;
            }
            let (_, before) = self.liquid.take().expect("it was loaded");
            self.load(place)?;
            let (_, after) = self.liquid.as_ref().expect("it was loaded");
            let (_, known, _) = self.state.take().expect("it was restored or computed");
            whitewater = known;
            let liquid_bytes = before.len().max(after.len()) as f64 * LIQUID_BYTES;
            let liquid = LiquidInterval::new(&before, after);
            let births = births_bound(&liquid, self.params);
            let particles = (whitewater.len() as f64 + births).min(f64::from(self.params.max_particles));
            let needed = BASE_MEMORY + particles * PARTICLE_BYTES + births * BIRTH_BYTES + liquid_bytes;
            self.request.check_memory(None, |_| needed as u64)?;
            let (params, walls, cancel) = (self.params, &self.walls, control.cancel);
            if advance(&mut whitewater, &liquid, params, walls, self.domain, cancel).is_break() {
                return Err(RunError::Interrupted);
            }
        } else {
            self.load(0)?;
            whitewater.record.left_out = self.liquid.as_ref().map_or(0, |(_, liquid)| liquid.left_out);
        }
        let (_, liquid) = self.liquid.as_ref().expect("it was loaded");
        let frame = Frame {
            index: self.frames[place].0,
            time: liquid.time,
            streams: vec![whitewater.stream(liquid.spacing)],
        };
        cache::write_frame(&self.folder, &frame, self.keys[place])?;
        self.state = Some((place, whitewater, liquid.spacing));
        Ok(())
    }

    /// Reads the stored whitewater of the frame at `place`.
    fn read(&mut self, place: usize) -> Result<(), RunError> {
        let path = self.path(place);
        let (frame, info) = cache::read_frame_within(&path, self.request.max_memory)?;
        info.expect_key(&path, self.keys[place])?;
        let stream = frame.streams.iter().find(|stream| stream.name == STREAM);
        let known = stream.and_then(|stream| Some((Whitewater::restore(stream)?, stream.spacing()?)));
        let (whitewater, spacing) = known.ok_or_else(|| crafted(&path))?;
        self.state = Some((place, whitewater, spacing));
        Ok(())
    }

    /// Reads the liquid of the frame at `place`.
    fn load(&mut self, place: usize) -> Result<(), RunError> {
        let path = &self.frames[place].1;
        let (frame, info) = cache::read_frame_within(path, self.request.max_memory)?;
        self.cached.expect(&info, path)?;
        // A time of its own would let the emission of years fill a frame.
        let due = (f64::from(self.frames[place].0.0) - self.first) / self.fps;
        if frame.time.is_nan() || (frame.time - due).abs() > 0.01 / self.fps {
            return Err(crafted(path));
        }
        let rates = Rates::new(self.params, &self.walls);
        let liquid = frame.streams.iter().find(|stream| stream.kind == StreamKind::Particles);
        let found = liquid.and_then(|stream: &Stream| LiquidFrame::new(stream, frame.time, &rates));
        let liquid = found.ok_or_else(|| crafted(path))?;
        self.liquid = Some((place, liquid));
        Ok(())
    }
}

/// The error of a frame whose checksums are right, but not its content.
fn crafted(path: &Path) -> RunError {
    RunError::Request(format!(
        "{}: found a frame without what its writer stores there, expected particles with position, velocity and id at ascending \
         times; the frame is of another version or crafted: remove it and run the same command again",
        crate::control::printable_path(path)
    ))
}
