//! A HID device that the kernel makes from `/dev/uhid`; the host finds a hidraw node.
//!
//! Events are laid out by hand: a 32-bit type, then what belongs to it, packed, in the byte order
//! of the machine. Source: the kernel's user-space API of uhid.

use core::time::Duration;
use std::fs::File;
use std::io::Write;
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::fs::{Mode, OFlags};

use super::link::{ArmLink, LinkError};
use super::pty::wait_for;

const DESTROY: u32 = 1;
const OPEN: u32 = 4;
const CLOSE: u32 = 5;
const OUTPUT: u32 = 6;
const GET_REPORT: u32 = 9;
const GET_REPORT_REPLY: u32 = 10;
const CREATE2: u32 = 11;
const INPUT2: u32 = 12;
const SET_REPORT: u32 = 13;
const SET_REPORT_REPLY: u32 = 14;

const DATA_MAX: usize = 4096;
/// Type, then the largest of all events: that of [`CREATE2`].
const EVENT_BYTES: usize = 4 + 128 + 64 + 64 + 2 + 2 + 4 * 4 + DATA_MAX;
const BUS_USB: u16 = 3;
const EIO: u16 = 5;

/// The identity of a HID device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HidIdentity {
    /// What people read; cut to what the kernel keeps.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// USB vendor.
    pub vendor_id: u16,
    /// USB product.
    pub product_id: u16,
    /// Report descriptor.
    pub descriptor: Vec<u8>,
}

/// Report descriptor of vendor-defined reports: usage page and usage; the ID, where reports are
/// numbered, and the bytes beside it, arm to host and host to arm.
pub(super) fn vendor_descriptor(
    usage: (u16, u16),
    input: (Option<u8>, usize),
    output: (Option<u8>, usize),
) -> Vec<u8> {
    let ([page_low, page_high], [usage_low, usage_high]) =
        (usage.0.to_le_bytes(), usage.1.to_le_bytes());
    let mut bytes = vec![0x06, page_low, page_high, 0x0A, usage_low, usage_high];
    bytes.extend([0xA1, 0x01, 0x75, 0x08, 0x15, 0x00, 0x26, 0xFF, 0x00]);
    for ((id, n), usage, main) in [(input, 1, 0x81), (output, 2, 0x91)] {
        if let Some(id) = id {
            bytes.extend([0x85, id]);
        }
        bytes.extend([0x95, u8::try_from(n).unwrap_or(u8::MAX), 0x09, usage, main, 0x02]);
    }
    bytes.push(0xC0);
    bytes
}

/// Report descriptor of a SpaceMouse whose translation and rotation come in one report.
pub(super) fn space_mouse_descriptor() -> Vec<u8> {
    let mut bytes = vec![
        0x05, 0x01, 0x09, 0x08, 0xA1, 0x01, 0x85, 0x01, 0x16, 0xA2, 0xFE, 0x26, 0x5E, 0x01, 0x75,
        0x10, 0x95, 0x06,
    ];
    bytes.extend((0x30..=0x35).flat_map(|usage| [0x09, usage]));
    bytes.extend([0x81, 0x02]);
    bytes.extend([
        0x85, 0x03, 0x05, 0x09, 0x19, 0x01, 0x29, 0x10, 0x15, 0x00, 0x25, 0x01, 0x75, 0x01, 0x95,
        0x10, 0x81, 0x02,
    ]);
    bytes.extend([
        0x85, 0x04, 0x05, 0x08, 0x09, 0x4B, 0x95, 0x01, 0x91, 0x02, 0x75, 0x07, 0x91, 0x03, 0xC0,
    ]);
    bytes
}

/// The arm's end of a HID device.
pub struct Uhid {
    identity: HidIdentity,
    file: File,
    event: Box<[u8; EVENT_BYTES]>,
    plugged: bool,
    gone: bool,
}

impl Uhid {
    /// Makes the device.
    ///
    /// # Errors
    /// `/dev/uhid` is not there or may not be opened, or the kernel refuses the descriptor.
    pub fn new(identity: HidIdentity) -> Result<Self, LinkError> {
        Self::open(identity, Path::new("/dev/uhid"))
    }

    fn open(identity: HidIdentity, path: &Path) -> Result<Self, LinkError> {
        let fd: OwnedFd = rustix::fs::open(
            path,
            OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC,
            Mode::empty(),
        )
        .map_err(|errno| LinkError::Node {
            what: format!("open {}", path.display()),
            cause: errno.into(),
        })?;
        let mut uhid = Self {
            identity,
            file: File::from(fd),
            event: Box::new([0; EVENT_BYTES]),
            plugged: false,
            gone: false,
        };
        uhid.replug()?;
        Ok(uhid)
    }

    fn write(&mut self, bytes: &[u8]) -> bool {
        matches!(self.file.write(bytes), Ok(n) if n == bytes.len())
    }

    /// Answers requests on the control endpoint, which these arms do not have.
    fn refuse(&mut self, reply: u32) {
        let mut bytes = reply.to_ne_bytes().to_vec();
        bytes.extend_from_slice(&self.event[4..8]);
        bytes.extend(EIO.to_ne_bytes());
        if reply == GET_REPORT_REPLY {
            bytes.extend(0u16.to_ne_bytes());
        }
        let _ = self.write(&bytes);
    }
}

/// The event that makes a device.
fn create_event(identity: &HidIdentity) -> Vec<u8> {
    let mut bytes = CREATE2.to_ne_bytes().to_vec();
    for (text, room) in
        [(identity.name.as_str(), 128), ("hapticd-mock", 64), (identity.serial.as_str(), 64)]
    {
        let end = bytes.len() + room;
        // The last byte stays zero.
        bytes.extend(text.bytes().take(room - 1));
        bytes.resize(end, 0);
    }
    bytes.extend((identity.descriptor.len() as u16).to_ne_bytes());
    bytes.extend(BUS_USB.to_ne_bytes());
    for number in [identity.vendor_id.into(), identity.product_id.into(), 0u32, 0] {
        bytes.extend(number.to_ne_bytes());
    }
    bytes.extend(&identity.descriptor);
    bytes.resize(EVENT_BYTES, 0);
    bytes
}

/// The event that reports.
fn input_event(frame: &[u8]) -> Vec<u8> {
    let frame = &frame[..frame.len().min(DATA_MAX)];
    let mut bytes = INPUT2.to_ne_bytes().to_vec();
    bytes.extend((frame.len() as u16).to_ne_bytes());
    bytes.extend(frame);
    bytes
}

/// The report in an output event: data, its length, its kind.
fn output_of(event: &[u8]) -> Option<&[u8]> {
    let length = u16::from_ne_bytes([*event.get(4 + DATA_MAX)?, *event.get(5 + DATA_MAX)?]);
    event.get(4..4 + usize::from(length).min(DATA_MAX))
}

impl ArmLink for Uhid {
    fn wait(&mut self, timeout: Duration) {
        wait_for(&self.file, timeout);
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        // One event for each read; those that are not for the arm are few.
        while let Ok(n) = rustix::io::read(&self.file, &mut self.event[..]) {
            if n < 4 {
                return 0;
            }
            match u32::from_ne_bytes([self.event[0], self.event[1], self.event[2], self.event[3]]) {
                OUTPUT => {
                    let Some(report) = output_of(&self.event[..n]) else { continue };
                    let taken = report.len().min(buffer.len());
                    buffer[..taken].copy_from_slice(&report[..taken]);
                    return taken;
                }
                OPEN => self.gone = false,
                CLOSE => self.gone = true,
                GET_REPORT => self.refuse(GET_REPORT_REPLY),
                SET_REPORT => self.refuse(SET_REPORT_REPLY),
                _ => {}
            }
        }
        0
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        self.plugged && self.write(&input_event(frame))
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        if self.plugged {
            self.plugged = false;
            self.write(&DESTROY.to_ne_bytes());
        }
        Ok(())
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        if !self.plugged {
            let event = create_event(&self.identity);
            self.file.write_all(&event).map_err(|cause| LinkError::Node {
                what: "make a HID device through /dev/uhid".to_owned(),
                cause,
            })?;
            self.plugged = true;
        }
        Ok(())
    }

    fn is_host_gone(&self) -> bool {
        self.gone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hex(text: &str) -> Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect()
    }

    #[test]
    fn descriptors_are_those_of_the_devices() {
        let vendor =
            "06 AB FF 0A 00 02 A1 01 75 08 15 00 26 FF 00 95 40 09 01 81 02 95 40 09 02 91 02 C0";
        assert_eq!(vendor_descriptor((0xFFAB, 0x0200), (None, 64), (None, 64)), hex(vendor));
        let numbered = vendor_descriptor((0xFF6F, 0x36), (Some(3), 8), (Some(4), 2));
        assert_eq!(numbered[..6], hex("06 6F FF 0A 36 00"));
        assert_eq!(numbered[15..], hex("85 03 95 08 09 01 81 02 85 04 95 02 09 02 91 02 C0"));
        let combined = "05 01 09 08 A1 01 85 01 16 A2 FE 26 5E 01 75 10 95 06 09 30 09 31 09 32 09 \
            33 09 34 09 35 81 02 85 03 05 09 19 01 29 10 15 00 25 01 75 01 95 10 81 02 85 04 05 08 \
            09 4B 95 01 91 02 75 07 91 03 C0";
        assert_eq!(space_mouse_descriptor(), hex(combined));
    }

    #[test]
    fn events_are_laid_out_as_the_kernel_reads_them() {
        let identity = HidIdentity {
            name: "arm".repeat(60),
            serial: "0001".to_owned(),
            vendor_id: 0x1234,
            product_id: 0x0006,
            descriptor: vendor_descriptor((0xFFAB, 0x0200), (None, 8), (None, 8)),
        };
        let event = create_event(&identity);
        assert_eq!(event.len(), 4376);
        assert_eq!((&event[..4], event[4 + 127]), (&[11, 0, 0, 0][..], 0));
        // 4 + 128 + 64: the serial; 64 after it: length of the descriptor, bus, vendor, product.
        assert_eq!(&event[196..201], b"0001\0");
        assert_eq!(event[260..272], [28, 0, 3, 0, 0x34, 0x12, 0, 0, 6, 0, 0, 0]);
        assert_eq!(event[280..308], identity.descriptor[..]);
        assert_eq!(input_event(&[7, 8, 9]), [12, 0, 0, 0, 3, 0, 7, 8, 9]);
        let mut output = vec![0; 4 + DATA_MAX + 3];
        output[4..7].copy_from_slice(&[0, 1, 2]);
        output[4 + DATA_MAX] = 3;
        assert_eq!(output_of(&output), Some(&[0, 1, 2][..]));
        assert_eq!(output_of(&output[..100]), None);
    }
}
