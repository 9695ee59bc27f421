//! Reports of a session: one self-contained HTML file with pictures, and the
//! compact table of one clamping for a terminal.
//!
//! The report shows records; it measures and decides nothing. What it derives
//! (uncertainties from a covariance, errors against a known answer, what a
//! correction program does) is in [`figures`] and [`figures::program`], and every
//! derived figure is defined on the page that shows it.
//!
//! | room | idea |
//! | --- | --- |
//! | [`figures`] | derived figures; what a correction program does |
//! | [`draw`] | elements that always close; scales, labels, digits |
//! | `pictures` | the pictures |
//! | [`pages`] | the page on a session, on two tool paths, on a planned path, on a scan that was placed or compared |
//! | [`terminal`] | the table for a terminal; its colours, and nothing else that steers it |

pub mod draw;
pub mod figures;
pub mod pages;
mod pictures;
pub mod terminal;
mod vector;

pub use pages::session::html;

#[cfg(test)]
mod sample;
#[cfg(test)]
mod tests;
