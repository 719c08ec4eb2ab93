//! What surfaces of frames would take, without making them.

use crate::{
    control::printable_path,
    frame::{FrameIndex, StreamKind},
    job::{
        Control, FailedFrame, Failure, RunError,
        batch::{BatchRequest, Source},
    },
    mesh::SurfaceParams,
    product::surface::{SurfaceBounds, surface_bounds},
};

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
    let affordable = request.max_memory.unwrap_or(AFFORDABLE);
    let frames = source.frames(request.selection.as_ref())?;
    let requested = frames.len();
    let mut failed = Vec::new();
    for (frame, path) in frames {
        if control.cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        let mut fail =
            |why: String, kind| failed.push(FailedFrame { name: format!("frame {frame}"), why, kind });
        let Some(path) = path else {
            fail(source.absent().into(), Failure::Other);
            continue;
        };
        let opened = match source.open(&path, frame, request.max_memory) {
            Ok(opened) => opened,
            Err(RunError::Cache(why)) => {
                fail(why.to_string(), Failure::of(&why));
                continue;
            }
            Err(why @ RunError::OverMemory { .. }) => {
                fail(format!("{}: {why}", printable_path(&path)), Failure::Memory);
                continue;
            }
            Err(RunError::Import(why)) => {
                fail(why.to_string(), Failure::Other);
                continue;
            }
            Err(why) => return Err(why),
        };
        let spacings: Vec<Option<f32>> =
            opened.headers.iter().map(|header| header.spacing.as_ref().ok().copied()).collect();
        let streams = match opened.unpack() {
            Ok((streams, _)) => streams,
            Err(why) => {
                fail(why.to_string(), Failure::Other);
                continue;
            }
        };
        for (stream, spacing) in streams.iter().zip(spacings) {
            if stream.kind != StreamKind::Particles {
                continue;
            }
            match surface_bounds(stream, spacing.filter(|_| is_known), params, affordable) {
                Ok(bounds) => done(FrameBounds { frame, stream: stream.name.clone(), bounds }),
                Err(why) => fail(format!("{}: {why}", printable_path(&path)), Failure::Other),
            }
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(RunError::SomeFailed { failed, requested }) }
}
