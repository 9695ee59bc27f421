//! `umi register`

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::terminal::{
    self, CAUTION, FAINT, Plain, TITLE, Table, bar, count, decimals, fixed, histogram, paint,
    print, print_error, print_json,
};
use clap::Args;
use serde_json::{Value, json};
use umi_client::files::points::{self, Pairs};
use umi_client::quantities::{Registered, length};
use umi_core::registration::{Distance, Registration, distances, register};
use umi_core::units::Point;

use super::suspect;
use crate::cmd::Format;

/// Register measured points to nominal ones: the rigid motion between them
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Register {
    /// Nominal points p in mm (CAD); or pairs with the columns px,py,pz,qx,qy,qz
    #[arg(value_name = "NOMINAL.csv")]
    nominal: PathBuf,
    /// Measured points q in mm, in the same order
    #[arg(value_name = "MEASURED.csv")]
    measured: Option<PathBuf>,
    /// Whose coordinates the measured points have: those of the work offset in which they were probed
    /// and the program runs, or the machine's
    #[arg(long, value_enum, default_value_t = Frame::Offset)]
    measured_in: Frame,
    /// Also carry this point of the part over and say its expected error (repeatable)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = point)]
    at: Vec<[f64; 3]>,
    #[command(flatten)]
    pub format: Format,
}

/// Whose coordinates points have.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Frame {
    Offset,
    Machine,
}

const HELP: &str = "\
Finds rotation R (determinant +1) and translation t with q = R p + t, with the
least sum of squares over three or more pairs. Residuals are R p + t - q.
Points belong together by their order; where both lists have a column `name`, the names must be the
same. Lists that no motion carries into each other, as inches into mm, a mirror image, another order
or points that are far off, are told (`suspect`), and so is a part that is turned upside down, as a
lost sign turns a flat list. Points that stand alike, as a square's, fit in several orders: where
another turns the part less, that is told, unless both lists have the same names. Nothing is
corrected by these.
--json says into whose coordinates the motion leads (`to`). For one into the machine's,
`umi correction` and `umi nc rewrite` need the work offset's origin.

Examples:
  umi register nominal.csv measured.csv
  umi register pairs.csv --json            columns px,py,pz,qx,qy,qz
  umi register nominal.csv measured.csv --at 250,0,40 --at -250,0,40
  umi register nominal.csv measured.csv --measured-in machine --json > moved.json

Exit status: 0 registered, 1 file or usage, 2 refused: the points do not
determine the motion ({\"error\":{\"code\":\"degenerate\" ...}}).";

fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    let point: Option<[f64; 3]> = numbers.ok().and_then(|list| list.try_into().ok());
    point
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .ok_or_else(|| "give three numbers in mm, as 250,0,40".into())
}

impl Register {
    pub fn run(self) -> Result<(), Failure> {
        let Pairs {
            nominal,
            measured,
            are_named,
        } = self.read()?;
        let registration = register(&nominal, &measured)?;
        let result = Registered::new(&registration, &nominal, &measured);
        let distances: Vec<Distance> = if nominal.len() <= MOST_FOR_DISTANCES {
            distances(&nominal, &measured)?.collect()
        } else {
            Vec::new()
        };
        let places: Vec<Place> = self
            .at
            .iter()
            .map(|p| Place::new(&registration, *p))
            .collect();
        let suspect = suspect::why(&nominal, &measured, &registration, are_named);
        if self.format.json {
            let mut machine = machine(&result, nominal.len(), &distances, &places);
            machine["cov"] = json!(registration.cov());
            machine["suspect"] = json!(suspect);
            machine["from"] = json!("part");
            machine["to"] = json!(match self.measured_in {
                Frame::Offset => "offset",
                Frame::Machine => "machine",
            });
            print_json(&machine)?;
        } else {
            print(&text(&result, &distances, &places))?;
        }
        if let Some(why) = suspect {
            print_error(&format!("{} {why}\n", paint(CAUTION, "suspect")));
        }
        Ok(())
    }

    fn read(&self) -> Result<Pairs, Failure> {
        let stdin = Path::new("-");
        match &self.measured {
            None => Ok(points::read_pairs(&self.nominal)?),
            Some(measured) if self.nominal == stdin && measured == stdin => Err(Failure::trouble(
                "usage",
                "standard input can be one of the two lists only: give the other as a file, or pairs as px,py,pz,qx,qy,qz",
            )),
            Some(measured) => Ok(points::read_both(&self.nominal, measured)?),
        }
    }
}

/// There are n(n-1)/2 distances: of more points than this they are not listed.
const MOST_FOR_DISTANCES: usize = 24;
/// Distances shown to people.
const MOST_SHOWN: usize = 10;
/// Pairs up to this number are listed, more are summed up in a histogram.
const MOST_LISTED: usize = 64;

/// A point of the part and where it was measured to be.
struct Place {
    nominal_mm: [f64; 3],
    image_mm: [f64; 3],
    expected_error_mm: Option<f64>,
}

impl Place {
    fn new(registration: &Registration, nominal_mm: [f64; 3]) -> Self {
        let point = Point::from_array_mm(nominal_mm);
        Self {
            nominal_mm,
            image_mm: registration.apply(point).to_array_mm(),
            expected_error_mm: registration.expected_error_at(point).map(|mm| mm.0),
        }
    }
}

fn machine(result: &Registered<'_>, n: usize, distances: &[Distance], places: &[Place]) -> Value {
    let mut object = crate::show::json::registration(result);
    let list: Vec<Value> = distances.iter().map(crate::show::json::distance).collect();
    object["distances"] = if n <= MOST_FOR_DISTANCES {
        list.into()
    } else {
        Value::Null
    };
    object["at"] = places
        .iter()
        .map(|place| {
            json!({
                "point_mm": place.nominal_mm,
                "image_mm": place.image_mm,
                "expected_error_mm": place.expected_error_mm,
            })
        })
        .collect();
    object
}

fn text(result: &Registered<'_>, distances: &[Distance], places: &[Place]) -> String {
    let digits = decimals(result.sigma_mm);
    let n = count(result.residuals_mm.len() as u64, "pair");
    let title = paint(TITLE, format_args!("registration of {n}: q = R p + t"));
    let mut text = format!("{title}\n\n{}\n", motion(result, digits));
    let dof = terminal::dof(result.dof);
    text += &format!("  rms {:.digits$} mm", result.rms_mm);
    text += &match result.sigma_mm {
        Some(sigma) => format!(", sigma {sigma:.digits$} mm with {dof}\n\n"),
        None => format!(" with {dof}: nothing is known about uncertainty\n\n"),
    };
    text += &residuals(result, digits);
    if !distances.is_empty() {
        text += &format!("\n{}", plate_check(distances, digits));
    }
    if !places.is_empty() {
        let titles = ["part (mm)", "measured (mm)", "expected error"];
        let mut table = Table::new("<<>").titles(&titles);
        for place in places {
            let error = place.expected_error_mm;
            table.row([
                triple(place.nominal_mm, digits),
                triple(place.image_mm, digits),
                error.map_or("-".into(), |error| format!("{error:.digits$} mm")),
            ]);
        }
        text += &format!("\n{table}");
    }
    text
}

/// Distances between the points; of many, those that differ most.
fn plate_check(distances: &[Distance], digits: usize) -> String {
    let size = |d: &Distance| d.difference().0.abs();
    let mut worst: Vec<&Distance> = distances.iter().collect();
    let all = worst.len() <= MOST_SHOWN;
    let mut title = "distance (mm)".to_owned();
    if !all {
        worst.sort_by(|a, b| size(b).total_cmp(&size(a)));
        worst.truncate(MOST_SHOWN);
        title = format!("distance (mm), worst {MOST_SHOWN} of {}", distances.len());
    }
    let titles = [&*title, "nominal", "measured", "difference"];
    let mut table = Table::new("<>>>").titles(&titles);
    for d in worst {
        table.row([
            format!("{} to {}", d.first + 1, d.second + 1),
            format!("{:.digits$}", d.nominal.0),
            format!("{:.digits$}", d.measured.0),
            format!("{:+.digits$}", Plain(d.difference().0)),
        ]);
    }
    table.to_string()
}

fn motion(result: &Registered<'_>, digits: usize) -> Table {
    let [ax, ay, az] = result.axis;
    let mut table = Table::new("<>>>>");
    let row = |name: &str, values: [String; 3]| {
        let mut row = vec![name.to_owned()];
        row.extend(values);
        row
    };
    for (name, values) in ["R", "", ""].iter().zip(result.rotation) {
        table.row(row(name, values.map(|x| fixed(x, 9))));
    }
    let mm = |x: f64| fixed(x, digits);
    table.row(row("t (mm)", result.translation_mm.map(mm)));
    if let Some(u) = result.u_translation_mm() {
        table.row(row("  std. uncertainty (mm)", u.map(mm)));
    }
    let angle = fixed(result.angle_deg, 6);
    table.row(["angle (deg)".to_owned(), angle]);
    table.row(row("axis", [ax, ay, az].map(|x| fixed(x, 6))));
    if let Some(u) = result.u_rotvec_rad() {
        let u = u.map(|u| format!("{:.1e}", u.to_degrees()));
        table.row(row("  std. uncertainty (deg)", u));
    }
    table
}

fn residuals(result: &Registered<'_>, digits: usize) -> String {
    let Some((worst, largest)) = result.worst() else {
        return String::new();
    };
    if result.residuals_mm.len() > MOST_LISTED {
        let lengths: Vec<f64> = result.lengths_mm().collect();
        let at = format!(
            "longest residual {largest:.digits$} mm at pair {}",
            worst + 1
        );
        let title = paint(FAINT, "  length of residual (mm), pairs");
        return format!("  {at}\n\n{title}\n{}", histogram(&lengths, digits));
    }
    let titles = ["pair", "dX", "dY", "dZ", "length", "(mm)"];
    let mut table = Table::new(">>>>><").titles(&titles);
    for (number, d) in result.residuals_mm.iter().enumerate() {
        let [x, y, z] = d.map(|d| format!("{:+.digits$}", Plain(d)));
        let size = length(*d);
        table.row([
            (number + 1).to_string(),
            x,
            y,
            z,
            format!("{size:.digits$}"),
            bar(size, largest, 16),
        ]);
    }
    table.to_string()
}

fn triple(values: [f64; 3], digits: usize) -> String {
    let [x, y, z] = values.map(|x| fixed(x, digits));
    format!("{x}, {y}, {z}")
}
