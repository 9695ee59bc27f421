//! Every reference fit, at the tolerance that the case states.

#[path = "cases/mod.rs"]
#[allow(dead_code)]
mod cases;

use cases::{Case, cases};
use umi_core::fit::{self, FitError};

/// Unwraps a fit that must succeed; None where a refusal was right.
fn expected<F>(case: &Case, result: Result<F, FitError>) -> Option<F> {
    match result {
        Err(error) if case.expects_error() => {
            case.refused(&error);
            None
        }
        Ok(_) if case.expects_error() => panic!("{} was fitted", case.id),
        Ok(fit) => Some(fit),
        Err(_) if case.may_refuse() => None,
        Err(error) => panic!("{}: {error}", case.id),
    }
}

fn flattened<const K: usize>(matrix: Option<[[f64; K]; K]>) -> Option<Vec<f64>> {
    matrix.map(|m| m.as_flattened().to_vec())
}

#[test]
fn spheres_hold_at_their_tolerance() {
    let cases = cases(&["sphere"]);
    assert_eq!(cases.len(), 10);
    for case in cases {
        let points = case.points(0);
        let Some(fit) = expected(&case, fit::sphere::fit(&points)) else {
            continue;
        };
        case.close_at_tol("center", fit.center.mm.as_slice());
        case.close_at_tol("radius", &[fit.radius.0]);
        case.close_statistics(&fit.stats);
        case.close_covariance("cov_unit", fit.cov_unit.as_flattened());
        case.close_true_covariance("cov", flattened(fit.cov()));

        let linear = fit::sphere::fit_linear(&points).unwrap();
        let wanted = case.result("linear_fit");
        for (g, w) in linear
            .center
            .to_array_mm()
            .iter()
            .zip(cases::flat(&wanted["center"]))
        {
            assert!(
                (g - w).abs() <= case.tol("center"),
                "{} linear {g} {w}",
                case.id
            );
        }
        let radius = wanted["radius"].as_f64().unwrap();
        assert!(
            (linear.radius.0 - radius).abs() <= case.tol("radius"),
            "{}",
            case.id
        );
    }
}
