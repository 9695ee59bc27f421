//! What a board says of its work, on the wire and in its journal.

pub mod fault;
pub mod feature;
pub mod head;
pub mod line;
pub mod program;
pub mod reason;
pub mod verdict;
