//! `umi scan demo`

use std::fmt::Write as _;

use clap::Args;
use serde::Serialize;
use umi_experiment::scan::ball::{self, DIAMETER_MM, THESIS_OFF_MM};
use umi_experiment::scan::edge;
use umi_experiment::scan::mount::calibrate;
use umi_experiment::scan::station::TableMachine;
use umi_experiment::scan::washer::{self, TRUE_MM, WasherTest};
use umi_virtual::scene::LineScannerSpec;

use super::super::Format;
use super::answer::mount_failure;
use crate::failure::Failure;
use crate::show::progress::Progress;
use crate::show::terminal::{BAD, GOOD, Table, count, paint, print, print_json};

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
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The machine tilts and turns its table (A, C); the sensor's mount is 1.3 degrees and 4.3 mm off
what the machine file says, and is calibrated on one ball and 30 profiles first. Every scan goes
the whole way: trigger pulses, the sensor's data channel byte for byte, latches, pairing, merging.

washer  that of Paludo's work (41.20, 19.75, 6.30 mm) in its three tests, tables 11 to 16. The
        sensor has that work's field and range, noise of 10 um, speckle of 5 um, mixed samples at
        a fifth of the edges, and a washer that mirrors.
ball    25.4 mm at 5 um noise; the thesis of Sawula is off by 68.4 um in its figure 6.6.
speed   where the edge of a block is when it is scanned at 2.5 to 500 mm/s, both ways: with the
        board, and with positions that are 55 ms old, as the timer of that thesis' program makes them.

With --workpiece instead: the workpiece of `umi demo` (tool paths 0.541 mm apart, as printed), scanned
as in the thesis' sections 5.1 and 6.5 at 2.5 mm/s, a profile each 0.127 mm: tables 5.1, 6.2, 6.3
beside ours, once with positions read by its software loop (up to 55 ms old) and once by the board.

Examples:
  umi scan demo
  umi scan demo --workpiece
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
}

#[derive(Serialize)]
struct BallRow {
    true_mm: f64,
    mean_mm: f64,
    largest_error_mm: f64,
    thesis_error_mm: f64,
    goal_mm: f64,
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
        if self.workpiece {
            return super::demo_workpiece::run(&seeds, self.format.json);
        }
        let shown = show(seeds, &Progress::new(self.format.json))?;
        if self.format.json {
            let value = serde_json::to_value(&shown)
                .map_err(|error| Failure::trouble("json", format_args!("no JSON: {error}")))?;
            print_json(&value)?;
        } else {
            print(&text(&shown))?;
        }
        if shown.ok {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }
}

fn show(seeds: Vec<u64>, progress: &Progress) -> Result<Shown, Failure> {
    let missing = || Failure::trouble("scene", "a preset of the scanner is missing");
    let (of_washer, of_ball) = (
        washer_sensor().ok_or_else(missing)?,
        ball_sensor().ok_or_else(missing)?,
    );
    let mut washers = [[[0.0; 3]; 2]; 3];
    let mut ball_sum = 0.0;
    let mut ball_most: f64 = 0.0;
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
        for (test, [sums, most]) in WasherTest::ALL.into_iter().zip(&mut washers) {
            let found = washer::run(&mut station, &mounted.machine, test).map_err(mount_failure)?;
            for (((sum, most), found), truth) in sums.iter_mut().zip(most).zip(found).zip(TRUE_MM) {
                *sum += found;
                *most = most.max((found - truth).abs());
            }
            progress.more(1);
        }
        let mut station = TableMachine::new(of_ball.clone(), *seed);
        let mounted = calibrate(&mut station).map_err(mount_failure)?;
        let found = ball::diameter(&mut station, &mounted.machine).map_err(mount_failure)?;
        progress.more(1);
        ball_sum += found;
        ball_most = ball_most.max((found - DIAMETER_MM).abs());
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
    let n = seeds.len() as f64;
    let washer: Vec<WasherRow> = WasherTest::ALL
        .into_iter()
        .zip(washers)
        .map(|(test, [sums, most])| {
            let mean = sums.map(|sum| sum / n);
            let less = |values: [f64; 3]| std::array::from_fn(|i| values[i] - TRUE_MM[i]);
            WasherRow {
                test: test.name(),
                printed_mm: test.printed_mm(),
                printed_error_mm: less(test.printed_mm()),
                mean_mm: mean,
                mean_error_mm: less(mean),
                largest_error_mm: most,
                goal_mm: GOALS_MM,
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
            mean_mm: ball_sum / n,
            largest_error_mm: ball_most,
            thesis_error_mm: THESIS_OFF_MM,
            goal_mm: BALL_GOAL_MM,
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

fn text(shown: &Shown) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        let _ = text.write_fmt(arguments);
        text.push('\n');
    };
    let [outer, inner, height] = shown.true_mm;
    line(format_args!(
        "Washer {outer:.2} / {inner:.2} / {height:.2} mm: outer and inner diameter, height; {} from {}",
        count(shown.seeds.len() as u64, "seed"),
        shown.seeds.first().copied().unwrap_or(0)
    ));
    let mut table =
        Table::new("<<>>>").titles(&["scan", "", "outer, mm", "inner, mm", "height, mm"]);
    for row in &shown.washer {
        let cells = |name: &str, what: &str, values: &[f64; 3], digits: usize, sign: bool| {
            let mut cells = vec![name.to_owned(), what.to_owned()];
            cells.extend(values.iter().map(|value| {
                if sign {
                    format!("{value:+.digits$}")
                } else {
                    format!("{value:.digits$}")
                }
            }));
            cells
        };
        table.row(cells(row.test, "printed", &row.printed_mm, 2, false));
        table.row(cells("", "printed, off", &row.printed_error_mm, 2, true));
        table.row(cells("", "here, mean", &row.mean_mm, 4, false));
        table.row(cells("", "here, mean off", &row.mean_error_mm, 4, true));
        table.row(cells(
            "",
            "here, largest off",
            &row.largest_error_mm,
            4,
            false,
        ));
    }
    line(format_args!("{table}"));
    let (ball, mount) = (&shown.ball, &shown.mount);
    line(format_args!(
        "Ball of {} mm: {:.4} mm on the mean, off by {:.4} mm at most; the thesis by {} mm",
        ball.true_mm, ball.mean_mm, ball.largest_error_mm, ball.thesis_error_mm
    ));
    let u = |value: Option<f64>, digits: usize| match value {
        Some(value) if value > 0.0 => format!("{value:.digits$}"),
        _ => "NONE (no noise)".into(),
    };
    line(format_args!(
        "Mount from one ball and 30 profiles: u {} mm, {} mrad; off by {:.4} mm, {:.3} mrad at most\n",
        u(mount.u_mm, 4),
        u(mount.u_mrad, 3),
        mount.largest_error_mm,
        mount.largest_error_mrad
    ));
    line(format_args!(
        "Where the edge of a block is along X at several speeds, WITHOUT noise: what is left is time"
    ));
    let mut table = Table::new(">>>").titles(&["mm/s", "with the board, mm", "with a timer, mm"]);
    for row in &shown.speed {
        table.row(vec![
            format!("{:+}", row.speed_mm_per_s),
            signed(row.with_board_mm),
            signed(row.with_timer_mm),
        ]);
    }
    line(format_args!("{table}"));
    text + &if shown.ok {
        paint(
            GOOD,
            "within the goals: 0.02, 0.02, 0.005 mm; ball 0.005 mm; speed 0.002 mm",
        )
    } else {
        paint(
            BAD,
            "NOT within the goals: 0.02, 0.02, 0.005 mm; ball 0.005 mm; speed 0.002 mm",
        )
    } + "\n"
}
