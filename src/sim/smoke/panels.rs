//! The surfaces of solids as panels.
//!
//! *Method*: nodes of a lattice that are nearer to a surface than a lattice step p are moved onto it along the normal, each with the
//! area p² (1 − |d|/p), which over a smooth surface sums to its area, to which they are scaled (`areas.rs`).
//! Those that fall into one cell become one panel. A panel's source stands inside the solid, about one and a half steps below it, or
//! less where that is thin: its field is smooth on the surface. In solids with edges it is a square just below the panel
//! instead, and boxes have rectangles on their faces (`tiles.rs`). Nodes are found
//! by halving blocks of the lattice: one whose middle is farther from the surface than its corners from the middle holds none.

use super::{
    areas::area,
    sources::Source,
    tiles::{self, Tile},
};
use crate::{math::Vec3, solid::Shape, space::CellGrid};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// How deep a source stands below its panel, in lattice steps. Nearer, the air between panels feels single sources; deeper, the
/// equations for them can hardly be told apart, and take more iterations.
const DEPTH: f32 = 1.5;

/// How deep a source stands at most over the radius of the largest ball that fits in the solid below its panel. In the ball's middle the sources
/// of all sides are one, and GMRES finds none that keep the air out: between the panels of a ball of a radius of 0.9 steps three times the
/// wind was left, of a wire of 0.7 steps three hundred times. With 0.6, 0.16 and 0.6 times the wind; with 0.3, 0.6 and 0.8 (a prototype in double precision).
const ASIDE: f32 = 0.6;

/// How deep the squares in solids with edges are [steps]. On the surface a half of the wind is left all over boxes of 6 to 16 steps, half a step deep the
/// air turns around edges twice as fast; here 0.3 to 0.5 is left, of which 0.15 on faces. Points, at any depth, leave 0.7 to 1 (a prototype in double precision).
const SUNK: f32 = 0.25;

/// How far the edges of such a square are taken to be at least [steps]. A fifth more is left with 0.3, which is best for rectangles on faces that
/// they cover without gaps (`tiles.rs`); larger was not tried.
const SOFT_SQUARE: f32 = 0.5;

/// The least thickness below a square, in its depths. The squares of two faces that are nearer to each other are one to the equations: with 2, up to three times the wind is
/// left on fins 0.55 steps thick by where the lattice falls, with 1 hundreds of times, and with 4 three quarters at most; more, and fins that keep some air out have none.
const ROOM: f32 = 4.0;

/// In solids with edges, a panel nearer than this to one before [steps] is a part of it: their equations would be nearly the same, and their sources as strong
/// as they cancel. Without, up to four times the wind is left by where the lattice falls; with half a step a tenth more than with these.
const TWINS: f32 = 0.4;

/// The least inner radius of a solid with sources [steps]. Panels of thinner ones stand on this side or that of it by where the lattice falls, and more is left than
/// without (a prototype); of a radius of 0.7 steps 0.3 to 0.7 is left.
const THIN: f32 = 0.5;

/// Panels that lean to one side by more than this part of their area do not stand for a solid, as of a ball as small as a step, or a mesh whose samples are
/// coarse. Balls of a radius of 0.7 steps lean by 0.36 at most.
const OPEN: f32 = 0.5;

/// The least inner radius of a solid whose edges are told from its thinness [steps].
const THICK: f32 = 2.0;

/// How far below a panel another face is looked for to tell an edge [steps]. Deeper than about one, and no edge is found in solids as thin as `THICK` allows.
const BELOW: f32 = 0.9;

/// Where the lattice stands [steps].
const OFFSET: Vec3 = Vec3::new(0.37, 0.29, 0.43);

/// A piece of a surface, about the solid's own origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    /// Its middle [m].
    pub(super) x: Vec3,
    /// Out of the solid.
    pub(super) normal: Vec3,
    /// [m²].
    pub(super) area: f32,
    /// About how wide it is [m].
    pub(super) width: f32,
    /// In thin parts, and right on an edge, it may have none; in solids thinner than its width none has.
    pub(super) source: Option<Source>,
}

/// How much steeper than a distance samples of one may be.
const STEEPEST: f32 = 1.25;

/// The longest side of the box around a shape [m]; 0 for a plane.
pub(super) fn longest(shape: &Shape) -> f32 {
    bounds(shape).map_or(0.0, |(low, high)| (high - low).amax())
}

fn bounds(shape: &Shape) -> Option<(Vec3, Vec3)> {
    match shape {
        Shape::Tank { min, max } => Some((Vec3::from(*min), Vec3::from(*max))),
        _ => shape.bounds(),
    }
}

/// Where a node of the lattice stands [m]: off the origin, so that it does not fall into the faces of shapes of round numbers.
fn place(node: Vec3, step: f32) -> Vec3 {
    (node + OFFSET) * step
}

/// The nodes around a shape that may be nearer than `step` to its surface, by z, y and x.
fn near(shape: &Shape, step: f32) -> Vec<[i64; 3]> {
    let Some((low, high)) = bounds(shape) else { return Vec::new() };
    let first = low.map(|v| (v / step).floor() as i64 - 1);
    let last = high.map(|v| (v / step).ceil() as i64 + 1);
    let mut found = Vec::new();
    let mut blocks = vec![(first, ((last - first).max() as u64 + 1).next_power_of_two() as i64)];
    while let Some((corner, side)) = blocks.pop() {
        // From its middle to its corners [steps].
        let half = 0.5 * (side - 1) as f32;
        let middle = place(corner.map(|v| v as f32).add_scalar(half), step);
        if shape.signed_distance(middle).abs() > STEEPEST * step * (1.0 + 3.0_f32.sqrt() * half) {
            continue;
        }
        if side == 1 {
            found.push([corner.z, corner.y, corner.x]);
            continue;
        }
        let side = side / 2;
        let parts =
            (0..8).map(|part: i64| Vector3::from_fn(|axis, _| corner[axis] + side * (part >> axis & 1)));
        let within = |part: &Vector3<i64>| (0..3).all(|axis| part[axis] <= last[axis]);
        blocks.extend(parts.filter(within).map(|part| (part, side)));
    }
    found.sort_unstable();
    found
}

/// The panels of a shape about `step` [m] wide; none for a plane.
pub(super) fn panels(shape: &Shape, step: f32) -> Vec<Panel> {
    if let Shape::Box { min, max } = shape {
        return tiles::panels(Vec3::from(*min), Vec3::from(*max), step);
    }
    sunken(shape, step)
}

/// Panels with sources below them.
fn sunken(shape: &Shape, step: f32) -> Vec<Panel> {
    let mut made = gathered(shape, step);
    // Nodes as far apart as a part is thin stand for more than its surface, or less.
    let whole = area(shape);
    let scale = whole / made.iter().map(|panel| panel.area).sum::<f32>();
    made.iter_mut().for_each(|panel| panel.area *= scale);
    // What is too thin for its panels has no sources.
    let leaning: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
    if shape.inner_radius() < THIN * step || leaning.norm() > OPEN * whole {
        return made;
    }
    // An ellipsoid is sharp at its ends and has no edge: points leave a seventh to two thirds of what squares do (a prototype).
    let may_have_edges = shape.inner_radius() >= THICK * step && !matches!(shape, Shape::Ellipsoid { .. });
    let edged = may_have_edges && made.iter().any(|panel| is_at_edge(shape, panel, step));
    if edged {
        made = merged(&made, TWINS * step);
    }
    for panel in &mut made {
        panel.source = if edged { square(shape, panel, step) } else { point(shape, panel, step) };
    }
    made
}

/// The panels, of which one nearer than `least` [m] to one before adds its area to that, whose place and normal stand for both: a mean of two faces' would be
/// neither's, and at an edge in the solid.
fn merged(panels: &[Panel], least: f32) -> Vec<Panel> {
    let at: Vec<Vec3> = panels.iter().map(|panel| panel.x).collect();
    let cells = CellGrid::new(&at, least);
    let mut kept: Vec<Option<Panel>> = vec![None; panels.len()];
    for (i, panel) in panels.iter().enumerate() {
        match cells.nearest_within(&at, panel.x, least, |j| kept[j].is_some()) {
            Some(j) => kept[j].iter_mut().for_each(|other| other.area += panel.area),
            None => kept[i] = Some(*panel),
        }
    }
    kept.into_iter().flatten().collect()
}

/// The source of a panel in a solid with edges; none in its thin parts.
fn square(shape: &Shape, panel: &Panel, step: f32) -> Option<Source> {
    let has_room = shape.signed_distance(panel.x - panel.normal * (ROOM * SUNK * step)) < 0.0;
    has_room.then(|| Source::Tile(Tile::square(panel, SUNK * step, SOFT_SQUARE * step)))
}

/// The source of a panel in a smooth solid.
fn point(shape: &Shape, panel: &Panel, step: f32) -> Option<Source> {
    let most = DEPTH * step;
    let depth = most.min(ASIDE * room(shape, panel, most / ASIDE));
    let place = panel.x - panel.normal * depth;
    // In a mesh, parts thinner than its samples may have no inside; a source in the air would blow all away.
    (shape.signed_distance(place) < 0.0).then_some(Source::Point(place))
}

/// The panels without sources, of the area that the nodes stand for.
fn gathered(shape: &Shape, step: f32) -> Vec<Panel> {
    // Area and middle by cell.
    let mut cells: BTreeMap<[i64; 3], (f32, Vec3)> = BTreeMap::new();
    for [k, j, i] in near(shape, step) {
        let node = place(Vec3::new(i as f32, j as f32, k as f32), step);
        let (distance, normal) = shape.contact(node);
        if distance.abs() >= step {
            continue;
        }
        let area = step * step * (1.0 - distance.abs() / step);
        let x = node - normal * distance;
        let cell =
            cells.entry([0, 1, 2].map(|axis| (x[axis] / step - OFFSET[axis]).floor() as i64)).or_default();
        cell.0 += area;
        cell.1 += x * area;
    }
    let panel = |(area, sum): (f32, Vec3)| {
        let middle = sum / area;
        // The nearest point of the middle; its normal is asked from outside, where it has one at edges too.
        let (distance, out) = shape.contact(middle);
        let x = middle - out * distance;
        let (_, normal) = shape.contact(x + out * (0.05 * step));
        Panel { x, normal, area, width: step, source: None }
    };
    cells.into_values().filter(|(area, _)| *area > 0.1 * step * step).map(panel).collect()
}

/// The radius of the largest ball in the solid that touches the surface at a panel [m], up to `most`.
fn room(shape: &Shape, panel: &Panel, most: f32) -> f32 {
    let mut radius = most;
    for _ in 0..6 {
        let inside = -shape.signed_distance(panel.x - panel.normal * radius);
        if inside > 0.9 * radius {
            break;
        }
        // Between two faces, and in a ball, half the sum is the answer at once; beside an edge it halves the rest.
        radius = 0.5 * (radius + inside);
    }
    radius
}

/// Whether another face of a thick part is near the place below a panel.
fn is_at_edge(shape: &Shape, panel: &Panel, step: f32) -> bool {
    let below = |depth: f32| panel.x - panel.normal * depth;
    if shape.signed_distance(below(DEPTH * step)) < -0.9 * DEPTH * step {
        return false;
    }
    // In a thick part there is room aside.
    let mut x = below(BELOW * step);
    for _ in 0..6 {
        let (distance, out) = shape.contact(x);
        if distance < -0.9 * BELOW * step {
            return true;
        }
        x -= out * (BELOW * step + distance);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sdf::Sampled, solid::MeshShape};
    use std::sync::Arc;

    #[test]
    fn panels_have_the_area_and_the_normals_of_their_shape() {
        let step = 0.05;
        let sphere = Shape::Sphere { center: [0.1, 0.0, -0.2], radius: 0.4 };
        let cuboid = Shape::Box { min: [0.0, 0.0, 0.0], max: [0.5, 0.4, 0.3] };
        let tank = Shape::Tank { min: [0.0, 0.0, 0.0], max: [0.5, 0.4, 0.3] };
        for (shape, area, flux) in
            [(sphere, 4.0 * std::f32::consts::PI * 0.16, 0.02), (cuboid, 0.94, 0.08), (tank, 0.94, 0.2)]
        {
            let made = panels(&shape, step);
            let sum: f32 = made.iter().map(|panel| panel.area).sum();
            assert!((sum / area - 1.0).abs() < 1e-4, "{shape:?}: {sum} for {area}");
            let closed: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
            assert!(closed.norm() < flux * area, "{shape:?}: {closed}");
            // Edges have no single normal, and panels there lean either way.
            let smooth = matches!(shape, Shape::Sphere { .. });
            for panel in made.iter().filter(|_| smooth) {
                assert!(shape.signed_distance(panel.x).abs() < 1e-4, "{shape:?} {panel:?}");
                let Some(Source::Point(source)) = panel.source else { panic!("a source each") };
                assert!(shape.signed_distance(source) < -0.2 * step, "{shape:?} {panel:?}");
                assert!(shape.signed_distance(panel.x + panel.normal * step) > 0.5 * step);
            }
        }
        assert!(panels(&Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] }, step).is_empty());
    }

    /// Spheres, boxes and samples of a ball in a mesh's place.
    fn shapes() -> Vec<Shape> {
        let ball = Shape::Sphere { center: [0.0; 3], radius: 0.4 };
        let (nodes, voxel) = ([26_u32; 3], 0.04);
        let origin = Vec3::repeat(-0.5);
        let at = |n: u32| Vec3::new((n % 26) as f32, (n / 26 % 26) as f32, (n / 676) as f32) * voxel + origin;
        let values = (0..26_u32.pow(3)).map(|n| ball.signed_distance(at(n))).collect();
        let mut mesh = MeshShape::new("ball.ply");
        mesh.translate = [0.1, -0.3, 0.2];
        mesh.rotate = [20.0, 0.0, 70.0];
        mesh.fill(Arc::new(Sampled { origin, voxel, nodes, values }));
        vec![
            Shape::Box { min: [0.0, 0.0, 0.0], max: [1.5, 0.03, 0.3] },
            Shape::Tank { min: [0.0, 0.0, 0.0], max: [0.5, 0.4, 0.3] },
            Shape::Capsule { from: [0.0, 0.0, -1.0], to: [0.3, 0.2, 1.0], radius: 0.1 },
            Shape::Mesh(mesh),
            ball,
        ]
    }

    #[test]
    fn no_node_near_a_surface_is_passed_over() {
        for (shape, step) in
            shapes().into_iter().flat_map(|shape| [0.03, 0.07].map(|step| (shape.clone(), step)))
        {
            let found = near(&shape, step);
            let (low, high) = bounds(&shape).unwrap();
            let range =
                |axis: usize| (low[axis] / step).floor() as i64 - 1..=(high[axis] / step).ceil() as i64 + 1;
            let mut missed = 0;
            for (k, j, i) in
                range(2).flat_map(|k| range(1).flat_map(move |j| range(0).map(move |i| (k, j, i))))
            {
                let node = place(Vec3::new(i as f32, j as f32, k as f32), step);
                let near = shape.contact(node).0.abs() < step;
                missed += usize::from(near && found.binary_search(&[k, j, i]).is_err());
            }
            assert_eq!(missed, 0, "{shape:?} {step}");
        }
    }

    #[test]
    fn thin_shapes_have_their_area_at_any_width() {
        let capsule = Shape::Capsule { from: [0.0; 3], to: [0.3, 0.2, 1.9], radius: 0.03 };
        let plate = Shape::Ellipsoid { center: [0.0; 3], radii: [1.0, 0.02, 0.6] };
        for (shape, step) in
            [&capsule, &plate].into_iter().flat_map(|shape| [0.02, 0.05, 0.2].map(|step| (shape, step)))
        {
            let sum: f32 = panels(shape, step).iter().map(|panel| panel.area).sum();
            assert!((sum / area(shape) - 1.0).abs() < 1e-3, "{shape:?} {step}: {sum}");
        }
    }

    #[test]
    fn no_two_panels_beside_an_edge_share_a_place() {
        let cuboid = Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] };
        for step in [1.22, 1.3, 1.32, 1.36, 1.5] {
            let made = sunken(&cuboid, step);
            let near =
                |i: usize| (0..i).map(|j| (made[i].x - made[j].x).norm()).fold(f32::INFINITY, f32::min);
            let least = (1..made.len()).map(near).fold(f32::INFINITY, f32::min);
            assert!(least >= TWINS * step, "{step}: {least}");
            let sum: f32 = made.iter().map(|panel| panel.area).sum();
            assert!((sum / 2400.0 - 1.0).abs() < 1e-3, "{step}: {sum}");
            let leaning: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
            assert!(leaning.norm() < 0.05 * sum, "{step}: {leaning}");
            let sources = made.iter().filter(|panel| panel.source.is_some()).count();
            // Those right on an edge have none.
            assert!(sources > made.len() * 9 / 10, "{step}: {sources} of {}", made.len());
        }
    }

    #[test]
    fn large_solids_take_time_by_their_surface() {
        // A million nodes in its bounds, 60 000 squares on its surface.
        let cuboid = Shape::Box { min: [0.0, 0.0, 0.0], max: [2.0, 2.0, 2.0] };
        let found = near(&cuboid, 0.02);
        let surface = 24.0 / (0.02 * 0.02);
        assert!((found.len() as f32) < 4.0 * surface, "{} nodes for {surface} squares", found.len());
    }
}
