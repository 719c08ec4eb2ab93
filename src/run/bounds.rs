//! What surfaces of frames would take, without making them.

use crate::{
    control::printable_path,
    frame::{FrameIndex, Stream, StreamKind},
    job::{
        Control, FailedFrame, Failure, RunError,
        batch::{BatchRequest, Source},
    },
    mesh::SurfaceParams,
    product::surface::{SurfaceBounds, surface_bounds},
};
use std::path::Path;

/// The bounds of the surface of one stream of a frame.
#[derive(Clone, Debug)]
pub(crate) struct FrameBounds {
    pub(crate) frame: FrameIndex,
    pub(crate) stream: String,
    pub(crate) bounds: SurfaceBounds,
}

/// Memory of coarse nodes above which they are not sampled without a limit of the user's [bytes].
const AFFORDABLE: u64 = 1 << 30;

/// Reads the frames of a source one by one and passes on the bounds of their surfaces. `is_known` is false if the source's
/// spacing is none of the user's.
///
/// # Errors
/// Frames that cannot be read are left out and reported together at the end ([`RunError::SomeFailed`]).
pub(crate) fn bounds(
    source: Source,
    is_known: bool,
    params: &SurfaceParams,
    request: &BatchRequest,
    control: Control,
    done: &mut dyn FnMut(FrameBounds),
) -> Result<(), RunError> {
    let frames = source.frames(request.selection.as_ref())?;
    let requested = frames.len();
    let mut failed = Vec::new();
    for (frame, path) in frames {
        if control.cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        let found = match &path {
            Some(path) => of_frame(&source, path, frame, is_known, params, request),
            None => Err(RunError::Request(source.absent().into())),
        };
        let place = path.as_deref().map_or_else(String::new, |path| format!("{}: ", printable_path(path)));
        let (why, kind) = match found {
            Ok(found) => {
                found.into_iter().for_each(&mut *done);
                continue;
            }
            Err(RunError::Cache(why)) => (why.to_string(), Failure::of(&why)),
            Err(RunError::Import(why)) => (why.to_string(), Failure::Other),
            Err(why @ RunError::OverMemory { .. }) => (format!("{place}{why}"), Failure::Memory),
            Err(RunError::Request(why)) => (format!("{place}{why}"), Failure::Other),
            Err(why) => return Err(why),
        };
        failed.push(FailedFrame { name: format!("frame {frame}"), why, kind });
    }
    if failed.is_empty() { Ok(()) } else { Err(RunError::SomeFailed { failed, requested }) }
}

/// The bounds of the surfaces of the streams of particles of a frame.
fn of_frame(
    source: &Source,
    path: &Path,
    frame: FrameIndex,
    is_known: bool,
    params: &SurfaceParams,
    request: &BatchRequest,
) -> Result<Vec<FrameBounds>, RunError> {
    let affordable = request.max_memory.unwrap_or(AFFORDABLE);
    let opened = source.open(path, frame, request.max_memory)?;
    let spacings: Vec<Option<f32>> =
        opened.headers.iter().map(|header| header.spacing.as_ref().ok().copied()).collect();
    let (streams, _) = opened.unpack()?;
    let particles = streams.iter().zip(spacings).filter(|(stream, _)| stream.kind == StreamKind::Particles);
    let of = |(stream, spacing): (&Stream, Option<f32>)| {
        let bounds = surface_bounds(stream, spacing.filter(|_| is_known), params, affordable)?;
        Ok(FrameBounds { frame, stream: stream.name.clone(), bounds })
    };
    particles.map(of).collect()
}
