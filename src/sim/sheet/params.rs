//! What a preset can say about sheets.

use crate::solid::{Interpolation, Keyframe, Shape};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Every sheet of a shot, and what they have in common.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetsParams {
    /// The sheets.
    pub sheet: Vec<SheetParams>,
    /// What they have in common.
    #[serde(default, rename = "sheets")]
    pub common: SheetsCommon,
}

/// What all sheets have in common: what joins them, how solids meet them and how they are solved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SheetsCommon {
    /// What joins points of sheets to each other.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joint: Vec<Joint>,
    /// How solids push sheets off before they touch; absent: they only stop what enters them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repulsion: Option<Repulsion>,
    /// How sheets meet each other and themselves; absent: they pass through.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<Contact>,
    /// Friction of sheets on solids, Coulomb's coefficient: 0 slides as on ice, 0.3 cloth on wood, 1 clings; absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0))]
    pub friction: Option<f32>,
    /// How far off solids points stay [m], which also keeps faces, straight between their points, from cutting into what is round: on a ball of radius R
    /// a face needs d²/8R, with d its longest diagonal as it lies. Absent: half of the thickness of `contact`, or nothing without it. Too large floats; where solids
    /// leave less room than twice it, points stay less far off. What starts nearer is moved off in the first substep.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "m", "minimum" = 0.0))]
    pub clearance: Option<f32>,
    /// How they are advanced in time.
    pub solver: SheetSolver,
}

/// One sheet: a membrane of points and springs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SheetParams {
    /// Its name, which files carry; no two sheets share one.
    pub name: String,
    /// Where it is at the start, which is also its shape without tension (but see `rest`).
    pub shape: SheetShape,
    /// Mass of a square metre [kg/m²]: silk 0.05, cotton 0.15, rubber 1. Lighter moves faster and takes more substeps.
    #[schemars(extend("unit" = "kg/m²", "exclusiveMinimum" = 0.0))]
    pub density: f32,
    /// Membrane stiffness along the first and the second direction [N/m]: the tension of a strip of 1 m width at a strain of 1.
    /// 10 sags like rubber film, 1000 like cloth. Too small stretches without end, large takes more substeps. Of a mesh the first
    /// direction is `grain`.
    #[schemars(extend("unit" = "N/m"))]
    pub stiffness: [f32; 2],
    /// Rest length of springs, as a part of their length at the start, by direction. Below 1 the sheet starts taut, above 1 slack;
    /// 0 is soap film.
    #[serde(default = "ones")]
    pub rest: [f32; 2],
    /// Stiffness against shear [N/m], by springs along the diagonals of quads; absent: quads shear freely, as loose weave does. Triangles
    /// have it by their edges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "N/m", "minimum" = 0.0))]
    pub shear: Option<f32>,
    /// Flexural rigidity [N·m]: silk 1e-6, cotton 1e-5, paper 1e-3, sheet metal 1; absent: it folds freely.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "N·m", "minimum" = 0.0))]
    pub bending: Option<f32>,
    /// Rate at which all motion dies [1/s], as in thick air: after 1/rate a third of the speed is left. It slows falling, too; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "1/s", "minimum" = 0.0))]
    pub damping: Option<f32>,
    /// Time within which springs damp their own change of length [s], by direction (shear takes the mean, bending has none): 0.001 calms
    /// cloth, 0.1 is dough; absent: none. Falling and turning are left alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "s"))]
    pub spring_damping: Option<[f32; 2]>,
    /// Velocity at the start [m/s].
    #[serde(default)]
    #[schemars(extend("unit" = "m/s"))]
    pub velocity: [f32; 3],
    /// The first direction of a mesh's stiffness, in the world at the start; any length but zero.
    #[serde(default = "along_x")]
    pub grain: [f32; 3],
    /// Parts that differ. Where several hold a point their factors multiply.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub region: Vec<Region>,
    /// What holds points in place or leads them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pin: Vec<Pin>,
}

/// The shape of a sheet at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SheetShape {
    /// A rectangular grid of points.
    Grid {
        /// The corner where both directions begin [m].
        #[schemars(extend("unit" = "m"))]
        origin: [f32; 3],
        /// From there along the first direction to the next corner [m].
        #[schemars(extend("unit" = "m"))]
        first: [f32; 3],
        /// From there along the second direction [m].
        #[schemars(extend("unit" = "m"))]
        second: [f32; 3],
        /// Cells along both. More shows finer folds and takes longer. With 0 along one direction the sheet is a chain of points along
        /// the other, as wide as a sheet would be; with 0 along both, one point.
        cells: [u32; 2],
    },
    /// Triangles and quads.
    Mesh(SheetMesh),
}

/// A mesh, which whoever reads files fills in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SheetMesh {
    /// The file, .ply or .obj, in the preset's folder or below it. What is painted on the vertices of a PLY as properties `stiffness`, `rest` and
    /// `damping` are factors, as those of a `region`.
    pub file: String,
    /// Positions in the world [m].
    #[serde(skip)]
    #[schemars(skip)]
    pub points: Vec<[f32; 3]>,
    /// Corners of the faces; a triangle names its last twice.
    #[serde(skip)]
    #[schemars(skip)]
    pub faces: Vec<[u32; 4]>,
    /// Factors painted on points, as those of a [`Region`]: of stiffness, shear and bending; empty: 1 everywhere.
    #[serde(skip)]
    #[schemars(skip)]
    pub stiffness: Vec<f32>,
    /// The same of rest lengths, …
    #[serde(skip)]
    #[schemars(skip)]
    pub rest: Vec<f32>,
    /// … and of both kinds of damping.
    #[serde(skip)]
    #[schemars(skip)]
    pub damping: Vec<f32>,
}

/// A part of a sheet that differs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Where it is at the start: the points within this shape.
    pub shape: Shape,
    /// Factor of stiffness, shear and bending.
    #[serde(default = "one")]
    #[schemars(extend("minimum" = 0.0))]
    pub stiffness: f32,
    /// Factor of the rest lengths of springs, those against shear too: below 1 it draws together, as a hem with elastic, above 1 it is slack
    /// and ruffles. A spring takes the mean of its ends, as of every factor.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(extend("minimum" = 0.0))]
    pub rest: f32,
    /// Factor of both kinds of damping.
    #[serde(default = "one")]
    #[schemars(extend("minimum" = 0.0))]
    pub damping: f32,
    /// Factor of the mass.
    #[serde(default = "one")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub density: f32,
}

/// Which points of a sheet are meant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Select {
    /// The four corners of a grid.
    Corners,
    /// The point nearest to the centre of mass.
    Center,
    /// The point nearest to a place in the world at the start [m].
    Nearest([f32; 3]),
    /// All points within a shape at the start.
    Inside(Shape),
    /// Points by their numbers.
    Points(Vec<u32>),
}

/// What holds points in place or leads them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pin {
    /// The points.
    pub at: Select,
    /// Stiffness of the spring that pulls each to its place [N/m]; absent: it is there exactly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "N/m", "exclusiveMinimum" = 0.0))]
    pub stiffness: Option<f32>,
    /// Where the places go, as for colliders; without any they stay.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How they move from keyframe to keyframe.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// The collider, counted from 0, that the places move with, in place of `keyframes`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collider: Option<u32>,
    /// The place that the points are led along, in the axes of the keyframes [m]; absent: each point's own at the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "m"))]
    pub place: Option<[f32; 3]>,
    /// The frame at which it lets go; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<u32>,
}

/// Joins a point of one sheet to a point of the same or another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// The names of the two sheets.
    pub sheets: [String; 2],
    /// The points of each: as many of one as of the other, joined in order.
    pub at: [Select; 2],
    /// Stiffness of the spring that draws them there [N/m]; absent: they are there exactly, and have to be at the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("unit" = "N/m", "exclusiveMinimum" = 0.0))]
    pub stiffness: Option<f32>,
    /// The direction in the world that the second is kept in as seen from the first, however far; any length but zero. Absent: they are
    /// kept together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f32; 3]>,
    /// The frame at which it lets go; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<u32>,
}

/// How solids push sheets off: a potential c·exp(−f/ξ) of the distance f.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Repulsion {
    /// c [J/m²]: a sheet of density ρ rests at the distance where c/ξ·exp(−f/ξ) = ρ g, and falls onto the solid if c/ξ is below.
    #[schemars(extend("unit" = "J/m²", "exclusiveMinimum" = 0.0))]
    pub energy: f32,
    /// ξ [m], over which the push grows by e. Smaller is a harder touch and takes more substeps.
    #[schemars(extend("unit" = "m", "exclusiveMinimum" = 0.0))]
    pub range: f32,
}

/// How sheets meet each other and themselves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// How far apart the middles of two layers are kept [m]: that of the cloth, or more, since faster motion takes more substeps the smaller it is (half
    /// of it is the furthest that layers approach in one). Best below the size of cells: what is closer than that at the start, within a
    /// sheet, is kept apart by 0.7 of what it was.
    #[schemars(extend("unit" = "m", "exclusiveMinimum" = 0.0))]
    pub thickness: f32,
    /// Friction of layers on each other, Coulomb's coefficient: 0.3 silk, 0.6 cotton; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0))]
    pub friction: Option<f32>,
}

/// How sheets are advanced in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SheetSolver {
    /// Which way.
    pub integrator: Integrator,
    /// Substep of the symplectic integrator, as a part of the longest stable one. Smaller follows fast waves better.
    #[schemars(range(min = 0.01, max = 0.95))]
    pub courant: f32,
    /// Substeps of a frame of the implicit integrator. More damps less and costs in proportion.
    #[schemars(range(min = 1, max = 100_000))]
    pub substeps: u32,
    /// Substeps of a frame at most: what needs more stops, and says so.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub max_substeps: u32,
    /// Residual at which the conjugate gradients stop, as a part of the right side. Larger lets stiff sheets stretch.
    #[schemars(range(min = 1e-7, max = 0.5))]
    pub tolerance: f32,
    /// Rounds of the conjugate gradients at most.
    #[schemars(range(min = 1, max = 100_000))]
    pub max_iterations: u32,
}

impl Default for SheetSolver {
    fn default() -> Self {
        Self {
            integrator: Integrator::Symplectic,
            courant: 0.5,
            substeps: 8,
            max_substeps: 100_000,
            tolerance: 1e-4,
            max_iterations: 500,
        }
    }
}

/// A way to advance in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// Semi-implicit Euler: keeps energy, in substeps that follow from stiffness and mass.
    #[default]
    Symplectic,
    /// Implicit Euler: any substep, and damps what is faster than it.
    Implicit,
}

impl Select {
    /// Its shape, if it has one.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Select::Inside(shape) => Some(shape),
            _ => None,
        }
    }

    fn shape_mut(&mut self) -> Option<&mut Shape> {
        match self {
            Select::Inside(shape) => Some(shape),
            _ => None,
        }
    }
}

impl SheetShape {
    /// Points of it, without building it; of a mesh that is not read yet 0.
    pub fn points(&self) -> f64 {
        match self {
            SheetShape::Grid { cells, .. } => cells.iter().map(|&n| f64::from(n) + 1.0).product(),
            SheetShape::Mesh(mesh) => mesh.points.len() as f64,
        }
    }
}

impl SheetsCommon {
    /// How far off solids points stay [m].
    pub(super) fn off(&self) -> f32 {
        let layer = || self.contact.as_ref().map_or(0.0, |contact| 0.5 * contact.thickness);
        self.clearance.unwrap_or_else(layer)
    }

    /// The shapes that are named, to be filled.
    pub fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        self.joint.iter_mut().flat_map(|joint| &mut joint.at).filter_map(Select::shape_mut)
    }
}

impl SheetParams {
    /// The shapes that are named, to be filled.
    pub fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        let regions = self.region.iter_mut().map(|region| &mut region.shape);
        let pins = self.pin.iter_mut().filter_map(|pin| pin.at.shape_mut());
        regions.chain(pins)
    }
}

fn one() -> f32 {
    1.0
}

/// For the keys of shots that were made before there was such a factor.
fn is_one(factor: &f32) -> bool {
    *factor == one()
}

fn ones() -> [f32; 2] {
    [1.0; 2]
}

fn along_x() -> [f32; 3] {
    [1.0, 0.0, 0.0]
}
