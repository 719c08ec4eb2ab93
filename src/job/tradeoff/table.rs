//! The table of a tradeoff: a row per setting, the Pareto front and its knee, and the setting to use.

use super::{
    column::{COSTS, Column, ColumnInfo, Costs, SECONDS, Shown, Spread, Unit},
    pareto,
};
use crate::{job::RunError, par};
use serde_json::{Map, Value as Json, json};

/// Words of all tables of a subject.
#[derive(Debug)]
pub(crate) struct Wording {
    /// What a time limit is for: "the shot".
    pub whole: &'static str,
    /// What the seconds of a setting are.
    pub seconds: &'static str,
    /// What settings that give the same have in common: "the same frames as".
    pub same: &'static str,
    /// The criterion that decides if none is named, and that `--dev` limits.
    pub criterion: &'static str,
    /// That limit, with `{}` for the figure.
    pub limit: &'static str,
    /// Why a setting that did not diverge may have no error; `None` if it always has one.
    pub incomparable: Option<&'static str>,
}

/// What a table has in addition to its rows.
#[derive(Clone, Debug)]
pub(crate) struct About {
    /// The shot's name.
    pub title: String,
    /// The compared frames, in words.
    pub frames: String,
    /// Facts by their JSON keys.
    pub facts: Vec<(&'static str, Json)>,
    /// Distance between particles at rest [m], where limits are in spacings; else 1.
    pub spacing: f64,
    /// Facts that belong below the table, each with its heading.
    pub remarks: Vec<(&'static str, String)>,
}

/// What a run changes in the preset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Setting {
    /// Label of the changes.
    pub label: String,
    /// The preset's tier, if the setting names one.
    pub quality: Option<&'static str>,
    /// Arguments of `--set` for the changes.
    pub set: Vec<String>,
}

/// A setting, what it cost and how it came out.
#[derive(Clone, Debug)]
pub(crate) struct TableRow {
    /// The setting.
    pub setting: Setting,
    /// A value per column.
    pub cells: Vec<Option<Spread>>,
    /// Passes and their times [s], where the table lists them.
    pub passes: Vec<(String, f64)>,
    /// Why and where the run ended early.
    pub diverged: Option<String>,
    /// The first row that gave the same result, if another did: the keys in which they differ do nothing here.
    pub same_as: Option<usize>,
    /// "knee" after which more time buys little, "front" if no other row is both faster and more exact, [`OUTSIDE`] if a
    /// figure is out of its column's bound, or "".
    pub mark: &'static str,
}

impl TableRow {
    /// The row of a setting, whose values `columns` measure from `view`.
    pub(crate) fn new<V>(setting: &Setting, costs: &Costs, columns: &[Column<V>], view: &V) -> Self {
        let cells = COSTS.iter().map(|column| column.of(costs)).chain(columns.iter().map(|c| c.of(view)));
        Self {
            setting: setting.clone(),
            cells: cells.collect(),
            passes: Vec::new(),
            diverged: None,
            same_as: None,
            mark: "",
        }
    }
}

/// The result of a tradeoff.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// Everything but the rows.
    pub about: About,
    /// Words of the subject.
    pub wording: &'static Wording,
    /// Threads that computed.
    pub threads: usize,
    /// The columns.
    pub columns: Vec<ColumnInfo>,
    /// The column of the error that decides.
    pub by: usize,
    /// The settings.
    pub rows: Vec<TableRow>,
    /// The reference.
    pub reference: TableRow,
    /// The reference refined once more. Its distance from the reference is the smallest error that can be seen.
    pub refined: TableRow,
    /// The row after which more time buys little.
    pub knee: Option<usize>,
}

impl Table {
    /// The table of some rows, with their front and knee by the criterion `by`.
    ///
    /// # Panics
    /// If no column has the criterion.
    pub(crate) fn new<V>(
        about: About,
        wording: &'static Wording,
        columns: &[Column<V>],
        by: &str,
        rows: Vec<TableRow>,
        [reference, refined]: [TableRow; 2],
    ) -> Self {
        let mut columns: Vec<ColumnInfo> =
            COSTS.iter().map(|column| column.info).chain(columns.iter().map(|column| column.info)).collect();
        columns[0].meaning = wording.seconds;
        let by = criterion(&columns, by);
        let threads = par::threads();
        let mut table = Self { about, wording, threads, columns, by, rows, reference, refined, knee: None };
        for place in 0..table.rows.len() {
            table.rows[place].mark = if table.is_outside(&table.rows[place]) { OUTSIDE } else { "" };
        }
        let (points, front) = (table.points(by), table.front(by));
        table.knee = pareto::knee_of(&points, &front);
        front.iter().for_each(|place| table.rows[*place].mark = "front");
        table.knee.iter().for_each(|place| table.rows[*place].mark = "knee");
        table
    }

    /// The column of a criterion.
    pub(crate) fn column(&self, criterion: &str) -> usize {
        self::criterion(&self.columns, criterion)
    }

    /// The columns of errors that front and knee can be found by.
    pub(crate) fn criteria(&self) -> impl Iterator<Item = usize> {
        (0..self.columns.len()).filter(|&column| self.columns[column].criterion.is_some())
    }

    /// The column that an error's time is in.
    pub(crate) fn time_of(&self, column: usize) -> usize {
        let key = self.columns[column].timed_by;
        self.columns
            .iter()
            .position(|info| info.key == key)
            .expect("errors are timed by a column of the table")
    }

    /// How small an error can be seen at all, if that is known.
    pub(crate) fn floor(&self, column: usize) -> Option<f64> {
        let floor = self.refined.cells[column].filter(|_| self.columns[column].needs_reference);
        floor.map(|spread| spread.median.abs())
    }

    /// The error of a row as far as it can be judged: at least the reference's own uncertainty. `None` if there is none, or
    /// the run diverged.
    pub(crate) fn judged(&self, row: &TableRow, column: usize) -> Option<f64> {
        let found = row.cells[column].filter(|_| row.diverged.is_none())?.median.abs();
        Some(found.max(self.floor(column).unwrap_or(0.0)))
    }

    /// The columns of whose bounds a row is out. A run that diverged has no figures.
    fn outside(&self, row: &TableRow) -> impl Iterator<Item = usize> {
        let is_out = |column: &usize| {
            let value = row.cells[*column].filter(|_| row.diverged.is_none());
            let bound = self.columns[*column].bound;
            // NaN is out of every bound.
            value.zip(bound).is_some_and(|(value, bound)| value.median.is_nan() || value.median.abs() > bound)
        };
        (0..self.columns.len()).filter(is_out)
    }

    /// Whether a figure of a row is out of its column's bound, so that the setting is not recommended.
    pub(crate) fn is_outside(&self, row: &TableRow) -> bool {
        self.outside(row).next().is_some()
    }

    /// The figures of a row that are out of their bounds, in words; `None` if none is.
    pub(crate) fn out_of_bounds(&self, row: &TableRow, digits: i32) -> Option<String> {
        let words = |column: usize| {
            let (heading, bound) = (self.columns[column].heading, self.bound(column, digits));
            format!("{heading} {} ({bound})", self.cell(row, column, digits))
        };
        let words: Vec<String> = self.outside(row).map(words).collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// The bounds within which settings are recommended, in words; `None` if there is none.
    pub(crate) fn bounds(&self, digits: i32) -> Option<String> {
        let bounded = (0..self.columns.len()).filter(|&column| self.columns[column].bound.is_some());
        let words =
            bounded.map(|column| format!("{} {}", self.columns[column].heading, self.bound(column, digits)));
        let words: Vec<String> = words.collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// The bound of a column in words.
    fn bound(&self, column: usize, digits: i32) -> String {
        let info = self.columns[column];
        let sign = if info.unit == Unit::Change { "±" } else { "at most " };
        let unit = if info.unit == Unit::Change { Unit::Percent } else { info.unit };
        let bound = info.bound.unwrap_or(f64::INFINITY);
        format!("{sign}{}", unit.show(bound, digits, self.about.spacing))
    }

    /// Whether there are settings that did not diverge, and none of them is within the bounds.
    pub(crate) fn are_all_outside(&self) -> bool {
        let mut finished = self.rows.iter().filter(|row| row.diverged.is_none()).peekable();
        finished.peek().is_some() && finished.all(|row| self.is_outside(row))
    }

    /// The front by the error of a column: places of rows within the bounds, ascending in cost.
    pub(crate) fn front(&self, column: usize) -> Vec<usize> {
        pareto::front(&self.points(column))
    }

    /// Time and error of every row within the bounds.
    fn points(&self, column: usize) -> Vec<Option<(f64, f64)>> {
        let time = self.time_of(column);
        let point = |row: &TableRow| {
            let point = (row.cells[time]?.median, self.judged(row, column)?);
            (!self.is_outside(row)).then_some(point)
        };
        self.rows.iter().map(point).collect()
    }

    /// The time of the whole shot with a setting [s].
    pub(crate) fn shot_seconds(&self, row: &TableRow) -> f64 {
        row.cells[SHOT_SECONDS].map_or(0.0, |spread| spread.median)
    }

    /// Why a row has no error, if it should have one.
    pub(crate) fn incomparable(&self, row: &TableRow) -> Option<&'static str> {
        let is_missing = row.diverged.is_none() && row.cells[self.column(self.wording.criterion)].is_none();
        self.wording.incomparable.filter(|_| is_missing)
    }

    /// The setting to use: the most exact that takes at most `time` [s] for the whole shot; the cheapest whose limited
    /// error is at most `dev`; with neither the knee. Never one out of the bounds.
    ///
    /// # Errors
    /// [`RunError::NoSetting`] if no row keeps limits and bounds; [`RunError::Request`] if nothing can be compared, because the
    /// reference diverged.
    pub(crate) fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError> {
        if time.is_none() && dev.is_none() {
            return Ok(self.knee);
        }
        let limited = self.column(self.wording.criterion);
        let decisive = if dev.is_some() { limited } else { self.by };
        if self.columns[decisive].needs_reference && self.reference.diverged.is_some() {
            let own = self.criteria().map(|column| self.columns[column]).filter(|info| !info.needs_reference);
            let own: String =
                own.map(|info| format!(", or --by {}", info.criterion.unwrap_or_default())).collect();
            return Err(RunError::Request(format!(
                "the reference diverged, so no setting can be compared with it; name another with --reference{own}"
            )));
        }
        let rank = |(place, row): (usize, &TableRow)| {
            let error = self.judged(row, decisive)?;
            let is_fast = time.is_none_or(|most| self.shot_seconds(row) <= most);
            let is_exact = dev.is_none_or(|most| error / self.about.spacing <= most);
            let cost = row.cells[self.time_of(decisive)].or(row.cells[0])?.median;
            let rank = if dev.is_some() { (cost, 0.0) } else { (error, cost) };
            (is_fast && is_exact && !self.is_outside(row)).then_some((place, rank))
        };
        let ranked = self.rows.iter().enumerate().filter_map(rank);
        let best = ranked.min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        best.map(|(place, _)| Some(place)).ok_or_else(|| {
            let time = time.map(|time| format!("{time} s for {}", self.wording.whole));
            let bounds = self.bounds(2).map(|bounds| format!("the bounds of the table ({bounds})"));
            let limits = [time, dev.map(|dev| self.limit(dev)), bounds];
            RunError::NoSetting { wanted: limits.into_iter().flatten().collect::<Vec<_>>().join(" and ") }
        })
    }

    /// A limit of `--dev` in words.
    pub(crate) fn limit(&self, dev: f64) -> String {
        self.wording.limit.replace("{}", &format!("{}%", 100.0 * dev))
    }

    /// The columns that are shown to people.
    fn shown(&self, to: Shown) -> impl Iterator<Item = usize> {
        (0..self.columns.len()).filter(move |&column| self.columns[column].shown <= to)
    }

    /// A cell in words: times with their range, errors below the reference's uncertainty as ≤, a dash without a value.
    pub(crate) fn cell(&self, row: &TableRow, column: usize, digits: i32) -> String {
        let words = |value| self.columns[column].unit.show(value, digits, self.about.spacing);
        match (row.cells[column], self.floor(column)) {
            (None, _) => "-".into(),
            (Some(spread), Some(floor)) if spread.median.abs() < floor => format!("≤ {}", words(floor)),
            (Some(Spread { median, min, max }), _) if min < max => {
                format!("{} ({}-{})", words(median), words(min), words(max))
            }
            (Some(spread), _) => words(spread.median),
        }
    }

    /// The headings, then each setting, numbered and marked as the knee or on the front, and last the reference.
    pub(crate) fn lines(&self, to: Shown, digits: i32) -> Vec<(&'static str, Vec<String>)> {
        let headings = self.shown(to).map(|column| self.columns[column].heading.to_owned());
        let with_passes = to == Shown::Page && self.rows.iter().any(|row| !row.passes.is_empty());
        let head = ["#", "setting"].map(String::from).into_iter().chain(headings);
        let passes = with_passes.then(|| "where the time goes".to_owned());
        let head = head.chain(passes).chain([String::new()]).collect();
        let line = |number: String, row: &TableRow, mark: &'static str| {
            let mut cells = vec![number, row.setting.label.clone()];
            cells.extend(self.shown(to).map(|column| self.cell(row, column, digits)));
            let pass = |(name, seconds): &(String, f64)| {
                format!("{name} {}", Unit::Seconds.show(*seconds, digits, 1.0))
            };
            cells.extend(with_passes.then(|| row.passes.iter().map(pass).collect::<Vec<_>>().join(", ")));
            cells.push(if row.diverged.is_some() { "diverged" } else { mark }.into());
            (mark, cells)
        };
        let settings = (1..).zip(&self.rows).map(|(number, row)| line(number.to_string(), row, row.mark));
        let reference = line(String::new(), &self.reference, "reference");
        [("", head)].into_iter().chain(settings).chain([reference]).collect()
    }

    /// What the columns mean, each with its heading, and how far the reference can be trusted.
    pub(crate) fn legend(&self, to: Shown, digits: i32) -> Vec<(&'static str, String)> {
        let by = self.columns[self.by];
        let time = if by.timed_by == SECONDS { "time" } else { "its own time" };
        let front = format!(
            "no other setting is better in both {time} and {}; knee: after it, more time buys little",
            by.heading
        );
        let meanings =
            self.shown(to).map(|column| self.columns[column]).filter(|info| !info.meaning.is_empty());
        let meanings = meanings.map(|info| (info.heading, info.meaning.to_owned()));
        let certainty = format!(
            "the reference differs from its own refinement by {}: smaller errors show as ≤",
            self.uncertainty(digits)
        );
        let remarks = self.about.remarks.iter().cloned();
        let outside =
            self.bounds(digits).map(|bounds| (OUTSIDE, format!("not recommended; the bounds are {bounds}")));
        [("front", front)]
            .into_iter()
            .chain(outside)
            .chain(meanings)
            .chain([("certainty", certainty)])
            .chain(remarks)
            .collect()
    }

    /// How far the reference is from its refinement, in words.
    pub(crate) fn uncertainty(&self, digits: i32) -> String {
        let compared = self.shown(Shown::Page).filter(|&column| self.columns[column].needs_reference);
        let words = compared.map(|column| {
            format!("{} {}", self.columns[column].heading, self.cell(&self.refined, column, digits))
        });
        words.collect::<Vec<_>>().join(", ")
    }

    /// The table as JSON, in SI units, with fractions for per cent.
    pub(crate) fn json(&self) -> Json {
        let mut out = Map::new();
        let mut put = |key: &str, value: Json| out.insert(key.into(), value);
        put("title", json!(self.about.title));
        self.about.facts.iter().for_each(|(key, value)| _ = put(key, value.clone()));
        put("threads", json!(self.threads));
        put("by", json!(self.columns[self.by].criterion));
        put("lines", self.rows.iter().map(|row| self.json_row(row)).collect());
        put("reference", self.json_row(&self.reference));
        put("refined", self.json_row(&self.refined));
        put("uncertainty", self.json_row(&self.refined)["apart"].take());
        put("knee", json!(self.knee));
        let bounds = self.columns.iter().filter_map(|info| Some((info.key.to_owned(), json!(info.bound?))));
        put("bounds", Json::Object(bounds.collect()));
        out.into()
    }

    fn json_row(&self, row: &TableRow) -> Json {
        let Setting { label, quality, set } = &row.setting;
        let mut out = json!({ "label": label, "set": set, "quality": quality });
        for (info, cell) in self.columns.iter().zip(&row.cells) {
            let value = match info.unit {
                Unit::Seconds => json!(cell),
                unit if unit.is_whole() => json!(cell.map(|spread| spread.median as u64)),
                _ => json!(cell.map(|spread| spread.median)),
            };
            match (info.needs_reference, info.key.split_once('.')) {
                (true, _) => out["apart"][info.key] = value,
                (false, Some((group, key))) => out[group][key] = value,
                (false, None) => out[info.key] = value,
            }
        }
        row.passes.iter().for_each(|(pass, seconds)| out["passes"][pass.replace(' ', "_")] = json!(seconds));
        out["diverged"] = json!(row.diverged);
        out["same_as"] = json!(row.same_as);
        out["outside"] = self.outside(row).map(|column| self.columns[column].key).collect();
        out["front"] = json!(["front", "knee"].contains(&row.mark));
        out["knee"] = json!(row.mark == "knee");
        out
    }

    /// The table in full for spreadsheets, as lines of fields: what JSON has of each setting, the reference and its
    /// refinement. Fields without a value are empty.
    pub(crate) fn csv(&self) -> Vec<Vec<String>> {
        let rows: Vec<Vec<(String, String)>> = self.all().map(|row| flat("", &self.json_row(row))).collect();
        let mut head: Vec<&String> = Vec::new();
        for (name, _) in rows.iter().flatten() {
            if !head.contains(&name) {
                head.push(name);
            }
        }
        let field = |row: &[(String, String)], name: &String| {
            row.iter().find(|(known, _)| known == name).map_or_else(String::new, |(_, value)| value.clone())
        };
        let lines = rows.iter().map(|row| head.iter().map(|name| field(row, name)).collect());
        [head.iter().map(|name| (*name).clone()).collect()].into_iter().chain(lines).collect()
    }

    /// Every row, the reference and its refinement last.
    fn all(&self) -> impl Iterator<Item = &TableRow> {
        self.rows.iter().chain([&self.reference, &self.refined])
    }
}

/// The values in a JSON object by their keys, those of objects within joined by `_`.
fn flat(key: &str, value: &Json) -> Vec<(String, String)> {
    let join = |inner: &str| if key.is_empty() { inner.to_owned() } else { format!("{key}_{inner}") };
    match value {
        Json::Object(map) => map.iter().flat_map(|(inner, value)| flat(&join(inner), value)).collect(),
        Json::Array(list) => {
            let words: Vec<&str> = list.iter().filter_map(Json::as_str).collect();
            vec![(key.into(), words.join(" "))]
        }
        Json::Null => Vec::new(),
        Json::String(text) => vec![(key.into(), text.clone())],
        other => vec![(key.into(), other.to_string())],
    }
}

/// The mark of a row with a figure out of its column's bound.
const OUTSIDE: &str = "outside";

/// The place of [`Costs::shot_seconds`] among the columns.
const SHOT_SECONDS: usize = 2;

/// The column of a criterion.
fn criterion(columns: &[ColumnInfo], name: &str) -> usize {
    columns.iter().position(|info| info.criterion == Some(name)).expect("criteria are columns of the table")
}
