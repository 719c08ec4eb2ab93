//! Triangles in the camera's directions, cut where they leave the part of space that can be drawn.

/// A corner with what is interpolated over a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    /// Place in the camera's directions [m].
    pub(super) at: [f64; 3],
    /// Normal in the world's directions.
    pub(super) normal: [f32; 3],
}

/// Planes through the camera: a point is inside if the product with each is not negative.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frustum {
    planes: [([f64; 3], f64); 5],
}

impl Frustum {
    /// The space in front of the plane `near` [m], within `slopes` to the right and downwards.
    pub(super) fn new(near: f64, slopes: [f64; 2]) -> Self {
        let [x, y] = slopes;
        let side = |normal: [f64; 3]| (normal, 0.0);
        let planes = [
            ([0.0, 0.0, 1.0], -near),
            side([1.0, 0.0, x]),
            side([-1.0, 0.0, x]),
            side([0.0, 1.0, y]),
            side([0.0, -1.0, y]),
        ];
        Self { planes }
    }

    /// Distance on the inner side of a plane, not normalised.
    fn inside(&self, plane: usize, x: &[f64; 3]) -> f64 {
        let (normal, offset) = &self.planes[plane];
        normal[0] * x[0] + normal[1] * x[1] + normal[2] * x[2] + offset
    }

    /// The part of a triangle that is inside, as a convex polygon in `out`, which is empty if there is none.
    pub(super) fn clip(&self, triangle: &[Corner; 3], out: &mut Vec<Corner>) {
        out.clear();
        out.extend_from_slice(triangle);
        let mut next = Vec::new();
        for plane in 0..self.planes.len() {
            let is_cut = out.iter().any(|corner| self.inside(plane, &corner.at) < 0.0);
            if !is_cut {
                continue;
            }
            next.clear();
            for i in 0..out.len() {
                let (a, b) = (out[i], out[(i + 1) % out.len()]);
                let (da, db) = (self.inside(plane, &a.at), self.inside(plane, &b.at));
                if da >= 0.0 {
                    next.push(a);
                }
                if (da >= 0.0) != (db >= 0.0) {
                    // From inside to outside, so that both triangles of an edge are cut at the same place.
                    next.push(match da >= 0.0 {
                        true => between(&a, &b, da / (da - db)),
                        false => between(&b, &a, db / (db - da)),
                    });
                }
            }
            std::mem::swap(out, &mut next);
            if out.len() < 3 {
                out.clear();
                return;
            }
        }
    }
}

/// The corner at the part `t` of the edge from a to b.
fn between(a: &Corner, b: &Corner, t: f64) -> Corner {
    let at = std::array::from_fn(|i| a.at[i] + t * (b.at[i] - a.at[i]));
    let normal = std::array::from_fn(|i| a.normal[i] + t as f32 * (b.normal[i] - a.normal[i]));
    Corner { at, normal }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(at: [f64; 3]) -> Corner {
        Corner { at, normal: [0.0, 0.0, 1.0] }
    }

    #[test]
    fn triangles_are_cut_at_the_near_plane_and_the_sides() {
        let frustum = Frustum::new(1.0, [2.0, 2.0]);
        let mut out = Vec::new();
        let inside = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]].map(corner);
        frustum.clip(&inside, &mut out);
        assert_eq!(out, inside);
        // One corner behind the camera: a quadrangle.
        let half = [[0.0, 0.0, -2.0], [1.0, 0.0, 4.0], [0.0, 1.0, 4.0]].map(corner);
        frustum.clip(&half, &mut out);
        assert_eq!(out.len(), 4);
        assert!(out.iter().all(|corner| corner.at[2] >= 1.0 - 1e-12), "{out:?}");
        frustum.clip(&[[0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, -7.0]].map(corner), &mut out);
        assert!(out.is_empty());
        frustum.clip(&[[-1e9, 0.0, 2.0], [1e9, 0.0, 2.0], [0.0, 1e9, 2.0]].map(corner), &mut out);
        let reach = out.iter().map(|corner| (corner.at[0] / corner.at[2]).abs()).fold(0.0, f64::max);
        assert!(out.len() >= 4 && reach < 2.0 + 1e-6, "{out:?}");
    }

    #[test]
    fn neighbours_are_cut_at_the_same_place() {
        let frustum = Frustum::new(1.0, [2.0, 2.0]);
        let mut state = 1_u32;
        let mut number = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX)
        };
        for _ in 0..200 {
            // An edge through the near plane, and a corner on either side of it.
            let a = corner([number(), number(), 1.1 + number()]);
            let b = corner([number(), number(), -number()]);
            let (c, d) = (corner([0.5, -1.0, 3.0]), corner([0.5, 2.0, 3.0]));
            let (mut first, mut second) = (Vec::new(), Vec::new());
            frustum.clip(&[a, b, c], &mut first);
            frustum.clip(&[b, a, d], &mut second);
            assert!(
                first.iter().filter(|corner| second.contains(corner)).count() >= 2,
                "{first:?} {second:?}"
            );
        }
    }
}
