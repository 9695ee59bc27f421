//! Files that a user writes or gets: jobs, points, tool paths, keys, heads.

pub mod capture;
pub mod config_file;
pub mod head_file;
pub mod image_file;
pub mod job_file;
pub mod key_file;
pub mod points;
pub mod tool_path;
