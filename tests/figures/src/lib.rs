//! The reference fits and the measured work in a form that a board can carry.
//!
//! [`fits::print`] computes every case of `tests/reference/fits` and `point` and prints every number of
//! every answer bit for bit; what a board prints must be what a host prints. [`work::all`]
//! is what instructions are counted for.
//!
//! No file, no heap: the data are compiled in.
#![no_std]

pub mod calibration;
pub mod fits;
mod half_sphere;
mod meter;
pub mod readings;
mod trust;
pub mod work;

pub use half_sphere::half_sphere;

/// A case of `tests/reference/fits` or `point`.
pub struct Case {
    /// Its name there.
    pub id: &'static str,
    /// What is fitted: `sphere`, `registration`, `point_sensor`, …
    pub kind: &'static str,
    /// The axis that an operator would name, where one is needed. A point sensor: 1 where the
    /// radius is free, 1 where the gain is.
    pub hint: [f64; 3],
    /// Points in the first three columns; in the others those that a registration pairs
    /// them with, mm. A point sensor: first the ball (centre, radius, their uncertainties), then
    /// the axes and the reading.
    pub rows: &'static [[f64; 6]],
}

/// All cases, in the order of their index.
pub const CASES: &[Case] = include!(concat!(env!("OUT_DIR"), "/cases.rs"));

/// The most points that a case has.
pub const MAX_POINTS: usize = {
    let (mut most, mut index) = (0, 0);
    while index < CASES.len() {
        if CASES[index].rows.len() > most {
            most = CASES[index].rows.len();
        }
        index += 1;
    }
    most
};

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::String;
    use std::vec::Vec;

    use super::*;

    /// All work comes to its result.
    #[test]
    fn all_work_succeeds() {
        struct Runs(Vec<&'static str>);
        impl work::Meter for Runs {
            fn measure(&mut self, work: &'static str, _: u32, run: &mut dyn FnMut()) {
                run();
                self.0.push(work);
            }
        }
        let mut runs = Runs(Vec::new());
        assert_eq!(work::all(&mut runs), Ok(()));
        assert_eq!(runs.0.len(), 19);
    }

    /// Every case of the index gives numbers, or a refusal where one is right.
    #[test]
    fn every_case_is_printed() {
        let mut page = String::new();
        fits::print(&mut page).unwrap();
        for case in CASES {
            let mut lines = page
                .lines()
                .filter(|line| line.split(' ').next() == Some(case.id));
            // A refusal is one word that is no number.
            let is_refused = |line: &str| {
                let said = line.split(' ').nth(2);
                said.is_some_and(|word| u64::from_str_radix(word, 16).is_err())
            };
            let refused = lines.next().is_some_and(is_refused);
            assert_eq!(refused, case.id.contains("bad_"), "{}", case.id);
            assert!(lines.all(|line| is_refused(line) == refused), "{}", case.id);
        }
        assert!(!page.contains("unknown"), "{page}");
        assert_eq!(CASES.len(), 44);
    }
}
