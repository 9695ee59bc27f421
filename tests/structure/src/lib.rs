//! How the workspace's crates and modules lean on each other, read from their source.
//!
//! # Design
//!
//! A file *leans on* another when its code outside of tests names an item that the other
//! declares. Re-exports are followed to the declaration: `pub use run::Run` in a `mod.rs`
//! makes nobody lean on that `mod.rs`, and a re-export alone leans on nothing. What stands in
//! a macro's arguments counts as well.
//!
//! A module and those that it contains are one room, and may name each other: a type in
//! `mod.rs` whose methods stand in `mod/part.rs`. Rooms beside each other may not.
//!
//! # Limitations
//!
//! A circle by way of the module that contains all of it is not seen. A method that is called without its trait's or type's name is not seen. What a macro
//! expands to is not seen.

mod crates;
mod graph;
mod module;
mod names;
mod paths;

pub use crates::{Crate, crates};
pub use graph::circles;
pub use module::{Module, Tree};
pub use names::{TypeName, types};
pub use paths::{Lean, leans};
