//! Cross-crate tests: see the files beside this folder. Here is what they share.

pub mod cases;
pub mod damage;
pub mod referee;
pub mod rig;
pub mod soak;
pub mod ways;
