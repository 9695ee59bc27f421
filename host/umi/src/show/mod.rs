//! What commands show: sentences, JSON, tables and colours, a job as text.

pub mod job;
pub mod json;
pub mod sensor;
pub mod terminal;
pub mod text;
pub mod utc;
