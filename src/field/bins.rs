//! Particles sorted by the brick of nodes that they lie in.

use crate::grid::{BRICK, Bricks, MAX_BRICK};
use crate::{math::Vec3, par};

/// A particle as its brick sees it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Local {
    /// Its position from the brick's first node [voxels], 0 to 8.
    pub(super) position: [f32; 3],
    /// Its index in the list given.
    pub(super) index: u32,
}

/// Particles by brick. The order inside a brick is that of the list given.
pub(super) struct Bins {
    /// The bricks that hold particles.
    pub(super) bricks: Bricks,
    /// `particles[start[b]..start[b + 1]]` lie in brick `b`.
    start: Vec<usize>,
    particles: Vec<Local>,
    /// Particles further out than bricks can be numbered, which are in no bin.
    pub(super) too_far: usize,
}

impl Bins {
    pub(super) fn new(positions: &[Vec3], voxel: f32) -> Self {
        // Brick and place in it, found in double precision: a particle far out keeps all of its own digits.
        let mut keyed = vec![([0; 3], Local::default()); positions.len()];
        par::fill(&mut keyed, |i| {
            let nodes = [0, 1, 2].map(|axis| f64::from(positions[i][axis]) / f64::from(voxel));
            let brick = nodes.map(|v| (v / BRICK as f64).floor());
            let local = [0, 1, 2].map(|axis| (nodes[axis] - brick[axis] * BRICK as f64) as f32);
            (brick.map(|v| v as i32), Local { position: local, index: i as u32 })
        });
        let before = keyed.len();
        let near = |v: i32| v.unsigned_abs() <= MAX_BRICK as u32;
        keyed.retain(|(brick, _)| brick.iter().all(|&v| near(v)));
        let too_far = before - keyed.len();

        // One bin for every run of equal bricks.
        par::sort_by_key(&mut keyed, |(brick, local)| ([brick[2], brick[1], brick[0]], local.index));
        let mut coords: Vec<[i32; 3]> = Vec::new();
        let mut start = Vec::new();
        for (place, (brick, _)) in keyed.iter().enumerate() {
            if coords.last() != Some(brick) {
                coords.push(*brick);
                start.push(place);
            }
        }
        start.push(keyed.len());
        let particles = keyed.into_iter().map(|(_, local)| local).collect();
        Self { bricks: Bricks::new(coords), start, particles, too_far }
    }

    /// The particles in a bin.
    pub(super) fn particles(&self, bin: usize) -> &[Local] {
        &self.particles[self.start[bin]..self.start[bin + 1]]
    }

    /// Every brick with a node closer than `reach` [voxels] along each axis to the box around a bin's particles.
    pub(super) fn within(&self, reach: f32) -> Bricks {
        let coords = par::map_chunks(self.bricks.len(), 64, |range| {
            let mut covered = Vec::new();
            for bin in range {
                let coord = self.bricks.coords()[bin];
                let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
                for particle in self.particles(bin) {
                    for axis in 0..3 {
                        low[axis] = low[axis].min(particle.position[axis]);
                        high[axis] = high[axis].max(particle.position[axis]);
                    }
                }
                let brick = |v: f32| (v as i32).div_euclid(BRICK as i32);
                let first = low.map(|v| brick((v - reach).ceil()));
                let last = high.map(|v| brick((v + reach).floor()));
                for z in first[2]..=last[2] {
                    for y in first[1]..=last[1] {
                        covered
                            .extend((first[0]..=last[0]).map(|x| [coord[0] + x, coord[1] + y, coord[2] + z]));
                    }
                }
            }
            // Neighbouring bins cover mostly the same bricks: on a fine grid the list would outgrow the grid.
            covered.sort_unstable();
            covered.dedup();
            covered
        });
        Bricks::new(coords.concat())
    }
}
