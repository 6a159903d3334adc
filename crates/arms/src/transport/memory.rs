//! A link in memory: two ends, no system call.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::{Carriage, Transport, TransportError};

#[derive(Debug, Default)]
struct Wire {
    to_arm: VecDeque<Vec<u8>>,
    to_host: VecDeque<Vec<u8>>,
    cut: bool,
    /// Bytes that the way to the arm holds; `None`: all.
    room: Option<usize>,
    /// The host sees what the arm has not read. The system shows it of some links only.
    shows_unread: bool,
}

/// One end of a link in memory, for tests and for simulated arms that speak a real protocol. Not
/// for a real-time loop: it locks.
#[derive(Clone, Debug)]
pub struct LoopbackEnd {
    wire: Arc<Mutex<Wire>>,
    carriage: Carriage,
    is_arm: bool,
}

/// Two ends of one link: the host's and the arm's.
pub fn loopback(carriage: Carriage) -> (LoopbackEnd, LoopbackEnd) {
    let wire = Arc::new(Mutex::new(Wire::default()));
    (
        LoopbackEnd { wire: wire.clone(), carriage, is_arm: false },
        LoopbackEnd { wire, carriage, is_arm: true },
    )
}

impl LoopbackEnd {
    /// Gives the way to the arm an end: more than `room` unread bytes do not fit.
    #[cfg(test)]
    pub(crate) fn limit(&self, room: usize) {
        if let Ok(mut wire) = self.wire.lock() {
            wire.room = Some(room);
        }
    }

    /// Lets the host see from now on what the arm has not read.
    #[cfg(test)]
    pub(crate) fn show_unread(&self) {
        if let Ok(mut wire) = self.wire.lock() {
            wire.shows_unread = true;
        }
    }

    /// Pulls the plug: both ends are lost from now on.
    pub fn cut(&self) {
        if let Ok(mut wire) = self.wire.lock() {
            wire.cut = true;
        }
    }
}

impl Transport for LoopbackEnd {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let Ok(mut wire) = self.wire.lock() else { return Err(TransportError::Lost) };
        if wire.cut {
            return Err(TransportError::Lost);
        }
        let queue = if self.is_arm { &mut wire.to_arm } else { &mut wire.to_host };
        let mut taken = 0;
        while let Some(mut frame) = queue.pop_front() {
            let n = frame.len().min(buffer.len() - taken);
            buffer[taken..taken + n].copy_from_slice(&frame[..n]);
            taken += n;
            match self.carriage {
                Carriage::Reports => return Ok(taken),
                Carriage::Stream if n < frame.len() => {
                    frame.drain(..n);
                    queue.push_front(frame);
                    return Ok(taken);
                }
                Carriage::Stream => {}
            }
        }
        Ok(taken)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        let Ok(mut wire) = self.wire.lock() else { return Err(TransportError::Lost) };
        if wire.cut {
            return Err(TransportError::Lost);
        }
        if self.is_arm {
            wire.to_host.push_back(frame.to_vec());
            return Ok(());
        }
        let waiting: usize = wire.to_arm.iter().map(Vec::len).sum();
        if wire.room.is_some_and(|room| waiting + frame.len() > room) {
            return Err(TransportError::Full);
        }
        wire.to_arm.push_back(frame.to_vec());
        Ok(())
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        if let Ok(mut wire) = self.wire.lock() {
            if self.is_arm { wire.to_host.clear() } else { wire.to_arm.clear() }
        }
        self.send(frame)
    }

    fn unread(&mut self) -> usize {
        self.wire.lock().map_or(0, |wire| if wire.shows_unread { wire.to_arm.len() } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_stay_whole_and_streams_do_not() {
        let (mut host, mut arm) = loopback(Carriage::Reports);
        arm.send(&[1, 2, 3]).expect("open");
        arm.send(&[4]).expect("open");
        let mut buffer = [0; 8];
        assert_eq!(host.receive(&mut buffer), Ok(3));
        assert_eq!(host.receive(&mut buffer), Ok(1));
        assert_eq!(host.receive(&mut buffer), Ok(0));

        let (mut host, mut arm) = loopback(Carriage::Stream);
        host.send(&[1, 2, 3]).expect("open");
        host.send(&[4]).expect("open");
        let mut small = [0; 2];
        assert_eq!((arm.receive(&mut small), small), (Ok(2), [1, 2]));
        assert_eq!((arm.receive(&mut buffer), &buffer[..2]), (Ok(2), &[3, 4][..]));
        arm.cut();
        assert_eq!(host.receive(&mut buffer), Err(TransportError::Lost));
        assert_eq!(host.send(&[1]), Err(TransportError::Lost));
    }
}
