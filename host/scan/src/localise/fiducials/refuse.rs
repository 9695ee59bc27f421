//! The search for the scanner's pose, and why there is none.

use serde_json::{Value, json};

use super::super::search::scene;
use super::super::verdict::symmetry;
use super::adjust::{Seen, Stray};
use super::features::Feature;
use super::matching::{Match, Matching, Tolerance};
use super::meshes::sides::Meeting;
use super::own::{Own, margin};
use super::{FiducialTask, Searched, Sought};
use crate::ScanError;
use crate::rigid::{Pose, Vec3};

/// How near features must be to where they should be to be taken for a fiducial.
const TIGHT: Tolerance = Tolerance {
    mm: 1.0,
    of_distance: 0.003,
};
/// Something of the right shape within this many mm of a fiducial's place is that fiducial, moved.
const MOVED_MM: f64 = 25.0;
const LOOSE: Tolerance = Tolerance {
    mm: MOVED_MM,
    of_distance: 0.0,
};
/// Matches that are tried with the points themselves.
const TRIED: usize = 24;
/// A mirror image, or another pose, that shows this many times the points is rather the right one.
const FAR_MORE: f64 = 1.3;

/// A side counts if it is this share of the body's surface, and has so many times as many points on it as beside it.
const SIDE_SHOWN: f64 = 0.2;
const SIDE_BESIDE: usize = 10;

/// A smaller turn of a fiducial is not told: 1 micrometre over 50 mm.
const TURNED_RAD: f64 = 2e-5;

/// What others say of a side holds to so many standard deviations.
const SURELY: f64 = 4.0;

/// A match tried with the points.
struct Tried {
    seen: Seen,
    points: usize,
    /// Of fiducials that are not at their place: the feature near it, and how far from it, in mm.
    near: Vec<(usize, Vec3)>,
    /// Fiducials that something looks like, elsewhere.
    elsewhere: Vec<usize>,
    /// Whether nothing moves freely.
    held: bool,
    /// Those that disagree with the others.
    strays: Vec<Stray>,
    /// How the sides of all bodies meet.
    meeting: Meeting,
}

impl Tried {
    /// Fiducials that agree: one at least, of two that disagree too.
    fn agreeing(&self) -> usize {
        agreeing(&self.seen, &self.strays)
    }

    /// What speaks for it, the most important first.
    fn worth(&self) -> (bool, usize, bool, bool, usize) {
        // One that stands near its place and disagrees speaks for the pose too, half as much: by a wrong pose it would
        // not stand there at all.
        let standing = self.seen.own.len() + self.agreeing();
        let agrees = self.strays.is_empty();
        // What leaves a motion free and explains more is right rather than one body that was read from other faces.
        (
            self.held || agrees,
            standing,
            agrees,
            self.meeting != Meeting::Gaping,
            self.points,
        )
    }
}

/// What speaks for a pose, or for the best one of those that were refused.
#[derive(Clone, Copy, Debug, Default)]
struct Evidence {
    /// Fiducials that agree.
    agreeing: usize,
    /// The points on all of them.
    points: usize,
}

/// How many of those seen agree with each other.
fn agreeing(seen: &Seen, strays: &[Stray]) -> usize {
    seen.own.len().saturating_sub(strays.len()).max(1)
}

/// The pose that the scan stands for.
pub(super) fn search(task: &FiducialTask<'_>) -> Result<Searched, ScanError> {
    let sought = Sought::new(task);
    let (here, result) = direct(&sought);
    // The faces of a box and its mirror image are the same: only how many of them are where they should be differs.
    let is_body = |f: &super::Fiducial| matches!(f.shape, super::FiducialShape::Mesh(_));
    let bodies = task.fiducials.iter().any(is_body);
    match &result {
        Ok(found) if !found.elsewhere && !bodies => {}
        Ok(_) => mirrored(task, here)?,
        Err(error) if ["fiducials_disagree", "ambiguous"].contains(&error.code) => {
            mirrored(task, here)?;
        }
        Err(error) if error.code == "no_fiducial" => {
            mirrored(task, Evidence::default())?;
            other_unit(task)?;
        }
        Err(_) => {}
    }
    result
}

/// What speaks for a pose in other points than those of the scan; nothing if there is none.
fn evidence(task: &FiducialTask<'_>, points: &[Vec3]) -> Evidence {
    let task = FiducialTask {
        points,
        ..task.clone()
    };
    let (evidence, result) = direct(&Sought::new(&task));
    match result {
        Ok(found) if found.held => evidence,
        _ => Evidence::default(),
    }
}

/// Refuses if the mirror image of the scan shows more than is seen `here`: more fiducials, or as many and far more of them.
fn mirrored(task: &FiducialTask<'_>, here: Evidence) -> Result<(), ScanError> {
    let mirrored: Vec<Vec3> = task
        .points
        .iter()
        .map(|p| Vec3::new(-p.x, p.y, p.z))
        .collect();
    let there = evidence(task, &mirrored);
    let share = there.points as f64 / here.points.max(1) as f64;
    if there.agreeing > here.agreeing && share > 0.9
        || there.agreeing == here.agreeing && share > FAR_MORE
    {
        return Err(ScanError::refused(
            "mirrored",
            "the fiducials fit the mirror image of the scan: an axis of the scanner has its sign lost, or the file of fiducials does",
        ));
    }
    Ok(())
}

/// Refuses if the scan shows the fiducials in another unit.
fn other_unit(task: &FiducialTask<'_>) -> Result<(), ScanError> {
    let marks: Vec<Vec3> = task
        .fiducials
        .iter()
        .flat_map(|f| f.shape.landmarks().into_iter().map(|p| f.pose.point(&p)))
        .collect();
    let span = |all: &[Vec3]| {
        let (low, high) = crate::surface::bounds(all.iter());
        (high - low).norm()
    };
    let (size, scan) = (span(&marks), span(task.points));
    for (factor, name) in super::super::verdict::UNITS {
        if !(0.5..50.0).contains(&(scan * factor / size.max(1e-9))) {
            continue;
        }
        let points: Vec<Vec3> = task.points.iter().map(|p| p * factor).collect();
        if evidence(task, &points).agreeing > 0 {
            let mut error = super::super::verdict::wrong_scale(factor, name);
            error.message.push_str(
                ". Where the scan is in mm, the file of fiducials is not: its positions and sizes are in mm",
            );
            return Err(error);
        }
    }
    Ok(())
}

/// The pose by the scan as it is, with what speaks for the best one.
fn direct(sought: &Sought<'_>) -> (Evidence, Result<Searched, ScanError>) {
    let features = sought.features();
    let matching = Matching::new(sought, &features, TIGHT);
    let mut tried: Vec<Tried> = matching
        .all_with_bodies()
        .iter()
        .take(TRIED)
        .filter_map(|m| attempt(sought, &features, &matching, m))
        .collect();
    tried.sort_by_key(|t| std::cmp::Reverse(t.worth()));
    let mut evidence = tried.first().map_or_else(Evidence::default, |t| Evidence {
        agreeing: t.agreeing(),
        points: t.points,
    });
    let result = judged(sought, &features, &tried, &mut evidence);
    (evidence, result)
}

fn judged(
    sought: &Sought<'_>,
    features: &[Feature],
    tried: &[Tried],
    evidence: &mut Evidence,
) -> Result<Searched, ScanError> {
    let mut loose = |least: usize| {
        let matching = Matching::new(sought, features, LOOSE);
        let found = matching.all().into_iter().find(|m| m.pairs.len() > least);
        found.map(|m| loosely(sought, features, &m, evidence))
    };
    let Some(best) = tried.first() else {
        return Err(match loose(1) {
            Some(error) => error,
            None => nothing(sought, features),
        });
    };
    // Where one has moved, the right pose disagrees, and shows far more than one that agrees by other faces.
    let disagrees = |t: &&Tried| {
        t.seen.own.len() >= best.seen.own.len() && !t.strays.is_empty() && shows_more(t, best)
    };
    if let Some(t) = Some(best)
        .filter(|t| !t.strays.is_empty())
        .or(tried.iter().find(disagrees))
    {
        return Err(disagree(sought.task, &t.strays));
    }
    if !best.near.is_empty() {
        let strays: Vec<Stray> = best
            .near
            .iter()
            .map(|(fiducial, off_mm)| Stray {
                fiducial: *fiducial,
                off_mm: *off_mm,
                turned_rad: 0.0,
            })
            .collect();
        return Err(disagree(sought.task, &strays));
    }
    if !best.held {
        return match loose(best.seen.own.len()) {
            Some(error) => Err(error),
            // The fit itself says what is free.
            None => Ok(found(best, Vec::new())),
        };
    }
    alone(sought, tried)?;
    let found = only_one(sought, tried)?;
    hangs_on_no_side(sought, best)?;
    Ok(found)
}

/// Whether one match shows so many more points than another one that this cannot be believed beside it.
fn shows_more(t: &Tried, than: &Tried) -> bool {
    t.points as f64 > FAR_MORE * than.points as f64
}

/// Refuses where several bodies hold the pose together and it hangs on one side of one that need not be this side: a wall's
/// other face looks the same. It is the side if it meets its neighbour, or if the others say that it lies there.
fn hangs_on_no_side(sought: &Sought<'_>, best: &Tried) -> Result<(), ScanError> {
    if best.seen.own.len() < 2 {
        return Ok(());
    }
    for (k, (f, own)) in best.seen.own.iter().enumerate() {
        let Some(sides) = &sought.sides[*f] else {
            continue;
        };
        // By one side alone the fit does not go.
        if !own.holds(&sought.task.fiducials[*f].shape) {
            continue;
        }
        let meet = sought.meet(*f, own);
        for side in 0..sides.count() {
            let its = || {
                meet.iter()
                    .filter(|(pair, _)| pair.contains(&side))
                    .map(|m| m.1)
            };
            let closed = its().any(|m| m == Meeting::Closed);
            if closed && its().all(|m| m != Meeting::Gaping) {
                continue;
            }
            let these: Vec<usize> = (0..own.on.len())
                .filter(|&i| sides.of(own.on[i].1.face) == Some(side))
                .collect();
            let u = best.seen.told_by_others(sought.task, k, &these);
            if SURELY * u > TIGHT.mm {
                let name = &sought.task.fiducials[*f].name;
                return Err(symmetry::ambiguous(
                    &[],
                    &[best.seen.machine.inverse()],
                    &format!(
                        "the pose hangs on one side of {name}, and the scan does not show that it meets the next one: the other \
                         face of a wall would look the same"
                    ),
                    "scan more densely, or so that a third side is seen",
                ));
            }
        }
    }
    Ok(())
}

fn found(best: &Tried, symmetries: Vec<super::SymmetryAxis>) -> Searched {
    Searched {
        machine: best.seen.machine,
        symmetries,
        held: best.held,
        elsewhere: !best.elsewhere.is_empty(),
    }
}

/// A match, tried with the points about where it puts each fiducial.
fn attempt(
    sought: &Sought<'_>,
    features: &[Feature],
    matching: &Matching<'_>,
    m: &Match,
) -> Option<Tried> {
    let fiducials = sought.task.fiducials;
    let mut seen = Seen {
        machine: m.machine,
        own: Vec::new(),
    };
    for (f, c) in &m.pairs {
        // What the feature does not hold is as the match has it.
        let there = m.machine.after(&fiducials[*f].pose);
        let start = sought.turned_to(&there, &features[*c], *f);
        if let Some(own) = sought.own(*f, &start, reach(sought, *f)) {
            seen.own.push((*f, own));
        }
    }
    if seen.own.is_empty() {
        return None;
    }
    seen = seen.settled(sought.task);
    let whole = m.pairs.len() == seen.own.len();
    for (f, fiducial) in fiducials.iter().enumerate() {
        if seen.own.iter().any(|(g, _)| *g == f) {
            continue;
        }
        let start = seen.machine.after(&fiducial.pose);
        let own = sought.own(f, &start, reach(sought, f));
        let is_it = |own: &Own| own.holds(&fiducial.shape) || shows_a_side(own, &fiducial.shape);
        if let Some(own) = own.filter(is_it) {
            let middle = fiducial.shape.middle();
            let off = own.motion.point(&middle) - start.point(&middle);
            // A body of which two sides are seen slides along them.
            let slack = match fiducial.shape {
                super::FiducialShape::Mesh(_) => 0.25 * fiducial.shape.size_mm(),
                _ => 2.0 * TIGHT.mm,
            };
            if off.norm() < slack {
                seen.own.push((f, own));
            }
        }
    }
    let held = whole && is_held(&seen, sought);
    if held || seen.own.len() > m.pairs.len() {
        seen = seen.settled(sought.task);
    }
    let (mut near, mut elsewhere) = (Vec::new(), Vec::new());
    for (f, fiducial) in fiducials.iter().enumerate() {
        if seen.own.iter().any(|(g, _)| *g == f) {
            continue;
        }
        let best = (0..features.len())
            .filter(|&c| features[c].class == sought.class[f])
            .filter(|&c| !seen.own.iter().any(|(_, own)| is_it(own, &features[c])))
            .map(|c| (matching.off(&seen.machine, f, c), c))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((off, c)) if held && off < MOVED_MM => {
                let middle = fiducial.shape.middle();
                let place = seen.machine.point(&fiducial.pose.point(&middle));
                let off = features[c].motion.point(&middle) - place;
                near.push((f, seen.machine.rotation.tr_mul(&off)));
            }
            Some(_) => elsewhere.push(f),
            None => {}
        }
    }
    Some(Tried {
        points: seen.own.iter().map(|(_, own)| own.on.len()).sum(),
        strays: seen.strays(sought.task),
        meeting: Meeting::of_all(
            seen.own
                .iter()
                .flat_map(|(f, own)| sought.meet(*f, own))
                .map(|(_, meeting)| meeting),
        ),
        seen,
        near,
        elsewhere,
        held,
    })
}

/// Whether a body shows one side of it, where the others put it. That holds three motions, no place; but it is there, and
/// where a wrong pose puts it there is nothing, or something in another plane: whether it agrees is asked of all alike.
fn shows_a_side(own: &Own, shape: &super::FiducialShape) -> bool {
    let super::FiducialShape::Mesh(mesh) = shape else {
        return false;
    };
    let shown = || {
        let at: Vec<Vec3> = own.on.iter().map(|(q, _)| own.motion.undo(q)).collect();
        scene::coverage(mesh, &at)
    };
    SIDE_BESIDE * own.beside <= own.on.len() && shown() > SIDE_SHOWN
}

/// Whether that is the feature.
fn is_it(own: &super::own::Own, feature: &Feature) -> bool {
    (own.motion.translation_mm - feature.motion.translation_mm).norm() < TIGHT.mm
}

/// How far from its place a fiducial is looked for with the points, in mm.
fn reach(sought: &Sought<'_>, f: usize) -> f64 {
    let size = sought.task.fiducials[f].shape.size_mm();
    (0.06 * size).max(4.0 * sought.noise_mm).max(0.2)
}

impl Sought<'_> {
    /// How the sides of a body meet that its points show.
    fn meet(&self, f: usize, own: &Own) -> Vec<([usize; 2], Meeting)> {
        let size = self.task.fiducials[f].shape.size_mm();
        let margin = margin(self.noise_mm, size);
        let sides = self.sides[f].as_ref();
        sides.map_or_else(Vec::new, |sides| sides.meet(own, margin, size))
    }

    /// The place of a feature; what it does not hold of the fiducial `f` is as `like` has it.
    pub fn turned_to(&self, like: &Pose, feature: &Feature, f: usize) -> Pose {
        use super::FiducialShape::{Ball, Cone, Mesh};
        let at = &feature.motion;
        let rotation = match self.task.fiducials[f].shape {
            Mesh(_) => return feature.own.held_from(like),
            Ball { .. } => like.rotation,
            Cone { .. } => {
                let axis = |pose: &Pose| pose.rotation.column(2).into_owned();
                let (from, to) = (axis(like), axis(at));
                let about = from.cross(&to);
                let angle = about.norm().atan2(from.dot(&to));
                let turn = if about.norm() > 1e-12 {
                    crate::rigid::rotation(&(about * (angle / about.norm())))
                } else {
                    nalgebra::Matrix3::identity()
                };
                turn * like.rotation
            }
        };
        Pose {
            rotation,
            translation_mm: at.translation_mm,
        }
    }
}

/// Whether what was seen holds all six motions.
fn is_held(seen: &Seen, sought: &Sought<'_>) -> bool {
    let marks: Vec<Vec3> = seen
        .own
        .iter()
        .flat_map(|(f, own)| {
            let shape = &sought.task.fiducials[*f].shape;
            // A body of which one side is seen slides along it.
            let whole = own.rank() == 6 || !matches!(shape, super::FiducialShape::Mesh(_));
            let marks = if whole {
                shape.landmarks()
            } else {
                vec![shape.middle()]
            };
            marks.into_iter().map(|p| own.motion.point(&p))
        })
        .collect();
    super::matching::carry(&marks, &marks).1 || seen.rank() == 6
}

/// A pose by one fiducial alone stands only where nothing speaks against it.
fn alone(sought: &Sought<'_>, tried: &[Tried]) -> Result<(), ScanError> {
    let best = &tried[0];
    let [(own, _)] = best.seen.own.as_slice() else {
        return Ok(());
    };
    let others: Vec<usize> = best
        .elsewhere
        .iter()
        .copied()
        .filter(|f| f != own)
        .collect();
    if others.is_empty() {
        return Ok(());
    }
    let strays: Vec<Stray> = others
        .iter()
        .filter_map(|f| {
            let shows = |t: &&Tried| t.held && t.seen.own.iter().any(|(g, _)| g == f);
            let other = tried.iter().find(shows)?;
            let middle = sought.task.fiducials[*f].shape.middle();
            let at = sought.task.fiducials[*f].pose.point(&middle);
            let off = other.seen.machine.point(&at) - best.seen.machine.point(&at);
            Some(Stray {
                fiducial: *f,
                off_mm: best.seen.machine.rotation.tr_mul(&off),
                turned_rad: 0.0,
            })
        })
        .collect();
    if strays.is_empty() {
        return Ok(());
    }
    let mut all = strays;
    all.push(Stray {
        fiducial: *own,
        off_mm: -all[0].off_mm,
        turned_rad: 0.0,
    });
    Err(disagree(sought.task, &all))
}

/// The best if no other pose explains the fiducials as well.
fn only_one(sought: &Sought<'_>, tried: &[Tried]) -> Result<Searched, ScanError> {
    let task = sought.task;
    let best = &tried[0];
    let marks: Vec<Vec3> = task
        .fiducials
        .iter()
        .flat_map(|f| f.shape.landmarks().into_iter().map(|p| f.pose.point(&p)))
        .collect();
    // Where the sides of bodies meet by the best one and do not by another, that has to show more points.
    let share = |t: &Tried| match (best.meeting, t.meeting) {
        (_, Meeting::Gaping) | (Meeting::Closed, Meeting::Unsure) => 1.0,
        _ => 0.7,
    };
    let equal: Vec<Pose> = tried[1..]
        .iter()
        .filter(|t| {
            t.held
                && (t.seen.own.len() == best.seen.own.len()
                    && t.points as f64 > share(t) * best.points as f64
                    || shows_more(t, best))
                && t.strays.is_empty()
                && t.seen.machine.apart_mm(&best.seen.machine, &marks) > 4.0 * TIGHT.mm
        })
        .map(|t| t.seen.machine)
        .collect();
    if equal.is_empty() {
        return Ok(found(best, Vec::new()));
    }
    let turns: Vec<Pose> = equal
        .iter()
        .map(|m| best.seen.machine.inverse().after(m))
        .collect();
    let axes = symmetry::axes(&turns, &marks);
    if task.accept_symmetry {
        return Ok(found(best, axes));
    }
    let poses: Vec<Pose> = std::iter::once(&best.seen.machine)
        .chain(&equal)
        .map(Pose::inverse)
        .collect();
    Err(symmetry::ambiguous(
        &axes,
        &poses,
        "the fiducials fit the scan in several ways",
        "mount them so that no turn carries them onto each other, scan more of them, or say --accept-symmetry",
    ))
}

fn nothing(sought: &Sought<'_>, features: &[Feature]) -> ScanError {
    let names: Vec<&str> = sought
        .task
        .fiducials
        .iter()
        .map(|f| f.name.as_str())
        .collect();
    let names = names.join(", ");
    let is_none = features.is_empty();
    let other = is_none.then(|| sought.other_balls()).flatten();
    let message = match (features.len(), other) {
        (0, Some(balls)) => format!(
            "no ball in the scan has the radius of the fiducials ({names}), {:.3} mm: {} have about {:.3} mm. Measure the balls \
             (half of their diameter) and mend radius_mm, if these are the fiducials; a scanner reads a shiny ball too large",
            balls.stated_mm, balls.count, balls.radius_mm
        ),
        (0, None) => format!(
            "nothing in the scan looks like one of the fiducials ({names}): are they in view, and is this their file?"
        ),
        (count, _) => format!(
            "of what looks like a fiducial in the scan ({count} places) nothing stands as the file has {names}: are they in \
             view, and is this their file?"
        ),
    };
    ScanError::refused("no_fiducial", message)
}

/// Fiducials that are all there, but not where the file has them.
fn loosely(
    sought: &Sought<'_>,
    features: &[Feature],
    m: &Match,
    evidence: &mut Evidence,
) -> ScanError {
    let fiducials = sought.task.fiducials;
    let mut seen = Seen {
        machine: m.machine,
        own: Vec::new(),
    };
    for (f, c) in &m.pairs {
        let like = m.machine.after(&fiducials[*f].pose);
        let start = sought.turned_to(&like, &features[*c], *f);
        if let Some(own) = sought.own(*f, &start, reach(sought, *f)) {
            seen.own.push((*f, own));
        }
    }
    let strays = if seen.own.is_empty() {
        Vec::new()
    } else {
        seen = seen.settled(sought.task);
        seen.strays(sought.task)
    };
    if strays.is_empty() {
        nothing(sought, features)
    } else {
        *evidence = Evidence {
            agreeing: agreeing(&seen, &strays),
            points: seen.own.iter().map(|(_, own)| own.on.len()).sum(),
        };
        disagree(sought.task, &strays)
    }
}

pub(super) fn disagree(task: &FiducialTask<'_>, strays: &[Stray]) -> ScanError {
    let name = |s: &Stray| task.fiducials[s.fiducial].name.clone();
    let words: Vec<String> = strays
        .iter()
        .map(|s| {
            // No minus zero.
            let v = s.off_mm.map(|mm| (mm * 1e3).round() / 1e3 + 0.0);
            let turned = if s.turned_rad > TURNED_RAD {
                format!(", and turned by {:.3} degrees", s.turned_rad.to_degrees())
            } else {
                String::new()
            };
            format!(
                "{} is {:.3} mm from where the others put it (X {:+.3}, Y {:+.3}, Z {:+.3}){turned}",
                name(s),
                s.off_mm.norm(),
                v.x,
                v.y,
                v.z
            )
        })
        .collect();
    let list: Vec<Value> = strays
        .iter()
        .map(|s| {
            json!({
                "name": name(s),
                "off_mm": s.off_mm.norm(),
                "vector_mm": s.off_mm.as_slice(),
                "turned_rad": s.turned_rad,
            })
        })
        .collect();
    ScanError::refused(
        "fiducials_disagree",
        format_args!(
            "the fiducials do not stand to each other as their file has it: {}; measure them anew, or take out of the file what has moved",
            words.join("; ")
        ),
    )
    .with("fiducials", list)
}
