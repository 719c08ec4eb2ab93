//! The comment by which a mesh file states what it was made from.

/// The comment that carries a key.
pub(super) fn key_comment(key: u64) -> String {
    format!("{KEY}{key:016x}")
}

/// What introduces the key in a comment.
pub(super) const KEY: &str = "meniscus key ";
