//! Jobs that could surprise later are refused by the name of the field.

use super::*;

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
            j.correction.as_mut().unwrap().program_number = 8830;
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

/// Settings of the skip line that nothing looks at are refused with what would look at them.
#[test]
fn the_skip_line_needs_who_looks_at_it() {
    let with = |skip| {
        let mut job = job();
        job.skip = skip;
        match crate::job::check(&job) {
            Ok(()) => "",
            Err(JobError::Missing { field, .. }) => field.name(),
            other => panic!("{other:?}"),
        }
    };
    let each_hit = SkipSpec {
        each_hit: true,
        ..SkipSpec::default()
    };
    for (skip, missing) in [
        (each_hit, ""),
        (
            SkipSpec {
                hold_off_ms: Some(5),
                min_width_us: Some(8),
                ..each_hit
            },
            "",
        ),
        (
            SkipSpec {
                hold_off_ms: Some(5),
                ..SkipSpec::default()
            },
            "skip.each_hit",
        ),
        (
            SkipSpec {
                delay_us: 12.0,
                ..each_hit
            },
            "witness.counts_per_mm",
        ),
        // A touch takes an unread correction back, whatever judges it.
        (
            SkipSpec {
                active: SignalLevel::Low,
                ..SkipSpec::default()
            },
            "",
        ),
    ] {
        assert_eq!(with(skip), missing);
    }
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
