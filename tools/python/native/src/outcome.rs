//! The result of a call: a surface with pointers to its columns, or the message of a failure.

use crate::{Text, call, memory::CallMemory, request::Failure, text_of};
use meniscus::{
    export::{obj, ply},
    frame::ChannelData,
    mesh::Surface,
};
use std::{ffi::c_void, path::Path, ptr};

/// A column of a mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct OutcomeColumn {
    /// Name: `vertices`, `triangles`, `normals`, an attribute as `vertex.NAME`; of droplets `points`, `point_radii`, `point.NAME`.
    pub name: Text,
    /// 1: f32, 2: three f32, 3: u32, 4: three u32; 0: there is no such column.
    pub kind: u32,
    /// Number of entries.
    pub len: usize,
    /// The values; not null.
    pub data: *const c_void,
}

impl OutcomeColumn {
    pub(crate) fn none() -> Self {
        Self { name: text_of(""), kind: 0, len: 0, data: ptr::null() }
    }
}

/// The result of a call.
#[derive(Debug)]
pub struct Outcome {
    status: u32,
    text: String,
    surface: Option<Surface>,
    /// Names of `columns`, which point to them.
    #[expect(dead_code, reason = "owns what columns point to")]
    names: Vec<String>,
    columns: Vec<OutcomeColumn>,
}

// SAFETY: the pointers are to what the outcome owns, which nothing changes.
unsafe impl Send for Outcome {}
// SAFETY: likewise.
unsafe impl Sync for Outcome {}

impl Outcome {
    pub(crate) fn new(made: Result<Surface, Failure>) -> Self {
        let failed =
            |status, text| Self { status, text, surface: None, names: Vec::new(), columns: Vec::new() };
        match made {
            Ok(surface) => Self::of_surface(surface),
            Err(Failure::Parameter(text)) => failed(1, text),
            Err(Failure::Particles(text)) => failed(2, text),
            Err(Failure::Interrupted) => failed(3, "interrupted during surface reconstruction".to_owned()),
            Err(Failure::Internal(text)) => failed(4, text),
            Err(Failure::Memory(text)) => failed(5, text),
            Err(Failure::Abandoned) => {
                let Failure::Memory(text) = call::refused() else {
                    unreachable!("it is a failure of memory")
                };
                failed(6, format!("{text}; what the call had taken stays taken until the process ends"))
            }
        }
    }

    fn of_surface(surface: Surface) -> Self {
        let text = report(&surface);
        let mut columns = Vec::new();
        let mut add = |name: String, kind, len, data: *const c_void| columns.push((name, kind, len, data));
        let attribute = |data: &ChannelData| match data {
            ChannelData::F32(values) => (1, values.len(), values.as_ptr().cast()),
            ChannelData::Vec3(values) => (2, values.len(), values.as_ptr().cast()),
            ChannelData::U32(values) => (3, values.len(), values.as_ptr().cast()),
            // Of another version of the library.
            _ => (0, 0, ptr::null()),
        };
        let mesh = &surface.mesh;
        add("vertices".to_owned(), 2, mesh.positions.len(), mesh.positions.as_ptr().cast());
        add("triangles".to_owned(), 4, mesh.triangles.len(), mesh.triangles.as_ptr().cast());
        add("normals".to_owned(), 2, mesh.normals.len(), mesh.normals.as_ptr().cast());
        for channel in &mesh.attributes {
            let (kind, len, data) = attribute(&channel.data);
            add(format!("vertex.{}", channel.name), kind, len, data);
        }
        if let Some(points) = &surface.points {
            add("points".to_owned(), 2, points.positions.len(), points.positions.as_ptr().cast());
            add("point_radii".to_owned(), 1, points.radii.len(), points.radii.as_ptr().cast());
            for channel in &points.attributes {
                let (kind, len, data) = attribute(&channel.data);
                add(format!("point.{}", channel.name), kind, len, data);
            }
        }
        // Moving a string or a vector leaves its values where they are.
        let names: Vec<String> = columns.iter().map(|(name, ..)| name.clone()).collect();
        let columns = names.iter().zip(&columns).map(|(name, &(_, kind, len, data))| {
            let name = text_of(name);
            OutcomeColumn { name, kind, len, data }
        });
        let columns = columns.collect();
        Self { status: 0, text, surface: Some(surface), names, columns }
    }

    pub(crate) fn status(&self) -> u32 {
        self.status
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    pub(crate) fn columns(&self) -> &[OutcomeColumn] {
        &self.columns
    }

    /// Writes the mesh, PLY or OBJ by the path's ending. Its threads are its own, as those of a reconstruction.
    pub(crate) fn write(&self, path: &Path, memory: &CallMemory) -> Result<(), Failure> {
        let Some(surface) = &self.surface else {
            return Err(Failure::Internal("there is no mesh to write".to_owned()));
        };
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let write = match &*ending {
            "ply" => ply::write,
            "obj" => obj::write,
            _ => {
                let found =
                    format!("path: found the ending `{}`, expected `.ply` or `.obj`", ending.escape_debug());
                return Err(Failure::Parameter(found));
            }
        };
        call::on_threads(memory, 0, || write(&surface.mesh, path, &[]))?
            .map(drop)
            .map_err(|error| Failure::Particles(error.to_string()))
    }
}

/// What the surface is and what was changed to get it, as JSON.
fn report(surface: &Surface) -> String {
    let listed = |counts: &[(u64, &'static str)]| -> Vec<serde_json::Value> {
        let nonzero = counts.iter().filter(|(count, _)| *count > 0);
        nonzero.map(|(count, text)| serde_json::json!([count, text])).collect()
    };
    let report = serde_json::json!({
        "origin": surface.mesh.origin.as_slice(),
        "sound": surface.check.is_sound(),
        "check": surface.check,
        "stats": surface.stats,
        "losses": listed(&surface.stats.losses()),
        "adjustments": listed(&surface.stats.adjustments()),
    });
    report.to_string()
}
