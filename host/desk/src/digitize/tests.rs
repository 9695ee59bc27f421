//! Runs over bodies whose surface is known.

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::PlaceState;
use umi_core::units::Point;
use umi_virtual::nc::{ControlFamily, ControlSettings};
use umi_virtual::scene::Scene;
use umi_virtual::station::SensorLineFault;

use super::*;

const MACHINE: &str = r#"
    [machine]
    travel_min_mm = [-200.0, -200.0, -50.0]
    travel_max_mm = [200.0, 200.0, 400.0]
    reference_mm = [0.0, 0.0, 400.0]
    start_mm = [0.0, 0.0, 300.0]
    [control.nc]
    dialect = "fanuc"
    [point_sensor]
    tool = 98
    offset_mm = [1.3, -0.8, -120.0]
    direction = [0.003490646098723725, -0.0017453177327930258, -0.9999923845989154]
    stand_off_mm = 44.0
    range_mm = 8.0
    spot_um = 37
    noise_um = 0.0
    linearity_percent = 0.0
    angle_deg = 85
    max_rate_hz = 9000
"#;

const BALL: &str = "[[body]]\nname = \"PART\"\nshape = { sphere = { radius_mm = 60.0 } }\n";

fn scene(bodies: &str) -> Scene {
    Scene::parse(&format!("{MACHINE}{bodies}")).unwrap()
}

fn sensor(scene: &Scene) -> PointSensor {
    let spec = scene.point_sensor.as_ref().unwrap();
    PointSensor {
        offset: Point::from_array_mm(spec.offset_mm),
        direction: Vector3::from(spec.direction).normalize(),
        gain: 1.0,
    }
}

fn asked(strategy: Strategy, by: HeardBy) -> DigitizeQuestion {
    DigitizeQuestion {
        strategy,
        at_mm: [-4.0, -4.0, 223.5],
        size_mm: [8.0, 8.0],
        step_mm: [2.0, 2.0],
        feed_mm_per_min: 1000.0,
        safe_z_mm: 300.0,
        adaptations: 1.0,
        dof_position: 50.0,
        rate_hz: 2000.0,
        power: 2000.0,
        captures: 20.0,
        by,
    }
}

fn go(bodies: &str, asked: &DigitizeQuestion) -> Result<Digitized, DigitizeRefusal> {
    let scene = scene(bodies);
    let sensor = sensor(&scene);
    run(scene, &sensor, asked, 1, SensorLineFault::None)
}

/// Every strategy, however the control hears of it: each place once, its point on the ball.
#[test]
fn all_ways_lead_to_the_ball() {
    for (strategy, by) in [
        (Strategy::NonAdaptive, HeardBy::Served),
        (Strategy::Adaptive, HeardBy::Served),
        (Strategy::PredictiveAdaptive, HeardBy::Served),
        (Strategy::NonAdaptive, HeardBy::Trip),
        (Strategy::Adaptive, HeardBy::Trip),
        (Strategy::PredictiveAdaptive, HeardBy::Trip),
        (Strategy::NonAdaptive, HeardBy::Pulses),
    ] {
        let asked = asked(strategy, by);
        let done = go(BALL, &asked).unwrap();
        assert_eq!(done.alarm, None, "{strategy:?} {by:?}");
        assert_eq!((done.places.len(), done.points(), done.losses), (25, 25, 0));
        let mut seen = std::collections::HashSet::new();
        for place in &done.places {
            assert!(seen.insert((place.row, place.column)));
            let off = place.found.point.unwrap().mm.norm() - 60.0;
            assert!(off.abs() < 5e-4, "{strategy:?} {by:?}: {place:?}");
            let x = -4.0 + 2.0 * place.column as f64;
            let y = -4.0 + 2.0 * place.row as f64;
            let at = place.found.axes.mm;
            assert!(
                (at.x - x).abs() < 0.03 && (at.y - y).abs() < 0.03,
                "{place:?}"
            );
        }
        let (_, most) = done.deviation_mm(44.0).unwrap();
        let near = match (strategy, by) {
            (Strategy::NonAdaptive, _) => 4.0,
            (_, HeardBy::Served) => 0.003,
            _ => 0.02,
        };
        assert!(most < near, "{strategy:?} {by:?}: {most}");
    }
}

/// The same on LinuxCNC, by trip and by pulses: as many points, each on the ball; and the file for
/// the shop holds every subroutine.
#[test]
fn linuxcnc_leads_to_the_ball() {
    let mut scene = scene(BALL);
    let mut settings = ControlSettings::of(ControlFamily::LinuxCnc);
    std::mem::swap(&mut scene.control.nc, &mut settings);
    let sensor = sensor(&scene);
    let spec = scene.point_sensor.clone().unwrap();
    for (strategy, by) in [
        (Strategy::NonAdaptive, HeardBy::Trip),
        (Strategy::Adaptive, HeardBy::Trip),
        (Strategy::PredictiveAdaptive, HeardBy::Trip),
        (Strategy::NonAdaptive, HeardBy::Pulses),
    ] {
        let asked = asked(strategy, by);
        let go = |sensor: &PointSensor, fault| run(scene.clone(), sensor, &asked, 1, fault);
        let done = go(&sensor, SensorLineFault::None).unwrap();
        assert_eq!(done.alarm, None, "{strategy:?} {by:?}");
        assert_eq!((done.places.len(), done.points(), done.losses), (25, 25, 0));
        assert!(done.duration_s > 3.0 && done.path_mm > 40.0);
        for place in &done.places {
            let off = place.found.point.unwrap().mm.norm() - 60.0;
            assert!(off.abs() < 5e-4, "{strategy:?} {by:?}: {place:?}");
        }
        let text = program(ControlFamily::LinuxCnc, &spec, &sensor, &asked).unwrap();
        let mut control = umi_virtual::nc::Control::new(scene.control.nc.clone());
        assert_eq!(control.load(&text).unwrap().len(), 1);
        let swapped = PointSensor {
            direction: -sensor.direction,
            ..sensor
        };
        for (sensor, fault) in [
            (&swapped, SensorLineFault::None),
            (&sensor, SensorLineFault::Lost(5)),
            (&sensor, SensorLineFault::OffByOne(60)),
        ] {
            let done = go(sensor, fault);
            for place in done.iter().flat_map(|done| &done.places) {
                if let Some(point) = place.found.point {
                    assert!((point.mm.norm() - 60.0).abs() < 5e-4, "{fault:?} {place:?}");
                }
            }
            let ends = |says: &str| {
                let message = done.as_ref().map_or_else(
                    |refusal| refusal.message.clone(),
                    |done| {
                        done.alarm
                            .as_ref()
                            .map_or_else(String::new, |alarm| alarm.message.clone())
                    },
                );
                assert!(message.contains(says), "{by:?} {fault:?}: {message}");
            };
            match (by, fault) {
                // On the way nothing stops the axes: the places have their names.
                (HeardBy::Pulses, SensorLineFault::OffByOne(_)) => {
                    assert!(done.map_or(0, |done| done.points()) < 25);
                }
                _ => ends("SENSOR FAULT"),
            }
        }
    }
    let refused = run(
        scene,
        &sensor,
        &asked(Strategy::Adaptive, HeardBy::Served),
        1,
        SensorLineFault::None,
    );
    assert_eq!(refused.unwrap_err().code, "bad_control");
}

/// GRBL's fixed path, with M8 as the gate: the same surface; a swapped sign gives no point.
#[test]
fn grbl_leads_to_the_ball_on_a_fixed_path() {
    let mut scene = scene(BALL);
    scene.control.nc = ControlSettings::of(ControlFamily::Grbl);
    let sensor = sensor(&scene);
    let pulses = asked(Strategy::NonAdaptive, HeardBy::Pulses);
    let go = |sensor: &PointSensor, fault| run(scene.clone(), sensor, &pulses, 1, fault).unwrap();
    let done = go(&sensor, SensorLineFault::None);
    assert_eq!(done.alarm, None);
    assert_eq!((done.places.len(), done.points(), done.losses), (25, 25, 0));
    assert!(done.duration_s > 3.0 && done.path_mm > 40.0);
    for place in &done.places {
        let off = place.found.point.unwrap().mm.norm() - 60.0;
        assert!(off.abs() < 5e-4, "{place:?}");
    }
    let swapped = PointSensor {
        direction: -sensor.direction,
        ..sensor
    };
    assert_eq!(go(&swapped, SensorLineFault::None).points(), 0);
    assert!(go(&sensor, SensorLineFault::OffByOne(60)).points() < 25);
    for (strategy, by) in [
        (Strategy::NonAdaptive, HeardBy::Served),
        (Strategy::Adaptive, HeardBy::Trip),
    ] {
        let asked = asked(strategy, by);
        let refused = run(scene.clone(), &sensor, &asked, 1, SensorLineFault::None);
        assert_eq!(refused.unwrap_err().code, "bad_control");
    }
}

/// Where the first place has no signal the beam is proven at the first that has one; a control
/// that does not hear of it gets no point at all.
#[test]
fn a_first_place_without_signal() {
    let mut asked = asked(Strategy::NonAdaptive, HeardBy::Served);
    let ring = "[[body]]\nname = \"RING\"\nshape = { ring = { radius_mm = 4.5, outer_radius_mm = 40.0, height_mm = 30.0 } }\nposition_mm = [-2.5, -4.9, 60.0]\n";
    let scene = scene(ring);
    let sensor = sensor(&scene);
    let swapped = PointSensor {
        direction: -sensor.direction,
        ..sensor
    };
    let go = |sensor: &PointSensor, asked: &DigitizeQuestion| {
        run(scene.clone(), sensor, asked, 1, SensorLineFault::None)
    };
    let done = go(&sensor, &asked).unwrap();
    let first = done.places[0].found.state;
    assert!(matches!(first, PlaceState::NoSignal(_)), "{first:?}");
    assert!((8..25).contains(&done.points()), "{}", done.points());
    let wrong = go(&swapped, &asked);
    assert_eq!(wrong.map_or(0, |done| done.points()), 0);
    asked.by = HeardBy::Pulses;
    let done = go(&sensor, &asked).unwrap();
    assert_eq!(done.points(), 0);
    let unproven = |p: &DigitizedPlace| p.found.state == PlaceState::BeamUnproven;
    assert!(done.places.iter().any(unproven), "{:?}", done.places);
}

/// On a slope predicting is faster than not.
#[test]
fn a_prediction_saves_time() {
    let time = |strategy| {
        let mut asked = asked(strategy, HeardBy::Served);
        asked.at_mm = [-20.0, -20.0, 216.9];
        go(BALL, &asked).unwrap().duration_s
    };
    assert!(time(Strategy::PredictiveAdaptive) < time(Strategy::Adaptive));
}

/// What goes wrong on the way is named, and what it touches is no point.
#[test]
fn faults_are_named() {
    let scene = scene(BALL);
    let sensor = sensor(&scene);
    let asked = asked(Strategy::Adaptive, HeardBy::Served);
    let with = |sensor: &PointSensor, fault| run(scene.clone(), sensor, &asked, 1, fault);
    let stops = |sensor: &PointSensor, fault, says: &str| {
        let message = match with(sensor, fault) {
            Ok(done) => {
                for place in &done.places {
                    if let Some(point) = place.found.point {
                        assert!((point.mm.norm() - 60.0).abs() < 5e-4, "{fault:?} {place:?}");
                    }
                }
                done.alarm
                    .map_or_else(|| "nothing".into(), |alarm| alarm.message)
            }
            Err(refusal) => refusal.message,
        };
        assert!(message.contains(says), "{fault:?}: {message}");
    };
    stops(&sensor, SensorLineFault::OffByOne(60), "LOST A CAPTURE");
    stops(&sensor, SensorLineFault::Lost(5), "LOST A CAPTURE");
    stops(&sensor, SensorLineFault::Stale(20), "BEAM WRONG");
    stops(&sensor, SensorLineFault::StaleAnswer(6), "STALE ANSWER");
    stops(&sensor, SensorLineFault::WrongAnswer(6), "DAMAGED");
    // A capture that is only looked at on the way: a record, and no harm to a point.
    let done = with(&sensor, SensorLineFault::Lost(60)).unwrap();
    assert_eq!((done.alarm, done.losses), (None, 1));
    let swapped = PointSensor {
        direction: -sensor.direction,
        ..sensor
    };
    stops(&swapped, SensorLineFault::None, "BEAM WRONG");
}

/// A sensor of 40 µm a capture is followed like any other; with its sign swapped it is named.
#[test]
fn a_noisy_sensor_is_no_wrong_one() {
    let mut scene = scene(BALL);
    if let Some(spec) = &mut scene.point_sensor {
        spec.noise_um = 40.0;
    }
    let sensor = sensor(&scene);
    let swapped = PointSensor {
        direction: -sensor.direction,
        ..sensor
    };
    for (strategy, by) in [
        (Strategy::Adaptive, HeardBy::Served),
        (Strategy::PredictiveAdaptive, HeardBy::Trip),
        (Strategy::NonAdaptive, HeardBy::Pulses),
    ] {
        for seed in 1..6 {
            let asked = asked(strategy, by);
            let done = run(scene.clone(), &sensor, &asked, seed, SensorLineFault::None).unwrap();
            let states: Vec<_> = done.places.iter().map(|p| p.found.state).collect();
            assert_eq!(done.alarm, None, "{strategy:?} {by:?} {seed}");
            assert_eq!(done.points(), 25, "{strategy:?} {by:?} {seed} {states:?}");
            let wrong = run(scene.clone(), &swapped, &asked, seed, SensorLineFault::None);
            let points = wrong.as_ref().map_or(0, Digitized::points);
            assert_eq!(points, 0, "{strategy:?} {by:?} {seed} {wrong:?}");
        }
    }
}

/// A step down beyond the depth of field, and a hole: the places over them have their reason,
/// nothing is touched, and the places behind are measured.
#[test]
fn holes_and_steps_are_skipped_by_name() {
    let ring = "[[body]]\nname = \"RING\"\nshape = { ring = { radius_mm = 2.5, outer_radius_mm = 40.0, height_mm = 30.0 } }\nposition_mm = [1.5, 0.0, 60.0]\n";
    let step = "[[body]]\nname = \"LOW\"\nshape = \"half_space\"\nposition_mm = [0.0, 0.0, 40.0]\n[[body]]\nname = \"HIGH\"\nshape = { block = { size_mm = [40.0, 40.0, 20.0] } }\nposition_mm = [-18.0, 0.0, 60.0]\n";
    for bodies in [ring, step] {
        for strategy in [
            Strategy::NonAdaptive,
            Strategy::Adaptive,
            Strategy::PredictiveAdaptive,
        ] {
            for by in [HeardBy::Served, HeardBy::Trip] {
                let done = go(bodies, &asked(strategy, by)).unwrap();
                assert_eq!(done.alarm, None);
                assert_eq!(done.places.len(), 25);
                let missing = 25 - done.points();
                assert!(
                    (1..=20).contains(&missing),
                    "{strategy:?} {by:?}: {missing}"
                );
                for place in &done.places {
                    if let Some(point) = place.found.point {
                        assert!((point.mm.z - 60.0).abs() < 5e-4, "{place:?}");
                    } else {
                        assert!(matches!(place.found.state, PlaceState::NoSignal(_)));
                    }
                }
            }
        }
    }
}

/// Every refusal by its name.
#[test]
fn refusals() {
    let base = asked(Strategy::Adaptive, HeardBy::Served);
    let refused = |bodies: &str, asked: DigitizeQuestion| {
        let refusal = go(bodies, &asked).unwrap_err();
        (refusal.code, refusal.letter)
    };
    let with = |change: fn(&mut DigitizeQuestion)| {
        let mut asked = base.clone();
        change(&mut asked);
        refused(BALL, asked)
    };
    assert_eq!(with(|a| a.at_mm[0] = -250.0), ("over_travel", None));
    assert_eq!(with(|a| a.at_mm[2] = 240.0), ("no_signal", None));
    assert_eq!(with(|a| a.at_mm[2] = 170.0), ("collision", None));
    assert_eq!(with(|a| a.rate_hz = 9001.0), ("rate_too_high", Some('W')));
    for (change, letter) in [
        ((|a| a.size_mm[0] = 0.0) as fn(&mut DigitizeQuestion), 'D'),
        (|a| a.size_mm[1] = -1.0, 'E'),
        (|a| a.step_mm[0] = 0.0, 'F'),
        (|a| a.step_mm[1] = f64::NAN, 'H'),
        (|a| a.feed_mm_per_min = 0.0, 'M'),
        (|a| a.safe_z_mm = 200.0, 'Q'),
        (|a| a.by = HeardBy::Pulses, 'R'),
        (|a| a.adaptations = 0.0, 'U'),
        (|a| a.dof_position = 101.0, 'V'),
        // An end of the depth of field gives no signal.
        (|a| a.dof_position = 4.9, 'V'),
        (|a| a.dof_position = 97.0, 'V'),
        (|a| a.rate_hz = 0.0, 'W'),
        (|a| a.power = -1.0, 'X'),
        (|a| a.captures = 1.0, 'Z'),
    ] {
        assert_eq!(with(change), ("bad_input", Some(letter)));
    }
}

/// The macro itself names each letter, on the control, without a host.
#[test]
fn the_macro_names_its_letters() {
    use umi_virtual::nc::{Control, Recorder};
    let macros = [
        include_str!("../../../../hw/control/fanuc/O8840-digitize.nc"),
        include_str!("../../../../hw/control/fanuc/O8841-sensor.nc"),
        include_str!("../../../../hw/control/fanuc/O8842-command.nc"),
        include_str!("../../../../hw/control/fanuc/O8843-beam.nc"),
    ];
    let good = "D8.E8.F2.H2.M1000.Q300.R1.U1.V50.W2000.X2000.Z20.";
    for family in [
        ControlFamily::Fanuc,
        ControlFamily::Haas,
        ControlFamily::Mitsubishi,
    ] {
        for (from, to, letter) in [
            ("D8.", "D0.", 'D'),
            ("D8.", "", 'D'),
            ("E8.", "E-1.", 'E'),
            ("F2.", "F0.", 'F'),
            ("H2.", "", 'H'),
            ("M1000.", "M30001.", 'M'),
            ("Q300.", "Q-50.", 'Q'),
            ("R1.", "R3.", 'R'),
            ("R1.", "R0.5", 'R'),
            ("U1.", "U0.", 'U'),
            ("V50.", "V101.", 'V'),
            ("V50.", "V0.", 'V'),
            ("V50.", "V100.", 'V'),
            ("W2000.", "W9001.", 'W'),
            ("X2000.", "X4096.", 'X'),
            ("Z20.", "Y1.Z20.", 'Y'),
            ("Z20.", "Z1.", 'Z'),
        ] {
            let mut control = Control::new(ControlSettings::of(family));
            for text in macros {
                control.load(text).unwrap();
            }
            let call = good.replace(from, to);
            control
                .load(&format!("%\nO1\nG65P8841\nG65P8840{call}\nM30\n%\n"))
                .unwrap();
            control.select(1).unwrap();
            let here = Point::from_mm(0.0, 0.0, 0.0);
            let alarm = control.run(&mut Recorder::new(here, here)).unwrap_err();
            let wanted = format!("{letter} - ");
            assert!(alarm.message.contains(&wanted), "{family:?} {to}: {alarm}");
        }
    }
}

/// The files of the families differ in nothing but what they say they do.
#[test]
fn the_families_have_the_same_macros() {
    let fanuc = include_str!("../../../../hw/control/fanuc/O8840-digitize.nc");
    for other in [
        include_str!("../../../../hw/control/haas/O8840-digitize.nc"),
        include_str!("../../../../hw/control/mitsubishi-mazak/O8840-digitize.nc"),
    ] {
        assert_eq!(other, fanuc);
    }
    let fanuc = include_str!("../../../../hw/control/fanuc/O8843-beam.nc");
    for other in [
        include_str!("../../../../hw/control/haas/O8843-beam.nc"),
        include_str!("../../../../hw/control/mitsubishi-mazak/O8843-beam.nc"),
    ] {
        assert_eq!(other, fanuc);
    }
    let fanuc = include_str!("../../../../hw/control/fanuc/O8842-command.nc");
    for other in [
        include_str!("../../../../hw/control/haas/O8842-command.nc"),
        include_str!("../../../../hw/control/mitsubishi-mazak/O8842-command.nc"),
    ] {
        assert_eq!(other, fanuc);
    }
}
