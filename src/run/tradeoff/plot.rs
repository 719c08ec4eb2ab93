//! The work–precision plot: SVG drawn by hand.
//!
//! A plotting library was not taken: three panels of points need less code than a library needs to be told, and this
//! way every point carries its setting as a title that browsers show.

use std::fmt::Write as _;

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
    .spread{stroke:#789}.blind{fill:#f2ead8}.number{font-size:10px}.lost{stroke:#c22;stroke-width:1.5}";

/// Panels beside each other.
const IN_A_ROW: usize = 3;

/// The panels as a file of its own.
pub(super) fn svg(panels: &[Panel]) -> String {
    let columns = panels.len().min(IN_A_ROW) as f64;
    let rows = panels.len().div_ceil(IN_A_ROW) as f64;
    let (wide, high) = (LEFT + WIDE + RIGHT, TOP + HIGH + BOTTOM);
    let (width, height) = (columns * wide, rows * high);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" aria-label=\"Time against error\"><style>{STYLE}</style>\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (place, panel) in panels.iter().enumerate() {
        let (row, column) = ((place / IN_A_ROW) as f64, (place % IN_A_ROW) as f64);
        let _ = writeln!(out, "<g transform=\"translate({},{})\">", LEFT + column * wide, TOP + row * high);
        panel.draw(&mut out);
        out += "</g>\n";
    }
    out + "</svg>\n"
}

/// A setting as a panel shows it.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Its place in the table, from 0.
    pub(super) place: usize,
    /// What people call it.
    pub(super) label: String,
    /// The least, the middle and the most [s].
    pub(super) seconds: [f64; 3],
    /// `None`: not known; it is not drawn.
    pub(super) error: Option<f64>,
    /// Why it gave no result.
    pub(super) lost: Option<String>,
    /// Whether it is ringed.
    pub(super) knee: bool,
}

/// One error against time.
pub(super) struct Panel {
    title: String,
    below: &'static str,
    points: Vec<Point>,
    /// Settings without a result: number, seconds, words.
    lost: Vec<(usize, f64, String)>,
    /// Indices into `points`, ascending in seconds.
    front: Vec<usize>,
    /// Errors below this cannot be told from none.
    blind: f64,
    x: Axis,
    y: Axis,
}

struct Point {
    number: usize,
    seconds: [f64; 3],
    error: f64,
    title: String,
    knee: bool,
}

impl Panel {
    /// A panel of some settings; `None` if none of them can be drawn. `front` holds places in the table, ascending in
    /// seconds; errors below `blind` cannot be told from none; `below` is what the seconds are.
    pub(super) fn new(
        title: String,
        below: &'static str,
        entries: Vec<Entry>,
        front: &[usize],
        blind: f64,
    ) -> Option<Self> {
        let (mut points, mut lost) = (Vec::new(), Vec::new());
        for Entry { place, label, seconds, error, lost: why, knee } in entries {
            match (why, error) {
                (Some(why), _) => lost.push((place + 1, seconds[1], format!("{label}: {why}"))),
                (None, Some(error)) if error > 0.0 && seconds[0] > 0.0 => {
                    let title = format!("{label}: {} s, {}", figure(seconds[1]), figure(error));
                    points.push(Point { number: place + 1, seconds, error, title, knee });
                }
                _ => {}
            }
        }
        if points.is_empty() && lost.is_empty() {
            return None;
        }
        let place = |line: &usize| points.iter().position(|point| point.number == line + 1);
        let front = front.iter().filter_map(place).collect();
        let times = points.iter().flat_map(|point| point.seconds).chain(lost.iter().map(|lost| lost.1));
        let x = Axis::around(times, WIDE);
        let errors = points.iter().map(|point| point.error).chain(Some(blind).filter(|&b| b > 0.0));
        let y = Axis::around(errors, HIGH);
        Some(Self { title, below, front, blind, x, y, points, lost })
    }
}

/// A logarithmic axis.
struct Axis {
    from: f64,
    to: f64,
    length: f64,
}

impl Axis {
    /// An axis that holds all values, with some room.
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
        self.length * (value / self.from).ln() / (self.to / self.from).ln()
    }

    /// Round values on the axis: 1, 2 and 5 of every decade, only 1 if that were too many.
    fn ticks(&self) -> Vec<f64> {
        let decades = (self.from.log10().floor() as i32)..=(self.to.log10().ceil() as i32);
        let steps: &[f64] = if self.to / self.from > 300.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10.0_f64.powi(decade)));
        all.filter(|tick| (self.from..=self.to).contains(tick)).collect()
    }
}

impl Panel {
    fn draw(&self, out: &mut String) {
        let (x, y) = (|v: f64| self.x.at(v), |v: f64| HIGH - self.y.at(v));
        let _ = write!(out, "<text class=\"title\" x=\"0\" y=\"-14\">{}</text>", escaped(&self.title));
        if self.blind > 0.0 {
            let top = y(self.blind);
            let height = HIGH - top;
            let _ =
                write!(out, "<rect class=\"blind\" y=\"{top:.1}\" width=\"{WIDE}\" height=\"{height:.1}\"/>");
        }
        for tick in self.x.ticks() {
            let at = x(tick);
            let _ = write!(out, "<path class=\"grid\" d=\"M{at:.1} 0V{HIGH}\"/>");
            let _ = write!(
                out,
                "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                HIGH + 18.0,
                figure(tick)
            );
        }
        for tick in self.y.ticks() {
            let at = y(tick);
            let _ = write!(out, "<path class=\"grid\" d=\"M0 {at:.1}H{WIDE}\"/>");
            let _ = write!(
                out,
                "<text x=\"-8\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                at + 4.0,
                figure(tick)
            );
        }
        let _ = write!(out, "<rect class=\"axis\" width=\"{WIDE}\" height=\"{HIGH}\"/>");
        let middle = WIDE / 2.0;
        let below = HIGH + 38.0;
        let _ =
            write!(out, "<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">{}</text>", self.below);

        // The front as steps: until the next setting is paid for, the error stays.
        let mut steps = String::new();
        for (place, &i) in self.front.iter().enumerate() {
            let (px, py) = (x(self.points[i].seconds[1]), y(self.points[i].error));
            let _ = if place == 0 {
                write!(steps, "M{px:.1} {py:.1}")
            } else {
                write!(steps, "H{px:.1}V{py:.1}")
            };
        }
        let _ = write!(out, "<path class=\"front\" d=\"{steps}\"/>");
        for (i, point) in self.points.iter().enumerate() {
            let [low, px, high] = point.seconds.map(x);
            let py = y(point.error);
            let class = if self.front.contains(&i) { "best" } else { "point" };
            if high - low > 1.0 {
                let _ = write!(out, "<path class=\"spread\" d=\"M{low:.1} {py:.1}H{high:.1}\"/>");
            }
            if point.knee {
                let _ = write!(out, "<circle class=\"knee\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"9\"/>");
            }
            let _ = write!(
                out,
                "<circle class=\"{class}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"5\"><title>{}</title></circle>\
                 <text class=\"number\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                escaped(&point.title),
                px + 8.0,
                py - 6.0,
                point.number
            );
        }
        for (number, seconds, words) in &self.lost {
            let px = if *seconds > 0.0 { x(*seconds) } else { 0.0 };
            let _ = write!(
                out,
                "<g transform=\"translate({px:.1},8)\"><path class=\"lost\" d=\"M-4 -4L4 4M-4 4L4 -4\"/><title>{}</title>\
                 <text class=\"number\" x=\"8\" y=\"4\">{number}</text></g>",
                escaped(words)
            );
        }
        out.push('\n');
    }
}

/// Three significant digits, without zeros that say nothing.
pub(super) fn figure(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

pub(super) fn percent(fraction: f64) -> String {
    format!("{} %", figure(100.0 * fraction))
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_and_no_idle_zeros() {
        assert_eq!([0.001234, 0.5, 12.0, 1234.5, 0.0].map(figure), ["0.00123", "0.5", "12", "1234", "0"]);
    }

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
