//! The functions behind the stated error; what it is worth, is in `job/tests/coverage.rs`.

use super::*;

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
