//! The transfer function of sRGB (IEC 61966-2-1), between linear light and stored values, both from 0 to 1.

use super::elementary::powf;

/// The stored value of linear light.
fn encoded(light: f32) -> f32 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * powf(light, 1.0 / 2.4) - 0.055 }
}

/// The linear light of a stored value.
pub(crate) fn decoded(value: f64) -> f32 {
    let light = if value <= 0.040_45 { value / 12.92 } else { powf((value + 0.055) / 1.055, 2.4) };
    light as f32
}

/// The byte that stores linear light; light beyond 0 to 1 has the nearest byte, and NaN 0.
pub(crate) fn to_byte(light: f32) -> u8 {
    (255.0 * encoded(light.clamp(0.0, 1.0)) + 0.5) as u8
}

/// The linear light that each byte stores.
pub(crate) fn linear_of_bytes() -> [f32; 256] {
    std::array::from_fn(|byte| decoded(byte as f64 / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_is_stored_again() {
        let light = linear_of_bytes();
        assert!((0..=255).all(|byte: u8| to_byte(light[usize::from(byte)]) == byte));
        assert_eq!((light[0], light[255]), (0.0, 1.0));
        // Middle grey of 18 % is stored as 118.
        assert_eq!(to_byte(0.18), 118);
        assert_eq!([-1.0, 7.0, f32::NAN].map(to_byte), [0, 255, 0]);
    }
}
