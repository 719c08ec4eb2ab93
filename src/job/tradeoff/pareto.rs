//! Which settings are worth their time.

use crate::math::elementary::ln;

/// The indices of the points that no other beats: of those that cost no more, none has a smaller error. Ascending
/// in cost. A point is (cost, error); `None`, infinite and undefined points take no part.
pub(crate) fn front(points: &[Option<(f64, f64)>]) -> Vec<usize> {
    let mut order: Vec<(usize, (f64, f64))> = points
        .iter()
        .enumerate()
        .filter_map(|(i, point)| {
            point.filter(|(cost, error)| cost.is_finite() && error.is_finite()).map(|p| (i, p))
        })
        .collect();
    order.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut best = f64::INFINITY;
    order.retain(|&(_, (_, error))| {
        let improves = error < best;
        best = best.min(error);
        improves
    });
    order.into_iter().map(|(i, _)| i).collect()
}

/// The place in `front` (points ascending in cost, descending in error) after which more time buys little: the one
/// farthest below the straight line between the ends, both axes logarithmic. `None` if no point lies below it.
pub(crate) fn knee(front: &[(f64, f64)]) -> Option<usize> {
    let log = |(cost, error): (f64, f64)| (ln(cost.max(MIN_LOGARITHM)), ln(error.max(MIN_LOGARITHM)));
    let (first, last) = (log(*front.first()?), log(*front.last()?));
    let (width, height) = (last.0 - first.0, first.1 - last.1);
    if width <= 0.0 || height <= 0.0 {
        return None;
    }
    let below = |point: (f64, f64)| {
        let (x, y) = log(point);
        1.0 - (x - first.0) / width - (y - last.1) / height
    };
    let deepest = (0..front.len()).max_by(|&a, &b| below(front[a]).total_cmp(&below(front[b])))?;
    (below(front[deepest]) > MIN_BEND).then_some(deepest)
}

/// The knee of a front of `points`, as a place among them.
pub(crate) fn knee_of(points: &[Option<(f64, f64)>], front: &[usize]) -> Option<usize> {
    let held: Vec<_> = front.iter().map(|&i| points[i].expect("points on the front are there")).collect();
    knee(&held).map(|place| front[place])
}

/// The smallest number whose logarithm is taken: stands for zero.
const MIN_LOGARITHM: f64 = 1e-12;

/// A bend smaller than this, as a part of the axes' length, is measuring noise.
const MIN_BEND: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points =
            [(1.0, 9.0), (2.0, 5.0), (2.0, 6.0), (3.0, 5.0), (4.0, 1.0), (9.0, 1.0), (0.5, f64::NAN)]
                .map(Some);
        assert_eq!(front(&points), [0, 1, 4]);
        assert_eq!(front(&[None, Some((1.0, 1.0))]), [1]);
        assert!(front(&[]).is_empty() && front(&[Some((f64::INFINITY, 0.0))]).is_empty());
    }

    #[test]
    fn the_knee_is_where_the_curve_bends() {
        assert_eq!(knee(&[(1.0, 100.0), (2.0, 4.0), (40.0, 2.0), (100.0, 1.0)]), Some(1));
        // A straight line, two points, one point and a concave front have none.
        assert_eq!(knee(&[(1.0, 100.0), (10.0, 10.0), (100.0, 1.0)]), None);
        assert_eq!(knee(&[(1.0, 2.0), (2.0, 1.0)]), None);
        assert_eq!(knee(&[(1.0, 2.0)]), None);
        assert_eq!(knee(&[]), None);
        assert_eq!(knee(&[(1.0, 100.0), (10.0, 90.0), (100.0, 1.0)]), None);
        assert_eq!(knee(&[(1.0, 1.0), (2.0, 0.1), (300.0, 0.0)]), None, "an error of 0 is only very small");
    }

    proptest! {
        #[test]
        fn every_point_is_on_the_front_or_beaten(points in prop::collection::vec((1..20_u32, 1..20_u32), 1..30)) {
            let points: Vec<_> = points.into_iter().map(|(c, e)| Some((f64::from(c), f64::from(e)))).collect();
            let found = front(&points);
            for (i, point) in points.iter().enumerate() {
                let (cost, error) = point.unwrap();
                let beaten = found.iter().any(|&j| {
                    let (c, e) = points[j].unwrap();
                    c <= cost && e <= error
                });
                prop_assert!(beaten, "{} is neither", i);
            }
            let shown: Vec<_> = found.iter().map(|&i| points[i].unwrap()).collect();
            prop_assert!(shown.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 > w[1].1));
        }
    }
}
