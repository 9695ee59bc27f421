//! Every reference fit, at the tolerance that the case states.

use crate::cases::{self, Case, cases};
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

#[test]
fn planes_hold_at_their_tolerance() {
    let cases = cases(&["plane"]);
    assert_eq!(cases.len(), 3);
    for case in cases {
        let Some(fit) = expected(&case, fit::plane::fit(&case.points(0))) else {
            continue;
        };
        case.close_at_tol("point", fit.point.mm.as_slice());
        case.close_up_to_sign("normal", fit.normal.as_slice());
        let sign = fit.normal.z.signum();
        case.close("offset", &[fit.offset.0 * sign], case.tol("point"));
        case.close_statistics(&fit.stats);
        case.close_covariance("cov_unit_normal", fit.cov_unit_normal.as_flattened());
        case.close_covariance("var_unit_offset_at_point", &[fit.var_unit_offset_at_point]);
        case.close_true_covariance("cov_normal", flattened(fit.cov_normal()));
        case.close_true_covariance(
            "var_offset_at_point",
            fit.var_offset_at_point().map(|v| vec![v]),
        );
    }
}

#[test]
fn lines_hold_at_their_tolerance() {
    let cases = cases(&["line"]);
    assert_eq!(cases.len(), 2);
    for case in cases {
        let Some(fit) = expected(&case, fit::line::fit(&case.points(0))) else {
            continue;
        };
        case.close_at_tol("point", fit.point.mm.as_slice());
        case.close_up_to_sign("direction", fit.direction.as_slice());
        case.close_statistics(&fit.stats);
        case.close_covariance("cov_unit_direction", fit.cov_unit_direction.as_flattened());
        case.close_covariance("cov_unit_point", fit.cov_unit_point.as_flattened());
        case.close_true_covariance("cov_direction", flattened(fit.cov_direction()));
        case.close_true_covariance("cov_point", flattened(fit.cov_point()));
    }
}

#[test]
fn circles_hold_at_their_tolerance() {
    let cases = cases(&["circle"]);
    assert_eq!(cases.len(), 4);
    for case in cases {
        let points = case.points(0);
        let Some(fit) = expected(&case, fit::circle::fit(&points)) else {
            continue;
        };
        case.close_at_tol("center", fit.center.mm.as_slice());
        case.close_at_tol("radius", &[fit.radius.0]);
        case.close_up_to_sign("normal", fit.normal.as_slice());
        case.close_statistics(&fit.stats);
        case.close("rms_plane", &[fit.rms_plane.0], case.tol("rms"));
        case.close("rms_total", &[fit.rms_total().0], case.tol("rms"));
        case.close_covariance("cov_unit", fit.cov_unit.as_flattened());
        case.close_true_covariance("cov", flattened(fit.cov()));

        // Told the normal, the fit in the plane is the same.
        let told = fit::circle::fit_in_plane(&points, &(fit.normal * -2.0)).unwrap();
        assert!(
            (told.center.mm - fit.center.mm).amax() < 1e-12,
            "{}",
            case.id
        );
        assert!((told.radius.0 - fit.radius.0).abs() < 1e-12);
        assert!((told.rms_plane.0 - fit.rms_plane.0).abs() < 1e-12);
        assert!((told.normal - fit.normal).amax() < 1e-15);
    }
}

/// A ring gauge needs only x and y: whatever stands in z, the answer is that of
/// the reference.
#[test]
fn ring_gauge_holds_in_two_dimensions() {
    let case = cases::case("circle_ring_gauge_36");
    let mut points = case.points(0);
    for (k, point) in points.iter_mut().enumerate() {
        point.mm.z = 20.0 * k as f64;
    }
    let fit = fit::circle2d::fit(&points).unwrap();
    let wanted = cases::flat(case.result("center"));
    assert!((fit.center_x.0 - wanted[0]).abs() <= case.tol("center"));
    assert!((fit.center_y.0 - wanted[1]).abs() <= case.tol("center"));
    case.close_at_tol("radius", &[fit.radius.0]);
    case.close_statistics(&fit.stats);
}

#[test]
fn cylinders_hold_at_their_tolerance() {
    let cases = cases(&["cylinder"]);
    assert_eq!(cases.len(), 3);
    for case in cases {
        let points = case.points(0);
        let Some(fit) = expected(&case, fit::cylinder::fit(&points)) else {
            continue;
        };
        case.close_at_tol("point", fit.point.mm.as_slice());
        case.close_up_to_sign("direction", fit.direction.as_slice());
        case.close_at_tol("radius", &[fit.radius.0]);
        case.close_statistics(&fit.stats);
        case.close_covariance("cov_unit_point", fit.cov_unit_point.as_flattened());
        case.close_covariance("cov_unit_direction", fit.cov_unit_direction.as_flattened());
        case.close_covariance("var_unit_radius", &[fit.var_unit_radius]);
        case.close_true_covariance("cov_point", flattened(fit.cov_point()));
        case.close_true_covariance("cov_direction", flattened(fit.cov_direction()));
        case.close_true_covariance("var_radius", fit.var_radius().map(|v| vec![v]));

        let hint = hint(&case);
        let near = fit::cylinder::fit_near(&points, &hint).unwrap();
        assert!((near.point.mm - fit.point.mm).amax() < 1e-10, "{}", case.id);
        assert!((near.radius.0 - fit.radius.0).abs() < 1e-10, "{}", case.id);
    }
}

#[test]
fn cones_hold_at_their_tolerance() {
    let cases = cases(&["cone"]);
    assert_eq!(cases.len(), 2);
    for case in cases {
        let points = case.points(0);
        let Some(fit) = expected(&case, fit::cone::fit(&points)) else {
            continue;
        };
        case.close_at_tol("apex", fit.apex.mm.as_slice());
        // With its sign: from the apex into the points.
        case.close_at_tol("direction", fit.direction.as_slice());
        case.close_at_tol("half_angle", &[fit.half_angle.0]);
        case.close("point", fit.point.mm.as_slice(), 1e-9);
        case.close("radius_at_point", &[fit.radius_at_point.0], 1e-9);
        case.close_statistics(&fit.stats);
        case.close_covariance("cov_unit_apex", fit.cov_unit_apex.as_flattened());
        case.close_covariance("cov_unit_direction", fit.cov_unit_direction.as_flattened());
        case.close_covariance("var_unit_half_angle", &[fit.var_unit_half_angle]);
        case.close_true_covariance("cov_apex", flattened(fit.cov_apex()));
        case.close_true_covariance("cov_direction", flattened(fit.cov_direction()));
        case.close_true_covariance("var_half_angle", fit.var_half_angle().map(|v| vec![v]));

        let hint = hint(&case);
        let near = fit::cone::fit_near(&points, &-hint).unwrap();
        assert!((near.apex.mm - fit.apex.mm).amax() < 1e-10, "{}", case.id);
    }
}

fn hint(case: &Case) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from_column_slice(&cases::flat(&case.json["hint_axis"]))
}

/// Thesis table 4.1, as printed: centre, radius and the standard deviation of
/// residuals, which is sqrt(SSQ / (n - 4)). Its "uncertainty of centre" is half of
/// that, and not the uncertainty of the centre: that is 1.4 to 2.2 times as large.
#[test]
fn thesis_table_4_1_is_reproduced() {
    let case = cases::case("sphere_thesis_table_4_1");
    let points = case.points(0);
    let fit = fit::sphere::fit(&points).unwrap();
    let printed = &case.json["printed"];
    let four_digits = |x: f64| (x * 1e4).round() / 1e4;

    let center: Vec<f64> = fit.center.to_array_mm().map(four_digits).to_vec();
    assert_eq!(center, cases::flat(&printed["center"]));
    assert_eq!(center, [-136.7105, 136.4120, 136.1212]);
    assert_eq!(four_digits(fit.radius.0), 12.7118);
    assert_eq!(
        four_digits(fit.radius.0),
        printed["radius"].as_f64().unwrap()
    );

    let squares: f64 = points.iter().map(|p| fit.residual(*p).0.powi(2)).sum();
    let deviation = fit.stats.sigma.unwrap().0;
    assert_eq!(four_digits(deviation), 0.0145);
    assert_eq!(
        four_digits(deviation),
        printed["std_residuals"].as_f64().unwrap()
    );
    // Five points minus four parameters leave one degree of freedom; no other
    // divisor gives the print.
    for divisor in 1..=5 {
        let candidate = four_digits((squares / f64::from(divisor)).sqrt());
        assert_eq!(candidate == 0.0145, divisor == 1, "{divisor}");
    }
    assert_eq!(fit.stats.dof, 1);

    // What the thesis calls the uncertainty of the centre is s/2, with s rounded.
    let half = four_digits(four_digits(deviation) / 2.0);
    assert_eq!(half, 0.0073);
    assert_eq!(half, printed["uncertainty_of_centre"].as_f64().unwrap());
    // The standard uncertainties by least squares.
    let [x, y, z] = fit.center_uncertainty().unwrap().map(|u| four_digits(u.0));
    assert_eq!([x, y, z], [0.0103, 0.0103, 0.0162]);
    assert_eq!(four_digits(fit.radius_uncertainty().unwrap().0), 0.0073);
}

/// One degree of freedom cannot see a wrong top hit: 0.18 mm on the top point leave
/// no residual, change the radius by a micrometre, and move the centre in z. Only something
/// outside the fit (the distances of the plate, a second hit) can catch it.
#[test]
fn a_wrong_top_hit_leaves_no_residual() {
    let mut points = cases::case("sphere_five_1um").points(0);
    let right = fit::sphere::fit(&points).unwrap();
    let top = (0..5)
        .max_by(|a, b| points[*a].mm.z.total_cmp(&points[*b].mm.z))
        .unwrap();
    points[top].mm.z += 0.18;
    let wrong = fit::sphere::fit(&points).unwrap();
    assert!(wrong.stats.rms.0 < 0.001, "{:?}", wrong.stats);
    assert!((wrong.radius.0 - right.radius.0).abs() < 0.002);
    assert!((wrong.center.mm.z - right.center.mm.z).abs() > 0.17);
}

/// The last bits of a few results, which must be the same on every target and at
/// every optimisation level (an `f64` printed by Rust reads back as itself). A
/// change of an algorithm may change them; then journals of older boards replay to
/// other last digits, and the changelog has to say so.
#[test]
fn the_last_bits_are_pinned() {
    let fit = fit::sphere::fit(&cases::case("sphere_thesis_table_4_1").points(0)).unwrap();
    let center = [-136.71050085452873, 136.4119988580253, 136.12124443203012];
    assert_eq!(fit.center.to_array_mm(), center);
    assert_eq!(fit.radius.0, 12.711755562460086);

    let fit = fit::cylinder::fit(&cases::case("cylinder_arc100_n45_10um").points(0)).unwrap();
    let point = [
        0.006642869333230422,
        0.0009967305410148544,
        -67.48919148363764,
    ];
    assert_eq!(fit.point.to_array_mm(), point);
    assert_eq!(fit.radius.0, 92.88177953508811);

    let fit = fit::cone::fit(&cases::case("cone_half30_n24_1um").points(0)).unwrap();
    let apex = [4.999592173357843, 4.999796719143448, 4.997408423022108];
    assert_eq!(fit.apex.to_array_mm(), apex);
    assert_eq!(fit.half_angle.0, 0.5235758126439306);
}
