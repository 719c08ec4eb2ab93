//! Symmetric 3×3 matrices.
//!
//! *Method*: eigenvalues and eigenvectors by the cyclic Jacobi iteration ([golub13] section 8.5), which keeps small
//! eigenvalues exact to their own digits and gives an orthogonal basis for any matrix.

use super::Vec3;

/// The upper triangle: xx, yy, zz, xy, xz, yz.
pub type Symmetric = [f32; 6];

/// Limit of Jacobi sweeps; off-diagonal elements vanish after four to six.
const SWEEPS: usize = 12;

/// The eigenvalues, descending, and their unit eigenvectors, a right-handed or left-handed basis.
///
/// A matrix that is not finite gives values that are not.
pub fn eigen(matrix: &Symmetric) -> ([f32; 3], [Vec3; 3]) {
    let [xx, yy, zz, xy, xz, yz] = matrix.map(f64::from);
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        let off_diagonal = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let along = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if off_diagonal <= 1e-12 * along || off_diagonal.is_nan() {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i: &usize, &j: &usize| a[j][j].total_cmp(&a[i][i]));
    let column = |k: usize| Vec3::new(v[0][k] as f32, v[1][k] as f32, v[2][k] as f32);
    (order.map(|k| a[k][k] as f32), order.map(column))
}

/// Turns the plane of p and q so that a_pq vanishes.
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt()); // [golub13] Eq. 8.5.3
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let r = 3 - p - q;
    let (app, aqq, apq, arp, arq) = (a[p][p], a[q][q], a[p][q], a[r][p], a[r][q]);
    a[p][p] = app - t * apq;
    a[q][q] = aqq + t * apq;
    (a[p][q], a[q][p]) = (0.0, 0.0);
    a[r][p] = c * arp - s * arq;
    a[r][q] = s * arp + c * arq;
    (a[p][r], a[q][r]) = (a[r][p], a[r][q]);
    for row in v {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn times(m: &Symmetric, x: Vec3) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = *m;
        Vec3::new(
            xx * x.x + xy * x.y + xz * x.z,
            xy * x.x + yy * x.y + yz * x.z,
            xz * x.x + yz * x.y + zz * x.z,
        )
    }

    proptest! {
        #[test]
        fn every_matrix_is_rebuilt(m in prop::array::uniform6(-10.0_f32..10.0), scale in -12..12) {
            let m = m.map(|v| v * 10.0_f32.powi(scale));
            let size: f32 = m.iter().map(|v| v.abs()).sum();
            let (values, vectors) = eigen(&m);
            prop_assert!(values[0] >= values[1] && values[1] >= values[2]);
            for k in 0..3 {
                prop_assert!((times(&m, vectors[k]) - vectors[k] * values[k]).norm() < 1e-5 * size);
                for j in 0..3 {
                    let expected = if j == k { 1.0 } else { 0.0 };
                    prop_assert!((vectors[j].dot(&vectors[k]) - expected).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn degenerate_matrices_have_a_basis_too() {
        for m in [
            [0.0; 6],
            [2.0, 2.0, 2.0, 0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            [0.0, 0.0, 3.0, 0.0, 0.0, 0.0],
        ] {
            let (values, vectors) = eigen(&m);
            assert!((values.iter().sum::<f32>() - m[0] - m[1] - m[2]).abs() < 1e-5);
            let volume = vectors[0].cross(&vectors[1]).dot(&vectors[2]);
            assert!((volume.abs() - 1.0).abs() < 1e-5, "{m:?}");
        }
        assert!(eigen(&[f32::NAN; 6]).0[0].is_nan());
    }
}
