//! Single points far from where all others are: a spike that was not filtered decides the greatest deviation,
//! and nobody looks for it.

use crate::rigid::Vec3;
use crate::solve::median;

/// A cloud of fewer points shows no scatter to hold one against.
const LEAST_POINTS: usize = 10;
/// A stray is this many standard deviations off, by the median of all deviations: no tail of a
/// normal distribution, and of hardly any other.
const FAR: f64 = 20.0;
/// And this much further off than all that are none: a tail has no gap.
const GAP: f64 = 3.0;
/// What files round is no scatter.
const LEAST_SIGMA_MM: f64 = 1e-3;
/// More than one in so many are no strays but a part of what was scanned.
const ONE_IN: usize = 100;

/// The warning of points that lie far off all others; `points` as they were compared, in the order of the file.
#[must_use]
pub fn strays(points: &[Vec3], deviations_mm: &[f64]) -> Option<String> {
    let n = deviations_mm.len();
    if n < LEAST_POINTS || points.len() != n {
        return None;
    }
    let middle_mm = median(&mut deviations_mm.to_vec());
    let off_mm: Vec<f64> = deviations_mm
        .iter()
        .map(|d| (d - middle_mm).abs())
        .collect();
    let half_mm = median(&mut off_mm.clone());
    // Of a normal distribution half lie within 0.6745 standard deviations.
    let limit_mm = FAR * (half_mm / 0.6745).max(LEAST_SIGMA_MM);
    let far = || {
        off_mm
            .iter()
            .enumerate()
            .filter(|(_, off)| **off > limit_mm)
    };
    let count = far().count();
    let nearest_mm = far().map(|(_, off)| *off).fold(f64::INFINITY, f64::min);
    let others_mm = off_mm
        .iter()
        .filter(|off| **off <= limit_mm)
        .fold(0.0, |a, b| f64::max(a, *b));
    let (worst, _) = far().max_by(|a, b| a.1.total_cmp(b.1))?;
    if count > (n / ONE_IN).max(1) || nearest_mm < GAP * others_mm {
        return None;
    }
    let (at, is_mm) = (&points[worst], deviations_mm[worst]);
    let others = match count {
        1 => String::new(),
        count => format!(" ({} more are far off, too)", count - 1),
    };
    Some(format!(
        "stray: point {} of {n} at {:.4}, {:.4}, {:.4} is {is_mm:+.4} mm off{others}, all others at most {:.4} mm about \
         the median of {middle_mm:+.4} mm: min, max and std are its own; umi scan filter leaves such points out",
        worst + 1,
        at.x,
        at.y,
        at.z,
        others_mm
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// About normal, standard deviation 4 um: sums of twelve of a fixed row of numbers.
    fn cloud(n: u64) -> (Vec<Vec3>, Vec<f64>) {
        let mut state = 7_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..n)
            .map(|i| {
                let sum: f64 = (0..12).map(|_| next()).sum();
                (Vec3::new(i as f64, 0.0, 0.0), 0.004 * sum)
            })
            .unzip()
    }

    #[test]
    fn a_single_point_far_off_is_named() {
        for (n, at) in [(10, 3), (500, 417), (20_000, 0)] {
            let (points, mut off) = cloud(n);
            assert_eq!(strays(&points, &off), None);
            off[at] = -3.6;
            let said = strays(&points, &off).unwrap();
            assert!(
                said.starts_with(&format!("stray: point {} of {n} at {at}.0000, ", at + 1)),
                "{said}"
            );
            assert!(said.contains("is -3.6000 mm off, all others"), "{said}");
        }
        let (points, mut off) = cloud(500);
        (off[3], off[400]) = (0.9, 1.2);
        let said = strays(&points, &off).unwrap();
        assert!(
            said.contains("point 401 of") && said.contains("(1 more are"),
            "{said}"
        );
    }

    /// Tails, a side of the part that is off, and files that are exact but for a rounded digit.
    #[test]
    fn what_is_no_stray_is_not_named() {
        let (points, off) = cloud(20_000);
        assert_eq!(strays(&points, &off), None);
        // Tails of Laplace's kind.
        let heavy: Vec<f64> = off.iter().map(|d| d * (d / 0.004).abs()).collect();
        assert_eq!(strays(&points, &heavy), None);
        let step: Vec<f64> = off
            .iter()
            .enumerate()
            .map(|(i, d)| if i < 3000 { d + 1.0 } else { *d })
            .collect();
        assert_eq!(strays(&points, &step), None);
        let mut exact = vec![0.0; 20_000];
        exact[5] = 0.01;
        assert_eq!(strays(&points, &exact), None);
    }
}
