//! Ctrl-C and the farm's stop signals: the job stops between two steps, finished frames stay.

use super::{exit, output::print_line};
use crate::control::CancelToken;
use std::time::Duration;

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
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            std::process::exit(exit::INTERRUPTED.into());
        });
    };
    if let Err(why) = ctrlc::set_handler(handler) {
        print_line(&format!("note: Ctrl-C will stop at once, without waiting for the frame ({why})"));
    }
    token
}
