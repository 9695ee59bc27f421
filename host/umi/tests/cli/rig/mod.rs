//! What the tests run the tool with.

pub mod board;
pub mod run;
