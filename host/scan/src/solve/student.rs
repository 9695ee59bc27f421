//! Student's t: how far a standard uncertainty reaches whose sigma is itself an estimate.

/// Student's t for a two-sided 95 % interval; none without degrees of freedom.
///
/// Up to 10 degrees of freedom from the tables, above by the expansion of
/// Abramowitz and Stegun 26.7.5, which is right to 0.001 there.
#[must_use]
pub fn coverage_95(dof: u64) -> Option<f64> {
    const TABLE: [f64; 10] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
    ];
    let place = usize::try_from(dof).ok()?.checked_sub(1)?;
    Some(TABLE.get(place).copied().unwrap_or_else(|| {
        const Z: f64 = NORMAL_95;
        let n = dof as f64;
        let (z3, z5, z7) = (Z.powi(3), Z.powi(5), Z.powi(7));
        Z + (z3 + Z) / (4.0 * n)
            + (5.0 * z5 + 16.0 * z3 + 3.0 * Z) / (96.0 * n * n)
            + (3.0 * z7 + 19.0 * z5 + 17.0 * z3 - 15.0 * Z) / (384.0 * n * n * n)
    }))
}

/// The same where sigma is known: the 97.5 % point of the normal distribution.
pub const NORMAL_95: f64 = 1.959_964;

#[cfg(test)]
mod tests {
    use super::coverage_95;

    /// The factors agree with the tables of Student's t at 1, 10, 11, 20 and 1000.
    #[test]
    fn coverage_agrees_with_the_tables() {
        for (dof, t) in [
            (1, 12.706),
            (10, 2.228),
            (11, 2.201),
            (20, 2.086),
            (1000, 1.962),
        ] {
            let got = coverage_95(dof).unwrap();
            assert!((got - t).abs() < 1e-3, "{dof}: {got} not {t}");
        }
        assert_eq!(coverage_95(0), None);
    }
}
