//! What is sent to a control means what it says, and goes out only when it may.
//!
//! Corrections in every dialect, rewritten tool paths, part programs on their way, and the
//! judgement of LinuxCNC's interpreter.

mod deliveries;
mod dialects;
mod referee;
mod rewrite;
