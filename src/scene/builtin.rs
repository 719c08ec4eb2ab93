//! Presets that are built into the binary: `meniscus shot dam-break` needs no file.

/// Every built-in preset: its name and its text.
pub fn all() -> &'static [(&'static str, &'static str)] {
    &[
        ("dam-break", include_str!("../../presets/dam-break.toml")),
        ("double-dam-break", include_str!("../../presets/double-dam-break.toml")),
        ("drop-in-pool", include_str!("../../presets/drop-in-pool.toml")),
    ]
}

/// The text of the built-in preset `name`.
pub fn get(name: &str) -> Option<&'static str> {
    all().iter().find(|(known, _)| *known == name).map(|&(_, text)| text)
}
