//! Framings of described packets: bodies into frames and out of streams. RT: safe.

use super::gather::Gather;
use super::layout::{BODY_MAX, Framing, LineFraming, Packet};
use super::number::pad;
use crate::transport::{FRAME_MAX, Frame};

const SLIP_END: u8 = 0xC0;
const SLIP_ESCAPE: u8 = 0xDB;
const SLIP_ESCAPED_END: u8 = 0xDC;
const SLIP_ESCAPED_ESCAPE: u8 = 0xDD;

/// Ends a line that has its numbers.
pub(super) fn close_line(line: &LineFraming, frame: &mut Frame) {
    if let Some(filler) = line.pad.filter(|filler| filler.before_close) {
        pad(frame, filler.byte, filler.len.saturating_sub(line.close.len()));
    }
    frame.extend(line.close.as_bytes());
    if let Some(filler) = line.pad.filter(|filler| !filler.before_close) {
        pad(frame, filler.byte, filler.len);
    }
}

fn checksum(packet: &Packet, body: &[u8]) -> u32 {
    let sync = match &packet.framing {
        Framing::Sync { sync, covers_sync: true, .. } => sync.as_slice(),
        _ => &[],
    };
    packet.checksum.map_or(0, |checksum| checksum.kind.compute([sync, body]))
}

/// Where the checksum of a body begins.
fn split(packet: &Packet, body: &[u8]) -> usize {
    body.len().saturating_sub(packet.checksum.map_or(0, |checksum| checksum.kind.n_bytes()))
}

fn order(packet: &Packet, value: u32) -> ([u8; 4], usize) {
    let Some(checksum) = packet.checksum else { return ([0; 4], 0) };
    let n = checksum.kind.n_bytes();
    let mut bytes = value.to_le_bytes();
    if checksum.big_endian {
        bytes[..n].reverse();
    }
    (bytes, n)
}

/// Completes a body with its checksum and appends it in its framing.
pub(super) fn put_body(packet: &Packet, body: &mut [u8], from_host: bool, frame: &mut Frame) {
    let at = split(packet, body);
    let (check, n) = order(packet, checksum(packet, &body[..at]));
    for (slot, byte) in body[at..].iter_mut().zip(&check[..n]) {
        *slot = *byte;
    }
    match &packet.framing {
        Framing::Report { id, .. } => {
            if from_host || id.is_some() {
                frame.push(id.unwrap_or(0));
            }
            frame.extend(body);
        }
        Framing::Sync { sync, .. } => {
            frame.extend(sync);
            frame.extend(body);
        }
        Framing::Cobs { .. } => {
            let mut stuffed = [0; BODY_MAX + 2];
            if let Ok(n) = cobs::try_encode(body, &mut stuffed) {
                frame.extend(&stuffed[..n]);
                frame.push(0);
            }
        }
        Framing::Slip { .. } => {
            for byte in body.iter() {
                match *byte {
                    SLIP_END => frame.extend(&[SLIP_ESCAPE, SLIP_ESCAPED_END]),
                    SLIP_ESCAPE => frame.extend(&[SLIP_ESCAPE, SLIP_ESCAPED_ESCAPE]),
                    byte => frame.push(byte),
                };
            }
            frame.push(SLIP_END);
        }
        Framing::Line(_) => {}
    }
}

/// Takes the escapes out in place; `None` where there is one that means nothing.
fn unslip(bytes: &mut [u8]) -> Option<usize> {
    let mut n = 0;
    let mut escaped = false;
    for at in 0..bytes.len() {
        let byte = match (escaped, bytes[at]) {
            (false, SLIP_ESCAPE) => {
                escaped = true;
                continue;
            }
            (false, byte) => byte,
            (true, SLIP_ESCAPED_END) => SLIP_END,
            (true, SLIP_ESCAPED_ESCAPE) => SLIP_ESCAPE,
            (true, _) => return None,
        };
        escaped = false;
        bytes[n] = byte;
        n += 1;
    }
    (!escaped).then_some(n)
}

/// Finds the bodies of one packet in what a link delivers.
#[derive(Debug, Default)]
pub(super) struct FrameReader {
    gather: Gather<FRAME_MAX>,
}

impl FrameReader {
    pub(super) fn clear(&mut self) {
        self.gather.clear();
    }

    /// Takes bytes, hands each body whose check is right to `take`, which says whether it makes
    /// sense; gives how many did not.
    pub(super) fn feed(
        &mut self,
        packet: &Packet,
        bytes: &[u8],
        at_host: bool,
        mut take: impl FnMut(&[u8]) -> bool,
    ) -> u32 {
        let mut accept = |body: &[u8]| {
            let at = split(packet, body);
            let (check, n) = order(packet, checksum(packet, &body[..at]));
            body.len() == packet.n_bytes() && body[at..] == check[..n] && take(body)
        };
        match &packet.framing {
            Framing::Report { id, len } => {
                let body = match (id, bytes) {
                    (Some(id), [first, body @ ..]) if first == id => body,
                    // Another numbered report, of which nothing is said.
                    (Some(_), [_, ..]) => return 0,
                    (None, [0, body @ ..]) if !at_host && body.len() == *len => body,
                    _ => bytes,
                };
                u32::from(!accept(body))
            }
            Framing::Sync { sync, len, .. } => self.feed_sync(sync, *len, bytes, accept),
            Framing::Cobs { .. } => {
                self.feed_ended(0, bytes, |frame| match cobs::decode_in_place(frame) {
                    Ok(n) => accept(&frame[..n]),
                    Err(_) => false,
                })
            }
            Framing::Slip { .. } => self.feed_ended(SLIP_END, bytes, |frame| {
                unslip(frame).is_some_and(|n| accept(&frame[..n]))
            }),
            Framing::Line(line) => {
                // Blanks behind the end belong to what is between frames.
                let close = match line.close.as_bytes().trim_ascii_end() {
                    [] => line.close.as_bytes(),
                    close => close,
                };
                let Some((end, rest)) = close.split_last() else { return 0 };
                let mut corrupt = 0;
                for byte in bytes {
                    corrupt += match self.gather.until(*end, *byte) {
                        Some(true) => Self::line(line, rest, self.gather.as_slice(), &mut take),
                        Some(false) => 1,
                        None => 0,
                    };
                }
                corrupt
            }
        }
    }

    fn line(
        line: &LineFraming,
        rest: &[u8],
        found: &[u8],
        take: &mut impl FnMut(&[u8]) -> bool,
    ) -> u32 {
        let is_blank = |byte: &u8| matches!(byte, b' ' | b'\r' | b'\n' | b'\t' | 0);
        let open = line.open.as_bytes();
        let begin = if open.is_empty() {
            found.iter().position(|byte| !is_blank(byte)).unwrap_or(found.len())
        } else {
            match found.windows(open.len()).rposition(|window| window == open) {
                Some(at) => at + open.len(),
                None => return 1,
            }
        };
        // What stands before the last opening is the remains of another line.
        let before = &found[..begin.saturating_sub(open.len())];
        let dirty = u32::from(!open.is_empty() && !before.iter().all(is_blank));
        let Some(body) = found[begin..].strip_suffix(rest) else { return 1 + dirty };
        let body = if line.separator == b' ' { body.trim_ascii() } else { body };
        dirty + u32::from(!take(body))
    }

    fn feed_ended(
        &mut self,
        end: u8,
        bytes: &[u8],
        mut accept: impl FnMut(&mut [u8]) -> bool,
    ) -> u32 {
        let mut corrupt = 0;
        for byte in bytes {
            match self.gather.until(end, *byte) {
                Some(true) if self.gather.as_slice().is_empty() => {}
                Some(true) => corrupt += u32::from(!accept(self.gather.as_mut_slice())),
                Some(false) => corrupt += 1,
                None => {}
            }
        }
        corrupt
    }

    fn feed_sync(
        &mut self,
        sync: &[u8],
        len: usize,
        bytes: &[u8],
        mut accept: impl FnMut(&[u8]) -> bool,
    ) -> u32 {
        let mut corrupt = 0;
        let mut dropped = false;
        for byte in bytes {
            if !self.gather.push(*byte) {
                // A layout that was not checked: longer than any frame.
                self.gather.clear();
            }
            loop {
                let waiting = self.gather.as_slice();
                let n = waiting.len().min(sync.len());
                if waiting[..n] != sync[..n] {
                    dropped = true;
                    self.gather.drop_front(1);
                    continue;
                }
                if waiting.len() < sync.len() + len || waiting.is_empty() {
                    break;
                }
                if accept(&waiting[sync.len()..sync.len() + len]) {
                    self.gather.drop_front((sync.len() + len).max(1));
                } else {
                    corrupt += 1;
                    self.gather.drop_front(1);
                }
            }
        }
        corrupt + u32::from(dropped && corrupt == 0)
    }
}
