//! Measures of sheets whose places are known.

use super::{
    compare::{energy, squares},
    row::{Row, between},
};
use crate::{
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
};
use serde_json::json;

/// Points of a grid over the unit square, on this surface.
fn points(cells: [u32; 2], height: impl Fn(f32, f32) -> f32) -> Vec<Vec3> {
    let part = |i: u32, n: u32| i as f32 / n.max(1) as f32;
    let at = |i, j| (part(i, cells[0]), part(j, cells[1]));
    let all = (0..=cells[1]).flat_map(|j| (0..=cells[0]).map(move |i| (i, j)));
    all.map(|(i, j)| at(i, j)).map(|(u, v)| Vec3::new(u, v, height(u, v))).collect()
}

#[test]
fn grids_of_any_cells_are_compared_at_the_same_places() {
    let twisted = |u: f32, v: f32| 2.0 * u - 3.0 * v + 4.0 * u * v;
    for cells in [[4, 4], [8, 4], [3, 7], [16, 12]] {
        let found = between(&points(cells, twisted), cells, [4, 4]);
        for (a, b) in found.iter().zip(points([4, 4], twisted)) {
            assert!((a - b).amax() < 2e-6, "{cells:?}: {a:?} {b:?}");
        }
    }
    // Where the corners are points they are these points, to the last digit.
    let rough = |u: f32, v: f32| (17.0 * u + 5.0 * v).sin();
    let fine = points([12, 8], rough);
    let every: Vec<Vec3> =
        (0..=2).flat_map(|j| (0..=4).map(move |i| 3 * i + 13 * 4 * j)).map(|k| fine[k]).collect();
    assert_eq!(between(&fine, [12, 8], [4, 2]), every);
    assert_eq!(between(&fine, [12, 8], [12, 8]), fine);
    // Chains and single points.
    let chain = points([5, 0], |u, _| u);
    assert_eq!(between(&chain, [5, 0], [5, 0]), chain);
    assert_eq!(between(&[Vec3::x()], [0, 0], [0, 0]), [Vec3::x()]);
}

#[test]
fn distances_are_between_the_same_points_of_the_same_sheets() {
    let frame = |sheets: &[(&str, Vec<Vec3>)]| Frame {
        streams: sheets
            .iter()
            .map(|(name, places)| {
                Stream::new(*name, StreamKind::MeshPoints, places.len()).with("position", places.clone())
            })
            .collect(),
        index: FrameIndex(1),
        time: 0.0,
    };
    let flat = points([1, 1], |_, _| 0.0);
    let up: Vec<Vec3> = flat.iter().map(|x| x + Vec3::new(0.0, 0.0, 0.5)).collect();
    let (a, b) = (frame(&[("sheet.a", flat.clone())]), frame(&[("sheet.a", up.clone())]));
    assert_eq!(squares(&a, &b), Some(vec![0.25; 4]));
    assert_eq!(squares(&a, &frame(&[("sheet.b", up.clone())])), None);
    assert_eq!(squares(&a, &frame(&[("sheet.a", up[..3].to_vec())])), None);
    assert_eq!(squares(&a, &frame(&[("sheet.a", flat.clone()), ("sheet.b", up)])), None);
}

#[test]
fn energies_are_parts_of_what_moves_and_stretches() {
    let row = |kinetic: f64, height: f64| -> Row {
        let logged = json!({
            "substeps": 3, "iterations": 0, "unconverged": 0, "overshot": 0, "kinetic_energy": kinetic, "elastic_energy": 1.0,
            "potential_energy": height, "strain_max": 0.1, "caught": 0, "inside_solids": 0,
        });
        serde_json::from_value(json!({
            "points": 4, "spacing": 0.1, "seconds": [1.0], "cpu_seconds": [], "memory": null, "diverged": null,
            "last_frame": 0,
            "frames": [{ "frame": 1, "places": 7, "logged": null }, { "frame": 2, "places": 8, "logged": logged }],
        }))
        .unwrap()
    };
    let reference = row(3.0, -50.0);
    assert_eq!(energy(&reference, &reference, &|_| true), Some(0.0));
    assert_eq!(energy(&row(4.0, -51.0), &reference, &|_| true), Some(0.0), "one goes into the other");
    assert_eq!(energy(&row(5.0, -50.0), &reference, &|_| true), Some(0.5));
    assert_eq!(energy(&row(5.0, -50.0), &reference, &|frame| frame == 1), None);
}
