//! Why sheets cannot start.

/// What is wrong with a preset's sheets, or with a frame to go on from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// A number that is NaN, infinite or out of its range.
    #[error("{key} is {value}: {expected}")]
    OutOfRange {
        /// The preset's key, for example `sheet.0.density`.
        key: String,
        /// What stands there.
        value: f32,
        /// What may stand there.
        expected: &'static str,
    },
    /// A grid whose corners lie on one line or on one point, or a mesh without area.
    #[error("{key} has no area; its sides need a length and two directions")]
    NoArea {
        /// The preset's key.
        key: String,
    },
    /// A face that names a point which is not there.
    #[error("{key} names point {point} of {count}")]
    NoSuchPoint {
        /// The preset's key.
        key: String,
        /// Its number.
        point: u32,
        /// Points there are.
        count: u32,
    },
    /// An edge of a mesh that has no length.
    #[error("{key} has an edge without length at point {point}; merge points that lie in one place")]
    Flat {
        /// The preset's key.
        key: String,
        /// One of its ends.
        point: u32,
    },
    /// A point of a mesh that has no face.
    #[error("{key} has no face at point {point}; delete loose points")]
    Loose {
        /// The preset's key.
        key: String,
        /// Its number.
        point: u32,
    },
    /// A selection without points, two of different length in a joint, or painted factors that are not as many as points.
    #[error("{key} selects {found} points; {expected}")]
    Selection {
        /// The preset's key.
        key: String,
        /// How many.
        found: usize,
        /// What is needed.
        expected: &'static str,
    },
    /// A joint that would have to jump at the start.
    #[error(
        "{key} has points that are {off:.2e} m {what} at the start; without stiffness it holds them where they meet, so place them there or give it \
         a stiffness, which draws them there"
    )]
    Apart {
        /// The preset's key.
        key: String,
        /// How far [m].
        off: f32,
        /// From what.
        what: &'static str,
    },
    /// A name that no sheet has, or two have; or a collider that is not there.
    #[error("{key}: '{name}' is not the name of exactly one")]
    Name {
        /// The preset's key.
        key: String,
        /// The name or number.
        name: String,
    },
    /// More points than can be counted.
    #[error("the sheets ask for {asked:.1e} points, more than 2³¹; fewer cells")]
    TooMany {
        /// Points asked for.
        asked: f64,
    },
    /// The frame to go on from lacks a part.
    #[error("the frame's stream '{stream}' has no '{what}' of {count} entries; simulate it again")]
    Missing {
        /// The stream's name.
        stream: String,
        /// The channel, or "points" if the stream itself is missing.
        what: &'static str,
        /// Points of the sheet.
        count: usize,
    },
}
