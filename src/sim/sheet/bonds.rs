//! Points that joints hold exactly: those that move as one, and pairs that keep a direction.
//!
//! *Method*: projections. What moved apart in a substep is put together at the mean by mass, positions and velocities alike, which keeps
//! momentum; of pairs with a direction n only the part across n is. The conjugate gradients are kept among motions that bonds
//! allow by a projection, too, as [baraff98] section 5.3 does it for single points; there all points weigh the same, so that it is orthogonal.
//!
//! Limits: a point has one bond with a direction, and then no other; what solids do to one end of such a pair turns it
//! until the next substep.

use super::{
    hold::{Held, Joined},
    lanes::Vectors,
};
use crate::math::{
    Vec3,
    wide::{WIDTH, Wide},
};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// The bonds that hold at a time.
#[derive(Clone, Debug, Default)]
pub(super) struct Bonds {
    groups: Vec<Group>,
    pairs: Vec<Pair>,
}

/// Vectors and what rounding took from them, if that is kept.
pub(super) struct Whole<'a> {
    pub(super) value: &'a mut Vectors,
    pub(super) low: Option<&'a mut Vectors>,
}

impl Whole<'_> {
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
struct Group {
    points: Vec<u32>,
    /// The one that a pin holds exactly, if there is one: the others go with it.
    led: Option<u32>,
}

/// Points whose difference is along `n`.
#[derive(Clone, Debug)]
struct Pair {
    ends: [u32; 2],
    /// Unit vector.
    n: Vec3,
}

/// A vector without its part along another.
fn across(d: Vector3<f64>, n: Vec3) -> Vector3<f64> {
    let n = n.cast();
    d - n * n.dot(&d)
}

impl Bonds {
    /// Those of joints without stiffness, as they are at `time` [s].
    pub(super) fn new(joined: &[Joined], held: &[Held], time: f64) -> Self {
        let exact = || joined.iter().filter(|joint| joint.stiffness.is_none() && joint.holds(time));
        let pairs =
            exact().filter_map(|joint| joint.direction.map(|n| Pair { ends: joint.ends, n })).collect();
        let groups = groups(exact().filter(|joint| joint.direction.is_none()).map(|joint| joint.ends));
        let pinned: Vec<u32> = held
            .iter()
            .filter(|pin| pin.stiffness.is_none() && pin.holds(time))
            .map(|pin| pin.point)
            .collect();
        let group = |points: Vec<u32>| {
            let led = points.iter().copied().find(|point| pinned.contains(point));
            Group { points, led }
        };
        Self { groups: groups.into_iter().map(group).collect(), pairs }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.groups.is_empty() && self.pairs.is_empty()
    }

    /// The points that go where a pin leads another.
    pub(super) fn led(&self) -> impl Iterator<Item = usize> {
        let groups = self.groups.iter().filter(|group| group.led.is_some());
        groups.flat_map(|group| &group.points).map(|&i| i as usize)
    }

    /// Makes vectors of points, velocities or positions, such as the bonds allow. `inverse`: 1/mass, zero of points that do not give way.
    pub(super) fn unite(&self, inverse: &[Wide], of: &mut Whole<'_>) {
        let weight = |i: u32| f64::from(inverse[i as usize / WIDTH][i as usize % WIDTH]);
        for Group { points, led } in &self.groups {
            let value = match led {
                Some(led) => of.get(*led as usize),
                None => {
                    let mass: f64 = points.iter().map(|&i| 1.0 / weight(i)).sum();
                    points.iter().map(|&i| of.get(i as usize) / weight(i)).sum::<Vector3<f64>>() / mass
                }
            };
            points.iter().for_each(|&i| of.set(i as usize, value));
        }
        for Pair { ends, n } in &self.pairs {
            let [a, b] = ends.map(|i| i as usize);
            let weights = ends.map(weight);
            let sum = weights[0] + weights[1];
            if sum > 0.0 {
                let off = across(of.get(b) - of.get(a), *n) / sum;
                of.set(a, of.get(a) + off * weights[0]);
                of.set(b, of.get(b) - off * weights[1]);
            }
        }
    }

    /// Takes from `out` what the bonds do not allow; orthogonal. `inverse`: zero of points that do not move.
    pub(super) fn filter(&self, inverse: &[Wide], out: &mut Vectors) {
        for group in self.groups.iter().filter(|group| group.led.is_none()) {
            let sum: Vector3<f64> = group.points.iter().map(|&i| out.get(i as usize).cast::<f64>()).sum();
            let mean = (sum / group.points.len() as f64).cast();
            group.points.iter().for_each(|&i| out.set(i as usize, mean));
        }
        for Pair { ends, n } in &self.pairs {
            let [a, b] = ends.map(|i| i as usize);
            let moves = ends.map(|i| inverse[i as usize / WIDTH][i as usize % WIDTH] > 0.0);
            let parts = [a, b].map(|i| across(out.get(i).cast(), *n));
            let common = if moves == [true, true] { (parts[0] + parts[1]) / 2.0 } else { Vector3::zeros() };
            for ((i, part), _) in [a, b].into_iter().zip(parts).zip(moves).filter(|(_, moves)| *moves) {
                out.add(i, (common - part).cast());
            }
        }
    }
}

/// The sets of points that chains of pairs connect, each ascending, by their first.
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
        // The least is the root, so that the order of joints does not matter.
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
