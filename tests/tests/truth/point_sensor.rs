//! Calibrations of a point sensor against answers of 50 digits.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;
use umi_core::point::{
    BallReading, CalibrationBall, PointCalibration, PointQuestion, PointRefusal, calibrate,
};
use umi_core::units::{Mm, Point};

fn text(name: &str) -> String {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("reference/point");
    fs::read_to_string(folder.join(name)).unwrap()
}

fn json(name: &str) -> Value {
    serde_json::from_str(&text(name)).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

/// The readings of a case; its only ball.
fn readings(case: &Value) -> Vec<BallReading> {
    let text = text(case["readings_csv"].as_str().unwrap());
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x,y,z,gamma"));
    lines
        .map(|line| {
            let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            BallReading {
                axes: Point::from_mm(row[0], row[1], row[2]),
                gamma: Mm(row[3]),
                ball: 0,
            }
        })
        .collect()
}

fn ball(case: &Value) -> CalibrationBall {
    let file: toml::Table = text(case["spheres"].as_str().unwrap()).parse().unwrap();
    let balls = file["sphere"].as_array().unwrap();
    assert_eq!(balls.len(), 1);
    let number = |key: &str| balls[0].get(key).map_or(0.0, |x| x.as_float().unwrap());
    let center: Vec<f64> = balls[0]["center_mm"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_float().unwrap())
        .collect();
    CalibrationBall {
        center: Point::from_mm(center[0], center[1], center[2]),
        radius: Mm(number("radius_mm")),
        u_center: Mm(number("u_center_mm")),
        u_radius: Mm(number("u_radius_mm")),
    }
}

fn wanted(case: &Value) -> PointQuestion {
    let free = |name: &str| case["free"].as_array().unwrap().contains(&name.into());
    assert_eq!(case["args"].as_array().unwrap().len(), 0);
    PointQuestion {
        free_radius: free("radius"),
        free_gain: free("gain"),
        ..PointQuestion::default()
    }
}

fn close(id: &str, what: &str, got: &[f64], wanted: &Value, tol: f64) {
    let wanted = numbers(wanted);
    assert_eq!(got.len(), wanted.len(), "{id} {what}");
    for (got, wanted) in got.iter().zip(wanted) {
        assert!((got - wanted).abs() <= tol, "{id} {what}: {got} {wanted}");
    }
}

/// Each 3 x 3 block of t and a within 1e-5 of its largest element.
fn close_blocks(id: &str, what: &str, got: &[[f64; 7]; 7], wanted: &Value) {
    let wanted: Vec<Vec<f64>> = wanted.as_array().unwrap().iter().map(numbers).collect();
    for (top, left) in [(0, 0), (0, 3), (3, 0), (3, 3)] {
        let cells = (top..top + 3).flat_map(|i| (left..left + 3).map(move |j| (i, j)));
        let largest = cells
            .clone()
            .fold(0.0_f64, |m, (i, j)| m.max(wanted[i][j].abs()));
        for (i, j) in cells {
            assert!(
                (got[i][j] - wanted[i][j]).abs() <= 1e-5 * largest,
                "{id} {what} {i} {j}: {} {}",
                got[i][j],
                wanted[i][j]
            );
        }
    }
}

fn holds(case: &Value, readings: &[BallReading], ball: &CalibrationBall, fit: &PointCalibration) {
    let id = case["id"].as_str().unwrap();
    let (result, tol) = (&case["result"], |key: &str| {
        case["tol"][key].as_f64().unwrap()
    });
    let sensor = &fit.sensor;
    close(
        id,
        "offset",
        &sensor.offset.to_array_mm(),
        &result["offset"],
        tol("offset"),
    );
    close(
        id,
        "direction",
        sensor.direction.as_slice(),
        &result["direction"],
        tol("direction"),
    );
    assert!((sensor.direction.norm() - 1.0).abs() < 1e-15, "{id}");
    if let Some(gain) = result.get("gain") {
        close(id, "gain", &[sensor.gain], gain, tol("gain"));
    } else {
        assert!(sensor.gain == 1.0, "{id}");
    }
    if let Some(radius) = result.get("radius_mm") {
        let got = ball.radius.0 + fit.radius_error.0;
        close(id, "radius", &[got], radius, tol("radius_mm"));
    } else {
        assert!(fit.radius_error.0 == 0.0, "{id}");
    }
    let residuals: Vec<f64> = readings.iter().map(|r| fit.residual(r, ball).0).collect();
    close(
        id,
        "residuals",
        &residuals,
        &result["residuals"],
        tol("residuals"),
    );
    close(id, "rms", &[fit.stats.rms.0], &result["rms"], tol("rms"));
    assert_eq!(
        fit.stats.dof as u64,
        result["dof"].as_u64().unwrap(),
        "{id}"
    );
    match fit.stats.sigma {
        Some(sigma) => close(id, "sigma", &[sigma.0], &result["sigma"], tol("sigma")),
        None => assert!(result["sigma"].is_null(), "{id}"),
    }
    close_blocks(id, "cov_unit", &fit.cov_unit, &result["cov_unit"]);
    if let Some(wanted) = result.get("covariance") {
        close_blocks(id, "covariance", &fit.covariance().unwrap(), wanted);
    }
    if let Some(wanted) = result.get("covariance_total") {
        close_blocks(
            id,
            "covariance_total",
            &fit.covariance_total().unwrap(),
            wanted,
        );
    }
}

#[test]
fn calibrations_hold_at_their_tolerance() {
    let index = json("index.json");
    let ids = index["cases"].as_array().unwrap();
    assert_eq!(ids.len(), 10);
    let (mut fitted, mut refused) = (0, 0);
    for id in ids {
        let case = json(&format!("{}.json", id.as_str().unwrap()));
        let (readings, ball) = (readings(&case), ball(&case));
        let fit = calibrate(&readings, &[ball], &wanted(&case));
        if case["expect"] == "fit" {
            let fit = fit.unwrap_or_else(|error: PointRefusal| panic!("{id}: {error}"));
            holds(&case, &readings, &ball, &fit);
            fitted += 1;
        } else {
            let error = fit.expect_err("a set that tells nothing");
            let names = case["error_any_of"].as_array().unwrap();
            assert!(names.contains(&error.code().into()), "{id}: {error}");
            refused += 1;
        }
    }
    assert_eq!((fitted, refused), (7, 3));
}
