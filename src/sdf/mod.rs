//! sdf
