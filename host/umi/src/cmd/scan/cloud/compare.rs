//! `umi scan compare`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::progress::Progress;
use crate::show::terminal::Plain;
use clap::{Args, ValueEnum};
use serde::Serialize;
use umi_report::pages::deviation::Bands;
use umi_scan::ScanError;
use umi_scan::cloud::ScanCloud;
use umi_scan::compare::{
    CloudAlignment, Deviations, Nominal, align, elsewhere, nearest, strays, summary,
};
use umi_scan::format::clouds::read_cloud;
use umi_scan::parallel::Threads;
use umi_scan::rigid::Vec3;
use umi_scan::surface::Near;

use super::limits::limits;
use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// How far a cloud is from its nominal: signed distances, positive outside
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Compare {
    /// Points in mm: CSV with the columns x_mm, y_mm, z_mm, PLY, PCD, LAS, LAZ or E57
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// kind = "plane", "cylinder", "sphere", "cone" or "torus" with its figures (TOML), or a mesh in mm
    /// (STL, OBJ; STEP within 0.005 mm)
    #[arg(long, value_name = "NOMINAL.toml|MESH.stl")]
    nominal: PathBuf,
    /// Move the cloud to where the squares of its distances are least, from where it lies
    #[arg(long)]
    align: bool,
    /// With --align: directions that stay; turns are about the middle of the points
    #[arg(
        long,
        value_name = "rx,..,tz",
        value_delimiter = ',',
        value_enum,
        requires = "align"
    )]
    lock: Vec<Freedom>,
    /// Count the points below and above these deviations, in mm
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = limits)]
    limits: Option<Bands>,
    /// Count the points in so many even classes from the least deviation to the greatest
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    histogram: Option<u32>,
    /// Threads; all of the machine without
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    threads: Option<u32>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Nominals as TOML:
  kind = \"plane\"      point_mm = [0, 0, 0]   normal = [0, 0, 1]
  kind = \"cylinder\"   point_mm = [0, 0, 0]   direction = [0, 0, 1]   radius_mm = 20.0
  kind = \"sphere\"     center_mm = [0, 0, 0]  radius_mm = 12.7
  kind = \"cone\"       apex_mm = [0, 0, 0]    direction = [0, 0, 1]   half_angle_deg = 30.0
  kind = \"torus\"      center_mm = [0, 0, 0]  direction = [0, 0, 1]
                       major_radius_mm = 30.0  minor_radius_mm = 5.0

Nothing is aligned without --align, and --align only settles a cloud that lies near its nominal:
umi scan localise places it from anywhere, by the part or by three balls (--fiducials).

Examples:
  umi scan compare cloud.ply --nominal bore.toml
  umi scan compare cloud.csv --nominal part.stl --json | jq .rms_mm
  umi scan compare cloud.ply --nominal part.step --limits -0.05,0.05 --histogram 20
  umi scan compare cloud.ply --nominal part.stl --align --lock rx,ry,tz

Refused (status 2): too_few_points, not_finite, nominal, no_convergence, a mesh's own (mesh_...).";

/// A direction in which a cloud may move.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Freedom {
    Rx,
    Ry,
    Rz,
    Tx,
    Ty,
    Tz,
}

const FREEDOMS: [Freedom; 6] = [
    Freedom::Rx,
    Freedom::Ry,
    Freedom::Rz,
    Freedom::Tx,
    Freedom::Ty,
    Freedom::Tz,
];

/// What is printed.
#[derive(Serialize)]
struct ComparedCloud {
    #[serde(flatten)]
    figures: Deviations,
    #[serde(skip_serializing_if = "Option::is_none")]
    limits: Option<BeyondLimits>,
    #[serde(skip_serializing_if = "Option::is_none")]
    histogram: Option<Histogram>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alignment: Option<CloudAlignment>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct BeyondLimits {
    low_mm: f64,
    high_mm: f64,
    /// Points below the lower one, between, and above the upper one.
    below: usize,
    within: usize,
    above: usize,
}

#[derive(Serialize)]
struct Histogram {
    /// Where the first class begins, and how wide each is.
    from_mm: f64,
    class_mm: f64,
    counts: Vec<u64>,
}

impl Histogram {
    /// In so many classes; the greatest deviation is of the last.
    fn of(deviations_mm: &[f64], found: &Deviations, classes: u32) -> Self {
        let class_mm = (found.max_mm - found.min_mm) / f64::from(classes);
        let mut counts = vec![0; classes as usize];
        for deviation in deviations_mm {
            let place = ((deviation - found.min_mm) / class_mm.max(f64::MIN_POSITIVE)) as usize;
            counts[place.min(classes as usize - 1)] += 1;
        }
        Self {
            from_mm: found.min_mm,
            class_mm,
            counts,
        }
    }
}

impl Compare {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<ComparedCloud, ScanError> {
        let progress = Progress::new(self.format.json);
        progress.stage("reading the nominal");
        let nominal = Nominal::read(&self.nominal)?;
        progress.stage("reading the cloud");
        let mut cloud = finite_cloud(read_cloud(&self.cloud)?, &self.cloud)?;
        let threads = self
            .threads
            .map_or_else(Threads::all, |n| Threads::new(n as usize));
        let alignment = if self.align {
            progress.stage("aligning");
            let locked = FREEDOMS.map(|freedom| self.lock.contains(&freedom));
            Some(align(&mut cloud, &nominal, locked, threads)?)
        } else {
            None
        };
        let near = if cloud.is_empty() {
            Vec::new()
        } else {
            nearest_shown(&cloud, &nominal, threads, &progress)?
        };
        let deviations: Vec<f64> = near.iter().map(|near| near.distance_mm).collect();
        let figures = summary(&deviations)?;
        let mut warnings = nominal.warnings(&cloud);
        warnings.extend(strays(&cloud, &deviations));
        let before_mm = alignment.as_ref().map(|alignment| alignment.rms_before_mm);
        // From afar it may settle where it does not belong, and look the better for it.
        if let Some(far) = before_mm.and_then(|mm| elsewhere(&cloud, mm)) {
            warnings.push(format!("{far}; that was before --align"));
        }
        Ok(ComparedCloud {
            warnings,
            limits: self.limits.map(|bands| {
                let count = |is: &dyn Fn(f64) -> bool| {
                    deviations
                        .iter()
                        .filter(|deviation| is(**deviation))
                        .count()
                };
                let (below, above) = (count(&|d| d < bands.low_mm), count(&|d| d > bands.high_mm));
                BeyondLimits {
                    low_mm: bands.low_mm,
                    high_mm: bands.high_mm,
                    below,
                    within: figures.n - below - above,
                    above,
                }
            }),
            histogram: self
                .histogram
                .map(|classes| Histogram::of(&deviations, &figures, classes)),
            figures,
            alignment,
        })
    }
}

/// Points between two looks at how far it is.
const PART: usize = 1 << 18;

/// What the nominal is to every point; how far it is, is shown.
///
/// # Errors
/// As [`nearest`].
pub fn nearest_shown(
    cloud: &[Vec3],
    nominal: &Nominal,
    threads: Threads,
    progress: &Progress,
) -> Result<Vec<Near>, ScanError> {
    progress.of("distances", cloud.len() as u64);
    let mut all = Vec::with_capacity(cloud.len());
    for part in cloud.chunks(PART) {
        all.extend(nearest(part, nominal, threads)?);
        progress.more(part.len() as u64);
    }
    Ok(all)
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
    let some = |value: Option<f64>| {
        value.map_or_else(|| "none".into(), |value| format!("{:+.6}", Plain(value)))
    };
    [
        ("points", found.n.to_string()),
        ("mean", format!("{:+.6}", Plain(found.mean_mm))),
        (
            "standard deviation",
            found
                .std_mm
                .map_or_else(|| "none".into(), |std| format!("{std:.6}")),
        ),
        ("rms", format!("{:.6}", found.rms_mm)),
        ("least", format!("{:+.6}", Plain(found.min_mm))),
        ("greatest", format!("{:+.6}", Plain(found.max_mm))),
        ("mean of those above", some(found.mean_above_mm)),
        ("mean of those below", some(found.mean_below_mm)),
    ]
    .map(|(name, value)| vec![name.to_owned(), value])
    .into()
}

fn text(compared: &ComparedCloud) -> String {
    let found = &compared.figures;
    let some = |value: Option<f64>| {
        value.map_or_else(|| "none".into(), |value| format!("{:+.6} mm", Plain(value)))
    };
    let mut text = format!(
        "{} points, positive outside\n\nmean       {:+.6} mm\nstd        {}\nrms        {:.6} mm\n\
         least      {:+.6} mm\ngreatest   {:+.6} mm\nmean above {}\nmean below {}\n",
        found.n,
        Plain(found.mean_mm),
        found
            .std_mm
            .map_or_else(|| "none".into(), |std| format!("{std:.6} mm")),
        found.rms_mm,
        Plain(found.min_mm),
        Plain(found.max_mm),
        some(found.mean_above_mm),
        some(found.mean_below_mm)
    );
    // Writing to a string cannot fail.
    if let Some(limits) = &compared.limits {
        let _ = writeln!(
            text,
            "below {:+} mm {}, within {}, above {:+} mm {}",
            limits.low_mm, limits.below, limits.within, limits.high_mm, limits.above
        );
    }
    if let Some(histogram) = &compared.histogram {
        let most = histogram.counts.iter().max().copied().unwrap_or(1).max(1);
        for (i, count) in histogram.counts.iter().enumerate() {
            let from = Plain(histogram.from_mm + i as f64 * histogram.class_mm);
            let bar = "#".repeat((40 * count / most) as usize);
            let _ = writeln!(text, "from {from:+.6} mm {count:>10} {bar}");
        }
    }
    if let Some(done) = &compared.alignment {
        let [x, y, z] = done.translation_mm.map(Plain);
        let _ = writeln!(
            text,
            "aligned: rms before {:.6} mm; shift {x:.6} {y:.6} {z:.6} mm, rotation {:?}; {} \
             directions that no distance sees were not moved",
            done.rms_before_mm, done.rotation, done.unseen
        );
    }
    for warning in &compared.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}
