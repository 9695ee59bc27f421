//! What a hit scatters along each axis, from hits that were repeated on one place.

use umi_core::units::Point;
use umi_protocol::job::ProbingSpec;

use crate::problem::Problem;

/// How far beside each other hits on one place may be, across the axis: on a ball of 25 mm, touched at
/// its pole, one is 0.4 µm lower there.
pub const BESIDE_MM: f64 = 0.1;

/// A touch that scatters by more measures nothing.
pub const MOST_MM: f64 = 0.1;

/// The names of the axes.
pub const AXES: [&str; 3] = ["X", "Y", "Z"];

/// What repeated hits along one axis have shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisScatter {
    /// So many.
    pub hits: usize,
    /// Standard deviation of one, mm.
    pub sigma_mm: f64,
    /// Degrees of freedom: hits less one.
    pub dof: u16,
}

impl AxisScatter {
    /// Of hits along X (0), Y (1) or Z (2).
    ///
    /// # Errors
    /// `too_few_hits`; `not_finite`; `not_one_place`: they are not repeated; `no_scatter`: the coordinate has no digit
    /// that shows it; `other_axis`: another coordinate scatters more.
    pub fn of(axis: usize, hits: &[Point]) -> Result<Self, Problem> {
        let name = AXES.get(axis).copied().unwrap_or_default();
        let count = hits.len() as f64;
        if hits.len() < 2 {
            let said = format!(
                "{} hits along {name}: a scatter needs two, and 20 to be known to a sixth",
                hits.len()
            );
            return Err(Problem::refused("too_few_hits", said));
        }
        let along = |of: usize| hits.iter().map(move |hit| hit.to_array_mm()[of]);
        if let Some(at) = hits
            .iter()
            .position(|hit| !hit.to_array_mm().iter().all(|mm| mm.is_finite()))
        {
            let said = format!(
                "hits along {name}: hit {} has a coordinate that is no number",
                at + 1
            );
            return Err(Problem::refused("not_finite", said));
        }
        let spread =
            |of: usize| along(of).fold(f64::MIN, f64::max) - along(of).fold(f64::MAX, f64::min);
        for across in (0..3).filter(|across| *across != axis) {
            let apart_mm = spread(across);
            if apart_mm > BESIDE_MM {
                let said = format!(
                    "hits along {name}: they are {apart_mm:.3} mm apart in {}, so they are on different \
                     places. Touch one place again and again, along {name} alone",
                    AXES.get(across).copied().unwrap_or_default()
                );
                return Err(Problem::refused("not_one_place", said));
            }
        }
        let mean = along(axis).sum::<f64>() / count;
        let squares: f64 = along(axis).map(|mm| (mm - mean).powi(2)).sum();
        let sigma_mm = (squares / (count - 1.0)).sqrt();
        if spread(axis) <= 0.0 {
            let said = format!(
                "hits along {name}: all have {name} {:?}, so the control's step hides what they scatter. \
                 State a third of its step",
                hits[0].to_array_mm()[axis]
            );
            return Err(Problem::refused("no_scatter", said));
        }
        if sigma_mm > MOST_MM {
            let said = format!(
                "hits along {name}: they scatter by {sigma_mm:.3} mm, which no touch on one place does. Are they \
                 in millimetres, and all from one side of the ball?"
            );
            return Err(Problem::refused("not_one_place", said));
        }
        if let Some(across) = (0..3).find(|of| *of != axis && spread(*of) > spread(axis)) {
            let said = format!(
                "hits along {name}: they scatter more in {} than in {name}. Are they hits along {0}, in the \
                 file of another axis?",
                AXES.get(across).copied().unwrap_or_default()
            );
            return Err(Problem::refused("other_axis", said));
        }
        Ok(Self {
            hits: hits.len(),
            sigma_mm,
            dof: u16::try_from(hits.len() - 1).unwrap_or(u16::MAX),
        })
    }

    /// By which share of itself it may be wrong, as one standard deviation.
    #[must_use]
    pub fn known_to(&self) -> f64 {
        1.0 / (2.0 * f64::from(self.dof)).sqrt()
    }
}

/// What a job states of them: of the degrees of freedom the fewest.
#[must_use]
pub fn spec(axes: &[AxisScatter; 3]) -> ProbingSpec {
    ProbingSpec {
        sigma_mm: axes.map(|axis| axis.sigma_mm),
        dof: axes.iter().map(|axis| axis.dof).min().unwrap_or_default(),
    }
}

/// The lines of a job file.
#[must_use]
pub fn lines(spec: &ProbingSpec) -> String {
    // To a nanometre, or to four digits where that is more.
    let written = |mm: f64| match mm {
        0.000_1.. => format!("{mm:.6}"),
        _ => format!("{mm:.3e}"),
    };
    let [x, y, z] = spec.sigma_mm.map(written);
    format!(
        "[guards.probing]                # what one hit scatters along X, Y and Z\n\
         sigma_mm = [{x}, {y}, {z}]\ndof = {}\n",
        spec.dof
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along_z(z: &[f64]) -> Vec<Point> {
        z.iter().map(|z| Point::from_mm(10.0, 20.0, *z)).collect()
    }

    /// By hand: 1, 2, 3 and 6 µm have the mean 3 and squares of 14 in three degrees of freedom.
    #[test]
    fn by_hand() {
        let got = AxisScatter::of(2, &along_z(&[5.001, 5.002, 5.003, 5.006])).unwrap();
        assert!((got.sigma_mm - (14.0_f64 / 3.0).sqrt() * 1e-3).abs() < 1e-12);
        assert_eq!((got.hits, got.dof), (4, 3));
        assert!((got.known_to() - 0.408).abs() < 1e-3);
        let twice = AxisScatter { dof: 19, ..got };
        let spec = spec(&[twice, got, twice]);
        assert_eq!(spec.dof, 3);
        assert!(lines(&spec).contains("sigma_mm = [0.002160, 0.002160, 0.002160]\ndof = 3\n"));
    }

    /// What shows no scatter of hits on one place is refused by its name.
    #[test]
    fn what_shows_none_is_refused() {
        let code = |axis, hits: &[Point]| AxisScatter::of(axis, hits).unwrap_err().code;
        assert_eq!(code(2, &along_z(&[5.0])), "too_few_hits");
        assert_eq!(code(2, &along_z(&[5.0, 5.0, 5.0])), "no_scatter");
        assert_eq!(code(0, &along_z(&[5.0, 5.2])), "not_one_place");
        assert_eq!(code(2, &along_z(&[-12.7, 12.7])), "not_one_place");
        assert_eq!(code(2, &along_z(&[f64::INFINITY, 5.0])), "not_finite");
        let of_y = [[1.0, 5.001, 2.0], [1.001, 5.004, 2.0], [1.0, 5.002, 2.001]];
        let of_y = of_y.map(|[x, y, z]| Point::from_mm(x, y, z));
        assert_eq!(code(0, &of_y), "other_axis");
        assert_eq!(code(2, &of_y), "other_axis");
        assert!(AxisScatter::of(1, &of_y).is_ok());
    }
}
