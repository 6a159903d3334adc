//! The loop's control word: whether force may flow, and whether the loop is to end.
//!
//! Every source of "off" (a signal, a client, a heartbeat that is missing, the console) holds the
//! word itself and takes force away with one atomic operation. Nothing in between can be late: no
//! thread, no queue, no lock. Only the way back is slow on purpose: force is allowed by a
//! [`Permit`] that was drawn before, and a permit is worthless once any source has said "off" after
//! it was drawn.
//!
//! ```text
//!  disable()   offs += 1                     order() = Quit     if end = 2
//!  permit()    Permit(offs)                          Stop       if end = 1
//!  renew(p)    offs = p + 1 if offs = p, else no     Enable     if allowed = offs + 1
//!  enable(p)   allowed = max(allowed, p + 1)         Disable    else
//!  stop()      end = max(end, 1)
//! ```
//! All operations are `Relaxed`: each word is the whole message and publishes no other memory. A
//! store becomes visible to the loop within one tick. `tests/loom` includes this file and checks it
//! under every interleaving.

use super::atomics::{AtomicU8, AtomicU64, Ordering};

/// What the loop is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// No force.
    Disable,
    /// Ramp up and render.
    Enable,
    /// Ramp down to zero, then end the loop.
    Stop,
    /// End the loop now, without a ramp; the arm still gets its zero command.
    Quit,
}

/// Leave to let force flow, until force is taken away after it was drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Permit(u64);

impl Permit {
    /// Drawn before any source could take force away: for the start of a run.
    pub const FIRST: Self = Self(0);
}

const STOP: u8 = 1;
const QUIT: u8 = 2;

/// The control word of one loop, shared by the loop (reads) and everything that may take force away
/// (writes).
#[derive(Debug)]
pub struct Control {
    /// How often force was taken away.
    offs: AtomicU64,
    /// The number of `offs` for which force is allowed, plus 1; 0: force was never allowed. It only
    /// grows.
    allowed: AtomicU64,
    /// How the loop is to end; it only grows.
    end: AtomicU8,
}

impl Default for Control {
    fn default() -> Self {
        Self::new()
    }
}

impl Control {
    /// A control without force.
    pub fn new() -> Self {
        Self { offs: AtomicU64::new(0), allowed: AtomicU64::new(0), end: AtomicU8::new(0) }
    }

    /// A control under which force flows at once: for runs without a person.
    pub fn enabled() -> Self {
        let control = Self::new();
        control.enable(Permit::FIRST);
        control
    }

    /// Takes force away, without a ramp. Wait-free; safe in a signal handler.
    pub fn disable(&self) {
        self.offs.fetch_add(1, Ordering::Relaxed);
    }

    /// Lets force ramp down and the loop end. Wait-free; safe in a signal handler. It cannot be
    /// taken back.
    pub fn stop(&self) {
        self.end.fetch_max(STOP, Ordering::Relaxed);
    }

    /// Ends the loop in the next tick, without a ramp. Wait-free; safe in a signal handler. It
    /// cannot be taken back.
    pub fn quit(&self) {
        self.end.fetch_max(QUIT, Ordering::Relaxed);
    }

    /// A person asks for an end: the first time with a ramp, after that at once. Safe in a signal
    /// handler.
    pub fn interrupt(&self) {
        if self.end.fetch_max(STOP, Ordering::Relaxed) >= STOP {
            self.quit();
        }
    }

    /// Leave to let force flow if it is not taken away until [`Self::enable`].
    pub fn permit(&self) -> Permit {
        Permit(self.offs.load(Ordering::Relaxed))
    }

    /// Takes force away on the way to letting it flow from zero: the permit for that, unless a
    /// source has taken force away since `asked` was drawn.
    pub fn renew(&self, asked: Permit) -> Option<Permit> {
        let next = asked.0.wrapping_add(1);
        let renewed =
            self.offs.compare_exchange(asked.0, next, Ordering::Relaxed, Ordering::Relaxed);
        renewed.is_ok().then_some(Permit(next))
    }

    /// Lets force flow, unless it was taken away since the permit was drawn. A permit that is older
    /// than the one that counts has no effect.
    pub fn enable(&self, permit: Permit) {
        self.allowed.fetch_max(permit.0.saturating_add(1), Ordering::Relaxed);
    }

    /// What the loop is to do now. RT: safe.
    pub fn order(&self) -> Order {
        match self.end.load(Ordering::Relaxed) {
            0 if self.allows_force() => Order::Enable,
            0 => Order::Disable,
            STOP => Order::Stop,
            _ => Order::Quit,
        }
    }

    /// Force was not taken away since it was allowed: a stop may end in a ramp. RT: safe.
    pub fn allows_force(&self) -> bool {
        let allowed = self.allowed.load(Ordering::Relaxed);
        allowed.checked_sub(1) == Some(self.offs.load(Ordering::Relaxed))
    }

    /// The loop is to end.
    pub fn is_ending(&self) -> bool {
        matches!(self.order(), Order::Stop | Order::Quit)
    }
}
