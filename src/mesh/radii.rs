//! Radii of particles, as factors of their kernels.

use super::{RadiusSource, SurfaceError, SurfaceParams};
use crate::{
    frame::{Column, Columns},
    par,
};

/// Names of the attribute, in upper or lower case; the first that is present counts.
const NAMES: [&str; 3] = ["radius", "pscale", "radii"];

/// Smallest and largest scale of a kernel. Smaller particles would fall between the nodes of usual grids; the time of larger ones
/// grows with the cube.
const RANGE: [f32; 2] = [0.25, 4.0];

/// Radii of particles over half the spacing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RadiusScales {
    /// One for each particle, within the range of scales.
    pub(crate) values: Vec<f32>,
    /// Particles whose radius was out of that range.
    pub(crate) limited: usize,
}

impl RadiusScales {
    /// The scales that the parameters request; `None`: every particle has half the spacing.
    ///
    /// # Errors
    /// [`SurfaceError::NoRadius`] if the particles have no radius.
    pub(crate) fn of<'a>(
        particles: impl Into<Columns<'a>>,
        spacing: f32,
        params: &SurfaceParams,
    ) -> Result<Option<Self>, SurfaceError> {
        let Some(RadiusSource::Attribute) = params.radius else { return Ok(None) };
        let particles = particles.into();
        let named = |name: &str| {
            let mut columns = particles.columns().iter();
            columns.find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|&(_, column)| column)
        };
        let inverse = 2.0 / spacing;
        let scales: Vec<f32> =
            match NAMES.into_iter().filter_map(named).find(|data| !matches!(data, Column::Vec3(_))) {
                Some(Column::F32(radii)) => radii.iter().map(|radius| radius * inverse).collect(),
                Some(Column::U32(radii)) => radii.iter().map(|&radius| radius as f32 * inverse).collect(),
                _ => return Err(SurfaceError::NoRadius),
            };
        let [min, max] = RANGE;
        let is_out = |i: usize| f64::from(u8::from(!(min..=max).contains(&scales[i])));
        let limited = par::sum(scales.len(), is_out) as usize;
        // NaN becomes the smallest.
        let values = scales.into_iter().map(|scale| scale.max(min).min(max)).collect();
        Ok(Some(Self { values, limited }))
    }

    /// The largest scale; 1 without particles.
    pub(crate) fn largest(&self) -> f32 {
        par::max(self.values.len(), |i| self.values[i]).map_or(1.0, |(_, scale)| scale)
    }

    /// Mean volume of a particle [spacing³].
    pub(crate) fn mean_volume(&self) -> f64 {
        let count = self.values.len().max(1) as f64;
        par::sum(self.values.len(), |i| f64::from(self.values[i]).powi(3)) / count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::{ChannelData, Stream, StreamKind},
        math::Vec3,
    };

    #[test]
    fn radii_are_scales_within_their_range() {
        let stream = |name: &str, data: ChannelData| {
            let len = data.len();
            Stream::new("particles", StreamKind::Particles, len)
                .with("position", vec![Vec3::zeros(); len])
                .with(name, data)
        };
        let params = SurfaceParams { radius: Some(RadiusSource::Attribute), ..SurfaceParams::default() };
        let radii = vec![0.05, 0.1, 0.2, 0.21, 0.0125, 0.0, -1.0, f32::NAN];
        for name in ["radius", "PScale", "radii"] {
            let found = RadiusScales::of(&stream(name, radii.clone().into()), 0.1, &params).unwrap().unwrap();
            assert_eq!(found.values, [1.0, 2.0, 4.0, 4.0, 0.25, 0.25, 0.25, 0.25]);
            assert_eq!((found.limited, found.largest()), (4, 4.0));
        }
        let whole =
            RadiusScales::of(&stream("pscale", vec![1_u32, 2].into()), 2.0, &params).unwrap().unwrap();
        assert_eq!((whole.values.as_slice(), whole.mean_volume()), (&[1.0, 2.0][..], 4.5));
        let other = stream("pscale", vec![Vec3::zeros()].into());
        assert_eq!(RadiusScales::of(&other, 0.1, &params), Err(SurfaceError::NoRadius));
        assert_eq!(RadiusScales::of(&other, 0.1, &SurfaceParams::default()), Ok(None));
    }
}
