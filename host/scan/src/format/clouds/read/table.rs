//! Numbers in columns: CSV with `x,y,z`, or the same parted by semicolons, tabs or blanks, with names or without.
//!
//! A name may say its unit, as `X [mm]`, `y_m` and `Z (inch)` do: the points are in mm by it.

use std::io::BufRead;

use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, ScanCloud};
use crate::format::table::{Column, TableReader};
use crate::rigid::Vec3;

/// The points of a table, one after the other.
pub(super) struct TablePoints<R> {
    table: TableReader<R>,
    at: [Column; 3],
    /// How many mm a unit of each is.
    mm: [f64; 3],
    /// Whether their names say so.
    states_unit: bool,
    profile: Option<Column>,
    index: Option<Column>,
    time: Option<Column>,
    intensity: Option<Column>,
    mount_u: Option<Column>,
    interpolated: Option<Column>,
}

impl<R: BufRead> TablePoints<R> {
    /// Reads the names of the columns: `x`, `Y`, `"z_mm"` and `X-Koordinate [mm]` are meant.
    pub fn new(input: R, name: String) -> Result<Self, ScanError> {
        let table = TableReader::of_points(input, name)?;
        let [x, y, z] = [axis(&table, "x")?, axis(&table, "y")?, axis(&table, "z")?];
        let units = [x.1, y.1, z.1];
        let states_unit = units.iter().all(Option::is_some);
        // Beside columns in mm those that say nothing are so, too.
        if !states_unit && units.iter().flatten().any(|mm| *mm != 1.0) {
            return Err(ScanError::unreadable(
                "corrupt",
                format_args!(
                    "{}: some of the columns x, y and z say their unit and some do not: write it for all three, or for none",
                    table.name()
                ),
            ));
        }
        Ok(Self {
            at: [x.0, y.0, z.0],
            mm: units.map(|mm| mm.unwrap_or(1.0)),
            states_unit,
            profile: table.optional("profile"),
            index: table.optional("index"),
            time: table.optional("t_us"),
            intensity: table.optional("intensity"),
            mount_u: table.optional("mount_u_mm"),
            interpolated: table.optional("interpolated"),
            table,
        })
    }

    /// What it says of its points beside their coordinates.
    pub const fn columns(&self) -> CloudColumns {
        CloudColumns {
            profile: self.profile.is_some(),
            index: self.index.is_some(),
            time: self.time.is_some(),
            intensity: self.intensity.is_some(),
            mount_u: self.mount_u.is_some(),
            interpolated: self.interpolated.is_some(),
        }
    }

    /// In which unit the columns are, in mm, where all three say the same.
    pub fn unit_mm(&self) -> Option<f64> {
        let [x, y, z] = self.mm;
        (self.states_unit && x == y && y == z).then_some(x)
    }

    /// The next point in mm where the columns say their unit, finite or not.
    pub fn next_point(&mut self) -> Result<Option<(Vec3, BesidePoint)>, ScanError> {
        let Some(row) = self.table.next_row()? else {
            return Ok(None);
        };
        let [x, y, z] = self.at;
        let at = Vec3::new(row.number(x)?, row.number(y)?, row.number(z)?);
        let at = at.component_mul(&Vec3::from(self.mm));
        let beside = BesidePoint {
            profile: self.profile.map_or(Ok(0), |c| row.integer(c))?,
            index: self.index.map_or(Ok(0), |c| row.integer(c))?,
            t_us: self.time.map_or(Ok(0.0), |c| row.number(c))?,
            intensity: self.intensity.map_or(Ok(0.0), |c| row.number(c))?,
            mount_u_mm: self.mount_u.map_or(Ok(0.0), |c| row.number(c))?,
            interpolated: self.interpolated.map_or(Ok(0.0), |c| row.number(c))? != 0.0,
        };
        Ok(Some((at, beside)))
    }
}

/// Units by what they are called, in mm.
const UNITS: [(&str, f64); 13] = [
    ("mm", 1.0),
    ("millimeter", 1.0),
    ("cm", 10.0),
    ("m", 1000.0),
    ("meter", 1000.0),
    ("metre", 1000.0),
    ("\u{b5}m", 1e-3),
    ("\u{3bc}m", 1e-3),
    ("um", 1e-3),
    ("in", 25.4),
    ("inch", 25.4),
    ("inches", 25.4),
    ("zoll", 25.4),
];

/// Words beside the axis in the name of a column that say nothing more.
const WORDS: [&str; 10] = [
    "coord",
    "coordinate",
    "koordinate",
    "pos",
    "position",
    "point",
    "punkt",
    "axis",
    "achse",
    "value",
];

/// The column of an axis, and how many mm its unit is, where its name says it.
fn axis<R: BufRead>(
    table: &TableReader<R>,
    axis: &'static str,
) -> Result<(Column, Option<f64>), ScanError> {
    let long = format!("{axis}_mm");
    if let Some(column) = table.optional(&long) {
        return Ok((column, table.is_named().then_some(1.0)));
    }
    let all: Vec<&str> = table.names().filter(|name| is_of(name, axis)).collect();
    let corrupt =
        |what: String| ScanError::unreadable("corrupt", format_args!("{}: {what}", table.name()));
    match all[..] {
        [] => table.column(&long).map(|column| (column, None)),
        [name] => {
            let unit = unit_mm(name).map_err(|unit| {
                corrupt(format!(
                    "the column {name:?} is in {unit:?}, and mm, cm, m, \u{b5}m and inch are known: give the points in one of these"
                ))
            })?;
            Ok((table.column(name)?, unit))
        }
        [one, other, ..] => Err(corrupt(format!(
            "the columns {one:?} and {other:?} may both be {axis}: name the right one {long:?}"
        ))),
    }
}

/// The words of a name, in small letters.
fn words(name: &str) -> Vec<String> {
    let is_part = |c: char| c.is_alphanumeric() || c == '\u{b5}';
    let all = name.split(|c| !is_part(c)).filter(|word| !word.is_empty());
    let small = all.map(str::to_lowercase);
    small.filter(|word| !WORDS.contains(&&word[..])).collect()
}

/// Whether a name is that of an axis, with a unit or without. What stands in brackets is a unit, known or not.
fn is_of(name: &str, axis: &str) -> bool {
    match &words(name)[..] {
        [one] => one == axis,
        [one, unit] => one == axis && (is_unit(unit) || name.contains(['[', '(', '{', '<'])),
        _ => false,
    }
}

fn is_unit(word: &str) -> bool {
    UNITS.iter().any(|(unit, _)| *unit == word)
}

/// How many mm the unit of such a name is, none where it has none; the unit itself where it is not known.
fn unit_mm(name: &str) -> Result<Option<f64>, String> {
    let words = words(name);
    let Some(unit) = words.get(1) else {
        return Ok(None);
    };
    let known = UNITS.iter().find(|(known, _)| known == unit);
    known.map_or_else(|| Err(unit.clone()), |(_, mm)| Ok(Some(*mm)))
}

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let bad = |refusal: ScanError| ScanError {
        // A cut has a name of its own.
        code: if refusal.code == "truncated" {
            "truncated"
        } else {
            "bad_file"
        },
        ..refusal
    };
    let name = "neither PLY, PCD, LAS, LAZ, E57 nor STL, and as a table".to_owned();
    let mut points = TablePoints::new(bytes, name).map_err(bad)?;
    let mut cloud = ScanCloud {
        states_unit: points.states_unit,
        unit_mm: points.unit_mm(),
        ..ScanCloud::default()
    };
    while let Some((at, _)) = points.next_point().map_err(bad)? {
        cloud.push(at);
    }
    Ok(cloud)
}
