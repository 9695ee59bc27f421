//! `umi fit`

use std::path::PathBuf;

use crate::failure::Failure;
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

use crate::cmd::Format;

/// Fit a geometry to points by orthogonal least squares
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Fit {
    /// The geometry
    #[arg(value_enum)]
    kind: Kind,
    /// Points in mm, one a line: x y z, or columns named x, y, z; `-` is standard input
    #[arg(value_name = "POINTS.csv")]
    points: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Columns are separated by commas, semicolons, tabs or blanks; # begins a comment;
the first line may name the columns.

Examples:
  umi fit sphere ball.csv               a ball: centre, radius, uncertainties
  umi fit cylinder bore.csv --json      for machines: one JSON object
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
        let points = points::read(&self.points)?;
        let fitted = umi_core::job::fit(self.kind.into(), &points)?;
        let fit = quantities::FitFigures::new(&fitted, &points);
        if self.format.json {
            print_json(&crate::show::json::fit(&fit))
        } else {
            print(&text(&fit, &points))
        }
    }
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
