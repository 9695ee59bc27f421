//! `umi scan demo --workpiece`

use serde::Serialize;
use umi_experiment::scan::workpiece::{PartFigures, PartScanner, scan};

use super::answer::mount_failure;
use crate::failure::Failure;
use crate::show::progress::Progress;
use crate::show::terminal::{BAD, GOOD, Table, count, paint, print, print_json};

/// What table 6.2 allows a scan to add.
const GOAL_MM: f64 = 0.015;

#[derive(Serialize)]
struct Shown {
    kind: &'static str,
    seeds: Vec<u64>,
    scans: Vec<Row>,
    goal_mm: f64,
    ok: bool,
}

/// Means over the seeds; what the scan adds is the largest of them.
#[derive(Serialize)]
struct Row {
    scan: &'static str,
    points: usize,
    mean_above_mm: f64,
    mean_below_mm: f64,
    std_mm: f64,
    reference_std_mm: f64,
    scan_rms_mm: f64,
    scan_max_mm: f64,
    printed: Option<Printed>,
}

#[derive(Serialize)]
struct Printed {
    mean_above_mm: f64,
    mean_below_mm: f64,
    std_mm: f64,
    reference_std_mm: Option<f64>,
}

pub(super) fn run(seeds: &[u64], json: bool) -> Result<(), Failure> {
    let mut all: Vec<(PartScanner, Vec<PartFigures>)> = PartScanner::ALL
        .into_iter()
        .map(|scanner| (scanner, Vec::new()))
        .collect();
    let progress = Progress::new(json);
    progress.of(
        "workpieces, cut and scanned in three ways",
        seeds.len() as u64,
    );
    for seed in seeds {
        for (slot, (_, figures)) in all.iter_mut().zip(scan(*seed).map_err(mount_failure)?) {
            slot.1.push(figures);
        }
        progress.more(1);
    }
    drop(progress);
    let scans: Vec<Row> = all
        .iter()
        .map(|(scanner, figures)| row(*scanner, figures))
        .collect();
    let board = all.iter().find(|(which, _)| *which == PartScanner::Board);
    let ok = board.is_some_and(|(_, figures)| figures.iter().all(|f| f.scan_rms_mm <= GOAL_MM));
    let shown = Shown {
        kind: "scan_demo_workpiece",
        seeds: seeds.to_vec(),
        scans,
        goal_mm: GOAL_MM,
        ok,
    };
    if json {
        let value = serde_json::to_value(&shown)
            .map_err(|error| Failure::trouble("json", format_args!("no JSON: {error}")))?;
        print_json(&value)?;
    } else {
        print(&text(&shown))?;
    }
    if ok { Ok(()) } else { Err(Failure::Negative) }
}

fn row(scanner: PartScanner, figures: &[PartFigures]) -> Row {
    let n = figures.len().max(1) as f64;
    let mean = |of: fn(&PartFigures) -> f64| figures.iter().map(of).sum::<f64>() / n;
    let most = |of: fn(&PartFigures) -> f64| figures.iter().map(of).fold(0.0, f64::max);
    Row {
        scan: scanner.name(),
        points: figures.first().map_or(0, |f| f.points),
        mean_above_mm: mean(|f| f.mean_above_mm),
        mean_below_mm: mean(|f| f.mean_below_mm),
        std_mm: mean(|f| f.std_mm),
        reference_std_mm: mean(|f| f.reference_std_mm),
        scan_rms_mm: most(|f| f.scan_rms_mm),
        scan_max_mm: most(|f| f.scan_max_mm),
        printed: scanner
            .printed_mm()
            .map(|([above, below, std], reference)| Printed {
                mean_above_mm: above,
                mean_below_mm: below,
                std_mm: std,
                reference_std_mm: reference,
            }),
    }
}

fn text(shown: &Shown) -> String {
    let mut table = Table::new("<<>>>>>>").titles(&[
        "scan",
        "",
        "points",
        "above, mm",
        "below, mm",
        "std, mm",
        "case 0, mm",
        "scan adds, mm",
    ]);
    let signed = |mm: f64| format!("{mm:+.4}");
    let plain = |mm: f64| format!("{mm:.4}");
    for row in &shown.scans {
        if let Some(printed) = &row.printed {
            table.row(vec![
                row.scan.into(),
                "printed".into(),
                String::new(),
                format!("{:+.3}", printed.mean_above_mm),
                format!("{:+.3}", printed.mean_below_mm),
                format!("{:.3}", printed.std_mm),
                printed
                    .reference_std_mm
                    .map_or_else(String::new, |mm| format!("{mm:.3}")),
                String::new(),
            ]);
        }
        table.row(vec![
            if row.printed.is_some() { "" } else { row.scan }.into(),
            "here".into(),
            row.points.to_string(),
            signed(row.mean_above_mm),
            signed(row.mean_below_mm),
            plain(row.std_mm),
            plain(row.reference_std_mm),
            format!("{} to {}", plain(row.scan_rms_mm), plain(row.scan_max_mm)),
        ]);
    }
    let verdict = format!(
        "the board's scan adds {} mm of the 0.015 mm that table 6.2 reckons with",
        shown
            .scans
            .last()
            .map_or_else(String::new, |row| plain(row.scan_rms_mm))
    );
    format!(
        "Workpiece of five clampings; {} from {}\n\n{table}\n\n\
         above, below, std   cases 1 to 4 against the arc as it lies best on case 0 (tables 5.1, 6.3)\n\
         case 0              standard deviation of case 0 about that arc\n\
         scan adds           a point's distance from the surface that was cut: root mean square, and largest\n\n{}\n",
        count(shown.seeds.len() as u64, "seed"),
        shown.seeds.first().copied().unwrap_or(0),
        if shown.ok {
            paint(GOOD, verdict)
        } else {
            paint(BAD, format_args!("NOT within the goal: {verdict}"))
        }
    )
}
