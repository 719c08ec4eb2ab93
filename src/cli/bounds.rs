//! `meniscus mesh --bounds`: what surfaces would take.

use super::output::print;
use crate::{
    control::printable,
    job::tradeoff::figure,
    math::Vec3,
    product::surface::GridBounds,
    run::{self, BatchRequest, Control, FrameBounds, ProductSettings, RunError, Source},
};

/// Prints the bounds of the surfaces of all frames, and a line for all of them together.
pub(super) fn print_bounds(
    source: Source,
    is_known: bool,
    settings: &ProductSettings,
    batch: &BatchRequest,
    control: Control,
) -> Result<(), RunError> {
    let mut all: Option<[Vec3; 2]> = None;
    let mut frames = 0;
    let result = run::bounds(source, is_known, &settings.surface, batch, control, &mut |found| {
        print(&bounds_line(&found));
        frames += 1;
        if let Some([low, high]) = found.bounds.corners {
            all = Some(all.map_or([low, high], |[lowest, highest]| [lowest.inf(&low), highest.sup(&high)]));
        }
    });
    if let Some(corners) = all.filter(|_| frames > 1) {
        print(&format!("all {frames}: box {}", box_text(corners)));
    }
    result
}

/// One line about the particles of a frame.
fn bounds_line(found: &FrameBounds) -> String {
    let FrameBounds { frame, stream, bounds } = found;
    let mut line = format!("frame {frame}  {}  {} particles", printable(stream), bounds.particles);
    if let Some(corners) = bounds.corners {
        line += &format!("  box {}", box_text(corners));
    }
    if let Some(spacing) = bounds.estimated_spacing {
        line += &format!("  spacing about {} m", figure(spacing.into(), DIGITS));
    }
    match bounds.grid {
        Some(GridBounds { voxel, size: [x, y, z], voxels, memory, is_spacing_estimated }) => {
            let by = if is_spacing_estimated { " by that spacing" } else { "" };
            let about = if memory.is_lower_bound { "more than" } else { "about" };
            line += &format!(
                "  grid{by} {x} × {y} × {z} of {} m, {voxels} voxels near particles, {about} {} MiB",
                figure(voxel.into(), DIGITS),
                memory.bytes >> 20
            );
        }
        None => line += "  no grid: the spacing is not known, add --spacing",
    }
    line
}

/// Digits of lengths.
const DIGITS: i32 = 4;

/// The corners of a box.
fn box_text([low, high]: [Vec3; 2]) -> String {
    let corner = |x: Vec3| [0, 1, 2].map(|axis| figure(x[axis].into(), DIGITS)).join(", ");
    format!("({}) to ({}) m", corner(low), corner(high))
}
