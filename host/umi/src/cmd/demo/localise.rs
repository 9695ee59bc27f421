//! `umi demo localise`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use umi_experiment::localise::cell::{self, ScannerKind};
use umi_experiment::localise::cut::{self, RawCut};
use umi_experiment::localise::figures::ErrorFigures;
use umi_experiment::localise::paper::{
    INDUSTRIAL_MM, PrintedClamping, RUN_OUT_RAD, SCANNER_2_SIGMA_MM, SPACING_MM, TABLE_4,
};
use umi_experiment::localise::raw::{LEAST_STOCK_MM, Printed};
use umi_experiment::localise::run::{
    ClampingFound, LocaliseSetting, LocaliseTrouble, TURNED_DEG, figures, run,
};
use umi_scan::parallel::Threads;
use umi_scan::rigid::Vec3;

use super::super::Format;
use super::super::scan::{failure, placed_page, stock_page};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{BAD, GOOD, Plain, Table, paint, print, print_json};

/// A published localisation again on a virtual machine: a part by six scans and two corners
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct DemoLocalise {
    /// The first seed
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// How many seeds, one after the other
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Also each corner alone, and crooked corners: three times as long
    #[arg(long)]
    more: bool,
    /// Where the pages go, and the raw part's files and programs
    #[arg(long, value_name = "DIR", default_value = "umi-localise")]
    out: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Threads; the results have the same bits for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
H. Srinivasan, O. Harrysson, R. Wysk: Automatic part localization in a CNC machine coordinate
system by means of 3D scans (2015). A bar stands in a trunnion as in the five clampings of its
table 4; what that table measured is the truth here. Two corners on the pallet are the fiducials.
Six scans are taken of each clamping, two each with the part turned by 0, 45 and 90 degrees, from
wherever the operator puts the scanner.

paper       what tables 4 and 5 print, with bias and scatter apart
scanner     as theirs: 0.381 mm (two sigma), points 0.383 mm apart
industrial  0.025 mm (two sigma)
With --more:
A, B alone  the scans of `scanner` with one corner alone, as the paper takes the best one
crooked     as `scanner`, the corners turned by 0.5 mrad (one sigma; 0.0254 mm over 50 mm)

Then a raw part that was printed crooked and warped is scanned, its finishing path is rewritten
to three places, and each is cut on a fresh copy: as drawn, by least squares of the stock, and
where `umi scan stock` puts it. What the tool does not reach stays bare. Once with enough
material, once with too little.

The folder gets clamping.html (where the first clamping is), stock.html (the raw part's stock), and
the raw part's files: `umi scan stock nominal.stl scan.csv --faces faces.toml` decides it again.

A clamping takes about 90 s of one core: the whole about 15 min of it.

The paper prints neither its angle convention nor the extent of its bar: turns are about X, then
Y, then Z; the bar is one of 76.2 by 25.4 by 40.64 mm with a step.

Examples:
  umi demo localise
  umi demo localise --more --out there
  umi demo localise --seeds 10 --json

Exit status: 0 within the goals for each seed (mean length of the error 0.10 mm, bias 0.05 mm;
industrial 0.010 mm) and nothing bare where the verdict is OK; 2 not, or the scans do not say
where the part is.";

/// The goals, mm: mean length and bias with the paper's scanner, mean length with the industrial one.
const LENGTH_MM: f64 = 0.10;
const BIAS_MM: f64 = 0.05;
const INDUSTRIAL_LENGTH_MM: f64 = 0.010;

#[derive(Serialize)]
struct Shown {
    seeds: Vec<u64>,
    paper: Summary,
    series: Vec<Series>,
    raw: Vec<RawShown>,
    ok: bool,
}

/// A raw part, cut by each placing.
#[derive(Serialize)]
struct RawShown {
    name: &'static str,
    stock_mm: f64,
    warp: f64,
    cuts: Vec<CutShown>,
}

#[derive(Serialize)]
struct CutShown {
    placing: &'static str,
    verdict: Option<&'static str>,
    least_stock_mm: Option<f64>,
    true_least_stock_mm: f64,
    bare_mm2: f64,
    lacking_mm2: f64,
    cut_max_mm: f64,
    cut_min_mm: f64,
}

/// The raw parts: name, stock on the boss, warp.
const RAW: [(&str, f64, f64); 2] = [("enough", 0.9, 1.0), ("too little", -0.4, 1.0)];

impl RawShown {
    fn new((name, stock_mm, warp): (&'static str, f64, f64), raw: &RawCut) -> Self {
        let cuts = raw.cuts.iter().map(|c| CutShown {
            placing: c.placing.name(),
            verdict: c.ok.map(|ok| if ok { "OK" } else { "NG" }),
            least_stock_mm: c.least_mm,
            true_least_stock_mm: c.true_least_mm,
            bare_mm2: c.bare_mm2,
            lacking_mm2: c.lacking_mm2,
            cut_max_mm: c.cut_mm[0],
            cut_min_mm: c.cut_mm[1],
        });
        Self {
            name,
            stock_mm,
            warp,
            cuts: cuts.collect(),
        }
    }

    /// Whether nothing is bare where the verdict is OK.
    fn holds(&self) -> bool {
        let mut cuts = self.cuts.iter();
        cuts.all(|c| c.verdict != Some("OK") || (c.bare_mm2 == 0.0 && c.lacking_mm2 == 0.0))
    }
}

/// One seed with one scanner.
#[derive(Serialize)]
struct Series {
    name: &'static str,
    seed: u64,
    summary: Summary,
    /// Clampings of which the corner lay within its 95 % region; not said with one corner alone.
    inside: Option<usize>,
    clampings: Vec<Clamping>,
}

#[derive(Clone, Serialize)]
struct Summary {
    mean_mm: [f64; 3],
    bias_mm: f64,
    scatter_mm: f64,
    length_mm: f64,
    worst_mm: f64,
}

#[derive(Serialize)]
struct Clamping {
    true_mm: [f64; 3],
    located_mm: [f64; 3],
    error_mm: [f64; 3],
    error_deg: [f64; 3],
    u_mm: f64,
    probed_error_mm: f64,
    noise_found_mm: f64,
    points: usize,
}

impl From<ErrorFigures> for Summary {
    fn from(f: ErrorFigures) -> Self {
        Self {
            mean_mm: f.mean_mm.into(),
            bias_mm: f.bias_mm,
            scatter_mm: f.scatter_mm,
            length_mm: f.length_mm,
            worst_mm: f.worst_mm,
        }
    }
}

impl From<&ClampingFound> for Clamping {
    fn from(c: &ClampingFound) -> Self {
        Self {
            true_mm: c.truth.translation_mm.into(),
            located_mm: c.found.translation_mm.into(),
            error_mm: c.error_mm().into(),
            error_deg: c.error_deg().into(),
            u_mm: c.u_mm,
            probed_error_mm: c.probed_mm.norm(),
            noise_found_mm: c.sigma_mm,
            points: c.points,
        }
    }
}

fn trouble(trouble: LocaliseTrouble) -> Failure {
    match trouble {
        LocaliseTrouble::Scene(error) => Failure::trouble("scene", error),
        LocaliseTrouble::Scan(error) => failure(error),
    }
}

impl DemoLocalise {
    pub fn run(self) -> Result<(), Failure> {
        let seeds: Vec<u64> = (0..self.seeds).map(|n| self.seed.wrapping_add(n)).collect();
        let mut kinds = vec![
            ("scanner", SCANNER_2_SIGMA_MM, 0.0),
            ("industrial", INDUSTRIAL_MM, 0.0),
        ];
        if self.more {
            kinds.push(("crooked", SCANNER_2_SIGMA_MM, RUN_OUT_RAD));
        }
        let pages = ["clamping.html", "stock.html"].map(|name| self.out.join(name));
        for page in &pages {
            self.force.check(page, &[])?;
        }
        let file = |path: &Path, error: std::io::Error| {
            Failure::trouble("file", format_args!("{}: {error}", path.display()))
        };
        std::fs::create_dir_all(&self.out).map_err(|error| file(&self.out, error))?;
        let threads = self.threads.map_or_else(Threads::all, Threads::new);
        let bar = ProgressBar::new((seeds.len() * kinds.len() * TABLE_4.len() + RAW.len()) as u64)
            .with_style(style());
        let mut series = Vec::new();
        for &seed in &seeds {
            for &(name, two_sigma_mm, misaligned_rad) in &kinds {
                let setting = LocaliseSetting {
                    scanner: ScannerKind {
                        noise_mm: two_sigma_mm / 2.0,
                        spacing_mm: SPACING_MM,
                    },
                    misaligned_rad,
                    turned_deg: &TURNED_DEG,
                    alone: self.more && name == "scanner",
                    seed,
                    threads,
                };
                bar.set_message(name);
                let found = run(&setting, &TABLE_4, |_| bar.inc(1)).map_err(trouble)?;
                if series.is_empty() {
                    let corners = cell::part().map_err(failure)?.corners();
                    let page =
                        placed_page("the bar in its first clamping", &found[0].answer, &corners);
                    std::fs::write(&pages[0], page).map_err(|error| file(&pages[0], error))?;
                }
                series.push(Series {
                    name,
                    seed,
                    summary: figures(&found).into(),
                    inside: Some(found.iter().filter(|c| c.inside).count()),
                    clampings: found.iter().map(Clamping::from).collect(),
                });
                for (k, name) in ["A alone", "B alone"].into_iter().enumerate() {
                    let errors: Vec<Vec3> =
                        found.iter().filter_map(|c| Some(c.alone_mm?[k])).collect();
                    if !errors.is_empty() {
                        series.push(Series {
                            name,
                            seed,
                            summary: ErrorFigures::of(&errors).into(),
                            inside: None,
                            clampings: Vec::new(),
                        });
                    }
                }
            }
        }
        let mut raw = Vec::new();
        for kind in RAW {
            bar.set_message(kind.0);
            let scanner = ScannerKind {
                noise_mm: INDUSTRIAL_MM / 2.0,
                spacing_mm: SPACING_MM,
            };
            let printed = Printed {
                stock_mm: kind.1,
                warp: kind.2,
            };
            let found = cut::run(&printed, &scanner, self.seed, threads, &self.out)?;
            if raw.is_empty() {
                let model = self.out.join("nominal.stl");
                let page = stock_page(&model, &found.points, &found.optimum, LEAST_STOCK_MM)
                    .map_err(failure)?;
                std::fs::write(&pages[1], page).map_err(|error| file(&pages[1], error))?;
            }
            raw.push(RawShown::new(kind, &found));
            bar.inc(1);
        }
        bar.finish_and_clear();
        let printed: Vec<Vec3> = TABLE_4.iter().map(PrintedClamping::error_mm).collect();
        let bare = raw.iter().all(RawShown::holds);
        let ok = bare
            && series.iter().all(|s| match s.name {
                "scanner" => s.summary.length_mm <= LENGTH_MM && s.summary.bias_mm <= BIAS_MM,
                "industrial" => s.summary.length_mm <= INDUSTRIAL_LENGTH_MM,
                _ => true,
            });
        let shown = Shown {
            seeds,
            paper: ErrorFigures::of(&printed).into(),
            series,
            raw,
            ok,
        };
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

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:30} {pos}/{len} clampings  {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn vector(values: &[f64; 3], digits: usize) -> Vec<String> {
    values
        .iter()
        .map(|value| format!("{:+.digits$}", Plain(*value)))
        .collect()
}

fn text(shown: &Shown) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        let _ = text.write_fmt(arguments);
        text.push('\n');
    };
    line(format_args!(
        "Table 4: located less measured (theirs), located less true (here, seed {})",
        shown.seeds.first().copied().unwrap_or(0)
    ));
    let mut table = Table::new("<<>>>>>>>").titles(&[
        "test",
        "by",
        "X, mm",
        "Y, mm",
        "Z, mm",
        "about X, deg",
        "Y",
        "Z",
        "u, mm",
    ]);
    for (number, printed) in TABLE_4.iter().enumerate() {
        let mut row = vec![(number + 1).to_string(), "paper".to_owned()];
        row.extend(vector(&printed.error_mm().into(), 2));
        row.extend(vector(&printed.error_deg().into(), 1));
        row.push(String::new());
        table.row(row);
        for name in ["scanner", "industrial"] {
            let of = shown.series.iter().find(|s| s.name == name);
            let Some(c) = of.and_then(|s| s.clampings.get(number)) else {
                continue;
            };
            let mut row = vec![String::new(), name.to_owned()];
            row.extend(vector(&c.error_mm, 4));
            row.extend(vector(&c.error_deg, 4));
            row.push(format!("{:.4}", c.u_mm));
            table.row(row);
        }
    }
    line(format_args!("{table}"));
    line(format_args!(
        "Table 5: what all clampings share (bias) and what is left (scatter)"
    ));
    let mut table = Table::new("<>>>>>>>>").titles(&[
        "by", "seed", "X, mm", "Y, mm", "Z, mm", "bias", "scatter", "length", "worst",
    ]);
    let mut row = |name: &str, seed: String, s: &Summary, digits: usize| {
        let mut row = vec![name.to_owned(), seed];
        row.extend(vector(&s.mean_mm, digits));
        for value in [s.bias_mm, s.scatter_mm, s.length_mm, s.worst_mm] {
            row.push(format!("{value:.digits$}"));
        }
        table.row(row);
    };
    row("paper", String::new(), &shown.paper, 3);
    for s in &shown.series {
        row(s.name, s.seed.to_string(), &s.summary, 4);
    }
    line(format_args!("{table}"));
    let first = |name: &str| shown.series.iter().find(|s| s.name == name);
    if let Some(c) = first("scanner").and_then(|s| s.clampings.first()) {
        line(format_args!(
            "Found by itself: noise {:.3} mm ({:.3} was set) by {} points on the bar. Nine hits of a probe: {:.4} mm off.",
            c.noise_found_mm,
            SCANNER_2_SIGMA_MM / 2.0,
            c.points,
            c.probed_error_mm
        ));
    }
    for name in ["scanner", "crooked", "industrial"] {
        let of = || shown.series.iter().filter(|s| s.name == name);
        let inside: usize = of().filter_map(|s| s.inside).sum();
        let all: usize = of().map(|s| s.clampings.len()).sum();
        if all == 0 {
            continue;
        }
        line(format_args!(
            "{name}: the corner is within its 95 % region in {inside} of {all} clampings"
        ));
    }
    line(format_args!(""));
    line(format_args!(
        "A raw part, its path put to three places and cut: what of its boss stays bare"
    ));
    let mut table = Table::new("<<<>>>>>").titles(&[
        "material",
        "place",
        "verdict",
        "least stock, mm",
        "in truth, mm",
        "bare, mm2",
        "lacking, mm2",
        "left, mm",
    ]);
    for raw in &shown.raw {
        for (k, c) in raw.cuts.iter().enumerate() {
            table.row(vec![
                if k == 0 { raw.name } else { "" }.to_owned(),
                c.placing.to_owned(),
                c.verdict.unwrap_or("").to_owned(),
                c.least_stock_mm
                    .map_or_else(String::new, |mm| format!("{mm:+.3}")),
                format!("{:+.3}", c.true_least_stock_mm),
                format!("{:.0}", c.bare_mm2),
                format!("{:.0}", c.lacking_mm2),
                format!("{:+.3} {:+.3}", c.cut_max_mm, c.cut_min_mm),
            ]);
        }
    }
    line(format_args!("{table}"));
    let goals = "the goals: mean length 0.10 mm, bias 0.05 mm; industrial 0.010 mm";
    text + &if shown.ok {
        paint(GOOD, format!("within {goals}"))
    } else {
        paint(BAD, format!("NOT within {goals}"))
    } + "\n"
}
