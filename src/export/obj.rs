//! Wavefront OBJ, as text: `docs/formats/mesh.md` has the layout.

use super::{ExportError, error::check_columns};
use crate::{
    cache::{WrittenFile, write_atomically},
    mesh::Mesh,
};
use std::{
    io::{self, Write},
    path::Path,
};

/// Writes `mesh` to `path`, with `comments` (one line each) at its top, and returns its size and checksum.
///
/// OBJ has no place for vertex attributes; a comment in the file names those that the mesh carries. Numbers have
/// as many digits as it takes to read back the same value.
///
/// # Errors
/// If the system refuses or columns have the wrong length.
pub fn write(mesh: &Mesh, path: &Path, comments: &[String]) -> Result<WrittenFile, ExportError> {
    check_columns(mesh, path)?;
    write_atomically(path, |out| encode(mesh, comments, out)).map_err(|error| ExportError::write(path, error))
}

fn encode(mesh: &Mesh, comments: &[String], out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "# Meniscus: metres, Z up, counter-clockwise seen from outside")?;
    for comment in comments {
        writeln!(out, "# {comment}")?;
    }
    writeln!(out, "# {} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len())?;
    for channel in &mesh.attributes {
        let name = channel.name.escape_debug();
        writeln!(out, "# the attribute {name} has no place in this format; write PLY to keep it")?;
    }
    if mesh.origin == nalgebra::Vector3::zeros() {
        for x in &mesh.positions {
            writeln!(out, "v {} {} {}", x.x, x.y, x.z)?;
        }
    } else {
        for x in mesh.positions.iter().map(|x| x.cast::<f64>() + mesh.origin) {
            writeln!(out, "v {} {} {}", x.x, x.y, x.z)?;
        }
    }
    for n in &mesh.normals {
        writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    for triangle in &mesh.triangles {
        // Vertices count from one.
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        if mesh.normals.is_empty() {
            writeln!(out, "f {a} {b} {c}")?;
        } else {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::Channel, math::Vec3};

    #[test]
    fn values_and_corners_read_back_the_same() {
        let mesh = Mesh {
            origin: nalgebra::Vector3::zeros(),
            positions: vec![Vec3::new(0.1, -1e-7, 3.0e5), Vec3::new(1.0 / 3.0, 0.0, -0.0), Vec3::zeros()],
            triangles: vec![[2, 0, 1]],
            normals: vec![Vec3::new(0.0, 0.6, 0.8); 3],
            attributes: vec![Channel { name: "velocity".into(), data: vec![Vec3::zeros(); 3].into() }],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        let written = write(&mesh, &path, &[]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(written.bytes, text.len() as u64);
        let read = |tag: &str| -> Vec<Vec3> {
            text.lines()
                .filter_map(|line| line.strip_prefix(tag))
                .map(|line| Vec3::from_iterator(line.split(' ').map(|number| number.parse::<f32>().unwrap())))
                .collect()
        };
        assert_eq!(read("v "), mesh.positions);
        assert_eq!(read("vn "), mesh.normals);
        assert!(
            text.contains("\nf 3//3 1//1 2//2\n") && text.contains("# the attribute velocity has no place")
        );

        let far = Mesh { origin: nalgebra::Vector3::new(0.0, 1e6, 0.0), ..mesh.clone() };
        write(&far, &path, &[]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let y: f64 = text
            .lines()
            .find_map(|line| line.strip_prefix("v ")?.split(' ').nth(1))
            .unwrap()
            .parse()
            .unwrap();
        assert_eq!(y, 1e6 + f64::from(-1e-7_f32));

        let bare = Mesh { normals: Vec::new(), ..mesh };
        write(&bare, &path, &[]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().ends_with("\nf 3 1 2\n"));
        write(&Mesh::default(), &path, &[]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().lines().all(|line| line.starts_with('#')));
    }
}
