//! Errors in the parameters of sheets, or in a frame to continue from.

/// An error in a preset's sheets, or in a frame to continue from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SheetError {
    /// A number that is NaN, infinite or out of its range.
    #[error("{key} is {value}: {expected}")]
    OutOfRange {
        /// The preset's key, for example `sheet.0.density`.
        key: String,
        /// The value found.
        value: f32,
        /// The values allowed.
        expected: &'static str,
    },
    /// A grid whose corners lie on one line or on one point, or a mesh without area.
    #[error("{key} has no area; its sides need a length and two directions")]
    NoArea {
        /// The preset's key.
        key: String,
    },
    /// A face that names a point that does not exist.
    #[error("{key} names point {point} of {count}")]
    NoSuchPoint {
        /// The preset's key.
        key: String,
        /// The point's number.
        point: u32,
        /// Number of points.
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
        /// The point's number.
        point: u32,
    },
    /// A selection without points, two of different length in a joint, or painted factors whose number
    /// differs from that of the points.
    #[error("{key} selects {found} points; {expected}")]
    Selection {
        /// The preset's key.
        key: String,
        /// Number of points found.
        found: usize,
        /// Requirement.
        expected: &'static str,
    },
    /// An exact joint whose points are apart at the start.
    #[error(
        "{key} has points that are {distance:.2e} m {what} at the start; without stiffness it holds them where they meet, so place them there or give it \
         a stiffness, which draws them there"
    )]
    Apart {
        /// The preset's key.
        key: String,
        /// The distance [m].
        distance: f32,
        /// What the distance is measured from.
        what: &'static str,
    },
    /// A name that no sheet or collider has, or that two have.
    #[error("{key}: '{name}' is not the name of exactly one")]
    Name {
        /// The preset's key.
        key: String,
        /// The name or number.
        name: String,
    },
    /// More points than indices.
    #[error("the sheets have {requested:.1e} points, more than 2³¹; use fewer cells")]
    TooMany {
        /// Number of points requested.
        requested: f64,
    },
    /// The frame to continue from lacks a stream or channel.
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
