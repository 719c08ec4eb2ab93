//! Memory of making volume files.

use crate::{
    export::vdb::VolumeGrid,
    frame::{Stream, StreamKind},
    job::memory::{BASE_MEMORY, Grids},
    mesh::{RadiusScales, SurfaceParams},
    product::surface::bricks_around,
};

/// Memory of every grid of particles [bytes/brick of the density]: nodes of density, distance and velocity, and the bytes of
/// the file. 17 800 were measured (32 768 particles at voxel 0.5, floats, not packed).
const BRICK_BYTES: f64 = 20000.0;

/// Memory of the particles or tracers themselves [bytes each].
const PARTICLE_BYTES: f64 = 150.0;

/// Memory of every grid of tracers [bytes/brick that tracers reach]: velocities reach beyond those.
const TRACER_BRICK_BYTES: f64 = 60000.0;

/// Additional memory where the vector potential is requested, which reaches as far as velocities [bytes/brick that tracers reach].
const POTENTIAL_BRICK_BYTES: f64 = 25000.0;

/// Peak memory of making volumes of so many particles or tracers in so many bricks [bytes].
fn volume_memory(kind: StreamKind, entries: usize, bricks: f64, grids: &[VolumeGrid]) -> u64 {
    let potential = grids.contains(&VolumeGrid::VectorPotential);
    let brick = match kind {
        StreamKind::Tracers if potential => TRACER_BRICK_BYTES + POTENTIAL_BRICK_BYTES,
        StreamKind::Tracers => TRACER_BRICK_BYTES,
        _ => BRICK_BYTES,
    };
    (BASE_MEMORY + entries as f64 * PARTICLE_BYTES + bricks * brick) as u64
}

/// The largest memory that making volumes of so many particles or tracers was seen to take [bytes].
pub(super) fn max_volume_memory(
    kind: StreamKind,
    entries: usize,
    params: &SurfaceParams,
    requested: &[VolumeGrid],
) -> u64 {
    let grids = Grids::at_most(entries, params.voxel).with_inside(entries, params.voxel);
    volume_memory(kind, entries, grids.bricks, requested)
}

/// A bound of the memory that making volumes of a stream takes, by where its particles are [bytes].
pub(super) fn stream_memory(
    stream: &Stream,
    spacing: f32,
    params: &SurfaceParams,
    requested: &[VolumeGrid],
) -> u64 {
    let positions = stream.vec3("position").unwrap_or_default();
    let radii = RadiusScales::of(stream, spacing, params).ok().flatten();
    let scales = radii.as_ref().map(|radii| &*radii.values);
    let bricks = bricks_around(positions, scales, spacing, params);
    volume_memory(stream.kind, stream.len(), bricks as f64, requested)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::batch::{FRAME_MEMORY_RESERVE, Source},
        math::Vec3,
        product::surface,
    };

    #[test]
    fn the_size_of_a_file_bounds_the_memory_of_its_particles() {
        // Else each file is read twice, the second time alone.
        let drop = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Vec3::from);
        let dir = tempfile::tempdir().unwrap();
        for copies in [0, 1, 10, 100, 1000] {
            let offset = |i: i32| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.2;
            let positions: Vec<Vec3> = (0..copies).flat_map(|i| drop.map(|x| x + offset(i))).collect();
            let count = positions.len();
            let file = dir.path().join("drops.xyz");
            std::fs::write(&file, vec![0; 12 * count]).unwrap();
            let sequence = crate::import::expand(&[file.to_string_lossy().into_owned()]).unwrap();
            let entries = Source::Files { sequence: &sequence, spacing: 0.1 }.max_entries(&file);
            let stream = Stream::new("particles", StreamKind::Particles, count).with("position", positions);
            for voxel in [0.5, 1.0] {
                let params = SurfaceParams { voxel, ..SurfaceParams::default() };
                let mesh = surface::memory::stream_memory(&stream, 0.1, &params, u64::MAX);
                let volume = stream_memory(&stream, 0.1, &params, &VolumeGrid::DEFAULT);
                let bounds = [
                    surface::memory::max_surface_memory(entries, &params),
                    max_volume_memory(StreamKind::Particles, entries, &params, &VolumeGrid::DEFAULT),
                ];
                for (needed, bound) in [mesh, volume].into_iter().zip(bounds) {
                    let bound = bound + FRAME_MEMORY_RESERVE;
                    assert!(needed <= bound, "{count} particles at {voxel}: {needed} of {bound} bytes");
                }
            }
        }
    }
}
