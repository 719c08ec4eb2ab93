//! Neighbour search: particles sorted into cells, and neighbour lists.
//!
//! *Method*: particles are ordered by the cell they lie in (z, then y, then x); only occupied cells are stored,
//! so memory follows the particles and a stray one costs one cell. Queries visit nine rows of cells around a point, or 25 for
//! twice the distance. Lists
//! are made cell by cell: particles of a cell share their candidates. Both can be rebuilt in place.

mod cells;
mod gather;
mod lists;

pub use cells::CellGrid;
pub(crate) use cells::{ONE_EDGE, TWO_EDGES};
pub use lists::Neighbours;
