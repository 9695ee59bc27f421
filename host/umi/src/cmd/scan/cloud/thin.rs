//! What the commands that make a cloud smaller have in common.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use umi_scan::ScanError;
use umi_scan::cloud::{CloudColumns, Points};
use umi_scan::format::clouds::{CloudReader, CloudStyle, write, write_cloud};
use umi_scan::thin::drops::{Dropped, Drops};

use crate::cmd::Format;
use crate::cmd::scan::answer::{answer, failure};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::progress::Progress;

/// A cloud in and a cloud out.
#[derive(Args)]
pub(crate) struct Clouds {
    /// The cloud: CSV with the columns x_mm,y_mm,z_mm (or x,y,z, or without names), PLY, PCD, LAS, LAZ, E57, or the corners of an STL
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// Where the points go, by the extension: .csv, .ply, .pcd, .las, .laz, .e57, .parquet;
    /// .stl makes a mesh of the grid of one view, holes left open
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
    /// Coordinates of a PLY or PCD file as doubles instead of floats
    #[arg(long)]
    double: bool,
    /// The longest edge of a mesh (.stl); without, four times the usual diagonal of its grid
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    longest_mm: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

/// What was done.
#[derive(Serialize)]
pub(crate) struct Thinned {
    kind: &'static str,
    points: u64,
    kept: u64,
    not_finite: u64,
    dropped: Vec<Dropped>,
    /// What a reader of the file may take wrongly.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

/// A step from points to fewer points.
pub(crate) type Step<'s> =
    dyn for<'a> Fn(Points<'a>, &'a RefCell<Drops>) -> Result<Points<'a>, ScanError> + 's;

impl Clouds {
    /// Reads, takes the step, writes, answers. `enough` is told what the cloud says of its points; `notes` are part of the answer.
    pub fn run(
        &self,
        kind: &'static str,
        dropped: Option<&Path>,
        enough: impl Fn(CloudColumns) -> Result<(), ScanError>,
        merged: bool,
        step: &Step<'_>,
        notes: &[&str],
    ) -> Result<(), Failure> {
        self.force.check(&self.output, &[&self.cloud])?;
        if let Some(path) = dropped {
            self.force.check(path, &[&self.cloud])?;
            if path == self.output {
                return Err(failure(ScanError::unreadable(
                    "file",
                    "the points that stay and those that go need a file each",
                )));
            }
        }
        let make = || -> Result<Thinned, ScanError> {
            let progress = Progress::new(self.format.json);
            progress.stage("the cloud's beginning");
            write::check_extension(&self.output)?;
            let mut reader = CloudReader::open(&self.cloud)?;
            enough(reader.columns)?;
            let style = CloudStyle {
                columns: if merged {
                    // A mean of several points is of no profile.
                    CloudColumns {
                        intensity: reader.columns.intensity,
                        mount_u: reader.columns.mount_u,
                        interpolated: reader.columns.interpolated,
                        ..CloudColumns::default()
                    }
                } else {
                    reader.columns
                },
                double: self.double,
                longest_mm: self.longest_mm,
            };
            let drops = RefCell::new(match dropped {
                Some(path) => Drops::to_file(path, reader.columns)?,
                None => Drops::default(),
            });
            let mut points = step(progress.through(reader.points()), &drops)?.peekable();
            if points.peek().is_none() {
                drop(points);
                return Err(nothing_left(&drops.borrow().counts));
            }
            let written = write_cloud(&self.output, style, Box::new(points))?;
            let dropped = drops.into_inner().finish()?;
            let mut warnings: Vec<String> = notes.iter().map(|note| (*note).to_owned()).collect();
            warnings.extend(write::notes(&self.output, self.double, written.farthest_mm));
            if style.columns.mount_u && !write::holds_uncertainty(&self.output) {
                warnings.push(
                    "This format has no room for the column mount_u_mm: it is left out.".into(),
                );
            }
            if style.columns.interpolated && !write::holds_interpolated(&self.output) {
                warnings.push(
                    "This format has no room for the mark of interpolated points (interpolated): it is left out.".into(),
                );
            }
            Ok(Thinned {
                kind,
                points: written.points
                    + dropped.iter().map(|d| d.points).sum::<u64>()
                    + reader.not_finite,
                kept: written.points,
                not_finite: reader.not_finite,
                dropped,
                warnings,
            })
        };
        answer(make(), self.format.json, text)
    }
}

/// A file without points would be taken for a part that is not there.
fn nothing_left(dropped: &[Dropped]) -> ScanError {
    if dropped.is_empty() {
        return ScanError::refused(
            "nothing_left",
            "The cloud has no points: nothing is written.",
        );
    }
    let reasons = dropped
        .iter()
        .map(|d| format!("{} {}", d.points, d.reason.replace('_', " ")));
    let reasons: Vec<String> = reasons.collect();
    ScanError::refused(
        "nothing_left",
        format_args!(
            "No point of the cloud stays ({}): nothing is written. Look at what is asked for, its unit and frame.",
            reasons.join(", ")
        ),
    )
}

fn text(thinned: &Thinned) -> String {
    let mut text = format!("{} of {} points\n", thinned.kept, thinned.points);
    for d in &thinned.dropped {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:>12} {}", d.points, d.reason.replace('_', " "));
    }
    if thinned.not_finite > 0 {
        let _ = writeln!(text, "{:>12} not finite", thinned.not_finite);
    }
    for warning in &thinned.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// So many numbers, as `1,2,3`.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    found
        .ok()
        .and_then(|list| list.try_into().ok())
        .filter(|list: &[f64; N]| list.iter().all(|x| x.is_finite()))
        .ok_or_else(|| format!("give {N} numbers with commas between"))
}

/// A number above 0.
pub(crate) fn above_zero(text: &str) -> Result<f64, String> {
    text.trim()
        .parse()
        .ok()
        .filter(|x: &f64| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "give a number above 0".into())
}
