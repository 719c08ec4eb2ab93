//! Resolution of the names in couplings to systems.

use super::{Coupling, CouplingError, Drag};
use crate::sim::{liquid, smoke};

/// The systems of a shot that can be coupled.
#[derive(Clone, Debug, Default)]
pub struct PresentSystems<'a> {
    /// Whether there is a liquid.
    pub liquid: bool,
    /// Whether there is smoke.
    pub smoke: bool,
    /// The names of the sheets, by number.
    pub sheets: Vec<&'a str>,
}

/// Couplings by system, in an order that does not depend on the preset's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResolvedCouplings {
    /// Index of each sheet that is coupled with the liquid, ascending, and the coefficient of friction.
    pub liquid: Vec<(usize, Option<f32>)>,
    /// Index of each sheet that is coupled with the smoke, ascending, and the drag.
    pub smoke: Vec<(usize, Drag)>,
}

/// One side of a coupling.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Participant {
    Liquid,
    Smoke,
    Sheet(usize),
}

/// Finds the systems that couplings name.
///
/// # Errors
/// The first invalid coupling.
pub fn resolve(
    couplings: &[Coupling],
    present: &PresentSystems<'_>,
) -> Result<ResolvedCouplings, CouplingError> {
    let mut resolved = ResolvedCouplings::default();
    let mut seen: Vec<(Participant, usize)> = Vec::new();
    for (index, coupling) in couplings.iter().enumerate() {
        let key = |name: &str| format!("coupling.{index}.{name}");
        let names = coupling.between.clone();
        let mut participants = [Participant::Liquid; 2];
        for (participant, name) in participants.iter_mut().zip(&names) {
            *participant = present.participant(name).ok_or_else(|| CouplingError::UnknownName {
                key: key("between"),
                name: name.clone(),
                known: present.names(),
            })?;
        }
        let (system, sheet) = match participants {
            [Participant::Sheet(_), Participant::Sheet(_)] => {
                return Err(CouplingError::UnsupportedPair { key: key("between"), names });
            }
            [system, Participant::Sheet(sheet)] | [Participant::Sheet(sheet), system] => (system, sheet),
            _ => return Err(CouplingError::UnsupportedPair { key: key("between"), names }),
        };
        if let Some(before) = seen.iter().position(|&other| other == (system, sheet)) {
            return Err(CouplingError::Duplicate { key: key("between"), names, before });
        }
        seen.push((system, sheet));
        let inapplicable = |name: &str| CouplingError::Inapplicable { key: key(name), names: names.clone() };
        if system == Participant::Liquid {
            if coupling.drag.is_some() {
                return Err(inapplicable("drag"));
            }
            coupling.friction.map_or(Ok(()), |value| number(value, 0.0, key("friction")))?;
            resolved.liquid.push((sheet, coupling.friction));
        } else {
            if coupling.friction.is_some() {
                return Err(inapplicable("friction"));
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

fn number(value: f32, min: f32, key: String) -> Result<(), CouplingError> {
    if value.is_finite() && value >= min {
        return Ok(());
    }
    let expected = if min > 0.0 { "a finite number above zero" } else { "a finite number, zero or above" };
    Err(CouplingError::OutOfRange { key, value, expected })
}

impl PresentSystems<'_> {
    /// The participant of this name; a system comes before a sheet of the same name.
    fn participant(&self, name: &str) -> Option<Participant> {
        match name {
            liquid::NAME => self.liquid.then_some(Participant::Liquid),
            smoke::NAME => self.smoke.then_some(Participant::Smoke),
            _ => self.sheets.iter().position(|sheet| *sheet == name).map(Participant::Sheet),
        }
    }

    /// The names of all participants, as a sentence.
    fn names(&self) -> String {
        let systems = [(self.liquid, liquid::NAME), (self.smoke, smoke::NAME)];
        let systems = systems.iter().filter(|(is_present, _)| *is_present).map(|(_, name)| *name);
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
    fn the_order_of_names_and_couplings_does_not_matter() {
        let present = PresentSystems { liquid: true, smoke: true, sheets: vec!["a", "b", "c"] };
        let with_friction = Coupling { friction: Some(0.2), ..coupling("c", "liquid") };
        let first =
            resolve(&[coupling("liquid", "a"), with_friction.clone(), coupling("smoke", "b")], &present)
                .unwrap();
        let other =
            resolve(&[coupling("b", "smoke"), with_friction, coupling("a", "liquid")], &present).unwrap();
        assert_eq!(first, other);
        assert_eq!(first.liquid, [(0, None), (2, Some(0.2))]);
        assert_eq!(first.smoke, [(1, Drag::default())]);
    }

    #[test]
    fn invalid_couplings_are_refused() {
        let present = PresentSystems { liquid: true, smoke: false, sheets: vec!["a", "b"] };
        let refused = |list: &[Coupling]| resolve(list, &present).unwrap_err();
        let name = refused(&[coupling("liquid", "cloth")]);
        assert!(name.to_string().contains("'liquid', 'a', 'b'"), "{name}");
        assert!(matches!(refused(&[coupling("smoke", "a")]), CouplingError::UnknownName { .. }));
        for (a, b) in [("a", "b"), ("liquid", "liquid"), ("a", "a")] {
            assert!(matches!(refused(&[coupling(a, b)]), CouplingError::UnsupportedPair { .. }), "{a} {b}");
        }
        let duplicate = refused(&[coupling("liquid", "b"), coupling("liquid", "a"), coupling("a", "liquid")]);
        assert!(matches!(duplicate, CouplingError::Duplicate { before: 1, .. }), "{duplicate}");
        let with_drag = Coupling { drag: Some(Drag::default()), ..coupling("liquid", "a") };
        assert_eq!(refused(&[with_drag]).key(), "coupling.0.drag");
        let with_friction = Coupling { friction: Some(-0.1), ..coupling("liquid", "a") };
        assert_eq!(refused(&[coupling("liquid", "b"), with_friction]).key(), "coupling.1.friction");
    }
}
