//! Smoke as streams of a frame, and back.

use super::{NAME, Smoke, System, TRACERS, estimate::refuse_kernel, tracers::Tracers};
use crate::{
    frame::{Stream, StreamKind},
    sim::{
        SetupError, World,
        vortex::{Vortons, flow::Flow},
    },
};

impl System {
    /// The state as named columns, with all that [`System::restore`] needs: vortons, then tracers.
    pub(in crate::sim) fn streams(&self) -> [Stream; 2] {
        let Flow { vortons, volume, id, next_id, strained, .. } = &self.flow;
        let mut stream = Stream::new(NAME, StreamKind::Vortons, vortons.len())
            .with("position", vortons.position.clone())
            .with("strength", vortons.strength.clone())
            .with("core", vortons.core.clone())
            .with("volume", volume.clone())
            .with("id", id.clone());
        stream.scalars = vec![
            ("next_id".into(), f64::from(*next_id)),
            ("strained".into(), *strained),
            ("frames".into(), f64::from(self.frames)),
            ("skipped_in_solids".into(), f64::from(self.skipped_in_solids)),
        ];
        [stream, self.tracers.stream(self.params.tracer_spacing())]
    }

    /// Takes the state from a frame's streams.
    pub(in crate::sim) fn restore(
        smoke: Smoke,
        world: &World,
        streams: &[Stream],
    ) -> Result<Self, SetupError> {
        refuse_kernel(&smoke.params)?;
        let mut system = Self::empty(smoke, world);
        let stream = find(streams, NAME)?;
        let missing = |what| SetupError::Missing { stream: NAME, what };
        let scalar = |name| stream.scalar(name).map(|value| value as u32).ok_or(missing(name));
        system.flow = Flow::restore(
            system.params.flow.clone(),
            vortons_of(stream)?,
            stream.f32("volume").ok_or(missing("volume"))?.to_vec(),
            stream.u32("id").ok_or(missing("id"))?.to_vec(),
            scalar("next_id")?,
            stream.scalar("strained").ok_or(missing("strained"))?,
        );
        system.frames = scalar("frames")?;
        system.skipped_in_solids = scalar("skipped_in_solids")?;
        system.tracers = Tracers::restore(find(streams, TRACERS)?)?;
        Ok(system)
    }
}

/// The stream of that name.
///
/// # Errors
/// If there is none.
pub(super) fn find<'a>(streams: &'a [Stream], name: &'static str) -> Result<&'a Stream, SetupError> {
    let missing = SetupError::Missing { stream: name, what: "particles" };
    streams.iter().find(|stream| stream.name == name).ok_or(missing)
}

/// The vortons of a frame's stream.
///
/// # Errors
/// If it lacks a column.
pub(super) fn vortons_of(stream: &Stream) -> Result<Vortons, SetupError> {
    let missing = |what| SetupError::Missing { stream: NAME, what };
    Ok(Vortons {
        position: stream.vec3("position").ok_or(missing("position"))?.to_vec(),
        strength: stream.vec3("strength").ok_or(missing("strength"))?.to_vec(),
        core: stream.f32("core").ok_or(missing("core"))?.to_vec(),
    })
}
