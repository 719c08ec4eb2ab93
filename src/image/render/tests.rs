//! Pictures against closed forms, and against hostile models.

use super::*;
use crate::{math::Vec3, par};
use nalgebra::Vector3;

/// A camera at distance 5 in front of the origin, whose focal length is 2000 / 36 × 50 pixels at 200 pixels.
fn view() -> Viewpoint {
    Viewpoint { position: [0.0, -5.0, 0.0], target: [0.0; 3], focal_length: 50.0 }
}

fn bounds() -> Bounds {
    Bounds { low: Vector3::repeat(-1.0), high: Vector3::repeat(1.0) }
}

fn draw(model: &Model, size: [usize; 2]) -> (Canvas, LeftOut) {
    render(model, &view(), size, &CancelToken::new())
}

/// A sphere of triangles about the origin.
fn sphere(radius: f32, rings: usize) -> Surface {
    let segments = 2 * rings;
    let point = |ring: usize, segment: usize| {
        let (a, b) = (
            std::f32::consts::PI * ring as f32 / rings as f32,
            std::f32::consts::TAU * (segment % segments) as f32 / segments as f32,
        );
        Vec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos())
    };
    let mut surface = Surface { front: [0.5; 3], back: [0.0; 3], ..Surface::default() };
    for ring in 0..rings {
        for segment in 0..segments {
            let first = surface.positions.len() as u32;
            let corners = [
                point(ring, segment),
                point(ring + 1, segment),
                point(ring + 1, segment + 1),
                point(ring, segment + 1),
            ];
            surface.positions.extend(corners.map(|x| x * radius));
            surface.normals.extend(corners);
            surface.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    surface
}

fn with(change: impl FnOnce(&mut Model)) -> Model {
    let mut model = Model::empty(bounds());
    change(&mut model);
    model
}

/// Pixels that differ from the picture without the model.
fn covered(picture: &Canvas) -> usize {
    let (empty, _) = draw(&with(|_| {}), picture.size());
    picture.pixels().iter().zip(empty.pixels()).filter(|(a, b)| a != b).count()
}

/// Pixels of the disc that a sphere of this radius about the origin covers: its outline is at the tangent of the angle whose sine is r / 5.
fn disc(radius: f64, width: usize) -> f64 {
    let sine = radius / 5.0;
    let outline = width as f64 * 50.0 / 36.0 * sine / (1.0 - sine * sine).sqrt();
    std::f64::consts::PI * outline * outline
}

#[test]
fn spheres_cover_the_disc_that_perspective_gives() {
    let size = [400, 400];
    let triangles = with(|model| model.solids.push(sphere(0.8, 96)));
    let ball = with(|model| {
        model.balls.push(Balls { positions: vec![Vec3::zeros()], radii: vec![0.8], colours: vec![[0.5; 3]] });
    });
    let water = with(|model| model.water.push(sphere(0.8, 96)));
    let outline = 400.0 * 50.0 / 36.0 * 0.16;
    // Each pixel at the outline counts if any of its samples is covered: half a pixel more, a quarter on average by two samples.
    let expected = disc(0.8, 400) + 0.5 * std::f64::consts::TAU * outline * 0.75;
    for model in [&triangles, &ball, &water] {
        let (picture, left_out) = draw(model, size);
        assert_eq!(left_out, LeftOut::default());
        let found = covered(&picture) as f64;
        assert!((found / expected - 1.0).abs() < 0.01, "{found} pixels, expected {expected}");
    }
}

#[test]
fn shading_is_that_of_the_normal() {
    let model = with(|model| model.solids.push(sphere(0.8, 128)));
    let camera = Projection::new(&view(), [400, 400], bounds().size());
    let light = Light::new(&model, &camera, &CancelToken::new());
    let (samples, _) = opaque::draw(&model, &camera, &light, &CancelToken::new());
    let mut bright = 0;
    for (x, y) in [(200, 200), (150, 140), (240, 180), (170, 250), (230, 130)] {
        // Where the ray meets the sphere.
        let ray = camera.to_world(camera.ray(x, y));
        let (b, c) = (camera.eye.dot(&ray), camera.eye.norm_squared() - 0.64);
        let t = (-b - (b * b - ray.norm_squared() * c).sqrt()) / ray.norm_squared();
        let at = camera.eye + ray * t;
        let normal: Vec3 = (at / 0.8).cast();
        let depth = samples.depths[y * 400 + x];
        assert!((f64::from(depth) - t).abs() < 2e-3, "depth {depth}, expected {t}");
        // A sphere shades nothing that faces the light.
        let facing = normal.dot(&light.key);
        if facing > 0.1 {
            bright += 1;
            let expected = light.matte(normal, 1.0);
            let found = samples.colours[y * 400 + x];
            for k in 0..3 {
                assert!(
                    (found[k] - 0.5 * expected[k]).abs() < 0.012,
                    "{x} {y}: {found:?}, half of {expected:?}"
                );
            }
        }
    }
    assert!(bright >= 3);
    // Sky from above is brighter than light from the ground; the key light adds to both, in proportion to the cosine.
    let [up, down] = [Vec3::z(), -Vec3::z()].map(|normal| light.matte(normal, 0.0));
    assert!((0..3).all(|k| up[k] > 1.5 * down[k]), "{up:?} {down:?}");
    let across = light.key.cross(&Vec3::x()).normalize();
    let key = |normal: Vec3| light.matte(normal, 1.0)[0] - light.matte(normal, 0.0)[0];
    let (full, half) = (key(light.key), key(light.key * 0.5 + across * 0.75_f32.sqrt()));
    assert!((half / full - 0.5).abs() < 1e-4 && full > 0.5 && key(across).abs() < 1e-6);
}

#[test]
fn vertices_have_their_own_colours() {
    let mut ball = sphere(0.8, 24);
    let of = |x: &Vec3| if x.x < 0.0 { [0.8, 0.0, 0.0] } else { [0.0, 0.0, 0.8] };
    ball.colours = ball.positions.iter().map(of).collect();
    let (picture, _) = draw(&with(|model| model.solids.push(ball)), [200, 200]);
    let at = |x: usize| picture.pixels()[100 * 200 + x].map(i32::from);
    let ([r, _, b], [red, _, blue]) = (at(80), at(120));
    assert!(r > b + 50 && blue > red + 50, "{:?} and {:?}", at(80), at(120));
}

#[test]
fn what_is_nearer_hides_what_is_behind_in_any_order() {
    let ball = |y: f32, colour: [f32; 3]| Balls {
        positions: vec![Vec3::new(0.0, y, 0.0)],
        radii: vec![0.4],
        colours: vec![colour],
    };
    let middle = |balls: Vec<Balls>| {
        let (picture, _) = draw(&with(|model| model.balls = balls), [80, 80]);
        picture.pixels()[40 * 80 + 40]
    };
    let (red, blue) = ([0.8, 0.05, 0.05], [0.05, 0.05, 0.8]);
    let alone = middle(vec![ball(-0.9, red)]);
    assert_eq!(middle(vec![ball(-0.9, red), ball(0.6, blue)]), alone);
    assert_eq!(middle(vec![ball(0.6, blue), ball(-0.9, red)]), alone);
    // A surface hides a ball behind it, and not one in front.
    let hidden = with(|model| {
        model.solids.push(sphere(0.5, 32));
        model.balls.push(ball(0.9, red));
    });
    let without = with(|model| model.solids.push(sphere(0.5, 32)));
    let at = |model: &Model| draw(model, [80, 80]).0.pixels()[40 * 80 + 40];
    let [a, b] = [at(&hidden), at(&without)];
    assert!(a[0].abs_diff(b[0]) < 4, "{a:?} {b:?}");
}

#[test]
fn water_lets_through_what_is_behind_and_tints_more_where_it_is_thick() {
    let wall = |model: &mut Model| {
        model.balls.push(Balls {
            positions: vec![Vec3::new(0.0, 60.0, 0.0)],
            radii: vec![40.0],
            colours: vec![[0.9; 3]],
        });
    };
    let seen = |radius: f32| {
        let model = with(|model| {
            wall(model);
            model.water.push(sphere(radius, 48));
        });
        draw(&model, [80, 80]).0.pixels()[40 * 80 + 40]
    };
    let clear = draw(&with(wall), [80, 80]).0.pixels()[40 * 80 + 40];
    let (thin, thick) = (seen(0.1), seen(0.9));
    assert!(thick[0] < thin[0] && thin[0] < clear[0], "{clear:?} {thin:?} {thick:?}");
    assert!(u32::from(thick[2]) > u32::from(thick[0]) + 25, "the thick part is blue: {thick:?}");
}

#[test]
fn fog_is_brighter_where_it_is_dense_and_on_the_side_of_the_light() {
    let mut positions = Vec::new();
    for i in 0..30 {
        for j in 0..30 {
            for k in 0..30 {
                positions.push(Vec3::new(i as f32, j as f32, k as f32).map(|x| (x - 14.5) / 30.0));
            }
        }
    }
    let fog = |densities: Vec<f32>| {
        with(|model| {
            model.is_dark = true;
            model.fog.push(Fog { positions: positions.clone(), densities, spacing: 1.0 / 30.0 });
        })
    };
    let full = draw(&fog(Vec::new()), [120, 120]).0;
    let thin = draw(&fog(vec![0.02; positions.len()]), [120, 120]).0;
    let at = |picture: &Canvas, x: usize, y: usize| u32::from(picture.pixels()[y * 120 + x][1]);
    assert!(at(&full, 60, 60) > at(&thin, 60, 60) + 20);
    assert!(at(&thin, 60, 60) > at(&thin, 5, 5));
    // The light comes from the upper left.
    assert!(at(&full, 50, 48) > at(&full, 70, 74) + 10, "{} {}", at(&full, 50, 48), at(&full, 70, 74));
}

#[test]
fn solids_cast_shadows_on_the_ground() {
    let ground = |model: &mut Model| model.ground = Some(-1.0);
    let camera = Viewpoint { position: [0.0, -5.0, 4.0], target: [0.0; 3], focal_length: 35.0 };
    let draw = |model: &Model| render(model, &camera, [160, 120], &CancelToken::new()).0;
    let lit = draw(&with(ground));
    let shaded = draw(&with(|model| {
        ground(model);
        model.solids.push(sphere(0.5, 32));
    }));
    let darker = lit.pixels().iter().zip(shaded.pixels()).filter(|(a, b)| a[1] > b[1] + 20).count();
    assert!(darker > 200, "{darker} pixels");
}

/// Everything that a model can have.
fn everything() -> Model {
    with(|model| {
        model.ground = Some(-1.0);
        model.solids.push(sphere(0.3, 24));
        model.water.push(sphere(0.7, 40));
        model.glass.push(sphere(0.9, 24));
        let positions: Vec<Vec3> = (0..3000)
            .map(|i| {
                let i = i as f32;
                Vec3::new((i * 0.7).sin(), (i * 1.3).sin(), (i * 2.1).sin())
            })
            .collect();
        let colours = (0..3000).map(|i| [i as f32 / 3000.0, 0.5, 0.2]).collect();
        model.balls.push(Balls { positions: positions.clone(), radii: vec![0.02], colours });
        model.fog.push(Fog { positions, densities: Vec::new(), spacing: 0.05 });
        model.lines.push([Vec3::repeat(-1.0), Vec3::repeat(1.0)]);
    })
}

#[test]
fn pictures_are_the_same_for_any_number_of_threads() {
    let model = everything();
    let pictures = [1, 2, 3].map(|threads| par::with_threads(threads, || draw(&model, [173, 91])));
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
    let colours: std::collections::BTreeSet<_> = pictures[0].0.pixels().iter().collect();
    assert!(colours.len() > 1000, "the picture shows something: {}", colours.len());
}

#[test]
fn an_empty_model_is_a_picture_of_the_background() {
    let (picture, left_out) = draw(&with(|_| {}), [64, 36]);
    assert_eq!((picture.size(), left_out), ([64, 36], LeftOut::default()));
    let pixels = picture.pixels();
    assert!((0..36).all(|y| (1..64).all(|x| pixels[y * 64 + x][0].abs_diff(pixels[y * 64][0]) < 12)));
}

#[test]
fn what_has_no_place_is_left_out_and_counted() {
    let mut broken = sphere(0.5, 8);
    let sound = broken.triangles.len() as u64;
    let first = broken.positions.len() as u32;
    let strange = [[f32::NAN, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0], [3e38, -3e38, 1e30]];
    broken.positions.extend(strange.map(Vec3::from));
    broken.triangles.extend([
        [0, 1, first],
        [0, 1, first + 1],
        [0, 1, first + 2],
        [0, 1, u32::MAX],
        [first + 77, 0, 1],
    ]);
    let mut positions = vec![Vec3::zeros()];
    positions.extend(strange.map(Vec3::from));
    let model = with(|model| {
        model.solids.push(broken.clone());
        model.water.push(broken.clone());
        model.glass.push(broken.clone());
        model.balls.push(Balls {
            positions: positions.clone(),
            radii: vec![f32::NAN, f32::INFINITY, -1.0, 1e30],
            colours: Vec::new(),
        });
        let (densities, spacing) = (vec![f32::NAN, f32::INFINITY, 1.0, -3.0], 0.1);
        model.fog.push(Fog { positions: positions.clone(), densities, spacing });
        model.lines.push([Vec3::zeros(), Vec3::from(strange[0])]);
    });
    let (_, left_out) = draw(&model, [64, 36]);
    assert_eq!(left_out, LeftOut { triangles: 3 * 5, points: 3 + 3 + 1, at_camera: 0 });
    assert!(sound > 0);
}

#[test]
fn huge_triangles_and_cameras_inside_are_drawn_in_bounded_time() {
    // A wall behind the origin, and a slope from there to behind the camera.
    let huge = |reach: f32, top: f32| Surface {
        positions: [[-reach, 3.0, -reach], [reach, 3.0, -reach], [0.0, top, reach]].map(Vec3::from).to_vec(),
        normals: Vec::new(),
        triangles: vec![[0, 1, 2]; 50],
        front: [0.9; 3],
        back: [0.9; 3],
        ..Surface::default()
    };
    let model = with(|model| {
        model.solids.push(huge(9e8, 3.0));
        model.water.push(huge(1e6, -1e6));
        model.glass.push(huge(50.0, -50.0));
        model.balls.push(Balls {
            positions: vec![Vec3::new(0.0, -5.0, 0.0), Vec3::new(0.0, -5.1, 0.0), Vec3::new(0.0, 0.0, 9e8)],
            radii: vec![10.0, 0.05, 1e8],
            colours: Vec::new(),
        });
        model.lines.push([Vec3::new(0.0, -5.0, 0.0), Vec3::new(1e8, 1e8, 1e8)]);
        model.lines.push([Vec3::new(0.0, -50.0, 0.0), Vec3::new(0.0, 50.0, 0.1)]);
    });
    let (picture, left_out) = draw(&model, [96, 54]);
    // The first ball has the camera in it, the second is behind it, the third reaches from before it to behind it.
    assert_eq!(left_out, LeftOut { at_camera: 2, ..LeftOut::default() });
    assert!(covered(&picture) > 96 * 54 / 4);
}

#[test]
fn a_cancelled_picture_ends_at_once() {
    let cancel = CancelToken::new();
    cancel.cancel();
    let (picture, _) = render(&everything(), &view(), [32, 18], &cancel);
    assert_eq!(picture.size(), [32, 18], "what it shows is not used");
}
