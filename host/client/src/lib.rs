//! An openumi board from a PC, without a terminal.
//!
//! | room | idea |
//! | --- | --- |
//! | [`problem`] | what is wrong and what to do, with a stable code |
//! | [`link`], [`port`] | the link to a board: its calls; which board is meant |
//! | [`journal`] | a board's journal pulled, verified and audited |
//! | [`mod@line`] | how a control's line is set, by listening |
//! | [`programs`] | part programs to a board and back |
//! | [`files`] | job files, point files, tool paths |
//! | [`correction`] | the rigid motion of a verdict, and its program |
//! | [`guards`] | what a job sees of what can go wrong, and from how many micrometres on |
//! | [`axes`], [`quantities`] | counts as millimetres; results with names, units and uncertainties |
//! | [`timeline`] | a board's events in order; each loss stands where it happened |
//! | [`session`] | the records of a session: what a report is made from |

pub mod axes;
pub mod correction;
pub mod files;
pub mod guards;
pub mod journal;
pub mod line;
pub mod link;
pub mod port;
pub mod problem;
pub mod programs;
pub mod quantities;
pub mod selftest;
pub mod session;
pub mod timeline;
