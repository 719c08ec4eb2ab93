//! Reports of the liquid: progress, warnings, totals.

use super::flow;
use crate::{
    cache::StreamInfo,
    frame::FrameIndex,
    job::{
        Total, nonzero,
        tradeoff::{figure, readable_volume},
    },
    sim::{
        FrameRecord, force,
        liquid::{
            EmptySource, LiquidRecord, LiquidSeeds, NAME, SubmergedBody, ThinSolid, record::FRAME_FIGURES,
        },
        system::{CachedFrame, PlottedFigure},
    },
};
use serde_json::json;

/// Sources without particles that are reported one by one; of others only their number is.
const MAX_EMPTY_SOURCES: usize = 4;

/// Thin colliders that are reported one by one; of others only their number is.
const MAX_THIN_SOLIDS: usize = 4;

/// Particles that seeding skipped, sources without any, and a viscosity that the spacing cannot show.
pub(super) fn seeding_warnings(seeds: &LiquidSeeds) -> Vec<String> {
    let mut warnings = nonzero(&[
        (
            seeds.skipped_in_solids.into(),
            "particles of the sources were skipped: they were inside solids or touched them",
        ),
        (
            seeds.skipped_overlapping.into(),
            "particles of the sources were skipped: another source had already filled their position",
        ),
    ]);
    let (listed, more) = seeds.empty_sources.split_at(seeds.empty_sources.len().min(MAX_EMPTY_SOURCES));
    warnings.extend(listed.iter().map(empty_source_warning));
    if let Some(last) = more.last() {
        let count = more.len();
        warnings
            .push(format!("{count} more sources hold no particle, the last is liquid.source.{}", last.index));
    }
    let (listed, more) = seeds.thin_solids.split_at(seeds.thin_solids.len().min(MAX_THIN_SOLIDS));
    warnings.extend(listed.iter().map(thin_solid_warning));
    if let Some(last) = more.last() {
        let (count, last) = (more.len(), key_of(last));
        warnings.push(format!("{count} more colliders and bodies are as thin, the last is {last}"));
    }
    let LiquidSeeds { far_from_origin, precise_distance, .. } = *seeds;
    if far_from_origin > 0.0 {
        warnings.push(format!(
            "particles are up to {} m from the world's origin, where single precision stops slow motion and may skip sources; \
             move the scene within {} m of the origin",
            figure(far_from_origin, 2),
            figure(precise_distance, 2)
        ));
    }
    warnings.extend(flow::seeding_warnings(seeds));
    let LiquidSeeds { viscosity, solver_viscosity, speed, .. } = *seeds;
    if viscosity > 0.0 && viscosity < solver_viscosity {
        warnings.push(format!(
            "a viscosity of {viscosity} Pa·s will hardly show in fast motion: at {speed:.1} m/s and this spacing, \
             eddies fade in the solver as with about {solver_viscosity:.2} Pa·s; slow, thin layers still show it. Lower \
             liquid.spacing, or leave `liquid.viscosity` out to save its time"
        ));
    }
    warnings.extend(seeds.submerged_body.map(submerged_body_warning));
    if seeds.rows_hold_bodies {
        warnings.push(
            "viscous liquid keeps its particles in rows, which hold bodies of up to twice its density in place: \
             write liquid.kernel_radius = 2.5"
                .into(),
        );
    }
    warnings
}

fn empty_source_warning(source: &EmptySource) -> String {
    let EmptySource { index, skipped, volume, sufficient_spacing } = *source;
    let why = match (skipped, sufficient_spacing) {
        (0, Some(spacing)) => format!(
            "its volume is that of {} particles; liquid.spacing = {} gives it some, or enlarge it",
            figure(volume, 2),
            figure(spacing, 2)
        ),
        (0, None) => format!(
            "its volume is that of {} particles; enlarge it, or lower liquid.spacing",
            figure(volume, 2)
        ),
        _ => format!(
            "all {skipped} were skipped, in solids or where another source had already filled their position"
        ),
    };
    format!("liquid.source.{index} holds no particle: {why}")
}

fn thin_solid_warning(solid: &ThinSolid) -> String {
    let ThinSolid { is_body, thickness, sufficient_thickness, .. } = *solid;
    let (thickness, sufficient) = (figure(thickness, 2), figure(sufficient_thickness, 2));
    let (effect, purpose) = match is_body {
        true => ("it stays below the surface", "For it to float"),
        false => ("liquid on one side acts on liquid on the other", "If it separates liquids"),
    };
    let key = key_of(solid);
    format!(
        "{key} is {thickness} m thick: {effect}. {purpose}, make it at least {sufficient} m thick, or lower liquid.spacing"
    )
}

fn submerged_body_warning(body: SubmergedBody) -> String {
    let SubmergedBody { index, others, spacings, .. } = body;
    let also = if others > 0 { format!(", as {others} larger") } else { String::new() };
    format!(
        "body.{index} starts inside the liquid{also}. Its inner radius is {} spacings, and liquid that has not moved holds a body of this size \
         back, so that it rises or sinks too slowly. Write liquid.kernel_radius = 2.2",
        figure(spacings, 2)
    )
}

/// Where the preset has a solid.
fn key_of(solid: &ThinSolid) -> String {
    format!("{}.{}", if solid.is_body { "body" } else { "world.collider" }, solid.index)
}

/// Progress line of a frame.
pub(super) fn progress(record: &LiquidRecord) -> String {
    let percent = |value: f64| format!("{:.2}%", 100.0 * value);
    let flow = record.flow.as_ref().map(|flow| flow::progress(flow) + "  ").unwrap_or_default();
    format!(
        "{flow}substeps {}  iterations {}  compression {} (max {})  dilation {}  volume {:+.1}%",
        record.substeps,
        record.iterations,
        percent(record.compression_avg),
        percent(record.density_dev_max),
        percent(record.dilation_avg),
        100.0 * record.volume_change,
    )
}

/// The figures that reports plot.
pub(super) fn plotted(record: &LiquidRecord) -> Vec<PlottedFigure> {
    let LiquidRecord { compression_avg, dilation_avg, kinetic_energy, potential_energy, .. } = *record;
    let mut figures = Vec::new();
    let density = [("compression", 100.0 * compression_avg), ("dilation", 100.0 * dilation_avg)];
    figures.extend(PlottedFigure::of("Density deviation of the bulk", "%", density));
    figures.extend(PlottedFigure::of("Volume of the liquid", "m³", [("volume", record.volume)]));
    let change = [("change", 100.0 * record.volume_change)];
    figures.extend(PlottedFigure::of("Change of the volume", "%", change));
    let total = kinetic_energy + potential_energy + record.surface_energy;
    let energies = [
        ("kinetic", kinetic_energy),
        ("potential", potential_energy),
        ("surface", record.surface_energy),
        ("sum", total),
    ];
    figures.extend(PlottedFigure::of("Energy of the liquid", "J", energies));
    let iterations = [
        ("substeps", f64::from(record.substeps)),
        ("density", f64::from(record.iterations)),
        ("viscosity", f64::from(record.viscosity_iterations)),
    ];
    figures.extend(PlottedFigure::of("Iterations of the liquid", "a frame", iterations));
    figures
}

/// Limits that changed a frame.
pub(super) fn warnings(record: &LiquidRecord) -> Vec<String> {
    let clamps = &record.clamps;
    let flow = record.flow.as_ref().map(flow::warnings).unwrap_or_default();
    let limits = nonzero(&[
        (record.unconverged.into(), "substeps stopped at max_iterations"),
        (record.viscosity_unconverged.into(), "viscous solves stopped at liquid.viscosity.max_iterations"),
        (record.pressure_unconverged.into(), "density solves before viscosity stopped at max_iterations"),
        (record.cfl_capped.into(), "substeps longer than cfl or surface tension allows (max_substeps)"),
        (clamps.corrections, "corrections shortened"),
        (clamps.energy, "velocities held to the energy bound"),
        (clamps.confinement, "confinements scaled down"),
        (clamps.micropolar, "micropolar exchanges scaled down"),
        (clamps.contacts, "contacts unresolved"),
        (u64::from(clamps.momentum), "iterations slowed down"),
        (record.particles_inside_solids.into(), "particles inside solids"),
    ]);
    [flow, limits, force::report::warnings(record.forces.as_ref(), "liquid.max_substeps")].concat()
}

/// Figures of a frame's end in its header.
pub(super) fn frame_figures(streams: &[StreamInfo]) -> Vec<(&'static str, f64)> {
    let scalars = streams.iter().filter(|stream| stream.name == NAME).flat_map(|stream| &stream.scalars);
    let named =
        |name: &'static str| scalars.clone().find(|(key, _)| key == name).map(|&(_, value)| (name, value));
    FRAME_FIGURES.iter().filter_map(|(name, _)| named(name)).collect()
}

/// Compression, dilation and volume over all frames, from their headers.
pub(super) fn cached_totals(frames: &[CachedFrame]) -> Vec<Total> {
    let mut totals = totals(frames.iter().map(|frame| (frame.index, frame_figures(&frame.streams))));
    totals.extend(flow::totals(frames));
    let forces = frames.iter().filter_map(|frame| frame.record.as_ref()?.liquid.as_ref()?.forces.as_ref());
    totals.extend(force::report::total("forces_on_liquid", forces));
    totals
}

/// Compression, dilation and volume over all frames, from their records.
pub(super) fn record_totals(frames: &[(FrameIndex, FrameRecord)]) -> Vec<Total> {
    let figures =
        |record: &LiquidRecord| FRAME_FIGURES.iter().map(|(name, value)| (*name, value(record))).collect();
    totals(frames.iter().filter_map(|(index, record)| Some((*index, figures(record.liquid.as_ref()?)))))
}

fn totals(frames: impl Iterator<Item = (FrameIndex, Vec<(&'static str, f64)>)>) -> Vec<Total> {
    // Caches of older versions lack some.
    let frames: Vec<_> = frames.filter(|(_, figures)| figures.len() == FRAME_FIGURES.len()).collect();
    let Some((last, _)) = frames.last() else { return Vec::new() };
    let values = |name: &'static str| {
        let all =
            frames.iter().flat_map(|(index, figures)| figures.iter().map(move |figure| (*index, figure)));
        all.filter(move |(_, (key, _))| *key == name).map(|(index, (_, value))| (index, *value))
    };
    let mean = |name| values(name).map(|(_, value)| value).sum::<f64>() / frames.len() as f64;
    let max = |name| values(name).map(|(_, value)| value).fold(0.0, f64::max);
    let end = |name| values(name).next_back().map_or(0.0, |(_, value)| value);
    let largest =
        |most: (FrameIndex, f64), now: (FrameIndex, f64)| if now.1.abs() > most.1.abs() { now } else { most };
    let (frame, change) = values("volume_change").fold((*last, 0.0), largest);
    let percent = |value: f64| format!("{:.2} %", 100.0 * value);
    let density = Total {
        key: NAME,
        value: json!({
            "frames": frames.len(),
            "density_dev_avg": mean("density_dev_avg"),
            "density_dev_max": max("density_dev_max"),
            "compression_avg": mean("compression_avg"),
            "compression_max": max("compression_avg"),
            "dilation_avg": mean("dilation_avg"),
            "dilation_max": max("dilation_avg"),
        }),
        heading: "density",
        text: format!(
            "compression {}, dilation {} on average; {} and {} in the worst frame; {} at most of a particle",
            percent(mean("compression_avg")),
            percent(mean("dilation_avg")),
            percent(max("compression_avg")),
            percent(max("dilation_avg")),
            percent(max("density_dev_max")),
        ),
    };
    let volume = Total {
        key: "liquid_volume",
        value: json!({
            "volume": end("volume"),
            "change": end("volume_change"),
            "largest_change": change,
            "largest_change_frame": frame,
            "isolated": end("isolated"),
            "components": end("components"),
        }),
        heading: "liquid",
        text: format!(
            "{} in frame {last} ({:+.2} %), {:+.2} % at most (frame {frame}); {} component{}, {} isolated particles",
            readable_volume(end("volume"), 4),
            100.0 * end("volume_change"),
            100.0 * change,
            end("components"),
            if end("components") == 1.0 { "" } else { "s" },
            end("isolated"),
        ),
    };
    vec![density, volume]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_are_means_and_extremes_and_the_end_of_the_shot() {
        let frame = |index: u32, compression_avg: f64, dilation_avg: f64, volume_change: f64| {
            let liquid = Some(LiquidRecord {
                compression_avg,
                dilation_avg,
                volume_change,
                volume: 0.00021 * (1.0 + volume_change),
                isolated: index,
                components: 2 * index,
                ..LiquidRecord::default()
            });
            (FrameIndex(index), FrameRecord { liquid, ..FrameRecord::default() })
        };
        let frames = [frame(2, 0.01, 0.0, 0.02), frame(3, 0.0, 0.04, -0.5), frame(4, 0.002, 0.02, 0.001)];
        let [density, volume] = <[Total; 2]>::try_from(record_totals(&frames)).unwrap();
        assert_eq!(
            density.text,
            "compression 0.40 %, dilation 2.00 % on average; 1.00 % and 4.00 % in the worst frame; 0.00 % at most of a particle"
        );
        assert_eq!(
            volume.text,
            "0.2102 L in frame 0004 (+0.10 %), -50.00 % at most (frame 0003); 8 components, 4 isolated particles"
        );
        assert_eq!(
            (&volume.value["largest_change"], &volume.value["largest_change_frame"]),
            (&json!(-0.5), &json!(3))
        );
        assert_eq!(record_totals(&[]), []);
        assert_eq!(cached_totals(&[CachedFrame::default()]), []);
    }

    #[test]
    fn sources_without_particles_are_named_up_to_a_limit() {
        let empty = |index, skipped, sufficient_spacing| EmptySource {
            index,
            skipped,
            volume: 0.268,
            sufficient_spacing,
        };
        let mut seeds = LiquidSeeds {
            empty_sources: vec![empty(0, 0, Some(0.0123)), empty(3, 7, None), empty(4, 0, None)],
            ..LiquidSeeds::default()
        };
        let warnings = seeding_warnings(&seeds);
        assert_eq!(warnings.len(), 3);
        assert_eq!(
            warnings[0],
            "liquid.source.0 holds no particle: its volume is that of 0.27 particles; liquid.spacing = 0.012 gives it some, or enlarge it"
        );
        assert!(
            warnings[1].starts_with("liquid.source.3 holds no particle: all 7 were skipped"),
            "{warnings:?}"
        );
        assert!(warnings[2].contains("liquid.source.4") && warnings[2].contains("lower"), "{warnings:?}");
        seeds.empty_sources = (0..60).map(|index| empty(index, 0, None)).collect();
        let warnings = seeding_warnings(&seeds);
        assert_eq!(warnings.len(), 5);
        assert_eq!(warnings[4], "56 more sources hold no particle, the last is liquid.source.59");
    }

    #[test]
    fn liquid_far_from_the_origin_is_reported() {
        let seeds = LiquidSeeds { far_from_origin: 1e4, precise_distance: 840.0, ..LiquidSeeds::default() };
        let [warning] = &seeding_warnings(&seeds)[..] else { panic!("one warning") };
        assert!(warning.contains("10000 m") && warning.contains("within 840 m"), "{warning}");
        let near = LiquidSeeds { precise_distance: 840.0, ..LiquidSeeds::default() };
        assert!(seeding_warnings(&near).is_empty());
    }

    #[test]
    fn thin_colliders_are_named_up_to_a_limit() {
        let thin =
            |index| ThinSolid { index, is_body: index == 8, thickness: 0.004, sufficient_thickness: 0.02 };
        let mut seeds = LiquidSeeds { thin_solids: vec![thin(2)], ..LiquidSeeds::default() };
        assert_eq!(
            seeding_warnings(&seeds),
            [
                "world.collider.2 is 0.004 m thick: liquid on one side acts on liquid on the other. If it separates liquids, make it at \
              least 0.02 m thick, or lower liquid.spacing"
            ]
        );
        seeds.thin_solids = (0..9).map(thin).collect();
        let warnings = seeding_warnings(&seeds);
        assert_eq!(warnings.len(), 5);
        assert_eq!(warnings[4], "5 more colliders and bodies are as thin, the last is body.8");
        seeds.thin_solids = vec![thin(8)];
        assert_eq!(
            seeding_warnings(&seeds),
            [
                "body.8 is 0.004 m thick: it stays below the surface. For it to float, make it at least 0.02 m thick, or lower liquid.spacing"
            ]
        );
    }

    #[test]
    fn a_viscosity_below_that_of_the_solver_is_reported_with_both() {
        let seeds = |viscosity| LiquidSeeds {
            viscosity,
            solver_viscosity: 20.0,
            speed: 2.0,
            ..LiquidSeeds::default()
        };
        let warnings = seeding_warnings(&seeds(0.001));
        assert!(
            warnings.len() == 1 && warnings[0].contains("0.001 Pa·s") && warnings[0].contains("20.00 Pa·s")
        );
        assert!(
            seeding_warnings(&seeds(50.0)).is_empty() && seeding_warnings(&LiquidSeeds::default()).is_empty()
        );
        let held = LiquidSeeds { rows_hold_bodies: true, ..LiquidSeeds::default() };
        assert!(seeding_warnings(&held)[0].contains("kernel_radius = 2.5"));
    }

    #[test]
    fn a_submerged_body_is_named_with_what_helps() {
        let submerged_body = Some(SubmergedBody { index: 3, others: 2, spacings: 6.0 });
        let seeds = LiquidSeeds { submerged_body, ..LiquidSeeds::default() };
        let [warning] = &seeding_warnings(&seeds)[..] else { panic!("one warning") };
        assert!(
            warning.contains("body.3 starts inside the liquid, as 2 larger. Its inner radius is 6 spacings"),
            "{warning}"
        );
        assert!(warning.contains("liquid.kernel_radius = 2.2"), "{warning}");
    }
}
