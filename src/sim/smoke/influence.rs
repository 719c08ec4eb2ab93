//! Influence coefficients of source panels: the normal velocity that each source of unit density induces at each panel.

use super::{panels::Panel, sources::Source};
use crate::{
    math::{Vec3, dot},
    par,
};

/// Rows that one task multiplies.
const ROWS: usize = 32;

/// The coefficients of panels with one source each, times 4π, and their unknowns.
#[derive(Debug)]
pub(super) struct Influence {
    /// Each source, and the factor from its unknown to its strength: of a point the squared width of its panel [m²], else 1.
    pub(super) unknowns: Vec<(Source, f32)>,
    /// Row i: normal velocity at panel i.
    rows: Vec<f32>,
}

impl Influence {
    /// The coefficients at `panels`, which have one source each, with their images in a mirror.
    pub(super) fn new(panels: &[Panel], mirror: Option<(Vec3, f32)>) -> Self {
        let unknown = |panel: &Panel| match panel.source.expect("a source each") {
            point @ Source::Point(_) => (point, panel.width.powi(2)),
            tile @ Source::Tile(_) => (tile, 1.0),
        };
        let unknowns: Vec<(Source, f32)> = panels.iter().map(unknown).collect();
        let count = panels.len();
        let mut rows = vec![0.0; count * count];
        par::for_chunks(&mut rows, count, |start, row| {
            let Panel { x, normal, .. } = panels[start / count];
            for (entry, (source, factor)) in row.iter_mut().zip(&unknowns) {
                *entry = normal.dot(&source.flow(x, mirror)) * factor;
            }
        });
        Self { unknowns, rows }
    }

    /// The product with a vector of unknowns.
    pub(super) fn product(&self, q: &[f64]) -> Vec<f64> {
        let count = self.unknowns.len();
        let mut out = vec![0.0; count];
        par::for_chunks(&mut out, ROWS, |start, out| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = dot(&self.rows[(start + i) * count..][..count], q);
            }
        });
        out
    }
}
