//! Wedges: variants of a shot, one for each combination of some settings, each in a shot folder of its own.
//!
//! A wedge is an ordinary shot: it resumes, is meshed and verified as any other, here or on a farm. What compares them, the contact
//! sheet (`pictures.rs`) and the table (`table.rs`), is made of what the folders hold, and reports those that are not what the list names
//! (`faults.rs`).

mod faults;
mod layout;
mod list;
mod pictures;
mod table;

pub(crate) use layout::{Layout, lay_out};
pub(crate) use list::WedgeList;
pub(crate) use pictures::{MAX_FRAMES, draw_wedges};
pub(crate) use table::{rows, write};
