//! Reports of a session: one self-contained HTML file with pictures, and the
//! compact table of one clamping for a terminal.
//!
//! The report shows records; it measures and decides nothing. What it derives
//! (uncertainties from a covariance, errors against a known answer, what a
//! correction program does) is in [`figures`] and [`program`], and every
//! derived figure is defined on the page that shows it.
//!
//! | room | idea |
//! | --- | --- |
//! | [`figures`], [`program`] | derived figures; what a correction program does |
//! | [`draw`] | elements that always close; scales, labels, digits |
//! | `pictures` | the pictures |
//! | [`page`] | the page and its parts |
//! | [`paths`] | the page on two tool paths |
//! | [`path_plan`] | the page on a planned scan path |
//! | [`scan`] | the page on a scan that was placed |
//! | [`deviation`] | the page on a scan beside its nominal |
//! | [`terminal`], [`ink`] | the table for a terminal; its colours, and nothing else that steers it |

pub mod deviation;
pub mod draw;
pub mod figures;
pub mod ink;
pub mod page;
pub mod path_plan;
pub mod paths;
mod pictures;
pub mod program;
pub mod scan;
pub mod terminal;
mod vector;

pub use page::html;

#[cfg(test)]
mod sample;
#[cfg(test)]
mod tests;
