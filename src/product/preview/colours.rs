//! Linear colours of what previews show.

use crate::{
    frame::{COLOR, Channel, ChannelData},
    math::srgb,
};

/// Colliders that are not glass, in turn.
pub(super) const COLLIDERS: [[f32; 3]; 4] =
    [[0.46, 0.43, 0.39], [0.36, 0.41, 0.46], [0.44, 0.37, 0.34], [0.37, 0.43, 0.37]];

/// Rigid bodies, in turn.
pub(super) const BODIES: [[f32; 3]; 4] =
    [[0.62, 0.30, 0.10], [0.68, 0.46, 0.12], [0.48, 0.20, 0.11], [0.30, 0.36, 0.14]];

/// Front and back of meshes that are no closed body, in turn.
pub(super) const CLOTHS: [[[f32; 3]; 2]; 3] = [
    [[0.58, 0.13, 0.09], [0.62, 0.42, 0.30]],
    [[0.10, 0.28, 0.50], [0.42, 0.50, 0.58]],
    [[0.16, 0.38, 0.20], [0.50, 0.56, 0.40]],
];

/// Drops in the air, foam, bubbles; and points of an unknown kind.
pub(super) const POINTS: [[f32; 3]; 4] =
    [[0.92, 0.95, 0.97], [0.88, 0.91, 0.92], [0.62, 0.80, 0.86], [0.45, 0.68, 0.80]];

/// Colours of speeds from 0 to the largest, in sRGB: the map "viridis" (Smith and van der Walt), which is even for the eye and readable without
/// colours.
const SPEEDS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 74, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [110, 206, 88],
    [253, 231, 37],
];

/// Colours of speeds, as a table from 0 to the largest.
pub(super) struct SpeedColours {
    table: Vec<[f32; 3]>,
}

/// Steps of the table.
const STEPS: usize = 256;

impl SpeedColours {
    pub(super) fn new() -> Self {
        let colour = |step: usize| mixed(step as f64 / (STEPS - 1) as f64).map(linear);
        Self { table: (0..STEPS).map(colour).collect() }
    }

    /// The linear colour of a part of the largest speed; grey of NaN.
    pub(super) fn of(&self, part: f32) -> [f32; 3] {
        if part.is_nan() {
            [0.5; 3]
        } else {
            self.table[(part.clamp(0.0, 1.0) * (STEPS - 1) as f32) as usize]
        }
    }
}

/// The colour of a part of the largest speed in sRGB, for a legend.
pub(super) fn legend(part: f64) -> [u8; 3] {
    mixed(part).map(|x| (x + 0.5) as u8)
}

/// The colour of a part in sRGB, from 0 to 255.
fn mixed(part: f64) -> [f64; 3] {
    let place = part.clamp(0.0, 1.0) * (SPEEDS.len() - 1) as f64;
    let first = (place as usize).min(SPEEDS.len() - 2);
    let t = place - first as f64;
    std::array::from_fn(|k| {
        let [a, b] = [SPEEDS[first][k], SPEEDS[first + 1][k]].map(f64::from);
        a + t * (b - a)
    })
}

/// The colours among the attributes of vertices or points; empty if they have none.
pub(super) fn colours_in(attributes: &[Channel]) -> Vec<[f32; 3]> {
    let colours = attributes.iter().find_map(|channel| match &channel.data {
        ChannelData::Vec3(values) if channel.name == COLOR => Some(values),
        _ => None,
    });
    colours.map_or_else(Vec::new, |values| values.iter().map(|&colour| colour.into()).collect())
}

/// Linear light of a value in sRGB from 0 to 255.
fn linear(x: f64) -> f32 {
    srgb::decoded(x / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_from_the_first_to_the_last_and_no_number_is_grey() {
        let colours = SpeedColours::new();
        assert_eq!(legend(0.0), SPEEDS[0]);
        assert_eq!(legend(1.0), SPEEDS[SPEEDS.len() - 1]);
        assert_eq!(legend(0.5), SPEEDS[4]);
        assert_eq!((colours.of(f32::NAN), colours.of(7.0)), ([0.5; 3], colours.of(1.0)));
        assert!((colours.of(1.0)[0] - linear(253.0)).abs() < 1e-6 && (linear(255.0) - 1.0).abs() < 1e-6);
        let bright = |part: f32| colours.of(part).iter().sum::<f32>();
        assert!((1..10).all(|i| bright(i as f32 / 10.0) > bright((i - 1) as f32 / 10.0)));
    }
}
