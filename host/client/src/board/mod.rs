//! A board on a port.
//!
//! | room | idea |
//! | --- | --- |
//! | [`link`] | the link to a board, and its calls |
//! | [`port`] | which board is meant |
//! | [`mod@line`] | how a control's line is set, by listening |
//! | [`selftest`] | the table that a board's self-test prints |

pub mod line;
pub mod link;
pub mod port;
pub mod selftest;
