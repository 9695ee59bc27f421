//! `umi scan compare`

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::cloud::ScanCloud;
use umi_scan::compare::{Deviations, Nominal, deviations_mm, summary};
use umi_scan::format::clouds::read_cloud;
use umi_scan::rigid::Vec3;

use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// How far a cloud is from its nominal: signed distances, positive outside; no alignment
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Compare {
    /// Points in mm: CSV with the columns x_mm, y_mm, z_mm, or PLY
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// kind = "plane", "cylinder" or "sphere" with its figures (TOML), or a mesh (STL) in mm
    #[arg(long, value_name = "NOMINAL.toml|MESH.stl")]
    nominal: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Nominals as TOML:
  kind = \"plane\"      point_mm = [0, 0, 0]   normal = [0, 0, 1]
  kind = \"cylinder\"   point_mm = [0, 0, 0]   direction = [0, 0, 1]   radius_mm = 20.0
  kind = \"sphere\"     center_mm = [0, 0, 0]  radius_mm = 12.7

Examples:
  umi scan compare cloud.ply --nominal bore.toml
  umi scan compare cloud.csv --nominal part.stl --json | jq .rms_mm

Refused (status 2): too_few_points, not_finite, nominal.";

impl Compare {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Deviations, ScanError> {
        let nominal = Nominal::read(&self.nominal)?;
        let cloud = finite_cloud(read_cloud(&self.cloud)?, &self.cloud)?;
        summary(&deviations_mm(&cloud, &nominal))
    }
}

/// The points, if all of the file are finite.
///
/// # Errors
/// `not_finite`.
pub fn finite_cloud(cloud: ScanCloud, path: &Path) -> Result<Vec<Vec3>, ScanError> {
    if cloud.not_finite > 0 {
        return Err(ScanError::refused(
            "not_finite",
            format_args!(
                "{} points of {} are not finite",
                cloud.not_finite,
                path.display()
            ),
        ));
    }
    Ok(cloud.points)
}

/// Names and values, as text and page show them.
pub fn figures(found: &Deviations) -> Vec<Vec<String>> {
    let some =
        |value: Option<f64>| value.map_or_else(|| "none".into(), |value| format!("{value:+.6}"));
    [
        ("points", found.n.to_string()),
        ("mean", format!("{:+.6}", found.mean_mm)),
        (
            "standard deviation",
            found
                .std_mm
                .map_or_else(|| "none".into(), |std| format!("{std:.6}")),
        ),
        ("rms", format!("{:.6}", found.rms_mm)),
        ("least", format!("{:+.6}", found.min_mm)),
        ("greatest", format!("{:+.6}", found.max_mm)),
        ("mean of those above", some(found.mean_above_mm)),
        ("mean of those below", some(found.mean_below_mm)),
    ]
    .map(|(name, value)| vec![name.to_owned(), value])
    .into()
}

fn text(found: &Deviations) -> String {
    let some =
        |value: Option<f64>| value.map_or_else(|| "none".into(), |value| format!("{value:+.6} mm"));
    format!(
        "{} points, positive outside\n\nmean       {:+.6} mm\nstd        {}\nrms        {:.6} mm\n\
         least      {:+.6} mm\ngreatest   {:+.6} mm\nmean above {}\nmean below {}\n",
        found.n,
        found.mean_mm,
        found
            .std_mm
            .map_or_else(|| "none".into(), |std| format!("{std:.6} mm")),
        found.rms_mm,
        found.min_mm,
        found.max_mm,
        some(found.mean_above_mm),
        some(found.mean_below_mm)
    )
}
