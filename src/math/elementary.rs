//! Elementary functions with the same bits on every system.
//!
//! Addition to square root are exact by IEEE 754 everywhere. These are not: each system's mathematical library has its own last bits,
//! glibc even by the processor's instructions. So they come from the crate `libm`, which is compiled into the program.

macro_rules! elementary {
    ($($(#[$doc:meta])* $name:ident($($argument:ident),+) = $single:ident, $double:ident;)+) => {
        /// A number that has elementary functions.
        pub(crate) trait Elementary: Copy {
            $(#[doc(hidden)] fn $name($($argument: Self),+) -> Self;)+
        }

        impl Elementary for f32 {
            $(#[inline] fn $name($($argument: Self),+) -> Self { libm::$single($($argument),+) })+
        }

        impl Elementary for f64 {
            $(#[inline] fn $name($($argument: Self),+) -> Self { libm::$double($($argument),+) })+
        }

        $($(#[$doc])* #[inline] pub(crate) fn $name<T: Elementary>($($argument: T),+) -> T { T::$name($($argument),+) })+
    };
}

elementary! {
    /// Sine of an angle [rad].
    sin(x) = sinf, sin;
    /// Cosine of an angle [rad].
    cos(x) = cosf, cos;
    /// Inverse cosine [rad].
    acos(x) = acosf, acos;
    /// Inverse tangent [rad].
    atan(x) = atanf, atan;
    /// Angle of the point (x, y) [rad].
    atan2(y, x) = atan2f, atan2;
    /// Hyperbolic cosine.
    cosh(x) = coshf, cosh;
    /// Inverse hyperbolic sine.
    asinh(x) = asinhf, asinh;
    /// Exponential function.
    exp(x) = expf, exp;
    /// Power of two.
    exp2(x) = exp2f, exp2;
    /// Exponential function less one.
    exp_m1(x) = expm1f, expm1;
    /// Natural logarithm.
    ln(x) = logf, log;
    /// Natural logarithm of one plus a number.
    ln_1p(x) = log1pf, log1p;
    /// Logarithm to the base 2.
    log2(x) = log2f, log2;
    /// Logarithm to the base 10.
    log10(x) = log10f, log10;
    /// Power with any exponent.
    powf(x, y) = powf, pow;
    /// Cube root.
    cbrt(x) = cbrtf, cbrt;
    /// Length of the vector (x, y), without overflow.
    hypot(x, y) = hypotf, hypot;
}

#[cfg(test)]
mod tests {
    use super::*;
    use xxhash_rust::xxh3::Xxh3;

    /// Hash of the bits of a function's values at 4096 arguments of `range`, in each precision.
    fn hash(
        range: std::ops::Range<f64>,
        single: impl Fn(f32, f32) -> f32,
        double: impl Fn(f64, f64) -> f64,
    ) -> u64 {
        let mut hasher = Xxh3::new();
        let part = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 / (1_u64 << 53) as f64;
        for i in 1..=4096 {
            let [x, y] =
                [part(2 * i), part(2 * i + 1)].map(|part| range.start + part * (range.end - range.start));
            hasher.update(&single(x as f32, y as f32).to_bits().to_le_bytes());
            hasher.update(&double(x, y).to_bits().to_le_bytes());
        }
        hasher.digest()
    }

    fn one(range: std::ops::Range<f64>, single: fn(f32) -> f32, double: fn(f64) -> f64) -> u64 {
        hash(range, |x, _| single(x), |x, _| double(x))
    }

    fn two(range: std::ops::Range<f64>, single: fn(f32, f32) -> f32, double: fn(f64, f64) -> f64) -> u64 {
        hash(range, single, double)
    }

    /// The hashes were recorded on x86-64 Linux. A system on which one differs would simulate another shot.
    #[test]
    fn every_function_has_the_recorded_bits() {
        let found = [
            ("sin", one(-100.0..100.0, sin, sin)),
            ("cos", one(-100.0..100.0, cos, cos)),
            ("acos", one(-1.0..1.0, acos, acos)),
            ("atan", one(-10.0..10.0, atan, atan)),
            ("cosh", one(-20.0..20.0, cosh, cosh)),
            ("asinh", one(-100.0..100.0, asinh, asinh)),
            ("exp", one(-80.0..80.0, exp, exp)),
            ("exp2", one(-100.0..100.0, exp2, exp2)),
            ("exp_m1", one(-1.0..1.0, exp_m1, exp_m1)),
            ("ln", one(0.0..1e6, ln, ln)),
            ("ln_1p", one(-1.0..1.0, ln_1p, ln_1p)),
            ("log2", one(0.0..1e6, log2, log2)),
            ("log10", one(0.0..1e6, log10, log10)),
            ("cbrt", one(-1e6..1e6, cbrt, cbrt)),
            ("atan2", two(-1.0..1.0, atan2, atan2)),
            ("powf", two(0.0..9.0, powf, powf)),
            ("hypot", two(-1.0..1.0, hypot, hypot)),
        ];
        assert_eq!(found, RECORDED);
    }

    const RECORDED: [(&str, u64); 17] = [
        ("sin", 0xa3c9_e61a_a447_43cf),
        ("cos", 0x754b_4a51_e016_5fd5),
        ("acos", 0xef26_82f5_be18_0607),
        ("atan", 0x1f42_72c2_6236_1fbe),
        ("cosh", 0x2ae3_353d_1e87_9b7d),
        ("asinh", 0x4b4b_b532_26d5_401c),
        ("exp", 0xff7b_4f42_53fc_ebe7),
        ("exp2", 0xd702_813e_bfc9_246d),
        ("exp_m1", 0xd605_9d0f_54c6_3f55),
        ("ln", 0x8ed6_a33f_7945_b91a),
        ("ln_1p", 0x0ef5_013d_5468_321f),
        ("log2", 0x21e6_d99f_3139_11b5),
        ("log10", 0x4344_9715_7015_6203),
        ("cbrt", 0x0f54_fdcb_223a_f31f),
        ("atan2", 0xc90b_d21f_bdaf_bfb6),
        ("powf", 0xea3e_9842_c141_0327),
        ("hypot", 0x97be_fbc6_8e7c_f117),
    ];
}
