//! The lattice's boundary against exact values.

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
fn nodes(lattice: Lattice, mut f: impl FnMut([usize; 3])) {
    for z in 0..=lattice.cells[2] {
        for y in 0..=lattice.cells[1] {
            for x in 0..=lattice.cells[0] {
                f([x, y, z]);
            }
        }
    }
}

/// How much of the potential is missed with boundary values that are exact, interpolated, copied and 0.
fn missed() -> [f64; 4] {
    let vortons = ring(48, 0.2);
    let lattice = Lattice { low: Vec3::new(-1.8, -1.8, -0.9), spacing: 3.6 / 72.0, cells: [72, 72, 36] };
    let mut points = Vec::new();
    nodes(lattice, |at| points.push(lattice.node(at)));
    let find = |points: &[Vec3]| {
        induced(&vortons, Targets::Points(points), Quantity::Potential, Kernel::Gaussian, Method::Direct)
            .unwrap()
            .potential
    };
    let exact = find(&points);
    let (mut source, mut boundary) = (Field::new(lattice), Field::new(lattice));
    let mut i = 0;
    nodes(lattice, |at| {
        let vorticity = vortons.position.iter().zip(&vortons.strength).map(|(x, g)| {
            let square = f64::from((lattice.node(at) - x).norm_squared()) / 0.04;
            g * ((2.0 * PI).powf(-1.5) / 0.008 * (-square / 2.0).exp()) as f32
        });
        source.set(at, vorticity.sum());
        boundary.set(at, exact[i]);
        i += 1;
    });
    let faces = [
        Faces::read(&boundary),
        Faces::found(lattice, 4, Between::Cubic, find),
        Faces::found(lattice, 4, Between::Copied, find),
        Faces::zero(lattice),
    ];
    faces.map(|faces| {
        let mut field = source.clone();
        faces.write(&mut field);
        poisson(&mut field);
        let (mut missed, mut whole, mut i) = (0.0, 0.0, 0);
        nodes(lattice, |at| {
            missed += f64::from((field.at(at) - exact[i]).norm_squared());
            whole += f64::from(exact[i].norm_squared());
            i += 1;
        });
        (missed / whole).sqrt()
    })
}

#[test]
fn boundary_values_between_nodes_of_the_tree_are_as_good_as_exact_ones() {
    let [exact, interpolated, copied, zero] = missed();
    assert!(
        exact < 4e-5 && interpolated < 1e-4 && copied > 20.0 * interpolated && (0.3..0.9).contains(&zero),
        "{exact} {interpolated} {copied} {zero}"
    );
}

#[test]
fn a_coarse_lattice_gives_back_cubics() {
    let lattice = Lattice { low: Vec3::new(1.0, 0.0, -1.0), spacing: 0.1, cells: [11, 18, 7] };
    let cubic = |x: &Vec3| Vec3::new(x.x.powi(3) - x.y, x.y * x.y * x.z, x.z.powi(3) * x.x);
    let faces = Faces::found(lattice, 4, Between::Cubic, |points| points.iter().map(cubic).collect());
    let mut field = Field::new(lattice);
    faces.write(&mut field);
    nodes(lattice, |at| {
        let outside = (0..3).any(|k| at[k] == 0 || at[k] == lattice.cells[k]);
        let expected = if outside { cubic(&lattice.node(at)) } else { Vec3::zeros() };
        assert!((field.at(at) - expected).norm() < 1e-5, "{at:?}");
    });
}
