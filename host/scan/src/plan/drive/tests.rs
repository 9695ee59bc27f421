//! Runs over edges rounded with a small radius, where all axes must turn fast.

use std::path::Path;

use nalgebra::{Rotation3, Vector3};

use super::axes::{Driver, Stance};
use crate::plan::laser_run::RunPoint;
use crate::plan::spec::ScanSpec;

/// A straight course on the unrolled surface: a plane, a quarter of a cylinder, a plane; askew by an angle.
fn over_a_fillet(
    radius_mm: f64,
    askew_deg: f64,
    step_mm: f64,
    turned: &Rotation3<f64>,
) -> Vec<RunPoint> {
    let (sin, cos) = askew_deg.to_radians().sin_cos();
    let arc = radius_mm * std::f64::consts::FRAC_PI_2;
    let plane = 8.0;
    let count = ((2.0 * plane + arc) / cos / step_mm).ceil() as usize;
    (0..=count)
        .map(|k| {
            let way = k as f64 * step_mm;
            let (s, y) = (way * cos - plane, way * sin);
            let angle = (s.clamp(0.0, arc) / radius_mm).sin_cos();
            let normal = Vector3::new(angle.0, 0.0, angle.1);
            let forward = Vector3::new(angle.1, 0.0, -angle.0);
            let beyond = s - s.clamp(0.0, arc);
            let at = normal * radius_mm + forward * beyond + Vector3::y() * y;
            RunPoint {
                at: turned * at,
                normal: turned * normal,
                along: turned * (forward * cos + Vector3::y() * sin),
            }
        })
        .collect()
}

#[test]
fn no_axis_turns_faster_than_allowed_over_a_fillet_gone_along_askew() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let spec = ScanSpec::open(&folder.join("step_wavy.toml")).unwrap();
    let driver = Driver::new(&spec);
    let mut driven = 0;
    for about_y in [-45.0, -20.0, 0.0_f64] {
        for about_z in [0.0, 30.0, 60.0, 90.0_f64] {
            let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), about_z.to_radians())
                * Rotation3::from_axis_angle(&Vector3::y_axis(), about_y.to_radians());
            for askew in [0.0, 20.0, 40.0, 55.0, 70.0] {
                let points = over_a_fillet(4.0, askew, 0.4, &turned);
                let (pieces, _) = driver.follow(&points, Stance::default());
                for piece in pieces {
                    driven += piece.axes.len();
                    for (k, pair) in piece.axes.windows(2).enumerate() {
                        let turn = pair[0][3..]
                            .iter()
                            .zip(&pair[1][3..])
                            .map(|(a, b)| (b - a).abs())
                            .fold(0.0, f64::max);
                        assert!(
                            turn <= spec.plan.max_turn_deg,
                            "{turn} degrees at pose {k}, {askew} {about_y} {about_z}"
                        );
                    }
                }
            }
        }
    }
    assert!(driven > 2000, "{driven}");
}
