//! Seven balls of different size off the middle of a box, some of which touch: fronts from all sides that collide.

use meniscus::math::Vec3;

/// Centres and radii, in sides of the box, from its middle.
const BALLS: [([f32; 3], f32); 7] = [
    ([-0.31, -0.22, -0.27], 0.13),
    ([0.27, -0.33, -0.12], 0.09),
    ([-0.12, 0.29, -0.33], 0.11),
    ([0.33, 0.24, 0.14], 0.10),
    ([-0.28, 0.07, 0.31], 0.12),
    ([0.07, -0.11, 0.21], 0.15),
    ([0.13, 0.04, -0.06], 0.07),
];

/// The smallest distance to one of the balls: outside, the distance to their union. `side` is the number of voxels along the box.
pub(crate) fn seven_balls(x: Vec3, side: usize) -> f32 {
    let side = side as f32;
    let ball = |(centre, radius): &([f32; 3], f32)| {
        (x - Vec3::from(centre.map(|c| c * side + 0.37))).norm() - radius * side
    };
    BALLS.iter().map(ball).fold(f32::INFINITY, f32::min)
}
