//! From a file's attributes to a stream: names, types, what is taken and what is not.

use super::error::excerpt;
use super::{ImportError, Imported, MemoryBudget};
use crate::frame::{ChannelData, Stream, StreamKind};
use crate::math::Vec3;
use std::path::Path;

/// An attribute's numbers, component by component within a particle.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    /// Floats; doubles are rounded to single precision.
    Float(Vec<f32>),
    /// Integers; those beyond 64 bits with a sign are the largest of these.
    Int(Vec<i64>),
}

impl Values {
    /// Counts the memory of `count` values of floats or integers.
    pub(super) fn take(budget: &MemoryBudget, is_float: bool, count: usize) -> Result<(), ImportError> {
        if is_float { budget.take_numbers::<f32>(count) } else { budget.take_numbers::<i64>(count) }
    }
}

/// Whether a column of text holds integers if all of its numbers are written as such. Others would be integers in one frame and
/// not in the next: the age of particles that were just born is 0.
pub(super) fn is_integer(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ["id", "index", "type", "source", "shape", "material", "group"].iter().any(|known| name.ends_with(known))
}

/// Attributes that are taken from a file at most, far above the dozens that solvers write. Names are compared with each other,
/// so that time would grow with the square of their number.
const MAX_ATTRIBUTES: usize = 4096;

/// Attributes that are not taken and listed one by one; the others are counted.
const MAX_LISTED: usize = 256;

/// Collects the attributes of a file whose positions are known.
pub(super) struct Gather<'a> {
    path: &'a Path,
    budget: &'a MemoryBudget<'a>,
    stream: Stream,
    ignored: Vec<String>,
    /// Attributes that are neither taken nor listed.
    unlisted: usize,
}

impl<'a> Gather<'a> {
    /// Starts with the positions, x y z of each particle in turn.
    pub(super) fn new(
        path: &'a Path,
        budget: &'a MemoryBudget,
        positions: &[f32],
    ) -> Result<Self, ImportError> {
        budget.take_numbers::<f32>(positions.len())?;
        let positions = vectors(positions);
        let mut gather = Self {
            path,
            budget,
            stream: Stream::new("particles", StreamKind::Particles, positions.len()),
            ignored: Vec::new(),
            unlisted: 0,
        };
        gather.require_finite("position", &positions)?;
        gather.push("position", positions.into());
        Ok(gather)
    }

    /// Takes an attribute of `components` numbers a particle, or lists why it is not taken.
    pub(super) fn add(&mut self, name: &str, components: usize, values: Values) -> Result<(), ImportError> {
        if self.stream.channels().len() >= MAX_ATTRIBUTES {
            let found = format!("more than {MAX_ATTRIBUTES} attributes");
            return Err(ImportError::unsupported(
                self.path,
                found,
                "no more; leave out those that no one reads",
            ));
        }
        let channel = channel_name(name);
        if self.stream.channel(channel).is_some() {
            self.ignore(name, format!("{channel} is there already"));
            return Ok(());
        }
        match (values, components) {
            (Values::Float(values), 1) => match values.iter().position(|value| !value.is_finite()) {
                None => self.push(channel, values.into()),
                Some(particle) => {
                    self.ignore(name, format!("particle {particle} holds {}", values[particle]))
                }
            },
            (Values::Float(values), 3) => {
                self.budget.take_numbers::<f32>(values.len())?;
                let values = vectors(&values);
                if channel == "velocity" {
                    self.require_finite("velocity", &values)?;
                }
                match not_finite(&values) {
                    None => self.push(channel, values.into()),
                    Some(particle) => {
                        self.ignore(name, format!("particle {particle} holds {}", text(values[particle])));
                    }
                }
            }
            (Values::Int(values), 1) => {
                match values.iter().position(|&value| u32::try_from(value).is_err()) {
                    None => {
                        self.budget.take_numbers::<u32>(values.len())?;
                        let values: Vec<u32> =
                            values.into_iter().filter_map(|value| value.try_into().ok()).collect();
                        self.push(channel, values.into());
                    }
                    Some(particle) => {
                        let value = values[particle];
                        self.ignore(
                            name,
                            format!("{value} of particle {particle} is not from 0 to 4294967295"),
                        );
                    }
                }
            }
            (Values::Float(_), _) => {
                self.ignore(name, format!("{components} components, only 1 or 3 floats are taken"));
            }
            (Values::Int(_), _) => self.ignore(name, format!("{components} integers, only 1 is taken")),
        }
        Ok(())
    }

    /// Lists an attribute that is not taken.
    pub(super) fn ignore(&mut self, name: &str, why: impl std::fmt::Display) {
        if self.ignored.len() < MAX_LISTED {
            self.ignored.push(excerpt(format!("{name}: {why}")));
        } else {
            self.unlisted += 1;
        }
    }

    /// What was gathered.
    pub(super) fn finish(mut self) -> Imported {
        if self.unlisted > 0 {
            self.ignored.push(format!("{} more attributes are not taken either", self.unlisted));
        }
        Imported { stream: self.stream, ignored: self.ignored }
    }

    fn push(&mut self, name: &str, data: ChannelData) {
        let stream = std::mem::replace(&mut self.stream, Stream::new("", StreamKind::Unknown, 0));
        self.stream = stream.with(name, data);
    }

    fn require_finite(&self, channel: &'static str, values: &[Vec3]) -> Result<(), ImportError> {
        match not_finite(values) {
            None => Ok(()),
            Some(particle) => {
                let (path, found) = (self.path.to_path_buf(), text(values[particle]));
                Err(ImportError::NotFinite { path, channel, particle, found })
            }
        }
    }
}

/// The name under which an attribute is kept.
fn channel_name(name: &str) -> &str {
    match name.to_ascii_lowercase().as_str() {
        "velocity" | "velocities" | "vel" | "v" => "velocity",
        "id" | "ids" | "particle_id" => "id",
        "density" => "density",
        _ => name,
    }
}

fn vectors(values: &[f32]) -> Vec<Vec3> {
    values.chunks_exact(3).map(|value| Vec3::new(value[0], value[1], value[2])).collect()
}

fn not_finite(values: &[Vec3]) -> Option<usize> {
    values.iter().position(|value| !value.iter().all(|component| component.is_finite()))
}

fn text(value: Vec3) -> String {
    format!("({}, {}, {})", value.x, value.y, value.z)
}
