//! Peak memory of a shot, by the memory of its systems, products and sampled meshes.
//!
//! *Method*: peaks of resident memory of whole runs. Tests compare the model with the peak of a real run, and its bound with
//! those of every built-in preset and tier.

use crate::{
    job::memory::BASE_MEMORY,
    sim::{registry, scene::Scene},
    solid::Shape,
};
use std::collections::BTreeMap;

/// Factor of the simulation's peak, and the fraction of it that the process still holds while it makes products: the allocator
/// keeps freed memory, and the longer the sequence, the more. Over seven shots that was 0.2 to 0.6, and 1.2 in one.
const ESTIMATE: [f64; 2] = [1.0, 0.6];

/// The same for a bound: measured peaks of simulating are up to 6 % above the estimate.
const BOUND: [f64; 2] = [1.1, 1.2];

/// Memory of sampling a mesh [bytes/node]: 26 to 36 were measured on four meshes.
const SAMPLING_BYTES: f64 = 34.0;

/// Memory of reading a mesh and of the tree over its triangles, with its file [bytes/byte of a binary file]: 7.2 and 8.0 were measured with
/// 5 000 000 and 500 000 triangles.
const READING_BYTES: f64 = 8.0;

/// Memory of a mesh's samples [bytes/node].
const SAMPLE_BYTES: f64 = 4.0;

/// Memory of a collider's boundary density [bytes/node of its samples]: a second field, on a grid wider by the kernel.
const BOUNDARY_BYTES: f64 = 6.0;

/// Distance fields of a mesh that deforms which are held at a time.
const HELD_KEYS: f64 = 3.0;

/// Memory of sampled meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Solids {
    /// While they are sampled, before seeding [bytes].
    sampling: f64,
    /// During the simulation [bytes].
    held: f64,
}

impl Solids {
    /// Of a scene whose meshes are sampled.
    fn of(scene: &Scene) -> Self {
        let mut scene = scene.clone();
        let mut fields = BTreeMap::new();
        let (mut colliding, mut deforming) = (0, 0.0);
        let mut add = |shape: &Shape| match shape {
            Shape::Mesh(mesh) if let Some(deformation) = mesh.deformation() => {
                let nodes = deformation.max_nodes();
                deforming += deformation.memory() + HELD_KEYS * SAMPLE_BYTES * nodes as f64;
                // The boundary densities of two keys, and one field that is sampled while the simulation runs.
                deforming += (BOUNDARY_BYTES + SAMPLING_BYTES) * nodes as f64;
                nodes
            }
            Shape::Mesh(mesh) => {
                // Shapes of one file share their samples.
                let nodes = mesh.samples().values.len();
                fields.insert((mesh.file.clone(), mesh.resolution), nodes);
                nodes
            }
            _ => 0,
        };
        for collider in &scene.world.collider {
            colliding += add(&collider.shape);
        }
        scene.force.iter().filter_map(|force| force.shape.as_ref()).for_each(|shape| _ = add(shape));
        for system in registry::ALL {
            for shape in system.shapes_mut(&mut scene) {
                add(shape);
            }
        }
        let rigid = Self::with(&fields.into_values().collect::<Vec<_>>(), colliding);
        let files = scene.assets.values().map(|asset| asset.bytes.len());
        let (all, largest) = files.fold((0, 0), |(all, largest), size| (all + size, largest.max(size)));
        let reading = READING_BYTES * largest as f64 + (all - largest) as f64;
        Self { sampling: rigid.sampling + reading, held: rigid.held + deforming + all as f64 }
    }

    /// Of fields with so many nodes each, and as many in all of those that are colliders.
    fn with(fields: &[usize], colliding: usize) -> Self {
        let all = fields.iter().sum::<usize>() as f64;
        let largest = fields.iter().copied().max().unwrap_or(0) as f64;
        Self {
            sampling: SAMPLE_BYTES * (all - largest) + SAMPLING_BYTES * largest,
            held: SAMPLE_BYTES * all + BOUNDARY_BYTES * colliding as f64,
        }
    }
}

/// The model of a shot's peak memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct MemoryModel {
    /// Peak of simulating [bytes].
    simulation: f64,
    /// The part of it that is kept while products are made [bytes].
    kept: f64,
}

impl MemoryModel {
    /// An estimate, by the memory of all systems [bytes].
    pub(super) fn estimate(scene: &Scene, systems: f64) -> Self {
        Self::new(Solids::of(scene), systems, ESTIMATE)
    }

    /// A bound, by the memory of all systems [bytes].
    pub(super) fn bound(scene: &Scene, systems: f64) -> Self {
        Self::new(Solids::of(scene), systems, BOUND)
    }

    fn new(solids: Solids, systems: f64, [factor, kept]: [f64; 2]) -> Self {
        let simulation = factor * (BASE_MEMORY + solids.sampling.max(solids.held + systems));
        Self { simulation, kept: kept * (simulation - BASE_MEMORY) }
    }

    /// Peak of simulating, and of making `products` after that in the same process [bytes].
    pub(super) fn peak(&self, products: impl Iterator<Item = f64>) -> u64 {
        products.map(|product| product + self.kept).fold(self.simulation, f64::max) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::StreamKind,
        job::memory::Grids,
        mesh::SurfaceParams,
        product::{RequestedProducts, surface::surface_memory},
        sim::ElementCount,
    };

    /// Nodes of the meshes of the built-in presets: samples, and how many of them collide.
    const NONE: (&[usize], usize) = (&[], 0);
    const ROCK: (&[usize], usize) = (&[336_895], 336_895);
    const BEAR: (&[usize], usize) = (&[906_360], 0);
    const RABBIT: (&[usize], usize) = (&[512_400], 0);
    const DUCK: (&[usize], usize) = (&[1_343_148], 1_343_148);

    /// A shot of a built-in preset with `kernel_radius` 2 and voxel 0.5, of so many particles.
    fn shot((fields, colliding): (&[usize], usize), particles: usize, factors: [f64; 2]) -> MemoryModel {
        let scene = scene();
        let counts = counts(particles);
        let present = registry::ALL.iter().filter(|system| system.is_present(&scene));
        let systems = present.map(|system| system.memory(&scene, &counts)).sum();
        MemoryModel::new(Solids::with(fields, colliding), systems, factors)
    }

    fn scene() -> Scene {
        let liquid = "[liquid]\nspacing = 0.1\nsource = [{ shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } } }]\n";
        crate::from_toml(&format!("title = \"t\"\nframes = \"1\"\n{liquid}[output]\nmesh = [\"ply\"]\n"))
    }

    fn counts(particles: usize) -> Vec<ElementCount> {
        vec![ElementCount::constant("particles", StreamKind::Particles, particles as f64)]
    }

    fn mib(bytes: u64) -> f64 {
        bytes as f64 / f64::from(1 << 20)
    }

    #[test]
    fn the_bound_covers_every_preset_in_every_tier() {
        // Particles, and the peaks of `meniscus shot` [MiB], by tools/bench/gallery.py.
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
                let products = RequestedProducts::max_memory(&scene(), &counts(particles));
                let model = shot(solids, particles, BOUND);
                let bound = mib(model.peak(products.into_iter().map(|(_, memory)| memory)));
                assert!((1.0..3.0).contains(&(bound / found)), "{particles}: {bound} MiB, found {found}");
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
            let bound = mib(shot(solids, particles, BOUND).peak(std::iter::empty()));
            assert!((1.0..1.3).contains(&(bound / found)), "{particles}: {bound} MiB, found {found}");
        }
    }

    #[test]
    fn counted_grids_give_the_measured_peaks() {
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
            let surface =
                surface_memory(particles, Grids { vertices, ..Grids::of_bricks(bricks) }, &params) as f64;
            let estimate = mib(shot(solids, particles, ESTIMATE).peak([surface].into_iter()));
            assert!((0.8..1.25).contains(&(estimate / found)), "{particles}: {estimate} MiB, found {found}");
        }
    }

    #[test]
    fn samples_count_once_a_file_and_boundary_densities_once_a_collider() {
        let one = Solids::with(&[1000], 0);
        let two = Solids::with(&[1000, 500], 2000);
        assert_eq!((one.sampling, one.held), (34_000.0, 4_000.0));
        assert_eq!((two.sampling, two.held), (36_000.0, 18_000.0));
    }
}
