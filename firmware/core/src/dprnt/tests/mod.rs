//! The receiver as a whole: the rules of the wire, captures, properties.

mod captures;
mod support;
