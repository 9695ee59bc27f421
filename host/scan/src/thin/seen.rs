//! What the sensor saw badly: too near or too far, or too much from the side.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::{Matrix3, SymmetricEigen};
use umi_kinematics::Pose;

use super::drops::{Drops, judged, keep};
use crate::ScanError;
use crate::cloud::{CloudPoint, Points};
use crate::rigid::Vec3;

/// Where the sensor looked from.
#[derive(Debug, Clone, PartialEq)]
pub enum Beams {
    /// Always along this unit vector of the cloud's frame, from the sensor to the part.
    Along(Vec3),
    /// By the pose of each profile: against the z of its frame.
    Poses(Arc<HashMap<u64, Pose>>),
}

impl Beams {
    pub(super) fn of(&self, profile: u64) -> Option<Vec3> {
        match self {
            Self::Along(beam) => Some(*beam),
            Self::Poses(poses) => poses
                .get(&profile)
                .map(|pose| -pose.rotation.column(2).into_owned()),
        }
    }
}

/// A point that its profile saw lies in the laser's plane, but for what a file's floats round.
const OFF_PLANE_MM: f64 = 0.01;
/// As a share of its coordinates: the rounding of floats, twice.
const ROUNDED: f64 = 2.4e-7;

/// The same points, if the poses are theirs.
///
/// # Errors
/// In place of a point: `foreign_poses` where it lies beside the laser's plane of its profile: the poses are of another
/// scan, or the cloud was moved since.
pub fn of_these_poses(points: Points<'_>, poses: Arc<HashMap<u64, Pose>>) -> Points<'_> {
    Box::new(points.map(move |point| {
        let p = point?;
        let at = Vec3::from(p.at);
        if let Some(pose) = poses.get(&p.profile) {
            let y_mm = pose.rotation.column(1).dot(&(at - pose.translation_mm));
            if y_mm.abs() > OFF_PLANE_MM + ROUNDED * at.amax() {
                return Err(ScanError::refused(
                    "foreign_poses",
                    format_args!(
                        "a point of profile {} lies {y_mm:+.3} mm beside the laser's plane: the poses are of another scan, or \
                         the cloud was moved since it was merged",
                        p.profile
                    ),
                )
                .with("profile", p.profile));
            }
        }
        Ok(p)
    }))
}

/// Points whose z in the sensor's frame is within bounds: others are `too_far` (z grows towards the
/// sensor) or `too_near`; those of a profile without a pose have `no_pose`.
pub fn range<'a>(
    points: Points<'a>,
    poses: Arc<HashMap<u64, Pose>>,
    least_mm: f64,
    most_mm: f64,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    judged(points, drops, move |p| {
        let Some(pose) = poses.get(&p.profile) else {
            return Some("no_pose");
        };
        let z = pose
            .rotation
            .column(2)
            .dot(&(Vec3::from(p.at) - pose.translation_mm));
        if z > most_mm {
            Some("too_near")
        } else if z >= least_mm {
            None
        } else {
            Some("too_far")
        }
    })
}

/// Sums over the points of a cell, from its middle.
#[derive(Debug, Clone, Copy)]
struct Sums {
    n: f64,
    first: Vec3,
    second: Matrix3<f64>,
}

/// A patch whose least spread but one is below this share of its greatest is a line.
const LINE: f64 = 1e-4;

/// Leaves out `steep` points: where the surface's normal stands off the beam by more than `most_deg`.
///
/// The normal is that of the plane through the points in the cell of `cell_mm` and the 26 about it.
/// Points of a single line show how far the beam is off square to that line alone, which is the least
/// that the surface can be; fewer than three show nothing, and stay. Points of a profile without a
/// pose have `no_pose`.
///
/// # Errors
/// Dropped points cannot be written; `not_finite` where a coordinate is too far out for the cells.
pub fn steep(
    points: Vec<CloudPoint>,
    beams: &Beams,
    most_deg: f64,
    cell_mm: f64,
    drops: &RefCell<Drops>,
) -> Result<Vec<CloudPoint>, ScanError> {
    let far = |x: f64| (x / cell_mm).abs() > 9e15;
    if points.iter().flat_map(|p| p.at).any(far) {
        return Err(ScanError::refused(
            "not_finite",
            "A point lies too far out for cells of this size.",
        ));
    }
    let place = |p: &CloudPoint| p.at.map(|x| (x / cell_mm).floor() as i64);
    let middle = |place: [i64; 3]| Vec3::from(place.map(|i| (i as f64 + 0.5) * cell_mm));
    let mut cells: HashMap<[i64; 3], Sums> = HashMap::new();
    for p in &points {
        let place = place(p);
        let arm = Vec3::from(p.at) - middle(place);
        let sums = cells.entry(place).or_insert(Sums {
            n: 0.0,
            first: Vec3::zeros(),
            second: Matrix3::zeros(),
        });
        sums.n += 1.0;
        sums.first += arm;
        sums.second += arm * arm.transpose();
    }
    let normals: HashMap<[i64; 3], Patch> = cells
        .keys()
        .map(|&place| (place, patch(&cells, place, cell_mm)))
        .collect();
    let least_cosine = most_deg.to_radians().cos();
    let mut without = Vec::new();
    let mut with = Vec::new();
    for p in points {
        if beams.of(p.profile).is_some() {
            with.push(p);
        } else {
            without.push(p);
        }
    }
    for p in &without {
        drops.borrow_mut().drop_point("no_pose", p)?;
    }
    keep(with, drops, "steep", |_, p| {
        let (Some(beam), Some(patch)) = (beams.of(p.profile), normals.get(&place(p))) else {
            return true;
        };
        match patch {
            Patch::Unknown => true,
            Patch::Plane(normal) => beam.dot(normal).abs() >= least_cosine,
            Patch::Line(along) => beam.cross(along).norm() >= least_cosine,
        }
    })
}

/// What the points about a place lie on.
enum Patch {
    /// With this normal.
    Plane(Vec3),
    /// Along this direction.
    Line(Vec3),
    Unknown,
}

fn patch(cells: &HashMap<[i64; 3], Sums>, [x, y, z]: [i64; 3], cell_mm: f64) -> Patch {
    let (mut n, mut first, mut second) = (0.0, Vec3::zeros(), Matrix3::zeros());
    for dx in -1..=1 {
        for dy in -1..=1 {
            for dz in -1..=1 {
                let Some(sums) = cells.get(&[x + dx, y + dy, z + dz]) else {
                    continue;
                };
                // From the middle of the cell in question.
                let to = Vec3::new(dx as f64, dy as f64, dz as f64) * cell_mm;
                let across = to * sums.first.transpose();
                n += sums.n;
                first += sums.first + sums.n * to;
                second += sums.second + across + across.transpose() + sums.n * to * to.transpose();
            }
        }
    }
    if n < 3.0 {
        return Patch::Unknown;
    }
    let spread = second / n - first * first.transpose() / (n * n);
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let [least, middle, most] = order;
    if eigen.eigenvalues[most] <= 0.0 {
        Patch::Unknown
    } else if eigen.eigenvalues[middle] < LINE * eigen.eigenvalues[most] {
        Patch::Line(eigen.eigenvectors.column(most).into_owned())
    } else {
        Patch::Plane(eigen.eigenvectors.column(least).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(drops: RefCell<Drops>) -> Vec<(&'static str, u64)> {
        let list = drops.into_inner().finish().unwrap();
        list.iter().map(|d| (d.reason, d.points)).collect()
    }

    fn point(at: [f64; 3], profile: u64) -> CloudPoint {
        CloudPoint {
            at,
            profile,
            ..CloudPoint::default()
        }
    }

    /// A roof whose sides slope by 30 and 70 degrees, profiles across it.
    fn roof() -> Vec<CloudPoint> {
        let height = |x: f64| {
            let slope: f64 = if x < 0.0 { 30.0 } else { -70.0 };
            x * slope.to_radians().tan()
        };
        (0..40)
            .flat_map(|p| {
                (-50..50).map(move |i| {
                    let x = 0.1 * f64::from(i) + 0.05;
                    point([x, 0.3 * p as f64, height(x)], p)
                })
            })
            .collect()
    }

    #[test]
    fn the_steep_side_of_a_roof_goes() {
        let beams = Beams::Along(-Vec3::z());
        for (most_deg, gone) in [(75.0, 0), (60.0, 2000), (20.0, 4000)] {
            let drops = RefCell::default();
            let kept = steep(roof(), &beams, most_deg, 0.5, &drops).unwrap();
            // Within a cell and a half of the ridge the two sides are one patch.
            let off = (4000 - kept.len()).abs_diff(gone);
            assert!(off <= 40 * 40, "{most_deg}: {}", kept.len());
            let clear = |p: &CloudPoint| p.at[0].abs() > 1.6;
            let expected = roof()
                .into_iter()
                .filter(clear)
                .filter(|p| {
                    let slope = if p.at[0] < 0.0 { 30.0 } else { 70.0 };
                    slope <= most_deg
                })
                .count();
            assert_eq!(kept.iter().filter(|p| clear(p)).count(), expected);
        }
        // From the side of the steep one it is the other that is steep.
        let beams = Beams::Along(Vec3::new(-1.0, 0.0, 0.0));
        let drops = RefCell::default();
        let kept = steep(roof(), &beams, 45.0, 0.5, &drops).unwrap();
        assert!(kept.iter().all(|p| p.at[0] > -1.6));
    }

    #[test]
    fn a_single_profile_shows_its_own_slope_alone() {
        let line: Vec<CloudPoint> = roof().into_iter().filter(|p| p.profile == 3).collect();
        let beams = Beams::Along(-Vec3::z());
        let drops = RefCell::default();
        let kept = steep(line, &beams, 50.0, 0.5, &drops).unwrap();
        assert!(kept.iter().filter(|p| p.at[0] > 1.6).count() == 0);
        assert_eq!(kept.iter().filter(|p| p.at[0] < -1.6).count(), 34);
        let two = vec![point([0.0; 3], 0), point([0.1, 0.0, 9.0], 0)];
        assert_eq!(
            steep(two, &beams, 1.0, 0.5, &RefCell::default())
                .unwrap()
                .len(),
            2
        );
    }

    #[test]
    fn range_is_the_sensors_own_z() {
        // Turned by 90 degrees about x: the sensor's z is -y of the cloud.
        let turned = Pose::turn(&Vec3::x(), &Vec3::zeros(), std::f64::consts::FRAC_PI_2);
        let pose = Pose {
            translation_mm: Vec3::new(5.0, 100.0, 7.0),
            ..turned
        };
        let at = |z: f64, x: f64| {
            let p = pose.point(&Vec3::new(x, 0.0, z));
            point(p.into(), 1)
        };
        let list = [
            at(-41.0, 1.0),
            at(-39.0, 2.0),
            at(39.0, 3.0),
            at(41.0, 4.0),
            point([0.0; 3], 2),
        ];
        let poses = Arc::new(HashMap::from([(1, pose)]));
        let drops = RefCell::default();
        let kept: Vec<CloudPoint> = range(
            Box::new(list.iter().copied().map(Ok)),
            Arc::clone(&poses),
            -40.0,
            40.0,
            &drops,
        )
        .map(Result::unwrap)
        .collect();
        assert_eq!(kept, list[1..3]);
        assert_eq!(
            counts(drops),
            [("too_far", 1), ("too_near", 1), ("no_pose", 1)]
        );
        let drops = RefCell::default();
        let beams = Beams::Poses(poses);
        assert_eq!(
            steep(list.to_vec(), &beams, 80.0, 1.0, &drops)
                .unwrap()
                .len(),
            4
        );
        assert_eq!(counts(drops), [("no_pose", 1)]);
    }
}
