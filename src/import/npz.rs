//! NPZ: numpy arrays in a zip archive, stored or deflated.

use super::gather::{Gather, Values};
use super::{ImportError, Imported, MemoryBudget, npy};
use std::io::Cursor;
use std::path::Path;
use zip::{ZipArchive, result::ZipError};

/// Names under which N × 3 positions are known, in lower case. Particles of one array need no name.
const POSITIONS: [&str; 7] = ["position", "positions", "pos", "points", "p", "x", "xyz"];

/// Three arrays that make a vector: their names and the channel's.
const VECTORS: [([&str; 3], &str); 3] =
    [(["x", "y", "z"], "position"), (["vx", "vy", "vz"], "velocity"), (["nx", "ny", "nz"], "normal")];

/// An array of the archive.
struct Member {
    /// Without `.npy`.
    name: String,
    shape: Vec<usize>,
    components: usize,
    values: Values,
}

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let mut ignored = Vec::new();
    let mut members = members(path, bytes, &mut ignored, budget)?;
    let positions = take_positions(path, &mut members, budget)?;
    let mut gather = Gather::new(path, budget, &positions)?;
    let count = positions.len() / 3;
    members.retain(|member| {
        let fits = member.shape[0] == count;
        if !fits {
            let why = format!("shape {:?}, not one entry for each of {count} particles", member.shape);
            ignored.push((member.name.clone(), why));
        }
        fits
    });
    for (names, channel) in &VECTORS[1..] {
        if let Some(vectors) = take_triple(&mut members, names, count, budget)? {
            gather.add(channel, 3, Values::Float(vectors))?;
        }
    }
    for Member { name, components, values, .. } in members {
        gather.add(&name, components, values)?;
    }
    for (name, why) in ignored {
        gather.ignore(&name, why);
    }
    Ok(gather.finish())
}

/// Reads every array that can be read, in the order of the archive.
fn members(
    path: &Path,
    bytes: &[u8],
    ignored: &mut Vec<(String, String)>,
    budget: &MemoryBudget,
) -> Result<Vec<Member>, ImportError> {
    let mut archive =
        ZipArchive::new(Cursor::new(bytes)).map_err(|error| refused(path, "archive", &error))?;
    let mut members = Vec::new();
    for index in 0..archive.len() {
        let place = format!("member {index} of the archive");
        let mut file = archive.by_index(index).map_err(|error| refused(path, &place, &error))?;
        let name = file.name().map_err(|error| refused(path, &place, &error))?.into_owned();
        let Some(name) = name.strip_suffix(".npy") else {
            ignored.push((name, "not an array".into()));
            continue;
        };
        let place = format!("member {name}.npy, ");
        // What the archive states is compared before it is unpacked, and may be too little.
        budget.afford(file.size())?;
        let content = budget.unpack(&mut file, &format!("{place}content"), |length, error| {
            let place = format!("{place}after {length} bytes of content");
            ImportError::malformed(path, place, error.to_string(), "a whole array")
        })?;
        let header = npy::header(path, &place, &content)?;
        if let Some(why) = header.unread() {
            ignored.push((name.into(), why));
            continue;
        }
        let values = npy::values(path, &place, &content, &header, budget)?;
        let (_, components) = header.table().expect("the shape was found readable");
        members.push(Member { name: name.into(), shape: header.shape, components, values });
    }
    Ok(members)
}

/// Fault of an archive.
fn refused(path: &Path, place: &str, error: &ZipError) -> ImportError {
    let found = error.to_string();
    match error {
        ZipError::UnsupportedArchive(_) | ZipError::CompressionMethodNotSupported(_) => {
            ImportError::unsupported(
                path,
                format!("{place}: {found}"),
                "members stored or deflated, not encrypted",
            )
        }
        _ => ImportError::malformed(path, place, found, "a whole zip archive"),
    }
}

/// Takes the positions out of the arrays: one of N × 3 floats, or x, y and z.
fn take_positions(
    path: &Path,
    members: &mut Vec<Member>,
    budget: &MemoryBudget,
) -> Result<Vec<f32>, ImportError> {
    let is_vector = |member: &Member| matches!(member.values, Values::Float(_)) && member.components == 3;
    let named = POSITIONS.iter().find_map(|name| {
        members.iter().position(|member| is_vector(member) && member.name.eq_ignore_ascii_case(name))
    });
    let alone = || (members.len() == 1 && is_vector(&members[0])).then_some(0);
    if let Some(index) = named.or_else(alone)
        && let Values::Float(positions) = members.remove(index).values
    {
        return Ok(positions);
    }
    let count = members.iter().find(|member| member.name.eq_ignore_ascii_case("x")).map(|x| x.shape[0]);
    let positions = match count {
        Some(count) => take_triple(members, &VECTORS[0].0, count, budget)?,
        None => None,
    };
    positions.ok_or_else(|| {
        let arrays: Vec<String> =
            members.iter().map(|member| format!("{} {:?}", member.name, member.shape)).collect();
        let expected = "floats as position (N × 3), or as x, y and z (N each)";
        ImportError::malformed(path, "archive", format!("the arrays [{}]", arrays.join(", ")), expected)
    })
}

/// Takes three arrays of `count` floats as one of vectors, if all are there.
fn take_triple(
    members: &mut Vec<Member>,
    names: &[&str; 3],
    count: usize,
    budget: &MemoryBudget,
) -> Result<Option<Vec<f32>>, ImportError> {
    let floats = names.map(|name| {
        let member = members.iter().find(|member| member.name.eq_ignore_ascii_case(name))?;
        match &member.values {
            Values::Float(values) if member.components == 1 && values.len() == count => Some(values),
            _ => None,
        }
    });
    let [Some(x), Some(y), Some(z)] = floats else { return Ok(None) };
    budget.take_numbers::<f32>(3 * count)?;
    let vectors = (0..count).flat_map(|i| [x[i], y[i], z[i]]).collect();
    members.retain(|member| !names.iter().any(|name| member.name.eq_ignore_ascii_case(name)));
    Ok(Some(vectors))
}
