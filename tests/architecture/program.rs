//! Functions that the built program takes from the system.

use std::{collections::HashSet, fs};

/// Functions of the system's mathematical library whose last bits are the system's own. Single precision adds an f.
const INEXACT: &str = "sin cos tan sincos exp exp2 exp10 log log10 log2 pow atan2 atan acos asin sinh cosh tanh asinh acosh atanh cbrt \
                       hypot expm1 log1p tgamma lgamma erf erfc";

/// Such functions that a program of ELF format imports, by their names in its tables of strings.
fn imported_functions(program: &[u8]) -> Vec<String> {
    let names: HashSet<&[u8]> = program.split(|&byte| byte == 0).collect();
    let all = INEXACT.split_whitespace().flat_map(|name| [name.to_owned(), format!("{name}f")]);
    let all = all.chain(["lgamma_r", "lgammaf_r"].map(str::to_owned));
    all.filter(|name| names.contains(name.as_bytes())).collect()
}

#[test]
fn the_program_imports_no_functions_that_differ_between_systems() {
    let mut program = fs::read(env!("CARGO_BIN_EXE_meniscus")).unwrap();
    // Progress bars shorten their numbers by powers.
    assert_eq!(imported_functions(&program), ["pow"]);
    program.extend(*b"\0asinhf\0");
    assert_eq!(imported_functions(&program), ["pow", "asinhf"]);
}
