//! Eight numbers at a time, neighbours of one particle or sums of eight particles: the arithmetic that the passes over
//! neighbour lists are written in.
//!
//! A pass is generic over [`Lanes`] (see `pass.rs`). [`Eight`] is the readable reference; the AVX2 twin beside it
//! rounds alike (no fused operations, the same order of sums), so both give the same bits.

use crate::{math::Vec3, space::Neighbours};
use std::ops::{Add, Div, Mul, Sub};

/// Numbers handled at once.
pub(super) const LANES: usize = 8;

/// A particle as its neighbours read it: x, y, z and one value, in one load.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub(super) struct Node(pub(super) [f32; 4]);

impl Node {
    #[inline(always)]
    pub(super) fn new(v: Vec3, value: f32) -> Self {
        Self([v.x, v.y, v.z, value])
    }

    #[inline(always)]
    pub(super) fn vector(&self) -> Vec3 {
        Vec3::new(self.0[0], self.0[1], self.0[2])
    }

    #[inline(always)]
    pub(super) fn value(&self) -> f32 {
        self.0[3]
    }
}

/// Eight numbers.
pub(super) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same number in every lane.
    fn splat(value: f32) -> Self;
    /// max(0, ·) that lets a NaN through, so that it is found.
    fn positive(self) -> Self;
    /// The larger of each pair of numbers; `other` where one is a NaN or both are zero.
    fn larger(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// 1 where a lane is zero, else 0.
    fn is_zero(self) -> Self;
    /// The smaller of each pair of numbers; `other` where one is a NaN or both are zero.
    fn smaller(self, other: Self) -> Self;
    /// Eight numbers in a row.
    fn load(row: &[f32; LANES]) -> Self;
    /// The numbers as a row.
    fn row(self) -> [f32; LANES];
    /// Σ over lanes: halves, quarters, pairs.
    fn sum(self) -> f32;
    /// [`Lanes::sum`] of each.
    fn sums(each: &[Self; LANES]) -> [f32; LANES];
    /// `list`, which is shorter than [`LANES`], filled up with `own`.
    fn filled_up(list: &[u32], own: u32) -> [u32; LANES];
    /// The four components of eight nodes.
    fn gather(nodes: &[Node], index: Index<'_>) -> [Self; 4];
}

/// The places of eight neighbours. Only [`by_eights`] makes it: the AVX2 twin reads these places without a check.
#[derive(Clone, Copy)]
pub(super) struct Index<'a> {
    at: &'a [u32; LANES],
    /// Every place is below it.
    count: usize,
}

impl<'a> Index<'a> {
    /// The places, after a check that each is one of `nodes`.
    #[inline(always)]
    pub(super) fn within(self, nodes: &[Node]) -> &'a [u32; LANES] {
        assert!(self.count <= nodes.len(), "neighbours are particles");
        self.at
    }
}

/// A list by eights, the last filled up with the particle itself, at distance zero.
///
/// A loop over it stays in the function it is written in. A closure would be a function of its own, compiled without the
/// form's instructions, and 5 times slower.
pub(super) struct Eights<'a> {
    list: &'a [u32],
    done: usize,
    /// What follows the last whole eight.
    last: [u32; LANES],
    count: usize,
}

/// The list of particle `own` by eights.
#[inline(always)]
pub(super) fn eights<L: Lanes>(lists: &Neighbours, own: usize) -> Eights<'_> {
    by_eights::<L>(lists.of(own), own, lists.count())
}

/// `list`, which holds numbers below `count`, by eights.
#[inline(always)]
fn by_eights<L: Lanes>(list: &[u32], own: usize, count: usize) -> Eights<'_> {
    debug_assert!(
        own < count && list.iter().all(|&j| (j as usize) < count),
        "listed numbers are below the count"
    );
    let last = L::filled_up(&list[list.len() / LANES * LANES..], own as u32);
    Eights { list, done: 0, last, count }
}

impl Eights<'_> {
    /// How many of the last eight are the particle itself.
    #[inline(always)]
    pub(super) fn padded(&self) -> f32 {
        (self.list.len().next_multiple_of(LANES) - self.list.len()) as f32
    }

    /// The next eight. They are borrowed, so that each place is read from memory where it is used: copied, eight of them
    /// become one register that they have to be taken out of again, at twice the instructions.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Index<'_>> {
        if self.done >= self.list.len() {
            return None;
        }
        let at = self.list[self.done..].first_chunk().unwrap_or(&self.last);
        self.done += LANES;
        Some(Index { at, count: self.count })
    }
}

/// x_i − x_j, and the squared length of that.
#[inline(always)]
pub(super) fn offset<L: Lanes>(own: [L; 4], other: [L; 4]) -> ([L; 3], L) {
    let d = [own[0] - other[0], own[1] - other[1], own[2] - other[2]];
    (d, d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
}

/// `sum` + `v` `weight`.
#[inline(always)]
pub(super) fn plus<L: Lanes>(sum: [L; 3], v: [L; 3], weight: L) -> [L; 3] {
    [sum[0] + v[0] * weight, sum[1] + v[1] * weight, sum[2] + v[2] * weight]
}

/// Σ over lanes of a vector.
#[inline(always)]
pub(super) fn total<L: Lanes>(v: [L; 3]) -> Vec3 {
    Vec3::new(v[0].sum(), v[1].sum(), v[2].sum())
}

/// A node's components in every lane.
#[inline(always)]
pub(super) fn spread<L: Lanes>(node: Node) -> [L; 4] {
    [L::splat(node.0[0]), L::splat(node.0[1]), L::splat(node.0[2]), L::splat(node.0[3])]
}

/// The reference form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Eight([f32; LANES]);

impl Eight {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }
}

impl Add for Eight {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Eight {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Eight {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Div for Eight {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl Lanes for Eight {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn positive(self) -> Self {
        Self(self.0.map(|a| if a < 0.0 { 0.0 } else { a }))
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        self.with(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn load(row: &[f32; LANES]) -> Self {
        Self(*row)
    }

    #[inline(always)]
    fn row(self) -> [f32; LANES] {
        self.0
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn is_zero(self) -> Self {
        Self(self.0.map(|a| if a == 0.0 { 1.0 } else { 0.0 }))
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        let a = self.0;
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }

    #[inline(always)]
    fn sums(each: &[Self; LANES]) -> [f32; LANES] {
        each.map(Self::sum)
    }

    #[inline(always)]
    fn filled_up(list: &[u32], own: u32) -> [u32; LANES] {
        std::array::from_fn(|lane| list.get(lane).copied().unwrap_or(own))
    }

    #[inline(always)]
    fn gather(nodes: &[Node], index: Index<'_>) -> [Self; 4] {
        let index = index.within(nodes);
        std::array::from_fn(|part| Self(index.map(|i| nodes[i as usize].0[part])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::{
        Kernel,
        pair::{Pair, Wendland},
        pass::{self, Pass},
    };

    /// Every operation on awkward numbers, as bits.
    struct Everything;

    impl Pass for Everything {
        type Out = Vec<u32>;

        #[inline(always)]
        fn run<L: Lanes, P: Pair>(self) -> Vec<u32> {
            let mut x = 0.37_f32;
            let mut next = || {
                x = (x * 79.1 + 0.013) % 7.3;
                x - 3.1
            };
            let mut nodes: Vec<Node> = (0..50).map(|_| Node(std::array::from_fn(|_| next()))).collect();
            nodes[3].0 = [0.0, -0.0, 1e-40, 3e38];
            let mut bits = Vec::new();
            let list: Vec<u32> = (0..29).map(|k| (k * 7) % 50).collect();
            let mut eights = by_eights::<L>(&list, 3, nodes.len());
            bits.push(eights.padded().to_bits());
            while let Some(index) = eights.next() {
                let [a, b, c, d] = L::gather(&nodes, index);
                let results = [
                    a + b,
                    c - d,
                    a * c,
                    b / d,
                    a.positive(),
                    b.larger(c),
                    b.smaller(c),
                    L::load(&(a + b).row()),
                    (a * a).sqrt(),
                    a.is_zero() + b.is_zero(),
                    L::splat(0.1) * d,
                    P::density(a * a, a) + P::slope(b),
                ];
                bits.extend(results.map(|r| r.sum().to_bits()));
                bits.extend(L::sums(&results[..LANES].try_into().expect("there are more")).map(f32::to_bits));
            }
            bits
        }
    }

    #[test]
    fn both_forms_round_alike() {
        let reference = Everything.run::<Eight, Wendland>();
        assert_eq!(reference.len(), 4 * (12 + 8) + 1);
        assert_eq!(reference.first(), Some(&3.0_f32.to_bits()));
        assert_eq!(pass::run(Kernel::Wendland, Everything), reference);
    }

    /// Reads the second of two particles where there is one.
    struct Astray;

    impl Pass for Astray {
        type Out = f32;

        #[inline(always)]
        fn run<L: Lanes, P: Pair>(self) -> f32 {
            let mut eights = by_eights::<L>(&[1], 0, 2);
            L::gather(&[Node::default()], eights.next().expect("there is one"))[0].sum()
        }
    }

    #[test]
    #[should_panic(expected = "neighbours are particles")]
    fn a_neighbour_that_is_no_particle_is_refused() {
        pass::run(Kernel::Wendland, Astray);
    }

    /// What is larger and smaller where a NaN or zeros of both signs are compared, as bits.
    struct Odd;

    impl Pass for Odd {
        type Out = Vec<[u32; LANES]>;

        #[inline(always)]
        fn run<L: Lanes, P: Pair>(self) -> Vec<[u32; LANES]> {
            let (mut bits, odd) = (Vec::new(), [f32::NAN, 0.0, -0.0, 1.0, f32::INFINITY]);
            for a in odd {
                for b in odd {
                    let (a, b) = (L::splat(a), L::splat(b));
                    for row in [a.larger(b).row(), a.smaller(b).row()] {
                        let mut words = [0; LANES];
                        for lane in 0..LANES {
                            words[lane] = row[lane].to_bits();
                        }
                        bits.push(words);
                    }
                }
            }
            bits
        }
    }

    #[test]
    fn a_nan_is_let_through() {
        assert_eq!(pass::run(Kernel::Wendland, Odd), Odd.run::<Eight, Wendland>());
        let (zero, nan) = (Eight::splat(0.0), Eight::splat(f32::NAN));
        assert!(zero.larger(nan).sum().is_nan() && nan.larger(zero).sum() == 0.0);
        assert!(zero.smaller(nan).sum().is_nan() && nan.smaller(zero).sum() == 0.0);
        assert!(Eight::splat(f32::NAN).positive().sum().is_nan());
        assert_eq!(Eight::splat(-2.0).positive().sum(), 0.0);
    }
}
