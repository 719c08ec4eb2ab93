//! Source panels on the surfaces of solids.
//!
//! *Method*: grid nodes nearer to a surface than the grid step p are projected onto it along the normal, each with the area
//! p² (1 − |d|/p). Over a smooth surface these areas sum to its area, to which they are scaled (`areas.rs`). The nodes that
//! fall into one cell become one panel. A panel's source is a point inside the solid, about one and a half steps below the
//! panel and less deep in thin parts: its field is smooth on the surface. In solids with edges the source is a square source
//! panel just below the surface. Boxes have rectangular source panels on their faces (`tiles.rs`). Nodes are found by
//! halving blocks of the grid: a block whose centre is farther from the surface than its corners from its centre has none.
//!
//! The faces of a box are divided into source panels whose collocation points are their centres. Each equation is then
//! dominated by its own panel, and GMRES needs a handful of iterations. Point sources below the faces crowd at edges instead.

use super::{sources::Source, tiles::Tile};
use crate::{math::Vec3, solid::Shape, space::CellGrid};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Depth of a point source below its panel, in grid steps. Nearer, the air between panels feels single sources. Deeper, the
/// equations become ill-conditioned and take more iterations.
const POINT_DEPTH: f32 = 1.5;

/// Largest depth of a point source over the radius of the largest ball that fits in the solid below its panel. At the ball's
/// centre the sources of all sides coincide, and GMRES finds none that keep the air out: between the panels of a ball of radius
/// 0.9 steps three times the wind was left, of a wire of 0.7 steps three hundred times. With 0.6, 0.16 and 0.6 times the wind
/// were left, with 0.3, 0.6 and 0.8 times (a prototype in double precision).
const MAX_DEPTH_OVER_RADIUS: f32 = 0.6;

/// Depth of square source panels in solids with edges, in grid steps. On the surface half of the wind is left all over boxes of
/// 6 to 16 steps. Half a step deep the air flows around edges twice as fast. Here 0.3 to 0.5 is left, of which 0.15 on faces.
/// Points at any depth leave 0.7 to 1 (a prototype in double precision).
const TILE_DEPTH: f32 = 0.25;

/// Smallest distance to the edges of such a panel in its integrals, in grid steps. With 0.3, which is best for panels that cover
/// faces without gaps (`BOX_SOFTENING`), a fifth more is left; larger values were not tried.
const TILE_SOFTENING: f32 = 0.5;

/// Smallest distance from an edge in the integrals, over the width of a panel. Smaller, and the logarithm makes air at edges fast:
/// with 0.05 twice as much of the wind is left on a box of 16 panels an edge. Larger, and the field near borders between panels
/// departs from that of sources.
const BOX_SOFTENING: f32 = 0.3;

/// Smallest thickness of a box with sources, over the width of its panels. In thinner ones the panels of both faces make the
/// equations nearly singular, and twice the wind is left.
const MIN_BOX_THICKNESS: f32 = 0.5;

/// Smallest thickness below a square source panel, in its depths. Panels of two faces nearer to each other make the equations
/// nearly singular. With 2, up to three times the wind is left on fins 0.55 steps thick, depending on the grid's position; with 1
/// hundreds of times; with 4 at most three quarters. With more, fins that keep some air out have no sources.
const MIN_LOCAL_THICKNESS: f32 = 4.0;

/// In solids with edges, panels nearer to each other than this are merged [steps]: their equations would be nearly the same, and
/// their sources would cancel. Without merging, up to four times the wind is left, depending on the grid's position; with half a
/// step a tenth more than with this.
const MERGE_DISTANCE: f32 = 0.4;

/// Largest coupling of two square source panels at most a step apart, the product of what each induces at the other over that of what they
/// induce at themselves: near 1 their equations are nearly the same.
const MAX_COUPLING: f32 = 0.8;

/// Smallest inner radius of a solid with sources [steps]. In thinner ones the grid's position decides on which side panels lie, and
/// more is left than without sources (a prototype). With a radius of 0.7 steps 0.3 to 0.7 is left.
const MIN_INNER_RADIUS: f32 = 0.5;

/// Largest vector area of a solid's panels over their area. Panels above it do not enclose a solid: a ball as small as a step, or a
/// mesh whose samples are coarse. Balls of a radius of 0.7 steps have 0.36 at most.
const MAX_VECTOR_AREA: f32 = 0.5;

/// Smallest inner radius of a solid whose edges are distinguished from its thinness [steps].
const MIN_EDGED_INNER_RADIUS: f32 = 2.0;

/// Depth below a panel at which an edge is detected by another face [steps]. Deeper than about one, no edge is found in solids as
/// thin as [`MIN_EDGED_INNER_RADIUS`] allows.
const EDGE_PROBE_DEPTH: f32 = 0.9;

/// Offset of the grid [steps].
const OFFSET: Vec3 = Vec3::new(0.37, 0.29, 0.43);

/// A part of a surface, in the solid's own coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    /// Centre [m].
    pub(super) x: Vec3,
    /// Unit normal, out of the solid.
    pub(super) normal: Vec3,
    /// [m²].
    pub(super) area: f32,
    /// About how wide it is [m].
    pub(super) width: f32,
    /// `None` in solids thinner than the panel's width, and possibly in thin parts and right on an edge.
    pub(super) source: Option<Source>,
}

/// Largest slope of a sampled distance.
const MAX_SLOPE: f32 = 1.25;

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

/// The grid whose nodes are projected onto a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct PanelGrid {
    /// Distance of its nodes [m].
    pub(super) step: f32,
    /// Where it starts [m].
    pub(super) origin: Vec3,
}

impl PanelGrid {
    /// The grid of a shape that keeps its form.
    fn of(step: f32) -> Self {
        Self { step, origin: Vec3::zeros() }
    }

    /// Position of a node [m]: off the origin, so that nodes do not fall onto faces at round numbers.
    fn node(&self, node: Vec3) -> Vec3 {
        (node + OFFSET) * self.step + self.origin
    }

    /// The cell of a point.
    fn cell(&self, x: Vec3) -> [i64; 3] {
        [0, 1, 2].map(|axis| ((x[axis] - self.origin[axis]) / self.step - OFFSET[axis]).floor() as i64)
    }
}

/// The nodes around a shape that may be nearer than `step` to its surface, by z, y and x.
fn near(shape: &Shape, grid: PanelGrid) -> Vec<[i64; 3]> {
    let PanelGrid { step, origin } = grid;
    let Some((low, high)) = bounds(shape) else { return Vec::new() };
    let first = (low - origin).map(|v| (v / step).floor() as i64 - 1);
    let last = (high - origin).map(|v| (v / step).ceil() as i64 + 1);
    let mut found = Vec::new();
    let mut blocks = vec![(first, ((last - first).max() as u64 + 1).next_power_of_two() as i64)];
    while let Some((corner, side)) = blocks.pop() {
        // From its centre to its corners [steps].
        let half = 0.5 * (side - 1) as f32;
        let middle = grid.node(corner.map(|v| v as f32).add_scalar(half));
        if shape.signed_distance(middle).abs() > MAX_SLOPE * step * (1.0 + 3.0_f32.sqrt() * half) {
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
        return box_panels(Vec3::from(*min), Vec3::from(*max), step);
    }
    with_sources(shape, PanelGrid::of(step), None)
}

/// Kind of the sources of a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SourceKind {
    /// Of smooth solids.
    Points,
    /// Of solids with edges.
    Tiles,
}

impl SourceKind {
    /// The kind of the sources of panels; `None` if there is none.
    pub(super) fn of(panels: &[Panel]) -> Option<Self> {
        panels.iter().find_map(|panel| panel.source).map(|source| match source {
            Source::Point(_) => Self::Points,
            Source::Tile(_) => Self::Tiles,
        })
    }
}

/// Panels with sources below them, of the surface's nodes in `grid`. Without a `kind` the shape decides which.
pub(super) fn with_sources(shape: &Shape, grid: PanelGrid, kind: Option<SourceKind>) -> Vec<Panel> {
    let step = grid.step;
    let mut made = project_nodes(shape, grid);
    // In thin parts the areas of the nodes do not sum to that of the surface.
    let whole = shape.area();
    let scale = whole / made.iter().map(|panel| panel.area).sum::<f32>();
    made.iter_mut().for_each(|panel| panel.area *= scale);
    // A solid too thin for its panels has no sources.
    let vector_area: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
    if shape.inner_radius() < MIN_INNER_RADIUS * step || vector_area.norm() > MAX_VECTOR_AREA * whole {
        return made;
    }
    // An ellipsoid is sharp at its ends but has no edge: points leave a seventh to two thirds of what square panels do (a prototype).
    let may_have_edges =
        shape.inner_radius() >= MIN_EDGED_INNER_RADIUS * step && !matches!(shape, Shape::Ellipsoid { .. });
    let has_edges = || may_have_edges && made.iter().any(|panel| is_at_edge(shape, panel, step));
    let edged = kind.map_or_else(has_edges, |kind| kind == SourceKind::Tiles);
    if edged {
        made = merged(&made, MERGE_DISTANCE * step);
    }
    for panel in &mut made {
        panel.source = if edged { tile(shape, panel, step) } else { point(shape, panel, step) };
    }
    if edged {
        remove_coupled(&mut made, step);
    }
    made
}

/// Removes the source of the second of two panels whose equations are nearly the same: their sources would cancel.
fn remove_coupled(panels: &mut [Panel], step: f32) {
    let at: Vec<Vec3> = panels.iter().map(|panel| panel.x).collect();
    let cells = CellGrid::new(&at, step);
    for i in 1..panels.len() {
        let Some(own) = panels[i].source else { continue };
        let influence = |source: Source, panel: &Panel| panel.normal.dot(&source.flow(panel.x, None));
        let is_coupled = |j: usize| {
            let Some(other) = panels[j].source.filter(|_| j < i) else { return false };
            let across = influence(other, &panels[i]) * influence(own, &panels[j]);
            across > MAX_COUPLING * influence(own, &panels[i]) * influence(other, &panels[j])
        };
        if cells.nearest_within(&at, panels[i].x, step, is_coupled).is_some() {
            panels[i].source = None;
        }
    }
}

/// Panels of which those nearer than `distance` [m] are merged into the first of them. Its position and normal are kept: the mean of
/// two faces' would belong to neither, and at an edge lie in the solid.
fn merged(panels: &[Panel], distance: f32) -> Vec<Panel> {
    let at: Vec<Vec3> = panels.iter().map(|panel| panel.x).collect();
    let cells = CellGrid::new(&at, distance);
    let mut kept: Vec<Option<Panel>> = vec![None; panels.len()];
    for (i, panel) in panels.iter().enumerate() {
        match cells.nearest_within(&at, panel.x, distance, |j| kept[j].is_some()) {
            Some(j) => kept[j].iter_mut().for_each(|other| other.area += panel.area),
            None => kept[i] = Some(*panel),
        }
    }
    kept.into_iter().flatten().collect()
}

/// The panels of a box about `step` [m] wide.
fn box_panels(min: Vec3, max: Vec3, step: f32) -> Vec<Panel> {
    let size = max - min;
    let counts = size.map(|side| (side / step).round().max(1.0) as usize);
    let is_thick_enough = size.min() >= MIN_BOX_THICKNESS * step;
    let mut made = Vec::new();
    for (axis, up) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let half = [u, v].map(|side| 0.5 * size[side] / counts[side] as f32);
        let normal = Vec3::ith(axis, if up { 1.0 } else { -1.0 });
        for (i, j) in (0..counts[v]).flat_map(|j| (0..counts[u]).map(move |i| (i, j))) {
            let mut x = if up { max } else { min };
            x[u] = min[u] + half[0] * (2 * i + 1) as f32;
            x[v] = min[v] + half[1] * (2 * j + 1) as f32;
            let area = 4.0 * half[0] * half[1];
            let axes = [Vec3::ith(u, 1.0), Vec3::ith(v, 1.0), normal];
            let tile = Tile { middle: x, axes, half, soft: BOX_SOFTENING * step };
            let source = is_thick_enough.then_some(Source::Tile(tile));
            made.push(Panel { x, normal, area, width: area.sqrt(), source });
        }
    }
    made
}

/// The source of a panel in a solid with edges, none in thin parts: a square source panel of its area, but no wider than it. It is
/// not aligned with edges of the solid, and next to them a corner of it may be in the air.
fn tile(shape: &Shape, panel: &Panel, step: f32) -> Option<Source> {
    let is_thick_enough =
        shape.signed_distance(panel.x - panel.normal * (MIN_LOCAL_THICKNESS * TILE_DEPTH * step)) < 0.0;
    is_thick_enough.then(|| {
        let normal = panel.normal;
        let along = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
        let half = 0.5 * panel.area.sqrt().min(panel.width);
        Source::Tile(Tile {
            middle: panel.x - normal * (TILE_DEPTH * step),
            axes: [along, normal.cross(&along), normal],
            half: [half; 2],
            soft: TILE_SOFTENING * step,
        })
    })
}

/// The source of a panel in a smooth solid.
fn point(shape: &Shape, panel: &Panel, step: f32) -> Option<Source> {
    let max = POINT_DEPTH * step;
    let depth = max.min(MAX_DEPTH_OVER_RADIUS * inscribed_radius(shape, panel, max / MAX_DEPTH_OVER_RADIUS));
    let place = panel.x - panel.normal * depth;
    // In a mesh, parts thinner than its samples may have no inside; a source in the air would be singular there.
    (shape.signed_distance(place) < 0.0).then_some(Source::Point(place))
}

/// Panels without sources; their areas are those of the nodes.
fn project_nodes(shape: &Shape, grid: PanelGrid) -> Vec<Panel> {
    let step = grid.step;
    // Area and first moment of each cell.
    let mut cells: BTreeMap<[i64; 3], (f32, Vec3)> = BTreeMap::new();
    for [k, j, i] in near(shape, grid) {
        let node = grid.node(Vec3::new(i as f32, j as f32, k as f32));
        let (distance, normal) = shape.contact(node);
        if distance.abs() >= step {
            continue;
        }
        let area = step * step * (1.0 - distance.abs() / step);
        let x = node - normal * distance;
        let cell = cells.entry(grid.cell(x)).or_default();
        cell.0 += area;
        cell.1 += x * area;
    }
    let panel = |(area, sum): (f32, Vec3)| {
        let middle = sum / area;
        // The surface point nearest to the centre; its normal is evaluated from outside, where it is defined at edges too.
        let (distance, out) = shape.contact(middle);
        let x = middle - out * distance;
        let (_, normal) = shape.contact(x + out * (0.05 * step));
        Panel { x, normal, area, width: step, source: None }
    };
    cells.into_values().filter(|(area, _)| *area > 0.1 * step * step).map(panel).collect()
}

/// The radius of the largest ball in the solid that touches the surface at a panel [m], up to `max`.
fn inscribed_radius(shape: &Shape, panel: &Panel, max: f32) -> f32 {
    let mut radius = max;
    for _ in 0..6 {
        let inside = -shape.signed_distance(panel.x - panel.normal * radius);
        if inside > 0.9 * radius {
            break;
        }
        // Between two faces and in a ball the mean is the answer at once; next to an edge it halves the difference.
        radius = 0.5 * (radius + inside);
    }
    radius
}

/// Whether another face of a thick part is near the place below a panel.
fn is_at_edge(shape: &Shape, panel: &Panel, step: f32) -> bool {
    let below = |depth: f32| panel.x - panel.normal * depth;
    if shape.signed_distance(below(POINT_DEPTH * step)) < -0.9 * POINT_DEPTH * step {
        return false;
    }
    // A thick part has a point of this depth near by.
    let mut x = below(EDGE_PROBE_DEPTH * step);
    for _ in 0..6 {
        let (distance, out) = shape.contact(x);
        if distance < -0.9 * EDGE_PROBE_DEPTH * step {
            return true;
        }
        x -= out * (EDGE_PROBE_DEPTH * step + distance);
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
            // Edges have no single normal: that of panels there is either face's.
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

    /// Spheres, boxes, and a mesh whose samples are those of a ball.
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
    fn every_node_near_a_surface_is_found() {
        for (shape, step) in
            shapes().into_iter().flat_map(|shape| [0.03, 0.07].map(|step| (shape.clone(), step)))
        {
            let found = near(&shape, PanelGrid::of(step));
            let (low, high) = bounds(&shape).unwrap();
            let range =
                |axis: usize| (low[axis] / step).floor() as i64 - 1..=(high[axis] / step).ceil() as i64 + 1;
            let mut missed = 0;
            for (k, j, i) in
                range(2).flat_map(|k| range(1).flat_map(move |j| range(0).map(move |i| (k, j, i))))
            {
                let node = PanelGrid::of(step).node(Vec3::new(i as f32, j as f32, k as f32));
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
            assert!((sum / shape.area() - 1.0).abs() < 1e-3, "{shape:?} {step}: {sum}");
        }
    }

    #[test]
    fn panels_near_an_edge_do_not_coincide() {
        let cuboid = Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] };
        for step in [1.22, 1.3, 1.32, 1.36, 1.5] {
            let made = with_sources(&cuboid, PanelGrid::of(step), None);
            let near =
                |i: usize| (0..i).map(|j| (made[i].x - made[j].x).norm()).fold(f32::INFINITY, f32::min);
            let min = (1..made.len()).map(near).fold(f32::INFINITY, f32::min);
            assert!(min >= MERGE_DISTANCE * step, "{step}: {min}");
            let sum: f32 = made.iter().map(|panel| panel.area).sum();
            assert!((sum / 2400.0 - 1.0).abs() < 1e-3, "{step}: {sum}");
            let vector_area: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
            assert!(vector_area.norm() < 0.05 * sum, "{step}: {vector_area}");
            let sources = made.iter().filter(|panel| panel.source.is_some()).count();
            // Panels right on an edge have none.
            assert!(sources > made.len() * 9 / 10, "{step}: {sources} of {}", made.len());
        }
    }

    #[test]
    fn large_solids_take_time_by_their_surface() {
        // A million nodes in its bounds, its surface is 60 000 cells.
        let cuboid = Shape::Box { min: [0.0, 0.0, 0.0], max: [2.0, 2.0, 2.0] };
        let found = near(&cuboid, PanelGrid::of(0.02));
        let surface = 24.0 / (0.02 * 0.02);
        assert!(
            (found.len() as f32) < 4.0 * surface,
            "{} nodes for {surface} cells of the surface",
            found.len()
        );
    }

    #[test]
    fn the_panels_of_a_box_are_its_faces() {
        let (min, max) = (Vec3::new(-1.0, 0.0, 2.0), Vec3::new(1.0, 0.72, 3.2));
        let made = box_panels(min, max, 0.2);
        assert_eq!(made.len(), 2 * (10 * 4 + 4 * 6 + 10 * 6));
        let area: f32 = made.iter().map(|panel| panel.area).sum();
        assert!((area - 2.0 * (2.0 * 0.72 + 0.72 * 1.2 + 2.0 * 1.2)).abs() < 1e-4, "{area}");
        let flux: Vec3 = made.iter().map(|panel| panel.normal * panel.area).sum();
        assert!(flux.norm() < 1e-4 && made.iter().all(|panel| panel.source.is_some()));
        let thin = box_panels(min, Vec3::new(1.0, 0.09, 3.2), 0.2);
        assert!(thin.iter().all(|panel| panel.source.is_none()), "too thin for its panels");
    }
}
