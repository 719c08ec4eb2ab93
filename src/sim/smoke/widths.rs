//! How wide the panels of each solid are.
//!
//! *Method*: the equations of all panels take as many numbers squared, so there are [`MOST`] in all. A solid whose panels of one
//! spacing are no more than an even share has them so; what it leaves is shared by the others, whose panels widen until each is
//! within its share. So a ball beside a large box keeps its panels, and the box has what is left.
//!
//! Limits: panels are at least one spacing wide. A solid that would need wider ones than it is long, as among some hundreds of others,
//! has none.

use super::{
    areas::area,
    panels::{Panel, longest, panels},
};
use crate::solid::Shape;

/// Panels of all solids at most: the matrix then takes 10 MB, and a solve up to 60 products with it.
pub(super) const MOST: usize = 1600;

/// Panels of the first try over the most there may be. Fewer, and a try may already be coarser than it need be; more, and large
/// solids take time and memory for panels that are thrown away.
const FIRST: f32 = 4.0;

/// The panels of each of `shapes`, `spacing` [m] wide or wider; together at most [`MOST`].
pub(super) fn shared_out(shapes: &[&Shape], spacing: f32) -> Vec<Vec<Panel>> {
    let first = |shape: &&Shape| {
        let step = spacing.max((area(shape) / (FIRST * MOST as f32)).sqrt());
        (step, panels(shape, step))
    };
    let mut tries: Vec<(f32, Vec<Panel>)> = shapes.iter().map(first).collect();
    let share = share(tries.iter().map(|(_, panels)| panels.len()).collect());
    for ((step, found), shape) in tries.iter_mut().zip(shapes) {
        while found.len() > share {
            *step *= (found.len() as f32 / share as f32).sqrt().max(1.05);
            *found = if *step < longest(shape) { panels(shape, *step) } else { Vec::new() };
        }
    }
    tries.into_iter().map(|(_, panels)| panels).collect()
}

/// The most panels of one solid, so that all have [`MOST`] if those with more than that have so many.
fn share(mut counts: Vec<usize>) -> usize {
    counts.sort_unstable();
    let (mut left, mut solids) = (MOST, counts.len());
    for count in counts {
        if count > left / solids {
            return left / solids;
        }
        (left, solids) = (left - count, solids - 1);
    }
    MOST
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
    fn what_small_solids_leave_is_shared_by_large_ones() {
        assert_eq!(share(vec![]), MOST);
        assert_eq!(share(vec![50, 1500]), MOST);
        assert_eq!(share(vec![5000, 100]), 1500);
        assert_eq!(share(vec![9000, 100, 700, 3000]), 500);
        assert_eq!(share(vec![9000, 100, 300, 3000]), 600);
        assert_eq!(share(vec![1; 2000]), 0);
    }

    #[test]
    fn a_ball_beside_a_large_box_keeps_its_panels() {
        let (floor, ball) = (floor(), ball(0.0, 0.1));
        let found = shared_out(&[&floor, &ball], 0.05);
        let alone = panels(&ball, 0.05);
        assert!(alone.len() > 40 && found[1].len() == alone.len(), "{} of {}", found[1].len(), alone.len());
        let all = found[0].len() + found[1].len();
        assert!((MOST / 3..=MOST).contains(&all), "{all}");
        for (panels, whole) in found.iter().zip([2400.0, 0.04 * std::f32::consts::PI]) {
            let sum: f32 = panels.iter().map(|panel| panel.area).sum();
            assert!((sum / whole - 1.0).abs() < 0.1, "{sum} for {whole}");
        }
    }

    #[test]
    fn however_many_solids_there_are_panels_are_bounded() {
        for (count, least) in [(30, MOST / 4), (400, 0), (2000, 0)] {
            let balls: Vec<Shape> = (0..count).map(|i| ball(i as f32, 0.2)).collect();
            let found = shared_out(&balls.iter().collect::<Vec<_>>(), 0.02);
            let all: usize = found.iter().map(Vec::len).sum();
            assert!((least..=MOST).contains(&all), "{count} balls: {all}");
        }
    }
}
