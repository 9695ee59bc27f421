//! An openumi board from a PC, without a terminal.
//!
//! | room | idea |
//! | --- | --- |
//! | [`problem`] | what is wrong and what to do, with a stable code |
//! | [`board`] | a board on a port: its calls, its line, its self-test |
//! | [`journal`] | a board's journal pulled, verified and audited |
//! | [`programs`] | part programs to a board and back |
//! | [`files`] | job files, point files, tool paths |
//! | [`job`] | what a job sees of what can go wrong; the correction of a verdict, and its program |
//! | [`axes`], [`quantities`] | counts as millimetres; results with names, units and uncertainties |
//! | [`timeline`] | a board's events in order; each loss stands where it happened |
//! | [`session`] | the records of a session: what a report is made from |

pub mod axes;
pub mod board;
pub mod files;
pub mod job;
pub mod journal;
pub mod problem;
pub mod programs;
pub mod quantities;
pub mod session;
pub mod timeline;
