//! The job on the points of the reference sessions: what must be OK, and what
//! residuals cannot see and other limits must.

use std::format;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{BlockEndCause, FaultKind};
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{
    Approach, Closing, Compensation, CorrectionSpec, Dialect, FeatureKind, FeatureSpec, Guards,
    Job, LearnedLimits, Limits, ProgramEnd, Reference, SendWhen, Teach, WarmthSpec, WitnessSpec,
    WorkOffset,
};
use umi_protocol::job_error::JobError;
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_protocol::pattern::{BlockPattern, CheckedPattern, LinePattern, ReceiverConfig};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::*;
use crate::dprnt::{BlockEnd, Doubts, ReportedHit};
use crate::units::{Micros, Point};

mod coverage;
mod feed;
mod guards;

/// Three spheres, taught, as `examples/three-spheres.toml` has it.
fn job() -> Job {
    use Approach::{MinusX, MinusY, MinusZ, PlusX, PlusY};
    let sphere = |number: usize| FeatureSpec {
        name: format!("SPHERE{number}").as_str().try_into().unwrap(),
        id: None,
        kind: FeatureKind::Sphere,
        hits: 5,
        position_mm: None,
        radius_mm: Some(12.7),
        approach: [MinusZ, MinusX, PlusX, MinusY, PlusY].into_iter().collect(),
        datum: true,
    };
    Job {
        name: "THREE SPHERES".try_into().unwrap(),
        reference: Reference::Taught,
        plate_timeout_s: 1800,
        receiver: ReceiverConfig {
            patterns: [LinePattern::Block(BlockPattern::default())]
                .into_iter()
                .collect(),
            ..ReceiverConfig::default()
        },
        features: (1..=3).map(sphere).collect(),
        compensation: Compensation::InMacro,
        limits: Limits {
            radius_error_mm: 0.03,
            rms_mm: 0.015,
            approach_deg: Some(0.2),
            lone_hit_mm: Some(0.005),
            distance_error_mm: 0.01,
            registration_rms_mm: 0.005,
            rotation_deg: 3.0,
            tilt_deg: 0.010,
            shift_mm: [60.0, 60.0, 0.06],
            expected_error_mm: Some(0.01),
        },
        correction: Some(CorrectionSpec {
            dialect: Dialect::G10G68,
            probed_in: WorkOffset::G54,
            probed_origin_mm: [0.0; 3],
            write_to: WorkOffset::G55,
            set: None,
            program_number: 9010,
            ends_with: ProgramEnd::M99,
            part_min_mm: [-26.0, -36.0, 0.0],
            part_max_mm: [26.0, 36.0, 26.0],
            leftover_mm: 0.02,
            send: SendWhen::OnRequest,
        }),
        witness: None,
        teach: Teach::FirstOk,
        guards: Guards::default(),
        line: umi_protocol::serial::LineSpec::default(),
        skip: umi_protocol::job::SkipSpec::default(),
        again: None,
    }
}

/// With numbers, as checked lines name them.
fn with_ids(mut job: Job) -> Job {
    for (id, feature) in (1..).zip(&mut job.features) {
        feature.id = Some(id);
    }
    job
}

/// A block as printed: name and points.
type Block = (String, Vec<[f64; 3]>);

fn session(text: &str) -> Vec<Block> {
    let json: serde_json::Value = serde_json::from_str(text).unwrap();
    let block = |b: &serde_json::Value| {
        let points = b["points"].as_array().unwrap();
        let point = |p: &serde_json::Value| [0, 1, 2].map(|i| p[i].as_f64().unwrap());
        (
            b["name"].as_str().unwrap().to_string(),
            points.iter().map(point).collect(),
        )
    };
    json["blocks"]
        .as_array()
        .unwrap()
        .iter()
        .map(block)
        .collect()
}

fn session_a() -> Vec<Block> {
    session(include_str!(
        "../../../../../tests/reference/sessions/session_a.json"
    ))
}

#[derive(Default)]
struct Outcome {
    features: Vec<FeatureResult>,
    verdicts: Vec<Verdict>,
    taught: usize,
}

impl Outcome {
    fn take(&mut self, decision: Decision<'_>) {
        match decision {
            Decision::Feature(feature) => self.features.push(feature.clone()),
            Decision::Verdict(verdict) => self.verdicts.push(verdict.clone()),
            Decision::Taught(_) => self.taught += 1,
        }
    }

    /// OK or the codes of the reasons, one entry per verdict.
    fn summary(&self) -> Vec<String> {
        let codes = |v: &Verdict| {
            v.reasons
                .iter()
                .map(|r| match &r.feature {
                    Some(name) => format!("{name}:{}", r.reason.code()),
                    None => r.reason.code().to_string(),
                })
                .collect::<Vec<_>>()
                .join(" ")
        };
        self.verdicts
            .iter()
            .map(|v| {
                assert_eq!(v.ok, v.reasons.is_empty(), "{v:?}");
                assert!(
                    v.ok || v.correction.is_none(),
                    "NG with a correction: {v:?}"
                );
                if v.ok { "OK".into() } else { codes(v) }
            })
            .collect()
    }
}

fn hit(point: [f64; 3]) -> ReportedHit {
    ReportedHit {
        line: 0,
        first: Micros(0),
        last: Micros(0),
        position: Point::from_array_mm(point),
        digits: [None; 3],
        feature: None,
        feature_id: None,
        index: None,
        run: None,
        sequence: None,
        approach: None,
        touched: None,
        feed_mm_per_min: None,
        doubts: if point == [0.0; 3] {
            Doubts::NULL_POINT
        } else {
            Doubts::NONE
        },
    }
}

fn feed(run: &mut Run, outcome: &mut Outcome, name: &str, points: &[[f64; 3]], announced: u16) {
    let now = Micros(1);
    run.block_start(name, now, &mut |d| outcome.take(d));
    for point in points {
        run.hit(&hit(*point), now, &mut |d| outcome.take(d));
    }
    let got = u16::try_from(points.len()).unwrap();
    let end = BlockEnd {
        name: name.try_into().unwrap(),
        expected: Some(announced),
        got,
        damaged: 0,
        complete: got == announced,
        ended_by: BlockEndCause::Count,
    };
    run.block_end(&end, now, &mut |d| outcome.take(d));
}

fn run_blocks(job: Job, blocks: &[Block]) -> Outcome {
    check(&job).unwrap();
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    for (name, points) in blocks {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    run.input_ended(&mut |d| outcome.take(d));
    outcome
}

/// Both reference sessions: five clampings, five OK verdicts, and the
/// registrations of the 50-digit answers within their tolerance.
#[test]
fn reference_sessions_are_ok_and_right() {
    for text in [
        include_str!("../../../../../tests/reference/sessions/session_a.json"),
        include_str!("../../../../../tests/reference/sessions/session_b.json"),
    ] {
        let outcome = run_blocks(job(), &session(text));
        assert_eq!(outcome.summary(), ["OK"; 5]);
        assert_eq!((outcome.taught, outcome.features.len()), (1, 15));
        assert_eq!(outcome.verdicts[0].registration, None);
        assert_eq!(outcome.verdicts[0].correction, None);

        let json: serde_json::Value = serde_json::from_str(text).unwrap();
        let tol = |key: &str| json["tol"][key].as_f64().unwrap();
        for (feature, block) in outcome
            .features
            .iter()
            .zip(json["blocks"].as_array().unwrap())
        {
            let fit = feature.fit.as_ref().unwrap();
            let position = fit.shape.position_mm().unwrap();
            for (i, value) in position.iter().enumerate() {
                let expected = block["fit"]["center"][i].as_f64().unwrap();
                assert!((value - expected).abs() <= tol("center"));
            }
            let expected = block["fit"]["radius"].as_f64().unwrap();
            assert!((fit.shape.radius_mm().unwrap() - expected).abs() <= tol("radius"));
        }
        let answers = json["registrations"].as_array().unwrap();
        for (verdict, answer) in outcome.verdicts[1..].iter().zip(answers) {
            let registration = verdict.registration.as_ref().unwrap();
            for (i, row) in registration.rotation.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    assert!((value - answer["R"][i][j].as_f64().unwrap()).abs() <= tol("R"));
                }
                let t = answer["t"][i].as_f64().unwrap();
                assert!((registration.translation_mm[i] - t).abs() <= tol("t"));
            }
            assert!(verdict.correction.is_some());
        }
    }
}

/// Changes the points of one block of the third clamping and gives that
/// clamping's verdict; the others must not be touched by it.
fn third_clamping(sphere: usize, change: impl Fn(&mut Vec<[f64; 3]>)) -> String {
    let mut blocks = session_a();
    change(&mut blocks[6 + sphere - 1].1);
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary.len(), 5, "{summary:?}");
    for other in [0, 1, 3, 4] {
        assert_eq!(summary[other], "OK");
    }
    summary[2].clone()
}

/// ERRATA: a wrong Z hit leaves no residual in a five-point block; the side
/// hits, driven to the centre's height, tell.
#[test]
fn wrong_z_hit_is_named() {
    for sphere in 1..=3 {
        for error_mm in [0.008, -0.008, 0.03, -0.06, 0.2, -0.5, 3.0] {
            let verdict = third_clamping(sphere, |points| points[0][2] += error_mm);
            assert!(
                verdict.contains(&format!("SPHERE{sphere}:lone_hit_offset")),
                "{verdict}"
            );
        }
    }
}

/// Where the side hits were driven to the height of the wrong Z hit, nothing
/// in the block shows it; the tilt of the plate does.
#[test]
fn wrong_z_that_moves_the_whole_block_shows_as_tilt() {
    for sphere in 1..=3 {
        for error_mm in [0.12, -0.12, 0.18] {
            let verdict = third_clamping(sphere, |points| {
                for point in points {
                    point[2] += error_mm;
                }
            });
            assert!(
                verdict.contains("tilt"),
                "sphere {sphere} {error_mm}: {verdict}"
            );
        }
    }
}

/// A missed measurement printed as zeros, anywhere in the block.
#[test]
fn null_point_is_named() {
    for hit in 0..5 {
        let verdict = third_clamping(2, |points| points[hit] = [0.0; 3]);
        assert_eq!(verdict, "SPHERE2:null_point");
    }
}

/// A lost sign in any coordinate is named with hit and axis.
#[test]
fn lost_sign_is_named() {
    for hit in 0..5 {
        for axis in 0..3 {
            let mut blocks = session_a();
            blocks[6].1[hit][axis] *= -1.0;
            let outcome = run_blocks(job(), &blocks);
            let reasons = &outcome.verdicts[2].reasons;
            // The top hit's Z moves only the centre (no residual): named as lone hit.
            let lone = outcome.summary()[2].contains("lone_hit_offset");
            let sign = reasons.iter().any(|r| {
                r.reason
                    == umi_protocol::reason::Reason::SuspectSign {
                        hit: u16::try_from(hit + 1).unwrap(),
                        axis: u8::try_from(axis).unwrap(),
                    }
            });
            assert!(sign || lone, "hit {hit} axis {axis}: {reasons:?}");
            assert!(!outcome.verdicts[2].ok);
        }
    }
}

/// All signs of a block lost: a perfect sphere at a wrong place.
#[test]
fn all_signs_of_a_block_lost_shows_in_the_distances() {
    let verdict = third_clamping(1, |points| {
        for point in points {
            *point = point.map(f64::abs);
        }
    });
    assert!(!verdict.is_empty() && verdict != "OK", "{verdict}");
}

/// A repeated line instead of the next point: four points that fit perfectly.
#[test]
fn repeated_point_is_named() {
    for hit in 1..5 {
        let verdict = third_clamping(3, |points| points[hit] = points[hit - 1]);
        assert_eq!(verdict, "SPHERE3:duplicate_point");
    }
}

/// A homing error of 0.18 mm in Z (Sawula 2013, section 5.2) moves the whole
/// setup and leaves no residual; the limit on the shift names it.
#[test]
fn datum_off_in_z_is_named() {
    let mut blocks = session_a();
    for (_, points) in &mut blocks[9..12] {
        for point in points {
            point[2] += 0.18;
        }
    }
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary, ["OK", "OK", "OK", "shift", "OK"]);
}

/// Spheres 2 and 3 exchanged: at different heights the distances show it.
#[test]
fn exchanged_spheres_are_named() {
    let mut blocks = session_a();
    let (two, three) = (blocks[4].1.clone(), blocks[5].1.clone());
    blocks[4].1 = three;
    blocks[5].1 = two;
    let outcome = run_blocks(job(), &blocks);
    let summary = outcome.summary();
    assert!(summary[1].contains("distance_error"), "{summary:?}");
    assert!(summary[1].contains("suspect_exchange"), "{summary:?}");
    assert_eq!(summary[2], "OK");
}

/// With all balls at one height and equal legs the exchanged setup has hardly
/// a residual: it seems turned over. The limits on the pose name it.
#[test]
fn exchanged_spheres_at_one_height_are_named_by_the_pose() {
    let mut blocks = session_a();
    for block in &mut blocks {
        if block.0 == "SPHERE2" {
            for point in &mut block.1 {
                point[2] += 25.67;
            }
        }
    }
    let (two, three) = (blocks[4].1.clone(), blocks[5].1.clone());
    blocks[4].1 = three;
    blocks[5].1 = two;
    let mut job = job();
    // Legs of 273.014 and 273.041 mm: the distances alone must not decide here.
    job.limits.distance_error_mm = 0.1;
    job.limits.registration_rms_mm = 0.1;
    let summary = run_blocks(job, &blocks).summary();
    assert!(!summary[1].contains("distance_error"), "{summary:?}");
    assert!(!summary[1].contains("registration_rms"), "{summary:?}");
    assert!(summary[1].contains("tilt"), "{summary:?}");
    assert!(summary[1].contains("suspect_exchange"), "{summary:?}");
}

/// Whichever block is lost, its clamping is NG and no other: blocks never
/// move into the wrong clamping.
#[test]
fn a_lost_block_spoils_its_clamping_only() {
    for lost in 3..15 {
        let mut blocks = session_a();
        let (name, _) = blocks.remove(lost);
        let outcome = run_blocks(job(), &blocks);
        let summary = outcome.summary();
        assert_eq!(summary.len(), 5, "{summary:?}");
        for (clamping, verdict) in summary.iter().enumerate() {
            if clamping == lost / 3 {
                assert!(verdict.contains("missing_feature"), "{name}: {verdict}");
            } else {
                assert_eq!(verdict, "OK");
            }
        }
    }
}

/// A block that is printed twice is counted once.
#[test]
fn an_unchanged_repeat_is_dropped() {
    for repeated in 0..15 {
        let mut blocks = session_a();
        let again = blocks[repeated].clone();
        blocks.insert(repeated + 1, again);
        let outcome = run_blocks(job(), &blocks);
        assert_eq!(outcome.summary(), ["OK"; 5], "{repeated}");
        assert_eq!(outcome.features.len(), 15);
    }
}

/// A refused block that is probed again is replaced, and the verdict says so;
/// the last block's setup is judged again under its number.
#[test]
fn a_refused_block_may_be_probed_again() {
    for bad in 0..15 {
        let mut blocks = session_a();
        let mut spoilt = blocks[bad].clone();
        spoilt.1[1] = [0.0; 3];
        blocks.insert(bad, spoilt);
        let outcome = run_blocks(job(), &blocks);
        let last: Vec<_> = (0..5)
            .map(|setup| outcome.verdicts.iter().rfind(|v| v.setup == setup).unwrap())
            .collect();
        assert!(last.iter().all(|v| v.ok), "{bad}: {:?}", outcome.summary());
        let remark = &last[bad / 3].remarks;
        assert!(
            remark.iter().any(|r| r.reason.code() == "replaced"),
            "{remark:?}"
        );
        assert_eq!(outcome.features.len(), 16);
    }
}

/// The same feature twice with different coordinates: nobody knows which.
#[test]
fn a_contradicting_repeat_is_ng() {
    let mut blocks = session_a();
    let mut again = blocks[4].clone();
    again.1[1][0] += 0.002;
    blocks.insert(5, again);
    let summary = run_blocks(job(), &blocks).summary();
    assert!(summary[1].contains("conflicting_repeat"), "{summary:?}");
    assert_eq!(summary[2], "OK");
}

/// Two opposite hits exchanged leave fit and pose as they are; the approaches
/// say that the hits are not those that the job means.
#[test]
fn exchanged_hits_are_named() {
    let verdict = third_clamping(2, |points| points.swap(3, 4));
    assert_eq!(verdict, "SPHERE2:approach_angle");
}

/// Fewer or more points than the job asks for.
#[test]
fn counts_must_agree() {
    let four = third_clamping(1, |points| {
        points.pop();
    });
    assert_eq!(four, "SPHERE1:missing_points");

    let mut blocks = session_a();
    let extra = [
        blocks[6].1[0][0] + 1.0,
        blocks[6].1[0][1],
        blocks[6].1[0][2],
    ];
    blocks[6].1.push(extra);
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &blocks {
        let announced = u16::try_from(points.len()).unwrap();
        feed(&mut run, &mut outcome, name, points, announced);
    }
    assert_eq!(outcome.summary()[2], "SPHERE1:wrong_count");
}

/// A damaged first setup is not taught, and says that there is no reference.
#[test]
fn a_bad_setup_is_never_taught() {
    let mut blocks = session_a();
    blocks[1].1[2] = [0.0; 3];
    let outcome = run_blocks(job(), &blocks);
    let summary = outcome.summary();
    assert_eq!(summary[0], "SPHERE2:null_point no_reference");
    assert_eq!(summary[1], "OK");
    assert_eq!(outcome.taught, 1);
    assert_eq!(outcome.verdicts[1].correction, None);
}

/// An unfinished setup is given up after the job's time-out, once.
#[test]
fn an_unfinished_setup_times_out() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &session_a()[..2] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    let due = run.deadline().unwrap();
    run.on_time(Micros(due.0 - 1), &mut |d| outcome.take(d));
    assert!(outcome.verdicts.is_empty());
    run.on_time(due, &mut |d| outcome.take(d));
    assert_eq!(
        outcome.summary(),
        ["timed_out missing_feature no_reference"]
    );
    assert_eq!(run.deadline(), None);
}

/// Given nominals: the setup is registered at once.
#[test]
fn given_nominals_register_the_first_setup() {
    let mut job = job();
    job.reference = Reference::Given;
    let positions = [
        [-135.018, -136.624, 135.91],
        [137.989, -134.678, 110.253],
        [-136.711, 136.412, 136.121],
    ];
    for (feature, position) in job.features.iter_mut().zip(positions) {
        feature.position_mm = Some(position);
    }
    let outcome = run_blocks(job, &session_a()[3..6]);
    assert_eq!(outcome.summary(), ["OK"]);
    let registration = outcome.verdicts[0].registration.as_ref().unwrap();
    assert!((registration.angle_deg - 1.0).abs() < 0.001);
}

/// Compensation on the board gives the same spheres as compensation in the
/// macro: tip radius less pretravel along the motion.
#[test]
fn compensation_on_the_board() {
    let mut job = job();
    let (tip_radius_mm, pretravel_mm) = (2.5, [0.062, 0.062, 0.0]);
    job.compensation = Compensation::OnBoard {
        tip_radius_mm,
        pretravel_mm,
    };
    let mut blocks = session_a();
    for (_, points) in &mut blocks {
        // Back from contact points to skip positions of the tip's centre.
        let side = tip_radius_mm - 0.062;
        points[0][2] += tip_radius_mm;
        points[1][0] += side;
        points[2][0] -= side;
        points[3][1] += side;
        points[4][1] -= side;
    }
    let outcome = run_blocks(job.clone(), &blocks);
    let reference = run_blocks(super::tests::job(), &session_a());
    assert_eq!(outcome.summary(), ["OK"; 5]);
    for (one, other) in outcome.features.iter().zip(&reference.features) {
        let position = |f: &FeatureResult| f.fit.as_ref().unwrap().shape.position_mm().unwrap();
        for (a, b) in position(one).iter().zip(position(other)) {
            assert!((a - b).abs() < 1e-9);
        }
    }
    // Without directions nothing can be compensated.
    job.correction = None;
    for feature in &mut job.features {
        feature.approach.clear();
    }
    let summary = run_blocks(job, &blocks).summary();
    assert!(summary[0].contains("no_approach"), "{summary:?}");
}

/// The correction is refused when the tilt left over is beyond the limit.
#[test]
fn uncorrected_error_beyond_the_limit_is_ng() {
    let mut job = job();
    job.correction.as_mut().unwrap().leftover_mm = 0.0005;
    let summary = run_blocks(job, &session_a()).summary();
    assert_eq!(
        summary,
        ["OK", "leftover", "leftover", "leftover", "leftover"]
    );
}

/// Jobs that could surprise later are refused by the name of the field.
#[test]
fn bad_jobs_are_refused() {
    type Change = fn(&mut Job);
    let cases: Vec<(&str, Change)> = vec![
        ("bad_name", |j| j.name.clear()),
        ("no_patterns", |j| j.receiver.patterns.clear()),
        ("bad_value", |j| j.receiver.idle_timeout_s = 0),
        ("no_features", |j| j.features.clear()),
        ("duplicate_feature", |j| {
            j.features[1].name = j.features[0].name.clone();
        }),
        ("bad_feature_name", |j| {
            j.features[0].name = "A B".try_into().unwrap();
        }),
        ("hit_count", |j| j.features[0].hits = 3),
        ("hit_count", |j| j.features[0].hits = 65),
        ("approach_count", |j| j.features[0].hits = 6),
        // Nothing is touched again.
        ("bad_value", |j| {
            j.again = Some(umi_protocol::job::AgainSpec { within_mm: 0.008 });
        }),
        // It is touched again, and nothing is held against it.
        ("missing", |j| {
            j.features[0].hits = 6;
            let _ = j.features[0].approach.push(Approach::MinusZ);
        }),
        ("missing", |j| j.reference = Reference::Given),
        ("missing", |j| j.features[0].radius_mm = None),
        ("bad_value", |j| j.features[0].radius_mm = Some(f64::NAN)),
        ("bad_value", |j| j.limits.rms_mm = 0.0),
        ("bad_value", |j| j.limits.shift_mm[2] = -1.0),
        ("bad_value", |j| j.limits.approach_deg = Some(f64::NAN)),
        ("bad_value", |j| j.plate_timeout_s = 0),
        ("bad_value", |j| {
            j.compensation = Compensation::OnBoard {
                tip_radius_mm: 1.0,
                pretravel_mm: [0.0, 2.0, 0.0],
            };
        }),
        ("bad_value", |j| {
            j.correction.as_mut().unwrap().program_number = 0;
        }),
        ("bad_value", |j| {
            j.correction.as_mut().unwrap().part_max_mm[1] = -100.0;
        }),
        ("same_offset", |j| {
            j.correction.as_mut().unwrap().write_to = WorkOffset::G54;
        }),
        ("unnamed_features", |j| {
            let _ = j.receiver.patterns.push(LinePattern::GrblProbe);
        }),
        ("hit_count", |j| {
            j.features[0].hits = 4;
            j.features[0].approach.pop();
        }),
        ("missing", |j| j.limits.approach_deg = None),
        ("missing", |j| j.features[2].approach.clear()),
        ("too_few_datums", |j| {
            j.features.pop();
        }),
        ("degenerate_reference", |j| {
            j.reference = Reference::Given;
            for (x, feature) in [0.0, 1.0, 2.0].into_iter().zip(&mut j.features) {
                feature.position_mm = Some([x, 0.0, 0.0]);
            }
        }),
    ];
    type Spoil = fn(&mut WitnessSpec);
    let witnessed: Vec<(&str, Spoil)> = vec![
        ("bad_value", |w| w.counts_per_mm[1] = 0.0),
        ("bad_value", |w| w.origin_counts = Some([f64::NAN; 3])),
        ("bad_value", |w| w.delay_ms = -1.0),
        ("bad_value", |w| w.tolerance_mm = 0.0),
        ("bad_value", |w| w.feed_mm_per_min = Some(0.0)),
    ];
    for (code, change) in witnessed {
        let mut job = checked_job();
        change(job.witness.as_mut().unwrap());
        assert_eq!(check(&job).expect_err(code).code(), code);
    }
    let mut blocks = checked_job();
    blocks.receiver = job().receiver;
    assert_eq!(check(&blocks), Err(JobError::WitnessPairing));
    let mut compensated = checked_job();
    compensated.compensation = Compensation::InMacro;
    assert_eq!(check(&compensated), Err(JobError::WitnessCompensation));
    for (code, change) in cases {
        let mut job = job();
        change(&mut job);
        let error = check(&job).expect_err(code);
        assert_eq!(error.code(), code, "{error}");
        assert!(error.to_string().len() > 20);
    }
    assert_eq!(check(&job()), Ok(()));
}

/// A setup that is printed again to the last digit was not measured again.
#[test]
fn a_setup_printed_again_is_ng() {
    let mut blocks = session_a()[..6].to_vec();
    blocks.extend_from_within(3..6);
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary, ["OK", "OK", "repeated_plate"]);
}

/// Bytes that are lost before a setup's first feature are held against that
/// setup, and against no other.
#[test]
fn a_loss_between_setups_concerns_the_next_one() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (at, (name, points)) in session_a().iter().enumerate() {
        if at == 6 {
            let lost = FaultKind::BufferOverrun { lost: 20 };
            run.fault(&lost, &mut |d| outcome.take(d));
        }
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert_eq!(outcome.summary(), ["OK", "OK", "bytes_lost", "OK", "OK"]);
}

/// A point too many behind a block takes its verdict back.
#[test]
fn a_surplus_point_revokes_the_verdict() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &session_a()[..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    let surplus = FaultKind::BlockCountMismatch {
        expected: 5,
        got: 6,
    };
    run.fault(&surplus, &mut |d| outcome.take(d));
    assert_eq!(outcome.summary(), ["OK", "OK", "wrong_count"]);
    assert_eq!(outcome.verdicts[1].setup, outcome.verdicts[2].setup);
}

/// Checked lines of another run never complete the setup of the run before.
#[test]
fn another_run_is_another_setup() {
    let mut job = job();
    for (id, feature) in (1..).zip(&mut job.features) {
        feature.id = Some(id);
    }
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    let mut send = |blocks: &[Block], first_id: u16, of_run: u32| {
        for (id, (_, points)) in (first_id..).zip(blocks) {
            for point in points {
                let mut hit = hit(*point);
                (hit.feature_id, hit.run) = (Some(id), Some(of_run));
                run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
            }
        }
    };
    let blocks = session_a();
    send(&blocks[..3], 1, 1);
    // Two spheres in run 2, the third of another clamping in run 3.
    send(&blocks[3..5], 1, 2);
    send(&blocks[8..9], 3, 3);
    send(&blocks[9..12], 1, 4);
    assert_eq!(
        outcome.summary(),
        [
            "OK",
            "run_changed missing_feature",
            "run_changed missing_feature missing_feature",
            "OK"
        ]
    );
}

/// A job for checked lines of skip positions, with the encoders as second witness.
fn checked_job() -> Job {
    let mut job = job();
    job.receiver.patterns.clear();
    let checked = LinePattern::Checked(CheckedPattern::default());
    let _ = job.receiver.patterns.push(checked);
    for (id, feature) in (1..).zip(&mut job.features) {
        feature.id = Some(id);
    }
    job.compensation = Compensation::OnBoard {
        tip_radius_mm: 2.5,
        pretravel_mm: [0.062, 0.062, 0.0],
    };
    job.witness = Some(WitnessSpec {
        counts_per_mm: [1000.0; 3],
        origin_counts: None,
        feed_mm_per_min: None,
        delay_ms: 4.0,
        tolerance_mm: 0.003,
    });
    job
}

/// With a second witness asked for, a setup is OK where the encoders agree, NG where
/// they do not, and NG where a skip edge was not latched.
#[test]
fn second_witness_decides() {
    let approaches = job().features[0].approach.clone();
    // What is wrong with the latches of the second setup.
    let second_plate = |fault: Option<f64>, bounces: u64| {
        let mut job = checked_job();
        // The signal comes 40 us late: at 30 mm/min the axes move 20 nm meanwhile.
        job.skip.delay_us = 40.0;
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        let mut t_ns = 0;
        for (at, (_, points)) in session_a()[..6].iter().enumerate() {
            for (point, approach) in points.iter().zip(&approaches) {
                let (axis, sign) = approach.axis_and_sign();
                let mut tip = *point;
                tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
                let moved = if at >= 3 { fault } else { Some(0.0) };
                if let Some(moved) = moved {
                    let counts = tip.map(|mm| libm::round((mm + moved) * 1000.0) as i64);
                    t_ns += 1_000_000_000;
                    // Each bounce is latched further on the machine's way: 0.05 mm beside.
                    for bounce in 0..=bounces {
                        let beside = if bounce == 0 { 0 } else { 50 };
                        let counts = counts.map(|count| count + beside);
                        let begin_ns = t_ns + bounce * 900_000;
                        let ends =
                            (bounces > 0).then_some((LatchCause::SkipEnd, begin_ns + 10_000));
                        for (cause, t_ns) in [(LatchCause::Skip, begin_ns)].into_iter().chain(ends)
                        {
                            run.latched(&LatchReport {
                                number: 0,
                                cause,
                                counts: counts.into_iter().collect(),
                                t_ns,
                                missed: 0,
                            });
                        }
                    }
                }
                let mut hit = hit(tip);
                hit.feature_id = Some(u16::try_from(at % 3 + 1).unwrap());
                hit.approach = Some(*approach);
                hit.feed_mm_per_min = Some(30.0);
                run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
            }
        }
        outcome
    };
    let agreeing = second_plate(Some(0.0), 0);
    assert_eq!(agreeing.summary(), ["OK", "OK"]);
    let remarks =
        |v: &Verdict| -> Vec<&str> { v.remarks.iter().map(|r| r.reason.code()).collect() };
    assert_eq!(
        remarks(&agreeing.verdicts[0]),
        ["taught", "witnessed", "witness_learned", "not_guarded"]
    );
    assert_eq!(remarks(&agreeing.verdicts[1]), ["witnessed", "not_guarded"]);
    // A probe that bounces: each touch is its first edge, and the rest is counted.
    let bouncing = second_plate(Some(0.0), 5);
    assert_eq!(bouncing.summary(), ["OK", "OK"]);
    assert_eq!(
        remarks(&bouncing.verdicts[1]),
        ["witnessed", "skip_chatter", "not_guarded"]
    );
    let told = bouncing.verdicts[1].remarks.iter().map(|r| &r.reason);
    let chatter = Reason::SkipChatter {
        bounces: 15 * 5,
        sparks: 0,
    };
    assert!(told.into_iter().any(|reason| *reason == chatter));
    let moved = second_plate(Some(0.05), 0);
    assert_eq!(
        moved.summary(),
        ["OK", "witness_shift witness_shift witness_shift"]
    );
    let blind = second_plate(None, 0).summary();
    assert!(blind[1].contains("SPHERE1:not_latched"), "{blind:?}");
}

/// A setup that taught the reference and is contradicted afterwards takes it back: the
/// next good setup is the reference.
#[test]
fn a_revoked_setup_is_no_reference() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    let blocks = session_a();
    for (name, points) in &blocks[..3] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert!(run.taught().is_some());
    let surplus = FaultKind::BlockCountMismatch {
        expected: 5,
        got: 6,
    };
    run.fault(&surplus, &mut |d| outcome.take(d));
    assert_eq!(run.taught(), None);
    assert_eq!(outcome.taught, 2, "taught, and taken back");
    let revoked = &outcome.verdicts[1];
    assert!(revoked.remarks.iter().all(|r| r.reason != Reason::Taught));
    for (name, points) in &blocks[3..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert_eq!(outcome.summary(), ["OK", "wrong_count", "OK"]);
    // It is the reference now, so there is nothing to correct.
    assert_eq!(outcome.verdicts[2].correction, None);
    assert_eq!(outcome.taught, 3);
}

/// Lines printed again without a touch have no latches: a repeat of what is known, not
/// a contradiction of it.
#[test]
fn a_repeat_without_latches_is_dropped() {
    let mut job = checked_job();
    job.correction = None;
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    let mut t_ns = 0;
    let approaches = super::tests::job().features[0].approach.clone();
    let blocks = session_a();
    for (at, (_, points)) in blocks[..3].iter().chain(&blocks[2..3]).enumerate() {
        for (point, approach) in points.iter().zip(&approaches) {
            let (axis, sign) = approach.axis_and_sign();
            let mut tip = *point;
            tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
            if at < 3 {
                let counts = tip.map(|mm| libm::round(mm * 1000.0) as i64);
                t_ns += 1_000_000_000;
                run.latched(&LatchReport {
                    number: 0,
                    cause: LatchCause::Skip,
                    counts: counts.into_iter().collect(),
                    t_ns,
                    missed: 0,
                });
            }
            let mut hit = hit(tip);
            hit.feature_id = Some(u16::try_from(at.min(2) + 1).unwrap());
            hit.approach = Some(*approach);
            hit.feed_mm_per_min = Some(30.0);
            run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
        }
    }
    assert_eq!(outcome.summary(), ["OK"]);
}

/// A line that no control has, and seven bits without their parity, are refused by name.
#[test]
fn lines_are_checked() {
    use umi_protocol::serial::{LineFamily, LineSpec};
    let with = |line: LineSpec, coding| {
        let mut job = job();
        job.line = line;
        job.receiver.coding = coding;
        crate::job::check(&job)
    };
    let any = LineSpec::default();
    let auto = umi_protocol::pattern::Coding::Auto;
    for control in LineFamily::ALL {
        assert_eq!(with(LineSpec { control, ..any }, auto), Ok(()));
    }
    let field = |line| match with(line, auto) {
        Err(JobError::BadValue { field, .. }) => field.name(),
        other => panic!("{other:?}"),
    };
    for baud in [0, 299, 230_401] {
        let baud = Some(baud);
        assert_eq!(field(LineSpec { baud, ..any }), "line.baud");
    }
    for bits in [0, 5, 6, 9] {
        let data_bits = Some(bits);
        assert_eq!(field(LineSpec { data_bits, ..any }), "line.data_bits");
    }
    for bits in [0, 3] {
        let stop_bits = Some(bits);
        assert_eq!(field(LineSpec { stop_bits, ..any }), "line.stop_bits");
    }
    let fanuc = LineSpec {
        control: LineFamily::Fanuc,
        ..any
    };
    let ascii = umi_protocol::pattern::Coding::Ascii;
    assert_eq!(with(fanuc, ascii), Err(JobError::ParityMissing));
}
