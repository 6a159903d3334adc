//! The studio: a piece on the table, a craft in the hand.
//!
//! Data in: what the tool does, tick by tick, and [`Order`]s of people, pages and scripts. Data out: frames for the loop, [`View`]s for those
//! who look.
//!
//! ```text
//!  ToolState ─► craft: push, pull, paint, … ─┐
//!  Order ─► undo, emboss, combine, save, … ──┴─► Workpiece ─► Frame (to the loop), View (to whoever looks)
//! ```

mod craft;
mod order;
mod view;

pub use craft::{Craft, ToolSettings};
pub use order::Order;
pub use view::View;
