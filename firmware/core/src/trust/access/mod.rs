//! Who may do what with a board: pure state, without flash, clock or randomness of its own.
//!
//! | file | idea |
//! | --- | --- |
//! | [`permit`] | what the protocol's table and the mode say to a request |
//! | [`register`] | the keys that a board knows, its lock, and what a wipe leaves |
//! | [`session`] | how a key is proven and frames are sealed; both ends |
//! | [`tries`] | how wrong keys are slowed |
//! | [`update`] | signed images, and the slots that they run from |

pub mod permit;
pub mod register;
pub mod session;
pub mod tries;
pub mod update;
