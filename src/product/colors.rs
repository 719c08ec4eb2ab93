//! Colours of particles that follow from the preset, so that surfaces and pictures show them without a new simulation.

use crate::{
    frame::{COLOR, Column, Columns, Stream},
    math::Vec3,
    mesh::SurfaceParams,
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

    /// What the colours of the surface of a stream depend on, for the key of a file; empty if it has none.
    pub(super) fn text(&self, stream: &str, params: &SurfaceParams) -> String {
        let found = self.of_stream(stream).filter(|_| has_colors(params));
        found.map_or_else(String::new, |found| format!(" {found:?}"))
    }

    /// What all colours depend on; empty without any.
    pub(super) fn all_text(&self) -> String {
        if self.0.is_empty() { String::new() } else { format!(" {self:?}") }
    }

    /// The colours of the particles of a stream, if its surface has them among its attributes.
    ///
    /// # Errors
    /// As [`Self::of_particles`].
    pub(super) fn for_surface(
        &self,
        stream: &Stream,
        params: &SurfaceParams,
    ) -> Result<ParticleColors, String> {
        if has_colors(params) { self.of_particles(stream) } else { Ok(ParticleColors::default()) }
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

/// Whether surfaces of these parameters have colours, where particles have some.
fn has_colors(params: &SurfaceParams) -> bool {
    params.attributes.as_ref().is_none_or(|names| names.iter().any(|name| name == COLOR))
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
            // A frame from elsewhere may have such a channel by itself.
            Some(colors) if columns.column(COLOR).is_none() => columns.with(COLOR, Column::Vec3(colors)),
            _ => columns,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::StreamKind, scene};

    #[test]
    fn particles_have_the_colors_of_their_sources_and_emitters() {
        let disc = "shape = { disc = { center = [0, 0, 1], normal = [0, 0, -1], radius = 0.1 } }";
        let set = [
            "liquid.source.0.color=[1, 0.5, 0]".to_owned(),
            format!(
                "liquid.emitter=[{{ {disc}, rate = 0.01 }}, {{ {disc}, rate = 0.01, color = [0, 0, 1] }}]"
            ),
        ];
        let overrides = scene::Overrides { quality: None, set: set.into() };
        let scene = Scene::from_preset(&scene::load("dam-break").unwrap(), &overrides).unwrap();
        let colors = StreamColors::of(Some(&scene));
        let stream = |numbers: &[u32]| {
            Stream::new("liquid", StreamKind::Particles, numbers.len()).with("source", numbers.to_vec())
        };
        let found = colors.of_particles(&stream(&[2, 0, 1])).unwrap();
        let wanted = [[0.0, 0.0, 1.0], [1.0, 0.5, 0.0], [0.8, 0.8, 0.8]].map(Vec3::from);
        assert_eq!(found.with(&stream(&[2, 0, 1])).vec3(COLOR), Some(&wanted[..]));

        // Frames of other sources, and without them.
        let why = colors.of_particles(&stream(&[0, 3])).unwrap_err();
        assert!(why.contains("numbers from 3 on"), "{why}");
        let without = Stream::new("liquid", StreamKind::Particles, 1);
        let why = colors.of_particles(&without).unwrap_err();
        assert!(why.contains("no channel `source`"), "{why}");
        // No surface needs them that does not name them, and no other stream has them.
        let plain = SurfaceParams { attributes: Some(vec!["velocity".into()]), ..SurfaceParams::default() };
        assert!(colors.for_surface(&without, &plain).is_ok() && colors.text("liquid", &plain).is_empty());
        assert!(!colors.text("liquid", &SurfaceParams::default()).is_empty());
        let other = Stream::new("other", StreamKind::Particles, 1);
        assert!(colors.of_particles(&other).unwrap().with(&other).column(COLOR).is_none());
        assert!(StreamColors::of(None).all_text().is_empty());
    }
}
