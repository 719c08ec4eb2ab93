//! Which systems couplings mean.

use super::{Coupling, Drag};
use crate::sim::{liquid, smoke};

/// What can be coupled in a shot.
#[derive(Clone, Debug, Default)]
pub struct There<'a> {
    /// Whether there is a liquid.
    pub liquid: bool,
    /// Whether there is smoke.
    pub smoke: bool,
    /// The names of the sheets, by number.
    pub sheets: Vec<&'a str>,
}

/// Couplings, in one order whatever the preset's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolved {
    /// The sheets that are coupled with the liquid, ascending by number, and its friction on them.
    pub liquid: Vec<(usize, Option<f32>)>,
    /// The sheets that are coupled with the smoke, ascending by number, and its drag.
    pub smoke: Vec<(usize, Drag)>,
}

/// Why a coupling has no meaning.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CouplingError {
    /// A name is that of no system and no sheet.
    #[error("`{key}`: there is no system or sheet '{name}'; {known}")]
    Name {
        /// The key.
        key: String,
        /// The name.
        name: String,
        /// What there is, as a sentence.
        known: String,
    },
    /// Two that cannot be coupled.
    #[error("`{key}`: '{}' and '{}' cannot be coupled; a liquid and a sheet can, and smoke and a sheet", .names[0], .names[1])]
    Pair {
        /// The key.
        key: String,
        /// The two.
        names: [String; 2],
    },
    /// Two that are coupled already.
    #[error("`{key}`: '{}' and '{}' are coupled by `coupling.{before}` already", .names[0], .names[1])]
    Twice {
        /// The key.
        key: String,
        /// The two.
        names: [String; 2],
        /// The number of the coupling before.
        before: usize,
    },
    /// A parameter of another kind of coupling.
    #[error("`{key}` has no meaning between '{}' and '{}'", .names[0], .names[1])]
    Foreign {
        /// The key.
        key: String,
        /// The two.
        names: [String; 2],
    },
    /// A number out of its range.
    #[error("`{key}` is {value}, expected {expected}")]
    OutOfRange {
        /// The key.
        key: String,
        /// What was found.
        value: f32,
        /// What was expected.
        expected: &'static str,
    },
}

impl CouplingError {
    /// The key at fault.
    pub fn key(&self) -> &str {
        match self {
            Self::Name { key, .. }
            | Self::Pair { key, .. }
            | Self::Twice { key, .. }
            | Self::Foreign { key, .. }
            | Self::OutOfRange { key, .. } => key,
        }
    }
}

/// One side of a coupling.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    Liquid,
    Smoke,
    Sheet(usize),
}

/// Finds the systems that couplings name.
///
/// # Errors
/// The first that has no meaning.
pub fn resolve(couplings: &[Coupling], there: &There<'_>) -> Result<Resolved, CouplingError> {
    let mut resolved = Resolved::default();
    let mut seen: Vec<(Side, usize)> = Vec::new();
    for (index, coupling) in couplings.iter().enumerate() {
        let key = |name: &str| format!("coupling.{index}.{name}");
        let names = coupling.between.clone();
        let mut sides = [Side::Liquid; 2];
        for (side, name) in sides.iter_mut().zip(&names) {
            *side = there.side(name).ok_or_else(|| CouplingError::Name {
                key: key("between"),
                name: name.clone(),
                known: there.names(),
            })?;
        }
        let (system, sheet) = match sides {
            [Side::Sheet(_), Side::Sheet(_)] => {
                return Err(CouplingError::Pair { key: key("between"), names });
            }
            [system, Side::Sheet(sheet)] | [Side::Sheet(sheet), system] => (system, sheet),
            _ => return Err(CouplingError::Pair { key: key("between"), names }),
        };
        if let Some(before) = seen.iter().position(|&other| other == (system, sheet)) {
            return Err(CouplingError::Twice { key: key("between"), names, before });
        }
        seen.push((system, sheet));
        let foreign = |name: &str| CouplingError::Foreign { key: key(name), names: names.clone() };
        if system == Side::Liquid {
            if coupling.drag.is_some() {
                return Err(foreign("drag"));
            }
            coupling.friction.map_or(Ok(()), |value| number(value, 0.0, key("friction")))?;
            resolved.liquid.push((sheet, coupling.friction));
        } else {
            if coupling.friction.is_some() {
                return Err(foreign("friction"));
            }
            let drag = coupling.drag.unwrap_or_default();
            number(drag.density, f32::MIN_POSITIVE, key("drag.density"))?;
            number(drag.across, 0.0, key("drag.across"))?;
            number(drag.along, 0.0, key("drag.along"))?;
            resolved.smoke.push((sheet, drag));
        }
    }
    resolved.liquid.sort_by_key(|(sheet, _)| *sheet);
    resolved.smoke.sort_by_key(|(sheet, _)| *sheet);
    Ok(resolved)
}

fn number(value: f32, least: f32, key: String) -> Result<(), CouplingError> {
    if value.is_finite() && value >= least {
        return Ok(());
    }
    let expected = if least > 0.0 { "a finite number above zero" } else { "a finite number, zero or above" };
    Err(CouplingError::OutOfRange { key, value, expected })
}

impl There<'_> {
    /// A sheet that is called like a system is not meant by its name.
    fn side(&self, name: &str) -> Option<Side> {
        match name {
            liquid::NAME => self.liquid.then_some(Side::Liquid),
            smoke::NAME => self.smoke.then_some(Side::Smoke),
            _ => self.sheets.iter().position(|sheet| *sheet == name).map(Side::Sheet),
        }
    }

    fn names(&self) -> String {
        let systems = [(self.liquid, liquid::NAME), (self.smoke, smoke::NAME)];
        let systems = systems.iter().filter(|(is_there, _)| *is_there).map(|(_, name)| *name);
        let all: Vec<String> =
            systems.chain(self.sheets.iter().copied()).map(|name| format!("'{name}'")).collect();
        if all.is_empty() { "there is none".to_owned() } else { format!("there is {}", all.join(", ")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coupling(a: &str, b: &str) -> Coupling {
        Coupling { between: [a.into(), b.into()], friction: None, drag: None }
    }

    #[test]
    fn neither_order_matters() {
        let there = There { liquid: true, smoke: true, sheets: vec!["a", "b", "c"] };
        let rubs = Coupling { friction: Some(0.2), ..coupling("c", "liquid") };
        let first =
            resolve(&[coupling("liquid", "a"), rubs.clone(), coupling("smoke", "b")], &there).unwrap();
        let other = resolve(&[coupling("b", "smoke"), rubs, coupling("a", "liquid")], &there).unwrap();
        assert_eq!(first, other);
        assert_eq!(first.liquid, [(0, None), (2, Some(0.2))]);
        assert_eq!(first.smoke, [(1, Drag::default())]);
    }

    #[test]
    fn what_has_no_meaning_is_refused() {
        let there = There { liquid: true, smoke: false, sheets: vec!["a", "b"] };
        let refused = |list: &[Coupling]| resolve(list, &there).unwrap_err();
        let name = refused(&[coupling("liquid", "cloth")]);
        assert!(name.to_string().contains("'liquid', 'a', 'b'"), "{name}");
        assert!(matches!(refused(&[coupling("smoke", "a")]), CouplingError::Name { .. }));
        for (a, b) in [("a", "b"), ("liquid", "liquid"), ("a", "a")] {
            assert!(matches!(refused(&[coupling(a, b)]), CouplingError::Pair { .. }), "{a} {b}");
        }
        let twice = refused(&[coupling("liquid", "b"), coupling("liquid", "a"), coupling("a", "liquid")]);
        assert!(matches!(twice, CouplingError::Twice { before: 1, .. }), "{twice}");
        let drags = Coupling { drag: Some(Drag::default()), ..coupling("liquid", "a") };
        assert_eq!(refused(&[drags]).key(), "coupling.0.drag");
        let rubs = Coupling { friction: Some(-0.1), ..coupling("liquid", "a") };
        assert_eq!(refused(&[coupling("liquid", "b"), rubs]).key(), "coupling.1.friction");
    }
}
