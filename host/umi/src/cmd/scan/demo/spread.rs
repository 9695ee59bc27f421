//! A figure over the seeds, and tables that terminal and page share.

use std::fmt::Write as _;

use serde::Serialize;
use umi_report::pages::scan::FigureTable;

use crate::show::terminal::Table;

/// A figure over the seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Spread {
    pub mean: f64,
    /// Standard deviation over the seeds; none of one seed.
    pub std: Option<f64>,
    /// The value that lies farthest from what it should be.
    pub worst: f64,
}

impl Spread {
    /// Of a value for each seed; `wanted` is what it should be.
    pub fn of(values: &[f64], wanted: f64) -> Self {
        let n = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        let off = |value: &f64| (value - wanted).abs();
        let worst = values.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
        Self {
            mean,
            std: (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
            worst: worst.copied().unwrap_or(0.0),
        }
    }

    /// Cells of a table: mean, standard deviation, worst.
    pub fn cells(&self, show: impl Fn(f64) -> String) -> [String; 3] {
        [
            show(self.mean),
            self.std
                .map_or_else(|| "one seed".into(), |std| format!("{std:.4}")),
            show(self.worst),
        ]
    }
}

/// The seeds, in words.
pub(super) fn named(seeds: &[u64]) -> String {
    match seeds {
        [] => "no seed".into(),
        [one] => format!("seed {one}"),
        [first, .., last] => format!("{} seeds, {first} to {last}", seeds.len()),
    }
}

/// A table for a terminal: a column of names, then figures.
pub(super) fn in_words(table: &FigureTable) -> String {
    let columns = table.heads.len();
    let alignment: String = (0..columns)
        .map(|i| if i < 1 { '<' } else { '>' })
        .collect();
    let mut words = Table::new(&alignment).titles(&table.heads);
    for row in &table.rows {
        words.row(row.clone());
    }
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write!(text, "{}\n\n{words}", table.caption);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_lies_farthest_from_what_is_wanted() {
        let spread = Spread::of(&[1.0, 2.0, 6.0], 5.0);
        assert_eq!(
            (spread.mean, spread.std, spread.worst),
            (3.0, Some(7.0_f64.sqrt()), 1.0)
        );
        assert_eq!(Spread::of(&[4.0], 0.0).std, None);
    }
}
