//! The root layer of a stage, and the manifest of its value clips, as text.
//!
//! *Method*: what has a file for each frame is a prim with value clips, whose values at a frame are those of that frame's file; the manifest
//! names their attributes, so that no clip is opened to find them. What is one file for all frames is a reference.

use super::{geometry::GeometryAttribute, layer::LayerSettings};
use crate::math::Vec3;
use std::fmt::Write;

/// The manifest's file name.
pub(crate) const MANIFEST: &str = "manifest.usda";

/// The name of the camera's prim, which no group has.
pub(crate) const CAMERA: &str = "camera";

/// The prim that all others are below.
const ROOT: &str = "shot";

/// The film that focal lengths are for: width and height [mm]. The pictures of shots are 16 to 9.
const APERTURE: [f64; 2] = [36.0, 20.25];

/// The nearest and farthest depth that the camera shows [m].
const CLIPPING: [f64; 2] = [0.01, 10_000.0];

/// A camera at rest, upright in the shot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StageCamera {
    /// Place of the camera [m].
    pub(crate) position: [f32; 3],
    /// The point in the middle of the picture [m].
    pub(crate) target: [f32; 3],
    /// Focal length for a film 36 mm wide [mm].
    pub(crate) focal_length: f32,
}

/// What a prim of the stage shows.
#[derive(Clone, Debug)]
pub(crate) enum Content {
    /// Geometry with a file for each frame.
    Clips {
        /// Schema of the prim.
        schema: &'static str,
        /// Attributes that its files have.
        attributes: Vec<GeometryAttribute>,
        /// Frames in ascending order, and the names of their files.
        files: Vec<(u32, String)>,
    },
    /// A file with all frames.
    Layer {
        /// Name of the file.
        file: String,
        /// Whether pictures do not show it.
        is_hidden: bool,
    },
}

/// A prim of the stage.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    /// The prim that it is below, an identifier.
    pub(crate) group: String,
    /// Name of the prim, an identifier that is unique in its group.
    pub(crate) name: String,
    /// What it shows.
    pub(crate) content: Content,
}

/// A stage.
#[derive(Clone, Debug)]
pub(crate) struct Stage<'a> {
    /// Title of the shot.
    pub(crate) title: &'a str,
    /// Axes, units and frames a second.
    pub(crate) settings: LayerSettings,
    /// The first and the last frame.
    pub(crate) frames: (u32, u32),
    /// The camera, if there is one.
    pub(crate) camera: Option<StageCamera>,
    /// Everything that it shows; members of a group one after the other.
    pub(crate) members: &'a [Member],
}

impl Stage<'_> {
    /// The text of the root layer.
    pub(crate) fn root(&self) -> String {
        let LayerSettings { space, fps } = self.settings;
        let (first, last) = self.frames;
        let mut text = format!(
            "#usda 1.0\n(\n    defaultPrim = \"{ROOT}\"\n    doc = {}\n    metersPerUnit = {}\n    upAxis = \"{}\"\n    \
             timeCodesPerSecond = {fps}\n    framesPerSecond = {fps}\n    startTimeCode = {first}\n    endTimeCode = {last}\n)\n\n\
             def Xform \"{ROOT}\"\n{{\n",
            quoted(self.title),
            space.meters_per_unit(),
            space.up.token(),
        );
        for group in self.members.chunk_by(|a, b| a.group == b.group) {
            let _ = writeln!(text, "    def Scope \"{}\"\n    {{", group[0].group);
            group.iter().for_each(|member| member.define(&mut text));
            text.push_str("    }\n\n");
        }
        if let Some(camera) = &self.camera {
            self.camera(camera, &mut text);
        }
        text + "}\n"
    }

    /// The text of the manifest.
    pub(crate) fn manifest(&self) -> String {
        let mut text = "#usda 1.0\n".to_owned();
        for group in self.members.chunk_by(|a, b| a.group == b.group) {
            let _ = writeln!(text, "\nover \"{}\"\n{{", group[0].group);
            for member in group {
                if let Content::Clips { attributes, .. } = &member.content {
                    let _ = writeln!(text, "    over \"{}\"\n    {{", member.name);
                    for GeometryAttribute { name, type_name, .. } in attributes {
                        let _ = writeln!(text, "        {type_name} {name}");
                    }
                    text.push_str("    }\n");
                }
            }
            text.push_str("}\n");
        }
        text
    }

    fn camera(&self, camera: &StageCamera, text: &mut String) {
        let space = self.settings.space;
        // Lengths of cameras are tenths of a unit.
        let film = |millimetres: f64| millimetres * 1e-2 * space.scale;
        let [position, target] =
            [camera.position, camera.target].map(|place| Vec3::from(place).cast::<f64>());
        let back = (position - target).normalize();
        let up = nalgebra::Vector3::z();
        // Looking straight down or up, the picture's top is at +Y.
        let side = up.cross(&back);
        let right = if side.norm() > 1e-6 { side.normalize() } else { nalgebra::Vector3::x() };
        let axes = [right, back.cross(&right), back].map(|axis| space.up.turned(axis.into()));
        let place = space.position(position.into());
        let row = |[x, y, z]: [f64; 3], w: f64| format!("({}, {}, {}, {w})", x + 0.0, y + 0.0, z + 0.0);
        let matrix = [row(axes[0], 0.0), row(axes[1], 0.0), row(axes[2], 0.0), row(place, 1.0)].join(", ");
        let _ = write!(
            text,
            "    def Camera \"{CAMERA}\"\n    {{\n        float focalLength = {}\n        float horizontalAperture = {}\n        \
             float verticalAperture = {}\n        float2 clippingRange = ({}, {})\n        matrix4d xformOp:transform = ( {matrix} )\n        \
             uniform token[] xformOpOrder = [\"xformOp:transform\"]\n    }}\n",
            film(camera.focal_length.into()) as f32,
            film(APERTURE[0]) as f32,
            film(APERTURE[1]) as f32,
            (CLIPPING[0] * space.scale) as f32,
            (CLIPPING[1] * space.scale) as f32,
        );
    }
}

impl Member {
    fn define(&self, text: &mut String) {
        let Self { group, name, content } = self;
        match content {
            Content::Layer { file, is_hidden } => {
                let hidden = if *is_hidden { "            token visibility = \"invisible\"\n" } else { "" };
                let _ = write!(
                    text,
                    "        def \"{name}\" (\n            prepend references = @./{file}@</{group}/{name}>\n        )\n        \
                     {{\n{hidden}        }}\n"
                );
            }
            Content::Clips { schema, attributes, files } => {
                let list = |item: &dyn Fn(usize, &(u32, String)) -> String| {
                    files
                        .iter()
                        .enumerate()
                        .map(|(place, file)| item(place, file))
                        .collect::<Vec<_>>()
                        .join(", ")
                };
                let _ = write!(
                    text,
                    "        def {schema} \"{name}\" (\n            clips = {{\n                dictionary default = {{\n                    \
                     double2[] active = [{}]\n                    asset[] assetPaths = [{}]\n                    \
                     asset manifestAssetPath = @./{MANIFEST}@\n                    string primPath = \"/{group}/{name}\"\n                    \
                     double2[] times = [{}]\n                }}\n            }}\n        )\n        {{\n",
                    list(&|place, (frame, _)| format!("({frame}, {place})")),
                    list(&|_, (_, file)| format!("@./{file}@")),
                    list(&|_, (frame, _)| format!("({frame}, {frame})")),
                );
                if *schema == "Mesh" {
                    text.push_str("            uniform token subdivisionScheme = \"none\"\n");
                    text.push_str("            uniform token orientation = \"rightHanded\"\n");
                }
                for attribute in attributes {
                    // Clips have values alone.
                    if let Some(interpolation) = attribute.interpolation() {
                        let GeometryAttribute { name, type_name, .. } = attribute;
                        let _ = writeln!(
                            text,
                            "            {type_name} {name} (\n                interpolation = \"{interpolation}\"\n            )"
                        );
                    }
                }
                text.push_str("        }\n");
            }
        }
    }
}

/// Members sorted by group, in the order of the first of each.
pub(crate) fn group_members(members: Vec<Member>) -> Vec<Member> {
    let mut groups: Vec<String> = Vec::new();
    for member in &members {
        if !groups.contains(&member.group) {
            groups.push(member.group.clone());
        }
    }
    let mut sorted = members;
    sorted.sort_by_key(|member| groups.iter().position(|group| *group == member.group));
    sorted
}

/// A text as a string of a text layer.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push(' '),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}
