//! Distances and first contacts held against slow ways to find them.

use super::*;

/// A small generator of test values.
fn values(seed: u64) -> impl FnMut(f64, f64) -> f64 {
    let mut random = fastrand::Rng::with_seed(seed);
    move |low, high| low + (high - low) * random.f64()
}

const ARC: SceneShape = SceneShape::Arc {
    radius_mm: 20.0,
    length_mm: 30.0,
    width_mm: 24.0,
    height_mm: 9.0,
};

/// The arc's distance is the least one to ten thousand points of its surface's section,
/// with the sign of the plain inequalities of the solid. The section's edge is at
/// z = sqrt(20² - 12²) - 20 = -4.
#[test]
fn arc_against_points_of_its_section() {
    let mut outline = Vec::new();
    let half_angle = libm::asin(12.0 / 20.0);
    for step in 0..=4000 {
        let t = f64::from(step) / 4000.0;
        let angle = half_angle * (2.0 * t - 1.0);
        outline.push((20.0 * angle.sin(), 20.0 * angle.cos() - 20.0));
        outline.push((12.0 * (2.0 * t - 1.0), -9.0));
        outline.push((12.0, -9.0 + 5.0 * t));
        outline.push((-12.0, -9.0 + 5.0 * t));
    }
    let mut value = values(1);
    for _ in 0..500 {
        let (y, z) = (value(-25.0, 25.0), value(-25.0, 15.0));
        let least = outline
            .iter()
            .map(|(a, b)| (y - a).hypot(z - b))
            .fold(f64::MAX, f64::min);
        let inside = y.abs() <= 12.0 && z >= -9.0 && y.hypot(z + 20.0) <= 20.0;
        let inside = inside || (y.abs() <= 12.0 && (-9.0..=-4.0).contains(&z));
        let distance = ARC.distance_mm(&Vector3::new(0.0, y, z));
        // The solid's ends are 15 away from x = 0.
        let expected = if inside { -least } else { least };
        assert!(
            (distance - expected).abs() < 1e-3,
            "{y} {z}: {distance} {expected}"
        );
    }
}

/// No distance changes by more than the way, in any direction.
#[test]
fn distances_are_lipschitz() {
    let shapes = [
        SceneShape::Sphere { radius_mm: 5.0 },
        SceneShape::HalfSpace,
        SceneShape::Block {
            size_mm: [8.0, 12.0, 6.0],
        },
        SceneShape::Cylinder {
            radius_mm: 6.0,
            height_mm: 9.0,
        },
        SceneShape::Cone {
            half_angle_deg: 30.0,
            height_mm: 12.0,
        },
        SceneShape::Ring {
            radius_mm: 6.0,
            outer_radius_mm: 11.0,
            height_mm: 9.0,
        },
        ARC,
    ];
    let mut value = values(2);
    for shape in shapes {
        for _ in 0..5000 {
            let p = Vector3::from_fn(|_, _| value(-25.0, 25.0));
            let step = Vector3::from_fn(|_, _| value(-3.0, 3.0));
            let change = shape.distance_mm(&(p + step)) - shape.distance_mm(&p);
            assert!(change.abs() <= step.norm() + 1e-12, "{shape:?} {p:?}");
        }
    }
}

/// A ball over the edge between crown and flank touches on a quarter round of its own.
#[test]
fn edge_of_the_arc() {
    let scene =
        body("{ arc = { radius_mm = 20.0, length_mm = 30.0, width_mm = 24.0, height_mm = 9.0 } }");
    // A ball of 2 whose centre is 1.5 beside the flank touches the edge from above, at 49°
    // from the vertical (the crown itself ends at 37°): sqrt(2² - 1.5²) over it.
    let z = 1.75_f64.sqrt() - 4.0;
    assert_stop(
        &scene,
        [0.0, 13.5, 30.0],
        [0.0, 13.5, -30.0],
        [0.0, 13.5, z],
    );
}

/// Leaving a body is as exact as reaching it.
#[test]
fn leaving_a_sphere() {
    let scene = body("{ sphere = { radius_mm = 10.0 } }");
    let ball = &scene.bodies()[0];
    let (from, to) = (Vector3::new(12.0, 2.0, 3.0), Vector3::new(12.0, 42.0, 3.0));
    let way = ball.first_beyond(&from, &to, 2.0).unwrap();
    assert!((way - 23_f64.sqrt()).abs() < 1e-9, "{way}");
    assert_eq!(
        ball.first_beyond(&from, &(from + (to - from) * 0.1), 2.0),
        None
    );
}
