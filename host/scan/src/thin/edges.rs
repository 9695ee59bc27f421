//! Mixed points: at an edge a part of the laser's spot lies on either side, and the sensor sees a point
//! between them, on no surface.

use std::cell::RefCell;

use super::drops::Drops;
use crate::cloud::{CloudPoint, Points};
use crate::rigid::Vec3;

/// Leaves out `mixed` points: a run of at most `most` points of a profile that lies further than
/// `off_mm` from the point before it and from the one behind it. Neighbours follow each other in the
/// file; a run at an end of a profile stays. What `spikes` leaves out lies so, too; this filter takes
/// also what stands between two surfaces.
pub fn mixed<'a>(
    points: Points<'a>,
    off_mm: f64,
    most: usize,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    let mut points = points;
    // A point that began the next profile, an error for behind the present one.
    let mut next: Option<CloudPoint> = None;
    let mut error = None;
    let mut profile: Vec<CloudPoint> = Vec::new();
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
            if profile.is_empty() {
                return error.take().map(Err);
            }
            let (kept, gone) = parted(&profile, off_mm, most);
            for point in &gone {
                if let Err(found) = drops.borrow_mut().drop_point("mixed", point) {
                    return Some(Err(found));
                }
            }
            out = kept.into_iter();
        }
    }))
}

/// What of a profile stays, and what does not.
fn parted(profile: &[CloudPoint], off_mm: f64, most: usize) -> (Vec<CloudPoint>, Vec<CloudPoint>) {
    let (mut kept, mut gone) = (Vec::with_capacity(profile.len()), Vec::new());
    let jump =
        |a: &CloudPoint, b: &CloudPoint| (Vec3::from(a.at) - Vec3::from(b.at)).norm() > off_mm;
    let mut begin = 0;
    for run in profile.chunk_by(|a, b| !jump(a, b)) {
        let inside = begin > 0 && begin + run.len() < profile.len();
        begin += run.len();
        if inside && run.len() <= most {
            gone.extend_from_slice(run);
        } else {
            kept.extend_from_slice(run);
        }
    }
    (kept, gone)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step() -> Vec<CloudPoint> {
        // A step of 5 mm behind x = 1, with two points on the way down in each profile.
        (0..3_u64)
            .flat_map(|profile| {
                (0..20_u32).map(move |index| {
                    let z = match index {
                        0..10 => 5.0,
                        10 => 3.5,
                        11 => 1.25,
                        _ => 0.0,
                    };
                    CloudPoint {
                        at: [0.1 * f64::from(index), profile as f64, z],
                        profile,
                        index,
                        ..CloudPoint::default()
                    }
                })
            })
            .collect()
    }

    #[test]
    fn points_between_two_surfaces_go() {
        let list = step();
        let run = |off_mm, most| {
            let drops = RefCell::default();
            let points = Box::new(list.iter().copied().map(Ok));
            let kept: Vec<CloudPoint> = mixed(points, off_mm, most, &drops)
                .map(Result::unwrap)
                .collect();
            let gone = drops.into_inner().finish().unwrap();
            (kept, gone.first().map_or(0, |d| d.points))
        };
        let (kept, gone) = run(0.5, 1);
        assert_eq!((kept.len(), gone), (54, 6));
        assert!(kept.iter().all(|p| !(10..12).contains(&p.index)));
        // Where the points on the way are near each other they are a run of two.
        let (kept, gone) = run(2.3, 1);
        assert_eq!((kept.len(), gone), (60, 0));
        let (_, gone) = run(1.4, 2);
        assert_eq!(gone, 3);
        // At the end of a profile nobody can say.
        let short: Vec<CloudPoint> = list[..11].to_vec();
        let drops = RefCell::default();
        let points = Box::new(short.iter().copied().map(Ok));
        assert_eq!(mixed(points, 0.5, 3, &drops).count(), 11);
    }

    #[test]
    fn an_error_comes_behind_the_points_before_it() {
        let list = step();
        let error = || crate::ScanError::unreadable("corrupt", "broken");
        let points = list[..25].iter().copied().map(Ok);
        let points: Points<'_> = Box::new(points.chain(std::iter::once(Err(error()))));
        let drops = RefCell::default();
        let all: Vec<_> = mixed(points, 0.5, 1, &drops).collect();
        assert_eq!(all.len(), 18 + 5 + 1);
        assert_eq!(all.last().unwrap().as_ref().unwrap_err().code, "corrupt");
    }
}
