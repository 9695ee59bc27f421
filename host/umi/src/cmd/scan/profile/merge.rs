//! `umi scan merge`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::Force;
use clap::Args;
use umi_kinematics::Pose;
use umi_scan::ScanError;
use umi_scan::format::clouds::write;
use umi_scan::format::machine;
use umi_scan::format::points::{PointFile, PointSink, PointStyle};
use umi_scan::format::poses::PoseFile;
use umi_scan::merge::{MergeOptions, Merged, merge};

use super::pair::{self, Latency, Streams};
use crate::cmd::Format;
use crate::cmd::scan::answer::answer;
use crate::show::progress::Progress;

/// Profiles and positions become a cloud of points in the workpiece frame
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Merge {
    #[command(flatten)]
    streams: Streams,
    /// The machine file: its axes as chains, the sensor's mount
    #[arg(long, value_name = "MACHINE.toml")]
    machine: PathBuf,
    #[command(flatten)]
    latency: Latency,
    /// Where the points go: .csv (with profile and index), .ply (binary), .pcd, .las, .laz, .e57
    /// or .parquet; .stl makes a mesh of the grid of one view, holes left open
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
    /// Coordinates of a PLY or PCD file as doubles instead of floats
    #[arg(long)]
    double: bool,
    /// PLY with the columns `profile` and `index`, which `umi scan filter --spike`, `--mixed`,
    /// `crop --profiles` and a mesh (.stl) need; CSV, PCD, E57 and Parquet always have them
    #[arg(long, conflicts_with = "each_profile")]
    profiles_too: bool,
    /// The time of each point in microseconds of the board's clock, as the column `t_us`; LAS, LAZ and E57 have it in
    /// seconds, as their standards name it (GPS time, timeStamp)
    #[arg(long, conflicts_with = "each_profile")]
    times_too: bool,
    /// The standard uncertainty of each point by that of the sensor's mount, as the column `mount_u_mm`: CSV, PLY, PCD
    /// and Parquet
    #[arg(long, conflicts_with = "each_profile")]
    uncertainty_too: bool,
    /// How bright the sensor saw each point, as the column `intensity`, in its own measure: of a `.gocator` capture
    /// whose sensor sends intensities (0 to 255), or of profiles as CSV with a column `intensity`
    #[arg(long, conflicts_with = "each_profile")]
    intensity_too: bool,
    /// E57 with a scan for each profile: points in the sensor's frame, and the sensor's pose
    #[arg(long)]
    each_profile: bool,
    /// Where the sensor was at each profile, as `umi scan filter` wants it
    #[arg(long, value_name = "POSES.csv")]
    poses: Option<PathBuf>,
    /// If the board lost motion of an axis, take the profiles before; those behind it are named
    /// (`behind_loss`)
    #[arg(long)]
    until_loss: bool,
    /// A profile whose latch was lost gets its place from the latches before and behind it, where
    /// these are at most so far apart; without, it is left out
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    interpolate_ms: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Profiles are paired as by `umi scan pair`; every valid sample of a paired profile becomes a
point. With a latency the counts are taken from the straight line between the latches on
either side of that moment; behind a loss of motion nothing is taken. Where the scan is refused, no
file is written, and one that was there stays. Where no sample has a range the cloud is empty, and a note
says so (`no_range`). Until it is complete the cloud is CLOUD.part; an interrupt takes that away.

With --interpolate-ms the answer names the profiles that no latch placed (`interpolated`): their
points stand on a straight line between two latches, whatever the axes did there. In the cloud they are
marked, and stay so through filter, crop, sample and convert: by the column `interpolated` (0 or 1) of
CSV, PLY, PCD and Parquet, and by the synthetic flag of LAS and LAZ. E57 and STL have no room for it: a
warning says so, and the answer's list is all. A cloud without such points has no such column.

The time of a point (--times-too) is that of its edge plus --latency-us: the moment for which its
counts were taken. All points of a profile have the same.

With --intensity-too each point has the intensity of its sample, which `umi scan filter
--intensity` goes by and every command behind keeps. Where a profile with samples has none the
scan is refused (`no_intensity`): 0 would say that it was dark. LAS and LAZ hold whole numbers of
0 to 65535.

With --uncertainty-too each point has the standard uncertainty that the mount's covariance in the machine
file gives it: the root of the variances along x, y and z together. The noise of the sensor and errors of the
axes are not in it.

Floats keep 24 bits: at 800 mm they are right within 0.03 µm; --double keeps all. A PLY whose first
point lies beyond 2 m has doubles, whether asked for or not. Its offset is always 0, and its header says so.

Examples:
  umi scan merge profiles.csv scan.csv --machine mill.toml -o cloud.ply
  umi scan merge part.gocator scan.csv --machine c800u.toml --latency-us 150 -o cloud.csv
  umi scan merge part.gocator scan.csv --machine c800u.toml --encoder x -o cloud.ply --double
  umi scan merge part.gocator scan.csv --machine c800u.toml --profiles-too --times-too -o cloud.ply
  umi scan merge part.gocator scan.csv --machine c800u.toml --intensity-too -o cloud.ply
  umi scan merge part.gocator scan.csv --machine found.toml --uncertainty-too -o cloud.parquet
  umi scan merge part.gocator scan.csv --machine c800u.toml --interpolate-ms 20 -o cloud.e57
  umi scan merge part.gocator scan.csv --machine c800u.toml --each-profile -o profiles.e57
  umi scan merge part.gocator scan.csv --machine c800u.toml --poses poses.csv -o cloud.csv

Refused (status 2): as `umi scan pair`, machine, missing_axis, not_finite, motion_lost, latency, too_few_latches,
no_grid, too_many_profiles, no_uncertainty, no_intensity.";

fn milliseconds(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|ms: &f64| ms.is_finite() && *ms > 0.0)
        .ok_or_else(|| format!("`{text}` is no time above 0"))
}

impl Merge {
    pub fn run(self) -> Result<(), Failure> {
        let inputs = [
            &*self.machine,
            &*self.streams.profiles,
            &*self.streams.triggers,
        ];
        self.force.check(&self.output, &inputs)?;
        if let Some(poses) = &self.poses {
            self.force.check(poses, &inputs)?;
            if *poses == self.output {
                return Err(Failure::trouble(
                    "file",
                    "points and poses need a file each",
                ));
            }
        }
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Merged, ScanError> {
        let progress = Progress::new(self.format.json);
        progress.stage("pairing profiles and latches");
        let machine = machine::read(&self.machine)?;
        let triggers = self.streams.read_triggers()?;
        let mut file = Files {
            points: if self.each_profile {
                PointFile::each_profile(&self.output)?
            } else {
                PointFile::create(
                    &self.output,
                    PointStyle {
                        double: self.double,
                        profiles: self.profiles_too,
                        times: self.times_too,
                        uncertainties: self.uncertainty_too,
                        intensities: self.intensity_too,
                        interpolated: false,
                    },
                )?
            },
            poses: self.poses.as_deref().map(PoseFile::create).transpose()?,
            progress,
            profiles: 0,
        };
        let mut merged = merge(
            &self.streams.profiles,
            &triggers,
            &machine,
            &MergeOptions {
                pairing: self.streams.options(),
                latency_us: self.latency.latency_us,
                until_loss: self.until_loss,
                interpolate_us: self.interpolate_ms.map(|ms| ms * 1e3),
                uncertainties: self.uncertainty_too,
                intensities: self.intensity_too,
            },
            &mut file,
        )?;
        let farthest_mm = merged.bounds_mm.map_or(0.0, |bounds| bounds.farthest_mm());
        merged
            .pairing
            .warnings
            .extend(write::notes(&self.output, self.double, farthest_mm));
        let marked = merged
            .interpolated
            .as_ref()
            .is_some_and(|all| !all.is_empty());
        if marked && !write::holds_interpolated(&self.output) {
            merged.pairing.warnings.push(
                "interpolated: this format has no room for the mark of interpolated points: only `interpolated` of this answer \
                 names their profiles. Write .ply, .csv, .pcd, .las or .parquet to have it with each point"
                    .into(),
            );
        }
        Ok(merged)
    }
}

/// Profiles between two looks at how far it is.
const PROFILES: u64 = 64;

/// The cloud, and where the sensor was if that is wanted.
struct Files {
    points: PointFile,
    poses: Option<PoseFile>,
    progress: Progress,
    profiles: u64,
}

impl PointSink for Files {
    fn pose(&mut self, profile: u64, pose: &Pose) -> Result<(), ScanError> {
        if let Some(file) = &mut self.poses {
            file.pose(profile, pose)?;
        }
        self.points.pose(profile, pose)
    }

    fn time(&mut self, t_us: f64) {
        self.points.time(t_us);
    }

    fn uncertainties(&mut self, mount_u_mm: &[f64]) {
        self.points.uncertainties(mount_u_mm);
    }

    fn intensities(&mut self, intensities: &[f64]) {
        self.points.intensities(intensities);
    }

    fn interpolating(&mut self) -> Result<(), ScanError> {
        self.points.interpolating()
    }

    fn interpolated(&mut self, is: bool) {
        self.points.interpolated(is);
    }

    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        if self.profiles == 0 {
            self.progress.count("profiles merged");
        }
        self.profiles += 1;
        if self.profiles.is_multiple_of(PROFILES) {
            self.progress.more(PROFILES);
        }
        self.points.profile(profile, points)
    }

    fn finish(&mut self, points: u64) -> Result<(), ScanError> {
        self.points.finish(points)?;
        self.poses.as_mut().map_or(Ok(()), PoseFile::finish)
    }
}

fn text(merged: &Merged) -> String {
    let mut text = format!(
        "{} points of {} of {} profiles; {} samples without range\n",
        merged.points, merged.paired, merged.profiles, merged.invalid
    );
    if !merged.behind_loss.is_empty() {
        let _ = writeln!(
            text,
            "profiles behind the loss of motion, left out: {} ({})",
            merged.behind_loss.len(),
            pair::listed(&merged.behind_loss)
        );
    }
    if let Some(profiles) = &merged.interpolated {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{} profiles without a latch placed between two others",
            profiles.len()
        );
    }
    if let Some(bounds) = &merged.bounds_mm {
        for (axis, (min, max)) in ["X", "Y", "Z"]
            .iter()
            .zip(bounds.min.iter().zip(&bounds.max))
        {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{axis} {min:.4} to {max:.4} mm");
        }
    }
    if let Some(mount) = &merged.mount_u_mm {
        let _ = writeln!(
            text,
            "standard uncertainty of a point by the mount: {:.4} mm (rms), {:.4} mm at most",
            mount.rms_mm, mount.max_mm
        );
    }
    text + &pair::text(&merged.pairing)
}
