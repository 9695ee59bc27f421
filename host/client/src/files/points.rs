//! Points from a text table: what CSV exports, spreadsheets and hand-written
//! lists look like, read strictly. Coordinates are millimetres.
//!
//! * Columns are separated by semicolons, commas, tabs or blanks. In a line with
//!   a semicolon only that separates.
//! * `#` begins a comment. Empty lines are skipped. Line ends may be LF or CRLF.
//! * The first line may name the columns, in any order and among others.
//! * Numbers have a decimal point. `nan` and `inf` are read as they are; it is
//!   for the fit to refuse them.
//! * Everything else is an error that names its line: no line is passed over.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{self, Read as _};
use std::path::Path;

use umi_core::units::Point;

use crate::problem::Problem;

/// Reads points from a file, or from standard input for `-`.
///
/// # Errors
/// The file cannot be read, or a line is not as described above.
pub fn read(path: &Path) -> Result<Vec<Point>, Problem> {
    points(&text(path)?, path)
}

fn points(text: &str, path: &Path) -> Result<Vec<Point>, Problem> {
    let parsed = parse(text, &[&["x", "y", "z"], &SOURCE, &TARGET]);
    let rows = parsed.map_err(|problem| in_file(path, &problem))?;
    Ok(rows.into_iter().map(Point::from_array_mm).collect())
}

/// Points that belong together.
#[derive(Debug)]
pub struct Pairs {
    /// Of the part.
    pub nominal: Vec<Point>,
    /// Where they were measured.
    pub measured: Vec<Point>,
    /// Names say so, and not their order alone.
    pub are_named: bool,
}

/// Reads points with their names, where the first line has a column `name`.
///
/// # Errors
/// As [`read`]; `name_twice`: one stands there twice.
pub fn read_named(path: &Path) -> Result<(Vec<Point>, Option<Vec<String>>), Problem> {
    let text = text(path)?;
    let points = points(&text, path)?;
    Ok((points, names_once(&text, path)?))
}

/// Reads two lists whose points belong together by their order.
///
/// # Errors
/// As [`read_named`]; `names_differ`: both have a column `name`, and not the same names in it.
pub fn read_both(first: &Path, second: &Path) -> Result<Pairs, Problem> {
    let (nominal, from) = read_named(first)?;
    let (measured, to) = read_named(second)?;
    let are_named = match (from, to) {
        (Some(from), Some(to)) => {
            let mut pairs = (1..).zip(from.iter().zip(&to));
            if let Some((number, (a, b))) = pairs.find(|(_, (a, b))| a != b) {
                return Err(Problem::trouble(
                    "names_differ",
                    format_args!(
                        "point {number} is `{a}` in {} and `{b}` in {}: write both lists in one order",
                        name(first),
                        name(second)
                    ),
                )
                .with("point", number));
            }
            from.iter().all(|name| !name.is_empty())
        }
        _ => false,
    };
    Ok(Pairs {
        nominal,
        measured,
        are_named,
    })
}

/// The names of a table's points, each once.
fn names_once(text: &str, path: &Path) -> Result<Option<Vec<String>>, Problem> {
    let Some(names) = names(text) else {
        return Ok(None);
    };
    let mut seen = BTreeSet::new();
    let mut all = names.iter();
    if let Some(twice) = all.find(|name| !name.is_empty() && !seen.insert(**name)) {
        return Err(Problem::trouble(
            "name_twice",
            format_args!(
                "{}: two points have the name `{twice}`: give each its own, or take the column out",
                name(path)
            ),
        ));
    }
    Ok(Some(names.into_iter().map(str::to_owned).collect()))
}

/// What the column `name` of a table says of its points, where it has one.
fn names(text: &str) -> Option<Vec<&str>> {
    let mut rows = text
        .lines()
        .map(|raw| raw.split('#').next().unwrap_or_default().trim())
        .filter(|content| !content.is_empty());
    let header = split(rows.next()?);
    let place = header
        .iter()
        .position(|field| column_name(field).0 == "name")?;
    let of = |row| {
        split(row)
            .get(place)
            .map(|name| name.trim_matches(['"', '\'']))
    };
    rows.map(of).collect()
}

/// Reads pairs of points from one file with the columns px, py, pz, qx, qy, qz,
/// or from standard input for `-`.
///
/// # Errors
/// As [`read_named`].
pub fn read_pairs(path: &Path) -> Result<Pairs, Problem> {
    let text = text(path)?;
    let rows = parse(&text, &[&["px", "py", "pz", "qx", "qy", "qz"]])
        .map_err(|problem| in_file(path, &problem))?;
    let names = names_once(&text, path)?;
    let (nominal, measured) = rows
        .into_iter()
        .map(|[px, py, pz, qx, qy, qz]| (Point::from_mm(px, py, pz), Point::from_mm(qx, qy, qz)))
        .unzip();
    Ok(Pairs {
        nominal,
        measured,
        are_named: names.is_some_and(|names| names.iter().all(|name| !name.is_empty())),
    })
}

/// The text of a file, or of standard input for `-`.
///
/// # Errors
/// It cannot be read, or is not a text of single bytes or UTF-8.
pub fn text(path: &Path) -> Result<String, Problem> {
    let bytes = if path == Path::new("-") {
        let mut bytes = Vec::new();
        let read = io::stdin().lock().read_to_end(&mut bytes);
        read.map(|_| bytes)
    } else {
        std::fs::read(path)
    };
    let bytes = bytes.map_err(|error| Problem::file("read", path, &error))?;
    if bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF]) || bytes.contains(&0) {
        let message = format!(
            "{}: this is not plain text (UTF-16 or binary): save it as text in UTF-8 or ASCII",
            name(path)
        );
        return Err(Problem::trouble("not_text", message));
    }
    // A comment may be in another code; a number with a strange character is no number.
    let text = String::from_utf8_lossy(&bytes);
    Ok(text.strip_prefix('\u{FEFF}').unwrap_or(&text).to_owned())
}

/// How a file is called in messages.
#[must_use]
pub fn name(path: &Path) -> String {
    if path == Path::new("-") {
        "standard input".into()
    } else {
        path.display().to_string()
    }
}

/// Column names of one point among pairs.
const SOURCE: [&str; 3] = ["px", "py", "pz"];
const TARGET: [&str; 3] = ["qx", "qy", "qz"];

/// What is wrong, and where.
#[derive(Debug, PartialEq)]
struct BadRow {
    /// From 1.
    line: usize,
    what: What,
}

#[derive(Debug, PartialEq)]
enum What {
    /// The header names columns, but not all that are needed.
    HeaderLacks { column: &'static str },
    /// The header names a column twice.
    HeaderTwice { column: &'static str },
    /// The header names a unit that is not mm.
    HeaderUnit { column: String },
    /// Not numbers, and no names of columns either.
    NoHeader { text: String },
    /// Another number of columns.
    Columns { got: usize, due: Due },
    /// A field has nothing in it.
    Empty { column: usize },
    /// A field is not a number.
    NotANumber { column: usize, text: String },
    /// A field has a decimal comma.
    DecimalComma { column: usize, text: String },
}

#[derive(Debug, PartialEq)]
enum Due {
    Header(usize),
    Named(&'static [&'static str]),
}

fn in_file(path: &Path, problem: &BadRow) -> Problem {
    let message = format!("{}, line {}: {}", name(path), problem.line, problem.what);
    Problem::trouble("bad_row", message).with("line", problem.line)
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::HeaderLacks { column } => write!(
                f,
                "these column names have no `{column}`: name all columns, or leave the names away"
            ),
            Self::HeaderTwice { column } => {
                write!(f, "the column `{column}` is named twice: name it once")
            }
            Self::HeaderUnit { column } => write!(
                f,
                "the column `{column}` is not in mm: convert it and name the unit mm"
            ),
            Self::NoHeader { text } => write!(
                f,
                "`{text}` is neither numbers nor names of columns (as x,y,z): correct it, or put # in front of a comment"
            ),
            Self::Columns {
                got,
                due: Due::Header(due),
            } => {
                write!(f, "{got} columns where the first line names {due}")
            }
            Self::Columns {
                got,
                due: Due::Named(names),
            } => write!(
                f,
                "{got} columns where {} are due ({}): remove the others, or name the columns in the first line",
                names.len(),
                names.join(", ")
            ),
            Self::Empty { column } => write!(
                f,
                "column {column} is empty: measure this point again, or remove the line"
            ),
            Self::NotANumber { column, text } => {
                write!(f, "`{text}` in column {column} is not a number")
            }
            Self::DecimalComma { column, text } => write!(
                f,
                "`{text}` in column {column} has a comma: write decimals with a point"
            ),
        }
    }
}

/// The rows of a table with one of these sets of columns.
fn parse<const N: usize>(
    text: &str,
    sets: &'static [&'static [&'static str; N]],
) -> Result<Vec<[f64; N]>, BadRow> {
    let mut rows = Vec::new();
    let mut layout = None;
    for (index, raw) in text.lines().enumerate() {
        let line = index + 1;
        let content = raw.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let fields = split(content);
        let at = |what| BadRow { line, what };
        if layout.is_none() {
            let header = header(content, &fields, sets).map_err(at)?;
            let is_header = header.is_some();
            layout = Some(header.unwrap_or_else(|| Layout::positional(sets)));
            if is_header {
                continue;
            }
        }
        if let Some(layout) = &layout {
            rows.push(layout.row(&fields).map_err(at)?);
        }
    }
    Ok(rows)
}

/// Which columns hold the coordinates.
struct Layout<const N: usize> {
    /// Columns in a line.
    columns: usize,
    /// Of these, those with the coordinates.
    places: [usize; N],
    /// The names, if they are not from a header.
    names: Option<&'static [&'static str]>,
}

impl<const N: usize> Layout<N> {
    fn positional(sets: &'static [&'static [&'static str; N]]) -> Self {
        Self {
            columns: N,
            places: std::array::from_fn(|n| n),
            names: sets.first().map(|set| set.as_slice()),
        }
    }

    fn row(&self, fields: &[&str]) -> Result<[f64; N], What> {
        if fields.len() != self.columns {
            let due = self.names.map_or(Due::Header(self.columns), Due::Named);
            let got = fields.len();
            return Err(What::Columns { got, due });
        }
        let mut row = [0.0; N];
        for (value, place) in row.iter_mut().zip(self.places) {
            *value = number(place, fields.get(place).copied().unwrap_or_default())?;
        }
        Ok(row)
    }
}

fn split(content: &str) -> Vec<&str> {
    let separator = [';', ','].into_iter().find(|s| content.contains(*s));
    match separator {
        Some(separator) => content.split(separator).map(str::trim).collect(),
        None => content.split_whitespace().collect(),
    }
}

fn number(place: usize, field: &str) -> Result<f64, What> {
    let column = place + 1;
    let text = || field.to_owned();
    if field.is_empty() {
        Err(What::Empty { column })
    } else if field.contains(',') {
        Err(What::DecimalComma {
            column,
            text: text(),
        })
    } else {
        let parsed = field.parse();
        parsed.map_err(|_| What::NotANumber {
            column,
            text: text(),
        })
    }
}

/// The columns that a first line names; none if it holds numbers.
fn header<const N: usize>(
    content: &str,
    fields: &[&str],
    sets: &'static [&'static [&'static str; N]],
) -> Result<Option<Layout<N>>, What> {
    if fields.iter().any(|field| field.parse::<f64>().is_ok()) {
        return Ok(None);
    }
    let names: Vec<(String, Option<String>)> = fields.iter().map(|f| column_name(f)).collect();
    // The set of which most columns are there is the one that is meant.
    let known = |set: &[&str]| {
        names
            .iter()
            .filter(|(n, _)| set.contains(&n.as_str()))
            .count()
    };
    let Some(set) = sets.iter().copied().max_by_key(|set| known(*set)) else {
        return Ok(None);
    };
    if known(set) == 0 {
        // Names that say nothing to us go by their place; but a damaged first
        // point (`l2.5,O,7`) must not pass for names.
        let plain = content.chars().all(|c| !c.is_ascii_digit());
        return if plain && fields.len() == N {
            Ok(Some(Layout::positional(sets)))
        } else {
            Err(What::NoHeader {
                text: content.to_owned(),
            })
        };
    }
    let mut places = [0; N];
    for (place, column) in places.iter_mut().zip(set) {
        let mut found = names
            .iter()
            .enumerate()
            .filter(|(_, (name, _))| name == column);
        let (at, (_, unit)) = found.next().ok_or(What::HeaderLacks { column })?;
        if found.next().is_some() {
            return Err(What::HeaderTwice { column });
        }
        if unit.as_ref().is_some_and(|unit| unit != "mm") {
            let column = fields.get(at).copied().unwrap_or_default().to_owned();
            return Err(What::HeaderUnit { column });
        }
        *place = at;
    }
    Ok(Some(Layout {
        columns: fields.len(),
        places,
        names: None,
    }))
}

/// Name and unit of a column: `"X [mm]"`, `x_mm`, `X(mm)` and `X` are all `x`.
fn column_name(field: &str) -> (String, Option<String>) {
    let plain = field.trim_matches(['"', '\'', ' ']).to_lowercase();
    let mut parts = plain
        .split(['_', ' ', '[', '(', '/', ']', ')'])
        .filter(|part| !part.is_empty());
    let name = parts.next().unwrap_or_default().to_owned();
    (name, parts.next().map(str::to_owned))
}

#[cfg(test)]
mod tests;
