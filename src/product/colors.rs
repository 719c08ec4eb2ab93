//! Colours of particles that follow from the preset, so that surfaces and pictures show them without a new simulation.

use crate::{
    frame::{COLOR, Column, Columns, Stream},
    math::Vec3,
    sim::{registry, scene::Scene, system::ChannelColors},
};

/// The colours of all streams of a shot.
#[derive(Debug, Default)]
pub(super) struct StreamColors(Vec<ChannelColors>);

/// Colours of the particles of one stream, in their order.
#[derive(Debug, Default)]
pub(super) struct ParticleColors(Option<Vec<Vec3>>);

impl StreamColors {
    /// The colours of the particles that the preset of a shot describes; none without one.
    pub(super) fn of(scene: Option<&Scene>) -> Self {
        let scene = scene.into_iter();
        Self(scene.flat_map(|scene| registry::ALL.iter().filter_map(|system| system.colors(scene))).collect())
    }

    /// What the colours of a stream depend on, for the key of a file; empty if it has none.
    pub(super) fn text(&self, stream: &str) -> String {
        self.of_stream(stream).map_or_else(String::new, |found| format!(" {found:?}"))
    }

    /// The colours of the particles of a stream.
    ///
    /// # Errors
    /// A message, if the frame was simulated without the channel that decides them, or with other sources.
    pub(super) fn of_particles(&self, stream: &Stream) -> Result<ParticleColors, String> {
        let Some(ChannelColors { channel, colors, .. }) = self.of_stream(&stream.name) else {
            return Ok(ParticleColors(None));
        };
        let numbers = stream.u32(channel).ok_or_else(|| {
            format!("the particles have no channel `{channel}`, which decides their colours; simulate the shot again")
        })?;
        if numbers.iter().any(|&number| number as usize >= colors.len()) {
            return Err(format!(
                "the channel `{channel}` has numbers from {} on, for which the preset has no colour; simulate the shot again",
                colors.len()
            ));
        }
        Ok(ParticleColors(Some(numbers.iter().map(|&number| colors[number as usize]).collect())))
    }

    fn of_stream(&self, stream: &str) -> Option<&ChannelColors> {
        self.0.iter().find(|colors| colors.stream == stream)
    }
}

impl ParticleColors {
    /// The attributes of a surface that has nothing but these.
    pub(super) fn attributes(&self) -> Option<Vec<String>> {
        Some(self.0.iter().map(|_| COLOR.to_owned()).collect())
    }

    /// The columns of a stream with the colours of its particles, if they have any.
    pub(super) fn with<'a>(&'a self, stream: &'a Stream) -> Columns<'a> {
        let columns = Columns::from(stream);
        match &self.0 {
            Some(colors) if columns.column(COLOR).is_none() => columns.with(COLOR, Column::Vec3(colors)),
            _ => columns,
        }
    }
}
