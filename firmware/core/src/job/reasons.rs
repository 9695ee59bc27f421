//! The reasons against a feature: kept, and those that its limits give.

use heapless::Vec;
use umi_protocol::feature::MAX_FEATURE_REASONS;
use umi_protocol::job::{FeatureSpec, Limits};
use umi_protocol::reason::Reason;

use super::exceeds;
use super::report::Fitted;

/// The reasons against one feature.
pub type Reasons = Vec<Reason, MAX_FEATURE_REASONS>;

/// Keeps a reason. A feature that has more reasons than there is room for is
/// refused all the same; the first ones say why.
pub fn add(reasons: &mut Reasons, reason: Reason) {
    if !reasons.contains(&reason) {
        let _ = reasons.push(reason);
    }
}

/// Radius and residuals against the limits.
pub fn against_limits(spec: &FeatureSpec, limits: &Limits, fitted: &Fitted, reasons: &mut Reasons) {
    if let (Some(radius), Some(nominal)) = (fitted.shape().radius_mm(), spec.radius_mm) {
        let error_mm = radius - nominal;
        if exceeds(error_mm.abs(), limits.radius_error_mm) {
            add(
                reasons,
                Reason::RadiusError {
                    error_mm,
                    limit_mm: limits.radius_error_mm,
                },
            );
        }
    }
    let rms_mm = fitted.rms_total_mm();
    if exceeds(rms_mm, limits.rms_mm) {
        let limit_mm = limits.rms_mm;
        add(reasons, Reason::Rms { rms_mm, limit_mm });
    }
}
