//! Translation of parts of the sheets that no pin holds.
//!
//! *Method*: springs do not resist a translation, so the rows of A (`implicit.rs`) over a part sum to its
//! inertia and what holds it. The translation that the conjugate gradients leave out is therefore known
//! without them, and momentum does not depend on their tolerance. It is the correction of [baraff98] Eq. 6 in
//! the space of translations alone.
//!
//! Symbols: A → [`Matrix`], b → `right`.
//! Limits: parts are sheets and what joints connect. A mesh of several connected components is one part: if
//! one component is held exactly, none is moved.

use super::{
    constraints::JointPair,
    implicit::{FreePart, Matrix},
    vectors::Vectors,
};
use crate::{
    par::{self, Forest},
    simd::{F32x8, LANES},
};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// The parts without a point that is held exactly, of sheets with these ranges of points and these joints.
pub(super) fn free_parts<'a>(
    ranges: &[Range<usize>],
    joints: impl Iterator<Item = &'a JointPair>,
    inverse: &[F32x8],
) -> Vec<FreePart> {
    let sheets = Forest::new(ranges.len());
    let of = |point: u32| ranges.partition_point(|range| range.end <= point as usize) as u32;
    joints.for_each(|joint| sheets.join(of(joint.ends[0]), of(joint.ends[1])));
    let roots = sheets.roots();
    let mut all: Vec<FreePart> = vec![Vec::new(); ranges.len()];
    roots.iter().zip(ranges).for_each(|(&root, range)| all[root as usize].push(range.clone()));
    let mobile =
        |part: &FreePart| part.iter().flat_map(Range::clone).all(|i| inverse.as_flattened()[i] > 0.0);
    all.retain(|part| !part.is_empty() && mobile(part));
    all
}

impl Matrix<'_> {
    /// Adds to `v`, an approximate solution of A v = b, the missing translation of each part.
    pub(super) fn translate(&self, right: &Vectors, v: &mut Vectors) {
        for part in self.free_parts {
            let (mut weight, mut missing) = (Matrix3::zeros(), Vector3::zeros());
            for range in part {
                let sums = par::map_chunks(range.len(), par::CHUNK, |points| {
                    points.fold((Matrix3::zeros(), Vector3::zeros()), |(weight, missing), i| {
                        let own = self.row_sum(range.start + i);
                        let [b, v] = [right, &*v].map(|of| of.get(range.start + i).cast::<f64>());
                        (weight + own, missing + b - own * v)
                    })
                });
                for (own, residual) in sums {
                    weight += own;
                    missing += residual;
                }
            }
            let Some(inverse) = weight.try_inverse() else { continue };
            let shift = (inverse * missing).cast::<f32>();
            part.iter().flat_map(Range::clone).for_each(|i| v.add(i, shift));
        }
    }

    /// Sum of a row of A: inertia, and the stiffness of pins.
    fn row_sum(&self, i: usize) -> Matrix3<f64> {
        let [xx, yy, zz, xy, xz, yz] = std::array::from_fn(|k| {
            self.blocks.get(i / LANES).map_or(0.0, |block| f64::from(block[k][i % LANES]))
        });
        let inertia = f64::from(self.inertia(i / LANES)[i % LANES]);
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) + Matrix3::from_diagonal_element(inertia)
    }
}
