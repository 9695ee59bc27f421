//! Offsets, lengths and steps of the control.

use super::*;

/// What was said of a run is not said of the next one.
#[test]
fn each_run_says_its_own_offset() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let mut run = Run::new(guarded);
    let mut outcome = Outcome::default();
    let still = Moved {
        is_rotated: false,
        tool_length_mm: 0.0,
        external: Point::from_mm(0.0, 0.0, 0.0),
    };
    let origin = Point::from_mm(0.0, 0.0, 0.0);
    let unshifted = Said::Shifted {
        offset: 1,
        by: origin,
    };
    for said in [
        Said::Frame {
            offset: 1,
            origin,
            asked_in: 0,
        },
        Said::Moved(still),
        unshifted,
    ] {
        let announced = Announced { run: 1, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    }
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
    assert_eq!(outcome.summary(), ["OK", "frame_unknown"]);
}

/// The offset in which a run is probed is held against the job.
#[test]
fn a_moved_offset_is_named() {
    let moved = |is_rotated: bool, x: f64, tool_length_mm: f64| Moved {
        is_rotated,
        tool_length_mm,
        external: Point::from_mm(x, 0.0, 0.0),
    };
    let still = moved(false, 0.5, 81.5);
    let shifted = |offset: u16, x: f64| Said::Shifted {
        offset,
        by: Point::from_mm(x, 0.0, 0.0),
    };
    let frame = |offset: u16, x: f64, moved: Option<Moved>| {
        let mut guarded = with_ids(job());
        guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
            .into_iter()
            .collect();
        guarded.guards.frame = true;
        guarded.guards.external_mm = [0.5, 0.0, 0.0];
        guarded.guards.tool_length_mm = Some(81.5);
        check(&guarded).unwrap();
        let mut run = Run::new(guarded);
        let mut outcome = Outcome::default();
        if offset > 0 {
            let origin = Point::from_mm(x, 0.0, 0.0);
            let said = Said::Frame {
                offset,
                origin,
                asked_in: 0,
            };
            let announced = Announced { run: 1, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
        if let Some(moved) = moved {
            for said in [Said::Moved(moved), shifted(offset, 0.0)] {
                let announced = Announced { run: 1, said };
                run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
            }
        }
        send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
        outcome.summary().remove(0)
    };
    let also = Some(still);
    assert_eq!(frame(1, 0.0, also), "OK");
    assert_eq!(frame(1, 0.0005, also), "OK");
    assert_eq!(frame(1, -0.001, also), "offset_changed no_reference");
    assert_eq!(frame(2, 0.0, also), "other_offset no_reference");
    assert_eq!(frame(0, 0.0, also), "frame_unknown no_reference");
    assert_eq!(frame(1, 0.0, None), "frame_unknown no_reference");
    for (other, named) in [
        (moved(true, 0.5, 81.5), "rotation_active no_reference"),
        (moved(false, 0.502, 81.5), "external_offset no_reference"),
        (moved(false, 0.5, 81.6), "tool_length no_reference"),
    ] {
        assert_eq!(frame(1, 0.0, Some(other)), named);
    }
}

/// A job without a correction moves programs of G54: what its lines say of another offset, a
/// rotation or a shift is held against it. One that only measures is probed as it likes.
#[test]
fn a_program_is_carried_from_where_it_is_probed() {
    let mut free = with_ids(job());
    free.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    free.correction = None;
    let at = |x: f64| Point::from_mm(x, 0.0, 0.0);
    let verdict = |job: &Job, offset: u16, is_rotated: bool, shift: f64| {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        let moved = Moved {
            is_rotated,
            tool_length_mm: 80.0,
            external: at(0.5),
        };
        let (origin, by) = (at(12.0), at(shift));
        for said in [
            Said::Frame {
                offset,
                origin,
                asked_in: 0,
            },
            Said::Moved(moved),
            Said::Shifted { offset, by },
        ] {
            let announced = Announced { run: 1, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
        let setup = clamping(0, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup[..job.features.len()], 1);
        outcome.summary().remove(0)
    };
    assert_eq!(verdict(&free, 1, false, 0.0), "OK");
    assert_eq!(verdict(&free, 2, false, 0.0), "other_offset");
    assert_eq!(verdict(&free, 1, true, 0.0), "rotation_active");
    assert_eq!(verdict(&free, 1, false, 5.0), "shifted");
    let mut measures = free.clone();
    measures.features.pop();
    assert_eq!(verdict(&measures, 2, true, 5.0), "OK");
}

/// Coordinates that no offset explains are refused by name, whenever the run says so, and a run
/// that says nothing of it too.
#[test]
fn coordinates_that_no_offset_explains_are_named() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let at = |x: f64, z: f64| Point::from_mm(x, 0.0, z);
    let looks = |before: &[(u16, Point)], between: &[(u16, Point)]| {
        let mut run = Run::new(guarded.clone());
        let mut outcome = Outcome::default();
        let say = |run: &mut Run, outcome: &mut Outcome, said: Said| {
            let announced = Announced { run: 1, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        };
        let origin = at(0.0, 0.0);
        say(
            &mut run,
            &mut outcome,
            Said::Frame {
                offset: 1,
                origin,
                asked_in: 0,
            },
        );
        let moved = Moved {
            is_rotated: false,
            tool_length_mm: 0.0,
            external: origin,
        };
        say(&mut run, &mut outcome, Said::Moved(moved));
        for &(offset, by) in before {
            say(&mut run, &mut outcome, Said::Shifted { offset, by });
        }
        let setup = clamping(0, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup[..1], 1);
        for &(offset, by) in between {
            say(&mut run, &mut outcome, Said::Shifted { offset, by });
        }
        send(&mut run, &mut outcome, &setup[1..], 1);
        outcome.summary().remove(0)
    };
    let still = (1, at(0.0, 0.0));
    assert_eq!(looks(&[still], &[]), "OK");
    assert_eq!(looks(&[still], &[still]), "OK");
    // What four rounded numbers can make of nothing.
    assert_eq!(looks(&[(1, at(0.002, -0.002))], &[]), "OK");
    assert_eq!(looks(&[], &[]), "shift_unknown no_reference");
    for by in [at(0.003, 0.0), at(0.0, -0.003), at(40.0, 0.0)] {
        assert_eq!(looks(&[(1, by)], &[]), "shifted no_reference");
        assert_eq!(looks(&[still], &[(1, by)]), "shifted no_reference");
        // What was shifted once was, whatever it is now.
        assert_eq!(looks(&[(1, by), still], &[]), "shifted no_reference");
    }
    let other = (2, at(0.0, 0.0));
    assert_eq!(looks(&[still], &[other]), "other_offset no_reference");
}

/// The tool length in force is that of the taught run, unless the job says which; where neither
/// is known each verdict says so.
#[test]
fn another_tool_length_than_taught_is_named() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let say = |run: &mut Run, outcome: &mut Outcome, of_run: u32, tool_length_mm: f64| {
        let origin = Point::from_mm(0.0, 0.0, 0.0);
        let moved = Moved {
            is_rotated: false,
            tool_length_mm,
            external: origin,
        };
        let by = origin;
        for said in [
            Said::Frame {
                offset: 1,
                origin,
                asked_in: 0,
            },
            Said::Moved(moved),
            Said::Shifted { offset: 1, by },
        ] {
            let announced = Announced { run: of_run, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
    };
    let mut run = Run::new(guarded.clone());
    let mut outcome = Outcome::default();
    for (number, length_mm) in (0..).zip([81.5, 81.501, 81.503, 0.0]) {
        say(&mut run, &mut outcome, number + 1, length_mm);
        let setup = clamping(number as usize, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup, number + 1);
    }
    let since = "tool_length_since_taught";
    assert_eq!(outcome.summary(), ["OK", "OK", since, since]);
    let open = |verdict: &Verdict| {
        let is = |of: &umi_protocol::verdict::SetupReason| of.reason == Reason::LengthNotGuarded;
        verdict.remarks.iter().any(is)
    };
    assert!(!outcome.verdicts.iter().any(open));
    // Put back after a restart; also as an earlier firmware kept it.
    let taught = run.taught().unwrap();
    assert_eq!(taught.learned.tool_length_mm, Some(81.5));
    for (learned, named, is_open) in [
        (taught.learned.clone(), since, false),
        (
            Lessons {
                tool_length_mm: None,
                ..taught.learned.clone()
            },
            "OK",
            true,
        ),
    ] {
        let mut again = Run::new(guarded.clone());
        let mut outcome = Outcome::default();
        let places = taught.places;
        again.restore_reference(Teaching {
            places,
            learned: &learned,
        });
        say(&mut again, &mut outcome, 9, 80.0);
        send(&mut again, &mut outcome, &clamping(1, [1, 2, 3]), 9);
        assert_eq!(outcome.summary(), [named]);
        assert_eq!(open(&outcome.verdicts[0]), is_open);
    }
}

/// What a control rounds to steps of more than 10 µm is refused, also what is to be taught,
/// wherever its work offset lies; 10 µm are not.
#[test]
fn coarse_steps_are_refused() {
    let session = |step_mm: f64, beside_mm: f64| {
        let mut job = with_ids(job());
        job.limits.rms_mm = 1.0;
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            for point in blocks.iter_mut().flat_map(|(_, points)| points) {
                *point = point.map(|mm| {
                    let mm = (mm / step_mm).round() * step_mm + beside_mm;
                    // As a control prints it.
                    (mm * 1e4).round() / 1e4
                });
            }
            send(&mut run, &mut outcome, &blocks, number as u32 + 1);
        }
        outcome.summary()
    };
    for step_mm in [0.0127, 0.02, 0.025, 0.0254, 0.05] {
        for beside_mm in [0.0, 0.001, 0.0037] {
            for of in session(step_mm, beside_mm) {
                assert!(of.contains("coarse_step"), "{step_mm} {beside_mm}: {of}");
            }
        }
    }
    for step_mm in [0.01, 0.005, 0.00254, 0.002, 0.001] {
        for of in session(step_mm, 0.0) {
            assert!(!of.contains("coarse_step"), "{step_mm}: {of}");
        }
    }
}

/// A ball whose radius is whole steps fits exactly, rounded or not: no correction comes of it.
#[test]
fn coarse_steps_of_whole_radii_are_refused() {
    let session = |step_mm: f64, beside_mm: f64, printed_mm: f64| {
        let mut run = Run::new(with_ids(job()));
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            for (_, points) in &mut blocks {
                let [x, y, z] = points[0];
                let at = [x, y, z - 12.7].map(|mm| (mm / step_mm).round() * step_mm + beside_mm);
                let sides = [
                    [0.0, 0.0, 1.0],
                    [1.0, 0.0, 0.0],
                    [-1.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0],
                    [0.0, -1.0, 0.0],
                ];
                *points = sides
                    .map(|side| [0, 1, 2].map(|axis| at[axis] + 12.7 * side[axis]))
                    .map(|point| point.map(|mm| (mm / printed_mm).round() * printed_mm))
                    .to_vec();
            }
            send(&mut run, &mut outcome, &blocks, number as u32 + 1);
        }
        outcome.summary().remove(1)
    };
    for step_mm in [0.02, 0.025, 0.05, 0.1, 0.0127, 0.0254] {
        for beside_mm in [0.0, 0.0043] {
            let of = session(step_mm, beside_mm, 1e-4);
            assert!(of.contains("coarse_step"), "{step_mm} {beside_mm}: {of}");
        }
    }
    // Inches that are printed in millimetres with three decimals.
    assert!(session(0.0254, 0.0, 1e-3).contains("coarse_step"));
    assert!(!session(0.01, 0.0, 1e-3).contains("coarse_step"));
    // What is only taught is let pass: paper has such figures.
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    let mut blocks = clamping(0, [1, 2, 3]);
    for (place, (_, points)) in (0..).zip(&mut blocks) {
        let (x, y) = (100.0 * f64::from(place % 2), 100.0 * f64::from(place / 2));
        let sides = [
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        *points = sides
            .map(|[a, b, c]| [x + 12.7 * a, y + 12.7 * b, 100.0 + 12.7 * c])
            .to_vec();
    }
    send(&mut run, &mut outcome, &blocks, 1);
    assert!(
        !outcome.summary()[0].contains("coarse"),
        "{:?}",
        outcome.summary()
    );
}
