//! Smoothing against the largest turn and the travel.

use std::path::Path;

use nalgebra::Vector3;

use super::axes::{Driver, Stance};
use crate::plan::laser_run::RunPoint;
use crate::plan::spec::ScanSpec;

/// The beam's angles zigzag, so that smoothing has work; the way bends by 10 degrees in one step, where the spindle stood
/// still.
#[test]
fn smoothing_that_turns_the_spindle_too_far_is_not_taken() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let spec = ScanSpec::open(&folder.join("step_wavy.toml")).unwrap();
    let driver = Driver::new(&spec);
    let points = |bend_deg: f64| -> Vec<RunPoint> {
        (0..12)
            .map(|k| {
                let (sin, cos) = if k < 6 { 0.0 } else { bend_deg }.to_radians().sin_cos();
                RunPoint {
                    at: Vector3::x() * f64::from(k),
                    normal: Vector3::z(),
                    along: Vector3::new(cos, sin, 0.0),
                }
            })
            .collect()
    };
    let rough: Vec<Vec<f64>> = (0..12)
        .map(|k| vec![if k % 2 == 0 { 1.0 } else { -1.0 }, 0.0, 0.0])
        .collect();
    let most = |rows: &[Vec<f64>]| {
        rows.windows(2)
            .flat_map(|w| [0, 1, 2].map(|k| (w[1][k] - w[0][k]).abs()))
            .fold(0.0, f64::max)
    };
    let mut rows = rough.clone();
    driver.smooth_within_limits(&mut rows, &points(10.0), Stance::default());
    assert!(most(&rows) <= spec.plan.max_turn_deg, "{rows:?}");
    // A way that bends by less is followed, and smoothed.
    let mut rows = rough.clone();
    driver.smooth_within_limits(&mut rows, &points(4.0), Stance::default());
    assert!(most(&rows) <= spec.plan.max_turn_deg, "{rows:?}");
    assert_ne!(rows, rough);
}

/// Beams that lean to either side keep the sensor lower than one straight down, which smoothing would make of them.
#[test]
fn smoothing_that_leaves_the_travel_is_not_taken() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let mut spec = ScanSpec::open(&folder.join("step_wavy.toml")).unwrap();
    let points: Vec<RunPoint> = (0..12)
        .map(|k| RunPoint {
            at: Vector3::x() * f64::from(k),
            normal: Vector3::z(),
            along: Vector3::x(),
        })
        .collect();
    let rough: Vec<Vec<f64>> = (0..12)
        .map(|k| vec![if k % 2 == 0 { 1.0 } else { -1.0 }, 0.0, 0.0])
        .collect();
    let z = |spec: &ScanSpec, rows: &[Vec<f64>]| -> [f64; 2] {
        let off = spec.sensor.reference_mm;
        let each = rows.iter().zip(&points).map(|(angles, point)| {
            let beam = spec.machine.pointing(angles).0;
            spec.machine.carriage(&(point.at - beam * off), angles).z
        });
        each.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| {
            [low.min(z), high.max(z)]
        })
    };
    let smoothed = |spec: &ScanSpec| {
        let mut rows = rough.clone();
        Driver::new(spec).smooth_within_limits(&mut rows, &points, Stance::default());
        rows
    };
    assert_ne!(smoothed(&spec), rough);
    let (before, after) = (z(&spec, &rough), z(&spec, &smoothed(&spec)));
    assert!(
        after[0] < before[0] || after[1] > before[1],
        "{before:?} {after:?}"
    );
    spec.machine.travel_mm[2] = before;
    let kept = z(&spec, &smoothed(&spec));
    assert!(
        kept[0] >= before[0] - 1e-9 && kept[1] <= before[1] + 1e-9,
        "{kept:?} {before:?}"
    );
}

/// A sensor that stands nearer or further off has the same angles, so that they are not sought again; where the travel may
/// end before, they are.
#[test]
fn another_distance_has_the_same_angles() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let mut spec = ScanSpec::open(&folder.join("step_wavy.toml")).unwrap();
    let points: Vec<RunPoint> = (0..40)
        .map(|k| {
            let (sin, cos) = (f64::from(k) / 20.0).sin_cos();
            RunPoint {
                at: Vector3::new(30.0 * sin, 0.0, 30.0 * cos),
                normal: Vector3::new(sin, 0.0, cos),
                along: Vector3::new(cos, 0.0, -sin),
            }
        })
        .collect();
    let near = Stance {
        lean_across_deg: 4.0,
        ..Stance::default()
    };
    let mut least = f64::INFINITY;
    for shift_mm in [0.9, -0.9] {
        let far = Stance { shift_mm, ..near };
        let driver = Driver::new(&spec);
        let followed = driver.follow(&points, near);
        let again = driver.follow(&points, far);
        let shifted = driver.shifted(&followed, &points, near, far).unwrap();
        assert!(!again.pieces.is_empty());
        assert_eq!(shifted.pieces.len(), again.pieces.len());
        for (one, other) in shifted.pieces.iter().zip(&again.pieces) {
            assert_eq!((one.from, &one.axes), (other.from, &other.axes));
            let z = one.axes.iter().map(|axes| axes[2]);
            least = z.fold(least, f64::min);
        }
    }
    // So that the nearer one is beyond the travel.
    spec.machine.travel_mm[2][0] = least + 0.5;
    let driver = Driver::new(&spec);
    let far = Stance {
        shift_mm: -0.9,
        ..near
    };
    let followed = driver.follow(&points, near);
    assert!(driver.shifted(&followed, &points, near, far).is_none());
}

/// The beam alone is that of both poses.
#[test]
fn the_beam_is_that_of_table_and_head() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    for file in ["step_wavy.toml", "kinematics_ac.toml", "three_axes.toml"] {
        let machine = ScanSpec::open(&folder.join(file)).unwrap().machine;
        let count = machine.limits().len() - 3;
        for k in 0..50 {
            let angles: Vec<f64> = (0..count)
                .map(|axis| 360.0 * (f64::from(k) * 0.37 + 0.21 * axis as f64).sin())
                .collect();
            let off = machine.beam(&angles) - machine.pointing(&angles).0;
            assert!(off.norm() < 1e-14, "{file} {angles:?}: {}", off.norm());
        }
    }
}
