//! What keeps outputs low and tells why: before `main`, at a fault, behind one.

pub mod before_main;
pub mod crash_note;
#[path = "../../../common/fault_entry.rs"]
mod fault_entry;
pub mod guard;
