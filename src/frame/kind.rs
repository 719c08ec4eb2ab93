//! What the entries of a stream are.

use serde::Serialize;

/// What the entries of a stream are, which decides what can be made of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum StreamKind {
    /// Particles that fill a volume; `position` [m] and the scalar `spacing` [m]. They have a surface.
    Particles,
    /// Points advected by a flow; `position` [m], `density` and the scalar `spacing` [m]. They fill volumes.
    Tracers,
    /// Vortex particles, the state from which a flow's velocity is evaluated; `position` [m], `strength` [m³/s].
    Vortons,
    /// Points of a surface mesh; `position` [m]. Its faces are in the stream of that name with `.faces` behind it.
    MeshPoints,
    /// Faces of a surface mesh: the numbers of the points at their corners.
    MeshFaces,
    /// Rigid bodies; `position` of the origin of the shape [m], `rotation` and `rotation_w`, a unit quaternion.
    RigidBodies,
    /// Entries of which nothing is known, and of which nothing is made.
    #[default]
    Unknown,
}

impl StreamKind {
    /// Whether the entries are points in space, and not connections between them.
    pub fn has_positions(self) -> bool {
        self != Self::MeshFaces
    }
}
