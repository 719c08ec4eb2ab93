//! The resolution of sheets that are grids, as something that is varied and has a finer direction.

use super::sweep::Vary;
use crate::{
    scene::{Overrides, Scene},
    sim::sheet::{Select, SheetShape},
};

/// What the cells of a reference are of the finest row's: twice would take reference and refinement 8 and 64 times as long, since substeps
/// become shorter with the cells.
const FINER: f64 = 1.5;

/// What a sheet's cells are called in a preset, after its number.
const KEY: &str = ".shape.grid.cells";

/// The key of the cells of a sheet.
fn key(sheet: usize) -> String {
    format!("sheet.{sheet}{KEY}")
}

/// Whether a key is of the cells of a sheet.
fn is_cells(key: &str) -> bool {
    key.starts_with("sheet.") && key.ends_with(KEY)
}

/// `sheet.0.shape.grid.cells=[8, 8]` as `cells=[8, 8]`; `None` of anything else.
pub(super) fn short(change: &str) -> Option<&str> {
    let (key, _) = change.split_once('=')?;
    is_cells(key).then(|| &change[key.len() - "cells".len()..])
}

/// The sheets that are grids, and their cells.
fn grids(scene: &Scene) -> impl Iterator<Item = (usize, [u32; 2])> {
    scene.sheet.iter().enumerate().filter_map(|(number, sheet)| match sheet.shape {
        SheetShape::Grid { cells, .. } => Some((number, cells)),
        SheetShape::Mesh(_) => None,
    })
}

/// So many times the cells, at least one; where there are none there stay none.
fn times(cells: [u32; 2], factor: f64) -> String {
    let [a, b] = cells.map(|n| (f64::from(n) * factor).round().max(f64::from(n.min(1))));
    format!("[{a}, {b}]")
}

/// All grids with these parts of their cells; `None` without a grid, or where points are named by their numbers, which are others then.
pub(super) fn vary(scene: &Scene, factors: &[f64]) -> Option<Vary> {
    let by_number = |at: &Select| matches!(at, Select::Points(_));
    let joints = scene.sheets.iter().flat_map(|common| &common.joint).flat_map(|joint| &joint.at);
    let mut named = scene.sheet.iter().flat_map(|sheet| &sheet.pin).map(|pin| &pin.at).chain(joints);
    let all: Vec<(usize, [u32; 2])> = grids(scene).collect();
    if all.is_empty() || named.any(by_number) {
        return None;
    }
    let values = |&factor: &f64| all.iter().map(|&(_, cells)| times(cells, factor)).collect();
    Some(Vary {
        keys: all.iter().map(|&(number, _)| key(number)).collect(),
        values: factors.iter().map(values).collect(),
    })
}

/// The overrides with more cells than the most of any of the scenes, for those sheets whose cells are varied.
pub(super) fn refine<'a>(
    overrides: Overrides,
    varied: &[Vary],
    scenes: impl Iterator<Item = &'a Scene> + Clone,
) -> Overrides {
    let mut set = overrides.set;
    for key in varied.iter().flat_map(|vary| &vary.keys).filter(|key| is_cells(key)) {
        let of = |scene: &Scene| grids(scene).find(|(number, _)| self::key(*number) == *key).map(|(_, n)| n);
        let most = scenes.clone().filter_map(of).reduce(|a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        set.extend(most.map(|cells| format!("{key}={}", times(cells, FINER))));
    }
    Overrides { set, ..overrides }
}
