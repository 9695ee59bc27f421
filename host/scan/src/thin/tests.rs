//! What each tool leaves out, and why.

use std::cell::RefCell;

use super::crop::{CropRegion, crop};
use super::filter::{intensity, isolated, spikes, statistical};
use super::sample::{every, voxels};
use super::seen::Beams;
use super::{Drops, drops::Dropped};
use crate::cloud::{CloudPoint, Points};
use crate::rigid::Vec3;

fn point(x: f64, y: f64, z: f64, profile: u64, index: u32) -> CloudPoint {
    CloudPoint {
        at: [x, y, z],
        profile,
        index,
        intensity: 10.0 * x,
        ..CloudPoint::default()
    }
}

/// Profiles of a plane, 0.5 mm apart in both directions.
fn plane(profiles: u64, width: u32) -> Vec<CloudPoint> {
    (0..profiles)
        .flat_map(|p| (0..width).map(move |i| point(0.5 * f64::from(i), 0.5 * p as f64, 0.0, p, i)))
        .collect()
}

fn points(list: &[CloudPoint]) -> Points<'_> {
    Box::new(list.iter().copied().map(Ok))
}

fn all(points: Points<'_>) -> Vec<CloudPoint> {
    points.map(Result::unwrap).collect()
}

fn counts(drops: RefCell<Drops>) -> Vec<(&'static str, u64)> {
    let list: Vec<Dropped> = drops.into_inner().finish().unwrap();
    list.iter().map(|d| (d.reason, d.points)).collect()
}

#[test]
fn regions_hold_what_lies_in_all_of_them() {
    let list = plane(5, 11);
    let drops = RefCell::default();
    let regions = vec![
        CropRegion::Box(Vec3::new(0.0, 0.0, -1.0), Vec3::new(3.0, 9.0, 1.0)),
        CropRegion::Profiles(1..=3),
        CropRegion::Side(Vec3::new(1.0, 0.0, 0.0), Vec3::x()),
        CropRegion::Ball(Vec3::new(2.0, 1.0, 0.0), 1.0),
    ];
    let kept = all(crop(points(&list), regions, &drops));
    // 7 of 11 columns in the box, 3 of 5 profiles, x from 1 on, then within 1 mm of (2, 1, 0).
    let ball = |p: &CloudPoint| (p.at[0] - 2.0).hypot(p.at[1] - 1.0) <= 1.0;
    assert_eq!(kept.len(), 3 * 3 + 2);
    assert!(kept.iter().all(ball));
    let counts = counts(drops);
    assert_eq!(
        counts,
        [
            ("other_profile", 2 * 7),
            ("outside_box", 5 * 4),
            ("behind_plane", 3 * 2),
            ("outside_ball", 3 * 5 - 11),
        ]
    );
    assert_eq!(counts.iter().map(|c| c.1).sum::<u64>() + 11, 55);
}

#[test]
fn a_spike_is_one_point_off_neighbours_that_agree() {
    let mut list = plane(2, 8);
    list[3].at[2] = 5.0;
    // A step is none: from here on all lie higher.
    for p in &mut list[12..] {
        p.at[2] = 5.0;
    }
    // At the end of a profile nobody can say.
    list[7].at[2] = -4.0;
    let drops = RefCell::default();
    let kept = all(spikes(points(&list), 1.5, None, &drops));
    assert_eq!(kept.len(), list.len() - 1);
    assert!(!kept.iter().any(|p| p.profile == 0 && p.index == 3));
    assert_eq!(counts(drops), [("spike", 1)]);
}

/// A cloud that was sorted otherwise has no neighbours to hold a point against: it is refused, where it came out as if it
/// were clean.
#[test]
fn points_that_do_not_follow_their_profile_are_refused() {
    let list = plane(3, 8);
    let mut by_index = list.clone();
    by_index.sort_by_key(|p| p.index);
    let mut turned = list.clone();
    turned[8..16].reverse();
    for (list, right) in [(&list, true), (&by_index, false), (&turned, false)] {
        let drops = RefCell::default();
        let found: Result<Vec<CloudPoint>, _> = spikes(points(list), 1.5, None, &drops).collect();
        match found {
            Ok(kept) => assert!(right && kept.len() == list.len()),
            Err(error) => assert!(!right && error.code == "unordered", "{error}"),
        }
    }
}

/// On a plane at 1 mm, as on flanks up to 82 degrees with kinks and steps, each sample that stands off goes and no other:
/// not the pitch, nor the step between neighbours on a flank, is how far one stands off.
#[test]
fn a_spike_is_told_at_any_pitch_and_on_any_flank() {
    for (pitch, slope) in [(1.0, 0.0), (0.1, 0.0), (1.0, 1.0), (0.1, 3.73), (0.1, 7.0)] {
        let mut seed = 11_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            0.02 * ((seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        let clean: Vec<CloudPoint> = (0..1000_u32)
            .map(|i| {
                // Up the flank, along a top, down a step.
                let (profile, place) = (u64::from(i / 100), f64::from(i % 100));
                let z = pitch * slope * place.min(60.0) - if place > 80.0 { 5.0 } else { 0.0 };
                point(pitch * place, profile as f64, z + noise(), profile, i % 100)
            })
            .collect();
        let mut bad = clean.clone();
        // Away from the kink, the step and the ends.
        let marked = |i: usize| matches!(i % 100, 10 | 33 | 70 | 90);
        for (i, p) in bad.iter_mut().enumerate().filter(|(i, _)| marked(*i)) {
            p.at[2] += if i % 20 == 0 { 8.0 } else { -8.0 };
        }
        let beam = Beams::Along(-Vec3::z());
        for beams in [None, Some(beam)] {
            let drops = RefCell::default();
            assert_eq!(
                all(spikes(points(&clean), 0.5, beams.clone(), &drops)).len(),
                1000
            );
            let kept = all(spikes(points(&bad), 0.5, beams.clone(), &drops));
            let gone: Vec<&CloudPoint> = bad.iter().filter(|p| !kept.contains(p)).collect();
            assert_eq!(gone.len(), 40, "{pitch} {slope} {beams:?}");
            assert!(gone.iter().all(|p| marked(p.index as usize)));
        }
    }
}

#[test]
fn dark_and_bright_points_are_told_apart() {
    let mut list = plane(1, 10);
    list[4].intensity = f64::NAN;
    let drops = RefCell::default();
    assert_eq!(all(intensity(points(&list), 5.0, 30.0, &drops)).len(), 5);
    assert_eq!(counts(drops), [("dark", 2), ("bright", 3)]);
}

#[test]
fn lonely_points_go_and_the_surface_stays() {
    let mut list = plane(20, 20);
    list.push(point(5.0, 5.0, 6.0, 20, 0));
    list.push(point(5.1, 5.0, 6.0, 20, 1));
    let drops = RefCell::default();
    let kept = isolated(list.clone(), 1.0, 3, &drops).unwrap();
    assert_eq!(kept.len(), 400);
    assert_eq!(counts(drops), [("isolated", 2)]);
    let drops = RefCell::default();
    let kept = statistical(list.clone(), 6, 4.0, &drops).unwrap();
    assert_eq!(kept.len(), 400);
    assert_eq!(counts(drops), [("outlier", 2)]);
    let refused = statistical(list[..4].to_vec(), 6, 4.0, &RefCell::default()).unwrap_err();
    assert_eq!(refused.code, "too_few_points");
}

#[test]
fn a_sample_has_each_cell_once_and_each_nth_point() {
    let list = plane(20, 20);
    let drops = RefCell::default();
    assert_eq!(all(every(points(&list), 7, &drops)).len(), 58);
    assert_eq!(counts(drops), [("sampled", 342)]);
    let drops = RefCell::default();
    let cells = voxels(points(&list), 2.0, &drops).unwrap();
    // 10 mm are five cells of 2 mm, each with 4 by 4 points about its middle.
    assert_eq!(cells.len(), 25);
    assert_eq!(cells[0].at, [0.75, 0.75, 0.0]);
    assert_eq!(counts(drops), [("merged", 375)]);
    let far = [point(1e300, 0.0, 0.0, 0, 0)];
    assert_eq!(
        voxels(points(&far), 1.0, &RefCell::default())
            .unwrap_err()
            .code,
        "not_finite"
    );
}
