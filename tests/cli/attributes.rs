//! Attributes that surfaces take from simulated particles, in addition to their velocity.

use super::*;
use meniscus::{cache, frame::Frame};
use ply_rs_bw::{
    parser::Parser,
    ply::{DefaultElement, Property},
};

/// The small shot with a second source next to the first, whose particles have the attributes of `channels`.
fn two_sources(channels: &str) -> String {
    let second =
        "[[liquid.source]]\nshape = { box = { min = [1.2, 0, 0], max = [1.5, 0.8, 0.4] } }\n\n[output]";
    SMALL.replace("[output]", second).replace("[liquid]", &format!("[liquid]\n{channels}"))
}

/// The same with viscosities of 2 and 300 Pa·s.
fn two_viscosities(channels: &str) -> String {
    let table = "[liquid.viscosity]\ndynamic = \"2 Pa·s\"\n\n[[liquid.source]]\nviscosity = \"300 Pa·s\"\nshape = { box = { min = [1.2";
    two_sources(channels).replace("[[liquid.source]]\nshape = { box = { min = [1.2", table)
}

/// The vertices of a PLY mesh.
fn vertices(desk: &Desk, file: &str) -> Vec<DefaultElement> {
    let mut file = fs::File::open(desk.path(file)).unwrap();
    Parser::<DefaultElement>::new().read_ply(&mut file).unwrap().payload.swap_remove("vertex").unwrap()
}

fn frame(desk: &Desk, shot: &str, number: u32) -> Frame {
    cache::read_frame(&desk.path(&format!("{shot}/cache/frame_{number:04}.mcf"))).unwrap().0
}

#[test]
fn age_and_source_are_transferred_where_they_are_named_and_nowhere_else() {
    let desk = Desk::new();
    desk.write("plain.toml", two_sources(""));
    desk.write("kept.toml", two_sources("channels = [\"source\", \"age\"]"));
    desk.run("simulate plain.toml", 0);
    // In two parts, so that the second one goes on from a frame of the cache.
    desk.run("simulate kept.toml --frames 1-2", 0);
    desk.run("simulate kept.toml", 0);
    for number in [1, 2, 5] {
        let (plain, kept) = (frame(&desk, "plain", number), frame(&desk, "kept", number));
        let (plain, kept) = (&plain.streams[0], &kept.streams[0]);
        let names = |stream: &meniscus::frame::Stream| -> Vec<String> {
            stream.channels().iter().map(|channel| channel.name.clone()).collect()
        };
        assert_eq!(names(plain), ["position", "velocity", "id"]);
        assert_eq!(names(kept), ["position", "velocity", "id", "age", "source"]);
        assert!(plain.channels() == &kept.channels()[..3], "they move no particle");
        let age = kept.f32("age").unwrap();
        assert!(age.iter().all(|&age| age == ((f64::from(number) - 1.0) / 24.0) as f32), "{age:?}");
        let of_second = |&id: &u32| u32::from(id >= 512);
        let expected: Vec<u32> = kept.u32("id").unwrap().iter().map(of_second).collect();
        assert!(expected.contains(&0) && expected.contains(&1));
        assert_eq!(kept.u32("source").unwrap(), expected, "frame {number}");
    }
    desk.run("simulate kept.toml -o whole", 0);
    assert_eq!(desk.bytes("whole/cache"), desk.bytes("kept/cache"));
    // Another set of channels is another cache.
    desk.run("simulate kept.toml --set liquid.channels=[\"age\"]", 14);

    let attributes = "--set surface.attributes=[\"source\",\"age\"]";
    // The second time the meshes exist, and their attributes are read from them.
    for there in ["0 up to date", "2 up to date"] {
        let (out, _) = desk.run(&format!("mesh kept {attributes} --frames 1,3"), 0);
        assert!(out.contains(there), "{out}");
        let manifest: serde_json::Value =
            serde_json::from_slice(&fs::read(desk.path("kept/shot.json")).unwrap()).unwrap();
        let attributes_of = serde_json::json!({ "age": ["age"], "source": ["source"] });
        assert_eq!(manifest["outputs"][0]["attributes"], attributes_of);
    }
    for (number, age) in [(1, 0.0), (3, 2.0 / 24.0)] {
        let vertices = vertices(&desk, &format!("kept/mesh/liquid_{number:04}.ply"));
        let source = |vertex: &DefaultElement| match vertex["source"] {
            Property::UInt(source) => source,
            ref other => panic!("{other:?}"),
        };
        let number = |vertex: &DefaultElement, name: &str| match vertex[name] {
            Property::Float(number) => number,
            ref other => panic!("{other:?}"),
        };
        assert!(vertices.iter().all(|vertex| (number(vertex, "age") - age).abs() < 1e-6));
        let side = |vertex: &DefaultElement| u32::from(number(vertex, "x") > 1.1);
        let right = vertices.iter().filter(|vertex| source(vertex) == side(vertex)).count();
        assert!(age > 0.0 || right == vertices.len(), "{right} of {} vertices", vertices.len());
        assert!(vertices.iter().any(|vertex| source(vertex) == 1));
    }

    // A cache without them cannot give them; the message has the remedy.
    let (_, talk) = desk.run(&format!("mesh plain {attributes}"), 2);
    assert!(talk.contains("liquid.channels") && talk.contains("simulated again"), "{talk}");
}

#[test]
fn each_source_keeps_its_viscosity_and_gives_it_to_the_surface() {
    let desk = Desk::new();
    desk.write("plain.toml", two_viscosities(""));
    desk.write("kept.toml", two_viscosities("channels = [\"viscosity\"]"));
    desk.run("simulate plain.toml", 0);
    desk.run("simulate kept.toml --frames 1-2", 0);
    desk.run("simulate kept.toml", 0);
    let [plain, kept] = ["plain", "kept"].map(|shot| frame(&desk, shot, 5));
    let [plain, kept] = [&plain, &kept].map(|frame| &frame.streams[0]);
    // A resumed shot needs the source of each particle.
    assert!(plain.u32("source").is_some() && plain.f32("viscosity").is_none());
    assert!(plain.vec3("position") == kept.vec3("position"), "a channel moves no particle");
    let of_source = |&source: &u32| [2.0, 300.0][source as usize];
    let expected: Vec<f32> = kept.u32("source").unwrap().iter().map(of_source).collect();
    assert_eq!(kept.f32("viscosity").unwrap(), expected);
    assert!(expected.contains(&2.0) && expected.contains(&300.0));

    desk.run("mesh kept --set surface.attributes=[\"viscosity\"] --frames 1,5", 0);
    let vertices = vertices(&desk, "kept/mesh/liquid_0005.ply");
    let values = vertices.iter().map(|vertex| match vertex["viscosity"] {
        Property::Float(value) => value,
        ref other => panic!("{other:?}"),
    });
    let [thinnest, thickest] =
        values.fold([f32::INFINITY, 0.0_f32], |[low, high], value| [low.min(value), high.max(value)]);
    assert!((thinnest - 2.0).abs() < 1e-3 && (thickest - 300.0).abs() < 1e-1, "{thinnest} to {thickest}");

    // A branch may change the viscosity of a source, and nothing else of it.
    desk.run("shot kept --from 3 -o thin --set liquid.source.1.viscosity=5", 0);
    assert_ne!(frame(&desk, "thin", 5).streams[0].vec3("position"), kept.vec3("position"));
    let (_, message) = desk.run("shot kept --from 3 -o moved --set liquid.source.1.velocity=[1,0,0]", 2);
    assert!(message.contains("liquid.source.1.velocity"), "{message}");
    desk.write("uniform.toml", two_sources("viscosity = { dynamic = 2 }"));
    desk.run("simulate uniform.toml", 0);
    let (_, message) = desk.run("shot uniform --from 3 -o own --set liquid.source.1.viscosity=5", 2);
    assert!(message.contains("source") && message.contains("simulate it from its start"), "{message}");
}

/// The small shot with two sources that touch, with these keys.
fn two_colors(first: &str, second: &str) -> String {
    let touching =
        two_sources("").replace("min = [1.2, 0, 0], max = [1.5,", "min = [0.8, 0, 0], max = [1.5,");
    let mut parts = touching.splitn(3, "[[liquid.source]]\n");
    let mut part = || parts.next().unwrap().to_owned();
    [part(), format!("[[liquid.source]]\n{first}"), part(), format!("[[liquid.source]]\n{second}"), part()]
        .concat()
}

const BLUE: &str = "color = [0.02, 0.1, 0.9]\n";
const RED: &str = "color = [0.9, 0.1, 0.02]\n";

#[test]
fn colors_of_sources_blend_on_the_surface_and_change_without_a_simulation() {
    let desk = Desk::new();
    desk.write("plain.toml", two_colors("", ""));
    desk.write("one.toml", two_colors(BLUE, RED));
    desk.run("shot plain.toml", 0);
    desk.run("shot one.toml", 0);
    let [plain, own] = ["plain", "one"].map(|shot| frame(&desk, shot, 5));
    let [plain, own] = [&plain, &own].map(|frame| &frame.streams[0]);
    assert!(own.u32("source").is_some() && plain.u32("source").is_none());
    assert!(plain.vec3("position") == own.vec3("position"), "a colour moves no particle");

    // Bytes in sRGB, from one colour to the other.
    let found = colors(&desk, "one/mesh/liquid_0003.ply");
    let part = |part: usize| found.iter().map(move |color| color[part]);
    assert_eq!([part(0).min(), part(0).max(), part(2).min(), part(2).max()], [39, 243, 39, 243].map(Some));
    assert!(found.iter().all(|color| color[1].abs_diff(89) <= 1), "green is 0.1 in both");
    let mixed = found.iter().filter(|color| color[0] > 60 && color[2] > 60).count();
    assert!(mixed > found.len() / 50, "{mixed} of {} vertices are between the two", found.len());
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(desk.path("one/shot.json")).unwrap()).unwrap();
    let attributes = serde_json::json!({ "color": ["red", "green", "blue"], "velocity": ["vx", "vy", "vz"] });
    assert_eq!(manifest["outputs"][0]["attributes"], attributes);

    // Other colours need other meshes, and no simulation; a source without one is white.
    let (cached, meshes) = (desk.bytes("one/cache"), desk.bytes("one/mesh"));
    desk.write("one.toml", two_colors(BLUE, ""));
    let (out, _) = desk.run("shot one.toml", 0);
    assert!(
        out.contains("0 frames simulated")
            && out.contains("5 frames meshed")
            && desk.bytes("one/cache") == cached,
        "{out}"
    );
    assert!(colors(&desk, "one/mesh/liquid_0003.ply").contains(&[231, 231, 231]));
    desk.write("one.toml", two_colors(BLUE, RED));
    desk.run("shot one.toml", 0);
    let surfaces = |files: Vec<(String, Vec<u8>)>| {
        files.into_iter().filter(|(name, _)| name.ends_with(".ply")).collect::<Vec<_>>()
    };
    assert_eq!(surfaces(desk.bytes("one/mesh")), surfaces(meshes), "the same colours give the same bytes");

    // Surfaces that name other attributes have none.
    desk.run("mesh one -o bare --set surface.attributes=[\"velocity\"] --frames 3", 0);
    assert!(vertices(&desk, "bare/mesh/liquid_0003.ply")[0].get("red").is_none());

    // Frames without the sources must be simulated again, and a surface without colours cannot have them.
    let (_, talk) = desk.run("shot plain.toml --set liquid.source.0.color=[1,0,0]", 14);
    assert!(talk.contains("liquid.channels"), "{talk}");
    let (_, talk) = desk.run("shot plain.toml -o none --set surface.attributes=[\"color\"]", 2);
    assert!(talk.contains("no source and no emitter has a colour"), "{talk}");
    let (_, talk) = desk.run("shot one.toml -o none --set liquid.source.0.color=[1,0,2]", 2);
    assert!(talk.contains("liquid.source.0.color.2") && talk.contains("0 to 1"), "{talk}");

    // A branch may have other colours; without any the sources are no longer part of the preset.
    desk.run("shot one --from 3 -o branch --set liquid.source.1.color=[1,1,1]", 0);
    assert!(
        colors(&desk, "branch/mesh/liquid_0005.ply").iter().any(|color| color.iter().all(|part| *part > 250))
    );
    let (_, talk) = desk.run("shot plain.toml -o one", 14);
    assert!(talk.contains("liquid.channels"), "{talk}");
    // Frames that have the sources for their viscosity need nothing more.
    desk.write("thick.toml", two_viscosities(""));
    desk.run("shot thick.toml", 0);
    let (out, _) = desk.run("shot thick.toml --set liquid.source.0.color=[1,0,0]", 0);
    assert!(out.contains("0 frames simulated") && out.contains("5 frames meshed"), "{out}");

    // Pictures of other colours are other pictures, with the mesh and without it, and stages have the colours.
    let picture = |folder: &str| {
        desk.run(&format!("preview {folder} --frames 3 --size 160x90"), 0);
        fs::read(desk.path(&format!("{folder}/preview/frame_0003.png"))).unwrap()
    };
    let before = picture("one");
    assert!(before == picture("one"));
    fs::remove_dir_all(desk.path("one/mesh")).unwrap();
    let without_mesh = picture("one");
    desk.write("one.toml", two_colors(RED, RED));
    desk.run("simulate one.toml", 0);
    assert!(picture("one") != without_mesh, "the draft surface has the colours of the preset");
    desk.run("shot one.toml", 0);
    assert!(picture("one") != before, "and so has the mesh");
    desk.run("usd one", 0);
    let manifest = fs::read_to_string(desk.path("one/usd/manifest.usda")).unwrap();
    assert!(manifest.contains("primvars:displayColor"), "{manifest}");

    // Particles of other programs may have colours.
    fs::copy(desk.path("one/mesh/liquid_0003.ply"), desk.path("points.ply")).unwrap();
    desk.run("mesh points.ply --spacing 0.1 -o again", 0);
    let file = desk.names("again/mesh").into_iter().find(|name| name.ends_with(".ply")).unwrap();
    assert!(colors(&desk, &format!("again/mesh/{file}")).iter().any(|color| color[0] > 200));
}

/// The colours of the vertices of a PLY mesh.
fn colors(desk: &Desk, file: &str) -> Vec<[u8; 3]> {
    let byte = |vertex: &DefaultElement, name: &str| match vertex[name] {
        Property::UChar(byte) => byte,
        ref other => panic!("{other:?}"),
    };
    let color = |vertex: &DefaultElement| ["red", "green", "blue"].map(|name| byte(vertex, name));
    vertices(desk, file).iter().map(color).collect()
}
