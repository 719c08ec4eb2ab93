//! The surfaces of solids as panels.
//!
//! *Method*: nodes of a lattice that are nearer to a surface than a lattice step p are moved onto it along the normal, each with the
//! area p² (1 − |d|/p), which over a smooth surface sums to its area, to which they are scaled (`areas.rs`).
//! Those that fall into one cell become one panel. A panel's source stands inside the solid, about one and a half steps below it:
//! its field is smooth on the surface. In solids with edges sources are nearer, panels along the edges have none, and of sources that
//! nearly coincide there is one. Boxes have rectangles on their faces instead (`tiles.rs`). Nodes are found
//! by halving blocks of the lattice: one whose middle is farther from the surface than its corners from the middle holds none.

use super::{areas::area, sources::Source, tiles};
use crate::{math::Vec3, solid::Shape};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// How deep a source stands below its panel, in lattice steps. Nearer, the air between panels feels single sources; deeper, the
/// equations for them can hardly be told apart, and take more iterations.
const DEPTH: f32 = 1.5;

/// The same in solids with edges, where the air turns sharply: deeper sources cannot do that but by cancelling each other, and 60
/// iterations leave 40 % of the flow through a box of ten steps; nearer ones, and half as much is left between the panels.
const EDGED: f32 = 0.9;

/// How deep a source stands at most over the radius of the largest ball that fits in the solid below its panel. In the ball's middle the sources
/// of all sides are one, and GMRES finds none that keep the air out: between the panels of a ball of a radius of 0.9 steps three times the
/// wind was left, of a wire of 0.7 steps three hundred times. With 0.6, 0.16 and 0.6 times the wind; with 0.3, 0.6 and 0.8 (a prototype in double precision).
const ASIDE: f32 = 0.6;

/// In solids with edges, a panel has no source if that would have to stand nearer to it [steps]: the source would be as near to the
/// face behind the edge, and blow through there.
const SHALLOW: f32 = 0.6;

/// In such solids, a source nearer than this to another [steps] is left out, and its panel has none: the two faces beside an edge may each
/// have one in the same place, and then all are as strong as they cancel. Without, GMRES ends by its iterations on a box of 16 panels an
/// edge by where the lattice falls, and up to 1.5 times the wind is left; with 0.35, one; larger, and panels that could keep the air out do not.
const TWINS: f32 = 0.6;

/// Panels that lean to one side by more than this part of their area do not stand for a solid: those of what is thinner than half a step
/// are all on one side of it, and their sources would blow.
const OPEN: f32 = 0.5;

/// The least inner radius of a solid whose edges are told from its thinness [steps].
const THICK: f32 = 2.0;

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
    /// At edges it may have none; in solids thinner than about half its width none has.
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

/// Panels with point sources below them.
fn sunken(shape: &Shape, step: f32) -> Vec<Panel> {
    let mut made = gathered(shape, step);
    // Nodes as far apart as a part is thin stand for more than its surface, or less.
    let scale = area(shape) / made.iter().map(|panel| panel.area).sum::<f32>();
    made.iter_mut().for_each(|panel| panel.area *= scale);
    let leaning: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
    if leaning.norm() > OPEN * area(shape) {
        return made;
    }
    let edged =
        shape.inner_radius() >= THICK * step && made.iter().any(|panel| is_at_edge(shape, panel, step));
    for panel in &mut made {
        let at_edge = edged && is_at_edge(shape, panel, step);
        let most = step * if edged { EDGED } else { DEPTH };
        let aside = if at_edge { most } else { most.min(ASIDE * room(shape, panel, most / ASIDE)) };
        let depth = depth(shape, panel, aside);
        let too_near = at_edge && depth < SHALLOW * step;
        // What is thinner than the shallowest has no source: one in the air would blow all away.
        let source = panel.x - panel.normal * depth;
        panel.source = (!too_near && shape.signed_distance(source) < 0.0).then_some(Source::Point(source));
    }
    if edged {
        part(&mut made, TWINS * step);
    }
    made
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

/// Leaves panels whose source is nearer than `least` [m] to that of one before without it.
fn part(panels: &mut [Panel], least: f32) {
    let cell = |y: Vec3| y.map(|v| (v / least).floor() as i64);
    let mut kept: BTreeMap<[i64; 3], Vec<Vec3>> = BTreeMap::new();
    for panel in panels {
        let Some(Source::Point(y)) = panel.source else { continue };
        let here = cell(y);
        let around = (0..27).map(|n| [0, 1, 2].map(|axis| here[axis] + n / 3_i64.pow(axis as u32) % 3 - 1));
        let crowded = around
            .filter_map(|cell| kept.get(&cell))
            .flatten()
            .any(|other| (other - y).norm_squared() < least * least);
        if crowded {
            panel.source = None;
        } else {
            kept.entry(here.into()).or_default().push(y);
        }
    }
}

/// The radius of the largest ball in the solid that touches the surface at a panel [m], up to `most`.
fn room(shape: &Shape, panel: &Panel, most: f32) -> f32 {
    let mut radius = most;
    for _ in 0..6 {
        let inside = -shape.signed_distance(panel.x - panel.normal * radius);
        if inside > 0.9 * radius {
            break;
        }
        // Between two faces, and in a ball, that is its radius at once; beside an edge it comes nearer by half.
        radius = 0.5 * (radius + inside);
    }
    radius
}

/// How deep the source of a panel stands, `most` at most [m]: less where another face is near.
fn depth(shape: &Shape, panel: &Panel, most: f32) -> f32 {
    let mut depth = most;
    for _ in 0..4 {
        if shape.signed_distance(panel.x - panel.normal * depth) < -0.6 * depth {
            break;
        }
        depth *= 0.6;
    }
    depth
}

/// Whether another face of a thick part is near the place below a panel.
fn is_at_edge(shape: &Shape, panel: &Panel, step: f32) -> bool {
    let below = |depth: f32| panel.x - panel.normal * depth;
    if shape.signed_distance(below(DEPTH * step)) < -0.9 * DEPTH * step {
        return false;
    }
    // In a thick part there is room aside.
    let mut x = below(EDGED * step);
    for _ in 0..6 {
        let (distance, out) = shape.contact(x);
        if distance < -0.9 * EDGED * step {
            return true;
        }
        x -= out * (EDGED * step + distance);
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
    fn no_two_sources_beside_an_edge_share_a_place() {
        let cuboid = Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] };
        for step in [1.22, 1.3, 1.32, 1.36, 1.5] {
            let mut made = sunken(&cuboid, step);
            let points = |made: &[Panel]| -> Vec<Vec3> {
                let point = |panel: &Panel| match panel.source {
                    Some(Source::Point(y)) => Some(y),
                    _ => None,
                };
                made.iter().filter_map(point).collect()
            };
            let at = points(&made);
            let nearest = |i: usize| (0..i).map(|j| (at[i] - at[j]).norm()).fold(f32::INFINITY, f32::min);
            let least = (1..at.len()).map(nearest).fold(f32::INFINITY, f32::min);
            assert!(least >= TWINS * step, "{step}: {least}");
            made.retain(|panel| panel.source.is_some());
            assert!(made.len() > 600, "{step}: {}", made.len());
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
