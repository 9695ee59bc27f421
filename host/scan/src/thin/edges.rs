//! Mixed points: at an edge a part of the laser's spot lies on either side, and the sensor sees a point
//! between them, on no surface.

use std::cell::RefCell;

use super::beside::{ProfileLine, by_profile};
use super::drops::Drops;
use super::seen::Beams;
use crate::cloud::Points;
use crate::rigid::Vec3;

/// So many samples are looked at on either side.
const BESIDE: usize = 5;

/// Leaves out `mixed` points: a run of at most `most` points of a profile between two surfaces, one before it and one
/// behind it, each of which carried on passes it by more than `off_mm`, on different sides. How far is taken along the
/// beam, where `beams` says it, and else square to each surface. A surface has two samples or more that the third agrees
/// with; what stands out to one side of both is a rib or a spike, and stays. Neighbours follow each other in the file; a run
/// at an end of a profile stays.
pub fn mixed<'a>(
    points: Points<'a>,
    off_mm: f64,
    most: usize,
    beams: Option<Beams>,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    by_profile(points, "mixed", drops, move |profile| {
        let beam = profile.first().and_then(|p| beams.as_ref()?.of(p.profile));
        let at: Vec<Vec3> = profile.iter().map(|p| Vec3::from(p.at)).collect();
        let mut goes = vec![false; at.len()];
        let mut place = 0;
        while place < at.len() {
            match run(&at, place, off_mm, most, beam) {
                Some(length) => {
                    goes[place..place + length].fill(true);
                    place += length;
                }
                None => place += 1,
            }
        }
        goes
    })
}

/// How many mixed points begin here, if any do.
fn run(at: &[Vec3], begin: usize, off_mm: f64, most: usize, beam: Option<Vec3>) -> Option<usize> {
    let before: Vec<Vec3> = at[..begin].iter().rev().take(BESIDE).copied().collect();
    let before = surface(&before, off_mm, beam)?;
    // Most points lie on what is before them.
    if before.off(&at[begin]).norm() <= off_mm {
        return None;
    }
    (1..=most.min(at.len() - begin)).find(|length| {
        let end = begin + length;
        let behind: Vec<Vec3> = at[end..].iter().take(BESIDE).copied().collect();
        surface(&behind, off_mm, beam).is_some_and(|behind| {
            at[begin..end].iter().all(|p| {
                let (one, other) = (before.off(p), behind.off(p));
                one.norm() > off_mm && other.norm() > off_mm && one.dot(&other) < 0.0
            })
        })
    })
}

/// The line of a surface, by its samples from the place in question on; none where the next one is not of it itself.
fn surface(nearest_first: &[Vec3], off_mm: f64, beam: Option<Vec3>) -> Option<ProfileLine> {
    let (nearest, further) = nearest_first.split_first()?;
    let goes_on = ProfileLine::beside(further, off_mm, beam)
        .is_none_or(|line| line.off(nearest).norm() <= off_mm);
    goes_on
        .then(|| ProfileLine::beside(nearest_first, off_mm, beam))
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::CloudPoint;

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
            let kept: Vec<CloudPoint> = mixed(points, off_mm, most, None, &drops)
                .map(Result::unwrap)
                .collect();
            let gone = drops.into_inner().finish().unwrap();
            (kept, gone.first().map_or(0, |d| d.points))
        };
        let (kept, gone) = run(0.5, 2);
        assert_eq!((kept.len(), gone), (54, 6));
        assert!(kept.iter().all(|p| !(10..12).contains(&p.index)));
        // They are two in a row, and one of them is nearer than 1.4 mm to what is next to it.
        assert_eq!(run(0.5, 1).1, 0);
        assert_eq!(run(1.4, 2).1, 0);
        // At the end of a profile nobody can say.
        let short: Vec<CloudPoint> = list[..11].to_vec();
        let drops = RefCell::default();
        let points = Box::new(short.iter().copied().map(Ok));
        assert_eq!(mixed(points, 0.5, 3, None, &drops).count(), 11);
    }

    #[test]
    fn an_error_comes_behind_the_points_before_it() {
        let list = step();
        let error = || crate::ScanError::unreadable("corrupt", "broken");
        let points = list[..25].iter().copied().map(Ok);
        let points: Points<'_> = Box::new(points.chain(std::iter::once(Err(error()))));
        let drops = RefCell::default();
        let all: Vec<_> = mixed(points, 0.5, 2, None, &drops).collect();
        assert_eq!(all.len(), 18 + 5 + 1);
        assert_eq!(all.last().unwrap().as_ref().unwrap_err().code, "corrupt");
    }

    /// Profiles of so many samples at this pitch, their heights by their places; how many go, along the beam or without it.
    fn gone(pitch: f64, heights: &[f64], off_mm: f64, most: usize) -> [u64; 2] {
        let sample = |(i, z): (usize, &f64)| CloudPoint {
            at: [pitch * i as f64, 0.0, *z],
            profile: 1,
            index: i as u32,
            ..CloudPoint::default()
        };
        let list: Vec<CloudPoint> = heights.iter().enumerate().map(sample).collect();
        let beam = Beams::Along(-Vec3::z());
        [None, Some(beam)].map(|beams| {
            let drops = RefCell::default();
            let points = Box::new(list.iter().copied().map(Ok));
            let kept = mixed(points, off_mm, most, beams, &drops).count();
            assert_eq!(
                kept as u64 + drops.borrow().counts.iter().map(|d| d.points).sum::<u64>(),
                list.len() as u64
            );
            drops
                .into_inner()
                .finish()
                .unwrap()
                .first()
                .map_or(0, |d| d.points)
        })
    }

    #[test]
    fn the_pitch_and_a_flank_are_no_edges() {
        let mut seed = 7_u64;
        let mut noise = |mm: f64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            mm * ((seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        // A plane at 1 mm, as a coarse sensor sees it.
        let plane: Vec<f64> = (0..2000).map(|_| noise(0.05)).collect();
        assert_eq!(gone(1.0, &plane, 0.3, 2), [0, 0]);
        // Flanks of 45 to 82 degrees at 0.1 mm; and a roof of them, with its kinks.
        for slope in [1.0, 2.0, 3.73, 7.0] {
            let flank: Vec<f64> = (0..500)
                .map(|i| 0.1 * slope * f64::from(i) + noise(0.01))
                .collect();
            assert_eq!(gone(0.1, &flank, 0.3, 2), [0, 0], "{slope}");
            let roof: Vec<f64> = (0..500_i32)
                .map(|i| 0.1 * slope * f64::from((i % 60 - 30).abs().min(20)) + noise(0.01))
                .collect();
            assert_eq!(gone(0.1, &roof, 0.3, 2), [0, 0], "{slope}");
        }
        // A rib of two samples is between no two surfaces, and a step without a sample on it has no mixed one.
        let rib: Vec<f64> = (0..100)
            .map(|i| f64::from(u8::from(i == 50 || i == 51)))
            .collect();
        assert_eq!(gone(0.1, &rib, 0.3, 2), [0, 0]);
        let step: Vec<f64> = (0..100).map(|i| if i < 50 { 0.0 } else { -5.0 }).collect();
        assert_eq!(gone(1.0, &step, 0.3, 2), [0, 0]);
        // Two on the way down a step go, at either pitch, also where both surfaces are steep.
        for (pitch, slope) in [(0.1, 0.0), (1.0, 0.0), (0.1, 2.0), (1.0, 1.0)] {
            let edge: Vec<f64> = (0..100)
                .map(|i| {
                    let along = pitch * slope * f64::from(i) + noise(0.005);
                    along
                        - match i {
                            0..50 => 0.0,
                            50 => 1.7,
                            51 => 3.4,
                            _ => 5.0,
                        }
                })
                .collect();
            assert_eq!(gone(pitch, &edge, 0.3, 2), [2, 2], "{pitch} {slope}");
        }
    }
}
