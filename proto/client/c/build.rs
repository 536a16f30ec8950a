//! How the library is linked.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        // Found by its name wherever the system looks; and never unloaded, for a thread may still be about to end.
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,liblamina_c.so,-z,nodelete");
    }
}
