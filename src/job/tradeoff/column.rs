//! Columns of a tradeoff's table.
//!
//! A column is declared once: its key, heading, unit, meaning, value, and whether it is an error. The terminal's table,
//! the page, the plot, CSV, JSON, `--by` and its help are loops over these declarations.

use crate::job::usage::duration;
use crate::math::elementary::log10;
use serde::Serialize;

/// The median of some values and their range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    /// The median.
    pub median: f64,
    /// The smallest.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Of some values; `None` of none.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let half = sorted.len() / 2;
        let median =
            if sorted.len() % 2 == 1 { sorted[half] } else { 0.5 * (sorted[half - 1] + sorted[half]) };
        Some(Self { median, min, max })
    }

    /// These times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { median: factor * self.median, min: factor * self.min, max: factor * self.max }
    }

    /// Of one value.
    pub(crate) fn exact(value: f64) -> Self {
        Self { median: value, min: value, max: value }
    }
}

/// The unit that a column's values are stored in, and the one that people read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unit {
    /// A whole number.
    Count,
    /// A mean of whole numbers.
    Mean,
    /// A fraction, shown in per cent.
    Percent,
    /// A relative change, shown in per cent with its sign.
    Change,
    /// Times of the repeats [s], with their range.
    Seconds,
    /// A long time [s].
    Duration,
    /// Bytes, shown in MiB.
    Mebibytes,
    /// Bytes, shown in MB.
    Megabytes,
    /// A length [m], shown in mm.
    Millimetres,
    /// A length [m], shown in particle spacings.
    Spacings,
    /// An angle [deg].
    Degrees,
    /// Grid cells.
    Voxels,
    /// Any other unit, shown as it is stored.
    Of(&'static str),
}

impl Unit {
    /// The factor from the stored unit to the one that people read, where particles rest `spacing` apart [m], and its symbol.
    fn shown(self, spacing: f64) -> (f64, &'static str) {
        match self {
            Self::Count | Self::Mean => (1.0, ""),
            Self::Percent | Self::Change => (100.0, "%"),
            Self::Seconds | Self::Duration => (1.0, "s"),
            Self::Mebibytes => (1.0 / f64::from(1 << 20), "MiB"),
            Self::Megabytes => (1e-6, "MB"),
            Self::Millimetres => (1e3, "mm"),
            Self::Spacings => (1.0 / spacing, "spacings"),
            Self::Degrees => (1.0, "°"),
            Self::Voxels => (1.0, "voxels"),
            Self::Of(symbol) => (1.0, symbol),
        }
    }

    /// That factor.
    pub(crate) fn scale(self, spacing: f64) -> f64 {
        self.shown(spacing).0
    }

    /// That symbol.
    pub(crate) fn symbol(self) -> &'static str {
        self.shown(1.0).1
    }

    /// A value with so many significant digits.
    pub(crate) fn show(self, value: f64, digits: i32, spacing: f64) -> String {
        let scaled = value * self.scale(spacing);
        match self {
            Self::Count | Self::Mean | Self::Mebibytes => format!("{scaled:.0}"),
            Self::Duration => duration(value),
            Self::Change => format!("{scaled:+.2} %"),
            Self::Degrees => format!("{}°", figure(scaled, digits)),
            Self::Percent | Self::Millimetres | Self::Of(_) => {
                format!("{} {}", figure(scaled, digits), self.symbol())
            }
            Self::Seconds | Self::Megabytes | Self::Spacings | Self::Voxels => figure(scaled, digits),
        }
    }

    /// Whether stored values are whole numbers.
    pub(crate) fn is_whole(self) -> bool {
        matches!(self, Self::Count | Self::Mebibytes | Self::Megabytes)
    }
}

/// From here on figures have an exponent: their digits would be those of rounding.
const MAX_PLAIN: f64 = 1e9;

/// A number with so many significant digits, without trailing zeros.
pub(crate) fn figure(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    if value.abs() >= MAX_PLAIN {
        return format!("{value:.*e}", digits.max(1) as usize - 1);
    }
    let decimals = (digits - 1 - log10(value.abs()).floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// A volume [m³] in the unit in which it is neither tiny nor huge.
pub(crate) fn readable_volume(cubic_metres: f64, digits: i32) -> String {
    let (unit, size) = match cubic_metres.abs() {
        v if v < 1e-7 && v > 0.0 => ("mm³", 1e-9),
        v if v < 1e-4 && v > 0.0 => ("mL", 1e-6),
        v if v < 0.1 && v > 0.0 => ("L", 1e-3),
        _ => ("m³", 1.0),
    };
    format!("{} {unit}", figure(cubic_metres / size, digits))
}

/// Where a column is shown. CSV and JSON have all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Shown {
    /// In the terminal and on the page.
    Everywhere,
    /// On the page.
    Page,
    /// Only in CSV and JSON.
    Data,
}

/// Description of a column, without its measurement.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ColumnInfo {
    /// Name in JSON, where a dot opens a group, and in CSV.
    pub key: &'static str,
    /// Heading in the table.
    pub heading: &'static str,
    /// Unit of the values.
    pub unit: Unit,
    /// Meaning, in a line.
    pub meaning: &'static str,
    /// Tables that show the column.
    pub shown: Shown,
    /// Whether it is a distance from the reference.
    pub needs_reference: bool,
    /// Name for `--by` of a column that is an error, by which front and knee can be found.
    pub criterion: Option<&'static str>,
    /// The key of the time that the error is set against.
    pub timed_by: &'static str,
    /// What to remark of a setting whose value is above zero.
    pub remark: &'static str,
    /// The largest absolute value with which a setting is recommended.
    pub bound: Option<f64>,
}

/// A column whose values are measured from a `V`.
pub(crate) struct Column<V: 'static> {
    /// Description.
    pub info: ColumnInfo,
    value: Value<V>,
}

enum Value<V: 'static> {
    Number(fn(&V) -> Option<f64>),
    Times(fn(&V) -> Option<Spread>),
}

/// The key of the time of the whole work.
pub(crate) const SECONDS: &str = "seconds";

impl<V> Column<V> {
    /// A column of numbers.
    pub(crate) const fn new(
        key: &'static str,
        heading: &'static str,
        unit: Unit,
        value: fn(&V) -> Option<f64>,
    ) -> Self {
        Self { info: info(key, heading, unit), value: Value::Number(value) }
    }

    /// A column of times.
    pub(crate) const fn times(
        key: &'static str,
        heading: &'static str,
        value: fn(&V) -> Option<Spread>,
    ) -> Self {
        Self { info: info(key, heading, Unit::Seconds), value: Value::Times(value) }
    }

    /// A column that only CSV and JSON have.
    pub(crate) const fn data(key: &'static str, unit: Unit, value: fn(&V) -> Option<f64>) -> Self {
        Self::new(key, "", unit, value).shown(Shown::Data)
    }

    /// Sets where it is shown.
    pub(crate) const fn shown(mut self, shown: Shown) -> Self {
        self.info.shown = shown;
        self
    }

    /// Sets its meaning.
    pub(crate) const fn meaning(mut self, meaning: &'static str) -> Self {
        self.info.meaning = meaning;
        self
    }

    /// Marks it as a distance from the reference.
    pub(crate) const fn against_reference(mut self) -> Self {
        self.info.needs_reference = true;
        self
    }

    /// Makes it an error that front and knee can be found by.
    pub(crate) const fn criterion(mut self, name: &'static str) -> Self {
        self.info.criterion = Some(name);
        self
    }

    /// Sets the largest absolute value with which a setting is recommended.
    pub(crate) const fn bound(mut self, bound: f64) -> Self {
        self.info.bound = Some(bound);
        self
    }

    /// Sets the error against the time of this column.
    pub(crate) const fn timed_by(mut self, key: &'static str) -> Self {
        self.info.timed_by = key;
        self
    }

    /// Remarks on settings whose value is above zero: "3 steps were too long".
    pub(crate) const fn remark(mut self, remark: &'static str) -> Self {
        self.info.remark = remark;
        self
    }

    /// The value; without a range unless it is a time.
    pub(crate) fn of(&self, view: &V) -> Option<Spread> {
        match self.value {
            Value::Number(value) => value(view).map(Spread::exact),
            Value::Times(value) => value(view),
        }
    }
}

const fn info(key: &'static str, heading: &'static str, unit: Unit) -> ColumnInfo {
    ColumnInfo {
        key,
        heading,
        unit,
        meaning: "",
        shown: Shown::Everywhere,
        needs_reference: false,
        criterion: None,
        timed_by: SECONDS,
        remark: "",
        bound: None,
    }
}

/// What a setting costs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs {
    /// Wall-clock time of the work that is compared [s].
    pub seconds: Spread,
    /// Processor time of the same, over all threads [s]; `None` where the system does not report it.
    pub cpu_seconds: Option<Spread>,
    /// Wall-clock time of the whole shot, if its other frames cost as much [s].
    pub shot_seconds: f64,
    /// Peak memory of the process [bytes]; `None` where the system does not report it.
    pub memory: Option<u64>,
}

/// The columns that every table begins with.
pub(crate) const COSTS: [Column<Costs>; 4] = {
    type CostColumn = Column<Costs>;
    [
        CostColumn::times(SECONDS, "seconds", |costs| Some(costs.seconds)),
        CostColumn::times("cpu_seconds", "", |costs| costs.cpu_seconds).shown(Shown::Data),
        CostColumn::new("shot_seconds", "whole shot", Unit::Duration, |costs| Some(costs.shot_seconds))
            .meaning("time of all frames, if the others cost as much"),
        CostColumn::new("memory", "MiB", Unit::Mebibytes, |costs| Some(costs.memory? as f64))
            .meaning("peak memory of the process"),
    ]
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_have_the_middle_value() {
        assert_eq!(Spread::of(&[]), None);
        assert_eq!(Spread::of(&[3.0, 1.0, 2.0]), Some(Spread { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(Spread::of(&[4.0, 1.0]).unwrap().median, 2.5);
    }

    #[test]
    fn figures_have_significant_digits_and_no_trailing_zeros() {
        let shown = |digits| [0.001234, 0.5, 12.0, 1234.5, 0.0].map(|value| figure(value, digits));
        assert_eq!(shown(3), ["0.00123", "0.5", "12", "1234", "0"]);
        assert_eq!(shown(2), ["0.0012", "0.5", "12", "1234", "0"]);
        assert_eq!([figure(4.7e21, 4), figure(-3e9, 1)], ["4.700e21", "-3e9"]);
        let volumes = [0.0, 2.0, 0.099, 5.21e-6, 6.5e-8, -3e-3].map(|value| readable_volume(value, 3));
        assert_eq!(volumes, ["0 m³", "2 m³", "99 L", "5.21 mL", "65 mm³", "-3 L"]);
        let values =
            [Unit::Percent, Unit::Change, Unit::Spacings, Unit::Mebibytes, Unit::Degrees, Unit::Of("m")];
        let shown = values.map(|unit| unit.show(0.25, 2, 0.5));
        assert_eq!(shown, ["25 %", "+25.00 %", "0.5", "0", "0.25°", "0.25 m"]);
    }
}
