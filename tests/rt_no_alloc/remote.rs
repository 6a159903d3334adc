//! Both ends of a link to another machine.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use arms::protocol::{Codec as _, MotorCommand};
use arms::remote::command_hold::HoldTiming;
use arms::remote::figures::LinkPhase;
use arms::remote::{LinkFigures, Node, NodeParameters, RemoteHost};
use arms::simulated::{SimArm, SimParameters};
use arms::transport::{Frame, Transport, TransportError};
use rtrb::{Consumer, Producer, RingBuffer};
use vps::spatial::Axes;

use super::counted;

const T: f64 = 1e-3;

/// One end of two rings: what a link in memory needs to allocate nothing.
struct RingEnd {
    from: Consumer<Frame>,
    to: Producer<Frame>,
}

impl Transport for RingEnd {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let Ok(frame) = self.from.pop() else { return Ok(0) };
        let bytes = frame.as_slice();
        buffer[..bytes.len()].copy_from_slice(bytes);
        Ok(bytes.len())
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        let mut sent = Frame::default();
        sent.extend(frame);
        self.to.push(sent).map_err(|_| TransportError::Full)
    }

    fn unread(&mut self) -> usize {
        0
    }
}

fn ends() -> (RingEnd, RingEnd) {
    let (to_arm, at_arm) = RingBuffer::new(64);
    let (to_host, at_host) = RingBuffer::new(64);
    (RingEnd { from: at_host, to: to_arm }, RingEnd { from: at_arm, to: to_host })
}

#[test]
fn both_ends_of_a_network_allocate_nothing() {
    let (mut end, arm_end) = ends();
    let parameters = NodeParameters {
        name: "arm".into(),
        sensed: Axes::SIX,
        actuated: Axes::SIX,
        period_s: T,
        force_limit_n: 5.0,
        torque_limit_nm: 0.1,
        workspace_radius_m: 0.1,
        timing: HoldTiming { hold_s: 10e-3, fade_s: 20e-3 },
        deadman: None,
        starts_with_host: true,
    };
    let mut node = Node::new(parameters, Box::new(arm_end));
    let mut arm = SimArm::new(SimParameters::ideal(T)).expect("an arm");
    // The greeting is cold, and takes two.
    let greeted = Arc::new(AtomicBool::new(false));
    let heard = greeted.clone();
    let beside = std::thread::spawn(move || {
        let mut n = 0;
        while !heard.load(Ordering::Relaxed) {
            n += 1;
            node.step(f64::from(n) * T, &mut arm);
            std::thread::sleep(Duration::from_millis(1));
        }
        (node, arm, n)
    });
    let mut host =
        RemoteHost::new(Axes::SIX, Axes::SIX, T, 7 << 16, Arc::new(LinkFigures::default()));
    host.start(&mut end).expect("greeted");
    greeted.store(true, Ordering::Relaxed);
    let (mut node, mut arm, first) = beside.join().expect("no panic");
    let figures = node.figures();

    let mut frame = Frame::default();
    let mut buffer = [0; 256];
    let mut was = [false; 5];
    let ((), allocations, frees) = counted(|| {
        for n in 0..50_000 {
            let now_s = f64::from(first + n) * T;
            host.tell_time(now_s);
            while let Ok(n @ 1..) = end.receive(&mut buffer) {
                host.feed(&buffer[..n]);
            }
            // Force, silence, and the way back.
            let turn = n % 500;
            let enabled = (50..450).contains(&turn);
            if !(200..300).contains(&turn) {
                host.encode(&MotorCommand::at_rest(enabled), &mut frame);
                let _ = end.send(frame.as_slice());
            }
            node.step(now_s, &mut arm);
            was[figures.phase() as usize] = true;
        }
    });
    assert_eq!((allocations, frees), (0, 0));
    assert!(
        was[LinkPhase::Disabled as usize]
            && was[LinkPhase::Enabled as usize]
            && was[LinkPhase::Tripped as usize],
        "{was:?}"
    );
    assert_eq!(figures.report().link_losses, 100);
}
