//! A whole question: one scan or several, fiducials, a part.

mod agree;
mod reach;

use nalgebra::Matrix6;

use super::fiducials::{Fiducial, FiducialSeen, FiducialTask, ScannerFound};
use super::uncertainty::{Group, Groups, turning};
use super::verdict::each::{self, EachScan};
use super::{LocaliseTask, Located};
use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::Kernel;
use crate::surface::Mesh;

/// A scan, and by what the machine had moved the part when it was taken.
#[derive(Clone, Debug)]
pub struct TakenScan {
    /// What it is called.
    pub name: String,
    /// Its points in mm, as the scanner has them.
    pub points: Vec<Vec3>,
    /// By what the part had been moved, in machine coordinates.
    pub moved: Pose,
    /// Whether all fiducials had been moved with it; else only those that say so themselves.
    pub carried: bool,
}

impl TakenScan {
    /// The corners of the box around its points.
    #[must_use]
    pub fn corners(&self) -> [Vec3; 8] {
        let (low, high) = crate::surface::bounds(self.points.iter());
        crate::surface::box_corners(&low, &high)
    }
}

/// Where the part is, or where the scanner stands.
#[derive(Clone, Debug)]
pub struct ScanQuestion<'a> {
    /// The scans.
    pub scans: &'a [TakenScan],
    /// Fiducials; without them the scanner's frame stands for the machine's.
    pub fiducials: &'a [Fiducial],
    /// The part; without it the scanner's pose is the answer.
    pub part: Option<&'a Mesh>,
    /// Where the part is about, or the scanner without a part: that is where the answer is sought.
    pub start: Option<Pose>,
    /// A stated problem over all points, of the part if there is one.
    pub kernel: Option<Kernel>,
    /// Whether one of several poses that look alike will do.
    pub accept_symmetry: bool,
    /// The largest standard uncertainty at a corner of the part, or of the scan without a part, in mm.
    pub limit_mm: Option<f64>,
    /// By how much the scale may be off, in ppm.
    pub scale_limit_ppm: f64,
    /// Another seed begins the search with other points.
    pub seed: u64,
    /// Threads.
    pub threads: Threads,
}

/// A scan with its place.
#[derive(Clone, Debug)]
pub struct PlacedScan {
    /// What it is called.
    pub name: String,
    /// Machine from scanner.
    pub motion: Pose,
    /// Its covariance: turn and translation, as everywhere.
    pub cov: Matrix6<f64>,
    /// The fiducials in it.
    pub fiducials: Vec<FiducialSeen>,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct ScanAnswer {
    /// The part's pose, or the scanner's (of the first scan) without a part.
    pub located: Located,
    /// The fiducials over all scans.
    pub fiducials: Vec<FiducialSeen>,
    /// The scans, where there are fiducials.
    pub scans: Vec<PlacedScan>,
    /// The points that count where the answer puts them, the part not moved, with their signed distances in mm.
    pub deviations: Vec<(Vec3, f64)>,
}

impl ScanQuestion<'_> {
    /// The answer with its uncertainty and verdict.
    ///
    /// # Errors
    /// As [`LocaliseTask::find`] and [`FiducialTask::find`]; with several scans the message names the one, and the one that
    /// contradicts the others is refused (`scans_disagree`). `not_finite` for what lies too far out.
    pub fn answer(&self) -> Result<ScanAnswer, ScanError> {
        self.in_reach()?;
        let answer = self.found()?;
        let located = &answer.located;
        let figures = located
            .motion
            .rotation
            .iter()
            .chain(&located.motion.translation_mm);
        if figures
            .chain([&located.rms_mm, &located.sigma_mm])
            .any(|x| !x.is_finite())
        {
            return Err(ScanError::refused(
                "not_finite",
                "some numbers of the scan are too large to reckon with: crop the scan to what the scanner saw",
            ));
        }
        Ok(answer)
    }

    fn found(&self) -> Result<ScanAnswer, ScanError> {
        if self.fiducials.is_empty() {
            return self.without_fiducials();
        }
        let mut found: Vec<ScannerFound> = Vec::new();
        for scan in self.scans {
            found.push(self.scanner(scan)?);
        }
        let scans: Vec<PlacedScan> = self
            .scans
            .iter()
            .zip(&found)
            .map(|(scan, found)| PlacedScan {
                name: scan.name.clone(),
                motion: found.located.motion,
                cov: found.located.certainty.cov,
                fiducials: found.fiducials.clone(),
            })
            .collect();
        let fiducials = over_all(&scans);
        let mut others = Vec::new();
        let mut of = Vec::new();
        let mut groups = Vec::new();
        let mut all = Vec::new();
        for (k, (scan, found)) in self.scans.iter().zip(&found).enumerate() {
            let back = scan.moved.inverse();
            let here = back.after(&found.located.motion);
            groups.push(turned(&found.located, scan, &back, self.fiducials));
            let mut one = EachScan {
                name: &scan.name,
                points: Vec::new(),
                on_fiducials: Vec::new(),
            };
            for (q, on_fiducial) in scan.points.iter().zip(&found.on_fiducials) {
                if *on_fiducial {
                    one.on_fiducials.push(here.point(q));
                } else {
                    one.points.push(here.point(q));
                }
            }
            of.resize(of.len() + one.points.len(), k);
            others.extend_from_slice(&one.points);
            all.push(one);
        }
        let located = match self.part {
            Some(part) => {
                let groups = Groups {
                    all: &groups,
                    of: &of,
                };
                let task = self.task(part, &others, groups);
                let mut located = each::find(&task, &all)?;
                if self.kernel.is_none() {
                    agree::agree(&task, &all, &located)?;
                }
                // What is wrong with a single scan's place several scans tell by each other.
                let is_alone = self.scans.len() == 1;
                let counts = |code| code == "wrong_radius" || is_alone && code == "one_fiducial";
                let reasons = found.iter().flat_map(|found| &found.located.reasons);
                let reasons = reasons.filter(|reason| counts(reason.code));
                located.reasons.extend(reasons.cloned());
                located
            }
            None => found.swap_remove(0).located,
        };
        let deviations = match self.part {
            Some(_) => deviations(&located, |i| others[i]),
            None => deviations(&located, |i| located.motion.point(&self.scans[0].points[i])),
        };
        Ok(ScanAnswer {
            located,
            fiducials,
            scans,
            deviations,
        })
    }

    fn without_fiducials(&self) -> Result<ScanAnswer, ScanError> {
        let ([scan], Some(part)) = (self.scans, self.part) else {
            return Err(ScanError::unreadable(
                "usage",
                "say what is sought: --part, or --fiducials; several scans need --fiducials",
            ));
        };
        let located = self.task(part, &scan.points, Groups::default()).find()?;
        Ok(ScanAnswer {
            fiducials: Vec::new(),
            scans: Vec::new(),
            deviations: deviations(&located, |i| scan.points[i]),
            located,
        })
    }

    fn task<'b>(
        &self,
        model: &'b Mesh,
        points: &'b [Vec3],
        groups: Groups<'b>,
    ) -> LocaliseTask<'b> {
        LocaliseTask {
            model,
            points,
            start: self.start,
            kernel: self.kernel,
            accept_symmetry: self.accept_symmetry,
            limit_mm: self.limit_mm,
            scale_limit_ppm: self.scale_limit_ppm,
            seed: self.seed,
            threads: self.threads,
            groups,
        }
    }

    fn scanner(&self, scan: &TakenScan) -> Result<ScannerFound, ScanError> {
        let fiducials: Vec<Fiducial> = self
            .fiducials
            .iter()
            .map(|f| Fiducial {
                carried: f.carried || scan.carried,
                ..f.clone()
            })
            .map(|f| f.moved(&scan.moved))
            .collect();
        let alone = self.part.is_none();
        let task = FiducialTask {
            fiducials: &fiducials,
            points: &scan.points,
            start: self.start.filter(|_| alone),
            kernel: self.kernel.filter(|_| alone),
            accept_symmetry: self.accept_symmetry,
            limit_mm: self.limit_mm.filter(|_| alone),
            scale_limit_ppm: self.scale_limit_ppm,
            seed: self.seed,
            threads: self.threads,
        };
        task.find().map_err(|error| match self.scans.len() {
            1 => error,
            _ => ScanError {
                message: format!("{}: {}", scan.name, error.message),
                ..error
            },
        })
    }
}

/// The points that count where they are, with their distances.
fn deviations(located: &Located, at: impl Fn(usize) -> Vec3) -> Vec<(Vec3, f64)> {
    let on = located.on.iter();
    on.map(|&(i, distance)| (at(i), distance)).collect()
}

/// How sure the points of a scan are as a whole, after they were carried back. A fiducial's place is as wrong in all scans;
/// one that the machine carries with the part errs along the part's axes.
fn turned(located: &Located, scan: &TakenScan, back: &Pose, fiducials: &[Fiducial]) -> Group {
    let turn = turning(&back.rotation);
    let causes = located.certainty.common.iter().zip(fiducials);
    let common = causes.map(|(cause, fiducial)| {
        let of_machine = turn * cause;
        if fiducial.carried || scan.carried {
            of_machine * turning(&scan.moved.rotation)
        } else {
            of_machine
        }
    });
    Group {
        at: back.point(&located.motion.translation_mm),
        cov: turn * located.certainty.cov * turn.transpose(),
        common: common.collect(),
    }
}

/// Each fiducial over all scans: its points and residuals, and its pose in the first scan that shows it.
fn over_all(scans: &[PlacedScan]) -> Vec<FiducialSeen> {
    let Some(first) = scans.first() else {
        return Vec::new();
    };
    (0..first.fiducials.len())
        .map(|k| {
            let of = || scans.iter().map(|s| &s.fiducials[k]);
            let n: usize = of().map(|f| f.n).sum();
            let squares: f64 = of().map(|f| f.rms_mm.powi(2) * f.n as f64).sum();
            FiducialSeen {
                name: first.fiducials[k].name.clone(),
                motion: of().find_map(|f| f.motion),
                n,
                rms_mm: (squares / n.max(1) as f64).sqrt(),
                share: of().map(|f| f.share).sum::<f64>() / scans.len() as f64,
            }
        })
        .collect()
}
