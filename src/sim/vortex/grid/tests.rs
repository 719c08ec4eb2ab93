//! The boundary values of the grid against exact ones.

use super::*;
use crate::sim::vortex::{Method, Quantity, induced};
use std::f64::consts::PI;

/// A ring of Gaussian vortons of circulation 1 and radius 1.
fn ring(count: usize, core: f32) -> Vortons {
    let mut vortons = Vortons { core: vec![core; count], ..Vortons::default() };
    for i in 0..count {
        let t = (2.0 * PI * i as f64 / count as f64) as f32;
        vortons.position.push(Vec3::new(t.cos(), t.sin(), 0.0));
        vortons.strength.push(Vec3::new(-t.sin(), t.cos(), 0.0) * (2.0 * PI / count as f64) as f32);
    }
    vortons
}

/// Calls `f` with every node.
fn nodes(grid: UniformGrid, mut f: impl FnMut([usize; 3])) {
    for z in 0..=grid.cells[2] {
        for y in 0..=grid.cells[1] {
            for x in 0..=grid.cells[0] {
                f([x, y, z]);
            }
        }
    }
}

/// Relative L2 errors of the potential with boundary values that are exact, interpolated, copied and 0.
fn errors() -> [f64; 4] {
    let vortons = ring(48, 0.2);
    let grid = UniformGrid { low: Vec3::new(-1.8, -1.8, -0.9), spacing: 3.6 / 72.0, cells: [72, 72, 36] };
    let mut points = Vec::new();
    nodes(grid, |at| points.push(grid.node(at)));
    let find = |points: &[Vec3]| {
        induced(&vortons, Targets::Points(points), Quantity::Potential, Kernel::Gaussian, Method::Direct)
            .unwrap()
            .potential
    };
    let exact = find(&points);
    let (mut source, mut boundary) = (VectorField::new(grid), VectorField::new(grid));
    let mut i = 0;
    nodes(grid, |at| {
        let vorticity = vortons.position.iter().zip(&vortons.strength).map(|(x, g)| {
            let square = f64::from((grid.node(at) - x).norm_squared()) / 0.04;
            g * ((2.0 * PI).powf(-1.5) / 0.008 * (-square / 2.0).exp()) as f32
        });
        source.set(at, vorticity.sum());
        boundary.set(at, exact[i]);
        i += 1;
    });
    let boundaries = [
        BoundaryValues::read(&boundary),
        BoundaryValues::sampled(grid, 4, Interpolation::Cubic, find),
        BoundaryValues::sampled(grid, 4, Interpolation::Nearest, find),
        BoundaryValues::zero(grid),
    ];
    boundaries.map(|boundary| {
        let mut field = source.clone();
        boundary.write(&mut field);
        poisson(&mut field);
        let (mut error, mut whole, mut i) = (0.0, 0.0, 0);
        nodes(grid, |at| {
            error += f64::from((field.at(at) - exact[i]).norm_squared());
            whole += f64::from(exact[i].norm_squared());
            i += 1;
        });
        (error / whole).sqrt()
    })
}

#[test]
fn interpolated_boundary_values_are_as_good_as_exact_ones() {
    let [exact, interpolated, copied, zero] = errors();
    assert!(
        exact < 4e-5 && interpolated < 1e-4 && copied > 20.0 * interpolated && (0.3..0.9).contains(&zero),
        "{exact} {interpolated} {copied} {zero}"
    );
}

#[test]
fn cubic_boundary_values_are_interpolated_exactly() {
    let grid = UniformGrid { low: Vec3::new(1.0, 0.0, -1.0), spacing: 0.1, cells: [11, 18, 7] };
    let cubic = |x: &Vec3| Vec3::new(x.x.powi(3) - x.y, x.y * x.y * x.z, x.z.powi(3) * x.x);
    let sample = |points: &[Vec3]| points.iter().map(cubic).collect();
    let boundary = BoundaryValues::sampled(grid, 4, Interpolation::Cubic, sample);
    let mut field = VectorField::new(grid);
    boundary.write(&mut field);
    nodes(grid, |at| {
        let outside = (0..3).any(|k| at[k] == 0 || at[k] == grid.cells[k]);
        let expected = if outside { cubic(&grid.node(at)) } else { Vec3::zeros() };
        assert!((field.at(at) - expected).norm() < 1e-5, "{at:?}");
    });
}
