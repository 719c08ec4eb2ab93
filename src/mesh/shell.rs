//! Offset of a sheet to a closed shell of some thickness.
//!
//! *Method*: every vertex is offset by half the thickness along its normal and by half against it. A strip
//! joins the two copies of every boundary edge, which has a triangle on one side only. A sheet whose edges
//! have at most two triangles, consistently oriented, gives a closed and oriented shell.
//!
//! Limits: where a sheet bends more sharply than its thickness the inner side folds over itself.

use super::{Mesh, normals_from_faces};
use crate::frame::{Channel, ChannelData};
use std::collections::BTreeMap;

/// The shell of `thickness` [m] around `sheet`. Vertex v of the sheet becomes v on the side that normals
/// point to and v + (vertices of the sheet) on the other; attributes are those of the sheet, on both sides.
pub fn shell(sheet: &Mesh, thickness: f32) -> Mesh {
    let normals = normals_from_faces(sheet);
    let side = |sign: f32| {
        let half = 0.5 * sign * thickness;
        sheet.positions.iter().zip(&normals).map(move |(x, n)| x + n * half)
    };
    let count = sheet.positions.len() as u32;
    let below = sheet.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v + count));
    // A boundary edge runs along its triangle; the strip has to run against it.
    let strips = borders(sheet).into_iter().flat_map(|[a, b]| [[b, a, a + count], [b, a + count, b + count]]);
    let mut body = Mesh {
        positions: side(1.0).chain(side(-1.0)).collect(),
        origin: sheet.origin,
        triangles: sheet.triangles.iter().copied().chain(below).chain(strips).collect(),
        normals: Vec::new(),
        attributes: sheet.attributes.iter().map(twice).collect(),
    };
    body.normals = normals_from_faces(&body);
    body
}

/// The boundary edges, in the direction of their triangle.
fn borders(sheet: &Mesh) -> Vec<[u32; 2]> {
    let mut sides = BTreeMap::<[u32; 2], i32>::new();
    for &[a, b, c] in &sheet.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *sides.entry([from, to]).or_default() += 1;
            *sides.entry([to, from]).or_default() -= 1;
        }
    }
    sides.into_iter().filter(|&(_, balance)| balance > 0).map(|(edge, _)| edge).collect()
}

fn twice(channel: &Channel) -> Channel {
    fn doubled<T: Clone>(values: &[T]) -> Vec<T> {
        [values, values].concat()
    }
    let data = match &channel.data {
        ChannelData::F32(values) => ChannelData::F32(doubled(values)),
        ChannelData::Vec3(values) => ChannelData::Vec3(doubled(values)),
        ChannelData::U32(values) => ChannelData::U32(doubled(values)),
    };
    Channel { name: channel.name.clone(), data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{math::Vec3, mesh::check};

    /// A sheet of `n` × `n` squares over the unit square, with this height, without the squares that
    /// `is_hole` selects.
    fn sheet(n: u32, height: impl Fn(f32, f32) -> f32, is_hole: impl Fn(u32, u32) -> bool) -> Mesh {
        let at = |i: u32| i as f32 / n as f32;
        let points = (0..(n + 1).pow(2)).map(|v| (at(v % (n + 1)), at(v / (n + 1))));
        let squares = (0..n * n).map(|s| (s % n, s / n)).filter(|&(i, j)| !is_hole(i, j));
        let corners = squares.flat_map(|(i, j)| {
            let v = j * (n + 1) + i;
            [[v, v + 1, v + n + 2], [v, v + n + 2, v + n + 1]]
        });
        Mesh {
            positions: points.map(|(x, y)| Vec3::new(x, y, height(x, y))).collect(),
            triangles: corners.collect(),
            ..Mesh::default()
        }
    }

    #[test]
    fn the_shell_of_a_flat_sheet_is_a_plate() {
        let body = shell(&sheet(4, |_, _| 0.0, |_, _| false), 0.1);
        let found = check(&body);
        assert!(found.is_sound(), "{found:?}");
        assert!((found.volume - 0.1).abs() < 1e-6 && (found.area - 2.4).abs() < 1e-5, "{found:?}");
        assert_eq!((body.positions.len(), body.triangles.len()), (50, 2 * 32 + 2 * 16));
    }

    #[test]
    fn shells_with_waves_and_holes_are_closed_and_have_area_times_thickness() {
        let waves = |x: f32, y: f32| 0.1 * (6.0 * x).sin() * (5.0 * y).cos();
        let thin = sheet(64, waves, |i, j| (20..30).contains(&i) && (20..30).contains(&j));
        let mut with_heat = thin.clone();
        let heat = (0..thin.positions.len()).map(|v| v as f32).collect::<Vec<_>>();
        with_heat.attributes = vec![Channel { name: "heat".into(), data: heat.into() }];
        let body = shell(&with_heat, 0.01);
        let found = check(&body);
        assert!(found.is_sound(), "{found:?}");
        // The volume of a shell that does not bend sharply is area times thickness, to second order in
        // curvature times thickness.
        let area = check(&thin).area;
        assert!((found.volume / (0.01 * area) - 1.0).abs() < 1e-3, "{} {}", found.volume, 0.01 * area);
        let ChannelData::F32(heat) = &body.attributes[0].data else { panic!("it was f32") };
        assert_eq!((heat.len(), heat[65 * 65]), (2 * 65 * 65, 0.0));
    }

    #[test]
    fn the_shell_of_an_empty_sheet_is_empty() {
        assert_eq!(shell(&Mesh::default(), 0.1), Mesh::default());
    }
}
