//! The figures of meshes in the lines of `mesh.jsonl`, and the frames whose mesh jumps.
//!
//! A surface that is cut anew in every frame may pop: a droplet falls between the nodes, a hole opens for one frame.
//! Volume, area and components of consecutive frames show it: a change that is several times the changes around it is
//! reported. It may be real (liquid poured in, a splash that breaks up), so it is a remark and no fault.
//!
//! A mesh that encloses another volume than its particles have is reported too: once a stream, with the worst frame.

use super::spacing::NeighbourDistances;
use crate::{
    export::MeshFormat,
    frame::FrameIndex,
    job::{
        RunError, ShotFolder,
        file_records::{hex, path, read_lines},
        is_file_name,
        tradeoff::{figure, readable_volume},
    },
    mesh::{MeshCheck, Surface, SurfaceStats},
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::{collections::BTreeMap, fmt};

/// The name of the folder of the meshes.
pub(super) const MESH_FOLDER: &str = "mesh";

/// Significant digits of volumes and areas.
pub(super) const DIGITS: i32 = 4;

/// The figures of one mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MeshRecord {
    /// The frame.
    pub frame: FrameIndex,
    /// The stream it shows.
    pub name: String,
    /// Key of what the mesh was made from, as in its file.
    pub key: String,
    /// Enclosed volume [m³].
    pub volume: f64,
    /// Volume of the particles [m³]: as the system measured it, or else spacing³ each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub particle_volume: Option<f64>,
    /// Area [m²].
    pub area: f64,
    /// Connected components.
    #[serde(rename = "pieces")]
    pub components: usize,
    /// Distances between the particles of a file, whose spacing may be wrong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<NeighbourDistances>,
}

/// The figures of a mesh, and the statistics of its reconstruction.
#[derive(Serialize)]
struct LogLine<'a> {
    #[serde(flatten)]
    record: &'a MeshRecord,
    #[serde(flatten)]
    stats: &'a SurfaceStats,
}

/// A change from one frame to the next that the changes around it do not suggest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Jump {
    /// The frame that differs from the one before.
    pub frame: FrameIndex,
    /// The stream.
    pub name: String,
    /// "volume", "area" or "components".
    pub what: &'static str,
    /// In the frame before.
    pub before: f64,
    /// In this frame.
    pub after: f64,
    /// The median of the changes around.
    pub usual: f64,
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, name, what, before, after, usual } = self;
        let [before, after, change, usual] =
            [*before, *after, (after - before).abs(), *usual].map(|value| figure(value, DIGITS));
        write!(
            f,
            "frame {frame} of {name}: {what} goes from {before} to {after}, by {change} where {usual} is usual"
        )
    }
}

impl MeshRecord {
    /// The figures of a surface of particles with the volume `particle_volume` [m³].
    pub(super) fn new(
        name: &str,
        frame: FrameIndex,
        key: u64,
        surface: &Surface,
        particle_volume: Option<f64>,
        neighbours: Option<NeighbourDistances>,
    ) -> Self {
        let (name, key) = (name.into(), hex(key));
        let MeshCheck { volume, area, components, .. } = surface.check;
        Self { frame, name, key, volume, particle_volume, area, components, neighbours }
    }

    /// The mesh's volume over that of its particles, less one; `None` if that is unknown or zero.
    pub(super) fn volume_difference(&self) -> Option<f64> {
        self.particle_volume.filter(|&volume| volume > 0.0).map(|volume| self.volume / volume - 1.0)
    }

    /// What the line of the mesh's files holds of it: all but what the line of every file has.
    pub(super) fn figures(&self, stats: &SurfaceStats) -> Map<String, Value> {
        let Ok(Value::Object(mut figures)) = serde_json::to_value(LogLine { record: self, stats }) else {
            unreachable!("figures are plain data")
        };
        for key in ["frame", "name", "key"] {
            figures.shift_remove(key);
        }
        figures
    }

    /// Whether the mesh is still in the folder.
    fn is_present(&self, folder: &ShotFolder) -> bool {
        let key = u64::from_str_radix(&self.key, 16).ok();
        // The line may name any file as a mesh.
        key.is_some()
            && is_file_name(&self.name)
            && MeshFormat::ALL.into_iter().any(|format| {
                let file = format!("{}_{}.{}", self.name, self.frame, format.extension());
                format.key_in(&folder.subfolder(MESH_FOLDER).join(file)) == key
            })
    }
}

/// The last line about every mesh that is still in the folder, by stream and frame; none if there is no log. A line that a
/// crash cut short is skipped.
pub(super) fn read(folder: &ShotFolder) -> Result<Vec<MeshRecord>, RunError> {
    let text = read_lines(&path(folder, MESH_FOLDER))?;
    let records = text.lines().filter_map(|line| serde_json::from_str::<MeshRecord>(line).ok());
    let last: BTreeMap<(String, FrameIndex), MeshRecord> =
        records.map(|record| ((record.name.clone(), record.frame), record)).collect();
    Ok(last.into_values().filter(|record| record.is_present(folder)).collect())
}

/// Changes on either side whose median is the usual one. Fewer, and the jump itself is the median; more, and the calm
/// before a splash makes every frame of it a jump.
const NEIGHBOUR_CHANGES: usize = 4;

/// The smallest jump, over the usual change. Smaller reports the first frames of every splash.
const MIN_JUMP_OVER_USUAL: f64 = 4.0;

/// The smallest jump as a fraction of the larger value …
const MIN_JUMP_FRACTION: [(&str, f64); 3] = [("volume", 0.01), ("area", 0.05), ("components", 0.25)];

/// … and as a number of components.
const MIN_JUMP_COMPONENTS: f64 = 3.0;

/// The jumps between consecutive records of the same stream, which are sorted. Gaps in the frames are not bridged: a
/// change over several frames is divided by their number.
pub(super) fn jumps(records: &[MeshRecord]) -> Vec<Jump> {
    let mut found = Vec::new();
    for series in records.chunk_by(|a, b| a.name == b.name) {
        for (what, fraction) in MIN_JUMP_FRACTION {
            let value = |record: &MeshRecord| match what {
                "volume" => record.volume,
                "area" => record.area,
                _ => record.components as f64,
            };
            let change = |pair: &[MeshRecord]| {
                let frames = f64::from(pair[1].frame.0 - pair[0].frame.0);
                (value(&pair[1]) - value(&pair[0])).abs() / frames
            };
            let changes: Vec<f64> = series.windows(2).map(change).collect();
            for (i, pair) in series.windows(2).enumerate() {
                let range =
                    i.saturating_sub(NEIGHBOUR_CHANGES)..(i + NEIGHBOUR_CHANGES + 1).min(changes.len());
                let mut others: Vec<f64> = range.filter(|&j| j != i).map(|j| changes[j]).collect();
                others.sort_unstable_by(f64::total_cmp);
                let Some(&usual) = others.get(others.len() / 2) else { continue };
                let (before, after) = (value(&pair[0]), value(&pair[1]));
                let components = if what == "components" { MIN_JUMP_COMPONENTS } else { 0.0 };
                let floor = fraction * before.abs().max(after.abs()) + components;
                if changes[i] > MIN_JUMP_OVER_USUAL * usual + floor {
                    let name = pair[1].name.clone();
                    found.push(Jump { frame: pair[1].frame, name, what, before, after, usual });
                }
            }
        }
    }
    found.sort_by(|a, b| (&a.name, a.frame).cmp(&(&b.name, b.frame)));
    found
}

/// Difference of a mesh's volume from that of its particles above which it is reported. Without artificial pressure, drafts of
/// the built-in presets stay within 7 %: torn films have too much (figure-bath, +6 %), spread-out water too little
/// (water-on-cloth, −7 %).
const MAX_VOLUME_DIFFERENCE: f64 = 0.1;

/// Reports, of each stream, the mesh whose volume differs most from that of its particles, if that is too much. Records are
/// sorted by stream.
pub(super) fn volume_warnings(records: &[MeshRecord]) -> Vec<String> {
    let warning = |series: &[MeshRecord]| {
        let known = || series.iter().filter_map(|record| Some((record, record.volume_difference()?)));
        let is_off = |difference: f64| difference.is_nan() || difference.abs() > MAX_VOLUME_DIFFERENCE;
        let count = known().filter(|(_, difference)| is_off(*difference)).count();
        let (worst, difference) = known().max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
        let MeshRecord { frame, name, volume, .. } = worst;
        (count > 0).then(|| {
            format!(
                "volume: the mesh of {name} in frame {frame} has {}, {:+.0} % against its particles, and {count} of {} meshes \
                 are off by more than {:.0} %: check the spacing of the particles, or lower surface.voxel",
                readable_volume(*volume, DIGITS),
                100.0 * difference,
                series.len(),
                100.0 * MAX_VOLUME_DIFFERENCE
            )
        })
    };
    records.chunk_by(|a, b| a.name == b.name).filter_map(warning).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{job::file_records::append_line, mesh::Mesh};

    fn series(volumes: &[f64]) -> Vec<MeshRecord> {
        let record = |(frame, &volume): (u32, &f64)| MeshRecord {
            frame: FrameIndex(frame),
            name: "liquid".into(),
            key: format!("{frame:016x}"),
            volume,
            particle_volume: Some(1.0),
            area: 6.0,
            components: 2,
            neighbours: None,
        };
        (1..).zip(volumes).map(record).collect()
    }

    #[test]
    fn a_frame_that_pops_is_reported_and_steady_change_is_not() {
        let steady: Vec<f64> = (0..20).map(|i| 1.0 + 0.02 * f64::from(i)).collect();
        assert_eq!(jumps(&series(&steady)), []);
        let mut popping = steady.clone();
        popping[9] += 0.2;
        let found = jumps(&series(&popping));
        assert_eq!(found.iter().map(|jump| jump.frame.0).collect::<Vec<_>>(), [10, 11]);
        assert!(found.iter().all(|jump| jump.what == "volume" && (jump.usual - 0.02).abs() < 1e-9));
        assert!(
            found[0]
                .to_string()
                .contains("frame 0010 of liquid: volume goes from 1.16 to 1.38, by 0.22 where 0.02 is usual")
        );

        // Small ones, those of a short sequence, and those of another stream are none.
        assert_eq!(jumps(&series(&[1.0, 1.0, 1.0, 1.009, 1.0, 1.0])), []);
        assert_eq!(jumps(&series(&[1.0, 2.0])), []);
        let mut two = series(&[1.0; 6]);
        two.extend(series(&[9.0; 6]).into_iter().map(|record| MeshRecord { name: "other".into(), ..record }));
        assert_eq!(jumps(&two), []);
    }

    #[test]
    fn components_that_come_for_one_frame_are_reported() {
        let mut records = series(&[1.0; 12]);
        records[6].components = 40;
        let found = jumps(&records);
        assert_eq!(
            found.iter().map(|jump| (jump.what, jump.frame.0)).collect::<Vec<_>>(),
            [("components", 7), ("components", 8)]
        );
        // A gap does not make one: 8 components over 8 frames.
        records = series(&[1.0; 6]);
        records[5] = MeshRecord { frame: FrameIndex(13), components: 8, ..records[5].clone() };
        assert_eq!(jumps(&records), []);
    }

    #[test]
    fn volumes_of_small_scenes_have_all_their_digits() {
        let small: Vec<f64> =
            (0..12).map(|i| if i == 6 { 2.613e-4 } else { 2.501e-4 + 1e-8 * f64::from(i) }).collect();
        let text = jumps(&series(&small))[0].to_string();
        assert!(text.contains("volume goes from 0.0002501 to 0.0002613, by 0.00001"), "{text}");
    }

    #[test]
    fn a_mesh_that_has_not_the_volume_of_its_particles_is_reported_once() {
        assert_eq!(volume_warnings(&series(&[1.0, 1.09, 0.91])), Vec::<String>::new());
        let [found] = <[String; 1]>::try_from(volume_warnings(&series(&[1.0, 1.2, 0.7, 1.0]))).unwrap();
        let expected = "volume: the mesh of liquid in frame 0003 has 0.7 m³, -30 % against its particles, and 2 of 4 meshes";
        assert!(found.starts_with(expected) && !found.contains("error"), "{found}");
        let unknown = |record: MeshRecord| MeshRecord { particle_volume: None, ..record };
        assert!(volume_warnings(&series(&[2.0]).into_iter().map(unknown).collect::<Vec<_>>()).is_empty());
    }

    #[test]
    fn the_last_line_about_a_frame_counts() {
        let dir = tempfile::tempdir().unwrap();
        let folder = ShotFolder::new(dir.path());
        assert_eq!(read(&folder).unwrap(), []);
        let records = series(&[1.0, 2.0, 3.0, 4.0]);
        std::fs::create_dir(folder.subfolder("mesh")).unwrap();
        for frame in 1..=3 {
            let path = folder.subfolder("mesh").join(format!("liquid_{frame:04}.obj"));
            MeshFormat::Obj.write(&Mesh::default(), &path, frame).unwrap();
        }
        let append = |line: &str| append_line(&path(&folder, MESH_FOLDER), line).unwrap();
        let line = |record: &MeshRecord| serde_json::to_string(record).unwrap() + "\n";
        for record in [&records[2], &records[0], &records[3], &records[1], &records[0]] {
            append(&line(record));
        }
        let newer = MeshRecord { volume: 7.0, ..records[1].clone() };
        append(&line(&newer));
        append("{\"frame\":3,\"na");
        let expected = [records[0].clone(), newer, records[2].clone()];
        assert_eq!(read(&folder).unwrap(), expected);

        // The name of a mesh in a line leads to no file elsewhere.
        let outside = dir.path().join("outside_0005.obj");
        MeshFormat::Obj.write(&Mesh::default(), &outside, 5).unwrap();
        let (frame, key) = (FrameIndex(5), format!("{:016x}", 5));
        append(&line(&MeshRecord { frame, key, name: "../outside".into(), ..records[0].clone() }));
        assert_eq!(read(&folder).unwrap(), expected);
        let figures = records[0].figures(&SurfaceStats::default());
        assert!(figures.contains_key("unseen_particles") && !figures.contains_key("frame"), "{figures:?}");
    }
}
