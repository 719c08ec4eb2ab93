//! What a picture shows: meshes, balls, fog and lines, as plain data.

use crate::math::Vec3;
use nalgebra::Vector3;

/// Largest coordinate of what is drawn [m].
const MAX_PLACE: f64 = 1e9;

/// A box around what a shot shows [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    /// Lower corner.
    pub(crate) low: Vector3<f64>,
    /// Upper corner.
    pub(crate) high: Vector3<f64>,
}

impl Bounds {
    /// The box that has nothing in it.
    pub(crate) fn empty() -> Self {
        Self { low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) }
    }

    /// Whether it has an extent, and all numbers are finite and within 10⁹.
    pub(crate) fn exists(&self) -> bool {
        let within = |x: &f64| x.abs() <= MAX_PLACE;
        self.low.iter().chain(&self.high).all(within) && self.size() > 0.0 && self.low <= self.high
    }

    /// The smallest box around both.
    #[must_use]
    pub(crate) fn union(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Length of the diagonal [m].
    pub(crate) fn size(&self) -> f64 {
        (self.high - self.low).norm()
    }

    /// The middle [m].
    pub(crate) fn middle(&self) -> Vector3<f64> {
        0.5 * (self.low + self.high)
    }
}

/// Triangles of one material. Faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    /// Vertices, relative to `origin` [m].
    pub(crate) positions: Vec<Vec3>,
    /// Origin of the vertices [m].
    pub(crate) origin: Vector3<f64>,
    /// A normal for each vertex, of any length.
    pub(crate) normals: Vec<Vec3>,
    /// Three vertices per triangle.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Linear colour of each vertex, in place of the colours of front and back; empty: they have none.
    pub(crate) colours: Vec<[f32; 3]>,
    /// Linear colour of the front.
    pub(crate) front: [f32; 3],
    /// Linear colour of the back, whose normals are those of the front, turned round.
    pub(crate) back: [f32; 3],
}

impl Surface {
    /// The corners of a triangle [m]; `None` if one does not exist, or has no finite place within 10⁹ m.
    pub(super) fn corners(&self, triangle: usize) -> Option<[Vector3<f64>; 3]> {
        let [a, b, c] = self.triangles[triangle].map(|corner| {
            let x = self.positions.get(corner as usize)?.cast::<f64>() + self.origin;
            x.iter().all(|x| x.abs() <= MAX_PLACE).then_some(x)
        });
        Some([a?, b?, c?])
    }

    /// Colour of a triangle, which exists: the mean of its corners, or that of its side.
    pub(super) fn colour(&self, triangle: usize, is_back: bool) -> [f32; 3] {
        if self.colours.is_empty() {
            return if is_back { self.back } else { self.front };
        }
        let corners = self.triangles[triangle];
        let of = |corner: u32| self.colours.get(corner as usize).copied().unwrap_or_default();
        std::array::from_fn(|part| corners.iter().map(|&corner| of(corner)[part]).sum::<f32>() / 3.0)
    }

    /// The normals at the corners of a triangle, which exists; upwards where there are none.
    pub(super) fn normals_at(&self, triangle: usize) -> [[f32; 3]; 3] {
        self.triangles[triangle].map(|corner| {
            let normal = self.normals.get(corner as usize).copied().unwrap_or_else(Vec3::z);
            if normal.iter().all(|x| x.is_finite()) { normal.into() } else { [0.0, 0.0, 1.0] }
        })
    }
}

/// Balls, each with its radius and colour.
#[derive(Clone, Debug, Default)]
pub(crate) struct Balls {
    /// Centres [m].
    pub(crate) positions: Vec<Vec3>,
    /// Radii [m]: one of all, or one each.
    pub(crate) radii: Vec<f32>,
    /// Linear colours: one of all, or one each.
    pub(crate) colours: Vec<[f32; 3]>,
}

impl Balls {
    /// The radius of a ball [m]; 0 if it is not finite.
    pub(super) fn radius(&self, i: usize) -> f32 {
        let radius = self.radii.get(i).or(self.radii.first()).copied().unwrap_or(0.0);
        if radius.is_finite() { radius.max(0.0) } else { 0.0 }
    }

    /// The colour of a ball.
    pub(super) fn colour(&self, i: usize) -> [f32; 3] {
        self.colours.get(i).or(self.colours.first()).copied().unwrap_or([0.5; 3])
    }
}

/// Points that together are a fog.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fog {
    /// Places [m].
    pub(crate) positions: Vec<Vec3>,
    /// Density of each, 1 for full; empty: all are full.
    pub(crate) densities: Vec<f32>,
    /// Distance between neighbours where the fog is at rest [m].
    pub(crate) spacing: f32,
}

/// Everything that a picture shows.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    /// Opaque surfaces.
    pub(crate) solids: Vec<Surface>,
    /// Closed surfaces of clear liquid.
    pub(crate) water: Vec<Surface>,
    /// Surfaces of clear glass.
    pub(crate) glass: Vec<Surface>,
    /// Balls.
    pub(crate) balls: Vec<Balls>,
    /// Fog.
    pub(crate) fog: Vec<Fog>,
    /// Lines, such as the edges of a tank [m].
    pub(crate) lines: Vec<[Vec3; 2]>,
    /// Height of the ground [m]; `None`: there is none.
    pub(crate) ground: Option<f64>,
    /// Box around what the shot shows in all of its frames; it decides the light and the scale of the ground's grid.
    pub(crate) bounds: Bounds,
    /// Whether the surroundings are dark, for what is bright itself.
    pub(crate) is_dark: bool,
}

impl Model {
    /// A model that shows nothing in these bounds.
    pub(crate) fn empty(bounds: Bounds) -> Self {
        let (solids, water, glass) = (Vec::new(), Vec::new(), Vec::new());
        let (balls, fog, lines) = (Vec::new(), Vec::new(), Vec::new());
        Self { solids, water, glass, balls, fog, lines, ground: None, bounds, is_dark: false }
    }
}

/// What a picture left out, since its numbers make no place in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LeftOut {
    /// Triangles with a corner that has no finite place within 10⁹ m, or that does not exist.
    pub(crate) triangles: u64,
    /// Balls, points of fog and lines without a finite place within 10⁹ m.
    pub(crate) points: u64,
    /// Balls around the camera or its near plane.
    pub(crate) at_camera: u64,
}

impl LeftOut {
    /// Adds what another part left out.
    pub(super) fn add(&mut self, other: Self) {
        self.triangles += other.triangles;
        self.points += other.points;
        self.at_camera += other.at_camera;
    }
}

/// Whether a place is finite and within 10⁹ m.
pub(super) fn is_place(x: &Vec3) -> bool {
    x.iter().all(|&x| f64::from(x).abs() <= MAX_PLACE)
}

impl Fog {
    /// The density of a point, 1 for full; 0 if it is not finite.
    pub(super) fn density(&self, i: usize) -> f32 {
        let density = self.densities.get(i).copied().unwrap_or(1.0);
        if density.is_finite() { density.clamp(0.0, 1e3) } else { 0.0 }
    }
}
