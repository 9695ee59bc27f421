//! The calibration of a point sensor, as it is written and read.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use umi_core::point::{
    BallReading, CalibrationBall, PointCalibration, PointQuestion, PointRefusal, PointSensor,
    ResidualNoise, calibrate,
};
use umi_core::units::{Mm, Point};

use super::doubts::doubts;
use super::readings::{MAX_MM, SensorReading, SensorReadings};
use super::scale::{self, ScaleError};
use super::spheres::CalibrationBalls;
use crate::ScanError;
use crate::rigid::Vec3;

/// A covariance of the offset (mm) and the direction.
pub type OffsetAndDirection = [[f64; 6]; 6];

/// The same with the gain behind them.
pub type SensorCovariance = [[f64; 7]; 7];

/// What is asked beside the offset and the direction.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationQuestion {
    /// What the solver is asked.
    pub wanted: PointQuestion,
    /// The largest rms that is accepted, mm.
    pub max_rms_mm: Option<f64>,
}

/// The answer, with the names that its file has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointSensorCalibration {
    /// `point_sensor`.
    pub kind: &'static str,
    /// Readings in the file.
    pub n: usize,
    /// Readings that were used.
    pub used: usize,
    /// Degrees of freedom.
    pub dof: usize,
    /// Offset t.
    pub offset_mm: [f64; 3],
    /// Direction a.
    pub direction: [f64; 3],
    /// Gain of the readings.
    pub gain: f64,
    /// Radius of the ball, with its error if that was asked for; none with several balls.
    pub radius_mm: Option<f64>,
    /// Distances of the points from their balls, in the order of the readings used.
    pub residuals_mm: Vec<f64>,
    /// `sqrt(sum d² / n)`.
    pub rms_mm: f64,
    /// `sqrt(sum d² / dof)`, none where the fit is exact. Weighted along the beam it is the
    /// standard deviation of one reading.
    pub sigma_mm: Option<f64>,
    /// Covariance of t and a from the scatter.
    pub covariance: Option<OffsetAndDirection>,
    /// The same with what the balls' uncertainties add.
    pub covariance_total: Option<OffsetAndDirection>,
    /// Covariance of the gain with t, a and itself, if it was asked for: a point needs it.
    pub covariance_gain: Option<[f64; 7]>,
    /// The same with what the balls' uncertainties add.
    pub covariance_gain_total: Option<[f64; 7]>,
    /// Standard uncertainty of the gain, if it was asked for.
    pub u_gain: Option<f64>,
    /// Standard uncertainty of the radius, if it was asked for.
    pub u_radius_mm: Option<f64>,
    /// Mean of the readings.
    pub stand_off_mm: f64,
    /// Standard uncertainties of x, y and z of a point at the mean reading, balls included.
    /// t and a are correlated: a point is known far better than t.
    pub u_point_mm: Option<[f64; 3]>,
    /// `mirror_ambiguous`, `weak: …`, `scale: …`, `outlier: …`, `radius: …`, `gain: …`, `repeated: …`.
    pub warnings: Vec<String>,
}

/// Finds offset and direction.
///
/// # Errors
/// Refused by the names of the solver, of the balls, and `residual_too_large`.
pub fn find(
    readings: &SensorReadings,
    balls: &CalibrationBalls,
    question: &CalibrationQuestion,
) -> Result<PointSensorCalibration, ScanError> {
    let read: Vec<BallReading> = readings
        .used
        .iter()
        .map(|reading| {
            Ok(BallReading {
                axes: Point::from_array_mm(reading.axes_mm),
                gamma: Mm(reading.gamma_mm),
                ball: balls.of(reading)?,
            })
        })
        .collect::<Result<_, ScanError>>()?;
    let fit = calibrate(&read, &balls.balls, &question.wanted).map_err(|refusal| {
        if let Some(error) = gain_is_open(&read, balls, &question.wanted, &refusal) {
            return error;
        }
        let wild = wild(readings).filter(|_| refusal.code() == "residual_too_large");
        let mut error = ScanError::from(refusal);
        if let Some(reading) = wild {
            error.message += &format!(
                "; the reading in line {}, {} mm, is far from all others: leave it out, or measure it again",
                reading.line, reading.gamma_mm
            );
        }
        error
    })?;
    if let Some(limit) = question.max_rms_mm
        && fit.stats.rms.0 > limit
    {
        return Err(ScanError::refused(
            "residual_too_large",
            format_args!(
                "rms {:.6} mm, limit {limit} mm: check the balls, the lens, and leave out readings with little signal (--min-snr)",
                fit.stats.rms.0
            ),
        )
        .with("rms_mm", fit.stats.rms.0));
    }
    Ok(answer(readings, &read, &balls.balls, question, &fit))
}

/// Readings that fit with the gain as it is, and have no minimum with the gain free: nothing is wrong with direction,
/// balls or unit.
fn gain_is_open(
    read: &[BallReading],
    balls: &CalibrationBalls,
    wanted: &PointQuestion,
    refusal: &PointRefusal,
) -> Option<ScanError> {
    if !wanted.free_gain || !matches!(refusal, PointRefusal::NoConvergence) {
        return None;
    }
    let fixed = PointQuestion {
        free_gain: false,
        ..*wanted
    };
    let fit = calibrate(read, &balls.balls, &fixed).ok()?;
    let n = read.len() as f64;
    let spread = (read
        .iter()
        .map(|r| (r.gamma.0 - fit.mean_gamma.0).powi(2))
        .sum::<f64>()
        / n)
        .sqrt();
    Some(ScanError::refused(
        "degenerate",
        format_args!(
            "the readings do not determine the gain: with a gain of 1 they fit (rms {:.2e} mm), with the gain free no minimum is found; they vary by {spread:.2e} mm only (standard deviation): measure over the whole depth of field, or leave --free gain out",
            fit.stats.rms.0
        ),
    ))
}

/// The one reading that is far from the others.
fn wild(readings: &SensorReadings) -> Option<&SensorReading> {
    let mut all: Vec<f64> = readings.used.iter().map(|r| r.gamma_mm).collect();
    all.sort_by(f64::total_cmp);
    // Of the others.
    let [_, least, .., most, _] = all.as_slice() else {
        return None;
    };
    let is_far = |r: &&SensorReading| {
        let beyond = (r.gamma_mm - most).max(least - r.gamma_mm);
        beyond > 2.0 * (most - least).max(1.0)
    };
    let mut far = readings.used.iter().filter(is_far);
    far.next().filter(|_| far.next().is_none())
}

fn answer(
    readings: &SensorReadings,
    read: &[BallReading],
    balls: &[CalibrationBall],
    question: &CalibrationQuestion,
    fit: &PointCalibration,
) -> PointSensorCalibration {
    let only = read
        .first()
        .filter(|first| read.iter().all(|r| r.ball == first.ball))
        .and_then(|first| balls.get(first.ball));
    let u = |asked: bool, variance| {
        asked
            .then(|| fit.stats.standard_uncertainty(variance))
            .flatten()
    };
    let wanted = &question.wanted;
    let (noise, total) = (fit.covariance(), fit.covariance_total());
    let of_gain = |covariance: Option<SensorCovariance>| {
        let [.., row] = covariance.filter(|_| wanted.free_gain)?;
        Some(row)
    };
    PointSensorCalibration {
        kind: "point_sensor",
        n: readings.lines,
        used: read.len(),
        dof: fit.stats.dof,
        offset_mm: fit.sensor.offset.to_array_mm(),
        direction: fit.sensor.direction.into(),
        gain: fit.sensor.gain,
        radius_mm: only.map(|ball| ball.radius.0 + fit.radius_error.0),
        residuals_mm: read
            .iter()
            .filter_map(|r| Some(fit.residual(r, balls.get(r.ball)?).0))
            .collect(),
        rms_mm: fit.stats.rms.0,
        sigma_mm: fit.stats.sigma.map(|sigma| sigma.0),
        covariance: noise.map(offset_and_direction),
        covariance_total: total.map(offset_and_direction),
        covariance_gain: of_gain(noise),
        covariance_gain_total: of_gain(total),
        u_gain: u(wanted.free_gain, fit.cov_unit[6][6]),
        u_radius_mm: u(wanted.free_radius, fit.radius_variance_unit),
        stand_off_mm: fit.mean_gamma.0,
        u_point_mm: fit
            .place_uncertainty(fit.mean_gamma)
            .map(|known| known.u.map(|u| u.0)),
        warnings: {
            let mut all = warnings(question, fit, scale::scale(read, balls, fit));
            all.extend(doubts(readings, read, balls, wanted, fit));
            all
        },
    }
}

/// Without the gain's row and column.
fn offset_and_direction(covariance: SensorCovariance) -> OffsetAndDirection {
    std::array::from_fn(|row| std::array::from_fn(|column| covariance[row][column]))
}

fn warnings(
    question: &CalibrationQuestion,
    fit: &PointCalibration,
    scale: Option<ScaleError>,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if fit.mirror {
        warnings.push("mirror_ambiguous".to_owned());
    }
    if let Some(weak) = fit.weak {
        warnings.push(format!(
            "weak: the readings hardly determine the {} (an error grows {:.0} times); spread them over a wider cone and over the depth of field",
            weak.what, weak.factor
        ));
    }
    if question.wanted.noise == ResidualNoise::AlongBeam {
        warnings.push("weighted: residuals count along the beam".to_owned());
    }
    if let Some(error) = scale.filter(ScaleError::is_sure) {
        let (ppm, u) = (error.scale * 1e6, error.u * 1e6);
        warnings.push(format!(
            "{SCALE} the axes' lengths should be {ppm:+.1} ppm longer to fit the balls (u {u:.1} ppm): correct the scale (steel: 11.5 ppm a kelvin), or measure the centres anew"
        ));
    }
    warnings
}

/// Another unit, and no gain, is outside its reciprocal and this.
const MOST_GAIN: f64 = 5.0;

/// What rounding the file's numbers may leave.
const COVARIANCE_ROUNDING: f64 = 1e-6;

/// How the warning begins that the axes' scale does not fit the balls.
const SCALE: &str = "scale:";

/// A reading, or a target, this part of the calibration's readings beside them is another lens'. The depth of field of a lens
/// is less than twice that, and the next lens is farther.
pub const OTHER_LENS_PART: f64 = 0.25;

/// A calibration that was read from its file.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownSensor {
    /// Offset, direction and gain.
    pub sensor: PointSensor,
    /// Covariance of offset, direction and gain, if the file has one.
    pub covariance: Option<SensorCovariance>,
    /// The same with the balls' uncertainties.
    pub covariance_total: Option<SensorCovariance>,
    /// Mean of the readings that it was made of, if the file says it.
    pub stand_off_mm: Option<f64>,
    /// What the calibration warned of.
    pub warnings: Vec<String>,
}

impl KnownSensor {
    /// What it says of the axes' scale, if that did not fit the balls.
    #[must_use]
    pub fn scale_warning(&self) -> Option<&str> {
        let mut all = self.warnings.iter().map(String::as_str);
        all.find(|warning| warning.starts_with(SCALE))
    }

    /// Refuses a calibration that says itself that the axes' scale did not fit the balls.
    ///
    /// # Errors
    /// `warm_scale`.
    pub fn check_scale(&self) -> Result<(), ScanError> {
        match self.scale_warning() {
            None => Ok(()),
            Some(warning) => Err(ScanError::refused(
                "warm_scale",
                format_args!("the calibration says: {warning}; then calibrate again"),
            )),
        }
    }

    /// Refuses readings that this lens does not have: by more than a quarter beside those of the calibration.
    ///
    /// # Errors
    /// `other_lens`, with the first such line.
    pub fn check_readings(&self, readings: &SensorReadings) -> Result<(), ScanError> {
        let within_mm = OTHER_LENS_PART * self.stand_off_mm.unwrap_or_default().abs();
        readings.used.iter().try_for_each(|reading| {
            self.check_stand_off(
                reading.gamma_mm,
                within_mm,
                format_args!(
                    "line {} reads {} mm, which is another lens' or an exchanged sign",
                    reading.line, reading.gamma_mm
                ),
            )
        })
    }

    /// Refuses a calibration that was made at readings farther than `within_mm` beside one that this lens has. One
    /// that does not say where it was made is taken.
    ///
    /// # Errors
    /// `other_lens`.
    pub fn check_stand_off(
        &self,
        reading_mm: f64,
        within_mm: f64,
        said: impl std::fmt::Display,
    ) -> Result<(), ScanError> {
        let Some(stand_off_mm) = self.stand_off_mm else {
            return Ok(());
        };
        // Also refuses what is no number.
        if (stand_off_mm - reading_mm).abs() <= within_mm {
            return Ok(());
        }
        Err(ScanError::refused(
            "other_lens",
            format_args!(
                "the calibration was made at readings about {stand_off_mm:.3} mm; {said}: calibrate with this lens"
            ),
        ))
    }
}

/// Reads the file of a calibration.
///
/// # Errors
/// Exit status 1 if the file cannot be read; refused as `bad_calibration`.
pub fn read(path: &Path) -> Result<KnownSensor, ScanError> {
    let bytes = std::fs::read(path).map_err(|error| ScanError::file("read", path, &error))?;
    parse(&bytes).map_err(|error| ScanError {
        message: format!("{}: {}", path.display(), error.message),
        ..error
    })
}

/// The calibration in a text, as [`read`] reads it.
///
/// # Errors
/// As [`read`].
pub fn parse(bytes: &[u8]) -> Result<KnownSensor, ScanError> {
    let file: Value = serde_json::from_slice(bytes)
        .map_err(|error| bad(format_args!("this is no JSON: {error}")))?;
    let kind = file.get("kind").and_then(Value::as_str);
    if kind != Some("point_sensor") {
        return Err(bad(
            "its kind is not \"point_sensor\": give what umi scan calibrate point --json has printed",
        ));
    }
    let triple = |key: &str| -> Result<[f64; 3], ScanError> {
        numbers(file.get(key)).ok_or_else(|| bad(format_args!("{key} is not three numbers")))
    };
    let direction = Vec3::from(triple("direction")?);
    let length = direction.norm();
    // Rounded to six digits it still counts; what is longer was never a direction.
    if !length.is_finite() || (length - 1.0).abs() > 1e-6 {
        return Err(bad(format_args!(
            "direction has the length {length}, a unit vector is needed"
        )));
    }
    let gain = match file.get("gain") {
        None => 1.0,
        Some(gain) => gain
            .as_f64()
            .filter(|gain| (1.0 / MOST_GAIN..=MOST_GAIN).contains(gain))
            .ok_or_else(|| {
                bad(format_args!(
                    "gain is not a number from {} to {MOST_GAIN}",
                    1.0 / MOST_GAIN
                ))
            })?,
    };
    let offset = triple("offset_mm")?;
    if offset.iter().any(|mm| mm.abs() > MAX_MM) {
        return Err(bad("offset_mm is no length on a machine"));
    }
    Ok(KnownSensor {
        sensor: PointSensor {
            offset: Point::from_array_mm(offset),
            direction,
            gain,
        },
        covariance: matrix(&file, "covariance", "covariance_gain")?,
        covariance_total: matrix(&file, "covariance_total", "covariance_gain_total")?,
        stand_off_mm: file.get("stand_off_mm").and_then(Value::as_f64),
        warnings: file
            .get("warnings")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .map(str::to_owned)
            .collect(),
    })
}

/// The covariance of offset and direction, and where the file has it that of the gain.
fn matrix(file: &Value, key: &str, of_gain: &str) -> Result<Option<SensorCovariance>, ScanError> {
    let Some(value) = file.get(key).filter(|value| !value.is_null()) else {
        return Ok(None);
    };
    let wrong = || bad(format_args!("{key} is not 6 rows of 6 numbers"));
    let rows = value
        .as_array()
        .filter(|rows| rows.len() == 6)
        .ok_or_else(wrong)?;
    let mut matrix = [[0.0; 7]; 7];
    for (row, wanted) in rows.iter().zip(&mut matrix) {
        let row: [f64; 6] = numbers(Some(row)).ok_or_else(wrong)?;
        wanted[..6].copy_from_slice(&row);
    }
    let is_free = file.get("u_gain").is_some_and(Value::is_number);
    if is_free && file.get(of_gain).is_none_or(Value::is_null) {
        return Err(bad(format_args!(
            "its gain was found, and {of_gain} is not in it, without which no point's uncertainty is known: calibrate again"
        )));
    }
    if let Some(gain) = file.get(of_gain).filter(|value| !value.is_null()) {
        matrix[6] =
            numbers(Some(gain)).ok_or_else(|| bad(format_args!("{of_gain} is not 7 numbers")))?;
        let [.., last] = matrix;
        for (row, of_gain) in matrix.iter_mut().zip(last) {
            row[6] = of_gain;
        }
    }
    if !is_covariance(&matrix) {
        return Err(bad(format_args!(
            "{key} is no covariance: it is symmetric, with no variance below 0 and no correlation above 1"
        )));
    }
    Ok(Some(matrix))
}

fn is_covariance(matrix: &SensorCovariance) -> bool {
    // Along itself a direction has a variance of zero, but for rounding.
    let least = |i: usize| {
        let block = [0..3, 3..6, 6..7][i / 3].clone();
        let largest = block.map(|k| matrix[k][k]).fold(0.0, f64::max);
        COVARIANCE_ROUNDING * largest
    };
    (0..7).all(|i| {
        matrix[i][i] <= MAX_MM
            && (0..=i).all(|j| {
                let most = (matrix[i][i].max(least(i)) * matrix[j][j].max(least(j))).sqrt();
                let [one, other] = [matrix[i][j], matrix[j][i]];
                matrix[i][i] >= -least(i)
                    && one.abs() <= most * (1.0 + COVARIANCE_ROUNDING)
                    && (one - other).abs() <= most * COVARIANCE_ROUNDING
            })
    })
}

fn numbers<const N: usize>(value: Option<&Value>) -> Option<[f64; N]> {
    let all: Option<Vec<f64>> = value?.as_array()?.iter().map(Value::as_f64).collect();
    all?.try_into().ok()
}

fn bad(message: impl std::fmt::Display) -> ScanError {
    ScanError::refused("bad_calibration", message)
}
