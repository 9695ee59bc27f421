//! Reports of a session: one self-contained HTML file with pictures, and the
//! compact table of one clamping for a terminal.
//!
//! The report shows records; it measures and decides nothing. What it derives
//! (uncertainties from a covariance, errors against a known answer, what a
//! correction program does) is in [`figures`] and [`program`], and every
//! derived figure is defined on the page that shows it.
//!
//! | file | idea |
//! | --- | --- |
//! | `model` | what a report is made from |
//! | `figures`, `program` | derived figures; what a correction program does |
//! | `number`, `text`, `markup` | digits and units; text that comes from a control; elements that always close |
//! | `svg`, `scale`, `labels` | drawing: primitives, scales and scale bars, labels that do not overlap |
//! | `sphere`, `unfitted`, `residuals`, `plate`, `part`, `chart`, `paths` | the pictures |
//! | `head`, `tables`, `registration`, `clamping`, `page` | the parts of the page |
//! | `experiment`, `thesis_tables`, `map`, `polar` | the thesis' tables and the surface that was cut |
//! | `terminal` | the table for a terminal |

mod chart;
mod clamping;
mod experiment;
pub mod figures;
mod head;
mod labels;
mod map;
mod markup;
mod model;
mod number;
mod page;
mod part;
pub mod paths;
mod plate;
mod polar;
pub mod program;
mod registration;
mod residuals;
mod scale;
mod sphere;
mod svg;
mod tables;
pub mod terminal;
mod text;
mod thesis_tables;
mod unfitted;

pub use model::{Fact, Plate, Session, Truth};
pub use page::{html, html_of_experiment};

#[cfg(test)]
mod sample;
#[cfg(test)]
mod tests;
