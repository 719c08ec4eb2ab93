//! What `meniscus mesh` takes: tiers of surfaces, spacings with units, tables of particles.

use super::{meshing::xyz, *};

/// A drop of particles 0.1 m apart above a sheet of one layer.
fn drop_and_sheet() -> Vec<[f32; 3]> {
    let block = (0..216).map(|i| [i % 6, i / 6 % 6, i / 36 + 4].map(|v| 0.1 * v as f32));
    let sheet = (0..100).map(|i| [i % 10, i / 10, 0].map(|v| 0.1 * v as f32));
    block.chain(sheet).collect()
}

/// The defaults of `[surface]`.
pub(super) const ISOTROPIC: &str = "--set surface.anisotropy=none --set surface.smoothing=none";

#[test]
fn tiers_are_settings_that_set_changes() {
    let desk = Desk::new();
    desk.write("drop.xyz", xyz(&drop_and_sheet()));
    let mesh = |options: &str| {
        desk.run(&format!("mesh drop.xyz --spacing 0.1 -o out --force {options}"), 0);
        fs::read(desk.path("out/mesh/particles_0001.ply")).unwrap()
    };
    // The settings are in the key that a file holds, so equal bytes are equal settings.
    let [draft, preview, last] = ["draft", "preview", "final"].map(|tier| mesh(&format!("--quality {tier}")));
    assert!(mesh("") == last, "final is the default");
    assert!(draft != preview && preview != last && draft.len() < last.len());
    assert!(mesh(&format!("{ISOTROPIC} --voxel 0.75")) == draft);
    assert!(mesh("--quality draft --set surface.smoothing={} --voxel 0.5") == preview);
    assert!(mesh("--quality preview --set surface.anisotropy={}") == last);
    assert!(mesh("--quality draft --voxel 0.5") == mesh(ISOTROPIC), "and nothing else");
}

#[test]
fn tiers_are_for_particle_files() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1", 0);
    let (_, talk) = desk.run("mesh small --quality draft", 2);
    assert!(talk.contains("--quality draft is for particle files") && talk.contains("--set"), "{talk}");
    let (_, talk) = desk.run("mesh a.xyz --spacing 0.1 -o out --quality fine", 2);
    assert!(talk.contains("draft, preview, final"), "{talk}");
}

#[test]
fn a_spacing_may_have_a_unit() {
    let desk = Desk::new();
    desk.write("drop.xyz", xyz(&drop_and_sheet()));
    let mesh = |spacing: &str| {
        let mut tool = desk.tool("mesh drop.xyz -o out --force --quality draft --spacing");
        assert!(tool.arg(spacing).output().unwrap().status.success(), "{spacing}");
        fs::read(desk.path("out/mesh/particles_0001.ply")).unwrap()
    };
    let metres = mesh("0.1");
    for text in ["10 cm", "100mm", "0.1 m"] {
        assert!(mesh(text) == metres, "{text}");
    }
    let (_, talk) = desk.run("mesh drop.xyz -o out --spacing 3kg", 2);
    assert!(talk.contains("unit of length"), "{talk}");
}

#[test]
fn tables_of_particles_are_meshed_as_the_same_particles() {
    let desk = Desk::new();
    let points = drop_and_sheet();
    desk.write("drop_1.xyz", xyz(&points));
    let rows = |separator: &str| -> String {
        let row = |[x, y, z]: &[f32; 3]| [x, y, z].map(f32::to_string).join(separator) + "\n";
        points.iter().map(row).collect()
    };
    desk.write("drop_1.csv", format!("x,y,z\n{}", rows(",")));
    desk.write("drop_1.txt", rows("\t"));
    desk.write("drop_1.tsv", rows(";"));
    let mesh = |file: &str| {
        desk.run(&format!("mesh {file} --spacing 0.1 -o {file}.out --quality draft"), 0);
        meshing::read_ply(&desk.path(&format!("{file}.out/mesh/particles_0001.ply")))
    };
    let expected = mesh("drop_1.xyz");
    assert!(expected.triangles.len() > 1000);
    for file in ["drop_1.csv", "drop_1.txt", "drop_1.tsv"] {
        let found = mesh(file);
        assert!(found.positions == expected.positions && found.triangles == expected.triangles, "{file}");
    }
    // As a sequence, and what is wrong with its place.
    desk.write("drop_2.csv", "x,y,z\n0,0,0\n0,0\n");
    let (_, talk) = desk.run("mesh drop_*.csv --spacing 0.1 -o out", 3);
    assert!(talk.contains("drop_2.csv: line 3, particle 1: found 2 columns"), "{talk}");
}
