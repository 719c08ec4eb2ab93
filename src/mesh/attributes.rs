//! Attribute transfer: interpolation of particle channels to the vertices of a surface.
//!
//! *Method*: numbers and vectors by a normalised kernel sum [shepard68], A(x) = Σ w_j A_j / Σ w_j with w_j =
//! (1 − (r_j/R)²)³; integers from the nearest particle; vorticity as the curl of the linear velocity field
//! that fits the particles around best, by least squares weighted with w_j: G = (Σ w dv dxᵀ)(Σ w dx dxᵀ)⁻¹
//! with dx, dv from the weighted means, so that rigid rotation is exact from one side too.
//! *Departs from the paper*: the weight has compact support instead of a singularity at the samples, so that
//! single particles do not show.
//!
//! Symbols: R → `radius` [m]; r_j → distance to particle j [m]; G → velocity gradient [1/s].
//! Limits: where the particles around lie in a plane or on a line, G contains only the motion along it.

use crate::{
    frame::{COLOR, Channel, ChannelData, Column, Columns},
    math::Vec3,
    par,
    space::CellGrid,
};

/// The part of its trace added to Σ w dx dxᵀ, which makes it invertible where all particles lie in a plane.
/// If it is smaller, rounding of the particles' positions shows; if larger, the vorticity of thin layers is
/// too small.
const REGULARISATION: f64 = 1e-5;

/// Names of the channels that vertices have if the parameters name none.
const DEFAULT: [&str; 2] = ["velocity", COLOR];

/// Source of an attribute.
#[derive(Clone, Copy)]
enum Source<'a> {
    Vectors(&'a [Vec3]),
    Numbers(&'a [f32]),
    Integers(&'a [u32]),
    /// The curl of these velocities.
    Curl(&'a [Vec3]),
}

/// The channels `names` of `particles` at `vertices`, interpolated from the particles within `radius` [m]. Positions are finite. Also
/// returns how many vertices had no particle within that radius and got the values of the nearest particle. Without names:
/// `velocity` and `color`, if they are vectors. `vorticity` is computed from `velocity` if there is no such channel. Without particles, and at
/// vertices that are not finite, values are zero, and counted as well.
///
/// # Errors
/// The first name that does not exist.
///
/// # Panics
/// If there are no positions.
pub fn transfer<'a>(
    particles: impl Into<Columns<'a>>,
    names: Option<&[String]>,
    vertices: &[Vec3],
    radius: f32,
) -> Result<(Vec<Channel>, usize), String> {
    let particles = &particles.into();
    let default = DEFAULT.iter().filter(|name| particles.vec3(name).is_some());
    let default: Vec<String> = default.map(|name| (*name).to_owned()).collect();
    let names = names.unwrap_or(&default);
    let sources: Vec<Source> = names
        .iter()
        .map(|name| source(particles, name).ok_or_else(|| name.clone()))
        .collect::<Result<_, _>>()?;
    if sources.is_empty() {
        return Ok((Vec::new(), 0));
    }
    let positions = particles.vec3("position").expect("particles have positions");
    let (columns, missing) = interpolate(vertices, positions, &sources, radius);
    let named = names.iter().zip(columns);
    Ok((named.map(|(name, data)| Channel { name: name.clone(), data }).collect(), missing))
}

/// The source of an attribute of that name.
fn source<'a>(particles: &Columns<'a>, name: &str) -> Option<Source<'a>> {
    match particles.column(name) {
        Some(Column::Vec3(values)) => Some(Source::Vectors(values)),
        Some(Column::F32(values)) => Some(Source::Numbers(values)),
        Some(Column::U32(values)) => Some(Source::Integers(values)),
        None if name == "vorticity" => particles.vec3("velocity").map(Source::Curl),
        None => None,
    }
}

/// One column per source, and the number of vertices with the nearest particle's values.
fn interpolate(
    vertices: &[Vec3],
    particles: &[Vec3],
    sources: &[Source],
    radius: f32,
) -> (Vec<ChannelData>, usize) {
    let cells = CellGrid::new(particles, radius);
    let parts = par::map_chunks(vertices.len(), par::CHUNK, |range| {
        let mut columns: Vec<ChannelData> = sources.iter().map(|source| source.column(range.len())).collect();
        let mut missing = Vec::new();
        let mut neighbours = Vec::new();
        for v in range {
            // Gather once for all columns.
            neighbours.clear();
            let x = vertices[v];
            let mut weights = 0.0;
            if x.iter().all(|x| x.is_finite()) {
                cells.for_each_within(particles, x, radius, |j, r2| {
                    let w = (1.0 - r2 / (radius * radius)).powi(3);
                    weights += w;
                    neighbours.push((j as u32, r2, w));
                });
            }
            if weights > f32::MIN_POSITIVE {
                let neighbours = Neighbours { list: &neighbours, weights, particles };
                sources
                    .iter()
                    .zip(&mut columns)
                    .for_each(|(source, column)| source.mean(&neighbours, column));
            } else {
                missing.push(v);
                sources.iter().zip(&mut columns).for_each(|(source, column)| source.of(None, column));
            }
        }
        (columns, missing)
    });

    // Join the parts, and fill missing values.
    let mut columns: Vec<ChannelData> = sources.iter().map(|source| source.column(vertices.len())).collect();
    let mut missing = Vec::new();
    for (part, without) in parts {
        columns.iter_mut().zip(part).for_each(|(column, part)| append(column, part));
        missing.extend(without);
    }
    let nearest = nearest(&missing, vertices, particles, radius);
    for (&v, &j) in missing.iter().zip(&nearest) {
        for (source, column) in sources.iter().zip(&mut columns) {
            let mut value = source.column(1);
            source.of(j, &mut value);
            match (column, value) {
                (ChannelData::Vec3(column), ChannelData::Vec3(value)) => column[v] = value[0],
                (ChannelData::F32(column), ChannelData::F32(value)) => column[v] = value[0],
                (ChannelData::U32(column), ChannelData::U32(value)) => column[v] = value[0],
                _ => unreachable!("a source has one kind of column"),
            }
        }
    }
    (columns, missing.len())
}

/// Appends `part` to `column`.
fn append(column: &mut ChannelData, part: ChannelData) {
    match (column, part) {
        (ChannelData::Vec3(column), ChannelData::Vec3(part)) => column.extend(part),
        (ChannelData::F32(column), ChannelData::F32(part)) => column.extend(part),
        (ChannelData::U32(column), ChannelData::U32(part)) => column.extend(part),
        _ => unreachable!("a source has one kind of column"),
    }
}

/// The particles around a vertex: (index, squared distance, w_j), and Σ w_j.
struct Neighbours<'a> {
    list: &'a [(u32, f32, f32)],
    weights: f32,
    particles: &'a [Vec3],
}

impl Source<'_> {
    /// An empty column with capacity for `len` values.
    fn column(self, len: usize) -> ChannelData {
        match self {
            Self::Vectors(_) | Self::Curl(_) => ChannelData::Vec3(Vec::with_capacity(len)),
            Self::Numbers(_) => ChannelData::F32(Vec::with_capacity(len)),
            Self::Integers(_) => ChannelData::U32(Vec::with_capacity(len)),
        }
    }

    /// Adds the value of particle `j`, or zero, to the column; a single particle has no vorticity.
    fn of(self, j: Option<u32>, column: &mut ChannelData) {
        let j = j.map(|j| j as usize);
        match (self, column) {
            (Self::Vectors(values), ChannelData::Vec3(to)) => to.push(j.map_or(Vec3::zeros(), |j| values[j])),
            (Self::Curl(_), ChannelData::Vec3(to)) => to.push(Vec3::zeros()),
            (Self::Numbers(values), ChannelData::F32(to)) => to.push(j.map_or(0.0, |j| values[j])),
            (Self::Integers(values), ChannelData::U32(to)) => to.push(j.map_or(0, |j| values[j])),
            _ => unreachable!("a source has one kind of column"),
        }
    }

    /// Adds the mean over the particles around.
    fn mean(self, neighbours: &Neighbours, column: &mut ChannelData) {
        match (self, column) {
            (Self::Vectors(values), ChannelData::Vec3(to)) => {
                let mut sum = Vec3::zeros();
                neighbours.list.iter().for_each(|&(j, _, w)| sum += values[j as usize] * w);
                to.push(sum / neighbours.weights); // A(x), [shepard68]
            }
            (Self::Numbers(values), ChannelData::F32(to)) => {
                let sum: f32 = neighbours.list.iter().map(|&(j, _, w)| values[j as usize] * w).sum();
                to.push(sum / neighbours.weights);
            }
            (Self::Integers(values), ChannelData::U32(to)) => {
                let nearer =
                    |a: &&(u32, f32, f32), b: &&(u32, f32, f32)| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0));
                to.push(neighbours.list.iter().min_by(nearer).map_or(0, |&(j, ..)| values[j as usize]));
            }
            (Self::Curl(values), ChannelData::Vec3(to)) => to.push(curl(neighbours, values)),
            _ => unreachable!("a source has one kind of column"),
        }
    }
}

/// The curl of the best linear fit of velocities.
fn curl(neighbours: &Neighbours, velocities: &[Vec3]) -> Vec3 {
    type Vector = nalgebra::Vector3<f64>;
    type Matrix = nalgebra::Matrix3<f64>;
    let mean = |values: &[Vec3]| {
        let sum = neighbours
            .list
            .iter()
            .fold(Vector::zeros(), |sum, &(j, _, w)| sum + values[j as usize].cast::<f64>() * f64::from(w));
        sum / f64::from(neighbours.weights)
    };
    let (x_mean, v_mean) = (mean(neighbours.particles), mean(velocities));
    let (mut spread, mut drift) = (Matrix::zeros(), Matrix::zeros());
    for &(j, _, w) in neighbours.list {
        let dx = neighbours.particles[j as usize].cast::<f64>() - x_mean;
        let dv = velocities[j as usize].cast::<f64>() - v_mean;
        spread += dx * dx.transpose() * f64::from(w);
        drift += dv * dx.transpose() * f64::from(w);
    }
    let Some(inverse) = (spread + Matrix::identity() * (REGULARISATION * spread.trace())).try_inverse()
    else {
        return Vec3::zeros();
    };
    let g = drift * inverse; // G
    let curl = Vector::new(g[(2, 1)] - g[(1, 2)], g[(0, 2)] - g[(2, 0)], g[(1, 0)] - g[(0, 1)]);
    curl.cast()
}

/// The particle nearest to each of some vertices (the first of equals), in growing radii.
fn nearest(missing: &[usize], vertices: &[Vec3], particles: &[Vec3], radius: f32) -> Vec<Option<u32>> {
    let mut found = vec![None; missing.len()];
    let mut radius = radius;
    let finite = |v: usize| vertices[v].iter().all(|x| x.is_finite());
    while !particles.is_empty() && (0..missing.len()).any(|i| found[i].is_none() && finite(missing[i])) {
        radius *= 2.0;
        let cells = CellGrid::new(particles, radius);
        par::update(&mut found, |i, slot| {
            if slot.is_some() || !finite(missing[i]) {
                return;
            }
            let best = cells.nearest_within(particles, vertices[missing[i]], radius, |_| true);
            // A radius beyond all numbers reaches everything: the search ends.
            *slot = best.map(|j| j as u32).or((!radius.is_finite()).then_some(0));
        });
    }
    found
}
