//! Discretisation of a sheet: points, springs and plates.
//!
//! *Method*: grids as in [gudukbay97] section 2, with four, three and two neighbours. A spring represents the
//! strip of sheet around it: k = Y · width / length, with half widths at borders. A point represents its
//! share of the area. Mass and stiffness are therefore those of the sheet at any resolution. Meshes take k =
//! Y · Σ area / length² over the faces of an edge [vangelder98]. Plates are sums of squares of linear forms Σ
//! w x: on grids the second differences of each direction and the twist of each cell, on meshes the Laplacian
//! of positions at each point, as in the isometric bending of [bergou06] and [wardetzky07].
//!
//! *Departs from the paper*: stiffness, rest length and damping vary by direction and by region, or are
//! painted. Diagonals resist shear with k = G (h₁² + h₂²)/(2 h₁ h₂). Quads of meshes count as half their area
//! at each edge, and bend as two triangles.
//!
//! Symbols: Y → `stiffness` [N/m], G → `shear` [N/m], h → `step` [m], D → `bending` [N·m].
//! Limits: a strip stretched along a direction of the grid has the strain load/Y; with diagonals Y + G −
//! G²/(Y + G) takes the place of Y. A mesh has Y exactly where its triangles are equilateral (Poisson's ratio
//! is then 1/3). Plates are flat at rest, whatever the shape of the mesh.

use super::params::{Region, SheetMesh, SheetParams, SheetShape};
use crate::math::Vec3;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A spring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spring {
    pub(super) ends: [u32; 2],
    pub(super) stiffness: f64,
    pub(super) rest: f64,
    /// [N·s/m].
    pub(super) damping: f64,
}

/// The energy ½ rigidity (Σ w x)².
#[derive(Clone, Debug)]
pub(super) struct Plate {
    pub(super) points: Vec<u32>,
    pub(super) weights: Vec<f64>,
    pub(super) rigidity: f64,
}

/// A sheet at the start; its points count from 0.
#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) points: Vec<Vec3>,
    /// Corners; a triangle names its last twice.
    pub(super) faces: Vec<[u32; 4]>,
    /// Area of every point [m²].
    pub(super) area: Vec<f64>,
    pub(super) springs: Vec<Spring>,
    pub(super) plates: Vec<Plate>,
    /// Number of points along the directions of a grid.
    pub(super) grid: Option<[u32; 2]>,
}

type Double = Vector3<f64>;

/// The discretisation of checked parameters.
pub(super) fn model(params: &SheetParams) -> Model {
    let mut model = match &params.shape {
        SheetShape::Grid { origin, first, second, cells } => {
            let sides = [first, second].map(|side| Double::from(side.map(f64::from)));
            grid(params, Double::from(origin.map(f64::from)), sides, *cells)
        }
        SheetShape::Mesh(mesh) => from_mesh(params, mesh),
    };

    // Factors of regions and of paint.
    let stiffness = factors(params, &model.points, |region| region.stiffness, |mesh| &mesh.stiffness);
    let rest = factors(params, &model.points, |region| region.rest, |mesh| &mesh.rest);
    let damping = dampings(params, &model.points);
    let mean = |of: &[f64], points: &[u32]| {
        points.iter().map(|&i| of[i as usize]).sum::<f64>() / points.len() as f64
    };
    for spring in &mut model.springs {
        spring.stiffness *= mean(&stiffness, &spring.ends);
        spring.rest *= mean(&rest, &spring.ends);
        spring.damping *= spring.stiffness * mean(&damping, &spring.ends);
    }
    for plate in &mut model.plates {
        plate.rigidity *= mean(&stiffness, &plate.points);
    }
    model
}

/// Factor of both kinds of damping at every point.
pub(super) fn dampings(params: &SheetParams, points: &[Vec3]) -> Vec<f64> {
    factors(params, points, |region| region.damping, |mesh| &mesh.damping)
}

/// Factor of the mass at every point.
pub(super) fn densities(params: &SheetParams, points: &[Vec3]) -> Vec<f64> {
    factors(params, points, |region| region.density, |_| &[])
}

/// Product of the factors of regions at every point, and of the painted factor.
fn factors(
    params: &SheetParams,
    points: &[Vec3],
    of: impl Fn(&Region) -> f32,
    painted: impl Fn(&SheetMesh) -> &[f32],
) -> Vec<f64> {
    let painted = match &params.shape {
        SheetShape::Mesh(mesh) => painted(mesh),
        SheetShape::Grid { .. } => &[],
    };
    let inside = |x: Vec3| params.region.iter().filter(move |region| region.shape.signed_distance(x) <= 0.0);
    let factor = |(i, &x): (usize, &Vec3)| {
        let regions: f64 = inside(x).map(|region| f64::from(of(region))).product();
        regions * f64::from(painted.get(i).copied().unwrap_or(1.0))
    };
    points.iter().enumerate().map(factor).collect()
}

/// Damping times of the two directions and of their mean [s].
fn times(params: &SheetParams) -> [f64; 3] {
    let [a, b] = params.spring_damping.unwrap_or_default().map(f64::from);
    [a, b, 0.5 * (a + b)]
}

fn grid(params: &SheetParams, origin: Double, sides: [Double; 2], cells: [u32; 2]) -> Model {
    let count = cells.map(|n| n + 1);
    let index = |i: u32, j: u32| i + count[0] * j;
    let step = [0, 1].map(|k| sides[k] / f64::from(cells[k].max(1)));
    let length = step.map(|s| s.norm());
    let skew = step[0].cross(&step[1]).norm() / (length[0] * length[1]);
    // Length along a direction that a point represents.
    let share = |k: usize, i: u32| {
        let border = cells[k] > 0 && (i == 0 || i == cells[k]);
        if border { 0.5 * length[k] } else { length[k] }
    };
    let all = || (0..count[1]).flat_map(|j| (0..count[0]).map(move |i| (i, j)));

    let points =
        all().map(|(i, j)| (origin + step[0] * f64::from(i) + step[1] * f64::from(j)).cast()).collect();
    let area = all().map(|(i, j)| skew * share(0, i) * share(1, j)).collect();
    let mut model = Model { points, area, grid: Some(count), ..Model::default() };
    let [y, tau, rest] =
        [params.stiffness.map(f64::from), [times(params)[0], times(params)[1]], params.rest.map(f64::from)];
    for (i, j) in all() {
        for (k, on, width) in [(0, i < cells[0], share(1, j)), (1, j < cells[1], share(0, i))] {
            if on {
                let other = if k == 0 { index(i + 1, j) } else { index(i, j + 1) };
                model.springs.push(Spring {
                    ends: [index(i, j), other],
                    stiffness: y[k] * skew * width / length[k],
                    rest: rest[k] * length[k],
                    damping: tau[k],
                });
            }
        }
    }
    for (i, j) in all().filter(|&(i, j)| i < cells[0] && j < cells[1]) {
        let corners = [index(i, j), index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)];
        model.faces.push([corners[0], corners[1], corners[3], corners[2]]);
        if let Some(shear) = params.shear {
            for (ends, sign) in [([corners[0], corners[3]], 1.0), ([corners[1], corners[2]], -1.0)] {
                let diagonal = step[0] + step[1] * sign;
                let slack = step[0] * rest[0] + step[1] * (sign * rest[1]);
                model.springs.push(Spring {
                    ends,
                    stiffness: f64::from(shear) * diagonal.norm_squared()
                        / (2.0 * skew * length[0] * length[1]),
                    rest: slack.norm(),
                    damping: times(params)[2],
                });
            }
        }
    }
    if let Some(bending) = params.bending {
        bend_grid(&mut model, f64::from(bending), cells, length, &share);
    }
    model
}

/// Bending energy of a grid: second differences of both directions and the twist of cells, ½ D ∫ κ₁₁² + κ₂₂²
/// + 2 κ₁₂².
fn bend_grid(
    model: &mut Model,
    bending: f64,
    cells: [u32; 2],
    length: [f64; 2],
    share: &dyn Fn(usize, u32) -> f64,
) {
    let index = |i: u32, j: u32| i + (cells[0] + 1) * j;
    for j in 0..=cells[1] {
        for i in 0..=cells[0] {
            let own = index(i, j);
            if i > 0 && i < cells[0] {
                let weights = [1.0, -2.0, 1.0].map(|w| w / length[0].powi(2)).to_vec();
                let points = vec![own - 1, own, own + 1];
                model.plates.push(Plate { points, weights, rigidity: bending * length[0] * share(1, j) });
            }
            if j > 0 && j < cells[1] {
                let weights = [1.0, -2.0, 1.0].map(|w| w / length[1].powi(2)).to_vec();
                let points = vec![index(i, j - 1), own, index(i, j + 1)];
                model.plates.push(Plate { points, weights, rigidity: bending * length[1] * share(0, i) });
            }
            if i < cells[0] && j < cells[1] {
                let area = length[0] * length[1];
                let weights = [1.0, -1.0, -1.0, 1.0].map(|w| w / area).to_vec();
                let points = vec![own, index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)];
                model.plates.push(Plate { points, weights, rigidity: 2.0 * bending * area });
            }
        }
    }
}

fn from_mesh(params: &SheetParams, mesh: &SheetMesh) -> Model {
    let at = |i: u32| Double::from(mesh.points[i as usize].map(f64::from));
    let grain = Double::from(params.grain.map(f64::from)).normalize();
    let points: Vec<Vec3> = mesh.points.iter().map(|&p| p.into()).collect();
    let mut model =
        Model { area: vec![0.0; points.len()], points, faces: mesh.faces.clone(), ..Model::default() };
    let area = |a: u32, b: u32, c: u32| 0.5 * (at(b) - at(a)).cross(&(at(c) - at(a))).norm();
    let mut edges: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    let mut triangles = Vec::new();
    for &[a, b, c, d] in &mesh.faces {
        // Quads are cut along the shorter diagonal where necessary.
        let (cut, whole) = if c == d {
            (vec![[a, b, c]], area(a, b, c))
        } else if (at(c) - at(a)).norm() <= (at(d) - at(b)).norm() {
            (vec![[a, b, c], [a, c, d]], area(a, b, c) + area(a, c, d))
        } else {
            (vec![[a, b, d], [b, c, d]], area(a, b, d) + area(b, c, d))
        };
        triangles.extend(cut);
        let corners: &[u32] = if c == d { &[a, b, c] } else { &[a, b, c, d] };
        let part = if c == d { 1.0 } else { 0.5 };
        for (k, &i) in corners.iter().enumerate() {
            model.area[i as usize] += whole / corners.len() as f64;
            let j = corners[(k + 1) % corners.len()];
            *edges.entry([i.min(j), i.max(j)]).or_default() += part * whole;
        }
        if let (Some(shear), true) = (params.shear, c != d) {
            for ends in [[a, c], [b, d]] {
                let length = (at(ends[1]) - at(ends[0])).norm();
                let stiffness = f64::from(shear) * length * length / (2.0 * whole);
                let rest = length * 0.5 * f64::from(params.rest[0] + params.rest[1]);
                model.springs.push(Spring { ends, stiffness, rest, damping: times(params)[2] });
            }
        }
    }
    let ([y1, y2], [r1, r2]) = (params.stiffness.map(f64::from), params.rest.map(f64::from));
    for (ends, area) in edges {
        let edge = at(ends[1]) - at(ends[0]);
        let along = (edge.dot(&grain) / edge.norm()).powi(2).min(1.0);
        let mixed = |a: f64, b: f64| a * along + b * (1.0 - along);
        let stiffness = mixed(y1, y2) * area / edge.norm_squared(); // [vangelder98] Eq. 8
        let damping = mixed(times(params)[0], times(params)[1]);
        model.springs.push(Spring { ends, stiffness, rest: mixed(r1, r2) * edge.norm(), damping });
    }
    if let Some(bending) = params.bending {
        model.plates = curvatures(&triangles, &at, &model.area, f64::from(bending));
    }
    model
}

/// Bending energy at every interior point of a mesh: ½ D |L x|²/A, with L the cotangent Laplacian and A the
/// Voronoi area.
fn curvatures(triangles: &[[u32; 3]], at: &dyn Fn(u32) -> Double, area: &[f64], bending: f64) -> Vec<Plate> {
    // Half the sum of the cotangents opposite to each edge, and the number of its triangles.
    let mut edges: BTreeMap<[u32; 2], (f64, u32)> = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let (i, j, corner) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
            let (u, v) = (at(i) - at(corner), at(j) - at(corner));
            let edge = edges.entry([i.min(j), i.max(j)]).or_default();
            *edge = (edge.0 + 0.5 * u.dot(&v) / u.cross(&v).norm(), edge.1 + 1);
        }
    }
    let mut around: Vec<Vec<(u32, f64)>> = vec![Vec::new(); area.len()];
    let mut border = vec![false; area.len()];
    for ([i, j], (weight, count)) in edges {
        for (own, other) in [(i, j), (j, i)] {
            around[own as usize].push((other, weight));
            border[own as usize] |= count != 2;
        }
    }
    let inner = (0..area.len()).filter(|&i| !border[i] && !around[i].is_empty());
    inner
        .map(|i| {
            let own = i as u32;
            let voronoi: f64 =
                around[i].iter().map(|&(j, w)| 0.25 * w * (at(j) - at(own)).norm_squared()).sum();
            // Obtuse triangles can leave a point a tiny Voronoi area; a third of its triangles' area is then
            // closer.
            let share = if voronoi > 0.3 * area[i] { voronoi } else { area[i] };
            let sum: f64 = around[i].iter().map(|&(_, w)| w).sum();
            Plate {
                points: around[i].iter().map(|&(j, _)| j).chain([own]).collect(),
                weights: around[i].iter().map(|&(_, w)| w).chain([-sum]).collect(),
                rigidity: bending / share, // [wardetzky07] section 3
            }
        })
        .collect()
}
