//! Tables of particles: lines of numbers between separators, with or without a line of names.

use super::{
    ImportError, Imported, MemoryBudget,
    gather::{Gather, Values, is_integer},
};
use std::path::Path;

/// Names of the vector whose components are the position.
const POSITION: [&str; 6] = ["", "p", "pos", "position", "points", "point"];

/// Names of vectors whose components are written without a sign between: `vx`, `nx`.
const VECTOR_PREFIXES: [&str; 4] = ["p", "v", "n", "vel"];

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(ImportError::malformed(path, "text", "bytes that are no text", "UTF-8"));
    };
    let layout = Layout::of(path, text, budget)?;
    let columns = layout.columns;
    // The lines are counted first: a list of their fields would take many times the memory of the text.
    let rows = layout.rows(text).count();
    // A number takes two bytes, but for the last.
    let numbers = rows.saturating_mul(columns).min(text.len() / 2 + 1);
    budget.take_numbers::<f64>(numbers)?;
    let mut table = Table { columns, values: Vec::with_capacity(numbers), integral: vec![true; columns] };
    for (particle, (line, text)) in layout.rows(text).enumerate() {
        let mut found = 0;
        for field in layout.separator.fields(text) {
            let place = || format!("line {line}, particle {particle}, column {}", found + 1);
            if found == columns {
                let found = format!("more than {columns} columns");
                return Err(ImportError::malformed(path, place(), found, format!("{columns}, as before")));
            }
            let Ok(value) = field.parse::<f64>() else {
                return Err(ImportError::malformed(path, place(), format!("{field:?}"), "a number"));
            };
            table.integral[found] &= field.parse::<i64>().is_ok();
            table.values.push(value);
            found += 1;
        }
        if found != columns {
            let (place, found) = (format!("line {line}, particle {particle}"), format!("{found} columns"));
            return Err(ImportError::malformed(path, place, found, format!("{columns}, as before")));
        }
    }
    gather(path, budget, &table, &layout)
}

/// What separates the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    /// One such character, with or without spaces around it.
    One(char),
    /// Spaces and tabs.
    Blank,
}

impl Separator {
    /// The separator of a file: the sign that the first line has most often outside of quotes, else blanks.
    fn of(line: &str) -> Self {
        let count = |sign| Self::One(sign).fields(line).count();
        let signs = [';', ',', '\t'].map(|sign| (sign, count(sign)));
        // The first of those with equal counts.
        let maximum = signs.into_iter().rev().filter(|&(_, count)| count > 1).max_by_key(|&(_, count)| count);
        maximum.map_or(Self::Blank, |(sign, _)| Self::One(sign))
    }

    /// The fields of a line, without quotes.
    fn fields(self, line: &str) -> impl Iterator<Item = &str> {
        let mut is_quoted = false;
        let ends = move |character: char| {
            is_quoted ^= character == '"';
            !is_quoted
                && match self {
                    Self::One(sign) => character == sign,
                    Self::Blank => character == ' ' || character == '\t',
                }
        };
        let is_field = move |field: &&str| self != Self::Blank || !field.is_empty();
        // A first name may be empty: it is that of row numbers.
        let line = if self == Self::One('\t') { line.trim_matches([' ', '\r']) } else { line.trim() };
        line.split(ends).filter(is_field).map(|field| {
            let field = field.trim();
            let inner = field.strip_prefix('"').and_then(|field| field.strip_suffix('"'));
            inner.map_or(field, str::trim)
        })
    }
}

/// The lines that are not blank, with their numbers from 1, and whether each is a comment, whose sign is left out.
fn lines(text: &str) -> impl Iterator<Item = (usize, bool, &str)> {
    text.lines().enumerate().filter_map(|(number, line)| {
        let comment = line.trim_start().strip_prefix('#');
        let line = comment.unwrap_or(line);
        (!line.trim().is_empty()).then_some((number + 1, comment.is_some(), line))
    })
}

/// How the lines of a file are read.
struct Layout<'a> {
    separator: Separator,
    columns: usize,
    /// The names of all columns, or none.
    names: Vec<&'a str>,
    /// The line of the names.
    names_at: usize,
    /// The first line that may hold a particle.
    first: usize,
}

impl<'a> Layout<'a> {
    /// The layout by the first line that is no comment, and the comment before it.
    ///
    /// # Errors
    /// If that line has fewer than three columns, or more than memory for their names.
    fn of(path: &Path, text: &'a str, budget: &MemoryBudget) -> Result<Self, ImportError> {
        let mut comment = None;
        for (number, is_comment, line) in lines(text) {
            if is_comment {
                comment = Some((number, line));
                continue;
            }
            let separator = Separator::of(line);
            let columns = separator.fields(line).count();
            if columns < 3 {
                let place = format!("line {number}");
                return Err(ImportError::malformed(
                    path,
                    place,
                    format!("{columns} columns"),
                    "at least x, y and z, separated by commas, semicolons, tabs or spaces",
                ));
            }
            budget.take_numbers::<&str>(columns)?;
            let is_number = |field: &str| field.parse::<f64>().is_ok();
            if !separator.fields(line).any(is_number) {
                let names = separator.fields(line).collect();
                return Ok(Self { separator, columns, names, names_at: number, first: number + 1 });
            }
            // The comment in front may name the columns, and be any other.
            let (names_at, line) = comment.unwrap_or_default();
            let names: Vec<&str> = Separator::of(line).fields(line).take(columns + 1).collect();
            let are_names = names.len() == columns && position_of(&names).is_some();
            let names = if are_names { names } else { Vec::new() };
            return Ok(Self { separator, columns, names, names_at, first: number });
        }
        // Nothing but comments: no particle.
        Ok(Self {
            separator: Separator::Blank,
            columns: 3,
            names: Vec::new(),
            names_at: 0,
            first: usize::MAX,
        })
    }

    /// The lines of particles with their numbers.
    fn rows<'b>(&self, text: &'b str) -> impl Iterator<Item = (usize, &'b str)> {
        let first = self.first;
        lines(text)
            .filter(move |(number, is_comment, _)| !is_comment && *number >= first)
            .map(|(number, _, line)| (number, line))
    }
}

/// The numbers of all particles.
struct Table {
    columns: usize,
    /// Particle by particle; doubles hold integers of 32 bits.
    values: Vec<f64>,
    /// Whether all numbers of a column are written as integers.
    integral: Vec<bool>,
}

impl Table {
    fn len(&self) -> usize {
        self.values.len() / self.columns
    }

    /// These columns in single precision, particle by particle.
    fn floats(&self, budget: &MemoryBudget, columns: &[usize]) -> Result<Vec<f32>, ImportError> {
        budget.take_numbers::<f32>(self.len() * columns.len())?;
        let mut values = Vec::with_capacity(self.len() * columns.len());
        for row in self.values.chunks_exact(self.columns) {
            values.extend(columns.iter().map(|&column| row[column] as f32));
        }
        Ok(values)
    }
}

/// Takes the position and the other columns by their names.
fn gather(
    path: &Path,
    budget: &MemoryBudget,
    table: &Table,
    layout: &Layout,
) -> Result<Imported, ImportError> {
    let names = &layout.names;
    if names.is_empty() {
        let mut gather = Gather::new(path, budget, &table.floats(budget, &[0, 1, 2])?)?;
        for column in 3..table.columns {
            gather.ignore(
                &format!("column {}", column + 1),
                "no line names the columns (x,y,z,vx,vy,vz,id,radius)",
            );
        }
        return Ok(gather.finish());
    }
    let vector = |first: usize| vector_at(names, first);
    let Some(position) = position_of(names) else {
        let found = format!("columns named {}", names.join(", "));
        let place = format!("line {}", layout.names_at);
        return Err(ImportError::malformed(path, place, found, "x, y and z next to each other"));
    };
    let mut gather =
        Gather::new(path, budget, &table.floats(budget, &[position, position + 1, position + 2])?)?;
    let mut column = 0;
    while column < table.columns {
        if column == position {
            column += 3;
            continue;
        }
        if let Some(name) = vector(column) {
            let name = match name.to_ascii_lowercase().as_str() {
                "v" | "vel" => "velocity".to_owned(),
                "n" => "normal".to_owned(),
                "" => "xyz".to_owned(),
                _ => name.to_owned(),
            };
            let values = table.floats(budget, &[column, column + 1, column + 2])?;
            gather.add(&name, 3, Values::Float(values))?;
            column += 3;
            continue;
        }
        let values = if table.integral[column] && is_integer(names[column]) {
            budget.take_numbers::<i64>(table.len())?;
            let numbers = table.values.iter().skip(column).step_by(table.columns);
            Values::Int(numbers.map(|&value| value as i64).collect())
        } else {
            Values::Float(table.floats(budget, &[column])?)
        };
        gather.add(names[column], 1, values)?;
        column += 1;
    }
    Ok(gather.finish())
}

/// The first column of the position.
fn position_of(names: &[&str]) -> Option<usize> {
    (0..names.len()).find(|&first| {
        vector_at(names, first)
            .is_some_and(|name| POSITION.iter().any(|known| name.eq_ignore_ascii_case(known)))
    })
}

/// The name of the vector whose components are the columns from `first` on: `v` of vx, vy, vz; `P` of P.x, P.y, P.z, `Points` of
/// Points:0, Points:1, Points:2.
fn vector_at<'a>(names: &[&'a str], first: usize) -> Option<&'a str> {
    let parts = names.get(first..first + 3)?;
    for signs in [['x', 'y', 'z'], ['0', '1', '2']] {
        let mut bases = parts.iter().zip(signs).map(|(name, sign)| component_of(name, sign));
        if let (Some(Some(a)), Some(Some(b)), Some(Some(c))) = (bases.next(), bases.next(), bases.next())
            && a == b
            && b == c
        {
            return Some(a);
        }
    }
    None
}

/// The name of the vector that a column is a component of.
fn component_of(name: &str, sign: char) -> Option<&str> {
    let inner = name.strip_suffix(']').unwrap_or(name);
    let base = inner.strip_suffix([sign, sign.to_ascii_uppercase()])?;
    if inner.len() < name.len() {
        return base.strip_suffix('[');
    }
    if let Some(base) = base.strip_suffix(['.', '_', ':']) {
        return Some(base);
    }
    let is_short = base.is_empty() || VECTOR_PREFIXES.iter().any(|known| base.eq_ignore_ascii_case(known));
    (is_short && sign.is_alphabetic()).then_some(base)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Imported, ImportError> {
        let path = Path::new("a.csv");
        read(path, text.as_bytes(), &MemoryBudget::new(path, text.len() as u64, None)?)
    }

    fn names(imported: &Imported) -> Vec<&str> {
        imported.stream.channels().iter().map(|channel| channel.name.as_str()).collect()
    }

    #[test]
    fn every_separator_gives_the_same_particles() {
        let expected =
            table("x,y,z,vx,vy,vz,id,radius\n1,2,3,4,5,6,7,0.5\n-1,0,1e-3,0,0,0,8,0.25\n").unwrap();
        assert_eq!(names(&expected), ["position", "velocity", "id", "radius"]);
        let positions = expected.stream.vec3("position").unwrap();
        assert_eq!(positions.iter().flatten().copied().collect::<Vec<_>>(), [1., 2., 3., -1., 0., 1e-3]);
        assert_eq!(expected.stream.u32("id"), Some(&[7, 8][..]));
        for text in [
            "\u{feff}x;y;z;vx;vy;vz;id;radius\r\n1;2;3;4;5;6;7;0.5\r\n-1;0;1e-3;0;0;0;8;0.25",
            "# frame 7\n\nX\tY\tZ\tvx\tvy\tvz\tid\tradius\n1\t2\t3\t4\t5\t6\t7\t0.5\n# between\n-1\t0\t1e-3\t0\t0\t0\t8\t0.25\n",
            "# x y z vx vy vz id radius\n  1 2   3 4 5 6 7 0.5\n-1 0 1e-3 0 0 0 8 .25\n",
            "\"id\", \"Points:0\", \"Points:1\", \"Points:2\", \"velocity:0\", \"velocity:1\", \"velocity:2\", \"radius\"\n\
             7, \"1\", 2, 3, 4, 5, 6, 0.5\n8, -1, 0, 1e-3, 0, 0, 0, 0.25\n",
            "P.x,P.y,P.z,v[x],v[y],v[z],id,radius\n1,2,3,4,5,6,7,0.5\n-1,0,1e-3,0,0,0,8,0.25\n",
            "\tx\ty\tz\tvx\tvy\tvz\tid\tradius\n0\t1\t2\t3\t4\t5\t6\t7\t0.5\n1\t-1\t0\t1e-3\t0\t0\t0\t8\t0.25\n",
            "x\ty\tz\tvx\tvy\tvz\tid\tradius\t\"v (m, s)\"\n1\t2\t3\t4\t5\t6\t7\t0.5\t0\n-1\t0\t1e-3\t0\t0\t0\t8\t0.25\t0\n",
            "radius,id,vel_x,vel_y,vel_z,px,py,pz\n0.5,7,4,5,6,1,2,3\n0.25,8,0,0,0,-1,0,1e-3\n",
        ] {
            let found = table(text).unwrap();
            for channel in expected.stream.channels() {
                assert_eq!(found.stream.channel(&channel.name), Some(&channel.data), "{text}");
            }
            assert!(found.ignored.is_empty() || text.contains("\tx"), "{text}: {:?}", found.ignored);
        }
    }

    #[test]
    fn columns_without_names_are_listed_and_no_particle_is_an_empty_stream() {
        let found = table("1 2 3 4\n5 6 7 8\n").unwrap();
        assert_eq!((names(&found), found.stream.len(), found.ignored.len()), (vec!["position"], 2, 1));
        assert!(found.ignored[0].contains("column 4"), "{:?}", found.ignored);
        for empty in ["# nothing\n", "x,y,z\n", "\n\n"] {
            assert_eq!(table(empty).unwrap().stream.len(), 0, "{empty:?}");
        }
        let found = table("x,y,z,temperature,shape\n0,0,0,-1.5,-2\n").unwrap();
        assert_eq!(names(&found), ["position", "temperature"]);
        assert!(found.ignored[0].contains("shape"), "{:?}", found.ignored);
        // Text that does not name a position is a comment, however many words it has.
        for comment in ["# exported by Houdini\n", "# exported by Houdini\n\n# \n"] {
            let found = table(&format!("{comment}1 2 3\n")).unwrap();
            assert_eq!((names(&found), found.stream.len()), (vec!["position"], 1), "{comment:?}");
        }
    }

    #[test]
    fn damaged_tables_are_refused_with_their_place() {
        for (text, words) in [
            ("x,y,z\n1,2\n", ["line 2, particle 0", "2 columns"]),
            ("x,y,z\n1,2,3\n1,2,3,4\n", ["line 3, particle 1, column 4", "more than 3"]),
            ("x,y,z\n1,2,\n", ["line 2, particle 0, column 3", "a number"]),
            ("x,y,z\n1,2,three\n", ["column 3", "three"]),
            ("x;y;z\n1,5;2;3\n", ["column 1", "1,5"]),
            ("1 2\n", ["line 1", "at least x, y and z"]),
            ("a,b,c,d\n1,2,3,4\n", ["line 1", "x, y and z"]),
            ("x,y,radius,z\n1,2,3,4\n", ["columns named x, y, radius, z", "next to each other"]),
            ("x,y,z\n1,2,nan\n", ["particle 0", "finite"]),
            ("x,y,z\n\"1,2,3\n", ["line 2", "1,2,3"]),
        ] {
            let why = table(text).unwrap_err().to_string();
            assert!(words.iter().all(|word| why.contains(word)), "{text:?}: {why}");
        }
        let path = Path::new("a.csv");
        let budget = MemoryBudget::new(path, 4, None).unwrap();
        assert!(read(path, b"\xff\xfe1\0", &budget).unwrap_err().to_string().contains("UTF-8"));
    }

    #[test]
    fn memory_is_counted_before_it_is_taken() {
        let path = Path::new("a.csv");
        let text = "1,2,3\n".repeat(1000);
        let budget = MemoryBudget::new(path, text.len() as u64, Some(text.len() as u64 + 1000)).unwrap();
        let refused = read(path, text.as_bytes(), &budget);
        assert!(matches!(refused, Err(ImportError::OverMemory { .. })), "{refused:?}");
    }
}
