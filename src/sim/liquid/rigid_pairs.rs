//! The particles near rigid bodies, and the lists of their images; see `images.rs`.

use super::{
    lanes::{self, Node},
    walls::Mirror,
};
use crate::{
    math::Vec3,
    par,
    simd::{IndexList, IndexRow, IndexRows, Lanes},
    space::Neighbours,
};
use std::ops::Range;

/// Mark of a particle that is not near a body.
pub(super) const NO_PAIR: u32 = u32::MAX;

/// A particle near a rigid body.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RigidPair {
    pub(super) particle: u32,
    pub(super) body: u32,
    /// Position in this iteration [m].
    pub(super) x: Vec3,
    /// Distance from the nearest collider when the lists were built [m].
    pub(super) collider_distance: f32,
    /// Whether the body may add to the density at the particle before lists are built again.
    pub(super) is_active: bool,
    /// The body's surface as the particle sees it; only a lower bound of the distance unless the pair is active.
    pub(super) mirror: Mirror,
}

/// Indices of the pairs of particle `i`.
#[inline]
pub(super) fn range_of(first_pair: &[u32], pairs: &[RigidPair], i: usize) -> Range<usize> {
    let Some(&first) = first_pair.get(i).filter(|&&first| first != NO_PAIR) else { return 0..0 };
    let first = first as usize;
    let count = pairs[first..].iter().take_while(|pair| pair.particle as usize == i).count();
    first..first + count
}

/// For each pair, the pairs of its particle's neighbours with the same body whose images may come near before lists are built again.
#[derive(Debug, Default)]
pub(super) struct ImageLists(Vec<ImageChunk>);

/// The lists of up to [`par::CHUNK`] pairs.
#[derive(Debug)]
struct ImageChunk {
    /// The list of the chunk's pair k ends at `ends[k]`, and starts at the end of the one before.
    ends: Vec<u32>,
    list: IndexList,
}

impl ImageLists {
    /// Finds the pairs among the neighbours. The pairs have their positions when the lists were built, and lower bounds of the distances from the
    /// body that they will have; `skin` is how much closer two particles may come, over h.
    pub(super) fn rebuild(
        &mut self,
        lists: &Neighbours,
        first_pair: &[u32],
        pairs: &[RigidPair],
        [inv_h, skin]: [f32; 2],
    ) {
        self.0 = par::map_chunks(pairs.len(), par::CHUNK, |range| {
            let (mut ends, mut list) = (Vec::with_capacity(range.len()), Vec::new());
            for own in &pairs[range] {
                let &RigidPair { particle, body, x, .. } = own;
                let may_come_near = |other: &RigidPair| {
                    let nearest = ((x - other.x).norm() * inv_h - skin).max(0.0);
                    nearest * nearest + 4.0 * own.mirror.distance * other.mirror.distance < 1.0
                };
                // `range_of` would read the pairs of each neighbour twice.
                let of_body = |&j: &u32| {
                    let first = first_pair.get(j as usize).filter(|&&first| first != NO_PAIR)?;
                    let mut of_particle =
                        (*first..).zip(&pairs[*first as usize..]).take_while(|(_, pair)| pair.particle == j);
                    let (place, other) = of_particle.find(|(_, pair)| pair.body == body)?;
                    may_come_near(other).then_some(place)
                };
                list.extend(lists.of(particle as usize).iter().filter_map(of_body));
                ends.push(list.len() as u32);
            }
            list.shrink_to_fit();
            // The last index is that of the padding.
            ImageChunk { ends, list: IndexList::new(list, pairs.len() + 1) }
        });
    }

    /// The chunk of pair `k`, and the range of its list there.
    #[inline(always)]
    pub(super) fn place_of(&self, k: usize) -> (&IndexList, Range<usize>) {
        let ImageChunk { ends, list } = &self.0[k / par::CHUNK];
        let k = k % par::CHUNK;
        let start = if k == 0 { 0 } else { ends[k - 1] };
        (list, start as usize..ends[k] as usize)
    }

    /// The list of pair `k` by eights, filled up with `padding`.
    #[inline(always)]
    pub(super) fn rows<L: Lanes>(&self, k: usize, padding: usize) -> IndexRows<'_> {
        let (list, range) = self.place_of(k);
        list.rows::<L>(range, padding)
    }
}

/// The pairs as their neighbours read them. The last is the padding of lists, whose weight, normal, slope and λ are zero.
#[derive(Debug, Default)]
pub(super) struct ImageNodes {
    /// Positions and distances from the body, over h.
    places: Vec<Node>,
    /// Normals, and weights.
    faces: Vec<Node>,
    /// Slopes of the weights, and changes of λ.
    slopes: Vec<Node>,
}

impl ImageNodes {
    /// Copies positions and mirrors of the pairs.
    pub(super) fn publish(&mut self, pairs: &[RigidPair], inv_h: f32) {
        let Self { places, faces, slopes } = self;
        copy(places, pairs, |pair| Node::new(pair.x * inv_h, pair.mirror.distance));
        copy(faces, pairs, |pair| Node::new(pair.mirror.normal, pair.mirror.weight));
        copy(slopes, pairs, |pair| Node::new(pair.mirror.slope, 0.0));
    }

    /// Sets the changes of λ, which `value` gives by particle [m²].
    pub(super) fn set_lambda(&mut self, pairs: &[RigidPair], value: impl Fn(u32) -> f32 + Sync) {
        par::update(&mut self.slopes[..pairs.len()], |k, node| node.0[3] = value(pairs[k].particle));
    }

    /// The change of λ of pair `k` [m²].
    #[inline(always)]
    pub(super) fn lambda(&self, k: usize) -> f32 {
        self.slopes[k].value()
    }

    /// Eight pairs.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(&self, index: IndexRow<'_>) -> ImageNodeLanes<L> {
        let [place, face, slope] = [&self.places, &self.faces, &self.slopes];
        ImageNodeLanes {
            place: lanes::gather(place, index),
            face: lanes::gather(face, index),
            slope: lanes::gather(slope, index),
        }
    }

    /// Pair `k` in every lane.
    #[inline(always)]
    pub(super) fn spread<L: Lanes>(&self, k: usize) -> ImageNodeLanes<L> {
        let [place, face, slope] = [self.places[k], self.faces[k], self.slopes[k]];
        ImageNodeLanes { place: lanes::spread(place), face: lanes::spread(face), slope: lanes::spread(slope) }
    }
}

/// Eight pairs of [`ImageNodes`].
#[derive(Clone, Copy)]
pub(super) struct ImageNodeLanes<L> {
    pub(super) place: [L; 4],
    pub(super) face: [L; 4],
    pub(super) slope: [L; 4],
}

/// Sets a node for each pair, and the padding.
fn copy(nodes: &mut Vec<Node>, pairs: &[RigidPair], of: impl Fn(&RigidPair) -> Node + Sync) {
    nodes.resize(pairs.len() + 1, Node::default());
    nodes[pairs.len()] = Node::default();
    par::fill(&mut nodes[..pairs.len()], |k| of(&pairs[k]));
}
