//! Results as quantities with names, units and uncertainties: the one source of
//! what tables, reports and `--json` show of a fit or a registration.

use std::borrow::Cow;

use umi_core::job::Fitted;
use umi_core::registration::Registration;
use umi_core::units::Point;
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::verdict::RegistrationReport;

/// A fit of any kind to any number of points.
#[derive(Clone, Debug)]
pub struct FitFigures<'a> {
    /// Geometry and unit covariance.
    pub shape: Shape,
    /// Degrees of freedom.
    pub dof: u64,
    /// sqrt(sum d² / n).
    pub rms_mm: f64,
    /// sqrt(sum d² / dof); none without degrees of freedom or without noise.
    pub sigma_mm: Option<f64>,
    /// One per point, in the order of the points.
    pub residuals_mm: Cow<'a, [f64]>,
}

impl<'a> From<&'a FitReport> for FitFigures<'a> {
    fn from(report: &'a FitReport) -> Self {
        Self {
            shape: report.shape,
            dof: report.dof.into(),
            rms_mm: report.rms_mm,
            sigma_mm: report.sigma_mm,
            residuals_mm: Cow::Borrowed(&report.residuals_mm),
        }
    }
}

impl FitFigures<'static> {
    /// What a fit says about its points.
    #[must_use]
    pub fn new(fitted: &Fitted, points: &[Point]) -> Self {
        let stats = fitted.stats();
        Self {
            shape: fitted.shape(),
            dof: stats.dof as u64,
            rms_mm: stats.rms.0,
            sigma_mm: stats.sigma.map(|sigma| sigma.0),
            residuals_mm: points.iter().map(|p| fitted.residual(*p).0).collect(),
        }
    }
}

impl FitFigures<'_> {
    /// Largest absolute residual and its place, from 0.
    #[must_use]
    pub fn worst(&self) -> Option<(usize, f64)> {
        largest(self.residuals_mm.iter().map(|d| d.abs()))
    }

    /// The name of the geometry.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self.shape {
            Shape::Sphere { .. } => "sphere",
            Shape::Plane { .. } => "plane",
            Shape::Line { .. } => "line",
            Shape::Circle { .. } => "circle",
            Shape::Cylinder { .. } => "cylinder",
            Shape::Cone { .. } => "cone",
        }
    }
}

/// What a quantity is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuantityUnit {
    /// A pure number, as the parts of a unit vector.
    One,
    /// Millimetres.
    Mm,
    /// Radians.
    Rad,
}

impl QuantityUnit {
    /// What a field's name ends with.
    #[must_use]
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::One => "",
            Self::Mm => "_mm",
            Self::Rad => "_rad",
        }
    }

    /// What the name of a variance or covariance ends with.
    #[must_use]
    pub const fn square_suffix(self) -> &'static str {
        match self {
            Self::One => "",
            Self::Mm => "_mm2",
            Self::Rad => "_rad2",
        }
    }
}

/// A number or three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Amount {
    /// A length, an angle.
    Scalar(f64),
    /// A position, a direction.
    Vector([f64; 3]),
}

/// A fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Its name, without unit.
    pub name: &'static str,
    /// Its unit.
    pub unit: QuantityUnit,
    /// Its value.
    pub value: Amount,
    /// What noise of 1 mm at the points would give as its variance, and the name
    /// of what is uncertain. None where the fit does not tell.
    pub uncertainty: Option<(&'static str, Amount)>,
}

impl Parameter {
    /// A parameter that is uncertain itself.
    const fn new(name: &'static str, unit: QuantityUnit, value: Amount, variance: Amount) -> Self {
        Self {
            name,
            unit,
            value,
            uncertainty: Some((name, variance)),
        }
    }

    /// Its standard uncertainty with noise of `sigma`.
    #[must_use]
    pub fn standard_uncertainty(&self, sigma_mm: Option<f64>) -> Option<Amount> {
        let sigma = sigma_mm?;
        let root = |variance: f64| sigma * variance.max(0.0).sqrt();
        Some(match self.uncertainty?.1 {
            Amount::Scalar(variance) => Amount::Scalar(root(variance)),
            Amount::Vector(variances) => Amount::Vector(variances.map(root)),
        })
    }
}

/// A variance or covariance for noise of 1 mm: inv(JᵀJ).
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Of what; empty for the parameters of a sphere or circle together.
    pub of: &'static str,
    /// The unit of that.
    pub unit: QuantityUnit,
    /// By rows; one number for a variance.
    pub rows: Rows,
}

/// A square matrix by rows, or one number.
#[derive(Clone, Debug, PartialEq)]
pub enum Rows {
    /// A variance.
    One(f64),
    /// A covariance.
    Matrix(Vec<Vec<f64>>),
}

impl Rows {
    fn of<const K: usize>(matrix: &[[f64; K]; K]) -> Self {
        Self::Matrix(matrix.iter().map(|row| row.to_vec()).collect())
    }
}

/// The parameters of a geometry and their covariances, in the order in which
/// they are shown.
#[must_use]
pub fn parameters(shape: &Shape) -> (Vec<Parameter>, Vec<Spread>) {
    use Amount::{Scalar, Vector};
    use QuantityUnit::{Mm, One, Rad};
    match *shape {
        Shape::Sphere {
            center_mm,
            radius_mm,
            cov_unit,
        } => {
            let [x, y, z, r] = diagonal(&cov_unit);
            let parameters = vec![
                Parameter::new("center", Mm, Vector(center_mm), Vector([x, y, z])),
                Parameter::new("radius", Mm, Scalar(radius_mm), Scalar(r)),
            ];
            (parameters, vec![matrix("", Mm, &cov_unit)])
        }
        Shape::Plane {
            point_mm,
            normal,
            offset_mm,
            cov_unit_normal,
            var_unit_offset,
        } => {
            let offset_at_point = "offset_at_point";
            let parameters = vec![
                certain("point", Mm, Vector(point_mm)),
                direction("normal", normal, &cov_unit_normal),
                Parameter {
                    uncertainty: Some((offset_at_point, Scalar(var_unit_offset))),
                    ..certain("offset", Mm, Scalar(offset_mm))
                },
            ];
            let spreads = vec![
                matrix("normal", One, &cov_unit_normal),
                variance(offset_at_point, Mm, var_unit_offset),
            ];
            (parameters, spreads)
        }
        Shape::Line {
            point_mm,
            direction: along,
            cov_unit_direction,
            cov_unit_point,
        } => {
            let parameters = vec![
                point("point", point_mm, &cov_unit_point),
                direction("direction", along, &cov_unit_direction),
            ];
            let spreads = vec![
                matrix("direction", One, &cov_unit_direction),
                matrix("point", Mm, &cov_unit_point),
            ];
            (parameters, spreads)
        }
        Shape::Circle {
            center_mm,
            normal,
            radius_mm,
            cov_unit,
            rms_plane_mm: _,
        } => {
            let [x, y, z, r] = diagonal(&cov_unit);
            let parameters = vec![
                Parameter::new("center", Mm, Vector(center_mm), Vector([x, y, z])),
                certain("normal", One, Vector(normal)),
                Parameter::new("radius", Mm, Scalar(radius_mm), Scalar(r)),
            ];
            (parameters, vec![matrix("", Mm, &cov_unit)])
        }
        Shape::Cylinder {
            point_mm,
            direction: along,
            radius_mm,
            cov_unit_direction,
            cov_unit_point,
            var_unit_radius,
        } => {
            let radius = Parameter::new("radius", Mm, Scalar(radius_mm), Scalar(var_unit_radius));
            let parameters = vec![
                point("point", point_mm, &cov_unit_point),
                direction("direction", along, &cov_unit_direction),
                radius,
            ];
            let spreads = vec![
                matrix("point", Mm, &cov_unit_point),
                matrix("direction", One, &cov_unit_direction),
                variance("radius", Mm, var_unit_radius),
            ];
            (parameters, spreads)
        }
        Shape::Cone {
            apex_mm,
            direction: along,
            half_angle_rad,
            cov_unit_apex,
            cov_unit_direction,
            var_unit_half_angle,
        } => {
            let angle = (Scalar(half_angle_rad), Scalar(var_unit_half_angle));
            let parameters = vec![
                point("apex", apex_mm, &cov_unit_apex),
                direction("direction", along, &cov_unit_direction),
                Parameter::new("half_angle", Rad, angle.0, angle.1),
            ];
            let spreads = vec![
                matrix("apex", Mm, &cov_unit_apex),
                matrix("direction", One, &cov_unit_direction),
                variance("half_angle", Rad, var_unit_half_angle),
            ];
            (parameters, spreads)
        }
    }
}

fn point(name: &'static str, mm: [f64; 3], cov: &[[f64; 3]; 3]) -> Parameter {
    let variance = Amount::Vector(diagonal(cov));
    Parameter::new(name, QuantityUnit::Mm, Amount::Vector(mm), variance)
}

fn direction(name: &'static str, unit: [f64; 3], cov: &[[f64; 3]; 3]) -> Parameter {
    let variance = Amount::Vector(diagonal(cov));
    Parameter::new(name, QuantityUnit::One, Amount::Vector(unit), variance)
}

/// A parameter about whose uncertainty the fit says nothing.
const fn certain(name: &'static str, unit: QuantityUnit, value: Amount) -> Parameter {
    Parameter {
        name,
        unit,
        value,
        uncertainty: None,
    }
}

fn matrix<const K: usize>(of: &'static str, unit: QuantityUnit, cov: &[[f64; K]; K]) -> Spread {
    Spread {
        of,
        unit,
        rows: Rows::of(cov),
    }
}

const fn variance(of: &'static str, unit: QuantityUnit, value: f64) -> Spread {
    Spread {
        of,
        unit,
        rows: Rows::One(value),
    }
}

fn diagonal<const K: usize>(matrix: &[[f64; K]; K]) -> [f64; K] {
    std::array::from_fn(|k| matrix[k][k])
}

fn largest(values: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    values.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))
}

/// A registration `q = R p + t` of any number of pairs.
#[derive(Clone, Debug)]
pub struct Registered<'a> {
    /// R by rows.
    pub rotation: [[f64; 3]; 3],
    /// t.
    pub translation_mm: [f64; 3],
    /// Angle of the rotation about its own axis.
    pub angle_deg: f64,
    /// Unit axis of the rotation (0, 0, 1 where the angle is zero).
    pub axis: [f64; 3],
    /// Degrees of freedom, 3n - 6.
    pub dof: u64,
    /// sqrt(sum of squared residual lengths / n).
    pub rms_mm: f64,
    /// sqrt(sum / dof).
    pub sigma_mm: Option<f64>,
    /// `R p + t - q`, one per pair.
    pub residuals_mm: Cow<'a, [[f64; 3]]>,
    /// For unit noise, of a small rotation w with `R_true = exp([w]x) R`.
    pub cov_unit_rotvec: [[f64; 3]; 3],
    /// For unit noise, of t at the origin.
    pub cov_unit_t: [[f64; 3]; 3],
    /// One standard deviation at the worst corner of the part, or at the worst of the points where no part
    /// is known.
    pub expected_error_mm: Option<f64>,
}

impl<'a> From<&'a RegistrationReport> for Registered<'a> {
    fn from(report: &'a RegistrationReport) -> Self {
        Self {
            rotation: report.rotation,
            translation_mm: report.translation_mm,
            angle_deg: report.angle_deg,
            axis: report.axis,
            dof: report.dof.into(),
            rms_mm: report.rms_mm,
            sigma_mm: report.sigma_mm,
            residuals_mm: Cow::Borrowed(&report.residuals_mm),
            cov_unit_rotvec: report.cov_unit_rotvec,
            cov_unit_t: report.cov_unit_t,
            expected_error_mm: report.expected_error_mm,
        }
    }
}

impl Registered<'static> {
    /// What a registration says about its pairs.
    #[must_use]
    pub fn new(registration: &Registration, source: &[Point], target: &[Point]) -> Self {
        let r = &registration.transform.rotation;
        let residuals = source.iter().zip(target);
        Self {
            rotation: [
                [r.m11, r.m12, r.m13],
                [r.m21, r.m22, r.m23],
                [r.m31, r.m32, r.m33],
            ],
            translation_mm: registration.transform.translation_mm.into(),
            angle_deg: registration.angle.to_degrees(),
            axis: registration.axis.map_or([0.0, 0.0, 1.0], Into::into),
            dof: registration.stats.dof as u64,
            rms_mm: registration.stats.rms.0,
            sigma_mm: registration.stats.sigma.map(|sigma| sigma.0),
            residuals_mm: residuals
                .map(|(p, q)| registration.residual_mm(*p, *q).into())
                .collect(),
            cov_unit_rotvec: registration.cov_unit_rotvec,
            cov_unit_t: registration.cov_unit_at(Point::from_mm(0.0, 0.0, 0.0)),
            expected_error_mm: source
                .iter()
                .filter_map(|p| registration.expected_error_at(*p))
                .map(|error| error.0)
                .max_by(f64::total_cmp),
        }
    }
}

impl Registered<'_> {
    /// Lengths of the residuals.
    pub fn lengths_mm(&self) -> impl Iterator<Item = f64> + '_ {
        self.residuals_mm.iter().map(|d| length(*d))
    }

    /// The longest residual and its place, from 0.
    #[must_use]
    pub fn worst(&self) -> Option<(usize, f64)> {
        largest(self.lengths_mm())
    }

    /// Standard uncertainties of the rotation vector, radians.
    #[must_use]
    pub fn u_rotvec_rad(&self) -> Option<[f64; 3]> {
        self.uncertainties(&self.cov_unit_rotvec)
    }

    /// Standard uncertainties of the translation at the origin.
    #[must_use]
    pub fn u_translation_mm(&self) -> Option<[f64; 3]> {
        self.uncertainties(&self.cov_unit_t)
    }

    fn uncertainties(&self, cov_unit: &[[f64; 3]; 3]) -> Option<[f64; 3]> {
        let sigma = self.sigma_mm?;
        Some(diagonal(cov_unit).map(|variance| sigma * variance.max(0.0).sqrt()))
    }
}

/// The length of a vector.
#[must_use]
pub fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}
