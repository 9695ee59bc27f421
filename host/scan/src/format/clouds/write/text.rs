//! CSV: `profile,index,x_mm,y_mm,z_mm,t_us,intensity,mount_u_mm,interpolated`, without the columns that a cloud does not have.

use std::io::{BufWriter, Write};

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::format::partial::Partial;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    let io = |error: std::io::Error| partial.failed(&error);
    let mut out = BufWriter::with_capacity(1 << 20, partial.begin()?);
    let columns = style.columns;
    let mut names = Vec::new();
    if columns.profile {
        names.push("profile");
    }
    if columns.index {
        names.push("index");
    }
    names.extend(["x_mm", "y_mm", "z_mm"]);
    if columns.time {
        names.push("t_us");
    }
    if columns.intensity {
        names.push("intensity");
    }
    if columns.mount_u {
        names.push("mount_u_mm");
    }
    if columns.interpolated {
        names.push("interpolated");
    }
    writeln!(out, "{}", names.join(",")).map_err(io)?;
    while let Some(p) = points.next_point()? {
        if columns.profile {
            write!(out, "{},", p.profile).map_err(io)?;
        }
        if columns.index {
            write!(out, "{},", p.index).map_err(io)?;
        }
        let [x, y, z] = p.at;
        // Rust prints the shortest digits that give back the same double.
        write!(out, "{x},{y},{z}").map_err(io)?;
        if columns.time {
            write!(out, ",{}", p.t_us).map_err(io)?;
        }
        if columns.intensity {
            write!(out, ",{}", p.intensity).map_err(io)?;
        }
        if columns.mount_u {
            write!(out, ",{}", p.mount_u_mm).map_err(io)?;
        }
        if columns.interpolated {
            write!(out, ",{}", u8::from(p.interpolated)).map_err(io)?;
        }
        writeln!(out).map_err(io)?;
    }
    out.flush().map_err(io)
}
