//! The functions behind the stated error; what it is worth, is in `job/tests/coverage.rs`.

use umi_protocol::job::FeatureKind;

use std::vec::Vec;

use super::axes::CarriedScatter;
use super::*;
use crate::job::fit;

/// Points of the F distribution as tables have them (NIST/SEMATECH e-Handbook, 1.3.6.7.3).
#[test]
fn f_distribution() {
    for (h, dof, table) in [
        (1.0, 1.0, 161.448),
        (2.0, 3.0, 9.552),
        (3.0, 3.0, 9.277),
        (3.0, 10.0, 3.708),
        (2.0, 20.0, 3.493),
        (10.0, 100.0, 1.927),
    ] {
        let value = f_95(h, dof);
        assert!((value - table).abs() < 6e-4 * table, "{h} {dof}: {value}");
    }
}

/// The logarithm of the gamma function is the library's.
#[test]
fn gamma() {
    for halves in 1..400_u16 {
        let x = f64::from(halves) * 0.5;
        let (ours, its) = (ln_gamma(x), libm::lgamma(x));
        assert!(
            (ours - its).abs() < 1e-13 * (1.0 + its.abs()),
            "{x}: {ours}, {its}"
        );
    }
}

/// Hits on a ball, on a bore and in a countersink, none of which stands along an axis.
fn shapes() -> [(FeatureKind, Vec<Vector3<f64>>); 3] {
    let about = |turns: u8, of: u8| f64::from(turns) / f64::from(of) * core::f64::consts::TAU;
    let lean = nalgebra::Rotation3::new(Vector3::new(0.5, -0.3, 0.2));
    let at = Vector3::new(120.0, -80.0, 45.0);
    let ball = (0..9_u8).map(|hit| {
        let height = f64::from(hit) / 10.0;
        let out = libm::sqrt(1.0 - height * height);
        let (sin, cos) = libm::sincos(about(3 * hit, 7));
        Vector3::new(out * cos, out * sin, height) * 12.7
    });
    let bore = (0..7_u8).map(|hit| {
        let (sin, cos) = libm::sincos(about(hit, 8));
        Vector3::new(cos, sin, 0.0) * 15.0
    });
    let sink = (0..10_u8).map(|hit| {
        let (sin, cos) = libm::sincos(about(2 * hit, 9));
        let height = 6.0 + 2.0 * f64::from(hit % 3);
        Vector3::new(cos * height, sin * height, 1.2 * height)
    });
    let there = |points: &mut dyn Iterator<Item = Vector3<f64>>| -> Vec<_> {
        points.map(|point| at + lean * point).collect()
    };
    [
        (FeatureKind::Sphere, there(&mut ball.into_iter())),
        (FeatureKind::Circle, there(&mut bore.into_iter())),
        (FeatureKind::Cone, there(&mut sink.into_iter())),
    ]
}

fn fitted(kind: FeatureKind, points: &[Vector3<f64>]) -> FitReport {
    let points: Vec<_> = points.iter().map(|mm| Point { mm: *mm }).collect();
    fit(kind, &points).unwrap().report(&points)
}

fn rows(points: &[Vector3<f64>]) -> Vec<[f64; 3]> {
    points.iter().map(|mm| (*mm).into()).collect()
}

/// With three sigmas that are one, what is worked out for three is the fit's own unit covariance
/// and its degrees of freedom.
#[test]
fn three_that_are_one() {
    for (kind, points) in shapes() {
        let fit = fitted(kind, &points);
        let axes = ByAxis::new([0.002; 3], 1e-6, 19.0);
        let carried = carried(&fit, &rows(&points), &axes).unwrap();
        let (variance, dof) = (5e-6, f64::from(fit.dof));
        let unit = match &fit.shape {
            Shape::Sphere { cov_unit, .. } | Shape::Circle { cov_unit, .. } => corner(cov_unit),
            Shape::Cone { cov_unit_apex, .. } => corner(cov_unit_apex),
            _ => unreachable!(),
        };
        let off = (carried.place - unit * variance).amax();
        assert!(off < 1e-9 * variance * unit.amax(), "{kind:?}: {off}");
        assert!((carried.squares / variance - dof).abs() < 1e-9, "{kind:?}");
        assert!((carried.dof - dof).abs() < 1e-9, "{kind:?}");
    }
}

/// With three that differ it is what fits do whose hits were moved, one by one, along their
/// normals: the covariance of the place, and what is left of them in the residuals.
#[test]
fn hits_moved_one_by_one() {
    let axes = ByAxis::new([0.001, 0.002, 0.006], 1e-6, 19.0);
    for (kind, points) in shapes() {
        let exact = fitted(kind, &points);
        let normal = |at: usize| {
            let out = |from: &[f64; 3], axis: &Vector3<f64>| {
                let arm = points[at] - Vector3::from(*from);
                (arm - axis * axis.dot(&arm)).normalize()
            };
            match &exact.shape {
                Shape::Sphere { center_mm, .. } => out(center_mm, &Vector3::zeros()),
                Shape::Circle {
                    center_mm, normal, ..
                } => out(center_mm, &Vector3::from(*normal)),
                Shape::Cone {
                    apex_mm,
                    direction,
                    half_angle_rad,
                    ..
                } => {
                    let direction = Vector3::from(*direction);
                    let (sin, cos) = libm::sincos(*half_angle_rad);
                    out(apex_mm, &direction) * cos - direction * sin
                }
                _ => unreachable!(),
            }
        };
        // A fit through an exact surface moves by this.
        const BY_MM: f64 = 1e-4;
        let (mut place, mut left) = (Matrix3::zeros(), Vec::new());
        let mut variances = Vec::new();
        for at in 0..points.len() {
            let moved = |by_mm: f64| {
                let mut points = points.clone();
                points[at] += normal(at) * by_mm;
                fitted(kind, &points)
            };
            let (plus, minus) = (moved(BY_MM), moved(-BY_MM));
            let at_mm = |fit: &FitReport| Vector3::from(fit.shape.position_mm().unwrap());
            let by = (at_mm(&plus) - at_mm(&minus)) / (2.0 * BY_MM);
            let n = normal(at);
            let variance = n.x * n.x * 1e-6 + n.y * n.y * 4e-6 + n.z * n.z * 36e-6 + 1e-6;
            place += by * by.transpose() * variance;
            let residuals = plus.residuals_mm.iter().zip(&minus.residuals_mm);
            let residuals: Vec<_> = residuals.map(|(a, b)| (a - b) / (2.0 * BY_MM)).collect();
            left.push(residuals);
            variances.push(variance);
        }
        // (I - H) V, and the trace of its square.
        let count = points.len();
        let part = |row: usize, column: usize| left[column][row] * variances[column];
        let squares: f64 = (0..count).map(|at| part(at, at)).sum();
        let pairs = (0..count).flat_map(|a| (0..count).map(move |b| (a, b)));
        let pairs: f64 = pairs.map(|(a, b)| part(a, b) * part(b, a)).sum();
        let told = carried(&exact, &rows(&points), &axes).unwrap();
        let off = (told.place - place).amax() / place.amax();
        assert!(off < 1e-5, "{kind:?}: {off}");
        assert!((told.squares / squares - 1.0).abs() < 1e-5, "{kind:?}");
        let dof = squares * squares / pairs;
        assert!((told.dof / dof - 1.0).abs() < 1e-5, "{kind:?}");
        // Another covariance than that of hits which scatter alike, and fewer degrees of freedom.
        let alike = carried(&exact, &rows(&points), &ByAxis::new([0.001; 3], 0.0, 19.0)).unwrap();
        let alike_place = alike.place * (place.trace() / alike.place.trace());
        assert!(
            (told.place - alike_place).amax() > 0.1 * place.amax(),
            "{kind:?}"
        );
        assert!(
            told.dof < 0.95 * alike.dof,
            "{kind:?}: {} {}",
            told.dof,
            alike.dof
        );
    }
}

/// What residuals that see one axis say does not make another's sigma known better.
#[test]
fn degrees_of_freedom_of_an_axis() {
    let (mut alone, mut seen) = (
        ByAxis::new([0.001, 0.001, 0.003], 0.0, 19.0),
        ByAxis::new([0.001, 0.001, 0.003], 0.0, 19.0),
    );
    let place = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 9e-6));
    let of_place = Vector3::new(0.0, 0.0, 9e-6);
    let mut told = CarriedScatter {
        place,
        of_place,
        squares: 2e-6,
        of_squares: Vector3::new(2e-6, 0.0, 0.0),
        dof: 30.0,
    };
    alone.place(&place, &of_place);
    alone.residuals(&told);
    assert!(alone.dof(49.0) < 19.0);
    told.of_squares = Vector3::new(0.0, 0.0, 2e-6);
    seen.place(&place, &of_place);
    seen.residuals(&told);
    assert!((seen.dof(49.0) - 49.0).abs() < 1e-9);
}
