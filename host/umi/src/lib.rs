//! The openumi host library.

pub mod link;
