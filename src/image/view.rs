//! An orthographic view of a frame.
//!
//! *Method*: particles are spheres and faces triangles in a depth buffer [1]; the depth is smoothed where it is continuous, so that
//! particles of a surface become one, and shaded by its normals (screen-space fluid rendering, van der Laan et al. 2009, simplified).
//! Tracers add up to the thickness of tracers along the view. The camera is in front, to the right and above: fixed, so that
//! pictures of variants can be compared.
//!
//! *Limits*: no perspective, no shadows, no solids.
//!
//! [1] nearest depth wins, which does not depend on the order of the entries.

use super::canvas::Canvas;
use crate::{
    frame::{Frame, Stream, StreamKind},
    math::Vec3,
};

/// The right, the upper and the forward direction of the camera: 37 degrees from the front, 21 degrees from above.
const CAMERA: [[f64; 3]; 3] = [[0.8, 0.6, 0.0], [-0.2112, 0.2816, 0.936], [-0.5616, 0.7488, -0.352]];

/// Radius of a drawn particle [spacings]: smaller, and gaps show between particles at rest; larger, and thin sheets look thick.
const RADIUS: f64 = 0.75;

/// The largest drawn radius [pixels], which bounds the time.
const MAX_RADIUS: f64 = 24.0;

/// Part of the points at either end of an axis that the extent leaves out, so that single drops do not shrink all others.
const OUTLIERS: f64 = 0.001;

/// Thickness of tracers that is drawn in half of its brightness [m], as a fraction of the view's height.
const HALF_BRIGHT: f64 = 0.05;

const BACKGROUND: [f64; 3] = [34.0, 36.0, 41.0];
const PARTICLES: [f64; 3] = [92.0, 158.0, 214.0];
const MESH: [f64; 3] = [222.0, 168.0, 98.0];
const TRACERS: [f64; 3] = [232.0, 232.0, 228.0];

/// The rectangle that pictures show, in the camera's right and upper direction [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    /// Lower left corner.
    pub(crate) min: [f64; 2],
    /// Upper right corner.
    pub(crate) max: [f64; 2],
}

impl View {
    /// The smallest rectangle that has both.
    #[must_use]
    pub(crate) fn union(self, other: Self) -> Self {
        let both = |a: [f64; 2], b: [f64; 2], of: fn(f64, f64) -> f64| [of(a[0], b[0]), of(a[1], b[1])];
        Self { min: both(self.min, other.min, f64::min), max: both(self.max, other.max, f64::max) }
    }

    /// The rectangle with a margin, in the shape of an image of `size`.
    fn fitted(self, size: [usize; 2]) -> (Self, f64) {
        let [width, height] = size.map(|pixels| pixels as f64);
        let spans = [0, 1].map(|axis| (self.max[axis] - self.min[axis]).max(1e-9) * 1.1);
        let pixel = (spans[0] / width).max(spans[1] / height);
        let middle = [0, 1].map(|axis| 0.5 * (self.max[axis] + self.min[axis]));
        let half = [0.5 * width * pixel, 0.5 * height * pixel];
        let min = [middle[0] - half[0], middle[1] - half[1]];
        (Self { min, max: [middle[0] + half[0], middle[1] + half[1]] }, pixel)
    }
}

/// Whether entries of a kind are drawn.
fn is_drawn(kind: StreamKind) -> bool {
    matches!(kind, StreamKind::Particles | StreamKind::Tracers | StreamKind::MeshPoints)
}

/// The finite positions of a stream that is drawn, in the camera's directions [m].
fn seen(stream: &Stream) -> impl Iterator<Item = (usize, [f64; 3])> {
    let positions = stream.vec3("position").filter(|_| is_drawn(stream.kind)).unwrap_or_default();
    positions.iter().enumerate().filter(|(_, x)| x.iter().all(|x| x.is_finite())).map(|(i, x)| (i, turned(x)))
}

fn turned(x: &Vec3) -> [f64; 3] {
    CAMERA.map(|axis| (0..3).map(|i| axis[i] * f64::from(x[i])).sum())
}

/// The rectangle that a frame fills, but for single drops; `None` if there is nothing to draw.
pub(crate) fn extent(frame: &Frame) -> Option<View> {
    let mut points: [Vec<f64>; 2] = Default::default();
    let mut margin = 0.0_f64;
    for stream in &frame.streams {
        for (_, at) in seen(stream) {
            (0..2).for_each(|axis| points[axis].push(at[axis]));
        }
        margin = margin.max(stream.spacing().filter(|_| is_drawn(stream.kind)).map_or(0.0, f64::from));
    }
    let count = points[0].len();
    let last = count.checked_sub(1)?;
    let left_out = ((count as f64 * OUTLIERS) as usize).min(last / 2);
    let mut limit = |axis: usize, place: usize| *points[axis].select_nth_unstable_by(place, f64::total_cmp).1;
    let min = [limit(0, left_out) - margin, limit(1, left_out) - margin];
    let max = [limit(0, last - left_out) + margin, limit(1, last - left_out) + margin];
    Some(View { min, max })
}

/// A picture under way.
struct Picture {
    size: [usize; 2],
    view: View,
    /// Size of a pixel [m].
    pixel: f64,
    /// Depth of what is nearest [m]; infinite: nothing.
    depth: Vec<f64>,
    /// Whether that is a sheet.
    is_mesh: Vec<bool>,
    /// Thickness of tracers [m].
    tracers: Vec<f64>,
    /// Largest step in depth that is still one surface [m].
    step: f64,
}

/// Draws a frame in an image of `size`. Returns also how many entries are outside the view.
pub(crate) fn draw(frame: &Frame, view: View, size: [usize; 2]) -> (Canvas, u64) {
    let (view, pixel) = view.fitted(size);
    let count = size[0] * size[1];
    let mut picture = Picture {
        size,
        view,
        pixel,
        depth: vec![f64::INFINITY; count],
        is_mesh: vec![false; count],
        tracers: vec![0.0; count],
        step: 4.0 * pixel,
    };
    let mut outside = 0;
    for stream in &frame.streams {
        outside += picture.add(stream, &frame.streams);
    }
    (picture.shaded(), outside)
}

impl Picture {
    /// Draws a stream; returns how many entries are outside.
    fn add(&mut self, stream: &Stream, all: &[Stream]) -> u64 {
        let spacing = stream.spacing().map_or(0.0, f64::from);
        let densities = stream.f32("density").filter(|_| stream.kind == StreamKind::Tracers);
        let [width, height] = self.size.map(|pixels| pixels as f64);
        let (mut outside, mut smoothing) = (0, 0.0_f64);
        for (i, at) in seen(stream) {
            let [x, y, depth] = self.placed(at);
            if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
                outside += 1;
                continue;
            }
            match stream.kind {
                StreamKind::Tracers => {
                    let density = f64::from(densities.map_or(1.0, |all| all[i])).clamp(0.0, 1.0);
                    let radius = (RADIUS * spacing).clamp(self.pixel, MAX_RADIUS * self.pixel);
                    self.puff([x, y], density * spacing.powi(3), radius);
                }
                StreamKind::Particles => {
                    let radius = (RADIUS * spacing).clamp(0.75 * self.pixel, MAX_RADIUS * self.pixel);
                    smoothing = smoothing.max(radius);
                    self.sphere([x, y], depth, radius);
                }
                _ => {}
            }
        }
        self.step = self.step.max(1.5 * smoothing);
        if stream.kind == StreamKind::MeshPoints {
            self.faces(stream, all);
        }
        outside
    }

    /// Pixel coordinates from the upper left corner, and the depth [m].
    fn placed(&self, at: [f64; 3]) -> [f64; 3] {
        [(at[0] - self.view.min[0]) / self.pixel, (self.view.max[1] - at[1]) / self.pixel, at[2]]
    }

    /// The columns and rows of a disc, with the squared distance of each pixel from its centre in radii.
    fn disc(&self, centre: [f64; 2], radius: f64) -> impl Iterator<Item = ([usize; 2], f64)> + use<> {
        let pixels = radius / self.pixel;
        let [columns, rows] = [0, 1].map(|axis| {
            let first = (centre[axis] - pixels).floor().max(0.0) as usize;
            first..self.size[axis].min((centre[axis] + pixels).ceil() as usize + 1)
        });
        let distance = move |column: usize, row: usize| {
            let offset = [column as f64 + 0.5 - centre[0], row as f64 + 0.5 - centre[1]];
            (offset[0] * offset[0] + offset[1] * offset[1]) / (pixels * pixels)
        };
        let all = rows.flat_map(move |row| columns.clone().map(move |column| [column, row]));
        all.map(move |place| (place, distance(place[0], place[1]))).filter(|(_, distance)| *distance <= 1.0)
    }

    fn sphere(&mut self, centre: [f64; 2], depth: f64, radius: f64) {
        for ([column, row], distance) in self.disc(centre, radius) {
            self.nearest(column, row, depth - (1.0 - distance).sqrt() * radius, false);
        }
    }

    /// Adds a volume of tracers [m³], thickest in the middle of its disc.
    fn puff(&mut self, centre: [f64; 2], volume: f64, radius: f64) {
        let peak = 2.0 * volume / (std::f64::consts::PI * radius * radius);
        for ([column, row], distance) in self.disc(centre, radius) {
            self.tracers[row * self.size[0] + column] += peak * (1.0 - distance);
        }
    }

    fn nearest(&mut self, column: usize, row: usize, depth: f64, is_mesh: bool) {
        let place = row * self.size[0] + column;
        if depth < self.depth[place] {
            self.depth[place] = depth;
            self.is_mesh[place] = is_mesh;
        }
    }

    /// Draws the faces of a mesh, whose corners are the number columns of the stream of its faces.
    fn faces(&mut self, points: &Stream, all: &[Stream]) {
        let name = format!("{}.faces", points.name);
        let is_faces = |stream: &&Stream| stream.kind == StreamKind::MeshFaces && stream.name == name;
        let (Some(faces), Some(positions)) = (all.iter().find(is_faces), points.vec3("position")) else {
            return;
        };
        let corners: Vec<&[u32]> =
            faces.channels().iter().filter_map(|channel| faces.u32(&channel.name)).take(4).collect();
        for face in 0..faces.len() {
            let at = corners.iter().map(|corner| positions.get(corner[face] as usize));
            let at: Option<Vec<[f64; 3]>> = at.map(|x| x.map(|x| self.placed(turned(x)))).collect();
            let Some(at) = at.filter(|at| at.iter().flatten().all(|x| x.is_finite())) else { continue };
            for other in 2..at.len() {
                self.triangle([at[0], at[other - 1], at[other]]);
            }
        }
    }

    fn triangle(&mut self, at: [[f64; 3]; 3]) {
        let [a, b, c] = at;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 {
            return;
        }
        let [columns, rows] = [0, 1].map(|axis| {
            let low = at.iter().map(|at| at[axis]).fold(f64::INFINITY, f64::min).max(0.0);
            let high = at.iter().map(|at| at[axis]).fold(f64::NEG_INFINITY, f64::max);
            low as usize..self.size[axis].min(high.max(0.0).ceil() as usize)
        });
        for row in rows {
            for column in columns.clone() {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let weight =
                    |p: [f64; 3], q: [f64; 3]| ((p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x)) / area;
                let weights = [weight(b, c), weight(c, a), weight(a, b)];
                if weights.iter().all(|weight| *weight >= -1e-9) {
                    let depth = (0..3).map(|i| weights[i] * at[i][2]).sum();
                    self.nearest(column, row, depth, true);
                }
            }
        }
    }

    /// The four neighbours of a place that belong to the same surface.
    fn joined<'a>(&'a self, depth: &'a [f64], column: usize, row: usize) -> [Option<f64>; 4] {
        let [width, height] = self.size;
        let here = row * width + column;
        let other = |is_inside: bool, place: usize| {
            let is_same = |other: usize| {
                self.is_mesh[other] == self.is_mesh[here] && (depth[other] - depth[here]).abs() < self.step
            };
            (is_inside && is_same(place)).then(|| depth[place])
        };
        [
            other(column > 0, here.wrapping_sub(1)),
            other(column + 1 < width, here + 1),
            other(row > 0, here.wrapping_sub(width)),
            other(row + 1 < height, here + width),
        ]
    }

    /// The depth of particles, smoothed where it is continuous.
    fn smoothed(&self) -> Vec<f64> {
        let passes = (2.0 * self.step / self.pixel).clamp(4.0, 40.0) as usize;
        let [width, height] = self.size;
        let mut depth = self.depth.clone();
        for _ in 0..passes {
            let before = depth.clone();
            for row in 0..height {
                for column in 0..width {
                    let place = row * width + column;
                    if before[place].is_finite() && !self.is_mesh[place] {
                        let joined = self.joined(&before, column, row);
                        let (sum, count) =
                            joined.iter().flatten().fold((before[place], 1.0), |(s, n), d| (s + d, n + 1.0));
                        depth[place] = sum / count;
                    }
                }
            }
        }
        depth
    }

    fn shaded(&self) -> Canvas {
        let [width, height] = self.size;
        let mut canvas = Canvas::new(width, height, [0; 3]);
        let depth = self.smoothed();
        let half_bright = HALF_BRIGHT * (self.view.max[1] - self.view.min[1]);
        for row in 0..height {
            for column in 0..width {
                let place = row * width + column;
                let mut colour = BACKGROUND;
                if depth[place].is_finite() {
                    let base = if self.is_mesh[place] { MESH } else { PARTICLES };
                    colour = lit(base, self.normal(&depth, column, row));
                }
                let tracers = self.tracers[place] / (self.tracers[place] + half_bright);
                for (channel, of_tracers) in colour.iter_mut().zip(TRACERS) {
                    *channel += tracers * (of_tracers - *channel);
                }
                canvas.set(column, row, colour.map(|channel| channel.clamp(0.0, 255.0) as u8));
            }
        }
        canvas
    }

    /// The normal of the surface at a pixel, in the directions right, up, towards the camera.
    fn normal(&self, depth: &[f64], column: usize, row: usize) -> [f64; 3] {
        let here = depth[row * self.size[0] + column];
        let [left, right, above, below] = self.joined(depth, column, row);
        let slope = |low: Option<f64>, high: Option<f64>| match (low, high) {
            (Some(low), Some(high)) => 0.5 * (high - low) / self.pixel,
            (Some(low), None) => (here - low) / self.pixel,
            (None, Some(high)) => (high - here) / self.pixel,
            (None, None) => 0.0,
        };
        let (x, y) = (slope(left, right), slope(below, above));
        let length = (x * x + y * y + 1.0).sqrt();
        [x / length, y / length, 1.0 / length]
    }
}

/// A colour in the light of a lamp from the upper left behind the camera.
fn lit(base: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
    let along = |light: [f64; 3]| (0..3).map(|i| light[i] * normal[i]).sum::<f64>().max(0.0);
    let diffuse = along([-0.48, 0.64, 0.6]);
    // The mirrored view direction, halfway to the lamp.
    let shine = along([-0.2683, 0.3578, 0.8944]).powi(24);
    base.map(|channel| channel * (0.36 + 0.64 * diffuse) + 70.0 * shine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameIndex;

    fn frame(streams: Vec<Stream>) -> Frame {
        Frame { index: FrameIndex(1), time: 0.0, streams }
    }

    fn particles(positions: &[[f32; 3]], spacing: f64) -> Stream {
        let positions: Vec<Vec3> = positions.iter().map(|&x| x.into()).collect();
        let mut stream =
            Stream::new("drops", StreamKind::Particles, positions.len()).with("position", positions);
        stream.scalars.push(("spacing".into(), spacing));
        stream
    }

    fn pixel(canvas: &Canvas, path: &std::path::Path) -> Vec<[u8; 3]> {
        canvas.save(path).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        bytes.as_chunks::<3>().0.to_vec()
    }

    #[test]
    fn the_camera_is_orthonormal_and_looks_down_from_the_front() {
        let dot = |a: usize, b: usize| (0..3).map(|i| CAMERA[a][i] * CAMERA[b][i]).sum::<f64>();
        for a in 0..3 {
            for b in 0..3 {
                assert!((dot(a, b) - if a == b { 1.0 } else { 0.0 }).abs() < 1e-9, "{a} {b}");
            }
        }
        assert!(CAMERA[2][1] > 0.0 && CAMERA[2][2] < 0.0 && CAMERA[1][2] > 0.0);
    }

    #[test]
    fn a_ball_is_drawn_in_the_middle_and_single_drops_do_not_shrink_it() {
        let dir = tempfile::tempdir().unwrap();
        let mut places = Vec::new();
        for i in 0..4096 {
            places.push([i % 16, i / 16 % 16, i / 256].map(|v| 0.1 * v as f32));
        }
        let block = frame(vec![particles(&places, 0.1)]);
        let view = extent(&block).unwrap();
        places.extend([[500.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0]]);
        let with_drop = frame(vec![particles(&places, 0.1)]);
        let wide = extent(&with_drop).unwrap();
        assert!(wide.max[0] - wide.min[0] < 1.3 * (view.max[0] - view.min[0]), "{wide:?} {view:?}");
        let (canvas, outside) = draw(&with_drop, wide, [80, 60]);
        assert_eq!(outside, 1, "the drop is counted");
        let pixels = pixel(&canvas, &dir.path().join("a.png"));
        let background = BACKGROUND.map(|channel| channel as u8);
        assert_eq!([pixels[0], pixels[79], pixels[80 * 59]], [background; 3]);
        assert_ne!(pixels[80 * 30 + 40], background);
        // Blue, lit from above: the top is brighter than the side.
        assert!(pixels[80 * 30 + 40][2] > pixels[80 * 30 + 40][0]);
        let column: Vec<u8> =
            (0..60).map(|row| pixels[80 * row + 40]).filter(|p| *p != background).map(|p| p[2]).collect();
        assert!(column.len() > 30 && column[3] > column[column.len() - 4], "{column:?}");
    }

    #[test]
    fn sheets_and_smoke_are_drawn_and_crafted_faces_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let corners: Vec<Vec3> =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(Vec3::from).to_vec();
        let points = Stream::new("cloth", StreamKind::MeshPoints, 4).with("position", corners);
        let face = |numbers: [u32; 4]| {
            let names = ["a", "b", "c", "d"].into_iter().zip(numbers);
            names.fold(Stream::new("cloth.faces", StreamKind::MeshFaces, 1), |stream, (name, number)| {
                stream.with(name, vec![number])
            })
        };
        let middle = |frame: &Frame| {
            let view = extent(frame).unwrap();
            pixel(&draw(frame, view, [40, 30]).0, &dir.path().join("a.png"))[40 * 15 + 20]
        };
        let background = BACKGROUND.map(|channel| channel as u8);
        let cloth = middle(&frame(vec![points.clone(), face([0, 1, 2, 3])]));
        assert!(cloth[0] > cloth[2] && cloth != background, "{cloth:?}");
        assert_eq!(
            middle(&frame(vec![points.clone(), face([0, 1, 2, 9])])),
            background,
            "a corner that is not there"
        );
        assert_eq!(middle(&frame(vec![points])), background);
        let mut tracers = particles(&[[0.0; 3], [0.01, 0.0, 0.0]], 0.3);
        tracers.kind = StreamKind::Tracers;
        let view = View { min: [-1.0; 2], max: [1.0; 2] };
        let (canvas, _) = draw(&frame(vec![tracers]), view, [40, 30]);
        let pixels = pixel(&canvas, &dir.path().join("a.png"));
        assert!(pixels.iter().any(|pixel| pixel[0] > 60), "tracers is bright");
        assert_eq!(extent(&frame(Vec::new())), None);
    }
}
