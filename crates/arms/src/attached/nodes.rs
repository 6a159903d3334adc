//! The nodes of this machine that an arm may hang on: hidraw and serial ports.
//!
//! Data out: [`DeviceFile`]s with what USB says of them. Which of them is a certain arm is decided
//! by [`Match`] of its profile, never by a product name alone: names are empty without access to
//! the node, and siblings share them.

use core::fmt;
use core::str::FromStr;
use std::fs;
use std::path::{Path, PathBuf};

use serialport::SerialPortType;

use crate::profile::{Match, TransportKind};

/// What kind of node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// `/dev/hidrawN`.
    Hid,
    /// A tty.
    Serial,
}

impl NodeKind {
    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hid => "hid",
            Self::Serial => "serial",
        }
    }
}

/// A node, and what the device behind it says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceFile {
    /// What kind of node it is.
    pub kind: NodeKind,
    /// Path to open.
    pub path: PathBuf,
    /// Stable name of a serial port (`/dev/serial/by-id/…`).
    pub by_id: Option<PathBuf>,
    /// USB vendor; 0: none.
    pub vendor_id: u16,
    /// USB product; 0: none.
    pub product_id: u16,
    /// Serial number; empty: none.
    pub serial: String,
    /// Product; empty: none, or no access.
    pub product: String,
    /// USB interface.
    pub interface: Option<u16>,
    /// Usage page and usage of each top-level collection (HID).
    pub usages: Vec<(u16, u16)>,
}

impl DeviceFile {
    /// A path that the user gave, of which nothing else is known.
    pub(crate) fn at(path: &Path) -> Self {
        let is_hid =
            path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("hidraw"));
        Self {
            kind: if is_hid { NodeKind::Hid } else { NodeKind::Serial },
            path: path.to_owned(),
            by_id: None,
            vendor_id: 0,
            product_id: 0,
            serial: String::new(),
            product: String::new(),
            interface: None,
            usages: Vec::new(),
        }
    }

    /// It says what it is.
    pub(super) fn has_identity(&self) -> bool {
        self.vendor_id != 0
    }

    /// True for a node of the same device, under whatever name.
    pub(super) fn is_of_device(&self, other: &Self) -> bool {
        let identity = |node: &Self| {
            (
                node.kind,
                node.vendor_id,
                node.product_id,
                node.serial.clone(),
                node.interface,
                node.usages.clone(),
            )
        };
        identity(self) == identity(other)
    }
}

/// Every node, hidraw first, in the order of their paths. What cannot be listed is left out. Cold.
pub fn list() -> Vec<DeviceFile> {
    let mut nodes = hid();
    nodes.extend(serial());
    nodes.sort_by(|a, b| (a.kind.name(), &a.path).cmp(&(b.kind.name(), &b.path)));
    nodes
}

fn hid() -> Vec<DeviceFile> {
    let mut nodes: Vec<DeviceFile> = Vec::new();
    let Ok(api) = hidapi::HidApi::new() else { return nodes };
    for info in api.device_list() {
        let path = PathBuf::from(info.path().to_string_lossy().into_owned());
        let usage = (info.usage_page(), info.usage());
        // hidapi lists a node once for each of its usages.
        if let Some(known) = nodes.iter_mut().find(|node| node.path == path) {
            known.usages.push(usage);
            continue;
        }
        nodes.push(DeviceFile {
            kind: NodeKind::Hid,
            vendor_id: info.vendor_id(),
            product_id: info.product_id(),
            serial: info.serial_number().unwrap_or_default().to_owned(),
            product: info.product_string().unwrap_or_default().to_owned(),
            interface: u16::try_from(info.interface_number()).ok(),
            usages: vec![usage],
            ..DeviceFile::at(&path)
        });
    }
    nodes
}

fn serial() -> Vec<DeviceFile> {
    // serialport panics where this folder is missing, as in a container without ttys.
    if !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let stable = by_id(Path::new("/dev/serial/by-id"));
    let ports = serialport::available_ports().unwrap_or_default();
    let nodes = ports.into_iter().map(|port| {
        let path = PathBuf::from(&port.port_name);
        let by_id = stable.iter().find(|(target, _)| *target == path).map(|(_, name)| name.clone());
        let node = DeviceFile { kind: NodeKind::Serial, by_id, ..DeviceFile::at(&path) };
        match port.port_type {
            SerialPortType::UsbPort(usb) => DeviceFile {
                vendor_id: usb.vid,
                product_id: usb.pid,
                serial: usb.serial_number.unwrap_or_default(),
                product: usb.product.unwrap_or_default(),
                ..node
            },
            _ => node,
        }
    });
    nodes.collect()
}

/// What the stable names in a folder point at: target and name.
fn by_id(folder: &Path) -> Vec<(PathBuf, PathBuf)> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    entries
        .flatten()
        .filter_map(|entry| {
            fs::canonicalize(entry.path()).ok().map(|target| (target, entry.path()))
        })
        .collect()
}

/// Which node the user means: `VID:PID[:SERIAL]` in hex, or a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selector {
    /// A device on USB.
    Usb {
        /// Vendor.
        vendor_id: u16,
        /// Product.
        product_id: u16,
        /// Serial number, where several are attached.
        serial: Option<String>,
    },
    /// A node, or a link to one.
    Path(PathBuf),
}

/// A selector is neither of its two forms.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no selector: write VID:PID or VID:PID:SERIAL in hex, as in 16c0:0483, or the path of \
        a node, as in /dev/ttyACM0"
)]
pub struct SelectorError(String);

impl FromStr for Selector {
    type Err = SelectorError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.contains('/') {
            return Ok(Self::Path(PathBuf::from(text)));
        }
        let id = |word: Option<&str>| {
            word.filter(|word| (1..=4).contains(&word.len()))
                .and_then(|word| u16::from_str_radix(word, 16).ok())
        };
        let mut words = text.splitn(3, ':');
        match (id(words.next()), id(words.next()), words.next()) {
            (Some(vendor_id), Some(product_id), serial) if serial != Some("") => {
                Ok(Self::Usb { vendor_id, product_id, serial: serial.map(str::to_owned) })
            }
            _ => Err(SelectorError(text.to_owned())),
        }
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usb { vendor_id, product_id, serial } => {
                write!(f, "{vendor_id:04x}:{product_id:04x}")?;
                serial.as_ref().map_or(Ok(()), |serial| write!(f, ":{serial}"))
            }
            Self::Path(path) => write!(f, "{}", path.display()),
        }
    }
}

impl Selector {
    /// True for a node that it can mean.
    pub(super) fn means(&self, node: &DeviceFile) -> bool {
        match self {
            Self::Usb { vendor_id, product_id, serial } => {
                (node.vendor_id, node.product_id) == (*vendor_id, *product_id)
                    && serial.as_ref().is_none_or(|serial| *serial == node.serial)
            }
            Self::Path(path) => node.path == *path || node.by_id.as_ref() == Some(path),
        }
    }
}

impl Match {
    /// True for a node that can be this arm: everything that is given has to fit. An arm of which
    /// neither numbers nor a stable name are given is no node by itself; the user has to name it.
    pub(crate) fn admits(&self, node: &DeviceFile) -> bool {
        let numbers = self.ids.is_empty()
            || self
                .ids
                .iter()
                .any(|id| (id.vendor, id.product) == (node.vendor_id, node.product_id));
        let is_named = !self.ids.is_empty() || self.by_id.is_some();
        is_named
            && numbers
            && self.has_form_of(node)
            && self.serial.as_ref().is_none_or(|serial| *serial == node.serial)
            && self.product.as_ref().is_none_or(|part| node.product.contains(part.as_str()))
            && self.by_id.as_ref().is_none_or(|part| {
                node.by_id
                    .as_ref()
                    .is_some_and(|name| name.to_string_lossy().contains(part.as_str()))
            })
    }

    /// True for a node of the right kind and interface, from any manufacturer.
    pub(super) fn has_form_of(&self, node: &DeviceFile) -> bool {
        let kind = match self.transport {
            TransportKind::Hid => NodeKind::Hid,
            TransportKind::Serial => NodeKind::Serial,
            TransportKind::Usb
            | TransportKind::Socket
            | TransportKind::Service
            | TransportKind::Library => return false,
        };
        let usage = |(page, usage): &(u16, u16)| {
            self.usage_page.is_none_or(|wanted| wanted == *page)
                && self.usage.is_none_or(|wanted| wanted == *usage)
        };
        kind == node.kind
            && (self.usage_page.is_none() && self.usage.is_none() || node.usages.iter().any(usage))
            && self.interface.is_none_or(|interface| node.interface == Some(u16::from(interface)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::UsbId;

    #[test]
    fn selectors_are_read_and_shown() {
        for text in ["16c0:0483", "16c0:0483:A 7", "/dev/ttyACM0", "./link"] {
            assert_eq!(text.parse::<Selector>().expect(text).to_string(), text);
        }
        assert_eq!("1:2".parse::<Selector>().expect("short").to_string(), "0001:0002");
        for text in ["", "16c0", "16c0:", "16c0:04833", "wxyz:0001", "16c0:0483:", "ttyACM0"] {
            let error = text.parse::<Selector>().expect_err(text).to_string();
            assert!(error.contains("VID:PID") && error.contains("/dev/ttyACM0"), "{error}");
        }
    }

    #[test]
    fn a_node_is_chosen_by_numbers_and_by_its_interface() {
        let teensy = DeviceFile {
            vendor_id: 0x16c0,
            product_id: 0x0486,
            interface: Some(0),
            usages: vec![(0xffab, 0x0200)],
            ..DeviceFile::at(Path::new("/dev/hidraw3"))
        };
        let emulated =
            DeviceFile { usages: vec![(0xffc9, 4)], interface: Some(1), ..teensy.clone() };
        let raw_hid = Match {
            transport: TransportKind::Hid,
            ids: vec![
                UsbId { vendor: 0x1234, product: 6 },
                UsbId { vendor: 0x16c0, product: 0x0486 },
            ],
            usage_page: Some(0xffab),
            usage: None,
            interface: None,
            serial: None,
            product: None,
            by_id: None,
            baud: 0,
        };
        assert!(raw_hid.admits(&teensy) && !raw_hid.admits(&emulated));
        assert!(!raw_hid.admits(&DeviceFile { kind: NodeKind::Serial, ..teensy.clone() }));
        assert!(
            !Match { ids: Vec::new(), ..raw_hid.clone() }.admits(&teensy),
            "a page alone is no arm"
        );
        assert!(!Match { by_id: Some("Teensy".into()), ..raw_hid }.admits(&teensy));
        let of_serial: Selector = "16c0:0486:77".parse().expect("valid");
        assert!(
            !of_serial.means(&teensy)
                && of_serial.means(&DeviceFile { serial: "77".into(), ..teensy.clone() })
        );
        assert!(Selector::Path("/dev/hidraw3".into()).means(&teensy));
    }

    #[test]
    fn listing_never_fails() {
        for node in list() {
            assert!(node.path.starts_with("/"), "{node:?}");
        }
    }
}
