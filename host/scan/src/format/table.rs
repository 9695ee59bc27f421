//! CSV with named columns, row by row in constant memory.
//!
//! * The first line names the columns; they go by their names, in any order and among others.
//! * Commas separate, or semicolons or tabs where the first line has no comma.
//! * Points ([`TableReader::of_points`]) may have blanks between, and no line of names.
//! * Empty lines are skipped, `#` at the beginning of a line makes it a comment. Line ends may
//!   be LF or CRLF.
//! * Points between whose columns no comma stands may have decimal commas, in the whole file alike. Elsewhere a first line
//!   of numbers with decimal commas is refused, and so are many nameless columns that may be such.
//! * Numbers have a decimal point otherwise, and may be quoted. Whole ones may end in `.0`, as other programs write counts. A row has a cell for every column.
//! * A last line that breaks off is an error (`truncated`), as every other oddity (`corrupt`). A last line without its
//!   end is one, too: a number that was cut is another number.

use std::cell::Cell;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::ops::Range;
use std::path::Path;

use crate::ScanError;

/// The longest line that is read, in bytes. A file without line ends is no table.
const LONGEST_LINE: u64 = 1 << 16;

/// A table that is read from its beginning to its end.
pub struct TableReader<R> {
    input: R,
    name: String,
    separator: u8,
    columns: Vec<String>,
    /// The line that was read last, from 1.
    line: u64,
    text: String,
    cells: Vec<Range<usize>>,
    /// The first line holds numbers: it is a row that nobody has taken yet, whole or not.
    first_row: Option<bool>,
    /// The first line holds numbers, and no names.
    is_nameless: bool,
    /// Points: what stands before the decimals, `.` or `,`, once a number has told.
    decimal: Option<Cell<Option<char>>>,
}

/// A first line without names of so many columns may be points with decimal commas between commas.
const MANY_NAMELESS: usize = 6;

/// The place of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column(usize);

/// One row; cells by their columns.
pub struct Row<'a> {
    name: &'a str,
    line: u64,
    columns: &'a [String],
    text: &'a str,
    cells: &'a [Range<usize>],
    /// As the table's, where decimal commas may be.
    decimal: Option<&'a Cell<Option<char>>>,
}

impl TableReader<BufReader<File>> {
    /// Opens a file and reads the names of its columns.
    ///
    /// # Errors
    /// The file cannot be read, or has no first line.
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        Self::new(
            BufReader::with_capacity(1 << 16, file),
            path.display().to_string(),
        )
    }
}

impl<R: BufRead> TableReader<R> {
    /// Reads the names of the columns. `name` is what messages call the table.
    ///
    /// # Errors
    /// There is no first line, it is no text, or names a column twice.
    pub fn new(input: R, name: String) -> Result<Self, ScanError> {
        Self::begin(input, name, false)
    }

    /// A table of points, as other programs write them: columns may be parted by blanks, numbers have decimal commas where
    /// no comma parts columns, and a first line of numbers is a point, its columns `x_mm`, `y_mm`, `z_mm` and nameless ones.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_points(input: R, name: String) -> Result<Self, ScanError> {
        Self::begin(input, name, true)
    }

    fn begin(input: R, name: String, of_points: bool) -> Result<Self, ScanError> {
        let mut table = Self {
            input,
            name,
            separator: b',',
            columns: Vec::new(),
            line: 0,
            text: String::new(),
            cells: Vec::new(),
            first_row: None,
            is_nameless: false,
            decimal: None,
        };
        let Some(whole) = table.read_line()? else {
            return Err(ScanError::unreadable(
                "corrupt",
                format_args!(
                    "{}: the file is empty, without a line of column names",
                    table.name
                ),
            ));
        };
        let has_commas = has_decimal_commas(&table.text);
        if has_commas && !of_points {
            return Err(table.corrupt("its numbers have a decimal comma: write a decimal point"));
        }
        // A comma among semicolons or tabs is one of a number.
        let by: &[u8] = match of_points {
            true if has_commas => b";\t ",
            true => b";\t,",
            false => b",;\t",
        };
        table.separator = by
            .iter()
            .copied()
            .find(|byte| table.text.as_bytes().contains(byte))
            .unwrap_or(if of_points { b' ' } else { b',' });
        table.decimal = (of_points && table.separator != b',').then(Cell::default);
        table.split();
        if table.separator == b' ' {
            // A unit stands behind a blank, and is none of the columns.
            let (text, cells) = (&table.text, &mut table.cells);
            cells.dedup_by(|unit, name| {
                let is_unit = text[unit.clone()].starts_with(['[', '(']);
                if is_unit {
                    name.end = unit.end;
                }
                is_unit
            });
        }
        let cells = table
            .cells
            .iter()
            .map(|cell| table.text[cell.clone()].trim());
        let is_number = |cell: &str| match table.decimal {
            Some(_) => cell.replacen(',', ".", 1).parse::<f64>().is_ok(),
            None => cell.parse::<f64>().is_ok(),
        };
        table.is_nameless = cells.clone().all(is_number);
        if of_points && table.is_nameless {
            if table.separator == b','
                && table.cells.len() >= MANY_NAMELESS
                && !table.text.contains('.')
            {
                return Err(table.corrupt(
                    "without names and without a decimal point these may be numbers with decimal commas: write decimal \
                     points, or a first line that names the columns x_mm,y_mm,z_mm and the others",
                ));
            }
            let named = ["x_mm", "y_mm", "z_mm"].map(str::to_owned).into_iter();
            let others =
                (named.len()..table.cells.len()).map(|place| format!("column {}", place + 1));
            table.columns = named.take(table.cells.len()).chain(others).collect();
            table.first_row = Some(whole);
            return Ok(table);
        }
        table.columns = cells
            .map(|cell| cell.trim_matches('"').to_owned())
            .collect();
        for (place, column) in table.columns.iter().enumerate() {
            if table.columns[..place].contains(column) {
                return Err(ScanError::unreadable(
                    "corrupt",
                    format_args!("{}: two columns have the name {column:?}", table.name),
                ));
            }
        }
        Ok(table)
    }

    /// What messages call the table.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The names of the columns; without any, those that stand for them.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(String::as_str)
    }

    /// Whether the first line names the columns.
    pub(super) const fn is_named(&self) -> bool {
        !self.is_nameless
    }

    /// A column that may be missing.
    #[must_use]
    pub fn optional(&self, column: &str) -> Option<Column> {
        self.columns
            .iter()
            .position(|name| name == column)
            .map(Column)
    }

    /// A column that must be there.
    ///
    /// # Errors
    /// It is not: code `missing_column`.
    pub fn column(&self, column: &str) -> Result<Column, ScanError> {
        self.optional(column).ok_or_else(|| {
            let has_like = |name: &String| name.eq_ignore_ascii_case(column);
            let like = self.columns.iter().find(|name| has_like(name));
            let like = like.map_or(String::new(), |name| {
                format!(" ({name:?} has to be written {column:?})")
            });
            let has = if self.is_nameless {
                // As some programs write the number of points before them.
                let numbers = match self.columns.len() {
                    1 => "a number alone: if it counts the points, leave it out".to_owned(),
                    many => format!("{many} numbers, and no names"),
                };
                format!("the first line holds {numbers}")
            } else {
                format!("the first line names {}", self.columns.join(", "))
            };
            ScanError::unreadable(
                "missing_column",
                format_args!("{}: there is no column {column:?}{like}; {has}", self.name),
            )
        })
    }

    /// The next row, or none at the end.
    ///
    /// # Errors
    /// The file cannot be read on, or the row has not one cell for each column.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>, ScanError> {
        let whole = match self.first_row.take() {
            Some(whole) => whole,
            None => {
                let Some(whole) = self.read_line()? else {
                    return Ok(None);
                };
                self.split();
                whole
            }
        };
        let (has, wants) = (self.cells.len(), self.columns.len());
        if has == wants && !whole {
            return Err(ScanError::unreadable(
                "truncated",
                format_args!(
                    "{}, line {}: the last line has no line end, so its last number may be cut: \
                     if it is whole, end it",
                    self.name, self.line
                ),
            )
            .with("line", self.line));
        }
        if has != wants {
            let (code, why) = if has < wants && !whole {
                (
                    "truncated",
                    "the file ends in the middle of this line: it was cut",
                )
            } else if has > wants && self.separator == b',' {
                (
                    "corrupt",
                    "every row needs a cell for each column; numbers have a decimal point, and no comma",
                )
            } else {
                ("corrupt", "every row needs a cell for each column")
            };
            return Err(ScanError::unreadable(
                code,
                format_args!(
                    "{}, line {}: {has} cells, but {wants} columns; {why}",
                    self.name, self.line
                ),
            )
            .with("line", self.line));
        }
        Ok(Some(Row {
            name: &self.name,
            line: self.line,
            columns: &self.columns,
            text: &self.text,
            cells: &self.cells,
            decimal: self.decimal.as_ref(),
        }))
    }

    /// Finds the cells of `text`.
    fn split(&mut self) {
        self.cells.clear();
        let of_blanks = self.separator == b' ';
        let mut begin = 0;
        let ends = self.text.bytes().enumerate().filter(|(_, byte)| {
            *byte == self.separator || (of_blanks && byte.is_ascii_whitespace())
        });
        for (at, _) in ends.chain([(self.text.len(), 0)]) {
            if !of_blanks || at > begin {
                self.cells.push(begin..at);
            }
            begin = at + 1;
        }
    }

    /// Reads the next line that is neither empty nor a comment into `text`.
    /// Whether it had its line end; none at the end of the file.
    fn read_line(&mut self) -> Result<Option<bool>, ScanError> {
        let mut bytes = std::mem::take(&mut self.text).into_bytes();
        loop {
            bytes.clear();
            let mut limited = std::io::Read::take(&mut self.input, LONGEST_LINE);
            let read = limited.read_until(b'\n', &mut bytes).map_err(|error| {
                ScanError::unreadable("file", format_args!("cannot read {}: {error}", self.name))
            })?;
            if read == 0 {
                return Ok(None);
            }
            self.line += 1;
            let whole = bytes.last() == Some(&b'\n');
            let is_cut = !whole && read as u64 == LONGEST_LINE;
            // Of other files these bytes are no line ends.
            let is_odd = self.line == 1 || is_cut || bytes.contains(&b'\r');
            if is_odd && is_binary(&bytes) {
                return Err(self.corrupt("this is no table: it is no text in UTF-8"));
            }
            if is_cut {
                return Err(self.corrupt("a line of more than 64 KiB: this is no table"));
            }
            while matches!(bytes.last(), Some(b'\n' | b'\r')) {
                bytes.pop();
            }
            if bytes.contains(&b'\r') {
                return Err(self.corrupt(
                    "its lines end with CR alone: write it with LF or CRLF at the ends of lines",
                ));
            }
            if self.line == 1 && bytes.starts_with("\u{FEFF}".as_bytes()) {
                bytes.drain(.."\u{FEFF}".len());
            }
            if bytes.is_empty() || bytes.first() == Some(&b'#') {
                continue;
            }
            self.text = match String::from_utf8(bytes) {
                Ok(text) => text,
                Err(_) => return Err(self.corrupt("this is no text: bytes that are not UTF-8")),
            };
            return Ok(Some(whole));
        }
    }

    fn corrupt(&self, what: &str) -> ScanError {
        ScanError::unreadable(
            "corrupt",
            format_args!("{}, line {}: {what}", self.name, self.line),
        )
        .with("line", self.line)
    }
}

impl<'a> Row<'a> {
    /// The number of its line, from 1.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.line
    }

    /// The text of a cell, without blanks around it.
    #[must_use]
    pub fn text(&self, column: Column) -> &'a str {
        let text = self.text[self.cells[column.0].clone()].trim();
        let quoted = text
            .strip_prefix('"')
            .and_then(|text| text.strip_suffix('"'));
        quoted.unwrap_or(text)
    }

    /// A number. `nan` and `inf` are read as they are.
    ///
    /// # Errors
    /// The cell is empty or no number.
    pub fn number(&self, column: Column) -> Result<f64, ScanError> {
        let text = self.text(column);
        let number = match text.find([',', '.']).zip(self.decimal) {
            Some((at, known)) => {
                let own = if text[at..].starts_with(',') {
                    ','
                } else {
                    '.'
                };
                // One of the two may part thousands.
                match known.get().filter(|decimal| *decimal != own) {
                    Some(',') => {
                        return Err(
                            self.wrong(column, "a number with a decimal comma, as those before,")
                        );
                    }
                    Some(_) => return Err(self.wrong(column, "a number as those before")),
                    None => {}
                }
                known.set(Some(own));
                text.replacen(own, ".", 1).parse()
            }
            None => text.parse(),
        };
        number.map_err(|_| self.wrong(column, "a number"))
    }

    /// A number that is finite.
    ///
    /// # Errors
    /// As [`Self::number`]; refused with code `not_finite` where it is NaN or infinite.
    pub fn finite(&self, column: Column) -> Result<f64, ScanError> {
        let number = self.number(column)?;
        if number.is_finite() {
            return Ok(number);
        }
        Err(ScanError::refused(
            "not_finite",
            format_args!(
                "{}, line {}: {} is {number}: a finite number is needed",
                self.name, self.line, self.columns[column.0]
            ),
        )
        .with("line", self.line))
    }

    /// A whole number.
    ///
    /// # Errors
    /// The cell is empty or no whole number.
    pub fn integer<T: std::str::FromStr>(&self, column: Column) -> Result<T, ScanError> {
        let text = self.text(column);
        let whole = text
            .split_once('.')
            .filter(|(_, part)| !part.is_empty() && part.bytes().all(|digit| digit == b'0'))
            .map_or(text, |(whole, _)| whole);
        whole
            .parse()
            .map_err(|_| self.wrong(column, "a whole number"))
    }

    /// What is wrong with a cell, and what should stand there.
    #[must_use]
    pub fn wrong(&self, column: Column, wanted: &str) -> ScanError {
        let text = self.text(column);
        let is_comma = text.contains(',') && text.replacen(',', ".", 1).parse::<f64>().is_ok();
        let point = if is_comma {
            ", with a decimal point"
        } else {
            ""
        };
        ScanError::unreadable(
            "corrupt",
            format_args!(
                "{}, line {}: {} is {text:?}: {wanted} is needed{point}",
                self.name, self.line, self.columns[column.0]
            ),
        )
        .with("line", self.line)
    }
}

/// Whether bytes are no text: a zero, or what UTF-8 does not have. A character that is cut at the end is none of these.
fn is_binary(bytes: &[u8]) -> bool {
    let is_text = |error: std::str::Utf8Error| error.error_len().is_none();
    bytes.contains(&0) || !std::str::from_utf8(bytes).map_or_else(is_text, |_| true)
}

/// Whether a line holds numbers alone, parted by something else than commas, and with commas in them.
fn has_decimal_commas(line: &str) -> bool {
    let cells: Vec<&str> = match [';', '\t'].into_iter().find(|&by| line.contains(by)) {
        Some(by) => line.split(by).map(str::trim).collect(),
        None => line.split_ascii_whitespace().collect(),
    };
    let is_number = |cell: &&str| match cell.split_once(',') {
        // "1, 2" has a comma between.
        Some((_, digits)) => {
            digits.starts_with(|first: char| first.is_ascii_digit())
                && cell.replacen(',', ".", 1).parse::<f64>().is_ok()
        }
        None => cell.parse::<f64>().is_ok(),
    };
    cells.len() > 1 && line.contains(',') && cells.iter().all(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(text: &str) -> TableReader<&[u8]> {
        TableReader::new(text.as_bytes(), "table".into()).unwrap()
    }

    #[test]
    fn columns_go_by_their_names() {
        let mut table = open("b, a ,c\r\n# a comment\r\n\r\n2,1.5,\r\n");
        let (a, b) = (table.column("a").unwrap(), table.column("b").unwrap());
        let c = table.optional("c").unwrap();
        let row = table.next_row().unwrap().unwrap();
        assert_eq!(row.number(a), Ok(1.5));
        assert_eq!(row.integer::<u32>(b), Ok(2));
        assert_eq!(row.text(c), "");
        assert_eq!(row.line(), 4);
        assert!(row.number(c).is_err());
        assert!(table.next_row().unwrap().is_none());
        assert_eq!(table.column("d").unwrap_err().code, "missing_column");
    }

    /// What other programs write otherwise is told by what to write instead.
    #[test]
    fn other_ways_of_writing_are_told() {
        let read = |text: &str| {
            let mut table = TableReader::new(text.as_bytes(), "table".into())?;
            let column = table.column("x_mm")?;
            let row = table.next_row()?.map(|row| row.number(column));
            row.transpose()
        };
        for (text, told) in [
            ("x_mm,z_mm\r1,2\r3,4\r", "CR alone"),
            ("X_mm,z_mm\n1,2\n", "\"X_mm\" has to be written \"x_mm\""),
            (
                "x_mm;z_mm\n1,5;2\n",
                "a number is needed, with a decimal point",
            ),
            ("x_mm,z_mm\n1,5,2,5\n", "a decimal point, and no comma"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.message.contains(told), "{error}");
        }
        assert_eq!(read("x_mm;z_mm\n1.5;2\n"), Ok(Some(1.5)));
    }

    /// A sentence names what is there: no decimal point for a number that has one, no line ends of what is no text, no
    /// column of a line without names.
    #[test]
    fn no_sentence_names_what_is_not_there() {
        let read = |bytes: &[u8], of_points: bool| {
            let mut table = TableReader::begin(bytes, "table".into(), of_points)?;
            let columns = ["x_mm", "y_mm", "z_mm"].map(|column| table.column(column));
            for column in columns {
                column?;
            }
            while table.next_row()?.is_some() {}
            Ok(())
        };
        let told = |bytes: &[u8], of_points: bool| -> String {
            let read: Result<(), ScanError> = read(bytes, of_points);
            read.unwrap_err().message
        };
        let mut table = open("profile\n12.7\n");
        let column = table.column("profile").unwrap();
        let row = table.next_row().unwrap().unwrap();
        let error = row.integer::<u32>(column).unwrap_err();
        assert!(
            error.message.ends_with("a whole number is needed"),
            "{error}"
        );

        for of_points in [false, true] {
            for binary in [
                &b"PK\x03\x04\0\r\x99\n1"[..],
                b"\x89PNG\r\x1a\n",
                b"x\0_\0m\0m\0\n",
            ] {
                let told = told(binary, of_points);
                assert!(told.contains("no text in UTF-8"), "{told}");
            }
        }
        for commas in ["1,5;2,0;40,01\n", "1,5 2,0 40,01\n", "1,5\t2\t3,5\n"] {
            let told = told(commas.as_bytes(), false);
            assert!(
                told.contains("decimal comma: write a decimal point"),
                "{told}"
            );
        }
        let count = told(b"3\n1 2 3\n4 5 6\n", true);
        assert!(
            count.contains("a number alone: if it counts the points"),
            "{count}"
        );
        let two = told(b"1.5 2.5\n", true);
        assert!(two.contains("holds 2 numbers, and no names"), "{two}");
        assert_eq!(read(b"1, 2, 3\n", true), Ok(()));
    }

    /// Where no comma parts columns, one in a number stands before its decimals, in the whole file; beside a decimal point it
    /// may part thousands.
    #[test]
    fn points_may_have_decimal_commas_where_no_comma_parts_columns() {
        let read = |text: &'static str| -> Result<Vec<f64>, ScanError> {
            let mut table = TableReader::of_points(text.as_bytes(), "p".into())?;
            let z = table.column("z_mm").or_else(|_| table.column("Z [mm]"))?;
            let mut found = Vec::new();
            while let Some(row) = table.next_row()? {
                found.push(row.number(z)?);
            }
            Ok(found)
        };
        for text in [
            "1,5;2,0;40,01\n1;2;-3\n",
            "1,5 2,0 40,01\n1 2 -3\n",
            "1,5\t2\t40,01\n1\t2\t-3\n",
            "X [mm];Y [mm];Z [mm]\n1,5;2;40,01\n1;2;-3\n",
            "X [mm] Y [mm] Z [mm]\n1,5 2 40,01\n1 2 -3\n",
        ] {
            assert_eq!(read(text), Ok(vec![40.01, -3.0]), "{text}");
        }
        for (text, told) in [
            ("x_mm;y_mm;z_mm\n1;2;3,5\n1;2;3.5\n", "decimal comma, as"),
            ("x_mm;y_mm;z_mm\n1;2;3.5\n1;2;3,5\n", "as those before"),
            ("x_mm;y_mm;z_mm\n1;2;1.003,5\n", "a number is needed"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.message.contains(told), "{error}");
        }
    }

    /// `1,0,2,0,40,01` is one point with decimal commas, or six columns: neither is guessed.
    #[test]
    fn many_nameless_columns_without_a_point_are_refused() {
        let begin =
            |text: &str| TableReader::of_points(text.as_bytes(), "table".into()).map(|_| ());
        let error = begin("1,0,2,0,40,01\n").unwrap_err();
        assert!(
            error.message.contains("may be numbers with decimal commas"),
            "{error}"
        );
        for fine in [
            "1.0,2.0,40.01,255,0,0\n",
            "1,2,3,17,4\n",
            "1 0 2 0 40 01\n",
            "x_mm,y_mm,z_mm,r,g,b\n1,0,2,0,40,1\n",
        ] {
            assert_eq!(begin(fine), Ok(()), "{fine}");
        }
    }

    #[test]
    fn numbers_may_be_quoted_and_whole_ones_have_a_zero_behind_the_point() {
        let mut table = open("\"a\",\"b\"\n\"-76894.0\",\"1.5\"\n7.5,\"2\n8.,3\n");
        let (a, b) = (table.column("a").unwrap(), table.column("b").unwrap());
        let row = table.next_row().unwrap().unwrap();
        assert_eq!(row.integer::<i64>(a), Ok(-76894));
        assert_eq!(row.number(b), Ok(1.5));
        let row = table.next_row().unwrap().unwrap();
        assert!(row.integer::<i64>(a).is_err() && row.number(b).is_err());
        assert!(
            table
                .next_row()
                .unwrap()
                .unwrap()
                .integer::<i64>(a)
                .is_err()
        );
    }

    #[test]
    fn a_row_that_breaks_off_is_told_from_one_that_is_wrong() {
        let code = |text| open(text).next_row().map(|_| ()).unwrap_err().code;
        assert_eq!(code("a,b,c\n1,2"), "truncated");
        assert_eq!(code("a,b,c\n1,2\n"), "corrupt");
        assert_eq!(code("a,b\n1,2,3\n"), "corrupt");
        let last = |text| open(text).next_row().map(|row| row.is_some());
        assert_eq!(last("a,b\n1,2.3\n"), Ok(true));
        assert_eq!(last("a,b\n1,2.3").unwrap_err().code, "truncated");
    }

    #[test]
    fn points_need_no_names_and_may_have_blanks_between() {
        let points =
            |text: &'static str| TableReader::of_points(text.as_bytes(), "p".into()).unwrap();
        for text in [
            "1,2,-3\n4,5,6\n",
            "1 2   -3\n 4 5 6 \n",
            "# a\n1\t2\t-3\n4\t5\t6\n",
        ] {
            let mut table = points(text);
            let z = table.column("z_mm").unwrap();
            let mut found = Vec::new();
            while let Some(row) = table.next_row().unwrap() {
                found.push(row.number(z).unwrap());
            }
            assert_eq!(found, [-3.0, 6.0], "{text}");
        }
        let mut table = points("z x y\n1 2 3\n");
        let z = table.column("z").unwrap();
        assert_eq!(table.next_row().unwrap().unwrap().number(z), Ok(1.0));
        assert_eq!(
            points("1,2\n3,4\n").column("z_mm").unwrap_err().code,
            "missing_column"
        );
        assert_eq!(points("1,2,3").next_row().err().unwrap().code, "truncated");
    }

    #[test]
    fn what_is_not_finite_is_refused_by_name() {
        let mut table = open("a\nnan\n");
        let a = table.column("a").unwrap();
        let row = table.next_row().unwrap().unwrap();
        assert_eq!(row.finite(a).unwrap_err().code, "not_finite");
    }
}
