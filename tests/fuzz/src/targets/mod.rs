//! One target for each kind of bytes from outside.

mod control;
mod files;
mod frame;
mod journal;
mod memory;
mod nc;
mod point_sensor;
mod receiver;
mod rewrite;
mod scan_files;
mod session;

/// What a target does with one input: it panics if something does not hold.
pub type Target = fn(&[u8]);

/// The targets by name; each one's inputs are kept in `corpus/NAME`.
pub const TARGETS: [(&str, Target); 11] = [
    ("control", control::one),
    ("files", files::one),
    ("frame", frame::one),
    ("journal", journal::one),
    ("memory", memory::one),
    ("nc", nc::one),
    ("point_sensor", point_sensor::one),
    ("receiver", receiver::one),
    ("rewrite", rewrite::one),
    ("scan_files", scan_files::one),
    ("session", session::one),
];
