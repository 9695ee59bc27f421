//! Cross-crate tests: see the files beside this folder. Here is what they share.

pub mod cases;
pub mod referee;
pub mod rig;
