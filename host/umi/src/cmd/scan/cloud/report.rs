//! `umi scan report`

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use umi_report::deviation::{Bands, DeviationPage, DeviationPoint, Section, html};
use umi_report::scan::FigureTable;
use umi_scan::ScanError;
use umi_scan::compare::{Deviations, Nominal, nearest, summary};
use umi_scan::format::clouds::read_cloud;
use umi_scan::parallel::Threads;
use umi_scan::rigid::Vec3;

use super::compare::{figures, finite_cloud};
use super::merged::MergeLosses;
use crate::cmd::Format;
use crate::cmd::scan::answer::failure;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{print, print_json};

/// A page on a cloud beside its nominal: maps, sections, a histogram, and a view that turns
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Report {
    /// Points in mm: CSV with the columns x_mm, y_mm, z_mm, PLY, PCD, LAS, E57 and what else is read
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// kind = "plane", "cylinder" or "sphere" with its figures (TOML), or a mesh (STL) in mm
    #[arg(long, value_name = "NOMINAL.toml|MESH.stl")]
    nominal: PathBuf,
    /// Where the page goes
    #[arg(short, long, value_name = "PAGE.html")]
    output: PathBuf,
    /// Between which deviations a point is good, in mm; without, the colours end where 99 % of the points do
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = limits)]
    limits: Option<Bands>,
    /// A section across an axis, as y=12.5 (mm); without any, three through the middle
    #[arg(long, value_name = "AXIS=MM", value_parser = section)]
    section: Vec<(usize, f64)>,
    /// What `umi scan merge --json` (or `pair`) has printed: lost frames and all that was not used
    #[arg(long, value_name = "MERGE.json")]
    merge: Option<PathBuf>,
    /// Threads; the page is the same for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The page is one file: it loads nothing and sends nothing, and runs one script, its own, that turns
the points under the mouse. Nothing is aligned: see `umi scan localise` for that.

Examples:
  umi scan report cloud.ply --nominal part.stl -o page.html
  umi scan report cloud.csv --nominal bore.toml --limits -0.02,0.03 -o page.html
  umi scan merge p.csv scan.csv --machine mill.toml -o cloud.ply --json > merge.json
  umi scan report cloud.ply --nominal part.stl --merge merge.json --section x=10 -o page.html

With --json: `kind` \"scan_report\", the figures of `umi scan compare`, `limits_mm` or null, `below` and
`above` (points beyond them), `lost_frames` or null.

Exit status: 0 written, whatever the deviations; 1 a file (bad_file) or usage; 2 refused:
too_few_points, not_finite, nominal.";

fn limits(text: &str) -> Result<Bands, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|number| number.trim().parse().map_err(|_| number.to_owned()))
        .collect::<Result<_, _>>()
        .map_err(|number| format!("`{number}` is no number"))?;
    match numbers[..] {
        [low_mm, high_mm] if low_mm.is_finite() && high_mm.is_finite() && low_mm < high_mm => {
            Ok(Bands { low_mm, high_mm })
        }
        _ => Err("two numbers are needed, the lower first: -0.05,0.05".into()),
    }
}

fn section(text: &str) -> Result<(usize, f64), String> {
    let wrong = || format!("`{text}` is no section: x=10, y=-2.5 or z=0");
    let (axis, at) = text.split_once('=').ok_or_else(wrong)?;
    let axis = ["x", "y", "z"]
        .iter()
        .position(|name| name.eq_ignore_ascii_case(axis.trim()))
        .ok_or_else(wrong)?;
    let at: f64 = at.trim().parse().map_err(|_| wrong())?;
    at.is_finite().then_some((axis, at)).ok_or_else(wrong)
}

#[derive(Serialize)]
struct Reported {
    kind: &'static str,
    #[serde(flatten)]
    figures: Deviations,
    limits_mm: Option<[f64; 2]>,
    below: Option<usize>,
    above: Option<usize>,
    lost_frames: Option<u64>,
}

impl Report {
    pub fn run(self) -> Result<(), Failure> {
        let inputs: Vec<&Path> = [&self.cloud, &self.nominal]
            .into_iter()
            .chain(&self.merge)
            .map(PathBuf::as_path)
            .collect();
        self.force.check(&self.output, &inputs)?;
        let (page, reported) = self.make().map_err(failure)?;
        self.force.write(&self.output, &inputs, html(&page))?;
        if self.format.json {
            let value = serde_json::to_value(&reported)
                .map_err(|error| Failure::trouble("json", format_args!("no JSON: {error}")))?;
            return print_json(&value);
        }
        print(&format!("{}\n{}\n", page.result, self.output.display()))
    }

    fn make(&self) -> Result<(DeviationPage, Reported), ScanError> {
        let nominal = Nominal::read(&self.nominal)?;
        let losses = self.merge.as_deref().map(MergeLosses::read).transpose()?;
        let cloud = finite_cloud(read_cloud(&self.cloud)?, &self.cloud)?;
        let threads = self.threads.map_or_else(Threads::all, Threads::new);
        let near = nearest(&cloud, &nominal, threads)?;
        let deviations: Vec<f64> = near.iter().map(|near| near.distance_mm).collect();
        let found = summary(&deviations)?;
        let points: Vec<DeviationPoint> = cloud
            .iter()
            .zip(&near)
            .map(|(p, near)| DeviationPoint {
                at_mm: [p.x, p.y, p.z],
                deviation_mm: near.distance_mm,
                outward: [0, 1, 2].map(|i| near.direction[i] as f32),
            })
            .collect();
        drop(near);
        let bands = self.limits.unwrap_or_else(|| spread(deviations));
        let below = points
            .iter()
            .filter(|p| p.deviation_mm < bands.low_mm)
            .count();
        let above = points
            .iter()
            .filter(|p| p.deviation_mm > bands.high_mm)
            .count();
        let name = |path: &Path| {
            path.file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        };
        let beyond = below + above;
        let share = 100.0 * beyond as f64 / found.n as f64;
        let (unit, _) = bands.unit();
        let range = format!(
            "{} to {} {unit}",
            bands.said(bands.low_mm),
            bands.said(bands.high_mm)
        );
        let result = match self.limits {
            Some(_) if beyond == 0 => format!("All {} points lie within {range}", found.n),
            Some(_) => format!(
                "{beyond} of {} points ({share:.2} %) lie outside of {range}: {below} below, {above} above",
                found.n
            ),
            None => format!(
                "{} points, rms {:.4} mm; no limits were given",
                found.n, found.rms_mm
            ),
        };
        let mut facts = vec![
            ("cloud", name(&self.cloud)),
            ("nominal", name(&self.nominal)),
            (
                "limits",
                match self.limits {
                    Some(_) => range,
                    None => format!(
                        "none given; the colours end at {range}, about where 99 % of the points do"
                    ),
                },
            ),
            (
                "alignment",
                "none: the points are where the cloud has them".to_owned(),
            ),
        ];
        let (low, high) = span(&cloud);
        facts.push((
            "the points span, mm",
            (0..3)
                .map(|i| format!("{} {:.3} to {:.3}", ["X", "Y", "Z"][i], low[i], high[i]))
                .collect::<Vec<_>>()
                .join(", "),
        ));
        let mut tables = vec![FigureTable {
            caption: "Deviations, positive outside of the nominal".into(),
            heads: vec!["figure", "mm"],
            rows: figures(&found).split_off(1),
        }];
        let mut remarks = Vec::new();
        if let Some(losses) = &losses {
            tables.extend(losses.tables());
            remarks.extend(losses.remarks());
        }
        let cuts = if self.section.is_empty() {
            (0..3)
                .map(|i| (i, f64::midpoint(low[i], high[i])))
                .collect()
        } else {
            self.section.clone()
        };
        let sections = cuts
            .into_iter()
            .map(|(axis, at_mm)| Section {
                axis,
                at_mm,
                lines: nominal
                    .section(axis, at_mm)
                    .into_iter()
                    .map(|ends| ends.map(|p| [p.x, p.y, p.z]))
                    .collect(),
            })
            .collect();
        let reported = Reported {
            kind: "scan_report",
            limits_mm: self.limits.map(|b| [b.low_mm, b.high_mm]),
            below: self.limits.map(|_| below),
            above: self.limits.map(|_| above),
            lost_frames: losses.as_ref().map(|l| l.lost_frames),
            figures: found,
        };
        let page = DeviationPage {
            title: format!("{} beside {}", name(&self.cloud), name(&self.nominal)),
            result,
            ok: self.limits.is_none() || beyond == 0,
            facts,
            tables,
            remarks,
            points,
            bands,
            limits: self.limits.is_some(),
            sections,
        };
        Ok((page, reported))
    }
}

/// A round number, up and down, that 99 % of the deviations lie within.
fn spread(mut deviations: Vec<f64>) -> Bands {
    for d in &mut deviations {
        *d = d.abs();
    }
    let at = (deviations.len() * 99 / 100).min(deviations.len() - 1);
    let (_, most, _) = deviations.select_nth_unstable_by(at, f64::total_cmp);
    // A tenth of a nanometre where there is no deviation at all.
    let most = most.max(1e-7);
    let decade = 10_f64.powi(most.log10().floor() as i32);
    let high_mm = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * decade)
        .find(|round| *round >= most)
        .unwrap_or(10.0 * decade);
    Bands {
        low_mm: -high_mm,
        high_mm,
    }
}

fn span(points: &[Vec3]) -> (Vec3, Vec3) {
    let first = points.first().copied().unwrap_or_else(Vec3::zeros);
    points
        .iter()
        .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)))
}
