//! What is probed once more: closing balls, balls on the table, tops; and what it tells.

use nalgebra::Vector3;
use umi_protocol::verdict::RegistrationReport;

use super::*;

/// A worn stylus scatters within the job's limits, and not within those that were learned.
#[test]
fn a_worn_stylus_is_named() {
    let mut learning = job();
    learning.guards.learned = Some(LearnedLimits {
        radius_mm: 0.003,
        rms_mm: 0.002,
        centring_mm: 0.004,
    });
    let worn = |job: Job, hit: usize, axis: usize, off_mm: f64| {
        let mut blocks = session_a();
        blocks[7].1[hit][axis] += off_mm;
        run_blocks(job, &blocks).summary().remove(2)
    };
    assert_eq!(worn(job(), 1, 0, 0.018), "OK");
    assert_eq!(
        run_blocks(learning.clone(), &session_a()).summary(),
        ["OK"; 5]
    );
    let named = worn(learning.clone(), 1, 0, 0.018);
    assert!(named.contains("SPHERE2:radius_since_taught"), "{named}");
    let named = worn(learning, 3, 0, 0.012);
    assert!(named.contains("SPHERE2:centring_since_taught"), "{named}");
}

/// The first ball probed again at the end, and a ball that stays on the table.
fn redundant() -> Job {
    let mut job = with_ids(job());
    for (id, name) in [(4, "CLOSING"), (5, "TABLE")] {
        let mut feature = job.features[0].clone();
        (feature.id, feature.name) = (Some(id), name.try_into().unwrap());
        let _ = job.features.push(feature);
    }
    job.guards.closing = [Closing {
        feature: "CLOSING".try_into().unwrap(),
        repeats: "SPHERE1".try_into().unwrap(),
        within_mm: 0.004,
    }]
    .into_iter()
    .collect();
    job.guards.fixed = ["TABLE".try_into().unwrap()].into_iter().collect();
    job.guards.fixed_mm = Some(0.005);
    job
}

/// A ball on the table: the first of the session, 300 mm beside.
fn table() -> Block {
    let (_, mut points) = session_a().remove(0);
    points.iter_mut().for_each(|point| point[0] += 300.0);
    ("TABLE".to_string(), points)
}

/// A first touch of a top that came early, with the sides driven by it, shows where the top is
/// touched once more; a second one beside the first is refused, and the two may be the same to
/// the last digit.
#[test]
fn the_top_once_more() {
    let session = |early_mm: f64, beside_mm: f64| {
        let mut job = job();
        job.again = Some(AgainSpec { within_mm: 0.006 });
        for feature in &mut job.features {
            feature.hits = 6;
            let _ = feature.approach.push(Approach::MinusZ);
        }
        check(&job).unwrap();
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        for number in 0..2 {
            for (name, points) in &mut clamping(number, [1, 2, 3]) {
                let [x, y, z] = points[0];
                points.push([x + beside_mm, y, z]);
                if number == 1 && name == "SPHERE2" {
                    points.iter_mut().take(5).for_each(|p| p[2] += early_mm);
                }
                feed(&mut run, &mut outcome, name, points, 6);
            }
        }
        let reasons = outcome.verdicts.last().map(|v| v.reasons.clone());
        (outcome.summary(), reasons.unwrap())
    };
    assert_eq!(session(0.0, 0.0).0, ["OK"; 2]);
    assert_eq!(session(0.005, 0.0).0, ["OK"; 2]);
    let (summary, reasons) = session(0.010, 0.0);
    assert_eq!(summary, ["OK", "SPHERE2:not_repeated"]);
    let Reason::NotRepeated {
        hit, first, off_mm, ..
    } = reasons[0].reason
    else {
        panic!("{reasons:?}");
    };
    assert_eq!((hit, first), (6, 1));
    assert!((off_mm + 0.010).abs() < 1e-9, "{off_mm}");
    let (summary, _) = session(0.0, 0.2);
    assert!(summary[0].contains("SPHERE1:not_same_place"), "{summary:?}");
}

/// A ball that is probed twice stands in the middle of both: what moved within the limit of
/// closing is halved, in the taught setup and in each other one.
#[test]
fn both_times_count() {
    let mut job = redundant();
    job.features.pop();
    job.guards.fixed.clear();
    job.guards.fixed_mm = None;
    check(&job).unwrap();
    let registered = |setup: usize, [first_mm, again_mm]: [f64; 2]| {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            let again = blocks[0].1.clone();
            blocks.push(("CLOSING".to_string(), again));
            for (id, (_, mut points)) in (1..).zip(blocks) {
                let off_mm = match id {
                    1 if number == setup => first_mm,
                    4 if number == setup => again_mm,
                    _ => 0.0,
                };
                points.iter_mut().for_each(|point| point[2] += off_mm);
                probe(&mut run, &mut outcome, id, &points, number);
            }
        }
        assert_eq!(outcome.summary(), ["OK"; 2]);
        outcome.verdicts.remove(1).registration.unwrap()
    };
    let apart = |a: &RegistrationReport, b: &RegistrationReport| {
        (Vector3::from(a.translation_mm) - Vector3::from(b.translation_mm)).norm()
    };
    for setup in 0..2 {
        let [still, again, first, both] =
            [[0.0, 0.0], [0.0, 0.003], [0.003, 0.0], [0.0015, 0.0015]]
                .map(|off_mm| registered(setup, off_mm));
        assert!(apart(&still, &again) > 3e-4, "{}", apart(&still, &again));
        for other in [&first, &both] {
            assert!(apart(&again, other) < 1e-9, "{}", apart(&again, other));
        }
    }
}

/// A ball on the table that is probed twice is held to its taught place each time by itself, however far
/// apart both may be: a stylus that is bent between them is not halved.
#[test]
fn each_time_of_a_ball_on_the_table_is_held() {
    let mut job = redundant();
    let mut feature = job.features[4].clone();
    (feature.id, feature.name) = (Some(6), "TABLE2".try_into().unwrap());
    // Whatever it says of itself, a verdict rests on it.
    feature.datum = false;
    let _ = job.features.push(feature);
    let _ = job.guards.closing.push(Closing {
        feature: "TABLE2".try_into().unwrap(),
        repeats: "TABLE".try_into().unwrap(),
        within_mm: 0.1,
    });
    check(&job).unwrap();
    let session = |bent_mm: [f64; 2]| {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            for bent_mm in bent_mm {
                let bent_mm = if number == 1 { bent_mm } else { 0.0 };
                let mut table = table();
                table.1.iter_mut().for_each(|point| point[1] += bent_mm);
                blocks.push(table);
            }
            for (id, (_, points)) in (1..).zip(&blocks) {
                probe(&mut run, &mut outcome, id, points, number);
            }
        }
        outcome.summary().remove(1)
    };
    assert_eq!(session([0.0, 0.0]), "OK");
    assert_eq!(session([0.0045, -0.0045]), "OK");
    assert_eq!(session([0.0, 0.008]), "TABLE2:fixed_moved");
    assert_eq!(session([0.008, 0.0]), "TABLE:fixed_moved");

    job_of_four_hits_is_refused(&job);
    let again = job.guards.closing[1].clone();
    let mut twice = job.clone();
    let _ = twice.guards.closing.push(again);
    assert!(check(&twice).is_err(), "it would count twice");
}

/// A feature that a verdict rests on has a hit more than it needs, whatever it says of itself.
fn job_of_four_hits_is_refused(job: &Job) {
    let mut job = job.clone();
    let closing = &mut job.features[5];
    closing.hits = 4;
    closing.approach.clear();
    let error = check(&job).unwrap_err();
    assert_eq!(error.code(), "hit_count", "{error}");
}

/// A part that slips between the first ball and the last shows in the closing one; a stylus
/// that was bent since teaching shows in the ball on the table.
#[test]
fn closing_and_fixed_balls() {
    let session = |slip_mm: f64, bent_mm: f64| {
        check(&redundant()).unwrap();
        let mut run = Run::new(redundant());
        let mut outcome = Outcome::default();
        for number in 0..3 {
            let mut blocks = clamping(number, [1, 2, 3]);
            let mut again = blocks[0].clone();
            again.0 = "CLOSING".to_string();
            again
                .1
                .iter_mut()
                .for_each(|p| p[0] += if number == 2 { slip_mm } else { 0.0 });
            blocks.push(again);
            blocks.push(table());
            for (id, (_, points)) in (1..).zip(&mut blocks) {
                let bent = if number == 2 { bent_mm } else { 0.0 };
                points.iter_mut().for_each(|p| p[1] += bent);
                probe(&mut run, &mut outcome, id, points, number);
            }
        }
        outcome.summary()
    };
    assert_eq!(session(0.0, 0.0), ["OK"; 3]);
    assert_eq!(session(0.006, 0.0), ["OK", "OK", "CLOSING:not_closed"]);
    assert_eq!(session(0.0, -0.007), ["OK", "OK", "TABLE:fixed_moved"]);
}

/// A ball on the table that was probed before a datum ball shows no stylus that was bent between
/// the two: the setup is NG, and names both.
#[test]
fn the_ball_on_the_table_comes_behind_the_datums() {
    let session = |order: [usize; 5]| {
        let mut run = Run::new(redundant());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            blocks.push(table());
            let order = if number == 0 { [0, 1, 2, 3, 4] } else { order };
            for place in order {
                probe(&mut run, &mut outcome, place + 1, &blocks[place].1, number);
            }
        }
        let last = outcome.verdicts.last().unwrap();
        let told = last.reasons.first().map(|of| of.reason.to_string());
        (outcome.summary().remove(1), told.unwrap_or_default())
    };
    assert_eq!(session([0, 1, 2, 3, 4]).0, "OK");
    // The closing ball may come behind it.
    assert_eq!(session([0, 1, 2, 4, 3]).0, "OK");
    for (order, name) in [([4, 0, 1, 2, 3], "SPHERE3"), ([0, 2, 4, 1, 3], "SPHERE2")] {
        let (summary, told) = session(order);
        assert_eq!(summary, "TABLE:fixed_before");
        assert!(told.starts_with(name), "{told}");
    }
}

/// A plate at 5 K more is registered as if it were not; at 8 K it is refused by name.
#[test]
fn warmth_is_told() {
    let mut warm = job();
    warm.guards.warmth = Some(WarmthSpec {
        expansion_ppm_per_k: 11.5,
        at_most_k: 6.0,
    });
    warm.guards.probing = Some(ProbingSpec::alike(0.001, 19));
    let clamped = |job: Job, kelvin: f64| {
        let mut blocks = session_a();
        let scale = 1.0 + 11.5e-6 * kelvin;
        // Each ball moves as a whole: about the plate's middle.
        let middle = [-45.0, -45.0, 127.0];
        for (_, points) in &mut blocks[3..6] {
            let mut center = [0.0; 3];
            for axis in 0..3 {
                let mean = points[1..].iter().map(|p| p[axis]).sum::<f64>() / 4.0;
                center[axis] = (mean - middle[axis]) * (scale - 1.0);
            }
            points.iter_mut().for_each(|p| {
                (0..3).for_each(|axis| p[axis] += center[axis]);
            });
        }
        run_blocks(job, &blocks[..6])
    };
    let cold = clamped(warm.clone(), 0.0).verdicts.remove(1);
    let at_5 = clamped(warm.clone(), 5.0).verdicts.remove(1);
    assert!(clamped(job(), 5.0).summary()[1].contains("distance_error"));
    assert!(cold.ok && at_5.ok, "{:?}", at_5.reasons);
    let kelvin = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::Warmer { kelvin, sigma_k } => Some((kelvin, sigma_k)),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    assert!((kelvin(&at_5).0 - kelvin(&cold).0 - 5.0).abs() < 0.01);
    assert!((0.2..6.0).contains(&kelvin(&at_5).1), "{:?}", kelvin(&at_5));
    let angle = |v: &Verdict| v.registration.as_ref().unwrap().angle_deg;
    assert!((angle(&at_5) - angle(&cold)).abs() < 1e-6);
    // The part's middle lies 5 K farther from the balls' one, where the plate has grown to.
    let part = job().correction.unwrap();
    let middle_z_mm = (part.part_min_mm[2] + part.part_max_mm[2]) / 2.0;
    let image = |verdict: &Verdict| {
        let fit = verdict.registration.as_ref().unwrap();
        let part = [0.0, 0.0, middle_z_mm];
        [0, 1, 2].map(|row: usize| {
            let turned: f64 = (0..3).map(|i| fit.rotation[row][i] * part[i]).sum();
            turned + fit.translation_mm[row]
        })
    };
    let (at_5_mm, cold_mm) = (image(&at_5), image(&cold));
    for (axis, arm) in [45.0, 45.0, middle_z_mm - 127.0].into_iter().enumerate() {
        let grown = at_5_mm[axis] - cold_mm[axis];
        // The plate is turned by 1 degree.
        assert!(
            (grown - arm * 5.0 * 11.5e-6).abs() < 1e-4,
            "{axis}: {grown}"
        );
    }
    let stated = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::Error95 { error_mm } => Some(error_mm),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    assert!((0.001..0.05).contains(&stated(&cold)), "{}", stated(&cold));
    assert!(clamped(warm.clone(), 8.0).summary()[1].contains("too_warm"));
    // What a rigid correction leaves of the part's growth is told, and stands in what is stated.
    let left = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::GrowthLeft { grown_mm } => Some(grown_mm),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    let half = libm::sqrt(26.0 * 26.0 + 36.0 * 36.0 + 13.0 * 13.0);
    let expected = half * (kelvin(&at_5).0 * 11.5e-6);
    assert!((left(&at_5) - expected).abs() < 1e-9, "{}", left(&at_5));
    assert!(stated(&at_5) > stated(&cold));
    // A part of 300 mm grows by more than may be left.
    let mut large = warm;
    let spec = large.correction.as_mut().unwrap();
    (spec.part_min_mm, spec.part_max_mm) = ([-150.0; 3], [150.0, 150.0, 0.0]);
    spec.leftover_mm = 0.010;
    large.limits.expected_error_mm = None;
    let summary = clamped(large.clone(), 5.0).summary();
    assert!(summary[1].contains("part_grown"), "{summary:?}");
    assert!(!clamped(large, 0.0).summary()[1].contains("part_grown"));
}

/// What nothing in a job guards against stands in each of its verdicts, also where only programs
/// are rewritten by them; a job without a registration has nothing to guard.
#[test]
fn what_is_not_guarded_is_told() {
    let open = |job: Job| {
        let verdicts = run_blocks(job, &session_a()[..6]).verdicts;
        let told = verdicts.iter().map(|verdict| {
            let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
                Reason::NotGuarded {
                    late_text,
                    moved_offset,
                    while_probed,
                    first_ok,
                } => Some([late_text, moved_offset, while_probed, first_ok]),
                _ => None,
            };
            verdict.remarks.iter().find_map(of)
        });
        told.collect::<Vec<_>>()
    };
    assert_eq!(open(job()), [Some([true, true, true, true]); 2]);
    let mut given = with_ids(job());
    given.teach = Teach::Asked;
    given.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    given.guards.run_variable = Some(531);
    assert_eq!(open(given.clone()), [Some([false, true, false, false]); 2]);
    given.guards.frame = true;
    assert_eq!(open(given.clone()), [None; 2]);
    // Blocks behind the lines of O8811: nothing says that their macros look again.
    let block = job().receiver.patterns[0].clone();
    let _ = given.receiver.patterns.push(block);
    assert_eq!(open(given), [Some([false, false, true, false]); 2]);
    let mut only = job();
    only.correction = None;
    assert_eq!(open(only.clone()), [Some([true, true, true, true]); 2]);
    for feature in only.features.iter_mut().skip(2) {
        feature.datum = false;
    }
    assert_eq!(open(only), [None; 2]);
}

/// The closing ball and the one that it repeats enclose all others in the order in which they
/// were probed, whatever that is: a slip elsewhere moves neither against the other. Without runs
/// the order is the job's, and a job that encloses nothing is refused.
#[test]
fn a_ball_outside_the_closing_pair_is_named() {
    const PAIR: [usize; 2] = [1, 4];
    let session = |order: [usize; 5], slips_at: usize| {
        let mut run = Run::new(redundant());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            blocks.push(table());
            for (turn, id) in order.into_iter().enumerate() {
                let slip = if number == 1 && turn >= slips_at {
                    0.05
                } else {
                    0.0
                };
                let on_table = id == 5;
                let slip = if on_table { 0.0 } else { slip };
                let mut points = blocks[id - 1].1.clone();
                points.iter_mut().for_each(|point| point[0] += slip);
                probe(&mut run, &mut outcome, id, &points, number);
            }
        }
        outcome.summary()
    };
    let mut orders = vec![vec![]];
    for id in 1..=5 {
        orders = orders
            .into_iter()
            .flat_map(|order: Vec<usize>| {
                (0..=order.len()).map(move |at| {
                    let mut longer = order.clone();
                    longer.insert(at, id);
                    longer
                })
            })
            .collect();
    }
    assert_eq!(orders.len(), 120);
    for order in orders {
        let turn = |id: usize| order.iter().position(|of| *of == id).unwrap();
        let encloses = [2, 3]
            .iter()
            .all(|id| (turn(PAIR[0])..turn(PAIR[1])).contains(&turn(*id)));
        let array: [usize; 5] = order.clone().try_into().unwrap();
        let summary = session(array, 5);
        let table_is_last = [1, 2, 3].iter().all(|id| turn(*id) < turn(5));
        if encloses && table_is_last {
            assert_eq!(summary, ["OK"; 2], "{order:?}");
        } else if encloses {
            assert!(
                summary.iter().all(|of| of.contains("TABLE:fixed_before")),
                "{order:?}"
            );
        } else {
            assert!(
                summary.iter().all(|of| of.contains("CLOSING:not_enclosed")),
                "{order:?}"
            );
        }
        for slips_at in 1..5 {
            // Behind the closing ball nothing is left to move.
            let ends = [1, 2, 3, 4].map(turn).into_iter().max().unwrap();
            let begins = [1, 2, 3, 4].map(turn).into_iter().min().unwrap();
            if slips_at <= ends && slips_at > begins {
                assert_ne!(session(array, slips_at)[1], "OK", "{order:?} {slips_at}");
            }
        }
    }
    let mut blocks = redundant();
    blocks.receiver.patterns = job().receiver.patterns;
    check(&blocks).unwrap();
    blocks.features.swap(2, 3);
    assert!(
        matches!(check(&blocks), Err(JobError::BadValue { field, .. }) if field == umi_protocol::job_error::Field::Closing)
    );
}

/// Of several closing balls each comes behind all others: one that a ball follows shows nothing
/// of what moves then.
#[test]
fn each_closing_ball_comes_last() {
    let mut job = redundant();
    let mut second = job.features[3].clone();
    (second.id, second.name) = (Some(6), "CLOSING3".try_into().unwrap());
    let _ = job.features.push(second);
    let _ = job.guards.closing.push(Closing {
        feature: "CLOSING3".try_into().unwrap(),
        repeats: "SPHERE3".try_into().unwrap(),
        within_mm: 0.004,
    });
    check(&job).unwrap();
    let session = |order: [usize; 6], turned: bool| {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            blocks.push(table());
            let mut again = blocks[2].clone();
            // About ball 1, when all have been probed once.
            let by_mm = if turned && number == 1 { 0.05 } else { 0.0 };
            again.1.iter_mut().for_each(|point| point[0] += by_mm);
            blocks.push(again);
            for id in order {
                probe(&mut run, &mut outcome, id, &blocks[id - 1].1, number);
            }
        }
        outcome.summary()
    };
    assert_eq!(session([1, 2, 3, 4, 6, 5], false), ["OK"; 2]);
    assert_eq!(session([1, 3, 2, 6, 5, 4], false), ["OK"; 2]);
    // The first one that is probed twice need not be the first in the job.
    assert_eq!(session([3, 1, 2, 4, 6, 5], false), ["OK"; 2]);
    let turned = session([1, 2, 3, 4, 6, 5], true);
    assert_eq!(turned, ["OK", "CLOSING3:not_closed"]);
    for order in [[1, 3, 6, 2, 4, 5], [1, 2, 4, 3, 6, 5], [2, 1, 3, 4, 6, 5]] {
        let summary = session(order, false);
        assert!(
            summary.iter().all(|of| of.contains("not_enclosed")),
            "{order:?} {summary:?}"
        );
    }
    // Blocks come in the job's order, which must be one of these.
    let mut blocks = job.clone();
    blocks.receiver.patterns = super::job().receiver.patterns;
    check(&blocks).unwrap();
    blocks.features.swap(1, 5);
    assert!(check(&blocks).is_err());
}
