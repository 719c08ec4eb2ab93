//! Panel widths of each solid within the limit of panels.
//!
//! *Method*: the matrix of the panel equations has their squared number of entries, so there are [`MAX_PANELS`] in all. A solid
//! whose panels of one spacing fit into an equal share has those. The others share what is left; their panels widen until each
//! solid is within its share. So a small ball next to a large box keeps its panels.
//!
//! A mesh whose vertices move may have a quarter and eight panels more at a time than at its largest area (`body.rs`).
//!
//! Limits: panels are at least one spacing wide, where a solid is largest. A solid that would need panels wider than itself, as among
//! some hundreds of others, has none.

use super::panels::{Panel, PanelGrid, SourceKind, longest, panels, with_sources};
use crate::solid::Shape;

/// Limit of panels of all solids at their largest: the matrix then takes 10 MB, and a solve up to 60 products with it. Where all are of one
/// mesh whose vertices move, 16 MB; of a hundred such meshes, 31 MB.
const MAX_PANELS: usize = 1600;

/// Panels of the first attempt over the limit. Smaller, and the attempt may be coarser than necessary; larger, and large solids take
/// time and memory for panels that are thrown away.
const FIRST_ATTEMPT: f32 = 4.0;

/// Panels of each of `shapes`, `spacing` [m] wide or wider; together at most [`MAX_PANELS`].
pub(super) fn distribute_panels(shapes: &[&Shape], spacing: f32) -> Vec<Vec<Panel>> {
    let first = |shape: &&Shape| {
        let step = spacing.max((shape.area() / (FIRST_ATTEMPT * MAX_PANELS as f32)).sqrt());
        (step, panels(shape, step))
    };
    let mut tries: Vec<(f32, Vec<Panel>)> = shapes.iter().map(first).collect();
    let share = share(tries.iter().map(|(_, panels)| panels.len()).collect());
    for ((step, found), shape) in tries.iter_mut().zip(shapes) {
        while found.len() > share {
            *step *= wider(found.len(), share);
            *found = if *step < longest(shape) { panels(shape, *step) } else { Vec::new() };
        }
    }
    tries.into_iter().map(|(_, panels)| panels).collect()
}

/// Panels of a shape in a grid, or a wider one in which there are at most `limit`, with sources of this kind.
pub(super) fn panels_within(
    shape: &Shape,
    mut grid: PanelGrid,
    kind: SourceKind,
    limit: usize,
) -> Vec<Panel> {
    grid.step = grid.step.max((shape.area() / (FIRST_ATTEMPT * limit as f32)).sqrt());
    loop {
        let found = with_sources(shape, grid, Some(kind));
        if found.len() <= limit {
            return found;
        }
        grid.step *= wider(found.len(), limit);
        if grid.step >= longest(shape) {
            return Vec::new();
        }
    }
}

/// Factor of the width of panels, of which there are more than the limit.
fn wider(count: usize, limit: usize) -> f32 {
    (count as f32 / limit as f32).sqrt().max(1.05)
}

/// Largest number of panels of one solid such that all solids together have at most [`MAX_PANELS`].
fn share(mut counts: Vec<usize>) -> usize {
    counts.sort_unstable();
    let (mut left, mut solids) = (MAX_PANELS, counts.len());
    for count in counts {
        if count > left / solids {
            return left / solids;
        }
        (left, solids) = (left - count, solids - 1);
    }
    MAX_PANELS
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floor() -> Shape {
        Shape::Box { min: [-10.0, -10.0, -20.0], max: [10.0, 10.0, 0.0] }
    }

    fn ball(x: f32, radius: f32) -> Shape {
        Shape::Sphere { center: [x, 0.0, 1.0], radius }
    }

    #[test]
    fn large_solids_share_the_panels_that_small_ones_leave() {
        assert_eq!(share(vec![]), MAX_PANELS);
        assert_eq!(share(vec![50, 1500]), MAX_PANELS);
        assert_eq!(share(vec![5000, 100]), 1500);
        assert_eq!(share(vec![9000, 100, 700, 3000]), 500);
        assert_eq!(share(vec![9000, 100, 300, 3000]), 600);
        assert_eq!(share(vec![1; 2000]), 0);
    }

    #[test]
    fn a_ball_next_to_a_large_box_keeps_its_panels() {
        let (floor, ball) = (floor(), ball(0.0, 0.1));
        let found = distribute_panels(&[&floor, &ball], 0.05);
        let alone = panels(&ball, 0.05);
        assert!(alone.len() > 40 && found[1].len() == alone.len(), "{} of {}", found[1].len(), alone.len());
        let all = found[0].len() + found[1].len();
        assert!((MAX_PANELS / 3..=MAX_PANELS).contains(&all), "{all}");
        for (panels, whole) in found.iter().zip([2400.0, 0.04 * std::f32::consts::PI]) {
            let sum: f32 = panels.iter().map(|panel| panel.area).sum();
            assert!((sum / whole - 1.0).abs() < 0.1, "{sum} for {whole}");
        }
    }

    #[test]
    fn panels_widen_until_they_are_within_their_limit() {
        let grid = PanelGrid { step: 0.02, origin: crate::math::Vec3::zeros() };
        let free = panels_within(&ball(0.0, 0.2), grid, SourceKind::Points, 10_000).len();
        assert!(free > 800, "{free}");
        for limit in [400, 50, 10] {
            let found = panels_within(&ball(0.0, 0.2), grid, SourceKind::Points, limit).len();
            assert!((limit / 3..=limit).contains(&found), "{limit}: {found}");
        }
        assert!(
            panels_within(&ball(0.0, 0.2), grid, SourceKind::Points, 1).is_empty(),
            "one panel encloses nothing"
        );
    }

    #[test]
    fn panels_are_bounded_for_any_number_of_solids() {
        for (count, least) in [(30, MAX_PANELS / 4), (400, 0), (2000, 0)] {
            let balls: Vec<Shape> = (0..count).map(|i| ball(i as f32, 0.2)).collect();
            let found = distribute_panels(&balls.iter().collect::<Vec<_>>(), 0.02);
            let all: usize = found.iter().map(Vec::len).sum();
            assert!((least..=MAX_PANELS).contains(&all), "{count} balls: {all}");
        }
    }
}
