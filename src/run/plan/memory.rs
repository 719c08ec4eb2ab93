//! How much memory a shot needs: every constant of the model, in one place.
//!
//! *Method*: peaks of resident memory of whole runs, by particles, bricks, vertices and the samples of solids. Tests
//! compare the model with the peak of a real run, and its bound with those of every built-in preset and tier.

use crate::{
    job::memory::{BASE_MEMORY, Grids},
    mesh::SurfaceParams,
    product::{surface::surface_memory, volume::particle_volume_memory},
    scene::Scene,
    solid::{MeshShape, Shape},
};
use std::collections::BTreeMap;

/// Memory of the simulation, a particle, at `kernel_radius` 2 and the densest state of a shot. Less would let a farm
/// kill the job, more refuses a shot that would have run. Shots of 30 000 to 130 000 particles are met within 7 %; five
/// million took 380.
const PARTICLE: f64 = 480.0;

/// The part of it that the neighbour lists take: it grows with the volume of the kernel.
const LISTS: f64 = 230.0;

/// The bound of the simulation over its estimate: what was measured lies up to 6 % above that.
const MARGIN: f64 = 1.1;

/// The part of the simulation's peak that the process still holds while it makes surfaces: the allocator keeps freed
/// memory, and the longer the sequence, the more. Over seven shots it was 0.2 to 0.6, and 1.2 in one.
const KEPT: f64 = 0.6;

/// The same for the bound.
const KEPT_AT_MOST: f64 = 1.2;

/// Memory of sampling a mesh, a node, while it is made: 26 to 36 were measured on four meshes.
const SAMPLING: f64 = 34.0;

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
            Shape::Mesh(mesh) => Some(mesh),
            _ => None,
        });
        let smoke = scene.smoke.iter().flat_map(|smoke| smoke.shapes());
        let smoke = smoke.filter_map(|(_, shape)| match shape {
            Shape::Mesh(mesh) => Some(mesh),
            _ => None,
        });
        let sources = sources.chain(smoke);
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

/// What is known of a shot that is to be simulated.
#[derive(Clone, Debug)]
pub(super) struct Known<'a> {
    pub(super) particles: usize,
    /// [spacings]
    pub(super) kernel_radius: f32,
    pub(super) solids: Solids,
    /// Of the largest frame; `None`: nothing but the particles is known, and the answers are bounds.
    pub(super) grids: Option<Grids>,
    pub(super) surface: &'a SurfaceParams,
}

impl Known<'_> {
    /// Peak memory of simulating [bytes].
    pub(super) fn simulation(&self) -> u64 {
        let lists = LISTS * (f64::from(self.kernel_radius) / 2.0).powi(3);
        let particles = self.particles as f64 * (PARTICLE - LISTS + lists);
        let margin = if self.grids.is_some() { 1.0 } else { MARGIN };
        (margin * (BASE_MEMORY + self.solids.making.max(self.solids.held + particles))) as u64
    }

    /// Peak memory of surfacing after that, in the same process [bytes].
    pub(super) fn surfaces(&self) -> u64 {
        surface_memory(self.particles, self.grids(), self.surface) + self.kept()
    }

    /// Peak memory of making volumes after that [bytes].
    pub(super) fn volumes(&self) -> u64 {
        let voxel = self.surface.voxel;
        // Nobody counts bricks where a shot makes no meshes.
        let counted = self.grids.filter(|grids| grids.bricks > 0.0);
        let near = counted.unwrap_or_else(|| Grids::at_most(self.particles, voxel));
        particle_volume_memory(self.particles, near.with_inside(self.particles, voxel)) + self.kept()
    }

    fn grids(&self) -> Grids {
        self.grids.unwrap_or_else(|| Grids::at_most(self.particles, self.surface.voxel))
    }

    fn kept(&self) -> u64 {
        let part = if self.grids.is_some() { KEPT } else { KEPT_AT_MOST };
        (part * (self.simulation() as f64 - BASE_MEMORY)) as u64
    }
}

/// Memory of simulating smoke, a vorton: columns, rates and the tree that sums them …
const VORTON: f64 = 900.0;

/// … and a tracer.
const TRACER: f64 = 230.0;

/// Peak memory of simulating smoke [bytes].
pub(super) fn smoke(vortons: f64, tracers: f64) -> u64 {
    (BASE_MEMORY + vortons * VORTON + tracers * TRACER) as u64
}

/// Memory of simulating sheets, a point, and of the mesh of a frame that is written: 360 to 410 were seen on grids of 160 000 and a million
/// points, by the implicit integrator and with repulsion …
const POINT: f64 = 410.0;

/// … and what bending takes beside: 1030 to 1040, with shear.
const BENT: f64 = 1050.0;

/// … and contact: its boxes, and lists of pairs. `falling-sheets` took 3 300 a point, and 6 250 with twice the cells, where each point had 25 pairs.
const MEETING: f64 = 6500.0;

/// Peak memory of simulating so many points of sheets, of which some may bend and some meet [bytes]; 0 without any.
pub(super) fn sheets(points: usize, [bend, meet]: [bool; 2]) -> u64 {
    let named = |is_named: bool, bytes: f64| if is_named { bytes } else { 0.0 };
    let point = POINT + named(bend, BENT) + named(meet, MEETING);
    if points == 0 { 0 } else { (BASE_MEMORY + points as f64 * point) as u64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes of the meshes of the built-in presets: samples, and how many of them collide.
    const NONE: (&[usize], usize) = (&[], 0);
    const ROCK: (&[usize], usize) = (&[336_895], 336_895);
    const BEAR: (&[usize], usize) = (&[906_360], 0);
    const RABBIT: (&[usize], usize) = (&[512_400], 0);
    const DUCK: (&[usize], usize) = (&[1_343_148], 1_343_148);

    /// A shot of a built-in preset with `kernel_radius` 2 and voxel 0.5.
    fn shot<'a>(
        (fields, colliding): (&[usize], usize),
        particles: usize,
        grids: Option<Grids>,
        surface: &'a SurfaceParams,
    ) -> Known<'a> {
        let solids = Solids::with(fields, colliding);
        Known { particles, kernel_radius: 2.0, solids, grids, surface }
    }

    fn mib(bytes: u64) -> f64 {
        bytes as f64 / f64::from(1 << 20)
    }

    #[test]
    fn the_bound_covers_every_preset_in_every_tier() {
        // Particles, and the peaks of `meniscus shot` [MiB], by tools/bench/gallery.py.
        let params = SurfaceParams::default();
        for (solids, rows) in [
            (NONE, [(8_000, 15.0), (32_768, 27.0), (103_823, 64.0)]),
            (NONE, [(10_240, 16.0), (34_560, 31.0), (116_640, 76.0)]),
            (NONE, [(8_912, 15.0), (30_088, 24.0), (101_792, 56.0)]),
            (ROCK, [(6_721, 21.0), (22_649, 23.0), (54_460, 39.0)]),
            (BEAR, [(11_512, 40.0), (36_722, 40.0), (128_791, 81.0)]),
            (RABBIT, [(9_984, 26.0), (33_671, 29.0), (79_872, 51.0)]),
            (DUCK, [(10_896, 55.0), (36_865, 55.0), (127_493, 161.0)]),
        ] {
            for (particles, found) in rows {
                let known = shot(solids, particles, None, &params);
                let told = mib(known.simulation().max(known.surfaces()));
                println!("{particles} particles: at most {told:.0} MiB, found {found}");
                assert!((1.0..3.0).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
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
            (ROCK, 6_721, 20.8),
            (BEAR, 11_512, 40.0),
            (BEAR, 36_722, 40.0),
            (BEAR, 128_791, 74.1),
            (RABBIT, 9_984, 26.3),
            (DUCK, 10_896, 55.1),
            (DUCK, 36_865, 54.9),
            (DUCK, 127_493, 80.6),
        ] {
            let told = mib(shot(solids, particles, None, &params).simulation());
            assert!((1.0..1.3).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
        }
    }

    #[test]
    fn what_was_counted_gives_the_peaks_that_were_found() {
        // Particles, most bricks and vertices of a frame, and the peaks of `meniscus shot` [MiB], by tools/bench/gallery.py.
        let params = SurfaceParams::default();
        for (solids, particles, bricks, vertices, found) in [
            (NONE, 103_823, 4_319.0, 270_096.0, 64.0),
            (NONE, 34_560, 2_527.0, 122_148.0, 31.0),
            (NONE, 116_640, 6_759.0, 335_606.0, 76.0),
            (NONE, 101_792, 4_014.0, 188_868.0, 56.0),
            (RABBIT, 79_872, 2_996.0, 109_986.0, 51.0),
            (DUCK, 36_865, 2_088.0, 215_364.0, 55.0),
            (DUCK, 127_493, 7_719.0, 772_682.0, 161.0),
        ] {
            let known = shot(solids, particles, Some(Grids { bricks, vertices }), &params);
            let told = mib(known.simulation().max(known.surfaces()));
            println!("{particles} particles: {told:.0} MiB, found {found}");
            assert!((0.8..1.25).contains(&(told / found)), "{particles}: {told} MiB, found {found}");
        }
    }

    #[test]
    fn volumes_count_what_no_mesh_counts() {
        let params = SurfaceParams { voxel: 0.25, ..SurfaceParams::default() };
        let told = |grids| shot(NONE, 8_000_000, grids, &params).volumes();
        // A million bricks are inside.
        assert!(told(Some(Grids::default())) as f64 > 2e6 * 0.9 * 20_000.0);
        assert_eq!(told(Some(Grids::default())), told(Some(Grids::at_most(8_000_000, 0.25))));
    }

    #[test]
    fn meshes_in_the_scene_are_counted_once_a_file_and_displace_once_a_collider() {
        let one = Solids::with(&[1000], 0);
        let two = Solids::with(&[1000, 500], 2000);
        assert_eq!((one.making, one.held), (34_000.0, 4_000.0));
        assert_eq!((two.making, two.held), (36_000.0, 18_000.0));
    }
}
