//! One suite for every form of lanes: each operation against plain arithmetic, bit for bit.

use super::*;
use crate::par;
use std::{array::from_fn, cell::Cell};

thread_local! {
    /// Whether passes on this thread take the scalar form.
    pub(super) static SCALAR_ONLY: Cell<bool> = const { Cell::new(false) };
}

/// What `job` returns with the scalar form of all passes, and with the fastest form.
pub(crate) fn in_both_forms<T: Send>(job: impl Fn() -> T + Sync) -> [T; 2] {
    [true, false].map(|scalar_only| {
        // On a pool of one thread, which then is the thread of every pass.
        par::with_threads(1, || {
            SCALAR_ONLY.set(scalar_only);
            job()
        })
    })
}

/// Eight rows of ordinary numbers, and rows of zeros of both signs, subnormal and huge numbers, infinities
/// and NaN.
fn rows() -> Vec<F32x8> {
    let mut x = 0.37_f32;
    let mut next = || {
        x = (x * 79.1 + 0.013) % 7.3;
        x - 3.1
    };
    let mut rows: Vec<F32x8> = (0..8).map(|_| from_fn(|_| next())).collect();
    rows.push([0.0, -0.0, 1e-40, 3e38, f32::NAN, f32::INFINITY, 1.0, -1e-20]);
    for value in [0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0] {
        rows.push([value; LANES]);
    }
    rows
}

/// The bits, the same for every NaN: processors differ in the sign of those that they make.
fn bits(row: F32x8) -> [u32; LANES] {
    row.map(|a| if a.is_nan() { f32::NAN.to_bits() } else { a.to_bits() })
}

/// Checks every operation on two vectors against plain arithmetic.
struct Pairs(F32x8, F32x8);

impl Pass for Pairs {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self(a, b) = self;
        let (x, y) = (L::load(&a), L::load(&b));
        let mut added = x;
        added += y;
        let less = x.less(y);
        let squares = x * x;
        for (name, found, expected) in [
            ("+", x + y, from_fn(|k| a[k] + b[k])),
            ("+=", added, from_fn(|k| a[k] + b[k])),
            ("-", x - y, from_fn(|k| a[k] - b[k])),
            ("*", x * y, from_fn(|k| a[k] * b[k])),
            ("/", x / y, from_fn(|k| a[k] / b[k])),
            ("neg", -x, a.map(|a| -a)),
            ("splat", L::splat(a[0]), [a[0]; LANES]),
            ("sqrt", squares.sqrt(), a.map(|a| (a * a).sqrt())),
            ("inverse_sqrt", squares.inverse_sqrt(), a.map(|a| 1.0 / (a * a).sqrt())),
            ("abs", x.abs(), a.map(f32::abs)),
            ("min", x.min(y), from_fn(|k| if a[k] < b[k] { a[k] } else { b[k] })),
            ("max", x.max(y), from_fn(|k| if a[k] > b[k] { a[k] } else { b[k] })),
            ("positive_part", x.positive_part(), a.map(|a| if a < 0.0 { 0.0 } else { a })),
            ("zero_indicator", x.zero_indicator(), a.map(|a| f32::from(u8::from(a == 0.0)))),
            ("select", L::select(less, x, y), from_fn(|k| if a[k] < b[k] { a[k] } else { b[k] })),
            ("shifted_up", x.shifted_up(b[0]), [b[0], a[0], a[1], a[2], a[3], a[4], a[5], a[6]]),
            ("shifted_down", x.shifted_down(b[0]), [a[1], a[2], a[3], a[4], a[5], a[6], a[7], b[0]]),
            ("sum", L::splat(x.sum()), [sum(a); LANES]),
            ("exp", (-squares).exp(), (-ScalarLanes::load(&a.map(|a| a * a))).exp().to_array()),
        ] {
            assert_eq!(bits(found.to_array()), bits(expected), "{name} of {a:?} and {b:?}");
        }
        let mask = |truth: &dyn Fn(usize) -> bool| (0..LANES).map(|k| u8::from(truth(k)) << k).sum::<u8>();
        let greater = y.less(x);
        assert_eq!(L::bits(less), mask(&|k| a[k] < b[k]));
        assert_eq!(L::bits(L::and(less, greater)), 0);
        assert_eq!(L::bits(L::and(less, less)), L::bits(less));
        assert_eq!(L::bits(L::and_not(less, greater)), L::bits(less));
        assert_eq!(L::bits(L::and_not(less, less)), 0);
    }
}

#[test]
fn every_operation_has_the_bits_of_plain_arithmetic() {
    in_both_forms(|| {
        for a in rows() {
            for b in rows() {
                dispatch(Pairs(a, b));
            }
        }
    });
}

/// Checks what moves numbers between lanes, and the powers of two.
struct Moves;

impl Pass for Moves {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let rows = rows();
        let columns = L::transpose(from_fn(|k| &rows[k]));
        let sums = L::sums(&columns);
        for k in 0..LANES {
            let column = from_fn(|row| rows[row][k]);
            assert_eq!(bits(columns[k].to_array()), bits(column));
            assert_eq!(sums[k].to_bits(), sum(column).to_bits());
        }
        for n in -126..=127_i16 {
            let shifted = L::splat(12_582_912.0) + L::splat(f32::from(n));
            assert_eq!(shifted.power_of_two().to_array(), [2.0_f64.powi(n.into()) as f32; LANES], "{n}");
        }
        let row: [u32; LANES] = [7, 3, 7, u32::MAX, 0, 7, 5, 1 << 31];
        assert_eq!(L::bits(L::equal(&row, 7)), 0b0010_0101);
        assert_eq!(L::bits(L::equal(&row, u32::MAX)), 0b0000_1000);
        for pattern in 0..=u8::MAX {
            let lanes: F32x8 = from_fn(|k| f32::from(pattern >> k & 1));
            let mask = L::splat(0.5).less(L::load(&lanes));
            let mut out = [0; LANES];
            let found = L::compress(mask, &row, &mut out);
            let expected: Vec<u32> = (0..LANES).filter(|k| pattern >> k & 1 == 1).map(|k| row[k]).collect();
            assert_eq!(&out[..found], expected, "{pattern:#b}");
        }
        for len in 0..LANES {
            let expected = from_fn(|k| if k < len { row[k] } else { 9 });
            assert_eq!(L::padded(&row[..len], 9), expected);
        }
    }
}

#[test]
fn lanes_are_moved_as_documented() {
    in_both_forms(|| dispatch(Moves));
}

/// Gathers lists of all lengths by eights.
struct Gathers;

impl Pass for Gathers {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let table: Vec<[f32; 4]> =
            (0..50_u8).map(|i| from_fn(|part| f32::from(i) + 0.1 * part as f32)).collect();
        let list = IndexList::new((0..200).map(|k| k * 7 % 50).collect(), 50);
        for len in 0..30 {
            let range = 11..11 + len;
            let mut rows = list.rows::<L>(range.clone(), 3);
            let padding = rows.padding();
            let mut found = Vec::new();
            while let Some(row) = rows.next() {
                let parts = L::gather(&table, row).map(L::to_array);
                found.extend((0..LANES).map(|lane| parts.map(|part| part[lane])));
            }
            let listed = list.as_slice()[range].iter().chain(std::iter::repeat_n(&3, padding));
            assert_eq!(found, listed.map(|&i| table[i as usize]).collect::<Vec<_>>());
        }
    }
}

#[test]
fn lists_are_gathered_by_eights_and_filled_up() {
    in_both_forms(|| dispatch(Gathers));
}

/// Gathers from a table that is shorter than the indices' bound.
struct BeyondTheTable;

impl Pass for BeyondTheTable {
    type Out = f32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f32 {
        let list = IndexList::new(vec![1], 2);
        let mut rows = list.rows::<L>(0..1, 0);
        L::gather(&[[0.0; 4]], rows.next().expect("there is one"))[0].sum()
    }
}

#[test]
#[should_panic(expected = "indices lie within the table")]
fn indices_beyond_the_table_are_refused() {
    dispatch(BeyondTheTable);
}

#[test]
#[should_panic(expected = "indices are below 50")]
fn lists_with_an_index_that_reaches_the_bound_are_refused() {
    IndexList::new((0..=50).collect(), 50);
}

/// Takes a row that is filled up with an index beyond the bound.
struct FilledBeyondTheBound;

impl Pass for FilledBeyondTheBound {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        IndexList::new(vec![1], 2).rows::<L>(0..1, 2);
    }
}

#[test]
#[should_panic(expected = "an index is below the bound")]
fn rows_filled_up_beyond_the_bound_are_refused() {
    dispatch(FilledBeyondTheBound);
}

#[test]
fn nan_is_not_lost() {
    let (zero, nan) = (ScalarLanes::splat(0.0), ScalarLanes::splat(f32::NAN));
    assert!(zero.max(nan).sum().is_nan() && nan.max(zero).sum() == 0.0);
    assert!(zero.min(nan).sum().is_nan() && nan.min(zero).sum() == 0.0);
    assert!(nan.positive_part().sum().is_nan());
}

#[test]
fn the_exponential_is_good_to_two_units_in_the_last_place() {
    for k in 0..1970 {
        let x = -0.044 * k as f32;
        let (found, exact) = (f64::from(ScalarLanes::splat(x).exp().to_array()[0]), f64::from(x).exp());
        assert!((found / exact - 1.0).abs() < 2.0 * f64::from(f32::EPSILON), "{x}: {found} {exact}");
    }
    assert_eq!(ScalarLanes::splat(-87.1).exp().to_array()[0], 0.0);
}

/// Plain loops over [`F32x8`], which the compiler vectorises.
struct PlainLoops<'a>(&'a [F32x8]);

impl Pass for PlainLoops<'_> {
    type Out = Vec<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<u32> {
        let mut total = [0.0; LANES];
        for row in self.0 {
            for lane in 0..LANES {
                let a = row[lane];
                total[lane] += (a * a + 0.3).sqrt() / (a - 7.1) - 3.0 * a;
            }
        }
        total.iter().chain([&sum(total)]).map(|v| v.to_bits()).collect()
    }
}

#[test]
fn plain_loops_have_the_same_bits_in_both_forms() {
    let rows: Vec<F32x8> =
        (0..100).map(|i| from_fn(|k| ((i * 37 + k * 11) % 101) as f32 * 0.137 - 6.0)).collect();
    let [scalar, fastest] = in_both_forms(|| dispatch(PlainLoops(&rows)));
    assert_eq!(scalar, fastest);
}
