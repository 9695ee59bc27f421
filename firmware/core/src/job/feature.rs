//! One feature: hits become contact points, a fit, and every reason against it.

use heapless::Vec;
use nalgebra::Vector3;
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::job::{
    Approach, Compensation, FeatureKind, FeatureSpec, Learned, LearnedLimits, Limits, MAX_HITS,
};
use umi_protocol::reason::Reason;

use super::diagnose;
use super::exceeds;
use super::reasons::{Reasons, add, against_limits};
use super::report::{fit, refusal};
use crate::units::Point;

/// What the encoders say about a hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Control less encoder, per axis.
    pub difference_mm: [f64; 3],
    /// Feed of the touch.
    pub feed_mm_per_min: f64,
}

/// A hit on its way into a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// As printed.
    pub position: Point,
    /// Direction of motion: the line's, else the job's.
    pub approach: Option<Approach>,
    /// What the encoders say, where the job asks for it.
    pub seen: Option<Seen>,
}

/// Contact points of the hits. With compensation on the board the tip's centre
/// at contact lies `pretravel` before the skip position, and the surface one
/// tip radius ahead of it, both along the direction of motion.
pub fn contact_points(
    compensation: Compensation,
    hits: &[Hit],
    reasons: &mut Reasons,
) -> Vec<Point, MAX_HITS> {
    let mut points = Vec::new();
    for (number, hit) in (1u16..).zip(hits) {
        let point = match (compensation, hit.approach) {
            (Compensation::InMacro, _) => Some(hit.position),
            (
                Compensation::OnBoard {
                    tip_radius_mm,
                    pretravel_mm,
                },
                Some(approach),
            ) => {
                let direction = direction(approach);
                let pretravel = Vector3::from(pretravel_mm).dot(&direction.abs());
                Some(Point {
                    mm: hit.position.mm + direction * (tip_radius_mm - pretravel),
                })
            }
            (Compensation::OnBoard { .. }, None) => {
                add(reasons, Reason::NoApproach { hit: number });
                None
            }
        };
        if let Some(point) = point {
            // Bounded: hits come from a list of the same size.
            let _ = points.push(point);
        }
    }
    points
}

/// Unit vector of an approach.
pub fn direction(approach: Approach) -> Vector3<f64> {
    let (axis, sign) = approach.axis_and_sign();
    let mut direction = Vector3::zeros();
    if let Some(component) = direction.get_mut(axis) {
        *component = sign;
    }
    direction
}

/// How far beside its first touch a ball may be touched again.
const BESIDE_MM: f64 = 0.1;

/// Holds the last hit against the first one, where the two are at one place.
pub fn against_again(limit_mm: f64, hits: &[Hit], reasons: &mut Reasons) {
    let (Some(first), Some(last)) = (hits.first(), hits.last()) else {
        return;
    };
    let Some(approach) = first.approach else {
        // Without it there is no contact point either, and that is told.
        return;
    };
    let hit = u16::try_from(hits.len()).unwrap_or(u16::MAX);
    let direction = direction(approach);
    let apart = last.position.mm - first.position.mm;
    let along_mm = apart.dot(&direction);
    let off_mm = (apart - direction * along_mm).norm();
    if last.approach != first.approach || exceeds(off_mm, BESIDE_MM) {
        add(
            reasons,
            Reason::NotSamePlace {
                hit,
                first: 1,
                off_mm,
            },
        );
    } else if exceeds(along_mm.abs(), limit_mm) {
        add(
            reasons,
            Reason::NotRepeated {
                hit,
                first: 1,
                off_mm: -along_mm,
                limit_mm,
            },
        );
    }
}

/// Two hits with the same printed coordinates: a repeated line, so a missing
/// measurement. Two real touches differ, if only in the last digit of noise;
/// the side hits of a pattern always differ in X or Y. A ball's last touch at the place of
/// its first one may be the same by chance (`again`).
pub fn find_duplicates(hits: &[Hit], again: bool, reasons: &mut Reasons) {
    for (first, (at, one)) in (1u16..).zip(hits.iter().enumerate()) {
        for (later, other) in (first + 1..).zip(hits.iter().skip(at + 1)) {
            let is_again = again && first == 1 && usize::from(later) == hits.len();
            if one.position == other.position && !is_again {
                add(reasons, Reason::DuplicatePoint { first, hit: later });
            }
        }
    }
}

/// Fits the points and holds the result against the limits. `again`: the last hit is at the
/// first one's place; what is asked of a lone hit is asked of the first one, by which the
/// others were driven.
pub fn judge(
    spec: &FeatureSpec,
    limits: &Limits,
    points: &[Point],
    hits: &[Hit],
    again: bool,
    reasons: &mut Reasons,
) -> Option<FitReport> {
    let fitted = match fit(spec.kind, points) {
        Ok(fitted) => fitted,
        Err(error) => {
            let code = refusal(&error);
            add(reasons, Reason::FitRefused { code });
            diagnose::suspects(spec, limits, points, reasons);
            return None;
        }
    };
    let before = reasons.len();
    against_limits(spec, limits, &fitted, reasons);
    if reasons.len() > before {
        diagnose::suspects(spec, limits, points, reasons);
    }
    let once = if again {
        (rest(points), rest(hits))
    } else {
        (points, hits)
    };
    against_lone_hit(spec, limits, once.0, once.1, reasons);
    against_approach(limits, &fitted.shape(), points, hits, reasons);
    Some(fitted.report(points))
}

/// All but the last.
fn rest<T>(of: &[T]) -> &[T] {
    of.split_last().map_or(of, |(_, rest)| rest)
}

/// Holds the height of a lone hit above the others against the nominal radius.
///
/// In a top-and-two-pairs pattern a wrong top hit leaves no residual. The routine
/// (Sawula 2013, appendix D) drives the side hits exactly one ball radius below the
/// top hit, so as printed the two heights differ by that radius, to the machine's
/// resolution and whatever the pretravel.
fn against_lone_hit(
    spec: &FeatureSpec,
    limits: &Limits,
    points: &[Point],
    hits: &[Hit],
    reasons: &mut Reasons,
) {
    let (FeatureKind::Sphere, Some(radius_mm), Some(limit_mm)) =
        (spec.kind, spec.radius_mm, limits.lone_hit_mm)
    else {
        return;
    };
    for axis in 0..3usize {
        let mut lone = None;
        let (mut along, mut sum, mut others) = (0u16, 0.0, 0.0);
        for (number, (point, hit)) in (1u16..).zip(points.iter().zip(hits)) {
            let height = point.mm.get(axis).copied().unwrap_or(f64::NAN);
            match hit.approach.map(|approach| approach.axis_and_sign()) {
                Some((of, sign)) if of == axis => {
                    lone = Some((number, sign, height));
                    along += 1;
                }
                _ => {
                    sum += height;
                    others += 1.0;
                }
            }
        }
        let (Some((hit, sign, height)), 1) = (lone, along) else {
            continue;
        };
        // The hit is approached towards the centre.
        let offset_mm = sign * (sum / others - height) - radius_mm;
        if exceeds(offset_mm.abs(), limit_mm) {
            let axis = u8::try_from(axis).unwrap_or(2);
            let reason = Reason::LoneHitOffset {
                hit,
                axis,
                offset_mm,
                limit_mm,
            };
            add(reasons, reason);
            return;
        }
    }
}

/// Holds each hit's surface normal against its approach.
///
/// A sphere probed as top plus two pairs has one degree of freedom, and a wrong
/// top hit moves the centre without any residual. But the side hits were driven
/// to the centre's height, so they then touch off the equator of the fitted
/// sphere: the normals tell. Where only one hit lies along an axis it is the
/// one to name.
fn against_approach(
    limits: &Limits,
    shape: &Shape,
    points: &[Point],
    hits: &[Hit],
    reasons: &mut Reasons,
) {
    let Some(limit_deg) = limits.approach_deg else {
        return;
    };
    // A boss is touched against its outward normals, a bore along them: which of
    // the two is said by all hits together, so one exchanged hit stands out.
    let facing: f64 = points
        .iter()
        .zip(hits)
        .filter_map(|(point, hit)| Some(normal_at(shape, *point)?.dot(&direction(hit.approach?))))
        .sum();
    let side = if facing < 0.0 { -1.0 } else { 1.0 };
    let mut worst: Option<(u16, f64)> = None;
    for (number, (point, hit)) in (1u16..).zip(points.iter().zip(hits)) {
        let (Some(approach), Some(normal)) = (hit.approach, normal_at(shape, *point)) else {
            continue;
        };
        let direction = direction(approach);
        let along = side * normal.dot(&direction);
        let across = normal.cross(&direction).norm_squared();
        let angle_deg = libm::atan2(libm::sqrt(across), along).to_degrees();
        if worst.is_none_or(|(_, most)| angle_deg > most) {
            worst = Some((number, angle_deg));
        }
    }
    let Some((hit, angle_deg)) = worst else {
        return;
    };
    if angle_deg <= limit_deg {
        return;
    }
    if let Some(reason) = lone_hit(shape, points, hits, limit_deg) {
        add(reasons, reason);
    } else {
        add(
            reasons,
            Reason::ApproachAngle {
                hit,
                angle_deg,
                limit_deg,
            },
        );
    }
}

/// The only hit along one axis of a sphere, if the others sit at a wrong height
/// along that axis and are otherwise square to their approach.
fn lone_hit(shape: &Shape, points: &[Point], hits: &[Hit], limit_deg: f64) -> Option<Reason> {
    let Shape::Sphere {
        center_mm,
        radius_mm,
        ..
    } = shape
    else {
        return None;
    };
    let center = Vector3::from(*center_mm);
    let limit_mm = radius_mm * libm::sin(limit_deg.to_radians());
    for axis in 0..3usize {
        let along = |hit: &Hit| hit.approach.is_some_and(|a| a.axis_and_sign().0 == axis);
        let mut lone = (1u16..).zip(hits).filter(|(_, hit)| along(hit));
        let (Some((number, _)), None) = (lone.next(), lone.next()) else {
            continue;
        };
        let mut sum = 0.0;
        let mut count = 0.0;
        let mut square = true;
        for (point, hit) in points.iter().zip(hits) {
            if along(hit) {
                continue;
            }
            let arm = point.mm - center;
            sum += arm.get(axis).copied().unwrap_or(0.0);
            count += 1.0;
            // The remaining direction, neither the approach nor the lone axis.
            let across = hit
                .approach
                .map_or(axis, |a| 3 - axis - a.axis_and_sign().0);
            square &= arm.get(across).is_some_and(|c| c.abs() <= limit_mm);
        }
        let offset_mm = sum / count;
        if square && offset_mm.abs() > limit_mm {
            return Some(Reason::LoneHitOffset {
                hit: number,
                axis: u8::try_from(axis).unwrap_or(2),
                offset_mm,
                limit_mm,
            });
        }
    }
    None
}

/// How far beside the centre the hits were approached, at most: the arm from the centre of a
/// sphere or circle to the hit, across the hit's approach. 0 where that is not known.
pub fn centring_mm(shape: &Shape, points: &[Point], hits: &[Hit]) -> f64 {
    let (Shape::Sphere { center_mm, .. } | Shape::Circle { center_mm, .. }) = shape else {
        return 0.0;
    };
    let center = Vector3::from(*center_mm);
    points
        .iter()
        .zip(hits)
        .fold(0.0, |most: f64, (point, hit)| {
            let across = hit.approach.map_or(0.0, |a| {
                (point.mm - center).cross(&direction(a)).norm_squared()
            });
            most.max(libm::sqrt(across))
        })
}

/// How a feature is, as it is learned.
pub fn learned(fit: &FitReport, centring_mm: f64) -> Learned {
    Learned {
        radius_mm: fit.shape.radius_mm().unwrap_or_default(),
        rms_mm: fit.rms_mm,
        centring_mm,
    }
}

/// Holds a feature against how it was in the taught setups: below the smallest and above the
/// largest. The job's own limits must cover every stylus and every ball; the taught setups
/// have shown what these ones do.
pub fn against_learned(
    limits: &LearnedLimits,
    (smallest, taught): (&Learned, &Learned),
    now: &Learned,
    reasons: &mut Reasons,
) {
    // Between the two it is off by nothing.
    let error_mm = match now.radius_mm {
        radius if radius > taught.radius_mm => radius - taught.radius_mm,
        radius if radius >= smallest.radius_mm => 0.0,
        radius => radius - smallest.radius_mm,
    };
    if exceeds(error_mm.abs(), limits.radius_mm) {
        let limit_mm = limits.radius_mm;
        add(reasons, Reason::RadiusSinceTaught { error_mm, limit_mm });
    }
    if exceeds(now.rms_mm - taught.rms_mm, limits.rms_mm) {
        add(
            reasons,
            Reason::RmsSinceTaught {
                rms_mm: now.rms_mm,
                taught_mm: taught.rms_mm,
                limit_mm: limits.rms_mm,
            },
        );
    }
    if exceeds(now.centring_mm - taught.centring_mm, limits.centring_mm) {
        add(
            reasons,
            Reason::CentringSinceTaught {
                off_mm: now.centring_mm,
                taught_mm: taught.centring_mm,
                limit_mm: limits.centring_mm,
            },
        );
    }
}

/// Unit surface normal at (or next to) a point; none where it is not defined.
fn normal_at(shape: &Shape, point: Point) -> Option<Vector3<f64>> {
    let along = |from: &[f64; 3]| point.mm - Vector3::from(*from);
    let radial = |from: &[f64; 3], axis: &[f64; 3]| {
        let arm = along(from);
        let axis = Vector3::from(*axis);
        arm - axis * arm.dot(&axis)
    };
    let normal = match shape {
        Shape::Sphere { center_mm, .. } => along(center_mm),
        Shape::Plane { normal, .. } => Vector3::from(*normal),
        Shape::Circle {
            center_mm, normal, ..
        } => radial(center_mm, normal),
        Shape::Cylinder {
            point_mm,
            direction,
            ..
        } => radial(point_mm, direction),
        Shape::Cone {
            apex_mm,
            direction,
            half_angle_rad,
            ..
        } => {
            let out = radial(apex_mm, direction);
            let length = libm::sqrt(out.norm_squared());
            let (sin, cos) = libm::sincos(*half_angle_rad);
            out * (cos / length) - Vector3::from(*direction) * sin
        }
        Shape::Line { .. } => return None,
    };
    let length = libm::sqrt(normal.norm_squared());
    (length > 0.0 && length.is_finite()).then(|| normal / length)
}
