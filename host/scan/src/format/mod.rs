//! Files in and out.
//!
//! * [`table`]: CSV with named columns, row by row.
//! * [`machine`]: the machine file.
//! * [`clouds`]: clouds point by point, in and out, by the extension of the file.
//! * [`points`]: merged points out, by the extension of the file.
//! * [`profiles`]: what the sensor tells; [`triggers`]: what the board tells.

pub mod clouds;
pub mod machine;
pub mod points;
pub mod profiles;
pub mod table;
pub mod triggers;
