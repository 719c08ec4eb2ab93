//! Local frame of particles far from the origin.
//!
//! *Method*: single precision distinguishes positions of at least 2⁻²⁴ of their distance from the origin. From
//! [`MAX_NODES`] voxels on, vertices of a surface share the same coordinates, and triangles lose their area.
//! The surface of such particles is made in a frame whose origin is their median coordinate, rounded to a multiple
//! of a brick's edge so that the grid's nodes stay where they are. A mesh keeps that origin in double
//! precision.
//!
//! Limits: particles are in single precision themselves: 10 km from the origin they are 1 mm apart, at 1000 km 6 cm.
//! Particles further than [`MAX_NODES`] voxels from their median are as in the frame of the
//! world.

use crate::{
    frame::{ChannelData, Column, Columns, Stream, StreamKind},
    grid::BRICK,
    math::Vec3,
    par,
};

/// Largest coordinate in the frame of the world [voxels]: as far the vertices of random fields stay distinct, at
/// [`super::MARGIN`] of a voxel.
const MAX_NODES: f32 = 8192.0;

/// Particles whose median is computed. If they are more, it takes longer; if fewer, a small group far from the others may
/// become the origin.
const MAX_SAMPLES: usize = 4096;

/// Whether particles are copied into a local frame for a surface of cells of `voxel` [m].
pub(crate) fn is_far(particles: &Columns, voxel: f32) -> bool {
    local_origin(particles.vec3("position").unwrap_or_default(), voxel).is_some()
}

/// The origin of the local frame [m]; `None` if that of the world serves as well.
pub(super) fn local_origin(positions: &[Vec3], voxel: f32) -> Option<nalgebra::Vector3<f64>> {
    let (_, reach) = par::max(positions.len(), |i| positions[i].amax())?;
    if reach <= MAX_NODES * voxel {
        return None;
    }
    let step = positions.len().div_ceil(MAX_SAMPLES);
    let samples: Vec<Vec3> = positions.iter().step_by(step).copied().collect();
    let median = |of: &dyn Fn(&Vec3) -> f32| {
        let mut values: Vec<f32> = samples.iter().map(of).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    let edge = f64::from(voxel) * BRICK as f64;
    let origin =
        nalgebra::Vector3::from_fn(|axis, _| (f64::from(median(&|x| x[axis])) / edge).round() * edge);
    // Particles around the origin of the world gain nothing by another.
    let distance = median(&|x| x.amax());
    let in_frame = median(&|x| to_frame(x, &origin).amax());
    (distance > MAX_NODES * voxel && in_frame < 0.5 * distance).then_some(origin)
}

/// The particles in the frame of `origin` [m].
pub(super) fn in_local_frame(particles: &Columns, origin: &nalgebra::Vector3<f64>) -> Stream {
    mapped(particles, particles.len(), |name, column| match column {
        Column::Vec3(values) if name == "position" => {
            let mut moved = values.to_vec();
            par::update(&mut moved, |_, x| *x = to_frame(x, origin));
            moved.into()
        }
        other => other.to_data(),
    })
}

/// Some of the particles.
pub(super) fn selected(particles: &Columns, kept: &[u32]) -> Stream {
    fn of<T: Clone>(values: &[T], kept: &[u32]) -> Vec<T> {
        kept.iter().map(|&i| values[i as usize].clone()).collect()
    }
    mapped(particles, kept.len(), |_, column| match column {
        Column::F32(values) => of(values, kept).into(),
        Column::Vec3(values) => of(values, kept).into(),
        Column::U32(values) => of(values, kept).into(),
    })
}

/// A stream of `len` entries, whose channels are made of the columns.
fn mapped(particles: &Columns, len: usize, change: impl Fn(&str, Column) -> ChannelData) -> Stream {
    let stream = Stream::new("particles", StreamKind::Particles, len);
    let columns = particles.columns().iter();
    columns.fold(stream, |stream, &(name, column)| stream.with(name, change(name, column)))
}

fn to_frame(x: &Vec3, origin: &nalgebra::Vector3<f64>) -> Vec3 {
    (x.cast::<f64>() - origin).cast()
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn the_frame_is_that_of_the_world_unless_all_are_far_and_together() {
        let block = |at: f32, width: f32| -> Vec<Vec3> {
            let step = width / 10.0;
            (0..1000).map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| at + v as f32 * step).into()).collect()
        };
        assert_eq!(local_origin(&[], 0.01), None);
        assert_eq!(local_origin(&block(70.0, 1.0), 0.01), None, "near");
        assert_eq!(local_origin(&block(-1e4, 2e4), 0.01), None, "wide");
        let with_lost = [block(0.0, 1.0), vec![Vec3::repeat(1e30)]].concat();
        assert_eq!(local_origin(&with_lost, 0.01), None, "one is lost");

        let far = [block(1e4, 1.0), vec![Vec3::repeat(-1e30)]].concat();
        let origin = local_origin(&far, 0.01).unwrap();
        let edges = origin / (f64::from(0.01_f32) * 8.0);
        assert!(edges.iter().all(|x| (x - x.round()).abs() < 1e-6), "{edges}");
        assert!(origin.iter().all(|x| (x - 1e4).abs() < 2.0), "{origin}");
        let stream = Stream::new("liquid", StreamKind::Particles, far.len())
            .with("id", (0..far.len() as u32).collect::<Vec<_>>())
            .with("position", far.clone());
        let moved = in_local_frame(&(&stream).into(), &origin);
        assert_eq!(moved.u32("id"), stream.u32("id"));
        let back = moved.vec3("position").unwrap()[999].cast::<f64>() + origin;
        assert!((back - far[999].cast::<f64>()).amax() < 1e-6, "{back}");
        let one = selected(&(&stream).into(), &[999]);
        assert_eq!(
            (one.len(), one.u32("id").unwrap(), one.vec3("position").unwrap()[0]),
            (1, &[999][..], far[999])
        );
    }
}
