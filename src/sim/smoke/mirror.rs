//! A plane as a mirror of the air (method of images): panels and sources that are before it.

use super::{panels::Panel, sources::Source};
use crate::math::Vec3;

/// Distance from the mirror at which a point counts as on it, over a panel's width.
pub(super) const TOLERANCE: f32 = 1e-4;

/// Depth of a point source below its panel over the panel's height above the mirror, at most.
const MAX_DEPTH: f32 = 0.6;

/// Depth of such a source over the panel's width, at least: the air next to a shallower one is blown away from it.
const MIN_DEPTH: f32 = 0.3;

/// Whether a panel is in the air or cut in half by the mirror. Panels that lie in the mirror are not.
pub(super) fn is_before(panel: &Panel, mirror: Option<(Vec3, f32)>) -> bool {
    mirror.is_none_or(|(n, offset)| {
        let tolerance = TOLERANCE * panel.width;
        n.dot(&panel.x) - offset - (n.dot(&panel.normal) * 4.0 * tolerance).abs() > -tolerance
    })
}

/// The source of a panel that is before the mirror, and so is the source: its image is in the solid then, too. A point that would be
/// beyond is less deep.
pub(super) fn source_in_air(panel: &Panel, mirror: Option<(Vec3, f32)>) -> Option<Source> {
    let source = panel.source.filter(|_| is_before(panel, mirror))?;
    let Some((n, offset)) = mirror else { return Some(source) };
    match source {
        Source::Point(y) => {
            let (height, depth) = (n.dot(&panel.x) - offset, panel.x - y);
            let part = (MAX_DEPTH * height / n.dot(&depth).max(MAX_DEPTH * height)).min(1.0);
            let is_deep = part == 1.0 || part * depth.norm() > MIN_DEPTH * panel.width;
            is_deep.then(|| Source::Point(panel.x - depth * part))
        }
        // On or below the panel, and possibly cut in half.
        Source::Tile(tile) => (n.dot(&tile.middle) - offset > -TOLERANCE * panel.width).then_some(source),
    }
}
