//! What `umi scan localise --report` shows.

use crate::show::terminal::Plain;
use umi_report::pages::scan::{FigureTable, PlacedPage, html as page};
use umi_scan::localise::scans::ScanAnswer;
use umi_scan::rigid::Vec3;

/// The page on an answer; `what` the pose is of, the corners at which it is said how sure that is, and tables behind those of
/// the answer.
pub fn html(what: &str, answer: &ScanAnswer, corners: &[Vec3], more: Vec<FigureTable>) -> String {
    let located = &answer.located;
    let ok = located.reasons.is_empty();
    let t = located.motion.translation_mm;
    let c = &located.certainty;
    let three = |v: &Vec3| format!("{:.4}, {:.4}, {:.4}", Plain(v.x), Plain(v.y), Plain(v.z));
    let rotation: Vec<String> = located
        .motion
        .rotation
        .row_iter()
        .map(|row| {
            format!(
                "({:.9}, {:.9}, {:.9})",
                Plain(row[0]),
                Plain(row[1]),
                Plain(row[2])
            )
        })
        .collect();
    let mut facts = vec![
        ("pose", what.to_owned()),
        (
            "translation, mm",
            format!("{:.6}, {:.6}, {:.6}", Plain(t.x), Plain(t.y), Plain(t.z)),
        ),
        ("rotation, rows", rotation.join(" ")),
        ("points that count", located.n_used.to_string()),
        ("surface shown", format!("{:.0} %", located.overlap * 100.0)),
        ("noise", format!("{:.4} mm", located.sigma_mm)),
        ("rms", format!("{:.4} mm", located.rms_mm)),
        ("scale", super::placed::scale(c)),
        (
            "shared errors",
            format!(
                "the uncertainty is {:.1} times that of white noise",
                c.shared
            ),
        ),
    ];
    facts.extend(located.symmetries.iter().map(|s| {
        let turns = match s.order {
            0 => "at any angle".to_owned(),
            order => format!("at {order} angles"),
        };
        (
            "looks the same",
            format!("{turns} about ({})", three(&s.axis)),
        )
    }));
    let fiducials = FigureTable {
        caption: "Fiducials: rms where the common pose puts them, and their share of what holds it"
            .into(),
        heads: vec!["name", "points", "rms, mm", "share, %"],
        rows: answer
            .fiducials
            .iter()
            .map(|f| match f.motion {
                Some(_) => vec![
                    f.name.clone(),
                    f.n.to_string(),
                    format!("{:.4}", f.rms_mm),
                    format!("{:.0}", f.share * 100.0),
                ],
                None => vec![f.name.clone(), "not seen".into()],
            })
            .collect(),
    };
    let scans = FigureTable {
        caption:
            "Scans: machine from scanner, and one standard uncertainty at the scanner's origin"
                .into(),
        heads: vec!["file", "translation, mm", "u, mm"],
        rows: answer
            .scans
            .iter()
            .map(|s| {
                let u = (3..6).map(|i| s.cov[(i, i)]).sum::<f64>().max(0.0).sqrt();
                vec![
                    s.name.clone(),
                    three(&s.motion.translation_mm),
                    format!("{u:.4}"),
                ]
            })
            .collect(),
    };
    let corners = FigureTable {
        caption: "How sure the pose is at the corners: one standard uncertainty of the place"
            .into(),
        heads: vec!["corner, mm", "is at, mm", "u, mm"],
        rows: corners
            .iter()
            .map(|p| {
                let u = c.at(&located.motion, p).trace().max(0.0).sqrt();
                vec![three(p), three(&located.motion.point(p)), format!("{u:.4}")]
            })
            .collect(),
    };
    page(&PlacedPage {
        title: format!("Where it is: {what}"),
        result: if ok { "OK".into() } else { "NG".into() },
        ok,
        reasons: located.reasons.iter().map(|r| r.message.clone()).collect(),
        facts,
        tables: [fiducials, corners, scans]
            .into_iter()
            .chain(more)
            .collect(),
        points: answer
            .deviations
            .iter()
            .map(|(p, d)| ([p.x, p.y, p.z], *d))
            .collect(),
        noise_mm: located.sigma_mm,
    })
}
