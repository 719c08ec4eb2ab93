//! The scalar reference of [`Lanes`]: what every operation means, and what runs where there is no AVX2.

use super::{F32x8, IndexRow, LANES, Lanes};
use std::{
    array::from_fn,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub},
};

/// Eight numbers, handled one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalarLanes(F32x8);

impl ScalarLanes {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(from_fn(|lane| f(self.0[lane], other.0[lane])))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $sign:tt) => {
        impl $trait for ScalarLanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $sign b)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl AddAssign for ScalarLanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for ScalarLanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}

impl Lanes for ScalarLanes {
    type Mask = [bool; LANES];

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(row: &F32x8) -> Self {
        Self(*row)
    }

    #[inline(always)]
    fn to_array(self) -> F32x8 {
        self.0
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn positive_part(self) -> Self {
        Self(self.0.map(|a| if a < 0.0 { 0.0 } else { a }))
    }

    #[inline(always)]
    fn zero_indicator(self) -> Self {
        Self(self.0.map(|a| if a == 0.0 { 1.0 } else { 0.0 }))
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(self.0.map(|a| f32::from_bits((a.to_bits() << 23).wrapping_add(0x3f80_0000))))
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        from_fn(|lane| self.0[lane] < other.0[lane])
    }

    #[inline(always)]
    fn equal(row: &[u32; LANES], index: u32) -> Self::Mask {
        row.map(|j| j == index)
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        from_fn(|lane| a[lane] & b[lane])
    }

    #[inline(always)]
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        from_fn(|lane| a[lane] & !b[lane])
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u8 {
        mask.iter().rev().fold(0, |bits, &set| bits << 1 | u8::from(set))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(from_fn(|lane| if mask[lane] { yes.0[lane] } else { no.0[lane] }))
    }

    #[inline(always)]
    fn shifted_up(self, first: f32) -> Self {
        Self(from_fn(|lane| if lane == 0 { first } else { self.0[lane - 1] }))
    }

    #[inline(always)]
    fn shifted_down(self, last: f32) -> Self {
        Self(from_fn(|lane| if lane == LANES - 1 { last } else { self.0[lane + 1] }))
    }

    #[inline(always)]
    fn transpose(rows: [&F32x8; LANES]) -> [Self; LANES] {
        from_fn(|column| Self(rows.map(|row| row[column])))
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        super::sum(self.0)
    }

    #[inline(always)]
    fn sums(each: &[Self; LANES]) -> F32x8 {
        each.map(Self::sum)
    }

    #[inline(always)]
    fn gather(table: &[[f32; 4]], index: IndexRow<'_>) -> [Self; 4] {
        let index = index.within(table.len());
        from_fn(|part| Self(index.map(|i| table[i as usize][part])))
    }

    #[inline(always)]
    fn padded(list: &[u32], fill: u32) -> [u32; LANES] {
        from_fn(|lane| list.get(lane).copied().unwrap_or(fill))
    }

    #[inline(always)]
    fn compress(mask: Self::Mask, row: &[u32; LANES], out: &mut [u32; LANES]) -> usize {
        // Every index is written, and the next one replaces it unless its mask is set.
        let mut found = 0;
        for lane in 0..LANES {
            out[found] = row[lane];
            found += usize::from(mask[lane]);
        }
        found
    }
}
