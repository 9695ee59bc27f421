//! What is wrong in a block is named, by its feature.

use super::*;

/// Changes the points of one block of the third clamping and gives that
/// clamping's verdict; the others must not be touched by it.
fn third_clamping(sphere: usize, change: impl Fn(&mut Vec<[f64; 3]>)) -> String {
    let mut blocks = session_a();
    change(&mut blocks[6 + sphere - 1].1);
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary.len(), 5, "{summary:?}");
    for other in [0, 1, 3, 4] {
        assert_eq!(summary[other], "OK");
    }
    summary[2].clone()
}

/// ERRATA: a wrong Z hit leaves no residual in a five-point block; the side
/// hits, driven to the centre's height, tell.
#[test]
fn wrong_z_hit_is_named() {
    for sphere in 1..=3 {
        for error_mm in [0.008, -0.008, 0.03, -0.06, 0.2, -0.5, 3.0] {
            let verdict = third_clamping(sphere, |points| points[0][2] += error_mm);
            assert!(
                verdict.contains(&format!("SPHERE{sphere}:lone_hit_offset")),
                "{verdict}"
            );
        }
    }
}

/// Where the side hits were driven to the height of the wrong Z hit, nothing
/// in the block shows it; the tilt of the plate does.
#[test]
fn wrong_z_that_moves_the_whole_block_shows_as_tilt() {
    for sphere in 1..=3 {
        for error_mm in [0.12, -0.12, 0.18] {
            let verdict = third_clamping(sphere, |points| {
                for point in points {
                    point[2] += error_mm;
                }
            });
            assert!(
                verdict.contains("tilt"),
                "sphere {sphere} {error_mm}: {verdict}"
            );
        }
    }
}

/// A missed measurement printed as zeros, anywhere in the block.
#[test]
fn null_point_is_named() {
    for hit in 0..5 {
        let verdict = third_clamping(2, |points| points[hit] = [0.0; 3]);
        assert_eq!(verdict, "SPHERE2:null_point");
    }
}

/// A lost sign in any coordinate is named with hit and axis.
#[test]
fn lost_sign_is_named() {
    for hit in 0..5 {
        for axis in 0..3 {
            let mut blocks = session_a();
            blocks[6].1[hit][axis] *= -1.0;
            let outcome = run_blocks(job(), &blocks);
            let reasons = &outcome.verdicts[2].reasons;
            // The top hit's Z moves only the centre (no residual): named as lone hit.
            let lone = outcome.summary()[2].contains("lone_hit_offset");
            let sign = reasons.iter().any(|r| {
                r.reason
                    == umi_protocol::reason::Reason::SuspectSign {
                        hit: u16::try_from(hit + 1).unwrap(),
                        axis: u8::try_from(axis).unwrap(),
                    }
            });
            assert!(sign || lone, "hit {hit} axis {axis}: {reasons:?}");
            assert!(!outcome.verdicts[2].ok);
        }
    }
}

/// All signs of a block lost: a perfect sphere at a wrong place.
#[test]
fn all_signs_of_a_block_lost_shows_in_the_distances() {
    let verdict = third_clamping(1, |points| {
        for point in points {
            *point = point.map(f64::abs);
        }
    });
    assert!(!verdict.is_empty() && verdict != "OK", "{verdict}");
}

/// A repeated line instead of the next point: four points that fit perfectly.
#[test]
fn repeated_point_is_named() {
    for hit in 1..5 {
        let verdict = third_clamping(3, |points| points[hit] = points[hit - 1]);
        assert_eq!(verdict, "SPHERE3:duplicate_point");
    }
}

/// A homing error of 0.18 mm in Z (Sawula 2013, section 5.2) moves the whole
/// setup and leaves no residual; the limit on the shift names it.
#[test]
fn datum_off_in_z_is_named() {
    let mut blocks = session_a();
    for (_, points) in &mut blocks[9..12] {
        for point in points {
            point[2] += 0.18;
        }
    }
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary, ["OK", "OK", "OK", "shift", "OK"]);
}

/// Spheres 2 and 3 exchanged: at different heights the distances show it.
#[test]
fn exchanged_spheres_are_named() {
    let mut blocks = session_a();
    let (two, three) = (blocks[4].1.clone(), blocks[5].1.clone());
    blocks[4].1 = three;
    blocks[5].1 = two;
    let outcome = run_blocks(job(), &blocks);
    let summary = outcome.summary();
    assert!(summary[1].contains("distance_error"), "{summary:?}");
    assert!(summary[1].contains("suspect_exchange"), "{summary:?}");
    assert_eq!(summary[2], "OK");
}

/// With all balls at one height and equal legs the exchanged setup has hardly
/// a residual: it seems turned over. The limits on the pose name it.
#[test]
fn exchanged_spheres_at_one_height_are_named_by_the_pose() {
    let mut blocks = session_a();
    for block in &mut blocks {
        if block.0 == "SPHERE2" {
            for point in &mut block.1 {
                point[2] += 25.67;
            }
        }
    }
    let (two, three) = (blocks[4].1.clone(), blocks[5].1.clone());
    blocks[4].1 = three;
    blocks[5].1 = two;
    let mut job = job();
    // Legs of 273.014 and 273.041 mm: the distances alone must not decide here.
    job.limits.distance_error_mm = 0.1;
    job.limits.registration_rms_mm = 0.1;
    let summary = run_blocks(job, &blocks).summary();
    assert!(!summary[1].contains("distance_error"), "{summary:?}");
    assert!(!summary[1].contains("registration_rms"), "{summary:?}");
    assert!(summary[1].contains("tilt"), "{summary:?}");
    assert!(summary[1].contains("suspect_exchange"), "{summary:?}");
}

/// Two opposite hits exchanged leave fit and pose as they are; the approaches
/// say that the hits are not those that the job means.
#[test]
fn exchanged_hits_are_named() {
    let verdict = third_clamping(2, |points| points.swap(3, 4));
    assert_eq!(verdict, "SPHERE2:approach_angle");
}

/// Fewer or more points than the job asks for.
#[test]
fn counts_must_agree() {
    let four = third_clamping(1, |points| {
        points.pop();
    });
    assert_eq!(four, "SPHERE1:missing_points");

    let mut blocks = session_a();
    let extra = [
        blocks[6].1[0][0] + 1.0,
        blocks[6].1[0][1],
        blocks[6].1[0][2],
    ];
    blocks[6].1.push(extra);
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &blocks {
        let announced = u16::try_from(points.len()).unwrap();
        feed(&mut run, &mut outcome, name, points, announced);
    }
    assert_eq!(outcome.summary()[2], "SPHERE1:wrong_count");
}
