//! Meshes a particle file of any supported format: `cargo run --example mesh_particles -- FILE SPACING OUT.ply`.

use meniscus::{
    control::CancelToken,
    export::ply,
    import,
    mesh::{self, SurfaceParams},
};
use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [file, spacing, out] = &arguments[..] else {
        return Err("usage: mesh_particles FILE SPACING OUT.ply".into());
    };
    let particles = import::read_particles(Path::new(file))?.stream;
    let surface =
        mesh::reconstruct(&particles, spacing.parse()?, &SurfaceParams::default(), &CancelToken::new())?;
    let written = ply::write(&surface.mesh, Path::new(out), &[])?;
    println!(
        "{} particles, {} triangles, {} bytes",
        particles.len(),
        surface.mesh.triangles.len(),
        written.bytes
    );
    Ok(())
}
