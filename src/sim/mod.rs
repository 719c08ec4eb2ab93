//! Simulation: the systems, their sources and forces, composed from what the preset names.

pub mod liquid;
