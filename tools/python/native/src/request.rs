//! What a caller wants of a surface, checked, and the surface or why there is none.

use crate::{
    call,
    memory::{CallMemory, granted_part},
};
use meniscus::{
    frame::{Columns, SPACING_RANGE},
    mesh::{self, Surface, SurfaceError, SurfaceParams},
    scene::{self, Problem, Quality, SceneError},
};
use std::any::Any;

/// Largest number of threads, that of the program's `--threads`.
const MAX_THREADS: usize = 1024;

/// A request, with texts and arrays of the caller.
pub(crate) struct Request<'a> {
    pub(crate) particles: Columns<'a>,
    /// Spacing of the particles [m].
    pub(crate) spacing: f64,
    /// Name of a quality tier; empty: the defaults of `[surface]`.
    pub(crate) quality: &'a str,
    /// Settings, each as `surface.key=value`.
    pub(crate) settings: Vec<String>,
    /// Threads to compute with; 0: one a core.
    pub(crate) threads: usize,
    /// Memory that the surface may need [bytes]; 0: what the system grants.
    pub(crate) max_memory: u64,
}

/// Why there is no surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Failure {
    /// A parameter is unknown or out of range.
    Parameter(String),
    /// The particles lack something.
    Particles(String),
    /// The caller cancelled.
    Interrupted,
    /// A bug.
    Internal(String),
    /// There is too little memory.
    Memory(String),
    /// There was too little memory, and threads of the call wait for it for ever.
    Abandoned,
}

impl Request<'_> {
    /// The surface.
    pub(crate) fn run(&self, memory: &CallMemory) -> Result<Surface, Failure> {
        let spacing = self.checked_spacing()?;
        let params = self.checked_params()?;
        if self.threads > MAX_THREADS {
            let found = self.threads;
            return Err(Failure::Parameter(format!("threads: found {found}, expected 0 to {MAX_THREADS}")));
        }
        // A pool for this call alone: the threads of a global one do not survive a fork of the interpreter.
        let made = call::on_threads(memory, self.threads, || {
            mesh::positions(&self.particles).map_err(|error| Failure::Particles(error.to_string()))?;
            self.check_memory(spacing, &params, memory)?;
            match mesh::reconstruct(&self.particles, spacing, &params, memory.cancel()) {
                Err(SurfaceError::Interrupted) if memory.was_refused() => Err(call::refused()),
                Err(SurfaceError::Interrupted) => Err(Failure::Interrupted),
                made => made.map_err(|error| Failure::Particles(error.to_string())),
            }
        });
        made?
    }

    /// Whether the memory that the surface needs is allowed and granted; its reserve is kept.
    fn check_memory(&self, spacing: f32, params: &SurfaceParams, memory: &CallMemory) -> Result<(), Failure> {
        let needed = |enough: u64| scene::stream_memory(&self.particles, spacing, params, enough);
        let allowed = if self.max_memory == 0 { u64::MAX } else { self.max_memory };
        let bound = needed(allowed);
        if bound > allowed {
            return Err(over_memory(bound, allowed, "is allowed by max_memory"));
        }
        if memory.hold(bound) {
            return Ok(());
        }
        // The bound may be several times what is needed; an estimate takes longer.
        let free = granted_part(bound);
        let estimate = needed(free);
        if memory.hold(estimate) {
            Ok(())
        } else {
            Err(over_memory(estimate, free, "is granted by the system"))
        }
    }

    fn checked_spacing(&self) -> Result<f32, Failure> {
        if SPACING_RANGE.contains(&self.spacing) {
            return Ok(self.spacing as f32);
        }
        let (from, to) = (SPACING_RANGE.start(), SPACING_RANGE.end());
        Err(Failure::Parameter(format!("spacing: found {}, expected {from} to {to} [m]", self.spacing)))
    }

    fn checked_params(&self) -> Result<SurfaceParams, Failure> {
        let quality = match self.quality {
            "" => None,
            name => Some(name.parse::<Quality>().map_err(|expected| {
                Failure::Parameter(format!("quality: found `{}`, {expected}", name.escape_debug()))
            })?),
        };
        let params = scene::surface_params(quality, &self.settings).map_err(|error| {
            Failure::Parameter(match &error {
                SceneError::Invalid(problems) => {
                    problems.iter().map(explained).collect::<Vec<_>>().join("\n")
                }
                other => other.to_string(),
            })
        })?;
        if params.contact.is_some() {
            let expected =
                "expected none: arrays of particles have no colliders; mesh the shot's cache instead";
            return Err(Failure::Parameter(format!("surface.contact: found settings, {expected}")));
        }
        Ok(params)
    }
}

/// The failure where a surface needs more memory than there is.
fn over_memory(needed: u64, available: u64, whose: &str) -> Failure {
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    Failure::Memory(format!(
        "the surface needs about {:.0} MB of memory, of which {:.0} MB {whose}; choose a larger voxel or spacing, fewer terms, or parts \
         of the particles",
        megabytes(needed),
        megabytes(available)
    ))
}

/// A problem with what was found and the next step.
fn explained(problem: &Problem) -> String {
    let mut text = format!("{}: {}", problem.message, problem.label);
    if let Some(nearest) = &problem.nearest {
        text += &format!("; did you mean `{nearest}`?");
    }
    if let Some(help) = &problem.help {
        text += &format!("; {help}");
    }
    text
}

/// The message of a panic.
pub(crate) fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "a panic without a message".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use meniscus::{control::CancelToken, frame::Column, math::Vec3};

    fn request<'a>(positions: &'a [Vec3], settings: &[&str]) -> Request<'a> {
        Request {
            particles: Columns::new(positions.len()).with("position", Column::Vec3(positions)),
            spacing: 0.1,
            quality: "",
            settings: settings.iter().map(|&text| text.to_owned()).collect(),
            threads: 1,
            max_memory: 0,
        }
    }

    fn made(request: &Request, cancel: &CancelToken) -> Result<Surface, Failure> {
        request.run(&CallMemory::new(cancel.clone()))
    }

    fn failure(request: &Request) -> String {
        match made(request, &CancelToken::new()) {
            Err(Failure::Parameter(text)) => text,
            other => panic!("{:?}", other.map(|surface| surface.stats)),
        }
    }

    #[test]
    fn parameters_out_of_their_range_are_named_with_value_and_range() {
        let positions = [Vec3::zeros()];
        for spacing in [0.0, -1.0, f64::NAN, 1e9] {
            let text = failure(&Request { spacing, ..request(&positions, &[]) });
            assert!(text.starts_with(&format!("spacing: found {spacing}, expected 0.000001 to")), "{text}");
        }
        let text = failure(&request(&positions, &["surface.voxel=20"]));
        assert!(text.contains("surface.voxel") && text.contains("20") && text.contains("0.05"), "{text}");
        let text = failure(&request(&positions, &["surface.voxle=1"]));
        assert!(text.contains("did you mean `voxel`"), "{text}");
        let both = failure(&request(&positions, &["surface.voxel=nan", "surface.kernel_radius=0"]));
        assert_eq!(both.lines().count(), 2, "{both}");
        let text = failure(&Request { quality: "fine", ..request(&positions, &[]) });
        assert_eq!(text, "quality: found `fine`, expected `draft`, `preview` or `final`");
        let text = failure(&Request { threads: 1025, ..request(&positions, &[]) });
        assert_eq!(text, "threads: found 1025, expected 0 to 1024");
        assert!(failure(&request(&positions, &["surface.contact={}"])).starts_with("surface.contact: "));
    }

    #[test]
    fn particles_that_are_not_finite_and_cancelled_calls_are_failures() {
        let positions = [Vec3::zeros(), Vec3::new(0.0, f32::NAN, 0.0)];
        let found = made(&request(&positions, &[]), &CancelToken::new()).unwrap_err();
        assert!(matches!(&found, Failure::Particles(text) if text.contains("particle 1")), "{found:?}");
        let cancel = CancelToken::new();
        cancel.cancel();
        assert_eq!(made(&request(&positions[..1], &[]), &cancel).unwrap_err(), Failure::Interrupted);
    }

    #[test]
    fn one_particle_is_a_sound_mesh() {
        let surface = made(&request(&[Vec3::zeros()], &[]), &CancelToken::new()).unwrap();
        assert!(surface.check.is_sound() && surface.check.components == 1, "{:?}", surface.check);
    }

    #[test]
    fn a_surface_that_needs_more_memory_than_is_allowed_or_granted_is_refused_before_it_is_made() {
        let positions = [Vec3::zeros(), Vec3::new(1.0, 0.0, 0.0)];
        let found = made(&Request { max_memory: 1 << 20, ..request(&positions, &[]) }, &CancelToken::new());
        let Err(Failure::Memory(text)) = found else { panic!("{:?}", found.map(|surface| surface.stats)) };
        assert!(
            text.starts_with("the surface needs about 1") && text.contains("1 MB is allowed by max_memory"),
            "{text}"
        );
        let surface = made(&Request { max_memory: 1 << 30, ..request(&positions, &[]) }, &CancelToken::new());
        assert!(surface.unwrap().check.is_sound());
    }
}
