//! What the numerics promise: orders of convergence, conservation, closed forms, the same bytes every time.

mod bodies;
mod bodies_at_rest;
mod bodies_viscosity;
mod cavities;
mod cleanup;
mod contact;
mod coupling;
mod decimation;
#[path = "../../benches/reference/dense.rs"]
mod dense;
mod eikonal;
mod liquid;
mod liquid_cylinder;
mod liquid_drops;
mod liquid_extremes;
mod liquid_friction;
mod liquid_inflow;
mod liquid_micropolar;
mod liquid_viscosity;
mod mesh;
mod sdf;
mod sheet;
mod smoke;
mod smoothing;
mod solidify;
mod solids;
mod surface_field;
mod volumes;
mod vortex;
mod vortex_dynamics;
mod vortex_extremes;
mod vortex_grid;

/// Whether the long studies run too (`tools/soak/run`): otherwise tests with many similar cases run some of them.
fn is_soak() -> bool {
    std::env::var_os("MENISCUS_SOAK").is_some()
}

/// Numbers of threads whose results are compared with those of one, in tests that take seconds. From three on, sorting by
/// groups is parallel too (`src/par/groups.rs`).
fn thread_counts() -> &'static [usize] {
    if is_soak() { &[2, 3, 8] } else { &[3] }
}

/// A table of a preset as the program reads it: by way of its JSON, so that the tests compile no reader of TOML for each type.
fn from_toml<T: serde::de::DeserializeOwned>(text: &str) -> T {
    let table: serde_json::Value = toml::from_str(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    serde_json::from_value(table).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
