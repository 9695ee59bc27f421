//! What firmware images take.

pub mod image;
