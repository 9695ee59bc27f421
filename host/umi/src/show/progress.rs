//! How far long work is: a line on standard error, where that is a terminal.

use std::io::IsTerminal as _;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use umi_scan::cloud::Points;

/// Points, between two looks at the line.
const POINTS: u64 = 1 << 16;
/// How often the clock on it is renewed.
const TURN: Duration = Duration::from_millis(200);

/// The line. It goes when the work is done. Nothing is shown where standard error is no terminal, or with `--json`.
pub(crate) struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A line, unless the answer is JSON.
    pub fn new(json: bool) -> Self {
        let bar = if !json && std::io::stderr().is_terminal() {
            let bar = ProgressBar::new_spinner();
            bar.enable_steady_tick(TURN);
            bar
        } else {
            ProgressBar::hidden()
        };
        let progress = Self { bar };
        progress.style("{spinner} {elapsed} {msg}");
        progress
    }

    /// What is done now; how long it takes is not known.
    pub fn stage(&self, what: &'static str) {
        self.bar.unset_length();
        self.style("{spinner} {elapsed} {msg}");
        self.bar.set_message(what);
    }

    /// What is counted now, to no known end.
    pub fn count(&self, what: &'static str) {
        self.bar.unset_length();
        self.bar.set_position(0);
        self.style("{spinner} {elapsed} {human_pos} {msg}");
        self.bar.set_message(what);
    }

    /// What is counted now, and how many there are.
    pub fn of(&self, what: &'static str, all: u64) {
        self.bar.set_position(0);
        self.bar.set_length(all);
        self.style("{spinner} {elapsed} [{bar:30}] {human_pos} of {human_len} {msg}");
        self.bar.set_message(what);
    }

    /// So many more are done.
    pub fn more(&self, n: u64) {
        self.bar.inc(n);
    }

    /// The points as they are, counted as they go by.
    pub fn through<'a>(&self, points: Points<'a>) -> Points<'a> {
        if self.bar.is_hidden() {
            return points;
        }
        self.count("points read");
        let bar = self.bar.clone();
        let mut seen = 0_u64;
        Box::new(points.inspect(move |_| {
            seen += 1;
            if seen.is_multiple_of(POINTS) {
                bar.inc(POINTS);
            }
        }))
    }

    fn style(&self, template: &str) {
        let style = ProgressStyle::with_template(template);
        self.bar
            .set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
