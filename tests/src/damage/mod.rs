//! Damaged sessions with known truth: clampings of a plate on a simulated machine, printed as
//! a control prints them, spoilt in one stated way, through receiver and job, and every
//! correction that leaves held against where the plate really stood.
//!
//! A correction is *wrong* if it puts a corner of the part more than [`WRONG_MM`] from where
//! it is when it is machined: where it has moved while it was probed, where it ended up. A refusal is *harmless* if the damage had moved nothing by as much.

mod kind;
mod motion;
mod plan;
mod session;
mod text;
mod world;

pub use kind::DamageKind;
pub use plan::SimulatedPlan;
pub use session::{DamageTally, measure};
pub use text::announced;

/// From here on a correction is wrong: 10 µm at a corner of the part.
pub const WRONG_MM: f64 = 0.010;
