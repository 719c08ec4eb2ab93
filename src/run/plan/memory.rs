//! How much memory a shot needs: every constant of the model, in one place.
//!
//! *Method*: peaks of resident memory of whole runs, by particles, bricks, vertices and the samples of solids. Tests
//! compare the model with the peak of a real run, and its bound with those of every built-in preset and tier.

use crate::{
    grid::{BRICK, Bricks},
    math::Vec3,
    mesh::SurfaceParams,
    par,
    scene::Scene,
    sim::liquid::SourceShape,
    solid::{MeshShape, Shape},
};
use std::{collections::BTreeMap, ops::Range};

/// The program, its threads and the frame being packed: 6 to 7 MiB before there is a particle, 9 MiB with them.
const BASE: f64 = 10e6;

/// Memory of the simulation, a particle, at `kernel_radius` 2 and the densest state of a shot. Less would let a farm
/// kill the job, more refuses a shot that would have run. Shots of 30 000 to 130 000 particles are met within 7 %; five
/// million took 380.
const PARTICLE: f64 = 480.0;

/// The part of it that the neighbour lists take: it grows with the volume of the kernel.
const LISTS: f64 = 230.0;

/// The bound of the simulation over its estimate: what was measured lies up to 6 % above that.
const MARGIN: f64 = 1.1;

/// Memory of surfacing, a brick of the density: its nodes and those of the distance. With the other constants, peaks of
/// seven shots are told from 4 % below to 19 % above what they are; larger ones are met better.
const BRICK_BYTES: f64 = 9000.0;

/// Memory of surfacing, a vertex of the mesh, its triangles included.
const VERTEX: f64 = 88.0;

/// Vertices a brick where nobody has counted them: dam breaks have 34 to 51. Liquid poured over a figure has 95, on fewer
/// bricks a particle, so that the bound by particles holds for it too.
const VERTICES: f64 = 40.0;

/// The part of the simulation's peak that the process still holds while it makes surfaces: the allocator keeps freed
/// memory. Over seven shots it was 0 to 0.4.
const KEPT: f64 = 0.4;

/// The same for the bound: 0.8 was seen once.
const KEPT_AT_MOST: f64 = 0.8;

/// Memory of surfacing, a particle: the frame, its weights and bins.
const SURFACED: f64 = 150.0;

/// Memory of making every grid of a volume, a brick of the density: nodes of density, distance and velocity, and the
/// bytes of the file. 17 800 were measured (32 768 particles at voxel 0.5, floats, not packed).
const VOLUME_BRICK: f64 = 20000.0;

/// Memory of sampling a mesh, a node, while it is made: 26 to 28 were measured on four meshes.
const SAMPLING: f64 = 28.0;

/// Memory of a mesh's samples, a node.
const FIELD: f64 = 4.0;

/// Memory of what a collider displaces, a node of its samples: a second field, on a grid wider by the kernel.
const DISPLACED: f64 = 6.0;

/// What sampled meshes take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solids {
    /// While they are sampled, before there is a particle [bytes].
    making: f64,
    /// During the simulation [bytes].
    held: f64,
}

impl Solids {
    /// Of a scene whose meshes are filled.
    pub(super) fn of(scene: &Scene) -> Self {
        let colliders = scene.world.collider.iter().filter_map(|collider| match &collider.shape {
            Shape::Mesh(mesh) => Some(mesh),
            _ => None,
        });
        let sources = scene.liquid.iter().flat_map(|liquid| &liquid.source);
        let sources = sources.filter_map(|source| match &source.shape {
            SourceShape::Mesh(mesh) => Some(mesh),
            _ => None,
        });
        let nodes = |mesh: &MeshShape| mesh.samples().values.len();
        let colliding: usize = colliders.clone().map(nodes).sum();
        // Shapes of one file share their samples.
        let fields: BTreeMap<_, usize> =
            colliders.chain(sources).map(|mesh| ((&mesh.file, mesh.resolution), nodes(mesh))).collect();
        Self::with(&fields.into_values().collect::<Vec<_>>(), colliding)
    }

    /// Of fields with so many nodes each, and as many in all of those that are colliders.
    fn with(fields: &[usize], colliding: usize) -> Self {
        let all = fields.iter().sum::<usize>() as f64;
        let largest = fields.iter().copied().max().unwrap_or(0) as f64;
        Self {
            making: FIELD * (all - largest) + SAMPLING * largest,
            held: FIELD * all + DISPLACED * colliding as f64,
        }
    }
}

/// What surfacing works on in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Grids {
    /// Bricks of the density.
    pub(super) bricks: f64,
    /// Vertices of the mesh.
    pub(super) vertices: f64,
}

impl Grids {
    /// So many bricks, of whose vertices nothing is known.
    pub(super) fn of_bricks(bricks: f64) -> Self {
        Self { bricks, vertices: bricks * VERTICES }
    }

    /// The most that `particles` cover at a voxel of `voxel` [spacings], before anything is known of how they lie:
    /// 0.12 bricks a particle at voxel 0.5 when the liquid is most spread (`double-dam-break`; the other presets have 0.06
    /// to 0.09).
    pub(super) fn at_most(particles: usize, voxel: f32) -> Self {
        Self::of_bricks(particles as f64 * SPREAD / f64::from(voxel).powf(2.3))
    }
}

/// What is known of a shot that is to be simulated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) particles: usize,
    /// [spacings]
    pub(super) kernel_radius: f32,
    pub(super) solids: Solids,
    /// Of the largest frame; `None`: nothing but the particles is known, and the answers are bounds.
    pub(super) grids: Option<Grids>,
    /// [spacings]
    pub(super) voxel: f32,
}

impl Known {
    /// Peak memory of simulating [bytes].
    pub(super) fn simulation(&self) -> u64 {
        let lists = LISTS * (f64::from(self.kernel_radius) / 2.0).powi(3);
        let particles = self.particles as f64 * (PARTICLE - LISTS + lists);
        let margin = if self.grids.is_some() { 1.0 } else { MARGIN };
        (margin * (BASE + self.solids.making.max(self.solids.held + particles))) as u64
    }

    /// Peak memory of surfacing after that, in the same process [bytes].
    pub(super) fn surfaces(&self) -> u64 {
        surface(self.particles, self.grids()) + self.kept()
    }

    /// Peak memory of making volumes after that [bytes].
    pub(super) fn volumes(&self) -> u64 {
        volume(self.particles, self.grids()) + self.kept()
    }

    fn grids(&self) -> Grids {
        self.grids.unwrap_or_else(|| Grids::at_most(self.particles, self.voxel))
    }

    fn kept(&self) -> u64 {
        let part = if self.grids.is_some() { KEPT } else { KEPT_AT_MOST };
        (part * (self.simulation() as f64 - BASE)) as u64
    }
}

/// Peak memory of surfacing `particles` [bytes].
pub(super) fn surface(particles: usize, grids: Grids) -> u64 {
    let mesh = grids.bricks * BRICK_BYTES + grids.vertices * VERTEX;
    (BASE + particles as f64 * SURFACED + mesh) as u64
}

/// Peak memory of making volumes of `particles` [bytes].
pub(super) fn volume(particles: usize, grids: Grids) -> u64 {
    (BASE + particles as f64 * SURFACED + grids.bricks * VOLUME_BRICK) as u64
}

/// The bricks of the density of particles at `positions` [m], at most: every brick that the box around a kernel meets.
pub(super) fn bricks_around(positions: &[Vec3], spacing: f32, params: &SurfaceParams) -> usize {
    let voxel = params.voxel * spacing;
    let reach = params.kernel_radius * spacing;
    // The first and the last node of each axis that a kernel reaches, and their bricks.
    let first = |v: f32| ((v - reach) / voxel).ceil() as i32;
    let last = |v: f32| ((v + reach) / voxel).floor() as i32;
    let brick = |node: i32| node.div_euclid(BRICK as i32);
    let of_chunk = |range: Range<usize>| {
        let bounds = positions[range]
            .iter()
            .map(|x| [0, 1, 2].map(|axis| (brick(first(x[axis])), brick(last(x[axis])))));
        let mut bounds: Vec<[(i32, i32); 3]> = bounds.collect();
        bounds.sort_unstable();
        bounds.dedup();
        let (mut bricks, mut full) = (Vec::new(), LIST);
        for [x, y, z] in bounds {
            for k in z.0..=z.1 {
                for j in y.0..=y.1 {
                    bricks.extend((x.0..=x.1).map(|i| [i, j, k]));
                }
            }
            // The widest kernels of particles side by side meet the same bricks.
            if bricks.len() > full {
                bricks.sort_unstable();
                bricks.dedup();
                full = bricks.len().max(LIST) + LIST;
            }
        }
        bricks.sort_unstable();
        bricks.dedup();
        bricks
    };
    Bricks::new(par::map_chunks(positions.len(), CHUNK, of_chunk).concat()).len()
}

/// Particles whose bricks are sought together. Larger, and fewer threads have work; smaller, and a brick is found by more
/// chunks.
const CHUNK: usize = 4096;

/// Bricks that are listed before doubles are taken out. Larger, and the list takes more memory than it is to tell of;
/// smaller, and it is sorted more often.
const LIST: usize = 1 << 20;

/// Bricks a particle at a voxel of one spacing. The power 2.3 lies between that of a surface and that of a volume:
/// bricks follow the surface, the samples in them the volume. Smaller, and a splash takes more than it was told to be the
/// most; larger, and more shots calibrate before they start, and fewer frames are meshed at once.
const SPREAD: f64 = 0.0236;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{DensityParams, density};

    #[test]
    fn bricks_are_counted_before_they_are_made() {
        let spacing = 0.1;
        let lattice = |n: i32, apart: f32| -> Vec<Vec3> {
            let point = |i: i32| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * apart;
            (0..n * n * n).map(point).collect()
        };
        for (positions, voxel) in
            [(lattice(20, 0.1), 0.5), (lattice(20, 0.1), 0.2), (lattice(12, 1.37), 0.5), (Vec::new(), 0.5)]
        {
            let params = SurfaceParams { voxel, ..SurfaceParams::default() };
            let kernel_radius = params.kernel_radius;
            let made = density(
                &positions,
                &DensityParams { spacing, kernel_radius, voxel, anisotropy: None, whole: true },
            )
            .grid
            .bricks
            .len();
            let counted = bricks_around(&positions, spacing, &params);
            assert!(made <= counted && counted <= made * 5 / 4, "{counted} counted, {made} made");
        }
    }

    /// Nodes of the meshes of the built-in presets: samples, and how many of them collide.
    const NONE: (&[usize], usize) = (&[], 0);
    const ROCK: (&[usize], usize) = (&[336_895], 336_895);
    const BEAR: (&[usize], usize) = (&[906_360], 0);
    const RABBIT: (&[usize], usize) = (&[512_400], 0);
    const DUCK: (&[usize], usize) = (&[1_343_148], 1_343_148);

    /// A shot of a built-in preset with `kernel_radius` 2 and voxel 0.5.
    fn shot((fields, colliding): (&[usize], usize), particles: usize, grids: Option<Grids>) -> Known {
        let solids = Solids::with(fields, colliding);
        Known { particles, kernel_radius: 2.0, solids, grids, voxel: 0.5 }
    }

    fn mib(bytes: u64) -> f64 {
        bytes as f64 / f64::from(1 << 20)
    }

    #[test]
    fn the_bound_covers_every_preset_in_every_tier() {
        // Particles, and the peaks of `meniscus shot` [MiB], by tools/bench/gallery.py.
        for (solids, rows) in [
            (NONE, [(8_000, 18.0), (32_768, 42.0), (103_823, 101.0)]),
            (NONE, [(10_240, 25.0), (34_560, 55.0), (116_640, 153.0)]),
            (NONE, [(8_912, 18.0), (30_088, 33.0), (101_792, 92.0)]),
            (ROCK, [(6_721, 17.0), (22_649, 29.0), (54_460, 48.0)]),
            (BEAR, [(11_512, 31.0), (36_722, 51.0), (128_791, 155.0)]),
            (RABBIT, [(9_984, 21.0), (33_671, 36.0), (79_872, 74.0)]),
            (DUCK, [(10_896, 43.0), (36_865, 62.0), (127_493, 204.0)]),
        ] {
            for (particles, found) in rows {
                let known = shot(solids, particles, None);
                let told = mib(known.simulation().max(known.surfaces()));
                println!("{particles} particles: at most {told:.0} MiB, found {found}");
                assert!((1.0..2.5).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
            }
        }
        // The same of `meniscus simulate`.
        for (solids, particles, found) in [
            (NONE, 8_000, 13.2),
            (NONE, 32_768, 25.5),
            (NONE, 103_823, 55.0),
            (NONE, 10_240, 14.4),
            (NONE, 34_560, 26.9),
            (NONE, 116_640, 63.2),
            (NONE, 8_912, 14.0),
            (ROCK, 6_721, 17.8),
            (BEAR, 11_512, 33.0),
            (BEAR, 36_722, 32.8),
            (BEAR, 128_791, 74.1),
            (RABBIT, 9_984, 22.2),
            (DUCK, 10_896, 44.7),
            (DUCK, 36_865, 44.8),
            (DUCK, 127_493, 80.6),
        ] {
            let told = mib(shot(solids, particles, None).simulation());
            assert!((1.0..1.3).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
        }
    }

    #[test]
    fn what_was_counted_gives_the_peaks_that_were_found() {
        // Particles, bricks and vertices of the largest frame, and the peaks of `meniscus shot` [MiB].
        for (solids, particles, bricks, vertices, found) in [
            (NONE, 32_768, 2_102.0, 106_742.0, 42.0),
            (NONE, 34_560, 3_855.0, 132_638.0, 55.0),
            (NONE, 116_640, 9_424.0, 358_022.0, 153.0),
            (BEAR, 36_722, 2_700.0, 122_472.0, 51.0),
            (BEAR, 128_791, 8_509.0, 341_270.0, 155.0),
            (DUCK, 36_865, 2_362.0, 223_490.0, 62.0),
            (DUCK, 127_493, 8_650.0, 798_454.0, 204.0),
        ] {
            let known = shot(solids, particles, Some(Grids { bricks, vertices }));
            let told = mib(known.simulation().max(known.surfaces()));
            println!("{particles} particles: {told:.0} MiB, found {found}");
            assert!((0.9..1.2).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
        }
    }

    #[test]
    fn meshes_in_the_scene_are_counted_once_a_file_and_displace_once_a_collider() {
        let one = Solids::with(&[1000], 0);
        let two = Solids::with(&[1000, 500], 2000);
        assert_eq!((one.making, one.held), (28_000.0, 4_000.0));
        assert_eq!((two.making, two.held), (30_000.0, 18_000.0));
    }
}
