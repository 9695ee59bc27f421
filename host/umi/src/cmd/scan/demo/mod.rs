//! `umi scan demo`

mod spread;
mod workpiece;

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use umi_experiment::scan::ball::{self, DIAMETER_MM, THESIS_OFF_MM};
use umi_experiment::scan::edge;
use umi_experiment::scan::mount::calibrate;
use umi_experiment::scan::station::TableMachine;
use umi_experiment::scan::washer::{self, TRUE_MM, WasherTest};
use umi_report::pages::scan::FigureTable;
use umi_report::pages::tables::{TablesPage, html};
use umi_virtual::scene::LineScannerSpec;

use super::super::Format;
use super::answer::mount_failure;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::progress::Progress;
use crate::show::terminal::{BAD, GOOD, Plain, paint, print, print_as_json};
use spread::{Spread, in_words, named};

/// Published scans again on a virtual machine: a washer, a ball, and what time does to both
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Demo {
    /// The first seed of the sensor's noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// How many seeds, one after the other
    #[arg(long, value_name = "N", default_value_t = 5,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// The thesis' workpiece instead: cut in five clampings, scanned in three ways
    #[arg(long)]
    workpiece: bool,
    /// A page with all tables; of the workpiece also its scan by the board on maps and in a view that turns
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The machine tilts and turns its table (A, C); the sensor's mount is 1.3 degrees and 4.3 mm off
what the machine file says, and is calibrated on one ball and 30 profiles first. Every scan goes
the whole way: trigger pulses, the sensor's data channel byte for byte, latches, pairing, merging.

washer  that of Paludo's work (41.20, 19.75, 6.30 mm) in its three tests: tables 11, 13 and 15 (results) and
        12, 14 and 16 (errors) with its figures beside ours. The sensor has that work's field and range, noise
        of 10 um, speckle of 5 um, mixed samples at a fifth of the edges, and a washer that mirrors.
ball    25.4 mm at 5 um noise; the thesis of Sawula is off by 68.4 um in its figure 6.6.
speed   where the edge of a block is when it is scanned at 2.5 to 500 mm/s, both ways: with the
        board, and with positions that are 55 ms old, as the timer of that thesis' program makes them.
        Nothing is random in it.

With --workpiece instead: the workpiece of `umi demo` (tool paths 0.541 mm apart, as printed), scanned
as in the thesis' sections 5.1 and 6.5 at 2.5 mm/s, a profile each 0.127 mm, once with positions read by its
software loop (up to 55 ms old) and once by the board. Its figures stand beside ours in
table 5.1  averages above and below, and standard deviation, by the Roland-like scanner
table 6.1  the Gocator's data sheet, and what the virtual one is made with
table 6.2  what scales, delay and scanner add, each alone, and in total
table 6.3  averages and standard deviation by the Gocator, and the fit of figure 6.8 (13 um)

Every figure is told over the seeds: mean, standard deviation of the seeds, worst (--json: `spread`).

Examples:
  umi scan demo
  umi scan demo --workpiece --report workpiece.html
  umi scan demo --runs 20 --seed 100 --json

Exit status: 0 within 0.02 mm (diameters), 0.005 mm (height, ball) and 2 um (speed) for each
seed, 2 not. With --workpiece: 0 the board's scan adds no more than the 15 um of table 6.2 (root mean
square, for each seed), 2 it does.";

/// Age of a position in the thesis' program at most: its form's timer ticks 18 times a second.
const TIMER_US: f64 = 55_000.0;
/// The goals: diameters, height, ball, place at any speed.
const GOALS_MM: [f64; 3] = [0.02, 0.02, 0.005];
const BALL_GOAL_MM: f64 = 0.005;
const PLACE_GOAL_MM: f64 = 0.002;
const SPEEDS: [f64; 6] = [2.5, -2.5, 100.0, -100.0, 500.0, -500.0];

#[derive(Serialize)]
struct Shown {
    seeds: Vec<u64>,
    true_mm: [f64; 3],
    washer: Vec<WasherRow>,
    ball: BallRow,
    mount: MountRow,
    speed: Vec<SpeedRow>,
    ok: bool,
}

#[derive(Serialize)]
struct WasherRow {
    test: &'static str,
    printed_mm: [f64; 3],
    printed_error_mm: [f64; 3],
    mean_mm: [f64; 3],
    mean_error_mm: [f64; 3],
    largest_error_mm: [f64; 3],
    goal_mm: [f64; 3],
    tables: [u32; 2],
    /// As printed: diameters, height and their mean, in mm and in percent.
    printed_errors: [[f64; 4]; 2],
    /// Of outer and inner diameter and height, over the seeds.
    spread: [Spread; 3],
}

#[derive(Serialize)]
struct BallRow {
    true_mm: f64,
    mean_mm: f64,
    largest_error_mm: f64,
    thesis_error_mm: f64,
    goal_mm: f64,
    spread: Spread,
}

#[derive(Serialize)]
struct MountRow {
    /// Largest standard uncertainties over the seeds, and how far it was off.
    /// None: without noise there is none.
    u_mm: Option<f64>,
    u_mrad: Option<f64>,
    largest_error_mm: f64,
    largest_error_mrad: f64,
}

#[derive(Serialize)]
struct SpeedRow {
    speed_mm_per_s: f64,
    with_board_mm: f64,
    with_timer_mm: f64,
}

/// S2's sensor with every error that its report tells of.
fn washer_sensor() -> Option<LineScannerSpec> {
    Some(LineScannerSpec {
        speckle_um: 5.0,
        edge_share: 0.2,
        gloss_deg: 3.0,
        ..LineScannerSpec::preset("s2")?
    })
}

fn ball_sensor() -> Option<LineScannerSpec> {
    Some(LineScannerSpec {
        noise_um: [5.0; 2],
        ..LineScannerSpec::preset("gocator")?
    })
}

impl Demo {
    pub fn run(self) -> Result<(), Failure> {
        let seeds: Vec<u64> = (0..u64::from(self.runs))
            .map(|n| self.seed.wrapping_add(n))
            .collect();
        if let Some(path) = &self.report {
            self.force.check(path, &[])?;
        }
        if self.workpiece {
            return workpiece::run(&seeds, self.format.json, self.report.as_deref());
        }
        let shown = show(seeds, &Progress::new(self.format.json))?;
        if let Some(path) = &self.report {
            std::fs::write(path, html(&page(&shown)))
                .map_err(|error| Failure::file("write", path, &error))?;
        }
        said(self.format.json, &shown, text, shown.ok)
    }
}

/// Prints what was found, for machines or in words; a failure where a goal was not met.
fn said<T: Serialize>(
    json: bool,
    shown: &T,
    text: impl FnOnce(&T) -> String,
    ok: bool,
) -> Result<(), Failure> {
    if json {
        print_as_json(shown)?;
    } else {
        print(&text(shown))?;
    }
    if ok { Ok(()) } else { Err(Failure::Negative) }
}

fn show(seeds: Vec<u64>, progress: &Progress) -> Result<Shown, Failure> {
    let missing = || Failure::trouble("scene", "a preset of the scanner is missing");
    let (of_washer, of_ball) = (
        washer_sensor().ok_or_else(missing)?,
        ball_sensor().ok_or_else(missing)?,
    );
    let mut washers: [Vec<[f64; 3]>; 3] = Default::default();
    let mut balls = Vec::new();
    let mut mount = MountRow {
        u_mm: None,
        u_mrad: None,
        largest_error_mm: 0.0,
        largest_error_mrad: 0.0,
    };
    // Of each seed three washers and a ball.
    progress.of("scans", 4 * seeds.len() as u64);
    for seed in &seeds {
        let mut station = TableMachine::new(of_washer.clone(), *seed);
        let mounted = calibrate(&mut station).map_err(mount_failure)?;
        for (test, found) in WasherTest::ALL.into_iter().zip(&mut washers) {
            let measured = washer::run(&mut station, &mounted.machine, test);
            found.push(measured.map_err(mount_failure)?);
            progress.more(1);
        }
        let mut station = TableMachine::new(of_ball.clone(), *seed);
        let mounted = calibrate(&mut station).map_err(mount_failure)?;
        let found = ball::diameter(&mut station, &mounted.machine).map_err(mount_failure)?;
        progress.more(1);
        balls.push(found);
        mount.largest_error_mm = mount.largest_error_mm.max(mounted.off.0);
        mount.largest_error_mrad = mount.largest_error_mrad.max(mounted.off.1);
        if let Some(covariance) = mounted.answer.covariance {
            for (place, row) in covariance.iter().enumerate() {
                let u = row.get(place).copied().unwrap_or(0.0).max(0.0).sqrt();
                let (slot, u) = if place < 3 {
                    (&mut mount.u_mrad, u * 1e3)
                } else {
                    (&mut mount.u_mm, u)
                };
                *slot = Some(slot.map_or(u, |most| most.max(u)));
            }
        }
    }
    progress.stage("edges at six speeds");
    let speed = speeds(of_ball)?;
    let balls = Spread::of(&balls, DIAMETER_MM);
    let ball_most = (balls.worst - DIAMETER_MM).abs();
    let washer: Vec<WasherRow> = WasherTest::ALL
        .into_iter()
        .zip(washers)
        .map(|(test, found)| {
            let spread: [Spread; 3] = std::array::from_fn(|i| {
                let of: Vec<f64> = found.iter().map(|three| three[i]).collect();
                Spread::of(&of, TRUE_MM[i])
            });
            let less = |values: [f64; 3]| std::array::from_fn(|i| values[i] - TRUE_MM[i]);
            let mean = spread.map(|of| of.mean);
            let off: [f64; 3] = less(spread.map(|of| of.worst));
            WasherRow {
                test: test.name(),
                printed_mm: test.printed_mm(),
                printed_error_mm: less(test.printed_mm()),
                mean_mm: mean,
                mean_error_mm: less(mean),
                largest_error_mm: off.map(f64::abs),
                goal_mm: GOALS_MM,
                tables: test.tables(),
                printed_errors: test.printed_errors(),
                spread,
            }
        })
        .collect();
    let within = washer.iter().all(|row| {
        let mut pairs = row.largest_error_mm.iter().zip(GOALS_MM);
        pairs.all(|(error, goal)| *error <= goal)
    });
    let still = speed
        .iter()
        .all(|row| row.with_board_mm.abs() <= PLACE_GOAL_MM);
    Ok(Shown {
        ok: within && still && ball_most <= BALL_GOAL_MM,
        seeds,
        true_mm: TRUE_MM,
        washer,
        ball: BallRow {
            true_mm: DIAMETER_MM,
            mean_mm: balls.mean,
            largest_error_mm: ball_most,
            thesis_error_mm: THESIS_OFF_MM,
            goal_mm: BALL_GOAL_MM,
            spread: balls,
        },
        mount,
        speed,
    })
}

/// Without noise: what is left is time.
fn speeds(of_ball: LineScannerSpec) -> Result<Vec<SpeedRow>, Failure> {
    let spec = LineScannerSpec {
        noise_um: [0.0; 2],
        busy_us: 500.0,
        exposure_us: 100.0,
        ..of_ball
    };
    let mut station = TableMachine::new(spec, 1);
    let machine = station.truth.clone();
    let mut at = |speed: f64, late: f64| {
        edge::place_along_x(&mut station, &machine, speed, late).map_err(mount_failure)
    };
    SPEEDS
        .into_iter()
        .map(|speed| {
            Ok(SpeedRow {
                speed_mm_per_s: speed,
                with_board_mm: at(speed, 0.0)?,
                with_timer_mm: at(speed, TIMER_US)?,
            })
        })
        .collect()
}

/// With its sign; what rounds to zero has none.
fn signed(mm: f64) -> String {
    let text = format!("{mm:+.4}");
    if text.trim_start_matches(['+', '-']) == "0.0000" {
        "0.0000".into()
    } else {
        text
    }
}

/// One figure of those of the three features: of one of them, or the mean.
type Reduced<'a> = &'a dyn Fn(&dyn Fn(usize) -> f64) -> f64;

/// What is measured of a washer.
const FEATURES: [&str; 3] = ["outer diameter", "inner diameter", "height"];

/// Tables 11 to 16, as terminal and page show them.
fn washer_tables(shown: &Shown) -> Vec<FigureTable> {
    let seeds = named(&shown.seeds);
    let mut all = Vec::new();
    for row in &shown.washer {
        let [results, errors] = row.tables;
        let of = |i: usize| {
            let [mean, std, worst] = row.spread[i].cells(|mm| format!("{mm:.4}"));
            vec![
                FEATURES[i].to_owned(),
                format!("{:.2}", shown.true_mm[i]),
                format!("{:.2}", row.printed_mm[i]),
                mean,
                std,
                worst,
            ]
        };
        all.push(FigureTable {
            caption: format!("Table {results}: results, {}, in mm ({seeds})", row.test),
            heads: vec!["", "true", "printed", "here, mean", "std", "worst"],
            rows: (0..3).map(of).collect(),
        });
        let percent = |off: f64, i: usize| 100.0 * off.abs() / shown.true_mm[i];
        let mean = |of: &dyn Fn(usize) -> f64| (0..3).map(of).sum::<f64>() / 3.0;
        let [printed_mm, printed_percent] = row.printed_errors;
        let figures = |name: &str, at: usize, of: Reduced<'_>| {
            let anew = |i: usize| row.printed_error_mm[i];
            let here = |i: usize| row.mean_error_mm[i];
            let worst = |i: usize| row.largest_error_mm[i];
            vec![
                name.to_owned(),
                format!("{:.2}", printed_mm[at]),
                match at {
                    3 => format!("{:.2}", of(&|i| anew(i).abs())),
                    _ => format!("{:+.2}", of(&anew)),
                },
                match at {
                    3 => format!("{:.4}", of(&|i| here(i).abs())),
                    _ => format!("{:+.4}", Plain(of(&here))),
                },
                format!("{:.4}", of(&worst)),
                format!("{:.2}", printed_percent[at]),
                format!("{:.2}", of(&|i| percent(anew(i), i))),
                format!("{:.3}", of(&|i| percent(here(i), i))),
                format!("{:.3}", of(&|i| percent(worst(i), i))),
            ]
        };
        let mut rows: Vec<Vec<String>> = (0..3)
            .map(|i| figures(FEATURES[i], i, &|of| of(i)))
            .collect();
        rows.push(figures("mean", 3, &|of| mean(of)));
        all.push(FigureTable {
            caption: format!(
                "Table {errors}: errors, {}, in mm and in percent. Anew: from the printed results",
                row.test
            ),
            heads: vec![
                "",
                "mm, printed",
                "printed, off",
                "here, mean off",
                "here, worst",
                "%, printed",
                "anew",
                "here, mean",
                "here, worst",
            ],
            rows,
        });
    }
    all
}

/// Where the edge was.
fn speed_table(shown: &Shown) -> FigureTable {
    let row = |row: &SpeedRow| {
        vec![
            format!("{:+}", row.speed_mm_per_s),
            signed(row.with_board_mm),
            signed(row.with_timer_mm),
        ]
    };
    FigureTable {
        caption: "Where the edge of a block is along X at several speeds, WITHOUT noise: what is left is time".into(),
        heads: vec!["mm/s", "with the board, mm", "with a timer, mm"],
        rows: shown.speed.iter().map(row).collect(),
    }
}

fn ball_words(shown: &Shown) -> String {
    let ball = &shown.ball;
    let [mean, std, worst] = ball.spread.cells(|mm| format!("{mm:.4}"));
    format!(
        "Ball of {} mm: {mean} mm on the mean, standard deviation {std}, worst {worst}, off by {:.4} mm at most; the thesis by {} mm",
        ball.true_mm, ball.largest_error_mm, ball.thesis_error_mm
    )
}

fn mount_words(shown: &Shown) -> String {
    let mount = &shown.mount;
    let u = |value: Option<f64>, digits: usize| match value {
        Some(value) if value > 0.0 => format!("{value:.digits$}"),
        _ => "NONE (no noise)".into(),
    };
    format!(
        "Mount from one ball and 30 profiles: u {} mm, {} mrad; off by {:.4} mm, {:.3} mrad at most",
        u(mount.u_mm, 4),
        u(mount.u_mrad, 3),
        mount.largest_error_mm,
        mount.largest_error_mrad
    )
}

fn verdict(shown: &Shown) -> &'static str {
    if shown.ok {
        "within the goals: 0.02, 0.02, 0.005 mm; ball 0.005 mm; speed 0.002 mm"
    } else {
        "NOT within the goals: 0.02, 0.02, 0.005 mm; ball 0.005 mm; speed 0.002 mm"
    }
}

fn page(shown: &Shown) -> TablesPage {
    let mut tables = washer_tables(shown);
    tables.push(speed_table(shown));
    TablesPage {
        title: "Published scans again".into(),
        result: verdict(shown).into(),
        ok: shown.ok,
        facts: vec![
            ("seeds", named(&shown.seeds)),
            ("ball", ball_words(shown)),
            ("mount", mount_words(shown)),
        ],
        tables,
    }
}

fn text(shown: &Shown) -> String {
    let [outer, inner, height] = shown.true_mm;
    let mut text = format!(
        "Washer {outer:.2} / {inner:.2} / {height:.2} mm: outer and inner diameter, height; {}\n\n",
        named(&shown.seeds)
    );
    for table in washer_tables(shown) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", in_words(&table));
    }
    let colour = if shown.ok { GOOD } else { BAD };
    let _ = writeln!(
        text,
        "{}\n{}\n\n{}\n{}",
        ball_words(shown),
        mount_words(shown),
        in_words(&speed_table(shown)),
        paint(colour, verdict(shown))
    );
    text
}
