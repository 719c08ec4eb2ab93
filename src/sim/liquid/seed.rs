//! Seeding: filling sources with particles on cubic seeding lattices.
//!
//! *Method*: the seeding lattice of a box starts at its corner, that of a mesh is aligned with the world, and that of other shapes
//! lies symmetrically about their centre. A source of few particles would get too many or none, depending on how the points
//! fall in it. It gets one of eight symmetric seeding lattices, with points on its centre or half a spacing off along each axis:
//! the one whose number of particles is closest to its volume.
//! *Limits*: a source thinner than a spacing holds no point of such a seeding lattice, or too many. Sources without particles are
//! reported.

use super::{
    LiquidParams,
    calibration::RestState,
    jitter::{Jitter, displaced},
    record::{EmptySource, LiquidSeeds},
    walls::Walls,
};
use crate::math::elementary::log10;
use crate::{math::Vec3, sim::SetupError, solid::Shape, space::CellGrid};
use nalgebra::Vector3;

/// Smallest distance to a particle of an earlier source, in spacings: closer particles are skipped. Seeding lattices that
/// meet out of step would start compressed (0.8 gives 20 % over rest density along the seam) and fly apart.
const MIN_SEPARATION: f32 = 0.9;

/// Smallest distance to a solid, in spacings: closer particles are skipped. The contact distance is half a spacing, and the
/// hundredth below absorbs rounding.
const MIN_SOLID_DISTANCE: f32 = 0.49;

/// Volume below which a source gets the seeding lattice whose number of particles matches it best, in particles. At 32, the
/// ball of two spacings in radius, all of them are within a few per cent of its volume; at 1 they are up to 160 % off.
const SMALL_SOURCE: f64 = 32.0;

/// Most points of the seeding lattice around a small source; thinner and longer sources keep theirs.
const MAX_SMALL_POINTS: f64 = 4096.0;

/// Most points of a seeding lattice that is tried to find a spacing at which a source has particles.
const MAX_TRIED_POINTS: f64 = 1e6;

/// Factor between spacings that are tried.
const TRIED_RATIO: f64 = 0.9;

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
    let spacing = f64::from(rest.spacing);
    let count: f64 =
        params.source.iter().map(|source| SeedingLattice::new(&source.shape, spacing).point_count()).sum();
    if count > f64::from(u32::MAX / 2) {
        return Err(SetupError::TooMany { count });
    }
    let mut seeds = Seeds::default();
    let is_in_solid = |x| walls.distance(x) < MIN_SOLID_DISTANCE * rest.spacing;
    for (index, source) in params.source.iter().enumerate() {
        let earlier = CellGrid::new(&seeds.positions, rest.spacing);
        let overlaps = |x| {
            let mut near = false;
            earlier.for_each_within(&seeds.positions, x, MIN_SEPARATION * rest.spacing, |_, _| near = true);
            near
        };
        let mut found = Vec::new();
        let mut skipped = 0;
        for x in SeedingLattice::fitted(&source.shape, spacing).points(&source.shape) {
            if is_in_solid(x) {
                seeds.report.skipped_in_solids += 1;
                skipped += 1;
            } else if overlaps(x) {
                seeds.report.skipped_overlapping += 1;
                skipped += 1;
            } else {
                found.push(x);
            }
        }
        if found.is_empty() {
            seeds.report.empty_sources.push(EmptySource {
                index: index as u32,
                skipped,
                volume: volume(&source.shape, spacing),
                sufficient_spacing: if skipped == 0 {
                    sufficient_spacing(&source.shape, spacing)
                } else {
                    None
                },
            });
        }
        seeds.positions.append(&mut found);
        seeds.velocities.resize(seeds.positions.len(), source.velocity.into());
        seeds.ends.push(seeds.positions.len() as u32);
    }
    seeds.report.particles = seeds.positions.len() as u32;
    if params.has_jitter() {
        let source_of = |i: usize| seeds.ends.partition_point(|&end| end as usize <= i);
        let fits = |i, x| is_inside(&params.source[source_of(i)].shape, x) && !is_in_solid(x);
        let jitter = |i| {
            let source = source_of(i);
            let first = source.checked_sub(1).map_or(0, |before| seeds.ends[before] as usize);
            let amplitude = params.source[source].jitter?;
            Some(Jitter { source: source as u32, number: (i - first) as u64, amplitude })
        };
        seeds.positions = displaced(&seeds.positions, rest.spacing, jitter, fits);
    }
    Ok(seeds)
}

/// Points at equal distances along the axes.
#[derive(Clone, Copy, Debug)]
struct SeedingLattice {
    /// First point [m].
    first: [f64; 3],
    /// Number of points along each axis.
    counts: [f64; 3],
    /// Distance between points [m].
    spacing: f64,
}

impl SeedingLattice {
    /// The seeding lattice of a shape of any size; without points for an unbounded shape.
    fn new(shape: &Shape, spacing: f64) -> Self {
        let s = spacing;
        let (first, counts) = match *shape {
            Shape::Box { min, max } => {
                let count =
                    |axis: usize| ((f64::from(max[axis]) - f64::from(min[axis])) / s).round().max(0.0);
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
        };
        Self { first, counts, spacing }
    }

    /// The seeding lattice that fills a shape: [`SeedingLattice::new`], or for a small shape the symmetric one whose number of points
    /// in it is closest to its volume.
    fn fitted(shape: &Shape, spacing: f64) -> Self {
        let usual = Self::new(shape, spacing);
        let volume = volume(shape, spacing);
        if volume >= SMALL_SOURCE || usual.point_count() > MAX_SMALL_POINTS {
            return usual;
        }
        let Some((low, high)) = shape.bounds() else { return usual };
        let count = |candidate: &Self| candidate.points(shape).count() as f64;
        let found = count(&usual);
        let mut best = (usual, (found - volume).abs());
        for choice in 0..8 {
            let candidate = Self::symmetric(shape, [low, high], choice, spacing);
            let count = count(&candidate);
            // A source that has particles keeps some, even if it has less than half a particle's volume.
            if (count > 0.0 || found == 0.0) && (count - volume).abs() < best.1 {
                best = (candidate, (count - volume).abs());
            }
        }
        best.0
    }

    /// A seeding lattice symmetric about the centre of `bounds`. Bit `axis` of `choice` selects one of two along each axis: a box
    /// is as long as one point more or fewer, other shapes have points on the centre or half a spacing off.
    fn symmetric(shape: &Shape, [low, high]: [Vec3; 2], choice: usize, spacing: f64) -> Self {
        let counts = [0, 1, 2].map(|axis| {
            let length = (f64::from(high[axis]) - f64::from(low[axis])) / spacing;
            match (shape, choice >> axis & 1 == 0) {
                (Shape::Box { .. }, true) => length.floor().max(1.0),
                (Shape::Box { .. }, false) => length.ceil().max(1.0),
                (_, true) => 2.0 * (length / 2.0).floor() + 1.0,
                (_, false) => 2.0 * (length / 2.0).ceil(),
            }
        });
        let first = [0, 1, 2].map(|axis| {
            let center = (f64::from(low[axis]) + f64::from(high[axis])) / 2.0;
            center - (counts[axis] - 1.0) / 2.0 * spacing
        });
        Self { first, counts, spacing }
    }

    /// Number of points, in the shape or not.
    fn point_count(&self) -> f64 {
        self.counts.iter().product()
    }

    /// The points that belong to a shape, in order.
    fn points<'a>(&'a self, shape: &'a Shape) -> impl Iterator<Item = Vec3> + 'a {
        let [nx, ny, nz] = self.counts.map(|n| n as u64);
        let point = move |k: u64| {
            let step = [k % nx, k / nx % ny, k / (nx * ny)];
            Vec3::from_fn(|axis, _| (self.first[axis] + step[axis] as f64 * self.spacing) as f32)
        };
        (0..nx * ny * nz).map(point).filter(|&x| contains(shape, x))
    }
}

/// Volume of a shape, in particles; zero for an unbounded one.
fn volume(shape: &Shape, spacing: f64) -> f64 {
    let volume = match shape {
        Shape::Mesh(mesh) => mesh.volume().unwrap_or(0.0),
        _ => shape.volume(),
    };
    volume / spacing.powi(3)
}

/// A spacing below `spacing` [m], of two digits, at which a shape has particles; `None` if there is none with a seeding lattice
/// of limited size.
fn sufficient_spacing(shape: &Shape, spacing: f64) -> Option<f64> {
    let mut tried = spacing;
    loop {
        tried *= TRIED_RATIO;
        // The message has two digits, and rounding up could lose the particles again.
        let digit = 10.0_f64.powi(log10(tried).floor() as i32 - 1);
        tried = (tried / digit).floor() * digit;
        let candidate = SeedingLattice::fitted(shape, tried);
        if candidate.point_count() > MAX_TRIED_POINTS || tried < f64::from(f32::EPSILON) * spacing {
            return None;
        }
        if candidate.points(shape).next().is_some() {
            return Some(tried);
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

/// Whether an arbitrary point is in the shape; [`contains`] is of points of the seeding lattice.
fn is_inside(shape: &Shape, x: Vec3) -> bool {
    match shape {
        Shape::Box { .. } => shape.signed_distance(x) <= 0.0,
        _ => contains(shape, x),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    fn seeds(text: &str, shapes: Vec<Shape>) -> Result<Seeds, SetupError> {
        let params: LiquidParams = crate::from_toml(text);
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
    fn jitter_displaces_particles_within_their_source_and_clear_of_solids() {
        let text = |jitter: [f32; 2]| {
            let [first, second] = jitter;
            format!(
                "spacing = 0.02\n[[source]]\njitter = {first}\nshape = {{ box = {{ min = [0, 0, 0], max = [0.2, 0.2, 0.1] }} }}\n\
                 [[source]]\njitter = {second}\nshape = {{ sphere = {{ center = [0.1, 0.1, 0.21], radius = 0.1 }} }}"
            )
        };
        let tank = || vec![Shape::Tank { min: [0.0; 3], max: [0.2, 0.2, 1.0] }];
        let regular = seeds(&text([0.5, 0.2]).replace("jitter", "#"), tank()).unwrap();
        let displaced = seeds(&text([0.5, 0.2]), tank()).unwrap();
        assert_eq!((&regular.ends, &regular.report), (&displaced.ends, &displaced.report));
        let first = regular.ends[0] as usize;
        for (range, jitter) in [(0..first, 0.5_f32), (first..regular.positions.len(), 0.2)] {
            let offsets: Vec<Vec3> =
                range.map(|i| (displaced.positions[i] - regular.positions[i]) / 0.02).collect();
            let mean = offsets.iter().sum::<Vec3>() / offsets.len() as f32;
            let square = offsets.iter().map(Vec3::norm_squared).sum::<f32>() / offsets.len() as f32;
            // Up to j along three axes, of which j² is the mean square, less what would be outside; and what moves pairs apart.
            assert!(offsets.iter().all(|offset| offset.amax() <= jitter + 0.5), "{jitter}");
            assert!(mean.norm() < 0.15 * jitter, "{jitter}: {mean}");
            assert!((0.5..1.1).contains(&(square / jitter.powi(2))), "{jitter}: {square}");
        }
        let (pool, ball) = displaced.positions.split_at(first);
        // Few are left with a neighbour closer than 0.85 spacings, where walls and the surface hold them; as drawn, nearly all.
        let nearest = |x: &Vec3| {
            pool.iter().filter(|y| *y != x).map(|y| (x - y).norm()).fold(f32::MAX, f32::min) / 0.02
        };
        let close = pool.iter().filter(|x| nearest(x) < 0.85).count();
        let closest = pool.iter().map(nearest).fold(f32::MAX, f32::min);
        assert!(close < first / 20 && closest > 0.5, "{close} of {first}, {closest} spacings at least");
        for x in pool {
            assert!(x.iter().all(|&c| c > 0.0097) && x.x < 0.1903 && x.y < 0.1903 && x.z <= 0.1001, "{x}");
        }
        for x in ball {
            assert!((x - Vec3::new(0.1, 0.1, 0.21)).norm() <= 0.1, "{x}");
            assert!(pool.iter().all(|y| (x - y).norm() >= 0.8 * 0.02), "{x}");
        }
    }

    #[test]
    fn sources_that_touch_keep_their_particles_and_their_places_without_jitter() {
        let boxes = |jitter: [&str; 2]| {
            let source = |k: usize| {
                let [from, to] = [0.2 * k as f32, 0.2 * (k + 1) as f32];
                format!(
                    "[[source]]\n{}\nshape = {{ box = {{ min = [{from}, 0, 0], max = [{to}, 0.2, 0.2] }} }}\n",
                    jitter[k]
                )
            };
            seeds(&format!("spacing = 0.02\n{}{}", source(0), source(1)), vec![]).unwrap()
        };
        let regular = boxes(["", ""]);
        let nearest = |x: &[Vec3], of: usize| {
            let others = x.iter().enumerate().filter(|(k, _)| *k != of).map(|(_, y)| (x[of] - y).norm());
            others.fold(f32::MAX, f32::min) / 0.02
        };
        for (jitter, still) in
            [(["jitter = 0.5", "jitter = 0.25"], 2000..2000), (["jitter = 0.5", ""], 1000..2000)]
        {
            let displaced = boxes(jitter);
            assert_eq!((displaced.positions.len(), &displaced.report), (2000, &regular.report), "{jitter:?}");
            assert_eq!(displaced.positions[still.clone()], regular.positions[still], "{jitter:?}");
            assert_ne!(displaced.positions[..1000], regular.positions[..1000]);
            let close = (0..2000).filter(|&of| nearest(&displaced.positions, of) < 0.85).count();
            assert!(close < 100, "{jitter:?}: {close} have a close neighbour, across the seam as well");
        }
    }

    #[test]
    fn small_sources_hold_the_particles_of_their_volume_around_their_centre() {
        let center = Vec3::new(0.013, -0.2, 0.07);
        let [x, y, z] = [center.x, center.y, center.z];
        let ball = |radius: f32| format!("sphere = {{ center = [{x}, {y}, {z}], radius = {radius} }}");
        let block = |size: f32| {
            let half = size / 2.0;
            let [min, max] = [-half, half].map(|half| [x + half, y + half, z + half]);
            format!("box = {{ min = {min:?}, max = {max:?} }}")
        };
        // Sizes in spacings of 2 cm, and volumes in particles.
        for (shape, expected) in [
            (ball(0.02 * 0.667), 1), // 1.24
            (ball(0.02 * 0.5), 1),   // 0.52
            (ball(0.02 * 0.8), 2),   // 2.1
            (ball(0.02 * 0.9), 4),   // 3.1
            (ball(0.02 * 1.5), 12),  // 14.1
            (block(0.02 * 1.5), 4),  // 3.4
        ] {
            let seeds = seeds(&sources(&[&shape]), vec![]).unwrap();
            assert_eq!(seeds.positions.len(), expected, "{shape}");
            let mean = seeds.positions.iter().sum::<Vec3>() / expected as f32;
            assert!((mean - center).amax() < 1e-6, "{shape}: {mean:?}");
            assert_eq!(seeds.report.empty_sources, [], "{shape}");
        }
        assert_eq!(seeds(&sources(&[&block(0.02 * 0.8)]), vec![]).unwrap().positions.len(), 1);
        // The seeding lattice of a source of more particles stays.
        let seeds = seeds(&sources(&[&ball(0.02 * 2.0)]), vec![]).unwrap();
        assert_eq!(seeds.positions.len(), 32);
        assert!((seeds.positions[0] - center - Vec3::new(-0.01, -0.01, -0.03)).amax() < 1e-6);
    }

    #[test]
    fn sources_without_particles_are_reported_with_a_spacing_that_gives_them_some() {
        let drop = "sphere = { center = [1, 1, 1], radius = 0.008 }";
        let layer = "box = { min = [2, 0, 0], max = [2.004, 1, 1] }";
        let found = seeds(&sources(&[drop, CUBE, CUBE, layer]), vec![]).unwrap();
        let empty = &found.report.empty_sources;
        assert_eq!(empty.iter().map(|source| source.index).collect::<Vec<_>>(), [0, 2, 3]);
        assert!(
            (empty[0].volume - 0.268).abs() < 0.001 && (empty[2].volume - 500.0).abs() < 0.1,
            "{empty:?}"
        );
        assert_eq!((empty[0].skipped, empty[1].skipped, empty[2].skipped), (0, 150, 0));
        assert_eq!(empty[1].sufficient_spacing, None);
        for (shape, spacing) in [(drop, empty[0].sufficient_spacing), (layer, empty[2].sufficient_spacing)] {
            let spacing = spacing.unwrap();
            assert!(spacing > 0.0065 && spacing < 0.02, "{shape}: {spacing}");
            let text = format!("spacing = {spacing}\nsource = [{{ shape = {{ {shape} }} }}]");
            assert!(!seeds(&text, vec![]).unwrap().positions.is_empty(), "{shape}");
        }
    }

    #[test]
    fn unbounded_shapes_hold_no_particle() {
        for shape in [
            "plane = { point = [0, 0, 0], normal = [0, 0, 1] }",
            "tank = { min = [0, 0, 0], max = [1, 1, 1] }",
        ] {
            assert!(seeds(&sources(&[shape]), vec![]).unwrap().positions.is_empty(), "{shape}");
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
    fn empty_and_oversized_sources_are_refused() {
        let tiny = "box = { min = [0, 0, 0], max = [0.004, 1, 1] }";
        let empty = seeds(&sources(&[tiny]), vec![]).unwrap();
        assert_eq!((empty.positions.len(), empty.report.empty_sources.len()), (0, 1));
        let huge = "box = { min = [0, 0, 0], max = [1e6, 1e6, 1e6] }";
        assert!(matches!(seeds(&sources(&[huge]), vec![]).unwrap_err(), SetupError::TooMany { .. }));
    }
}
