//! Whether the poses agree: what is wrong about a machine is named, and chance is not.

use umi_scan::calibrate::misfit::ALARM;

use super::*;

/// What the machine tells of its positions, where `wrong` is what is wrong about them.
fn told(simulated: (Observations, Vec<Vec<f64>>), wrong: impl Fn(&mut Vec<f64>)) -> Observations {
    let (mut told, mut joints) = simulated;
    let machine = machine();
    for (flange, q) in told.flanges.iter_mut().zip(&mut joints) {
        wrong(q);
        *flange = machine.flange_in_workpiece(q);
    }
    told.slips = AxisSlip::of(&machine, &joints);
    told
}

const TILTED: Vector3<f64> = Vector3::new(0.3, -0.2, 1.0);
/// Of the rotary axes, as a machine that reaches no further.
const SMALL: Swing = Swing {
    a_deg: 15.0,
    c_deg: 30.0,
    a_from_deg: 0.0,
};
const KINDS: [&str; 3] = ["ball", "plane", "known balls"];

fn simulated(
    kind: &str,
    swing: Swing,
    random: &mut Random,
) -> ((Observations, Vec<Vec<f64>>), SensorOptions) {
    match kind {
        "plane" => (plane_at(&TILTED, swing, EVEN, random), on_plane()),
        "known balls" => {
            let names = (0..BALLS.len()).map(|i| i.to_string());
            let options = SensorOptions {
                centres: Some(names.zip(BALLS).collect()),
                ..on_sphere(Some(12.7))
            };
            (spheres_at(&BALLS, 12.7, swing, EVEN, random), options)
        }
        _ => (
            spheres_at(&[BALL], 15.0, swing, EVEN, random),
            on_sphere(Some(15.0)),
        ),
    }
}

fn allowing(options: SensorOptions) -> SensorOptions {
    SensorOptions {
        allow_misfit: true,
        ..options
    }
}

/// A zero of A that is wrong by 0.05 degrees leaves 6 µm on a plane and the mount 0.1 mm off: each of these is named,
/// with what must be added, and none is answered with an uncertainty that its error mocks.
#[test]
fn a_wrong_zero_of_an_axis_is_named_however_small_the_residuals() {
    for kind in KINDS {
        for seed in 0..12 {
            let mut random = Random(seed);
            let (seen, options) = simulated(kind, SMALL, &mut random);
            let all = told(seen, |q| q[3] -= 0.05);
            let result = sensor(&all, &truth(), &options);
            let answer = sensor(&all, &truth(), &allowing(options)).unwrap();
            let misfit = answer.misfit.as_ref().unwrap();
            assert!(misfit.p < 1e-9, "{kind} {seed}: {misfit:?}");
            let slip = misfit.slip.as_ref().unwrap();
            assert_eq!(slip.what, "the zero of A", "{kind} {seed}");
            let apart = (slip.add - 0.05) / slip.u;
            assert!(
                apart.abs() < 5.0 && slip.u < 0.01,
                "{kind} {seed}: {slip:?}"
            );
            match result {
                Ok(answer) => {
                    // By the poses it is as uncertain as it is wrong.
                    let (_, shift) = off(&answer);
                    let u = answer.best_covariance().unwrap();
                    let u = (3..6).map(|i| u[i][i]).sum::<f64>().sqrt();
                    assert!(shift < 5.0 * u, "{kind} {seed}: {shift} {u}");
                    assert!(answer.warnings[0].starts_with("misfit: "));
                    assert!(answer.warnings[0].contains("deg (standard uncertainty"));
                }
                Err(error) => {
                    assert_eq!(error.code, "misfit", "{kind} {seed}: {error}");
                    assert_eq!(error.details["misfit"]["slip"]["what"], "the zero of A");
                }
            }
            // With what it says, the mount is right.
            let (seen, options) = simulated(kind, SMALL, &mut Random(seed));
            let put_right = told(seen, |q| q[3] += slip.add - 0.05);
            let right = sensor(&put_right, &truth(), &options).unwrap();
            assert!(right.warnings.is_empty(), "{kind} {seed}");
        }
    }
    // The worst of it: 6 µm of residuals, 0.1 mm of error, refused.
    let mut random = Random(1);
    let (seen, options) = simulated("plane", SMALL, &mut random);
    let all = told(seen, |q| q[3] -= 0.05);
    assert_eq!(sensor(&all, &truth(), &options).unwrap_err().code, "misfit");
    let answer = sensor(&all, &truth(), &allowing(options)).unwrap();
    assert!(answer.sigma_mm.unwrap() < 0.006 && off(&answer).1 > 0.09);
}

/// What else may be wrong about an axis is named as that, and what is added to it puts it right.
#[test]
fn each_slip_of_an_axis_is_named_for_what_it_is() {
    type Slip = fn(&mut Vec<f64>);
    let slips: [(&str, f64, Slip); 4] = [
        ("the scale of A", 500.0, |q| q[3] /= 1.000_5),
        ("the scale of C", 500.0, |q| q[4] /= 1.000_5),
        ("the scale of X", 400.0, |q| q[0] /= 1.000_4),
        ("the scale of Z", 400.0, |q| q[2] /= 1.000_4),
    ];
    for (what, ppm, wrong) in slips {
        let mut random = Random(9);
        let (seen, options) = simulated("known balls", BOTH, &mut random);
        let all = told(seen, wrong);
        let answer = sensor(&all, &truth(), &allowing(options)).unwrap();
        let slip = answer.misfit.unwrap().slip.unwrap();
        assert_eq!(slip.what, what, "{slip:?}");
        assert!(
            (slip.add - ppm).abs() < 5.0 * slip.u + 0.01 * ppm,
            "{slip:?}"
        );
    }
}

/// Poses that agree give an alarm by chance only: of 200 sets of a kind 5 % have a p below 0.05, none a slip, and at
/// most one is told (1 in 1000 is expected). The mount is that of an answer without the test.
#[test]
fn poses_that_agree_give_no_alarm() {
    for kind in KINDS {
        let mut random = Random(77);
        let (mut doubtful, mut told) = (0, 0);
        for _ in 0..200 {
            let ((all, _), options) = simulated(kind, BOTH, &mut random);
            let answer = sensor(&all, &truth(), &options).unwrap();
            let misfit = answer.misfit.unwrap();
            doubtful += u32::from(misfit.p < 0.05);
            told += u32::from(misfit.stands_out());
            assert_eq!(answer.warnings.is_empty(), !misfit.stands_out());
        }
        // Within 99.9 % of what 5 % of 200 gives.
        assert!((2..=21).contains(&doubtful), "{kind}: {doubtful}");
        assert!(told <= 1, "{kind}: {told}");
    }
}

/// By hand; the last result is in docs/promises.md: the alarms of 200 sets of each kind that `mounts` simulates, with each
/// kind of noise.
#[test]
#[ignore = "a minute"]
fn alarms_of_3600_sets_whose_poses_agree() {
    for (name, noise) in [
        ("distance", EVEN),
        ("range", along_z(0.005)),
        ("growing range", GROWING),
    ] {
        let mut random = Random(79);
        let (mut by_f, mut by_slip, mut sets) = (0, 0, 0);
        for kind in super::KINDS {
            for _ in 0..200 {
                sets += 1;
                let Some(answer) = calibrated(kind, noise, &mut random) else {
                    by_slip += 1;
                    continue;
                };
                let misfit = answer.misfit.unwrap();
                by_f += u32::from(misfit.p < ALARM);
                by_slip += u32::from(misfit.slip.is_some());
            }
        }
        println!("{name}: of {sets} sets {by_f} by F, {by_slip} by a slip");
        assert!(by_slip <= 3);
        assert!(
            by_f <= if matches!(noise, Noise::Growing(..)) {
                24
            } else {
                6
            }
        );
    }
}

/// Poses that are off by something of their own, 5 µm as the noise of a sample, are told and blamed on no axis; the
/// covariance by the poses holds the truth, the others do not.
#[test]
fn poses_that_scatter_widen_the_covariance() {
    for kind in KINDS {
        let mut random = Random(78);
        let (mut alike, mut by_poses) = (0, 0);
        for _ in 0..100 {
            let ((mut all, _), options) = simulated(kind, BOTH, &mut random);
            for flange in &mut all.flanges {
                flange.translation_mm += Vector3::from_fn(|_, _| 0.005 * random.normal());
            }
            let answer = sensor(&all, &truth(), &options).unwrap();
            let misfit = answer.misfit.as_ref().unwrap();
            assert!(
                misfit.p < ALARM && misfit.slip.is_none(),
                "{kind}: {misfit:?}"
            );
            assert!((0.002..0.009).contains(&misfit.between_mm), "{misfit:?}");
            assert!((0.004..0.008).contains(&misfit.within_mm), "{misfit:?}");
            let [held, _] = holds(&answer);
            alike += u32::from(held);
            let poses = SensorAnswer {
                covariance_scatter: answer.covariance_poses,
                dof_scatter: answer.dof_poses,
                ..answer
            };
            let [_, held] = holds(&poses);
            by_poses += u32::from(held);
        }
        assert!(alike < 50 && by_poses >= 86, "{kind}: {alike} {by_poses}");
    }
}

/// One pose at which the machine was somewhere else is named.
#[test]
fn the_worst_pose_is_named() {
    let mut random = Random(3);
    let ((mut all, _), options) = simulated("ball", BOTH, &mut random);
    all.profiles = (0..30).map(|i| format!("P{i}")).collect();
    all.flanges[17].translation_mm.z += 0.02;
    let answer = sensor(&all, &truth(), &options).unwrap();
    let misfit = answer.misfit.unwrap();
    assert_eq!(misfit.worst.pose, "profile P17", "{misfit:?}");
    assert!(misfit.worst.t.abs() > 6.0 && misfit.p < ALARM);
    // 170 µm where samples scatter by 5 are no pose.
    all.flanges[17].translation_mm.z += 0.15;
    let error = sensor(&all, &truth(), &on_sphere(Some(15.0))).unwrap_err();
    assert_eq!(error.code, "misfit", "{error}");
    assert!(error.message.contains("profile P17"), "{error}");
}

/// An axis whose balls are all off together at one angle is told; angles that agree are not.
#[test]
fn angles_of_an_axis_that_disagree_are_told() {
    let mut random = Random(5);
    let u = Vector3::new(0.02, -0.01, 1.0).normalize();
    let arms = [
        Vector3::new(90.0, 10.0, 15.0),
        Vector3::new(60.0, -50.0, 55.0),
        Vector3::new(-20.0, 80.0, 0.0),
    ];
    let angles: Vec<f64> = (0..12).map(|i| 30.0 * f64::from(i)).collect();
    let (mut told, mut doubtful) = (0, 0);
    for _ in 0..200 {
        let found = axis(&turned(&u, &arms, &angles, 0.005, &mut random)).unwrap();
        let misfit = found.misfit.unwrap();
        doubtful += u32::from(misfit.p < 0.05);
        told += u32::from(misfit.stands_out());
        assert_eq!(found.warnings.len(), usize::from(misfit.stands_out()));
    }
    assert!(
        (2..=21).contains(&doubtful) && told <= 1,
        "{doubtful} {told}"
    );
    let mut centres = turned(&u, &arms, &angles, 0.005, &mut random);
    for centre in &mut centres {
        if centre.angle_deg == 60.0 {
            centre.measured_mm.x += 0.03;
        }
    }
    let found = axis(&centres).unwrap();
    let misfit = found.misfit.unwrap();
    assert!(misfit.stands_out(), "{misfit:?}");
    assert_eq!(misfit.worst.pose, "the angle 60 deg");
    let [wide, plain] = [found.cov_point_poses, found.cov_point].map(|c| c.unwrap()[0][0]);
    assert!(wide > plain, "{wide} {plain}");
    // One ball leaves nothing to hold an angle against.
    let found = axis(&turned(&u, &arms[..1], &angles, 0.005, &mut random)).unwrap();
    assert!(found.misfit.is_none() && found.warnings.is_empty());
}
