//! What the linker has to know of the shared library.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // The number is that of `VPS_ABI_VERSION`.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libvps.so.1");
    // Its worker threads outlive any `dlclose`.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
}
