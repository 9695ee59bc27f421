//! What each of several scans says by itself of the pose that all of them gave.
//!
//! Where the machine did not move the part as a scan's `moved` has it, that scan puts the part elsewhere. The others then
//! outvote it: its points are off the part, so neither the fit nor its uncertainty sees them.

use super::account::{Account, TOO_MUCH};
use super::rivals::{advantage, explained, off, on};
use super::{Judge, Worth, count};
use crate::ScanError;
use crate::localise::fit::{self, Fit};
use crate::localise::search::oriented::{from_seed, thin};
use crate::localise::search::pairs::spread;
use crate::localise::search::scene::{Scene, cell_mm};
use crate::localise::uncertainty::Groups;
use crate::localise::{LocaliseTask, Located, misfits};
use crate::rigid::{Pose, Vec3};
use crate::solve::measure_within;
use crate::surface::CompositeSurface;

/// Points that a scan's own pose is settled with, and how far it is sought from the common one, over the diagonal.
const SETTLED: usize = 20_000;
const BESIDE: f64 = 0.05;
/// A scan that has a smaller share of its points on the part than this, over the largest share, is searched by itself.
const LIKE: f64 = 0.5;
/// A scan disagrees if its own pose explains this share more of its points, or leaves it by so many times what its doubts
/// and the noise allow, in squares and for each motion.
const MORE: f64 = 0.03;
const DOUBTS: f64 = 25.0;
/// Two poses leave as much unexplained if it is so nearly the same, in shares: some hundred places of the part are seen.
const AS_WELL: f64 = 0.05;

/// A scan of several, in machine coordinates and carried back.
pub(in crate::localise) struct EachScan<'a> {
    pub name: &'a str,
    /// Its points that are on no fiducial.
    pub points: Vec<Vec3>,
    /// Those on fiducials: they hide what lies behind them.
    pub on_fiducials: Vec<Vec3>,
}

/// The part by all scans. Where they show no pose together, but the largest one alone does, it is asked whether the others
/// contradict that.
pub(in crate::localise) fn find(
    task: &LocaliseTask<'_>,
    scans: &[EachScan<'_>],
) -> Result<Located, ScanError> {
    let found = task.find();
    if task.kernel.is_some() {
        return found;
    }
    if found.is_err()
        && scans.len() > 1
        && let Some(largest) = scans.iter().max_by_key(|scan| scan.points.len())
        && let Ok(alone) = (LocaliseTask {
            points: &largest.points,
            groups: Groups::default(),
            ..task.clone()
        })
        .find()
        && let Err(error) = agree(task, scans, &alone)
        && error.code == "scans_disagree"
    {
        return Err(error);
    }
    let located = found?;
    agree(task, scans, &located)?;
    Ok(located)
}

/// Refuses a pose that one of the scans contradicts, or that leaves too much of them unexplained.
fn agree(
    task: &LocaliseTask<'_>,
    scans: &[EachScan<'_>],
    located: &Located,
) -> Result<(), ScanError> {
    let surface = CompositeSurface::from(task.model.clone());
    let judge = Judge::new(task, &surface);
    let scenes: Vec<Scene> = scans
        .iter()
        .map(|scan| {
            let points = from_seed(&scan.points, task.seed);
            Scene::new(task.model, &points, task.threads)
        })
        .collect();
    let share = |scene: &Scene| {
        let (sigma, threads) = (located.sigma_mm.max(scene.noise_mm), task.threads);
        let points = &scene.fine;
        let on = explained(judge.part(), points, &located.motion, sigma, threads);
        count(&on) as f64 / on.len().max(1) as f64
    };
    let shares: Vec<f64> = scenes.iter().map(share).collect();
    let most = shares.iter().copied().fold(0.0, f64::max);
    if scans.len() > 1 {
        for (k, scan) in scans.iter().enumerate() {
            let far = (shares[k] < LIKE * most).then_some(&scan.on_fiducials[..]);
            if let Some(off_mm) = judge.off(&scenes[k], k, located, far) {
                return Err(disagree(scan.name, off_mm));
            }
        }
    }
    judge.accounted(&scenes, scans, located)
}

impl Judge<'_> {
    /// How far from the common pose the scan `k` puts the part, if it contradicts it. `far`: it is sought everywhere, and
    /// these points stand in the scanner's way besides.
    ///
    /// Where a side goes on beyond its edges, its points count for no pose: a bar that slides along itself comes onto the
    /// chuck behind its end, and lies on a larger body with more points than the scan has of the bar. Nor does a pose
    /// contradict that would be no place of the part by this scan alone: it leaves too much unexplained. Where the scan shows
    /// the part at the common place as well, another body beside it contradicts only if this scan alone would put the part
    /// there, and in one way, and that leaves no more unexplained: a corner of a shelf is like a piece of many parts.
    fn off(&self, scene: &Scene, k: usize, located: &Located, far: Option<&[Vec3]>) -> Option<f64> {
        let threads = self.task.threads;
        let (common, sigma) = (&located.motion, located.sigma_mm);
        let of = |motion: &Pose| {
            let passed = self.passed(scene, motion);
            let standing = off(self.part(), &scene.fine, motion, sigma, threads);
            let is_own = |face: u32| !passed.contains(&self.prepared.sides[face as usize]);
            let points = standing.off.iter().zip(standing.face);
            let own = points.map(|(off, face)| on(*off) && is_own(face));
            own.collect::<Vec<bool>>()
        };
        let here = of(common);
        let speaks = |fit: &Fit| {
            let there = of(&fit.motion);
            let (more, chance) = advantage(&there, &here);
            (more > chance + MORE * count(&there) as f64).then_some(there)
        };
        let apart = |fit: &Fit| fit.motion.apart_mm(common, &self.prepared.corners);
        let points: Vec<Vec3> = spread(scene.fine.len(), SETTLED)
            .into_iter()
            .map(|i| scene.fine[i])
            .collect();
        let reach = BESIDE * self.prepared.diagonal;
        let floor = self.prepared.diagonal * 1e-7;
        let beside = fit::settle(self.surface, &points, common, reach, floor, 8, threads);
        if let Some(fit) = beside
            && let Some(there) = speaks(&fit)
        {
            let on: Vec<usize> = (0..there.len()).filter(|&i| there[i]).collect();
            let within = 2.0 * reach;
            let measured = measure_within(self.surface, &scene.fine, common, &[], within, threads);
            let groups = Groups {
                all: &self.task.groups.all[k..=k],
                of: &[],
            };
            let (misfit, held) = misfits(&scene.fine, &measured, &on, sigma, groups)[0];
            if misfit > DOUBTS * held as f64 {
                return Some(apart(&fit));
            }
        }
        let before = thin(far?, cell_mm(self.task.model), threads);
        let fits = self.fits(scene, None);
        let stands = |fit: &Fit| {
            matches!(self.worth(scene, fit), Worth::Good)
                && (self.is_surely(scene, fit)
                    || self.account(scene, fit, &before).0.judged(TOO_MUCH).is_ok())
        };
        let is_elsewhere = |fit: &Fit| apart(fit) > reach;
        let better = |fit: &&Fit| is_elsewhere(fit) && speaks(fit).is_some() && stands(fit);
        let elsewhere = fits.iter().find(better)?;
        let common = Fit {
            motion: *common,
            sigma_mm: sigma,
            inliers: count(&here),
            worth: 0,
        };
        let moved = |fit: &Fit| {
            let there = of(&fit.motion);
            let both = here.iter().zip(&there).filter(|(a, b)| **a && **b);
            2 * both.count() > count(&here)
        };
        if stands(&common) && !moved(elsewhere) {
            // Another body: the scan shows the part at either place, or something there that is like a piece of it.
            let all: Vec<Fit> = fits.iter().cloned().chain([common.clone()]).collect();
            let alone = self.only_one(scene, &all);
            let one = alone.ok().filter(|one| one.symmetries.is_empty())?.fit;
            let left = |fit: &Fit| self.account(scene, fit, &before).0.unexplained();
            let contradicts = is_elsewhere(&one) && left(&one) < left(&common) + AS_WELL;
            return contradicts.then(|| apart(&one));
        }
        Some(apart(elsewhere))
    }

    /// Refuses if the scans together leave too much unexplained, each weighed by what it has on the part.
    fn accounted(
        &self,
        scenes: &[Scene],
        scans: &[EachScan<'_>],
        located: &Located,
    ) -> Result<(), ScanError> {
        let fit = Fit {
            motion: located.motion,
            sigma_mm: located.sigma_mm,
            inliers: located.n_used,
            worth: 0,
        };
        let cell = cell_mm(self.task.model);
        let accounts = scenes.iter().zip(scans).map(|(scene, scan)| {
            let before = thin(&scan.on_fiducials, cell, self.task.threads);
            self.account(scene, &fit, &before)
        });
        let all: Vec<(Account, usize)> = accounts.collect();
        if all.is_empty() || scenes.iter().all(|scene| self.is_surely(scene, &fit)) {
            return Ok(());
        }
        Account::of_all(&all).judged(TOO_MUCH)
    }
}

fn disagree(name: &str, off_mm: f64) -> ScanError {
    ScanError::refused(
        "scans_disagree",
        format_args!(
            "{name} puts the part {off_mm:.3} mm from where the other scans put it: does `moved` of each say how the machine \
             had moved the part?"
        ),
    )
    .with("scan", name)
    .with("off_mm", off_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::fiducials::{Fiducial, FiducialShape};
    use crate::localise::scans::{ScanAnswer, ScanQuestion, TakenScan};
    use crate::localise::tests::{Random, bracket, prism, scan, task};
    use crate::localise::uncertainty::Group;
    use crate::parallel::Threads;
    use crate::rigid::rotation;
    use crate::surface::Mesh;

    const BALLS: [[f64; 3]; 4] = [
        [-60.0, -40.0, 20.0],
        [150.0, -35.0, 30.0],
        [140.0, 120.0, 25.0],
        [-50.0, 110.0, 60.0],
    ];

    fn fiducials(u_position_mm: f64) -> Vec<Fiducial> {
        BALLS
            .iter()
            .enumerate()
            .map(|(k, at)| Fiducial {
                name: format!("B{k}"),
                shape: FiducialShape::Ball { radius_mm: 12.7 },
                pose: Pose {
                    translation_mm: Vec3::from(*at),
                    ..Pose::identity()
                },
                u_position_mm,
                u_rotation_rad: 0.0,
                carried: false,
            })
            .collect()
    }

    fn moved(degrees: f64, by: [f64; 3]) -> Pose {
        Pose {
            rotation: rotation(&(Vec3::z() * degrees.to_radians())),
            translation_mm: Vec3::from(by),
        }
    }

    /// A view of the balls, each displaced as `at` says, and of the part where the machine has moved it.
    fn taken(part: &Mesh, moved: &Pose, at: &[Vec3], random: &mut Random) -> TakenScan {
        let eye = (Vec3::new(0.3, -0.2, 0.9) + random.vector() * 0.2).normalize();
        let from_eye = |n: &Vec3| (moved.rotation * n).dot(&eye) > 0.1;
        let mut points = scan(part, 2500, 0.01, moved, random, from_eye);
        for centre in at {
            for _ in 0..500 {
                let n = random.vector().normalize();
                if n.dot(&eye) > 0.2 {
                    points.push(centre + n * 12.7 + random.vector() * 0.01);
                }
            }
        }
        let scanner = random.pose();
        TakenScan {
            name: "turned.ply".into(),
            points: points.iter().map(|q| scanner.point(q)).collect(),
            moved: *moved,
            carried: false,
        }
    }

    fn centres() -> Vec<Vec3> {
        BALLS.iter().map(|at| Vec3::from(*at)).collect()
    }

    fn answer(
        part: &Mesh,
        fiducials: &[Fiducial],
        scans: &[TakenScan],
    ) -> Result<ScanAnswer, ScanError> {
        ScanQuestion {
            scans,
            fiducials,
            part: Some(part),
            start: None,
            kernel: None,
            accept_symmetry: false,
            limit_mm: None,
            scale_limit_ppm: 1000.0,
            seed: 0,
            threads: Threads::new(2),
        }
        .answer()
    }

    /// A `moved` that is wrong by 0.2 mm, by 1 mm, not there at all, or the wrong way round, does not lose to the scan with
    /// more points: it is named. A right one is taken.
    #[test]
    fn a_scan_whose_motion_is_wrong_is_named() {
        let part = bracket();
        let mut random = Random(41);
        let turned = moved(90.0, [100.0, -20.0, 0.0]);
        let mut scans =
            [Pose::identity(), turned].map(|moved| taken(&part, &moved, &centres(), &mut random));
        scans[0].name = "straight.ply".into();
        let fiducials = fiducials(0.0);
        let right = answer(&part, &fiducials, &scans).unwrap().located;
        assert!(right.motion.apart_mm(&Pose::identity(), &part.corners()) < 0.02);
        let off = |x: f64| moved(90.0, [100.0 + x, -20.0, 0.0]);
        let wrong = [off(0.2), off(1.0), Pose::identity(), turned.inverse()];
        for (k, wrong) in wrong.into_iter().enumerate() {
            scans[1].moved = wrong;
            let error = answer(&part, &fiducials, &scans).map(|_| k).unwrap_err();
            assert_eq!(error.code, "scans_disagree", "{k}: {}", error.message);
            let named =
                error.message.contains("straight.ply") || error.message.contains("turned.ply");
            assert!(
                named && error.message.contains("moved"),
                "{}",
                error.message
            );
        }
    }

    /// Where the balls stand is known to 0.05 mm: four scans of them know it no better than one. The noise, 0.01 mm, is
    /// small beside that.
    #[test]
    fn several_scans_know_no_better_where_the_fiducials_stand() {
        let part = bracket();
        let mut random = Random(43);
        let fiducials = fiducials(0.05);
        let scans: Vec<TakenScan> = (0..4)
            .map(|_| taken(&part, &Pose::identity(), &centres(), &mut random))
            .collect();
        let u = |scans: &[TakenScan]| {
            let located = answer(&part, &fiducials, scans).unwrap().located;
            let at = |p: &Vec3| located.certainty.at(&located.motion, p).trace().sqrt();
            part.corners().iter().map(at).fold(0.0, f64::max)
        };
        let (one, four) = (u(&scans[..1]), u(&scans));
        assert!(four > 0.9 * one && four < 1.1 * one, "{one} {four}");
    }

    /// What two scans say of the place of a bracket that the first one shows from all around. `second`: the other's points.
    fn agreed(second: impl Fn(&Mesh, &mut Random) -> Vec<Vec3>) -> Result<(), ScanError> {
        let part = bracket();
        let second = second(&part, &mut Random(61));
        agreed_on(&part, 0.01, [&second, &[]])
    }

    /// The same of any part; the second scan's points, and those of them that are on fiducials.
    fn agreed_on(part: &Mesh, noise_mm: f64, second: [&[Vec3]; 2]) -> Result<(), ScanError> {
        let mut random = Random(47);
        let all = |_: &Vec3| true;
        let first = scan(part, 6000, noise_mm, &Pose::identity(), &mut random, all);
        let located = task(part, &first).find().unwrap();
        let none = Vec::new();
        let [points, on_fiducials] = second.map(<[Vec3]>::to_vec);
        let scans = [
            ("first.ply", first.clone(), none),
            ("second.ply", points, on_fiducials),
        ];
        let scans = scans.map(|(name, points, on_fiducials)| EachScan {
            name,
            points,
            on_fiducials,
        });
        let sure = Group {
            at: Vec3::zeros(),
            cov: nalgebra::Matrix6::identity() * 1e-12,
            common: Vec::new(),
        };
        let groups = [sure.clone(), sure];
        let of: Vec<usize> = vec![0; first.len()];
        let both = LocaliseTask {
            groups: Groups {
                all: &groups,
                of: &of,
            },
            ..task(part, &first)
        };
        agree(&both, &scans, &located)
    }

    fn shifted(by: [f64; 3]) -> Pose {
        moved(0.0, by)
    }

    /// The second scan shows the bracket's six sides alone, which lean, and the face of a chuck 2 mm below it: along the sides
    /// the bracket slides onto the chuck, and has more points there. The chuck goes on beyond the bracket's edges.
    #[test]
    fn a_chuck_behind_the_end_of_a_part_contradicts_no_scan() {
        let chuck = |part: &Mesh, random: &mut Random| {
            let sides = |n: &Vec3| n.z.abs() < 0.9;
            let mut points = scan(part, 4000, 0.01, &Pose::identity(), random, sides);
            for _ in 0..12_000 {
                let at = Vec3::new(
                    random.next() * 110.0 - 25.0,
                    random.next() * 90.0 - 25.0,
                    -2.0,
                );
                points.push(at + random.vector() * 0.01);
            }
            points
        };
        assert_eq!(agreed(chuck).map_err(|e| e.message), Ok(()));
        // A scan that has the part's own end 2 mm farther down contradicts.
        let apart = |part: &Mesh, random: &mut Random| {
            let by = shifted([-2.0 * 8.0 / 30.0, -2.0 * 5.0 / 30.0, -2.0]);
            scan(part, 9000, 0.01, &by, random, |_| true)
        };
        let code = agreed(apart).map_err(|e| e.code);
        assert_eq!(code, Err("scans_disagree"));
    }

    /// The second scan shows little of the bracket, and 130 mm off a body with more points that has a corner of it. Alone it
    /// would be no place of the bracket, of which more must have been seen from wherever the corner is.
    #[test]
    fn a_body_with_a_corner_of_the_part_contradicts_no_scan() {
        let with = |of_it: fn(&Vec3) -> bool| {
            move |part: &Mesh, random: &mut Random| {
                let mut points = scan(part, 400, 0.01, &Pose::identity(), random, |_| true);
                let by = shifted([130.0, 20.0, 10.0]);
                let body = scan(part, 9000, 0.01, &Pose::identity(), random, |_| true);
                let body = body.iter().filter(|p| of_it(p));
                points.extend(body.map(|p| by.point(p)));
                points
            }
        };
        let corner =
            |p: &Vec3| p.x - p.z * 8.0 / 30.0 < 35.0 && p.y - p.z / 6.0 < 25.0 && p.z < 18.0;
        assert_eq!(agreed(with(corner)).map_err(|e| e.message), Ok(()));
        // The whole of another bracket there does.
        assert_eq!(
            agreed(with(|_| true)).map_err(|e| e.code),
            Err("scans_disagree")
        );
    }

    /// A stepped bar along X, its corner at the origin.
    fn bar() -> Mesh {
        let outline = [
            [0.0, -40.64],
            [25.4, -40.64],
            [25.4, -14.0],
            [15.4, -14.0],
            [15.4, 0.0],
            [0.0, 0.0],
        ];
        let upright = prism(&outline, &[[0, 1, 2, 3], [0, 3, 4, 5]], 76.2, [0.0, 0.0]);
        let along = |c: &Vec3| Vec3::new(c.z, c.x, c.y);
        let all: Vec<[Vec3; 3]> = (upright.triangles().iter())
            .map(|t| t.corners.each_ref().map(along))
            .collect();
        Mesh::new(&all).unwrap()
    }

    /// Points 0.9 mm apart on a rectangle between these, of each this share; one of the three does not change.
    fn flat(from: [f64; 3], to: [f64; 3], share: f64, random: &mut Random) -> Vec<Vec3> {
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let steps = (to - from).map(|mm| (mm / 0.9).round().max(1.0) as usize);
        let mut all = Vec::new();
        for at in 0..steps.product() {
            let k = [
                at % steps.x,
                at / steps.x % steps.y,
                at / (steps.x * steps.y),
            ];
            let of = Vec3::from_fn(|i, _| (k[i] as f64 + 0.5) / steps[i] as f64);
            if random.next() < share {
                all.push(from + (to - from).component_mul(&of) + random.vector() * 0.1);
            }
        }
        all
    }

    /// From above, of the bar its two tops, and little of its sides.
    fn bar_from_above(random: &mut Random) -> Vec<Vec3> {
        let mut all = flat([0.0; 3], [76.2, 15.4, 0.0], 0.6, random);
        let mut more = |from, to, share| all.extend(flat(from, to, share, random));
        more([0.0, 15.4, -14.0], [76.2, 25.4, -14.0], 0.6);
        more([0.0, 0.0, -40.64], [76.2, 0.0, 0.0], 0.05);
        more([0.0, 15.4, -14.0], [76.2, 15.4, 0.0], 0.05);
        more([0.0, 25.4, -40.64], [76.2, 25.4, -14.0], 0.05);
        more([0.0, 0.0, -40.64], [0.0, 15.4, 0.0], 0.05);
        more([76.2, 0.0, -40.64], [76.2, 15.4, 0.0], 0.05);
        all
    }

    /// A shelf: its front, and a strip of its top beside what stands on it. The bar's corner lies well in the shelf's, and
    /// what stands there hides the rest of the bar. `walls`: those of what stands there.
    fn shelf(walls: bool, random: &mut Random) -> [Vec<Vec3>; 2] {
        let mut all = flat([0.0; 3], [82.0, 8.0, 0.0], 1.0, random);
        let mut more = |from, to| all.extend(flat(from, to, 1.0, random));
        more([0.0, 8.0, 0.0], [10.0, 72.0, 0.0]);
        more([0.0, 0.0, -20.0], [82.0, 0.0, 0.0]);
        if walls {
            more([10.0, 8.0, 0.0], [72.0, 8.0, 12.0]);
            more([62.0, 8.0, 12.0], [72.0, 8.0, 32.0]);
            more([62.0, 8.0, 32.0], [72.0, 52.0, 32.0]);
            more([10.0, 52.0, 42.0], [72.0, 62.0, 42.0]);
        }
        let mut fiducial = flat([10.0, 8.0, 12.0], [62.0, 52.0, 12.0], 1.0, random);
        if walls {
            fiducial.extend(flat([10.0, 52.0, 12.0], [62.0, 52.0, 42.0], 1.0, random));
        }
        [all, fiducial].map(|of| of.iter().map(|p| p + Vec3::new(7.0, 53.0, -50.0)).collect())
    }

    /// One of two scans shows the bar from above, and beside it a shelf that has more points of the bar's faces, and hides
    /// what of it is missing. The bar lies there in several ways alike, or leaves more unexplained than where the other scan
    /// has it: that contradicts nothing. Without the bar it does.
    #[test]
    fn a_shelf_that_a_part_could_lie_in_contradicts_no_scan() {
        let part = bar();
        for walls in [true, false] {
            let mut random = Random(59);
            let shown = bar_from_above(&mut random);
            let [shelf, fiducial] = shelf(walls, &mut random);
            let of = |shown: &[Vec3]| {
                let second = [shown, &shelf].concat();
                agreed_on(&part, 0.1, [&second, &fiducial]).map_err(|e| e.code)
            };
            assert_eq!(of(&shown), Ok(()), "{walls}");
            assert_eq!(of(&[]), Err("scans_disagree"), "{walls}");
        }
    }
}
