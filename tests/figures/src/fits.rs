//! Every reference fit, printed bit for bit.

use core::fmt::{Result, Write};

use heapless::Vec;
use nalgebra::Vector3;
use umi_core::fit::{self, FitError, Statistics};
use umi_core::registration::{Registration, register};
use umi_core::units::Point;

use crate::calibration::Readings;
use crate::{CASES, Case, MAX_POINTS};

type Points = Vec<Point, MAX_POINTS>;

/// Prints a line for each group of numbers: the case, their name, and the bits of each
/// number in hexadecimal; or the code of the refusal.
///
/// # Errors
/// `out`'s.
pub fn print(out: &mut impl Write) -> Result {
    CASES.iter().try_for_each(|case| print_case(case, out))
}

/// In how many parts [`print_part`] prints them.
pub const PARTS: usize = 4;

/// As [`print`], each so manyth case, without the calibrations by more than thirty readings: a processor
/// without floating-point unit takes a minute for them.
///
/// # Errors
/// `out`'s.
pub fn print_part(part: usize, out: &mut impl Write) -> Result {
    CASES
        .iter()
        .filter(|case| case.kind != "point_sensor" || case.rows.len() <= 31)
        .skip(part)
        .step_by(PARTS)
        .try_for_each(|case| print_case(case, out))
}

/// As [`print`], one case.
///
/// # Errors
/// `out`'s.
pub fn print_case(case: &Case, out: &mut impl Write) -> Result {
    let points = case.points(0);
    let hint = Vector3::from(case.hint);
    let page = &mut Page { case, out };
    match case.kind {
        "sphere" => {
            page.fit("fit", fit::sphere::fit(&points), |page, fit| {
                page.point("center", fit.center)?;
                page.numbers("radius", &[fit.radius.0])?;
                page.numbers("cov_unit", fit.cov_unit.as_flattened())?;
                page.statistics(&fit.stats)
            })?;
            page.fit("linear", fit::sphere::fit_linear(&points), |page, fit| {
                page.point("linear_center", fit.center)?;
                page.numbers("linear_radius", &[fit.radius.0])
            })
        }
        "plane" => page.fit("fit", fit::plane::fit(&points), |page, fit| {
            page.point("point", fit.point)?;
            page.vector("normal", &fit.normal)?;
            page.numbers("offset", &[fit.offset.0, fit.var_unit_offset_at_point])?;
            page.numbers("cov_unit_normal", fit.cov_unit_normal.as_flattened())?;
            page.statistics(&fit.stats)
        }),
        "line" => page.fit("fit", fit::line::fit(&points), |page, fit| {
            page.point("point", fit.point)?;
            page.vector("direction", &fit.direction)?;
            page.numbers("cov_unit_point", fit.cov_unit_point.as_flattened())?;
            page.numbers("cov_unit_direction", fit.cov_unit_direction.as_flattened())?;
            page.statistics(&fit.stats)
        }),
        "circle" => {
            page.fit("fit", fit::circle::fit(&points), |page, fit| {
                page.point("center", fit.center)?;
                page.vector("normal", &fit.normal)?;
                page.numbers("radius", &[fit.radius.0, fit.rms_plane.0])?;
                page.numbers("cov_unit", fit.cov_unit.as_flattened())?;
                page.statistics(&fit.stats)
            })?;
            page.fit("flat", fit::circle2d::fit(&points), |page, fit| {
                let numbers = [fit.center_x.0, fit.center_y.0, fit.radius.0];
                page.numbers("flat", &numbers)?;
                page.numbers("flat_cov_unit", fit.cov_unit.as_flattened())
            })
        }
        "cylinder" => {
            page.fit("fit", fit::cylinder::fit(&points), cylinder)?;
            page.fit("near", fit::cylinder::fit_near(&points, &hint), cylinder)
        }
        "cone" => {
            page.fit("fit", fit::cone::fit(&points), cone)?;
            page.fit("near", fit::cone::fit_near(&points, &hint), cone)
        }
        "registration" => {
            let target = case.points(3);
            page.fit("fit", register(&points, &target), |page, fit| {
                registration(page, &fit)?;
                points
                    .iter()
                    .zip(&target)
                    .try_for_each(|(p, q)| page.vector("residual", &fit.residual_mm(*p, *q)))
            })
        }
        "point_sensor" => match Readings::of(case).map(|of| of.calibrate()) {
            Some(Ok(found)) => {
                page.point("offset", found.sensor.offset)?;
                page.vector("direction", &found.sensor.direction)?;
                page.numbers("gain_radius", &[found.sensor.gain, found.radius_error.0])?;
                page.numbers("cov_unit", found.cov_unit.as_flattened())?;
                page.numbers("cov_balls", found.cov_balls.as_flattened())?;
                page.statistics(&found.stats)
            }
            Some(Err(refusal)) => page.word("fit", refusal.code()),
            None => page.word("unknown", case.kind),
        },
        other => page.word("unknown", other),
    }
}

fn cylinder<W: Write>(page: &mut Page<'_, W>, fit: fit::cylinder::CylinderFit) -> Result {
    page.point("point", fit.point)?;
    page.vector("direction", &fit.direction)?;
    page.numbers("radius", &[fit.radius.0, fit.var_unit_radius])?;
    page.numbers("cov_unit_point", fit.cov_unit_point.as_flattened())?;
    page.numbers("cov_unit_direction", fit.cov_unit_direction.as_flattened())?;
    page.statistics(&fit.stats)
}

fn cone<W: Write>(page: &mut Page<'_, W>, fit: fit::cone::ConeFit) -> Result {
    page.point("apex", fit.apex)?;
    page.vector("direction", &fit.direction)?;
    page.numbers("half_angle", &[fit.half_angle.0, fit.var_unit_half_angle])?;
    page.point("point", fit.point)?;
    page.numbers("radius_at_point", &[fit.radius_at_point.0])?;
    page.numbers("cov_unit_apex", fit.cov_unit_apex.as_flattened())?;
    page.numbers("cov_unit_direction", fit.cov_unit_direction.as_flattened())?;
    page.statistics(&fit.stats)
}

fn registration<W: Write>(page: &mut Page<'_, W>, fit: &Registration) -> Result {
    page.numbers("rotation", fit.transform.rotation.as_slice())?;
    page.vector("translation", &fit.transform.translation_mm)?;
    page.numbers("angle", &[fit.angle.0])?;
    if let Some(axis) = &fit.axis {
        page.vector("axis", axis)?;
    }
    page.point("centroid", fit.centroid)?;
    page.numbers("cov_unit", fit.cov_unit.as_flattened())?;
    page.numbers("cov_unit_rotvec", fit.cov_unit_rotvec.as_flattened())?;
    if let Some(cov_t) = fit.cov_t() {
        page.numbers("cov_t", cov_t.as_flattened())?;
    }
    let inverse = fit.inverse();
    page.numbers("inverse", inverse.rotation.as_slice())?;
    page.vector("inverse_translation", &inverse.translation_mm)?;
    page.statistics(&fit.stats)
}

impl Case {
    /// The points in three columns, the first being `column`.
    pub(crate) fn points(&self, column: usize) -> Points {
        let axis =
            |row: &[f64; 6], axis: usize| row.get(column + axis).copied().unwrap_or(f64::NAN);
        self.rows
            .iter()
            .map(|row| Point::from_mm(axis(row, 0), axis(row, 1), axis(row, 2)))
            .collect()
    }
}

/// Where the answer to a case is printed.
struct Page<'a, W> {
    case: &'a Case,
    out: &'a mut W,
}

impl<W: Write> Page<'_, W> {
    fn fit<F>(
        &mut self,
        name: &str,
        fit: core::result::Result<F, FitError>,
        print: impl FnOnce(&mut Self, F) -> Result,
    ) -> Result {
        match fit {
            Ok(fit) => print(self, fit),
            Err(error) => self.word(name, error.code()),
        }
    }

    fn word(&mut self, name: &str, word: &str) -> Result {
        writeln!(self.out, "{} {name} {word}", self.case.id)
    }

    fn numbers(&mut self, name: &str, numbers: &[f64]) -> Result {
        write!(self.out, "{} {name}", self.case.id)?;
        for number in numbers {
            write!(self.out, " {:016x}", number.to_bits())?;
        }
        writeln!(self.out)
    }

    fn vector(&mut self, name: &str, vector: &Vector3<f64>) -> Result {
        self.numbers(name, vector.as_slice())
    }

    fn point(&mut self, name: &str, point: Point) -> Result {
        self.numbers(name, &point.to_array_mm())
    }

    fn statistics(&mut self, stats: &Statistics) -> Result {
        let sigma = stats.sigma.map_or(0.0, |sigma| sigma.0);
        let numbers = [stats.rms.0, sigma, stats.max_abs_residual.0];
        self.numbers("rms_sigma_max", &numbers)
    }
}
