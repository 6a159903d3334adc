//! USB bulk transfers to an FTDI chip, without a tty: the Novint Falcon. Cargo feature `usb`.
//!
//! The chip's lines, divisors and latency timer are vendor requests (devices reference, sections
//! 4.3 and 5.G). Each packet that it sends starts with two bytes of modem status, also when it
//! carries nothing else. Two [threads](super::threaded) move the bytes, as nusb allocates.

use core::time::Duration;

use nusb::transfer::{Buffer, Bulk, ControlOut, ControlType, In, Out, Recipient, TransferError};
use nusb::{Endpoint, Interface, MaybeFuture};

use super::threaded::{Disconnected, Sink, Source, Threaded};
use super::{FRAME_MAX, Line, Transport, TransportError};
use crate::IoPlacement;
use rt::schedule::ThreadRequest;

/// Endpoint from the arm.
const ENDPOINT_IN: u8 = 0x81;
/// Endpoint to the arm.
const ENDPOINT_OUT: u8 = 0x02;
/// Bytes of a packet at full speed.
const PACKET: usize = 64;
/// Bytes of modem status before the data of a packet.
const MODEM_STATUS: usize = 2;
/// Clock of the baud rate generator, in eighths of its step: 24 MHz.
const BAUD_CLOCK_EIGHTHS: u32 = 24_000_000;
/// How long a vendor request may take.
const REQUEST_PATIENCE: Duration = Duration::from_millis(500);
/// How long a write may take before the arm counts as gone.
const WRITE_PATIENCE: Duration = Duration::from_millis(500);

/// Why the device cannot be opened. Cold.
#[derive(Debug, thiserror::Error)]
pub enum UsbError {
    /// No such device on the bus.
    #[error("no USB device {vendor_id:04x}:{product_id:04x} is attached")]
    Missing {
        /// Vendor.
        vendor_id: u16,
        /// Product.
        product_id: u16,
    },
    /// The system refused.
    #[error(
        "cannot open the USB device: {0}; install devices/udev/70-hapticd.rules and replug (see \
            `hapticd doctor`)"
    )]
    Open(#[from] nusb::Error),
    /// No thread, no eventfd.
    #[error("cannot start the threads of the USB device: {0}")]
    Thread(std::io::Error),
}

/// An open FTDI chip.
pub(crate) struct UsbLink {
    interface: Interface,
    threads: Threaded,
}

impl UsbLink {
    /// Opens the first device of these numbers, and of this serial number if one is given; takes
    /// its interface 0 away from a kernel driver that holds it. Cold.
    ///
    /// # Errors
    /// See [`UsbError`].
    pub(crate) fn open(
        vendor_id: u16,
        product_id: u16,
        serial: Option<&str>,
        request: Option<ThreadRequest>,
    ) -> Result<Self, UsbError> {
        let info = nusb::list_devices()
            .wait()?
            .find(|info| {
                info.vendor_id() == vendor_id
                    && info.product_id() == product_id
                    && serial.is_none_or(|serial| info.serial_number() == Some(serial))
            })
            .ok_or(UsbError::Missing { vendor_id, product_id })?;
        let interface = info.open().wait()?.detach_and_claim_interface(0).wait()?;
        let source = Packets(interface.endpoint::<Bulk, In>(ENDPOINT_IN)?);
        let sink = Frames(interface.endpoint::<Bulk, Out>(ENDPOINT_OUT)?);
        let threads = Threaded::start(source, sink, request).map_err(UsbError::Thread)?;
        Ok(Self { interface, threads })
    }
}

struct Packets(Endpoint<Bulk, In>);

impl Source for Packets {
    fn wait(
        &mut self,
        buffer: &mut [u8; FRAME_MAX],
        patience: Duration,
    ) -> Result<usize, Disconnected> {
        if self.0.pending() == 0 {
            self.0.submit(Buffer::new(PACKET));
        }
        // A transfer that is not done stays under way.
        let Some(completion) = self.0.wait_next_complete(patience) else { return Ok(0) };
        match completion.into_result() {
            Ok(packet) => Ok(strip_status(&packet, buffer)),
            Err(TransferError::Cancelled) => Ok(0),
            Err(_) => Err(Disconnected),
        }
    }
}

struct Frames(Endpoint<Bulk, Out>);

impl Sink for Frames {
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
        self.0
            .transfer_blocking(Buffer::from(frame), WRITE_PATIENCE)
            .into_result()
            .map(|_| ())
            .map_err(|_| Disconnected)
    }
}

/// Copies the data of a packet without its modem status; how many bytes that is.
fn strip_status(packet: &[u8], buffer: &mut [u8]) -> usize {
    let data = packet.get(MODEM_STATUS..).unwrap_or_default();
    let n = data.len().min(buffer.len());
    if let (Some(room), Some(data)) = (buffer.get_mut(..n), data.get(..n)) {
        room.copy_from_slice(data);
    }
    n
}

/// The vendor requests of a line: `bRequest` and `wValue`.
fn requests_of(line: Line) -> impl Iterator<Item = (u8, u16)> {
    let no_flow_control = matches!(line, Line::Plain8N1).then_some((2, 0));
    let request = match line {
        Line::Reset => (0, 0),
        Line::PurgeReceived => (0, 1),
        Line::PurgeSent => (0, 2),
        Line::Dtr(level) => (1, 0x0100 | u16::from(level)),
        Line::Rts(level) => (1, 0x0200 | u16::from(level) << 1),
        Line::Baud(baud) => (3, divisor(baud)),
        Line::Plain8N1 => (4, 8),
        Line::LatencyMs(latency_ms) => (9, u16::from(latency_ms)),
    };
    core::iter::once(request).chain(no_flow_control)
}

/// Divisor of 3 MHz in whole steps, with a half, a quarter or an eighth in the upper two bits.
fn divisor(baud: u32) -> u16 {
    let eighths = (BAUD_CLOCK_EIGHTHS + baud / 2) / baud.max(1);
    let (whole, code) = match eighths % 8 {
        0 => (eighths / 8, 0),
        1 => (eighths / 8, 3),
        2 | 3 => (eighths / 8, 2),
        4 | 5 => (eighths / 8, 1),
        _ => (eighths / 8 + 1, 0),
    };
    u16::try_from(whole).unwrap_or(0x3FFF) & 0x3FFF | code << 14
}

impl Transport for UsbLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        self.threads.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send(frame)
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send_now(frame)
    }

    /// The newest frame wins: but for one on the bus there is no older one.
    fn unread(&mut self) -> usize {
        0
    }

    fn line(&mut self, line: Line) -> Result<(), TransportError> {
        for (request, value) in requests_of(line) {
            let control = ControlOut {
                control_type: ControlType::Vendor,
                recipient: Recipient::Device,
                request,
                value,
                index: 0,
                data: &[],
            };
            self.interface.control_out(control, REQUEST_PATIENCE).wait().map_err(|error| {
                match error {
                    TransferError::Disconnected => TransportError::Lost,
                    TransferError::Unknown(errno) => {
                        TransportError::Os(i32::try_from(errno).unwrap_or(0))
                    }
                    _ => TransportError::Os(0),
                }
            })?;
        }
        Ok(())
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_the_published_requests() {
        let requests: [(Line, &[(u8, u16)]); 11] = [
            (Line::Reset, &[(0, 0)]),
            (Line::PurgeReceived, &[(0, 1)]),
            (Line::PurgeSent, &[(0, 2)]),
            (Line::Dtr(false), &[(1, 0x0100)]),
            (Line::Dtr(true), &[(1, 0x0101)]),
            (Line::Rts(false), &[(1, 0x0200)]),
            (Line::Baud(9600), &[(3, 0x4138)]),
            (Line::Baud(142_857), &[(3, 0x0015)]),
            (Line::Baud(1_500_000), &[(3, 0x0002)]),
            (Line::Plain8N1, &[(4, 0x0008), (2, 0)]),
            (Line::LatencyMs(16), &[(9, 16)]),
        ];
        for (line, expected) in requests {
            assert_eq!(requests_of(line).collect::<Vec<_>>(), expected, "{line:?}");
        }
    }

    #[test]
    fn modem_status_is_not_data() {
        let mut buffer = [0; 8];
        assert_eq!(strip_status(&[0x01, 0x60], &mut buffer), 0);
        assert_eq!(strip_status(&[0x01], &mut buffer), 0);
        assert_eq!(
            (strip_status(&[0x01, 0x60, 0x3C, 0x41], &mut buffer), &buffer[..2]),
            (2, &[0x3C, 0x41][..])
        );
    }
}
