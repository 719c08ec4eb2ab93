//! Observables: numbers that compare two runs of one shot.
//!
//! Each is a property of the whole liquid, defined at any spacing, and steadier than the path of a particle: splashing
//! liquid is chaotic, its bulk is not. Extents are percentiles, since the outermost particle is random.

use crate::{frame::Stream, math::Vec3, par};
use serde::{Deserialize, Serialize};

/// A property of the liquid that is compared between runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Observable {
    /// Extent along +x: the 99.9th percentile of the particles [m].
    FrontX,
    /// Extent along +y: the 99.9th percentile of the particles [m].
    FrontY,
    /// Extent along +z, the top of splashes: the 99.9th percentile of the particles [m].
    FrontZ,
    /// Height of the bulk: the 95th percentile of z [m].
    #[default]
    Height,
    /// Centre of mass along x [m].
    CenterX,
    /// Centre of mass along y [m].
    CenterY,
    /// Centre of mass along z [m].
    CenterZ,
    /// Kinetic energy of a kilogram of liquid [J/kg].
    KineticEnergy,
}

impl Observable {
    /// All observables.
    pub const ALL: [Self; 8] = [
        Self::FrontX,
        Self::FrontY,
        Self::FrontZ,
        Self::Height,
        Self::CenterX,
        Self::CenterY,
        Self::CenterZ,
        Self::KineticEnergy,
    ];

    /// Name of the observable in presets.
    pub fn name(self) -> &'static str {
        match self {
            Self::FrontX => "front_x",
            Self::FrontY => "front_y",
            Self::FrontZ => "front_z",
            Self::Height => "height",
            Self::CenterX => "center_x",
            Self::CenterY => "center_y",
            Self::CenterZ => "center_z",
            Self::KineticEnergy => "kinetic_energy",
        }
    }

    /// Unit of the observable.
    pub fn unit(self) -> &'static str {
        if self == Self::KineticEnergy { "J/kg" } else { "m" }
    }

    /// Value for the particles of `stream`; `None` without particles or without the channels it needs.
    pub fn of(self, stream: &Stream) -> Option<f64> {
        let x = stream.vec3("position").filter(|x| !x.is_empty())?;
        Some(match self {
            Self::FrontX => percentile(x, 0, 0.999),
            Self::FrontY => percentile(x, 1, 0.999),
            Self::FrontZ => percentile(x, 2, 0.999),
            Self::Height => percentile(x, 2, 0.95),
            Self::CenterX => mean(x, 0),
            Self::CenterY => mean(x, 1),
            Self::CenterZ => mean(x, 2),
            Self::KineticEnergy => {
                let v = stream.vec3("velocity")?;
                0.5 * par::sum(v.len(), |i| f64::from(v[i].norm_squared())) / v.len() as f64
            }
        })
    }
}

/// The coordinate that the fraction `part` of the particles does not exceed.
fn percentile(x: &[Vec3], axis: usize, part: f64) -> f64 {
    let mut values: Vec<f32> = x.iter().map(|x| x[axis]).collect();
    let rank = ((values.len() as f64 * part).ceil() as usize).clamp(1, values.len()) - 1;
    f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1)
}

fn mean(x: &[Vec3], axis: usize) -> f64 {
    par::sum(x.len(), |i| f64::from(x[i][axis])) / x.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::StreamKind;

    #[test]
    fn observables_have_their_defined_values() {
        let x: Vec<Vec3> = (1..=1000).map(|i| Vec3::new(i as f32, -2.0, i as f32 / 10.0)).collect();
        let v = vec![Vec3::new(0.0, 3.0, 4.0); 1000];
        let stream =
            Stream::new("liquid", StreamKind::Particles, 1000).with("position", x).with("velocity", v);
        let found = Observable::ALL.map(|observable| observable.of(&stream).unwrap() as f32);
        assert_eq!(found, [999.0, -2.0, 99.9, 95.0, 500.5, -2.0, 50.05, 12.5]);
        for observable in Observable::ALL {
            assert_eq!(observable.of(&Stream::new("liquid", StreamKind::Particles, 0)), None);
            assert_eq!(serde_json::to_value(observable).unwrap(), observable.name());
        }
        let alone =
            Stream::new("liquid", StreamKind::Particles, 1).with("position", vec![Vec3::new(1.0, 2.0, 3.0)]);
        assert_eq!(Observable::FrontX.of(&alone), Some(1.0));
        assert_eq!(Observable::KineticEnergy.of(&alone), None);
    }
}
