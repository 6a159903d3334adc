#![no_main]

use hapticd::mesh::Format;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    hapticd_fuzz::mesh(bytes, Format::Stl);
});
