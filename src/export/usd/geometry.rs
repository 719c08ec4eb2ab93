//! A mesh or points of one frame as a layer with time samples at that frame.
//!
//! Standard attributes have the names of the schemas `Mesh` and `Points`; all others are primvars with a value for each vertex. Names
//! that other programs expect are added and share the values.

use super::{
    crate_file::{Attribute, CrateFile, Prim, Value},
    layer::LayerSettings,
    names::{Identifiers, identifier},
};
use crate::{
    frame::{Channel, ChannelData},
    import::Geometry,
};
use serde::{Deserialize, Serialize};

/// Whose names primvars have in addition to those of the schemas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum NameScheme {
    /// None.
    #[default]
    Usd,
    /// Houdini: `v`, `N`, `pscale`, `id`, `Cd`.
    Houdini,
    /// Maya: `velocityPV`, `radiusPP`, `particleId`, `rgbPP`.
    Maya,
}

impl NameScheme {
    /// Every scheme.
    pub const ALL: [Self; 3] = [Self::Usd, Self::Houdini, Self::Maya];

    /// Name of the scheme in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Usd => "usd",
            Self::Houdini => "houdini",
            Self::Maya => "maya",
        }
    }

    /// The name and type of the primvar that a program expects of a standard attribute, if it expects one.
    fn alias(self, name: &str) -> Option<(&'static str, &'static str)> {
        match (self, name) {
            (Self::Usd, _) => None,
            (Self::Houdini, "velocities") => Some(("v", "vector3f[]")),
            (Self::Houdini, "normals") => Some(("N", "normal3f[]")),
            (Self::Houdini, RADIUS) => Some(("pscale", "float[]")),
            (Self::Houdini, "ids") => Some(("id", "int64[]")),
            (Self::Houdini, COLOUR) => Some(("Cd", "color3f[]")),
            // A colour set, which is how Maya keeps vectors of vertices.
            (Self::Maya, "velocities") => Some(("velocityPV", "color3f[]")),
            (Self::Maya, RADIUS) => Some(("radiusPP", "float[]")),
            (Self::Maya, "ids") => Some(("particleId", "int64[]")),
            (Self::Maya, COLOUR) => Some(("rgbPP", "color3f[]")),
            _ => None,
        }
    }
}

/// The primvar of radii, of which widths are twice as large.
const RADIUS: &str = "primvars:radius";

/// The primvar of colours.
const COLOUR: &str = "primvars:displayColor";

/// Names of columns that are colours.
const COLOURS: [&str; 4] = ["color", "colour", "Cd", "displayColor"];

/// Names that programs take for the standard attributes where primvars have them.
const STANDARD: [&str; 4] = ["points", "normals", "widths", "velocities"];

/// Where the values of an attribute come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Points,
    Extent,
    Counts,
    Corners,
    Normals,
    /// Twice the values of a channel, which are lengths.
    Widths(usize),
    /// A channel of lengths, or of vectors of lengths.
    Lengths(usize),
    /// A channel of vectors without a length.
    Directions(usize),
    /// A channel as it is.
    Plain(usize),
    /// A channel of integers, with 64 bits.
    Long(usize),
}

/// An attribute of a mesh or of points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct GeometryAttribute {
    /// Name, with its namespace.
    pub(crate) name: String,
    /// Type, as text files write it.
    pub(crate) type_name: &'static str,
    column: Column,
}

impl GeometryAttribute {
    /// How it is interpolated over a mesh, where its schema leaves that open.
    pub(crate) fn interpolation(&self) -> Option<&'static str> {
        let is_column = self.name.starts_with("primvars:") || self.name == "normals" || self.name == "widths";
        is_column.then_some("vertex")
    }
}

/// The schema of a geometry.
pub(crate) fn schema(geometry: &Geometry) -> &'static str {
    if geometry.triangles.is_some() { "Mesh" } else { "Points" }
}

/// The attributes of a geometry, with all names of a scheme; each name once.
pub(crate) fn attributes(geometry: &Geometry, scheme: NameScheme) -> Vec<GeometryAttribute> {
    let is_mesh = geometry.triangles.is_some();
    let mut found: Vec<(String, &'static str, Column)> =
        vec![("points".into(), "point3f[]", Column::Points), ("extent".into(), "float3[]", Column::Extent)];
    if is_mesh {
        found.push(("faceVertexCounts".into(), "int[]", Column::Counts));
        found.push(("faceVertexIndices".into(), "int[]", Column::Corners));
    }
    if geometry.normals.is_some() {
        found.push(("normals".into(), "normal3f[]", Column::Normals));
    }
    let mut others: Vec<(String, &'static str, Column)> = Vec::new();
    for (place, Channel { name, data }) in geometry.attributes.iter().enumerate() {
        let is_new = |name: &str| found.iter().chain(&others).all(|(known, ..)| known != name);
        let own = format!("primvars:{}", identifier(name));
        // The second column of a standard attribute is a primvar.
        match (name.as_str(), data) {
            ("velocity", ChannelData::Vec3(_)) if is_new("velocities") => {
                found.push(("velocities".into(), "vector3f[]", Column::Lengths(place)));
            }
            ("velocity", ChannelData::Vec3(_)) => others.push((own, "vector3f[]", Column::Lengths(place))),
            ("radius", ChannelData::F32(_)) => {
                if !is_mesh && is_new("widths") {
                    found.push(("widths".into(), "float[]", Column::Widths(place)));
                }
                others.push((RADIUS.to_owned(), "float[]", Column::Lengths(place)));
            }
            ("id", ChannelData::U32(_)) if !is_mesh && is_new("ids") => {
                found.push(("ids".into(), "int64[]", Column::Long(place)));
            }
            (name, ChannelData::Vec3(_)) if COLOURS.contains(&name) => {
                let name = if is_new(COLOUR) { COLOUR.to_owned() } else { own };
                others.push((name, "color3f[]", Column::Plain(place)));
            }
            (_, ChannelData::Vec3(_)) => others.push((own, "vector3f[]", Column::Directions(place))),
            (_, ChannelData::F32(_)) => others.push((own, "float[]", Column::Plain(place))),
            (_, ChannelData::U32(_)) => others.push((own, "int[]", Column::Plain(place))),
        }
    }
    found.extend(others);
    let mut aliases: Vec<(String, &'static str, Column)> = Vec::new();
    for (name, _, column) in &found {
        let Some((alias, type_name)) = scheme.alias(name) else { continue };
        let alias = format!("primvars:{alias}");
        if aliases.iter().all(|(known, ..)| *known != alias) {
            aliases.push((alias, type_name, *column));
        }
    }
    // A column that has such a name by itself gets a number.
    let mut names = Identifiers::default();
    STANDARD.iter().for_each(|name| names.reserve(name));
    for (alias, ..) in &aliases {
        names.reserve(alias.trim_start_matches("primvars:"));
    }
    let unique = |(name, type_name, column): (String, &'static str, Column)| {
        let name = match name.strip_prefix("primvars:") {
            Some(own) => format!("primvars:{}", names.unique(own)),
            None => name,
        };
        GeometryAttribute { name, type_name, column }
    };
    let own: Vec<GeometryAttribute> = found.into_iter().map(unique).collect();
    let alias = |(name, type_name, column)| GeometryAttribute { name, type_name, column };
    own.into_iter().chain(aliases.into_iter().map(alias)).collect()
}

/// What is wrong with a geometry that cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum GeometryFault {
    /// A position is not finite.
    #[error(
        "vertex {vertex} is not at a finite place in units of the stage; use a smaller --scale, or make the file again"
    )]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// There are too many triangles.
    #[error("{triangles} triangles, expected at most 150 million; use a coarser surface")]
    TooLarge {
        /// Triangles.
        triangles: usize,
    },
    /// There are too many vertices.
    #[error("{vertices} vertices with integers, expected at most 497 million; use fewer points")]
    TooManyVertices {
        /// Vertices.
        vertices: usize,
    },
}

/// What is remarkable about the values of a layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct GeometryRemarks {
    /// Numbers of attributes that are not finite.
    pub(crate) not_finite: usize,
    /// Integers above 2³¹ − 1, which files hold as negative ones with the same bits.
    pub(crate) wrapped: usize,
}

/// A layer with the geometry of one frame in the prim `/GROUP/NAME`.
pub(crate) struct GeometryLayer {
    pub(super) file: CrateFile,
    pub(super) fields: Vec<(&'static str, Value)>,
    pub(super) prim: Prim,
    /// What is remarkable about the values.
    pub(crate) remarks: GeometryRemarks,
}

impl GeometryLayer {
    /// The layer of a geometry with time samples at a frame.
    ///
    /// # Errors
    /// If a position is not finite, or there are more triangles than an array holds.
    pub(crate) fn new(
        geometry: &Geometry,
        settings: &LayerSettings,
        scheme: NameScheme,
        frame: u32,
        path: (&str, &str),
    ) -> Result<Self, GeometryFault> {
        let mut file = CrateFile::new();
        let (group, name) = path;
        let fields = settings.fields(&mut file, group, Some((frame, frame)));
        let times = file.times(&[f64::from(frame)]);
        let mut values =
            Values { file, geometry, settings, made: Vec::new(), remarks: GeometryRemarks::default() };
        let mut attributes = Vec::new();
        for attribute in self::attributes(geometry, scheme) {
            let value = values.value(attribute.column)?;
            let samples = values.file.samples(times, &[value]);
            attributes.push(Attribute {
                interpolation: attribute.interpolation(),
                name: attribute.name,
                type_name: attribute.type_name,
                is_uniform: false,
                default: None,
                samples: Some(samples),
            });
        }
        let Values { mut file, remarks, .. } = values;
        let type_name = schema(geometry);
        if type_name == "Mesh" {
            attributes.extend(mesh_constants(&mut file));
        }
        let shape = Prim { name: name.to_owned(), type_name, attributes, children: Vec::new() };
        let prim = Prim {
            name: group.to_owned(),
            type_name: "Scope",
            attributes: Vec::new(),
            children: vec![shape],
        };
        Ok(Self { file, fields, prim, remarks })
    }
}

/// Attributes that all meshes have: polygons that are not subdivided, counter-clockwise seen from outside.
pub(super) fn mesh_constants(file: &mut CrateFile) -> [Attribute; 2] {
    [("subdivisionScheme", "none"), ("orientation", "rightHanded")].map(|(name, value)| Attribute {
        name: name.to_owned(),
        type_name: "token",
        is_uniform: true,
        interpolation: None,
        default: Some(file.token(value)),
        samples: None,
    })
}

/// Makes the values of columns, each once.
struct Values<'a> {
    file: CrateFile,
    geometry: &'a Geometry,
    settings: &'a LayerSettings,
    made: Vec<(Column, Value)>,
    remarks: GeometryRemarks,
}

impl Values<'_> {
    fn value(&mut self, column: Column) -> Result<Value, GeometryFault> {
        if let Some(&(_, known)) = self.made.iter().find(|(other, _)| *other == column) {
            return Ok(known);
        }
        let space = self.settings.space;
        let triangles = self.geometry.triangles.as_deref().unwrap_or_default();
        let too_large = GeometryFault::TooLarge { triangles: triangles.len() };
        let value = match column {
            Column::Points => {
                let points = space.lengths(&self.geometry.positions);
                let is_finite = |point: &[f32; 3]| point.iter().all(|c| c.is_finite());
                if let Some(vertex) = points.iter().position(|point| !is_finite(point)) {
                    return Err(GeometryFault::NotFinite { vertex });
                }
                self.file.vectors(&points)
            }
            Column::Extent => {
                let points = space.lengths(&self.geometry.positions);
                let radii = match self.geometry.triangles {
                    None => self.radii(),
                    Some(_) => Vec::new(),
                };
                self.file.vectors(&extent(&points, &radii))
            }
            Column::Counts => {
                let counts = vec![3_i32; triangles.len()];
                self.file.integers(counts.into_iter()).ok_or(too_large)?
            }
            Column::Corners => {
                let corners: Vec<i32> =
                    triangles.as_flattened().iter().map(|&corner| corner as i32).collect();
                self.file.integers(corners.into_iter()).ok_or(too_large)?
            }
            Column::Normals => {
                let normals = space.directions(self.geometry.normals.as_deref().unwrap_or_default());
                self.vectors(&normals)
            }
            Column::Widths(_) => {
                let widths: Vec<f32> = self.radii().into_iter().map(|radius| 2.0 * radius).collect();
                self.numbers(&widths)
            }
            Column::Lengths(place)
            | Column::Directions(place)
            | Column::Plain(place)
            | Column::Long(place) => self.channel(column, place)?,
        };
        self.made.push((column, value));
        Ok(value)
    }

    fn channel(&mut self, column: Column, place: usize) -> Result<Value, GeometryFault> {
        let space = self.settings.space;
        Ok(match (&self.geometry.attributes[place].data, column) {
            (ChannelData::Vec3(vectors), Column::Lengths(_)) => self.vectors(&space.lengths(vectors)),
            (ChannelData::Vec3(vectors), Column::Directions(_)) => self.vectors(&space.directions(vectors)),
            (ChannelData::Vec3(vectors), _) => {
                let plain: Vec<[f32; 3]> = vectors.iter().map(|&v| v.into()).collect();
                self.vectors(&plain)
            }
            (ChannelData::F32(numbers), Column::Lengths(_)) => {
                let lengths: Vec<f32> = numbers.iter().map(|&number| space.length(number)).collect();
                self.numbers(&lengths)
            }
            (ChannelData::F32(numbers), _) => self.numbers(numbers),
            (ChannelData::U32(integers), Column::Long(_)) => {
                self.file.long_integers(integers.iter().map(|&integer| integer.into()))
            }
            (ChannelData::U32(integers), _) => {
                self.remarks.wrapped += integers.iter().filter(|&&integer| integer > i32::MAX as u32).count();
                let value = self.file.integers(integers.iter().map(|&integer| integer as i32));
                value.ok_or(GeometryFault::TooManyVertices { vertices: integers.len() })?
            }
        })
    }

    /// The radii of points in units of the stage; none without such a channel.
    fn radii(&self) -> Vec<f32> {
        // A vector may have the same name.
        let radii = self.geometry.attributes.iter().find_map(|channel| match &channel.data {
            ChannelData::F32(radii) if channel.name == "radius" => Some(radii),
            _ => None,
        });
        radii.map_or_else(Vec::new, |radii| {
            radii.iter().map(|&radius| self.settings.space.length(radius)).collect()
        })
    }

    fn numbers(&mut self, numbers: &[f32]) -> Value {
        self.remarks.not_finite += numbers.iter().filter(|number| !number.is_finite()).count();
        self.file.floats(numbers)
    }

    fn vectors(&mut self, vectors: &[[f32; 3]]) -> Value {
        self.remarks.not_finite += vectors.iter().flatten().filter(|number| !number.is_finite()).count();
        self.file.vectors(vectors)
    }
}

/// The box around points with radii, if there are any. That of no points is empty: its minimum is above its maximum, as OpenUSD has it.
pub(super) fn extent(points: &[[f32; 3]], radii: &[f32]) -> [[f32; 3]; 2] {
    let (mut min, mut max) = ([f32::MAX; 3], [-f32::MAX; 3]);
    for (place, point) in points.iter().enumerate() {
        let radius = radii.get(place).copied().filter(|radius| radius.is_finite()).unwrap_or(0.0);
        for axis in 0..3 {
            min[axis] = min[axis].min(point[axis] - radius);
            max[axis] = max[axis].max(point[axis] + radius);
        }
    }
    [min, max]
}
