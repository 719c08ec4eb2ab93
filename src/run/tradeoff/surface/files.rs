//! The table of surfaces as files.

use super::{Apart, By, Line, Table};
use crate::run::{
    RunError,
    tradeoff::{
        page::{self, Page, Shown, introduction, maybe, rows},
        plot::{Panel, figure, percent},
    },
};
use std::path::{Path, PathBuf};

/// Writes `tradeoff.csv`, `tradeoff.svg` and `tradeoff.html` into `folder` and returns their paths.
///
/// # Errors
/// If one cannot be written.
pub fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
    page(table).write(folder)
}

fn page(table: &Table) -> Page<'_> {
    let head = [
        "#",
        "setting",
        "s a frame",
        "whole shot",
        "MiB",
        "triangles",
        "rms",
        "largest",
        "normals",
        "volume",
        "field",
        "where the time goes",
        "",
    ];
    let frames: Vec<String> = table.about.frames.iter().map(u32::to_string).collect();
    Page {
        title: &table.title,
        introduction: introduction(
            &format!(
                "Frames {}, about {:.0} particles of spacing {} m, {} threads",
                frames.join(", "),
                table.about.particles,
                table.about.spacing,
                table.threads
            ),
            &uncertainty(table),
        ),
        panels: panels(table),
        head: head.map(String::from).to_vec(),
        rows: rows(table, |number, line, mark| cells(number, line, mark, table)),
        legend: "Rms and largest: distance between the surface and the reference's, both ways, in particle spacings. \
                 Normals: angle to those of the nearest points, RMS. Volume: of all frames, against the reference's. Field: \
                 how far the signed distance is from the exact distance to its own zero, mean over the band, in voxels."
            .into(),
        csv: csv(table),
    }
}

/// How far the reference is from its refinement, in words.
fn uncertainty(table: &Table) -> String {
    let Apart { distance, normals, volume, .. } = table.uncertainty;
    let parts = [
        distance.map(|d| format!("{} spacings", figure(d / f64::from(table.about.spacing)))),
        normals.map(|n| format!("{}° of the normals", figure(n))),
        volume.map(|v| format!("{} of the volume", percent(v))),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn cells(number: &str, line: &Line, mark: &str, table: &Table) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let spacings = |metres: f64| figure(metres / f64::from(table.about.spacing));
    let passes = line.told.passes.iter().map(|(name, seconds)| format!("{name} {}", figure(*seconds)));
    vec![
        number.into(),
        line.label.clone(),
        figure(line.seconds.median),
        format!("{:.0} s", line.shot_seconds),
        maybe(line.told.memory.map(|bytes| bytes as f64), &|bytes| {
            format!("{:.0}", bytes / f64::from(1 << 20))
        }),
        format!("{:.0}", line.told.triangles),
        maybe(line.apart.distance, &spacings),
        maybe(line.apart.hausdorff, &spacings),
        maybe(line.apart.normals, &|n| format!("{}°", figure(n))),
        maybe(line.apart.volume, &|v| format!("{:+.2} %", 100.0 * v)),
        maybe(line.told.field.map(|field| field.mean), &figure),
        passes.collect::<Vec<_>>().join(", "),
        mark.into(),
    ]
}

fn panels(table: &Table) -> Vec<Panel> {
    let spacings = 1.0 / f64::from(table.about.spacing);
    let shown = By::ALL.map(|by| {
        let (title, scale) = match by {
            By::Distance => ("distance from the reference, RMS [spacings]", spacings),
            By::Hausdorff => ("largest distance from the reference [spacings]", spacings),
            By::Normals => ("normals, from the reference [deg]", 1.0),
            By::Volume => ("volume, from the reference [%]", 100.0),
            By::Field => ("signed distance, mean error [voxels]", 1.0),
        };
        let below =
            if by == By::Field { "seconds a frame for the signed distance alone" } else { "seconds a frame" };
        Shown { by, title: title.into(), below, scale }
    });
    page::panels(table, shown)
}

fn csv(table: &Table) -> Vec<Vec<String>> {
    let all = || table.lines.iter().chain([&table.reference, &table.refined]);
    let mut passes: Vec<&str> = Vec::new();
    for (name, _) in all().flat_map(|line| &line.told.passes) {
        if !passes.contains(&name.as_str()) {
            passes.push(name);
        }
    }
    let own = "memory_bytes,vertices,triangles,pieces,volume,area,unsound_frames,distance_rms,hausdorff,hausdorff_beyond,\
               hausdorff_missing,normals_rms_deg,volume_apart,field_seconds,field_error_mean_voxels,field_error_largest_voxels";
    let named = passes.iter().map(|pass| format!("seconds_{}", pass.replace(' ', "_")));
    page::csv(table, own.split(',').map(String::from).chain(named), |line| {
        let Apart { distance, hausdorff, beyond, missing, normals, volume } = line.apart;
        let told = &line.told;
        let mut fields = vec![
            told.memory.map_or_else(String::new, |bytes| bytes.to_string()),
            told.vertices.to_string(),
            told.triangles.to_string(),
            told.pieces.to_string(),
            told.volume.to_string(),
            told.area.to_string(),
            told.unsound.to_string(),
            maybe(distance),
            maybe(hausdorff),
            maybe(beyond),
            maybe(missing),
            maybe(normals),
            maybe(volume),
            maybe(told.field_seconds.map(|spread| spread.median)),
            maybe(told.field.map(|field| field.mean)),
            maybe(told.field.map(|field| field.largest)),
        ];
        let of = |pass: &&str| told.passes.iter().find(|(name, _)| name == pass).map(|(_, seconds)| *seconds);
        fields.extend(passes.iter().map(|pass| maybe(of(pass))));
        fields
    })
}
