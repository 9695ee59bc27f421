//! A whole question: one scan or several, fiducials, a part.

use nalgebra::Matrix6;

use super::fiducials::{Fiducial, FiducialSeen, FiducialShape, FiducialTask, ScannerFound};
use super::fit::{self, Fit};
use super::search::pairs::spread;
use super::uncertainty::{Group, Groups, turning};
use super::verdict::each::{self, EachScan};
use super::{LocaliseTask, Located, misfits};
use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::{FARTHEST_MM, Pose, Vec3, is_in_reach};
use crate::solve::{Kernel, measure};
use crate::surface::{CompositeSurface, Mesh};

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

    /// Refuses what lies too far out. Of a scan only where all points count: else they are left out.
    fn in_reach(&self) -> Result<(), ScanError> {
        let refused = |what: String, hint: &str| {
            Err(ScanError::refused(
                "not_finite",
                format_args!("{what} more than {FARTHEST_MM:e} mm away, which nothing is: {hint}"),
            ))
        };
        if self
            .start
            .is_some_and(|start| !is_in_reach(&start.translation_mm))
        {
            return refused("the start lies".into(), "is its translation_mm in mm?");
        }
        if let Some(part) = self.part
            && !part.corners().iter().all(is_in_reach)
        {
            return refused("the model reaches".into(), "export it again, in mm");
        }
        for fiducial in self.fiducials {
            let size_mm = match &fiducial.shape {
                FiducialShape::Mesh(mesh) => mesh.diagonal_mm(),
                FiducialShape::Ball { radius_mm } => *radius_mm,
                FiducialShape::Cone { height_mm, .. } => *height_mm,
            };
            if !is_in_reach(&fiducial.pose.translation_mm) || !is_in_reach(&Vec3::repeat(size_mm)) {
                let what = format!("{} reaches", fiducial.name);
                return refused(what, "its place and its size are in mm");
            }
        }
        for scan in self.scans {
            if !is_in_reach(&scan.moved.translation_mm) {
                let what = format!("{}: `moved` carries the part", scan.name);
                return refused(what, "its translation_mm is in mm");
            }
            let far = scan.points.iter().find(|p| !is_in_reach(p));
            if let Some(p) = far.filter(|_| self.kernel.is_some()) {
                let what = format!(
                    "{}: the point {:e}, {:e}, {:e} lies",
                    scan.name, p.x, p.y, p.z
                );
                return refused(
                    what,
                    "--kernel counts all points, so take it out of the scan, or leave --kernel out",
                );
            }
        }
        Ok(())
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
                    agree(&task, &all, &located)?;
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

/// Points of a scan that its own pose is settled with.
const SETTLED: usize = 20_000;
/// Scans do not lie on one part if together they are so many times as rough as the roughest of them alone,
const TOGETHER: f64 = 2.0;
/// and one by itself leaves the common pose by so many times what its doubts and its noise allow, in squares and for each
/// motion.
const DOUBTS: f64 = 25.0;

/// Refuses scans each of which fits the part to its noise, and which together do not: where one of them is a little off, all
/// of its points are near enough to the common pose to be taken for noise.
fn agree(
    task: &LocaliseTask<'_>,
    scans: &[EachScan<'_>],
    located: &Located,
) -> Result<(), ScanError> {
    if scans.len() < 2 {
        return Ok(());
    }
    let surface = CompositeSurface::from(task.model.clone());
    let (common, reach, threads) = (&located.motion, 10.0 * located.sigma_mm, task.threads);
    let inside = fit::boxed(&surface, common, reach);
    let near = |scan: &EachScan<'_>| -> Vec<Vec3> {
        let all: Vec<&Vec3> = scan.points.iter().filter(|q| inside(q)).collect();
        let some = spread(all.len(), SETTLED).into_iter();
        some.map(|i| *all[i]).collect()
    };
    let points: Vec<Vec<Vec3>> = scans.iter().map(near).collect();
    let floor = task.model.diagonal_mm() * 1e-7;
    let settle = |points: &[Vec3]| fit::settle(&surface, points, common, reach, floor, 8, threads);
    let own: Vec<Option<Fit>> = points.iter().map(|points| settle(points)).collect();
    let noise = |of: &Option<Fit>| of.as_ref().map_or(f64::INFINITY, |fit| fit.sigma_mm);
    let rough = own.iter().map(noise).filter(|mm| mm.is_finite());
    if located.sigma_mm < TOGETHER * rough.fold(0.0, f64::max) {
        return Ok(());
    }
    let leaves = |k: usize| {
        let Some(fit) = &own[k] else { return false };
        let there = measure(&surface, &points[k], &fit.motion, &[], threads);
        let is_on = |&i: &usize| there[i].distance_mm.abs() < fit::INLIER * fit.sigma_mm;
        let on: Vec<usize> = (0..there.len()).filter(is_on).collect();
        let here = measure(&surface, &points[k], common, &[], threads);
        let groups = Groups {
            all: &task.groups.all[k..=k],
            of: &[],
        };
        let (misfit, held) = misfits(&points[k], &here, &on, fit.sigma_mm, groups)[0];
        misfit > DOUBTS * held as f64
    };
    if !(0..scans.len()).any(leaves) {
        return Ok(());
    }
    // Without the one that is off the others are one part; of two nobody knows which it is.
    let others = |k: usize| {
        let others = (0..points.len()).filter(|&i| i != k);
        let others: Vec<Vec3> = others.flat_map(|i| points[i].iter().copied()).collect();
        settle(&others)
    };
    let without: Vec<Option<Fit>> = (0..scans.len()).map(others).collect();
    let one = (0..scans.len()).min_by(|&a, &b| noise(&without[a]).total_cmp(&noise(&without[b])));
    let (Some(one), corners) = (one, task.model.corners()) else {
        return Ok(());
    };
    let (Some(fit), Some(others)) = (&own[one], &without[one]) else {
        return Ok(());
    };
    let off_mm = fit.motion.apart_mm(&others.motion, &corners);
    Err(ScanError::refused(
        "scans_disagree",
        format_args!(
            "each scan fits the part to {:.4} mm and all together to {:.4} mm: {} puts it {off_mm:.3} mm from where the other \
             scans put it. Does `moved` of each say how the machine had moved the part, to the angle?",
            fit.sigma_mm, located.sigma_mm, scans[one].name
        ),
    )
    .with("scan", scans[one].name)
    .with("off_mm", off_mm))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::tests::{Random, bracket, scan, task};
    use crate::rigid::rotation;

    fn turned(degrees: f64, about: Vec3) -> Pose {
        let rotation = rotation(&(about * degrees.to_radians()));
        Pose {
            rotation,
            translation_mm: Vec3::zeros(),
        }
    }

    /// Three views of a bracket 150 mm from the axis; one of them turned by so much more than its `moved` says. How sure each
    /// scan's place is, in mm.
    fn three(degrees: f64, u_mm: f64) -> Result<(), ScanError> {
        let part = bracket();
        let mut random = Random(73);
        let at = Pose {
            translation_mm: Vec3::new(0.0, 150.0, 0.0),
            ..Pose::identity()
        };
        let views = [[0.3, -0.2, 0.9], [-0.5, 0.8, 0.3], [0.6, 0.5, -0.6]];
        let names = ["first.ply", "second.ply", "third.ply"];
        let mut scans = Vec::new();
        for (k, (eye, name)) in views.iter().zip(names).enumerate() {
            let eye = Vec3::from(*eye).normalize();
            let off = turned(if k == 2 { degrees } else { 0.0 }, Vec3::x()).after(&at);
            let points = scan(&part, 4000, 0.01, &off, &mut random, |n| n.dot(&eye) > 0.1);
            scans.push(EachScan {
                name,
                points,
                on_fiducials: Vec::new(),
            });
        }
        let points: Vec<Vec3> = scans.iter().flat_map(|s| s.points.clone()).collect();
        let of: Vec<usize> = (0..3)
            .flat_map(|k| vec![k; scans[k].points.len()])
            .collect();
        let sure = Group {
            at: Vec3::new(0.0, 150.0, 0.0),
            cov: Matrix6::identity() * u_mm.powi(2),
            common: Vec::new(),
        };
        let groups = [sure.clone(), sure.clone(), sure];
        let task = LocaliseTask {
            groups: Groups {
                all: &groups,
                of: &of,
            },
            ..task(&part, &points)
        };
        // Of all points alike: none of the scan that is off counts less.
        let all = LocaliseTask {
            start: Some(at),
            kernel: Some(Kernel::None),
            ..task.clone()
        };
        agree(&task, &scans, &all.find()?)
    }

    /// A turn that the machine made 0.2 degrees wider than the file says is 0.5 mm at the part: all points of that scan are
    /// near the part then, and look like noise.
    #[test]
    fn a_scan_that_was_turned_a_little_wrong_is_named() {
        assert_eq!(three(0.0, 1e-3).map_err(|e| e.message), Ok(()));
        for degrees in [0.1, 0.2, 0.5] {
            let error = three(degrees, 1e-3).unwrap_err();
            assert_eq!(error.code, "scans_disagree", "{degrees}");
            assert!(
                error.message.contains("third.ply puts"),
                "{degrees}: {error}"
            );
        }
        // Where the scans' places are that unsure, it is no contradiction.
        assert_eq!(three(0.2, 1.0).map_err(|e| e.message), Ok(()));
    }

    /// What lies where nothing can be is refused by name and with what to do, and no answer is made of it.
    #[test]
    fn what_is_too_far_out_is_refused() {
        let part = bracket();
        let points = scan(&part, 400, 0.01, &Pose::identity(), &mut Random(3), |_| {
            true
        });
        let far = |x: f64| Pose {
            translation_mm: Vec3::new(x, 0.0, 0.0),
            ..Pose::identity()
        };
        let ball = |x: f64, radius_mm: f64| Fiducial {
            name: "B1".into(),
            shape: FiducialShape::Ball { radius_mm },
            pose: far(x),
            u_position_mm: 0.0,
            u_rotation_rad: 0.0,
            carried: false,
        };
        let huge = Mesh::new(&[[Vec3::zeros(), Vec3::x() * 1e38, Vec3::y() * 1e38]]).unwrap();
        for x in [1e10, 1e160, 1e200, 1e300] {
            let with = |point: Option<f64>, moved: Pose| TakenScan {
                name: "a.ply".into(),
                points: points
                    .iter()
                    .copied()
                    .chain(point.map(|x| Vec3::x() * x))
                    .collect(),
                moved,
                carried: false,
            };
            let whole = with(None, Pose::identity());
            let stray = with(Some(x), Pose::identity());
            let moved = with(None, far(x));
            let question = ScanQuestion {
                scans: std::slice::from_ref(&whole),
                fiducials: &[],
                part: Some(&part),
                start: Some(Pose::identity()),
                kernel: Some(Kernel::None),
                accept_symmetry: false,
                limit_mm: None,
                scale_limit_ppm: 1000.0,
                seed: 0,
                threads: Threads::new(1),
            };
            assert_eq!(question.answer().map(|a| a.located.reasons), Ok(Vec::new()));
            let (elsewhere, large) = ([ball(x, 10.0)], [ball(0.0, x)]);
            for (wrong, told) in [
                (
                    ScanQuestion {
                        scans: std::slice::from_ref(&stray),
                        ..question.clone()
                    },
                    "leave --kernel out",
                ),
                (
                    ScanQuestion {
                        scans: std::slice::from_ref(&moved),
                        ..question.clone()
                    },
                    "`moved`",
                ),
                (
                    ScanQuestion {
                        start: Some(far(x)),
                        ..question.clone()
                    },
                    "the start",
                ),
                (
                    ScanQuestion {
                        part: Some(&huge),
                        ..question.clone()
                    },
                    "export it again",
                ),
                (
                    ScanQuestion {
                        fiducials: &elsewhere,
                        ..question.clone()
                    },
                    "B1",
                ),
                (
                    ScanQuestion {
                        fiducials: &large,
                        ..question.clone()
                    },
                    "B1",
                ),
            ] {
                let error = wrong.answer().map(|a| a.located.motion).unwrap_err();
                assert_eq!(error.code, "not_finite");
                assert!(error.message.contains(told), "{error}");
            }
            // Nor is a pose made of it where a point alone is so far, and is left out.
            let search = ScanQuestion {
                scans: std::slice::from_ref(&stray),
                kernel: None,
                ..question.clone()
            };
            if let Ok(answer) = search.answer() {
                assert!(
                    answer
                        .located
                        .motion
                        .apart_mm(&Pose::identity(), &part.corners())
                        < 0.05
                );
            }
        }
    }
}
