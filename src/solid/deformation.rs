//! Meshes whose vertices move: signed distance to them at any time.
//!
//! *Method*: between two samples of a file the vertices move at constant velocity. *Keys* divide the time between samples so that no
//! vertex moves farther than [`KEY_DISPLACEMENT`] from one key to the next. At a key the distance to the triangles is sampled on a grid;
//! between keys it is interpolated linearly in time. Grids of all keys share the places of their nodes, and each contains the mesh
//! at the keys before and after it, so that distances of what is at rest do not change.
//! *Departs from the papers*: none is followed.
//!
//! Limits: a part thinner than the displacement between two keys thins out half way between them. The change of the distance has
//! the velocity of the surface along its normal; how a surface slides in itself is not in it.

use crate::{
    math::Vec3,
    par,
    sdf::{self, MARGIN_NODES, Sampled, SampledGrid, Triangles},
};
use std::sync::{Arc, Mutex, PoisonError};

/// Farthest that a vertex moves from one key to the next [voxels]: then parts of three voxels and more keep their inside.
const KEY_DISPLACEMENT: f32 = 2.0;

/// Most keys between two samples: a vertex that moves farther does not move but jumps.
const MAX_KEYS_BETWEEN_SAMPLES: f32 = 256.0;

/// Most keys of a file, which take 24 MB.
const MAX_KEYS: usize = 1_000_000;

/// Grids start and end at multiples of so many voxels, so that grids derived from them at a coarser voxel share their nodes too.
const ALIGNMENT: f32 = 8.0;

/// Largest size of a later sample, in sizes of the first, which determines the voxel.
const MAX_GROWTH: f32 = 8.0;

/// Most nodes of a field, in nodes of a cube of the first sample's longest side with margins: a mesh may grow to four times its size along
/// each axis …
const MAX_CUBES: f64 = 64.0;

/// … and to so many nodes, 3.4 GB while they are sampled, or those of the cube if they are more.
const MAX_NODES: f64 = 1e8;

/// Volume below which a sample has collapsed, relative to that of the largest.
const COLLAPSED_VOLUME: f64 = 1e-3;

/// Why a mesh cannot move as its samples have it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(crate) enum DeformationError {
    /// The first sample has no extent, or one that is not finite.
    #[error("the first sample has no extent")]
    NoExtent,
    /// A vertex that jumps.
    #[error(
        "vertex {vertex} moves by {sizes:.2} sizes of the mesh from sample {sample} to the next, expected at most {limit:.2}"
    )]
    Jump {
        /// The sample before the jump, from 0.
        sample: usize,
        /// The vertex, from 0.
        vertex: usize,
        /// How far it moves, in longest sides of the first sample's box.
        sizes: f32,
        /// How far it may.
        limit: f32,
    },
    /// A sample far larger than the first.
    #[error("sample {sample} is {sizes:.1} times as large as the first, expected at most 8 times")]
    Grown {
        /// The sample, from 0.
        sample: usize,
        /// Its size, in longest sides of the first sample's box.
        sizes: f32,
    },
    /// A sample whose surface encloses next to nothing.
    #[error("sample {sample} encloses {part:.1e} of the largest sample's volume, expected at least 1e-3")]
    Collapsed {
        /// The sample, from 0.
        sample: usize,
        /// The volume of the sample over the largest.
        part: f64,
    },
    /// A field that would take too much memory.
    #[error(
        "the mesh between {time:.3} s and the samples next to it takes {nodes:.1e} nodes, expected at most {limit:.1e}: a lower \
         `resolution` has larger voxels, which are those of the first sample"
    )]
    TooLarge {
        /// Time of the field [s].
        time: f64,
        /// Nodes that it takes.
        nodes: f64,
        /// Nodes that it may have.
        limit: f64,
    },
    /// Motion that needs too many keys.
    #[error("the motion needs {keys} distance fields, expected at most 1000000")]
    TooLong {
        /// How many it needs.
        keys: usize,
    },
}

/// A moving mesh, in the units and axes of its file.
#[derive(Debug)]
pub(crate) struct Deformation {
    triangles: Vec<[u32; 3]>,
    /// Positions of the vertices in each sample, and the box around each.
    samples: Vec<Vec<Vec3>>,
    boxes: Vec<(Vec3, Vec3)>,
    /// Times of the samples, ascending [s].
    times: Vec<f64>,
    /// Farthest displacement of a vertex from each sample to the next.
    displacements: Vec<f32>,
    keys: Vec<Key>,
    voxel: f32,
    /// Where node (0, 0, 0) of all grids would be.
    origin: Vec3,
    /// The fields of the keys that were used last.
    recent: Mutex<Vec<(usize, Arc<Sampled>)>>,
}

/// A time at which the distance is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    time: f64,
    /// The sample before it, and the part of the time to the next one.
    sample: usize,
    part: f32,
}

/// Two keys and how far the time between them has passed, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KeyTime {
    pub(crate) keys: [usize; 2],
    pub(crate) part: f32,
}

impl PartialEq for Deformation {
    fn eq(&self, other: &Self) -> bool {
        let parts = |it: &Self| (it.voxel, it.origin);
        parts(self) == parts(other)
            && self.times == other.times
            && self.triangles == other.triangles
            && self.samples == other.samples
    }
}

impl Deformation {
    /// The motion of `mesh`, whose vertices are at `samples` at `times` [s], which ascend. The first sample's longest side has
    /// `resolution` voxels.
    ///
    /// # Errors
    /// [`DeformationError`] if the motion is not continuous, or a sample has no inside.
    ///
    /// # Panics
    /// Without a sample, or if samples, times and vertices are not of one number.
    pub(crate) fn new(
        triangles: Vec<[u32; 3]>,
        samples: Vec<Vec<Vec3>>,
        times: Vec<f64>,
        resolution: u32,
    ) -> Result<Self, DeformationError> {
        assert!(!samples.is_empty() && samples.len() == times.len(), "a time for each sample");
        let boxes: Vec<(Vec3, Vec3)> =
            samples.iter().map(|x| sdf::bounds(&triangles, x).unwrap_or_default()).collect();
        let side = |(low, high): (Vec3, Vec3)| (high - low).amax();
        let size = side(boxes[0]);
        let voxel = size / resolution as f32;
        if !(voxel.is_finite() && voxel > 0.0) {
            return Err(DeformationError::NoExtent);
        }
        let sizes = |length: f32| length / size;
        if let Some(sample) = boxes.iter().position(|&all| sizes(side(all)) > MAX_GROWTH) {
            return Err(DeformationError::Grown { sample, sizes: sizes(side(boxes[sample])) });
        }
        let forest = par::Forest::new(samples[0].len());
        triangles.iter().for_each(|&[a, b, c]| [b, c].into_iter().for_each(|other| forest.join(a, other)));
        let components = forest.roots();
        let volumes: Vec<f64> = samples.iter().map(|x| volume(&triangles, &components, x)).collect();
        let largest = volumes.iter().copied().fold(0.0, f64::max);
        let collapsed = |&volume: &f64| volume < COLLAPSED_VOLUME * largest || largest == 0.0;
        if let Some(sample) = volumes.iter().position(collapsed) {
            return Err(DeformationError::Collapsed {
                sample,
                part: volumes[sample] / largest.max(f64::MIN_POSITIVE),
            });
        }

        let (mut keys, mut displacements, mut count) = (Vec::new(), Vec::new(), 1);
        for (sample, pair) in samples.windows(2).enumerate() {
            let (vertex, farthest) = farthest(&pair[0], &pair[1]);
            let parts = (farthest / (KEY_DISPLACEMENT * voxel)).ceil();
            if parts.is_nan() || parts > MAX_KEYS_BETWEEN_SAMPLES {
                let limit = sizes(MAX_KEYS_BETWEEN_SAMPLES * KEY_DISPLACEMENT * voxel);
                return Err(DeformationError::Jump { sample, vertex, sizes: sizes(farthest), limit });
            }
            let parts = parts.max(1.0);
            displacements.push(farthest);
            count += parts as usize;
            if count > MAX_KEYS {
                continue;
            }
            keys.extend((0..parts as u32).map(|k| {
                let part = k as f32 / parts;
                Key {
                    time: times[sample] + f64::from(part) * (times[sample + 1] - times[sample]),
                    sample,
                    part,
                }
            }));
        }
        if count > MAX_KEYS {
            return Err(DeformationError::TooLong { keys: count });
        }
        let last = samples.len() - 1;
        keys.push(Key { time: times[last], sample: last, part: 0.0 });
        let origin = boxes[0].0;
        let recent = Mutex::default();
        let made = Self { triangles, samples, boxes, times, displacements, keys, voxel, origin, recent };
        // Counted as floating-point numbers before any memory is taken.
        let side = f64::from(resolution) + 2.0 * f64::from(MARGIN_NODES) + 2.0 * f64::from(ALIGNMENT);
        let limit = (MAX_CUBES * side.powi(3)).min(MAX_NODES).max(side.powi(3));
        for (key, &Key { time, .. }) in made.keys.iter().enumerate() {
            let nodes = made.grid(key).nodes.iter().map(|&n| f64::from(n)).product::<f64>();
            if nodes > limit {
                return Err(DeformationError::TooLarge { time, nodes, limit });
            }
        }
        Ok(made)
    }

    /// Number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.samples[0].len()
    }

    /// The triangles, which are the same in all samples.
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Velocities of the vertices [1/s]: the mean over a `half_interval` [s] before `time` and after.
    pub(crate) fn velocities(&self, time: f64, half_interval: f64) -> Vec<Vec3> {
        let mut velocities = vec![Vec3::zeros(); self.vertices()];
        for (times, samples) in self.times.windows(2).zip(self.samples.windows(2)) {
            let common = (time + half_interval).min(times[1]) - (time - half_interval).max(times[0]);
            if common > 0.0 {
                let factor = (common / (2.0 * half_interval * (times[1] - times[0]))) as f32;
                let moved = samples[0].iter().zip(&samples[1]).map(|(a, b)| (b - a) * factor);
                velocities.iter_mut().zip(moved).for_each(|(v, by)| *v += by);
            }
        }
        velocities
    }

    /// The time at which the area of the triangles is largest [s], of those of the samples.
    pub(crate) fn time_of_largest_area(&self) -> f64 {
        let area = |positions: &Vec<Vec3>| -> f64 {
            let of = |triangle: &[u32; 3]| {
                let [a, b, c] = triangle.map(|corner| positions[corner as usize].cast::<f64>());
                (b - a).cross(&(c - a)).norm()
            };
            self.triangles.iter().map(of).sum()
        };
        let areas = self.samples.iter().map(area).zip(&self.times);
        areas
            .fold((0.0, self.times[0]), |best, (area, &time)| if area > best.0 { (area, time) } else { best })
            .1
    }

    /// First and last time at which vertices are given [s].
    pub(crate) fn time_span(&self) -> (f64, f64) {
        (self.times[0], self.times[self.times.len() - 1])
    }

    /// Positions of the vertices at `time` [s].
    pub(crate) fn positions(&self, time: f64) -> Vec<Vec3> {
        let after = self.times.partition_point(|&of| of <= time);
        let (Some(sample), true) = (after.checked_sub(1), after < self.times.len()) else {
            return self.samples[after.saturating_sub(1)].clone();
        };
        let part = (time - self.times[sample]) / (self.times[after] - self.times[sample]);
        self.between(sample, part as f32)
    }

    /// Lowest and highest corner of a box that contains the mesh at all times.
    pub(crate) fn bounds(&self) -> (Vec3, Vec3) {
        self.boxes.iter().copied().reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1))).unwrap_or_default()
    }

    /// Largest speed of a vertex between two times [1/s].
    pub(crate) fn fastest(&self, from: f64, to: f64) -> f64 {
        let pairs = self.times.windows(2).zip(&self.displacements);
        let reached = pairs.filter(|(times, _)| times[0] < to && from < times[1]);
        reached.map(|(times, &by)| f64::from(by) / (times[1] - times[0])).fold(0.0, f64::max)
    }

    /// The keys around a time [s].
    pub(crate) fn key_time(&self, time: f64) -> KeyTime {
        let after = self.keys.partition_point(|key| key.time <= time);
        let (Some(before), true) = (after.checked_sub(1), after < self.keys.len()) else {
            let key = after.saturating_sub(1);
            return KeyTime { keys: [key, key], part: 0.0 };
        };
        let [a, b] = [self.keys[before].time, self.keys[after].time];
        KeyTime { keys: [before, after], part: ((time - a) / (b - a)) as f32 }
    }

    /// The distance at a key.
    pub(crate) fn field(&self, key: usize) -> Arc<Sampled> {
        let recent = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, field)) = recent().iter().find(|(of, _)| *of == key) {
            return field.clone();
        }
        // Without the lock: a thread that waits for the field's parts may take over work that needs the lock.
        let Key { sample, part, .. } = self.keys[key];
        let mesh = Triangles { positions: self.between(sample, part), triangles: self.triangles.clone() };
        let made = Arc::new(sdf::on_grid(&mesh, self.grid(key)).field);
        let mut recent = recent();
        recent.retain(|(of, _)| of.abs_diff(key) == 1);
        recent.push((key, made.clone()));
        made
    }

    /// The mesh of the first sample.
    pub(crate) fn first_mesh(&self) -> Triangles {
        Triangles { positions: self.samples[0].clone(), triangles: self.triangles.clone() }
    }

    /// The largest number of nodes of a field.
    pub(crate) fn max_nodes(&self) -> usize {
        (0..self.keys.len()).map(|key| self.grid(key).count()).max().unwrap_or(0)
    }

    /// Memory of its vertices and keys [bytes].
    pub(crate) fn memory(&self) -> f64 {
        let (vertex, key) = (size_of::<Vec3>() as f64, size_of::<Key>() as f64);
        vertex * (self.samples.len() * self.vertices()) as f64 + key * self.keys.len() as f64
    }

    /// The grid of a key's field.
    fn grid(&self, key: usize) -> SampledGrid {
        let near = key.saturating_sub(1)..(key + 2).min(self.keys.len());
        let boxes = self.keys[near].iter().map(|&Key { sample, part, .. }| self.bounds_between(sample, part));
        let (low, high) = boxes.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1))).unwrap_or_default();
        let margin = MARGIN_NODES as f32;
        let place = |x: f32, axis: usize| f64::from((x - self.origin[axis]) / self.voxel);
        let align = f64::from(ALIGNMENT);
        let first = Vec3::from_fn(|axis, _| {
            (((place(low[axis], axis) - f64::from(margin)) / align).floor() * align) as f32
        });
        let nodes = std::array::from_fn(|axis| {
            let cells = place(high[axis], axis) + f64::from(margin) - f64::from(first[axis]);
            ((cells / align).ceil() * align) as u32 + 1
        });
        SampledGrid { origin: self.origin + first * self.voxel, voxel: self.voxel, nodes }
    }

    /// A box that contains the mesh between two samples: interpolated corners contain interpolated vertices.
    fn bounds_between(&self, sample: usize, part: f32) -> (Vec3, Vec3) {
        let (low, high) = self.boxes[sample];
        if part == 0.0 {
            return (low, high);
        }
        let (next_low, next_high) = self.boxes[sample + 1];
        (low + (next_low - low) * part, high + (next_high - high) * part)
    }

    /// Positions of the vertices a part of the time after a sample.
    fn between(&self, sample: usize, part: f32) -> Vec<Vec3> {
        if part == 0.0 {
            return self.samples[sample].clone();
        }
        let [a, b] = [&self.samples[sample], &self.samples[sample + 1]];
        a.iter().zip(b).map(|(a, b)| a + (b - a) * part).collect()
    }
}

/// Volume that a mesh encloses: the sum over its connected components, each of which may be seen from inside.
fn volume(triangles: &[[u32; 3]], components: &[u32], positions: &[Vec3]) -> f64 {
    let mut volumes = vec![0.0; positions.len()];
    for triangle in triangles {
        let corners = triangle.map(|corner| positions[corner as usize]);
        volumes[components[triangle[0] as usize] as usize] += sdf::volume_below(corners, positions[0]);
    }
    volumes.iter().map(|volume| volume.abs()).sum()
}

/// The vertex that moves farthest, and how far.
fn farthest(from: &[Vec3], to: &[Vec3]) -> (usize, f32) {
    let moves = from.iter().zip(to).map(|(a, b)| (b - a).norm()).enumerate();
    moves.fold((0, 0.0), |most, (vertex, by)| if by > most.1 || by.is_nan() { (vertex, by) } else { most })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of side 1 at the origin, moved and scaled.
    fn block(shift: Vec3, scale: f32) -> Vec<Vec3> {
        let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
        (0..8).map(|i| Vec3::from_fn(|axis, _| corner(i, axis)) * scale + shift).collect()
    }

    fn faces() -> Vec<[u32; 3]> {
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
    }

    fn moved(samples: Vec<Vec<Vec3>>) -> Result<Deformation, DeformationError> {
        let times = (0..samples.len()).map(|k| 0.5 * k as f64).collect();
        Deformation::new(faces(), samples, times, 16)
    }

    /// Distance at a time, as shapes have it.
    fn distance(of: &Deformation, x: Vec3, time: f64) -> f32 {
        let KeyTime { keys, part } = of.key_time(time);
        let [a, b] = keys.map(|key| of.field(key).sample(x).0);
        a + (b - a) * part
    }

    #[test]
    fn distances_follow_the_mesh_between_its_samples() {
        // 0.6 in half a second are 9.6 voxels: five keys.
        let of = moved(vec![block(Vec3::zeros(), 1.0), block(Vec3::x() * 0.6, 1.0)]).unwrap();
        assert_eq!(of.keys.len(), 6);
        for step in 0..=20 {
            let time = 0.025 * f64::from(step);
            let face = 0.5 + 1.2 * time as f32;
            for beyond in [-0.2, -0.05, 0.0, 0.1, 0.2] {
                let found = distance(&of, Vec3::new(face + beyond, 0.1, -0.2), time);
                assert!((found - beyond).abs() < 0.02, "{time} s: {found} instead of {beyond}");
            }
            assert!((of.positions(time)[1].x - face).abs() < 1e-6);
        }
        // Before the first sample and after the last it is at rest.
        assert_eq!(distance(&of, Vec3::x(), -1.0), distance(&of, Vec3::x(), 0.0));
        assert_eq!(of.positions(9.0), block(Vec3::x() * 0.6, 1.0));
        assert!((of.fastest(0.1, 0.2) - 1.2).abs() < 1e-6);
        assert_eq!(of.fastest(0.5, 2.0), 0.0);
        let (low, high) = of.bounds();
        assert!((low - Vec3::repeat(-0.5)).norm() < 1e-6 && (high - Vec3::new(1.1, 0.5, 0.5)).norm() < 1e-6);
    }

    #[test]
    fn what_rests_keeps_its_distances_to_the_bit() {
        // One end of the bar moves; the grids of the keys differ, the nodes near the other end do not.
        let mut bent = block(Vec3::zeros(), 1.0);
        bent[7].x += 0.9;
        let of = moved(vec![block(Vec3::zeros(), 1.0), bent]).unwrap();
        let x = Vec3::new(-0.53, 0.02, 0.07);
        let first = distance(&of, x, 0.0);
        for step in 1..10 {
            assert_eq!(distance(&of, x, 0.05 * f64::from(step)), first);
        }
    }

    #[test]
    fn thin_parts_that_move_farther_than_their_thickness_stay_solid() {
        let plate = |shift: f32| -> Vec<Vec3> {
            block(Vec3::zeros(), 1.0).iter().map(|x| Vec3::new(0.2 * x.x + shift, x.y, x.z)).collect()
        };
        let of = moved(vec![plate(0.0), plate(1.0)]).unwrap();
        let depth = (0..=100).map(|step| {
            let time = 0.005 * f64::from(step);
            distance(&of, Vec3::new(2.0 * time as f32, 0.0, 0.0), time)
        });
        let shallowest = depth.fold(f32::NEG_INFINITY, f32::max);
        assert!(shallowest < -0.03, "half of the thickness is 0.1, found {shallowest}");
    }

    #[test]
    fn motion_that_cannot_be_followed_is_refused() {
        let still = block(Vec3::zeros(), 1.0);
        let refused = |samples: Vec<Vec<Vec3>>| moved(samples).unwrap_err().to_string();
        let mut jumped = still.clone();
        jumped[5].y += 40.0;
        let grown = refused(vec![still.clone(), jumped]);
        assert!(grown.contains("sample 1 is 40.0 times as large"), "{grown}");
        let jump = refused(vec![still.clone(), block(Vec3::x() * 33.0, 1.0)]);
        assert!(jump.contains("moves by 33.00 sizes of the mesh from sample 0"), "{jump}");
        let flat: Vec<Vec3> = still.iter().map(|x| Vec3::new(x.x, x.y, 0.0)).collect();
        assert!(refused(vec![still.clone(), flat.clone()]).contains("sample 1 encloses"));
        assert!(refused(vec![flat]).contains("sample 0 encloses"));
        assert!(refused(vec![vec![Vec3::zeros(); 8]]).contains("no extent"));
        // A second box that is seen from inside does not cancel the first.
        let two: Vec<Vec3> = [block(Vec3::zeros(), 1.0), block(Vec3::x() * 2.0, 1.0)].concat();
        let flipped = faces().into_iter().map(|[a, b, c]| [a + 8, c + 8, b + 8]);
        let both = faces().into_iter().chain(flipped).collect();
        assert!(Deformation::new(both, vec![two.clone(), two], vec![0.0, 1.0], 16).is_ok());
        // Within eight sizes, and more nodes than memory should be taken for; they are counted only.
        let samples = vec![still.clone(), block(Vec3::zeros(), 3.5), block(Vec3::zeros(), 7.5)];
        let large = Deformation::new(faces(), samples, vec![0.0, 1.0, 2.0], 128).unwrap_err().to_string();
        assert!(large.contains("e8 nodes, expected at most 1.0e8"), "{large}");
        let mut lost = still.clone();
        lost[2].z = f32::NAN;
        assert!(moved(vec![still, lost]).is_err());
    }

    #[test]
    fn equal_files_are_equal_whatever_was_sampled() {
        let make = || moved(vec![block(Vec3::zeros(), 1.0), block(Vec3::x(), 1.0)]).unwrap();
        let (a, b) = (make(), make());
        a.field(3);
        assert_eq!(a, b);
        assert!(a.max_nodes() >= a.field(3).values.len());
        assert_ne!(a, moved(vec![block(Vec3::zeros(), 1.0)]).unwrap());
    }
}
