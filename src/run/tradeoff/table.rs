//! What every table has: settings, what they cost, the front and the knee, and the setting to use.

use super::{
    Spread,
    pareto::{self, Candidate},
    sweep::Setting,
};
use crate::run::RunError;
use serde::Serialize;
use std::fmt::Debug;

/// What is compared: a system of a shot, or its surfaces. A value holds what its table says besides the lines.
pub trait Compared: Clone + Debug + Serialize {
    /// The errors, one of which decides.
    type By: Copy + Debug + PartialEq + Serialize;
    /// What a run alone tells.
    type Told: Clone + Debug + Serialize;
    /// How far two runs are apart.
    type Apart: Copy + Debug + Default + Serialize;

    /// The error that a limit is about.
    const LIMITED: Self::By;
    /// What to do if the reference diverged, so that nothing can be compared with it.
    const WITHOUT_REFERENCE: &'static str;
    /// Why a line that did not diverge may have no error; `None`: there is nothing to say.
    const INCOMPARABLE: Option<&'static str> = None;

    /// Whether an error is one against the reference.
    fn needs_reference(by: Self::By) -> bool;

    /// The size of an error, if it is known.
    fn error(by: Self::By, told: &Self::Told, apart: &Self::Apart) -> Option<f64>;

    /// The time that an error is set against: that of the whole work, but for errors of one part of it.
    fn seconds(_by: Self::By, line: &Line<Self>) -> Option<Spread> {
        Some(line.seconds)
    }

    /// What limits are in, in the unit of the error that they are about.
    fn unit(&self) -> f64 {
        1.0
    }

    /// A limit in words.
    fn limit(most: f64) -> String;
}

/// One line of the table: a setting, what it cost and what it gave.
#[derive(Clone, Debug, Serialize)]
#[serde(bound = "")]
pub struct Line<C: Compared> {
    /// The keys that the setting changes.
    pub label: String,
    /// The changes, as `--set` takes them.
    pub set: Vec<String>,
    /// The preset's tier, if the setting is one.
    pub quality: Option<String>,
    /// Wall-clock time of the frames' simulation, or of a frame's surface [s].
    pub seconds: Spread,
    /// Processor time of the same [s].
    pub cpu_seconds: Option<Spread>,
    /// The whole shot, if its other frames cost as much [s].
    pub shot_seconds: f64,
    /// What the run alone tells.
    #[serde(flatten)]
    pub told: C::Told,
    /// Distances from the reference.
    pub apart: C::Apart,
    /// Why and where the run ended early.
    pub diverged: Option<String>,
    /// The first line that gave the same, if another did: what tells them apart does nothing here.
    pub same_as: Option<usize>,
    /// Whether nothing beats it, by the chosen error.
    pub front: bool,
}

impl<C: Compared> Line<C> {
    /// A setting that took `seconds` of wall-clock and processor time, before it is compared.
    pub(super) fn new(
        setting: &Setting,
        [seconds, cpu_seconds]: [Option<Spread>; 2],
        shot_seconds: f64,
        told: C::Told,
    ) -> Self {
        Self {
            label: setting.label.clone(),
            set: setting.overrides.set.clone(),
            quality: setting.overrides.quality.map(|tier| tier.name().into()),
            seconds: seconds.expect("what is told of has been run"),
            cpu_seconds,
            shot_seconds,
            told,
            apart: C::Apart::default(),
            diverged: None,
            same_as: None,
            front: false,
        }
    }
}

/// The result of a tradeoff.
#[derive(Clone, Debug, Serialize)]
#[serde(bound = "")]
pub struct Table<C: Compared> {
    /// The shot's name.
    pub title: String,
    /// What was compared.
    #[serde(flatten)]
    pub about: C,
    /// Threads that computed.
    pub threads: usize,
    /// The error that decides.
    pub by: C::By,
    /// The settings.
    pub lines: Vec<Line<C>>,
    /// The reference.
    pub reference: Line<C>,
    /// The reference refined once more.
    pub refined: Line<C>,
    /// How far these two are apart: smaller errors cannot be told from none.
    pub uncertainty: C::Apart,
    /// The line after which more time buys little.
    pub knee: Option<usize>,
}

impl<C: Compared> Table<C> {
    /// The lines with their front and knee. The refinement of the reference has its distance from that.
    pub(super) fn new(
        title: &str,
        about: C,
        by: C::By,
        lines: Vec<Line<C>>,
        [reference, refined]: [Line<C>; 2],
    ) -> Self {
        let mut table = Self {
            title: title.into(),
            about,
            threads: crate::par::threads(),
            by,
            lines,
            reference,
            uncertainty: refined.apart,
            refined,
            knee: None,
        };
        let front = table.front(by);
        table.knee = pareto::knee_of(&table.points(by), &front);
        for i in front {
            table.lines[i].front = true;
        }
        table
    }

    /// How small an error against the reference can be seen at all, if that is known.
    pub fn floor(&self, by: C::By) -> Option<f64> {
        if C::needs_reference(by) { C::error(by, &self.refined.told, &self.uncertainty) } else { None }
    }

    /// The error of a line as it can be judged: at least the reference's own uncertainty. `None` if there is none, or the run
    /// diverged.
    pub fn judged(&self, line: &Line<C>, by: C::By) -> Option<f64> {
        let found = C::error(by, &line.told, &line.apart).filter(|_| line.diverged.is_none());
        found.map(|found| found.max(self.floor(by).unwrap_or(0.0)))
    }

    /// The front by `by`: indices of lines, ascending in cost.
    pub fn front(&self, by: C::By) -> Vec<usize> {
        pareto::front(&self.points(by))
    }

    /// Time and error of every line.
    fn points(&self, by: C::By) -> Vec<Option<(f64, f64)>> {
        let point = |line| Some((C::seconds(by, line)?.median, self.judged(line, by)?));
        self.lines.iter().map(point).collect()
    }

    /// The setting to use: the most exact that takes at most `time` [s] for the whole shot, the cheapest whose error, the one that
    /// limits are about, is at most `dev`, or with neither the knee.
    ///
    /// # Errors
    /// [`RunError::NoSetting`] if no line keeps the limits; [`RunError::Request`] if nothing can be compared, because the
    /// reference diverged.
    pub fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError> {
        if time.is_none() && dev.is_none() {
            return Ok(self.knee);
        }
        let decides = if dev.is_some() { C::LIMITED } else { self.by };
        if C::needs_reference(decides) && self.reference.diverged.is_some() {
            return Err(RunError::Request(format!(
                "the reference diverged, so nobody knows which setting is the most exact; {}",
                C::WITHOUT_REFERENCE
            )));
        }
        let candidate = |line: &Line<C>| Candidate {
            cost: C::seconds(decides, line).unwrap_or(line.seconds).median,
            whole: line.shot_seconds,
            error: self.judged(line, self.by),
            dev: match dev {
                Some(_) => self.judged(line, C::LIMITED).map(|found| found / self.about.unit()),
                None => line.diverged.is_none().then_some(0.0),
            },
        };
        let best = pareto::choose(self.lines.iter().map(candidate), time, dev);
        let wanted = || {
            let time = time.map(|time| format!("{time} s for the shot"));
            [time, dev.map(C::limit)].into_iter().flatten().collect::<Vec<_>>().join(" and ")
        };
        best.map(Some).ok_or_else(|| RunError::NoSetting { wanted: wanted() })
    }
}
