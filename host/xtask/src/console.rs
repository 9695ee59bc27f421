//! What a person sees: progress lines, notes, errors and the summary table.
//!
//! Everything goes to standard error, so that the standard output of the commands
//! that a task runs stays theirs. Colour is used on terminals only, and not where
//! `NO_COLOR` is set (<https://no-color.org>).

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::time::Duration;

const BOLD: &str = "1";
const RED: &str = "31;1";
const GREEN: &str = "32;1";
const YELLOW: &str = "33;1";

/// Whether colour is wanted.
pub fn has_colour() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none()
}

fn paint(colour: &str, text: &str) -> String {
    if has_colour() {
        format!("\x1b[{colour}m{text}\x1b[0m")
    } else {
        text.to_owned()
    }
}

/// The headline of one step of a longer task.
pub fn headline(text: &str) {
    eprintln!("\n{}", paint(BOLD, &format!("== {text}")));
}

/// A line of progress.
pub fn progress(text: &str) {
    eprintln!("   {text}");
}

/// Something left out, and why.
pub fn skipped(text: &str) {
    eprintln!("   {} {text}", paint(YELLOW, "skipped:"));
}

/// Something that is not as it should be, and is no failure.
pub fn warning(text: &str) {
    eprintln!("   {} {text}", paint(YELLOW, "warning:"));
}

/// An error with its causes, the outermost first.
pub fn error(error: &anyhow::Error) {
    eprintln!("{} {error:#}", paint(RED, "error:"));
}

/// Prints rows under their headings, the first of them, on standard output.
pub fn rows<const N: usize>(rows: &[[String; N]]) {
    print!("{}", aligned(rows));
}

fn aligned<const N: usize>(rows: &[[String; N]]) -> String {
    let widths: [usize; N] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].len()).max().unwrap_or(0));
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            // Figures stand under each other by their last digit.
            let _ = if cell.starts_with(|first: char| first.is_ascii_digit()) {
                write!(line, "{cell:>width$}  ")
            } else {
                write!(line, "{cell:width$}  ")
            };
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// How a step ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It ran and everything held.
    Passed,
    /// What ran held, but a part could not run here, for this reason.
    Partly(String),
    /// It could not run here, for this reason, and is not required here.
    Skipped(String),
    /// It ran and something did not hold.
    Failed,
    /// An earlier step failed, or it was not asked for.
    NotRun,
}

/// One line of the summary table.
pub(crate) struct Line {
    /// The name of the step.
    pub step: &'static str,
    /// How it ended.
    pub outcome: Outcome,
    /// How long it took.
    pub took: Duration,
}

/// Prints the summary table.
pub fn summary(lines: &[Line]) {
    eprint!("\n{}", table(lines, paint));
}

fn table(lines: &[Line], paint: impl Fn(&str, &str) -> String) -> String {
    let width = lines.iter().map(|line| line.step.len()).max().unwrap_or(0);
    let mut text = format!("{:width$}  {:8}  {:>8}\n", "step", "result", "seconds");
    for line in lines {
        let (colour, result) = match line.outcome {
            Outcome::Passed => (GREEN, "ok"),
            Outcome::Partly(_) => (YELLOW, "partly"),
            Outcome::Skipped(_) => (YELLOW, "skipped"),
            Outcome::Failed => (RED, "FAILED"),
            Outcome::NotRun => (YELLOW, "not run"),
        };
        // Padded before it is painted: escape codes would count as width.
        let result = paint(colour, &format!("{result:8}"));
        let seconds = line.took.as_secs_f64();
        let _ = write!(text, "{:width$}  {result}  {seconds:>8.1}", line.step);
        if let Outcome::Skipped(reason) | Outcome::Partly(reason) = &line.outcome {
            let _ = write!(text, "  {reason}");
        }
        text.push('\n');
    }
    let total: f64 = lines.iter().map(|line| line.took.as_secs_f64()).sum();
    let _ = writeln!(text, "{:width$}  {:8}  {total:>8.1}", "total", "");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words are aligned left, figures right, and no line ends in blanks.
    #[test]
    fn aligned_table() {
        let rows = [
            ["image", "bytes", "files"],
            ["pico", "1234", "a"],
            ["x", "99", ""],
        ];
        assert_eq!(
            aligned(&rows.map(|row| row.map(String::from))),
            "image  bytes  files\n\
             pico    1234  a\n\
             x         99\n"
        );
    }

    /// What did not run, or not all of it, is yellow: green is only what ran and held.
    #[test]
    fn colours() {
        let colour = |outcome| {
            let line = Line {
                step: "step",
                outcome,
                took: Duration::ZERO,
            };
            let text = table(&[line], |colour, text| format!("<{colour}>{text}"));
            let start = text.find('<').unwrap();
            text[start + 1..text.find('>').unwrap()].to_owned()
        };
        assert_eq!(colour(Outcome::Passed), GREEN);
        assert_eq!(colour(Outcome::Failed), RED);
        assert_eq!(colour(Outcome::Skipped("why".into())), YELLOW);
        assert_eq!(colour(Outcome::Partly("why".into())), YELLOW);
        assert_eq!(colour(Outcome::NotRun), YELLOW);
    }

    /// Columns line up, the reason of a skip is on its line, and the total is the sum.
    #[test]
    fn summary_table() {
        let line = |step, outcome, seconds| Line {
            step,
            outcome,
            took: Duration::from_secs_f64(seconds),
        };
        let text = table(
            &[
                line("format", Outcome::Passed, 1.24),
                line("fuzzing", Outcome::Skipped("no c++".into()), 0.0),
                line("set-up", Outcome::Partly("no QEMU".into()), 2.0),
                line("tests", Outcome::Failed, 100.5),
                line("demo", Outcome::NotRun, 0.0),
            ],
            |_, text| text.to_owned(),
        );
        assert_eq!(
            text,
            "step     result     seconds\n\
             format   ok             1.2\n\
             fuzzing  skipped        0.0  no c++\n\
             set-up   partly         2.0  no QEMU\n\
             tests    FAILED       100.5\n\
             demo     not run        0.0\n\
             total                 103.7\n"
        );
    }
}
