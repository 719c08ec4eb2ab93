//! From a cached frame and the files made of it to what its picture shows.

use super::{
    colours::{CLOTHS, SpeedColours, colours_in},
    files::{ShownFile, ShownFiles},
    settings::ParticleLook,
    stage::Stage,
};
use crate::{
    control::CancelToken,
    frame::{Frame, Stream, StreamKind},
    image::render::{Balls, Fog, Model, Surface},
    job::RunError,
    mesh::{Mesh, SmoothingParams, SurfaceError, SurfaceParams, reconstruct},
    product::{colors::ParticleColors, sheet_mesh::sheet_mesh},
    solid::body_poses,
};

/// Radius of particles that are shown as balls [spacings].
const BALL: f32 = 0.55;

/// Settings of surfaces that have no mesh: isotropic and coarser than those of presets.
pub(super) fn draft_surface() -> SurfaceParams {
    let smoothing = Some(SmoothingParams::default());
    SurfaceParams { voxel: 0.75, attributes: Some(Vec::new()), smoothing, ..SurfaceParams::default() }
}

/// What a picture shows, and what the user should know of it.
pub(super) struct Content {
    pub(super) model: Model,
    /// What it was made of, for the line about the frame.
    pub(super) made_of: Vec<String>,
    /// What is not shown, and why.
    pub(super) notes: Vec<String>,
    /// Whether a file that it should show could not be read.
    pub(super) is_incomplete: bool,
}

/// What the picture of a frame shows.
///
/// # Errors
/// If a file cannot be read, or takes more memory than allowed [bytes]; if cancelled.
pub(super) fn content(
    stage: &Stage,
    frame: &Frame,
    files: &ShownFiles<'_>,
    shown: &[ShownFile],
    max_memory: Option<u64>,
    cancel: &CancelToken,
) -> Result<Content, RunError> {
    let mut model = Model::empty(stage.bounds);
    (model.ground, model.is_dark) = (stage.ground, stage.is_dark);
    let mut content = Content { model, made_of: Vec::new(), notes: Vec::new(), is_incomplete: false };
    let mut cloths = 0;
    for stream in &frame.streams {
        match stream.kind {
            StreamKind::Particles => content.add_particles(stage, stream, files, shown, cancel)?,
            StreamKind::Tracers => content.add_tracers(stream),
            StreamKind::MeshPoints => {
                let [front, back] = CLOTHS[cloths % CLOTHS.len()];
                cloths += 1;
                match sheet_mesh(stream, &frame.streams, None) {
                    Some(mesh) => {
                        content.made_of.push(format!("{} triangles", mesh.triangles.len()));
                        content.model.solids.push(surface(mesh, front, back));
                    }
                    None => content.notes.push(format!("{}: no faces, so it is not shown", stream.name)),
                }
            }
            _ => {}
        }
    }
    for file in shown {
        match files.points(file, max_memory) {
            Ok(None) => {}
            Ok(Some(points)) => {
                content.made_of.push(format!("{} {}", points.positions.len(), file.name));
                content.model.balls.push(points);
            }
            Err(why @ RunError::OverMemory { .. }) => return Err(why),
            Err(why) => {
                content.is_incomplete = true;
                content.notes.push(format!("points are not shown: {why}"));
            }
        }
    }
    let poses = body_poses(&frame.streams);
    let without_pose = stage.props.add_to(&mut content.model, frame.time, &poses, stage.view.position);
    if without_pose > 0 {
        content.notes.push(format!("{without_pose} bodies have no pose, so they are not shown"));
    }
    Ok(content)
}

impl Content {
    fn add_particles(
        &mut self,
        stage: &Stage,
        stream: &Stream,
        files: &ShownFiles<'_>,
        shown: &[ShownFile],
        cancel: &CancelToken,
    ) -> Result<(), RunError> {
        if stage.particles == ParticleLook::Speed {
            self.made_of.push(format!("{} particles", stream.len()));
            self.model.balls.push(balls(stream, stage.speed));
            return Ok(());
        }
        if stream.is_empty() {
            return Ok(());
        }
        for file in shown.iter().filter(|file| file.name == stream.name) {
            match files.mesh(file) {
                Ok(None) => {}
                Ok(Some(mesh)) => {
                    self.made_of.push(format!("mesh of {} triangles", mesh.triangles.len()));
                    self.add_surface(mesh);
                    return Ok(());
                }
                Err(why) => {
                    self.is_incomplete = true;
                    self.notes.push(format!("shown by a draft surface: {why}"));
                }
            }
        }
        let colors = stage.colors.of_particles(stream).unwrap_or_else(|why| {
            self.notes.push(format!("{}: shown without colours: {why}", stream.name));
            ParticleColors::default()
        });
        let particles = colors.with(stream);
        let made = match stream.spacing() {
            Some(spacing) => {
                let params = SurfaceParams { attributes: colors.attributes(), ..draft_surface() };
                reconstruct(&particles, spacing, &params, cancel).map_err(Some)
            }
            None => Err(None),
        };
        match made {
            Ok(made) => {
                self.made_of.push(format!("draft surface of {} triangles", made.mesh.triangles.len()));
                self.add_surface(made.mesh);
            }
            Err(Some(SurfaceError::Interrupted)) => return Err(RunError::Interrupted),
            Err(why) => {
                let why = why.map_or_else(|| "no spacing".to_owned(), |why| why.to_string());
                self.notes
                    .push(format!("{}: shown as particles, since it has no surface: {why}", stream.name));
                self.model.balls.push(balls(stream, stage.speed));
            }
        }
        Ok(())
    }

    /// Adds the surface of particles: clear, or opaque in the colours of its vertices.
    fn add_surface(&mut self, mesh: Mesh) {
        let surface = surface(mesh, [0.0; 3], [0.0; 3]);
        if surface.colours.is_empty() {
            self.model.water.push(surface);
        } else {
            self.model.solids.push(surface);
        }
    }

    fn add_tracers(&mut self, stream: &Stream) {
        let (Some(positions), Some(spacing)) = (stream.vec3("position"), stream.spacing()) else {
            self.notes.push(format!("{}: no places or no spacing, so it is not shown", stream.name));
            return;
        };
        let densities = stream.f32("density").unwrap_or_default().to_vec();
        self.made_of.push(format!("{} tracers", positions.len()));
        self.model.fog.push(Fog { positions: positions.to_vec(), densities, spacing });
    }
}

/// A mesh as a surface of these colours.
fn surface(mesh: Mesh, front: [f32; 3], back: [f32; 3]) -> Surface {
    let Mesh { positions, origin, triangles, normals, attributes } = mesh;
    Surface { positions, origin, normals, triangles, colours: colours_in(&attributes), front, back }
}

/// Particles as balls, coloured by their speed over the largest of the scale [m/s].
fn balls(stream: &Stream, largest: f32) -> Balls {
    let colours = SpeedColours::new();
    let scale = if largest > 0.0 { 1.0 / largest } else { 0.0 };
    let positions = stream.vec3("position").unwrap_or_default().to_vec();
    let velocities = stream.vec3("velocity").unwrap_or_default();
    let colours = velocities.iter().map(|v| colours.of(v.norm() * scale)).collect();
    Balls { positions, radii: vec![BALL * stream.spacing().unwrap_or(0.0)], colours }
}
