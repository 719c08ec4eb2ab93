//! Parameters of sheets.

use crate::solid::{Interpolation, Keyframe, Shape};
use serde::{Deserialize, Serialize};

/// Every sheet of a shot, and the parameters common to all.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetsParams {
    /// The sheets.
    pub sheet: Vec<SheetParams>,
    /// Parameters common to all sheets.
    #[serde(default, rename = "sheets")]
    pub common: SheetsCommon,
}

/// What all sheets have in common: joints, collisions with solids, contact and the solver.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SheetsCommon {
    /// Joints between points of sheets.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joint: Vec<Joint>,
    /// How solids repel sheets before they touch; absent: they only stop points that enter them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repulsion: Option<Repulsion>,
    /// Contact of sheets with each other and with themselves; absent: they pass through.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<Contact>,
    /// Coulomb friction of sheets on solids: 0 slides as on ice, 0.3 cloth on wood, 1 clings; absent: none.
    /// Range: at least 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f32>,
    /// Distance from solids that points keep [m]. It also prevents faces, straight between their points, from
    /// cutting into round solids: on a ball of radius R a face needs d²/8R, with d its longest diagonal.
    /// Absent: half of the thickness of `contact`, or nothing without it. If it is too large, sheets float.
    /// Between solids less than twice this distance apart, points keep less. Points that start closer are
    /// moved away in the first substep. Range: at least 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance: Option<f32>,
    /// How sheets advance in time.
    pub solver: SheetSolver,
}

/// One sheet: a membrane of points and springs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SheetParams {
    /// Name of the sheet, which also names its files; no two sheets share one.
    pub name: String,
    /// Shape at the start, which is also the shape without tension (but see `rest`).
    pub shape: SheetShape,
    /// Mass of a square metre [kg/m²]: silk 0.05, cotton 0.15, rubber 1. Lighter moves faster and takes more
    /// substeps. Range: above 0.
    pub density: f32,
    /// Membrane stiffness along the first and the second direction [N/m]: the tension of a strip of 1 m width
    /// at a strain of 1. 10 sags like rubber film, 1000 like cloth. If it is too small, the sheet stretches
    /// without end; if large, it takes more substeps. The first direction of a mesh is `grain`.
    pub stiffness: [f32; 2],
    /// Rest length of springs relative to their length at the start, by direction. Below 1 the sheet starts
    /// taut, above 1 slack; 0 is soap film.
    #[serde(default = "ones")]
    pub rest: [f32; 2],
    /// Stiffness against shear [N/m], by springs along the diagonals of quads; absent: quads shear freely, as
    /// loose weave does. The edges of triangles resist shear. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shear: Option<f32>,
    /// Flexural rigidity [N·m]: silk 1e-6, cotton 1e-5, paper 1e-3, sheet metal 1; absent: it folds freely.
    /// Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bending: Option<f32>,
    /// Rate at which all motion decays [1/s], as in thick air: after 1/rate a third of the speed is left. It
    /// also slows falling; absent: none. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping: Option<f32>,
    /// Time scale of the damping of springs [s], by direction (shear takes the mean, bending has none): 0.001
    /// calms cloth, 0.1 is dough; absent: none. Rigid motion is not damped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spring_damping: Option<[f32; 2]>,
    /// Velocity at the start [m/s].
    #[serde(default)]
    pub velocity: [f32; 3],
    /// First direction of a mesh's stiffness, in the world at the start; any length other than zero.
    #[serde(default = "along_x")]
    pub grain: [f32; 3],
    /// Regions with other material. Where several contain a point their factors multiply.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub region: Vec<Region>,
    /// Pins, which hold points in place or lead them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pin: Vec<Pin>,
}

/// The shape of a sheet at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum SheetShape {
    /// A rectangular grid of points.
    Grid {
        /// The side along the first direction, from `origin` to the next corner [m].
        origin: [f32; 3],
        /// The side along the second direction [m].
        first: [f32; 3],
        /// From there along the second direction [m].
        second: [f32; 3],
        /// Number of cells along both directions. More cells show finer folds and take longer. With 0 along
        /// one direction the sheet is a chain of points along the other, as wide as a sheet would be; with 0
        /// along both it is one point.
        cells: [u32; 2],
    },
    /// Triangles and quads.
    Mesh(SheetMesh),
}

/// A mesh; its points and faces are read from a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SheetMesh {
    /// The file, .ply or .obj, in the preset's folder or below it. The vertex properties `stiffness`, `rest`
    /// and `damping` of a PLY are factors, like those of a `region`.
    pub file: String,
    /// Positions in the world [m].
    #[serde(skip)]
    pub points: Vec<[f32; 3]>,
    /// Corners of the faces; triangles repeat the last.
    #[serde(skip)]
    pub faces: Vec<[u32; 4]>,
    /// Factors of stiffness, shear and bending painted on points, like those of a [`Region`]; empty: 1
    /// everywhere.
    #[serde(skip)]
    pub stiffness: Vec<f32>,
    /// Painted factors of rest lengths; empty: 1 everywhere.
    #[serde(skip)]
    pub rest: Vec<f32>,
    /// Painted factors of both kinds of damping; empty: 1 everywhere.
    #[serde(skip)]
    pub damping: Vec<f32>,
}

/// A region of a sheet with other material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// The region at the start: the points inside this shape.
    pub shape: Shape,
    /// Factor of stiffness, shear and bending. Range: at least 0.
    #[serde(default = "one")]
    pub stiffness: f32,
    /// Factor of the rest lengths of springs, diagonals included: below 1 the region contracts, like a hem
    /// with elastic; above 1 it is slack and ruffles. A spring takes the mean of every factor at its ends.
    /// Range: at least 0.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub rest: f32,
    /// Factor of both kinds of damping. Range: at least 0.
    #[serde(default = "one")]
    pub damping: f32,
    /// Factor of the mass. Range: above 0.
    #[serde(default = "one")]
    pub density: f32,
}

/// Selection of points of a sheet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Select {
    /// The four corners of a grid.
    Corners,
    /// The point nearest to the centre of mass.
    Center,
    /// The point nearest to a place in the world at the start [m].
    Nearest([f32; 3]),
    /// All points inside a shape at the start.
    Inside(Shape),
    /// Points by their numbers.
    Points(Vec<u32>),
}

/// A pin, which holds points in place or leads them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pin {
    /// The pinned points.
    pub at: Select,
    /// Stiffness of the spring that pulls each point to its place [N/m]; absent: the pin is exact. Range: above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f32>,
    /// Motion of the places, as for colliders; without keyframes they stay.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// Interpolation between keyframes.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// The collider, counted from 0, that the places move with, instead of `keyframes`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collider: Option<u32>,
    /// The place of the points, in the axes of the keyframes [m]; absent: each point's own at the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<[f32; 3]>,
    /// The frame at which the pin lets go; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<u32>,
}

/// Joins a point of one sheet to a point of the same or another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// The names of the two sheets.
    pub sheets: [String; 2],
    /// The points of each: as many of one as of the other, joined in order.
    pub at: [Select; 2],
    /// Stiffness of the spring that pulls the points together [N/m]; absent: the joint is exact, and the
    /// points must coincide at the start. Range: above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f32>,
    /// The direction in the world from the first point to the second, at any distance; any length other than
    /// zero. Absent: the points are held together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f32; 3]>,
    /// The frame at which the joint lets go; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<u32>,
}

/// Repulsion of sheets by solids: a potential c·exp(−f/ξ) of the distance f.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Repulsion {
    /// c [J/m²]: a sheet of density ρ rests at the distance where c/ξ·exp(−f/ξ) = ρ g, and falls onto the
    /// solid if c/ξ is below. Range: above 0.
    pub energy: f32,
    /// ξ [m], the distance over which the force grows by e. Smaller makes a harder contact and takes more
    /// substeps. Range: above 0.
    pub range: f32,
}

/// Contact of sheets with each other and with themselves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Distance that the middles of two layers keep [m]: the thickness of the cloth, or more. Smaller values
    /// take more substeps where motion is fast, as layers approach by at most half of it in one substep. It
    /// is best below the size of cells: parts of a sheet that are closer at the start keep 0.7 of that
    /// distance. Range: above 0.
    pub thickness: f32,
    /// Coulomb friction between layers: 0.3 silk, 0.6 cotton; absent: none. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f32>,
}

/// How sheets advance in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SheetSolver {
    /// The time integrator.
    pub integrator: Integrator,
    /// Substep of the symplectic integrator relative to the longest stable one. Smaller follows fast waves
    /// better. Range: 0.01 to 0.95.
    pub courant: f32,
    /// Substeps of a frame with the implicit integrator. More substeps damp less and cost in proportion.
    /// Range: 1 to 100000.
    pub substeps: u32,
    /// Largest number of substeps of a frame; a frame that needs more is an error. Range: 1 to 10000000.
    pub max_substeps: u32,
    /// Relative residual at which the conjugate gradients stop. Larger lets stiff sheets stretch.
    /// Range: 0.0000001 to 0.5.
    pub tolerance: f32,
    /// Largest number of iterations of the conjugate gradients. Range: 1 to 100000.
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

/// Time integrator of sheets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Integrator {
    /// Semi-implicit Euler: conserves energy, in substeps that follow from stiffness and mass.
    #[default]
    Symplectic,
    /// Implicit Euler: stable for any substep; damps what is faster than it.
    Implicit,
}

impl Select {
    /// The shape of the selection, if it has one.
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
    /// Number of points, without building them; 0 for a mesh that was not read yet.
    pub fn points(&self) -> f64 {
        match self {
            SheetShape::Grid { cells, .. } => cells.iter().map(|&n| f64::from(n) + 1.0).product(),
            SheetShape::Mesh(mesh) => mesh.points.len() as f64,
        }
    }
}

impl SheetsCommon {
    /// Distance from solids that points keep [m].
    pub(super) fn solid_clearance(&self) -> f32 {
        let layer = || self.contact.as_ref().map_or(0.0, |contact| 0.5 * contact.thickness);
        self.clearance.unwrap_or_else(layer)
    }

    /// The shapes of selections, to be filled from files.
    pub fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        self.joint.iter_mut().flat_map(|joint| &mut joint.at).filter_map(Select::shape_mut)
    }
}

impl SheetParams {
    /// The shapes of regions and pins, to be filled from files.
    pub fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        let regions = self.region.iter_mut().map(|region| &mut region.shape);
        let pins = self.pin.iter_mut().filter_map(|pin| pin.at.shape_mut());
        regions.chain(pins)
    }
}

fn one() -> f32 {
    1.0
}

/// Omits the default, so that hashes of shots from before this factor stay the same.
fn is_one(factor: &f32) -> bool {
    *factor == one()
}

fn ones() -> [f32; 2] {
    [1.0; 2]
}

fn along_x() -> [f32; 3] {
    [1.0, 0.0, 0.0]
}
