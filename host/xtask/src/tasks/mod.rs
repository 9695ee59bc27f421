//! The tasks, one module each, and what only they run.

pub mod background;
pub mod bench;
pub mod dependencies;
pub mod firmware;
pub mod flash;
pub mod fuzz;
pub mod release;
pub mod set_up;
pub mod size;
pub mod test;
