//! The arc of a ball or the line of a plane in a single profile, among whatever else it shows.
//!
//! Circles and lines through a few samples are tried, always the same ones; that with the most
//! samples beside it is fitted, and what lies within four standard deviations of it is kept.

use crate::profile::ProfilePoint;

/// A circle with this much of its radius upwards is seen at 65 degrees.
const LEAST_COSINE: f64 = 0.42;
/// How many circles or lines are tried.
const TRIES: u64 = 400;
/// Samples of a shape, at least.
const FEWEST: usize = 8;
/// A line must have this share of the profile's samples.
const LINE_SHARE: f64 = 0.3;
/// An arc spans at least this share of its circle's radius.
const ARC_SHARE: f64 = 0.6;

/// What is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Wanted {
    /// A straight line.
    Line,
    /// The cut of a ball of this radius, or of an unknown one.
    Arc(Option<f64>),
}

/// A circle, or a line as the normal `(a, c)` and offset of `a x + c z = d`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ProfileShape {
    Circle { x: f64, z: f64, radius: f64 },
    Line { a: f64, c: f64, d: f64 },
}

impl ProfileShape {
    fn off(&self, p: &ProfilePoint) -> f64 {
        match *self {
            Self::Circle { x, z, radius } => (p.x_mm - x).hypot(p.z_mm - z) - radius,
            Self::Line { a, c, d } => a * p.x_mm + c * p.z_mm - d,
        }
    }
}

/// A shape, and the samples that are kept of it, as places.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FoundShape {
    pub shape: ProfileShape,
    pub kept: Vec<usize>,
    /// Samples of the shape that are too steep.
    pub steep: usize,
}

/// The shape with the most samples within `within_mm`; none where too few agree.
pub(super) fn find(samples: &[ProfilePoint], wanted: Wanted, within_mm: f64) -> Option<FoundShape> {
    if samples.len() < FEWEST {
        return None;
    }
    // A few hundred samples are enough to choose by.
    let every = samples.len().div_ceil(400);
    let thin: Vec<ProfilePoint> = samples.iter().step_by(every).copied().collect();
    let mut best: Option<(usize, ProfileShape)> = None;
    for number in 0..TRIES {
        let Some(shape) = through(&thin, wanted, number) else {
            continue;
        };
        let near = thin.iter().filter(|p| shape.off(p).abs() < within_mm);
        let count = near.count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, shape));
        }
    }
    let (_, mut shape) = best?;
    let mut limit = within_mm;
    for _ in 0..10 {
        let near: Vec<ProfilePoint> = samples
            .iter()
            .filter(|p| shape.off(p).abs() < limit)
            .copied()
            .collect();
        if near.len() < FEWEST {
            return None;
        }
        shape = fitted(&near, wanted)?;
        let squares: f64 = near.iter().map(|p| shape.off(p).powi(2)).sum();
        limit = (4.0 * (squares / near.len() as f64).sqrt()).clamp(1e-6, within_mm);
    }
    let of_shape: Vec<usize> = (0..samples.len())
        .filter(|&i| shape.off(&samples[i]).abs() < limit)
        .collect();
    let kept: Vec<usize> = match shape {
        ProfileShape::Line { c, .. } if c.abs() < LEAST_COSINE => Vec::new(),
        ProfileShape::Line { .. } => of_shape.clone(),
        ProfileShape::Circle { z, radius, .. } => of_shape
            .iter()
            .copied()
            .filter(|&i| samples[i].z_mm - z > LEAST_COSINE * radius)
            .collect(),
    };
    let (first, last) = (samples.get(*kept.first()?)?, samples.get(*kept.last()?)?);
    let enough = match shape {
        ProfileShape::Line { .. } => kept.len() as f64 >= LINE_SHARE * samples.len() as f64,
        ProfileShape::Circle { radius, .. } => (last.x_mm - first.x_mm).abs() >= ARC_SHARE * radius,
    };
    (kept.len() >= FEWEST && enough).then(|| FoundShape {
        shape,
        steep: of_shape.len() - kept.len(),
        kept,
    })
}

/// The shape through samples that the number chooses.
fn through(samples: &[ProfilePoint], wanted: Wanted, number: u64) -> Option<ProfileShape> {
    let place = |part: u64| {
        let mut z = (3 * number + part + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        &samples[((z ^ (z >> 31)) % samples.len() as u64) as usize]
    };
    match wanted {
        Wanted::Line => fitted(&[*place(0), *place(1)], wanted),
        Wanted::Arc(_) => fitted(&[*place(0), *place(1), *place(2)], wanted),
    }
}

fn fitted(points: &[ProfilePoint], wanted: Wanted) -> Option<ProfileShape> {
    let n = points.len() as f64;
    let (mx, mz) = points
        .iter()
        .fold((0.0, 0.0), |(x, z), p| (x + p.x_mm / n, z + p.z_mm / n));
    let (mut xx, mut xz, mut zz, mut xq, mut zq, mut q) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let (x, z) = (p.x_mm - mx, p.z_mm - mz);
        let square = x * x + z * z;
        xx += x * x;
        xz += x * z;
        zz += z * z;
        xq += x * square;
        zq += z * square;
        q += square;
    }
    match wanted {
        Wanted::Line => {
            // The direction of the greatest scatter.
            let angle = 0.5 * (2.0 * xz).atan2(xx - zz);
            let (a, c) = (-angle.sin(), angle.cos());
            (q > 0.0).then_some(ProfileShape::Line {
                a,
                c,
                d: a * mx + c * mz,
            })
        }
        Wanted::Arc(stated) => {
            let determinant = xx * zz - xz * xz;
            if determinant <= 1e-12 * q * q {
                return None;
            }
            let x = 0.5 * (xq * zz - zq * xz) / determinant;
            let z = 0.5 * (zq * xx - xq * xz) / determinant;
            let radius = (x * x + z * z + q / n).sqrt();
            let right = match stated {
                Some(stated) => radius <= 1.02 * stated && radius >= 0.3 * stated,
                None => (0.5..500.0).contains(&radius),
            };
            // The sensor sees it from above.
            (right && z < 0.0).then_some(ProfileShape::Circle {
                x: mx + x,
                z: mz + z,
                radius,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(index: u32, x_mm: f64, z_mm: f64) -> ProfilePoint {
        ProfilePoint { index, x_mm, z_mm }
    }

    /// A table with a ball of 10 mm cut 6 mm beside its middle, noise of 5 µm, and spikes.
    fn scene() -> Vec<ProfilePoint> {
        (0..600)
            .map(|i| {
                let x = -30.0 + 0.1 * f64::from(i);
                let noise = 0.005 * (f64::from(i) * 12.9898).sin();
                let ball = 64.0 - (x - 4.0).powi(2);
                let z = if ball > 0.0 { 3.0 + ball.sqrt() } else { -5.0 };
                let spike = if i % 37 == 0 { 2.0 } else { 0.0 };
                sample(i, x, z + noise + spike)
            })
            .collect()
    }

    #[test]
    fn the_ball_and_the_table_are_told_apart() {
        let samples = scene();
        let ball = find(&samples, Wanted::Arc(Some(10.0)), 0.05).unwrap();
        let ProfileShape::Circle { x, z, radius } = ball.shape else {
            panic!("{ball:?}");
        };
        assert!((x - 4.0).abs() < 0.005 && (z - 3.0).abs() < 0.01 && (radius - 8.0).abs() < 0.01);
        assert!(ball.kept.len() > 120 && ball.steep > 5, "{ball:?}");
        for &i in &ball.kept {
            assert!((samples[i].x_mm - 4.0).abs() < 8.0 && i % 37 != 0);
        }
        let table = find(&samples, Wanted::Line, 0.05).unwrap();
        let ProfileShape::Line { a, c, d } = table.shape else {
            panic!("{table:?}");
        };
        assert!(a.abs() < 1e-3 && (d / c + 5.0).abs() < 1e-3);
        assert!(
            table
                .kept
                .iter()
                .all(|&i| (samples[i].x_mm - 4.0).abs() >= 7.99)
        );
    }

    #[test]
    fn what_is_not_there_is_not_found() {
        let flat: Vec<ProfilePoint> = (0..100)
            .map(|i| sample(i, f64::from(i), 0.003 * (f64::from(i) * 78.2).sin()))
            .collect();
        assert_eq!(find(&flat, Wanted::Arc(Some(10.0)), 0.05), None);
        // A hollow is no ball.
        let hollow: Vec<ProfilePoint> = (0..100)
            .map(|i| {
                let x = -7.0 + 0.14 * f64::from(i);
                sample(i, x, 20.0 - (100.0 - x * x).sqrt())
            })
            .collect();
        assert_eq!(find(&hollow, Wanted::Arc(Some(10.0)), 0.05), None);
        assert_eq!(find(&flat[..5], Wanted::Line, 0.05), None);
        let steep: Vec<ProfilePoint> = (0..100)
            .map(|i| sample(i, 0.01 * f64::from(i), f64::from(i)))
            .collect();
        assert_eq!(find(&steep, Wanted::Line, 0.05), None);
    }
}
