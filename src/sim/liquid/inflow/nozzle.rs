//! The cross-section of an emitter: columns of its seeding lattice along the direction of the flow.
//!
//! *Method*: the outline of a shape as seen against the flow is sampled on a square grid of one spacing, symmetric about its middle.
//! Of the grids with an odd or even number of points along each side, the one is chosen whose area is closest to that of the outline,
//! which a finer grid gives. The front of each column is found by sphere tracing of the shape's signed distance. Columns are shifted
//! against each other along the flow, so that the seeding lattice stays even when the flow is stretched; see [`SHIFTS`].
//!
//! Symbols: d → `direction`; a column's front → `depth` behind the reference plane, which touches the foremost front [m].
//! Limits: parts of the outline narrower than a spacing may have no column. Large outlines have the grid that fits their sides.

use crate::{math::Vec3, sim::liquid::calibration::RestState, solid::Shape};
use nalgebra::Vector3;

/// Most points of a grid, in the outline or not.
pub(in crate::sim::liquid) const MAX_POINTS: f64 = 4e6;

/// Points of a grid up to which all grids are compared with a finer one.
const MAX_COMPARED_POINTS: f64 = 4096.0;

/// Points of the finer grid along a spacing.
const FINER: f64 = 4.0;

/// Distance from the surface at which a ray has arrived, in spacings.
const ARRIVED: f64 = 1e-3;

/// Most steps along a ray; one that grazes the shape until then has arrived if it is within ten times [`ARRIVED`].
const MAX_TRACING_STEPS: usize = 200;

/// Shifts along the flow from a column to the next along each axis, in distances of layers: 1/ρ and 1/ρ² of the plastic number
/// ρ = 1.3247, the root of ρ³ = ρ + 1.
///
/// A falling jet is stretched along the flow and contracts across it. The columns of a cubic seeding lattice then come so close that
/// the density rises, by 46 % when the length has doubled: pressure stops the contraction, and the jet falls apart into its layers.
/// Here the distance along the flow times the square of that across it has a positive minimum over all pairs, as a norm of the cubic
/// field of ρ. No stretching that contracts both axes alike brings particles closer than 0.86 spacings, and with Wendland's kernel and
/// a support of 2 spacings or more the density stays within 1 %. [kraynik92] does the same for planar elongation, with quadratic
/// fields. In a sheet, which contracts across one axis alone, pairs come closer (docs/decisions/042).
const SHIFTS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Largest density of the shifted seeding lattice over that at rest. Even 0.2 % above it would be corrected at once by particles that
/// have left the nozzle, with velocities of 1 cm/s across the jet; the lower it is, the more is a jet dilated.
const MAX_DENSITY: f64 = 0.9999;

/// Steps to find the distance of layers; each leaves a fifth of the deviation.
const LAYER_STEPS: u32 = 12;

/// Distance between the layers of the shifted seeding lattice [m]: the spacing, or where its density would be above that at rest a
/// little more, with Wendland's kernel up to 0.3 %, with Poly6 up to 2 %.
pub(in crate::sim::liquid) fn layer_distance(rest: &RestState) -> f64 {
    let radius = f64::from(rest.support / rest.spacing);
    let reach = radius.ceil() as i32;
    let side = || -reach..=reach;
    let density = |distance: f64| -> f64 {
        let columns = side().flat_map(|u| side().map(move |w| [f64::from(u), f64::from(w)]));
        let neighbours = columns.flat_map(|[u, w]| {
            let shift = SHIFTS[0] * u + SHIFTS[1] * w;
            let nearest = -shift.round() as i32;
            (nearest - reach..=nearest + reach)
                .map(move |layer| (u * u + w * w + ((f64::from(layer) + shift) * distance).powi(2)).sqrt())
        });
        let sum: f64 =
            neighbours.map(|r| r / radius).filter(|&q| q < 1.0).map(|q| rest.kernel.density(q)).sum();
        f64::from(rest.density_scale) * sum
    };
    let mut distance = 1.0;
    for _ in 0..LAYER_STEPS {
        distance *= (density(distance) / MAX_DENSITY).max(1.0);
    }
    distance * f64::from(rest.spacing)
}

/// A column of the seeding lattice.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim::liquid) struct Column {
    /// Its point on the reference plane, in the emitter's own coordinates [m].
    pub(in crate::sim::liquid) foot: Vector3<f64>,
    /// Distance of its front behind the reference plane [m].
    pub(in crate::sim::liquid) depth: f64,
    /// Shift of its particles against the flow, in distances of layers, from −½ to ½.
    pub(in crate::sim::liquid) shift: f64,
}

/// The cross-section of an emitter.
#[derive(Clone, Debug, Default)]
pub(in crate::sim::liquid) struct Nozzle {
    /// Unit vector along the flow, in the emitter's own axes.
    pub(in crate::sim::liquid) direction: Vector3<f64>,
    pub(in crate::sim::liquid) columns: Vec<Column>,
    /// Area of the outline [m²]; that of the columns if the outline is large.
    pub(in crate::sim::liquid) outline_area: f64,
}

/// Shape, axes and extent of a cross-section.
struct Outline<'a> {
    shape: &'a Shape,
    /// Two axes across the flow, and the flow's.
    axes: [Vector3<f64>; 3],
    /// Extent along each axis [m].
    low: Vector3<f64>,
    high: Vector3<f64>,
    spacing: f64,
}

/// Points of the square grid over an outline of this shape and flow; infinite if it has no end.
pub(in crate::sim::liquid) fn grid_points(shape: &Shape, direction: [f32; 3], spacing: f64) -> f64 {
    let points = |outline: Outline<'_>| outline.lengths().map(|length| length.max(1.0)).iter().product();
    Outline::new(shape, direction, spacing).map_or(f64::INFINITY, points)
}

impl Nozzle {
    /// The cross-section of a shape with points `spacing` [m] apart, for a flow along `direction`. Without columns if the shape has no
    /// end, the direction no length, or the outline no point of a grid.
    pub(in crate::sim::liquid) fn new(shape: &Shape, direction: [f32; 3], spacing: f64) -> Self {
        let Some(outline) = Outline::new(shape, direction, spacing) else { return Self::default() };
        let lengths = outline.lengths();
        let direction = outline.axes[2];
        if lengths.iter().product::<f64>() > MAX_COMPARED_POINTS {
            let columns = outline.columns(lengths.map(|length| length.round().max(1.0)), spacing);
            let outline_area = columns.len() as f64 * spacing * spacing;
            return Self { direction, columns, outline_area };
        }
        let fine = spacing / FINER;
        let counts = lengths.map(|length| (FINER * length).round().max(1.0));
        let outline_area = outline.columns(counts, fine).len() as f64 * fine * fine;
        let mut best: Option<(Vec<Column>, f64)> = None;
        for choice in 0..4_u32 {
            let count = |axis: usize| (lengths[axis].floor() + f64::from(choice >> axis & 1)).max(1.0);
            let columns = outline.columns([count(0), count(1)], spacing);
            let off = (columns.len() as f64 * spacing * spacing - outline_area).abs();
            if !columns.is_empty() && best.as_ref().is_none_or(|(_, least)| off < *least) {
                best = Some((columns, off));
            }
        }
        let columns = best.map(|(columns, _)| columns).unwrap_or_default();
        Self { direction, columns, outline_area }
    }
}

impl<'a> Outline<'a> {
    fn new(shape: &'a Shape, direction: [f32; 3], spacing: f64) -> Option<Self> {
        let flow = Vector3::from(direction.map(f64::from)).try_normalize(f64::MIN_POSITIVE)?;
        let across = Vector3::ith(flow.iamin(), 1.0);
        let first = (across - flow * flow.dot(&across)).normalize();
        let axes = [first, flow.cross(&first), flow];
        let (min, max) = shape.bounds()?;
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = -low;
        for corner in 0..8_usize {
            let corner = Vec3::from_fn(|axis, _| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] });
            let place = Vector3::from_fn(|axis, _| axes[axis].dot(&corner.cast()));
            (low, high) = (low.inf(&place), high.sup(&place));
        }
        Some(Self { shape, axes, low, high, spacing })
    }

    /// Lengths across the flow, in spacings.
    fn lengths(&self) -> [f64; 2] {
        [0, 1].map(|axis| (self.high[axis] - self.low[axis]) / self.spacing)
    }

    /// The columns of a symmetric grid with `counts` points along its sides, `step` [m] apart, on the reference plane.
    fn columns(&self, counts: [f64; 2], step: f64) -> Vec<Column> {
        let place = |axis: usize, k: u64| {
            let middle = 0.5 * (self.low[axis] + self.high[axis]);
            middle + (k as f64 - 0.5 * (counts[axis] - 1.0)) * step
        };
        let [nu, nw] = counts.map(|count| count as u64);
        let mut columns = Vec::new();
        for k in 0..nu * nw {
            let [u, w] = [k % nu, k / nu];
            let foot = self.axes[0] * place(0, u) + self.axes[1] * place(1, w);
            let shift = SHIFTS[0] * u as f64 + SHIFTS[1] * w as f64;
            columns.extend(self.front(foot).map(|front| Column {
                foot: foot + self.axes[2] * front,
                depth: front,
                shift: shift - shift.round(),
            }));
        }
        let foremost = columns.iter().map(|column| column.depth).fold(f64::NEG_INFINITY, f64::max);
        for column in &mut columns {
            column.depth = foremost - column.depth;
            column.foot += self.axes[2] * column.depth;
        }
        columns
    }

    /// Where the ray through `foot` against the flow meets the shape, along the flow [m].
    fn front(&self, foot: Vector3<f64>) -> Option<f64> {
        let arrived = ARRIVED * self.spacing;
        let mut at = self.high.z + arrived;
        let mut distance = f64::INFINITY;
        for _ in 0..MAX_TRACING_STEPS {
            let x: Vec3 = (foot + self.axes[2] * at).cast();
            distance = f64::from(self.shape.signed_distance(x));
            if distance <= arrived {
                return Some(at - distance.max(0.0));
            }
            at -= distance;
            if at < self.low.z - arrived || at.is_nan() {
                return None;
            }
        }
        (distance <= 10.0 * arrived).then_some(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sdf::Sampled, sim::liquid::Kernel, solid::MeshShape};
    use std::{f64::consts::PI, sync::Arc};

    #[test]
    fn columns_fill_the_outline_of_every_shape() {
        let center = [0.3, -0.2, 1.0];
        let sphere = Shape::Sphere { center, radius: 0.1 };
        let capsule = Shape::Capsule { from: [0.0; 3], to: [0.0, 0.0, 0.4], radius: 0.1 };
        let disc = |normal| Shape::Disc { center, normal, radius: 0.1, thickness: 0.0 };
        let torus = Shape::Torus { center, axis: [0.0, 0.0, 1.0], radius: 0.2, tube: 0.1 };
        let (voxel, nodes) = (0.02, [31_u32; 3]);
        let at = |n: u32| Vec3::new((n % 31) as f32, (n / 31 % 31) as f32, (n / 961) as f32) * voxel;
        let ball = Shape::Sphere { center: [0.3; 3], radius: 0.2 };
        let values = (0..31_u32.pow(3)).map(|n| ball.signed_distance(at(n))).collect();
        let mut mesh = MeshShape::new("ball.ply");
        mesh.fill(Arc::new(Sampled { origin: Vec3::zeros(), voxel, nodes, values }));
        for (shape, direction, area) in [
            (Shape::Box { min: [0.0; 3], max: [0.1, 0.14, 0.3] }, [0.0, 0.0, -2.0], 0.014),
            (Shape::Box { min: [0.0; 3], max: [0.1, 0.14, 0.3] }, [1.0, 0.0, 0.0], 0.042),
            (sphere.clone(), [1.0, 2.0, -0.5], PI * 0.01),
            (capsule, [1.0, 0.0, 0.0], 0.08 + PI * 0.01),
            (disc([0.0, 0.0, -1.0]), [0.0, 0.0, -1.0], PI * 0.01),
            // Seen at 60°.
            (disc([0.0, 0.0, -1.0]), [0.0, 3.0_f32.sqrt(), -1.0], 0.5 * PI * 0.01),
            (torus, [0.0, 0.0, 1.0], PI * 0.08),
            (Shape::Ellipsoid { center, radii: [0.1, 0.2, 0.05] }, [0.0, 0.0, 1.0], PI * 0.02),
            (Shape::Mesh(mesh), [0.0, -1.0, 0.3], PI * 0.04),
        ] {
            for spacing in [0.01, 0.02, 0.033] {
                let nozzle = Nozzle::new(&shape, direction, spacing);
                let found = nozzle.columns.len() as f64 * spacing * spacing;
                let bound = if spacing < 0.03 { 0.08 } else { 0.2 };
                assert!((found / area - 1.0).abs() < bound, "{shape:?} {direction:?}: {found} of {area}");
                assert!(
                    (nozzle.outline_area / area - 1.0).abs() < 0.03,
                    "{}: {shape:?}",
                    nozzle.outline_area
                );
                for column in &nozzle.columns {
                    let front: Vec3 = (column.foot - nozzle.direction * column.depth).cast();
                    let distance = f64::from(shape.signed_distance(front));
                    assert!(column.depth >= 0.0 && distance.abs() < 0.02 * spacing, "{shape:?}: {distance}");
                }
            }
        }
        let spacing = 0.02;
        let columns = Nozzle::new(&sphere, [0.0, 0.0, -1.0], spacing).columns;
        let mean = columns.iter().map(|column| column.foot).sum::<Vector3<f64>>() / columns.len() as f64;
        assert!((mean.xy() - nalgebra::Vector2::new(0.3, -0.2)).norm() < 1e-6, "symmetric: {mean}");
    }

    /// Distances over h from a particle to its neighbours, with h of `radius` spacings, in the seeding lattice of layers `distance` spacings
    /// apart, stretched by `factor` along the flow at constant volume.
    fn stretched(radius: f64, distance: f64, factor: f64) -> Vec<f64> {
        let reach = (radius * factor.sqrt()).ceil() as i32 + 1;
        let side = -reach..=reach;
        let mut found = Vec::new();
        for u in side.clone() {
            for w in side.clone() {
                let shift = SHIFTS[0] * f64::from(u) + SHIFTS[1] * f64::from(w);
                let across = f64::from(u * u + w * w) / factor;
                let nearest = -shift.round() as i32;
                for layer in nearest - reach..=nearest + reach {
                    let along = (f64::from(layer) + shift) * distance * factor;
                    found.push((across + along * along).sqrt() / radius);
                }
            }
        }
        found.retain(|&q| q < 1.0);
        found
    }

    #[test]
    fn a_stretched_jet_has_its_density_and_no_pairs() {
        for radius in [1.8_f32, 2.0, 2.2, 2.5] {
            let kernel = Kernel::Wendland;
            let rest = RestState::new(kernel, 1.0, radius);
            let distance = layer_distance(&rest);
            assert!((1.0..1.01).contains(&distance), "{radius}: {distance}");
            for factor in [1.0, 1.3, 1.7, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.0] {
                let found = stretched(f64::from(radius), distance, factor);
                let sum: f64 = found.iter().map(|&q| kernel.density(q)).sum();
                let density = f64::from(rest.density_scale) * sum;
                let closest =
                    found.iter().copied().filter(|&q| q > 0.0).fold(1.0, f64::min) * f64::from(radius);
                println!("{radius}, stretched {factor}: density {density:.4}, closest {closest:.3}");
                assert!(factor > 1.0 || density <= 1.0, "{radius}: {density}");
                let bound = if radius < 2.0 { 0.03 } else { 0.01 };
                assert!((density - 1.0).abs() < bound, "{radius}, {factor}: {density}");
                assert!(closest > 0.85, "{factor}: {closest} spacings");
            }
        }
        let paper = layer_distance(&RestState::new(Kernel::Poly6Spiky, 1.0, 2.0));
        assert!((1.0..1.02).contains(&paper), "{paper}");
    }

    #[test]
    fn a_nozzle_narrower_than_the_spacing_is_one_column() {
        let shape = Shape::Disc { center: [0.0; 3], normal: [0.0, 0.0, 1.0], radius: 0.003, thickness: 0.0 };
        let nozzle = Nozzle::new(&shape, [0.0, 0.0, 1.0], 0.02);
        assert_eq!(nozzle.columns.len(), 1);
        assert!((nozzle.outline_area / (PI * 9e-6) - 1.0).abs() < 0.5, "{}", nozzle.outline_area);
        assert!(Nozzle::new(&shape, [0.0; 3], 0.02).columns.is_empty());
        let plane = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        assert!(Nozzle::new(&plane, [0.0, 0.0, 1.0], 0.02).columns.is_empty());
        assert_eq!(grid_points(&plane, [0.0, 0.0, 1.0], 0.02), f64::INFINITY);
    }
}
