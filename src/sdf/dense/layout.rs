//! Decomposition of a dense grid into blocks, and the wavefront over them.

use crate::par;

/// A box of nodes cut into blocks of one size; those at the far ends may be smaller. Blocks are numbered like
/// nodes, x fastest, and so are the nodes of a block.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// The nodes of the box along each axis.
    pub nodes: [usize; 3],
    block: [usize; 3],
    counts: [usize; 3],
}

impl Layout {
    /// Cuts a box of `nodes` into blocks of `block` nodes.
    ///
    /// # Panics
    /// If a block has no node.
    pub fn new(nodes: [usize; 3], block: [usize; 3]) -> Self {
        assert!(block.iter().all(|&n| n > 0), "a block has at least one node");
        Self { nodes, block, counts: std::array::from_fn(|axis| nodes[axis].div_ceil(block[axis])) }
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.counts.iter().product()
    }

    fn coord(&self, block: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [block % nx, block / nx % ny, block / (nx * ny)]
    }

    /// The block of a node of the box.
    #[inline]
    pub fn block_of(&self, node: [usize; 3]) -> usize {
        let [x, y, z] = std::array::from_fn(|axis| node[axis] / self.block[axis]);
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    /// The first node of a block.
    pub fn first(&self, block: usize) -> [usize; 3] {
        let coord = self.coord(block);
        std::array::from_fn(|axis| coord[axis] * self.block[axis])
    }

    /// The nodes of a block along each axis.
    pub fn size(&self, block: usize) -> [usize; 3] {
        let first = self.first(block);
        std::array::from_fn(|axis| self.block[axis].min(self.nodes[axis] - first[axis]))
    }

    /// The blocks beyond the six faces: −x, +x, −y, +y, −z, +z.
    pub fn around(&self, block: usize) -> [Option<usize>; 6] {
        let coord = self.coord(block);
        let strides = [1, self.counts[0], self.counts[0] * self.counts[1]];
        std::array::from_fn(|face| {
            let axis = face / 2;
            let there = if face % 2 == 0 { coord[axis] > 0 } else { coord[axis] + 1 < self.counts[axis] };
            let step = strides[axis];
            there.then(|| if face % 2 == 0 { block - step } else { block + step })
        })
    }

    /// Calls `work` for every block, after its predecessors in the direction of the sweep: [gourlay17].
    pub fn wavefront(&self, order: [i32; 3], work: impl Fn(usize) + Sync) {
        let adjacent = |block: usize, ahead: bool| {
            let faces = self.around(block);
            (0..3).filter_map(move |axis| faces[2 * axis + usize::from((order[axis] > 0) == ahead)])
        };
        par::wavefront(
            self.block_count(),
            |block| adjacent(block, false).count(),
            |block| adjacent(block, true),
            work,
        );
    }

    /// The values of every block, one vector each.
    pub(super) fn split<T: Copy + Send + Sync>(&self, values: &[T]) -> Vec<Vec<T>> {
        assert_eq!(values.len(), self.nodes.iter().product::<usize>(), "one number per node");
        par::map(self.block_count(), |block| {
            let ([fx, fy, fz], [sx, sy, sz]) = (self.first(block), self.size(block));
            let mut own = Vec::with_capacity(sx * sy * sz);
            for z in fz..fz + sz {
                for y in fy..fy + sy {
                    let at = fx + self.nodes[0] * (y + self.nodes[1] * z);
                    own.extend_from_slice(&values[at..at + sx]);
                }
            }
            own
        })
    }

    /// The inverse of [`Layout::split`]; `read` passes a block's values to its argument.
    pub(super) fn join(&self, read: impl Fn(usize, &mut dyn FnMut(&[f32])) + Sync) -> Vec<f32> {
        let [nx, ny, nz] = self.nodes;
        let mut values = vec![0.0; nx * ny * nz];
        let depth = self.block[2];
        // One slab of blocks at a time, so that each block is read once per layer.
        par::for_chunks(&mut values, (nx * ny).max(1), |start, layer| {
            let z = start / (nx * ny);
            let slab = self.counts[0] * self.counts[1];
            for block in z / depth * slab..(z / depth + 1) * slab {
                let ([fx, fy, _], [sx, sy, _]) = (self.first(block), self.size(block));
                read(block, &mut |own| {
                    for y in 0..sy {
                        let to = fx + nx * (fy + y);
                        let from = sx * (y + sy * (z % depth));
                        layer[to..to + sx].copy_from_slice(&own[from..from + sx]);
                    }
                });
            }
        });
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_contain_every_node_once_and_know_their_neighbours() {
        for (nodes, block) in [([7, 5, 9], [3, 2, 4]), ([8, 8, 8], [8, 4, 16]), ([1, 1, 1], [5, 5, 5])] {
            let layout = Layout::new(nodes, block);
            let values: Vec<f32> = (0..nodes.iter().product::<usize>()).map(|i| i as f32).collect();
            let blocks = layout.split(&values);
            assert_eq!(layout.join(|block, f| f(&blocks[block])), values);
            for (block, own) in blocks.iter().enumerate() {
                assert_eq!(own.len(), layout.size(block).iter().product::<usize>());
                for (face, other) in layout.around(block).into_iter().enumerate() {
                    let axis = face / 2;
                    match other {
                        None if face % 2 == 0 => assert_eq!(layout.first(block)[axis], 0),
                        None => {
                            assert_eq!(layout.first(block)[axis] + layout.size(block)[axis], nodes[axis]);
                        }
                        Some(other) => {
                            assert_eq!(layout.around(other)[face ^ 1], Some(block));
                            let (low, high) = if face % 2 == 0 { (other, block) } else { (block, other) };
                            assert_eq!(
                                layout.first(low)[axis] + layout.size(low)[axis],
                                layout.first(high)[axis]
                            );
                        }
                    }
                }
            }
        }
    }
}
