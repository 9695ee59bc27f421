//! A journal as a Parquet file: a row for each entry, the columns of the CSV table.

use std::sync::Arc;

use parquet::data_type::{ByteArray, ByteArrayType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use serde_json::Value;

/// `t_us` is null where entries are not there any more. Numbers are below 2^63: an entry a
/// microsecond for 292 000 years.
const SCHEMA: &str = "message journal {
    REQUIRED INT64 seq (INTEGER(64,false));
    OPTIONAL INT64 t_us (INTEGER(64,false));
    REQUIRED BYTE_ARRAY type (UTF8);
    REQUIRED BYTE_ARRAY record (JSON);
}";

/// The rows, column by column.
#[derive(Default)]
pub(super) struct Columns {
    seq: Vec<i64>,
    /// Of the rows that have one.
    t_us: Vec<i64>,
    /// 1 for each row that has a time.
    has_time: Vec<i16>,
    types: Vec<ByteArray>,
    records: Vec<ByteArray>,
}

impl Columns {
    pub fn push(&mut self, seq: u64, t_us: Option<u64>, record: &Value) {
        self.seq.push(seq as i64);
        self.t_us.extend(t_us.map(|t_us| t_us as i64));
        self.has_time.push(i16::from(t_us.is_some()));
        let name = record["type"].as_str().unwrap_or_default();
        self.types.push(name.into());
        self.records.push(record.to_string().into_bytes().into());
    }

    /// The file.
    pub fn file(self) -> Result<Vec<u8>, ParquetError> {
        let schema = Arc::new(parse_message_type(SCHEMA)?);
        let mut out = Vec::new();
        let mut writer = SerializedFileWriter::new(&mut out, schema, Arc::default())?;
        let mut group = writer.next_row_group()?;
        let texts = [None, None, Some(&self.types), Some(&self.records)];
        for (place, texts) in texts.into_iter().enumerate() {
            let Some(mut column) = group.next_column()? else {
                break;
            };
            match texts {
                Some(texts) => column
                    .typed::<ByteArrayType>()
                    .write_batch(texts, None, None)?,
                None if place == 0 => column
                    .typed::<Int64Type>()
                    .write_batch(&self.seq, None, None)?,
                None => column.typed::<Int64Type>().write_batch(
                    &self.t_us,
                    Some(&self.has_time),
                    None,
                )?,
            };
            column.close()?;
        }
        group.close()?;
        writer.close()?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    use serde_json::json;

    use super::*;

    /// Every row comes back, with a time or without.
    #[test]
    fn a_file_comes_back_as_it_was() {
        let mut columns = Columns::default();
        for seq in 0..1000 {
            let t_us = (seq % 3 != 0).then_some(1000 * seq);
            columns.push(seq, t_us, &json!({"type": "time", "seq": seq}));
        }
        let path = std::env::temp_dir().join(format!("umi-{}.parquet", std::process::id()));
        std::fs::write(&path, columns.file().unwrap()).unwrap();
        let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
        std::fs::remove_file(&path).unwrap();
        let rows: Vec<_> = reader
            .get_row_iter(None)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(rows.len(), 1000);
        for (seq, row) in (0..1000_u64).zip(rows) {
            assert_eq!(row.get_ulong(0).unwrap(), seq);
            assert_eq!(row.get_ulong(1).ok(), (seq % 3 != 0).then_some(1000 * seq));
            assert_eq!(row.get_string(2).unwrap(), "time");
            assert_eq!(
                *row.get_string(3).unwrap(),
                json!({"type": "time", "seq": seq}).to_string()
            );
        }
    }
}
