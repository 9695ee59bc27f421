//! The pictures of a session.

pub mod chart;
pub mod part;
pub mod residuals;
pub mod setup;
pub mod sphere;
pub mod unfitted;
pub mod views;
