//! How a job's progress is shown.

use super::{
    args::ProgressStyle,
    output::{is_terminal, open_jd, print_line},
};
use crate::{control::printable, run::Reporter};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle as BarStyle};
use std::{
    sync::{Arc, Mutex, MutexGuard},
    time::{Duration, Instant},
};

/// The reporter for a style.
pub(super) fn reporter(style: ProgressStyle) -> Box<dyn Reporter> {
    match style {
        ProgressStyle::Auto if is_terminal() => Box::new(Bar::default()),
        ProgressStyle::Bar => Box::new(Bar::default()),
        ProgressStyle::Auto | ProgressStyle::Plain => Box::new(Lines::new(Form::Plain)),
        ProgressStyle::Json => Box::new(Lines::new(Form::Json)),
        ProgressStyle::Openjd => Box::new(Lines::new(Form::OpenJd)),
        ProgressStyle::None => Box::new(Notes),
    }
}

/// No progress; what the user should know is printed.
struct Notes;

impl Reporter for Notes {
    fn begin(&self, _job: &str, _frames: usize) {}
    fn progress(&self, _frames_done: f64) {}
    fn frame(&self, _figures: &str) {}
    fn note(&self, text: &str) {
        print_line(&format!("note: {text}"));
    }
    fn end(&self) {}
    fn stop(&self) {}
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
            .with_prefix(printable(job).into_owned())
            .with_message(format!("of {frames} frames"));
        bar.enable_steady_tick(Duration::from_millis(200));
        *lock(&self.bar) = Some(bar);
    }

    fn progress(&self, frames_done: f64) {
        self.with(|bar| bar.set_position((frames_done * STEPS) as u64));
    }

    fn frame(&self, figures: &str) {
        self.with(|bar| bar.set_message(printable(figures).into_owned()));
    }

    fn suspended(&self, print: &mut dyn FnMut()) {
        match &*lock(&self.bar) {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    fn note(&self, text: &str) {
        self.suspended(&mut || print_line(&format!("note: {text}")));
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
    output: Arc<Output>,
}

/// Output form of the lines and the job they report.
struct Output {
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
    last_print: Instant,
}

/// Longest silence. Farms take a silent job for a dead one.
const SILENCE: Duration = Duration::from_secs(8);

impl Lines {
    /// A reporter that speaks up by itself when a job is silent for long.
    fn new(form: Form) -> Self {
        let job =
            Job { name: String::new(), frames: 0, percent: 0.0, running: false, last_print: Instant::now() };
        let output = Arc::new(Output { form, job: Mutex::new(job) });
        let listener = Arc::downgrade(&output);
        let speak_up = move || {
            while let Some(output) = listener.upgrade() {
                output.break_silence();
                drop(output);
                std::thread::sleep(Duration::from_secs(1));
            }
        };
        // Without a thread the job is silent between its frames.
        let _ = std::thread::Builder::new().spawn(speak_up);
        Self { output }
    }
}

impl Output {
    fn break_silence(&self) {
        let job = &mut *lock(&self.job);
        if job.running && job.last_print.elapsed() >= SILENCE {
            self.print_progress(job);
        }
    }

    fn print_progress(&self, job: &mut Job) {
        job.last_print = Instant::now();
        let percent = job.percent;
        match self.form {
            Form::Plain => print_line(&format!("Progress: {percent:.0}%")),
            Form::Json => self.json("progress", &serde_json::json!({ "job": job.name, "percent": percent })),
            Form::OpenJd => open_jd("progress", &format!("{percent:.1}")),
        }
    }

    fn json(&self, event: &str, body: &serde_json::Value) {
        print_line(&serde_json::json!({ "event": event, "data": body }).to_string());
    }

    fn text(&self, event: &str, text: &str) {
        match self.form {
            Form::Plain if event == "note" => print_line(&format!("note: {text}")),
            Form::Plain => print_line(text),
            Form::Json => self.json(event, &serde_json::json!({ "text": text })),
            Form::OpenJd => open_jd("status", text),
        }
    }
}

impl Reporter for Lines {
    fn begin(&self, name: &str, frames: usize) {
        *lock(&self.output.job) =
            Job { name: name.to_owned(), frames, percent: 0.0, running: true, last_print: Instant::now() };
        self.output.text("begin", &format!("{name}: {frames} frames"));
    }

    fn progress(&self, frames_done: f64) {
        let job = &mut *lock(&self.output.job);
        let percent = 100.0 * frames_done / (job.frames.max(1) as f64);
        let whole = percent.floor() > job.percent.floor();
        job.percent = percent;
        // Plain lines have one a frame; percents follow by the clock.
        if whole && self.output.form != Form::Plain {
            self.output.print_progress(job);
        }
    }

    fn frame(&self, figures: &str) {
        self.output.text("frame", figures);
    }

    fn note(&self, text: &str) {
        self.output.text("note", text);
    }

    fn end(&self) {
        let job = &mut *lock(&self.output.job);
        let finished = job.percent >= 100.0 && self.output.form != Form::Plain;
        job.percent = 100.0;
        job.running = false;
        if !finished {
            self.output.print_progress(job);
        }
    }

    fn stop(&self) {
        lock(&self.output.job).running = false;
    }
}

/// Progress is shown even if a job panicked while it held the lock.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
