//! The surfaces that faces lie on: a place for two parameters, and back.

use nalgebra::{Matrix2, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

use super::super::unreadable::unreadable;
use super::curve::steps;
use super::frame::{Drawing, Frame};
use super::part21::Values;
use super::spline::{Knots, SplineSurface, weighted};
use crate::ScanError;

/// How far a border may lie off its surface.
const OFF_MM: f64 = 0.05;

/// A surface.
pub(super) enum Surface {
    Plane(Frame),
    /// Radius; about z of the frame.
    Cylinder(Frame, f64),
    /// Radius at the frame's height, tangent of the half angle.
    Cone(Frame, f64, f64),
    /// Radius.
    Sphere(Frame, f64),
    /// Radius of the ring, radius of the tube.
    Torus(Frame, f64, f64),
    Spline {
        spline: SplineSurface,
        /// The way round once, where the surface closes on itself.
        round: [Option<f64>; 2],
    },
}

/// Reads a surface.
pub(super) fn read(drawing: &Drawing, number: u64) -> Result<Surface, ScanError> {
    let entity = drawing.entities.at(number)?;
    if let Some(values) = entity.get("PLANE") {
        return Ok(Surface::Plane(drawing.frame(values.entity(1)?)?));
    }
    if let Some(values) = entity.get("CYLINDRICAL_SURFACE") {
        let frame = drawing.frame(values.entity(1)?)?;
        return Ok(Surface::Cylinder(frame, drawing.length(values, 2)?));
    }
    if let Some(values) = entity.get("CONICAL_SURFACE") {
        let frame = drawing.frame(values.entity(1)?)?;
        let radius = values.number(2)? * drawing.mm_per_unit;
        let half = values.number(3)?;
        let slope = half.tan();
        // Where angles are in degrees, nearly every cone is one that radians do not have.
        if radius < 0.0 || !(0.0..FRAC_PI_2).contains(&half) || slope > 1e3 {
            return Err(unreadable(format_args!("#{number} is no cone in radians")));
        }
        return Ok(Surface::Cone(frame, radius, slope));
    }
    if let Some(values) = entity.get("SPHERICAL_SURFACE") {
        let frame = drawing.frame(values.entity(1)?)?;
        return Ok(Surface::Sphere(frame, drawing.length(values, 2)?));
    }
    if let Some(values) = entity.get("TOROIDAL_SURFACE") {
        let frame = drawing.frame(values.entity(1)?)?;
        let (ring, tube) = (drawing.length(values, 2)?, drawing.length(values, 3)?);
        return Ok(Surface::Torus(frame, ring, tube));
    }
    if let Some(values) = entity.get("B_SPLINE_SURFACE_WITH_KNOTS") {
        let (base, knots) = if entity.is_plain() {
            (
                &values[1.min(values.len())..],
                &values[8.min(values.len())..],
            )
        } else {
            (drawing.get(number, "B_SPLINE_SURFACE")?, values)
        };
        let rows = base.list(2)?;
        let columns = rows.list(0)?.len();
        let mut points = Vec::new();
        for k in 0..rows.len() {
            let row = rows.entities(k)?;
            if row.len() != columns {
                return Err(unreadable(format_args!(
                    "#{number}: the rows of a spline have different lengths"
                )));
            }
            for n in row {
                points.push(drawing.point(n)?);
            }
        }
        let mut weights = Vec::new();
        if let Some(rational) = entity.get("RATIONAL_B_SPLINE_SURFACE") {
            let rows = rational.list(0)?;
            for k in 0..rows.len() {
                weights.extend(rows.numbers(k)?);
            }
        } else {
            weights.resize(points.len(), 1.0);
        }
        if weights.len() != points.len() || weights.iter().any(|w| *w <= 0.0) {
            return Err(unreadable(format_args!(
                "#{number}: the weights of a spline are not above 0, one for each point"
            )));
        }
        let spline = SplineSurface {
            u: Knots::new(
                base.number(0)?,
                &knots.numbers(2)?,
                &knots.numbers(0)?,
                rows.len(),
            )?,
            v: Knots::new(
                base.number(1)?,
                &knots.numbers(3)?,
                &knots.numbers(1)?,
                columns,
            )?,
            points: points
                .iter()
                .zip(&weights)
                .map(|(p, w)| weighted(p, *w))
                .collect(),
            columns,
        };
        let round = closes(&spline);
        return Ok(Surface::Spline { spline, round });
    }
    Err(super::not_read(&format!(
        "the surface #{number}, {}",
        entity.name()
    )))
}

/// Whether the borders of a spline lie on each other.
fn closes(spline: &SplineSurface) -> [Option<f64>; 2] {
    let ([u0, u1], [v0, v1]) = (spline.u.ends(), spline.v.ends());
    let shares: [f64; 7] = std::array::from_fn(|k| k as f64 / 6.0);
    let same = |a: Vector3<f64>, b: Vector3<f64>| (a - b).norm() < 1e-4;
    let in_u = shares.iter().all(|w| {
        let v = v0 + (v1 - v0) * w;
        same(spline.at(u0, v).0, spline.at(u1, v).0)
    });
    let in_v = shares.iter().all(|w| {
        let u = u0 + (u1 - u0) * w;
        same(spline.at(u, v0).0, spline.at(u, v1).0)
    });
    [in_u.then_some(u1 - u0), in_v.then_some(v1 - v0)]
}

impl Surface {
    /// Place and both derivatives.
    pub fn at(&self, u: f64, v: f64) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let ring = |f: &Frame| (f.x * u.cos() + f.y * u.sin(), f.y * u.cos() - f.x * u.sin());
        match self {
            Surface::Plane(f) => (f.at + f.x * u + f.y * v, f.x, f.y),
            Surface::Cylinder(f, r) => {
                let (out, round) = ring(f);
                (f.at + out * *r + f.z * v, round * *r, f.z)
            }
            Surface::Cone(f, r, slope) => {
                let (out, round) = ring(f);
                let here = r + slope * v;
                (
                    f.at + out * here + f.z * v,
                    round * here,
                    out * *slope + f.z,
                )
            }
            Surface::Sphere(f, r) => {
                let (out, round) = ring(f);
                (
                    f.at + (out * v.cos() + f.z * v.sin()) * *r,
                    round * (r * v.cos()),
                    (f.z * v.cos() - out * v.sin()) * *r,
                )
            }
            Surface::Torus(f, ring_mm, tube_mm) => {
                let (out, round) = ring(f);
                let here = ring_mm + tube_mm * v.cos();
                (
                    f.at + out * here + f.z * (tube_mm * v.sin()),
                    round * here,
                    (f.z * v.cos() - out * v.sin()) * *tube_mm,
                )
            }
            Surface::Spline { spline, round } => {
                let wrap = |x: f64, [low, _]: [f64; 2], round: Option<f64>| match round {
                    Some(way) => low + (x - low).rem_euclid(way),
                    None => x,
                };
                spline.at(
                    wrap(u, spline.u.ends(), round[0]),
                    wrap(v, spline.v.ends(), round[1]),
                )
            }
        }
    }

    /// The way round once in each parameter, where there is one.
    pub fn round(&self) -> [Option<f64>; 2] {
        match self {
            Surface::Plane(_) => [None, None],
            Surface::Cylinder(..) | Surface::Cone(..) | Surface::Sphere(..) => [Some(TAU), None],
            Surface::Torus(..) => [Some(TAU), Some(TAU)],
            Surface::Spline { round, .. } => *round,
        }
    }

    /// A ball with its poles away from a face that is less than half of it; none for other surfaces and larger faces.
    pub fn turned_towards(&self, borders: &[Vec<Vector3<f64>>]) -> Option<Self> {
        let Surface::Sphere(frame, radius) = self else {
            return None;
        };
        let out = |p: &Vector3<f64>| (p - frame.at).normalize();
        let mean: Vector3<f64> = borders.iter().flatten().map(out).sum();
        let x = mean.try_normalize(1e-6)?;
        // Nearer than this to the rim of the half, parameters would crowd at the new poles.
        if borders.iter().flatten().any(|p| out(p).dot(&x) < 0.15) {
            return None;
        }
        // Across the face where it is narrow: its first corner lies on the equator.
        let first = borders.first()?.first().map(out)?;
        let z = x.cross(&first).try_normalize(1e-6)?;
        let turned = Frame {
            at: frame.at,
            x,
            y: z.cross(&x),
            z,
        };
        Some(Surface::Sphere(turned, *radius))
    }

    /// The parameters of a point on the surface, near to those of a point beside it where there are several.
    ///
    /// # Errors
    /// `mesh_unreadable`: it does not lie on the surface.
    pub fn parameters(
        &self,
        p: &Vector3<f64>,
        beside: Option<Vector2<f64>>,
    ) -> Result<Vector2<f64>, ScanError> {
        let local = |f: &Frame| {
            let d = p - f.at;
            Vector3::new(f.x.dot(&d), f.y.dot(&d), f.z.dot(&d))
        };
        let mut found = match self {
            Surface::Plane(f) => local(f).xy(),
            Surface::Cylinder(f, _) | Surface::Cone(f, ..) => {
                let d = local(f);
                Vector2::new(d.y.atan2(d.x), d.z)
            }
            Surface::Sphere(f, _) => {
                let d = local(f);
                Vector2::new(d.y.atan2(d.x), d.z.atan2(d.xy().norm()))
            }
            Surface::Torus(f, ring, _) => {
                let d = local(f);
                Vector2::new(d.y.atan2(d.x), d.z.atan2(d.xy().norm() - ring))
            }
            Surface::Spline { spline, .. } => self.search(spline, p, beside),
        };
        if let Some(beside) = beside {
            for (k, round) in self.round().into_iter().enumerate() {
                if let Some(way) = round {
                    found[k] += way * ((beside[k] - found[k]) / way).round();
                }
            }
        }
        let (at, by_u, by_v) = self.at(found.x, found.y);
        if (at - p).norm() > OFF_MM {
            return Err(unreadable(format_args!(
                "a border lies {:.3} mm off its surface",
                (at - p).norm()
            )));
        }
        if by_u.cross(&by_v).norm() <= 1e-9 * by_u.norm().max(by_v.norm()).powi(2) {
            return Err(super::not_read("a face that reaches a pole of its surface"));
        }
        Ok(found)
    }

    /// Gauss and Newton's steps from the parameters beside, else from the nearest of a grid.
    fn search(
        &self,
        spline: &SplineSurface,
        p: &Vector3<f64>,
        beside: Option<Vector2<f64>>,
    ) -> Vector2<f64> {
        let far = |q: Vector2<f64>| (self.at(q.x, q.y).0 - p).norm_squared();
        let near = beside.map(|q| self.descend(spline, p, q));
        if let Some(q) = near
            && far(q) < 1e-10
        {
            return q;
        }
        let fine = |breaks: Vec<f64>| -> Vec<f64> {
            let mut all = vec![breaks[0]];
            for pair in breaks.windows(2) {
                all.extend((1..=3).map(|k| pair[0] + (pair[1] - pair[0]) * f64::from(k) / 3.0));
            }
            all
        };
        let (us, vs) = (fine(spline.u.breaks()), fine(spline.v.breaks()));
        let mut starts: Vec<(f64, Vector2<f64>)> = us
            .iter()
            .flat_map(|u| vs.iter().map(move |v| Vector2::new(*u, *v)))
            .map(|q| (far(q), q))
            .collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        starts
            .iter()
            .take(4)
            .map(|(_, q)| self.descend(spline, p, *q))
            .chain(near)
            .min_by(|a, b| far(*a).total_cmp(&far(*b)))
            .unwrap_or_default()
    }

    fn descend(
        &self,
        spline: &SplineSurface,
        p: &Vector3<f64>,
        start: Vector2<f64>,
    ) -> Vector2<f64> {
        let round = self.round();
        let mut q = start;
        let mut best = (f64::INFINITY, q);
        for _ in 0..30 {
            let (at, by_u, by_v) = self.at(q.x, q.y);
            let off = p - at;
            let size = off.norm_squared();
            if size < best.0 {
                best = (size, q);
            }
            let normal = Matrix2::new(
                by_u.norm_squared(),
                by_u.dot(&by_v),
                by_u.dot(&by_v),
                by_v.norm_squared(),
            );
            let Some(inverse) = normal.try_inverse() else {
                break;
            };
            let step = inverse * Vector2::new(by_u.dot(&off), by_v.dot(&off));
            q += step;
            for (k, [low, high]) in [spline.u.ends(), spline.v.ends()].into_iter().enumerate() {
                if round[k].is_none() {
                    q[k] = q[k].clamp(low, high);
                }
            }
            if !(step.x.is_finite() && step.y.is_finite()) || step.norm() < 1e-14 {
                break;
            }
        }
        best.1
    }

    /// Steps in each parameter that are close enough for the surface between two corners of a face.
    pub fn grid(&self, low: Vector2<f64>, high: Vector2<f64>, longest_mm: f64) -> [Vec<f64>; 2] {
        let inner = |k: usize| -> Vec<f64> {
            let mut breaks = vec![low[k]];
            if let Surface::Spline { spline, round } = self {
                let knots = [&spline.u, &spline.v][k];
                if round[k].is_none() {
                    let within = |t: &f64| *t > low[k] && *t < high[k];
                    breaks.extend(knots.breaks().into_iter().filter(within));
                }
            }
            if breaks.len() == 1 {
                breaks.extend((1..4).map(|j| low[k] + (high[k] - low[k]) * f64::from(j) / 4.0));
            }
            breaks.push(high[k]);
            breaks
        };
        let along = |k: usize| {
            let breaks = inner(k);
            (0..=6)
                .map(|w| {
                    let other = low[1 - k] + (high[1 - k] - low[1 - k]) * f64::from(w) / 6.0;
                    let at = |t: f64| {
                        if k == 0 {
                            self.at(t, other).0
                        } else {
                            self.at(other, t).0
                        }
                    };
                    steps(&at, &breaks, longest_mm)
                })
                .max_by_key(Vec::len)
                .unwrap_or(breaks)
        };
        [along(0), along(1)]
    }
}
