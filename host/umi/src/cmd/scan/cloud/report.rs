//! `umi scan report`

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use umi_report::pages::deviation::{Bands, DeviationPage, html};
use umi_scan::ScanError;
use umi_scan::compare::{Deviations, Nominal, strays, summary};
use umi_scan::format::clouds::read_cloud;
use umi_scan::parallel::Threads;

use super::compare::{finite_cloud, nearest_shown};
use super::deviation_page::{Compared, beyond, page};
use super::limits::limits;
use super::merged::MergeLosses;
use crate::cmd::Format;
use crate::cmd::scan::answer::failure;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::progress::Progress;
use crate::show::terminal::{print, print_json};

/// A page on a cloud beside its nominal: maps, sections, a histogram, and a view that turns
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Report {
    /// Points in mm: CSV with the columns x_mm, y_mm, z_mm, PLY, PCD, LAS, E57 and what else is read
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// What `umi scan compare` takes: a shape with its figures (TOML), or a mesh in mm (STL, OBJ, STEP)
    #[arg(long, value_name = "NOMINAL.toml|MESH.stl")]
    nominal: PathBuf,
    /// Where the page goes
    #[arg(short, long, value_name = "PAGE.html")]
    output: PathBuf,
    /// Between which deviations a point is good, in mm; without, the colours end where 99 % of the points do
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = limits)]
    limits: Option<Bands>,
    /// A section across an axis, as y=12.5 (mm); several may be given. Without any, three through the middle
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

A section is drawn across its axis at that coordinate of the cloud's frame. Its points are those of a slice
about that plane: 0.05 % of the largest dimension to each side at first, doubled until 800 points are in it, at most
to 1 %. Points where the nominal leans more than 30 degrees out of the plane are left out, because
their deviation is not within it. The page states how many points a section has, and how thick it is. Without a point in the slice
there is no drawing.

Examples:
  umi scan report cloud.ply --nominal part.stl -o page.html
  umi scan report cloud.csv --nominal bore.toml --limits -0.02,0.03 -o page.html
  umi scan merge p.csv scan.csv --machine mill.toml -o cloud.ply --json > merge.json
  umi scan report cloud.ply --nominal part.stl --merge merge.json --section x=10 -o page.html

With --json: `kind` \"scan_report\", the figures of `umi scan compare`, `limits_mm` or null, `below` and
`above` (points beyond them), `lost_frames` or null.

Exit status: 0 written, whatever the deviations; 1 a file (bad_file) or usage; 2 refused:
too_few_points, not_finite, nominal.";

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
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
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
        let notes: String = reported
            .warnings
            .iter()
            .map(|warning| format!("warning: {warning}\n"))
            .collect();
        print(&format!(
            "{}\n{}\n{notes}",
            page.result,
            self.output.display()
        ))
    }

    fn make(&self) -> Result<(DeviationPage, Reported), ScanError> {
        let progress = Progress::new(self.format.json);
        progress.stage("reading the nominal");
        let nominal = Nominal::read(&self.nominal)?;
        progress.stage("reading the cloud");
        let losses = self.merge.as_deref().map(MergeLosses::read).transpose()?;
        let cloud = finite_cloud(read_cloud(&self.cloud)?, &self.cloud)?;
        let threads = self.threads.map_or_else(Threads::all, Threads::new);
        let near = nearest_shown(&cloud, &nominal, threads, &progress)?;
        progress.stage("drawing the page");
        let deviations: Vec<f64> = near.iter().map(|near| near.distance_mm).collect();
        let found = summary(&deviations)?;
        let beyond = self.limits.map(|bands| beyond(&near, bands));
        let mut warnings = nominal.warnings(&cloud);
        warnings.extend(strays(&cloud, &deviations));
        let page = page(&Compared {
            cloud: &self.cloud,
            nominal: &self.nominal,
            surface: &nominal,
            points: &cloud,
            near: &near,
            found: &found,
            limits: self.limits,
            sections: &self.section,
            losses: losses.as_ref(),
            remarks: warnings.clone(),
        });
        let reported = Reported {
            kind: "scan_report",
            limits_mm: self.limits.map(|b| [b.low_mm, b.high_mm]),
            below: beyond.map(|(below, _)| below),
            above: beyond.map(|(_, above)| above),
            lost_frames: losses.as_ref().map(|l| l.lost_frames),
            figures: found,
            warnings,
        };
        Ok((page, reported))
    }
}
