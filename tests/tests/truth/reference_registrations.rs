//! Every reference registration, at the tolerance that the case states.

use crate::cases::{self, cases, flat};
use umi_core::registration::{distances, register};
use umi_core::units::Point;

/// Answers, statistics and covariances of all registrations; refusals with the
/// right class.
#[test]
fn every_reference_registration_holds_at_its_tolerance() {
    let cases = cases(&["registration"]);
    assert_eq!(cases.len(), 10);
    for case in cases {
        let (source, target) = (case.points(0), case.points(3));
        let result = register(&source, &target);
        if case.expects_error() {
            case.refused(&result.unwrap_err());
            continue;
        }
        let fit = match result {
            Ok(fit) => fit,
            Err(_) if case.may_refuse() => continue,
            Err(error) => panic!("{}: {error}", case.id),
        };
        let rotation = fit.transform.rotation;
        case.close_at_tol("R", rotation.transpose().as_slice());
        case.close_at_tol("t", fit.transform.translation_mm.as_slice());
        case.close("angle", &[fit.angle.0], case.tol("R"));
        case.close_statistics(&fit.stats);
        let residuals: Vec<f64> = source
            .iter()
            .zip(&target)
            .flat_map(|(p, q)| fit.residual_mm(*p, *q).as_slice().to_vec())
            .collect();
        // Residuals of the rounded t: no better than t itself.
        case.close("residuals", &residuals, case.tol("t"));

        case.close_covariance("cov_unit_rotvec", fit.cov_unit_rotvec.as_flattened());
        case.close_true_covariance(
            "cov_rotvec",
            fit.cov_rotvec().map(|c| c.as_flattened().to_vec()),
        );
        case.close_true_covariance("cov_t", fit.cov_t().map(|c| c.as_flattened().to_vec()));
        if let (Some(cov), Some(cov_t), Some(cov_w)) = (fit.cov(), fit.cov_t(), fit.cov_rotvec()) {
            // The blocks of the 6x6 are the 3x3 ones.
            let scale = cov_t
                .as_flattened()
                .iter()
                .fold(0.0_f64, |m, x| m.max(x.abs()));
            for i in 0..3 {
                for j in 0..3 {
                    assert!(
                        (cov[i + 3][j + 3] - cov_t[i][j]).abs() < 1e-9 * scale,
                        "{}",
                        case.id
                    );
                    assert_eq!(cov[i][j], cov_w[i][j]);
                }
            }
        }

        // R is a rotation to the last digit, and R a = a for its axis.
        let identity = rotation * rotation.transpose();
        assert!(
            (identity - nalgebra_identity()).amax() < 1e-15,
            "{}",
            case.id
        );
        assert!((rotation.determinant() - 1.0).abs() < 1e-15);
        let axis = fit.axis.unwrap();
        assert!(
            (fit.transform.rotate(&axis) - axis).amax() < 1e-15,
            "{}",
            case.id
        );
        // The inverse undoes the transform.
        for p in &source {
            let back = fit.inverse().apply(fit.apply(*p));
            assert!((back.mm - p.mm).amax() < 1e-15 * 1e5);
        }
    }
}

fn nalgebra_identity() -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::identity()
}

/// Thesis table 4.2 as printed: rotation, translation and residuals of the four
/// clampings agree with the printed digits.
#[test]
fn thesis_table_4_2_is_reproduced() {
    for k in 1..=4 {
        let case = cases::case(&format!("registration_thesis_table_4_2_case{k}"));
        let fit = register(&case.points(0), &case.points(3)).unwrap();
        let printed = &case.json["printed"];
        let close = |got: &[f64], wanted: &serde_json::Value| {
            for (g, w) in got.iter().zip(flat(wanted)) {
                // Half a digit, and 1.03 of it at worst in the reconstruction.
                assert!((g - w).abs() < 0.52e-4, "case {k}: {g} printed {w}");
            }
        };
        close(fit.transform.rotation.transpose().as_slice(), &printed["R"]);
        close(fit.transform.translation_mm.as_slice(), &printed["t"]);
        for ((p, q), wanted) in case
            .points(0)
            .iter()
            .zip(case.points(3))
            .zip(printed["residuals"].as_array().unwrap())
        {
            close(fit.residual_mm(*p, q).as_slice(), wanted);
        }
    }
}

/// The plate check sees a bent plate and not a moved one.
#[test]
fn distances_change_with_the_plate_and_not_with_its_place() {
    let case = cases::case("registration_exact3");
    let (source, mut target) = (case.points(0), case.points(3));
    let all: Vec<_> = distances(&source, &target).unwrap().collect();
    let order: Vec<_> = all.iter().map(|d| (d.first, d.second)).collect();
    assert_eq!(order, [(0, 1), (0, 2), (1, 2)]);
    assert!(
        all.iter()
            .all(|d| d.difference().0.abs() < 1e-12 && d.nominal.0 > 200.0)
    );
    target[2] = Point::from_mm(target[2].mm.x, target[2].mm.y + 0.1, target[2].mm.z);
    let bent: Vec<f64> = distances(&source, &target)
        .unwrap()
        .map(|d| d.difference().0)
        .collect();
    assert!(bent[0].abs() < 1e-12 && bent[1].abs() > 0.05 && bent[2].abs() > 0.05);
    assert_eq!(
        distances(&source, &target[1..]).err().unwrap().code(),
        "length_mismatch"
    );
}

/// As `the_last_bits_are_pinned` of the fits.
#[test]
fn the_last_bits_are_pinned() {
    let case = cases::case("registration_thesis_table_4_2_case4");
    let fit = register(&case.points(0), &case.points(3)).unwrap();
    let first_row: Vec<f64> = fit.transform.rotation.row(0).iter().copied().collect();
    assert_eq!(
        first_row,
        [
            0.9992891189153111,
            0.03769955900547247,
            8.261595567110244e-6
        ]
    );
    let translation = [
        -35.18458581694781,
        -0.27679309687778186,
        -0.008997432114199455,
    ];
    assert_eq!(fit.transform.translation_mm.as_slice(), translation);
}
