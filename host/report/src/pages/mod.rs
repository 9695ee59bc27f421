//! The pages: each one self-contained HTML file.

pub mod deviation;
pub mod path_plan;
pub mod paths;
pub mod scan;
pub mod session;
pub mod tables;
