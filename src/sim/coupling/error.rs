//! Why a coupling has no meaning.

/// Why a coupling is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CouplingError {
    /// There is no system or sheet of this name.
    #[error("`{key}`: there is no system or sheet '{name}'; {known}")]
    UnknownName {
        /// The key.
        key: String,
        /// The name.
        name: String,
        /// The systems and sheets of the shot, as a sentence.
        known: String,
    },
    /// These two systems cannot be coupled.
    #[error("`{key}`: '{}' and '{}' cannot be coupled; a liquid and a sheet can, and smoke and a sheet", .names[0], .names[1])]
    UnsupportedPair {
        /// The key.
        key: String,
        /// The names of both.
        names: [String; 2],
    },
    /// An earlier coupling has the same two systems.
    #[error("`{key}`: '{}' and '{}' are already coupled by `coupling.{before}`", .names[0], .names[1])]
    Duplicate {
        /// The key.
        key: String,
        /// The names of both.
        names: [String; 2],
        /// Index of the earlier coupling.
        before: usize,
    },
    /// A parameter that this kind of coupling does not have.
    #[error("`{key}` does not apply to a coupling of '{}' and '{}'", .names[0], .names[1])]
    Inapplicable {
        /// The key.
        key: String,
        /// The names of both.
        names: [String; 2],
    },
    /// A value is out of its range.
    #[error("`{key}` is {value}, expected {expected}")]
    OutOfRange {
        /// The key.
        key: String,
        /// The value.
        value: f32,
        /// The valid range.
        expected: &'static str,
    },
}

impl CouplingError {
    /// The key at fault.
    pub fn key(&self) -> &str {
        match self {
            Self::UnknownName { key, .. }
            | Self::UnsupportedPair { key, .. }
            | Self::Duplicate { key, .. }
            | Self::Inapplicable { key, .. }
            | Self::OutOfRange { key, .. } => key,
        }
    }
}
