//! Settings of previews.

/// How previews are made.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PreviewParams {
    /// Width and height of the pictures of frames [pixels]; loop and contact sheet have the same shape.
    pub(crate) size: [usize; 2],
    /// Whether the selected frames become pictures of their own.
    pub(crate) frames: bool,
    /// What is shown of particles.
    pub(crate) particles: ParticleLook,
    /// Whether pictures of frames that are up to date are drawn for the caller.
    pub(crate) shows_kept: bool,
}

/// What is shown of particles that have a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ParticleLook {
    /// Their surface: the mesh of the frame, or else one of draft quality, made in memory.
    #[default]
    Surface,
    /// Balls, coloured by speed.
    Speed,
}

impl ParticleLook {
    /// All looks.
    pub(crate) const ALL: [Self; 2] = [Self::Surface, Self::Speed];

    /// Its name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Speed => "speed",
        }
    }
}
