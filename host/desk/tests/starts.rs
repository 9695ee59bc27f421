//! The macro from every start of a grid: three places beside each other along X and along Y, five
//! heights, over a ball, a cylinder, a plane at 20 degrees, a step and a hole; each strategy, each
//! way to hear of a reading, on a Fanuc and on LinuxCNC.
//!
//! Each run ends by itself or by an alarm that names its reason; every point lies on the body, every
//! place without one has its reason, and nothing touches. The test of every day takes a part of the
//! grid; all of it by hand (`cargo test --release -p umi-desk --test starts -- --ignored`).

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::PlaceState;
use umi_core::units::Point;
use umi_desk::digitize::{DigitizeQuestion, HeardBy, Strategy, run};
use umi_virtual::nc::{ControlFamily, ControlSettings};
use umi_virtual::scene::Scene;
use umi_virtual::station::SensorLineFault;

const MACHINE: &str = r#"
    [machine]
    travel_min_mm = [-200.0, -200.0, -50.0]
    travel_max_mm = [200.0, 200.0, 400.0]
    reference_mm = [0.0, 0.0, 400.0]
    start_mm = [0.0, 0.0, 300.0]
    position_gain_per_s = 0.0
    [control.nc]
    dialect = "fanuc"
    [point_sensor]
    tool = 98
    offset_mm = [1.3, -0.8, -120.0]
    direction = [0.003490646098723725, -0.0017453277327930258, -0.9999923845989154]
    stand_off_mm = 44.0
    range_mm = 8.0
    spot_um = 37
    noise_um = 0.0
    linearity_percent = 0.0
    angle_deg = 85
    max_rate_hz = 9000
"#;

const STAND_OFF_MM: f64 = 44.0;

/// Width of the spot, rounded up.
const SPOT_MM: f64 = 0.04;

/// A part: its scene, its height under a start, how far a point is from it, and whether places may
/// be without a point where the sensor began well within its depth of field.
struct Part {
    name: &'static str,
    bodies: &'static str,
    height: fn(f64, f64) -> f64,
    off: fn(&Vector3<f64>) -> f64,
    has_gaps: bool,
}

const TILT: f64 = 0.363_970_234_266_202_4; // tan 20 degrees

const PARTS: [Part; 5] = [
    Part {
        name: "ball",
        bodies: "[[body]]\nname = \"PART\"\nshape = { sphere = { radius_mm = 60.0 } }\n",
        height: |x, y| (3600.0 - x * x - y * y).sqrt(),
        off: |p| p.norm() - 60.0,
        has_gaps: false,
    },
    Part {
        name: "cylinder",
        bodies: "[[body]]\nname = \"PART\"\nshape = { cylinder = { radius_mm = 40.0, height_mm = 200.0 } }\nrotation_deg = [-90.0, 0.0, 0.0]\nposition_mm = [0.0, 100.0, 20.0]\n",
        height: |x, _| 20.0 + (1600.0 - x * x).sqrt(),
        off: |p| p.x.hypot(p.z - 20.0) - 40.0,
        has_gaps: false,
    },
    Part {
        name: "plane at 20 degrees",
        bodies: "[[body]]\nname = \"PART\"\nshape = \"half_space\"\nrotation_deg = [0.0, -20.0, 0.0]\nposition_mm = [0.0, 0.0, 60.0]\n",
        height: |x, _| 60.0 + TILT * x,
        off: |p| p.z - 60.0 - TILT * p.x,
        has_gaps: false,
    },
    Part {
        name: "step",
        bodies: "[[body]]\nname = \"LOW\"\nshape = \"half_space\"\nposition_mm = [0.0, 0.0, 40.0]\n[[body]]\nname = \"HIGH\"\nshape = { block = { size_mm = [40.0, 40.0, 20.0] } }\nposition_mm = [-18.0, 0.0, 60.0]\n",
        height: |_, _| 60.0,
        // At the edge the spot lies on both.
        off: |p| match p {
            p if (p.x - 2.0).abs() < SPOT_MM => 0.0,
            p if p.z > 50.0 => p.z - 60.0,
            p => p.z - 40.0,
        },
        has_gaps: true,
    },
    Part {
        name: "hole",
        bodies: "[[body]]\nname = \"PART\"\nshape = { ring = { radius_mm = 2.5, outer_radius_mm = 40.0, height_mm = 30.0 } }\nposition_mm = [2.5, 1.0, 60.0]\n",
        height: |_, _| 60.0,
        off: |p| {
            let from_axis = (p.x - 2.5).hypot(p.y - 1.0);
            if (from_axis - 2.5).abs() < SPOT_MM {
                0.0
            } else {
                p.z - 60.0
            }
        },
        has_gaps: true,
    },
];

const WAYS: [(Strategy, HeardBy); 7] = [
    (Strategy::NonAdaptive, HeardBy::Served),
    (Strategy::Adaptive, HeardBy::Served),
    (Strategy::PredictiveAdaptive, HeardBy::Served),
    (Strategy::NonAdaptive, HeardBy::Trip),
    (Strategy::Adaptive, HeardBy::Trip),
    (Strategy::PredictiveAdaptive, HeardBy::Trip),
    (Strategy::NonAdaptive, HeardBy::Pulses),
];

/// Runs from every start; how many there were, how many went through to the last place, and how many had no three
/// points: at one height a part that rises or falls leaves the depth of field, and on the way a place takes captures
/// of three steps.
fn every_start(beside_mm: &[f64], heights_mm: &[f64]) -> [u32; 3] {
    let (mut runs, mut whole, mut scant) = (0, 0, 0);
    for part in &PARTS {
        for family in [ControlFamily::Fanuc, ControlFamily::LinuxCnc] {
            let mut scene = Scene::parse(&format!("{MACHINE}{}", part.bodies)).unwrap();
            scene.control.nc = ControlSettings::of(family);
            let spec = scene.point_sensor.clone().unwrap();
            let sensor = PointSensor {
                offset: Point::from_array_mm(spec.offset_mm),
                direction: Vector3::from(spec.direction).normalize(),
                gain: 1.0,
            };
            for (strategy, by) in WAYS {
                if family == ControlFamily::LinuxCnc && by == HeardBy::Served {
                    continue;
                }
                // A place that is made of its own step only does not know its curvature: the square
                // of 2 mm over 24 times 40 mm.
                let tolerance_mm = if by == HeardBy::Pulses { 5e-3 } else { 1e-3 };
                for (dx, dy, dz) in grid(beside_mm, heights_mm) {
                    let [x, y] = [-4.0 + dx, -2.0 + dy];
                    // Where the beam meets the part at the first place.
                    let beam = sensor.direction * STAND_OFF_MM;
                    let seen = (x + 1.3 + beam.x, y - 0.8 + beam.y);
                    let z = (part.height)(seen.0, seen.1) + 120.0 - beam.z + dz;
                    let asked = DigitizeQuestion {
                        strategy,
                        at_mm: [x, y, z],
                        size_mm: [6.0, 4.0],
                        step_mm: [2.0, 2.0],
                        feed_mm_per_min: 1000.0,
                        safe_z_mm: 300.0,
                        adaptations: 2.0,
                        dof_position: 50.0,
                        rate_hz: 2000.0,
                        power: 2000.0,
                        captures: 4.0,
                        by,
                    };
                    let what = format!(
                        "{} {family:?} {strategy:?} {by:?} {dx} {dy} {dz}",
                        part.name
                    );
                    let done = run(scene.clone(), &sensor, &asked, 1, SensorLineFault::None)
                        .unwrap_or_else(|refusal| panic!("{what}: {refusal}"));
                    runs += 1;
                    assert_eq!(done.alarm, None, "{what}");
                    assert_eq!(done.places.len(), 12, "{what}");
                    whole += u32::from(done.points() == 12);
                    let is_scant = done.points() < 3;
                    scant += u32::from(is_scant);
                    assert!(
                        by == HeardBy::Pulses || !is_scant,
                        "{what}: {:?}",
                        done.places
                    );
                    for place in &done.places {
                        match place.found.point {
                            Some(point) => {
                                let off = (part.off)(&point.mm);
                                assert!(off.abs() < tolerance_mm, "{what}: {off} {place:?}");
                            }
                            None => {
                                let state = place.found.state;
                                let is_named =
                                    matches!(state, PlaceState::NoSignal(_) | PlaceState::Edge);
                                assert!(is_named, "{what}: {place:?}");
                                let follows = strategy != Strategy::NonAdaptive;
                                assert!(part.has_gaps || !follows, "{what}: {place:?}");
                            }
                        }
                    }
                }
            }
        }
    }
    [runs, whole, scant]
}

fn grid(beside_mm: &[f64], heights_mm: &[f64]) -> Vec<(f64, f64, f64)> {
    let mut all = Vec::new();
    for dx in beside_mm {
        for dy in beside_mm {
            all.extend(heights_mm.iter().map(|dz| (*dx, *dy, *dz)));
        }
    }
    all
}

#[test]
fn from_some_starts() {
    let [runs, whole, scant] = every_start(&[-0.6], &[-2.9, 1.6]);
    assert_eq!(runs, 5 * 11 * 2);
    assert!(whole > 50, "{whole}");
    assert!(scant < 6, "{scant}");
}

#[test]
#[ignore = "long: run by hand"]
fn from_every_start() {
    let [runs, whole, scant] = every_start(&[-0.8, 0.0, 0.7], &[-3.5, -1.7, 0.0, 1.7, 3.5]);
    println!("{runs} runs, {whole} without a gap, {scant} by pulses with fewer than three points");
    assert_eq!(runs, 5 * 11 * 45);
    // Of 450 by pulses.
    assert!(scant < 150, "{scant}");
}
