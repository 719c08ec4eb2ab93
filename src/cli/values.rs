//! How the values of flags are read: frames, sizes, times, formats.

use crate::{
    export::{
        MeshFormat, SheetFormat,
        usd::{NameScheme, SCALE_RANGE, UpAxis},
        vdb::VolumeGrid,
    },
    preset::units,
    scene::Frames,
};
use std::time::Duration;

pub(super) fn frames(text: &str) -> Result<Frames, String> {
    text.parse().map_err(|why: crate::scene::FramesError| why.to_string())
}

pub(super) fn volume_grid(text: &str) -> Result<VolumeGrid, String> {
    VolumeGrid::from_name(text).ok_or_else(|| {
        let names: Vec<&str> = VolumeGrid::ALL.iter().map(|grid| grid.name()).collect();
        format!("expected one of {}", names.join(", "))
    })
}

pub(super) fn mesh_format(text: &str) -> Result<MeshFormat, String> {
    MeshFormat::from_extension(text).ok_or_else(|| "expected ply or obj".into())
}

pub(super) fn sheet_format(text: &str) -> Result<SheetFormat, String> {
    SheetFormat::ALL
        .into_iter()
        .find(|format| format.name() == text)
        .ok_or_else(|| "expected pc2, ply or obj".into())
}

pub(super) fn up_axis(text: &str) -> Result<UpAxis, String> {
    let found = UpAxis::ALL.into_iter().find(|axis| axis.name().eq_ignore_ascii_case(text));
    found.ok_or_else(|| "expected y or z".into())
}

/// Units of a stage in a metre.
pub(super) fn scale(text: &str) -> Result<f64, String> {
    let (min, max) = (SCALE_RANGE.start(), SCALE_RANGE.end());
    let found = text.trim().parse().ok().filter(|scale| SCALE_RANGE.contains(scale));
    found.ok_or_else(|| format!("expected units in a metre, {min} to {max}, such as 100 for centimetres"))
}

pub(super) fn name_scheme(text: &str) -> Result<NameScheme, String> {
    let named = NameScheme::ALL.into_iter().filter(|&scheme| scheme != NameScheme::Usd);
    named.into_iter().find(|scheme| scheme.name() == text).ok_or_else(|| "expected houdini or maya".into())
}

/// A spacing of particles [m], whose range is checked where it is used.
pub(super) fn spacing(text: &str) -> Result<f32, String> {
    if let Ok(metres) = text.trim().parse() {
        return Ok(metres);
    }
    units::convert(text, Some("m")).map(|metres| metres as f32).map_err(|_| {
        "expected metres above 0, or a number with a unit of length: 0.02, \"2 cm\", 20mm".into()
    })
}

/// A thickness [m].
pub(super) fn thickness(text: &str) -> Result<f32, String> {
    let metres = text.parse().ok().filter(|metres: &f32| *metres > 0.0 && metres.is_finite());
    metres.ok_or_else(|| "expected metres above zero, such as 0.002".into())
}

/// A time [s] with a unit.
pub(super) fn time(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match text[digits.len()..].to_ascii_lowercase().as_str() {
        "" | "s" | "sec" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        "d" => 86400.0,
        unit => return Err(format!("unknown unit {unit:?}; expected a time such as 90s, 10min or 2h")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number * factor),
        _ => Err("expected a time such as 90s, 10min or 2h".into()),
    }
}

/// The longest wait.
const MAX_WAIT: Duration = Duration::from_secs(365 * 86400);

/// A time to wait.
pub(super) fn wait(text: &str) -> Result<Duration, String> {
    let wait = Duration::try_from_secs_f64(time(text)?).ok().filter(|wait| *wait <= MAX_WAIT);
    wait.ok_or_else(|| "expected at most 365d".into())
}

/// A fraction, maybe in per cent.
pub(super) fn fraction(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (digits, factor) = text.strip_suffix('%').map_or((text, 1.0), |digits| (digits, 0.01));
    match digits.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number * factor <= 1.0 => Ok(number * factor),
        _ => Err("expected a part such as 0.5% or 0.005".into()),
    }
}

/// A number of bytes with a unit.
pub(super) fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match text[digits.len()..].to_ascii_lowercase().as_str() {
        "k" | "kib" => 1 << 10,
        "m" | "mib" => 1 << 20,
        "g" | "gib" => 1_u64 << 30,
        "t" | "tib" => 1 << 40,
        "kb" => 1000,
        "mb" => 1_000_000,
        "gb" => 1_000_000_000,
        "b" | "" => 1,
        unit => return Err(format!("unknown unit {unit:?}; expected a size such as 8GiB or 500MiB")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok((number * factor as f64) as u64),
        _ => Err("expected a size such as 8GiB or 500MiB".into()),
    }
}

/// Width and height of a picture [pixels], each in this range: smaller ones have no place for anything, and larger ones take gigabytes.
const PICTURE_SIDES: std::ops::RangeInclusive<usize> = 16..=4096;

/// Width and height of a picture [pixels].
pub(super) fn picture_size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once(['x', 'X', '×']);
    let side = |text: &str| text.trim().parse().ok().filter(|side| PICTURE_SIDES.contains(side));
    sides.and_then(|(width, height)| Some([side(width)?, side(height)?])).ok_or_else(|| {
        let (min, max) = (PICTURE_SIDES.start(), PICTURE_SIDES.end());
        format!("expected width and height from {min} to {max} pixels, such as 960x540")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_fractions_carry_units() {
        assert_eq!(["90", "90s", "10 min", "2h"].map(time), [90.0, 90.0, 600.0, 7200.0].map(Ok));
        assert_eq!((fraction("0.5%"), fraction("0.02")), (Ok(0.005), Ok(0.02)));
        for wrong in ["", "s", "-1s", "0", "2 parsecs", "inf"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
        assert_eq!(wait("2h"), Ok(Duration::from_secs(7200)));
        assert!(wait("1e300").is_err() && wait("366d").is_err() && wait("1e-300").is_ok());
        for wrong in ["", "%", "-1%", "0", "200%", "nan"] {
            assert!(fraction(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn spacings_carry_units_of_length() {
        for text in ["0.02", "2 cm", "2cm", " 20 mm ", "2e-2"] {
            assert_eq!(spacing(text), Ok(0.02), "{text}");
        }
        assert_eq!(spacing("1 in"), Ok(0.0254));
        for wrong in ["", "cm", "2 s", "2 parsecs", "2 cm²", "two", "2 %"] {
            assert!(spacing(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_of_pictures_are_two_numbers_of_pixels() {
        assert_eq!([picture_size("960x540"), picture_size(" 16 × 4096")], [Ok([960, 540]), Ok([16, 4096])]);
        for wrong in ["", "960", "x", "960x", "15x540", "960x4097", "-960x540", "1e3x540", "960x540x3"] {
            assert!(picture_size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_carry_units() {
        assert_eq!(size("8GiB"), Ok(8 << 30));
        assert_eq!(size("1.5k"), Ok(1536));
        assert_eq!(size("500MB"), Ok(500_000_000));
        for wrong in ["", "GiB", "-1GiB", "8 parsecs", "nan"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
