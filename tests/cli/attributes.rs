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
