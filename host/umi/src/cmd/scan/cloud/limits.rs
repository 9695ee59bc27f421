//! Limits of deviations on the command line.

use umi_report::pages::deviation::Bands;

/// The lower and the upper limit of deviations, with a comma between.
pub(super) fn limits(text: &str) -> Result<Bands, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|number| number.trim().parse().map_err(|_| number.to_owned()))
        .collect::<Result<_, _>>()
        .map_err(|number| format!("`{number}` is no number"))?;
    match numbers[..] {
        [low_mm, high_mm] if low_mm.is_finite() && high_mm.is_finite() && low_mm < high_mm => {
            Ok(Bands { low_mm, high_mm })
        }
        _ => Err("two numbers are needed, the lower first: -0.05,0.05".into()),
    }
}
