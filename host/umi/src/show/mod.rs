//! What commands show: sentences, JSON, tables and colours, a job as text, how far long work is.

pub mod job;
pub mod json;
pub(crate) mod progress;
pub mod sensor;
pub mod terminal;
pub mod text;
pub mod utc;
