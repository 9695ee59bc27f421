//! What the sensor reads, and what it says where it reads nothing.

use nalgebra::Vector3;
use umi_core::point::{BallReading, CalibrationBall, PointQuestion, calibrate};
use umi_core::units::{Mm, Point};

use super::{Exposure, NoSignal, PointSensorHead, SensorFault};
use crate::scene::Scene;

/// The 50 mm lens over a ball of 20 mm.
const SCENE: &str = r#"
    [point_sensor]
    tool = 98
    offset_mm = [1.3, -0.8, -120.0]
    direction = [0.01, -0.02, -1.0]
    stand_off_mm = 44.0
    range_mm = 8.0
    spot_um = 0
    noise_um = 0.0
    linearity_percent = 0.0
    angle_deg = 70
    max_rate_hz = 9000

    [[body]]
    name = "BALL"
    shape = { sphere = { radius_mm = 10.0 } }
"#;

const EXPOSURE: Exposure = Exposure {
    rate_hz: 2000.0,
    power: 2000.0,
};

fn setup(text: &str) -> (Scene, PointSensorHead) {
    let scene = Scene::parse(text).unwrap();
    let sensor = PointSensorHead::new(scene.point_sensor.clone().unwrap(), 1);
    (scene, sensor)
}

fn with(from: &str, to: &str) -> (Scene, PointSensorHead) {
    assert!(SCENE.contains(from));
    setup(&SCENE.replace(from, to))
}

/// The axes where the beam strikes a place `way` before it.
fn axes(sensor: &PointSensorHead, place: Vector3<f64>, way: f64) -> Vector3<f64> {
    place - Vector3::from(sensor.spec().offset_mm) - sensor.direction * way
}

fn refused(fault: Result<super::SensorSignal, SensorFault>) -> &'static str {
    fault.unwrap_err().code()
}

/// Readings over the ball, at three stand-offs.
fn readings(scene: &Scene, sensor: &mut PointSensorHead, captures: u32) -> Vec<BallReading> {
    let mut readings = Vec::new();
    for k in 0..100 {
        let cos = 1.0 - (f64::from(k) + 0.5) / 100.0 * 0.5;
        let (sin, turn) = ((1.0 - cos * cos).sqrt(), 2.399_963 * f64::from(k));
        let place = Vector3::new(sin * turn.cos(), sin * turn.sin(), cos) * 10.0;
        let at = axes(sensor, place, 44.0 + 2.5 * (f64::from(k % 3) - 1.0));
        let read = sensor.captures(scene, &at, EXPOSURE, captures).unwrap();
        readings.push(BallReading {
            axes: Point { mm: at },
            gamma: Mm(read.signal.gamma_mm),
            ball: 0,
        });
    }
    readings
}

const BALL: CalibrationBall = CalibrationBall {
    center: Point::from_mm(0.0, 0.0, 0.0),
    radius: Mm(10.0),
    u_center: Mm(0.0),
    u_radius: Mm(0.0),
};

#[test]
fn a_reading_is_the_way_along_the_beam() {
    let (scene, mut sensor) = setup(SCENE);
    for (x, way) in [(0.0, 44.0), (5.0, 40.5), (-3.0, 47.9)] {
        let place = Vector3::new(x, 2.0, (96.0_f64 - x * x).sqrt());
        let at = axes(&sensor, place, way);
        let read = sensor.capture(&scene, &at, EXPOSURE).unwrap();
        assert!((read.gamma_mm - way).abs() < 1e-8, "{read:?}");
        assert!(read.snr > 50.0 && read.total > 100.0, "{read:?}");
    }
}

/// The sensor and the calibration agree about what t, a and g are.
#[test]
fn the_calibration_gives_the_sensor_back() {
    let (scene, mut sensor) = with("max_rate_hz", "gain_error_ppm = 400\nmax_rate_hz");
    let readings = readings(&scene, &mut sensor, 1);
    let wanted = PointQuestion {
        free_gain: true,
        ..PointQuestion::default()
    };
    let fit = calibrate(&readings, &[BALL], &wanted).unwrap();
    let offset = fit.sensor.offset.mm - Vector3::from(sensor.spec().offset_mm);
    assert!(offset.amax() < 1e-5, "{offset:?}");
    assert!((fit.sensor.direction - sensor.direction).amax() < 1e-7);
    assert!((fit.sensor.gain - 1.0004).abs() < 1e-7);
}

/// The paper's settings: 1000 captures of 1 µm at each of 100 places.
#[test]
fn noise_of_captures_averages_out() {
    let (scene, mut sensor) = with("noise_um = 0.0", "noise_um = 1.0");
    let readings = readings(&scene, &mut sensor, 1000);
    let fit = calibrate(&readings, &[BALL], &PointQuestion::default()).unwrap();
    let sigma = fit.stats.sigma.unwrap().0;
    // 1 µm, more off the middle and on the flank, over the root of 1000.
    assert!((2e-5..8e-5).contains(&sigma), "{sigma}");
    let place = axes(&sensor, Vector3::new(0.0, 0.0, 10.0), 44.0);
    let read = sensor.captures(&scene, &place, EXPOSURE, 4000).unwrap();
    assert!((read.spread_mm - 1e-3).abs() < 5e-5, "{read:?}");
    // At the end of the depth of field it is twice as much.
    let place = axes(&sensor, Vector3::new(0.0, 0.0, 10.0), 47.999);
    let read = sensor.captures(&scene, &place, EXPOSURE, 4000).unwrap();
    assert!((read.spread_mm - 2e-3).abs() < 1e-4, "{read:?}");
}

#[test]
fn every_missing_signal_has_its_reason() {
    let shelf = "[[body]]\nname = \"SHELF\"\nshape = { block = { size_mm = [6.0, 6.0, 1.0] } }\n\
                 position_mm = [0.0, 0.0, 30.0]\n";
    let (scene, mut sensor) = setup(SCENE);
    let top = Vector3::new(0.0, 0.0, 10.0);
    let mut at = |way, exposure| {
        let place = axes(&sensor, top, way);
        refused(sensor.capture(&scene, &place, exposure))
    };
    assert_eq!(at(48.1, EXPOSURE), "out_of_range");
    assert_eq!(at(39.9, EXPOSURE), "out_of_range");
    let dark = Exposure {
        power: 10.0,
        ..EXPOSURE
    };
    assert_eq!(at(44.0, dark), "underexposed");
    let fast = Exposure {
        rate_hz: 9001.0,
        ..EXPOSURE
    };
    assert_eq!(at(44.0, fast), "rate_too_high");
    let strong = Exposure {
        power: 4096.0,
        ..EXPOSURE
    };
    assert_eq!(at(44.0, strong), "power_too_high");
    let nan = Exposure {
        rate_hz: f64::NAN,
        ..EXPOSURE
    };
    assert_eq!(at(44.0, nan), "rate_too_high");
    // Past the ball, and on its flank.
    let place = axes(&sensor, Vector3::new(12.0, 0.0, 0.0), 44.0);
    assert_eq!(
        refused(sensor.capture(&scene, &place, EXPOSURE)),
        "out_of_range"
    );
    let steep = Vector3::new(75_f64.to_radians().sin(), 0.0, 75_f64.to_radians().cos());
    let place = axes(&sensor, steep * 10.0, 44.0);
    assert_eq!(
        refused(sensor.capture(&scene, &place, EXPOSURE)),
        "too_steep"
    );
    // A shelf over the ball: the ball would be in range.
    let (scene, mut sensor) = setup(&format!("{SCENE}{shelf}"));
    let place = axes(&sensor, top, 44.0);
    let read = sensor.capture(&scene, &place, EXPOSURE);
    assert_eq!(read, Err(SensorFault::NoSignal(NoSignal::Occluded)));
    assert_eq!(
        sensor.captures(&scene, &place, EXPOSURE, 0).unwrap_err(),
        SensorFault::NoCaptures
    );
}

/// A spot across an edge reads between both surfaces.
#[test]
fn a_spot_takes_the_mean() {
    let step = r#"
        [[body]]
        name = "LOW"
        shape = "half_space"
        [[body]]
        name = "STEP"
        shape = { block = { size_mm = [20.0, 20.0, 1.0] } }
        position_mm = [10.0, 0.0, 1.0]
    "#;
    let text = SCENE
        .replace("direction = [0.01, -0.02, -1.0]", "direction = [0, 0, -1]")
        .replace("spot_um = 0", "spot_um = 40")
        .split("[[body]]")
        .next()
        .unwrap()
        .to_owned();
    let (scene, mut sensor) = setup(&(text + step));
    let mut read = |x: f64| {
        let at = axes(&sensor, Vector3::new(x, 0.0, 0.0), 44.0);
        sensor.capture(&scene, &at, EXPOSURE).unwrap().gamma_mm
    };
    assert!((read(-0.5) - 44.0).abs() < 1e-8);
    assert!((read(0.5) - 43.0).abs() < 1e-8);
    let across = read(0.01);
    assert!(across > 43.1 && across < 43.9, "{across}");
}

/// The linearity curve is smooth, bounded, and the sensor's own.
#[test]
fn linearity_is_a_smooth_curve_by_seed() {
    let spec = with("linearity_percent = 0.0", "linearity_percent = 0.08")
        .0
        .point_sensor
        .unwrap();
    let curve = |seed: u64| -> Vec<f64> {
        let sensor = PointSensorHead::new(spec.clone(), seed);
        (-100..=100)
            .map(|k| sensor.linearity_mm(f64::from(k) / 100.0))
            .collect()
    };
    let (one, other) = (curve(1), curve(2));
    assert_eq!(one, curve(1));
    assert_ne!(one, other);
    let most = 0.0008 * 8.0;
    assert!(one.iter().all(|error| error.abs() <= most));
    assert!(one.iter().any(|error| error.abs() > most / 10.0));
    // No step of a hundredth of half the range changes it by more than the sines can.
    assert!(one.windows(2).all(|w| (w[1] - w[0]).abs() < most * 0.04));
}

#[test]
fn tables_that_make_no_sense_are_refused() {
    for (from, to, says) in [
        ("tool = 98", "tool = 99", "the probe's number"),
        ("[0.01, -0.02, -1.0]", "[0, 0, 0]", "has no length"),
        ("range_mm = 8.0", "range_mm = 88.0", "less than twice"),
        (
            "range_mm = 8.0",
            "range_mm = 8.0\ncolour = 1",
            "unknown field",
        ),
        ("range_mm = 8.0", "", "missing field"),
        (
            "angle_deg = 70",
            "angle_deg = 91",
            "`point_sensor.angle_deg` is 91",
        ),
    ] {
        let error = Scene::parse(&SCENE.replace(from, to)).unwrap_err().message;
        assert!(error.contains(says), "{to}: {error}");
    }
}

/// A ball bar as in the paper: balls of 20 mm, 249.53189 mm apart, the sensor calibrated on
/// the first ball and both seen alike. With all errors off the length comes back to a tenth
/// of a micrometre.
#[test]
fn a_ball_bar_comes_back() {
    let far = [249.531_89 * 0.6, 249.531_89 * 0.8, 0.0];
    let text = format!(
        "{}[[body]]\nname = \"FAR\"\nshape = {{ sphere = {{ radius_mm = 10.0 }} }}\nposition_mm = {far:?}\n",
        SCENE.replace("spot_um = 0", "spot_um = 37")
    );
    let (scene, mut sensor) = setup(&text);
    let readings = readings(&scene, &mut sensor, 1);
    let fit = calibrate(&readings, &[BALL], &PointQuestion::default()).unwrap();
    let mut center = |origin: Vector3<f64>| {
        let points: Vec<Point> = (0..100)
            .map(|k| {
                let reading = readings[k];
                let at = reading.axes.mm + origin;
                let read = sensor.capture(&scene, &at, EXPOSURE).unwrap();
                fit.sensor.place(Point { mm: at }, Mm(read.gamma_mm))
            })
            .collect();
        umi_core::fit::sphere::fit(&points).unwrap().center.mm
    };
    let length = (center(Vector3::from(far)) - center(Vector3::zeros())).norm();
    assert!((length - 249.531_89).abs() < 1e-4, "{length}");
}
