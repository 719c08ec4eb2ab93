//! Checks of the liquid in a preset, once every value is valid on its own.

use crate::math::elementary::cbrt;
use crate::{
    frame::COLOR,
    preset::{check::Places, problem::Finding, shapes::source_finding},
    sim::{
        liquid::{Constraint, LiquidChannel, LiquidParams},
        scene::Scene,
    },
};

/// Largest number of particles that 32-bit neighbour lists can index.
const MAX_PARTICLES: f64 = 2_147_483_648.0;

/// Reports contradictions in the liquid, and what cannot be simulated.
pub(super) fn check_liquid(liquid: &LiquidParams, places: &Places, findings: &mut Vec<Finding>) {
    if liquid.iterations.is_some() && liquid.density_dev.is_some() {
        findings.push(
            Finding::new(
                places.of("liquid.iterations"),
                "liquid.iterations",
                "`liquid.iterations` and `liquid.density_dev` exclude each other",
                "a fixed number of iterations, but `density_dev` is given too",
            )
            .with_help("remove one of them; on the command line, `--set liquid.density_dev=none` does it"),
        );
    }
    if liquid.artificial_pressure.is_some() && liquid.constraint == Constraint::Compression {
        findings.push(
            Finding::new(
                places.of("liquid.artificial_pressure"),
                "liquid.artificial_pressure",
                "`liquid.artificial_pressure` needs `constraint = \"equality\"`",
                "found the constraint \"compression\", under which nothing opposes the repulsion and a free liquid doubles its \
                 volume",
            )
            .with_help(
                "remove the table: under \"compression\" the surface needs no repulsion; or write `constraint = \"equality\"`, the \
                 paper's combination, in `[liquid]`",
            ),
        );
    }
    if liquid.vorticity.is_some() && liquid.micropolar.is_some() {
        // The later of the two tables is the one that was added.
        let key = ["liquid.vorticity", "liquid.micropolar"].into_iter().max_by_key(|key| places.of(key));
        let key = key.unwrap_or("liquid.micropolar");
        findings.push(
            Finding::new(
                places.of(key),
                key,
                "`liquid.vorticity` and `liquid.micropolar` exclude each other",
                "both return lost energy to vortices, and would share one budget",
            )
            .with_help(
                "remove one of the tables; on the command line, `--set liquid.vorticity=none` does it",
            ),
        );
    }
    if liquid.min_substeps > liquid.max_substeps {
        let (min, max) = (liquid.min_substeps, liquid.max_substeps);
        // The later of the two keys is the one that broke the order.
        let key = ["liquid.min_substeps", "liquid.max_substeps"].into_iter().max_by_key(|key| places.of(key));
        let key = key.unwrap_or("liquid.min_substeps");
        findings.push(
            Finding::new(
                places.of(key),
                key,
                format!("`min_substeps` ({min}) is above `max_substeps` ({max})"),
                format!("found {min} to {max} substeps a frame, expected the smaller number first"),
            )
            .with_help("raise `max_substeps` or lower `min_substeps`; both have defaults"),
        );
    }
    if liquid.source.is_empty() && liquid.emitter.is_empty() {
        findings.push(
            Finding::new(
                places.of("liquid.source"),
                "liquid.source",
                "the liquid has no source and no emitter, so there is nothing to simulate",
                "expected at least one `[[liquid.source]]` or `[[liquid.emitter]]`",
            )
            .with_help(
                "add `[[liquid.source]]` with `shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }`",
            ),
        );
    }
    for (index, source) in liquid.source.iter().enumerate() {
        findings.extend(source_finding(&format!("liquid.source.{index}"), &source.shape, places));
    }
    check_viscosities(liquid, places, findings);
    check_particle_count(liquid, places, findings);
}

/// Whether there is a table `viscosity` where a source or a channel needs it.
fn check_viscosities(liquid: &LiquidParams, places: &Places, findings: &mut Vec<Finding>) {
    if liquid.viscosity.is_some() {
        return;
    }
    let sources = liquid.source.iter().map(|source| source.viscosity).enumerate();
    let sources = sources.map(|(index, viscosity)| (format!("liquid.source.{index}.viscosity"), viscosity));
    let emitters = liquid.emitter.iter().map(|emitter| emitter.viscosity).enumerate();
    let emitters =
        emitters.map(|(index, viscosity)| (format!("liquid.emitter.{index}.viscosity"), viscosity));
    for (key, viscosity) in sources.chain(emitters).filter_map(|(key, viscosity)| Some((key, viscosity?))) {
        let message = format!("`{key}` needs the table `liquid.viscosity`");
        let found = format!("found {viscosity} Pa·s, and no `[liquid.viscosity]`");
        let help = "add `[liquid.viscosity]` with `dynamic`, the viscosity of sources and emitters that name none, or remove the key";
        findings.push(Finding::new(places.of(&key), &key, message, found).with_help(help));
    }
    if liquid.channels.contains(&LiquidChannel::Viscosity) {
        let key = "liquid.channels";
        let message = "the channel `viscosity` needs the table `liquid.viscosity`";
        let found = "found `viscosity`, and no `[liquid.viscosity]`";
        let help = "add `[liquid.viscosity]` with `dynamic`, or remove the channel";
        findings.push(Finding::new(places.of(key), key, message, found).with_help(help));
    }
}

fn check_particle_count(liquid: &LiquidParams, places: &Places, findings: &mut Vec<Finding>) {
    let count = particle_estimate(liquid);
    if count > MAX_PARTICLES {
        let volume = count * f64::from(liquid.spacing).powi(3);
        let key = "liquid.spacing";
        let needed = cbrt(volume / MAX_PARTICLES);
        findings.push(
            Finding::new(
                places.of(key),
                key,
                format!("the sources hold about {count:.3e} particles, more than the solver can index ({MAX_PARTICLES})"),
                format!("found {} m between particles, for {volume:.3} m³ of liquid", liquid.spacing),
            )
            .with_help(format!("make `liquid.spacing` larger than {needed:.2e} m, or the sources smaller")),
        );
    }
}

/// Estimate of the number of particles by volume; overlapping sources count twice, and meshes, whose volume is in their file,
/// do not count.
pub(super) fn particle_estimate(liquid: &LiquidParams) -> f64 {
    let volume: f64 = liquid.source.iter().map(|source| source.shape.volume()).sum();
    volume / f64::from(liquid.spacing).powi(3)
}

/// Estimate of the number of particles at the shot's end, if none leaves; `None` without a liquid.
#[cfg(test)]
pub(crate) fn final_particle_estimate(scene: &Scene) -> Option<f64> {
    let emitted = |liquid: &LiquidParams| {
        crate::sim::liquid::inflow::emitted_particles(liquid, scene.timeline(), scene.seconds())
    };
    scene.liquid.as_ref().map(|liquid| particle_estimate(liquid) + emitted(liquid))
}

/// Whether there is a liquid on which colliders with friction, restitution or a contact angle act.
pub(super) fn check_colliders(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let has_tension = scene.liquid.as_ref().is_some_and(|liquid| liquid.surface_tension.is_some());
    for (index, collider) in scene.world.collider.iter().enumerate() {
        if let Some(angle) = collider.contact_angle.filter(|_| !has_tension) {
            let key = format!("world.collider.{index}.contact_angle");
            let message = "`contact_angle` of a collider needs a liquid with surface tension";
            let found = format!("found {angle}°, and no `[liquid.surface_tension]`");
            let help = "add `[liquid.surface_tension]` with a `coefficient`, \"0.072 N/m\" for water, or remove the angle";
            findings.push(Finding::new(places.of(&key), &key, message, found).with_help(help));
        }
    }
    let colliders = scene.world.collider.iter().enumerate().filter(|_| scene.liquid.is_none());
    for (index, collider) in colliders {
        for (name, value) in [("friction", collider.friction), ("restitution", collider.restitution)] {
            if let Some(value) = value {
                let key = format!("world.collider.{index}.{name}");
                let message = format!("`{name}` of a collider acts on liquids, and the preset has none");
                findings.push(
                    Finding::new(places.of(&key), &key, message, format!("found {value}"))
                        .with_help("remove it; the friction of sheets on colliders is `sheets.friction`"),
                );
            }
        }
    }
}

/// Whether a source or an emitter has a colour, if the surface is to have colours.
pub(super) fn check_colors(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let Some(liquid) = &scene.liquid else { return };
    if liquid.colors().is_none() && scene.surface.attributes.iter().flatten().any(|name| name == COLOR) {
        let key = "surface.attributes";
        let message = "no source and no emitter has a colour";
        let found = format!("found `{COLOR}`, and no source or emitter with the key `color`");
        let help = "add `color = [0.8, 0.1, 0.05]` to a `[[liquid.source]]` or `[[liquid.emitter]]`, or remove the attribute";
        findings.push(Finding::new(places.of(key), key, message, found).with_help(help));
    }
}

/// Whether the particles have the channels that the surface is to have as attributes.
pub(super) fn check_attributes(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let Some(liquid) = &scene.liquid else { return };
    let wanted = |name: &str| scene.surface.attributes.iter().flatten().any(|attribute| attribute == name);
    let carries = |channel: &LiquidChannel| liquid.frame_channels().any(|found| found == *channel);
    let needed = LiquidChannel::ALL.into_iter().filter(|channel| carries(channel) || wanted(channel.name()));
    let needed: Vec<_> = needed.map(|channel| format!("\"{}\"", channel.name())).collect();
    for channel in LiquidChannel::ALL {
        let name = channel.name();
        if wanted(name) && !carries(&channel) {
            findings.push(
                Finding::new(
                    places.of("surface.attributes"),
                    "surface.attributes",
                    format!("the particles have no channel `{name}`"),
                    format!("found `{name}`, which `liquid.channels` does not name"),
                )
                .with_help(format!(
                    "write `channels = [{}]` in `[liquid]`; an existing cache must be simulated again",
                    needed.join(", ")
                )),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{Overrides, Scene, load};

    /// The dam break with these settings; the message where it is refused.
    fn dam_break(set: &[&str]) -> Result<Scene, String> {
        let preset = load("dam-break").expect("a built-in preset");
        let set = set.iter().map(ToString::to_string).collect();
        Scene::from_preset(&preset, &Overrides { quality: None, set }).map_err(|error| format!("{error:?}"))
    }

    #[test]
    fn a_viscosity_of_a_source_needs_the_table_of_viscosity() {
        let own = "liquid.source.0.viscosity=10 Pa·s";
        let disc = "shape = { disc = { center = [0, 0, 1], normal = [0, 0, -1], radius = 0.1 } }";
        let nozzle = format!("liquid.emitter=[{{ {disc}, rate = 0.01, viscosity = 3 }}]");
        for set in [own, &nozzle, "liquid.channels=[\"viscosity\"]"] {
            let error = dam_break(&[set]).unwrap_err();
            assert!(error.contains("add `[liquid.viscosity]` with `dynamic`"), "{error}");
        }
        let table = "liquid.viscosity={ dynamic = 1 }";
        for set in [own, &nozzle, "liquid.channels=[\"viscosity\"]"] {
            dam_break(&[set, table]).unwrap();
        }
        // Frames have the source where it decides the viscosity.
        let wanted = "surface.attributes=[\"source\"]";
        assert!(dam_break(&[own, table, wanted]).is_ok() && dam_break(&[table, wanted]).is_err());
        assert!(dam_break(&["liquid.source.0.viscosity=0", table]).is_err());
    }
}
