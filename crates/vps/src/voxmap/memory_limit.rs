//! How much memory a bake may take, and where the limit comes from.

use crate::setting_names::SettingNames;

/// Of what the system has left, bytes that stay free for everything else that runs on it.
pub const FREE_BYTES: u64 = 128 << 20;

/// A limit, and where it comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryLimit {
    /// Bytes that the caller allowed.
    Given(u64),
    /// Bytes that the system had left. An estimate holds to within a half, and to run out of memory
    /// ends the process: [`FREE_BYTES`] and a third of the rest are not taken.
    Left(u64),
}

impl MemoryLimit {
    /// The largest estimate that keeps it.
    pub fn max_bytes(self) -> u64 {
        match self {
            Self::Given(bytes) => bytes,
            Self::Left(bytes) => bytes.saturating_sub(FREE_BYTES) / 3 * 2,
        }
    }

    /// `2.0 GiB, more than the 1.0 GiB that are allowed (2.1 GB and 1.1 GB)`.
    pub fn exceeded_by(self, needed_bytes: u64) -> String {
        let max_bytes = self.max_bytes();
        let needed = show_bytes(needed_bytes);
        let most = show_bytes(max_bytes);
        match self {
            Self::Given(_) => {
                let [needed_decimal, most_decimal] =
                    [needed_bytes, max_bytes].map(show_decimal_bytes);
                format!(
                    "{needed}, more than the {most} that are allowed ({needed_decimal} and \
                        {most_decimal})"
                )
            }
            Self::Left(left) => format!(
                "{needed}, more than the {most} that can be taken here: {} are left, of which {} \
                    and a third of the rest stay free",
                show_bytes(left),
                show_bytes(FREE_BYTES)
            ),
        }
    }

    /// What would make it larger.
    pub fn remedy(self, names: &SettingNames) -> String {
        match self {
            Self::Given(_) => format!("a larger {}", names.memory_limit),
            Self::Left(_) => "end programs that hold memory".to_owned(),
        }
    }
}

/// A number of bytes for people, in binary units.
pub fn show_bytes(bytes: u64) -> String {
    let bytes = bytes as f64;
    let (unit, name) = [(1_u64 << 30, "GiB"), (1 << 20, "MiB")]
        .into_iter()
        .find(|(unit, _)| bytes >= *unit as f64)
        .unwrap_or((1 << 10, "KiB"));
    let value = bytes / unit as f64;
    if value < 10.0 { format!("{value:.1} {name}") } else { format!("{value:.0} {name}") }
}

/// The same in powers of ten, as people write sizes: `20 MB`.
pub fn show_decimal_bytes(bytes: u64) -> String {
    let (unit, name) = [(1e9, "GB"), (1e6, "MB")]
        .into_iter()
        .find(|(unit, _)| bytes as f64 >= *unit)
        .unwrap_or((1e3, "kB"));
    let value = bytes as f64 / unit;
    if value < 10.0 {
        format!("{} {name}", (value * 10.0).round() / 10.0)
    } else {
        format!("{value:.0} {name}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_not_taken_to_the_last_byte() {
        assert_eq!(MemoryLimit::Given(7).max_bytes(), 7);
        assert_eq!(MemoryLimit::Left(FREE_BYTES + 300).max_bytes(), 200);
        assert_eq!(MemoryLimit::Left(FREE_BYTES - 1).max_bytes(), 0);
        let said = MemoryLimit::Left(FREE_BYTES + (3 << 30)).exceeded_by(5 << 30);
        assert!(
            said.starts_with(
                "5.0 GiB, more than the 2.0 GiB that can be taken here: 3.1 GiB are left"
            ),
            "{said}"
        );
    }
}
