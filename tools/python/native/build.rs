//! What the linker needs to know of a library that Python loads.

fn main() {
    println!("cargo::rerun-if-changed=exports.def");
    let is_gnu = std::env::var("CARGO_CFG_TARGET_ENV").as_deref() == Ok("gnu");
    match std::env::var("CARGO_CFG_TARGET_OS").as_deref() {
        // Everything would be exported otherwise. For MSVC rustc itself passes such a list.
        Ok("windows") if is_gnu => {
            let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
            println!("cargo::rustc-cdylib-link-arg={folder}/exports.def");
        }
        // Else the name is the path of the build.
        Ok("macos") => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libmeniscus_native.dylib");
        }
        _ => {}
    }
}
