//! Ctrl-C and the farm's stop signals: the job stops between two steps, finished frames stay.

use super::{exit, output::print_line};
use crate::control::CancelToken;
#[cfg(unix)]
use std::{io, sync::Arc};
use std::{thread, time::Duration};

/// How long a job may take to come to the next step.
///
/// Every file is written next to its place and renamed, so leaving at any moment loses only the frame under way.
const PATIENCE: Duration = Duration::from_secs(4);

/// Listens for the signals from now on; the first one cancels the token, the second one exits.
pub(super) fn listen() -> CancelToken {
    let token = CancelToken::new();
    let cancel = token.clone();
    let handler = move || {
        if cancel.is_cancelled() {
            std::process::exit(exit::INTERRUPTED.into());
        }
        cancel.cancel();
        print_line("\nstopping; finished frames are kept");
        let leave = || {
            thread::sleep(PATIENCE);
            std::process::exit(exit::INTERRUPTED.into());
        };
        // Without a thread the job ends at its next step, however long that takes.
        let _ = thread::Builder::new().spawn(leave);
    };
    if let Err(why) = watch(handler) {
        print_line(&format!("note: Ctrl-C will stop at once, without waiting for the frame ({why})"));
    }
    token
}

/// Calls `handler` at each signal to stop that was not ignored when the program started: a job under `nohup`, or in the background
/// of a script, goes on.
#[cfg(unix)]
fn watch(handler: impl Fn() + Send + 'static) -> io::Result<()> {
    use signal_hook::{
        consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
        flag,
        iterator::Signals,
    };
    // Else the limit of the size of a file ends the process without a word; so the write fails, and is reported.
    flag::register(SIGXFSZ, Arc::default())?;
    let ignored = ignored_signals();
    // Where it is not known what is ignored, what `nohup` ignores is left as it is: a hang-up ends the process, and loses no more
    // than the frame under way.
    let candidates = if ignored.is_some() { &[SIGINT, SIGTERM, SIGHUP][..] } else { &[SIGINT, SIGTERM] };
    let is_heard = |signal: &&i32| ignored.is_none_or(|mask| mask >> (**signal - 1) & 1 == 0);
    let mut signals = Signals::new(candidates.iter().filter(is_heard))?;
    thread::Builder::new().spawn(move || signals.forever().for_each(|_| handler())).map(|_| ())
}

#[cfg(not(unix))]
fn watch(handler: impl Fn() + Send + 'static) -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(handler)
}

/// The signals that this process ignores, bit n − 1 for signal n; `None` where the system does not list them.
#[cfg(unix)]
fn ignored_signals() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}
