//! Numbers with units: `"2 cm"`, `"0.5 %"`, `"9.81 m/s²"`.
//!
//! A unit is a product of prefixed symbols with whole powers. It is read as a factor to SI and a vector of
//! powers of the base units; two units measure the same if the vectors agree. Angles and temperatures are
//! dimensions of their own, so that `"30 deg"` is refused where a bare number is expected.

use std::cmp::Ordering;

/// A number read with its unit, converted to the requested unit.
///
/// # Errors
/// [`UnitError`], with what was found.
pub(crate) fn convert(text: &str, wanted: Option<&str>) -> Result<f64, UnitError> {
    let (number, rest) = split_number(text.trim()).ok_or(UnitError::NoNumber)?;
    let rest = rest.trim();
    if rest.is_empty() {
        return Err(UnitError::NoUnit);
    }
    let found = parse(rest).ok_or_else(|| UnitError::Unknown(rest.to_owned()))?;
    let wanted = wanted.map_or_else(Unit::one, |unit| parse(unit).expect("units in the schema are known"));
    if found.powers != wanted.powers {
        return Err(UnitError::Other(rest.to_owned()));
    }
    let value = number * (found.up * wanted.down) / (found.down * wanted.up);
    if value.is_finite() { Ok(value) } else { Err(UnitError::NoNumber) }
}

/// Whether `unit` can be read.
pub(crate) fn is_known(unit: &str) -> bool {
    parse(unit).is_some()
}

/// Why a string is not a number of the requested unit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum UnitError {
    /// No finite number is at the beginning.
    NoNumber,
    /// A number in quotes without a unit.
    NoUnit,
    /// The unit is not known.
    Unknown(String),
    /// The unit measures something else.
    Other(String),
}

/// Powers of metre, kilogram, second, kelvin and radian.
type Powers = [i32; 5];

/// A factor to SI, kept as a quotient so that "7 %" is exactly 7/100, and what it measures.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Unit {
    up: f64,
    down: f64,
    powers: Powers,
}

impl Unit {
    fn one() -> Self {
        Self { up: 1.0, down: 1.0, powers: [0; 5] }
    }

    fn times(self, other: Self, power: i32) -> Self {
        let mut out = self;
        for _ in 0..power.unsigned_abs() {
            let (up, down) = if power > 0 { (other.up, other.down) } else { (other.down, other.up) };
            out.up *= up;
            out.down *= down;
        }
        for (sum, p) in out.powers.iter_mut().zip(other.powers) {
            *sum += p * power;
        }
        out
    }
}

/// Symbol, factor up, factor down, powers, whether prefixes apply.
const SYMBOLS: &[(&str, f64, f64, Powers, bool)] = &[
    ("m", 1.0, 1.0, [1, 0, 0, 0, 0], true),
    ("g", 1.0, 1e3, [0, 1, 0, 0, 0], true),
    ("t", 1e3, 1.0, [0, 1, 0, 0, 0], false),
    ("s", 1.0, 1.0, [0, 0, 1, 0, 0], true),
    ("min", 60.0, 1.0, [0, 0, 1, 0, 0], false),
    ("h", 3600.0, 1.0, [0, 0, 1, 0, 0], false),
    ("K", 1.0, 1.0, [0, 0, 0, 1, 0], true),
    ("rad", 1.0, 1.0, [0, 0, 0, 0, 1], true),
    ("deg", std::f64::consts::PI, 180.0, [0, 0, 0, 0, 1], false),
    ("°", std::f64::consts::PI, 180.0, [0, 0, 0, 0, 1], false),
    ("Hz", 1.0, 1.0, [0, 0, -1, 0, 0], true),
    ("N", 1.0, 1.0, [1, 1, -2, 0, 0], true),
    ("Pa", 1.0, 1.0, [-1, 1, -2, 0, 0], true),
    ("J", 1.0, 1.0, [2, 1, -2, 0, 0], true),
    ("W", 1.0, 1.0, [2, 1, -3, 0, 0], true),
    ("L", 1.0, 1e3, [3, 0, 0, 0, 0], true),
    ("l", 1.0, 1e3, [3, 0, 0, 0, 0], true),
    ("in", 254.0, 1e4, [1, 0, 0, 0, 0], false),
    ("ft", 3048.0, 1e4, [1, 0, 0, 0, 0], false),
    ("%", 1.0, 100.0, [0; 5], false),
    ("‰", 1.0, 1000.0, [0; 5], false),
    ("1", 1.0, 1.0, [0; 5], false),
];

const PREFIXES: &[(&str, f64, f64)] = &[
    ("n", 1.0, 1e9),
    ("µ", 1.0, 1e6),
    ("μ", 1.0, 1e6),
    ("u", 1.0, 1e6),
    ("m", 1.0, 1e3),
    ("c", 1.0, 1e2),
    ("d", 1.0, 10.0),
    ("h", 1e2, 1.0),
    ("k", 1e3, 1.0),
    ("M", 1e6, 1.0),
    ("G", 1e9, 1.0),
];

fn symbol(text: &str) -> Option<Unit> {
    let plain = |name: &str| SYMBOLS.iter().find(|entry| entry.0 == name);
    if let Some(&(_, up, down, powers, _)) = plain(text) {
        return Some(Unit { up, down, powers });
    }
    PREFIXES.iter().find_map(|&(prefix, up, down)| {
        let &(_, s_up, s_down, powers, prefixable) = plain(text.strip_prefix(prefix)?)?;
        prefixable.then_some(Unit { up: up * s_up, down: down * s_down, powers })
    })
}

/// A product of symbols: `kg/m³`, `N·s`, `m/s^2`, `m s⁻²`. A slash divides by everything up to the next one.
fn parse(text: &str) -> Option<Unit> {
    let mut unit = Unit::one();
    for (index, group) in text.split('/').enumerate() {
        let sign = if index == 0 { 1 } else { -1 };
        let mut terms =
            group.split(['·', '*', '⋅', ' ']).map(str::trim).filter(|term| !term.is_empty()).peekable();
        terms.peek()?;
        for term in terms {
            let (name, power) = split_power(term)?;
            unit = unit.times(symbol(name)?, sign * power);
        }
    }
    Some(unit)
}

/// A symbol and its power: `m²`, `s^-2`, `s⁻²`, `m3`, `kg`.
fn split_power(term: &str) -> Option<(&str, i32)> {
    const RAISED: &str = "⁰¹²³⁴⁵⁶⁷⁸⁹";
    let is_power = |c: char| c == '^' || c == '-' || c == '⁻' || c.is_ascii_digit() || RAISED.contains(c);
    let at = match term.find(is_power) {
        Some(0) => return (term == "1").then_some((term, 1)),
        Some(at) => at,
        None => return Some((term, 1)),
    };
    let digits: String = term[at..]
        .strip_prefix('^')
        .unwrap_or(&term[at..])
        .chars()
        .map(|c| match RAISED.chars().position(|raised| raised == c) {
            Some(digit) => char::from(b'0' + digit as u8),
            None if c == '⁻' => '-',
            None => c,
        })
        .collect();
    let power: i32 = digits.parse().ok()?;
    (power != 0 && power.abs() <= 9).then_some((&term[..at], power))
}

/// The longest decimal number that `text` begins with, and the rest.
fn split_number(text: &str) -> Option<(f64, &str)> {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(|b| b.is_ascii_digit() || *b == b'_') {
            at += 1;
        }
        at
    };
    let start = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let mut end = digits(start);
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        match digits(end + 1 + sign).cmp(&(end + 1 + sign)) {
            Ordering::Greater => end = digits(end + 1 + sign),
            Ordering::Equal | Ordering::Less => {}
        }
    }
    let number: f64 = text[..end].replace('_', "").parse().ok()?;
    number.is_finite().then_some((number, &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_convert_exactly() {
        let table = [
            ("0.5 %", None, 0.005),
            ("7 %", Some("1"), 0.07),
            ("5‰", Some("1"), 0.005),
            ("2 cm", Some("m"), 0.02),
            ("2cm", Some("m"), 0.02),
            ("250 mm", Some("m"), 0.25),
            ("1 km", Some("m"), 1000.0),
            ("3 µm", Some("m"), 3e-6),
            ("-1.5e2 cm", Some("m"), -1.5),
            ("1_000 mm", Some("m"), 1.0),
            ("10 in", Some("m"), 0.254),
            ("10 ft", Some("m"), 3.048),
            ("9.81 m/s²", Some("m/s²"), 9.81),
            ("9.81 m/s^2", Some("m/s²"), 9.81),
            ("9.81 m/s2", Some("m/s²"), 9.81),
            ("9.81 m s⁻²", Some("m/s²"), 9.81),
            ("981 cm/s²", Some("m/s²"), 9.81),
            ("36 km/h", Some("m/s"), 10.0),
            ("1 g/cm³", Some("kg/m³"), 1000.0),
            ("1000 kg/m^3", Some("kg/m³"), 1000.0),
            ("1 kg/L", Some("kg/m³"), 1000.0),
            ("1 mPa·s", Some("Pa·s"), 1e-3),
            ("1 kg/m/s", Some("Pa·s"), 1.0),
            ("72 mN/m", Some("N/m"), 0.072),
            ("180 deg", Some("rad"), std::f64::consts::PI),
            ("30°", Some("deg"), 30.0),
            ("250 ms", Some("s"), 0.25),
            ("2 min", Some("s"), 120.0),
            ("5 Hz", Some("1/s"), 5.0),
            ("1 s^-1", Some("1/s"), 1.0),
        ];
        for (text, wanted, expected) in table {
            let value = convert(text, wanted).unwrap();
            assert!((value - expected).abs() <= expected.abs() * 4.0 * f64::EPSILON, "{text} {value}");
        }
        assert_eq!(convert("7 %", None), Ok(0.07));
        assert_eq!(convert("2.15 cm", Some("m")), Ok(0.0215));
    }

    #[test]
    fn other_units_and_broken_numbers_are_refused() {
        let other = |unit: &str| Err(UnitError::Other(unit.to_owned()));
        let unknown = |unit: &str| Err(UnitError::Unknown(unit.to_owned()));
        assert_eq!(convert("2 s", Some("m")), other("s"));
        assert_eq!(convert("2 m", None), other("m"));
        assert_eq!(convert("30 deg", None), other("deg"));
        assert_eq!(convert("5 %", Some("m")), other("%"));
        assert_eq!(convert("2 m/s", Some("m/s²")), other("m/s"));
        for unit in
            ["parsec", "kmin", "c%", "m^0", "m^99", "m/", "/s", "m^", "^2", "2", "m²³³", "cm-", "e", "e5"]
        {
            assert!(matches!(convert(&format!("2 {unit}"), Some("m")), Err(UnitError::Unknown(_))), "{unit}");
        }
        assert_eq!(convert("2 parsec", Some("m")), unknown("parsec"));
        for text in ["", "cm", "nan m", "inf m", "1e999 m", "- m", ".", "e5 m"] {
            assert_eq!(convert(text, Some("m")), Err(UnitError::NoNumber), "{text}");
        }
        assert_eq!(convert("1e308 km", Some("nm")), Err(UnitError::NoNumber));
        assert_eq!(convert(" 2.5 ", Some("m")), Err(UnitError::NoUnit));
    }
}
