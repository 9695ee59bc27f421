//! What a distance costs, and how much less a far point weighs.

use std::str::FromStr;

/// A robust kernel. `r` is a distance in mm, `C` a limit in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kernel {
    /// r².
    None,
    /// r² up to C, then C (2|r| − C).
    Huber(f64),
    /// C²/3 (1 − (1 − r²/C²)³) up to C, then C²/3.
    Tukey(f64),
}

impl Kernel {
    /// What the distance `r` costs, in mm².
    #[must_use]
    pub fn cost(self, r: f64) -> f64 {
        match self {
            Self::None => r * r,
            Self::Huber(c) if r.abs() <= c => r * r,
            Self::Huber(c) => c * (2.0 * r.abs() - c),
            Self::Tukey(c) => {
                let rest = (1.0 - (r / c).powi(2)).max(0.0);
                c * c / 3.0 * (1.0 - rest * rest * rest)
            }
        }
    }

    /// The weight of r² in a step: half of the cost's derivative, by r.
    #[must_use]
    pub fn weight(self, r: f64) -> f64 {
        match self {
            Self::None => 1.0,
            Self::Huber(c) => (c / r.abs().max(1e-300)).min(1.0),
            Self::Tukey(c) => {
                let rest = (1.0 - (r / c).powi(2)).max(0.0);
                rest * rest
            }
        }
    }
}

impl FromStr for Kernel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let limit = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|c| c.is_finite() && *c > 0.0)
                .ok_or_else(|| format!("`{text}` is no limit: give it in mm, as huber:0.05"))
        };
        match text.split_once(':') {
            None if text == "none" => Ok(Self::None),
            Some(("huber", c)) => limit(c).map(Self::Huber),
            Some(("tukey", c)) => limit(c).map(Self::Tukey),
            _ => Err(format!("`{text}` is no kernel: none, huber:MM or tukey:MM")),
        }
    }
}
