//! What a caller wants of a surface, checked, and the surface or why there is none.

use meniscus::{
    control::CancelToken,
    frame::{Columns, SPACING_RANGE},
    mesh::{self, Surface, SurfaceError, SurfaceParams},
    par,
    scene::{self, Problem, Quality, SceneError},
};
use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
};

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
}

impl Request<'_> {
    /// The surface. A panic is a failure like others.
    pub(crate) fn run(&self, cancel: &CancelToken) -> Result<Surface, Failure> {
        let spacing = self.checked_spacing()?;
        let params = self.checked_params()?;
        if self.threads > MAX_THREADS {
            let found = self.threads;
            return Err(Failure::Parameter(format!("threads: found {found}, expected 0 to {MAX_THREADS}")));
        }
        // A pool for this call alone: the threads of a global one do not survive a fork of the interpreter.
        let make = || {
            par::try_with_threads(self.threads, || {
                mesh::reconstruct(&self.particles, spacing, &params, cancel)
            })
        };
        match catch_unwind(AssertUnwindSafe(make)) {
            Ok(Ok(Ok(surface))) => Ok(surface),
            Ok(Ok(Err(SurfaceError::Interrupted))) => Err(Failure::Interrupted),
            Ok(Ok(Err(error))) => Err(Failure::Particles(error.to_string())),
            Ok(Err(refused)) => Err(Failure::Parameter(format!(
                "threads: the system refused to start {} ({refused}); pass fewer, or allow more processes (`ulimit -u`)",
                if self.threads == 0 { "one for every core".into() } else { self.threads.to_string() }
            ))),
            Err(panic) => Err(Failure::Internal(panic_text(&*panic))),
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
    use meniscus::{frame::Column, math::Vec3};

    fn request<'a>(positions: &'a [Vec3], settings: &[&str]) -> Request<'a> {
        Request {
            particles: Columns::new(positions.len()).with("position", Column::Vec3(positions)),
            spacing: 0.1,
            quality: "",
            settings: settings.iter().map(|&text| text.to_owned()).collect(),
            threads: 1,
        }
    }

    fn failure(request: &Request) -> String {
        match request.run(&CancelToken::new()) {
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
        let found = request(&positions, &[]).run(&CancelToken::new()).unwrap_err();
        assert!(matches!(&found, Failure::Particles(text) if text.contains("particle 1")), "{found:?}");
        let cancel = CancelToken::new();
        cancel.cancel();
        assert_eq!(request(&positions[..1], &[]).run(&cancel).unwrap_err(), Failure::Interrupted);
    }

    #[test]
    fn one_particle_is_a_sound_mesh() {
        let surface = request(&[Vec3::zeros()], &[]).run(&CancelToken::new()).unwrap();
        assert!(surface.check.is_sound() && surface.check.components == 1, "{:?}", surface.check);
    }
}
