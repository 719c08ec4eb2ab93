//! Inputs and results of parallel tasks, one slot each.
//!
//! A slot is a mutex, although it is never contended: memory that tasks write at their own index would need `unsafe`, which is
//! in `src/simd/` alone.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The input or the result of every task. A task locks its own slot alone.
pub(super) struct Slots<T>(Vec<Mutex<Option<T>>>);

impl<T> Slots<T> {
    /// One value for every task.
    pub(super) fn of(values: impl IntoIterator<Item = T>) -> Self {
        Self(values.into_iter().map(|value| Mutex::new(Some(value))).collect())
    }

    /// Empty slots for the results of `count` tasks.
    pub(super) fn empty(count: usize) -> Self {
        Self((0..count).map(|_| Mutex::new(None)).collect())
    }

    /// How many tasks there are.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// The value of task `i`.
    ///
    /// # Panics
    /// If it has been taken already.
    pub(super) fn take(&self, i: usize) -> T {
        self.slot(i).take().expect("every task runs once")
    }

    /// Keeps the result of task `i`.
    pub(super) fn put(&self, i: usize, value: T) {
        *self.slot(i) = Some(value);
    }

    /// The results, in order of the tasks.
    ///
    /// # Panics
    /// If a task has left none.
    pub(super) fn into_values(self) -> Vec<T> {
        let value = |slot: Mutex<Option<T>>| slot.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.0.into_iter().map(|slot| value(slot).expect("every task has a result")).collect()
    }

    fn slot(&self, i: usize) -> MutexGuard<'_, Option<T>> {
        self.0[i].lock().unwrap_or_else(PoisonError::into_inner)
    }
}
