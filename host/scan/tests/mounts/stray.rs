//! One observation that lies off all others is named, and chance is not.

use super::*;

/// Balls at even angles of an axis, measured to some micrometres.
fn measured(balls: usize, angles: usize, noise_mm: f64, random: &mut Random) -> Vec<TurnedCentre> {
    let mut vector = || Vector3::from_fn(|_, _| random.signed());
    let (u, foot) = (vector().normalize(), 50.0 * vector());
    let across = u.cross(&vector()).normalize();
    let mut centres = Vec::new();
    for ball in 0..balls {
        let place = foot + across * (60.0 + 40.0 * ball as f64) + u * (20.0 * ball as f64);
        for k in 0..angles {
            let angle_deg = 360.0 * k as f64 / angles as f64;
            let there = Pose::turn(&u, &foot, angle_deg.to_radians()).point(&place);
            centres.push(TurnedCentre {
                angle_deg,
                ball,
                measured_mm: there + noise_mm * Vector3::from_fn(|_, _| random.normal()),
            });
        }
    }
    centres
}

/// An angle that was written down wrong, by a digit or by ten degrees, is named with the one that the others have: it
/// widened the axis' uncertainty, and nothing said why. A wrong coordinate is named without an angle.
#[test]
fn a_wrong_angle_among_the_centres_is_named_with_the_right_one() {
    let mut random = Random(5);
    for (balls, angles) in [(1, 6), (1, 12), (2, 5), (3, 8)] {
        for wrong_deg in [0.05, -0.1, 1.0, -10.0, 20.0] {
            let mut centres = measured(balls, angles, 0.002, &mut random);
            let place = (random.signed().abs() * centres.len() as f64) as usize;
            let right_deg = centres[place].angle_deg;
            centres[place].angle_deg += wrong_deg;
            let words = match axis(&centres) {
                Ok(found) => {
                    let outlier = found.outlier.as_ref().unwrap();
                    assert_eq!(outlier.rows, [place + 1], "{balls} {angles} {wrong_deg}");
                    let by_others = outlier.angle_by_others_deg.unwrap();
                    assert!(
                        (by_others - right_deg).abs() < 0.015,
                        "{by_others} {right_deg}"
                    );
                    assert_eq!(found.refuse_doubtful().unwrap_err().code, "outlier");
                    found.warnings.join("\n")
                }
                Err(error) => error.to_string(),
            };
            let row = format!("row {} (at ", place + 1);
            assert!(
                words.contains(&row),
                "{balls} {angles} {wrong_deg}: {words}"
            );
        }
        let mut centres = measured(balls, angles, 0.002, &mut random);
        let bent = centres.len() / 2;
        centres[bent].measured_mm += Vector3::new(0.1, 0.1, -0.1);
        let found = axis(&centres).unwrap().outlier.unwrap();
        assert_eq!(
            (found.rows.clone(), found.angle_by_others_deg),
            (vec![bent + 1], None)
        );
        assert!(
            (found.off_mm - 0.1 * 3_f64.sqrt()).abs() < 0.02,
            "{found:?}"
        );
    }
}

/// An angle at which several balls were measured is named for all of them: two balls at 120.05 degrees.
#[test]
fn an_angle_that_is_wrong_for_all_balls_is_named_once() {
    let mut random = Random(8);
    for balls in [2, 3, 4] {
        for wrong_deg in [0.05, -0.2, 5.0] {
            let mut centres = measured(balls, 6, 0.005, &mut random);
            let wrong: Vec<usize> = (0..balls).map(|ball| 6 * ball + 2).collect();
            for &place in &wrong {
                centres[place].angle_deg += wrong_deg;
            }
            let words = match axis(&centres) {
                Ok(found) => {
                    let outlier = found.outlier.as_ref().unwrap();
                    let rows: Vec<usize> = wrong.iter().map(|place| place + 1).collect();
                    assert_eq!(outlier.rows, rows, "{balls} {wrong_deg}");
                    let by_others = outlier.angle_by_others_deg.unwrap();
                    assert!((by_others - 120.0).abs() < 0.015, "{by_others}");
                    found.warnings.join("\n")
                }
                Err(error) => error.to_string(),
            };
            assert!(words.contains("rows 3, 9"), "{balls} {wrong_deg}: {words}");
        }
    }
}

/// Two that are off widen the scatter that each is held against, and hid each other: two of eight centres, and two samples
/// of one profile.
#[test]
fn two_strays_do_not_hide_each_other() {
    let mut random = Random(9);
    for seed in 0..8 {
        let mut centres = measured(1, 8, 0.003, &mut random);
        let (first, second) = (seed, (seed + 3) % 8);
        centres[first].measured_mm += Vector3::new(0.2, 0.0, 0.1);
        centres[second].measured_mm += Vector3::new(0.0, -0.2, 0.1);
        let found = axis(&centres).unwrap().outlier.unwrap();
        let mut rows = [first + 1, second + 1];
        rows.sort_unstable();
        assert!(
            found.rows == rows || rows.contains(&found.rows[0]),
            "{found:?} {rows:?}"
        );
    }
    for on_plane_too in [false, true] {
        for seed in 0..8 {
            let (mut all, options) = if on_plane_too {
                let tilted = Vector3::new(0.3, -0.2, 1.0);
                (
                    plane(&tilted, BOTH, along_z(0.005), &mut random),
                    on_plane(),
                )
            } else {
                let all = spheres(&[BALL], 15.0, BOTH, along_z(0.005), &mut random);
                (all, on_sphere(Some(15.0)))
            };
            let place = 13 * (seed + 2) + 5;
            for stray in [place, place + 1] {
                all.points[stray].seen_mm.z += 1.0;
            }
            let words = match sensor(&all, &truth(), &options) {
                Ok(answer) => {
                    assert_eq!(answer.refuse_doubtful().unwrap_err().code, "outlier");
                    let mut rows: Vec<usize> = answer.outliers.iter().map(|one| one.row).collect();
                    rows.sort_unstable();
                    assert_eq!(rows, [place + 1, place + 2], "{seed}");
                    answer.warnings.join("\n")
                }
                Err(error) => error.to_string(),
            };
            let named =
                [place + 1, place + 2].map(|row| words.contains(&format!("{row} (profile")));
            assert_eq!(named, [true; 2], "{seed}: {words}");
            // Without them the mount is as good as if they had never been.
            let dropping = SensorOptions {
                drop_outliers: true,
                ..options
            };
            let answer = sensor(&all, &truth(), &dropping).unwrap();
            assert_eq!((answer.dropped.len(), answer.outliers.len()), (2, 0));
            assert!(answer.residuals_mm[place].is_nan());
            assert!(
                answer
                    .warnings
                    .iter()
                    .any(|said| said.starts_with("dropped: rows"))
            );
            assert_eq!(answer.residuals_mm.len(), all.points.len());
            answer.refuse_doubtful().unwrap();
            let (_, shift) = off(&answer);
            assert!(shift < 0.02, "{seed}: {shift}");
        }
    }
}

/// A gross sample makes the mount too uncertain for an answer: the refusal names its row.
#[test]
fn a_refusal_names_the_gross_sample() {
    let mut random = Random(10);
    for off_mm in [3.0, 20.0] {
        let tilted = Vector3::new(0.3, -0.2, 1.0);
        let mut all = plane(&tilted, SMALL_SWING, along_z(0.005), &mut random);
        all.points[100].seen_mm.z += off_mm;
        let words = match sensor(&all, &truth(), &on_plane()) {
            Ok(answer) => answer.warnings.join("\n"),
            Err(error) => error.to_string(),
        };
        assert!(words.contains("row 101 ("), "{off_mm}: {words}");
    }
}

const SMALL_SWING: Swing = Swing {
    a_deg: 15.0,
    c_deg: 60.0,
    a_from_deg: 0.0,
};

/// The normal of a plane looks to where the sensor was, so that its residuals are positive outside, as a ball's are: its
/// sign was that of an eigenvector, and the page of every second calibration showed no point.
#[test]
fn the_normal_of_a_plane_faces_the_sensor() {
    let mut random = Random(11);
    for _ in 0..12 {
        let tilted = Vector3::new(0.3 * random.signed(), 0.3 * random.signed() + 0.4, 1.0);
        let all = plane(&tilted, BOTH, along_z(0.002), &mut random);
        let answer = sensor(&all, &truth(), &on_plane()).unwrap();
        let normal = Vector3::from(answer.features[0].normal.unwrap());
        let seen_from = all.flanges[0].rotation * truth().rotation * Vector3::z();
        assert!(normal.dot(&seen_from) > 0.0);
        let anchor = Vector3::new(10.0, -5.0, 7.0);
        let distance = answer.features[0].distance_mm.unwrap();
        assert!((normal.dot(&anchor) - distance).abs() < 0.01);
    }
}

/// A step of 50 µm at one place of the line in every profile leaves profiles that agree, and a mount that is some
/// micrometres off: it is told; a line that is straight, or bent by less than samples scatter, is not.
#[test]
fn what_is_off_at_one_place_of_the_line_is_told() {
    let mut random = Random(12);
    let tilted = Vector3::new(0.3, -0.2, 1.0);
    for seed in 0..12 {
        for (step_mm, told) in [(0.05, true), (0.002, false), (0.0, false)] {
            let on_ball = seed % 2 > 0;
            let (mut all, options, from) = if on_ball {
                let all = spheres(&[BALL], 15.0, BOTH, Noise::Distance(0.005), &mut random);
                (all, on_sphere(Some(15.0)), 8.0)
            } else {
                (
                    plane(&tilted, BOTH, along_z(0.005), &mut random),
                    on_plane(),
                    12.0,
                )
            };
            for seen in &mut all.points {
                if seen.seen_mm.x > from {
                    seen.seen_mm.z += step_mm;
                }
            }
            let answer = sensor(&all, &truth(), &options).unwrap();
            let is_told = answer
                .warnings
                .iter()
                .any(|said| said.starts_with("along the line: samples at x"));
            assert_eq!(is_told, told, "{seed} {step_mm} {:?}", answer.warnings);
        }
    }
}

/// Of 600 sets of centres that scatter alike, as many have a stray as chance has: one in a thousand by the test.
#[test]
fn centres_that_belong_together_have_no_stray() {
    let mut random = Random(6);
    let named = (0..600)
        .filter(|i| {
            let centres = measured(1 + i % 3, 5 + i % 7, 0.002, &mut random);
            axis(&centres).unwrap().outlier.is_some()
        })
        .count();
    assert!(named <= 4, "{named}");
}

/// A sample of a reflection, 60 µm off among 390 of 5 µm, is named; none is where samples scatter as those of real
/// sensors do, by their range and the more the farther away.
#[test]
fn a_sample_that_is_no_part_of_the_ball_is_named() {
    let mut random = Random(7);
    for seed in 0..20 {
        let mut all = spheres(&[BALL], 15.0, BOTH, Noise::Distance(0.005), &mut random);
        let place = 13 * (seed + 1) + 6;
        all.points[place].seen_mm.z += 0.08;
        let options = on_sphere(Some(15.0));
        let answer = sensor(&all, &truth(), &options).unwrap();
        assert_eq!(answer.outliers.len(), 1);
        let outlier = &answer.outliers[0];
        assert_eq!(outlier.row, place + 1, "{seed}");
        assert!((outlier.off_mm - 0.08).abs() < 0.025, "{outlier:?}");
        let profile = format!("profile {}", all.points[place].flange);
        assert_eq!(outlier.profile, profile);
        assert!(
            answer
                .warnings
                .iter()
                .any(|words| words.starts_with("outlier: row"))
        );
        for noise in [
            Noise::Distance(0.005),
            along_z(0.005),
            Noise::Growing(0.004, 0.0002),
        ] {
            let all = spheres(&[BALL], 15.0, BOTH, noise, &mut random);
            let answer = sensor(&all, &truth(), &options).unwrap();
            assert_eq!(answer.outliers, [], "{seed}");
        }
    }
}

/// Errors with tails, as speckle leaves them (Laplace's law), are no strays: eight standard deviations by the median named
/// 23 of 108 such sets.
#[test]
fn samples_whose_errors_have_tails_are_no_strays() {
    let mut random = Random(13);
    let mut named = 0;
    for _ in 0..60 {
        let mut all = spheres(&[BALL], 15.0, BOTH, Noise::Distance(0.0), &mut random);
        for seen in &mut all.points {
            let u = random.signed();
            seen.seen_mm.z -= 0.0035 * u.signum() * (1.0 - u.abs()).max(1e-9).ln();
        }
        let answer = sensor(&all, &truth(), &on_sphere(Some(15.0))).unwrap();
        named += usize::from(!answer.outliers.is_empty());
    }
    assert!(named <= 1, "{named}");
}

/// A stray among few samples has a great part in what they say, and is named all the same: eight lines of a plane with
/// eight samples each, one or two of them off by eighty standard deviations.
#[test]
fn a_stray_among_few_samples_is_named() {
    let mut random = Random(14);
    let tilted = Vector3::new(0.3, -0.2, 1.0);
    let mut refused = 0;
    for seed in 0..24 {
        let mut all = plane(&tilted, BOTH, along_z(0.002), &mut random);
        let mut place = 0;
        all.points.retain(|seen| {
            place += 1;
            seen.flange < 10 && place % 13 < 8
        });
        let first = 8 * (seed % 10) + 3;
        let strays = if seed % 2 > 0 {
            vec![first]
        } else {
            vec![first, first + 1]
        };
        for &stray in &strays {
            all.points[stray].seen_mm.z += 0.16;
        }
        let dropping = SensorOptions {
            drop_outliers: true,
            ..on_plane()
        };
        // Two in one profile may be too much for a set as small as this: then there is no answer.
        let answer = match sensor(&all, &truth(), &dropping) {
            Ok(answer) => answer,
            Err(error) => {
                assert_eq!(error.code, "uncertain");
                refused += 1;
                continue;
            }
        };
        let mut rows: Vec<usize> = answer.dropped.iter().map(|one| one.row - 1).collect();
        rows.sort_unstable();
        assert_eq!(rows, strays, "{seed}");
    }
    assert!(refused <= 1, "{refused}");
}
