//! `umi scan demo --workpiece`

use std::path::Path;

use serde::Serialize;
use umi_experiment::scan::workpiece::{
    ErrorShare, ErrorSource, PartFigures, PartScanner, PartScans, scan,
};
use umi_report::pages::deviation::{DeviationPage, DeviationPoint, html};
use umi_report::pages::scan::FigureTable;
use umi_virtual::scene::LineScannerSpec;

use super::super::answer::mount_failure;
use super::super::cloud::spread;
use super::spread::{Spread, in_words, named};
use crate::failure::Failure;
use crate::show::progress::Progress;
use crate::show::terminal::{BAD, GOOD, Plain, paint};

/// What table 6.2 allows a scan to add.
const GOAL_MM: f64 = 0.015;

#[derive(Serialize)]
struct Shown {
    kind: &'static str,
    seeds: Vec<u64>,
    scans: Vec<Row>,
    table_6_1: Vec<DataSheetRow>,
    table_6_2: Vec<BudgetRow>,
    goal_mm: f64,
    ok: bool,
}

/// Means over the seeds; what the scan adds is the largest of them. `spread` has mean, standard deviation and worst of each.
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
    pitch_mm: f64,
    step_mm: f64,
    spread: RowSpread,
    printed: Option<Printed>,
}

#[derive(Serialize)]
struct RowSpread {
    mean_above_mm: Spread,
    mean_below_mm: Spread,
    std_mm: Spread,
    reference_std_mm: Spread,
    scan_rms_mm: Spread,
}

#[derive(Serialize)]
struct Printed {
    mean_above_mm: f64,
    mean_below_mm: f64,
    std_mm: f64,
    reference_std_mm: Option<f64>,
}

/// A row of table 6.1: what the sensor of the thesis has by its maker, and the virtual one by its scene.
#[derive(Serialize)]
struct DataSheetRow {
    name: &'static str,
    printed_mm: [f64; 2],
    here_mm: [f64; 2],
}

/// A row of table 6.2; none where the thesis has no figure.
#[derive(Serialize)]
struct BudgetRow {
    error: &'static str,
    printed_along_mm: Option<f64>,
    printed_z_mm: Option<f64>,
    /// Along the motion, at most.
    along_mm: Option<Spread>,
    /// Square to the surface: root mean square.
    z_rms_mm: Spread,
    /// The largest of all seeds.
    z_max_mm: f64,
}

pub(super) fn run(seeds: &[u64], json: bool, page: Option<&Path>) -> Result<(), Failure> {
    let mut all: Vec<PartScans> = Vec::new();
    let progress = Progress::new(json);
    progress.of(
        "workpieces, cut and scanned in three ways",
        seeds.len() as u64,
    );
    for seed in seeds {
        let mut scans = scan(*seed).map_err(mount_failure)?;
        // The page shows the first; what is not shown is not held.
        if page.is_none() || !all.is_empty() {
            scans.board = Vec::new();
        }
        all.push(scans);
        progress.more(1);
    }
    drop(progress);
    let missing = || Failure::trouble("scene", "a preset of the scanner is missing");
    let sensor = LineScannerSpec::preset("gocator").ok_or_else(missing)?;
    let scans: Vec<Row> = PartScanner::ALL
        .into_iter()
        .map(|scanner| row(scanner, &all))
        .collect();
    let within = |scans: &PartScans| {
        let mut board = scans
            .scans
            .iter()
            .filter(|(which, _)| *which == PartScanner::Board);
        board.all(|(_, figures)| figures.scan_rms_mm <= GOAL_MM)
    };
    let shown = Shown {
        kind: "scan_demo_workpiece",
        seeds: seeds.to_vec(),
        scans,
        table_6_1: data_sheet(&sensor),
        table_6_2: budget(&all),
        goal_mm: GOAL_MM,
        ok: all.iter().all(within),
    };
    if let (Some(path), Some(first)) = (page, all.first()) {
        std::fs::write(path, html(&made(&shown, &first.board)))
            .map_err(|error| Failure::file("write", path, &error))?;
    }
    super::said(json, &shown, text, shown.ok)
}

fn of(all: &[PartScans], scanner: PartScanner) -> Vec<PartFigures> {
    let figures = all.iter().flat_map(|scans| &scans.scans);
    let figures = figures.filter(|(which, _)| *which == scanner);
    figures.map(|(_, figures)| *figures).collect()
}

fn row(scanner: PartScanner, all: &[PartScans]) -> Row {
    let figures = of(all, scanner);
    let over = |what: fn(&PartFigures) -> f64| {
        Spread::of(&figures.iter().map(what).collect::<Vec<_>>(), 0.0)
    };
    let spread = RowSpread {
        mean_above_mm: over(|f| f.mean_above_mm),
        mean_below_mm: over(|f| f.mean_below_mm),
        std_mm: over(|f| f.std_mm),
        reference_std_mm: over(|f| f.reference_std_mm),
        scan_rms_mm: over(|f| f.scan_rms_mm),
    };
    Row {
        scan: scanner.name(),
        points: figures.first().map_or(0, |f| f.points),
        mean_above_mm: spread.mean_above_mm.mean,
        mean_below_mm: spread.mean_below_mm.mean,
        std_mm: spread.std_mm.mean,
        reference_std_mm: spread.reference_std_mm.mean,
        scan_rms_mm: spread.scan_rms_mm.worst,
        scan_max_mm: over(|f| f.scan_max_mm).worst,
        pitch_mm: over(|f| f.pitch_mm).mean,
        step_mm: over(|f| f.step_mm).mean,
        spread,
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

/// Table 6.1.
fn data_sheet(here: &LineScannerSpec) -> Vec<DataSheetRow> {
    let row = |name, printed_mm, here_mm| DataSheetRow {
        name,
        printed_mm,
        here_mm,
    };
    let mm = |um: [f64; 2]| um.map(|um| um * 1e-3);
    vec![
        row("resolution Z", [0.006, 0.014], mm(here.noise_um)),
        row("resolution X", [0.044, 0.075], mm(here.pitch_um)),
        row("clearance distance", [90.0; 2], [here.clearance_mm; 2]),
        row("measurement range", [80.0; 2], [here.range_mm; 2]),
        row("field of view", [47.0, 85.0], here.field_mm),
    ]
}

/// Table 6.2: each error alone, then what a whole scan adds.
fn budget(all: &[PartScans]) -> Vec<BudgetRow> {
    let shares = |source: ErrorSource| -> Vec<ErrorShare> {
        let shares = all.iter().flat_map(|scans| &scans.shares);
        shares
            .filter(|share| share.source == source)
            .copied()
            .collect()
    };
    let alone = |error, source, printed_along_mm, printed_z_mm| {
        let shares = shares(source);
        let over = |what: fn(&ErrorShare) -> f64| {
            Spread::of(&shares.iter().map(what).collect::<Vec<_>>(), 0.0)
        };
        let along = over(|share| share.along_mm);
        BudgetRow {
            error,
            printed_along_mm,
            printed_z_mm,
            along_mm: (along.worst > 0.0).then_some(along),
            z_rms_mm: over(|share| share.rms_mm),
            z_max_mm: over(|share| share.max_mm).worst,
        }
    };
    let whole = |error, scanner, printed_z_mm| {
        let figures = of(all, scanner);
        let over = |what: fn(&PartFigures) -> f64| {
            Spread::of(&figures.iter().map(what).collect::<Vec<_>>(), 0.0)
        };
        BudgetRow {
            error,
            printed_along_mm: None,
            printed_z_mm,
            along_mm: None,
            z_rms_mm: over(|f| f.scan_rms_mm),
            z_max_mm: over(|f| f.scan_max_mm).worst,
        }
    };
    vec![
        alone(
            "scales (1 µm a count)",
            ErrorSource::Scales,
            None,
            Some(0.001),
        ),
        alone("time delay (loop)", ErrorSource::Delay, Some(0.0125), None),
        alone("laser scanner", ErrorSource::Sensor, None, Some(0.014)),
        whole("total, software loop", PartScanner::Loop, Some(GOAL_MM)),
        whole("total, board", PartScanner::Board, None),
    ]
}

fn signed(mm: f64) -> String {
    format!("{:+.4}", Plain(mm))
}

fn plain(mm: f64) -> String {
    format!("{mm:.4}")
}

/// All tables, as terminal and page show them.
fn tables(shown: &Shown) -> Vec<FigureTable> {
    let seeds = named(&shown.seeds);
    let range = |[low, high]: [f64; 2]| {
        if low == high {
            format!("{low}")
        } else {
            format!("{low} to {high}")
        }
    };
    let sheet = shown
        .table_6_1
        .iter()
        .map(|row| vec![row.name.into(), range(row.printed_mm), range(row.here_mm)]);
    let printed = |mm: Option<f64>, digits: usize, none: &str| {
        mm.map_or_else(|| none.to_owned(), |mm| format!("{mm:.digits$}"))
    };
    let budget = shown.table_6_2.iter().map(|row| {
        let along = row
            .along_mm
            .map_or_else(String::new, |along| plain(along.worst));
        let z = match row.error {
            "time delay (loop)" => "negligible".into(),
            _ => printed(row.printed_z_mm, 3, ""),
        };
        let [mean, std, worst] = row.z_rms_mm.cells(plain);
        vec![
            row.error.into(),
            printed(row.printed_along_mm, 4, ""),
            along,
            z,
            mean,
            std,
            worst,
            plain(row.z_max_mm),
        ]
    });
    let mut all = vec![
        FigureTable {
            caption: "Table 6.1: the sensor, in mm. Printed: its maker's data sheet. Here: what the virtual sensor is made with; its \
                      resolution in Z is the standard deviation of its noise, near and far"
                .into(),
            heads: vec!["", "printed", "here"],
            rows: sheet.collect(),
        },
        FigureTable {
            caption: format!(
                "Table 6.2: what errors add to a scan, in mm ({seeds}). The first three here: each alone in a scan of its own, the \
                 mount as it is; the steps of scales and messages are in all. Totals: the scans of table 6.3, with the mount as it \
                 was calibrated. Along: of positions, along the motion. Z: distance from the surface that was cut"
            ),
            heads: vec![
                "error",
                "along, printed",
                "along, at most",
                "Z, printed",
                "Z rms, mean",
                "std",
                "worst",
                "largest",
            ],
            rows: budget.collect(),
        },
    ];
    for (name, scans) in [
        ("Table 5.1: cases 1 to 4 by the Roland", &shown.scans[..1]),
        (
            "Table 6.3, and the fit of figure 6.8: by the Gocator",
            &shown.scans[1..],
        ),
    ] {
        let mut rows = Vec::new();
        for row in scans {
            let cells = |what: &str, four: [String; 4]| {
                let mut cells = vec![row.scan.to_owned(), what.to_owned()];
                cells.extend(four);
                cells
            };
            if let Some(printed) = &row.printed {
                rows.push(cells(
                    "printed",
                    [
                        format!("{:+.3}", printed.mean_above_mm),
                        format!("{:+.3}", printed.mean_below_mm),
                        format!("{:.3}", printed.std_mm),
                        printed
                            .reference_std_mm
                            .map_or_else(String::new, |mm| format!("{mm:.3}")),
                    ],
                ));
            }
            let of = &row.spread;
            let [above, below] = [of.mean_above_mm, of.mean_below_mm].map(|s| s.cells(signed));
            let [std, reference] = [of.std_mm, of.reference_std_mm].map(|s| s.cells(plain));
            // Of one seed there is no spread.
            let several = row.spread.std_mm.std.is_some();
            let kinds = if several {
                &["here, mean", "here, std of seeds", "here, worst"][..]
            } else {
                &["here"]
            };
            for (i, what) in kinds.iter().enumerate() {
                rows.push(cells(
                    what,
                    [&above, &below, &std, &reference].map(|three| three[i].clone()),
                ));
            }
        }
        all.push(FigureTable {
            caption: format!(
                "{name}, in mm ({seeds}): deviations from the arc as it lies best on case 0; worst is the farthest from 0"
            ),
            heads: vec!["scan", "", "average above", "average below", "standard deviation", "case 0, std"],
            rows,
        });
    }
    let points = shown.scans.iter().map(|row| {
        let printed = match row.scan {
            "Gocator, software loop" => "7680000; 0.0625 and 0.127",
            _ => "",
        };
        vec![
            row.scan.into(),
            printed.into(),
            row.points.to_string(),
            format!("{:.4}", row.pitch_mm),
            format!("{:.4}", row.step_mm),
        ]
    });
    all.push(FigureTable {
        caption: "Section 6.5: points on the part, and their distances along the line and from profile to profile, in mm. 7.68 million \
                  points are 30 s of 200 profiles, 0.0125 mm apart at 2.5 mm/s; 0.127 mm apart they are a tenth"
            .into(),
        heads: vec!["scan", "printed", "points", "along the line", "to the next"],
        rows: points.collect(),
    });
    all
}

fn verdict(shown: &Shown) -> String {
    let board = shown.scans.last();
    let said = format!(
        "the board's scan adds {} mm at most of the 0.015 mm that table 6.2 reckons with",
        board.map_or_else(String::new, |row| plain(row.scan_rms_mm))
    );
    if shown.ok {
        said
    } else {
        format!("NOT within the goal: {said}")
    }
}

fn text(shown: &Shown) -> String {
    let tables: Vec<String> = tables(shown).iter().map(in_words).collect();
    format!(
        "Workpiece of five clampings; {}\n\n{}\n{}\n",
        named(&shown.seeds),
        tables.join("\n"),
        paint(if shown.ok { GOOD } else { BAD }, verdict(shown))
    )
}

/// The page: the tables, and the board's scan of the first seed as the thesis has its own in figures 6.8 to 6.11.
fn made(shown: &Shown, board: &[([f64; 3], f64)]) -> DeviationPage {
    let points: Vec<DeviationPoint> = board
        .iter()
        .map(|&(at_mm, deviation_mm)| DeviationPoint {
            at_mm,
            deviation_mm,
            outward: umi_experiment::scan::workpiece::outward(&at_mm),
        })
        .collect();
    let bands = if points.is_empty() {
        umi_report::pages::deviation::Bands::default()
    } else {
        spread(points.iter().map(|point| point.deviation_mm).collect())
    };
    DeviationPage {
        title: "The thesis' workpiece, scanned again".into(),
        result: verdict(shown),
        ok: shown.ok,
        facts: vec![
            ("seeds", named(&shown.seeds)),
            (
                "maps",
                format!(
                    "the board's scan of seed {} from the arc as it lies best on case 0, as figures 6.8 to 6.11",
                    shown.seeds.first().copied().unwrap_or(0)
                ),
            ),
        ],
        tables: tables(shown),
        bands,
        points,
        ..DeviationPage::default()
    }
}
