//! Which maker's library an arm needs, where that is looked for, and what its error codes mean.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{force_dimension, open_haptics, virtuose};
use crate::protocol::Open6Arm;

/// A maker whose library is loaded at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Family {
    /// Force Dimension: `libdrd`, or the smaller `libdhd`.
    ForceDimension,
    /// 3D Systems: `libHD` of OpenHaptics.
    OpenHaptics,
    /// Haption: `libVirtuoseAPI`.
    Virtuose,
}

/// What a profile says of an arm behind a maker's library.
#[derive(Clone, Debug, PartialEq)]
pub struct VendorProtocol {
    /// Whose.
    pub family: Family,
    /// The library, where the profile names one.
    pub library: Option<PathBuf>,
    /// The arm may move by itself to find its zero: said with `--home` for one opening, never
    /// written.
    pub home: bool,
    /// What the profile expects of the arm.
    pub arm: Open6Arm,
}

/// A library of others that the maker's one rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Need {
    /// Its file.
    pub(crate) file: &'static str,
    /// What it is.
    pub(crate) title: &'static str,
    /// How it comes here.
    pub(crate) advice: &'static str,
    /// The advice is prose, and no command.
    pub(crate) by_hand: bool,
}

const NCURSES: &str = "sudo apt install libncurses5   # Debian 12, Ubuntu 22.04; later releases \
    have none: take the package of one of these";
const TOUCH_DRIVER: &str = "install the driver of the arm (TouchDriver) beside OpenHaptics";

/// Folders of libraries on Linux.
const FOLDERS: [&str; 3] = ["/usr/local/lib", "/usr/lib", "/usr/lib/MACHINE-linux-gnu"];

impl Family {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::ForceDimension, Self::OpenHaptics, Self::Virtuose];

    /// Name of the codec in profiles.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ForceDimension => "force-dimension",
            Self::OpenHaptics => "open-haptics",
            Self::Virtuose => "virtuose",
        }
    }

    /// For people.
    pub const fn title(self) -> &'static str {
        match self {
            Self::ForceDimension => "Force Dimension SDK (libdrd or libdhd, 3.16 or later)",
            Self::OpenHaptics => "OpenHaptics of 3D Systems (libHD, 3.0 or later)",
            Self::Virtuose => "VirtuoseAPI of Haption (libVirtuoseAPI, 4.03 or later)",
        }
    }

    /// Where its library comes from.
    pub const fn source(self) -> &'static str {
        match self {
            Self::ForceDimension => {
                "https://www.forcedimension.com/software/sdk (free, with a registration)"
            }
            Self::Virtuose => "Haption, which delivers it with the arm",
            Self::OpenHaptics => {
                "https://support.3dsystems.com (OpenHaptics for Linux, with the driver of the arm)"
            }
        }
    }

    /// Whether USB numbers are those of its arms. The Touch has had two vendors, and a Falcon that
    /// of its USB chip.
    pub(crate) const fn has_usb(self, vendor: u16, product: u16) -> bool {
        match self {
            Self::ForceDimension => vendor == 0x1451 || vendor == 0x0403 && product == 0xcb48,
            Self::Virtuose => false,
            Self::OpenHaptics => vendor == 0x2988 || vendor == 0x0301 && product == 0x2988,
        }
    }

    /// Libraries of others that its own rests on.
    pub(crate) const fn needs(self) -> &'static [Need] {
        match self {
            Self::ForceDimension => &[Need {
                file: "libusb-1.0.so.0",
                title: "libusb",
                advice: "sudo apt install libusb-1.0-0",
                by_hand: false,
            }],
            Self::Virtuose => &[],
            Self::OpenHaptics => &[
                Need {
                    file: "libncurses.so.5",
                    title: "ncurses 5",
                    advice: NCURSES,
                    by_hand: false,
                },
                Need { file: "libtinfo.so.5", title: "tinfo 5", advice: NCURSES, by_hand: false },
                Need {
                    file: "libPhantomIOLib42.so",
                    title: "driver of the arm",
                    advice: TOUCH_DRIVER,
                    by_hand: true,
                },
                Need {
                    file: "libPHANToMIO.so.4",
                    title: "driver of the arm",
                    advice: TOUCH_DRIVER,
                    by_hand: true,
                },
            ],
        }
    }

    /// What chooses one of several of its arms, for a selector that does not.
    pub(crate) const fn selector_advice(self) -> &'static str {
        match self {
            Self::ForceDimension => {
                "the USB vendor of its maker is 1451, and a Falcon is 0403:cb48; 1451:0402:SERIAL \
                    chooses by serial number"
            }
            Self::OpenHaptics => {
                "the USB vendor of its maker is 2988; 2988:0302:NAME chooses by the name that the \
                    maker's setup gave the arm"
            }
            Self::Virtuose => {
                "it has no USB numbers; its address is `serial` under [match] of a copy of the \
                    profile"
            }
        }
    }

    /// File names, the best first.
    const fn files(self) -> &'static [&'static str] {
        match self {
            Self::ForceDimension => &["libdrd.so.3", "libdrd.so", "libdhd.so.3", "libdhd.so"],
            Self::Virtuose => &["libVirtuoseAPI.so"],
            Self::OpenHaptics => &["libHD.so.3.4", "libHD.so.3.0", "libHD.so.3", "libHD.so"],
        }
    }

    /// Environment variables that name a library, or the folder of the maker's kit.
    pub const fn variables(self) -> &'static [&'static str] {
        match self {
            Self::ForceDimension => &["HAPTICD_LIBDRD", "FDSDK", "FORCEDIM_SDK"],
            Self::Virtuose => &["HAPTICD_LIBVIRTUOSE"],
            Self::OpenHaptics => &["HAPTICD_LIBHD", "OH_SDK_BASE"],
        }
    }

    /// What an error code of a sample means.
    pub fn fault_text(self, fault: u16) -> Option<&'static str> {
        match self {
            Self::ForceDimension => force_dimension::fault_text(fault),
            Self::OpenHaptics => open_haptics::fault_text(fault),
            Self::Virtuose => virtuose::fault_text(fault),
        }
    }

    /// Every place where the library may be, in the order in which they are tried. `variable` reads
    /// the environment.
    pub fn places(
        self,
        written: Option<&Path>,
        variable: impl Fn(&str) -> Option<OsString>,
    ) -> Vec<PathBuf> {
        // What a profile names is what the user wants, and nothing else.
        if let Some(path) = written {
            return vec![path.to_owned()];
        }
        let mut places = Vec::new();
        let mut in_folder =
            |folder: &Path| places.extend(self.files().iter().map(|file| folder.join(file)));
        // An empty one would be the working folder.
        for value in self
            .variables()
            .iter()
            .filter_map(|name| variable(name))
            .filter(|value| !value.is_empty())
        {
            let path = PathBuf::from(value);
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.ends_with(".so") || name.contains(".so.") {
                return vec![path];
            }
            let machine = std::env::consts::ARCH;
            for below in [format!("lib/release/lin-{machine}-gcc"), "lib".to_owned(), String::new()]
            {
                in_folder(&path.join(below));
            }
        }
        if let Some(home) = variable("HOME").filter(|home| !home.is_empty()) {
            in_folder(&Path::new(&home).join(".local/lib"));
        }
        for folder in FOLDERS {
            in_folder(Path::new(&folder.replace("MACHINE", std::env::consts::ARCH)));
        }
        places
    }

    /// The same in the environment of this process.
    pub(crate) fn places_here(self, written: Option<&Path>) -> Vec<PathBuf> {
        self.absolute_places(written, |name| std::env::var_os(name))
    }

    /// [`places`](Self::places) from the folder that this program was started in: a name without a
    /// folder would be looked for elsewhere when it is loaded.
    pub(crate) fn absolute_places(
        self,
        written: Option<&Path>,
        variable: impl Fn(&str) -> Option<OsString>,
    ) -> Vec<PathBuf> {
        self.places(written, variable)
            .into_iter()
            .map(|path| std::path::absolute(&path).unwrap_or(path))
            .collect()
    }

    /// What is wrong where none of these places has it, in one line.
    pub(crate) fn missing_text(self, places: &[PathBuf]) -> String {
        match places {
            [only] => format!("there is no {}", only.display()),
            _ => format!("its library is in none of {} folders", folders(places).len()),
        }
    }

    /// Where it was looked for, and what to do, line by line.
    pub(crate) fn missing_advice(self, places: &[PathBuf]) -> String {
        let mut lines = Vec::new();
        if places.len() > 1 {
            lines.push(format!("looked for {} in", self.files().join(", ")));
            lines.extend(folders(places).iter().map(|folder| format!("  {}", folder.display())));
        }
        lines.push(format!("install the {} from {}", self.title(), self.source()));
        let names: Vec<String> =
            self.variables().iter().map(|name| format!("export {name}=…")).collect();
        lines.push(format!(
            "or name the file, or the folder of the maker's kit: {}, `library` under [protocol] of \
                a profile, or --selector FILE",
            names.join(" or ")
        ));
        lines.join("\n")
    }

    /// How an arm finds its zero that was ordered to; `None` where its maker's controller knows it.
    pub(crate) fn way_to_zero(self) -> Option<&'static str> {
        match self {
            Self::ForceDimension => Some(
                "an arm that does not know its zero moves by itself now, until it has found it: \
                    keep away from it",
            ),
            Self::OpenHaptics => Some(
                "an arm that cannot find its zero takes the place where it is held now: hold it \
                    there",
            ),
            Self::Virtuose => None,
        }
    }

    /// What helps where the library is there and the system cannot load it, by what the system
    /// says.
    pub(super) fn load_advice(self, cause: &str) -> Option<&'static str> {
        self.needs().iter().find(|need| cause.contains(need.file)).map(|need| need.advice)
    }
}

/// Folders of places, each once.
fn folders(places: &[PathBuf]) -> Vec<&Path> {
    let mut folders: Vec<&Path> = places.iter().filter_map(|path| path.parent()).collect();
    folders.dedup();
    folders
}

impl core::fmt::Display for Family {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_is_looked_for_where_the_profile_the_environment_and_the_maker_say() {
        let family = Family::ForceDimension;
        let nothing = |_: &str| None;
        assert_eq!(
            family.places(Some(Path::new("/a/b.so")), |_| Some("/c.so".into())),
            [Path::new("/a/b.so")]
        );
        let named = family
            .places(None, |name| (name == "HAPTICD_LIBDRD").then(|| "/x/libdrd.so.3.17.5".into()));
        assert_eq!(named, [Path::new("/x/libdrd.so.3.17.5")]);
        let kit = family.places(None, |name| (name == "FDSDK").then(|| "/opt/sdk".into()));
        let below = format!("/opt/sdk/lib/release/lin-{}-gcc/libdrd.so.3", std::env::consts::ARCH);
        assert!(
            kit[0] == Path::new(&below) && kit.contains(&"/usr/local/lib/libdhd.so".into()),
            "{kit:?}"
        );
        let at_home = family.places(None, |name| (name == "HOME").then(|| "/home/a".into()));
        assert_eq!(at_home[0], Path::new("/home/a/.local/lib/libdrd.so.3"));
        let with_empty =
            family.places(None, |name| Some(if name == "HOME" { "/home/a" } else { "" }.into()));
        assert_eq!(with_empty, at_home, "an empty variable is none");
        let of_a_user = family
            .places(None, |name| (name == "FDSDK").then(|| "/home/u.sofia/sdk.source".into()));
        assert!(
            of_a_user.len() > 1,
            "a folder whose name holds the letters is no file: {of_a_user:?}"
        );
        assert_eq!(family.places(None, nothing).len(), 4 * FOLDERS.len());
    }

    #[test]
    fn a_library_that_is_nowhere_is_reported_as_a_list_of_folders_and_what_to_do() {
        let family = Family::ForceDimension;
        let places = family.places(None, |name| (name == "HOME").then(|| "/home/a".into()));
        assert_eq!(family.missing_text(&places), "its library is in none of 4 folders");
        let advice = family.missing_advice(&places);
        let lines: Vec<&str> = advice.lines().collect();
        assert_eq!(
            lines[..3],
            [
                "looked for libdrd.so.3, libdrd.so, libdhd.so.3, libdhd.so in",
                "  /home/a/.local/lib",
                "  /usr/local/lib"
            ]
        );
        assert!(
            lines.len() == 7
                && lines[5].starts_with("install the Force Dimension SDK")
                && lines[6].contains("export FDSDK="),
            "{lines:?}"
        );
        let written = [PathBuf::from("/no/libdrd.so")];
        assert_eq!(family.missing_text(&written), "there is no /no/libdrd.so");
        assert!(
            family.missing_advice(&written).starts_with("install"),
            "nothing else was looked at"
        );
    }

    #[test]
    fn what_a_library_rests_on_is_said_with_what_helps() {
        let missing = |file: &str| {
            format!("{file}: cannot open shared object file: No such file or directory")
        };
        let advice =
            |family: Family, file: &str| family.load_advice(&missing(file)).unwrap_or_default();
        assert!(advice(Family::OpenHaptics, "libncurses.so.5").contains("apt install libncurses5"));
        assert!(advice(Family::OpenHaptics, "libPhantomIOLib42.so").contains("TouchDriver"));
        assert!(advice(Family::ForceDimension, "libusb-1.0.so.0").contains("libusb-1.0-0"));
        assert_eq!(advice(Family::Virtuose, "libm.so.6"), "");
    }
}
