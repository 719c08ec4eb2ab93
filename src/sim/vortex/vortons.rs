//! A set of vortons, and the range of their properties.

use crate::{math::Vec3, par, sim::Diverged};

/// The smallest core [m]. Sums over smaller cores would overflow single precision where vortons come close.
pub const MIN_CORE: f32 = 1e-6;

/// The largest coordinate and core [m], and the largest strength [m³/s]. Larger values are considered a
/// mistake.
pub const MAX_MAGNITUDE: f32 = 1e9;

/// Vortex particles, one column per property, all of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vortons {
    /// The positions [m].
    pub position: Vec<Vec3>,
    /// Γ = ω V: vorticity times volume [m³/s].
    pub strength: Vec<Vec3>,
    /// σ: the size of the core [m], at least [`MIN_CORE`].
    pub core: Vec<f32>,
}

/// Kind of an element that is out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Vortons.
    Vortons,
    /// Points at which velocities are requested.
    Points,
    /// Source panels with the spin of solids.
    Panels,
}

/// A vorton, point or panel that is out of the range of single-precision sums.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("number {index} of the {} has {what}", kind.name())]
pub struct OutOfRange {
    /// Kind of the element.
    pub kind: ElementKind,
    /// Index of the first such element.
    pub index: usize,
    /// The value that was found, and the range.
    pub what: String,
}

impl ElementKind {
    fn name(self) -> &'static str {
        match self {
            Self::Vortons => "vortons",
            Self::Points => "points",
            Self::Panels => "panels of solids that turn",
        }
    }
}

impl OutOfRange {
    /// The error that ends a substep of smoke. Vortons have these `ids`, the message calls points `points`,
    /// and `limits` are the settings to change, except for panels.
    pub(in crate::sim) fn diverged(
        &self,
        substep: u32,
        ids: &[u32],
        points: &'static str,
        limits: &'static str,
    ) -> Diverged {
        let index = self.index as u32;
        let (particle, of, try_next) = match self.kind {
            ElementKind::Vortons => (ids.get(self.index).copied().unwrap_or(index), "", limits),
            ElementKind::Points => (index, points, limits),
            ElementKind::Panels => (index, self.kind.name(), "slower turns in the keyframes of colliders"),
        };
        let what = if of.is_empty() {
            format!("has {}", self.what)
        } else {
            format!("of the {of} has {}", self.what)
        };
        Diverged { system: "smoke", substep, particle, what, try_next }
    }
}

impl Vortons {
    /// The number of vortons.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are no vortons.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Checks that every vorton is in range.
    ///
    /// # Errors
    /// [`OutOfRange`], for the first vorton with a coordinate or a strength that is NaN or larger than
    /// [`MAX_MAGNITUDE`], or with a core that is not between [`MIN_CORE`] and that.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let count = self.len();
        assert!(self.strength.len() == count && self.core.len() == count, "a column for every property");
        let refuse = |index: usize, what: String| Err(OutOfRange { kind: ElementKind::Vortons, index, what });
        if let Some(index) = first(count, |i| !within(self.position[i])) {
            return refuse(index, outside("position", self.position[index], "m"));
        }
        if let Some(index) = first(count, |i| !within(self.strength[i])) {
            return refuse(index, outside("strength", self.strength[index], "m³/s"));
        }
        if let Some(index) = first(count, |i| !(MIN_CORE..=MAX_MAGNITUDE).contains(&self.core[i])) {
            let what = format!("a core of {} m, not in {MIN_CORE:e}..{MAX_MAGNITUDE:e} m", self.core[index]);
            return refuse(index, what);
        }
        Ok(())
    }
}

/// Checks that every point is in range.
pub(super) fn check_points(points: &[Vec3]) -> Result<(), OutOfRange> {
    first(points.len(), |i| !within(points[i])).map_or(Ok(()), |index| {
        Err(OutOfRange { kind: ElementKind::Points, index, what: outside("position", points[index], "m") })
    })
}

fn within(v: Vec3) -> bool {
    v.iter().all(|c| c.abs() <= MAX_MAGNITUDE)
}

fn outside(name: &str, v: Vec3, unit: &str) -> String {
    format!("the {name} ({}, {}, {}) {unit}, beyond {MAX_MAGNITUDE:e}", v.x, v.y, v.z)
}

/// First index for which `is_out_of_range` holds.
fn first(count: usize, is_out_of_range: impl Fn(usize) -> bool + Sync) -> Option<usize> {
    par::map_chunks(count, 1 << 14, |mut range| range.find(|&i| is_out_of_range(i)))
        .into_iter()
        .flatten()
        .next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_and_values_out_of_range_are_reported() {
        let fit = Vortons {
            position: vec![Vec3::zeros(); 3],
            strength: vec![Vec3::zeros(); 3],
            core: vec![0.1; 3],
        };
        assert_eq!(fit.check(), Ok(()));
        let spoiled = |spoil: fn(&mut Vortons)| {
            let mut vortons = fit.clone();
            spoil(&mut vortons);
            vortons.check().map_err(|error| (error.index, error.what.split(' ').nth(1).unwrap().to_owned()))
        };
        let named = |index: usize, name: &str| Err((index, name.to_owned()));
        assert_eq!(spoiled(|v| v.position[1].y = f32::NAN), named(1, "position"));
        assert_eq!(spoiled(|v| v.position[0].y = 2.0 * MAX_MAGNITUDE), named(0, "position"));
        assert_eq!(spoiled(|v| v.strength[2].z = f32::INFINITY), named(2, "strength"));
        assert_eq!(spoiled(|v| v.core[2] = f32::NAN), named(2, "core"));
        assert_eq!(spoiled(|v| v.core[1] = 0.0), named(1, "core"));
        assert!(check_points(&[Vec3::zeros(), Vec3::repeat(f32::NAN)]).is_err_and(|error| error.index == 1));
    }
}
