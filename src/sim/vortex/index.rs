//! Multi-indices α of three exponents, in the order in which expansions keep their coefficients.
//!
//! By degree |α| = α_x + α_y + α_z, then by falling α_x, then by falling α_y: what belongs to a lower order comes first, so
//! an expansion cut at a lower order is the beginning of it.

/// The highest order of an expansion.
pub(super) const MAX_ORDER: usize = 8;

/// Multi-indices up to [`MAX_ORDER`].
pub(super) const COEFS: usize = coefs(MAX_ORDER);

/// Multi-indices of degree up to `order`.
pub(super) const fn coefs(order: usize) -> usize {
    (order + 1) * (order + 2) * (order + 3) / 6
}

/// Multi-indices of degrees below `degree`.
pub(super) const fn before(degree: usize) -> usize {
    degree * (degree + 1) * (degree + 2) / 6
}

/// One step towards a multi-index: `parent` + 1 on `axis`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) axis: u8,
    /// The place of the parent.
    pub(super) parent: u8,
    /// The parent's exponent on the axis.
    pub(super) exponent: u8,
    /// The place of what has one less than the parent on the axis, if the parent has any.
    pub(super) grandparent: u8,
}

/// The place of every sum: `ADD[a][b]` is that of α + β; 0 where the sum's degree is above [`MAX_ORDER`].
pub(super) static ADD: [[u8; COEFS]; COEFS] = sums();

/// The step to every multi-index but the first.
pub(super) static STEPS: [Step; COEFS] = steps();

const EXPONENTS: [[usize; 3]; COEFS] = exponents();

/// The place of a multi-index.
pub(super) const fn place(e: [usize; 3]) -> usize {
    let rest = e[1] + e[2];
    before(e[0] + rest) + rest * (rest + 1) / 2 + e[2]
}

const fn exponents() -> [[usize; 3]; COEFS] {
    let mut out = [[0; 3]; COEFS];
    let (mut degree, mut rest, mut z) = (0, 0, 0);
    let mut at = 0;
    while at < COEFS {
        out[at] = [degree - rest, rest - z, z];
        at += 1;
        z += 1;
        if z > rest {
            (rest, z) = (rest + 1, 0);
        }
        if rest > degree {
            (degree, rest) = (degree + 1, 0);
        }
    }
    out
}

const fn sums() -> [[u8; COEFS]; COEFS] {
    let mut out = [[0; COEFS]; COEFS];
    let mut a = 0;
    while a < COEFS {
        let mut b = 0;
        while b < COEFS {
            let (x, y) = (EXPONENTS[a], EXPONENTS[b]);
            let sum = [x[0] + y[0], x[1] + y[1], x[2] + y[2]];
            if sum[0] + sum[1] + sum[2] <= MAX_ORDER {
                out[a][b] = place(sum) as u8;
            }
            b += 1;
        }
        a += 1;
    }
    out
}

const fn steps() -> [Step; COEFS] {
    let mut out = [Step { axis: 0, parent: 0, exponent: 0, grandparent: 0 }; COEFS];
    let mut at = 1;
    while at < COEFS {
        let mut e = EXPONENTS[at];
        // Along the axis of the smallest exponent there is: the fewest have a grandparent.
        let mut axis = 3;
        let mut k = 0;
        while k < 3 {
            if e[k] > 0 && (axis == 3 || e[k] < e[axis]) {
                axis = k;
            }
            k += 1;
        }
        e[axis] -= 1;
        let (parent, exponent) = (place(e) as u8, e[axis] as u8);
        e[axis] = e[axis].saturating_sub(1);
        out[at] = Step { axis: axis as u8, parent, exponent, grandparent: place(e) as u8 };
        at += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_multi_index_has_its_place_and_sums_find_theirs() {
        for (at, &e) in EXPONENTS.iter().enumerate() {
            assert_eq!(place(e), at);
            let degree: usize = e.iter().sum();
            assert!((before(degree)..coefs(degree)).contains(&at));
            for (b, other) in EXPONENTS.iter().enumerate() {
                let sum: [usize; 3] = std::array::from_fn(|k| e[k] + other[k]);
                let expected = if sum.iter().sum::<usize>() <= MAX_ORDER { place(sum) } else { 0 };
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
