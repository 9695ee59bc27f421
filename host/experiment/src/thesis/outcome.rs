//! What an experiment gives.

use umi_core::fit;
use umi_core::units::Point;
use umi_virtual::cutting::{CylinderArc, DeviationStatistics, SurfaceDeviations, Workpiece};

use umi_protocol::job::Dialect;

use super::part::{NOMINAL, SECTIONS};
use super::path::Passes;
use umi_client::session::Session;

/// By what a clamping is corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The board's program, in words that this shop's control knows.
    Program(Dialect),
    /// The finishing program, rewritten by the verdict's registration.
    Rewritten,
}

impl Method {
    /// All that there is an interpreter for.
    pub const ALL: [Self; 8] = [
        Self::Program(Dialect::G10G68),
        Self::Program(Dialect::Variables),
        Self::Program(Dialect::G68ThreeD),
        Self::Program(Dialect::FanucSettingError),
        Self::Program(Dialect::Haas),
        Self::Program(Dialect::LinuxCnc),
        Self::Program(Dialect::Grbl),
        Self::Rewritten,
    ];

    /// Its name in commands and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Program(dialect) => dialect.name(),
            Self::Rewritten => "rewritten",
        }
    }
}

/// How an experiment is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Seed of all random errors.
    pub seed: u64,
    /// No error sources: no noise, no delay, and a pretravel that is alike in all
    /// directions and compensated exactly.
    pub ideal: bool,
    /// The largest distance of two passes on the surface, mm.
    pub stepover_mm: f64,
    /// Pitch of the grid on which the surface is measured, X and Y, mm.
    pub pitch_mm: [f64; 2],
    /// By what the clampings are corrected.
    pub remedy: Method,
}

/// The finished surface, measured.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The deviation of every node.
    pub deviations: SurfaceDeviations,
    /// Figures of the whole surface.
    pub whole: DeviationStatistics,
    /// Figures of each section.
    pub sections: Vec<DeviationStatistics>,
    /// What the thesis' tables 5.1 and 6.3 state: sections 1 and up against the nominal
    /// arc as it lies best on section 0 ([`SurfaceDeviations::laid_on`]). None if section 0
    /// was not cut.
    pub against_first: Option<DeviationStatistics>,
    /// Contacts of the tool that were no cuts (rapid motions through the material).
    pub crashes: usize,
}

impl Surface {
    /// Measures a workpiece. None if a section has no node: the grid is too coarse.
    #[must_use]
    pub fn measure(workpiece: &Workpiece, passes: &Passes, crashes: usize) -> Option<Self> {
        Self::measure_against(workpiece, passes, crashes, &NOMINAL)
    }

    fn measure_against(
        workpiece: &Workpiece,
        passes: &Passes,
        crashes: usize,
        nominal: &CylinderArc,
    ) -> Option<Self> {
        let deviations = SurfaceDeviations::of(workpiece, nominal);
        let whole = deviations.statistics(|_, _| true)?;
        let sections = (0..SECTIONS)
            .map(|section| {
                let [low, high] = passes.section_y_mm(section);
                deviations.statistics(|_, y| y > low && y <= high)
            })
            .collect::<Option<Vec<_>>>()?;
        let [low, high] = passes.section_y_mm(0);
        let first = |_: f64, y: f64| y > low && y <= high;
        let against_first = deviations
            .laid_on(nominal, first)
            .and_then(|laid| laid.statistics(|x, y| !first(x, y)));
        Some(Self {
            deviations,
            whole,
            sections,
            against_first,
            crashes,
        })
    }
}

/// A plane through points of the plate's surface (table 5.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Centroid of the points, mm.
    pub centroid_mm: [f64; 3],
    /// Unit normal.
    pub normal: [f64; 3],
    /// Standard deviation of the residuals, n - 3 degrees of freedom, mm.
    pub std_mm: f64,
    /// Points.
    pub points: usize,
}

impl Plane {
    /// Fits it, orthogonal least squares.
    ///
    /// # Errors
    /// The fit's.
    pub fn fit(points: &[Point]) -> Result<Self, fit::FitError> {
        let plane = fit::plane::fit(points)?;
        Ok(Self {
            centroid_mm: plane.point.to_array_mm(),
            normal: plane.normal.into(),
            // Four points or more, so there is one; an exact plane has none.
            std_mm: plane.stats.sigma.map_or(0.0, |sigma| sigma.0),
            points: points.len(),
        })
    }
}

/// The probe in a ring gauge (thesis, section 3.5).
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Direction of each hit from the fitted centre, radians, and the pretravel there:
    /// how much farther the tip went than the ring's wall, mm.
    pub pretravel: Vec<(f64, f64)>,
    /// Its mean: the fitted circle's radius less that of the ring less the tip's, mm.
    pub mean_mm: f64,
}

impl Calibration {
    /// From the tip's centre at the hits; the circle that they allow is the ring's
    /// radius less the tip's, mm.
    ///
    /// # Errors
    /// The fit's.
    pub fn fit(points: &[Point], allowed_radius_mm: f64) -> Result<Self, fit::FitError> {
        let circle = fit::circle2d::fit(points)?;
        let (x, y) = (circle.center_x.0, circle.center_y.0);
        let pretravel = points.iter().map(|p| {
            let (dx, dy) = (p.mm.x - x, p.mm.y - y);
            (dy.atan2(dx), dx.hypot(dy) - allowed_radius_mm)
        });
        Ok(Self {
            pretravel: pretravel.collect(),
            mean_mm: circle.radius.0 - allowed_radius_mm,
        })
    }
}

/// Everything that one run of the experiment gives.
#[derive(Clone, Debug)]
pub struct ExperimentOutcome {
    /// How it was run.
    pub setting: Setting,
    /// The error sources in force, in words: name and amount.
    pub sources: Vec<(String, String)>,
    /// The probe in a ring gauge, before the first clamping.
    pub calibration: Calibration,
    /// What the probing routine adds for the pretravel, mm.
    pub compensation_mm: f64,
    /// The finishing path.
    pub passes: Passes,
    /// What the board decided.
    pub session: Session,
    /// The workpiece that was cut with the corrections.
    pub corrected: Surface,
    /// A workpiece that was cut in the same clampings without them.
    pub uncorrected: Surface,
    /// The plate's surface in each clamping.
    pub planes: Vec<Plane>,
    /// How far the programmed points are from where they should be on the part,
    /// without correction, for each clamping: the largest, mm.
    pub position_error_mm: Vec<f64>,
    /// Bytes that the control has printed.
    pub printed_bytes: usize,
    /// The correction program that the control read in each clamping; none where
    /// the setup was taught.
    pub corrections: Vec<Option<String>>,
    /// The finishing program that ran in each clamping; none where the verdict was NG.
    pub programs: Vec<Option<String>>,
    /// Duration on the machine, seconds.
    pub machine_s: f64,
}

/// The figures of one run that are compared between seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExperimentSummary {
    /// The seed.
    pub seed: u64,
    /// The corrected surface.
    pub corrected: DeviationStatistics,
    /// The same as the thesis states it ([`Surface::against_first`]).
    pub against_first: Option<DeviationStatistics>,
    /// The uncorrected one.
    pub uncorrected: DeviationStatistics,
}

impl ExperimentOutcome {
    /// The figures that are compared between seeds.
    #[must_use]
    pub fn summary(&self) -> ExperimentSummary {
        ExperimentSummary {
            seed: self.setting.seed,
            corrected: self.corrected.whole,
            against_first: self.corrected.against_first,
            uncorrected: self.uncorrected.whole,
        }
    }
}

/// Mean and standard deviation (n - 1) of a figure over seeds; the deviation is zero
/// for one seed.
#[must_use]
#[allow(clippy::cast_precision_loss, reason = "a handful of seeds")]
pub fn spread(
    summaries: &[ExperimentSummary],
    figure: impl Fn(&ExperimentSummary) -> f64,
) -> (f64, f64) {
    let n = summaries.len().max(1) as f64;
    let mean = summaries.iter().map(&figure).sum::<f64>() / n;
    let squares: f64 = summaries
        .iter()
        .map(|summary| (figure(summary) - mean).powi(2))
        .sum();
    (mean, (squares / (n - 1.0).max(1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use umi_virtual::cutting::DeviationStatistics;

    use super::*;

    /// Mean and standard deviation over seeds, by hand.
    #[test]
    fn spread_over_seeds() {
        let summaries: Vec<ExperimentSummary> = [1.0, 2.0, 6.0]
            .iter()
            .map(|&mean_mm| ExperimentSummary {
                seed: 1,
                corrected: DeviationStatistics {
                    mean_mm,
                    ..DeviationStatistics::default()
                },
                against_first: None,
                uncorrected: DeviationStatistics::default(),
            })
            .collect();
        let (mean, std) = spread(&summaries, |summary| summary.corrected.mean_mm);
        assert!((mean - 3.0).abs() < 1e-12 && (std - 7.0_f64.sqrt()).abs() < 1e-12);
        assert!(spread(&summaries[..1], |_| 4.0).1.abs() < 1e-12);
    }
}
