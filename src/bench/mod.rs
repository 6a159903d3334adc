//! Measuring generation beside the paper and beside other programs.
//!
//! [`stand_ins`] makes the models.

mod random;
pub mod stand_ins;
