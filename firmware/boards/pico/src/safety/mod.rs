//! What keeps outputs low and tells why: before `main`, at a fault, behind one.

pub mod before_main;
pub mod crash_note;
pub mod guard;
