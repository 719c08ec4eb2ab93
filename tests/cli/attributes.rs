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
        let path = desk.path(&format!("kept/mesh/liquid_{number:04}.ply"));
        let ply = Parser::<DefaultElement>::new().read_ply(&mut fs::File::open(path).unwrap()).unwrap();
        let vertices = &ply.payload["vertex"];
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
