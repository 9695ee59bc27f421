//! The openumi host tool.
fn main() {}
