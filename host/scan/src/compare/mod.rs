//! How far a cloud is from its nominal: signed distances, positive outside.
//!
//! Nothing is aligned unless [`align`] is called.

mod align;
mod nominal;
mod strays;

use serde::Serialize;

pub use align::{CloudAlignment, Locked, align};
pub use nominal::{Nominal, elsewhere};
pub use strays::strays;

use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::surface::Near;

/// The answer of `umi scan compare`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Deviations {
    /// Points.
    pub n: usize,
    /// The mean of all.
    pub mean_mm: f64,
    /// Standard deviation about the mean, with n − 1; none for one point.
    pub std_mm: Option<f64>,
    /// The least.
    pub min_mm: f64,
    /// The greatest.
    pub max_mm: f64,
    /// The mean of those above zero, if there are any.
    pub mean_above_mm: Option<f64>,
    /// The mean of those below zero, if there are any.
    pub mean_below_mm: Option<f64>,
    /// The root of the mean square.
    pub rms_mm: f64,
}

/// The signed distance of every point.
#[must_use]
pub fn deviations_mm(points: &[Vec3], nominal: &Nominal) -> Vec<f64> {
    let mut hint = 0;
    points
        .iter()
        .map(|point| nominal.distance_mm(point, &mut hint))
        .collect()
}

/// What the nominal is to every point, on several threads; the same for any number of them.
///
/// # Errors
/// `not_finite` where a point has no distance.
pub fn nearest(
    points: &[Vec3],
    nominal: &Nominal,
    threads: Threads,
) -> Result<Vec<Near>, ScanError> {
    let parts = threads.chunks(points.len(), 4096, |range| {
        let mut hint = 0;
        points[range]
            .iter()
            .map(|point| nominal.near(point, &mut hint))
            .collect::<Option<Vec<Near>>>()
    });
    let all: Option<Vec<Vec<Near>>> = parts.into_iter().collect();
    all.map(|all| all.concat())
        .ok_or_else(|| ScanError::refused("not_finite", "a deviation is not finite"))
}

/// The figures of all deviations.
///
/// # Errors
/// `too_few_points` without any; `not_finite`.
pub fn summary(deviations_mm: &[f64]) -> Result<Deviations, ScanError> {
    let n = deviations_mm.len();
    if n == 0 {
        return Err(ScanError::refused(
            "too_few_points",
            "there is no point to compare",
        ));
    }
    if deviations_mm.iter().any(|d| !d.is_finite()) {
        return Err(ScanError::refused(
            "not_finite",
            "a deviation is not finite",
        ));
    }
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (mut n, mut sum) = (0.0, 0.0);
        values.for_each(|value| {
            n += 1.0;
            sum += value;
        });
        (n > 0.0).then(|| sum / n)
    };
    let mean_mm = mean(&mut deviations_mm.iter().copied()).unwrap_or(0.0);
    let about: f64 = deviations_mm
        .iter()
        .map(|d| (d - mean_mm) * (d - mean_mm))
        .sum();
    let squares: f64 = deviations_mm.iter().map(|d| d * d).sum();
    Ok(Deviations {
        n,
        mean_mm,
        std_mm: (n > 1).then(|| (about / (n - 1) as f64).sqrt()),
        min_mm: deviations_mm.iter().copied().fold(f64::INFINITY, f64::min),
        max_mm: deviations_mm
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max),
        mean_above_mm: mean(&mut deviations_mm.iter().copied().filter(|d| *d > 0.0)),
        mean_below_mm: mean(&mut deviations_mm.iter().copied().filter(|d| *d < 0.0)),
        rms_mm: (squares / n as f64).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }

    #[test]
    fn the_sides_of_all_nominals_are_positive_outside() {
        let p = Vec3::new(3.0, 4.0, 1.0);
        for (text, expected) in [
            (
                "kind = \"plane\"\npoint_mm = [0, 0, 2]\nnormal = [0, 0, 5]",
                -1.0,
            ),
            (
                "kind = \"cylinder\"\npoint_mm = [0, 0, 9]\ndirection = [0, 0, -2]\nradius_mm = 4.5",
                0.5,
            ),
            (
                "kind = \"sphere\"\ncenter_mm = [3, 4, 0]\nradius_mm = 3",
                -2.0,
            ),
            // On the axis 1 mm from the apex: sin 30° from each generator.
            (
                "kind = \"cone\"\napex_mm = [3, 4, 0]\ndirection = [0, 0, 7]\nhalf_angle_deg = 30",
                -0.5,
            ),
            // Behind the apex.
            (
                "kind = \"cone\"\napex_mm = [3, 4, 3]\ndirection = [0, 0, 1]\nhalf_angle_deg = 30",
                2.0,
            ),
            // 5 mm from the axis, 1 mm above the ring of 5 mm.
            (
                "kind = \"torus\"\ncenter_mm = [0, 0, 0]\ndirection = [0, 0, 1]\nmajor_radius_mm = 5\nminor_radius_mm = 3",
                -2.0,
            ),
        ] {
            let nominal = Nominal::parse(text).unwrap();
            close(deviations_mm(&[p], &nominal)[0], expected);
        }
        for text in [
            "kind = \"plane\"\npoint_mm = [0, 0, 2]\nnormal = [0, 0, 0]",
            "kind = \"sphere\"\ncenter_mm = [3, 4, 0]\nradius_mm = -3",
            "kind = \"sphere\"\ncenter_mm = [3, 4, nan]\nradius_mm = 3",
            "kind = \"cube\"",
        ] {
            assert_eq!(Nominal::parse(text).unwrap_err().code, "nominal", "{text}");
        }
    }

    #[test]
    fn distances_grow_along_their_directions() {
        let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]].map(Vec3::from);
        let mesh = crate::surface::Mesh::new(&[corners]).unwrap();
        let toml = |text| Nominal::parse(text).unwrap();
        for nominal in [
            toml("kind = \"plane\"\npoint_mm = [0, 0, 2]\nnormal = [0, 0, 5]"),
            toml(
                "kind = \"cylinder\"\npoint_mm = [0, 0, 9]\ndirection = [0, 1, -2]\nradius_mm = 4.5",
            ),
            toml("kind = \"sphere\"\ncenter_mm = [3, 4, 0]\nradius_mm = 3"),
            Nominal::Mesh(Box::new(mesh.into())),
        ] {
            let points = [[2.0, 1.0, 1.0], [3.0, 3.5, -1.0], [4.0, 2.0, 0.5]].map(Vec3::from);
            let all = nearest(&points, &nominal, Threads::new(2)).unwrap();
            let expected = deviations_mm(&points, &nominal);
            for ((p, near), expected) in points.iter().zip(&all).zip(expected) {
                close(near.distance_mm, expected);
                close(near.direction.norm(), 1.0);
                let further = p + near.direction * 1e-3;
                close(nominal.distance_mm(&further, &mut 0), expected + 1e-3);
            }
        }
    }

    #[test]
    fn a_plane_cuts_a_mesh_once_a_triangle() {
        let corners = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, 10.0]].map(Vec3::from);
        let mesh = crate::surface::Mesh::new(&[corners]).unwrap();
        let nominal = Nominal::Mesh(Box::new(mesh.into()));
        let lines = nominal.section(2, 4.0);
        assert_eq!(lines.len(), 1);
        let mut x = lines[0].map(|p| p.x);
        x.sort_by(f64::total_cmp);
        close(x[0], 0.0);
        close(x[1], 6.0);
        assert!(nominal.section(2, 11.0).is_empty() && nominal.section(1, 1.0).is_empty());
    }

    #[test]
    fn figures_of_one_side_leave_the_other_open() {
        let found = summary(&[1.0, 2.0, 3.0]).unwrap();
        close(found.mean_mm, 2.0);
        close(found.std_mm.unwrap(), 1.0);
        close(found.rms_mm, (14.0_f64 / 3.0).sqrt());
        assert_eq!(found.mean_below_mm, None);
        assert_eq!(summary(&[0.5]).unwrap().std_mm, None);
        assert_eq!(summary(&[]).unwrap_err().code, "too_few_points");
    }
}
