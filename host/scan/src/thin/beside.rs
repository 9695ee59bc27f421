//! What the samples on one side of a place in a profile say of it.
//!
//! # Design
//! The pitch is no height: on a coarse grid, or on a steep flank, neighbours are far from each other on one surface. So a
//! sample is held against the line through those before it, and through those behind it. How far it stands off is taken
//! along the beam where it is known, and square to the line where it is not.

use std::cell::RefCell;
use std::collections::HashSet;

use super::drops::Drops;
use crate::ScanError;
use crate::cloud::{CloudPoint, Points};
use crate::rigid::Vec3;

/// So many samples make the line, where they lie on one: a longer one carries less noise beyond its end.
const LONG: usize = 4;

/// A line through samples of a profile.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProfileLine {
    at: Vec3,
    along: Vec3,
    beam: Option<Vec3>,
}

impl ProfileLine {
    /// Through two points; none where they are one.
    pub fn through(a: &Vec3, b: &Vec3, beam: Option<Vec3>) -> Option<Self> {
        let along = b - a;
        (along.norm_squared() > 0.0).then_some(Self {
            at: *a,
            along,
            // Along a line that runs with the beam nothing is high.
            beam: beam
                .filter(|beam| across(&along, beam).norm_squared() > 1e-12 * along.norm_squared()),
        })
    }

    /// Through the samples on one side of a place, the nearest first: through four where these lie on one line within half
    /// of `off_mm`, else through the next two; none where there is one only.
    pub fn beside(nearest_first: &[Vec3], off_mm: f64, beam: Option<Vec3>) -> Option<Self> {
        let [first, second, ..] = nearest_first else {
            return None;
        };
        let long = nearest_first.get(..LONG).and_then(|all| {
            let line = Self::through(first, all.last()?, beam)?;
            let is_straight = |p: &Vec3| line.off(p).norm() <= off_mm / 2.0;
            all.iter().all(is_straight).then_some(line)
        });
        long.or_else(|| Self::through(first, second, beam))
    }

    /// How a point stands off the line.
    pub fn off(&self, p: &Vec3) -> Vec3 {
        let w = p - self.at;
        let Some(beam) = self.beam else {
            return w - self.along * (w.dot(&self.along) / self.along.norm_squared());
        };
        let (w_across, across) = (across(&w, &beam), across(&self.along, &beam));
        let share = w_across.dot(&across) / across.norm_squared();
        beam * (w - self.along * share).dot(&beam)
    }
}

fn unordered(profile: u64) -> ScanError {
    ScanError::refused(
        "unordered",
        format_args!(
            "the points of profile {profile} do not follow each other along it, and spikes and edges are told by neighbours: sort the \
             cloud by profile and index, filter before sampling, and clouds that were put together one by one"
        ),
    )
}

/// What of a direction is square to the beam.
fn across(v: &Vec3, beam: &Vec3) -> Vec3 {
    v - beam * v.dot(beam)
}

/// The points without those that `judge` leaves out of their profile, for this reason. One profile is held at a time.
///
/// # Errors
/// `unordered` where the points of a profile do not follow each other, in the order of their places along it: what is not
/// beside its neighbours cannot be judged by them.
pub(super) fn by_profile<'a>(
    points: Points<'a>,
    reason: &'static str,
    drops: &'a RefCell<Drops>,
    judge: impl Fn(&[CloudPoint]) -> Vec<bool> + 'a,
) -> Points<'a> {
    let mut points = points;
    // A point that began the next profile, an error for behind the present one.
    let mut next: Option<CloudPoint> = None;
    let mut error = None;
    let mut profile: Vec<CloudPoint> = Vec::new();
    let mut known: HashSet<u64> = HashSet::new();
    let mut out: std::vec::IntoIter<CloudPoint> = Vec::new().into_iter();
    Box::new(std::iter::from_fn(move || {
        loop {
            if let Some(point) = out.next() {
                return Some(Ok(point));
            }
            if let Some(error) = error.take() {
                return Some(Err(error));
            }
            profile.clear();
            profile.extend(next.take());
            loop {
                match points.next() {
                    Some(Ok(point)) => {
                        if profile.first().is_some_and(|p| p.profile != point.profile) {
                            next = Some(point);
                            break;
                        }
                        profile.push(point);
                    }
                    Some(Err(found)) => {
                        error = Some(found);
                        break;
                    }
                    None => break,
                }
            }
            let Some(first) = profile.first() else {
                return error.take().map(Err);
            };
            let runs_back = profile.windows(2).any(|two| two[1].index < two[0].index);
            if !known.insert(first.profile) || runs_back {
                return Some(Err(unordered(first.profile)));
            }
            let goes = judge(&profile);
            let mut kept = Vec::with_capacity(profile.len());
            for (point, goes) in profile.iter().zip(goes) {
                if !goes {
                    kept.push(*point);
                } else if let Err(found) = drops.borrow_mut().drop_point(reason, point) {
                    return Some(Err(found));
                }
            }
            out = kept.into_iter();
        }
    }))
}
