//! The receiver as a whole: the rules of the wire, captures, properties.
//!
//! Captures are named as in the project's collection of wire facts: R was
//! recorded on a machine, M is printed in a maker's manual, C is constructed
//! from the makers' rules.

mod captures;
mod codes;
mod foreign;
mod groups;
mod lines;
mod programs;
mod properties;
mod support;
