//! Planes, of which each profile is a line.
//!
//! Along a profile a plane's residual is linear in x and z, so two points of the line through the profile's points say all
//! that a mount has to bring together; what the points scatter about it is the sensor's own noise, whatever the mount. So a
//! fit can be held against that noise before anybody believes it, and many descents from around the first guess, on two points
//! a profile, take hardly any time.

use std::collections::HashMap;

use nalgebra::{Matrix2, Vector2, Vector3};

use super::distance::apart;
use super::model::MountModel;
use crate::calibrate::features::SampleSights;
use crate::calibrate::features::{plane_through, points_by_feature};
use crate::calibrate::observations::{Observation, Observations};
use crate::calibrate::solve::{Model, descend};
use crate::rigid::rotation;
use umi_kinematics::Pose;

/// So many lines at most are brought together by the many descents, spread over all.
const MOST_LINES: usize = 60;
/// First steps of each descent, and those of the best.
const STEPS: (usize, usize) = (12, 80);
/// So many of the best are followed to their ends.
const FOLLOWED: usize = 24;
/// Mounts that are less apart are in one valley: mm, degrees.
const SAME: (f64, f64) = (0.05, 0.03);
/// Where descents begin about the guess, which is right to 6° and 20 mm: turns about each axis in rad, shifts along one.
const TURNS: [f64; 3] = [0.0, -0.06, 0.06];
const SHIFT_MM: f64 = 12.0;
/// Descents that end farther off are of no use.
const MOST_SHIFT_MM: f64 = 200.0;
/// A plane's residuals that are rounding.
const ROUNDED_MM: f64 = 1e-5;

/// The line of a profile of a plane, in the sensor's frame.
struct Line {
    flange: usize,
    feature: usize,
    points: usize,
    middle_mm: Vector3<f64>,
    /// Along it, of the length of the points' scatter along it.
    along_mm: Vector3<f64>,
    /// The sum of squares of the points' distances from it, in mm².
    off_mm2: f64,
}

/// The lines of all profiles, those of one feature together.
fn lines(all: &Observations) -> Vec<Line> {
    let mut place: HashMap<(usize, usize), usize> = HashMap::new();
    let mut groups: Vec<Vec<&Observation>> = Vec::new();
    for seen in &all.points {
        let at = *place.entry((seen.feature, seen.flange)).or_insert_with(|| {
            groups.push(Vec::new());
            groups.len() - 1
        });
        groups[at].push(seen);
    }
    let line = |points: Vec<&Observation>| {
        let first = points.first()?;
        let n = points.len() as f64;
        let sum: Vector3<f64> = points.iter().map(|seen| seen.seen_mm).sum();
        let middle_mm = sum / n;
        let mut scatter = Matrix2::zeros();
        for seen in &points {
            let arm = seen.seen_mm - middle_mm;
            let arm = Vector2::new(arm.x, arm.z);
            scatter += arm * arm.transpose();
        }
        let eigen = scatter.symmetric_eigen();
        let (most, least) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
        let along = eigen.eigenvectors.column(most) * (eigen.eigenvalues[most].max(0.0) / n).sqrt();
        Some(Line {
            flange: first.flange,
            feature: first.feature,
            points: points.len(),
            middle_mm,
            along_mm: Vector3::new(along.x, 0.0, along.y),
            off_mm2: if most == least {
                0.0
            } else {
                eigen.eigenvalues[least].max(0.0)
            },
        })
    };
    let mut lines: Vec<Line> = groups.into_iter().filter_map(line).collect();
    lines.sort_by_key(|line| line.feature);
    lines
}

/// What the points scatter about their own lines, as residuals of a mount.
pub(super) struct Within {
    /// The sum of squares.
    ssq: f64,
    /// Its degrees of freedom.
    dof: usize,
    /// Numbers that the lines show beyond the unknowns.
    over: usize,
}

impl Within {
    /// None where no profile has more than the two points of its line.
    pub(super) fn of(model: &MountModel<'_>) -> Option<Self> {
        let lines = lines(model.all);
        let (mut ssq, mut dof) = (0.0, 0);
        for line in &lines {
            let SampleSights::Plane { normal, .. } = &model.features[line.feature] else {
                return None;
            };
            // Off the line by a mm, a point is off the plane by less.
            let flange = &model.all.flanges[line.flange];
            let seen = (flange.rotation * model.mount.rotation).tr_mul(normal);
            ssq += line.off_mm2 * (seen.x * seen.x + seen.z * seen.z);
            dof += line.points.saturating_sub(2);
        }
        let (nuisances, targets) = model.unknowns();
        (dof > 0).then_some(Self {
            ssq,
            dof,
            over: (2 * lines.len()).saturating_sub(nuisances + targets),
        })
    }

    /// The variance of a residual by this, or by what a fit leaves between the profiles where that is more, in mm².
    pub(super) fn variance(&self, ssq: f64) -> f64 {
        let within = self.ssq / self.dof as f64;
        let between = (ssq - self.ssq) / self.over.max(1) as f64;
        within.max(between)
    }

    /// Whether a fit's sum of squares is no more than noise explains.
    pub(super) fn fits(&self, ssq: f64) -> bool {
        /// Of the mean squares. Noise alone is beyond that in one of twenty sets of the least size, which takes time and
        /// nothing else.
        const TIMES: f64 = 3.0;
        let over = self.over.max(1) as f64;
        let noise = TIMES * over * self.ssq / self.dof as f64;
        ssq - self.ssq <= noise + (self.over + self.dof) as f64 * ROUNDED_MM * ROUNDED_MM
    }
}

/// The mounts in whose valleys descents from about the first guess end, the best first, by two points of each line.
pub(super) fn valleys<'a>(first: &MountModel<'a>, start: &Pose) -> Vec<MountModel<'a>> {
    let few = two_of_each(first.all);
    let mut ends: Vec<(f64, MountModel<'_>)> = starts(&few, first, start)
        .into_iter()
        .map(|mut model| (descend(&mut model, STEPS.0), model))
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut followed = apart_of(ends, FOLLOWED);
    for (ssq, model) in &mut followed {
        *ssq = descend(model, STEPS.1);
    }
    followed.retain(|(_, model)| {
        (model.mount.translation_mm - start.translation_mm).norm() <= MOST_SHIFT_MM
    });
    followed.sort_by(|a, b| a.0.total_cmp(&b.0));
    apart_of(followed, FOLLOWED)
        .into_iter()
        .map(|(_, found)| at_mount(first, found.mount))
        .collect()
}

/// The model with its features where a mount sees them.
pub(super) fn at_mount<'a>(model: &MountModel<'a>, mount: Pose) -> MountModel<'a> {
    let points = points_by_feature(model.all, &mount);
    MountModel {
        mount,
        features: points.iter().map(|points| plane_through(points)).collect(),
        ..model.clone()
    }
}

/// The first ones of these, none as the others, so many at most.
fn apart_of<'a>(sorted: Vec<(f64, MountModel<'a>)>, most: usize) -> Vec<(f64, MountModel<'a>)> {
    let mut kept: Vec<(f64, MountModel<'a>)> = Vec::new();
    for (ssq, model) in sorted {
        let is_same = |other: &(f64, MountModel<'_>)| {
            let (shift_mm, turn_deg) = apart(&model.mount, &other.1.mount);
            shift_mm < SAME.0 && turn_deg < SAME.1
        };
        if kept.len() < most && ssq.is_finite() && !kept.iter().any(is_same) {
            kept.push((ssq, model));
        }
    }
    kept
}

/// Two points of each line, or of as many as are enough.
fn two_of_each(all: &Observations) -> Observations {
    let lines = lines(all);
    let every = lines.len().div_ceil(MOST_LINES).max(1);
    let points = lines.iter().step_by(every).flat_map(|line| {
        [-1.0, 1.0].map(|sign| Observation {
            flange: line.flange,
            feature: line.feature,
            seen_mm: line.middle_mm + sign * line.along_mm,
        })
    });
    Observations {
        features: all.features.clone(),
        profiles: Vec::new(),
        flanges_by_radians: None,
        flanges: all.flanges.clone(),
        slips: Vec::new(),
        points: points.collect(),
    }
}

/// Mounts about the first guess, with the planes as each of them sees them.
fn starts<'a>(few: &'a Observations, first: &MountModel<'_>, start: &Pose) -> Vec<MountModel<'a>> {
    let begin = first.of(few);
    let shifts = (0..3).flat_map(|axis| [-1.0, 1.0].map(|sign| (axis, sign)));
    let shifts = shifts.filter(|(axis, _)| first.sought[3 + axis]);
    let shifts: Vec<Vector3<f64>> = std::iter::once(Vector3::zeros())
        .chain(shifts.map(|(axis, sign)| Vector3::ith(axis, sign * SHIFT_MM)))
        .collect();
    let n = TURNS.len();
    let turns = (0..n * n * n).map(|place| {
        let by = |axis: u32| TURNS[place / n.pow(axis) % n];
        rotation(&Vector3::new(by(0), by(1), by(2)))
    });
    turns
        .flat_map(|turn| shifts.iter().map(move |shift| (turn, *shift)))
        .map(|(turn, shift)| {
            let mount = Pose {
                rotation: turn * start.rotation,
                translation_mm: start.translation_mm + shift,
            };
            at_mount(&begin, mount)
        })
        .collect()
}

/// Numbers that the profiles of planes show of the mount beyond the unknowns, at least, and how many profiles differ. A line
/// shows two. Where the flange only shifts, its lines are parallel, and what their heights differ by says at most how the
/// plane is inclined (2, once for a plane) and how steeply the sensor looks at it (1).
pub(super) fn numbers_over(model: &MountModel<'_>) -> (i64, usize) {
    /// Turned by less, a flange only shifts.
    const TURNED: f64 = 1e-3;
    /// Shifts of a flange that is turned alike: no more of them tell anything else.
    const SHIFTS: usize = 4;
    /// A plane seen at so many angles is never in question.
    const ENOUGH: usize = 1000;
    type Turned = (nalgebra::Matrix3<f64>, Vec<Vector3<f64>>);
    let mut seen_of: Vec<Vec<Turned>> = vec![Vec::new(); model.features.len()];
    let mut last = None;
    for seen in &model.all.points {
        if last == Some((seen.feature, seen.flange)) {
            continue;
        }
        last = Some((seen.feature, seen.flange));
        let flange = &model.all.flanges[seen.flange];
        let of = &mut seen_of[seen.feature];
        let alike = |turned: &Turned| (turned.0 - flange.rotation).amax() < TURNED;
        match of.iter().position(alike) {
            Some(place) => {
                let shifts = &mut of[place].1;
                if shifts.len() < SHIFTS && !shifts.contains(&flange.translation_mm) {
                    shifts.push(flange.translation_mm);
                }
            }
            None if of.len() < ENOUGH => of.push((flange.rotation, vec![flange.translation_mm])),
            None => {}
        }
    }
    let shown = seen_of.iter().map(|of| {
        let more = of.iter().map(|(_, shifts)| shifts.len() as i64 - 1);
        let shifted = of.iter().filter(|(_, shifts)| shifts.len() > 1).count() as i64;
        let heights = more.sum::<i64>().min(2 + shifted);
        (2 * of.len() as i64 + heights - 3).max(0)
    });
    let (_, targets) = model.unknowns();
    let profiles = seen_of
        .iter()
        .flatten()
        .map(|(_, shifts)| shifts.len())
        .sum();
    (shown.sum::<i64>() - targets as i64, profiles)
}

#[cfg(test)]
mod tests {
    use super::super::{Artefact, SensorOptions, first_model};
    use super::*;

    /// Numbers over of a plane that is seen at so many angles, and at each from so many places.
    fn over(angles: usize, places: usize) -> (i64, usize) {
        let mut all = Observations {
            features: vec!["plane".into()],
            ..Observations::default()
        };
        for flange in 0..angles * places {
            let (angle, place) = ((flange / places) as f64, (flange % places) as f64);
            all.flanges.push(Pose {
                rotation: rotation(&Vector3::new(0.1 * angle, 0.2 * angle, 0.0)),
                translation_mm: Vector3::new(10.0 * place, 3.0 * place * place, 5.0 * place),
            });
            all.points.extend([-9.0, 0.0, 9.0].map(|x| Observation {
                flange,
                feature: 0,
                seen_mm: Vector3::new(x, 0.0, 1.0),
            }));
        }
        let options = SensorOptions {
            on: Artefact::Plane,
            radius_mm: None,
            centres: None,
            hold: [false; 3],
            bars: Vec::new(),
            allow_misfit: false,
            drop_outliers: false,
        };
        numbers_over(&first_model(&all, &Pose::identity(), &options).unwrap())
    }

    /// Two numbers a profile at angles of its own, less nine unknowns; at the same angles its heights show three at most, and
    /// two of those, the plane's normal, only once.
    #[test]
    fn parallel_lines_show_less_than_two_numbers_each() {
        assert_eq!(over(5, 1), (1, 5));
        assert_eq!(over(24, 1), (39, 24));
        assert_eq!(over(1, 30), (2 + 3 - 9, 4));
        assert_eq!(over(3, 2), (3 * 2 + 3 - 9, 6));
        assert_eq!(over(3, 30), (3 * 2 + 5 - 9, 12));
    }
}
