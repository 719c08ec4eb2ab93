//! A call on threads of its own, so that it can be left where the system refuses it memory.

use crate::{
    memory::{CallMemory, is_granted},
    outcome::Outcome,
    request::{Failure, panic_text},
};
use meniscus::{control::CancelToken, par::ThreadsRefused};
use std::{
    fmt::Display,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::Duration,
};

/// Interval at which the caller looks for a call that was abandoned.
const POLL: Duration = Duration::from_millis(100);

/// Memory of a thread's stack [bytes].
const STACK: u64 = 2 << 20;

/// A call that is under way.
struct Call {
    memory: CallMemory,
    /// What the job returned, once it has ended.
    ended: Mutex<Option<Option<Outcome>>>,
}

/// Runs `job` in a thread of its own and returns its outcome. If the system refuses memory, the outcome reports that;
/// if the job had to be abandoned for it, what it uses may be used until the process ends.
pub(crate) fn supervised(
    cancel: CancelToken,
    job: impl FnOnce(&CallMemory) -> Option<Outcome> + Send + 'static,
) -> Option<Outcome> {
    // Later there may be no memory for it.
    let abandoned = Outcome::new(Err(Failure::Abandoned));
    let call = Arc::new(Call { memory: CallMemory::new(cancel), ended: Mutex::new(None) });
    if !call.memory.hold(STACK) {
        return Some(Outcome::new(Err(refused())));
    }
    let theirs = call.clone();
    let started = thread::Builder::new().spawn(move || {
        let Call { memory, ended } = &*theirs;
        let outcome = memory.work_for(|| without_unwinding(|| job(memory)));
        *ended.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
        memory.wake_owner();
    });
    let thread = match started {
        Ok(thread) => thread,
        Err(error) => return Some(Outcome::new(Err(threads_refused(1, error)))),
    };
    loop {
        let ended = call.ended.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(outcome) = ended {
            // Its stack is free when this returns. A panic is an outcome already.
            let _ = thread.join();
            return outcome;
        }
        if call.memory.is_abandoned() {
            return Some(abandoned);
        }
        thread::park_timeout(POLL);
    }
}

/// More than any allocation that the C library serves from memory which it has already, as it does up to 32 MiB: stacks are always new memory
/// [bytes].
const FROM_THE_SYSTEM: u64 = 33 << 20;

/// The result of a job, or the outcome of its panic.
fn without_unwinding(job: impl FnOnce() -> Option<Outcome>) -> Option<Outcome> {
    catch_unwind(AssertUnwindSafe(job))
        .unwrap_or_else(|panic| Some(Outcome::new(Err(Failure::Internal(panic_text(&*panic))))))
}

/// Runs `job` on so many threads (0: one a core) for a call.
pub(crate) fn on_threads<R: Send>(
    memory: &CallMemory,
    threads: usize,
    job: impl FnOnce() -> R + Send,
) -> Result<R, Failure> {
    memory.on_threads(threads, job).map_err(|error: ThreadsRefused| threads_refused(threads, error))
}

/// The failure where so many threads are refused, for lack of memory or by a limit of threads.
fn threads_refused(threads: usize, error: impl Display) -> Failure {
    let count = if threads == 0 { thread::available_parallelism().map_or(1, usize::from) } else { threads };
    // Twice the stacks: the system needs some memory around them, and other threads may have freed some since.
    if !is_granted((2 * count as u64 * STACK).max(FROM_THE_SYSTEM)) {
        let text = format!(
            "the system refused memory for {count} threads ({error}): pass fewer, or allow more (`ulimit -v`)"
        );
        return Failure::Memory(text);
    }
    let named = if threads == 0 { "one for every core".to_owned() } else { threads.to_string() };
    Failure::Parameter(format!(
        "threads: the system refused to start {named} ({error}); pass fewer, or allow more processes (`ulimit -u`) or memory (`ulimit -v`)"
    ))
}

/// The failure where the system refuses memory in the midst of a call.
pub(crate) fn refused() -> Failure {
    Failure::Memory(
        "the system refused memory: end other programs, allow more memory (`ulimit -v`), or choose a larger spacing or voxel"
            .to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{hint::black_box, sync::mpsc};

    #[test]
    fn a_panic_is_an_outcome() {
        let outcome = supervised(CancelToken::new(), |_| panic!("planted")).unwrap();
        assert_eq!((outcome.status(), outcome.text()), (4, "planted"));
        assert!(supervised(CancelToken::new(), |_| None).is_none());
    }

    #[test]
    fn threads_are_refused_for_lack_of_memory_or_by_their_number() {
        let of = |threads| threads_refused(threads, "planted");
        assert!(
            matches!(of(1), Failure::Parameter(text) if text.starts_with("threads: the system refused to start 1 (planted)"))
        );
        assert!(matches!(of(1 << 40), Failure::Memory(text) if text.contains("1099511627776 threads")));
    }

    #[test]
    fn a_call_whose_memory_is_refused_is_left() {
        let cancel = CancelToken::new();
        let (sender, receiver) = mpsc::channel();
        let outcome = supervised(cancel.clone(), move |memory| {
            // Its threads work for the call, too.
            let made = on_threads(memory, 2, || black_box(Vec::<u8>::with_capacity(1 << 50)).capacity());
            sender.send(made.is_ok()).unwrap();
            None
        });
        let outcome = outcome.unwrap();
        assert_eq!(outcome.status(), 6, "{}", outcome.text());
        assert!(cancel.is_cancelled());
        assert!(
            receiver.recv_timeout(Duration::from_millis(200)).is_err(),
            "the thread goes on without memory"
        );
        // Others do not notice.
        assert!(supervised(CancelToken::new(), |_| None).is_none());
    }
}
