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
