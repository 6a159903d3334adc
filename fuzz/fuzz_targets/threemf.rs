#![no_main]

#[path = "../src/mesh.rs"]
mod mesh;

use vps::mesh::Format;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    mesh::exercise(bytes, Format::ThreeMf);
});
