//! Seeding: filling sources with particles on cubic seeding lattices.

use super::{LiquidParams, calibration::RestState, record::LiquidSeeds, walls::Walls};
use crate::{math::Vec3, sim::SetupError, solid::Shape, space::CellGrid};
use nalgebra::Vector3;

/// Smallest distance to a particle of an earlier source, in spacings: closer particles are skipped. Seeding lattices that
/// meet out of step would start compressed (0.8 gives 20 % over rest density along the seam) and fly apart.
const MIN_SEPARATION: f32 = 0.9;

/// Smallest distance to a solid, in spacings: closer particles are skipped. The contact distance is half a spacing, and the
/// hundredth below absorbs rounding.
const MIN_SOLID_DISTANCE: f32 = 0.49;

/// The particles at the start of a shot.
#[derive(Debug, Default)]
pub(super) struct Seeds {
    pub(super) positions: Vec<Vec3>,
    pub(super) velocities: Vec<Vec3>,
    /// One past the last id of each source.
    pub(super) ends: Vec<u32>,
    pub(super) report: LiquidSeeds,
}

/// Fills every source in order; ids are the indices of the result.
pub(super) fn seed(params: &LiquidParams, rest: &RestState, walls: &Walls) -> Result<Seeds, SetupError> {
    let count: f64 =
        params.source.iter().map(|s| seeding_lattice(&s.shape, rest.spacing).1.iter().product::<f64>()).sum();
    if count > f64::from(u32::MAX / 2) {
        return Err(SetupError::TooMany { count });
    }
    let mut seeds = Seeds::default();
    for source in &params.source {
        let earlier = CellGrid::new(&seeds.positions, rest.spacing);
        let (first, counts) = seeding_lattice(&source.shape, rest.spacing);
        let [nx, ny, nz] = counts.map(|n| n as u64);
        let mut found = Vec::new();
        for k in 0..nx * ny * nz {
            let step = [k % nx, k / nx % ny, k / (nx * ny)];
            let x =
                Vec3::from_fn(|axis, _| (first[axis] + step[axis] as f64 * f64::from(rest.spacing)) as f32);
            if !contains(&source.shape, x) {
                continue;
            }
            if walls.distance(x) < MIN_SOLID_DISTANCE * rest.spacing {
                seeds.report.skipped_in_solids += 1;
                continue;
            }
            let mut near = false;
            earlier.for_each_within(&seeds.positions, x, MIN_SEPARATION * rest.spacing, |_, _| near = true);
            if near {
                seeds.report.skipped_overlapping += 1;
            } else {
                found.push(x);
            }
        }
        seeds.positions.append(&mut found);
        seeds.velocities.resize(seeds.positions.len(), source.velocity.into());
        seeds.ends.push(seeds.positions.len() as u32);
    }
    seeds.report.particles = seeds.positions.len() as u32;
    if seeds.positions.is_empty() { Err(SetupError::NoParticles) } else { Ok(seeds) }
}

/// One past the last id of each source, from the ids and sources of all particles: ids ascend source by source, and no
/// particle is ever removed. An empty source ends where the previous one does.
pub(super) fn ends(ids: &[u32], sources: &[u32]) -> Vec<u32> {
    let mut ends = vec![0; sources.iter().max().map_or(0, |&last| last as usize + 1)];
    for (&id, &source) in ids.iter().zip(sources) {
        let end = &mut ends[source as usize];
        *end = id.saturating_add(1).max(*end);
    }
    for source in 1..ends.len() {
        ends[source] = ends[source].max(ends[source - 1]);
    }
    ends
}

/// First point of the seeding lattice of a shape [m], and the number of points along each axis; none for an unbounded shape.
fn seeding_lattice(shape: &Shape, spacing: f32) -> ([f64; 3], [f64; 3]) {
    let s = f64::from(spacing);
    match *shape {
        Shape::Box { min, max } => {
            let count = |axis: usize| ((f64::from(max[axis]) - f64::from(min[axis])) / s).round().max(0.0);
            (min.map(|m| f64::from(m) + 0.5 * s), [count(0), count(1), count(2)])
        }
        Shape::Sphere { center, radius } => {
            let half = (f64::from(radius) / s).ceil();
            (center.map(|c| f64::from(c) - (half - 0.5) * s), [2.0 * half; 3])
        }
        Shape::Mesh(ref mesh) => {
            let (low, high) = mesh.bounds();
            let first = |axis: usize| (f64::from(low[axis]) / s).floor() + 0.5;
            let count = |axis: usize| (f64::from(high[axis]) / s + 0.5 - first(axis)).floor().max(0.0);
            ([0, 1, 2].map(|axis| first(axis) * s), [count(0), count(1), count(2)])
        }
        Shape::Plane { .. } | Shape::Tank { .. } => ([0.0; 3], [0.0; 3]),
        _ => {
            let (low, high) =
                shape.bounds().map_or_else(Default::default, |(low, high)| (low.cast(), high.cast()));
            let half: Vector3<f64> = ((high - low) / (2.0 * s)).map(f64::ceil);
            let first = (low + high) / 2.0 - half.add_scalar(-0.5) * s;
            (first.into(), (half * 2.0).into())
        }
    }
}

/// Whether a point of the seeding lattice belongs to the shape.
fn contains(shape: &Shape, x: Vec3) -> bool {
    match *shape {
        Shape::Box { .. } => true,
        Shape::Sphere { center, radius } => (x - Vec3::from(center)).norm() <= radius,
        Shape::Mesh(ref mesh) => mesh.contains(x),
        _ => shape.signed_distance(x) <= 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    fn seeds(text: &str, shapes: Vec<Shape>) -> Result<Seeds, SetupError> {
        let params: LiquidParams = toml::from_str(text).expect("the preset is valid");
        let rest = RestState::new(params.kernel, params.spacing, params.kernel_radius);
        let solids: Vec<Solid> = shapes.into_iter().map(Solid::fixed).collect();
        seed(&params, &rest, &Walls::new(&solids, &rest))
    }

    fn sources(shapes: &[&str]) -> String {
        let list: Vec<String> = shapes.iter().map(|shape| format!("{{ shape = {{ {shape} }} }}")).collect();
        format!("spacing = 0.02\nsource = [{}]", list.join(", "))
    }

    const CUBE: &str = "box = { min = [0, 0, 0], max = [0.2, 0.1, 0.06] }";

    #[test]
    fn a_box_has_one_particle_per_cell_half_a_spacing_inside() {
        let seeds =
            seeds(&sources(&[CUBE]), vec![Shape::Tank { min: [0.0; 3], max: [1.0, 0.1, 1.0] }]).unwrap();
        assert_eq!(seeds.report, LiquidSeeds { particles: 150, ..LiquidSeeds::default() });
        assert!((seeds.positions[0] - Vec3::repeat(0.01)).norm() < 1e-7);
        assert!((seeds.positions[149] - Vec3::new(0.19, 0.09, 0.05)).norm() < 1e-6);
    }

    #[test]
    fn rounded_sources_hold_particles_for_their_volume_and_are_symmetric() {
        let pi = std::f32::consts::PI;
        let cases = [
            ("sphere = { center = [5, 0, 0.3], radius = 0.2 }", 4.0 / 3.0 * pi * 0.2_f32.powi(3)),
            (
                "capsule = { from = [4.7, 0, 0.3], to = [5.3, 0, 0.3], radius = 0.15 }",
                pi * 0.15_f32.powi(2) * (0.6 + 4.0 / 3.0 * 0.15),
            ),
            (
                "torus = { center = [5, 0, 0.3], axis = [0, 0, 1], radius = 0.3, tube = 0.12 }",
                2.0 * pi.powi(2) * 0.3 * 0.12_f32.powi(2),
            ),
            (
                "ellipsoid = { center = [5, 0, 0.3], radii = [0.3, 0.2, 0.15] }",
                4.0 / 3.0 * pi * 0.3 * 0.2 * 0.15,
            ),
        ];
        for (shape, expected) in cases {
            let positions = seeds(&sources(&[shape]), vec![]).unwrap().positions;
            let volume = positions.len() as f32 * 0.02_f32.powi(3);
            // A capsule of few particles across is 2.4 % off.
            let bound = if shape.starts_with("sphere") { 0.02 } else { 0.03 };
            assert!((volume / expected - 1.0).abs() < bound, "{shape}: {volume} of {expected}");
            let mean = positions.iter().sum::<Vec3>() / positions.len() as f32;
            assert!((mean - Vec3::new(5.0, 0.0, 0.3)).amax() < 1e-4, "{shape}: {mean:?}");
        }
    }

    #[test]
    fn unbounded_shapes_hold_no_particle() {
        for shape in [
            "plane = { point = [0, 0, 0], normal = [0, 0, 1] }",
            "tank = { min = [0, 0, 0], max = [1, 1, 1] }",
        ] {
            assert_eq!(seeds(&sources(&[shape]), vec![]).unwrap_err(), SetupError::NoParticles, "{shape}");
        }
    }

    #[test]
    fn overlaps_and_particles_in_solids_are_skipped_and_counted() {
        let twice = seeds(&sources(&[CUBE, CUBE]), vec![]).unwrap();
        assert_eq!((twice.report.particles, twice.report.skipped_overlapping), (150, 150));
        let next = "box = { min = [0.2, 0, 0], max = [0.4, 0.1, 0.06] }";
        assert_eq!(seeds(&sources(&[CUBE, CUBE, next]), vec![]).unwrap().ends, [150, 150, 300]);
        let floor = Shape::Plane { point: [0.0, 0.0, 0.02], normal: [0.0, 0.0, 1.0] };
        let above = seeds(&sources(&[CUBE]), vec![floor]).unwrap();
        assert_eq!((above.report.particles, above.report.skipped_in_solids), (100, 50));
    }

    #[test]
    fn the_ends_of_sources_follow_from_particles_in_any_order() {
        assert_eq!(ends(&[4, 0, 2, 3, 1], &[3, 0, 1, 3, 0]), [2, 3, 3, 5]);
        assert_eq!(ends(&[], &[]), [0; 0]);
    }

    #[test]
    fn empty_and_oversized_sources_are_refused() {
        let tiny = "box = { min = [0, 0, 0], max = [0.004, 1, 1] }";
        assert_eq!(seeds(&sources(&[tiny]), vec![]).unwrap_err(), SetupError::NoParticles);
        let huge = "box = { min = [0, 0, 0], max = [1e6, 1e6, 1e6] }";
        assert!(matches!(seeds(&sources(&[huge]), vec![]).unwrap_err(), SetupError::TooMany { .. }));
    }
}
