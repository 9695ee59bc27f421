//! How the tool looks on a terminal: colours, tables, numbers and small plots.
//!
//! Colours go out as escape codes and are taken away again where the output is
//! no terminal, where `NO_COLOR` is set, or where the terminal has none (by
//! `anstream`). Everything is readable without them. Nothing else steers the terminal: a name
//! that comes from elsewhere is shown in letters ([`ink`]).

use std::fmt::{self, Display};
use std::io::{self, Write as _};

pub use anstyle::Style;
use anstyle::{AnsiColor, Effects};
pub use umi_client::problem::one_line;
use umi_report::terminal::ink;
pub use umi_scan::solve::student::coverage_95;

use crate::failure::Failure;

/// Good news.
pub const GOOD: Style = AnsiColor::Green.on_default().effects(Effects::BOLD);
/// Bad news.
pub const BAD: Style = AnsiColor::Red.on_default().effects(Effects::BOLD);
/// Something to look at.
pub const CAUTION: Style = AnsiColor::Yellow.on_default();
/// Titles.
pub const TITLE: Style = Style::new().effects(Effects::BOLD);
/// What matters less.
pub const FAINT: Style = Style::new().effects(Effects::DIMMED);
/// Ordinary text.
pub const PLAIN: Style = Style::new();

/// For a number of things that were lost.
#[must_use]
pub fn loss_style(lost: impl Into<u64>) -> Style {
    if lost.into() > 0 { BAD } else { PLAIN }
}

/// Text in a style.
#[must_use]
pub fn paint(style: Style, text: impl Display) -> String {
    if style == PLAIN {
        text.to_string()
    } else {
        let codes = style.render().to_string();
        // One sequence for each attribute: their codes in one.
        let codes = codes.replace("\u{1b}[", "").replace('m', ";");
        ink::coloured(codes.trim_end_matches(';'), &text.to_string())
    }
}

/// Writes to standard output.
///
/// # Errors
/// [`Failure::OutputClosed`] if nobody reads any more; the system's error.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = anstream::stdout().lock();
    let written = out
        .write_all(ink::shown(text).as_bytes())
        .and_then(|()| out.flush());
    written.map_err(|error| not_written(&error))
}

fn not_written(error: &io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::OutputClosed,
        _ => Failure::trouble("file", format_args!("cannot write the output: {error}")),
    }
}

/// Writes a JSON value as one line to standard output.
///
/// # Errors
/// As [`print()`].
pub fn print_json(value: &serde_json::Value) -> Result<(), Failure> {
    print(&format!("{value}\n"))
}

/// Writes what may be long as one line of JSON to standard output, a piece at a time: as a JSON
/// value it would take ten times the memory.
///
/// # Errors
/// As [`print()`].
pub fn print_as_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let mut out = Shown {
        out: anstream::stdout().lock(),
        piece: Vec::with_capacity(2 * PIECE),
    };
    let written = serde_json::to_writer(&mut out, value)
        .map_err(io::Error::from)
        .and_then(|()| out.write_all(b"\n"))
        .and_then(|()| out.flush());
    written.map_err(|error| not_written(&error))
}

/// So many bytes go out at a time.
const PIECE: usize = 1 << 16;

/// A writer of text of which nothing steers the terminal.
struct Shown<W> {
    out: W,
    piece: Vec<u8>,
}

impl<W: io::Write> Shown<W> {
    fn pass_on(&mut self) -> io::Result<()> {
        // A character whose end is still to come waits for it.
        let whole = match std::str::from_utf8(&self.piece) {
            Ok(text) => text.len(),
            Err(error) => error.valid_up_to(),
        };
        let text = str::from_utf8(&self.piece[..whole]).unwrap_or_default();
        self.out.write_all(ink::shown(text).as_bytes())?;
        self.piece.drain(..whole);
        Ok(())
    }
}

impl<W: io::Write> io::Write for Shown<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.piece.extend_from_slice(bytes);
        if self.piece.len() >= PIECE {
            self.pass_on()?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.pass_on()?;
        self.out.flush()
    }
}

/// Writes to standard error; there is nobody to tell if that fails.
pub fn print_error(text: &str) {
    let _ = anstream::stderr().write_all(ink::shown(text).as_bytes());
}

/// Columns of text under optional titles, separated by blanks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    titles: Vec<String>,
    /// Whether a column's text stands at its right edge, as numbers do.
    right: Vec<bool>,
    rows: Vec<Vec<(Style, String)>>,
}

impl Table {
    /// A table whose columns stand left (`<`) or right (`>`), one character each.
    #[must_use]
    pub fn new(alignment: &str) -> Self {
        Self {
            right: alignment.chars().map(|c| c == '>').collect(),
            ..Self::default()
        }
    }

    /// With titles over the columns.
    #[must_use]
    pub fn titles(mut self, titles: &[&str]) -> Self {
        self.titles = titles.iter().map(|&title| title.to_owned()).collect();
        self
    }

    /// One more row.
    pub fn row<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.styled(cells.into_iter().map(|cell| (PLAIN, cell)));
    }

    /// One more row, each cell with its style. No text makes two rows.
    pub fn styled<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = (Style, T)>) {
        let cells = cells.into_iter();
        self.rows.push(
            cells
                .map(|(style, text)| (style, one_line(text.into())))
                .collect(),
        );
    }

    fn width(&self, column: usize) -> usize {
        let title = self.titles.get(column).map(String::as_str);
        let cells = self.rows.iter().filter_map(|row| row.get(column));
        cells
            .map(|(_, text)| text.as_str())
            .chain(title)
            .map(|text| text.chars().count())
            .max()
            .unwrap_or(0)
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let titles = self.titles.iter().map(|title| (FAINT, title.clone()));
        let titles: Vec<_> = titles.collect();
        let widths: Vec<_> = (0..self.right.len()).map(|c| self.width(c)).collect();
        for row in [&titles].into_iter().chain(&self.rows) {
            if row.is_empty() {
                continue;
            }
            let mut line = String::new();
            for ((style, text), (width, right)) in row.iter().zip(widths.iter().zip(&self.right)) {
                let blanks = " ".repeat(width.saturating_sub(text.chars().count()));
                let painted = paint(*style, text);
                line.push_str("  ");
                if *right {
                    line.push_str(&blanks);
                    line.push_str(&painted);
                } else {
                    line.push_str(&painted);
                    line.push_str(&blanks);
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// A number as it is, but what is zero to the decimals that are shown is never minus zero.
#[derive(Clone, Copy, Debug)]
pub struct Plain(pub f64);

impl fmt::Display for Plain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_zero = match f.precision() {
            None => self.0 == 0.0,
            Some(decimals) => {
                let digits = format!("{:.decimals$}", self.0.abs());
                digits.bytes().all(|b| matches!(b, b'0' | b'.'))
            }
        };
        fmt::Display::fmt(if is_zero { &0.0 } else { &self.0 }, f)
    }
}

/// Fixed decimals; what rounds to zero has no sign.
#[must_use]
pub fn fixed(value: f64, decimals: usize) -> String {
    format!("{:.decimals$}", Plain(value))
}

/// Decimals that show at least 0.1 µm, and two digits of the noise or uncertainty,
/// but not more than a picometre.
#[must_use]
pub fn decimals(noise_mm: Option<f64>) -> usize {
    let noise = noise_mm.filter(|noise| *noise > 0.0).unwrap_or(1.0);
    let mut decimals = 4;
    let mut shown = 1e-3;
    while decimals < 9 && noise < shown {
        decimals += 1;
        shown /= 10.0;
    }
    decimals
}

/// `n thing` or `n things`.
#[must_use]
pub fn count(n: u64, thing: &str) -> String {
    format!("{n} {thing}{}", if n == 1 { "" } else { "s" })
}

/// Degrees of freedom in words.
#[must_use]
pub fn dof(dof: u64) -> String {
    match dof {
        0 => "no degrees of freedom".into(),
        1 => "1 degree of freedom".into(),
        n => format!("{n} degrees of freedom"),
    }
}

/// A bar from the middle to the left (negative) or right (positive), `width`
/// characters to each side, full at `full`.
#[must_use]
pub fn signed_bar(value: f64, full: f64, width: usize) -> String {
    let len = bar_length(value.abs(), full, width);
    let blank = |n| " ".repeat(n);
    let bar = "#".repeat(len);
    if value < 0.0 {
        format!("{}{bar}|", blank(width - len))
    } else {
        format!("{}|{bar}", blank(width))
    }
}

/// A bar to the right, full at `full`.
#[must_use]
pub fn bar(value: f64, full: f64, width: usize) -> String {
    "#".repeat(bar_length(value, full, width))
}

fn bar_length(value: f64, full: f64, width: usize) -> usize {
    if value.is_finite() && value > 0.0 && full > 0.0 {
        ((value / full * width as f64).round() as usize).min(width)
    } else {
        0
    }
}

/// How often values fall into equal classes between the smallest and the
/// largest: one line for each class, the middle of the class in front.
#[must_use]
pub fn histogram(values: &[f64], decimals: usize) -> String {
    const CLASSES: usize = 15;
    const WIDTH: usize = 50;
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(*v), high.max(*v))
        });
    let mut counts = [0_u32; CLASSES];
    let step = (high - low) / CLASSES as f64;
    for value in values {
        // All equal: 0/0, which `as` makes class 0.
        let class = (((value - low) / step) as usize).min(CLASSES - 1);
        if let Some(count) = counts.get_mut(class) {
            *count += 1;
        }
    }
    let most = counts.iter().copied().max().unwrap_or(0);
    let mut table = Table::new(">><");
    for (class, count) in counts.into_iter().enumerate() {
        // What is there is seen, however little it is.
        let least = usize::from(count > 0);
        let middle = low + (class as f64 + 0.5) * step;
        table.row([
            format!("{middle:+.decimals$}"),
            count.to_string(),
            "#".repeat(bar_length(count.into(), most.into(), WIDTH).max(least)),
        ]);
    }
    table.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What rounds to zero has no sign, what does not keeps it.
    #[test]
    fn zero_has_no_sign() {
        assert_eq!(fixed(-0.00004, 4), "0.0000");
        assert_eq!(fixed(-0.00006, 4), "-0.0001");
        assert_eq!(fixed(-0.0, 0), "0");
        assert_eq!(fixed(-12.5, 1), "-12.5");
        let wide = |value: f64| {
            format!(
                "[{:9.3}] [{:+.2}] [{}]",
                Plain(value),
                Plain(value),
                Plain(value)
            )
        };
        assert_eq!(wide(-0.0), "[    0.000] [+0.00] [0]");
        assert_eq!(wide(-0.0004), "[    0.000] [+0.00] [-0.0004]");
        assert_eq!(wide(-0.0006), "[   -0.001] [+0.00] [-0.0006]");
        assert_eq!(wide(f64::NAN), "[      NaN] [NaN] [NaN]");
    }

    /// Columns are as wide as their widest cell, colours count for nothing, and
    /// no line ends in blanks.
    #[test]
    fn columns_line_up() {
        let mut table = Table::new("<>").titles(&["name", "value"]);
        table.styled([(BAD, "radius"), (PLAIN, "12.7")]);
        table.row(["x", "-135.5105"]);
        let plain = ink::plain(&table.to_string());
        assert_eq!(
            plain,
            "  name        value\n  radius       12.7\n  x       -135.5105\n"
        );
        assert!(ink::shown(&table.to_string()).contains('\u{1b}'));
    }

    /// Two digits of the noise are shown, within 4 to 9 decimals.
    #[test]
    fn decimals_follow_the_noise() {
        assert_eq!(decimals(Some(0.0145)), 4);
        assert_eq!(decimals(Some(0.000_45)), 5);
        assert_eq!(decimals(Some(1e-20)), 9);
        assert_eq!(decimals(None), 4);
        assert_eq!(decimals(Some(f64::NAN)), 4);
    }

    /// What goes out in pieces is the text that goes out at once, also where a character lies across
    /// two pieces; what steers a terminal does not go out.
    #[test]
    fn pieces_are_the_whole() {
        let value = serde_json::json!({ "a": "€\u{9b}ü".repeat(PIECE), "b": [1.5, null] });
        let mut shown = Shown {
            out: Vec::new(),
            piece: Vec::new(),
        };
        for bytes in value.to_string().as_bytes().chunks(1000) {
            shown.write_all(bytes).unwrap();
        }
        shown.flush().unwrap();
        assert!(shown.out == ink::shown(&value.to_string()).into_bytes());
    }

    /// Bars grow from the middle to their side and stay within their width.
    #[test]
    fn bars_have_a_side_and_an_end() {
        assert_eq!(signed_bar(-0.5, 1.0, 4), "  ##|");
        assert_eq!(signed_bar(1.0, 1.0, 4), "    |####");
        assert_eq!(signed_bar(9.0, 1.0, 4), "    |####");
        assert_eq!(signed_bar(0.0, 0.0, 4), "    |");
    }

    /// Every value is in one class, also the smallest and the largest.
    #[test]
    fn the_histogram_loses_no_value() {
        let values: Vec<f64> = (0..200).map(|n| f64::from(n) * 0.1 - 3.0).collect();
        let counted: u32 = histogram(&values, 1)
            .lines()
            .filter_map(|line| line.split_whitespace().nth(1)?.parse::<u32>().ok())
            .sum();
        assert_eq!(counted, 200);
    }
}
