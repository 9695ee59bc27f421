//! The verdict on one setup (one clamping) and the correction that follows.

use core::fmt;

use heapless::{String, Vec};
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::{Dialect, MAX_DATUMS, Name};
use crate::records::feature::Matrix3;
use crate::records::reason::Reason;

/// Reasons kept with one verdict, at most. More are counted in `reasons_dropped`.
pub const MAX_VERDICT_REASONS: usize = 16;
/// Remarks kept with one verdict, at most.
pub const MAX_REMARKS: usize = 8;
/// Pairs of datum features in a verdict, at most.
pub const MAX_DISTANCES: usize = MAX_DATUMS * (MAX_DATUMS - 1) / 2;
/// Bytes of a correction program, at most.
pub const MAX_CORRECTION: usize = 1024;

/// The verdict on one setup.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Verdict {
    /// Which setup (clamping) since the job was set, from 0. A verdict on the
    /// same setup number replaces the earlier one.
    pub setup: u32,
    /// True: every feature came, every limit holds. Only then is there a correction.
    pub ok: bool,
    /// Why it is NG.
    pub reasons: Vec<SetupReason, MAX_VERDICT_REASONS>,
    /// Reasons that found no room.
    pub reasons_dropped: u16,
    /// What was noticed and does not change the verdict.
    pub remarks: Vec<SetupReason, MAX_REMARKS>,
    /// Distances between datum positions, against the reference.
    pub distances: Vec<DistanceReport, MAX_DISTANCES>,
    /// Reference to measured positions; none for the setup that was taught.
    pub registration: Option<RegistrationReport>,
    /// What goes to the control.
    pub correction: Option<CorrectionReport>,
}

impl Verdict {
    /// The run that was measured, where the control has said it.
    #[must_use]
    pub fn of_run(&self) -> Option<u32> {
        let mut remarks = self.remarks.iter();
        remarks.find_map(|remark| match remark.reason {
            Reason::OfRun { run } => Some(run),
            _ => None,
        })
    }
}

/// A reason, and the feature that it is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct SetupReason {
    /// None: about the setup as a whole.
    pub feature: Option<Name>,
    /// The reason.
    pub reason: Reason,
}

impl fmt::Display for SetupReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(feature) = &self.feature {
            write!(f, "{feature}: ")?;
        }
        self.reason.fmt(f)
    }
}

/// Distance between two datum positions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct DistanceReport {
    /// One feature.
    pub a: Name,
    /// The other.
    pub b: Name,
    /// Measured distance in space.
    pub measured_mm: f64,
    /// Reference distance in space; none while there is no reference.
    pub reference_mm: Option<f64>,
}

/// A rigid registration `q = R p + t`, p nominal (CAD), q measured (MCS).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct RegistrationReport {
    /// R by rows, orthogonal, determinant +1.
    pub rotation: Matrix3,
    /// t.
    pub translation_mm: [f64; 3],
    /// Angle of the rotation about its own axis.
    pub angle_deg: f64,
    /// Unit axis of the rotation (0, 0, 1 where the angle is zero).
    pub axis: [f64; 3],
    /// Degrees of freedom, 3n - 6.
    pub dof: u32,
    /// sqrt(sum of squared residual lengths / n).
    pub rms_mm: f64,
    /// sqrt(sum / dof).
    pub sigma_mm: Option<f64>,
    /// `R p + t - q`, one per datum feature in the job's order.
    pub residuals_mm: Vec<[f64; 3], MAX_DATUMS>,
    /// Covariance for unit noise of a small rotation w, `R_true = exp([w]x) R`.
    pub cov_unit_rotvec: Matrix3,
    /// Covariance for unit noise of t at the origin.
    pub cov_unit_t: Matrix3,
    /// One standard deviation at the worst corner of the part, where sigma and
    /// the part's extents are known.
    pub expected_error_mm: Option<f64>,
}

/// A correction program, made only from an OK verdict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct CorrectionReport {
    /// The words used.
    pub dialect: Dialect,
    /// The complete program, lines ended by LF; line ends and parity of the
    /// control are applied when it is sent.
    pub text: String<MAX_CORRECTION>,
    /// Largest error that it leaves at the part's corners.
    pub leftover_mm: f64,
}
