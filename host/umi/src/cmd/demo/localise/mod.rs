//! `umi demo localise`

mod tables;

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use serde_json::{Map, Value};
use umi_experiment::localise::cell::{self, ScannerKind};
use umi_experiment::localise::cut::{self, RawCut};
use umi_experiment::localise::figures::ErrorFigures;
use umi_experiment::localise::paper::{
    Counterpart, INDUSTRIAL_MM, PARAMETERS, PrintedClamping, PrintedParameter, RUN_OUT_RAD,
    SCANNER_2_SIGMA_MM, SPACING_MM, TABLE_4,
};
use umi_experiment::localise::raw::{LEAST_STOCK_MM, Printed};
use umi_experiment::localise::run::{
    ClampingFound, ClampingTried, LocaliseSetting, LocaliseTrouble, TURNED_DEG, figures, run,
};
use umi_scan::ScanError;
use umi_scan::localise::Chosen;
use umi_scan::parallel::Threads;
use umi_scan::rigid::Vec3;

use crate::cmd::Format;
use crate::cmd::scan::{failure, placed_page, stock_page};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{print, print_json};

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

What the paper set in its tables 2 and 3 by trial and error stands beside what was found without being
set, and each kind over all seeds.

The folder gets clamping.html (where the first clamping is that was found, and all tables), stock.html (the raw
part's stock), and the raw part's files: `umi scan stock nominal.stl scan.csv --faces faces.toml` decides it again.

A clamping takes about 90 s of one core: the whole about 15 min of it.

The paper prints neither its angle convention nor the extent of its bar: turns are about X, then
Y, then Z; the bar is one of 76.2 by 25.4 by 40.64 mm with a step.

Examples:
  umi demo localise
  umi demo localise --more --out there
  umi demo localise --seeds 10 --json

A clamping that is refused has its line in the tables, with the reason's name; the others go on.

Exit status: 0 within the goals for each seed (mean length of the error 0.10 mm, bias 0.05 mm;
industrial 0.010 mm) and nothing bare where the verdict is OK; 2 not, or the scans of a clamping
do not say by both corners where the part is.";

/// The goals, mm: mean length and bias with the paper's scanner, mean length with the industrial one.
const LENGTH_MM: f64 = 0.10;
const BIAS_MM: f64 = 0.05;
const INDUSTRIAL_LENGTH_MM: f64 = 0.010;

#[derive(Serialize)]
struct Shown {
    seeds: Vec<u64>,
    paper: Summary,
    series: Vec<Series>,
    /// Each kind over all seeds.
    spread: Vec<Spread>,
    parameters: Vec<Parameter>,
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
    /// None where no clamping said where the part is.
    summary: Option<Summary>,
    /// Clampings of which the corner lay within its 95 % region; not said with one corner alone.
    inside: Option<usize>,
    /// Why the scans did not say where the part is, each time.
    refused: Vec<&'static str>,
    /// The same, and which clamping it was.
    refusals: Vec<Refusal>,
    clampings: Vec<Clamping>,
}

impl Series {
    /// By both corners.
    fn joint(name: &'static str, seed: u64, tried: &[ClampingTried]) -> Self {
        let found = || tried.iter().filter_map(|t| t.found.as_ref().ok());
        let refusals = Refusal::of(tried.iter().map(|t| t.found.as_ref().err()));
        let clampings = tried.iter().enumerate().filter_map(|(k, t)| {
            let found = t.found.as_ref().ok()?;
            Some(Clamping::new(k + 1, found))
        });
        Self {
            name,
            seed,
            summary: found().next().map(|_| figures(found()).into()),
            inside: Some(found().filter(|c| c.inside).count()),
            refused: refusals.iter().map(|r| r.code).collect(),
            refusals,
            clampings: clampings.collect(),
        }
    }

    /// By one corner alone: by number, 0 or 1. None if that was not asked.
    fn alone(name: &'static str, k: usize, seed: u64, tried: &[ClampingTried]) -> Option<Self> {
        let of: Vec<&Result<Vec3, ScanError>> = tried
            .iter()
            .map(|t| t.alone_mm.as_ref().map(|alone| &alone[k]))
            .collect::<Option<_>>()?;
        let errors: Vec<Vec3> = of.iter().filter_map(|e| e.as_ref().ok()).copied().collect();
        let refusals = Refusal::of(of.iter().map(|e| e.as_ref().err()));
        Some(Self {
            name,
            seed,
            summary: (!errors.is_empty()).then(|| ErrorFigures::of(&errors).into()),
            inside: None,
            refused: refusals.iter().map(|r| r.code).collect(),
            refusals,
            clampings: Vec::new(),
        })
    }

    /// Whether it keeps the goals. A clamping that both corners do not place keeps none.
    fn holds(&self) -> bool {
        let Some(f) = &self.summary else {
            return !self.is_joint();
        };
        let within = match self.name {
            "scanner" => f.length_mm <= LENGTH_MM && f.bias_mm <= BIAS_MM,
            "industrial" => f.length_mm <= INDUSTRIAL_LENGTH_MM,
            _ => true,
        };
        within && (!self.is_joint() || self.refusals.is_empty())
    }

    fn is_joint(&self) -> bool {
        self.inside.is_some()
    }
}

/// Why the scans of a clamping did not say where the part is.
#[derive(Serialize)]
struct Refusal {
    /// From 1 on, as table 4 has them.
    clamping: usize,
    code: &'static str,
    message: String,
    /// What else `umi scan localise --json` says of it.
    #[serde(flatten)]
    details: Map<String, Value>,
}

impl Refusal {
    fn of<'a>(errors: impl Iterator<Item = Option<&'a ScanError>>) -> Vec<Self> {
        let refused = errors.enumerate().filter_map(|(k, error)| {
            let error = error?;
            Some(Self {
                clamping: k + 1,
                code: error.code,
                message: error.message.clone(),
                details: error.details.clone(),
            })
        });
        refused.collect()
    }
}

/// Smallest, middle and largest over the seeds.
#[derive(Serialize)]
struct Range {
    min: f64,
    median: f64,
    max: f64,
}

impl Range {
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut all: Vec<f64> = values.collect();
        all.sort_unstable_by(f64::total_cmp);
        let (min, max) = (*all.first()?, *all.last()?);
        let median = (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0;
        Some(Self { min, median, max })
    }
}

/// A kind over all seeds.
#[derive(Serialize)]
struct Spread {
    name: &'static str,
    seeds: usize,
    length_mm: Option<Range>,
    bias_mm: Option<Range>,
    scatter_mm: Option<Range>,
    /// The worst error of all.
    worst_mm: Option<f64>,
    /// Clampings within their 95 % regions, and of how many; not said with one corner alone.
    inside: Option<[usize; 2]>,
    /// Clampings that were refused.
    refused: usize,
}

impl Spread {
    fn of(name: &'static str, series: &[Series]) -> Option<Self> {
        let of = || series.iter().filter(move |s| s.name == name);
        of().next()?;
        let range = |figure: fn(&Summary) -> f64| {
            Range::of(of().filter_map(|s| s.summary.as_ref()).map(figure))
        };
        let inside: Option<usize> = of().map(|s| s.inside).sum();
        Some(Self {
            name,
            seeds: of().count(),
            length_mm: range(|s| s.length_mm),
            bias_mm: range(|s| s.bias_mm),
            scatter_mm: range(|s| s.scatter_mm),
            worst_mm: range(|s| s.worst_mm).map(|range| range.max),
            inside: inside.map(|inside| [inside, of().map(|s| s.clampings.len()).sum()]),
            refused: of().map(|s| s.refused.len()).sum(),
        })
    }
}

/// A parameter of the paper beside what stands for it here, in the first clamping.
#[derive(Serialize)]
struct Parameter {
    name: &'static str,
    paper: &'static str,
    /// Why there is none here.
    none: Option<&'static str>,
    scanner_mm: Option<f64>,
    industrial_mm: Option<f64>,
}

impl Parameter {
    fn new(printed: &PrintedParameter, series: &[Series]) -> Self {
        let first = |name: &str| {
            let of = series.iter().find(|s| s.name == name)?;
            let c = of.clampings.first().filter(|c| c.number == 1)?;
            match printed.here {
                Counterpart::Normals => c.chosen.normals_mm,
                Counterpart::Search => c.chosen.search_mm,
                Counterpart::Reach => c.chosen.reach_mm,
                Counterpart::Enough => c.chosen.enough_mm,
                Counterpart::Noise => Some(c.noise_found_mm),
                Counterpart::None(_) => None,
            }
        };
        Self {
            name: printed.name,
            paper: printed.set,
            none: match printed.here {
                Counterpart::None(why) => Some(why),
                _ => None,
            },
            scanner_mm: first("scanner"),
            industrial_mm: first("industrial"),
        }
    }
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
    /// From 1 on, as table 4 has them.
    number: usize,
    true_mm: [f64; 3],
    located_mm: [f64; 3],
    error_mm: [f64; 3],
    error_deg: [f64; 3],
    u_mm: f64,
    probed_error_mm: f64,
    noise_found_mm: f64,
    points: usize,
    #[serde(skip)]
    chosen: Chosen,
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

impl Clamping {
    fn new(number: usize, c: &ClampingFound) -> Self {
        Self {
            number,
            true_mm: c.truth.translation_mm.into(),
            located_mm: c.found.translation_mm.into(),
            error_mm: c.error_mm().into(),
            error_deg: c.error_deg().into(),
            u_mm: c.u_mm,
            probed_error_mm: c.probed_mm.norm(),
            noise_found_mm: c.sigma_mm,
            points: c.points,
            chosen: c.answer.located.chosen,
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
        let mut first = None;
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
                let tried = run(&setting, &TABLE_4, |_| bar.inc(1)).map_err(trouble)?;
                series.push(Series::joint(name, seed, &tried));
                for (k, name) in ["A alone", "B alone"].into_iter().enumerate() {
                    series.extend(Series::alone(name, k, seed, &tried));
                }
                // The page shows the first clamping that was found.
                if first.is_none() {
                    let mut found = tried.into_iter().enumerate();
                    first = found.find_map(|(k, t)| Some((k, t.found.ok()?.answer)));
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
        let ok = bare && series.iter().all(Series::holds);
        let shown = Shown {
            seeds,
            paper: ErrorFigures::of(&printed).into(),
            spread: ["scanner", "A alone", "B alone", "crooked", "industrial"]
                .into_iter()
                .filter_map(|name| Spread::of(name, &series))
                .collect(),
            parameters: PARAMETERS
                .iter()
                .map(|printed| Parameter::new(printed, &series))
                .collect(),
            series,
            raw,
            ok,
        };
        if let Some((k, answer)) = &first {
            let corners = cell::part().map_err(failure)?.corners();
            let more = tables::all(&shown);
            let title = format!("the bar in clamping {} of table 4", k + 1);
            let page = placed_page(&title, answer, &corners, more);
            std::fs::write(&pages[0], page).map_err(|error| file(&pages[0], error))?;
        }
        if self.format.json {
            let value = serde_json::to_value(&shown)
                .map_err(|error| Failure::trouble("json", format_args!("no JSON: {error}")))?;
            print_json(&value)?;
        } else {
            print(&tables::text(&shown))?;
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
