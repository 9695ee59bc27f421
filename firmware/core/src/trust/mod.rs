//! Who may, and what is genuine.
//!
//! | room | idea |
//! | --- | --- |
//! | [`board_key`] | the board's own key, and what it signs |
//! | [`entropy`] | noise, tested and conditioned |
//! | [`access`] | the keys of people, their roles, sessions and tries; updates |

pub mod access;
pub mod board_key;
pub mod entropy;
