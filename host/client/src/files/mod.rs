//! Files that a user writes or gets: jobs, points, tool paths.

pub mod job_file;
pub mod points;
pub mod tool_path;
