//! A point sensor in the spindle.

pub(super) mod digitize;
pub(super) mod points;
pub(super) mod serve;

/// A line for each warning.
pub(super) fn warned(warnings: &[String]) -> String {
    warnings
        .iter()
        .map(|warning| format!("warning: {warning}\n"))
        .collect()
}
