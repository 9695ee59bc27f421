//! What a pose is worth that the end came to by itself.
//!
//! The end begins anew where more points lie by the size ([`super::super::size`]). That pose has passed none of what the
//! search's had to: it is asked the same, against all that the search found and the pose that it is to replace.

use super::symmetry::ambiguous;
use super::{Decided, Judge, Worth, no_fit, too_little};
use crate::ScanError;
use crate::localise::LocaliseTask;
use crate::localise::fit::{self, Fit};
use crate::localise::search::oriented::from_seed;
use crate::localise::search::scene::Scene;
use crate::rigid::Pose;
use crate::surface::CompositeSurface;

/// The pose, if it stands, with what lies beside it. `others`: what else was found, however good it is.
pub(in crate::localise) fn judged(
    task: &LocaliseTask<'_>,
    surface: &CompositeSurface,
    fit: &Fit,
    others: &[Pose],
) -> Result<Decided, ScanError> {
    let judge = Judge::new(task, surface);
    let scene = Scene::new(task.model, &from_seed(task.points, task.seed), task.threads);
    match judge.worth(&scene, fit) {
        Worth::Bad => return Err(no_fit()),
        // Of a start it is not asked how much the scan shows.
        Worth::Little(shown) if task.start.is_none() => return Err(too_little(shown)),
        _ => {}
    }
    let missed = judge.mirrored(&scene, std::slice::from_ref(fit))?;
    let others = others.iter().map(|motion| Fit {
        motion: *motion,
        ..fit.clone()
    });
    let fits: Vec<Fit> = std::iter::once(fit.clone())
        .chain(missed)
        .chain(others)
        .collect();
    let decided = judge.only_one(&scene, &fits);
    // As poses that are as good as each other: of a foreign part they are no answer either.
    let is_answer = |error: &ScanError| error.code == "ambiguous";
    if decided.as_ref().map_or_else(is_answer, |_| true) {
        judge.stands(&scene, fit)?;
    }
    let decided = judge.with_aside(&scene, decided?)?;
    let moved_mm = decided
        .fit
        .motion
        .apart_mm(&fit.motion, &judge.prepared.corners);
    if moved_mm > fit::CLOSE * fit.sigma_mm {
        // All points speak for the one, and those that tell the two apart, or most sides, for the other.
        return Err(ambiguous(
            &[],
            &[fit.motion, decided.fit.motion],
            "the part lies on more of the points by one pose, and those where two poses differ speak for the other",
            "scan what tells them apart, or with less noise and fewer stray points",
        ));
    }
    Ok(decided)
}
