//! The receiver as a whole: the rules of the wire, captures, properties.
//!
//! Rules are those in the documentation of [`super`]. Captures: R was recorded on
//! a machine, M is printed in a maker's manual, C is constructed from the rules.

mod captures;
mod codes;
mod foreign;
mod groups;
mod lines;
mod programs;
mod properties;
mod runs;
mod support;
