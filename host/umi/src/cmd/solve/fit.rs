//! `umi fit`

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::json;
use crate::show::terminal::{
    self, FAINT, Plain, TITLE, Table, count, decimals, fixed, histogram, paint, print, print_json,
    signed_bar,
};
use clap::{Args, ValueEnum};
use umi_client::files::points;
use umi_client::quantities::{self, Amount, Parameter, QuantityUnit, parameters};
use umi_core::units::Point;
use umi_protocol::feature::Shape;
use umi_protocol::job::FeatureKind;
use umi_scan::format::clouds::CloudReader;

use crate::cmd::Format;
use crate::cmd::scan::answer::failure;

/// Fit a geometry to points by orthogonal least squares
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Fit {
    /// The geometry
    #[arg(value_enum)]
    kind: Kind,
    /// Points in mm, one a line: x y z, or columns named x, y, z; `-` is standard input. Or a cloud: .ply, .pcd, .las, .laz
    /// or .e57
    #[arg(value_name = "POINTS")]
    points: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Columns are separated by commas, semicolons, tabs or blanks; # begins a comment; the first line
may name the columns. A cloud is read as `umi scan convert` reads it, by its ending: E57 has
metres, all others mm. Points of a cloud without numbers are left out and counted (`not_finite`).

Examples:
  umi fit sphere ball.csv               a ball: centre, radius, uncertainties
  umi fit cylinder bore.csv --json      for machines: one JSON object
  umi fit sphere cloud.ply              a cloud that a scan left, cropped to the ball
  grep -v bad hits.txt | umi fit plane -

Exit status: 0 fitted, 1 file or usage, 2 refused: the points do not determine
the geometry ({\"error\":{\"code\":\"too_few_points\" ...}}).";

#[derive(Clone, Copy, ValueEnum)]
enum Kind {
    /// Centre and radius; 4 points or more
    Sphere,
    /// Point and normal; 3 points or more
    Plane,
    /// Point and direction; 2 points or more
    Line,
    /// Circle in space: centre, normal and radius; 3 points or more
    Circle,
    /// Axis and radius; 5 points or more
    Cylinder,
    /// Apex, axis and half angle; 6 points or more
    Cone,
}

impl From<Kind> for FeatureKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Sphere => Self::Sphere,
            Kind::Plane => Self::Plane,
            Kind::Line => Self::Line,
            Kind::Circle => Self::Circle,
            Kind::Cylinder => Self::Cylinder,
            Kind::Cone => Self::Cone,
        }
    }
}

impl Fit {
    pub fn run(self) -> Result<(), Failure> {
        let (points, not_finite) = read(&self.points)?;
        let fitted = umi_core::job::fit(self.kind.into(), &points)?;
        let fit = quantities::FitFigures::new(&fitted, &points);
        if self.format.json {
            return print_json(&match not_finite {
                Some(left_out) => json::fit_of_cloud(&fit, left_out),
                None => json::fit(&fit),
            });
        }
        let mut text = text(&fit, &points);
        if let Some(left_out) = not_finite.filter(|n| *n > 0) {
            let points = count(left_out, "point");
            text += &format!("\n  {points} without numbers left out\n");
        }
        print(&text)
    }
}

/// Formats of clouds, by the ending.
const CLOUDS: [&str; 5] = ["ply", "pcd", "las", "laz", "e57"];
/// What is no list of points.
const OTHERS: [&str; 7] = ["parquet", "stl", "obj", "step", "stp", "gocator", "toml"];

/// The points of a file, and how many of a cloud were left out for want of numbers.
fn read(path: &Path) -> Result<(Vec<Point>, Option<u64>), Failure> {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let ending = ending.to_ascii_lowercase();
    if OTHERS.contains(&ending.as_str()) {
        return Err(Failure::trouble(
            "format",
            format_args!(
                "{}: .{ending} is no list of points. Give a cloud (.{}), or points as text: x y z in each line",
                path.display(),
                CLOUDS.join(", .")
            ),
        ));
    }
    if !CLOUDS.contains(&ending.as_str()) {
        return Ok((points::read(path)?, None));
    }
    let mut cloud = CloudReader::open(path).map_err(failure)?;
    let mut points = Vec::new();
    while let Some(point) = cloud.next_point().map_err(failure)? {
        points.push(Point::from_array_mm(point.at));
    }
    Ok((points, Some(cloud.not_finite)))
}

/// Points up to this number are listed, more are summed up in a histogram.
const MOST_LISTED: usize = 64;

fn text(fit: &quantities::FitFigures<'_>, points: &[Point]) -> String {
    let (parameters, _) = parameters(&fit.shape);
    let n = count(fit.residuals_mm.len() as u64, "point");
    let title = paint(TITLE, format_args!("{} through {n}", fit.kind()));
    let mut table = Table::new("<>>").titles(&["", "value", "std. uncertainty"]);
    // All lengths to the digits of the one that is least certain.
    let lengths = parameters.iter().filter(|p| p.unit == QuantityUnit::Mm);
    let uncertainties = lengths.flat_map(|p| numbers(p.standard_uncertainty(fit.sigma_mm)));
    let digits = decimals(uncertainties.reduce(f64::max));
    for parameter in &parameters {
        rows(&mut table, parameter, fit.sigma_mm, digits);
    }
    let digits = decimals(fit.sigma_mm);
    let mut text = format!("{title}\n\n{table}\n{}\n", statistics(fit, digits));
    text += &residuals(fit, points, digits);
    text
}

/// The lines of one parameter.
fn rows(table: &mut Table, parameter: &Parameter, sigma_mm: Option<f64>, digits: usize) {
    let u = numbers(parameter.standard_uncertainty(sigma_mm));
    let name = parameter.name.replace('_', " ");
    let values = numbers(Some(parameter.value));
    let axes: &[&str] = match parameter.value {
        Amount::Scalar(_) => &[""],
        Amount::Vector(_) => &[" X", " Y", " Z"],
    };
    for (number, (value, axis)) in values.iter().zip(axes).enumerate() {
        let u = u.get(number);
        let (value, u) = match parameter.unit {
            QuantityUnit::Mm => (
                format!("{} mm", fixed(*value, digits)),
                u.map(|u| format!("{u:.digits$} mm")),
            ),
            QuantityUnit::One => (fixed(*value, 9), u.map(|u| format!("{u:.1e}"))),
            QuantityUnit::Rad => (
                format!("{} deg", fixed(value.to_degrees(), 6)),
                u.map(|u| format!("{:.1e} deg", u.to_degrees())),
            ),
        };
        let u = u.unwrap_or_else(|| "-".into());
        table.row([format!("{name}{axis}"), value, u]);
    }
}

fn numbers(amount: Option<Amount>) -> Vec<f64> {
    match amount {
        None => Vec::new(),
        Some(Amount::Scalar(value)) => vec![value],
        Some(Amount::Vector(values)) => values.to_vec(),
    }
}

fn statistics(fit: &quantities::FitFigures<'_>, digits: usize) -> String {
    let dof = terminal::dof(fit.dof);
    let mut text = format!("  rms {:.digits$} mm", fit.rms_mm);
    text += &match fit.sigma_mm {
        Some(sigma) => format!(", sigma {sigma:.digits$} mm with {dof}"),
        None if fit.dof == 0 => format!(": {dof}, so nothing is known about uncertainty"),
        None => format!(" with {dof}: an exact fit says nothing about uncertainty"),
    };
    if let Shape::Circle { rms_plane_mm, .. } = fit.shape {
        text += &format!("\n  rms of the plane {rms_plane_mm:.digits$} mm");
    }
    if let (Some(_), Some(factor)) = (fit.sigma_mm, terminal::coverage_95(fit.dof)) {
        let hint = format!("  95 % interval: {factor:.2} x the standard uncertainty (Student's t)");
        text += &format!("\n{}", paint(FAINT, hint));
    }
    text + "\n"
}

fn residuals(fit: &quantities::FitFigures<'_>, points: &[Point], digits: usize) -> String {
    let Some((worst, largest)) = fit.worst() else {
        return String::new();
    };
    if points.len() > MOST_LISTED {
        let at = format!(
            "largest residual {largest:.digits$} mm at point {}",
            worst + 1
        );
        let title = paint(FAINT, "  residual (mm), points");
        let histogram = histogram(&fit.residuals_mm, digits);
        return format!("  {at}\n\n{title}\n{histogram}");
    }
    let mut table = Table::new(">>>>><").titles(&["point", "X", "Y", "Z", "residual", "(mm)"]);
    for (number, (point, d)) in points.iter().zip(fit.residuals_mm.iter()).enumerate() {
        let [x, y, z] = point.to_array_mm().map(Plain);
        table.row([
            (number + 1).to_string(),
            format!("{x:.digits$}"),
            format!("{y:.digits$}"),
            format!("{z:.digits$}"),
            format!("{:+.digits$}", Plain(*d)),
            signed_bar(*d, largest, 12),
        ]);
    }
    table.to_string()
}
