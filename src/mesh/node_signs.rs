//! Signs of the nodes of a brick and of its upper neighbours, as bits: all that the topology of marching
//! cubes needs.

use super::Contour;
use crate::grid::{BRICK, Bricks, NodeMask, mask_of};

/// Index of a missing brick.
pub(super) const MISSING: u32 = u32::MAX;

/// The inside nodes of a brick.
#[derive(Clone, Copy, Default)]
pub(super) struct BrickSigns(NodeMask);

impl BrickSigns {
    /// The signs of brick `brick`.
    pub(super) fn of(contour: &Contour, brick: usize) -> Self {
        Self(mask_of(contour.grid.brick(brick), |&value| contour.is_inside(value)))
    }

    /// The nodes of row y of layer z, bit x.
    fn row(&self, y: usize, z: usize) -> u16 {
        (self.0[z] >> (BRICK * y)) as u16 & 0xff
    }

    /// Whether all nodes are inside (`Some(true)`) or outside (`Some(false)`).
    fn corner(&self) -> Option<bool> {
        let all = |word: u64| self.0.iter().all(|&other| other == word);
        if all(u64::MAX) { Some(true) } else { all(0).then_some(false) }
    }
}

/// Signs of the nodes of a brick and of those of its upper neighbours that its cells touch: 9³.
pub(super) struct PaddedSigns {
    /// This brick and its upper neighbours, by [`neighbour`].
    pub(super) around: [u32; 8],
    /// Rows of nodes along x: bit x of row y + 9·z is set if node (x, y, z) is inside …
    inside: [u16; 81],
    /// … and if its brick exists.
    present: [u16; 81],
}

/// Index of the upper neighbour that holds a node 0..=8 along each axis: bit 0 is set for those along x, bit
/// 1 for y, bit 2 for z.
pub(super) fn neighbour(node: [usize; 3]) -> usize {
    (0..3).map(|axis| (node[axis] / BRICK) << axis).sum()
}

/// The brick at `coord` and its upper neighbours, by [`neighbour`]; missing ones have an index that no brick
/// has.
pub(super) fn around(bricks: &Bricks, coord: [i32; 3]) -> [u32; 8] {
    let coords = bricks.coords();
    let mut around = [MISSING; 8];
    for corner in [0, 2, 4, 6] {
        let neighbour_coord: [i32; 3] = std::array::from_fn(|axis| coord[axis] + (corner >> axis & 1) as i32);
        let next = [neighbour_coord[0] + 1, neighbour_coord[1], neighbour_coord[2]];
        let found = bricks.find(neighbour_coord);
        // Bricks are in order of z, y, x: the next along x follows directly, if it exists.
        let after = match found {
            Some(found) => coords.get(found + 1).is_some_and(|&coord| coord == next).then_some(found + 1),
            None => bricks.find(next),
        };
        around[corner] = found.map_or(MISSING, |found| found as u32);
        around[corner + 1] = after.map_or(MISSING, |found| found as u32);
    }
    around
}

impl PaddedSigns {
    /// The signs of the bricks `around`.
    pub(super) fn of(signs: &[BrickSigns], around: [u32; 8]) -> Self {
        let (mut inside, mut present) = ([0; 81], [0; 81]);
        for z in 0..=BRICK {
            for y in 0..=BRICK {
                let corner = neighbour([0, y, z]);
                let row = |brick: u32| signs.get(brick as usize).map(|signs| signs.row(y % BRICK, z % BRICK));
                let (own, next) = (row(around[corner]), row(around[corner | 1]).map(|row| row & 1));
                inside[y + 9 * z] = own.unwrap_or(0) | next.unwrap_or(0) << BRICK;
                present[y + 9 * z] = own.map_or(0, |_| 0xff) | next.map_or(0, |_| 1) << BRICK;
            }
        }
        Self { around, inside, present }
    }

    /// The signs of brick `brick`; `None` if it and its upper neighbours are on one side.
    pub(super) fn crossed(bricks: &Bricks, signs: &[BrickSigns], brick: usize) -> Option<Self> {
        let around = around(bricks, bricks.coords()[brick]);
        let own = signs[brick].corner();
        let same_side = |&other: &u32| other == MISSING || signs[other as usize].corner() == own;
        (own.is_none() || !around.iter().all(same_side)).then(|| Self::of(signs, around))
    }

    /// The nodes of row y of layer z whose edges along x, y and z the surface crosses.
    #[inline]
    pub(super) fn edges(&self, y: usize, z: usize) -> [u16; 3] {
        let (row, inside, present) = (y + 9 * z, &self.inside, &self.present);
        [(0, 1), (1, 0), (9, 0)].map(|(step, shift)| {
            (inside[row] ^ (inside[row + step] >> shift))
                & present[row]
                & (present[row + step] >> shift)
                & 0xff
        })
    }

    /// The nodes x of row y of layer z with a crossed edge, with these edges: bit 0 along x, 1 y, 2 z.
    #[inline]
    pub(super) fn crossed_edges(&self, y: usize, z: usize) -> impl Iterator<Item = (usize, u16)> + use<> {
        let edges = self.edges(y, z);
        let of = move |x: usize| (0..3).map(|axis| (edges[axis] >> x & 1) << axis).sum();
        bits(edges[0] | edges[1] | edges[2]).map(move |x| (x, of(x)))
    }

    /// The cells of row y of layer z with corners on both sides, and those with all corners.
    #[inline]
    pub(super) fn cells(&self, y: usize, z: usize) -> (u16, u16) {
        let [mut any_inside, mut any_outside, mut all_present] = [0, 0, u16::MAX];
        for row in [0, 1, 9, 10].map(|step| y + 9 * z + step) {
            any_inside |= self.inside[row];
            any_outside |= self.present[row] & !self.inside[row];
            all_present &= self.present[row];
        }
        let crossed = (any_inside | any_inside >> 1) & (any_outside | any_outside >> 1) & 0xff;
        (crossed, all_present & all_present >> 1)
    }

    /// Whether the lowest layers of nodes across x, y and z, with those of the upper neighbours, have nodes
    /// on both sides.
    pub(super) fn crossed_layers(&self) -> [bool; 3] {
        let crossed = |step: usize, count: usize, mask: u16| {
            let rows = || (0..count).map(|i| step * i);
            rows().any(|row| self.inside[row] & mask != 0)
                && rows().any(|row| self.present[row] & !self.inside[row] & mask != 0)
        };
        [crossed(1, 81, 1), crossed(9, 9, u16::MAX), crossed(1, 9, u16::MAX)]
    }

    /// The inside corners of a cell.
    #[inline]
    pub(super) fn mask(&self, [x, y, z]: [usize; 3]) -> u8 {
        let corners = |i: usize, step: usize| (self.inside[y + 9 * z + step] >> x & 3) << (2 * i);
        (corners(0, 0) | corners(1, 1) | corners(2, 9) | corners(3, 10)) as u8
    }
}

/// The positions of the set bits, from the lowest.
#[inline]
pub(super) fn bits(mut word: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = word.trailing_zeros() as usize;
        let is_set = word != 0;
        word &= word.wrapping_sub(1);
        is_set.then_some(place)
    })
}
