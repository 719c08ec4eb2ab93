//! The grid sum of induced velocities: orders of its solvers, and the error it keeps.

use crate::vortex::{KERNELS, Shape, cloud, errors, noise, relative_error, velocity};
use meniscus::{
    math::Vec3,
    par,
    sim::vortex::{
        Kernel, Method, Quantity, Targets, UniformGrid, VectorField, Vortons, boundary_values, choose_grid,
        induced, induced_both, multigrid_poisson, poisson, sampled_error,
    },
};

use std::f64::consts::PI;

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

/// A box of 1.2 m × 1.5 m × 0.9 m in cells of 0.3 m over `fine`.
fn grid_of(fine: usize) -> UniformGrid {
    let cells = [4, 5, 3].map(|n| n * fine);
    UniformGrid { low: Vec3::new(-0.3, 0.2, 5.0), spacing: 0.3 / fine as f32, cells }
}

/// The largest error of A on a box whose boundary is given, over the largest A, with ∇²A = −ω made by hand.
fn error_of_solution(solve: fn(&mut VectorField), fine: usize) -> f64 {
    let grid = grid_of(fine);
    let size = [1.2, 1.5, 0.9];
    // A product of sin³(πx/L), whose source is 0 on the boundary, and a harmonic function.
    let at = |node: [usize; 3]| {
        let x = grid.node(node) - grid.low;
        let [(f, fs), (g, gs), (h, hs)] = [0, 1, 2].map(|k| {
            let turn = PI / size[k];
            let (s, c) = (turn * f64::from(x[k])).sin_cos();
            (s.powi(3), turn * turn * (3.0 * s.powi(3) - 6.0 * s * c * c))
        });
        let [x, y, z] = [x.x, x.y, x.z].map(f64::from);
        let harmonic = |k: f64| (5.0 * x).exp() / 50.0 * (3.0 * y + k).cos() * (4.0 * z).sin();
        let potential = Vec3::from_fn(|k, _| ((k + 1) as f64 * f * g * h + harmonic(k as f64)) as f32);
        let source = Vec3::from_fn(|k, _| ((k + 1) as f64 * (fs * g * h + f * gs * h + f * g * hs)) as f32);
        (potential, source)
    };
    let mut field = VectorField::new(grid);
    nodes(grid, |node| {
        let outside = (0..3).any(|k| node[k] == 0 || node[k] == grid.cells[k]);
        let (potential, source) = at(node);
        field.set(node, if outside { potential } else { source });
    });
    solve(&mut field);
    let (mut missed, mut whole) = (0.0_f64, 0.0_f64);
    nodes(grid, |node| {
        let a = at(node).0;
        missed = missed.max(f64::from((field.at(node) - a).amax()));
        whole = whole.max(f64::from(a.amax()));
    });
    missed / whole
}

#[test]
fn solvers_of_the_poisson_equation_are_of_their_order() {
    let solvers: [(_, fn(&mut VectorField), _, _); 2] =
        [("sines", poisson, 4.0, 2), ("multigrid", multigrid_poisson, 2.0, 4)];
    for (solver, solve, order, fine) in solvers {
        let found = [1, 2, 4].map(|times| error_of_solution(solve, fine * times));
        for pair in found.windows(2) {
            let observed = (pair[0] / pair[1]).log2();
            assert!((observed - order).abs() < 0.25, "{solver}: {found:?}");
        }
    }
    // Where single precision ends.
    assert!(error_of_solution(poisson, 16) < 3e-6);
}

#[test]
fn multigrid_leaves_a_hundredth_of_the_residual() {
    for cells in [[16, 16, 16], [48, 40, 8], [12, 6, 10], [2, 3, 5]] {
        let mut field = VectorField::new(UniformGrid { low: Vec3::zeros(), spacing: 1.0, cells });
        for (k, values) in field.values.iter_mut().enumerate() {
            let value = |i: usize| ((i * 7919 + k) % 1009) as f32 / 1009.0 - 0.5;
            values.iter_mut().enumerate().for_each(|(i, v)| *v = value(i));
        }
        let source = field.clone();
        multigrid_poisson(&mut field);
        let (mut residual, mut whole) = (0.0, 0.0);
        nodes(field.grid, |node| {
            if (0..3).any(|k| node[k] == 0 || node[k] == cells[k]) {
                assert_eq!(field.at(node), source.at(node), "the boundary values stay");
                return;
            }
            let [x, y, z] = node;
            let neighbours = field.at([x - 1, y, z])
                + field.at([x + 1, y, z])
                + field.at([x, y - 1, z])
                + field.at([x, y + 1, z])
                + field.at([x, y, z - 1])
                + field.at([x, y, z + 1]);
            residual += (neighbours + source.at(node) - field.at(node) * 6.0).norm_squared();
            whole += source.at(node).norm_squared();
        });
        assert!(residual < 1e-4 * whole, "{cells:?}: {residual} of {whole}");
    }
}

#[test]
fn lengths_of_factors_two_three_and_five_are_solved_alike() {
    for fine in [9, 10, 15] {
        assert!(error_of_solution(poisson, fine) < 1.3 * error_of_solution(poisson, 8), "{fine}");
    }
}

#[test]
#[should_panic(expected = "factors 2, 3 and 5")]
fn a_length_of_factor_seven_is_refused() {
    error_of_solution(poisson, 7);
}

/// The error of a grid sum, relative to the sum over pairs.
fn reached(vortons: &Vortons, kernel: Kernel, error: f32) -> f64 {
    assert!(choose_grid(vortons, vortons.len(), kernel, error).is_some(), "the tree: {kernel:?} {error}");
    let method = Method::Grid { error };
    let found = induced(vortons, Targets::Vortons, Quantity::Velocity, kernel, method).unwrap().velocity;
    sampled_error(vortons, Targets::Vortons, kernel, &found, 300).unwrap()
}

#[test]
fn the_grid_keeps_the_requested_error() {
    for shape in [Shape::Ring, Shape::Cube, Shape::Sheet, Shape::Clusters] {
        let vortons = cloud(shape, 30_000, false);
        let mut last = f64::INFINITY;
        // The sheet and the blobs fill little of their boxes.
        let errors =
            if [Shape::Ring, Shape::Cube].contains(&shape) { &[0.1, 0.03, 0.01][..] } else { &[0.1, 0.03] };
        for &error in errors {
            let found = reached(&vortons, Kernel::default(), error);
            assert!(found < f64::from(error) && found <= last, "{shape:?}: {found} of {error}, after {last}");
            last = found;
        }
    }
    let vortons = cloud(Shape::Cube, 30_000, false);
    for error in [3e-3, 1e-3] {
        let found = reached(&vortons, Kernel::default(), error);
        assert!(found < f64::from(error), "{found} of {error}");
    }
}

#[test]
fn every_kernel_and_uneven_cores_keep_the_error_on_a_grid() {
    // Without the long studies, the kernels with the longest and with the shortest tail.
    let extremes = [Kernel::RosenheadMoore, Kernel::Gaussian];
    for kernel in KERNELS.into_iter().filter(|kernel| crate::is_soak() || extremes.contains(kernel)) {
        for (uneven, shape) in [(false, Shape::Ring), (false, Shape::Cube), (true, Shape::Cube)] {
            let vortons = cloud(shape, if uneven { 40_000 } else { 12_000 }, uneven);
            // The margin for Rosenhead and Moore's long tails makes boxes of rings too large.
            // And pairs of uneven Gaussians cost as much as all of few.
            let errors = match (shape, uneven) {
                (Shape::Ring, _) => &[0.1, 0.03][..],
                (_, true) => &[0.03],
                _ => &[0.03, 0.01],
            };
            for &error in errors {
                let found = reached(&vortons, kernel, error);
                assert!(found < f64::from(error), "{kernel:?} {shape:?} {uneven}: {found} of {error}");
            }
        }
    }
    // Here the grid has wider cores, and what pairs leave out of the difference adds up all around the ring.
    let vortons = cloud(Shape::Ring, 40_000, false);
    let found = reached(&vortons, Kernel::RosenheadMoore, 0.01);
    assert!(found < 0.01, "wider cores: {found}");
    let vortons = cloud(Shape::Cube, 12_000, false);
    for error in [1e-3, 3e-4] {
        let found = reached(&vortons, Kernel::Gaussian, error);
        assert!(found < f64::from(error), "{found} of {error}");
    }
}

#[test]
fn the_three_methods_agree_on_every_quantity() {
    // Points in the cloud, around it, and beyond any box.
    let points: Vec<Vec3> =
        (0..600).map(|i| Vec3::from_fn(|k, _| 3.0 * noise(70 * i + k) as f32 - 1.0)).collect();
    for kernel in
        [Kernel::WinckelmansLeonard, Kernel::Gaussian].into_iter().take(if crate::is_soak() { 2 } else { 1 })
    {
        let vortons = cloud(Shape::Cube, 12_000, false);
        let at = [&vortons.position[..300], &points].concat();
        let tree = errors(&vortons, &at, kernel, Method::Tree { error: 1e-2 });
        let grid = errors(&vortons, &at, kernel, Method::Grid { error: 1e-2 });
        for [potential, velocity, gradient] in [tree, grid] {
            assert!(potential < 1e-2 && velocity < 1e-2 && gradient < 0.12, "{kernel:?}: {tree:?} {grid:?}");
        }
    }
}

#[test]
fn the_error_of_the_papers_multigrid_is_as_documented() {
    let points: Vec<Vec3> =
        (0..300).map(|i| Vec3::from_fn(|k, _| 2.0 * noise(70 * i + k) as f32 - 0.5)).collect();
    let shapes = [(Shape::Ring, [0.01, 0.06]), (Shape::Cube, [0.04, 0.1])];
    for (shape, [low, high]) in shapes.into_iter().take(if crate::is_soak() { 2 } else { 1 }) {
        let vortons = cloud(shape, if crate::is_soak() { 12_000 } else { 6000 }, false);
        let at = [&vortons.position[..300], &points].concat();
        let [potential, velocity, gradient] = errors(&vortons, &at, Kernel::Gaussian, Method::Multigrid);
        assert!((low..high).contains(&velocity), "{shape:?}: {velocity}");
        assert!(potential < velocity && gradient < 4.0 * high, "{shape:?}: {potential} {gradient}");
    }
    // Two vortons so far from each other that no grid holds both.
    let far = Vortons {
        position: vec![Vec3::zeros(), Vec3::repeat(1e6)],
        strength: vec![Vec3::x(), Vec3::y()],
        core: vec![0.1; 2],
    };
    let found = velocity(&far, Kernel::Gaussian, Method::Multigrid);
    let error = sampled_error(&far, Targets::Vortons, Kernel::Gaussian, &found, 2).unwrap();
    assert!(error < 1e-2, "{error}");
}

#[test]
fn a_stray_does_not_enlarge_the_grid() {
    let mut vortons = cloud(Shape::Cube, 12_000, false);
    let of = |vortons: &Vortons| choose_grid(vortons, vortons.len(), Kernel::Gaussian, 1e-2).unwrap();
    let alone = of(&vortons);
    vortons.position.extend([Vec3::repeat(1e6), Vec3::new(4.0, 0.5, 0.5)]);
    vortons.strength.extend([Vec3::new(1e-2, 0.0, 0.0), Vec3::new(0.0, 0.0, 1e-2)]);
    vortons.core.extend([0.05; 2]);
    assert_eq!(of(&vortons), alone);
    assert!(reached(&vortons, Kernel::Gaussian, 1e-2) < 1e-2);
    // The velocity of the stray next to the box is part of that in the box.
    let method = Method::Grid { error: 1e-2 };
    let at = vec![
        Vec3::new(0.95, 0.5, 0.5),
        vortons.position[12_000],
        vortons.position[12_001],
        Vec3::repeat(-1e6),
    ];
    let [potential, velocity, _] = errors(&vortons, &at, Kernel::Gaussian, method);
    assert!(potential < 1e-2 && velocity < 2e-2, "{potential} {velocity}");
}

#[test]
fn the_grids_velocity_is_the_curl_of_its_potential() {
    let vortons = cloud(Shape::Cube, 12_000, false);
    // Six points around each of many, so that a grid pays.
    let (h, count) = (4e-3_f32, 2000);
    let middles: Vec<Vec3> =
        (0..count).map(|i| Vec3::from_fn(|k, _| 0.1 + 0.8 * noise(30 * i + k) as f32)).collect();
    let around = |x: &Vec3| [0, 1, 2, 3, 4, 5].map(|k| x + Vec3::ith(k / 2, if k % 2 == 0 { h } else { -h }));
    let points: Vec<Vec3> = middles.iter().flat_map(around).collect();
    let method = Method::Grid { error: 1e-2 };
    assert!(choose_grid(&vortons, points.len(), Kernel::Gaussian, 1e-2).is_some());
    let find = |points: &[Vec3], quantity| {
        induced(&vortons, Targets::Points(points), quantity, Kernel::Gaussian, method).unwrap()
    };
    let potential = find(&points, Quantity::Potential).potential;
    let velocity = find(&points, Quantity::Velocity).velocity;
    let (mut missed, mut whole) = (0.0, 0.0);
    for (a, u) in potential.chunks_exact(6).zip(velocity.chunks_exact(6)) {
        let slope = |axis: usize, k: usize| (a[2 * axis][k] - a[2 * axis + 1][k]) / (2.0 * h);
        let curl = Vec3::new(slope(1, 2) - slope(2, 1), slope(2, 0) - slope(0, 2), slope(0, 1) - slope(1, 0));
        let u = u.iter().sum::<Vec3>() / 6.0;
        missed += f64::from((curl - u).norm_squared());
        whole += f64::from(u.norm_squared());
    }
    assert!(missed < 4e-4 * whole, "{}", (missed / whole).sqrt());
}

#[test]
fn boundary_values_are_the_potential() {
    let vortons = cloud(Shape::Ring, 6000, false);
    let around = UniformGrid { low: Vec3::new(-1.4, -1.4, -0.4), spacing: 0.025, cells: [112, 112, 32] };
    let mut field = VectorField::new(around);
    boundary_values(&mut field, &vortons, Kernel::default(), 1e-4).unwrap();
    let mut at = Vec::new();
    nodes(around, |node| {
        if (0..3).any(|k| node[k] == 0 || node[k] == around.cells[k]) {
            at.push(node);
        }
    });
    let points: Vec<Vec3> = at.iter().map(|&node| around.node(node)).collect();
    let exact =
        induced(&vortons, Targets::Points(&points), Quantity::Potential, Kernel::default(), Method::Direct);
    let found: Vec<Vec3> = at.iter().map(|&node| field.at(node)).collect();
    let error = relative_error(
        found.iter().flatten(),
        exact.unwrap().potential.iter().flatten().map(|&c| f64::from(c)),
    );
    assert!(error < 5e-4, "{error}");
}

#[test]
fn a_grid_sum_does_not_depend_on_threads() {
    let vortons = cloud(Shape::Cube, 9000, true);
    let method = Method::Grid { error: 0.1 };
    let find = |threads| {
        par::with_threads(threads, || {
            induced(&vortons, Targets::Vortons, Quantity::VelocityAndGradient, Kernel::default(), method)
                .unwrap()
        })
    };
    let one = find(1);
    assert!([2, 3, 8].iter().all(|&threads| find(threads) == one));
}

#[test]
#[should_panic(expected = "the grid with WinckelmansLeonard accepts errors")]
fn an_error_below_the_grids_range_is_refused() {
    let method = Method::Grid { error: 1e-5 };
    let _ = induced(&Vortons::default(), Targets::Vortons, Quantity::Velocity, Kernel::default(), method);
}

#[test]
fn one_solution_serves_vortons_and_points() {
    let vortons = cloud(Shape::Cube, 30_000, false);
    // Inside the grid, next to it and far off.
    let points: Vec<Vec3> = (0..600)
        .map(|i| Vec3::from_fn(|k, _| (if i < 500 { 2.4 } else { 40.0 }) * (noise(90 * i + k) as f32 - 0.5)))
        .collect();
    let kernel = Kernel::default();
    let method = Method::Grid { error: 1e-3 };
    assert!(choose_grid(&vortons, vortons.len() + points.len(), kernel, 1e-3).is_some());
    let (found, along) = induced_both(&vortons, Targets::Vortons, &points, kernel, method).unwrap();
    let missed = sampled_error(&vortons, Targets::Vortons, kernel, &found.velocity, 300).unwrap();
    assert!(missed < 1e-3, "{missed}");
    let exact =
        induced(&vortons, Targets::Points(&points), Quantity::Velocity, kernel, Method::Direct).unwrap();
    let missed =
        relative_error(along.iter().flatten(), exact.velocity.iter().flatten().map(|&v| f64::from(v)));
    assert!(missed < 5e-3, "{missed}");
    // The gradient is that of a call of its own to the error of both, twelve times that of the velocity, and without points all is.
    let alone = induced(&vortons, Targets::Vortons, Quantity::VelocityAndGradient, kernel, method).unwrap();
    let gradient = alone.gradient.iter().flatten().map(|&v| f64::from(v));
    let missed = relative_error(found.gradient.iter().flatten(), gradient);
    assert!(missed < 2e-2, "{missed}");
    let (none, nowhere) = induced_both(&vortons, Targets::Vortons, &[], kernel, method).unwrap();
    assert!(none == alone && nowhere.is_empty());
    // The others are two calls.
    for method in [Method::Tree { error: 1e-3 }, Method::Direct] {
        let few = cloud(Shape::Cube, 3000, false);
        let find = |targets, quantity| induced(&few, targets, quantity, kernel, method).unwrap();
        let (found, along) = induced_both(&few, Targets::Vortons, &points, kernel, method).unwrap();
        assert!(found == find(Targets::Vortons, Quantity::VelocityAndGradient), "{method:?}");
        assert!(along == find(Targets::Points(&points), Quantity::Velocity).velocity, "{method:?}");
    }
}
