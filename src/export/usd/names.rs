//! Names of prims and attributes: USD identifiers.

use std::collections::HashSet;

/// The longest identifier that is made of a name [characters].
const MAX_LENGTH: usize = 200;

/// An identifier made of any text: letters, digits and underscores of ASCII, not beginning with a digit.
pub(crate) fn identifier(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let made: String = name.chars().take(MAX_LENGTH).map(plain).collect();
    match made.chars().next() {
        Some(first) if !first.is_ascii_digit() => made,
        _ => format!("_{made}"),
    }
}

/// Identifiers of one namespace, each given once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Identifiers(HashSet<String>);

impl Identifiers {
    /// Takes an identifier that must not be given to others.
    pub(crate) fn reserve(&mut self, name: &str) {
        self.0.insert(name.to_owned());
    }

    /// The identifier of a name, with a number from the second on.
    pub(crate) fn unique(&mut self, name: &str) -> String {
        let stem = identifier(name);
        let numbered = (1_u32..).map(|number| match number {
            1 => stem.clone(),
            _ => format!("{stem}_{number}"),
        });
        let mut free = numbered.filter(|name| self.0.insert(name.clone()));
        free.next().expect("there are more numbers than names")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_text_becomes_an_identifier_and_each_another() {
        for (name, expected) in [
            ("liquid", "liquid"),
            ("two words", "two_words"),
            ("box-2", "box_2"),
            ("2nd", "_2nd"),
            ("", "_"),
            ("grün\u{1b}[31m\"@</a>", "gr_n__31m____a_"),
        ] {
            assert_eq!(identifier(name), expected);
        }
        assert!(identifier(&"x".repeat(10_000)).len() <= MAX_LENGTH + 1);
        let mut names = Identifiers::default();
        names.reserve("points");
        let given: Vec<String> = ["a-b", "a_b", "a.b", "points"].map(|name| names.unique(name)).into();
        assert_eq!(given, ["a_b", "a_b_2", "a_b_3", "points_2"]);
    }
}
