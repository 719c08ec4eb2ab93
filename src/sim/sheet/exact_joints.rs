//! Joints without stiffness: points that move as one, and pairs that keep a direction.
//!
//! *Method*: projections. Joined points that separated in a substep are moved to their mean by mass,
//! positions and velocities alike, which conserves momentum. For pairs with a direction n only the part
//! across n is. The conjugate gradients stay in the space of motions that exact joints allow, also by a
//! projection, as [baraff98] section 5.3 does for single points. There all points have the same weight, so
//! that the projection is orthogonal.
//!
//! Limits: a point has at most one joint with a direction, and then no other exact joint. If a solid moves
//! one end of such a pair, the pair is turned until the next substep.

use super::{
    constraints::{JointPair, PinnedPoint},
    vectors::Vectors,
};
use crate::{
    math::Vec3,
    simd::{F32x8, LANES},
};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// The exact joints that hold at a time.
#[derive(Clone, Debug, Default)]
pub(super) struct ExactJoints {
    groups: Vec<JointGroup>,
    pairs: Vec<DirectionPair>,
}

/// Vectors and their rounding errors, if these are kept.
pub(super) struct CompensatedVectors<'a> {
    pub(super) value: &'a mut Vectors,
    pub(super) low: Option<&'a mut Vectors>,
}

impl CompensatedVectors<'_> {
    fn get(&self, i: usize) -> Vector3<f64> {
        let low = self.low.as_ref().map_or(Vec3::zeros(), |low| low.get(i));
        self.value.get(i).cast::<f64>() + low.cast()
    }

    fn set(&mut self, i: usize, value: Vector3<f64>) {
        let rounded: Vec3 = value.cast();
        self.value.set(i, rounded);
        if let Some(low) = &mut self.low {
            low.set(i, (value - rounded.cast()).cast());
        }
    }
}

/// Points that move as one.
#[derive(Clone, Debug)]
struct JointGroup {
    points: Vec<u32>,
    /// The point that a pin holds exactly, if there is one; the others follow it.
    pinned: Option<u32>,
}

/// Two points whose difference is along `n`.
#[derive(Clone, Debug)]
struct DirectionPair {
    ends: [u32; 2],
    /// Unit vector.
    n: Vec3,
}

/// A vector without its component along `n`.
fn across(d: Vector3<f64>, n: Vec3) -> Vector3<f64> {
    let n = n.cast();
    d - n * n.dot(&d)
}

impl ExactJoints {
    /// The joints without stiffness that hold at `time` [s].
    pub(super) fn new(joints: &[JointPair], pins: &[PinnedPoint], time: f64) -> Self {
        let exact = || joints.iter().filter(|joint| joint.stiffness.is_none() && joint.holds(time));
        let pairs = exact()
            .filter_map(|joint| joint.direction.map(|n| DirectionPair { ends: joint.ends, n }))
            .collect();
        let groups = groups(exact().filter(|joint| joint.direction.is_none()).map(|joint| joint.ends));
        let pinned_points: Vec<u32> = pins
            .iter()
            .filter(|pin| pin.stiffness.is_none() && pin.holds(time))
            .map(|pin| pin.point)
            .collect();
        let group = |points: Vec<u32>| {
            let pinned = points.iter().copied().find(|point| pinned_points.contains(point));
            JointGroup { points, pinned }
        };
        Self { groups: groups.into_iter().map(group).collect(), pairs }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.groups.is_empty() && self.pairs.is_empty()
    }

    /// The points that follow a pinned point.
    pub(super) fn followers(&self) -> impl Iterator<Item = usize> {
        let groups = self.groups.iter().filter(|group| group.pinned.is_some());
        groups.flat_map(|group| &group.points).map(|&i| i as usize)
    }

    /// Projects positions or velocities to those that the joints allow. `inverse`: 1/mass, zero for points
    /// that cannot move.
    pub(super) fn project(&self, inverse: &[F32x8], of: &mut CompensatedVectors<'_>) {
        let weight = |i: u32| f64::from(inverse[i as usize / LANES][i as usize % LANES]);
        for JointGroup { points, pinned } in &self.groups {
            let value = match pinned {
                Some(pinned) => of.get(*pinned as usize),
                None => {
                    let mass: f64 = points.iter().map(|&i| 1.0 / weight(i)).sum();
                    points.iter().map(|&i| of.get(i as usize) / weight(i)).sum::<Vector3<f64>>() / mass
                }
            };
            points.iter().for_each(|&i| of.set(i as usize, value));
        }
        for DirectionPair { ends, n } in &self.pairs {
            let [a, b] = ends.map(|i| i as usize);
            let weights = ends.map(weight);
            let sum = weights[0] + weights[1];
            if sum > 0.0 {
                let correction = across(of.get(b) - of.get(a), *n) / sum;
                of.set(a, of.get(a) + correction * weights[0]);
                of.set(b, of.get(b) - correction * weights[1]);
            }
        }
    }

    /// Removes from `out` what the joints do not allow, by an orthogonal projection. `inverse`: zero for
    /// points that cannot move.
    pub(super) fn filter(&self, inverse: &[F32x8], out: &mut Vectors) {
        for group in self.groups.iter().filter(|group| group.pinned.is_none()) {
            let sum: Vector3<f64> = group.points.iter().map(|&i| out.get(i as usize).cast::<f64>()).sum();
            let mean = (sum / group.points.len() as f64).cast();
            group.points.iter().for_each(|&i| out.set(i as usize, mean));
        }
        for DirectionPair { ends, n } in &self.pairs {
            let [a, b] = ends.map(|i| i as usize);
            let moves = ends.map(|i| inverse[i as usize / LANES][i as usize % LANES] > 0.0);
            let parts = [a, b].map(|i| across(out.get(i).cast(), *n));
            let common = if moves == [true, true] { (parts[0] + parts[1]) / 2.0 } else { Vector3::zeros() };
            for ((i, part), _) in [a, b].into_iter().zip(parts).zip(moves).filter(|(_, moves)| *moves) {
                out.add(i, (common - part).cast());
            }
        }
    }
}

/// Sets of points that chains of pairs connect, each in ascending order, by their first point.
pub(super) fn groups(pairs: impl Iterator<Item = [u32; 2]>) -> Vec<Vec<u32>> {
    let mut parent: BTreeMap<u32, u32> = BTreeMap::new();
    fn root(parent: &BTreeMap<u32, u32>, mut i: u32) -> u32 {
        while let Some(&up) = parent.get(&i).filter(|&&up| up != i) {
            i = up;
        }
        i
    }
    for ends in pairs {
        let roots = ends.map(|i| {
            parent.entry(i).or_insert(i);
            root(&parent, i)
        });
        // The lowest point is the root, so that the order of joints does not matter.
        parent.insert(roots[0].max(roots[1]), roots[0].min(roots[1]));
    }
    let mut sets: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &i in parent.keys() {
        sets.entry(root(&parent, i)).or_default().push(i);
    }
    sets.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_of_pairs_are_one_group_in_any_order() {
        let pairs = [[7, 3], [1, 2], [3, 9], [2, 5], [9, 7]];
        let expected = vec![vec![1, 2, 5], vec![3, 7, 9]];
        assert_eq!(groups(pairs.into_iter()), expected);
        assert_eq!(groups(pairs.into_iter().rev()), expected);
    }
}
