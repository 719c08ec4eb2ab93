//! Linear systems without symmetry.
//!
//! *Method*: GMRES [saad86], not restarted, with Gram–Schmidt done as it comes (modified) and Givens rotations; in double precision.
//! Symbols: A → `apply`, b → `right`, Q → `basis`, R → `upper`. Limits: keeps a vector an iteration.

use crate::math::elementary::hypot;

/// x with |b − A x| ≤ `tolerance` |b|, from zero, in at most `most` iterations; and the relative residual that was reached.
pub(crate) fn gmres(
    right: &[f64],
    tolerance: f64,
    most: usize,
    apply: impl Fn(&[f64]) -> Vec<f64>,
) -> (Vec<f64>, f64) {
    let norm = dot(right, right).sqrt();
    if norm == 0.0 || !norm.is_finite() {
        return (vec![0.0; right.len()], if norm == 0.0 { 0.0 } else { f64::NAN });
    }
    let mut basis = vec![right.iter().map(|b| b / norm).collect::<Vec<f64>>()];
    let (mut upper, mut rotations): (Vec<Vec<f64>>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let mut residual = vec![norm];
    while upper.len() < most && residual[upper.len()].abs() > tolerance * norm {
        // The next direction, orthogonal to those before.
        let mut next = apply(&basis[upper.len()]);
        let mut column = Vec::with_capacity(basis.len() + 1);
        for q in &basis {
            let along = dot(q, &next);
            next.iter_mut().zip(q).for_each(|(v, q)| *v -= along * q);
            column.push(along);
        }
        let length = dot(&next, &next).sqrt();

        // The column is turned as those before were, and then so that nothing is left below the diagonal.
        for (i, [cos, sin]) in rotations.iter().enumerate() {
            let (a, b) = (column[i], column[i + 1]);
            (column[i], column[i + 1]) = (cos * a + sin * b, cos * b - sin * a);
        }
        let last = column.len() - 1;
        let size = hypot(column[last], length);
        if size == 0.0 {
            break;
        }
        let turn = [column[last] / size, length / size];
        column[last] = size;
        let left = residual[last];
        residual[last] = turn[0] * left;
        residual.push(-turn[1] * left);
        upper.push(column);
        rotations.push(turn);
        if length <= 1e-14 * size {
            break;
        }
        next.iter_mut().for_each(|v| *v /= length);
        basis.push(next);
    }

    // R y = residual, from below, and x = Q y.
    let count = upper.len();
    let mut y = vec![0.0; count];
    for i in (0..count).rev() {
        let known: f64 = (i + 1..count).map(|j| upper[j][i] * y[j]).sum();
        y[i] = (residual[i] - known) / upper[i][i];
    }
    let mut x = vec![0.0; right.len()];
    for (q, y) in basis.iter().zip(&y) {
        x.iter_mut().zip(q).for_each(|(x, q)| *x += y * q);
    }
    (x, residual[count].abs() / norm)
}

/// Σ a b in eight partial sums, which a processor adds at once.
pub(crate) fn dot<A: Copy + Into<f64>>(a: &[A], b: &[f64]) -> f64 {
    let ((a, last_a), (b, last_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for (sum, (&a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a.into() * b;
        }
    }
    let last: f64 = last_a.iter().zip(last_b).map(|(&a, b)| a.into() * b).sum();
    sums.iter().sum::<f64>() + last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_without_symmetry_is_solved() {
        let n = 40;
        let entry = |i: usize, j: usize| {
            if i == j { 3.0 } else { ((i * 7 + j * 13) % 11) as f64 / 40.0 - 0.1 }
        };
        let apply =
            |x: &[f64]| (0..n).map(|i| (0..n).map(|j| entry(i, j) * x[j]).sum()).collect::<Vec<f64>>();
        let wanted: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
        let (found, residual) = gmres(&apply(&wanted), 1e-12, 60, apply);
        assert!(residual <= 1e-12);
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!(gmres(&vec![0.0; n], 1e-6, 9, apply), (vec![0.0; n], 0.0));
        let (_, early) = gmres(&wanted, 1e-12, 2, apply);
        assert!(early > 1e-12 && early < 1.0);
    }
}
