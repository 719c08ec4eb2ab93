//! The table of surfaces as files.

use super::{Apart, By, Line, Table, seconds};
use crate::run::{
    RunError,
    tradeoff::{
        page::{Page, full, introduction, maybe, rows},
        plot::{Entry, Panel, figure, percent},
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
    let frames: Vec<String> = table.frames.iter().map(u32::to_string).collect();
    Page {
        title: &table.title,
        introduction: introduction(
            &format!(
                "Frames {}, about {:.0} particles of spacing {} m, {} threads",
                frames.join(", "),
                table.particles,
                table.spacing,
                table.threads
            ),
            &uncertainty(table),
        ),
        panels: panels(table),
        head: head.map(String::from).to_vec(),
        rows: rows(&table.lines, &table.reference, table.knee, |line| line.front, |number, line, mark| {
            cells(number, line, mark, table)
        }),
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
        distance.map(|d| format!("{} spacings", figure(d / f64::from(table.spacing)))),
        normals.map(|n| format!("{}° of the normals", figure(n))),
        volume.map(|v| format!("{} of the volume", percent(v))),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn cells(number: &str, line: &Line, mark: &str, table: &Table) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let spacings = |metres: f64| figure(metres / f64::from(table.spacing));
    let passes = line.passes.iter().map(|(name, seconds)| format!("{name} {}", figure(*seconds)));
    vec![
        number.into(),
        line.label.clone(),
        figure(line.seconds.median),
        format!("{:.0} s", line.shot_seconds),
        maybe(line.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        format!("{:.0}", line.triangles),
        maybe(line.apart.distance, &spacings),
        maybe(line.apart.hausdorff, &spacings),
        maybe(line.apart.normals, &|n| format!("{}°", figure(n))),
        maybe(line.apart.volume, &|v| format!("{:+.2} %", 100.0 * v)),
        maybe(line.field.map(|field| field.mean), &figure),
        passes.collect::<Vec<_>>().join(", "),
        mark.into(),
    ]
}

fn panels(table: &Table) -> Vec<Panel> {
    let spacing = f64::from(table.spacing);
    let made = By::ALL.map(|by| {
        let (title, scale) = match by {
            By::Distance => ("distance from the reference, RMS [spacings]", 1.0 / spacing),
            By::Hausdorff => ("largest distance from the reference [spacings]", 1.0 / spacing),
            By::Normals => ("normals, from the reference [deg]", 1.0),
            By::Volume => ("volume, from the reference [%]", 100.0),
            By::Field => ("signed distance, mean error [voxels]", 1.0),
        };
        let Apart { distance, hausdorff, normals, volume, .. } = table.uncertainty;
        let raw = |line: &Line| match by {
            By::Distance => line.apart.distance,
            By::Hausdorff => line.apart.hausdorff,
            By::Normals => line.apart.normals,
            By::Volume => line.apart.volume,
            By::Field => line.field.map(|field| field.mean),
        };
        let blind = match by {
            By::Distance => distance,
            By::Hausdorff => hausdorff,
            By::Normals => normals,
            By::Volume => volume,
            By::Field => None,
        };
        let entry = |(place, line): (usize, &Line)| {
            let spread = seconds(line, by);
            Entry {
                place,
                label: line.label.clone(),
                seconds: [spread.min, spread.median, spread.max],
                error: raw(line).map(|error| scale * error.abs()),
                lost: raw(line).is_none().then(|| "no surface to compare".into()),
                knee: table.knee == Some(place) && table.by == by,
            }
        };
        let entries = table.lines.iter().enumerate().map(entry).collect();
        let below =
            if by == By::Field { "seconds a frame for the signed distance alone" } else { "seconds a frame" };
        Panel::new(title.into(), below, entries, &table.front(by), scale * blind.unwrap_or(0.0).abs())
    });
    made.into_iter().flatten().collect()
}

/// Every line, the reference and its refinement; SI units, parts as fractions, empty where there is no value.
fn csv(table: &Table) -> Vec<Vec<String>> {
    let all = || table.lines.iter().chain([&table.reference, &table.refined]);
    let mut passes: Vec<&str> = Vec::new();
    for (name, _) in all().flat_map(|line| &line.passes) {
        if !passes.contains(&name.as_str()) {
            passes.push(name);
        }
    }
    let head = "setting,seconds_median,seconds_min,seconds_max,cpu_seconds,shot_seconds,memory_bytes,vertices,triangles,\
                pieces,volume,area,unsound_frames,distance_rms,hausdorff,hausdorff_beyond,hausdorff_missing,\
                normals_rms_deg,volume_apart,field_seconds,field_error_mean_voxels,field_error_largest_voxels,on_front,knee";
    let fields = |line: &Line, knee: bool| {
        let Apart { distance, hausdorff, beyond, missing, normals, volume } = line.apart;
        let mut fields = vec![
            line.label.clone(),
            line.seconds.median.to_string(),
            line.seconds.min.to_string(),
            line.seconds.max.to_string(),
            maybe(line.cpu_seconds.map(|spread| spread.median)),
            line.shot_seconds.to_string(),
            line.memory.map_or_else(String::new, |bytes| bytes.to_string()),
            line.vertices.to_string(),
            line.triangles.to_string(),
            line.pieces.to_string(),
            line.volume.to_string(),
            line.area.to_string(),
            line.unsound.to_string(),
            maybe(distance),
            maybe(hausdorff),
            maybe(beyond),
            maybe(missing),
            maybe(normals),
            maybe(volume),
            line.field_seconds.median.to_string(),
            maybe(line.field.map(|field| field.mean)),
            maybe(line.field.map(|field| field.largest)),
            line.front.to_string(),
            knee.to_string(),
        ];
        let of = |pass: &&str| line.passes.iter().find(|(name, _)| name == pass).map(|(_, seconds)| *seconds);
        fields.extend(passes.iter().map(|pass| maybe(of(pass))));
        fields
    };
    let named = passes.iter().map(|pass| format!("seconds_{}", pass.replace(' ', "_")));
    let head = head.split(',').map(String::from).chain(named).collect();
    // The refinement's distance from the reference is what the reference's own errors are judged by.
    let refined = Line { apart: table.uncertainty, ..table.refined.clone() };
    full(head, &table.lines, [&table.reference, &refined], table.knee, fields)
}
