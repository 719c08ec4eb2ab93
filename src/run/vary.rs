//! Keys of a preset with several values each, and their combinations.

use std::str::FromStr;

/// Keys of the preset that vary together, and the values to try, as the command line writes them:
/// `liquid.cfl=0.2,0.4`, or `liquid.cfl+liquid.min_substeps=0.2+16,0.4+8`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Vary {
    /// The dotted keys, at least one.
    pub keys: Vec<String>,
    /// At least one list of values, each with a value a key.
    pub values: Vec<Vec<String>>,
}

impl FromStr for Vary {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected KEY=VALUE,VALUE,…, such as liquid.cfl=0.2,0.4,0.8";
        let (keys, values) = text.split_once('=').ok_or(expected)?;
        let parts =
            |text: &str, mark| split_outside(text, mark).iter().map(|part| part.trim().into()).collect();
        let keys: Vec<String> = parts(keys, '+');
        // A single key takes its values as they are: they may hold a plus.
        let together =
            |value: &str| if keys.len() == 1 { vec![value.trim().into()] } else { parts(value, '+') };
        let values: Vec<Vec<String>> = split_outside(values, ',').into_iter().map(together).collect();
        if keys.iter().chain(values.iter().flatten()).any(String::is_empty) {
            return Err(expected.into());
        }
        match values.iter().find(|value| value.len() != keys.len()) {
            None => Ok(Self { keys, values }),
            Some(value) => Err(format!(
                "found {} for {} keys; expected a value for each, joined by +, such as \
                 liquid.cfl+liquid.min_substeps=0.2+16,0.4+8",
                value.join("+"),
                keys.len()
            )),
        }
    }
}

/// The parts between marks that are outside brackets and quotes.
fn split_outside(text: &str, mark: char) -> Vec<&str> {
    let (mut depth, mut quoted) = (0_i32, false);
    let at_mark = |c: char| {
        match c {
            '[' | '{' => depth += 1,
            ']' | '}' => depth -= 1,
            '"' => quoted = !quoted,
            _ => {}
        }
        c == mark && depth == 0 && !quoted
    };
    text.split(at_mark).collect()
}

impl Vary {
    /// The arguments of `--set` that each list of values means.
    pub(super) fn assignments(&self) -> Vec<Vec<String>> {
        let assignment = |(key, value): (&String, &String)| format!("{key}={value}");
        self.values.iter().map(|values| self.keys.iter().zip(values).map(assignment).collect()).collect()
    }
}

/// Every combination of one value of each axis, the last axis varying fastest.
pub(super) fn combinations<T: Clone>(axes: &[Vec<Vec<T>>]) -> Vec<Vec<T>> {
    let mut sets: Vec<Vec<T>> = vec![Vec::new()];
    for axis in axes {
        sets = sets
            .into_iter()
            .flat_map(|set| axis.iter().map(move |changes| [&set[..], changes].concat()))
            .collect();
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_split_outside_lists_and_quotes() {
        let values = |text: &str| text.parse::<Vary>().unwrap().values;
        assert_eq!(values("liquid.source.0.velocity=[0,0,-1],[0,0,-2]"), [["[0,0,-1]"], ["[0,0,-2]"]]);
        assert_eq!(values("a=\"1, 2\",3+4"), [["\"1, 2\""], ["3+4"]]);
        let together: Vary = "liquid.cfl + liquid.min_substeps=0.2+16,0.4+8".parse().unwrap();
        assert_eq!(together.keys, ["liquid.cfl", "liquid.min_substeps"]);
        assert_eq!(together.values, [["0.2", "16"], ["0.4", "8"]]);
        for wrong in ["", "a", "=1", "a=", "a=1,,2", "a+b=1+2,3", "a+=1+2"] {
            assert!(wrong.parse::<Vary>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_last_axis_varies_fastest() {
        let axes = ["a=1,2", "b+c=3+4,5+6"].map(|text| text.parse::<Vary>().unwrap().assignments());
        let sets = combinations(&axes);
        let texts: Vec<String> = sets.iter().map(|set| set.join(" ")).collect();
        assert_eq!(texts, ["a=1 b=3 c=4", "a=1 b=5 c=6", "a=2 b=3 c=4", "a=2 b=5 c=6"]);
        assert_eq!(combinations::<String>(&[]), [[""; 0]]);
    }
}
