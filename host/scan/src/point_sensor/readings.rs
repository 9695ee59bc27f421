//! Readings of a point sensor: `x,y,z,gamma[,sphere][,snr,total]`, mm; or the places that
//! a board has measured, `qx_mm,qy_mm,qz_mm,gamma_mm[,snr][,status]`.

use std::io::BufRead;
use std::path::Path;

use crate::format::table::{Row, TableReader};
use crate::{Ending, ScanError};

/// What is longer lies on no machine.
pub(super) const MAX_MM: f64 = 1e9;

/// One line of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorReading {
    /// Its line in the file, from 1.
    pub line: u64,
    /// Position of the axes, mm.
    pub axes_mm: [f64; 3],
    /// What the sensor read, mm.
    pub gamma_mm: f64,
    /// The ball that it names, if it names one.
    pub sphere: Option<String>,
}

/// The readings that count.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorReadings {
    /// Lines of the file.
    pub lines: usize,
    /// Those that are used, in their order.
    pub used: Vec<SensorReading>,
}

/// Reads a file of readings; those whose quality is below `min_snr` are left out.
///
/// # Errors
/// Exit status 1 if the file cannot be read. Refused: `missing_column`, `not_a_number`,
/// `not_finite`.
pub fn read(path: &Path, min_snr: Option<f64>) -> Result<SensorReadings, ScanError> {
    from_table(
        TableReader::open(path).map_err(|error| refused_as("missing_column", error))?,
        min_snr,
    )
}

/// The readings of a table, as [`read`] reads them.
///
/// # Errors
/// As [`read`].
pub fn from_table<R: BufRead>(
    mut table: TableReader<R>,
    min_snr: Option<f64>,
) -> Result<SensorReadings, ScanError> {
    let missing = |error| refused_as("missing_column", error);
    let is_measured = table.optional("qx_mm").is_some();
    let [x, y, z, gamma] = if is_measured {
        ["qx_mm", "qy_mm", "qz_mm", "gamma_mm"]
    } else {
        ["x", "y", "z", "gamma"]
    };
    let column = |name| table.column(name).map_err(missing);
    let (axes, gamma) = ([column(x)?, column(y)?, column(z)?], column(gamma)?);
    let status = table.optional("status").filter(|_| is_measured);
    let sphere = table.optional("sphere");
    let snr = match min_snr {
        Some(least) => Some((table.column("snr").map_err(missing)?, least)),
        None => None,
    };
    let mut readings = SensorReadings::default();
    let wrong = |error| refused_as("not_a_number", error);
    while let Some(row) = table.next_row().map_err(wrong)? {
        readings.lines += 1;
        // A place without a point has its reason there.
        if status.is_some_and(|column| row.text(column) != "ok") {
            continue;
        }
        if let Some((column, least)) = snr {
            // A reading without a figure of its quality had no signal.
            let blank = row.text(column).is_empty();
            if blank || below(row.number(column).map_err(wrong)?, least) {
                continue;
            }
        }
        let number = |column| finite(&row, column);
        readings.used.push(SensorReading {
            line: row.line(),
            axes_mm: [number(axes[0])?, number(axes[1])?, number(axes[2])?],
            gamma_mm: number(gamma)?,
            sphere: sphere
                .map(|column| row.text(column))
                .filter(|name| !name.is_empty())
                .map(str::to_owned),
        });
    }
    Ok(readings)
}

/// True for NaN, too.
fn below(snr: f64, least: f64) -> bool {
    snr.is_nan() || snr < least
}

fn finite(row: &Row<'_>, column: crate::format::table::Column) -> Result<f64, ScanError> {
    let mm = row
        .finite(column)
        .map_err(|error| refused_as("not_a_number", error))?;
    if mm.abs() > MAX_MM {
        return Err(ScanError::refused(
            "not_finite",
            format_args!(
                "line {}: {mm:e} mm is no length on a machine: remove the reading or measure it again",
                row.line()
            ),
        ));
    }
    Ok(mm)
}

/// What is wrong with the contents is a refusal here, with a name of its own; what the
/// system cannot read is not.
fn refused_as(code: &'static str, error: ScanError) -> ScanError {
    if error.ending == Ending::Refused || error.code == "file" {
        return error;
    }
    ScanError {
        ending: Ending::Refused,
        code,
        ..error
    }
}
