//! Plots of figures over frames: SVG drawn by hand, as that of `tradeoff`.

use crate::{
    job::tradeoff::{escaped, figure},
    math::elementary::log10,
};

/// Size of a plot and its margins [px].
const WIDE: f64 = 420.0;
const HIGH: f64 = 200.0;
const LEFT: f64 = 62.0;
const TOP: f64 = 34.0;
const RIGHT: f64 = 18.0;
const BOTTOM: f64 = 44.0;

/// Height of a line of the legend [px], and its entries next to each other.
const LEGEND_LINE: f64 = 18.0;
const LEGEND_COLUMNS: usize = 2;

/// Frames with a point of their own: more cannot be distinguished, and make the page heavy.
pub(super) const MAX_POINTS: usize = 1200;

/// Colours of lines, as classes of the page's style.
pub(super) const COLOURS: usize = 8;

/// Figures of one unit over frames.
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) unit: String,
    pub(super) series: Vec<Series>,
}

/// A figure over frames.
pub(super) struct Series {
    pub(super) name: String,
    /// Frames in ascending order, with their values.
    pub(super) points: Vec<(u32, f64)>,
}

impl Plot {
    /// The plot; `None` if no series has a finite value.
    pub(super) fn svg(&self) -> Option<String> {
        let finite = || {
            let points = self.series.iter().flat_map(|series| &series.points);
            points.filter(|(_, value)| value.is_finite()).copied()
        };
        let first = finite().map(|(frame, _)| frame).min()?;
        let last = finite().map(|(frame, _)| frame).max()?;
        let x_axis = Axis::around([f64::from(first), f64::from(last)].into_iter(), WIDE);
        // Zero belongs to most figures: without it, a small change looks like a large one.
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, value)| {
            (low.min(value), high.max(value))
        });
        let is_near_zero = low >= 0.0 && low < 0.6 * high || high <= 0.0 && high > 0.6 * low;
        let zero = is_near_zero.then_some(0.0);
        let y_axis = Axis::around([low, high].into_iter().chain(zero), HIGH);
        let legend = self.series.len().div_ceil(LEGEND_COLUMNS) as f64 * LEGEND_LINE;
        let (width, height) = (LEFT + WIDE + RIGHT, TOP + HIGH + BOTTOM + legend);
        let heading = escaped(&format!("{} [{}]", self.title, self.unit));
        let mut out = format!(
            "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" aria-label=\"{heading}\">\
             <g transform=\"translate({LEFT},{TOP})\"><text class=\"title\" x=\"0\" y=\"-14\">{heading}</text>"
        );
        for tick in x_axis.ticks().into_iter().filter(|tick| tick.fract() == 0.0) {
            let (at, below) = (x_axis.at(tick), HIGH + 18.0);
            out += &format!(
                "<path class=\"grid\" d=\"M{at:.1} 0V{HIGH}\"/><text class=\"below\" x=\"{at:.1}\" y=\"{below}\">{tick}</text>"
            );
        }
        for tick in y_axis.ticks() {
            let (at, label) = (HIGH - y_axis.at(tick), figure(tick, 4));
            out += &format!(
                "<path class=\"grid\" d=\"M0 {at:.1}H{WIDE}\"/><text class=\"left\" x=\"-8\" y=\"{:.1}\">{label}</text>",
                at + 4.0
            );
        }
        let (middle, below) = (0.5 * WIDE, HIGH + 36.0);
        out += &format!(
            "<rect class=\"axis\" width=\"{WIDE}\" height=\"{HIGH}\"/><text class=\"below\" x=\"{middle}\" y=\"{below}\">frame</text>"
        );
        for (number, series) in self.series.iter().enumerate() {
            out += &series.line(number, &x_axis, &y_axis);
            out += &series.legend(number);
        }
        Some(out + "</g></svg>\n")
    }
}

/// The points, or of more than [`MAX_POINTS`] the smallest, the largest and a non-finite one of each of equal parts, in their order.
fn thinned(points: &[(u32, f64)]) -> Vec<(u32, f64)> {
    if points.len() <= MAX_POINTS {
        return points.to_vec();
    }
    let mut kept = Vec::with_capacity(MAX_POINTS);
    for part in points.chunks(points.len().div_ceil(MAX_POINTS / 3)) {
        let finite = || part.iter().enumerate().filter(|(_, (_, value))| value.is_finite());
        let low = finite().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let high = finite().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let gap = part.iter().enumerate().find(|(_, (_, value))| !value.is_finite());
        let mut places: Vec<usize> = [low, high, gap].into_iter().flatten().map(|(place, _)| place).collect();
        places.sort_unstable();
        places.dedup();
        kept.extend(places.into_iter().map(|place| part[place]));
    }
    kept
}

impl Series {
    /// The line through its points, which is broken where a value is not finite.
    fn line(&self, number: usize, x_axis: &Axis, y_axis: &Axis) -> String {
        let thinned = thinned(&self.points);
        let mut path = String::new();
        for part in thinned.split(|(_, value)| !value.is_finite()) {
            for (place, &(frame, value)) in part.iter().enumerate() {
                let (x, y) = (x_axis.at(f64::from(frame)), HIGH - y_axis.at(value));
                path += &format!("{}{x:.1} {y:.1}", if place == 0 { 'M' } else { 'L' });
            }
            // A line of one point has no length, but round ends.
            if part.len() == 1 {
                path += "h0.01";
            }
        }
        let class = number % COLOURS;
        let name = escaped(&self.name);
        format!("<path class=\"line c{class}\" d=\"{path}\"><title>{name}</title></path>")
    }

    /// Its entry in the legend, with its last value.
    fn legend(&self, number: usize) -> String {
        let (column, row) = (number % LEGEND_COLUMNS, number / LEGEND_COLUMNS);
        let x = column as f64 * WIDE / LEGEND_COLUMNS as f64;
        let y = HIGH + BOTTOM + 8.0 + row as f64 * LEGEND_LINE;
        let class = number % COLOURS;
        let last = self.points.iter().rev().find(|(_, value)| value.is_finite());
        let last = last.map_or_else(String::new, |(_, value)| format!(" {}", figure(*value, 3)));
        format!(
            "<path class=\"line c{class}\" d=\"M{x:.1} {:.1}h16\"/><text x=\"{:.1}\" y=\"{y:.1}\">{}{last}</text>",
            y - 4.0,
            x + 22.0,
            escaped(&self.name)
        )
    }
}

/// Width of an axis, at least: numbers that differ by less lose digits, and their quotients are no numbers.
const MIN_WIDTH: f64 = 1e-280;

/// A linear axis.
struct Axis {
    from: f64,
    to: f64,
    length: f64,
}

impl Axis {
    /// An axis that holds all values.
    fn around(values: impl Iterator<Item = f64>, length: f64) -> Self {
        let (from, to) = values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        // Of one value, or of values that differ by rounding, the axis has a width all the same.
        let largest = from.abs().max(to.abs());
        let minimum_width = (1e-9 * largest).max(MIN_WIDTH);
        // Of halves, whose difference does not overflow.
        match 0.5 * to - 0.5 * from > 0.5 * minimum_width {
            true => Self { from, to, length },
            false => {
                let half = if largest < MIN_WIDTH { 0.5 } else { 0.05 * largest };
                Self { from: (from - half).max(f64::MIN), to: (to + half).min(f64::MAX), length }
            }
        }
    }

    /// Pixels from the axis's start.
    fn at(&self, value: f64) -> f64 {
        // Of halves, whose difference does not overflow.
        self.length * ((0.5 * value - 0.5 * self.from) / (0.5 * self.to - 0.5 * self.from))
    }

    /// Round values on the axis: about five, at distances of 1, 2 or 5 times a power of ten.
    fn ticks(&self) -> Vec<f64> {
        let min_step = self.to / 5.5 - self.from / 5.5;
        let decade = 10.0_f64.powi(log10(min_step).floor() as i32);
        let step = [1.0, 2.0, 5.0, 10.0].map(|part| part * decade).into_iter().find(|step| *step >= min_step);
        let step = step.unwrap_or(10.0 * decade);
        if !(step.is_finite() && step > 0.0) {
            return Vec::new();
        }
        let (first, last) = ((self.from / step).ceil(), (self.to / step).floor());
        (0..=((last - first).clamp(0.0, 10.0) as usize)).map(|i| (first + i as f64) * step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: &[(u32, f64)]) -> Plot {
        let series = vec![Series { name: "<b>".into(), points: points.to_vec() }];
        Plot { title: "A & B".into(), unit: "%".into(), series }
    }

    #[test]
    fn lines_are_broken_at_nan_and_texts_are_escaped() {
        let svg = plot(&[(1, 0.0), (2, 1.0), (3, f64::NAN), (4, 2.0), (5, f64::INFINITY)]).svg().unwrap();
        assert!(svg.contains("d=\"M0.0 200.0L140.0 100.0M420.0 0.0h0.01\""), "{svg}");
        assert!(
            svg.contains("A &amp; B [%]") && svg.contains("&lt;b&gt; 2") && !svg.contains("<b>"),
            "{svg}"
        );
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert_eq!(plot(&[(1, f64::NAN)]).svg(), None);
        assert_eq!(plot(&[]).svg(), None);
    }

    #[test]
    fn axes_are_round_and_have_a_width() {
        let ticks = |from: f64, to: f64| Axis::around([from, to].into_iter(), 100.0).ticks();
        assert_eq!(ticks(0.0, 10.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(1.0, 1.0), [0.96, 0.98, 1.0, 1.02, 1.04]);
        assert_eq!(ticks(0.0, 0.0).len(), 5);
        for (from, to) in [
            (1e300, 1.1e300),
            (-1e-300, 1e-300),
            (5.0, 5.0 + 1e-12),
            (-1e308, 1e308),
            (f64::MAX, f64::MAX),
            (f64::MIN, f64::MAX),
            (-5e-324, 5e-324),
        ] {
            let axis = Axis::around([from, to].into_iter(), 100.0);
            let found = axis.ticks();
            assert!(found.len() <= 11, "{from} {to}: {found:?}");
            assert!([axis.at(from), axis.at(to)].iter().all(|x| (0.0..=100.0).contains(x)), "{from} {to}");
            assert!(found.iter().all(|tick| tick.is_finite()));
            let svg = plot(&[(1, from), (2, to)]).svg().unwrap();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn many_frames_become_few_points() {
        let points: Vec<(u32, f64)> = (0..100_000).map(|i| (i, f64::from(i % 7))).collect();
        assert!(plot(&points).svg().unwrap().len() < 40_000);
        // A peak of one frame stays, and so does a gap.
        let mut points = vec![(0, 1.0); 100_000];
        points.iter_mut().zip(0..).for_each(|(point, frame)| point.0 = frame);
        (points[54_321].1, points[77_777].1) = (9.0, f64::NAN);
        let kept = thinned(&points);
        assert!(kept.len() <= MAX_POINTS && kept.contains(&(54_321, 9.0)), "{}", kept.len());
        assert!(kept.is_sorted_by_key(|(frame, _)| *frame) && kept.iter().any(|(_, value)| value.is_nan()));
    }
}
