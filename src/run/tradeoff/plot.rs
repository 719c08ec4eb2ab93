//! The work–precision plot: SVG drawn by hand, alone or in a page with the table.
//!
//! A plotting library was not taken: three panels of points need less code than a library needs to be told, and this
//! way every point carries its setting as a title that browsers show.

use super::{By, Line, Table};
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

/// The plot as a file of its own.
pub(super) fn svg(table: &Table) -> String {
    let panels = panels(table);
    let count = panels.len() as f64;
    let (width, height) = (count * (LEFT + WIDE + RIGHT), TOP + HIGH + BOTTOM);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" aria-label=\"Time against error\"><style>{STYLE}</style>\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (place, panel) in panels.iter().enumerate() {
        let _ = writeln!(
            out,
            "<g transform=\"translate({},{TOP})\">",
            LEFT + place as f64 * (LEFT + WIDE + RIGHT)
        );
        panel.draw(&mut out);
        out += "</g>\n";
    }
    out + "</svg>\n"
}

/// The plot and the table as one page that needs nothing else.
pub(super) fn html(table: &Table) -> String {
    let title = escaped(&table.title);
    let mut rows = String::new();
    for (place, line) in table.lines.iter().enumerate() {
        let mark = match (table.knee == Some(place), line.front) {
            (true, _) => "knee",
            (false, true) => "front",
            _ => "",
        };
        row(&mut rows, &(place + 1).to_string(), line, mark, table);
    }
    row(&mut rows, "", &table.reference, "reference", table);
    let unit = table.observable.unit();
    let uncertainty = [
        table.uncertainty.energy.map(|e| format!("energy {}", percent(e))),
        table.uncertainty.observable.map(|o| format!("{} {} {unit}", table.observable.name(), figure(o))),
        table.uncertainty.position.map(|p| format!("positions {} m", figure(p))),
    ];
    let uncertainty = uncertainty.into_iter().flatten().collect::<Vec<_>>().join(", ");
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}: time against error</title><style>\
         body{{font:15px/1.5 system-ui,sans-serif;margin:2em;color:#222}}svg{{max-width:100%;height:auto}}\
         table{{border-collapse:collapse}}td,th{{padding:.2em .8em;text-align:right;border-bottom:1px solid #ddd}}\
         td:nth-child(2),th:nth-child(2){{text-align:left}}.knee{{background:#fff0e0}}.front{{background:#eafaf2}}\
         .reference{{color:#777}}p{{max-width:60em}}</style><h1>{title}</h1>\
         <p>Frames {frames}, {threads} threads. Every point is a setting; lower is more exact, left is faster. Nothing \
         beats the green ones. After the ringed one, more time buys little. What lies in the tinted band cannot be told \
         from the reference, which differs from its own refinement by {uncertainty}. An error or a time of exactly 0 has no \
         place on these axes: such settings stand in the table alone.</p>{plot}\
         <table><tr><th>#<th>setting<th>seconds<th>whole shot<th>density, mean<th>density, largest<th>volume<th>energy\
         <th>{observable}<th>positions<th></tr>{rows}</table>\
         <p>Density: how far from incompressible, mean of the frames and largest of all particles. Volume: of the \
         surface, last frame against first. Energy, {observable} and positions: RMS distance from the reference.</p></html>\n",
        frames = table.frames,
        threads = table.threads,
        observable = table.observable.name(),
        uncertainty = if uncertainty.is_empty() { "an unknown amount" } else { &uncertainty },
        plot = svg(table),
    )
}

fn row(out: &mut String, number: &str, line: &Line, mark: &str, table: &Table) {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let unit = table.observable.unit();
    let end = match &line.diverged {
        Some(why) => format!("diverged, {}", escaped(why)),
        None => mark.into(),
    };
    let _ = write!(
        out,
        "<tr class=\"{mark}\"><td>{number}<td>{}<td>{:.1}<td>{:.0} s<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{end}</tr>",
        escaped(&line.label),
        line.seconds.median,
        line.shot_seconds,
        percent(line.density_dev_avg),
        percent(line.density_dev_largest),
        maybe(line.volume_change, &|v| format!("{:+.1} %", 100.0 * v)),
        maybe(line.apart.energy, &percent),
        maybe(line.apart.observable, &|o| format!("{} {unit}", figure(o))),
        maybe(line.apart.position, &|p| format!("{} m", figure(p))),
    );
}

/// One error against time.
struct Panel {
    title: String,
    points: Vec<Point>,
    /// Settings that diverged: number, seconds, words.
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

fn panels(table: &Table) -> Vec<Panel> {
    let name = |by: By| match by {
        By::Density => "density deviation, mean [%]".to_owned(),
        By::Energy => "energy, from the reference [%]".to_owned(),
        By::Observable => {
            format!("{}, from the reference [{}]", table.observable.name(), table.observable.unit())
        }
    };
    let blind = |by: By| match by {
        By::Density => 0.0,
        By::Energy => 100.0 * table.uncertainty.energy.unwrap_or(0.0),
        By::Observable => table.uncertainty.observable.unwrap_or(0.0),
    };
    let made = By::ALL.map(|by| {
        let scale = if by == By::Observable { 1.0 } else { 100.0 };
        let raw = |line: &Line| match by {
            By::Density => Some(line.density_dev_avg),
            By::Energy => line.apart.energy,
            By::Observable => line.apart.observable,
        };
        let (mut points, mut lost) = (Vec::new(), Vec::new());
        for (place, line) in table.lines.iter().enumerate() {
            let seconds = [line.seconds.min, line.seconds.median, line.seconds.max];
            match (&line.diverged, raw(line)) {
                (Some(why), _) => {
                    lost.push((place + 1, seconds[1], format!("{}: diverged, {why}", line.label)))
                }
                (None, Some(error)) if error > 0.0 && seconds[0] > 0.0 => points.push(Point {
                    number: place + 1,
                    seconds,
                    error: scale * error,
                    title: format!("{}: {:.1} s, {}", line.label, seconds[1], figure(scale * error)),
                    knee: table.knee == Some(place) && table.by == by,
                }),
                _ => {}
            }
        }
        let front = table.front(by);
        let place = |line: &usize| points.iter().position(|point| point.number == line + 1);
        let front = front.iter().filter_map(place).collect();
        let times = points.iter().flat_map(|point| point.seconds).chain(lost.iter().map(|lost| lost.1));
        let x = Axis::around(times, WIDE);
        let errors = points.iter().map(|point| point.error).chain(Some(blind(by)).filter(|&b| b > 0.0));
        let y = Axis::around(errors, HIGH);
        Panel { title: name(by), front, blind: blind(by), x, y, points, lost }
    });
    made.into_iter().filter(|panel| !panel.points.is_empty() || !panel.lost.is_empty()).collect()
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
        let _ = write!(
            out,
            "<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">seconds for the frames</text>"
        );

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

fn percent(fraction: f64) -> String {
    format!("{} %", figure(100.0 * fraction))
}

fn escaped(text: &str) -> String {
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
