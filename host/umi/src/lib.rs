//! The openumi host library.
