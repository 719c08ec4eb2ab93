//! Names the functions that the library exports on Windows, where everything would be exported otherwise.

fn main() {
    println!("cargo::rerun-if-changed=exports.def");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("windows") {
        let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
        println!("cargo::rustc-cdylib-link-arg={folder}/exports.def");
    }
}
