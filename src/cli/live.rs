//! Pictures in the terminal while they are drawn.

use super::output::print_picture;
use crate::{
    image::{Canvas, TerminalPictures},
    run::Reporter,
};
use std::io::IsTerminal;

/// A reporter that shows pictures on stdout too.
pub(super) struct Live<'a> {
    inner: &'a dyn Reporter,
    pictures: TerminalPictures,
}

impl<'a> Live<'a> {
    /// Shows pictures as the terminal declares; `None` if stdout is no terminal, or one that declares none.
    pub(super) fn new(inner: &'a dyn Reporter) -> Option<Self> {
        let pictures =
            std::io::stdout().is_terminal().then(|| TerminalPictures::of(|name| std::env::var(name).ok()));
        pictures.flatten().map(|pictures| Self { inner, pictures })
    }
}

impl Reporter for Live<'_> {
    fn begin(&self, job: &str, frames: usize) {
        self.inner.begin(job, frames);
    }

    fn progress(&self, frames_done: f64) {
        self.inner.progress(frames_done);
    }

    fn frame(&self, figures: &str) {
        self.inner.frame(figures);
    }

    fn suspended(&self, print: &mut dyn FnMut()) {
        self.inner.suspended(print);
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }

    fn end(&self) {
        self.inner.end();
    }

    fn stop(&self) {
        self.inner.stop();
    }

    fn picture(&self, picture: &Canvas) {
        match self.pictures.text(picture) {
            Ok(text) => self.inner.suspended(&mut || print_picture(&text)),
            Err(why) => self.inner.note(&format!("the picture is not shown: {why}")),
        }
    }
}
