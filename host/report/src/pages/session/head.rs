//! The head of the page: what was done, with what, and how it went.

use umi_protocol::job::{Compensation, Job, Reference};

use crate::draw::markup::{Element, el};
use crate::draw::number::{NONE, fixed, signed, typographic, um, um_signed};
use crate::figures::{
    PointError, distance_errors, extreme, largest, point_errors, radius_error, turn_and_tilt_deg,
};
use crate::pages::session::clamping::badge;
use crate::pages::session::tables::{TableCell, judged, num, num_or, table, word};
use umi_client::session::{Session, Setup};

/// The result of a session in one sentence.
#[must_use]
pub fn result(session: &Session) -> String {
    let all = session.setups.len();
    let bad: Vec<&Setup> = session.setups.iter().filter(|s| !s.verdict.ok).collect();
    match (bad.as_slice(), all) {
        (_, 0) => "No clamping was judged.".to_owned(),
        ([], 1) => "The clamping is OK.".to_owned(),
        ([], _) => format!("All {all} clampings are OK."),
        ([first, ..], _) => {
            let why = first.verdict.reasons.first();
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            let more = if bad.len() > 1 {
                format!("; {} more are NG", bad.len() - 1)
            } else {
                String::new()
            };
            format!(
                "{} of {all} clampings OK. {} is NG{why}{more}.",
                all - bad.len(),
                first.heading()
            )
        }
    }
}

/// Title, result with its pictures, badges and facts.
pub fn header(session: &Session, result: &str, pictures: Option<Element>) -> Element {
    let class = if session.setups.iter().all(|setup| setup.verdict.ok) {
        "result"
    } else {
        "result ng"
    };
    let badges = session.setups.iter().enumerate().map(|(place, setup)| {
        el("a")
            .class(if setup.verdict.ok {
                "tile ok"
            } else {
                "tile ng"
            })
            .attr("href", format!("#setup-{place}"))
            .child(el("b").text(setup.heading()))
            .child(badge(setup.verdict.ok))
    });
    el("header")
        .child(el("h1").text(&session.title))
        .child(el("p").class(class).text(typographic(result)))
        .children(pictures)
        .child(el("p").class("lead").text(&session.about))
        .child(
            el("nav")
                .class("tiles")
                .attr("aria-label", "Verdicts")
                .children(badges),
        )
        .child(facts(session))
}

fn facts(session: &Session) -> Element {
    let job = &session.job;
    let mut lines = vec![("Job".to_string(), job_in_words(job))];
    if let Some(board) = &session.identity {
        lines.push((
            "Board".into(),
            format!(
                "{}, serial {}, firmware {}",
                board.board, board.serial, board.firmware
            ),
        ));
    }
    lines.push(("Compensation".into(), compensation(job.compensation)));
    if let Some(spec) = &job.correction {
        lines.push((
            "Correction".into(),
            format!(
                "dialect {}, probed in {}, writes {}, program O{:04}",
                spec.dialect.name(),
                spec.probed_in,
                spec.write_to,
                spec.program_number
            ),
        ));
    }
    let faults = session.faults.len();
    lines.push((
        "Line from the control".into(),
        match faults {
            0 => "nothing lost, damaged or not understood".into(),
            1 => "1 fault, listed below".into(),
            _ => format!("{faults} faults, listed below"),
        },
    ));
    lines.extend(
        session
            .facts
            .iter()
            .map(|f| (f.label.clone(), f.value.clone())),
    );
    el("dl").children(
        lines
            .iter()
            .flat_map(|(label, value)| [el("dt").text(label), el("dd").text(typographic(value))]),
    )
}

fn job_in_words(job: &Job) -> String {
    let hits: u32 = job.features.iter().map(|f| u32::from(f.hits)).sum();
    let reference = match job.reference {
        Reference::Given => "nominal positions given by the job",
        Reference::Taught => "nominal positions taught by the first good clamping",
    };
    format!(
        "{}: {} features, {hits} hits a clamping; {reference}",
        job.name,
        job.features.len()
    )
}

fn compensation(compensation: Compensation) -> String {
    match compensation {
        Compensation::InMacro => {
            "tip radius and pretravel in the macro: the lines hold contact points".into()
        }
        Compensation::OnBoard {
            tip_radius_mm,
            pretravel_mm: [x, y, z],
        } => format!(
            "on the board: tip radius {} mm, pretravel X {}, Y {}, Z {} \u{b5}m",
            fixed(tip_radius_mm, 4),
            um(x),
            um(y),
            um(z)
        ),
    }
}

/// All clampings in one table.
pub fn overview(session: &Session) -> Element {
    let with_truth = session.setups.iter().any(|p| p.truth.is_some());
    let mut headers = vec![
        "<Clamping",
        "<Verdict",
        "Radius error|\u{b5}m",
        "rms|\u{b5}m",
        "Distance error|\u{b5}m",
        "Turn|\u{b0}",
        "Tilt|\u{b0}",
        "Registration rms|\u{b5}m",
    ];
    if with_truth {
        headers.extend(["Path error, registered|\u{b5}m", "corrected|\u{b5}m"]);
    }
    headers.push("<First reason");
    let rows = session
        .setups
        .iter()
        .map(|setup| overview_row(session, setup, with_truth))
        .collect();
    let limits = &session.job.limits;
    let caption = format!(
        "Largest values of every clamping. Limits: radius error \u{b1}{}, rms {}, distance error \u{b1}{}, \
         registration rms {} \u{b5}m; turn \u{b1}{}, tilt {}\u{b0}.",
        um(limits.radius_error_mm),
        um(limits.rms_mm),
        um(limits.distance_error_mm),
        um(limits.registration_rms_mm),
        fixed(limits.rotation_deg, 3),
        fixed(limits.tilt_deg, 4),
    );
    table(&caption, &headers, rows)
}

fn overview_row(session: &Session, setup: &Setup, with_truth: bool) -> Vec<TableCell> {
    let limits = &session.job.limits;
    let latest = || {
        session
            .job
            .features
            .iter()
            .filter_map(|s| Some((s, setup.feature(&s.name)?)))
    };
    let fits = || latest().filter_map(|(s, f)| Some((s, f.fit.as_ref()?)));
    let radius = extreme(fits().filter_map(|(s, f)| radius_error(Some(s), f)));
    let rms = extreme(fits().map(|(_, f)| f.rms_mm));
    let distance = extreme(distance_errors(setup));
    let registration = setup.verdict.registration.as_ref();
    let angles = registration.map(turn_and_tilt_deg);
    let against = |value: Option<f64>, text: fn(f64) -> String, limit: f64| {
        value.map_or_else(|| num(NONE), |v| judged(text(v), v.abs() <= limit))
    };
    let mut row = vec![
        word(setup.heading()),
        if setup.verdict.ok {
            word("\u{2713} OK")
        } else {
            TableCell::ng("\u{2717} NG")
        },
        against(radius, um_signed, limits.radius_error_mm),
        against(rms, um, limits.rms_mm),
        against(distance, um_signed, limits.distance_error_mm),
        against(angles.map(|a| a.0), |v| signed(v, 4), limits.rotation_deg),
        against(angles.map(|a| a.1), |v| fixed(v, 4), limits.tilt_deg),
        against(
            registration.map(|r| r.rms_mm),
            um,
            limits.registration_rms_mm,
        ),
    ];
    if with_truth {
        let errors = setup.truth.map(|_| point_errors(session, setup));
        for of in [
            |e: &PointError| e.registration_mm,
            |e: &PointError| e.program_mm,
        ] {
            let most = errors.as_ref().and_then(|e| largest(e.iter().map(of)));
            row.push(num_or(most.map(um)));
        }
    }
    row.push(match setup.verdict.reasons.first() {
        Some(reason) => word(typographic(&reason.to_string())),
        None if setup.is_taught() => word("reference"),
        None => word(""),
    });
    row
}

/// What was lost, damaged or not understood.
pub fn faults(session: &Session) -> Element {
    let out = el("section").child(el("h2").text("Faults on the line from the control"));
    if session.faults.is_empty() {
        return out.child(el("p").text("None: nothing was lost, damaged or not understood."));
    }
    let rows = session
        .faults
        .iter()
        .map(|fault| {
            #[allow(clippy::cast_precision_loss, reason = "shown with milliseconds")]
            let seconds = fault.t_us as f64 / 1e6;
            vec![
                num(fault.line.to_string()),
                num(fault.byte_offset.to_string()),
                num(fixed(seconds, 3)),
                word(fault.code().as_str()),
                word(fault.kind.to_string()),
                word(fault.text.as_str()),
            ]
        })
        .collect();
    out.child(table(
        "Every fault with its place in the stream of bytes",
        &["Line", "Byte", "Time|s", "<Code", "<What is wrong", "<Text"],
        rows,
    ))
}
