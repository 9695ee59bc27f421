//! Numbers on the command line.

use std::str::FromStr;

/// `X,Y,Z`
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triple(pub [f64; 3]);

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Option<Vec<f64>> = text
            .split(',')
            .map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()))
            .collect();
        let numbers = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        numbers
            .map(Triple)
            .ok_or_else(|| "three numbers with commas are needed, as 0,0,-1".to_owned())
    }
}

/// One finite number.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok();
    number
        .filter(|number: &f64| number.is_finite())
        .ok_or_else(|| "a finite number is needed".to_owned())
}

/// A finite number of 0 or more.
pub(crate) fn at_least_0(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|value: &f64| value.is_finite() && *value >= 0.0)
        .ok_or_else(|| format!("`{text}` is no number of 0 or more"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is compared with a number that is none is never too large: a limit of it would let all pass.
    #[test]
    fn what_is_no_number_is_no_limit() {
        for text in ["nan", "NaN", "-nan", "inf", "-inf", "1e400", "", "x"] {
            assert!(finite(text).is_err() && at_least_0(text).is_err(), "{text}");
        }
        assert_eq!(finite("-0.5"), Ok(-0.5));
        assert!(at_least_0("-0.5").is_err());
        assert_eq!(at_least_0("0.02"), Ok(0.02));
    }
}
