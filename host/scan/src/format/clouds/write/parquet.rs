//! Parquet by the crate of the same name: a column each, row groups of a million points, uncompressed.

use std::sync::Arc;

use parquet::data_type::{BoolType, DoubleType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::cloud::CloudPoint;
use crate::format::partial::Partial;

/// Points that are held until they are written.
const GROUP: usize = 1 << 20;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    let refused = |error: ParquetError| partial.refused(error);
    let columns = style.columns;
    let mut schema = String::from("message cloud { ");
    if columns.profile {
        schema += "REQUIRED INT64 profile; ";
    }
    if columns.index {
        schema += "REQUIRED INT32 index (INTEGER(32,false)); ";
    }
    schema += "REQUIRED DOUBLE x_mm; REQUIRED DOUBLE y_mm; REQUIRED DOUBLE z_mm; ";
    if columns.time {
        schema += "REQUIRED DOUBLE t_us; ";
    }
    if columns.intensity {
        schema += "REQUIRED DOUBLE intensity; ";
    }
    if columns.mount_u {
        schema += "REQUIRED DOUBLE mount_u_mm; ";
    }
    if columns.interpolated {
        schema += "REQUIRED BOOLEAN interpolated; ";
    }
    let schema = parse_message_type(&(schema + "}")).map_err(refused)?;
    let file = partial.begin()?;
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(schema), Arc::default()).map_err(refused)?;
    let mut held: Vec<CloudPoint> = Vec::new();
    loop {
        held.clear();
        while held.len() < GROUP {
            let Some(p) = points.next_point()? else { break };
            held.push(p);
        }
        if held.is_empty() {
            break;
        }
        let mut group = writer.next_row_group().map_err(refused)?;
        let mut whole = |on: bool, of: &dyn Fn(&CloudPoint) -> i64, wide: bool| {
            if !on {
                return Ok(());
            }
            let Some(mut column) = group.next_column()? else {
                return Ok(());
            };
            if wide {
                let values: Vec<i64> = held.iter().map(of).collect();
                column
                    .typed::<Int64Type>()
                    .write_batch(&values, None, None)?;
            } else {
                let values: Vec<i32> = held.iter().map(|p| of(p) as i32).collect();
                column
                    .typed::<Int32Type>()
                    .write_batch(&values, None, None)?;
            }
            column.close()
        };
        whole(columns.profile, &|p| p.profile as i64, true).map_err(refused)?;
        whole(columns.index, &|p| i64::from(p.index), false).map_err(refused)?;
        let mut real = |on: bool, of: &dyn Fn(&CloudPoint) -> f64| {
            if !on {
                return Ok(());
            }
            let Some(mut column) = group.next_column()? else {
                return Ok(());
            };
            let values: Vec<f64> = held.iter().map(of).collect();
            column
                .typed::<DoubleType>()
                .write_batch(&values, None, None)?;
            column.close()
        };
        for k in 0..3 {
            real(true, &|p| p.at[k]).map_err(refused)?;
        }
        real(columns.time, &|p| p.t_us).map_err(refused)?;
        real(columns.intensity, &|p| p.intensity).map_err(refused)?;
        real(columns.mount_u, &|p| p.mount_u_mm).map_err(refused)?;
        if columns.interpolated {
            let values: Vec<bool> = held.iter().map(|p| p.interpolated).collect();
            let column = group.next_column().map_err(refused)?;
            if let Some(mut column) = column {
                let batch = column.typed::<BoolType>().write_batch(&values, None, None);
                batch.map_err(refused)?;
                column.close().map_err(refused)?;
            }
        }
        group.close().map_err(refused)?;
    }
    writer.close().map_err(refused)?;
    Ok(())
}
