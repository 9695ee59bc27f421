//! What is on the screen, and that every size of it can be drawn.

use super::*;
use crate::watch::view::Link;
use umi_client::axes::Scale;
use umi_protocol::latch::{LatchCounters, Positions};
use umi_protocol::line::HitReport;
use umi_protocol::message::{
    AccessMode, Identity, Status, TeachBy, TeachPending, TeachSetup, TeachWhat,
};

fn view(scaled: bool) -> View {
    let name = |text: &str| text.try_into().unwrap();
    let text = include_str!("../../../../../examples/three-spheres-witnessed.toml");
    let job = umi_client::files::job_file::parse(text).unwrap();
    View {
        identity: Identity {
            board: name("pico"),
            serial: name("0042"),
            firmware: name("0.1.0"),
        },
        link: Link {
            gone: None,
            answer: Duration::from_micros(1500),
            damaged: 0,
            events_lost: 0,
            reconnected: 0,
        },
        status: Status {
            uptime_us: 3_725_250_000,
            reset: ResetReason::PowerOn,
            job: Some(job.name.clone()),
            job_lost: None,
            has_reference: false,
            teaching: None,
            verdicts: 3,
            verdicts_ok: 2,
            last_verdict_ok: Some(false),
            correction_waiting: false,
            punched_lines: None,
            counters: Default::default(),
            events_dropped: 0,
            journal_failures: 0,
            link_damaged: 0,
            latches: LatchCounters {
                missed: 77,
                ..LatchCounters::default()
            },
            access: AccessMode::Open,
        },
        positions: Positions {
            counts: [-1_234_567, 50_000, 0, 12].into_iter().collect(),
            t_ns: 1_000_000_000,
            illegal: [0; 4].into_iter().collect(),
            lost_samples: 0,
        },
        feed_mm_per_min: None,
        scale: Scale::of(scaled.then_some(&job)),
        hits: [HitReport {
            line: 1,
            t_us: 1,
            feature: Some(name("SPHERE1")),
            position_mm: [1.0, -2.5, 3.0],
            approach: Some(umi_protocol::job::Approach::MinusZ),
            feed_mm_per_min: Some(300.0),
        }]
        .into(),
        latch: None,
        skip: Default::default(),
        verdict: None,
        sent: None,
        sends: true,
    }
}

/// How wide the latest touch was stands among the board's figures, and under the verdict that its line rests where
/// the job has a touch.
#[test]
fn the_width_of_a_touch_and_a_wrong_level_are_shown() {
    use umi_protocol::latch::{LatchCause, LatchReport};
    let mut view = view(true);
    assert!(text(&view, 120).contains("latest touch        width not told"));
    for number in 0..8 {
        let (cause, t_ms) = match number % 2 {
            0 => (LatchCause::SkipEnd, 1000 + 1500 * u64::from(number)),
            _ => (LatchCause::Skip, 1030 + 1500 * u64::from(number - 1)),
        };
        view.skip.edge(&LatchReport {
            number,
            cause,
            counts: [0; 3].into_iter().collect(),
            t_ns: t_ms * 1_000_000,
            missed: 0,
        });
    }
    let shown = text(&view, 120);
    assert!(
        shown.contains("latest touch        2970.000 ms wide"),
        "{shown}"
    );
    let said = "skip line       the skip line rests at high, by what it has shown; set `[skip]` `active = \"low\"`";
    assert!(shown.contains(said), "{shown}");
}

/// An OK is shown as one as long as it counts: its correction may have gone out, or been taken
/// back by what was printed since, and its reference may be forgotten.
#[test]
fn an_ok_that_was_taken_back_is_none() {
    let mut view = view(true);
    let correction = umi_protocol::verdict::CorrectionReport {
        dialect: umi_protocol::job::Dialect::G10G68,
        text: heapless::String::new(),
        leftover_mm: 0.0,
    };
    let name = |text: &str| text.try_into().unwrap();
    let distance = umi_protocol::verdict::DistanceReport {
        a: name("SPHERE1"),
        b: name("SPHERE2"),
        measured_mm: 200.0,
        reference_mm: Some(200.0),
    };
    view.verdict = Some(umi_protocol::verdict::Verdict {
        setup: 4,
        ok: true,
        reasons: [].into_iter().collect(),
        reasons_dropped: 0,
        remarks: [].into_iter().collect(),
        distances: [distance].into_iter().collect(),
        registration: None,
        correction: Some(correction),
    });
    let line = |view: &View| {
        let said = text(view, 120);
        let line = said.lines().find(|line| line.starts_with("latest verdict"));
        line.unwrap().to_owned()
    };
    // Whose the board is stands before it.
    assert!(line(&view).starts_with("latest verdict  open board, "));
    view.status.access = AccessMode::Claimed;
    assert!(!line(&view).contains("open"), "{}", line(&view));
    (view.status.has_reference, view.status.correction_waiting) = (true, true);
    let waits = line(&view);
    assert!(
        !waits.contains("waits no more") && !waits.contains("went out"),
        "{waits}"
    );
    assert_eq!(view.json()["verdict"]["correction_is"], "waits");
    view.status.correction_waiting = false;
    let gone = line(&view);
    assert!(
        gone.contains("its correction waits no more: READ gets an alarm (it was "),
        "{gone}"
    );
    assert_eq!(view.json()["verdict"]["correction_is"], "gone");
    view.sent = Some(3);
    assert_eq!(line(&view), gone);
    view.sent = Some(4);
    assert!(
        line(&view).contains("; its correction went out"),
        "{}",
        line(&view)
    );
    view.sends = false;
    assert_eq!(line(&view), waits);
    view.status.has_reference = false;
    let forgotten = line(&view);
    assert!(
        forgotten.contains("the reference is forgotten: NG until another"),
        "{forgotten}"
    );
    assert_eq!(view.json()["verdict"]["reference_forgotten"], true);
}

/// Plain text has a line for each axis, in millimetres where the job says how, and
/// everything else that is known.
#[test]
fn text_says_everything() {
    let said = text(&view(true), 120);
    for words in [
        "board pico 0042, firmware 0.1.0",
        "X  -123.4567 mm",
        "Y     5.0000 mm",
        "W         12 counts",
        "missed latches      77",
        "answers in          1.5 ms",
        "1:02:05.2",
        "2 OK, 1 NG",
        "SPHERE1",
        "-2.5000",
        "-z  F300",
    ] {
        assert!(said.contains(words), "no {words:?} in\n{said}");
    }
    let counts = text(&view(false), 60);
    assert!(counts.contains("X   -1234567 counts"), "{counts}");
    assert!(counts.contains("does not say how many counts"));
}

/// A teaching that was asked for is told, until it has happened.
#[test]
fn a_pending_teaching_is_told() {
    let mut view = view(true);
    assert!(!text(&view, 120).contains("to be taught"));
    view.status.teaching = Some(TeachPending {
        by: TeachBy::Button,
        what: TeachWhat::Reference,
        t_us: view.status.uptime_us - 3_661_500_000,
        setup: TeachSetup::Next,
    });
    let said = text(&view, 120);
    let line = "to be taught    the setup that comes next is to be the reference: \
                the board's button asked 1:01:01 ago";
    assert!(said.contains(line), "{said}");
    assert_eq!(view.json()["status"]["teaching"]["by"], "button");
    assert_eq!(view.json()["status"]["teaching"]["setup"], "next");
}

/// A program that is punched and does not end is said in the verdict's place.
#[test]
fn a_program_that_does_not_end_is_told() {
    let mut view = view(true);
    assert!(!text(&view, 120).contains("punch"));
    view.status.punched_lines = Some(40);
    let said = text(&view, 120);
    let line = "latest verdict  none: the control seems to punch a program (40 lines); `%` or a checked line ends it";
    assert!(said.contains(line), "{said}");
    assert_eq!(view.json()["status"]["punched_lines"], 40);
}

/// The feed is the way between two positions over the time between them.
#[test]
fn feed_is_way_over_time() {
    let mut view = view(true);
    let mut next = view.positions.clone();
    // 0.3 mm and 0.4 mm in 0.1 s: 5 mm/s.
    next.counts[0] += 3000;
    next.counts[1] -= 4000;
    next.t_ns += 100_000_000;
    view.moved(next.clone());
    assert!((view.feed_mm_per_min.unwrap() - 300.0).abs() < 1e-9);
    // No time has passed, or the board has started again: nobody knows.
    view.moved(next.clone());
    assert_eq!(view.feed_mm_per_min, None);
    next.t_ns = 5;
    view.moved(next);
    assert_eq!(view.feed_mm_per_min, None);
}

/// Every terminal can be drawn on, however small; a loss is seen on a usual one; digits
/// are as large as there is room.
#[test]
fn every_size_can_be_drawn() {
    let mut view = view(true);
    view.link.gone = Some(("unplugged".into(), Duration::from_secs(3)));
    for width in (0..200).step_by(7) {
        for height in (0..70).step_by(3) {
            let area = Rect::new(0, 0, width, height);
            draw(&view, area, &mut Buffer::empty(area));
        }
    }
    let shown = |width, height| {
        let area = Rect::new(0, 0, width, height);
        let mut buffer = Buffer::empty(area);
        draw(&view, area, &mut buffer);
        let symbols = buffer.content().iter().map(|cell| cell.symbol());
        symbols.collect::<String>()
    };
    // Link and board, too, in brief where there is no room for more.
    for (width, height) in [(40, 24), (60, 24), (74, 24), (80, 24), (120, 50), (200, 70)] {
        let shown = shown(width, height);
        for said in ["1.5 ms", "THREE SPHERES W", "2 OK, 1 NG", "1:02:05.2"] {
            assert!(shown.contains(said), "no {said:?} in {width}x{height}");
        }
        assert!(shown.contains("missed latches      77"), "{width}x{height}");
        assert!(shown.contains("GONE for 3 s: unplugged"));
        assert!(shown.contains("latest verdict  none yet"));
        assert!(shown.contains("latest hit      SPHERE1"));
    }
    let area = Rect::new(0, 0, 60, 24);
    let mut buffer = Buffer::empty(area);
    help(area, &mut buffer);
    let page: String = buffer.content().iter().map(|cell| cell.symbol()).collect();
    assert!(page.contains("q, Esc, Ctrl-C  end"), "{page}");
    assert_eq!(size(&view, Rect::new(0, 0, 80, 24)), Size::Text);
    assert_eq!(size(&view, Rect::new(0, 0, 80, 30)), Size::Middle);
    assert_eq!(size(&view, Rect::new(0, 0, 120, 50)), Size::Large);
    view.positions.counts.truncate(3);
    assert_eq!(size(&view, Rect::new(0, 0, 80, 24)), Size::Middle);
}
