//! The nodes of this machine that an arm may hang on: hidraw and serial ports.
//!
//! Data out: [`Node`]s with what USB says of them. Which of them is a certain arm is decided by [`Criteria`], never by a product name alone: names
//! are empty without access to the node, and siblings share them.

use core::fmt;
use core::str::FromStr;
use std::fs;
use std::path::{Path, PathBuf};

use serialport::SerialPortType;

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
pub struct Node {
    /// Kind.
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

impl Node {
    /// A path that the user gave, of which nothing else is known.
    pub fn at(path: &Path) -> Self {
        let is_hid = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("hidraw"));
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
}

/// Every node, hidraw first, in the order of their paths. What cannot be listed is left out. Cold.
pub fn list() -> Vec<Node> {
    let mut nodes = hid();
    nodes.extend(serial());
    nodes.sort_by(|a, b| (a.kind.name(), &a.path).cmp(&(b.kind.name(), &b.path)));
    nodes
}

fn hid() -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::new();
    let Ok(api) = hidapi::HidApi::new() else { return nodes };
    for info in api.device_list() {
        let path = PathBuf::from(info.path().to_string_lossy().into_owned());
        let usage = (info.usage_page(), info.usage());
        // hidapi lists a node once for each of its usages.
        if let Some(known) = nodes.iter_mut().find(|node| node.path == path) {
            known.usages.push(usage);
            continue;
        }
        nodes.push(Node {
            kind: NodeKind::Hid,
            vendor_id: info.vendor_id(),
            product_id: info.product_id(),
            serial: info.serial_number().unwrap_or_default().to_owned(),
            product: info.product_string().unwrap_or_default().to_owned(),
            interface: u16::try_from(info.interface_number()).ok(),
            usages: vec![usage],
            ..Node::at(&path)
        });
    }
    nodes
}

fn serial() -> Vec<Node> {
    // serialport panics where this folder is missing, as in a container without ttys.
    if !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let stable = by_id(Path::new("/dev/serial/by-id"));
    let ports = serialport::available_ports().unwrap_or_default();
    let nodes = ports.into_iter().map(|port| {
        let path = PathBuf::from(&port.port_name);
        let by_id = stable.iter().find(|(target, _)| *target == path).map(|(_, name)| name.clone());
        let node = Node { kind: NodeKind::Serial, by_id, ..Node::at(&path) };
        match port.port_type {
            SerialPortType::UsbPort(usb) => Node {
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
    entries.flatten().filter_map(|entry| fs::canonicalize(entry.path()).ok().map(|target| (target, entry.path()))).collect()
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
#[error("`{0}` is no selector: write VID:PID or VID:PID:SERIAL in hex, as in 16c0:0483, or the path of a node, as in /dev/ttyACM0")]
pub struct SelectorError(String);

impl FromStr for Selector {
    type Err = SelectorError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.contains('/') {
            return Ok(Self::Path(PathBuf::from(text)));
        }
        let id = |word: Option<&str>| {
            word.filter(|word| (1..=4).contains(&word.len())).and_then(|word| u16::from_str_radix(word, 16).ok())
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

/// What a node must be to be a certain arm. Empty fields say nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Criteria {
    /// Kind of node.
    pub kind: Option<NodeKind>,
    /// USB vendor.
    pub vendor_id: Option<u16>,
    /// USB product.
    pub product_id: Option<u16>,
    /// Serial number.
    pub serial: Option<String>,
    /// Part of the product's name.
    pub product: Option<String>,
    /// USB interface.
    pub interface: Option<u16>,
    /// Usage page and usage of one of the collections.
    pub usage_page: Option<u16>,
    /// Usage, on that page.
    pub usage: Option<u16>,
    /// Part of the stable name.
    pub by_id: Option<String>,
}

impl Criteria {
    /// True for a node that meets all of them.
    pub fn admit(&self, node: &Node) -> bool {
        fn meets<T: PartialEq>(wanted: Option<&T>, found: &T) -> bool {
            wanted.is_none_or(|wanted| wanted == found)
        }
        let usage = |(page, usage): &(u16, u16)| meets(self.usage_page.as_ref(), page) && meets(self.usage.as_ref(), usage);
        let by_id = |part: &String| node.by_id.as_ref().is_some_and(|name| name.to_string_lossy().contains(part.as_str()));
        meets(self.kind.as_ref(), &node.kind)
            && meets(self.vendor_id.as_ref(), &node.vendor_id)
            && meets(self.product_id.as_ref(), &node.product_id)
            && meets(self.serial.as_ref(), &node.serial)
            && self.product.as_ref().is_none_or(|part| node.product.contains(part.as_str()))
            && self.interface.is_none_or(|interface| node.interface == Some(interface))
            && (self.usage_page.is_none() && self.usage.is_none() || node.usages.iter().any(usage))
            && self.by_id.as_ref().is_none_or(by_id)
    }

    /// True when they name a device at all, so that one may be chosen by them.
    pub fn name_a_device(&self) -> bool {
        self.vendor_id.is_some() && self.product_id.is_some() || self.by_id.is_some()
    }

    /// The same, narrowed to what the user selected.
    #[must_use]
    pub fn narrowed(&self, selector: &Selector) -> Self {
        match selector {
            Selector::Usb { vendor_id, product_id, serial } => Self {
                vendor_id: Some(*vendor_id),
                product_id: Some(*product_id),
                serial: serial.clone().or_else(|| self.serial.clone()),
                ..self.clone()
            },
            Selector::Path(_) => self.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let teensy = Node {
            vendor_id: 0x16c0,
            product_id: 0x0486,
            interface: Some(0),
            usages: vec![(0xffab, 0x0200)],
            ..Node::at(Path::new("/dev/hidraw3"))
        };
        let emulated = Node { usages: vec![(0xffc9, 4)], interface: Some(1), ..teensy.clone() };
        let raw_hid = Criteria {
            kind: Some(NodeKind::Hid),
            vendor_id: Some(0x16c0),
            product_id: Some(0x0486),
            usage_page: Some(0xffab),
            ..Criteria::default()
        };
        assert!(raw_hid.name_a_device() && raw_hid.admit(&teensy) && !raw_hid.admit(&emulated));
        let other = raw_hid.narrowed(&"16c0:0486:77".parse().expect("valid"));
        assert!(!other.admit(&teensy) && other.admit(&Node { serial: "77".into(), ..teensy.clone() }));
        assert!(!Criteria { by_id: Some("Teensy".into()), ..Criteria::default() }.admit(&teensy));
        assert!(!Criteria::default().name_a_device());
    }

    #[test]
    fn listing_never_fails() {
        for node in list() {
            assert!(node.path.starts_with("/"), "{node:?}");
        }
    }
}
