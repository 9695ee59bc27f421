//! What lies farther out than anything does: its squares would be lost in the sums, and poses be no numbers.

use super::ScanQuestion;
use crate::ScanError;
use crate::localise::fiducials::FiducialShape;
use crate::rigid::{FARTHEST_MM, Vec3, is_in_reach};

impl ScanQuestion<'_> {
    /// Refuses what lies too far out. Of a scan only where all points count: else they are left out.
    pub(super) fn in_reach(&self) -> Result<(), ScanError> {
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
}

#[cfg(test)]
mod tests {
    use super::super::TakenScan;
    use super::*;
    use crate::localise::fiducials::Fiducial;
    use crate::localise::tests::{Random, bracket, scan};
    use crate::parallel::Threads;
    use crate::rigid::Pose;
    use crate::solve::Kernel;
    use crate::surface::Mesh;

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
