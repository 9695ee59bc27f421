//! Points from a scanner on a machine: a library without terminal.
//!
//! * [`mod@format`]: tables and captures in, clouds out.
//! * [`profile`]: laser lines with their stamps; [`pair`]: which latch each belongs to.
//! * [`merge`]: profiles and positions to points; [`pose`]: where the machine holds the sensor.
//! * [`calibrate`]: the sensor's mount and rotary axes.
//! * [`compare`]: a cloud and its nominal.
//! * [`point_sensor`]: a sensor that measures along one beam.
//! * [`plan`]: a scan path on the part's surface, proved.
//! * [`cloud`], [`surface`], [`rigid`]: points, nominals with exact signed distances, motions.
//! * [`thin`]: clouds filtered, cropped, sampled.
//! * [`localise`]: where the part is in a scan, or why the scan does not say.
//! * [`stock`]: the best place of the finished part in the raw one.
//! * [`solve`], [`parallel`]: least squares, small linear programmes, how far an uncertainty by few reaches; threads.
//! * [`error`]: why there is no answer.

pub mod calibrate;
pub mod cloud;
pub mod compare;
pub mod error;
pub mod format;
pub mod localise;
pub mod merge;
pub mod pair;
pub mod parallel;
pub mod plan;
pub mod point_sensor;
pub mod pose;
pub mod profile;
pub mod rigid;
pub mod solve;
pub mod stock;
pub mod surface;
pub mod thin;

pub use error::{Ending, ScanError};
