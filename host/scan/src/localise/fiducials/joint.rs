//! One fit of all fiducials that are seen, and what it is worth.

use nalgebra::Matrix6;

use super::super::fit::{self, INLIER};
use super::super::search::scene;
use super::super::uncertainty::{Group, Groups, certainty, turning};
use super::super::verdict::symmetry;
use super::super::{Chosen, Located, degenerate, verdict_reasons};
use super::adjust::Seen;
use super::balls::radius::{self, other_radius, radius_seen};
use super::own::{self, Own};
use super::refuse::disagree;
use super::{
    Fiducial, FiducialSeen, FiducialShape, FiducialTask, LEAST_POINTS, ScannerFound, SymmetryAxis,
};
use crate::ScanError;
use crate::rigid::{Pose, Vec3};
use crate::solve::{Kernel, Measured, eigen, measure};
use crate::surface::{BallShape, CompositeSurface, Cone, Mesh};

/// All fiducials in one surface, about a place among them: machine coordinates can be large.
struct Bodies {
    surface: CompositeSurface,
    /// The fiducial of each face.
    of_face: Vec<usize>,
    /// The rims of each, and how large its features are.
    rims: Vec<(Vec<[Vec3; 2]>, f64)>,
    origin: Vec3,
}

impl Bodies {
    fn new(fiducials: &[Fiducial]) -> Result<Self, ScanError> {
        let n = fiducials.len() as f64;
        let origin = fiducials
            .iter()
            .map(|f| f.pose.translation_mm)
            .sum::<Vec3>()
            / n;
        let mut surface = CompositeSurface::default();
        let mut corners: Vec<[Vec3; 3]> = Vec::new();
        let mut rims = Vec::new();
        let (mut of_mesh, mut of_ball, mut of_cone) = (Vec::new(), Vec::new(), Vec::new());
        for (k, fiducial) in fiducials.iter().enumerate() {
            let pose = Pose {
                translation_mm: fiducial.pose.translation_mm - origin,
                ..fiducial.pose
            };
            let own = match &fiducial.shape {
                FiducialShape::Mesh(mesh) => own::rims(mesh),
                _ => Vec::new(),
            };
            rims.push((
                own.iter().map(|r| r.map(|p| pose.point(&p))).collect(),
                fiducial.shape.size_mm(),
            ));
            match &fiducial.shape {
                FiducialShape::Mesh(mesh) => {
                    for t in mesh.triangles() {
                        corners.push(t.corners.map(|c| pose.point(&c)));
                        of_mesh.push(k);
                    }
                }
                FiducialShape::Ball { radius_mm } => {
                    of_ball.push(k);
                    surface.balls.push(BallShape {
                        centre_mm: pose.translation_mm,
                        radius_mm: *radius_mm,
                    });
                }
                FiducialShape::Cone {
                    half_angle_rad,
                    height_mm,
                } => {
                    of_cone.push(k);
                    surface.cones.push(Cone {
                        pose,
                        half_angle_rad: *half_angle_rad,
                        height_mm: *height_mm,
                    });
                }
            }
        }
        if !corners.is_empty() {
            surface.mesh = Some(Mesh::new(&corners)?);
        }
        Ok(Self {
            surface,
            of_face: [of_mesh, of_ball, of_cone].concat(),
            rims,
            origin,
        })
    }

    /// The fiducial that a point is nearest to.
    fn of(&self, m: &Measured) -> usize {
        self.of_face.get(m.face).copied().unwrap_or(0)
    }

    /// Which fiducials these points show: enough of them, and around it.
    fn standing(
        &self,
        task: &FiducialTask<'_>,
        these: &[usize],
        measured: &[Measured],
    ) -> Vec<bool> {
        let mut own: Vec<Own> = task
            .fiducials
            .iter()
            .map(|f| Own {
                motion: f.pose,
                sigma_mm: 0.0,
                on: Vec::new(),
                beside: 0,
            })
            .collect();
        for &i in these {
            own[self.of(&measured[i])]
                .on
                .push((task.points[i], measured[i]));
        }
        own.iter()
            .zip(task.fiducials)
            .map(|(own, f)| own.on.len() >= LEAST_POINTS && own.holds(&f.shape))
            .collect()
    }

    /// Refuses a body that stands alone where the file has others beside it, and nothing is seen of these at their places:
    /// three faces that meet are found on tables, boxes and other fiducials as well. Its number, if something is seen.
    fn one_of_several(
        &self,
        task: &FiducialTask<'_>,
        standing: &[bool],
        measured: &[Measured],
        motion: &Pose,
        sigma: f64,
    ) -> Result<Option<usize>, ScanError> {
        let mut stand = (0..standing.len()).filter(|&k| standing[k]);
        let (Some(one), None) = (stand.next(), stand.next()) else {
            return Ok(None);
        };
        let is_body = matches!(task.fiducials[one].shape, FiducialShape::Mesh(_));
        if !is_body || task.fiducials.len() < 2 {
            return Ok(None);
        }
        // On each other one's surface, and a little off it: a face that crosses there has as many of these.
        let mut seen = vec![(0, 0); task.fiducials.len()];
        for (q, m) in task.points.iter().zip(measured) {
            let off = m.distance_mm.abs() / sigma;
            if off >= 3.0 * INLIER || !self.is_within(q, m, motion, sigma) {
                continue;
            }
            let (on, beside) = &mut seen[self.of(m)];
            *(if off < INLIER { on } else { beside }) += 1;
        }
        let shows = |k: usize| seen[k].0 >= LEAST_POINTS && seen[k].0 > BESIDE * seen[k].1;
        if (0..seen.len()).any(|k| k != one && shows(k)) {
            return Ok(Some(one));
        }
        let what = format!(
            "of the {} fiducials in the file only {} was found, and nothing is seen of the others where it puts them: faces that \
             meet as its own do are found on other bodies, too",
            task.fiducials.len(),
            task.fiducials[one].name
        );
        Err(symmetry::ambiguous(
            &[],
            &[motion.inverse()],
            &what,
            "scan so that a second fiducial is seen, or leave in the file what is in view",
        ))
    }

    /// Each fiducial that stands, where its own points put it: those about it, also what the common pose takes for astray.
    fn apart(
        &self,
        task: &FiducialTask<'_>,
        motion: &Pose,
        machine: &Pose,
        measured: &[Measured],
        standing: &[bool],
        noise_mm: f64,
    ) -> Seen {
        let mut own = Vec::new();
        for (k, fiducial) in task.fiducials.iter().enumerate() {
            let size = fiducial.shape.size_mm();
            let reach = (REACH * size).max(0.2);
            let near: Vec<Vec3> = (task.points.iter().zip(measured))
                .filter(|(_, m)| self.of(m) == k && m.distance_mm.abs() < 3.0 * reach)
                .filter(|(q, m)| self.is_within(q, m, motion, noise_mm))
                .map(|(q, _)| *q)
                .collect();
            if !standing[k] {
                continue;
            }
            let surface = fiducial.shape.surface();
            let start = machine.after(&fiducial.pose);
            let (floor, threads) = (size * 1e-7, task.threads);
            let Some(fit) = fit::settle(&surface, &near, &start, reach, floor, 30, threads) else {
                continue;
            };
            let there = measure(&surface, &near, &fit.motion, &[], threads);
            let on = near.into_iter().zip(there);
            let on: Vec<(Vec3, Measured)> = on
                .filter(|(_, m)| m.distance_mm.abs() < INLIER * fit.sigma_mm)
                .collect();
            if on.len() >= LEAST_POINTS {
                own.push((
                    k,
                    Own {
                        motion: fit.motion,
                        sigma_mm: fit.sigma_mm,
                        on,
                        beside: 0,
                    },
                ));
            }
        }
        Seen {
            machine: *machine,
            own,
        }
    }

    /// Whether the foot of a point lies within a surface and not beside its rim, for this noise.
    fn is_within(&self, q: &Vec3, m: &Measured, motion: &Pose, noise_mm: f64) -> bool {
        let triangles = self.surface.mesh.as_ref().map_or(&[][..], Mesh::triangles);
        let Some(t) = triangles.get(m.face) else {
            return true;
        };
        let (rims, size) = &self.rims[self.of(m)];
        let foot = motion.undo(&(q - m.direction * m.distance_mm));
        (motion.rotation * t.normal).dot(&m.direction).abs() > 0.7
            && own::is_apart(&foot, rims, own::margin(noise_mm, *size))
    }
}

/// From about the right pose to the fit of the points and its worth.
pub(super) fn finish(
    task: &FiducialTask<'_>,
    machine: &Pose,
    symmetries: Vec<SymmetryAxis>,
) -> Result<ScannerFound, ScanError> {
    let bodies = Bodies::new(task.fiducials)?;
    let from_origin = Pose {
        rotation: nalgebra::Matrix3::identity(),
        translation_mm: -bodies.origin,
    };
    let mut motion = machine.after(&from_origin.inverse());
    let (surface, points, threads) = (&bodies.surface, task.points, task.threads);
    let least = task
        .fiducials
        .iter()
        .map(|f| f.shape.size_mm())
        .fold(f64::MAX, f64::min);
    let measured;
    let mut groups: Vec<Group> = task.fiducials.iter().map(|f| f.group(machine)).collect();
    // Each one's doubt along the machine's axes: the same in every scan.
    let axes = turning(&machine.rotation);
    for (k, group) in groups.iter_mut().enumerate() {
        group.common = vec![Matrix6::zeros(); task.fiducials.len()];
        group.common[k] = axes * group.cov.map(f64::sqrt);
    }
    if let Some(kernel) = task.kernel {
        let settled = fit::task(surface, points, kernel, 300, threads).solve(&motion);
        motion = settled.motion;
        measured = settled.measured;
    } else {
        let reach = (0.05 * least).max(0.2);
        let settled = fit::settle(surface, points, &motion, reach, least * 1e-7, 40, threads);
        let Some(settled) = settled else {
            return Err(not_here());
        };
        let sigma = settled.sigma_mm;
        let there = measure(surface, points, &settled.motion, &[], threads);
        let near = |limit: f64| -> Vec<usize> {
            let motion = &settled.motion;
            let is_near = |i: usize| {
                there[i].distance_mm.abs() < limit
                    && bodies.is_within(&points[i], &there[i], motion, sigma)
            };
            (0..points.len()).filter(|&i| is_near(i)).collect()
        };
        let standing = bodies.standing(task, &near(INLIER * sigma), &there);
        let mut kept = near(10.0 * sigma);
        kept.retain(|&i| standing[bodies.of(&there[i])]);
        let near: Vec<Vec3> = kept.iter().map(|&i| points[i]).collect();
        let of: Vec<usize> = kept.iter().map(|&i| bodies.of(&there[i])).collect();
        let groups = Groups {
            all: &groups,
            of: &of,
        };
        motion = fit::weighed(surface, &near, groups, &settled.motion, sigma, threads);
        measured = measure(surface, points, &motion, &[], threads);
    }
    let sigma = match task.kernel {
        Some(Kernel::None) => {
            let sum: f64 = measured.iter().map(|m| m.distance_mm.powi(2)).sum();
            (sum / (measured.len() as f64 - 6.0).max(1.0)).sqrt()
        }
        Some(Kernel::Huber(c) | Kernel::Tukey(c)) => fit::noise(&measured, 10.0 * c),
        None => fit::noise(&measured, (0.05 * least).max(0.2)),
    };
    let all = task.kernel == Some(Kernel::None);
    let mut on: Vec<usize> = (0..points.len())
        .filter(|&i| {
            all || (measured[i].distance_mm.abs() < INLIER * sigma
                && bodies.is_within(&points[i], &measured[i], &motion, sigma))
        })
        .collect();
    let standing = bodies.standing(task, &on, &measured);
    if task.kernel.is_none() && !standing.contains(&true) {
        return Err(not_here());
    }
    let one = match task.kernel {
        None => bodies.one_of_several(task, &standing, &measured, &motion, sigma)?,
        Some(_) => None,
    };
    if !all {
        on.retain(|&i| standing[bodies.of(&measured[i])]);
    }
    let of: Vec<usize> = measured.iter().map(|m| bodies.of(m)).collect();
    let groups_of = Groups {
        all: &groups,
        of: &of,
    };
    let mut sure = certainty(points, &measured, &on, &motion, sigma, groups_of);
    if !sure.free.is_empty() {
        return Err(degenerate(&sure.free, &sure.about_mm, "fiducials"));
    }
    // Of the machine's own origin, and from the scanner's point of view.
    let machine = motion.after(&from_origin);
    let apart = bodies.apart(task, &motion, &machine, &measured, &standing, sigma);
    if apart.own.len() > 1 {
        let agreement = apart.agreement(task);
        if task.kernel.is_none() && !agreement.strays.is_empty() {
            return Err(disagree(task, &agreement.strays));
        }
        if let Some((scale, u_scale)) = agreement.scale {
            (sure.scale, sure.u_scale) = (scale, u_scale);
        }
        // What neighbours share is in the covariance already.
        sure = sure.differing(agreement.ratio);
    }
    let mut of_ball: Vec<Vec<Vec3>> = vec![Vec::new(); task.fiducials.len()];
    for &i in &on {
        of_ball[of[i]].push(points[i]);
    }
    let radii = task.fiducials.iter().enumerate().map(|(k, f)| {
        let FiducialShape::Ball { radius_mm } = f.shape else {
            return None;
        };
        let centre = machine.point(&f.pose.translation_mm);
        if standing[k] {
            radius_seen(&of_ball[k], &centre, radius_mm)
        } else {
            other_radius(points, &centre, radius_mm, sigma)
        }
    });
    let radii: Vec<_> = radii.collect();
    let on_bodies: Vec<_> = on
        .iter()
        .map(|&i| (points[i], measured[i], of[i]))
        .collect();
    sure.cov += radius::doubt(task.fiducials, &radii, &on_bodies, &motion);
    sure = sure.before(&motion, &from_origin).inverted(&machine);
    let motion_of_scanner = machine.inverse();
    let squares: f64 = on.iter().map(|&i| measured[i].distance_mm.powi(2)).sum();
    let mut located = Located {
        motion: motion_of_scanner,
        n_used: on.len(),
        overlap: shown(task.fiducials, &on, &of, points, &machine),
        rms_mm: (squares / on.len().max(1) as f64).sqrt(),
        sigma_mm: sigma,
        certainty: sure,
        symmetries,
        on: on.iter().map(|&i| (i, measured[i].distance_mm)).collect(),
        chosen: Chosen::default(),
        reasons: Vec::new(),
    };
    let (low, high) = crate::surface::bounds(points.iter());
    located.reasons = verdict_reasons(
        &located,
        &crate::surface::box_corners(&low, &high),
        task.limit_mm,
        task.scale_limit_ppm,
        "scan",
    );
    located.reasons.extend(one.map(|one| {
        ScanError::refused(
            "one_fiducial",
            format_args!(
                "only {} holds the pose, and of the others one side at most is seen: a wall's other face would look the same; scan so \
                 that a second fiducial shows three sides",
                task.fiducials[one].name
            ),
        )
    }));
    let groups = Groups {
        all: &groups,
        of: &of,
    };
    located
        .reasons
        .extend(radius::wrong(task.fiducials, &radii));
    let fiducials = seen(task, &machine, &on, &measured, groups, &standing, sigma);
    let mut on_fiducials = vec![false; points.len()];
    for i in on {
        on_fiducials[i] = true;
    }
    Ok(ScannerFound {
        located,
        fiducials,
        on_fiducials,
    })
}

fn not_here() -> ScanError {
    ScanError::refused(
        "no_fiducial",
        "no fiducial is where it should be near the start: is the start right? Without --start it is searched",
    )
}

/// How far from its place a fiducial's own points are looked for, over its size.
const REACH: f64 = 0.06;

/// A surface is seen where so many times as many points lie on it as a little off it.
const BESIDE: usize = 3;

/// What of the fiducials' surface the points show.
fn shown(
    fiducials: &[Fiducial],
    on: &[usize],
    of: &[usize],
    points: &[Vec3],
    machine: &Pose,
) -> f64 {
    let (mut area, mut seen) = (0.0, 0.0);
    for (k, fiducial) in fiducials.iter().enumerate() {
        let own = machine.after(&fiducial.pose);
        let shown: Vec<Vec3> = on
            .iter()
            .filter(|&&i| of[i] == k)
            .map(|&i| own.undo(&points[i]))
            .collect();
        if let Some(mesh) = fiducial.shape.mesh() {
            area += mesh.area_mm2();
            seen += mesh.area_mm2() * scene::coverage(&mesh, &shown);
        }
    }
    seen / area.max(1e-9)
}

/// Each fiducial in the scan.
fn seen(
    task: &FiducialTask<'_>,
    machine: &Pose,
    on: &[usize],
    measured: &[Measured],
    groups: Groups<'_>,
    standing: &[bool],
    sigma: f64,
) -> Vec<FiducialSeen> {
    let (points, of) = (task.points, groups.of);
    let about = fit::middle(&on.iter().map(|&i| points[i]).collect::<Vec<_>>());
    let arm = on
        .iter()
        .map(|&i| (points[i] - about).norm())
        .fold(1e-3, f64::max);
    let mut h = vec![Matrix6::zeros(); task.fiducials.len()];
    for &i in on {
        let r = fit::row(&points[i], &measured[i], &about, arm);
        h[of[i]] += r * r.transpose();
    }
    let damping = groups.damping(&h, &about, arm, sigma * sigma);
    let weights: Vec<Matrix6<f64>> = h.iter().zip(&damping).map(|(h, d)| d * h).collect();
    let whole: Matrix6<f64> = weights.iter().sum();
    let (values, vectors) = eigen(&((whole + whole.transpose()) / 2.0));
    let share = |w: &Matrix6<f64>| -> f64 {
        (0..6)
            .map(|k| {
                let v = vectors.column(k);
                v.dot(&(w * v)) / values[k].max(1e-300) / 6.0
            })
            .sum()
    };
    task.fiducials
        .iter()
        .enumerate()
        .map(|(k, fiducial)| {
            let own: Vec<usize> = on.iter().copied().filter(|&i| of[i] == k).collect();
            let squares: f64 = own.iter().map(|&i| measured[i].distance_mm.powi(2)).sum();
            let expected = machine.after(&fiducial.pose);
            let mine: Vec<Vec3> = own.iter().map(|&i| points[i]).collect();
            let found = standing[k];
            let surface = fiducial.shape.surface();
            FiducialSeen {
                name: fiducial.name.clone(),
                motion: found.then(|| {
                    fit::task(&surface, &mine, Kernel::None, 30, task.threads)
                        .solve(&expected)
                        .motion
                }),
                n: own.len(),
                rms_mm: if found {
                    (squares / own.len() as f64).sqrt()
                } else {
                    0.0
                },
                share: if found { share(&weights[k]) } else { 0.0 },
            }
        })
        .collect()
}
