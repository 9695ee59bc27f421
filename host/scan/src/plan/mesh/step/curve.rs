//! Edges as polylines. Every edge is made once, so that the faces on both its sides have the same corners.

use nalgebra::Vector3;

use super::super::unreadable::unreadable;
use super::CHORD_MM;
use super::frame::{Drawing, Frame};
use super::part21::{Value, Values};
use super::spline::{Knots, SplineCurve, weighted};
use crate::ScanError;

/// Halvings of a stretch of a curve at most.
const HALVINGS: usize = 10;

/// A curve in space.
pub(super) enum Curve {
    Line,
    /// Half axes along x and y of the frame; equal ones are a circle.
    Ellipse(Frame, f64, f64),
    Spline(SplineCurve),
    Polyline(Vec<Vector3<f64>>),
}

/// Reads a curve.
pub(super) fn read(drawing: &Drawing, number: u64, depth: usize) -> Result<Curve, ScanError> {
    let entity = drawing.entities.at(number)?;
    if depth > 8 {
        return Err(unreadable("a curve leads back to itself"));
    }
    for kind in ["SURFACE_CURVE", "SEAM_CURVE", "INTERSECTION_CURVE"] {
        if let Some(values) = entity.get(kind) {
            return read(drawing, values.entity(1)?, depth + 1);
        }
    }
    if let Some(values) = entity.get("TRIMMED_CURVE") {
        // Where it ends, the edge's vertices say.
        return read(drawing, values.entity(1)?, depth + 1);
    }
    if entity.get("LINE").is_some() {
        return Ok(Curve::Line);
    }
    if let Some(values) = entity.get("CIRCLE") {
        let radius = drawing.length(values, 2)?;
        return Ok(Curve::Ellipse(
            drawing.frame(values.entity(1)?)?,
            radius,
            radius,
        ));
    }
    if let Some(values) = entity.get("ELLIPSE") {
        let (a, b) = (drawing.length(values, 2)?, drawing.length(values, 3)?);
        return Ok(Curve::Ellipse(drawing.frame(values.entity(1)?)?, a, b));
    }
    if let Some(values) = entity.get("POLYLINE") {
        let points: Result<_, _> = values
            .entities(1)?
            .iter()
            .map(|n| drawing.point(*n))
            .collect();
        return Ok(Curve::Polyline(points?));
    }
    if let Some(values) = entity.get("B_SPLINE_CURVE_WITH_KNOTS") {
        // Plain: all values in one list. Complex: each kind has its own.
        let (degree, points, knots) = if entity.is_plain() {
            (
                values.number(1)?,
                values.entities(2)?,
                &values[6.min(values.len())..],
            )
        } else {
            let base = drawing.get(number, "B_SPLINE_CURVE")?;
            (base.number(0)?, base.entities(1)?, values)
        };
        let weights = match entity.get("RATIONAL_B_SPLINE_CURVE") {
            Some(rational) => rational.numbers(0)?,
            None => vec![1.0; points.len()],
        };
        if weights.len() != points.len() || weights.iter().any(|w| *w <= 0.0) {
            return Err(unreadable(format_args!(
                "#{number}: the weights of a spline are not above 0, one for each point"
            )));
        }
        let knots = Knots::new(degree, &knots.numbers(1)?, &knots.numbers(0)?, points.len())?;
        let points: Result<Vec<_>, ScanError> = points
            .iter()
            .zip(&weights)
            .map(|(n, w)| Ok(weighted(&drawing.point(*n)?, *w)))
            .collect();
        return Ok(Curve::Spline(SplineCurve {
            knots,
            points: points?,
        }));
    }
    Err(super::not_read(&format!(
        "the curve #{number}, {}",
        entity.name()
    )))
}

/// An edge as points from its first vertex to its second.
pub(super) fn edge(
    drawing: &Drawing,
    number: u64,
    longest_mm: f64,
) -> Result<Vec<Vector3<f64>>, ScanError> {
    let values = drawing.get(number, "EDGE_CURVE")?;
    let vertex = |place: usize| -> Result<Vector3<f64>, ScanError> {
        let point = drawing.get(values.entity(place)?, "VERTEX_POINT")?;
        drawing.point(point.entity(1)?)
    };
    let (from, to) = (vertex(1)?, vertex(2)?);
    let along = values.flag(4)?;
    let curve = read(drawing, values.entity(3)?, 0)?;
    let (start, end) = if along { (from, to) } else { (to, from) };
    let mut points = between(&curve, &start, &end, longest_mm).ok_or_else(|| {
        unreadable(format_args!(
            "edge #{number}: its vertices do not lie on its curve"
        ))
    })?;
    let last = points.len() - 1;
    // The vertices are what the neighbouring edges end at.
    (points[0], points[last]) = (start, end);
    if !along {
        points.reverse();
    }
    Ok(points)
}

/// How far a vertex may lie off its curve.
const OFF_MM: f64 = 0.05;

/// Points of a curve from one of its points to another, the way its parameter rises.
fn between(
    curve: &Curve,
    start: &Vector3<f64>,
    end: &Vector3<f64>,
    longest_mm: f64,
) -> Option<Vec<Vector3<f64>>> {
    let near = |p: &Vector3<f64>, q: &Vector3<f64>| (p - q).norm() <= OFF_MM;
    match curve {
        Curve::Line => {
            let count = ((end - start).norm() / longest_mm).ceil().clamp(1.0, 1e4) as usize;
            Some(
                (0..=count)
                    .map(|k| start + (end - start) * (k as f64 / count as f64))
                    .collect(),
            )
        }
        Curve::Ellipse(frame, a, b) => {
            let at = |t: f64| frame.at + frame.x * (a * t.cos()) + frame.y * (b * t.sin());
            let angle = |p: &Vector3<f64>| {
                let d = p - frame.at;
                (frame.y.dot(&d) / b).atan2(frame.x.dot(&d) / a)
            };
            let (t0, mut t1) = (angle(start), angle(end));
            if t1 <= t0 + 1e-9 {
                t1 += std::f64::consts::TAU;
            }
            (near(&at(t0), start) && near(&at(t1), end)).then(|| {
                let count = 8;
                let breaks: Vec<f64> = (0..=count)
                    .map(|k| t0 + (t1 - t0) * f64::from(k) / f64::from(count))
                    .collect();
                flat(&at, &breaks, longest_mm)
            })
        }
        Curve::Spline(spline) => {
            let at = |t: f64| spline.at(t);
            let mut breaks = spline.knots.breaks();
            let [low, high] = spline.knots.ends();
            if !(near(&at(low), start) && near(&at(high), end)) {
                let (t0, t1) = (nearest(&at, &breaks, start), nearest(&at, &breaks, end));
                if !(near(&at(t0), start) && near(&at(t1), end)) || t0 >= t1 {
                    return None;
                }
                breaks.retain(|t| *t > t0 && *t < t1);
                breaks.insert(0, t0);
                breaks.push(t1);
            }
            Some(flat(&at, &breaks, longest_mm))
        }
        Curve::Polyline(points) => {
            let (first, last) = (points.first()?, points.last()?);
            (points.len() > 1 && near(first, start) && near(last, end)).then(|| points.clone())
        }
    }
}

/// Points of a curve so close that chords leave it by no more than [`CHORD_MM`].
pub(super) fn flat(
    at: &impl Fn(f64) -> Vector3<f64>,
    breaks: &[f64],
    longest_mm: f64,
) -> Vec<Vector3<f64>> {
    steps(at, breaks, longest_mm)
        .iter()
        .map(|t| at(*t))
        .collect()
}

/// The parameters of [`flat`].
pub(super) fn steps(
    at: &impl Fn(f64) -> Vector3<f64>,
    breaks: &[f64],
    longest_mm: f64,
) -> Vec<f64> {
    let mut all = vec![breaks[0]];
    for pair in breaks.windows(2) {
        let mut open = vec![(pair[0], pair[1], 0)];
        while let Some((t0, t1, depth)) = open.pop() {
            let (a, b) = (at(t0), at(t1));
            let off = [0.25, 0.5, 0.75].map(|w| {
                let p = at(t0 + (t1 - t0) * w);
                let chord = b - a;
                let share = if chord.norm_squared() > 0.0 {
                    ((p - a).dot(&chord) / chord.norm_squared()).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                (p - a - chord * share).norm()
            });
            let straight = off.iter().all(|d| *d <= CHORD_MM) && (b - a).norm() <= longest_mm;
            if straight || depth >= HALVINGS {
                all.push(t1);
            } else {
                let middle = (t0 + t1) / 2.0;
                open.push((middle, t1, depth + 1));
                open.push((t0, middle, depth + 1));
            }
        }
    }
    all
}

/// The parameter of the point of a curve nearest to a point: the best of a few in each stretch, then by thirds.
fn nearest(at: &impl Fn(f64) -> Vector3<f64>, breaks: &[f64], p: &Vector3<f64>) -> f64 {
    let mut best = (f64::INFINITY, breaks[0], 0.0);
    for pair in breaks.windows(2) {
        let width = (pair[1] - pair[0]) / 8.0;
        for k in 0..=8 {
            let t = pair[0] + width * f64::from(k);
            let d = (at(t) - p).norm_squared();
            if d < best.0 {
                best = (d, t, width);
            }
        }
    }
    let (low, high) = (breaks[0], breaks[breaks.len() - 1]);
    let (mut a, mut b) = ((best.1 - best.2).max(low), (best.1 + best.2).min(high));
    for _ in 0..100 {
        let (s, t) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
        if (at(s) - p).norm_squared() < (at(t) - p).norm_squared() {
            b = t;
        } else {
            a = s;
        }
    }
    (a + b) / 2.0
}

/// The edges of a loop with their senses.
pub(super) fn loop_edges(drawing: &Drawing, number: u64) -> Result<Vec<(u64, bool)>, ScanError> {
    let entity = drawing.entities.at(number)?;
    let Some(values) = entity.get("EDGE_LOOP") else {
        return Err(super::not_read(&format!(
            "the border #{number}, {}",
            entity.name()
        )));
    };
    let edges = values.entities(1)?;
    if edges.is_empty() {
        return Err(unreadable(format_args!(
            "the border #{number} has no edges"
        )));
    }
    edges
        .iter()
        .map(|oriented| {
            let values = drawing.get(*oriented, "ORIENTED_EDGE")?;
            match values.value(3) {
                Some(Value::Entity(edge)) => Ok((*edge, values.flag(4)?)),
                _ => Err(unreadable(format_args!("#{oriented} names no edge"))),
            }
        })
        .collect()
}
