//! Presets that are built into the binary: `meniscus shot dam-break` needs no file.

/// Every built-in preset: its name and its text.
pub fn all() -> &'static [(&'static str, &'static str)] {
    &[
        ("balls-in-cloth", include_str!("../../presets/balls-in-cloth.toml")),
        ("cloth-over-ellipsoid", include_str!("../../presets/cloth-over-ellipsoid.toml")),
        ("colliding-rings", include_str!("../../presets/colliding-rings.toml")),
        ("crown-splash", include_str!("../../presets/crown-splash.toml")),
        ("dam-break", include_str!("../../presets/dam-break.toml")),
        ("dam-break-rocks", include_str!("../../presets/dam-break-rocks.toml")),
        ("double-dam-break", include_str!("../../presets/double-dam-break.toml")),
        ("drop-in-pool", include_str!("../../presets/drop-in-pool.toml")),
        ("ducks", include_str!("../../presets/ducks.toml")),
        ("falling-sheets", include_str!("../../presets/falling-sheets.toml")),
        ("figure-bath", include_str!("../../presets/figure-bath.toml")),
        ("figure-drop", include_str!("../../presets/figure-drop.toml")),
        ("figure-splash", include_str!("../../presets/figure-splash.toml")),
        ("filling-glass", include_str!("../../presets/filling-glass.toml")),
        ("flag-in-smoke", include_str!("../../presets/flag-in-smoke.toml")),
        ("floating-crates", include_str!("../../presets/floating-crates.toml")),
        ("fruit-in-honey", include_str!("../../presets/fruit-in-honey.toml")),
        ("fountain", include_str!("../../presets/fountain.toml")),
        ("honey", include_str!("../../presets/honey.toml")),
        ("leapfrog-rings", include_str!("../../presets/leapfrog-rings.toml")),
        ("plume", include_str!("../../presets/plume.toml")),
        ("rain-on-pond", include_str!("../../presets/rain-on-pond.toml")),
        ("ring-through-arch", include_str!("../../presets/ring-through-arch.toml")),
        ("sheet-center", include_str!("../../presets/sheet-center.toml")),
        ("sheet-corners", include_str!("../../presets/sheet-corners.toml")),
        ("sheet-over-torus", include_str!("../../presets/sheet-over-torus.toml")),
        ("smoke-over-bear", include_str!("../../presets/smoke-over-bear.toml")),
        ("smoke-over-sphere", include_str!("../../presets/smoke-over-sphere.toml")),
        ("smoke-ring", include_str!("../../presets/smoke-ring.toml")),
        ("stretchy-center", include_str!("../../presets/stretchy-center.toml")),
        ("stretchy-corners", include_str!("../../presets/stretchy-corners.toml")),
        ("sundae", include_str!("../../presets/sundae.toml")),
        ("tablecloth", include_str!("../../presets/tablecloth.toml")),
        ("through-torus", include_str!("../../presets/through-torus.toml")),
        ("tipping-cup", include_str!("../../presets/tipping-cup.toml")),
        ("torus-small-hole", include_str!("../../presets/torus-small-hole.toml")),
        ("wading", include_str!("../../presets/wading.toml")),
        ("walk-through-smoke", include_str!("../../presets/walk-through-smoke.toml")),
        ("water-drop", include_str!("../../presets/water-drop.toml")),
        ("water-on-cloth", include_str!("../../presets/water-on-cloth.toml")),
        ("waterfall", include_str!("../../presets/waterfall.toml")),
        ("wave-machine", include_str!("../../presets/wave-machine.toml")),
        ("zero-gravity-vortex", include_str!("../../presets/zero-gravity-vortex.toml")),
    ]
}

/// Files that built-in presets name: their names and their bytes.
pub fn assets() -> &'static [(&'static str, &'static [u8])] {
    &[
        ("assets/bear.ply", include_bytes!("../../presets/assets/bear.ply")),
        ("assets/duck.ply", include_bytes!("../../presets/assets/duck.ply")),
        ("assets/glass.ply", include_bytes!("../../presets/assets/glass.ply")),
        ("assets/rabbit.ply", include_bytes!("../../presets/assets/rabbit.ply")),
        ("assets/rock.ply", include_bytes!("../../presets/assets/rock.ply")),
        ("assets/rubber-duck.ply", include_bytes!("../../presets/assets/rubber-duck.ply")),
        ("assets/walker.pc2", include_bytes!("../../presets/assets/walker.pc2")),
        ("assets/walker.ply", include_bytes!("../../presets/assets/walker.ply")),
    ]
}

/// The bytes of the built-in file `name`.
pub fn asset(name: &str) -> Option<&'static [u8]> {
    assets().iter().find(|(known, _)| *known == name).map(|&(_, bytes)| bytes)
}

/// The text of the built-in preset `name`.
pub fn get(name: &str) -> Option<&'static str> {
    all().iter().find(|(known, _)| *known == name).map(|&(_, text)| text)
}
