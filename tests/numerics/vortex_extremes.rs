//! What vortons induce at the ends of what they may be: few, in one place, on a line, far apart, of all sizes.

use crate::vortex::{KERNELS, Shape, cloud, relative_error, velocity};
use meniscus::{
    math::Vec3,
    sim::vortex::{Induced, Kernel, MIN_CORE, Method, OutOfRange, Quantity, Targets, Vortons, induced},
};

/// Everything at the vortons and at a few points; all of it has to be finite.
fn everything(name: &str, vortons: &Vortons, method: Method) -> Vec<Induced> {
    let points = [Vec3::zeros(), Vec3::repeat(1e-3), Vec3::new(-7.0, 4.0, 1e5)];
    let mut found = Vec::new();
    for kernel in KERNELS {
        for quantity in [Quantity::Potential, Quantity::VelocityAndGradient] {
            for targets in [Targets::Vortons, Targets::Points(&points)] {
                let induced = induced(vortons, targets, quantity, kernel, method).unwrap();
                let vectors = induced.potential.iter().chain(&induced.velocity).flatten();
                let finite = vectors.chain(induced.gradient.iter().flatten()).all(|c| c.is_finite());
                assert!(finite, "{name}: {kernel:?} {quantity:?} {method:?}");
                found.push(induced);
            }
        }
    }
    found
}

/// The tree against the sum over pairs, everywhere finite.
fn agree(name: &str, vortons: &Vortons, tolerance: f64) {
    everything(name, vortons, Method::Grid { error: 1e-2 });
    let (direct, tree) =
        (everything(name, vortons, Method::Direct), everything(name, vortons, Method::Tree { error: 1e-4 }));
    for (direct, tree) in direct.iter().zip(&tree) {
        for (direct, tree) in [(&direct.potential, &tree.potential), (&direct.velocity, &tree.velocity)] {
            let error = relative_error(tree.iter().flatten(), direct.iter().flatten().map(|&c| f64::from(c)));
            assert!(error.is_nan() && tree == direct || error < tolerance, "{name}: {error}");
        }
    }
}

pub(crate) fn vorton(position: Vec3, strength: Vec3, core: f32) -> Vortons {
    Vortons { position: vec![position], strength: vec![strength], core: vec![core] }
}

#[test]
fn the_fewest_vortons_are_summed() {
    agree("none", &Vortons::default(), 0.0);
    let mut vortons = vorton(Vec3::new(0.1, 0.2, 0.3), Vec3::new(1.0, -2.0, 0.5), 0.1);
    assert_eq!(velocity(&vortons, Kernel::default(), Method::Tree { error: 1e-3 }), [Vec3::zeros()]);
    agree("one", &vortons, 1e-6);
    // Two, from one place to far apart.
    for distance in [0.0, 1e-7, 1e-3, 1.0, 1e6] {
        vortons.position.truncate(1);
        vortons.position.push(vortons.position[0] + Vec3::new(distance, 0.0, 0.0));
        (vortons.strength, vortons.core) = (vec![Vec3::z(); 2], vec![0.1; 2]);
        agree(&format!("two {distance} apart"), &vortons, 1e-6);
    }
}

#[test]
fn degenerate_clouds_are_summed() {
    // Of fewer vortons, the error far from the origin averages out less.
    let (count, far) = if crate::is_soak() { (3000, 2e-4) } else { (1500, 4e-4) };
    let base = cloud(Shape::Cube, count, false);
    let with = |change: fn(usize, &mut Vec3, &mut Vec3, &mut f32)| {
        let mut vortons = base.clone();
        for i in 0..vortons.len() {
            change(i, &mut vortons.position[i], &mut vortons.strength[i], &mut vortons.core[i]);
        }
        vortons
    };
    agree("coincident", &with(|_, x, _, _| *x = Vec3::new(0.3, 0.2, 0.1)), 1e-4);
    let heaps = |i: usize, x: &mut Vec3, _: &mut Vec3, s: &mut f32| {
        if !i.is_multiple_of(3) {
            (*x, *s) = (Vec3::new(0.3, 0.2, 0.1), *s * (i % 3) as f32);
        }
    };
    // Two thirds of the targets are one point, whose error nothing averages out.
    agree("heaps of two cores in a cloud", &with(heaps), 1e-3);
    agree("nearly coincident", &with(|_, x, _, _| *x *= 1e-7), 2e-4);
    agree("a million metres off", &with(|_, x, _, _| x.x += 1e6), far);
    agree("without strength", &with(|_, _, g, _| *g = Vec3::zeros()), 0.0);
    agree("collinear", &with(|_, x, _, _| *x = Vec3::new(x.x, 0.0, 0.0)), 5e-4);
    agree("coplanar", &with(|_, x, _, _| x.z = 0.0), 2e-4);
    agree("strengths over twelve decades", &with(|i, _, g, _| *g *= 10.0_f32.powi(i as i32 % 13 - 6)), 2e-4);
    agree("cores over three decades", &with(|i, _, _, s| *s *= 10.0_f32.powi(i as i32 % 4 - 3)), 2e-4);
    agree("the smallest cores", &with(|_, _, _, s| *s = MIN_CORE), 2e-4);
    agree(
        "a stray",
        &with(|i, x, _, _| {
            if i == 0 {
                *x = Vec3::repeat(1e6)
            }
        }),
        2e-4,
    );
    agree("in one cell of a stray", &with(|i, x, _, _| if i > 0 { *x *= 1e-4 } else { *x *= 1e4 }), 2e-4);
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let mut vortons = cloud(Shape::Cube, 10, false);
    vortons.strength[7].y = f32::NAN;
    let refused = |vortons: &Vortons, targets| {
        induced(vortons, targets, Quantity::Velocity, Kernel::default(), Method::Direct).unwrap_err()
    };
    let error: OutOfRange = refused(&vortons, Targets::Vortons);
    assert!(
        error.index == 7 && error.to_string().starts_with("number 7 of the vortons has the strength"),
        "{error}"
    );
    let points = [Vec3::zeros(), Vec3::repeat(f32::INFINITY)];
    assert_eq!(refused(&cloud(Shape::Cube, 3, false), Targets::Points(&points)).index, 1);
}
