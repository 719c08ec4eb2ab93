//! Quality tiers of a preset.

use std::{fmt, str::FromStr};

/// How much of the preset's detail to compute: a tier is a `[quality.NAME]` table of the preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quality {
    /// Seconds: does the shot work at all?
    Draft,
    /// Minutes: how does it move?
    Preview,
    /// The preset as written, or its `[quality.final]`.
    Final,
}

impl Quality {
    /// Every tier, coarse to fine.
    pub const ALL: [Self; 3] = [Self::Draft, Self::Preview, Self::Final];

    /// The tier's name in presets and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Preview => "preview",
            Self::Final => "final",
        }
    }

    /// Settings, as a preset, of surfaces of particles without a preset.
    pub(crate) fn surface_settings(self) -> &'static str {
        match self {
            Self::Draft => "[surface]\nvoxel = 0.75\n",
            Self::Preview => "[surface.smoothing]\n",
            Self::Final => "[surface.anisotropy]\n[surface.smoothing]\n",
        }
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A word that names no quality tier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected `draft`, `preview` or `final`")]
pub struct UnknownQuality;

impl FromStr for Quality {
    type Err = UnknownQuality;

    fn from_str(text: &str) -> Result<Self, UnknownQuality> {
        Self::ALL.into_iter().find(|quality| quality.name() == text).ok_or(UnknownQuality)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::SurfaceParams;
    use crate::scene::{Overrides, Scene, builtin, load, surface_params};

    #[test]
    fn the_final_tier_of_surfaces_is_that_of_the_liquid_presets() {
        let surface = |quality| surface_params(Some(quality), &[]).unwrap();
        let last = surface(Quality::Final);
        let mut liquids = 0;
        for (name, _) in builtin::all() {
            let scene = Scene::from_preset(&load(name).unwrap(), &Overrides::default()).unwrap();
            if scene.liquid.is_some() && *name != "honey" {
                // Particle files have no colliders to fit a surface to.
                let has_contact = scene.surface.contact.is_some();
                assert_eq!(has_contact, !scene.world.collider.is_empty(), "{name}");
                assert_eq!(SurfaceParams { contact: None, ..scene.surface }, last, "{name}");
                liquids += 1;
            }
        }
        assert!(liquids > 9, "{liquids}");
        assert!(last.distance.is_none() && surface(Quality::Draft).has_no_cleanup());
        assert!(
            surface(Quality::Preview).anisotropy.is_none() && !surface(Quality::Preview).has_no_cleanup()
        );
    }
}
