//! The work–precision plot: SVG drawn by hand.
//!
//! A plotting library was not taken: three panels of points need less code than a library needs as configuration, and
//! here every point carries its setting as a title that browsers show.

use super::{
    column::{Spread, figure},
    table::Table,
};
use crate::math::elementary::{ln, log10};

/// Size of a panel and its margins [px].
const WIDE: f64 = 380.0;
const HIGH: f64 = 300.0;
const LEFT: f64 = 64.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 52.0;
const RIGHT: f64 = 16.0;

const STYLE: &str = "text{font:12px system-ui,sans-serif;fill:#333}.title{font-size:14px;font-weight:600}\
    .axis{stroke:#999;fill:none}.grid{stroke:#e4e4e4}.front{stroke:#0b6;stroke-width:1.5;fill:none}\
    .point{fill:#9ab;stroke:#fff}.best{fill:#0b6;stroke:#fff}.knee{fill:none;stroke:#d60;stroke-width:2}\
    .spread{stroke:#789}.floor{fill:#f2ead8}.number{font-size:10px}.lost{stroke:#c22;stroke-width:1.5}\
    .below{text-anchor:middle}.left{text-anchor:end}";

/// Panels next to each other.
const PANELS_PER_ROW: usize = 3;

/// The plot of a table: a panel per error, without those that no setting has.
pub(crate) fn svg(table: &Table) -> String {
    let panels: Vec<String> = table.criteria().filter_map(|column| panel(table, column)).collect();
    let (wide, high) = (LEFT + WIDE + RIGHT, TOP + HIGH + BOTTOM);
    let width = panels.len().min(PANELS_PER_ROW) as f64 * wide;
    let height = panels.len().div_ceil(PANELS_PER_ROW) as f64 * high;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" aria-label=\"Time against error\"><style>{STYLE}</style>\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (place, panel) in panels.iter().enumerate() {
        let (row, column) = ((place / PANELS_PER_ROW) as f64, (place % PANELS_PER_ROW) as f64);
        let (x, y) = (LEFT + column * wide, TOP + row * high);
        out += &format!("<g transform=\"translate({x},{y})\">{panel}</g>\n");
    }
    out + "</svg>\n"
}

/// An error against time, a point per setting; `None` if no setting can be drawn.
fn panel(table: &Table, column: usize) -> Option<String> {
    let (info, time) = (&table.columns[column], table.time_of(column));
    let scale = info.unit.scale(table.about.spacing);
    // Places of settings with their time and error, and of those without a result with the reason.
    let (mut points, mut lost) = (Vec::new(), Vec::new());
    for (place, row) in table.rows.iter().enumerate() {
        let Some(seconds) = row.cells[time] else { continue };
        let error = row.cells[column].map(|spread| scale * spread.median.abs());
        let diverged = row.diverged.as_ref().map(|why| format!("diverged, {why}"));
        let missing = table.incomparable(row).filter(|_| error.is_none()).map(String::from);
        if let Some(why) = diverged.or(missing) {
            lost.push((place, seconds.median, why));
        } else if let Some(error) = error.filter(|&error| error > 0.0 && seconds.min > 0.0) {
            points.push((place, seconds, error));
        }
    }
    if points.is_empty() && lost.is_empty() {
        return None;
    }
    let floor = scale * table.floor(column).unwrap_or(0.0);
    let times = points.iter().flat_map(|(_, Spread { min, median, max }, _)| [*min, *median, *max]);
    let x_axis = Axis::around(times.chain(lost.iter().map(|lost| lost.1)), WIDE);
    let y_axis = Axis::around(points.iter().map(|point| point.2).chain([floor]), HIGH);
    let (x, y) = (|seconds: f64| x_axis.at(seconds), |error: f64| HIGH - y_axis.at(error));

    let compared = if info.needs_reference { ", from the reference" } else { "" };
    let title = format!("{}{compared} [{}]", info.heading, info.unit.symbol());
    let mut out = format!("<text class=\"title\" x=\"0\" y=\"-14\">{}</text>", escaped(&title));
    if floor > 0.0 {
        let (top, height) = (y(floor), y_axis.at(floor));
        out += &format!("<rect class=\"floor\" y=\"{top:.1}\" width=\"{WIDE}\" height=\"{height:.1}\"/>");
    }
    for tick in x_axis.ticks() {
        let (at, below, label) = (x(tick), HIGH + 18.0, figure(tick, 3));
        out += &format!("<path class=\"grid\" d=\"M{at:.1} 0V{HIGH}\"/>");
        out += &format!("<text class=\"below\" x=\"{at:.1}\" y=\"{below}\">{label}</text>");
    }
    for tick in y_axis.ticks() {
        let (at, label) = (y(tick), figure(tick, 3));
        out += &format!("<path class=\"grid\" d=\"M0 {at:.1}H{WIDE}\"/>");
        out += &format!("<text class=\"left\" x=\"-8\" y=\"{:.1}\">{label}</text>", at + 4.0);
    }
    let (middle, below, seconds) = (WIDE / 2.0, HIGH + 38.0, table.columns[time].heading);
    out += &format!(
        "<rect class=\"axis\" width=\"{WIDE}\" height=\"{HIGH}\"/>\
         <text class=\"below\" x=\"{middle}\" y=\"{below}\">{seconds} [s]</text>"
    );

    // The front as steps: until the next setting is paid for, the error stays.
    let front = table.front(column);
    let on_front = front.iter().filter_map(|place| points.iter().find(|point| point.0 == *place));
    let corners = on_front.map(|(_, seconds, error)| (x(seconds.median), y(*error)));
    let steps = corners.enumerate().map(|(number, (x, y))| match number {
        0 => format!("M{x:.1} {y:.1}"),
        _ => format!("H{x:.1}V{y:.1}"),
    });
    out += &format!("<path class=\"front\" d=\"{}\"/>", steps.collect::<String>());
    for (place, seconds, error) in &points {
        let [low, px, high] = [seconds.min, seconds.median, seconds.max].map(x);
        let (py, row, number) = (y(*error), &table.rows[*place], place + 1);
        if high - low > 1.0 {
            out += &format!("<path class=\"spread\" d=\"M{low:.1} {py:.1}H{high:.1}\"/>");
        }
        if row.mark == "knee" && table.by == column {
            out += &format!("<circle class=\"knee\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"9\"/>");
        }
        let class = if front.contains(place) { "best" } else { "point" };
        let (seconds, error) = (figure(seconds.median, 3), figure(*error, 3));
        let title = escaped(&format!("{}: {seconds} s, {error}", row.setting.label));
        out += &format!(
            "<circle class=\"{class}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"5\"><title>{title}</title></circle>\
             <text class=\"number\" x=\"{:.1}\" y=\"{:.1}\">{number}</text>",
            px + 8.0,
            py - 6.0,
        );
    }
    for (place, seconds, why) in &lost {
        let px = if *seconds > 0.0 { x(*seconds) } else { 0.0 };
        let (title, number) = (format!("{}: {why}", table.rows[*place].setting.label), place + 1);
        out += &format!(
            "<g transform=\"translate({px:.1},8)\"><path class=\"lost\" d=\"M-4 -4L4 4M-4 4L4 -4\"/>\
             <title>{}</title><text class=\"number\" x=\"8\" y=\"4\">{number}</text></g>",
            escaped(&title)
        );
    }
    Some(out)
}

/// A logarithmic axis.
struct Axis {
    from: f64,
    to: f64,
    length: f64,
}

impl Axis {
    /// An axis that holds all values, with a margin.
    fn around(values: impl Iterator<Item = f64>, length: f64) -> Self {
        let held = values.filter(|value| *value > 0.0 && value.is_finite());
        let (low, high) = held.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        if high == 0.0 {
            return Self { from: 0.1, to: 10.0, length };
        }
        Self { from: low / 1.4, to: high * 1.4, length }
    }

    /// Pixels from the axis's start.
    fn at(&self, value: f64) -> f64 {
        self.length * ln(value / self.from) / ln(self.to / self.from)
    }

    /// Round values on the axis: 1, 2 and 5 of every decade, only 1 if that were too many.
    fn ticks(&self) -> Vec<f64> {
        let decades = (log10(self.from).floor() as i32)..=(log10(self.to).ceil() as i32);
        let steps: &[f64] = if self.to / self.from > 300.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10.0_f64.powi(decade)));
        all.filter(|tick| (self.from..=self.to).contains(tick)).collect()
    }
}

/// A text without characters that mean something in SVG and HTML.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::Axis;

    #[test]
    fn ticks_are_round_and_few() {
        let axis = Axis::around([1.5, 30.0].into_iter(), 100.0);
        assert_eq!(axis.ticks(), [2.0, 5.0, 10.0, 20.0]);
        assert!(axis.at(1.5) > 0.0 && axis.at(30.0) < 100.0);
        let wide = Axis::around([0.001, 50.0].into_iter(), 100.0).ticks();
        assert_eq!(wide.len(), 5);
        assert_eq!(Axis::around([0.0].into_iter(), 100.0).ticks().len(), 7);
    }
}
