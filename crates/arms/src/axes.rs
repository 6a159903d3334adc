//! How many axes an arm can have.

/// Most readings and motors that an arm can have: seven joints and a gripper; a Cartesian pose
/// takes seven.
pub const MAX_AXES: usize = 8;
