//! What the supervisor wants of the servo: one byte.

use core::sync::atomic::{AtomicU8, Ordering};

use crate::haptics::DriveRequest;

/// An order of the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Order {
    /// No force.
    Disable = 0,
    /// Ramp up and render.
    Enable = 1,
    /// Ramp down to zero, then end the loop.
    Stop = 2,
    /// End the loop now, without a ramp; the arm still gets its zero command.
    Quit = 3,
}

impl Order {
    /// What the tick is told.
    pub const fn request(self) -> DriveRequest {
        match self {
            Self::Disable => DriveRequest::Disable,
            Self::Enable => DriveRequest::Enable,
            Self::Stop | Self::Quit => DriveRequest::Stop,
        }
    }
}

/// The newest order. Latest value wins; shared between the supervisor (writes) and the servo (reads).
///
/// Both orderings are `Relaxed`: the byte is the whole message and publishes no other memory, so there is nothing for an
/// acquire/release pair to order. The store becomes visible to the servo's load within one tick.
#[derive(Debug)]
pub struct Control(AtomicU8);

impl Control {
    /// A control with its first order.
    pub const fn new(order: Order) -> Self {
        Self(AtomicU8::new(order as u8))
    }

    /// Gives an order. Partner: the load in [`Control::order`].
    pub fn give(&self, order: Order) {
        self.0.store(order as u8, Ordering::Relaxed);
    }

    /// The newest order. RT: safe. Partner: the store in [`Control::give`].
    pub fn order(&self) -> Order {
        match self.0.load(Ordering::Relaxed) {
            0 => Order::Disable,
            1 => Order::Enable,
            2 => Order::Stop,
            // Only `give` stores, so this is 3; were it anything else, ending is the safe reading.
            _ => Order::Quit,
        }
    }
}
