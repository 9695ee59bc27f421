use heapless::Vec as List;
use umi_core::units::Point;
use umi_protocol::fault::FaultKind;
use umi_protocol::job::{Dialect, FeatureKind};
use umi_protocol::reason::FitRefusal;

use super::*;

fn name<const N: usize>(text: &str) -> heapless::String<N, u8> {
    heapless::String::try_from(text).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect()
}

/// Points around a shape with a little noise, so that there is a sigma.
fn points(kind: FeatureKind) -> Vec<Point> {
    (0..24)
        .map(|n| {
            let t = f64::from(n);
            let (a, h) = (t * 2.4, t * 0.9);
            let r = 10.0 + 0.001 * (t * 1.7).sin();
            let (x, y, z) = match kind {
                FeatureKind::Sphere => (
                    r * a.cos() * (h / 12.0).cos(),
                    r * a.sin() * (h / 12.0).cos(),
                    r * (h / 12.0).sin(),
                ),
                FeatureKind::Plane => (10.0 * a.cos(), 8.0 * a.sin() + t, r),
                FeatureKind::Line => (t, 2.0 * t, r),
                FeatureKind::Circle => (r * a.cos(), r * a.sin(), 0.001 * t.cos()),
                FeatureKind::Cylinder => (r * a.cos(), r * a.sin(), h),
                FeatureKind::Cone => ((r + h) * a.cos(), (r + h) * a.sin(), 2.0 * h),
            };
            Point::from_mm(x + 100.0, y - 50.0, z + 30.0)
        })
        .collect()
}

fn fitted(kind: FeatureKind) -> Value {
    let points = points(kind);
    let result = umi_core::job::fit(kind, &points).unwrap();
    fit(&FitFigures::new(&result, &points))
}

/// The names and the order of all fields of every kind of fit, which scripts rely on.
#[test]
fn fields_of_every_kind() {
    for (kind, parameters, uncertainties) in [
        (
            FeatureKind::Sphere,
            "center_mm radius_mm",
            "u_center_mm u_radius_mm cov_unit cov_mm2",
        ),
        (
            FeatureKind::Plane,
            "point_mm normal offset_mm",
            "u_normal u_offset_at_point_mm cov_unit_normal cov_normal var_unit_offset_at_point var_offset_at_point_mm2",
        ),
        (
            FeatureKind::Line,
            "point_mm direction",
            "u_point_mm u_direction cov_unit_direction cov_direction cov_unit_point cov_point_mm2",
        ),
        (
            FeatureKind::Circle,
            "center_mm normal radius_mm",
            "rms_plane_mm u_center_mm u_radius_mm cov_unit cov_mm2",
        ),
        (
            FeatureKind::Cylinder,
            "point_mm direction radius_mm",
            "u_point_mm u_direction u_radius_mm cov_unit_point cov_point_mm2 cov_unit_direction cov_direction var_unit_radius var_radius_mm2",
        ),
        (
            FeatureKind::Cone,
            "apex_mm direction half_angle_rad",
            "u_apex_mm u_direction u_half_angle_rad cov_unit_apex cov_apex_mm2 cov_unit_direction cov_direction var_unit_half_angle var_half_angle_rad2",
        ),
    ] {
        let value = fitted(kind);
        let wanted = format!(
            "kind n {parameters} rms_mm sigma_mm dof max_abs_residual_mm {uncertainties} residuals_mm"
        );
        assert_eq!(keys(&value).join(" "), wanted);
        let object = value.as_object().unwrap();
        assert!(object.values().all(|field| !field.is_null()), "{value}");
        assert_eq!(value["residuals_mm"].as_array().unwrap().len(), 24);
        assert_eq!(value["n"], 24);
    }
}

/// u² is the diagonal of cov, which is sigma² times that of cov_unit.
#[test]
fn uncertainties_belong_to_their_covariance() {
    let value = fitted(FeatureKind::Sphere);
    let number = |value: &Value| value.as_f64().unwrap();
    let sigma = number(&value["sigma_mm"]);
    for axis in 0..3 {
        let cov = number(&value["cov_mm2"][axis][axis]);
        let u = number(&value["u_center_mm"][axis]);
        let unit = number(&value["cov_unit"][axis][axis]);
        assert!((u * u - cov).abs() <= 1e-12 * cov);
        assert!((sigma * sigma * unit - cov).abs() <= 1e-12 * cov);
    }
}

/// Without degrees of freedom nothing is invented: sigma and all that needs it is null.
#[test]
fn no_sigma_no_uncertainty() {
    let points = &points(FeatureKind::Sphere)[..4];
    let result = umi_core::job::fit(FeatureKind::Sphere, points).unwrap();
    let value = fit(&FitFigures::new(&result, points));
    for field in ["sigma_mm", "cov_mm2", "u_center_mm", "u_radius_mm"] {
        assert!(value[field].is_null(), "{field}");
    }
    assert!(value["cov_unit"].is_array());
    assert_eq!(value["dof"], 0);
}

/// A number reads back as the same double, and a number that is none is null.
#[test]
fn numbers_read_back_to_the_last_bit() {
    for x in [
        0.1 + 0.2,
        1.0 / 3.0,
        -136.710_500_854_528_73,
        5e-324,
        f64::MAX,
    ] {
        let text = json!(x).to_string();
        assert_eq!(
            text.parse::<f64>().unwrap().to_bits(),
            x.to_bits(),
            "{text}"
        );
    }
    assert!(json!(f64::NAN).is_null());
}

fn feature_result() -> FeatureResult {
    let points = points(FeatureKind::Sphere);
    let result = umi_core::job::fit(FeatureKind::Sphere, &points).unwrap();
    FeatureResult {
        index: 4,
        setup: 1,
        name: name("SPHERE2"),
        kind: FeatureKind::Sphere,
        reasons: List::new(),
        points_mm: points.iter().map(|p| p.to_array_mm()).collect(),
        fit: Some(result.report(&points)),
    }
}

/// A good feature carries the same object as `umi fit` prints for its points.
#[test]
fn a_feature_carries_its_fit() {
    let value = feature(&feature_result());
    assert_eq!(value["type"], "feature");
    assert_eq!(value["index"], 4);
    assert_eq!(value["name"], "SPHERE2");
    assert_eq!(value["status"], "ok");
    assert_eq!(value["reasons"], json!([]));
    assert_eq!(value["points_mm"].as_array().unwrap().len(), 24);
    assert_eq!(value["fit"], fitted(FeatureKind::Sphere));
}

/// A refused feature says why, with code, sentence and figures; its fit is null.
#[test]
fn a_refused_feature_says_why() {
    let mut result = feature_result();
    result.fit = None;
    result.reasons = List::from_slice(&[
        Reason::FitRefused {
            code: FitRefusal::Degenerate,
        },
        Reason::NullPoint { hit: 3 },
    ])
    .unwrap();
    let value = feature(&result);
    assert_eq!(value["status"], "refused");
    assert!(value["fit"].is_null());
    assert_eq!(value["reasons"][0]["code"], "degenerate");
    assert_eq!(value["reasons"][1]["code"], "null_point");
    assert_eq!(value["reasons"][1]["details"], json!({"hit": 3}));
    let message = value["reasons"][1]["message"].as_str().unwrap();
    assert!(message.contains("hit 3"), "{message}");
}

/// A fault has its code, its place and its figures.
#[test]
fn a_fault_has_code_and_figures() {
    let value = fault(&Fault {
        kind: FaultKind::Gap {
            run: 17,
            from: 3,
            to: 4,
        },
        line: 8,
        byte_offset: 300,
        t_us: 5_000_000,
        text: name("UMI1"),
    });
    assert_eq!(value["type"], "fault");
    assert_eq!(value["code"], "gap");
    assert_eq!(
        (&value["line"], &value["byte_offset"]),
        (&json!(8), &json!(300))
    );
    assert_eq!(value["details"], json!({"run": 17, "from": 3, "to": 4}));
    assert!(value["message"].as_str().unwrap().contains("run 17"));
}

fn empty_verdict() -> Verdict {
    Verdict {
        setup: 2,
        ok: false,
        reasons: List::new(),
        reasons_dropped: 0,
        remarks: List::new(),
        distances: List::new(),
        registration: None,
        correction: None,
    }
}

/// An NG verdict names its reasons and the feature of each; what it has not is null.
#[test]
fn an_ng_verdict_names_reasons_and_features() {
    let mut verdict_ = empty_verdict();
    let shift = Reason::Shift {
        axis: 2,
        shift_mm: 0.18,
        limit_mm: 0.06,
    };
    verdict_.reasons = List::from_slice(&[
        SetupReason {
            feature: Some(name("SPHERE1")),
            reason: Reason::SequenceGap,
        },
        SetupReason {
            feature: None,
            reason: shift,
        },
    ])
    .unwrap();
    let value = verdict(&verdict_);
    assert_eq!(value["type"], "verdict");
    assert_eq!(value["plate"], 2);
    assert_eq!(value["verdict"], "NG");
    assert_eq!(value["reasons"][0]["feature"], "SPHERE1");
    assert_eq!(value["reasons"][0]["code"], "sequence_gap");
    assert!(value["reasons"][1]["feature"].is_null());
    assert_eq!(value["reasons"][1]["details"]["shift_mm"], 0.18);
    assert!(value["registration"].is_null());
    assert!(value["correction"].is_null());
}

/// An OK verdict carries the registration as `umi register` prints it, distances
/// with their error, and the program to the last character.
#[test]
fn an_ok_verdict_carries_registration_and_correction() {
    let nominal = points(FeatureKind::Plane);
    let nominal = &nominal[..5];
    let turned: Vec<Point> = nominal
        .iter()
        .map(|p| {
            let [x, y, z] = p.to_array_mm();
            Point::from_mm(-y + 1.0, x + 2.0, z + 0.001 * x.sin())
        })
        .collect();
    let found = umi_core::registration::register(nominal, &turned).unwrap();
    let printed = Registered::new(&found, nominal, &turned);
    let mut verdict_ = empty_verdict();
    verdict_.ok = true;
    verdict_.registration = Some(umi_protocol::verdict::RegistrationReport {
        rotation: printed.rotation,
        translation_mm: printed.translation_mm,
        angle_deg: printed.angle_deg,
        axis: printed.axis,
        dof: 9,
        rms_mm: printed.rms_mm,
        sigma_mm: printed.sigma_mm,
        residuals_mm: List::from_slice(&printed.residuals_mm).unwrap(),
        cov_unit_rotvec: printed.cov_unit_rotvec,
        cov_unit_t: printed.cov_unit_t,
        expected_error_mm: printed.expected_error_mm,
    });
    verdict_.correction = Some(CorrectionReport {
        dialect: Dialect::G10G68,
        text: heapless::String::try_from("%\nO9010\nM99\n%\n").unwrap(),
        leftover_mm: 0.003,
    });
    verdict_
        .distances
        .push(DistanceReport {
            a: name("S1"),
            b: name("S2"),
            measured_mm: 250.25,
            reference_mm: Some(250.0),
        })
        .unwrap();
    let value = verdict(&verdict_);
    assert_eq!(value["verdict"], "OK");
    assert_eq!(value["registration"], registration(&printed));
    assert_eq!(value["registration"]["dof"], 9);
    assert!((value["registration"]["angle_deg"].as_f64().unwrap() - 90.0).abs() < 0.01);
    assert_eq!(value["distances"][0]["error_mm"], 0.25);
    assert_eq!(
        value["correction"],
        json!({"dialect": "g10-g68", "text": "%\nO9010\nM99\n%\n", "leftover_mm": 0.003})
    );
}

/// A journal entry is its record's object behind number and time; bytes stand
/// there as text and complete.
#[test]
fn an_entry_is_its_record_with_number_and_time() {
    let raw = List::from_slice(b"X-1.5\r\n\x94").unwrap();
    let value = entry(7, 1_500_000, &Record::Bytes { raw });
    assert_eq!(
        value,
        json!({
            "seq": 7, "t_us": 1_500_000, "type": "bytes",
            "text": "X-1.5\\r\\n\\x14", "hex": "582d312e350d0a94",
        })
    );
    let value = entry(8, 2, &Record::Verdict(empty_verdict()));
    assert_eq!(value["type"], "verdict");
    assert_eq!(value["seq"], 8);
    let value = entry(9, 3, &Record::Acknowledged { seq: 5, lost: 2 });
    assert_eq!(value["seq"], 9);
    assert_eq!(value["acked_seq"], 5);
    assert_eq!(value["lost"], 2);
}

/// Faults are counted by their names.
#[test]
fn counters_are_named() {
    let mut of = Counters::default();
    of.count(FaultCode::BadParity);
    let value = counters(&of);
    assert_eq!(value["faults"]["bad_parity"], 1);
    assert_eq!(value["faults"].as_object().unwrap().len(), FaultCode::COUNT);
    assert_eq!(value["bytes"], 0);
}
