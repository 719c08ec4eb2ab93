//! Legacy VTK: unstructured grids and poly data, ASCII or big-endian binary.
//!
//! Only points and their attributes are taken; cells are read past, in both layouts (one list up to version 4,
//! `OFFSETS` and `CONNECTIVITY` from 5).

mod scan;

use super::gather::{Gather, Values};
use super::numbers::Kind;
use super::{ImportError, Imported, MemoryBudget};
use scan::{BYTE, FLOAT, INT, Scan};
use std::path::Path;

/// To what the attributes that follow belong.
#[derive(Clone, Copy, PartialEq)]
enum Owner {
    Dataset,
    Points,
    Cells,
}

/// What was read so far.
struct Reader<'a> {
    scan: Scan<'a>,
    points: Option<Vec<f32>>,
    /// Name, components, values of the points' attributes.
    attributes: Vec<(String, usize, Values)>,
    ignored: Vec<(String, &'static str)>,
    owner: Owner,
    /// Entries of an attribute of the current owner.
    count: usize,
}

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let mut scan = Scan::new(path, bytes, budget);
    scan.line();
    scan.line();
    let format = scan.line().trim().to_ascii_uppercase();
    scan.binary = match format.as_str() {
        "BINARY" => true,
        "ASCII" => false,
        _ => return Err(scan.malformed(format!("{format:?} in line 3"), "ASCII or BINARY")),
    };
    let mut reader = Reader {
        scan,
        points: None,
        attributes: Vec::new(),
        ignored: Vec::new(),
        owner: Owner::Dataset,
        count: 0,
    };
    while let Some(line) = reader.scan.keyword() {
        reader.section(&line)?;
    }
    let Some(points) = reader.points else {
        return Err(reader.scan.malformed("the end of the file", "a line POINTS"));
    };
    let mut gather = Gather::new(path, budget, &points)?;
    for (name, components, values) in reader.attributes {
        gather.add(&name, components, values)?;
    }
    for (name, why) in reader.ignored {
        gather.ignore(&name, why);
    }
    Ok(gather.finish())
}

impl Reader<'_> {
    /// Reads the section that starts with a line of these words.
    fn section(&mut self, words: &[String]) -> Result<(), ImportError> {
        let keyword = words[0].to_ascii_uppercase();
        match keyword.as_str() {
            "DATASET" => self.dataset(words),
            "POINTS" => self.read_points(words),
            "CELLS" | "VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" => self.cells(words),
            "CELL_TYPES" => {
                let count = self.scan.number(words, 1, "the number of cells")?;
                self.scan.skip(INT, count)
            }
            "POINT_DATA" | "CELL_DATA" => self.owned_by(words),
            "METADATA" => {
                while !self.scan.line().trim().is_empty() {}
                Ok(())
            }
            "FIELD" => self.field(words),
            "LOOKUP_TABLE" => {
                let count = self.scan.number(words, 2, "the size of the table")?;
                let kind = if self.scan.binary { BYTE } else { FLOAT };
                self.scan.skip(kind, count.saturating_mul(4))
            }
            _ => self.attribute(&keyword, words),
        }
    }

    fn dataset(&self, words: &[String]) -> Result<(), ImportError> {
        match words.get(1).map(|kind| kind.to_ascii_uppercase()).as_deref() {
            Some("UNSTRUCTURED_GRID" | "POLYDATA") => Ok(()),
            other => {
                let found = format!("DATASET {}", other.unwrap_or("without a kind"));
                Err(ImportError::unsupported(self.scan.path, found, "UNSTRUCTURED_GRID or POLYDATA"))
            }
        }
    }

    fn read_points(&mut self, words: &[String]) -> Result<(), ImportError> {
        let count = self.scan.number(words, 1, "the number of points")?;
        let kind = self.scan.kind(words, 2)?;
        match self.scan.values(kind, count.saturating_mul(3))? {
            Values::Float(points) if self.points.is_none() => self.points = Some(points),
            Values::Float(_) => return Err(self.scan.malformed("a second POINTS", "the points once")),
            Values::Int(_) => {
                return Err(ImportError::unsupported(self.scan.path, "integer points", "float or double"));
            }
        }
        Ok(())
    }

    /// Reads past the cells.
    fn cells(&mut self, words: &[String]) -> Result<(), ImportError> {
        let first = self.scan.number(words, 1, "the number of cells")?;
        let second = self.scan.number(words, 2, "the size of the cells")?;
        if !self.scan.starts_with("OFFSETS") {
            return self.scan.skip(INT, second);
        }
        for (name, count) in [("OFFSETS", first), ("CONNECTIVITY", second)] {
            let words = self.scan.keyword().unwrap_or_default();
            if words.first().map(String::as_str) != Some(name) {
                return Err(self.scan.malformed(format!("{words:?}"), name));
            }
            let kind = self.scan.kind(&words, 1)?;
            self.scan.skip(kind, count)?;
        }
        Ok(())
    }

    fn owned_by(&mut self, words: &[String]) -> Result<(), ImportError> {
        self.count = self.scan.number(words, 1, "the number of entries")?;
        self.owner = Owner::Cells;
        if words[0].eq_ignore_ascii_case("POINT_DATA") {
            self.owner = Owner::Points;
            let Some(points) = &self.points else {
                return Err(self.scan.malformed(words.join(" "), "POINTS before POINT_DATA"));
            };
            let points = points.len() / 3;
            if self.count != points {
                return Err(self.scan.malformed(words.join(" "), format!("attributes of {points} points")));
            }
        }
        Ok(())
    }

    /// Reads the arrays of a field.
    fn field(&mut self, words: &[String]) -> Result<(), ImportError> {
        let arrays = self.scan.number(words, 2, "the number of arrays")?;
        let mut array = 0;
        while array < arrays {
            let Some(words) = self.scan.keyword() else {
                return Err(self.scan.malformed("the end of the file", format!("array {array} of {arrays}")));
            };
            if words[0] == "METADATA" {
                self.section(&words)?;
                continue;
            }
            let components = self.scan.number(&words, 1, "the components of an array")?;
            let entries = self.scan.number(&words, 2, "the entries of an array")?;
            let kind = self.scan.kind(&words, 3)?;
            if self.owner == Owner::Points && entries != self.count {
                let expected = format!("{} entries, one a point", self.count);
                return Err(self
                    .scan
                    .malformed(format!("{entries} entries in array {}", words[0]), expected));
            }
            self.take(&words[0], kind, components, entries)?;
            array += 1;
        }
        Ok(())
    }

    /// Reads an attribute that is not in a field.
    fn attribute(&mut self, keyword: &str, words: &[String]) -> Result<(), ImportError> {
        if self.owner == Owner::Dataset {
            return Err(self.scan.malformed(format!("{keyword:?}"), "a section of the dataset"));
        }
        let name = words.get(1).cloned().unwrap_or_default();
        let (kind, components) = match keyword {
            "SCALARS" => {
                let kind = self.scan.kind(words, 2)?;
                let components = if words.len() > 3 { self.scan.number(words, 3, "components")? } else { 1 };
                if self.scan.starts_with("LOOKUP_TABLE") {
                    self.scan.line();
                }
                (kind, components)
            }
            "VECTORS" | "NORMALS" => (self.scan.kind(words, 2)?, 3),
            "TENSORS" => (self.scan.kind(words, 2)?, 9),
            "TENSORS6" => (self.scan.kind(words, 2)?, 6),
            "GLOBAL_IDS" | "PEDIGREE_IDS" => (self.scan.kind(words, 2)?, 1),
            "TEXTURE_COORDINATES" => (self.scan.kind(words, 3)?, self.scan.number(words, 2, "dimensions")?),
            "COLOR_SCALARS" => {
                let kind = if self.scan.binary { BYTE } else { FLOAT };
                (kind, self.scan.number(words, 2, "components")?)
            }
            _ => return Err(self.scan.malformed(format!("{keyword:?}"), "a section of legacy VTK")),
        };
        self.take(&name, kind, components, self.count)
    }

    /// Reads an array and keeps it if it belongs to the points.
    fn take(&mut self, name: &str, kind: Kind, components: usize, entries: usize) -> Result<(), ImportError> {
        let (name, count) = (decoded(name), components.saturating_mul(entries));
        let why = match self.owner {
            Owner::Points => {
                let values = self.scan.values(kind, count)?;
                self.attributes.push((name, components, values));
                return Ok(());
            }
            Owner::Cells => "of the cells, not of the points",
            Owner::Dataset => "of the whole dataset, not of the points",
        };
        self.ignored.push((name, why));
        self.scan.skip(kind, count)
    }
}

/// A name without the `%20` that stand for characters which would end it.
fn decoded(name: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = name.as_bytes();
    while let [byte, tail @ ..] = rest {
        let code = tail.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(code) if *byte == b'%' => {
                bytes.push(code);
                rest = &tail[2..];
            }
            _ => {
                bytes.push(*byte);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
