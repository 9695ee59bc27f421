//! The tables of `umi demo localise`, in the terminal and on its page.

use umi_report::pages::scan::FigureTable;

use super::{Range, Shown, Summary};
use crate::show::terminal::{BAD, GOOD, Plain, Table, paint};

/// All tables.
pub(super) fn all(shown: &Shown) -> Vec<FigureTable> {
    vec![
        clampings(shown),
        errors(shown),
        spread(shown),
        parameters(shown),
        raw(shown),
    ]
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
    text + &if shown.ok {
        paint(GOOD, format!("within {goals}"))
    } else {
        paint(BAD, format!("NOT within {goals}"))
    } + "\n"
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
            let of = shown.series.iter().find(|s| s.name == name);
            let Some(c) = of.and_then(|s| s.clampings.get(number)) else {
                continue;
            };
            let mut row = vec![String::new(), name.to_owned()];
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
        heads: vec![
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
        ],
        rows,
    }
}

/// Table 5, each seed.
fn errors(shown: &Shown) -> FigureTable {
    let row = |name: &str, seed: String, s: &Summary, digits: usize| {
        let mut row = vec![name.to_owned(), seed];
        row.extend(vector(&s.mean_mm, digits));
        for value in [s.bias_mm, s.scatter_mm, s.length_mm, s.worst_mm] {
            row.push(format!("{value:.digits$}"));
        }
        row
    };
    let mut rows = vec![row("paper", String::new(), &shown.paper, 3)];
    let series = shown.series.iter();
    rows.extend(series.filter_map(|s| {
        let figures = s.summary.as_ref()?;
        Some(row(s.name, s.seed.to_string(), figures, 4))
    }));
    FigureTable {
        caption: "Table 5: what all clampings share (bias) and what is left (scatter)".into(),
        heads: vec![
            "by", "seed", "X, mm", "Y, mm", "Z, mm", "bias", "scatter", "length", "worst",
        ],
        rows,
    }
}

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
