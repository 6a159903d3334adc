//! A network in memory: two ends, with delay, jitter, loss and a cut, in the time that the caller
//! gives. The same seed gives the same delays and losses.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{Transport, TransportError};
use crate::split_mix::SplitMix64;

/// What becomes of a datagram.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkQuality {
    /// Least time on the way, s.
    pub delay_s: f64,
    /// Most that comes on top, uniform, s. Datagrams overtake each other.
    pub jitter_s: f64,
    /// Share that never comes.
    pub loss: f64,
}

#[derive(Debug)]
struct Datagram {
    due_s: f64,
    bytes: Vec<u8>,
}

#[derive(Debug)]
struct Network {
    quality: LinkQuality,
    random: SplitMix64,
    now_s: f64,
    is_cut: bool,
    /// To the arm, to the host.
    under_way: [Vec<Datagram>; 2],
    /// When the last datagram came out at the arm's end, s.
    last_to_arm_s: f64,
}

/// The network, for the caller that drives it.
#[derive(Clone, Debug)]
pub struct SimulatedNetwork(Arc<Mutex<Network>>);

/// One end. Not for a real-time loop: it locks.
#[derive(Clone, Debug)]
pub struct NetworkEnd {
    network: SimulatedNetwork,
    is_arm: bool,
}

impl SimulatedNetwork {
    /// A network at time 0.
    pub fn new(quality: LinkQuality, seed: u64) -> Self {
        let under_way = [Vec::new(), Vec::new()];
        Self(Arc::new(Mutex::new(Network {
            quality,
            random: SplitMix64::new(seed),
            now_s: 0.0,
            is_cut: false,
            under_way,
            last_to_arm_s: 0.0,
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Network> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The host's end and the arm's.
    pub fn ends(&self) -> (NetworkEnd, NetworkEnd) {
        (
            NetworkEnd { network: self.clone(), is_arm: false },
            NetworkEnd { network: self.clone(), is_arm: true },
        )
    }

    /// Lets time pass.
    pub fn set_now(&self, now_s: f64) {
        self.lock().now_s = now_s;
    }

    /// What time it is, s.
    pub fn now_s(&self) -> f64 {
        self.lock().now_s
    }

    /// Cuts the cable, or joins it again. What was under way is gone.
    pub fn cut(&self, is_cut: bool) {
        let mut network = self.lock();
        network.is_cut = is_cut;
        network.under_way.iter_mut().for_each(Vec::clear);
    }

    /// When the last datagram reached the arm's end, s: not when it was taken, but when it came.
    pub fn last_to_arm_s(&self) -> f64 {
        self.lock().last_to_arm_s
    }
}

impl Transport for NetworkEnd {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let mut network = self.network.lock();
        let now_s = network.now_s;
        let to_host = usize::from(!self.is_arm);
        let next = network.under_way[to_host]
            .iter()
            .enumerate()
            .filter(|(_, datagram)| datagram.due_s <= now_s);
        let Some(idx) =
            next.min_by(|(_, a), (_, b)| a.due_s.total_cmp(&b.due_s)).map(|(idx, _)| idx)
        else {
            return Ok(0);
        };
        let Datagram { due_s, bytes } = network.under_way[to_host].remove(idx);
        if self.is_arm {
            network.last_to_arm_s = network.last_to_arm_s.max(due_s);
        }
        let n = bytes.len().min(buffer.len());
        buffer[..n].copy_from_slice(&bytes[..n]);
        Ok(n)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        let mut network = self.network.lock();
        let LinkQuality { delay_s, jitter_s, loss } = network.quality;
        let is_lost = network.random.unit() < loss;
        let share = network.random.unit();
        if !network.is_cut && !is_lost {
            let due_s = network.now_s + delay_s + share * jitter_s;
            network.under_way[usize::from(self.is_arm)]
                .push(Datagram { due_s, bytes: frame.to_vec() });
        }
        Ok(())
    }

    /// A network drops what is late, and a node judges the age of what comes.
    fn unread(&mut self) -> usize {
        0
    }

    fn now_ns(&self) -> i64 {
        (self.network.now_s() * 1e9).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_take_their_time_overtake_each_other_and_some_never_come() {
        let network =
            SimulatedNetwork::new(LinkQuality { delay_s: 10e-3, jitter_s: 2e-3, loss: 0.25 }, 1);
        let (mut host, mut arm) = network.ends();
        for n in 0..200_u8 {
            network.set_now(f64::from(n) * 1e-3);
            host.send(&[n]).expect("open");
        }
        let mut buffer = [0; 4];
        network.set_now(9.9e-3);
        assert_eq!(arm.receive(&mut buffer), Ok(0));
        network.set_now(1.0);
        let mut came = Vec::new();
        while arm.receive(&mut buffer) == Ok(1) {
            came.push(buffer[0]);
        }
        assert!((120..180).contains(&came.len()), "{}", came.len());
        assert!(!came.is_sorted(), "a jitter of two sending periods reorders");
        assert!(network.last_to_arm_s() > 0.2 && network.last_to_arm_s() < 0.212);
        assert_eq!(host.receive(&mut buffer), Ok(0), "nothing for the host");
        arm.send(&[1]).expect("open");
        network.cut(true);
        host.send(&[1]).expect("a cut cable says nothing");
        network.set_now(2.0);
        assert_eq!((host.receive(&mut buffer), arm.receive(&mut buffer)), (Ok(0), Ok(0)));
    }
}
