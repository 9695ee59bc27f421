//! Which angles of up to three rotary axes point a sensor along a beam and a line: all of them, in closed form.
//!
//! The rotations stand in a row from the sensor inwards to the part: a direction v of the part is seen by the sensor
//! as `E1(a1) E2(a2) E3(a3) v`. Two known problems carry everything (Paden and Kahan): turn a vector about one axis onto
//! another, and turn it about one axis until it makes a given angle with a second one. Each has its poles, where the
//! vector lies on the axis and the angle says nothing; they are named, and the free axis stands at zero.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

/// Vectors that differ by less than this (radians, or of a unit length) are one: a pole, or a match.
const SAME: f64 = 1e-9;

/// A rotation of a chain.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainRotation {
    /// Unit vector; positive angles turn right-handed about it.
    pub direction: Vector3<f64>,
    /// Least and largest angle.
    pub limits_deg: [f64; 2],
}

/// What shall point where: pairs of a unit vector of the part and the one of the sensor that it shall become.
#[derive(Debug, Clone, PartialEq)]
pub struct Aim {
    /// The beam, on the part and on the sensor.
    pub beam: (Vector3<f64>, Vector3<f64>),
    /// The laser line, where it matters.
    pub line: Option<(Vector3<f64>, Vector3<f64>)>,
}

/// All angles that reach an aim, in degrees from -180 to 180, one set for each branch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Branches {
    /// Angles in the order of the rotations.
    pub branches: Vec<Vec<f64>>,
    /// At a pole an axis is free: there are endless sets. The first one has the free axis at zero.
    pub singular: bool,
}

/// The angle, moved by whole turns to lie within the limits as near to `wanted` as it can, in degrees.
pub fn nearest_turn(angle: f64, limits: [f64; 2], wanted: f64) -> Option<f64> {
    let best = angle + 360.0 * ((wanted - angle) / 360.0).round();
    let low = angle + 360.0 * ((limits[0] - 1e-9 - angle) / 360.0).ceil();
    let high = angle + 360.0 * ((limits[1] + 1e-9 - angle) / 360.0).floor();
    // A whole turn lies inside if the first one above the low limit is not above the high one.
    (low <= high).then(|| best.max(low).min(high).clamp(limits[0], limits[1]))
}

fn turn(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle).into_inner()
}

/// The angle about `axis` that brings the part of `from` across it onto that of `to`; none at a pole.
fn onto(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<f64> {
    let a = from - axis * axis.dot(from);
    let b = to - axis * axis.dot(to);
    if a.norm() < SAME || b.norm() < SAME {
        return None;
    }
    Some(axis.dot(&a.cross(&b)).atan2(a.dot(&b)))
}

/// Angles about `k2` at which u comes to stand at the cosine `c` to `k1`.
enum Inclined {
    Never,
    Always,
    At(Vec<f64>),
}

fn incline(k1: &Vector3<f64>, k2: &Vector3<f64>, u: &Vector3<f64>, c: f64) -> Inclined {
    let constant = k1.dot(k2) * k2.dot(u);
    let a = k1.dot(u) - constant;
    let b = k1.dot(&k2.cross(u));
    let r = a.hypot(b);
    if r < SAME {
        return if (c - constant).abs() < SAME {
            Inclined::Always
        } else {
            Inclined::Never
        };
    }
    let x = (c - constant) / r;
    // Near 1 the cosine is flat: what rounding takes there is a square root of it, so 1e-15 becomes 3e-8 in the angle.
    if x.abs() > 1.0 + SAME {
        return Inclined::Never;
    }
    let middle = b.atan2(a);
    let half = x.clamp(-1.0, 1.0).acos();
    if half < 1e-7 || std::f64::consts::PI - half < 1e-7 {
        return Inclined::At(vec![middle + half]);
    }
    Inclined::At(vec![middle + half, middle - half])
}

/// Angles a, b with `E1(a) E2(b) u = w`, and whether one of them is free (then it is 0).
fn two(
    k1: &Vector3<f64>,
    k2: &Vector3<f64>,
    u: &Vector3<f64>,
    w: &Vector3<f64>,
) -> (Vec<[f64; 2]>, bool) {
    let (seconds, mut singular) = match incline(k1, k2, u, k1.dot(w)) {
        Inclined::Never => return (Vec::new(), false),
        Inclined::Always => (vec![0.0], true),
        Inclined::At(angles) => (angles, false),
    };
    let mut found = Vec::new();
    for b in seconds {
        let v = turn(k2, b) * u;
        match onto(k1, &v, w) {
            Some(a) => found.push([a, b]),
            None => {
                singular = true;
                // What the cosine has lost of the angle is seen in the direction. Where b is free, too, nothing was lost.
                let by_b = k2.cross(&v);
                let lost = by_b.dot(&(w - v)) / by_b.norm_squared().max(SAME);
                found.push([0.0, b + lost]);
            }
        }
    }
    (found, singular)
}

/// The rotation that takes the part's beam and line to the sensor's.
fn whole(beam: (Vector3<f64>, Vector3<f64>), line: (Vector3<f64>, Vector3<f64>)) -> Matrix3<f64> {
    let on = |b: &Vector3<f64>, l: &Vector3<f64>| Matrix3::from_columns(&[*l, b.cross(l), *b]);
    on(&beam.1, &line.1) * on(&beam.0, &line.0).transpose()
}

fn matches(angles: &[f64], turns: &[ChainRotation], pair: &(Vector3<f64>, Vector3<f64>)) -> bool {
    let mut v = pair.0;
    for (t, a) in turns.iter().zip(angles).rev() {
        v = turn(&t.direction, *a) * v;
    }
    (v - pair.1).norm() < 1e-7
}

/// All angles of up to three rotations that reach the aim. Limits are used at poles alone: the free axis then stands at
/// zero, or where that lies outside, at its limit nearest to zero.
pub fn aim(turns: &[ChainRotation], aim: &Aim) -> Branches {
    let mut result = match (&aim.line, turns) {
        (_, []) => Branches {
            branches: vec![Vec::new()],
            singular: false,
        },
        (Some(line), [one]) => one_turn(one, &[aim.beam, *line]),
        (None, [one]) => one_turn(one, &[aim.beam]),
        (Some(line), [first, second]) => two_turns(first, second, &whole(aim.beam, *line)),
        (None, [first, second]) => {
            let (found, singular) = two(
                &first.direction,
                &second.direction,
                &aim.beam.0,
                &aim.beam.1,
            );
            let mut found: Vec<Vec<f64>> = found.into_iter().map(Vec::from).collect();
            if singular {
                found.truncate(1);
                free_within_limits(&mut found, first, second, aim);
            }
            Branches {
                branches: found,
                singular,
            }
        }
        (Some(line), [first, second, third, ..]) => {
            three_turns([first, second, third], &whole(aim.beam, *line))
        }
        (None, [first, rest @ ..]) => {
            // Three rotations share one direction: that nearest to the sensor is held.
            let held = nearest_turn(0.0, first.limits_deg, 0.0)
                .unwrap_or(if first.limits_deg[0] > 0.0 {
                    first.limits_deg[0]
                } else {
                    first.limits_deg[1]
                })
                .to_radians();
            let inner = Aim {
                beam: (aim.beam.0, turn(&first.direction, -held) * aim.beam.1),
                line: None,
            };
            let mut found = self::aim(&rest[..rest.len().min(2)], &inner);
            for set in &mut found.branches {
                for angle in set.iter_mut() {
                    *angle = angle.to_radians();
                }
                set.insert(0, held);
            }
            found
        }
    };
    result.branches.retain(|angles| {
        matches(angles, turns, &aim.beam)
            && aim
                .line
                .as_ref()
                .is_none_or(|line| matches(angles, turns, line))
    });
    for set in &mut result.branches {
        for angle in set.iter_mut() {
            *angle = angle.to_degrees();
            *angle -= 360.0 * (*angle / 360.0).round();
        }
    }
    drop_repeated(&mut result.branches);
    result.singular &= !result.branches.is_empty();
    if result.singular {
        let within = |set: &Vec<f64>| {
            set.iter()
                .zip(turns)
                .all(|(a, t)| nearest_turn(*a, t.limits_deg, 0.0).is_some())
        };
        if !result.branches.iter().any(within)
            && let Some(set) = at_limits(turns, aim)
        {
            result.branches.insert(0, set);
        }
    }
    result
}

/// At a pole the angles that reach the aim are a line. Where it runs through the limits, it meets them where one of the
/// angles stands at its own limit, or at zero: of these, the set with the least angles.
fn at_limits(turns: &[ChainRotation], aim: &Aim) -> Option<Vec<f64>> {
    let mut best: Option<(f64, Vec<f64>)> = None;
    for (k, one) in turns.iter().enumerate() {
        let [low, high] = one.limits_deg;
        for held in [0.0, low, high] {
            if nearest_turn(held, one.limits_deg, 0.0).is_none() {
                continue;
            }
            for set in with_held(turns, aim, k, held) {
                let inside: Option<Vec<f64>> = set
                    .iter()
                    .zip(turns)
                    .map(|(a, t)| nearest_turn(*a, t.limits_deg, 0.0))
                    .collect();
                let Some(set) = inside else { continue };
                let size = set.iter().map(|a| a.abs()).sum();
                if best.as_ref().is_none_or(|(least, _)| size < *least) {
                    best = Some((size, set));
                }
            }
        }
    }
    best.map(|(_, set)| set)
}

/// Angles of all rotations that reach an aim with one of them held, in degrees: those further in are turned by it, and so
/// is what they carry. One set for each branch of the others.
pub fn with_held(turns: &[ChainRotation], aim: &Aim, held: usize, degrees: f64) -> Vec<Vec<f64>> {
    let mut sets = holding(turns, aim, held, degrees).branches;
    for set in &mut sets {
        set.insert(held, degrees);
    }
    sets
}

fn holding(turns: &[ChainRotation], aim: &Aim, held: usize, degrees: f64) -> Branches {
    let by = turn(&turns[held].direction, degrees.to_radians());
    let others = turns.iter().enumerate().filter(|(k, _)| *k != held);
    let rest: Vec<ChainRotation> = others
        .map(|(k, t)| ChainRotation {
            direction: if k > held {
                by * t.direction
            } else {
                t.direction
            },
            limits_deg: t.limits_deg,
        })
        .collect();
    self::aim(
        &rest,
        &Aim {
            beam: (by * aim.beam.0, aim.beam.1),
            line: aim.line.map(|(from, to)| (by * from, to)),
        },
    )
}

fn drop_repeated(branches: &mut Vec<Vec<f64>>) {
    let mut kept: Vec<Vec<f64>> = Vec::new();
    for set in branches.drain(..) {
        let same = |other: &Vec<f64>| {
            other.iter().zip(&set).all(|(a, b)| {
                let d = (a - b) / 360.0;
                (d - d.round()).abs() * 360.0 < 1e-5
            })
        };
        if !kept.iter().any(same) {
            kept.push(set);
        }
    }
    *branches = kept;
}

fn one_turn(one: &ChainRotation, pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Branches {
    let angle = pairs
        .iter()
        .find_map(|(from, to)| onto(&one.direction, from, to));
    Branches {
        branches: vec![vec![angle.unwrap_or(0.0)]],
        singular: angle.is_none(),
    }
}

/// Both angles follow from the whole rotation: the second is where it leaves the first's axis.
fn two_turns(first: &ChainRotation, second: &ChainRotation, r: &Matrix3<f64>) -> Branches {
    let back = r.transpose() * first.direction;
    let (b, singular) = match onto(&second.direction, &back, &first.direction) {
        Some(b) => (b, false),
        None => (0.0, true),
    };
    let rest = r * turn(&second.direction, -b);
    Branches {
        branches: vec![vec![about(&first.direction, &rest), b]],
        singular,
    }
}

/// The angle of a rotation about a known axis.
fn about(axis: &Vector3<f64>, r: &Matrix3<f64>) -> f64 {
    let across = if axis.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let from = (across - axis * axis.dot(&across)).normalize();
    onto(axis, &from, &(r * from)).unwrap_or(0.0)
}

fn three_turns(turns: [&ChainRotation; 3], r: &Matrix3<f64>) -> Branches {
    let [k1, k2, k3] = turns.map(|t| t.direction);
    let (pairs, singular) = two(&k1, &k2, &k3, &(r * k3));
    let complete = |a: f64, b: f64| {
        let rest = (turn(&k1, a) * turn(&k2, b)).transpose() * r;
        vec![a, b, about(&k3, &rest)]
    };
    let mut branches: Vec<Vec<f64>> = pairs.iter().map(|[a, b]| complete(*a, *b)).collect();
    if singular {
        // First and third turn about one line now. The third, further in, is the free one: it stands at zero.
        let mut with_third_held = Vec::new();
        for [_, b] in &pairs {
            for held in [
                0.0_f64,
                turns[2].limits_deg[0].to_radians(),
                turns[2].limits_deg[1].to_radians(),
            ] {
                if nearest_turn(held.to_degrees(), turns[2].limits_deg, 0.0).is_none() {
                    continue;
                }
                let rest = r * (turn(&k2, *b) * turn(&k3, held)).transpose();
                let a = about(&k1, &rest);
                if nearest_turn(a.to_degrees(), turns[0].limits_deg, 0.0).is_some() {
                    with_third_held.push(vec![a, *b, held]);
                }
            }
        }
        with_third_held.append(&mut branches);
        branches = with_third_held;
    }
    Branches { branches, singular }
}

/// The inner axis was put to zero at a pole; where zero lies outside its limits it stands at the nearer one.
fn free_within_limits(
    found: &mut [Vec<f64>],
    first: &ChainRotation,
    second: &ChainRotation,
    aim: &Aim,
) {
    for set in found.iter_mut() {
        if nearest_turn(0.0, second.limits_deg, 0.0).is_some() || set[1] != 0.0 {
            continue;
        }
        let [low, high] = second.limits_deg;
        let held = if low.abs() < high.abs() { low } else { high }.to_radians();
        let v = turn(&second.direction, held) * aim.beam.0;
        if let Some(a) = onto(&first.direction, &v, &aim.beam.1) {
            *set = vec![a, held];
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};

    use super::*;

    fn axis(x: f64, y: f64, z: f64) -> ChainRotation {
        ChainRotation {
            direction: Vector3::new(x, y, z).normalize(),
            limits_deg: [-180.0, 180.0],
        }
    }

    /// Chains of all kinds, oblique ones too: every branch points as asked, and the angles that made the pose are one.
    #[test]
    fn every_branch_reaches_the_aim_and_the_makers_angles_are_among_them() {
        let chains = [
            [
                axis(0.0, 0.0, -1.0),
                axis(1.0, 0.0, 0.0),
                axis(0.0, 0.0, 1.0),
            ],
            [
                axis(0.0, 0.0, -1.0),
                axis(0.0, 1.0, 0.0),
                axis(1.0, 0.0, 0.0),
            ],
            [
                axis(0.0, 0.0, -1.0),
                axis(0.0, 1.0, 1.0),
                axis(0.0, 0.0, 1.0),
            ],
            [
                axis(0.2, 0.1, -1.0),
                axis(1.0, 0.1, 0.0),
                axis(0.3, 1.0, 0.2),
            ],
        ];
        let (beam, line) = (-Vector3::z(), Vector3::y());
        for (c, chain) in chains.iter().enumerate() {
            for i in 0..200 {
                let x = |k: f64| (f64::from(i) * k).fract() * 340.0 - 170.0;
                let angles = [x(0.618_033_9), x(0.754_877_6), x(0.569_840_3)];
                let mut r = Matrix3::identity();
                for (t, a) in chain.iter().zip(angles) {
                    r *= turn(&t.direction, a.to_radians());
                }
                let aim_ = Aim {
                    beam: (r.transpose() * beam, beam),
                    line: Some((r.transpose() * line, line)),
                };
                let found = aim(chain, &aim_);
                let made = |set: &Vec<f64>| {
                    set.iter().zip(angles).all(|(a, b)| {
                        let d = (a - b) / 360.0;
                        (d - d.round()).abs() < 1e-7
                    })
                };
                assert!(
                    found.singular || found.branches.iter().any(made),
                    "chain {c}: {angles:?} not in {:?}",
                    found.branches
                );
                assert!(found.branches.len() <= 2);
            }
        }
    }

    /// Angles of a search that knows no geometry: Newton's steps from a raster of starts, each different end once.
    fn searched(turns: &[ChainRotation], aim: &Aim) -> Vec<Vec<f64>> {
        let pairs: Vec<_> = std::iter::once(aim.beam).chain(aim.line).collect();
        let miss = |angles: &[f64; 3]| {
            let mut rest = SVector::<f64, 6>::zeros();
            for (k, (from, to)) in pairs.iter().enumerate() {
                let v = turns
                    .iter()
                    .zip(angles)
                    .rev()
                    .fold(*from, |v, (t, a)| turn(&t.direction, *a) * v);
                rest.fixed_rows_mut::<3>(3 * k).copy_from(&(v - to));
            }
            rest
        };
        let (n, starts) = (turns.len(), 9_usize);
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for number in 0..starts.pow(n as u32) {
            let mut angles = [0.0; 3];
            for (k, angle) in angles.iter_mut().enumerate().take(n) {
                *angle = (number / starts.pow(k as u32) % starts) as f64 * 0.7 - 3.1;
            }
            for _ in 0..40 {
                let here = miss(&angles);
                let mut slopes = SMatrix::<f64, 6, 3>::zeros();
                for k in 0..n {
                    let (mut up, mut down) = (angles, angles);
                    up[k] += 1e-6;
                    down[k] -= 1e-6;
                    slopes.set_column(k, &((miss(&up) - miss(&down)) / 2e-6));
                }
                let normal = slopes.tr_mul(&slopes) + Matrix3::identity() * 1e-12;
                let Some(step) = normal.lu().solve(&slopes.tr_mul(&here)) else {
                    break;
                };
                let short = 1.0 / (step.amax() / 0.6).max(1.0);
                for k in 0..n {
                    angles[k] -= step[k] * short;
                }
                if step.amax() < 1e-13 {
                    break;
                }
            }
            if miss(&angles).norm() < 1e-10 {
                ends.push(
                    angles[..n]
                        .iter()
                        .map(|a| a.to_degrees() - 360.0 * (a.to_degrees() / 360.0).round())
                        .collect(),
                );
            }
        }
        drop_repeated(&mut ends);
        ends
    }

    /// As many branches as a search finds, and the same; away from poles, where there are endless ones.
    #[test]
    fn a_search_finds_no_branch_that_is_missing() {
        let mut state = 17_u64;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
        };
        let mut counts = [0; 5];
        for case in 0..60 {
            let mut direction = || axis(random(), random(), random());
            let turns = match case % 4 {
                0 => vec![
                    axis(0.0, 0.0, -1.0),
                    axis(1.0, 0.0, 0.0),
                    axis(0.0, 0.0, 1.0),
                ],
                1 => vec![axis(0.0, 1.0, 1.0), axis(0.0, 0.0, 1.0)],
                2 => vec![direction(), direction(), direction()],
                _ => vec![direction(), direction()],
            };
            let unit = |v: Vector3<f64>| v.normalize();
            let beam = unit(Vector3::new(random(), random(), random()));
            let across = unit(beam.cross(&Vector3::new(random(), random(), random())));
            // Half of the aims are made by angles, so that they can be reached.
            let r = turns.iter().fold(Matrix3::identity(), |r, t| {
                r * turn(&t.direction, random() * 3.0)
            });
            let reached = case % 3 > 0;
            let from =
                |v: Vector3<f64>, w: Vector3<f64>| if reached { r.transpose() * v } else { w };
            let other = unit(Vector3::new(random(), random(), random()));
            let other_across = unit(other.cross(&Vector3::new(random(), random(), random())));
            let aim_ = Aim {
                beam: (from(beam, other), beam),
                line: (turns.len() > 2).then(|| (from(across, other_across), across)),
            };
            let (ours, wanted) = (aim(&turns, &aim_), searched(&turns, &aim_));
            assert!(!ours.singular);
            assert_eq!(
                ours.branches.len(),
                wanted.len(),
                "case {case}: {ours:?} {wanted:?}"
            );
            let mut both = ours.branches.clone();
            both.extend(wanted.iter().cloned());
            drop_repeated(&mut both);
            assert_eq!(both.len(), wanted.len(), "case {case}: {ours:?} {wanted:?}");
            counts[wanted.len()] += 1;
        }
        assert!(counts[0] > 3 && counts[2] > 20, "{counts:?}");
    }

    #[test]
    fn a_pole_is_named_and_its_free_axis_stands_at_zero() {
        let chain = [
            axis(0.0, 0.0, -1.0),
            axis(1.0, 0.0, 0.0),
            axis(0.0, 0.0, 1.0),
        ];
        let beam = -Vector3::z();
        let turned = turn(&Vector3::z(), 0.7) * Vector3::y();
        let found = aim(
            &chain,
            &Aim {
                beam: (beam, beam),
                line: Some((turned, Vector3::y())),
            },
        );
        assert!(found.singular);
        assert!(found.branches[0][2].abs() < 1e-12, "{:?}", found.branches);
        assert!((found.branches[0][0].abs() - 0.7_f64.to_degrees()).abs() < 1e-9);
    }

    /// Two axes along one line share an angle: neither alone has room for it, and zero is not allowed to either.
    /// Where the cosine is flat it has lost half of the digits of the angle; the direction has not.
    #[test]
    fn a_pole_is_reached_to_the_last_digits() {
        let k1 = Vector3::new(0.3, -0.2, 1.0).normalize();
        let k2 = Vector3::new(0.1, 0.9, -0.3).normalize();
        for step in 0..1000 {
            let angle = f64::from(step) * 0.006_283 - 3.1;
            let u = turn(&k2, -angle) * k1;
            let (found, singular) = two(&k1, &k2, &u, &k1);
            assert!(singular && !found.is_empty(), "{angle}");
            for [a, b] in found {
                let off = turn(&k1, a) * turn(&k2, b) * u - k1;
                assert!(off.norm() < 1e-12, "{angle}: {:e}", off.norm());
            }
        }
    }

    #[test]
    fn a_pole_that_needs_both_axes_is_reached_within_their_limits() {
        let (beam, line) = (-Vector3::z(), Vector3::y());
        let limited = |x: f64, y: f64, z: f64, limits_deg: [f64; 2]| ChainRotation {
            limits_deg,
            ..axis(x, y, z)
        };
        let chains = [
            // Spindle and table about one line, with and without a tilt between.
            vec![
                limited(0.0, 0.0, -1.0, [-40.0, 40.0]),
                limited(0.0, 0.0, 1.0, [-50.0, 60.0]),
            ],
            vec![
                limited(0.0, 0.0, -1.0, [-40.0, 40.0]),
                limited(1.0, 0.0, 0.0, [-90.0, 90.0]),
                limited(0.0, 0.0, 1.0, [10.0, 60.0]),
            ],
            vec![
                limited(1.0, 0.0, 0.0, [-90.0, 90.0]),
                limited(0.0, 0.0, -1.0, [-40.0, 40.0]),
                limited(0.0, 0.0, 1.0, [-50.0, 60.0]),
            ],
        ];
        for chain in chains {
            // The spindle's rotation is counted the other way.
            let made: Vec<f64> = chain
                .iter()
                .map(|t| match t.direction.z {
                    z if z < -0.5 => -38.0,
                    z if z > 0.5 => 55.0,
                    _ => 0.0,
                })
                .collect();
            let r = chain
                .iter()
                .zip(&made)
                .fold(Matrix3::identity(), |r, (t, a)| {
                    r * turn(&t.direction, f64::to_radians(*a))
                });
            let aim_ = Aim {
                beam: (r.transpose() * beam, beam),
                line: Some((r.transpose() * line, line)),
            };
            let found = aim(&chain, &aim_);
            assert!(found.singular, "{chain:?}");
            let first = &found.branches[0];
            for (a, t) in first.iter().zip(&chain) {
                assert!(nearest_turn(*a, t.limits_deg, 0.0).is_some(), "{found:?}");
            }
            let back = chain
                .iter()
                .zip(first)
                .fold(Matrix3::identity(), |r, (t, a)| {
                    r * turn(&t.direction, a.to_radians())
                });
            assert!((back - r).amax() < 1e-9);
        }
    }

    #[test]
    fn whole_turns_go_to_the_nearest_one_inside() {
        assert_eq!(nearest_turn(170.0, [-200.0, 0.0], 0.0), Some(-190.0));
        assert_eq!(nearest_turn(170.0, [-100.0, 100.0], 0.0), None);
        assert_eq!(nearest_turn(-350.0, [-360.0, 360.0], 0.0), Some(10.0));
        assert_eq!(nearest_turn(10.0, [-360.0, 360.0], -300.0), Some(-350.0));
    }
}
