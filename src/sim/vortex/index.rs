//! Multi-indices α of three exponents, in the order in which expansions store their coefficients.
//!
//! They are ordered by degree |α| = α_x + α_y + α_z, then by descending α_x, then by descending α_y. So the
//! first coefficients of an expansion are those of the expansion of a lower order.

/// The highest order of an expansion.
pub(super) const MAX_ORDER: usize = 8;

/// The number of multi-indices of degree up to [`MAX_ORDER`].
pub(super) const MAX_COEFS: usize = coefs(MAX_ORDER);

/// The number of multi-indices of degree up to `order`.
pub(super) const fn coefs(order: usize) -> usize {
    (order + 1) * (order + 2) * (order + 3) / 6
}

/// The number of multi-indices of degrees below `degree`.
pub(super) const fn before(degree: usize) -> usize {
    degree * (degree + 1) * (degree + 2) / 6
}

/// A step of the recurrence that leads to a multi-index: `parent` + 1 on `axis`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) axis: u8,
    /// The index of the parent.
    pub(super) parent: u8,
    /// The exponent of the parent on the axis.
    pub(super) exponent: u8,
    /// The index of the parent − 1 on the axis, if that exists.
    pub(super) grandparent: u8,
}

/// The index of every sum: `ADD[a][b]` is that of α + β, or 0 where the degree of the sum is above
/// [`MAX_ORDER`].
pub(super) static ADD: [[u8; MAX_COEFS]; MAX_COEFS] = sums();

/// The step to every multi-index except the first.
pub(super) static STEPS: [Step; MAX_COEFS] = steps();

const EXPONENTS: [[usize; 3]; MAX_COEFS] = exponents();

/// The index of a multi-index in the order.
pub(super) const fn index_of(e: [usize; 3]) -> usize {
    let yz = e[1] + e[2];
    before(e[0] + yz) + yz * (yz + 1) / 2 + e[2]
}

const fn exponents() -> [[usize; 3]; MAX_COEFS] {
    let mut out = [[0; 3]; MAX_COEFS];
    let (mut degree, mut yz, mut z) = (0, 0, 0);
    let mut at = 0;
    while at < MAX_COEFS {
        out[at] = [degree - yz, yz - z, z];
        at += 1;
        z += 1;
        if z > yz {
            (yz, z) = (yz + 1, 0);
        }
        if yz > degree {
            (degree, yz) = (degree + 1, 0);
        }
    }
    out
}

const fn sums() -> [[u8; MAX_COEFS]; MAX_COEFS] {
    let mut out = [[0; MAX_COEFS]; MAX_COEFS];
    let mut a = 0;
    while a < MAX_COEFS {
        let mut b = 0;
        while b < MAX_COEFS {
            let (x, y) = (EXPONENTS[a], EXPONENTS[b]);
            let sum = [x[0] + y[0], x[1] + y[1], x[2] + y[2]];
            if sum[0] + sum[1] + sum[2] <= MAX_ORDER {
                out[a][b] = index_of(sum) as u8;
            }
            b += 1;
        }
        a += 1;
    }
    out
}

const fn steps() -> [Step; MAX_COEFS] {
    let mut out = [Step { axis: 0, parent: 0, exponent: 0, grandparent: 0 }; MAX_COEFS];
    let mut at = 1;
    while at < MAX_COEFS {
        let mut e = EXPONENTS[at];
        // Along the axis of the smallest exponent above 0: so few steps have a grandparent.
        let mut axis = 3;
        let mut k = 0;
        while k < 3 {
            if e[k] > 0 && (axis == 3 || e[k] < e[axis]) {
                axis = k;
            }
            k += 1;
        }
        e[axis] -= 1;
        let (parent, exponent) = (index_of(e) as u8, e[axis] as u8);
        e[axis] = e[axis].saturating_sub(1);
        out[at] = Step { axis: axis as u8, parent, exponent, grandparent: index_of(e) as u8 };
        at += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multi_indices_and_their_sums_are_found() {
        for (at, &e) in EXPONENTS.iter().enumerate() {
            assert_eq!(index_of(e), at);
            let degree: usize = e.iter().sum();
            assert!((before(degree)..coefs(degree)).contains(&at));
            for (b, other) in EXPONENTS.iter().enumerate() {
                let sum: [usize; 3] = std::array::from_fn(|k| e[k] + other[k]);
                let expected = if sum.iter().sum::<usize>() <= MAX_ORDER { index_of(sum) } else { 0 };
                assert_eq!(usize::from(ADD[at][b]), expected);
            }
        }
    }

    #[test]
    fn steps_lead_to_every_multi_index() {
        for (at, step) in STEPS.iter().enumerate().skip(1) {
            let (mut parent, axis) = (EXPONENTS[usize::from(step.parent)], usize::from(step.axis));
            assert_eq!(parent[axis], usize::from(step.exponent));
            if parent[axis] > 0 {
                let mut grandparent = parent;
                grandparent[axis] -= 1;
                assert_eq!(EXPONENTS[usize::from(step.grandparent)], grandparent);
            }
            parent[axis] += 1;
            assert_eq!(parent, EXPONENTS[at]);
        }
    }
}
