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
    Job, LearnedLimits, Limits, ProgramEnd, Reference, SendWhen, SkipSpec, Teach, WarmthSpec,
    WitnessSpec, WorkOffset,
};
use umi_protocol::job_error::JobError;
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel};
use umi_protocol::pattern::{BlockPattern, CheckedPattern, LinePattern, ReceiverConfig};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::*;
use crate::dprnt::{BlockEnd, Doubts, ReportedHit};
use crate::units::{Micros, Point};

mod coverage;
mod feed;
mod guards;
mod jobs;
mod named;
mod repeats;
mod taught;
mod witnessed;

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
    let end = block_end(name, points.len(), announced);
    run.block_end(&end, now, &mut |d| outcome.take(d));
}

fn block_end(name: &str, got: usize, announced: u16) -> BlockEnd {
    let got = u16::try_from(got).unwrap();
    BlockEnd {
        name: name.try_into().unwrap(),
        expected: Some(announced),
        got,
        damaged: 0,
        complete: got == announced,
        ended_by: BlockEndCause::Count,
    }
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
