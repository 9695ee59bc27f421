//! The passes of a chart: directions are ranked by the way they would take, the best ones are driven and seen, the least
//! costly is kept.

use super::super::course::LaserRun;
use super::super::course::along_line::line_fields;
use super::super::course::field::{HeightField, Spacing, fields};
use super::super::course::level::{LinePoint, lines};
use super::super::course::run::{RunEnds, run};
use super::super::drive::axes::{Stance, angle_deg};
use super::super::drive::order::{FEED_MM_PER_S, idle_s};
use super::super::drive::realise::{Obstructed, Pass};
use super::super::map::Chart;
use super::super::proof::figures::{OverlapPoints, overlap, overlap_resolution, seen_share};
use super::super::proof::samples::SamplePoint;
use super::super::proof::see::{Eye, SightDepth};
use super::Workshop;
use super::reach::ChartReach;
use crate::ScanError;
use crate::parallel::Threads;

/// How many directions are driven and seen in full.
const TRIED: usize = 12;

/// What a strip of the part that is not seen costs, against the way that would see it.
const UNSEEN_WEIGHT: f64 = 3.0;

/// The same for what is beyond half of what may stay unseen: the other half is for the part's other pieces.
const BEYOND_WEIGHT: f64 = 12.0;

/// What a second costs that the laser point does not move on in, in way with the laser on: of two directions with nearly the
/// same way, that whose passes lie handier for the axes. (So does a part that is the same in a mirror get one plan, whatever
/// its mesh.)
const HASTE_MM_PER_S: f64 = 0.5;

/// What it takes to stop at a pass' end and to begin the next, in seconds, where a single pass is compared with several.
const HALT_S: f64 = 0.5;

/// What strips that overlap too little cost, of their way, by the few points that coverage needs.
const MAYBE_SHORT_WEIGHT: f64 = 0.1;

/// The same by the points that a finished path is judged by: less than what goes unseen, more than any way.
const SHORT_WEIGHT: f64 = 4.0;

/// Share of the line that is counted on at the outer ends of the first and last pass.
const EDGE_SHARE: f64 = 0.97;

/// Costs that differ by this share are the same but for rounding.
const SAME_SHARE: f64 = 1e-6;

/// How often a course that breaks is followed again with closer points.
const FINER_RUNS: usize = 3;

/// Normals and directions are smoothed over this share of the line to either side.
const SMOOTH_SHARE: f64 = 0.3;

/// The best passes for one chart, of which `samples` are the points.
pub fn chart_passes(
    shop: &Workshop<'_>,
    chart: &Chart,
    samples: &[SamplePoint],
    obstructed: &mut Obstructed,
) -> Result<Vec<Pass>, ScanError> {
    let line = shop.spec.sensor.line_mm;
    let area: f64 = chart
        .faces
        .iter()
        .map(|&f| shop.part.area_mm2(f as usize))
        .sum();
    // A crumb: its seeing is left to the passes beside it, and to what is filled in.
    if area < 1e-4 * shop.part.surface.area_mm2() && area < line * 0.5 {
        return Ok(Vec::new());
    }
    let strip_mm = strip_mm(shop, chart, area);
    // Of a part narrower than the line, estimates tell little, and no direction takes long.
    let narrow = strip_mm < line;
    let per_sample = shop.part.surface.area_mm2() / shop.samples.len() as f64;
    let mut ranked: Vec<(f64, HeightField, Vec<f64>)> = Vec::new();
    let mut heights = fields(shop.part, chart);
    if !shop.realiser.driver.free_line() {
        heights.extend(line_fields(shop.part, chart, &shop.realiser.driver));
    }
    let reach = ChartReach::new(shop, chart);
    let found = Threads::all().chunks(heights.len(), 1, |range| {
        let field = &heights[range.start];
        shop.deadline.more().then(|| {
            let (share, lost) = reach.share(shop, chart, field);
            let levels = field.levels(shop.part, chart, spacing(shop, WHOLE, 1.0), &share);
            let length = level_length(shop, chart, field, &levels, &share);
            let lost = UNSEEN_WEIGHT * lost / strip_mm;
            (length + lost + 0.25 * line * levels.len() as f64, share)
        })
    });
    for (field, found) in heights.into_iter().zip(found) {
        if let Some((cost, share)) = found {
            ranked.push((cost, field, share));
        }
    }
    // What differs by rounding alone stays in the order of the heights: a part that lies otherwise in its file is planned alike.
    let even = |cost: f64| (cost / (SAME_SHARE * line)).round();
    ranked.sort_by(|a, b| even(a.0).total_cmp(&even(b.0)));
    let beyond = reach.beyond(chart);
    // Where the axes reach a part of the chart only, lengths of courses say little: all are driven.
    let cut = beyond.len() * 20 > chart.faces.len();
    let faces = || chart.faces.iter().copied().collect();
    let judge = shop.overlap_points.as_ref().map(|all| all.on(&faces()));
    let tried = match chart.faces.len() {
        40_000.. => TRIED / 4,
        10_000.. => TRIED / 2,
        ..5_000 if cut || narrow || judge.is_some() => ranked.len(),
        _ => TRIED,
    };
    let eye = Eye::new(&shop.spec.sensor, &shop.realiser.scenery, samples);
    let mut best: Option<Driven> = None;
    for (estimate, field, share) in &ranked[..ranked.len().min(tried)] {
        shop.deadline.check()?;
        // Nothing that must take a fifth more way than the best has taken will win.
        if !cut && !narrow && best.as_ref().is_some_and(|b| *estimate > 1.25 * b.cost) {
            break;
        }
        let view = View {
            samples,
            eye: &eye,
            judge: judge.as_ref(),
            per_sample,
            strip_mm,
        };
        let found = driven(shop, chart, field, share, &view)?;
        // The cheaper estimate wins a draw.
        if best.as_ref().is_none_or(|b| found.beats(b)) {
            best = Some(found);
        }
    }
    let Some(best) = best else {
        return Ok(Vec::new());
    };
    let unreached = samples.iter().filter(|s| beyond.contains(&s.face));
    obstructed.axis_limit.extend(unreached.map(|s| s.at));
    obstructed.add(best.hindered);
    Ok(best.passes)
}

/// The width that a strip of a chart can have, about: the line's length, or the chart's own width where that is less.
fn strip_mm(shop: &Workshop<'_>, chart: &Chart, area: f64) -> f64 {
    let longest = shop.part.across_mm(&chart.faces);
    shop.spec.sensor.line_mm.min(area / longest.max(1e-9))
}

/// What is asked of a direction's passes.
struct View<'a> {
    samples: &'a [SamplePoint],
    eye: &'a Eye<'a>,
    judge: Option<&'a OverlapPoints>,
    per_sample: f64,
    strip_mm: f64,
}

/// A direction, driven and seen.
struct Driven {
    cost: f64,
    /// Area that goes unseen beyond what may.
    beyond_mm2: f64,
    /// Strips overlap too little.
    short: bool,
    seconds: f64,
    passes: Vec<Pass>,
    hindered: Obstructed,
}

impl Driven {
    /// The less costly one is better; but a single pass that sees enough has no overlap to keep, no links and no turns
    /// between strips: it is better than several that take longer or overlap too little, and not better than such as are
    /// done sooner.
    fn beats(&self, other: &Driven) -> bool {
        let whole = |d: &Driven| d.passes.len() == 1 && d.beyond_mm2 <= 0.0;
        let several = |d: &Driven| d.passes.len() > 1;
        if whole(self) && several(other) {
            return other.short || self.seconds < other.seconds || self.cost < other.cost;
        }
        if whole(other) && several(self) {
            return !other.beats(self);
        }
        self.cost < other.cost * (1.0 - SAME_SHARE)
    }
}

/// The whole line is seen, as a share of it.
const WHOLE: f64 = 1.0;

/// A strip of less than this share of the line has ends that range or incidence cut off.
const CUT_OFF: f64 = 0.95;

/// Drives the courses of a height; closer together while the overlap is too little, and as close as the strips are narrow
/// where range or incidence cut the line's ends off.
fn driven(
    shop: &Workshop<'_>,
    chart: &Chart,
    field: &HeightField,
    share: &[f64],
    view: &View<'_>,
) -> Result<Driven, ScanError> {
    let View {
        samples,
        eye,
        judge,
        per_sample,
        strip_mm,
    } = *view;
    let threads = Threads::all();
    let mut best: Option<Driven> = None;
    let mut tries = vec![(WHOLE, 0.86), (WHOLE, 0.93), (WHOLE, 1.0)];
    while let Some((seen_width, tighter)) = tries.pop() {
        let mut hindered = Obstructed::default();
        let mut passes = Vec::new();
        let levels = field.levels(shop.part, chart, spacing(shop, seen_width, tighter), share);
        let courses = threads.each(levels.len(), |k| {
            if shop.deadline.more() {
                lines(shop.part, chart, field, levels[k])
            } else {
                Vec::new()
            }
        });
        let courses: Vec<Vec<LinePoint>> = courses.into_iter().flatten().collect();
        // Each course on its own; they are put together in their order.
        let found = threads.chunks(courses.len(), 1, |range| {
            let mut hindered = Obstructed::default();
            if !shop.deadline.more() {
                return (Vec::new(), hindered);
            }
            let passes = line_passes(shop, &courses[range.start], 0.0, &mut hindered);
            (passes, hindered)
        });
        shop.deadline.check()?;
        for (more, by) in found {
            passes.extend(more);
            hindered.add(by);
        }
        let all: Vec<&Pass> = passes.iter().collect();
        let seen = eye.see(&all, SightDepth::Range, threads);
        let unseen = seen.sights.iter().filter(|s| s.is_empty()).count() as f64 * per_sample;
        let length: f64 = passes.iter().map(|p| p.length_mm(shop.spec)).sum();
        let (short, weight) = match judge {
            Some(points) => (
                points
                    .judge(shop.spec, &shop.realiser.scenery, &all, shop.deadline)
                    .is_some_and(|o| !o.holds()),
                SHORT_WEIGHT,
            ),
            None => (
                overlap(
                    shop.spec,
                    &all,
                    samples,
                    &seen,
                    per_sample.sqrt(),
                    shop.deadline,
                )
                .is_some_and(|o| o.tenth < enough_overlap(shop, per_sample)),
                MAYBE_SHORT_WEIGHT,
            ),
        };
        shop.deadline.check()?;
        let may = 0.5 * (1.0 - shop.spec.plan.min_coverage) * seen.sights.len() as f64 * per_sample;
        let beyond = (unseen - may).max(0.0);
        let idle_s = idle_s(shop.spec, &all, shop.deadline);
        let cost = length
            + HASTE_MM_PER_S * idle_s
            + (UNSEEN_WEIGHT * unseen + (BEYOND_WEIGHT - UNSEEN_WEIGHT) * beyond) / strip_mm
            + if short { weight * length } else { 0.0 };
        // How wide a beam that does not follow the surface sees is reckoned with in `share`; shadows are not mended by closer courses.
        let looks = seen.sights.iter().zip(&seen.missed);
        let shaded = looks.filter(|(s, m)| s.is_empty() && m.occluded).count();
        let first =
            seen_width == WHOLE && tighter == 1.0 && shop.realiser.driver.fixed_beam().is_none();
        let narrower = if first && (short || beyond > 0.0) && shaded * 20 < seen.sights.len() {
            seen_share(shop.spec, &all, samples, &seen, per_sample.sqrt())
        } else {
            WHOLE
        };
        if best.as_ref().is_none_or(|b| cost < b.cost) {
            best = Some(Driven {
                cost,
                beyond_mm2: beyond,
                short,
                seconds: length / FEED_MM_PER_S + idle_s + HALT_S * all.len() as f64,
                passes,
                hindered,
            });
        }
        if narrower < CUT_OFF {
            if short {
                best = None;
            }
            tries = [0.86, 0.93, 1.0]
                .map(|tighter| (narrower, tighter))
                .to_vec();
            continue;
        }
        // What is hindered is not mended by closer courses.
        if !short || unseen > 0.2 * seen.sights.len() as f64 * per_sample {
            break;
        }
    }
    Ok(best.unwrap_or(Driven {
        cost: f64::INFINITY,
        beyond_mm2: f64::INFINITY,
        short: false,
        seconds: f64::INFINITY,
        passes: Vec::new(),
        hindered: Obstructed::default(),
    }))
}

/// The least overlap that the samples can tell from the wanted one.
pub fn enough_overlap(shop: &Workshop<'_>, per_sample_mm2: f64) -> f64 {
    shop.spec.plan.overlap - overlap_resolution(shop.spec, per_sample_mm2)
}

/// Where courses lie whose strips are `seen_width` of the line wide.
fn spacing(shop: &Workshop<'_>, seen_width: f64, tighter: f64) -> Spacing {
    let line = shop.spec.sensor.line_mm;
    let cut_off = 1.0 - seen_width;
    let (overlap, spare) = (shop.spec.plan.overlap, shop.overlap_spare);
    // With care, the strips on both sides of a cut overlap, too.
    let seam = if spare > 0.0 { overlap + spare } else { 0.0 };
    Spacing {
        width_mm: line * (EDGE_SHARE - cut_off - seam).max(0.1),
        // A hundredth more than wanted, for what facets and smoothing take.
        pitch_mm: line * (1.0 - cut_off - overlap - spare - 0.01).max(0.02) * tighter,
    }
}

/// Passes along one level line, with steps as short as the axes need; the laser line lies across it, or askew by as much.
pub fn line_passes(
    shop: &Workshop<'_>,
    line: &[LinePoint],
    line_askew_deg: f64,
    obstructed: &mut Obstructed,
) -> Vec<Pass> {
    // No wider than the part bends.
    let smooth = SMOOTH_SHARE * shop.spec.sensor.line_mm.min(shop.across_mm / 3.0);
    let mut step = shop.spec.plan.max_step_mm * 0.97;
    let ends = RunEnds {
        inset_mm: shop.part.inset_mm,
        shortest_mm: 0.4 * shop.realiser.shortest_mm,
    };
    let Some(mut best) = run(line, step, smooth, ends) else {
        return Vec::new();
    };
    let stance = Stance {
        line_askew_deg,
        ..Stance::default()
    };
    let follow = |points: &[_]| shop.realiser.driver.follow(points, stance);
    let mut driven = follow(&best.points);
    for _ in 0..FINER_RUNS {
        if driven.unreached.breaks == 0 || best.points.len() > 10_000 {
            break;
        }
        // As much shorter as the normals turn too far from point to point; half as long at least.
        let turn = sharpest_turn_deg(&best) / shop.spec.plan.max_turn_deg;
        step /= (1.25 * turn).clamp(2.0, 32.0);
        let Some(finer) = run(line, step, smooth, ends) else {
            break;
        };
        let closer = follow(&finer.points);
        if turn <= 1.0 && closer.unreached.breaks >= driven.unreached.breaks {
            // The axes jump there however close the points are.
            break;
        }
        (best, driven) = (finer, closer);
    }
    obstructed.breaks += driven.unreached.breaks;
    shop.realiser
        .passes(&best, line_askew_deg, driven, obstructed)
}

/// The largest angle between the normals of neighbouring points.
fn sharpest_turn_deg(run: &LaserRun) -> f64 {
    let turns = run.points.windows(2);
    turns
        .map(|w| angle_deg(&w[0].normal, &w[1].normal))
        .fold(0.0, f64::max)
}

/// Length of all level lines on the surface, where it is reached; `levels` rise.
fn level_length(
    shop: &Workshop<'_>,
    chart: &Chart,
    field: &HeightField,
    levels: &[f64],
    share: &[f64],
) -> f64 {
    let mut sum = 0.0;
    for ((f, &face), _) in chart
        .map
        .faces
        .iter()
        .zip(&chart.faces)
        .zip(share)
        .filter(|(_, s)| **s > 0.0)
    {
        let h = f.map(|k| field.height[k as usize]);
        let (low, high) = (h[0].min(h[1]).min(h[2]), h[0].max(h[1]).max(h[2]));
        let from = levels.partition_point(|l| *l <= low);
        for &level in levels[from..].iter().take_while(|l| **l <= high) {
            let above = h.map(|v| v >= level);
            if above[0] == above[1] && above[1] == above[2] {
                continue;
            }
            let t = shop.part.corners(face as usize);
            let mut ends = [t[0]; 2];
            let mut found = 0;
            for k in 0..3 {
                let j = (k + 1) % 3;
                if above[k] != above[j] && found < 2 {
                    ends[found] = t[k] + (t[j] - t[k]) * ((level - h[k]) / (h[j] - h[k]));
                    found += 1;
                }
            }
            sum += (ends[1] - ends[0]).norm();
        }
    }
    sum
}
