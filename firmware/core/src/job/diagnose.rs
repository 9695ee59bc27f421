//! What would explain a bad fit? Names the hit where exactly one change makes
//! everything right. It never repairs: the feature stays refused.

use heapless::Vec;
use umi_protocol::job::{FeatureKind, FeatureSpec, Limits, MAX_HITS};
use umi_protocol::reason::Reason;

use super::reasons::{Reasons, add, against_limits};
use super::report::fit;
use crate::units::Point;

/// Features with more hits are not tried: each trial is a fit.
const MAX_TRIED: usize = 16;

/// Tries a lost sign in each coordinate, then each hit left out.
pub fn suspects(spec: &FeatureSpec, limits: &Limits, points: &[Point], reasons: &mut Reasons) {
    if !can_diagnose(spec.kind) || points.len() > MAX_TRIED {
        return;
    }
    let mut trial: Vec<Point, MAX_HITS> = points.iter().copied().collect();
    if let Some(reason) = lost_sign(spec, limits, points, &mut trial) {
        add(reasons, reason);
        return;
    }
    if let Some(reason) = outlier(spec, limits, points, &mut trial) {
        add(reasons, reason);
    }
}

/// Whether these points would pass.
fn passes(spec: &FeatureSpec, limits: &Limits, points: &[Point]) -> bool {
    fit(spec.kind, points).is_ok_and(|fitted| {
        let mut reasons = Reasons::new();
        against_limits(spec, limits, &fitted, &mut reasons);
        reasons.is_empty()
    })
}

fn lost_sign(
    spec: &FeatureSpec,
    limits: &Limits,
    points: &[Point],
    trial: &mut Vec<Point, MAX_HITS>,
) -> Option<Reason> {
    let mut found = None;
    for (number, (at, point)) in (1u16..).zip(points.iter().enumerate()) {
        for axis in 0..3u8 {
            let mut changed = *point;
            if let Some(c) = changed.mm.get_mut(usize::from(axis)) {
                *c = -*c;
            }
            set(trial, at, changed);
            if passes(spec, limits, trial) {
                if found.is_some() {
                    // More than one explanation explains nothing.
                    set(trial, at, *point);
                    return None;
                }
                found = Some(Reason::SuspectSign { hit: number, axis });
            }
        }
        set(trial, at, *point);
    }
    found
}

fn outlier(
    spec: &FeatureSpec,
    limits: &Limits,
    points: &[Point],
    trial: &mut Vec<Point, MAX_HITS>,
) -> Option<Reason> {
    // One degree of freedom must remain, else what is left always "fits".
    if points.len() < usize::from(spec.kind.min_hits()) + 2 {
        return None;
    }
    let mut found = None;
    for (number, (at, point)) in (1u16..).zip(points.iter().enumerate()) {
        trial.clear();
        trial.extend(
            points
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != at)
                .map(|(_, p)| *p),
        );
        if passes(spec, limits, trial) {
            if found.is_some() {
                return None;
            }
            let others = fit(spec.kind, trial).ok()?;
            found = Some(Reason::SuspectHit {
                hit: number,
                off_mm: others.residual(*point).0.abs(),
            });
        }
    }
    found
}

fn set(points: &mut Vec<Point, MAX_HITS>, at: usize, point: Point) {
    if let Some(place) = points.get_mut(at) {
        *place = point;
    }
}

/// Kinds whose fit is cheap enough to try again with a changed hit.
const fn can_diagnose(kind: FeatureKind) -> bool {
    matches!(
        kind,
        FeatureKind::Sphere | FeatureKind::Circle | FeatureKind::Plane
    )
}
