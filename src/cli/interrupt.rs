//! Ctrl-C and the farm's stop signals: the job stops between two steps, finished frames stay.

use super::{exit, output::print_line};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// How long a job may take to come to the next step.
///
/// Every file is written next to its place and renamed, so leaving at any moment loses only the frame under way.
const PATIENCE: Duration = Duration::from_secs(4);

/// Listens for the signals from now on.
pub(super) fn listen() {
    let handler = || {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            std::process::exit(exit::INTERRUPTED.into());
        }
        print_line("\nstopping; finished frames are kept");
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            std::process::exit(exit::INTERRUPTED.into());
        });
    };
    if let Err(why) = ctrlc::set_handler(handler) {
        print_line(&format!("note: Ctrl-C will stop at once, without waiting for the frame ({why})"));
    }
}

/// Whether the user requested a stop.
pub(super) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}
