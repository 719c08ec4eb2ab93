//! Memory of making surface meshes.

use super::bricks::bricks_around;
use crate::{
    field::{DensityParams, coarse_step, surface_size},
    frame::{COLOR, Column, Columns, Stream},
    grid::BRICK_NODES,
    job::memory::{BASE_MEMORY, Grids},
    math::Vec3,
    mesh::{DistanceParams, RadiusScales, SurfaceParams, is_far},
    sdf::Order,
};

/// Memory of a surface as it is cut, until its normals are found [bytes/brick of the density] …
const CUT_BRICK_BYTES: f64 = 2165.0;

/// … and [bytes/vertex] …
const CUT_VERTEX_BYTES: f64 = 18.0;

/// … and when it is checked, after the density is freed [bytes/vertex], its triangles included. Estimated peaks of one frame
/// each of seven presets in three tiers are 8 % low to 7 % high; of a splash of 945 000 particles at voxel 0.25 a fifth high.
const CHECKED_VERTEX_BYTES: f64 = 105.0;

/// Memory of a surface that is cleaned up or cut from distances [bytes/brick of the density] …
const BRICK_BYTES: f64 = 2950.0;

/// … and of its mesh [bytes/vertex], its triangles included …
const VERTEX_BYTES: f64 = 67.0;

/// … and more where it is smoothed: 99 to 126 were measured.
const SMOOTHED_VERTEX_BYTES: f64 = 125.0;

/// … or fitted to colliders, if it is not smoothed: half-edges, normals and where the vertices were (118 MB were measured of a splash whose
/// estimate is 133 MB) …
const FITTED_VERTEX_BYTES: f64 = 70.0;

/// … or decimated, after that: 1.22 GB were measured with 3.1 million vertices.
const DECIMATED_VERTEX_BYTES: f64 = 245.0;

/// Memory of the signed distance [bytes/brick of it]: its nodes twice, and the state of the sweeps.
const DISTANCE_BRICK_BYTES: f64 = 6400.0;

/// … and more at second order: the lists of waiting nodes.
const SECOND_ORDER_BRICK_BYTES: f64 = 4.0 * BRICK_NODES as f64;

/// Memory of the coarse nodes while the density is computed [bytes/brick].
const COARSE_BRICK_BYTES: f64 = 2150.0;

/// Part of the memory of a vertex that is its velocity [bytes], which many files lack.
const VELOCITY_BYTES: f64 = 12.0;

/// What meshing takes over the bricks of the coarse nodes alone: 1.5 to 2.5 where spray has more of them than of others.
const OVER_COARSE: f64 = 2.0;

/// Memory of the frame, the particles' order in cells and their weights [bytes/particle] …
const PARTICLE_BYTES: f64 = 64.0;

/// … and more where every kernel has a shape or a radius of its own: 28 to 95 were measured of shapes.
const OWN_KERNEL_BYTES: f64 = 70.0;

/// Bricks that are computed over those found near the surface at first: 1.00 to 1.05 on splashes and sprays.
const OPENED_BRICKS: f64 = 1.05;

/// Peak memory of meshing so many particles, whose vertices have velocities [bytes].
pub(crate) fn surface_memory(particles: usize, grids: Grids, params: &SurfaceParams) -> u64 {
    memory(particles, grids, params, 0.0)
}

/// Peak memory of meshing so many particles, with so many more bytes of attributes for each vertex than a velocity takes
/// [bytes].
fn memory(particles: usize, grids: Grids, params: &SurfaceParams, attributes: f64) -> u64 {
    let named = |is_named: bool, bytes: f64| if is_named { bytes } else { 0.0 };
    let has_own_kernels = params.anisotropy.is_some() || params.radius.is_some();
    let distance = params.needed_distance();
    let particle = PARTICLE_BYTES + named(has_own_kernels, OWN_KERNEL_BYTES);
    let Grids { bricks, vertices, coarse_bricks, distance_bricks } = grids;
    let held = if params.has_no_cleanup() && distance.is_none() {
        (bricks * CUT_BRICK_BYTES + vertices * CUT_VERTEX_BYTES)
            .max(vertices * (CHECKED_VERTEX_BYTES + attributes))
    } else {
        let cleaned = named(params.smoothing.is_some(), SMOOTHED_VERTEX_BYTES)
            .max(named(params.contact.is_some(), FITTED_VERTEX_BYTES))
            .max(named(params.decimation.is_some(), DECIMATED_VERTEX_BYTES));
        let is_second_order = distance.is_some_and(|distance| distance.order == Order::Second);
        let distance = distance_bricks
            * (named(distance.is_some(), DISTANCE_BRICK_BYTES)
                + named(is_second_order, SECOND_ORDER_BRICK_BYTES));
        bricks * BRICK_BYTES + distance + vertices * (VERTEX_BYTES + cleaned)
    };
    let sampled = bricks * CUT_BRICK_BYTES + coarse_bricks * COARSE_BRICK_BYTES;
    (BASE_MEMORY + particles as f64 * particle + held.max(sampled)) as u64
}

/// Bytes of the attributes of a vertex over those of a velocity.
fn attribute_bytes(particles: &Columns, params: &SurfaceParams) -> f64 {
    let bytes = |name: &String| match particles.column(name) {
        Some(Column::F32(_) | Column::U32(_)) => 4.0,
        _ => 12.0,
    };
    let requested = match &params.attributes {
        Some(names) => names.iter().map(bytes).sum(),
        None => {
            ["velocity", COLOR].iter().filter(|name| particles.vec3(name).is_some()).count() as f64
                * VELOCITY_BYTES
        }
    };
    requested - VELOCITY_BYTES
}

/// The largest memory that meshing so many particles was seen to take [bytes].
pub(crate) fn max_surface_memory(particles: usize, params: &SurfaceParams) -> u64 {
    surface_memory(particles, Grids::at_most(particles, params.voxel), params)
}

/// The memory that meshing particles needs, by where they are \[bytes\]: a bound if that is at most `enough`, else an
/// estimate, which takes longer. Estimates of whole runs are 10 % low to 45 % high. Positions are finite.
pub fn stream_memory<'a>(
    particles: impl Into<Columns<'a>>,
    spacing: f32,
    params: &'a SurfaceParams,
    enough: u64,
) -> u64 {
    let placed = Placed::new(particles, spacing, params);
    let bound = placed.memory(Grids::of_bricks(placed.bricks(1.0) as f64));
    if bound <= enough { bound } else { placed.estimate(enough).bytes.min(bound) }
}

/// An estimate of memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MemoryEstimate {
    pub(crate) bytes: u64,
    /// Whether meshing needs more, because the grids are too large to be sampled.
    pub(crate) is_lower_bound: bool,
}

/// An estimate of the memory that meshing a stream needs; a lower bound if the coarse nodes take more than `affordable` [bytes].
pub(super) fn estimated_memory(
    stream: &Stream,
    spacing: f32,
    params: &SurfaceParams,
    affordable: u64,
) -> MemoryEstimate {
    Placed::new(stream, spacing, params).estimate(affordable)
}

/// Particles, and how they are meshed.
struct Placed<'a> {
    particles: Columns<'a>,
    positions: &'a [Vec3],
    radii: Option<RadiusScales>,
    spacing: f32,
    params: &'a SurfaceParams,
}

impl<'a> Placed<'a> {
    fn new(particles: impl Into<Columns<'a>>, spacing: f32, params: &'a SurfaceParams) -> Self {
        let particles = particles.into();
        let positions = particles.vec3("position").unwrap_or_default();
        // Where radii are missing, meshing fails and needs nothing.
        let radii = RadiusScales::of(&particles, spacing, params).ok().flatten();
        Self { particles, positions, radii, spacing, params }
    }

    fn scales(&self) -> Option<&[f32]> {
        self.radii.as_ref().map(|radii| &*radii.values)
    }

    /// The bricks of a grid whose voxels are `step` times as wide.
    fn bricks(&self, step: f32) -> usize {
        let params = SurfaceParams { voxel: self.params.voxel * step, ..self.params.clone() };
        bricks_around(self.positions, self.scales(), self.spacing, &params)
    }

    fn memory(&self, grids: Grids) -> u64 {
        let Self { particles, spacing, params, .. } = self;
        memory(particles.len(), grids, params, attribute_bytes(particles, params))
            + copied_bytes(particles, *spacing, params)
    }

    fn estimate(&self, affordable: u64) -> MemoryEstimate {
        // Surfacing samples the density on coarse bricks first: if those do not fit, nothing does.
        let step = coarse_step(&density_params(self.spacing, self.params)) as f32;
        let coarse = (self.bricks(step) * BRICK_NODES * size_of::<f32>()) as f64;
        if coarse > affordable as f64 {
            let bytes = self.memory(Grids::default()) + (OVER_COARSE * coarse) as u64;
            return MemoryEstimate { bytes, is_lower_bound: true };
        }
        MemoryEstimate { bytes: self.memory(self.grids()), is_lower_bound: false }
    }

    /// The grids of the surface by its coarse nodes, else by the bricks in reach.
    fn grids(&self) -> Grids {
        let band = self.params.needed_distance().map_or(0.0, |distance| distance.order.reach(distance.band));
        let density = density_params(self.spacing, self.params);
        let Some(size) = surface_size(self.positions, self.scales(), &density, band) else {
            return Grids::of_bricks(self.bricks(1.0) as f64);
        };
        Grids {
            bricks: size.bricks as f64 * OPENED_BRICKS,
            vertices: size.vertices as f64,
            coarse_bricks: size.coarse_bricks as f64,
            distance_bricks: size.distance_bricks as f64,
        }
    }
}

/// Bytes of the copy of particles that are far from the origin.
fn copied_bytes(particles: &Columns, spacing: f32, params: &SurfaceParams) -> u64 {
    let bytes = |column: &Column| match column {
        Column::F32(_) | Column::U32(_) => 4,
        Column::Vec3(_) => 12,
    };
    let each: usize = particles.columns().iter().map(|(_, column)| bytes(column)).sum();
    if is_far(particles, params.voxel * spacing) { (particles.len() * each) as u64 } else { 0 }
}

/// The memory that meshing a stream takes, from which `triangles` were made [bytes].
pub(super) fn meshed_memory(stream: &Stream, spacing: f32, params: &SurfaceParams, triangles: u64) -> u64 {
    let placed = Placed::new(stream, spacing, params);
    // A closed mesh has about half as many vertices as triangles.
    placed.memory(Grids { vertices: triangles as f64 / 2.0, ..placed.grids() })
}

fn density_params(spacing: f32, params: &SurfaceParams) -> DensityParams {
    let SurfaceParams { voxel, kernel_radius, .. } = *params;
    DensityParams { spacing, kernel_radius, voxel, anisotropy: None, whole: false }
}

/// The largest memory that reading and meshing a level set of so many bricks takes [bytes]: that of a surface by distances,
/// whose density and distance take as much as the file and its tree.
pub(super) fn level_set_memory(bricks: usize) -> u64 {
    let params = SurfaceParams { distance: Some(DistanceParams::default()), ..SurfaceParams::default() };
    surface_memory(0, Grids::of_bricks(bricks as f64), &params)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_a_single_frame_follows_its_passes() {
        // Particles, bricks, vertices, and the peaks of `meniscus mesh --frames N` [MiB]: plain, with kernels, smoothed.
        use crate::{field::Anisotropy, mesh::SmoothingParams};
        for (particles, bricks, vertices, found) in [
            (103_823, 4_165.0, 270_096.0, [43.5, 49.3, 73.0]),
            (116_640, 6_472.0, 332_018.0, [52.6, 60.3, 91.0]),
            (127_493, 7_424.0, 772_682.0, [89.4, 92.8, 179.6]),
            (54_460, 2_117.0, 93_508.0, [24.0, 26.7, 32.8]),
            (92_875, 8_364.0, 376_784.0, [44.0, 45.0, 91.0]),
            (945_220, 67_159.0, 3_123_674.0, [317.7, 318.0, 701.0]),
            (52_098, 95_602.0, 2_808_524.0, [277.0, 287.0, 741.0]),
        ] {
            let plain = SurfaceParams::default();
            let kernels = SurfaceParams { anisotropy: Some(Anisotropy::default()), ..plain.clone() };
            let smoothed = SurfaceParams { smoothing: Some(SmoothingParams::default()), ..plain.clone() };
            for (params, found) in [plain, kernels, smoothed].iter().zip(found) {
                let estimate =
                    surface_memory(particles, Grids { vertices, ..Grids::of_bricks(bricks) }, params) as f64
                        / f64::from(1 << 20);
                assert!(
                    (0.9..1.45).contains(&(estimate / found)),
                    "{particles}: {estimate} MiB, found {found}"
                );
            }
        }
    }
}
