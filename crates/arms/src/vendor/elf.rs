//! What the first bytes of a file say of whether this process can load it: the system's own words
//! for a library of another processor are "no such file".

use std::io::Read as _;
use std::path::Path;

use vps::storage::regular;

/// How much of a file is looked at.
const HEAD: u64 = 20;

/// Number of a processor in `e_machine`, and its name as Rust has it.
const PROCESSORS: [(u16, &str); 5] =
    [(3, "x86"), (40, "arm"), (62, "x86_64"), (183, "aarch64"), (243, "riscv64")];

/// Why this process cannot load a file; `None` where nothing speaks against it.
pub(crate) fn unsuitable_file(path: &Path) -> Option<String> {
    if path.is_dir() {
        return Some("is a folder: name the file in it".to_owned());
    }
    let mut head = Vec::new();
    match regular::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head)) {
        Ok(_) => unsuitable(&head),
        Err(error) => Some(format!("cannot be read: {error}")),
    }
}

/// Why this process cannot load a file that begins so; `None` where nothing speaks against it.
fn unsuitable(head: &[u8]) -> Option<String> {
    let is = |start: &[u8]| head.starts_with(start);
    let what = match () {
        () if is(b"\x7fELF") => return of_other_machine(head),
        () if head.is_empty() => "is empty",
        () if is(b"MZ") => "is a library for Windows",
        () if is(b"\xcf\xfa\xed\xfe") || is(b"\xca\xfe\xba\xbe") => "is a library for macOS",
        () => "is no library",
    };
    Some(what.to_owned())
}

fn of_other_machine(head: &[u8]) -> Option<String> {
    let u16_at = |at: usize| Some(u16::from_le_bytes(head.get(at..at + 2)?.try_into().ok()?));
    let (Some(kind), Some(processor)) = (u16_at(16), u16_at(18)) else {
        return Some("is cut off".to_owned());
    };
    let here = std::env::consts::ARCH;
    match PROCESSORS.iter().find(|(number, _)| *number == processor).map(|(_, name)| *name) {
        // 3: a shared object.
        Some(name) if name == here && kind == 3 => None,
        Some(name) if name == here => Some("is a program, and no library".to_owned()),
        Some(name) => Some(format!(
            "is for {name}, and this program for {here}: take the maker's library for {here}"
        )),
        None => Some(format!(
            "is for another processor (ELF machine {processor}), and this program for {here}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(kind: u8, processor: u8) -> Vec<u8> {
        let mut head = b"\x7fELF\x02\x01\x01".to_vec();
        head.resize(HEAD as usize, 0);
        (head[16], head[18]) = (kind, processor);
        head
    }

    #[test]
    fn a_library_of_another_processor_or_system_and_what_is_none_are_named() {
        let own = PROCESSORS
            .iter()
            .find(|(_, name)| *name == std::env::consts::ARCH)
            .expect("a processor that is known")
            .0 as u8;
        let other = if own == 183 { 62 } else { 183 };
        assert_eq!(unsuitable(&head(3, own)), None);
        for (bytes, words) in [
            (head(3, other), "take the maker's library for"),
            (head(3, 8), "another processor (ELF machine 8)"),
            (head(2, own), "is a program, and no library"),
            (head(3, own)[..10].to_vec(), "is cut off"),
            (b"MZ\x90\0".to_vec(), "for Windows"),
            (b"\xcf\xfa\xed\xfe".to_vec(), "for macOS"),
            (b"[package]".to_vec(), "is no library"),
            (Vec::new(), "is empty"),
        ] {
            let reported = unsuitable(&bytes).expect("refused");
            assert!(reported.contains(words), "{words}: {reported}");
        }
    }
}
