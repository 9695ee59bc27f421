//! What the scanner sees of scenes whose truth is known.

use umi_kinematics::Pose;
use umi_scan::format::profiles::{Depth, gocator};

use super::{LineProfile, LineScanner, Optics, PulseFate};
use crate::scene::{LineScannerSpec, Scene};

/// A table at Z 0, and a ring of 41.20 / 19.75 mm, 6.30 mm high, on it.
const WASHER: &str = r#"
    [[body]]
    name = "TABLE"
    shape = "half_space"
    [[body]]
    name = "WASHER"
    shape = { ring = { radius_mm = 9.875, outer_radius_mm = 20.6, height_mm = 6.3 } }
    position_mm = [0.0, 0.0, 6.3]
"#;

const BALL: &str = r#"
    [[body]]
    name = "BALL"
    shape = { sphere = { radius_mm = 12.7 } }
"#;

fn spec() -> LineScannerSpec {
    LineScannerSpec {
        noise_um: [0.0; 2],
        ..LineScannerSpec::preset("gocator").unwrap()
    }
}

/// The sensor's origin at a height over the middle of the scene.
fn at(y_mm: f64, z_mm: f64) -> Pose {
    Pose::shift_mm(nalgebra::Vector3::new(0.0, y_mm, z_mm))
}

fn look(text: &str, spec: &LineScannerSpec, pose: &Pose) -> LineProfile {
    Optics::new(spec.clone()).profile(&Scene::parse(text).unwrap(), |_| *pose)
}

#[test]
fn samples_lie_on_the_ball_and_on_their_columns() {
    let profile = look(BALL, &spec(), &at(2.0, 0.0));
    let seen: Vec<_> = profile.iter().flatten().collect();
    assert!(seen.len() > 200, "{}", seen.len());
    for sample in &seen {
        let radius = libm::sqrt(sample.x_mm * sample.x_mm + 4.0 + sample.z_mm * sample.z_mm);
        assert!((radius - 12.7).abs() < 1e-8, "{sample:?}");
    }
    let optics = Optics::new(spec());
    for (column, sample) in profile.iter().enumerate() {
        if let Some(sample) = sample {
            assert!((optics.place(column, sample.z_mm) - sample.x_mm).abs() < 1e-9);
        }
    }
    // Steeper than 80 degrees nothing comes back.
    assert!(
        seen.iter()
            .all(|s| s.cosine >= libm::cos(80_f64.to_radians()) - 1e-12)
    );
}

#[test]
fn the_field_is_that_of_the_table() {
    const TABLE: &str = "[[body]]\nname = \"T\"\nshape = \"half_space\"\n";
    for (z, width, pitch) in [(-39.999, 47.0, 0.044), (39.999, 85.0, 0.075)] {
        // The table is at -z in the sensor's frame.
        let profile = look(TABLE, &spec(), &at(0.0, z));
        let seen: Vec<_> = profile.iter().flatten().collect();
        let (first, last) = (seen.first().unwrap(), seen.last().unwrap());
        assert!((last.x_mm - first.x_mm - width).abs() < 2.0 * pitch);
        let steps = (last.x_mm - first.x_mm) / (seen.len() - 1) as f64;
        assert!((steps - pitch).abs() < 1e-4, "{steps}");
    }
    for z in [-40.001, 40.001] {
        assert!(
            look(TABLE, &spec(), &at(0.0, z))
                .iter()
                .all(Option::is_none)
        );
    }
}

#[test]
fn the_camera_does_not_see_behind_a_wall() {
    // The camera is on the +Y side: behind the ring, seen from there, the table is hidden.
    let steep = LineScannerSpec {
        baseline_mm: 120.0,
        ..spec()
    };
    let table = |y: f64| {
        let profile = look(WASHER, &steep, &at(y, 10.0));
        let seen = profile.iter().flatten();
        let middle = seen.filter(|s| s.x_mm.abs() < 3.0 && s.z_mm < -9.9);
        middle.count()
    };
    assert!(table(22.0) > 50);
    assert_eq!(table(-22.0), 0);
    // The camera looks down by atan(120 / 140): the ring hides 5.4 mm behind it.
    assert!(table(-27.0) > 50);
}

#[test]
fn noise_has_its_size_and_grows_with_the_incidence() {
    let noisy = LineScannerSpec {
        noise_um: [5.0; 2],
        speckle_um: 0.0,
        ..spec()
    };
    let spread = |tilt_deg: f64| {
        let pose = Pose::turn(
            &nalgebra::Vector3::x(),
            &nalgebra::Vector3::zeros(),
            tilt_deg.to_radians(),
        );
        let scene = Scene::parse("[[body]]\nname = \"T\"\nshape = \"half_space\"\n").unwrap();
        let mut scanner = LineScanner::new(noisy.clone(), 7);
        let clean = scanner.optics().profile(&scene, |_| pose);
        let (mut n, mut sum) = (0.0, 0.0);
        for _ in 0..20 {
            let taken = scanner.noisy(clean.clone());
            for (a, b) in taken.iter().zip(&clean) {
                if let (Some(a), Some(b)) = (a, b) {
                    n += 1.0;
                    sum += (a.z_mm - b.z_mm) * (a.z_mm - b.z_mm);
                }
            }
        }
        assert!(n > 10_000.0);
        libm::sqrt(sum / n) * 1e3
    };
    assert!((spread(0.0) - 5.0).abs() < 0.15);
    assert!((spread(-60.0) - 10.0).abs() < 0.3);
}

#[test]
fn speckle_is_shared_by_neighbours() {
    let speckled = LineScannerSpec {
        speckle_um: 4.0,
        speckle_samples: 5.0,
        ..spec()
    };
    let scene = Scene::parse("[[body]]\nname = \"T\"\nshape = \"half_space\"\n").unwrap();
    let mut scanner = LineScanner::new(speckled, 3);
    let clean = scanner.optics().profile(&scene, |_| Pose::identity());
    let (mut own, mut shared, mut n) = (0.0, 0.0, 0.0);
    for _ in 0..40 {
        let taken: Vec<f64> = scanner
            .noisy(clean.clone())
            .iter()
            .flatten()
            .map(|s| s.z_mm)
            .collect();
        for pair in taken.windows(2) {
            own += pair[0] * pair[0];
            shared += pair[0] * pair[1];
            n += 1.0;
        }
    }
    assert!((libm::sqrt(own / n) * 1e3 - 4.0).abs() < 0.2);
    assert!((shared / own - libm::exp(-0.2)).abs() < 0.03);
}

#[test]
fn a_mirror_gives_false_points_and_is_lost_where_it_dazzles() {
    let shiny = LineScannerSpec {
        gloss_deg: 4.0,
        steepest_deg: 60.0,
        ..spec()
    };
    let clean = look(BALL, &shiny, &at(0.0, 0.0));
    // Half way to the camera the ball mirrors into it: atan(60 / 117) / 2 about X.
    let dazzled = look(BALL, &shiny, &at(12.7 * libm::sin(0.224), 0.0));
    let middle = |profile: &LineProfile| {
        profile
            .iter()
            .flatten()
            .filter(|s| s.x_mm.abs() < 0.4)
            .count()
    };
    assert!(middle(&clean) > 5);
    assert_eq!(middle(&dazzled), 0);
    // A steep face mirrors the laser to the table beside it, and the camera takes that place for
    // one in the laser's plane, high above.
    let mut washer = shiny;
    washer.gloss_deg = 0.0;
    washer.baseline_mm = 20.0;
    let wedge = "[[body]]\nname = \"T\"\nshape = \"half_space\"\n[[body]]\nname = \"W\"\n\
        shape = { block = { size_mm = [20.0, 20.0, 20.0] } }\nposition_mm = [0.0, 0.0, 6.0]\n\
        rotation_deg = [65.0, 0.0, 0.0]\n";
    let falses = |spec: &LineScannerSpec| {
        let profile = look(wedge, spec, &at(0.0, 0.0));
        profile.iter().flatten().filter(|s| s.is_false).count()
    };
    assert_eq!(falses(&washer), 0);
    washer.gloss_deg = 1.0;
    assert!(falses(&washer) > 100);
    let high = look(wedge, &washer, &at(0.0, 0.0));
    let high = high.iter().flatten().filter(|s| s.is_false);
    // From the face at 6 mm the light falls 7.15 mm aside; the camera at (20, 130) sees that place
    // over the plane at 34.2 mm.
    assert!(high.into_iter().all(|s| (s.z_mm - 34.2).abs() < 0.5));
}

#[test]
fn an_exposure_is_the_mean_over_its_motion() {
    let blurred = LineScannerSpec {
        exposure_us: 3000.0,
        ..spec()
    };
    let scene = Scene::parse("[[body]]\nname = \"T\"\nshape = \"half_space\"\n").unwrap();
    let optics = Optics::new(blurred);
    // Up by 1 mm in a millisecond: the mean is that of the middle, but for what is square.
    let profile = optics.profile(&scene, |us| at(0.0, us * 1e-3));
    let middle = profile[640].unwrap();
    assert!(middle.z_mm.abs() < 1e-9);
    // Out of the range in two of three moments: too little light.
    let gone = optics.profile(&scene, |us| at(0.0, 39.5 + us * 1e-3));
    assert!(gone[640].is_some());
    let gone = optics.profile(&scene, |us| at(0.0, 40.5 + us * 1e-3));
    assert!(gone[640].is_none());
}

#[test]
fn the_input_drops_what_is_short_or_early_and_counts_it() {
    let mut scanner = LineScanner::new(spec(), 1);
    assert_eq!(scanner.pulse(0.0, 19.0), PulseFate::TooShort);
    assert_eq!(scanner.pulse(10.0, 20.0), PulseFate::Taken);
    assert_eq!(scanner.pulse(1009.0, 20.0), PulseFate::Busy);
    assert_eq!(scanner.pulse(1010.0, 20.0), PulseFate::Taken);
    let tally = scanner.tally();
    assert_eq!((tally.short, tally.busy), (1, 1));
}

/// What is sent is read back by the reader of captures: stamps, samples, and what has no range.
#[test]
fn the_channel_is_read_back() {
    for evenly_spaced in [false, true] {
        let spec = LineScannerSpec {
            evenly_spaced,
            clock_offset_us: 5e6,
            clock_drift_ppm: 100.0,
            repeated_share: 0.3,
            lost_share: 0.2,
            ..spec()
        };
        let scene = Scene::parse(WASHER).unwrap();
        let mut scanner = LineScanner::new(spec, 11);
        let profile = scanner.take(&scene, |_| at(0.0, 10.0));
        let mut bytes = Vec::new();
        for frame in 0..40_i32 {
            bytes.extend(scanner.send(f64::from(frame) * 2000.0, i64::from(frame) - 3, &profile));
        }
        let tally = scanner.tally();
        assert!(tally.lost > 2 && tally.repeated > 4, "{tally:?}");
        let mut came = 0;
        gocator::visit(bytes.as_slice(), "channel", Depth::Samples, |read| {
            came += 1;
            let frame = read.stamp.frame as f64;
            let shown = 5e6 + 1.0001 * frame * 2000.0;
            assert!((read.stamp.t_us - shown).abs() < 0.5);
            assert_eq!(read.stamp.encoder, Some(read.stamp.frame as i64 - 3));
            if !evenly_spaced {
                let valid = profile.iter().flatten().count();
                assert_eq!(read.samples.len(), valid);
                for sample in read.samples {
                    let truth = profile[sample.index as usize].unwrap();
                    assert!((sample.x_mm - truth.x_mm).abs() < 1e-3);
                    assert!((sample.z_mm - truth.z_mm).abs() < 1e-3);
                }
            }
            assert!(read.samples.len() > 500);
            for sample in read.samples {
                // Table and ring, by the place; what is near an edge may be between both.
                let r = sample.x_mm.abs();
                let near_edge = (r - 9.875).abs() < 0.3 || (r - 20.6).abs() < 0.3;
                let z = if r > 9.875 && r < 20.6 { -3.7 } else { -10.0 };
                assert!(near_edge || (sample.z_mm - z).abs() < 2e-3, "{sample:?}");
            }
            Ok(())
        })
        .unwrap();
        assert_eq!(came, tally.taken - tally.lost + tally.repeated);
    }
}

/// Intensities stand behind their profile, by the incidence; who does not ask reads the same profiles as without them.
#[test]
fn intensities_are_read_back_beside_the_same_samples() {
    let scene = Scene::parse(WASHER).unwrap();
    for evenly_spaced in [false, true] {
        let run = |intensities, depth| {
            let spec = LineScannerSpec {
                evenly_spaced,
                intensities,
                ..spec()
            };
            let mut scanner = LineScanner::new(spec, 11);
            let profile = scanner.take(&scene, |_| at(0.0, 10.0));
            let bytes = scanner.send(0.0, 0, &profile);
            let mut all = Vec::new();
            let read = gocator::visit(bytes.as_slice(), "channel", depth, |read| {
                all.push((
                    read.stamp,
                    read.samples.to_vec(),
                    read.intensities.map(<[f64]>::to_vec),
                ));
                Ok(())
            });
            assert_eq!(read.unwrap(), [0; 0]);
            (profile, all)
        };
        let (_, without) = run(false, Depth::Intensities);
        let (_, unasked) = run(true, Depth::Samples);
        assert_eq!(without, unasked);
        let (profile, asked) = run(true, Depth::Intensities);
        assert_eq!(asked[0].1, without[0].1);
        let bright = asked[0].2.as_ref().unwrap();
        assert_eq!(bright.len(), asked[0].1.len());
        for (sample, bright) in asked[0].1.iter().zip(bright) {
            assert!((1.0..=200.0).contains(bright), "{bright}");
            if !evenly_spaced {
                let truth = profile[sample.index as usize].unwrap();
                assert!((bright - truth.brightness()).abs() <= 0.5, "{sample:?}");
            }
        }
    }
}

/// The same seed gives the same bytes.
#[test]
fn a_seed_says_all() {
    let scene = Scene::parse(WASHER).unwrap();
    let run = |seed| {
        let mut scanner = LineScanner::new(LineScannerSpec::preset("s2").unwrap(), seed);
        let profile = scanner.take(&scene, |_| at(1.0, 5.0));
        scanner.send(1.0, 0, &profile)
    };
    assert_eq!(run(4), run(4));
    assert_ne!(run(4), run(5));
}

/// Presets are found, others are refused by name; the file says what differs.
#[test]
fn a_scene_names_its_scanner() {
    let scene = Scene::parse("[line_scanner]\npreset = \"s2\"\nnoise_um = [1, 2]\n").unwrap();
    let spec = scene.line_scanner.unwrap();
    assert_eq!((spec.range_mm, spec.noise_um), (50.0, [1.0, 2.0]));
    let error = Scene::parse("[line_scanner]\npreset = \"faro\"\n").unwrap_err();
    assert!(error.message.contains("gocator, s2, roland"), "{error}");
    let turned = "[line_scanner]\nrotation = [[1,0,0],[0,1,0],[0,0,-1]]\n";
    assert!(
        Scene::parse(turned)
            .unwrap_err()
            .message
            .contains("line_scanner.rotation")
    );
}
