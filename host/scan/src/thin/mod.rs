//! Clouds with fewer points: filtered, cropped, sampled. Every point that is left out is counted by its reason.
//!
//! * [`filter`]: what is no surface: dark points, spikes, isolated points, outliers.
//! * [`edges`]: mixed points (`beside`: what a profile's samples say of the one next to them); [`seen`]: what was out of range or seen too much from the side.
//! * [`crop`]: what is not of the part: a box, a ball, a side of a plane, a range of profiles.
//! * [`sample`]: fewer of the same: each n-th, one for each cell.
//! * [`drops`]: how many, and why.

mod beside;
pub mod crop;
pub mod drops;
pub mod edges;
pub mod filter;
pub mod sample;
pub mod seen;
#[cfg(test)]
mod tests;

pub use drops::Drops;
