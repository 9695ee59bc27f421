//! Contacts against closed forms.

use super::*;

fn scene(bodies: &str) -> Scene {
    Scene::parse(bodies).unwrap()
}

fn body(shape: &str) -> Scene {
    scene(&format!(
        "[[body]]\nname = \"B\"\nshape = {shape}\nposition_mm = [1.0, 2.0, 3.0]"
    ))
}

/// Where a ball of 2 mm stops between two points, relative to the body.
fn stop(scene: &Scene, from: [f64; 3], to: [f64; 3]) -> Option<[f64; 3]> {
    let place = Vector3::new(1.0, 2.0, 3.0);
    let [from, to] = [from, to].map(|p| Vector3::from(p) + place);
    let contact = scene.first_contact(&from, &to, 2.0, |_| true)?;
    Some((contact.center_mm - place).into())
}

fn assert_stop(scene: &Scene, from: [f64; 3], to: [f64; 3], expected: [f64; 3]) {
    let found = stop(scene, from, to).expect("a contact");
    let error = (Vector3::from(found) - Vector3::from(expected)).norm();
    assert!(error < 1e-8, "{found:?}, not {expected:?}");
}

/// A sphere, straight on and off centre: x = sqrt(12² - 5²) for a ball of 2 on one of 10.
#[test]
fn sphere() {
    let scene = body("{ sphere = { radius_mm = 10.0 } }");
    assert_stop(&scene, [0.0, 0.0, 50.0], [0.0, 0.0, 0.0], [0.0, 0.0, 12.0]);
    let side = libm::sqrt(144.0 - 25.0);
    assert_stop(
        &scene,
        [50.0, 5.0, 0.0],
        [-50.0, 5.0, 0.0],
        [side, 5.0, 0.0],
    );
    assert_eq!(
        stop(&scene, [50.0, 12.001, 0.0], [-50.0, 12.001, 0.0]),
        None
    );
    // Already there.
    assert_stop(&scene, [0.0, 0.0, 11.0], [0.0, 0.0, 50.0], [0.0, 0.0, 11.0]);
}

/// A block: face, edge (a quarter round of the ball) and corner.
#[test]
fn block() {
    let scene = body("{ block = { size_mm = [20.0, 10.0, 8.0] } }");
    assert_stop(&scene, [3.0, 1.0, 9.0], [3.0, 1.0, -9.0], [3.0, 1.0, 2.0]);
    assert_stop(
        &scene,
        [30.0, 1.0, -4.0],
        [0.0, 1.0, -4.0],
        [12.0, 1.0, -4.0],
    );
    // 1 mm above the top edge x = 10: x = 10 + sqrt(4 - 1).
    assert_stop(
        &scene,
        [30.0, 0.0, 1.0],
        [0.0, 0.0, 1.0],
        [10.0 + libm::sqrt(3.0), 0.0, 1.0],
    );
    // 1 mm above the top and 1 mm beside the end y = 5: x = 10 + sqrt(4 - 1 - 1).
    assert_stop(
        &scene,
        [30.0, 6.0, 1.0],
        [0.0, 6.0, 1.0],
        [10.0 + libm::sqrt(2.0), 6.0, 1.0],
    );
}

/// A bore from within, a boss from without, and the rim of a bore.
#[test]
fn ring_and_boss() {
    let ring = body("{ ring = { radius_mm = 35.0, outer_radius_mm = 50.0, height_mm = 20.0 } }");
    for degrees in [0.0, 33.0, 180.0, 271.0] {
        let (s, c) = f64::to_radians(degrees).sin_cos();
        assert_stop(
            &ring,
            [0.0, 0.0, -10.0],
            [40.0 * c, 40.0 * s, -10.0],
            [33.0 * c, 33.0 * s, -10.0],
        );
    }
    // From above onto the rim: 1 mm inside of it, z = sqrt(4 - 1).
    assert_stop(
        &ring,
        [34.0, 0.0, 9.0],
        [34.0, 0.0, -9.0],
        [34.0, 0.0, libm::sqrt(3.0)],
    );
    let boss = body("{ cylinder = { radius_mm = 10.0, height_mm = 20.0 } }");
    assert_stop(
        &boss,
        [0.0, 30.0, -5.0],
        [0.0, 0.0, -5.0],
        [0.0, 12.0, -5.0],
    );
}

/// The arc surface, on its flank and its crown; a plane at an angle.
#[test]
fn arc_and_plane() {
    let arc = body(
        "{ arc = { radius_mm = 88.87, length_mm = 50.0, width_mm = 70.0, height_mm = 30.0 } }",
    );
    let height = |y: f64| libm::sqrt(90.87 * 90.87 - y * y) - 88.87;
    for y in [0.0, 10.0, -30.0] {
        assert_stop(&arc, [4.0, y, 60.0], [4.0, y, -20.0], [4.0, y, height(y)]);
    }
    let tilted = scene(
        "[[group]]\nname = \"G\"\nrotation_deg = [30.0, 0.0, 0.0]\n\
         [[body]]\nname = \"P\"\nshape = \"half_space\"\ngroup = \"G\"",
    );
    // The plane rises with y by tan 30°, the ball stands 2 / cos 30° above it.
    let contact = tilted
        .first_contact(
            &Vector3::new(0.0, 6.0, 50.0),
            &Vector3::new(0.0, 6.0, -50.0),
            2.0,
            |_| true,
        )
        .unwrap();
    let (s, c) = f64::to_radians(30.0).sin_cos();
    assert!((contact.center_mm.z - (6.0 * s / c + 2.0 / c)).abs() < 1e-8);
    assert!((contact.normal - Vector3::new(0.0, -s, c)).norm() < 1e-8);
}

/// No point of a path up to the contact is closer than the ball's radius, for many
/// paths among many bodies: the first contact is the first.
#[test]
fn nothing_is_passed_over() {
    let scene = scene(
        "[[group]]\nname = \"G\"\nrotation_deg = [10.0, -20.0, 30.0]\ntranslation_mm = [5.0, 0.0, -3.0]\npivot_mm = [1.0, 2.0, 3.0]\n\
         [[body]]\nname = \"A\"\nshape = { sphere = { radius_mm = 4.0 } }\nposition_mm = [10.0, 5.0, 0.0]\ngroup = \"G\"\n\
         [[body]]\nname = \"B\"\nshape = { block = { size_mm = [6.0, 3.0, 9.0] } }\nposition_mm = [-8.0, 2.0, 4.0]\ngroup = \"G\"\n\
         [[body]]\nname = \"C\"\nshape = { ring = { radius_mm = 5.0, outer_radius_mm = 7.0, height_mm = 4.0 } }\nposition_mm = [0.0, -12.0, 0.0]\n\
         [[body]]\nname = \"D\"\nshape = { arc = { radius_mm = 20.0, length_mm = 10.0, width_mm = 12.0, height_mm = 6.0 } }\nposition_mm = [0.0, 12.0, -2.0]\nrotation_deg = [0.0, 0.0, 45.0]",
    );
    let mut random = fastrand::Rng::with_seed(7);
    let mut point = || Vector3::from_fn(|_, _| 40.0 * random.f64() - 20.0);
    let mut touched = 0;
    for _ in 0..2000 {
        let (from, to) = (point(), point());
        if scene.clearance(&from, 1.0, |_| true) < 0.0 {
            continue;
        }
        let contact = scene.first_contact(&from, &to, 1.0, |_| true);
        let end = contact.map_or(to, |contact| contact.center_mm);
        for part in 0..500 {
            let at = from + (end - from) * (f64::from(part) / 500.0);
            assert!(scene.clearance(&at, 1.0, |_| true) > 0.0);
        }
        if let Some(contact) = contact {
            touched += 1;
            assert!(scene.clearance(&contact.center_mm, 1.0, |_| true).abs() < 1e-9);
        }
    }
    assert!(touched > 300, "{touched}");
}

/// A group is placed as one.
#[test]
fn groups_move_together() {
    let mut scene = scene(
        "[[group]]\nname = \"PLATE\"\n\
         [[body]]\nname = \"A\"\nshape = { sphere = { radius_mm = 1.0 } }\nposition_mm = [10.0, 0.0, 0.0]\ngroup = \"PLATE\"",
    );
    assert!(scene.place("PLATE", pose([0.0, 0.0, 5.0], [0.0, 0.0, 90.0], [0.0; 3])));
    assert!(!scene.place("TABLE", RigidTransform::identity()));
    let at = scene.bodies()[0].placed().translation_mm;
    assert!((at - Vector3::new(0.0, 10.0, 5.0)).norm() < 1e-12);
}

/// A faulty scene is refused with a reason that names the place.
#[test]
fn faulty_scenes_are_refused() {
    for (text, says) in [
        ("[machine]\nspeed = 3", "speed"),
        ("[machine]\nrapid_mm_per_min = 0.0", "rapid_mm_per_min"),
        ("[control]\nskip_delay_ms = [4.0, 0.0]", "skip_delay_ms"),
        (
            "[[body]]\nname = \"B\"\nshape = { sphere = { radius_mm = -1.0 } }",
            "body B",
        ),
        (
            "[[body]]\nname = \"B\"\nshape = { egg = { radius_mm = 1.0 } }",
            "egg",
        ),
        (
            "[[body]]\nname = \"B\"\nshape = \"half_space\"\ngroup = \"G\"",
            "no group G",
        ),
        (
            "[setting_errors.P8]\nrotation_deg = [0.0, 0.0, 1.0]",
            "P1 to P7",
        ),
        (
            "[setting_errors.P1]\nrotation_deg = [nan, 0.0, 1.0]",
            "setting_errors.P1",
        ),
        ("[tools.99]\nlength_mm = 1.0\nradius_mm = 1.0", "probe"),
        (
            "[machine]\ncounts_per_mm = [1.0, 0.0, 1.0]",
            "counts_per_mm",
        ),
    ] {
        let error = Scene::parse(text).unwrap_err().to_string();
        assert!(error.contains(says), "{text}: {error}");
    }
}

mod distances;
mod mesh;
