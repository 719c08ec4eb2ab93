//! Cameras: from a place and a target to rays and samples, and the camera that frames a box.
//!
//! The conventions are those of the Blender extension: the sensor is 36 mm wide whatever the format of the picture, the horizon is
//! level, and an automatic camera looks at the box from the front, 28° from the left and 18° from above, through a lens of 50 mm.

use super::model::Bounds;
use nalgebra::Vector3;

/// Width of the sensor [mm].
const SENSOR: f64 = 36.0;

/// Focal length of automatic cameras [mm].
const FOCAL_LENGTH: f64 = 50.0;

/// Direction from the target to an automatic camera: azimuth −28°, elevation 18°.
const TOWARD_CAMERA: [f64; 3] = [-0.446_493_5, -0.839_733_4, 0.309_017];

/// Margin of automatic cameras around the box, as a part of its diagonal.
const MARGIN: f64 = 0.06;

/// Distance of the near plane, as a part of the diagonal of what is shown.
const NEAR_PLANE: f64 = 1e-3;

/// Where a camera is, at rest and upright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Viewpoint {
    /// Position [m].
    pub(crate) position: [f64; 3],
    /// The point in the middle of the picture [m].
    pub(crate) target: [f64; 3],
    /// Focal length for a sensor 36 mm wide [mm].
    pub(crate) focal_length: f64,
}

impl Viewpoint {
    /// The camera that sees all of a box with a margin, in a picture of `aspect`, width over height.
    pub(crate) fn framing(bounds: &Bounds, aspect: f64) -> Self {
        let size = bounds.size();
        let margin = MARGIN * size;
        let (low, high) = (bounds.low.add_scalar(-margin), bounds.high.add_scalar(margin));
        let axes = axes(-Vector3::from(TOWARD_CAMERA));
        let half = [0.5 * SENSOR / FOCAL_LENGTH, 0.5 * SENSOR / FOCAL_LENGTH / aspect];
        let corners = (0..8_usize).map(|i| {
            let corner = Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
            axes.map(|axis| axis.dot(&corner))
        });
        // Of the planes on either side: a corner X is inside if ±(X − c) ≤ half (Z − c_z).
        let mut limits = [[f64::NEG_INFINITY; 2]; 2];
        for corner in corners {
            for side in 0..2 {
                let reach = half[side] * corner[2];
                limits[side][0] = limits[side][0].max(corner[side] - reach);
                limits[side][1] = limits[side][1].max(-corner[side] - reach);
            }
        }
        let depth = |side: usize| -(limits[side][0] + limits[side][1]) / (2.0 * half[side]);
        let middle = |side: usize| 0.5 * (limits[side][0] - limits[side][1]);
        let eye = axes[0] * middle(0) + axes[1] * middle(1) + axes[2] * depth(0).min(depth(1));
        let target = eye + axes[2] * (bounds.middle() - eye).dot(&axes[2]);
        Self { position: eye.into(), target: target.into(), focal_length: FOCAL_LENGTH }
    }

    /// Whether every number is finite and within 10⁹, the places differ and the focal length is above 0.
    pub(crate) fn is_valid(&self) -> bool {
        let within = |x: &f64| x.abs() <= 1e9;
        self.position.iter().chain(&self.target).all(within)
            && self.position != self.target
            && (self.focal_length > 0.0 && within(&self.focal_length))
    }
}

/// Right, down and forward direction of a level camera that looks along `forward`, which is not zero.
fn axes(forward: Vector3<f64>) -> [Vector3<f64>; 3] {
    let forward = forward.normalize();
    let level = forward.cross(&Vector3::z());
    // Straight up or down there is no horizon: as Blender, +Y is then up in the picture.
    let right = level.try_normalize(1e-9).unwrap_or_else(Vector3::x);
    [right, forward.cross(&right), forward]
}

/// A perspective projection onto a grid of samples.
#[derive(Clone, Debug)]
pub(super) struct Projection {
    pub(super) eye: Vector3<f64>,
    /// Right, down and forward.
    pub(super) axes: [Vector3<f64>; 3],
    /// Samples per unit of tangent.
    pub(super) focal: f64,
    /// Width and height [samples].
    pub(super) size: [usize; 2],
    /// Distance of the near plane [m].
    pub(super) near: f64,
}

impl Projection {
    /// The projection of a camera onto `size` samples; `extent` is the diagonal of what is shown [m].
    pub(super) fn new(view: &Viewpoint, size: [usize; 2], extent: f64) -> Self {
        let eye = Vector3::from(view.position);
        let axes = axes(Vector3::from(view.target) - eye);
        let focal = size[0] as f64 * view.focal_length / SENSOR;
        Self { eye, axes, focal, size, near: NEAR_PLANE * extent }
    }

    /// A point in the camera's directions [m].
    pub(super) fn to_view(&self, x: Vector3<f64>) -> [f64; 3] {
        let x = x - self.eye;
        self.axes.map(|axis| axis.dot(&x))
    }

    /// Place of a point in front of the camera [samples].
    pub(super) fn to_screen(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let [w, h] = self.size;
        [0.5 * w as f64 + self.focal * x / z, 0.5 * h as f64 + self.focal * y / z]
    }

    /// The ray through the middle of a sample, in the camera's directions; its forward component is 1.
    pub(super) fn ray(&self, x: usize, y: usize) -> [f64; 3] {
        let [w, h] = self.size;
        [(x as f64 + 0.5 - 0.5 * w as f64) / self.focal, (y as f64 + 0.5 - 0.5 * h as f64) / self.focal, 1.0]
    }

    /// A direction from the camera's directions to the world's.
    pub(super) fn to_world(&self, [x, y, z]: [f64; 3]) -> Vector3<f64> {
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::render::model::Bounds;

    #[test]
    fn the_automatic_camera_shows_all_of_a_box_as_large_as_it_can() {
        for (high, aspect) in [([3.0, 1.0, 1.0], 16.0 / 9.0), ([0.1, 0.1, 0.9], 16.0 / 9.0), ([2.0; 3], 0.5)]
        {
            let bounds = Bounds { low: Vector3::zeros(), high: Vector3::from(high) };
            let size = [(1000.0 * aspect) as usize, 1000];
            let view = Viewpoint::framing(&bounds, size[0] as f64 / size[1] as f64);
            assert!(view.is_valid());
            let camera = Projection::new(&view, size, bounds.size());
            let margin = MARGIN * bounds.size();
            let mut reach = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
            for i in 0..8_usize {
                let corner =
                    Vector3::from_fn(|k, _| if i >> k & 1 == 1 { high[k] + margin } else { -margin });
                let at = camera.to_screen(camera.to_view(corner));
                for side in 0..2 {
                    reach[side] = [reach[side][0].min(at[side]), reach[side][1].max(at[side])];
                }
            }
            let fills = |side: usize| (reach[side][1] - reach[side][0]) / size[side] as f64;
            assert!((0..2).all(|side| reach[side][0] > -1e-6 && reach[side][1] < size[side] as f64 + 1e-6));
            assert!((fills(0).max(fills(1)) - 1.0).abs() < 1e-6, "{reach:?}");
            // From the front, left and above, with a level horizon.
            assert!(view.position[1] < 0.0 && view.position[2] > view.target[2]);
            assert!(camera.axes[0].z.abs() < 1e-12 && camera.axes[1].z < 0.0);
        }
    }

    #[test]
    fn a_camera_that_looks_straight_down_has_y_up() {
        let view = Viewpoint { position: [0.0, 0.0, 5.0], target: [0.0; 3], focal_length: 50.0 };
        let camera = Projection::new(&view, [100, 100], 1.0);
        let at = camera.to_screen(camera.to_view(Vector3::new(1.0, 1.0, 0.0)));
        assert!(at[0] > 50.0 && at[1] < 50.0, "{at:?}");
    }

    #[test]
    fn the_sensor_is_36_mm_wide() {
        let view = Viewpoint { position: [0.0, -5.0, 0.0], target: [0.0; 3], focal_length: 40.0 };
        let camera = Projection::new(&view, [960, 540], 1.0);
        // 18 mm to the side at 40 mm is the edge of the picture.
        let at = camera.to_screen(camera.to_view(Vector3::new(5.0 * 18.0 / 40.0, 0.0, 0.0)));
        assert!((at[0] - 960.0).abs() < 1e-9 && (at[1] - 270.0).abs() < 1e-9, "{at:?}");
        let ray = camera.to_world(camera.ray(480, 269));
        assert!((ray - Vector3::new(0.5 / camera.focal, 1.0, 0.5 / camera.focal)).norm() < 1e-12, "{ray}");
    }
}
