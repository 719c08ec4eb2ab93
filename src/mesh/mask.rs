//! Masks of smoothing: how much each vertex is smoothed, by an attribute of the particles.

use super::{SmoothingMask, SurfaceError, transfer};
use crate::{
    frame::{ChannelData, Columns},
    math::Vec3,
};

impl SmoothingMask {
    /// The weight of the smoothing at some points [0..1], by the mean of the attribute within `radius` [m].
    ///
    /// # Errors
    /// [`SurfaceError::NoChannel`] if the particles lack the attribute.
    pub(super) fn weights(
        &self,
        particles: &Columns,
        points: &[Vec3],
        radius: f32,
    ) -> Result<Vec<f32>, SurfaceError> {
        let names = std::slice::from_ref(&self.attribute);
        let (columns, _) = transfer(particles, Some(names), points, radius)
            .map_err(|name| SurfaceError::no_channel(name, particles))?;
        Ok(columns.into_iter().next().map_or_else(Vec::new, |column| match column.data {
            ChannelData::F32(values) => values.iter().map(|&value| self.weight(value)).collect(),
            ChannelData::Vec3(values) => values.iter().map(|value| self.weight(value.norm())).collect(),
            ChannelData::U32(values) => values.iter().map(|&value| self.weight(value as f32)).collect(),
        }))
    }

    /// The weight of the smoothing at this value.
    fn weight(&self, value: f32) -> f32 {
        let weight = (value - self.none) / (self.full - self.none);
        if weight.is_nan() { 1.0 } else { weight.clamp(0.0, 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_rise_from_none_to_full_in_either_direction() {
        let weight =
            |none, full, value| SmoothingMask { attribute: "a".to_owned(), none, full }.weight(value);
        assert_eq!(
            [-1.0, 0.0, 0.25, 1.0, 9.0].map(|value| weight(0.0, 1.0, value)),
            [0.0, 0.0, 0.25, 1.0, 1.0]
        );
        assert_eq!([0.0, 1.0, 2.0, 3.0, 9.0].map(|value| weight(3.0, 1.0, value)), [1.0, 1.0, 0.5, 0.0, 0.0]);
        assert_eq!([1.0, 3.0, f32::NAN].map(|value| weight(2.0, 2.0, value)), [0.0, 1.0, 1.0]);
        assert_eq!(weight(0.0, 1.0, f32::NAN), 1.0);
    }
}
