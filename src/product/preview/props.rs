//! Colliders and rigid bodies as surfaces, and tanks as lines, in their own axes and in the frames of a shot.

use super::colours::{BODIES, COLLIDERS};
use crate::{
    image::render::{Bounds, Model, Surface},
    job::RunError,
    math::Vec3,
    mesh::{Mesh, try_unit},
    preset::assets,
    product::colliders::shown_mesh,
    sim::{deforming::deformation, scene::Scene},
    solid::{Collider, Deformation, Look, MeshShape, Motion, Pose, Shape},
};

/// Faces whose normals differ by more than this have an edge between them: the cosine of 40 degrees.
const CREASE: f32 = 0.766;

/// Faces around a vertex, at most, whose normals are compared: each with each, so that more take too long. Of more, each has its own.
const MAX_VALENCE: usize = 256;

/// Memory of a triangle's corner: place, normal and number, in the prop and in the model [bytes].
const CORNER_BYTES: u64 = 56;

/// A plane whose normal is this close to +Z is the ground.
const FLOOR: f32 = 0.9999;

/// What a prop is, in its own axes.
enum Form {
    Surface(Surface),
    /// A mesh whose vertices move.
    Deforming(MeshShape, Box<Deformation>),
    /// The edges of a tank.
    Edges(Vec<[Vec3; 2]>),
    /// An unbounded plane: a point and the normal out of the solid.
    Plane(Vec3, Vec3),
}

/// A collider.
pub(super) struct Prop {
    form: Form,
    motion: Option<Motion>,
    look: Look,
    colour: [f32; 3],
}

/// The colliders and the rigid bodies of a scene.
#[derive(Default)]
pub(super) struct Props {
    pub(super) colliders: Vec<Prop>,
    /// In their own axes, with their looks.
    pub(super) bodies: Vec<(Surface, Look)>,
}

impl Props {
    /// Those of a scene that pictures show, and the tanks.
    ///
    /// # Errors
    /// If a mesh cannot be read.
    pub(super) fn new(scene: &Scene) -> Result<Self, RunError> {
        let (fps, start) = (f64::from(scene.fps), scene.frames.first().0);
        let mut props = Self::default();
        for (number, collider) in scene.world.collider.iter().enumerate() {
            let Some(form) = form(&collider.shape, scene)? else { continue };
            let is_tank = matches!(form, Form::Edges(_));
            let look = collider.shown_look().or(is_tank.then_some(Look::Glass));
            let Some(look) = look.filter(|look| *look != Look::Hidden) else { continue };
            let Collider { keyframes, interpolation, .. } = collider;
            let motion = Motion::new(keyframes, *interpolation, fps, start);
            let colour = COLLIDERS[number % COLLIDERS.len()];
            props.colliders.push(Prop { form, motion, look, colour });
        }
        for (number, body) in scene.body.iter().enumerate() {
            let mesh = shown_mesh(&body.shape, Look::Matte, bytes(&body.shape, scene), 1.0)?;
            let surface = creased(&mesh, BODIES[number % BODIES.len()]);
            props.bodies.push((surface, body.look.unwrap_or(Look::Matte)));
        }
        Ok(props)
    }

    /// The memory that they and their copies in a model take [bytes].
    pub(super) fn memory(&self) -> u64 {
        let corners = |form: &Form| match form {
            Form::Surface(surface) => surface.positions.len(),
            Form::Deforming(_, deformation) => 3 * deformation.triangles().len(),
            Form::Edges(_) | Form::Plane(..) => 0,
        };
        let colliders: usize = self.colliders.iter().map(|prop| corners(&prop.form)).sum();
        let bodies: usize = self.bodies.iter().map(|(surface, _)| surface.positions.len()).sum();
        (colliders + bodies) as u64 * CORNER_BYTES
    }

    /// Boxes of bounded colliders and bodies at a time, but for tanks and what is hidden.
    pub(super) fn boxes(&self, time: f64, poses: &[Pose]) -> Vec<Bounds> {
        let mut found = Vec::new();
        for prop in &self.colliders {
            let surface = match &prop.form {
                Form::Surface(surface) => bounds_of(surface.positions.iter().map(|&x| prop.placed(x, time))),
                Form::Deforming(mesh, deformation) => {
                    let positions = mesh.place(&deformation.positions(time));
                    bounds_of(positions.into_iter().map(|x| prop.placed(x, time)))
                }
                Form::Edges(_) | Form::Plane(..) => continue,
            };
            found.push(surface);
        }
        found.extend(self.body_boxes(poses));
        found.retain(Bounds::exists);
        found
    }

    /// Boxes of the bodies in these poses, but for those that are hidden.
    pub(super) fn body_boxes<'a>(&'a self, poses: &'a [Pose]) -> impl Iterator<Item = Bounds> + 'a {
        let shown = self.bodies.iter().zip(poses).filter(|((_, look), _)| *look != Look::Hidden);
        shown.map(|((surface, _), pose)| bounds_of(surface.positions.iter().map(|&x| pose.to_world(x))))
    }

    /// Boxes of the tanks at the start.
    pub(super) fn tanks(&self) -> Vec<Bounds> {
        let edges = |prop: &Prop| match &prop.form {
            Form::Edges(lines) => Some(bounds_of(lines.iter().flatten().map(|&x| prop.placed(x, 0.0)))),
            _ => None,
        };
        self.colliders.iter().filter_map(edges).collect()
    }

    /// Height of a level plane that does not move, the highest of several [m].
    pub(super) fn floor(&self) -> Option<f64> {
        let height = |prop: &Prop| match &prop.form {
            Form::Plane(point, _) if prop.is_floor() => Some(f64::from(point.z)),
            _ => None,
        };
        self.colliders.iter().filter_map(height).reduce(f64::max)
    }

    /// Adds all to a model at a time, with the bodies in their poses. Planes that are no floor are squares around the middle of the bounds, and
    /// only seen from outside. Returns how many bodies have no pose, so that they are not shown.
    pub(super) fn add_to(&self, model: &mut Model, time: f64, poses: &[Pose], eye: [f64; 3]) -> usize {
        for prop in &self.colliders {
            let surface = match &prop.form {
                Form::Surface(surface) => prop.moved(surface, time),
                Form::Deforming(mesh, deformation) => {
                    let positions = mesh.place(&deformation.positions(time));
                    let triangles = deformation.triangles().to_vec();
                    let mesh = Mesh { positions, triangles, ..Mesh::default() };
                    prop.moved(&creased(&mesh, prop.colour), time)
                }
                Form::Edges(lines) => {
                    let placed = lines.iter().map(|line| line.map(|x| prop.placed(x, time)));
                    model.lines.extend(placed);
                    continue;
                }
                Form::Plane(..) if prop.is_floor() => continue,
                Form::Plane(point, normal) => {
                    let (point, normal) = (prop.placed(*point, time), prop.turned(*normal, time));
                    let Some(square) = square(point, normal, &model.bounds, eye, prop.colour) else {
                        continue;
                    };
                    square
                }
            };
            match prop.look {
                Look::Glass => model.glass.push(surface),
                _ => model.solids.push(surface),
            }
        }
        for ((surface, look), pose) in self.bodies.iter().zip(poses) {
            let mut placed = surface.clone();
            placed.positions.iter_mut().for_each(|x| *x = pose.to_world(*x));
            placed.normals.iter_mut().for_each(|n| *n = pose.rotation * *n);
            match look {
                Look::Hidden => {}
                Look::Glass => model.glass.push(placed),
                _ => model.solids.push(placed),
            }
        }
        let without_pose = self.bodies.iter().skip(poses.len());
        without_pose.filter(|(_, look)| *look != Look::Hidden).count()
    }
}

impl Prop {
    fn pose(&self, time: f64) -> (Pose, f32) {
        self.motion.as_ref().map_or((Pose::identity(), 1.0), |motion| (motion.pose(time), motion.scale(time)))
    }

    /// A point of its own axes in the world at a time [m].
    fn placed(&self, x: Vec3, time: f64) -> Vec3 {
        let (pose, scale) = self.pose(time);
        pose.to_world(x * scale)
    }

    /// A direction of its own axes in the world.
    fn turned(&self, n: Vec3, time: f64) -> Vec3 {
        self.pose(time).0.rotation * n
    }

    fn moved(&self, surface: &Surface, time: f64) -> Surface {
        let mut moved = surface.clone();
        if self.motion.is_some() {
            let (pose, scale) = self.pose(time);
            moved.positions.iter_mut().for_each(|x| *x = pose.to_world(*x * scale));
            moved.normals.iter_mut().for_each(|n| *n = pose.rotation * *n);
        }
        (moved.front, moved.back) = (self.colour, self.colour);
        moved
    }

    fn is_floor(&self) -> bool {
        matches!(&self.form, Form::Plane(_, normal) if normal.z >= FLOOR) && self.motion.is_none()
    }
}

/// The bytes of the file that a mesh names; none of other shapes.
fn bytes<'a>(shape: &Shape, scene: &'a Scene) -> &'a [u8] {
    match shape {
        Shape::Mesh(mesh) => scene.assets.get(&mesh.file).map_or(&[], |asset| &asset.bytes),
        _ => &[],
    }
}

/// What a shape is in pictures; `None`: nothing.
fn form(shape: &Shape, scene: &Scene) -> Result<Option<Form>, RunError> {
    Ok(Some(match shape {
        Shape::Plane { point, normal } => {
            let normal = Vec3::from(*normal);
            let largest = normal.amax();
            let Some(unit) = (normal / largest).try_normalize(0.0) else { return Ok(None) };
            Form::Plane((*point).into(), unit)
        }
        Shape::Tank { min, max } => Form::Edges(edges(*min, *max)),
        Shape::Mesh(mesh) if mesh.names_motion() => match deformation(mesh, scene)? {
            Some(deformation) => Form::Deforming(mesh.clone(), Box::new(deformation)),
            None => return Ok(None),
        },
        shape => {
            let mesh = shown_mesh(shape, Look::Matte, bytes(shape, scene), 1.0)?;
            Form::Surface(creased(&mesh, [0.0; 3]))
        }
    }))
}

/// The twelve edges of a box.
fn edges(min: [f32; 3], max: [f32; 3]) -> Vec<[Vec3; 2]> {
    let corner = |i: usize| Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { max[axis] } else { min[axis] });
    let along =
        |axis: usize| (0..8_usize).filter(move |i| i >> axis & 1 == 0).map(move |i| (i, i | 1 << axis));
    (0..3).flat_map(along).map(|(a, b)| [corner(a), corner(b)]).collect()
}

/// A mesh with normals that are smooth where it is, and edges at creases. Triangles with corners that do not exist are
/// kept, and left out where they are drawn.
pub(super) fn creased(mesh: &Mesh, colour: [f32; 3]) -> Surface {
    let place = |corner: u32| mesh.positions.get(corner as usize).copied().unwrap_or(Vec3::repeat(f32::NAN));
    // Twice the area long.
    let face = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(place);
        (b - a).cross(&(c - a))
    };
    let faces: Vec<Vec3> = mesh.triangles.iter().map(face).collect();
    let units: Vec<Vec3> =
        faces.iter().map(|n| try_unit(&(n / n.amax())).unwrap_or_else(Vec3::zeros)).collect();
    // The faces around each vertex.
    let mut starts = vec![0_u32; mesh.positions.len() + 1];
    let known = |triangle: &[u32; 3]| triangle.iter().all(|&v| (v as usize) < mesh.positions.len());
    for triangle in mesh.triangles.iter().filter(|triangle| known(triangle)) {
        triangle.iter().for_each(|&v| starts[v as usize + 1] += 1);
    }
    (1..starts.len()).for_each(|v| starts[v] += starts[v - 1]);
    let mut around = vec![0_u32; starts[mesh.positions.len()] as usize];
    let mut next = starts.clone();
    for (number, triangle) in mesh.triangles.iter().enumerate().filter(|(_, triangle)| known(triangle)) {
        for &v in triangle {
            around[next[v as usize] as usize] = number as u32;
            next[v as usize] += 1;
        }
    }
    let mut surface = Surface { origin: mesh.origin, front: colour, back: colour, ..Surface::default() };
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        let first = surface.positions.len() as u32;
        for &v in triangle {
            let neighbours = if known(triangle) {
                &around[starts[v as usize] as usize..starts[v as usize + 1] as usize]
            } else {
                &[]
            };
            let neighbours = if neighbours.len() > MAX_VALENCE { &[] } else { neighbours };
            let smooth = neighbours.iter().map(|&other| other as usize);
            let smooth = smooth.filter(|&other| units[other].dot(&units[number]) > CREASE);
            let sum: Vec3 = smooth.map(|other| faces[other]).sum();
            surface.positions.push(place(v));
            surface.normals.push(try_unit(&(sum / sum.amax())).unwrap_or(units[number]));
        }
        surface.triangles.push([first, first + 1, first + 2]);
    }
    surface
}

/// The part of a plane around the middle of the bounds, as a square; `None` if the camera is behind it.
fn square(point: Vec3, normal: Vec3, bounds: &Bounds, eye: [f64; 3], colour: [f32; 3]) -> Option<Surface> {
    let eye = Vec3::from(eye.map(|x| x as f32));
    if normal.dot(&(eye - point)) <= 0.0 {
        return None;
    }
    let middle: Vec3 = bounds.middle().cast();
    let middle = middle - normal * normal.dot(&(middle - point));
    let reach = 0.75 * bounds.size() as f32;
    let across = Vec3::from_fn(|i, _| if i == normal.iamin() { 1.0 } else { 0.0 });
    let u = across.cross(&normal).normalize();
    let v = normal.cross(&u);
    let corner = |a: f32, b: f32| middle + (u * a + v * b) * reach;
    Some(Surface {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![normal; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        front: colour,
        back: colour,
        ..Surface::default()
    })
}

/// The box around points.
pub(super) fn bounds_of(points: impl Iterator<Item = Vec3>) -> Bounds {
    let finite = points.filter(|x| x.iter().all(|x| x.is_finite())).map(|x| x.cast::<f64>());
    finite.fold(Bounds::empty(), |all, x| Bounds { low: all.low.inf(&x), high: all.high.sup(&x) })
}

/// Identifies the colliders and bodies of a scene and the files that they name.
pub(super) fn text(scene: &Scene) -> String {
    let shapes = scene.world.collider.iter().map(|collider| &collider.shape);
    let shapes = shapes.chain(scene.body.iter().map(|body| &body.shape));
    let hash = assets::hash(shapes.flat_map(Shape::files), &scene.assets);
    let of = (&scene.world.collider, &scene.body, scene.fps, scene.frames.first().0);
    format!("{} {hash:016x}", serde_json::to_string(&of).expect("a scene is plain data"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(look: Look) -> (Surface, Look) {
        (Surface { positions: vec![Vec3::repeat(3.0), Vec3::repeat(4.0)], ..Surface::default() }, look)
    }

    #[test]
    fn hidden_bodies_frame_no_picture_and_bodies_without_a_pose_are_counted() {
        let bodies = vec![body(Look::Hidden), body(Look::Matte), body(Look::Hidden), body(Look::Matte)];
        let props = Props { bodies, ..Props::default() };
        let poses = [Pose::identity(), Pose::identity()];
        let boxes = props.boxes(0.0, &poses);
        assert_eq!(boxes, [bounds_of([Vec3::repeat(3.0), Vec3::repeat(4.0)].into_iter())]);
        let mut model = Model::empty(boxes[0]);
        assert_eq!(props.add_to(&mut model, 0.0, &poses, [0.0; 3]), 1);
        assert_eq!(model.solids.len(), 1);
    }

    #[test]
    fn a_fan_of_many_faces_around_a_vertex_is_not_smoothed_there() {
        // Comparing each face with each takes hours for the fans that files can have.
        let count = 2000_u32;
        let rim = |i: u32| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(count);
            Vec3::new(angle.cos() as f32, angle.sin() as f32, 0.0)
        };
        let mut positions: Vec<Vec3> = (0..count).map(rim).collect();
        positions.push(Vec3::z());
        let triangles = (0..count).map(|i| [i, (i + 1) % count, count]).collect();
        let surface = creased(&Mesh { positions, triangles, ..Mesh::default() }, [0.5; 3]);
        assert_eq!(surface.triangles.len(), count as usize);
        // The tip has the normals of its faces, the rim those of its neighbours.
        assert!(surface.normals.iter().all(|n| (n.z - 0.5_f32.sqrt()).abs() < 0.01));
    }
}
