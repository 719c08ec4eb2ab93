//! Resources used by this process so far, where the system reports them: on Linux, by `/proc`.

use std::time::{Duration, Instant};

/// A time in words: "12 s", "3 min 20 s", "7 h 05 min".
pub(crate) fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..10 => format!("{seconds:.1} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// Processor time of all threads so far [s], in steps of 10 ms; `None` where the system does not report it.
pub(crate) fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name comes first, in brackets, and may hold anything.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |place: usize| fields.get(place)?.parse::<f64>().ok();
    Some((ticks(USER)? + ticks(SYSTEM)?) / TICKS_PER_SECOND)
}

/// Measures work by processor time where the system reports it, since that is the same on a busy machine; else by time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meter {
    start: Instant,
    cpu: Option<f64>,
}

impl Meter {
    /// Starts now.
    pub(crate) fn new() -> Self {
        Self { start: Instant::now(), cpu: cpu_seconds() }
    }

    /// Work since the start [s].
    pub(crate) fn work(&self) -> f64 {
        self.cpu().unwrap_or_else(|| self.wall())
    }

    /// The time `seconds` [s] after the start.
    pub(crate) fn after(&self, seconds: f64) -> Instant {
        self.start + Duration::from_secs_f64(seconds)
    }

    /// Wall-clock time since the start [s].
    pub(crate) fn wall(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Processor time since the start [s].
    pub(crate) fn cpu(&self) -> Option<f64> {
        Some(cpu_seconds()? - self.cpu?)
    }
}

/// Peak of the resident memory of this process since a moment.
///
/// What the allocator keeps of freed memory is held too: up to some ten MiB a thread of what ran before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peak {
    /// Whether the system's mark could be set back.
    is_known: bool,
}

impl Peak {
    /// Forgets what was before.
    pub(crate) fn since_now() -> Self {
        Self { is_known: std::fs::write("/proc/self/clear_refs", "5").is_ok() }
    }

    /// Peak of resident memory since then [bytes]; `None` where the system does not report it.
    pub(crate) fn bytes(&self) -> Option<u64> {
        let status = std::fs::read_to_string("/proc/self/status").ok().filter(|_| self.is_known)?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
        Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? << 10)
    }
}

/// Places of the times in user and system mode, counted from the field after the name.
const USER: usize = 11;
const SYSTEM: usize = 12;

/// The unit of those times: part of Linux's interface, the same on every architecture in use.
const TICKS_PER_SECOND: f64 = 100.0;

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::duration;

    #[test]
    fn durations_are_readable() {
        let printed = [0.04, 9.96, 59.4, 59.6, 3599.6, 25_500.0].map(duration);
        assert_eq!(printed, ["0.0 s", "10 s", "59 s", "1 min 00 s", "1 h 00 min", "7 h 05 min"]);
    }

    #[test]
    fn memory_that_is_held_shows_in_the_peak() {
        let peak = super::Peak::since_now();
        let held = vec![1_u8; 64 << 20];
        let found = peak.bytes();
        assert!(found.is_none_or(|bytes| bytes > 64 << 20), "{found:?}, {}", held[held.len() / 2]);
    }

    #[test]
    fn processor_time_grows_with_work() {
        let before = super::cpu_seconds().unwrap();
        let mut sum = 0.0_f64;
        while super::cpu_seconds().unwrap() < before + 0.02 {
            sum += (0..100_000).map(|i| f64::from(i).sqrt()).sum::<f64>();
        }
        assert!(sum > 0.0);
    }
}
