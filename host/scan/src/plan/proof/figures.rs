//! Figures of a path as it stands in its file.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;
use serde::Serialize;

use super::super::drive::deadline::Deadline;
use super::super::drive::realise::Pass;
use super::super::drive::touch::Scenery;
use super::super::machine::SensorPose;
use super::super::mesh::PartMesh;
use super::super::spec::ScanSpec;
use super::cells::Cells;
use super::samples::{SAMPLES, SamplePoint, samples};
use super::see::{Eye, SampleSights, Sight, SightDepth};
use crate::parallel::Threads;

/// Overlap of neighbouring passes as a share of the line's length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Overlap {
    /// The least of all stretches that enough points tell of (a tenth of all, where there is none).
    pub min: f64,
    /// A tenth of the stretches have less.
    pub tenth: f64,
    /// The middle of all stretches.
    pub median: f64,
}

/// Points in a stretch from which its width follows, whatever lies between them.
const TELLING: usize = 8;

/// Points on a part of which overlap is told, at least.
const OVERLAP_POINTS: usize = 40_000;

/// The overlap of a finished path, and whether that is enough.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JudgedOverlap {
    /// What is wanted.
    pub wanted: f64,
    /// The least of all stretches that enough points tell of; 0 where strips lie side by side without any.
    pub min: f64,
    /// A tenth of the stretches have less: this is judged.
    pub tenth: f64,
    /// The middle of all stretches.
    pub median: f64,
    /// By how much the points can tell less than there is.
    pub resolution: f64,
}

impl JudgedOverlap {
    /// Is it as wide as wanted, as far as the points can tell?
    pub fn holds(&self) -> bool {
        self.tenth >= self.wanted - self.resolution
    }

    /// What a user should know of strips that hold by their tenth and overlap less somewhere.
    pub fn warning(&self) -> Option<String> {
        (self.holds() && self.min < self.wanted - self.resolution).then(|| {
            format!(
                "Somewhere neighbouring strips overlap by {:.3} of the line only; {} is wanted. They are judged by the tenth of their length that overlaps least, which has {:.3}.",
                self.min, self.wanted, self.tenth
            )
        })
    }
}

/// Points by which overlap is judged: more than the coverage of a small part needs.
///
/// The same strips are looked at once more by few points, as many as a judge who has no more would take. Short stretches are
/// told by a handful of those, and by their outermost ones alone: a tenth told by one set of points is off by a hundredth
/// or two of the line on a small ball. What holds, holds by both.
pub struct OverlapPoints {
    fine: Spread,
    coarse: Spread,
}

/// Points spread evenly, and how far apart they lie.
struct Spread {
    points: Vec<SamplePoint>,
    apart_mm: f64,
}

impl Spread {
    fn new(part: &PartMesh, count: usize) -> Self {
        let points = samples(part, count);
        Spread {
            apart_mm: (part.surface.area_mm2() / points.len() as f64).sqrt(),
            points,
        }
    }

    fn on(&self, faces: &HashSet<u32>) -> Self {
        let points = self.points.iter().copied();
        Spread {
            points: points.filter(|p| faces.contains(&p.face)).collect(),
            apart_mm: self.apart_mm,
        }
    }
}

impl OverlapPoints {
    /// Points on the whole part.
    pub fn new(part: &PartMesh) -> Self {
        OverlapPoints {
            fine: Spread::new(part, OVERLAP_POINTS),
            coarse: Spread::new(part, SAMPLES),
        }
    }

    /// Those of them that lie on certain triangles.
    pub fn on(&self, faces: &HashSet<u32>) -> Self {
        OverlapPoints {
            fine: self.fine.on(faces),
            coarse: self.coarse.on(faces),
        }
    }

    /// The overlap of a path. Strips without any count: where what a pass sees ends on the surface, another pass sees what
    /// lies beyond that end, and both see nothing in common. None where no pass has a neighbour. A late answer is short, as
    /// that of [`overlap`].
    ///
    /// Its tenth is the lesser one of two: of all stretches, and of those alone where a neighbour reaches the end of a whole
    /// line. On a small ball every strip ends early, by incidence; many wide
    /// overlaps there would hide the narrow ones beside them.
    pub fn judge(
        &self,
        spec: &ScanSpec,
        scenery: &Scenery<'_>,
        passes: &[&Pass],
        deadline: Deadline,
    ) -> Option<JudgedOverlap> {
        let (mut judged, _) = self.fine.judge(spec, scenery, passes, deadline)?;
        if !judged.holds() {
            return Some(judged);
        }
        // These points may tell as much less as lies between two of them at either edge of a strip.
        if let Some((_, Some(at_ends))) = self.coarse.judge(spec, scenery, passes, deadline) {
            let may = RESOLUTION * self.coarse.apart_mm / spec.sensor.line_mm - judged.resolution;
            judged.tenth = judged.tenth.min(at_ends + may);
        }
        Some(judged)
    }
}

impl Spread {
    /// The overlap by these points, and its tenth of those stretches alone where a neighbour reaches the end of a whole line.
    fn judge(
        &self,
        spec: &ScanSpec,
        scenery: &Scenery<'_>,
        passes: &[&Pass],
        deadline: Deadline,
    ) -> Option<(JudgedOverlap, Option<f64>)> {
        let eye = Eye::new(&spec.sensor, scenery, &self.points);
        let seen = eye.see(passes, SightDepth::Range, Threads::all());
        let ends = strip_ends(spec, passes, &self.points, &seen, self.apart_mm);
        let mut widths = widths(spec, passes, &seen, &ends, deadline);
        for stretch in bare(spec, passes, &self.points, &seen, &ends, self.apart_mm) {
            widths.entry(stretch).or_insert([0.0, 0.0, NONE]);
        }
        let bare = widths.values().any(|w| w[0] == 0.0);
        let at_ends = tenth_of(
            widths
                .values()
                .map(|w| w[2])
                .filter(|w| *w >= 0.0)
                .collect(),
        );
        let Overlap { min, tenth, median } = told(widths)?;
        let judged = JudgedOverlap {
            wanted: spec.plan.overlap,
            min: if bare { 0.0 } else { min },
            tenth: at_ends.map_or(tenth, |at_ends| at_ends.min(tenth)),
            median,
            resolution: overlap_resolution(spec, self.apart_mm * self.apart_mm),
        };
        Some((judged, at_ends))
    }
}

/// Points so far from the middle towards the end of a whole line, as a share of half of it, lie at that end.
const AT_END: f64 = 0.9;

/// Strips with a gap between them are neighbours up to this share of the line; a wider gap is seen in the coverage.
const GAP: f64 = 0.1;

/// Stretches at whose end of the line the neighbour's strip begins without a point in common.
fn bare(
    spec: &ScanSpec,
    passes: &[&Pass],
    points: &[SamplePoint],
    seen: &SampleSights,
    ends: &HashMap<StretchEnd, StripEnd>,
    apart_mm: f64,
) -> HashSet<StretchEnd> {
    let ways = ways(spec, passes);
    let places: Vec<Vector3<f64>> = points.iter().map(|p| p.at).collect();
    // As wide as an end counts, a narrow gap, and on to the next points.
    let near_mm = (0.5 * (1.0 - AT_END) + GAP) * spec.sensor.line_mm + 2.0 * apart_mm;
    let cells = Cells::new(&places, near_mm);
    // A corner of a strip is no stretch of it: a part of the points that lie at its end must say so.
    let at_end = STRETCH_MM * 0.5 * (1.0 - AT_END) * spec.sensor.line_mm / apart_mm.powi(2);
    let needed = |pass: u32| {
        let way = &ways[pass as usize];
        let length = way.last().zip(way.first()).map_or(0.0, |(b, a)| b - a);
        (0.25 * at_end * (length / STRETCH_MM).min(1.0)).clamp(1.0, 1e6) as usize
    };
    let mut found: HashMap<StretchEnd, usize> = HashMap::new();
    for (point, sights) in points.iter().zip(&seen.sights) {
        let [only] = sights.as_slice() else { continue };
        let stretch = stretch(&ways, only);
        let at_end = ends
            .get(&stretch)
            .is_some_and(|end| end.has(only.lateral.abs()));
        if !at_end || found.get(&stretch).is_some_and(|n| *n >= needed(only.pass)) {
            continue;
        }
        let pose = &passes[only.pass as usize].poses[only.step as usize];
        let outwards = pose.line * only.lateral.signum();
        let beyond = |k: usize| {
            let d = places[k] - point.at;
            let others = &seen.sights[k];
            d.norm() < near_mm
                && d.dot(&outwards) > 0.0
                && d.dot(&pose.feed()).abs() < 2.0 * apart_mm
                && points[k].normal.dot(&point.normal) > SAME_SIDE
                && !others.is_empty()
                && others.iter().all(|s| s.pass != only.pass)
        };
        if cells.any_near(&point.at, near_mm, beyond) {
            *found.entry(stretch).or_insert(0) += 1;
        }
    }
    found
        .into_iter()
        .filter(|(stretch, count)| *count >= needed(stretch.0))
        .map(|(stretch, _)| stretch)
        .collect()
}

/// Normals within this of each other (a cosine) belong to one side of the part: beyond a sharp edge a strip may begin anew.
const SAME_SIDE: f64 = 0.9;

/// Of the distance of points: they tell an overlap by so much too small at both its edges.
const RESOLUTION: f64 = 1.2;

/// The share of that which a plan is allowed: its own points are spread evenly.
const SHARE: f64 = 0.6;

/// By how much of the line an overlap may be told less than wanted, where points of this area stand for the surface.
pub fn overlap_resolution(spec: &ScanSpec, per_sample_mm2: f64) -> f64 {
    SHARE * RESOLUTION * per_sample_mm2.sqrt() / spec.sensor.line_mm
}

/// Overlap is told in stretches so long.
const STRETCH_MM: f64 = 10.0;

/// A stretch of a pass, and the line's end there.
type StretchEnd = (u32, u64, bool);

/// Way of each pose, on and on over all passes.
fn ways(spec: &ScanSpec, passes: &[&Pass]) -> Vec<Vec<f64>> {
    let tip = |p: &SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
    let mut way = 0.0;
    let of_pass = |pass: &&Pass| {
        let steps = (0..pass.poses.len()).map(|k| {
            if k > 0 {
                way += (tip(&pass.poses[k]) - tip(&pass.poses[k - 1])).norm();
            }
            way
        });
        steps.collect()
    };
    passes.iter().map(of_pass).collect()
}

fn stretch(ways: &[Vec<f64>], sight: &Sight) -> StretchEnd {
    let way = ways[sight.pass as usize][sight.step as usize];
    (sight.pass, (way / STRETCH_MM) as u64, sight.lateral > 0.0)
}

/// Where a strip ends in a stretch.
#[derive(Debug, Clone, Copy)]
struct StripEnd {
    /// The outermost place that its pass sees, from 0 at the line's middle to 1 at its end.
    edge: f64,
    /// Range, incidence or a shadow end it before the line does: the surface goes on.
    cut: bool,
}

impl StripEnd {
    /// Does a place lie at this end?
    fn has(&self, towards: f64) -> bool {
        towards >= self.least(AT_END)
    }

    /// A neighbour's points must reach this place to lie at this end; `whole` where the line is seen to its end.
    fn least(&self, whole: f64) -> f64 {
        if self.cut {
            whole.min(self.edge - (1.0 - whole))
        } else {
            whole
        }
    }
}

/// Where the strips of all passes end.
fn strip_ends(
    spec: &ScanSpec,
    passes: &[&Pass],
    points: &[SamplePoint],
    seen: &SampleSights,
    apart_mm: f64,
) -> HashMap<StretchEnd, StripEnd> {
    let ways = ways(spec, passes);
    let mut ends: HashMap<StretchEnd, StripEnd> = HashMap::new();
    for sight in seen.sights.iter().flatten() {
        let edge = sight.lateral.abs();
        let end = ends.entry(stretch(&ways, sight));
        let end = end.or_insert(StripEnd { edge, cut: false });
        end.edge = end.edge.max(edge);
    }
    if ends.values().all(|end| end.edge >= AT_END) {
        return ends;
    }
    let places: Vec<Vector3<f64>> = points.iter().map(|p| p.at).collect();
    // The outermost two rows of points or so, and as many behind them.
    let band = 2.0 * apart_mm / (0.5 * spec.sensor.line_mm);
    let near_mm = 4.0 * apart_mm;
    let cells = Cells::new(&places, near_mm);
    // Points at an early end, and those behind which the surface goes on that this pass does not see.
    let mut counts: HashMap<StretchEnd, [usize; 2]> = HashMap::new();
    for (point, sights) in points.iter().zip(&seen.sights) {
        for sight in sights {
            let stretch = stretch(&ways, sight);
            let edge = ends[&stretch].edge;
            if edge >= AT_END || sight.lateral.abs() < edge - band {
                continue;
            }
            let pose = &passes[sight.pass as usize].poses[sight.step as usize];
            let outwards = pose.line * sight.lateral.signum();
            let on = cells.any_near(&point.at, near_mm, |k| {
                let d = places[k] - point.at;
                d.norm() < near_mm
                    && d.dot(&outwards) > 2.0 * d.dot(&pose.feed()).abs()
                    && points[k].normal.dot(&point.normal) > SAME_SIDE
                    && seen.sights[k].iter().all(|s| s.pass != sight.pass)
            });
            let [all, going_on] = counts.entry(stretch).or_default();
            *all += 1;
            *going_on += usize::from(on);
        }
    }
    for (stretch, [all, going_on]) in counts {
        if let Some(end) = ends.get_mut(&stretch) {
            end.cut = 2 * going_on > all;
        }
    }
    ends
}

/// The overlap in stretches of 10 mm at each end of the line; none where no two passes see a point in common.
///
/// Where another pass sees the strip's edge too, the strip that both see is as wide as the points there lie apart.
/// Once the time is up it tells of some passes only: whoever asks looks at the time.
pub fn overlap(
    spec: &ScanSpec,
    passes: &[&Pass],
    points: &[SamplePoint],
    seen: &SampleSights,
    apart_mm: f64,
    deadline: Deadline,
) -> Option<Overlap> {
    let ends = strip_ends(spec, passes, points, seen, apart_mm);
    told(widths(spec, passes, seen, &ends, deadline))
}

/// The share of the line that passes see, where range or incidence end their strips before the line does: a tenth of the
/// ends lie nearer to its middle. The part's own border ends no strip early.
pub fn seen_share(
    spec: &ScanSpec,
    passes: &[&Pass],
    points: &[SamplePoint],
    seen: &SampleSights,
    apart_mm: f64,
) -> f64 {
    let ends = strip_ends(spec, passes, points, seen, apart_mm).into_values();
    let mut edges: Vec<f64> = ends.map(|e| if e.cut { e.edge } else { 1.0 }).collect();
    edges.sort_by(f64::total_cmp);
    edges.get(edges.len() / 10).map_or(1.0, |e| e.max(0.1))
}

/// A neighbour's strip that reaches beyond the line's middle ends where its points leave a gap of this share of half the line:
/// what lies behind it belongs to the line's other end.
const STRIP_GAP: f64 = 0.3;

/// A neighbour's points reach the end of a whole line from this place on.
const AT_NEIGHBOUR: f64 = 0.7;

/// No neighbour reaches the end of a whole line.
const NONE: f64 = -1.0;

/// Of each stretch the overlap that its points span, the same with what lies between the points (0 of few points), and
/// the first alone where a neighbour reaches the end of a whole line (else below 0).
fn widths(
    spec: &ScanSpec,
    passes: &[&Pass],
    seen: &SampleSights,
    ends: &HashMap<StretchEnd, StripEnd>,
    deadline: Deadline,
) -> HashMap<StretchEnd, [f64; 3]> {
    let ways = ways(spec, passes);
    let mut by_pass: Vec<Vec<(u32, Sight)>> = vec![Vec::new(); passes.len()];
    for (point, sights) in seen.sights.iter().enumerate() {
        for a in sights {
            by_pass[a.pass as usize].push((point as u32, *a));
        }
    }
    // Pass by pass: all pairs of sights at once would be as many as the square of the passes.
    let found = Threads::all().chunks(by_pass.len(), 1, |range| {
        let mine = &by_pass[range.start];
        let mut widths: Vec<(StretchEnd, [f64; 3])> = Vec::new();
        if !deadline.more() {
            return widths;
        }
        // By stretch and neighbour: places of the points that both see, from the line's middle towards that end.
        let mut bins: HashMap<(StretchEnd, u32), Vec<f64>> = HashMap::new();
        for (point, a) in mine {
            let (pass, at, _) = stretch(&ways, a);
            let sights = &seen.sights[*point as usize];
            for b in sights.iter().filter(|b| b.pass != a.pass) {
                for (side, towards) in [(true, a.lateral), (false, -a.lateral)] {
                    let bin = bins.entry(((pass, at, side), b.pass));
                    bin.or_default().push(towards);
                }
            }
        }
        for ((stretch, _), mut places) in bins {
            let edge = places.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let least = ends
                .get(&stretch)
                .map_or(AT_NEIGHBOUR, |end| end.least(AT_NEIGHBOUR));
            if edge <= least {
                continue;
            }
            places.sort_unstable_by(|a, b| b.total_cmp(a));
            let apart = places
                .windows(2)
                .position(|p| p[1] < 0.0 && p[0] - p[1] > STRIP_GAP);
            let joined = apart.map_or(places.len(), |k| k + 1);
            if joined < 3 {
                continue;
            }
            let count = joined as f64;
            let width = (edge - places[joined - 1]) / 2.0;
            let at_end = edge > AT_NEIGHBOUR && places.iter().filter(|p| **p > 0.0).count() >= 3;
            let at_end = if at_end { width } else { NONE };
            // The outermost of some points in a strip leave a little of it at either edge.
            let whole = (width * (count + 1.0) / (count - 1.0)).min(1.0);
            let whole = if joined >= TELLING { whole } else { 0.0 };
            widths.push((stretch, [width, whole, at_end]));
        }
        widths
    });
    let mut widths: HashMap<StretchEnd, [f64; 3]> = HashMap::new();
    for (stretch, found) in found.into_iter().flatten() {
        let most = widths.entry(stretch).or_insert([0.0, 0.0, NONE]);
        for (most, found) in most.iter_mut().zip(found) {
            *most = most.max(found);
        }
    }
    widths
}

fn told(widths: HashMap<StretchEnd, [f64; 3]>) -> Option<Overlap> {
    let told = widths.values().map(|w| w[1]).filter(|w| *w > 0.0);
    let least = told.fold(f64::INFINITY, f64::min);
    let sorted = ascending(widths.into_values().map(|w| w[0]).collect());
    (!sorted.is_empty()).then(|| Overlap {
        min: least.min(at(&sorted, 0.1)),
        tenth: at(&sorted, 0.1),
        median: at(&sorted, 0.5),
    })
}

fn tenth_of(widths: Vec<f64>) -> Option<f64> {
    let sorted = ascending(widths);
    (!sorted.is_empty()).then(|| at(&sorted, 0.1))
}

fn ascending(mut widths: Vec<f64>) -> Vec<f64> {
    widths.sort_by(f64::total_cmp);
    widths
}

/// The value at a share of a row that ascends and is not empty.
fn at(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (low, high) = (
        sorted[place.floor() as usize],
        sorted[place.ceil() as usize],
    );
    low + (high - low) * place.fract()
}

/// How the poses stand to the part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Largest difference of the middle ray from the reference distance.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet that it meets.
    pub tilt_max_deg: f64,
    /// Poses whose middle ray meets no part.
    pub off_part: usize,
    /// Ways from pose to pose on which it meets none, and none lies beside it.
    pub gaps: usize,
}

/// A way between two poses on a bent border leaves the part by less than this.
const BESIDE_MM: f64 = 0.05;

/// Follows the middle ray of every pose, and of the axes' ways between them.
pub fn stand(spec: &ScanSpec, scenery: &Scenery<'_>, passes: &[&Pass]) -> Stand {
    let mut stand = Stand {
        stand_off_max_mm: 0.0,
        tilt_max_deg: 0.0,
        off_part: 0,
        gaps: 0,
    };
    let part = scenery.meshes[0];
    let far = spec.sensor.range_mm[1] * 1.5;
    let beside = |pose: &SensorPose| {
        let mut sides = [pose.line, -pose.line, pose.feed(), -pose.feed()].into_iter();
        sides.any(|side| {
            let from = pose.origin_mm + side * BESIDE_MM;
            part.first_hit(&from, &pose.beam, far).is_some()
        })
    };
    let mut look = |pose: &SensorPose| {
        let hit = part.first_hit(&pose.origin_mm, &pose.beam, far);
        if let Some(hit) = &hit {
            let off = (hit.at - spec.sensor.reference_mm).abs();
            let tilt = scenery.tilt_deg(pose, hit);
            stand.stand_off_max_mm = stand.stand_off_max_mm.max(off);
            stand.tilt_max_deg = stand.tilt_max_deg.max(tilt);
        }
        hit.is_some()
    };
    let (mut off_part, mut gaps) = (0, 0);
    for pass in passes {
        for (k, pose) in pass.poses.iter().enumerate() {
            off_part += usize::from(!look(pose));
            let mut gap = false;
            for between in pass.between(spec, k) {
                gap |= !look(&between) && !beside(&between);
            }
            gaps += usize::from(gap);
        }
    }
    Stand {
        off_part,
        gaps,
        ..stand
    }
}
