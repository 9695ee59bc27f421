//! A sensor that measures along one beam: its calibration on balls, its points.
//!
//! * [`readings`], [`spheres`]: what was read, and of which balls.
//! * [`calibration`]: where its zero stands and where its beam points.
//! * [`cloud`]: readings to points.
//! * [`plan`]: a set of places from which the calibration is well determined; [`program`]: its NC program.

pub mod calibration;
pub mod cloud;
mod doubts;
pub mod plan;
pub mod program;
pub mod readings;
mod scale;
pub mod spheres;
#[cfg(test)]
mod tests;

use umi_core::point::PointRefusal;

use crate::ScanError;

impl From<PointRefusal> for ScanError {
    fn from(error: PointRefusal) -> Self {
        Self::refused(error.code(), error)
    }
}
