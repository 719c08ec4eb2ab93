//! The 256 cases of marching cubes, derived by a rule.
//!
//! *Method*: the cell subdivision of [lorensen87], with its table derived from one rule. Walk around each
//! face of the cell, counter-clockwise seen from outside the cell. Where the walk enters a run of inside
//! corners through edge p and leaves it through edge q, the surface crosses the face from p to q. Every
//! crossed edge lies in two faces, whose walks pass it in opposite directions: one enters there and the other
//! leaves, so the segments form closed loops. Each loop is filled with triangles.
//! *Departs from the paper*: where the inside corners of a face are diagonal, [lorensen87] leaves holes,
//! because its table mirrors cases. Here the rule depends on the face alone and always separates the two
//! inside corners, so both cells at the face have the same two segments.
//!
//! Why the mesh is a closed 2-manifold: a face segment belongs to one loop in each of its two cells, which
//! gives its edge two triangles of opposite direction. A diagonal of a loop never joins two vertices of one
//! face, so no other cell has it; it has the two triangles next to it. The four cells around a vertex each
//! hold one fan of triangles from one face to the next, which form one cycle. Three vertices of a triangle
//! lie on three edges of a convex cell and not in one face, so they are not collinear as long as they stay
//! off the corners.
//!
//! Numbering: corner c is at (c & 1, c >> 1 & 1, c >> 2); bit c of a mask is set if corner c is inside. Edge
//! 4·axis + n runs along `axis` from the corner that has n's two bits in the other two coordinates.

/// Marks an edge that no other follows.
const NONE: u8 = u8::MAX;

/// The triangles of every corner mask.
#[derive(Debug)]
pub(super) struct Cases {
    triangles: Vec<[u8; 3]>,
    start: Vec<u16>,
}

impl Cases {
    /// Derives the table (0.15 ms).
    pub(super) fn derive() -> Self {
        let mut cases = Self { triangles: Vec::new(), start: vec![0] };
        for mask in 0..=255 {
            for outline in loops(mask) {
                let (_, triangles) =
                    fill(&outline).expect("every loop has a filling without diagonals in faces");
                cases.triangles.extend(triangles);
            }
            cases.start.push(cases.triangles.len() as u16);
        }
        cases
    }

    /// The triangles of corner mask `mask`, as edges of the cell, counter-clockwise seen from outside.
    #[inline]
    pub(super) fn of(&self, mask: u8) -> &[[u8; 3]] {
        let mask = usize::from(mask);
        &self.triangles[usize::from(self.start[mask])..usize::from(self.start[mask + 1])]
    }
}

/// The lower corner of an edge, and its axis.
pub(super) const fn edge(edge: u8) -> (u8, u8) {
    let (axis, n) = (edge / 4, edge % 4);
    let corner = match axis {
        0 => n << 1,
        1 => (n & 1) | (n >> 1) << 2,
        _ => n,
    };
    (corner, axis)
}

/// The edge between two neighbouring corners.
fn edge_between(a: u8, b: u8) -> u8 {
    let corner = a & b;
    let axis = (a ^ b).trailing_zeros() as u8;
    let n = match axis {
        0 => corner >> 1,
        1 => (corner & 1) | (corner >> 2) << 1,
        _ => corner,
    };
    4 * axis + n
}

/// The corners of the six faces, counter-clockwise seen from outside the cell.
fn faces() -> [[u8; 4]; 6] {
    std::array::from_fn(|face| {
        let (axis, upper) = (face / 2, face % 2);
        let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let base = (upper as u8) << axis;
        if upper == 1 {
            [base, base | b, base | b | c, base | c]
        } else {
            [base, base | c, base | b | c, base | b]
        }
    })
}

/// The segments of `mask` on a face, as (edge entered, edge left).
fn segments(mask: u8, face: [u8; 4]) -> Vec<(u8, u8)> {
    let inside = |i: usize| mask >> face[i % 4] & 1 == 1;
    let edge_after = |i: usize| edge_between(face[i % 4], face[(i + 1) % 4]);
    (0..4)
        .filter(|&i| !inside(i) && inside(i + 1))
        .map(|i| {
            let last = (i + 1..).find(|&j| !inside(j + 1)).expect("corner i is outside");
            (edge_after(i), edge_after(last))
        })
        .collect()
}

/// The closed loops in which the surface intersects the faces of the cell, as edges.
fn loops(mask: u8) -> Vec<Vec<u8>> {
    let mut next = [NONE; 12];
    for face in faces() {
        for (entered, left) in segments(mask, face) {
            next[usize::from(entered)] = left;
        }
    }
    let mut found = Vec::new();
    for first in 0..12 {
        let mut outline = Vec::new();
        let mut at = first;
        while next[usize::from(at)] != NONE {
            outline.push(at);
            at = std::mem::replace(&mut next[usize::from(at)], NONE);
        }
        if !outline.is_empty() {
            found.push(outline);
        }
    }
    found
}

/// Whether two edges of the cell lie in one face.
fn share_face(a: u8, b: u8) -> bool {
    faces().iter().any(|face| {
        let on = |e: u8| {
            let (corner, axis) = edge(e);
            face.contains(&corner) && face.contains(&(corner | 1 << axis))
        };
        on(a) && on(b)
    })
}

/// Squared distance between the middles of two edges, in half edges.
fn length(a: u8, b: u8) -> i32 {
    let middle = |e: u8| -> [i32; 3] {
        let (corner, axis) = edge(e);
        std::array::from_fn(|d| i32::from(corner >> d & 1) * 2 + i32::from(usize::from(axis) == d))
    };
    std::iter::zip(middle(a), middle(b)).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Fills a loop with triangles, with the smallest sum of diagonals, none of them in a face. `None` if that is
/// impossible.
fn fill(outline: &[u8]) -> Option<(i32, Vec<[u8; 3]>)> {
    let last = outline.len() - 1;
    if last < 2 {
        return Some((0, Vec::new()));
    }
    let cost = |i: usize, j: usize| {
        let (a, b) = (outline[i], outline[j]);
        if j == i + 1 {
            Some(0)
        } else if share_face(a, b) {
            None
        } else {
            Some(length(a, b))
        }
    };
    let mut best: Option<(i32, Vec<[u8; 3]>)> = None;
    for apex in 1..last {
        let (Some(left), Some(right)) = (cost(0, apex), cost(apex, last)) else { continue };
        let (Some(before), Some(after)) = (fill(&outline[..=apex]), fill(&outline[apex..])) else { continue };
        let total = left + right + before.0 + after.0;
        if best.as_ref().is_none_or(|(least, _)| total < *least) {
            let mut triangles = before.1;
            triangles.push([outline[0], outline[apex], outline[last]]);
            triangles.extend(after.1);
            best = Some((total, triangles));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// How often each directed edge between two vertices occurs in a case.
    fn directed(triangles: &[[u8; 3]]) -> HashMap<(u8, u8), usize> {
        let mut count = HashMap::new();
        for &[a, b, c] in triangles {
            for pair in [(a, b), (b, c), (c, a)] {
                *count.entry(pair).or_insert(0) += 1;
            }
        }
        count
    }

    #[test]
    fn every_mask_fills_its_face_segments_with_a_disc() {
        let cases = Cases::derive();
        for mask in 0..=255_u8 {
            let sides = directed(cases.of(mask));
            let open: Vec<_> =
                sides.keys().filter(|&&(a, b)| !sides.contains_key(&(b, a))).copied().collect();
            let mut expected: Vec<_> = faces().iter().flat_map(|&face| segments(mask, face)).collect();
            let mut found = open.clone();
            expected.sort_unstable();
            found.sort_unstable();
            assert_eq!(found, expected, "mask {mask:08b}: the border is the face segments");
            assert!(sides.values().all(|&n| n == 1), "mask {mask:08b}: a side is used once");
            for &(a, b) in sides.keys() {
                assert!(
                    open.contains(&(a, b)) || open.contains(&(b, a)) || !share_face(a, b),
                    "mask {mask:08b}"
                );
            }
            for outline in loops(mask) {
                assert!(outline.len() >= 3);
            }
            let filled: usize = loops(mask).iter().map(|outline| outline.len() - 2).sum();
            assert_eq!(cases.of(mask).len(), filled, "mask {mask:08b}: each loop is one disc");
        }
    }

    #[test]
    fn every_mask_has_a_vertex_on_exactly_its_crossed_edges() {
        let cases = Cases::derive();
        for mask in 0..=255_u8 {
            for e in 0..12 {
                let (corner, axis) = edge(e);
                assert_eq!(edge_between(corner, corner | 1 << axis), e);
                let crossed = (mask >> corner ^ mask >> (corner | 1 << axis)) & 1 == 1;
                assert_eq!(cases.of(mask).iter().flatten().any(|&v| v == e), crossed, "{mask:08b} edge {e}");
            }
        }
    }

    /// Two adjacent cells have the same segments on their common face, in opposite directions, for all pairs
    /// of masks.
    #[test]
    fn neighbouring_cells_agree_on_their_common_face() {
        for axis in 0..3_u8 {
            let lower = faces()[usize::from(2 * axis)];
            let upper = faces()[usize::from(2 * axis + 1)];
            let bit = 1 << axis;
            for mask in 0..=255_u8 {
                // The neighbour's lower corners are this cell's upper ones; its other corners do not matter.
                let shared: u8 = lower.iter().map(|&c| (mask >> (c | bit) & 1) << c).sum();
                let rest: u8 = lower.iter().map(|&c| (mask >> c & 1) << (c | bit)).sum();
                let shift = |e: u8| {
                    let (corner, along) = edge(e);
                    edge_between(corner ^ bit, (corner ^ bit) | 1 << along)
                };
                let mut here: Vec<_> =
                    segments(mask, upper).iter().map(|&(p, q)| (shift(q), shift(p))).collect();
                here.sort_unstable();
                for beyond in [0, rest, !rest & upper.iter().map(|&c| 1 << c).sum::<u8>()] {
                    let mut there = segments(shared | beyond, lower);
                    there.sort_unstable();
                    assert_eq!(here, there, "axis {axis}, mask {mask:08b}");
                }
            }
        }
    }

    /// A mask and its complement have the same lines on every face, unless its inside corners are diagonal;
    /// then each separates its own inside corners.
    #[test]
    fn a_mask_and_its_complement_agree_on_every_face() {
        for mask in 0..=255_u8 {
            for face in faces() {
                let mut here: Vec<_> = segments(mask, face);
                let mut there: Vec<_> = segments(!mask, face).iter().map(|&(p, q)| (q, p)).collect();
                here.sort_unstable();
                there.sort_unstable();
                if here.len() < 2 {
                    assert_eq!(here, there, "mask {mask:08b}");
                } else {
                    let edges = |s: &[(u8, u8)]| {
                        let mut all: Vec<_> = s.iter().flat_map(|&(p, q)| [p, q]).collect();
                        all.sort_unstable();
                        all
                    };
                    assert_eq!(edges(&here), edges(&there), "mask {mask:08b}: the same four vertices");
                }
            }
        }
    }

    /// One inside corner gives a triangle that faces away from it.
    #[test]
    fn triangles_look_away_from_the_inside() {
        let cases = Cases::derive();
        for corner in 0..8_u8 {
            let [a, b, c] = cases.of(1 << corner)[0].map(|e| {
                let (low, axis) = edge(e);
                let half = nalgebra::Vector3::from_fn(|d, _| if d == usize::from(axis) { 0.5 } else { 0.0 });
                half + nalgebra::Vector3::from_fn(|d, _| f32::from(low >> d & 1))
            });
            let inside = nalgebra::Vector3::from_fn(|d, _| f32::from(corner >> d & 1));
            assert!((b - a).cross(&(c - a)).dot(&(a - inside)) > 0.0, "corner {corner}");
        }
    }
}
