//! How a job's progress is shown.

use super::{
    args::ProgressStyle,
    output::{open_jd, say},
};
use crate::run::Reporter;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle as BarStyle};
use std::{
    io::IsTerminal,
    sync::{Arc, Mutex, MutexGuard},
    time::{Duration, Instant},
};

/// The reporter for a style.
pub(super) fn reporter(style: ProgressStyle) -> Box<dyn Reporter> {
    let terminal = std::io::stderr().is_terminal();
    match style {
        ProgressStyle::Auto if terminal => Box::new(Bar::default()),
        ProgressStyle::Bar => Box::new(Bar::default()),
        ProgressStyle::Auto | ProgressStyle::Plain => Box::new(Lines::new(Form::Plain)),
        ProgressStyle::Json => Box::new(Lines::new(Form::Json)),
        ProgressStyle::Openjd => Box::new(Lines::new(Form::OpenJd)),
        ProgressStyle::None => Box::new(Quiet),
    }
}

/// A bar with the time left.
#[derive(Default)]
struct Bar {
    bar: Mutex<Option<ProgressBar>>,
}

/// Steps of the bar within a frame.
const STEPS: f64 = 1000.0;

impl Bar {
    fn with(&self, act: impl FnOnce(&ProgressBar)) {
        if let Some(bar) = &*lock(&self.bar) {
            act(bar);
        }
    }
}

impl Reporter for Bar {
    fn begin(&self, job: &str, frames: usize) {
        let style =
            BarStyle::with_template("{prefix:>9} {bar:32} {percent:>3}%  {elapsed} gone, {eta} left  {msg}")
                .expect("the template is well formed");
        let total = (frames as f64 * STEPS) as u64;
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(10))
            .with_style(style)
            .with_prefix(job.to_owned())
            .with_message(format!("of {frames} frames"));
        bar.enable_steady_tick(Duration::from_millis(200));
        *lock(&self.bar) = Some(bar);
    }

    fn progress(&self, frames_done: f64) {
        self.with(|bar| bar.set_position((frames_done * STEPS) as u64));
    }

    fn frame(&self, figures: &str) {
        self.with(|bar| bar.set_message(figures.to_owned()));
    }

    fn note(&self, text: &str) {
        let drawn = lock(&self.bar).as_ref().map(|bar| bar.suspend(|| say(&format!("note: {text}"))));
        if drawn.is_none() {
            say(&format!("note: {text}"));
        }
    }

    fn end(&self) {
        if let Some(bar) = lock(&self.bar).take() {
            bar.finish();
        }
    }

    fn stop(&self) {
        if let Some(bar) = lock(&self.bar).take() {
            bar.abandon();
        }
    }
}

/// Lines for logs, farms and scripts.
struct Lines {
    talk: Arc<Talk>,
}

/// What is said, and how.
struct Talk {
    form: Form,
    job: Mutex<Job>,
}

#[derive(Clone, Copy, PartialEq)]
enum Form {
    Plain,
    Json,
    OpenJd,
}

struct Job {
    name: String,
    frames: usize,
    percent: f64,
    running: bool,
    said: Instant,
}

/// Longest silence. Farms take a silent job for a dead one.
const SILENCE: Duration = Duration::from_secs(8);

impl Lines {
    /// A reporter that speaks up by itself when a job is silent for long.
    fn new(form: Form) -> Self {
        let job = Job { name: String::new(), frames: 0, percent: 0.0, running: false, said: Instant::now() };
        let talk = Arc::new(Talk { form, job: Mutex::new(job) });
        let listener = Arc::downgrade(&talk);
        std::thread::spawn(move || {
            while let Some(talk) = listener.upgrade() {
                talk.break_silence();
                drop(talk);
                std::thread::sleep(Duration::from_secs(1));
            }
        });
        Self { talk }
    }
}

impl Talk {
    fn break_silence(&self) {
        let job = &mut *lock(&self.job);
        if job.running && job.said.elapsed() >= SILENCE {
            self.say(job);
        }
    }

    fn say(&self, job: &mut Job) {
        job.said = Instant::now();
        let percent = job.percent;
        match self.form {
            Form::Plain => say(&format!("Progress: {percent:.0}%")),
            Form::Json => self.json("progress", &serde_json::json!({ "job": job.name, "percent": percent })),
            Form::OpenJd => open_jd(&format!("openjd_progress: {percent:.1}")),
        }
    }

    fn json(&self, event: &str, body: &serde_json::Value) {
        say(&serde_json::json!({ "event": event, "data": body }).to_string());
    }

    fn text(&self, event: &str, text: &str) {
        match self.form {
            Form::Plain if event == "note" => say(&format!("note: {text}")),
            Form::Plain => say(text),
            Form::Json => self.json(event, &serde_json::json!({ "text": text })),
            Form::OpenJd => open_jd(&format!("openjd_status: {text}")),
        }
    }
}

impl Reporter for Lines {
    fn begin(&self, name: &str, frames: usize) {
        *lock(&self.talk.job) =
            Job { name: name.to_owned(), frames, percent: 0.0, running: true, said: Instant::now() };
        self.talk.text("begin", &format!("{name}: {frames} frames"));
    }

    fn progress(&self, frames_done: f64) {
        let job = &mut *lock(&self.talk.job);
        let percent = 100.0 * frames_done / (job.frames.max(1) as f64);
        let whole = percent.floor() > job.percent.floor();
        job.percent = percent;
        // Plain lines have one a frame; percents follow by the clock.
        if whole && self.talk.form != Form::Plain {
            self.talk.say(job);
        }
    }

    fn frame(&self, figures: &str) {
        self.talk.text("frame", figures);
    }

    fn note(&self, text: &str) {
        self.talk.text("note", text);
    }

    fn end(&self) {
        let job = &mut *lock(&self.talk.job);
        let finished = job.percent >= 100.0 && self.talk.form != Form::Plain;
        job.percent = 100.0;
        job.running = false;
        if !finished {
            self.talk.say(job);
        }
    }

    fn stop(&self) {
        lock(&self.talk.job).running = false;
    }
}

/// Says nothing.
struct Quiet;

impl Reporter for Quiet {
    fn begin(&self, _job: &str, _frames: usize) {}
    fn progress(&self, _frames_done: f64) {}
    fn frame(&self, _figures: &str) {}
    fn note(&self, _text: &str) {}
    fn end(&self) {}
    fn stop(&self) {}
}

/// Progress is shown even if a job panicked while it held the lock.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
