//! The openumi host library.

pub mod audit;
pub mod axes;
pub mod capture;
pub mod correction;
pub mod experiment;
pub mod failure;
pub mod gather;
pub mod happening;
pub mod interrupt;
pub mod jobfile;
pub mod jobtext;
pub mod json;
pub mod link;
pub mod live;
pub mod points;
pub mod port;
pub mod programs;
pub mod pull;
pub mod report;
pub mod results;
pub mod style;
pub mod toolpath;
pub mod watch;
pub mod wiring;
pub mod words;
