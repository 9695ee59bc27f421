use nalgebra::Vector3;
use umi_scan::parallel::Threads;

use super::{AreaScan, scan};
use crate::scene::Scene;

fn scene(scanner: &str, bodies: &str) -> Scene {
    let text = format!(
        "[scanner]\nposition_mm = [0.0, -200.0, 300.0]\nlook_at_mm = [0.0, 0.0, 10.0]\nfield_deg = [20.0, 20.0]\n\
         distance_mm = 350.0\nspacing_mm = 1.5\n{scanner}\n{bodies}"
    );
    Scene::parse(&text).unwrap()
}

const BODIES: &str = "
[[body]]
name = \"TABLE\"
shape = \"half_space\"
[[body]]
name = \"CONE\"
shape = { cone = { half_angle_deg = 30.0, height_mm = 40.0 } }
position_mm = [0.0, 0.0, 45.0]
rotation_deg = [10.0, 0.0, 0.0]
[[body]]
name = \"BLOCK\"
shape = { block = { size_mm = [20.0, 20.0, 30.0] } }
position_mm = [-35.0, 10.0, 30.0]
";

fn seen(scanner: &str) -> (Scene, AreaScan) {
    let scene = scene(scanner, BODIES);
    let seen = scan(&scene, scene.scanner.as_ref().unwrap(), 3, Threads::new(2));
    (scene, seen)
}

/// Where a point is in the machine.
fn placed(scene: &Scene, p: &Vector3<f64>) -> Vector3<f64> {
    let pose = scene.scanner.as_ref().unwrap().placed();
    pose.rotation * p + pose.translation_mm
}

#[test]
fn without_errors_every_point_lies_on_a_body_and_is_seen_by_both_cameras() {
    let (scene, seen) = seen("baseline_mm = 120.0\ngrazing_deg = 70.0");
    assert!(seen.points.len() > 3000 && seen.shadowed > 50 && seen.grazing > 20);
    assert_eq!(
        seen.rays,
        seen.points.len() + seen.empty + seen.grazing + seen.shadowed + seen.dropped
    );
    let pose = scene.scanner.as_ref().unwrap().placed();
    let eyes =
        [0.0, 120.0].map(|x| pose.rotation * Vector3::new(x, 0.0, 0.0) + pose.translation_mm);
    let mut on_cone = 0;
    for p in &seen.points {
        let q = placed(&scene, p);
        let nearest = |name: &str| {
            let body = scene.bodies().iter().find(|b| b.name == name).unwrap();
            body.distance_mm(&q)
        };
        on_cone += usize::from(nearest("CONE").abs() < 1e-6);
        assert!(scene.clearance(&q, 0.0, |_| true).abs() < 1e-6, "{q:?}");
        for eye in eyes {
            let way = q - eye;
            let free = scene.beam(&eye, &way.normalize(), way.norm() - 1e-3, |_| true);
            assert!(free.is_none(), "{q:?} is hidden from {eye:?}");
        }
    }
    assert!(on_cone > 200, "{on_cone}");
}

#[test]
fn noise_is_as_large_as_stated_and_neighbours_share_what_they_should() {
    let (_, truth) = seen("");
    let error = |scanner: &str| -> Vec<f64> {
        let (_, noisy) = seen(scanner);
        let pairs = truth.points.iter().zip(&noisy.points);
        pairs.map(|(a, b)| (b - a).dot(&a.normalize())).collect()
    };
    let square = |e: &[f64]| e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64;
    let beside = |e: &[f64]| e.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / e.len() as f64;
    let own = error("noise_mm = 0.05");
    assert!((square(&own).sqrt() - 0.05).abs() < 0.003);
    assert!(beside(&own).abs() < 0.05 * square(&own));
    // A field of twelve lengths across: its mean square over the image is not exact.
    let shared = error("shared_noise_mm = 0.05\nshared_length_mm = 10.0");
    let size = square(&shared).sqrt();
    assert!((0.03..0.07).contains(&size), "{size}");
    assert!(beside(&shared) > 0.95 * square(&shared));
    // Own noise is not moved by the shared one.
    let both = error("noise_mm = 0.05\nshared_noise_mm = 0.05\nshared_length_mm = 10.0");
    let left = both.iter().zip(own.iter().zip(&shared));
    assert!(left.map(|(b, (o, s))| b - o - s).all(|x| x.abs() < 1e-9));
}

#[test]
fn points_are_lost_mixed_and_out_of_range_as_stated() {
    let (_, whole) = seen("");
    let (_, few) = seen("drop_out = 0.25");
    let share = few.dropped as f64 / whole.points.len() as f64;
    assert!((share - 0.25).abs() < 0.02, "{share}");
    let (scene, mixed) = seen("spot_mm = 2.0");
    let off = |p: &&Vector3<f64>| scene.clearance(&placed(&scene, p), 0.0, |_| true).abs() > 0.05;
    let between = mixed.points.iter().filter(off).count();
    assert!(
        mixed.mixed > 50 && between > 30,
        "{} {between}",
        mixed.mixed
    );
    assert!(mixed.mixed < mixed.points.len() / 10);
    let (_, near) = seen("range_mm = [0.0, 330.0]");
    assert!(near.points.iter().all(|p| p.z <= 330.0 + 1e-9));
    assert!(near.empty > 500 && near.points.len() > 500);
}

#[test]
fn threads_change_no_bit_and_seeds_do() {
    let scene = scene(
        "noise_mm = 0.02\nshared_noise_mm = 0.01\ndrop_out = 0.1",
        BODIES,
    );
    let scanner = scene.scanner.as_ref().unwrap();
    let one = scan(&scene, scanner, 5, Threads::new(1));
    assert_eq!(one, scan(&scene, scanner, 5, Threads::new(3)));
    assert_ne!(one, scan(&scene, scanner, 6, Threads::new(3)));
}

#[test]
fn a_scanner_that_cannot_be_is_refused() {
    let refused = |scanner: &str, word: &str| {
        let text = format!(
            "[scanner]\nposition_mm = [0, 0, 300]\nfield_deg = [20, 20]\ndistance_mm = 300\n{scanner}"
        );
        let message = Scene::parse(&text).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused("spacing_mm = 1.0", "look_at_mm");
    refused("spacing_mm = 1.0\nlook_at_mm = [0, 0, 300]", "look_at_mm");
    refused("spacing_mm = 0.001\nlook_at_mm = [0, 0, 0]", "spacing_mm");
    refused(
        "spacing_mm = 1.0\nlook_at_mm = [0, 0, 0]\nrange_mm = [3, 2]",
        "range_mm",
    );
    refused(
        "spacing_mm = 1.0\nlook_at_mm = [0, 0, 0]\nnoise_mm = nan",
        "noise_mm",
    );
    refused(
        "spacing_mm = 1.0\nlook_at_mm = [0, 0, 0]\nnoise = 1",
        "noise",
    );
}
