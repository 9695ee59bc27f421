//! The tables of `umi demo localise`, in the terminal and on its page.

use umi_report::pages::scan::FigureTable;

use super::{Range, Refusal, Series, Shown, Summary};
use crate::show::terminal::{BAD, GOOD, Plain, Table, paint};

/// All tables.
pub(super) fn all(shown: &Shown) -> Vec<FigureTable> {
    let mut all = vec![clampings(shown), errors(shown), spread(shown)];
    all.extend(refused(shown));
    all.extend([parameters(shown), raw(shown)]);
    all
}

/// All that the terminal shows.
pub(super) fn text(shown: &Shown) -> String {
    let mut text = String::new();
    for table in all(shown) {
        // Names stand left, and figures right.
        let left = |k: usize| table.rows.iter().all(|row| !is_figure(&row[k]));
        let columns = 0..table.heads.len();
        let alignment: String = columns.map(|k| if left(k) { '<' } else { '>' }).collect();
        let mut rows = Table::new(&alignment).titles(&table.heads);
        for row in &table.rows {
            rows.row(row.iter().map(String::as_str));
        }
        text += &format!("{}\n{rows}\n", table.caption);
    }
    let goals = "the goals: mean length 0.10 mm, bias 0.05 mm; industrial 0.010 mm";
    let refusals = shown.series.iter().filter(|s| s.is_joint());
    let refused: usize = refusals.map(|s| s.refusals.len()).sum();
    text += &if shown.ok {
        paint(GOOD, format!("within {goals}"))
    } else {
        paint(BAD, format!("NOT within {goals}"))
    };
    if refused > 0 {
        let many = if refused == 1 {
            "clamping"
        } else {
            "clampings"
        };
        text += &format!(
            "\n{}",
            paint(BAD, format!("{refused} {many} REFUSED by both corners"))
        );
    }
    text + "\n"
}

fn is_figure(cell: &str) -> bool {
    cell.parse::<f64>().is_ok()
}

fn vector(values: &[f64; 3], digits: usize) -> Vec<String> {
    values
        .iter()
        .map(|value| format!("{:+.digits$}", Plain(*value)))
        .collect()
}

/// In the place of a figure.
fn refusal(code: &str) -> String {
    format!("REFUSED: {code}")
}

const HEADS: [&str; 10] = [
    "test",
    "by",
    "X, mm",
    "Y, mm",
    "Z, mm",
    "about X, deg",
    "Y",
    "Z",
    "u, mm",
    "probed, mm",
];

/// Table 4.
fn clampings(shown: &Shown) -> FigureTable {
    let mut rows = Vec::new();
    for (number, printed) in super::TABLE_4.iter().enumerate() {
        let mut row = vec![(number + 1).to_string(), "paper".to_owned()];
        row.extend(vector(&printed.error_mm().into(), 2));
        row.extend(vector(&printed.error_deg().into(), 1));
        row.extend([String::new(), String::new()]);
        rows.push(row);
        for name in ["scanner", "industrial"] {
            let Some(of) = shown.series.iter().find(|s| s.name == name) else {
                continue;
            };
            let mut row = vec![String::new(), name.to_owned()];
            if let Some(why) = of.refusals.iter().find(|r| r.clamping == number + 1) {
                row.push(refusal(why.code));
                row.resize(HEADS.len(), String::new());
                rows.push(row);
                continue;
            }
            let Some(c) = of.clampings.iter().find(|c| c.number == number + 1) else {
                continue;
            };
            row.extend(vector(&c.error_mm, 4));
            row.extend(vector(&c.error_deg, 4));
            row.push(format!("{:.4}", c.u_mm));
            row.push(format!("{:.4}", c.probed_error_mm));
            rows.push(row);
        }
    }
    FigureTable {
        caption: format!(
            "Table 4: located less measured (theirs), located less true (here, seed {}); probed: by nine hits, off the truth",
            shown.seeds.first().copied().unwrap_or(0)
        ),
        heads: HEADS.to_vec(),
        rows,
    }
}

/// Table 5, each seed.
fn errors(shown: &Shown) -> FigureTable {
    let row = |name: &str, seed: String, s: Option<&Summary>, digits: usize, refused: String| {
        let mut row = vec![name.to_owned(), seed];
        if let Some(s) = s {
            row.extend(vector(&s.mean_mm, digits));
            for value in [s.bias_mm, s.scatter_mm, s.length_mm, s.worst_mm] {
                row.push(format!("{value:.digits$}"));
            }
        }
        row.resize(ERRORS.len() - 1, String::new());
        row.push(refused);
        row
    };
    let paper = Some(&shown.paper);
    let mut rows = vec![row("paper", String::new(), paper, 3, String::new())];
    let series = shown.series.iter();
    rows.extend(series.map(|s| {
        let (seed, refused) = (s.seed.to_string(), s.refusals.len().to_string());
        row(s.name, seed, s.summary.as_ref(), 4, refused)
    }));
    FigureTable {
        caption: "Table 5: what all clampings share (bias) and what is left (scatter)".into(),
        heads: ERRORS.to_vec(),
        rows,
    }
}

const ERRORS: [&str; 10] = [
    "by", "seed", "X, mm", "Y, mm", "Z, mm", "bias", "scatter", "length", "worst", "refused",
];

/// Each kind over all seeds.
fn spread(shown: &Shown) -> FigureTable {
    let range = |r: &Option<Range>| {
        r.as_ref().map_or_else(String::new, |r| {
            format!("{:.4} {:.4} {:.4}", r.min, r.median, r.max)
        })
    };
    let rows = shown.spread.iter().map(|s| {
        vec![
            s.name.to_owned(),
            s.seeds.to_string(),
            range(&s.length_mm),
            range(&s.bias_mm),
            range(&s.scatter_mm),
            s.worst_mm.map_or_else(String::new, |mm| format!("{mm:.4}")),
            s.inside
                .map_or_else(String::new, |[inside, all]| format!("{inside} of {all}")),
            s.refused.to_string(),
        ]
    });
    FigureTable {
        caption:
            "Over the seeds, mm: smallest, middle, largest; clampings within their 95 % regions"
                .into(),
        heads: vec![
            "by", "seeds", "length", "bias", "scatter", "worst", "inside", "refused",
        ],
        rows: rows.collect(),
    }
}

/// Clampings that were refused, if there are any.
fn refused(shown: &Shown) -> Option<FigureTable> {
    let of = |s: &Series| {
        let row = |r: &Refusal| {
            vec![
                s.name.to_owned(),
                s.seed.to_string(),
                format!("clamping {}", r.clamping),
                refusal(r.code),
                r.message.clone(),
            ]
        };
        s.refusals.iter().map(row).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<String>> = shown.series.iter().flat_map(of).collect();
    (!rows.is_empty()).then(|| FigureTable {
        caption: "Refused: these clampings are in none of the figures".into(),
        heads: vec!["by", "seed", "test", "name", "why"],
        rows,
    })
}

/// Tables 2 and 3.
fn parameters(shown: &Shown) -> FigureTable {
    let rows = shown.parameters.iter().map(|p| {
        let cell = |mm: Option<f64>| match (p.none, mm) {
            (Some(why), _) => why.to_owned(),
            // Two figures say what it is beside theirs, however small.
            (None, Some(mm)) if mm < 0.01 => format!("{mm:.1e} mm"),
            (None, Some(mm)) => format!("{mm:.2} mm"),
            (None, None) => String::new(),
        };
        vec![
            p.name.to_owned(),
            p.paper.to_owned(),
            cell(p.scanner_mm),
            cell(p.industrial_mm),
        ]
    });
    FigureTable {
        caption: "Tables 2 and 3: what they set by trial and error, and what was found here by part and scan (first clamping)"
            .into(),
        heads: vec!["parameter", "paper", "scanner", "industrial"],
        rows: rows.collect(),
    }
}

fn raw(shown: &Shown) -> FigureTable {
    let mut rows = Vec::new();
    for raw in &shown.raw {
        for (k, c) in raw.cuts.iter().enumerate() {
            rows.push(vec![
                if k == 0 { raw.name } else { "" }.to_owned(),
                c.placing.to_owned(),
                c.verdict.unwrap_or("").to_owned(),
                c.least_stock_mm
                    .map_or_else(String::new, |mm| format!("{:+.3}", Plain(mm))),
                format!("{:+.3}", Plain(c.true_least_stock_mm)),
                format!("{:.0}", c.bare_mm2),
                format!("{:.0}", c.lacking_mm2),
                format!("{:+.3} {:+.3}", Plain(c.cut_max_mm), Plain(c.cut_min_mm)),
            ]);
        }
    }
    FigureTable {
        caption: "A raw part, its path put to three places and cut: what of its boss stays bare"
            .into(),
        heads: vec![
            "material",
            "place",
            "verdict",
            "least stock, mm",
            "in truth, mm",
            "bare, mm2",
            "lacking, mm2",
            "left, mm",
        ],
        rows,
    }
}

#[cfg(test)]
mod tests {
    use umi_experiment::localise::figures::ErrorFigures;
    use umi_experiment::localise::run::ClampingTried;
    use umi_scan::ScanError;
    use umi_scan::rigid::Vec3;

    use super::super::{Clamping, Spread};
    use super::*;

    fn error() -> ScanError {
        ScanError::refused("scans_disagree", "scan 2 puts the part elsewhere").with("off_mm", 107.0)
    }

    fn clamping(number: usize, x: f64) -> Clamping {
        Clamping {
            number,
            true_mm: [0.0; 3],
            located_mm: [x, 0.0, 0.0],
            error_mm: [x, 0.0, 0.0],
            error_deg: [0.0; 3],
            u_mm: 0.003,
            probed_error_mm: 0.0,
            noise_found_mm: 0.1,
            points: 1000,
            chosen: Default::default(),
        }
    }

    fn summary(errors: &[Vec3]) -> Summary {
        ErrorFigures::of(errors).into()
    }

    fn shown(series: Vec<Series>) -> Shown {
        Shown {
            seeds: vec![3],
            paper: summary(&[Vec3::x()]),
            ok: series.iter().all(Series::holds),
            spread: Spread::of("scanner", &series).into_iter().collect(),
            series,
            parameters: Vec::new(),
            raw: Vec::new(),
        }
    }

    /// A clamping that both corners do not place loses none of the others, has its row and its name, and is not within the
    /// goals.
    #[test]
    fn a_refused_clamping_is_seen_at_a_glance_and_loses_no_other() {
        let tried = [1, 2].map(|_| ClampingTried {
            found: Err(error()),
            alone_mm: Some([Ok(Vec3::x()), Err(error())]),
        });
        // The second one of three is refused.
        let mut joint = Series::joint("scanner", 3, &tried);
        assert!(joint.summary.is_none() && !joint.holds());
        joint.refusals.remove(0);
        joint.refused.remove(0);
        joint.summary = Some(summary(&[Vec3::x() * 0.001]));
        joint.inside = Some(2);
        joint.clampings = vec![clamping(1, 0.001), clamping(3, 0.002)];
        let shown = shown(vec![joint]);
        assert!(!shown.ok);
        let rows = clampings(&shown).rows;
        let by: Vec<&str> = (rows.iter().filter(|row| row[1] == "scanner"))
            .map(|row| &row[2][..])
            .collect();
        assert_eq!(by, ["+0.0010", "REFUSED: scans_disagree", "+0.0020"]);
        let text = text(&shown);
        assert!(
            text.contains("1 clamping REFUSED by both corners"),
            "{text}"
        );
        assert!(text.contains("scan 2 puts the part elsewhere"), "{text}");
        let json = serde_json::to_value(&shown).unwrap();
        let series = &json["series"][0];
        assert_eq!(series["refused"], serde_json::json!(["scans_disagree"]));
        let refusal = &series["refusals"][0];
        assert_eq!(
            (&refusal["clamping"], &refusal["off_mm"]),
            (&2.into(), &107.0.into())
        );
        assert_eq!(json["spread"][0]["refused"], 1);
        assert_eq!(json["spread"][0]["inside"], serde_json::json!([2, 2]));
    }

    /// That one corner alone is not enough breaks no promise.
    #[test]
    fn one_corner_alone_may_be_refused() {
        let tried = [ClampingTried {
            found: Err(error()),
            alone_mm: Some([Ok(Vec3::x()), Err(error())]),
        }];
        let of = |k| Series::alone("A alone", k, 3, &tried).unwrap();
        assert!(of(0).holds() && of(0).refusals.is_empty());
        assert!(of(1).holds() && of(1).summary.is_none());
        assert_eq!(of(1).refused, ["scans_disagree"]);
    }
}
