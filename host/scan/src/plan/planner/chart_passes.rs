//! The passes of a chart: directions are ranked by the way they would take, the best ones are driven and seen, the least
//! costly is kept.

use super::super::course::along_line::line_fields;
use super::super::course::field::{HeightField, Spacing, fields};
use super::super::course::level::{LinePoint, lines};
use super::super::course::run::run;
use super::super::drive::axes::Stance;
use super::super::drive::realise::{Obstructed, Pass};
use super::super::map::Chart;
use super::super::proof::figures::overlap;
use super::super::proof::samples::SamplePoint;
use super::super::proof::see::see;
use super::Workshop;
use crate::ScanError;

/// How many directions are driven and seen in full.
const TRIED: usize = 6;

/// What a strip of the part that is not seen costs, against the way that would see it.
const UNSEEN_WEIGHT: f64 = 3.0;

/// The same for what is beyond half of what may stay unseen: the other half is for the part's other pieces.
const BEYOND_WEIGHT: f64 = 12.0;

/// Share of the line that is counted on at the outer ends of the first and last pass.
const EDGE_SHARE: f64 = 0.97;

/// Normals and directions are smoothed over this share of the line to either side.
const SMOOTH_SHARE: f64 = 0.3;

/// The best passes for one chart.
pub fn chart_passes(
    shop: &Workshop<'_>,
    chart: &Chart,
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
    let mut inside = vec![false; shop.part.faces.len()];
    for &f in &chart.faces {
        inside[f as usize] = true;
    }
    let samples: Vec<_> = shop
        .samples
        .iter()
        .filter(|s| inside[s.face as usize])
        .copied()
        .collect();
    let per_sample = shop.part.surface.area_mm2() / shop.samples.len() as f64;
    let mut ranked: Vec<(f64, HeightField, Vec<f64>)> = Vec::new();
    let mut heights = fields(shop.part, chart);
    if !shop.realiser.driver.free_line() {
        heights.extend(line_fields(shop.part, chart, &shop.realiser.driver));
    }
    for field in heights {
        if !shop.deadline.more() {
            break;
        }
        let share = line_share(shop, chart, &field);
        let levels = field.levels(shop.part, chart, spacing(shop, 1.0), &share);
        let length: f64 = levels
            .iter()
            .map(|l| level_length(shop, chart, &field, *l))
            .sum();
        ranked.push((length + 0.25 * line * levels.len() as f64, field, share));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let tried = if chart.faces.len() > 40_000 {
        TRIED / 2
    } else {
        TRIED
    };
    let mut best: Option<Driven> = None;
    // In pairs on two threads; the cheaper estimate wins a draw, so that the answer does not depend on which ends first.
    for pair in ranked[..ranked.len().min(tried)].chunks(2) {
        shop.deadline.check()?;
        // Nothing that must take a fifth more way than the best has taken will win.
        if best.as_ref().is_some_and(|b| pair[0].0 > 1.25 * b.cost) {
            break;
        }
        let drive = |one: &(f64, HeightField, Vec<f64>)| {
            driven(shop, chart, &one.1, &one.2, &samples, per_sample)
        };
        let (first, second) = std::thread::scope(|scope| {
            let other = pair.get(1).map(|one| scope.spawn(|| drive(one)));
            (Some(drive(&pair[0])), other.and_then(|o| o.join().ok()))
        });
        for found in [first, second].into_iter().flatten() {
            let found = found?;
            if best.as_ref().is_none_or(|b| found.cost < b.cost) {
                best = Some(found);
            }
        }
    }
    let Some(best) = best else {
        return Ok(Vec::new());
    };
    obstructed.axis_limit.extend(best.hindered.axis_limit);
    obstructed.collision.extend(best.hindered.collision);
    Ok(best.passes)
}

/// A direction, driven and seen.
struct Driven {
    cost: f64,
    passes: Vec<Pass>,
    hindered: Obstructed,
}

/// Drives the courses of a height; closer together while the overlap is too little.
fn driven(
    shop: &Workshop<'_>,
    chart: &Chart,
    field: &HeightField,
    share: &[f64],
    samples: &[SamplePoint],
    per_sample: f64,
) -> Result<Driven, ScanError> {
    let line_mm = shop.spec.sensor.line_mm;
    let mut best: Option<Driven> = None;
    for tighter in [1.0, 0.93, 0.86] {
        let mut hindered = Obstructed::default();
        let mut passes = Vec::new();
        for level in field.levels(shop.part, chart, spacing(shop, tighter), share) {
            for line in lines(shop.part, chart, field, level) {
                shop.deadline.check()?;
                passes.extend(line_passes(shop, &line, &mut hindered));
            }
        }
        let all: Vec<&Pass> = passes.iter().collect();
        let seen = see(&shop.spec.sensor, &shop.realiser.scenery, samples, &all);
        let unseen = seen.sights.iter().filter(|s| s.is_empty()).count() as f64 * per_sample;
        let length: f64 = passes.iter().map(|p| p.length_mm(shop.spec)).sum();
        let short = overlap(shop.spec, &all, &seen)
            .is_some_and(|o| o.min < enough_overlap(shop, per_sample));
        let may = 0.5 * (1.0 - shop.spec.plan.min_coverage) * samples.len() as f64 * per_sample;
        let beyond = (unseen - may).max(0.0);
        let cost = length
            + (UNSEEN_WEIGHT * unseen + (BEYOND_WEIGHT - UNSEEN_WEIGHT) * beyond) / line_mm
            + if short { 0.1 * length } else { 0.0 };
        if best.as_ref().is_none_or(|b| cost < b.cost) {
            best = Some(Driven {
                cost,
                passes,
                hindered,
            });
        }
        // What is hindered is not mended by closer courses.
        if !short || unseen > 0.2 * samples.len() as f64 * per_sample {
            break;
        }
    }
    Ok(best.unwrap_or(Driven {
        cost: f64::INFINITY,
        passes: Vec::new(),
        hindered: Obstructed::default(),
    }))
}

/// The least overlap that the samples can tell from the wanted one.
pub fn enough_overlap(shop: &Workshop<'_>, per_sample_mm2: f64) -> f64 {
    shop.spec.plan.overlap - 0.6 * 1.2 * per_sample_mm2.sqrt() / shop.spec.sensor.line_mm
}

fn spacing(shop: &Workshop<'_>, tighter: f64) -> Spacing {
    let line = shop.spec.sensor.line_mm;
    Spacing {
        width_mm: line * EDGE_SHARE,
        // A hundredth more than wanted, for what facets and smoothing take.
        pitch_mm: line * (1.0 - shop.spec.plan.overlap - 0.01).max(0.02) * tighter,
    }
}

/// Passes along one level line, with steps as short as the axes need.
pub fn line_passes(
    shop: &Workshop<'_>,
    line: &[LinePoint],
    obstructed: &mut Obstructed,
) -> Vec<Pass> {
    let smooth = SMOOTH_SHARE * shop.spec.sensor.line_mm;
    let mut step = shop.spec.plan.max_step_mm * 0.97;
    let Some(mut best) = run(line, step, smooth) else {
        return Vec::new();
    };
    let breaks = |points: &[_]| {
        shop.realiser
            .driver
            .follow(points, Stance::default())
            .1
            .breaks
    };
    let mut least = breaks(&best.points);
    for _ in 0..3 {
        if least == 0 || best.points.len() > 10_000 {
            break;
        }
        step /= 2.0;
        let Some(finer) = run(line, step, smooth) else {
            break;
        };
        let fewer = breaks(&finer.points);
        if fewer >= least {
            // The axes jump there however close the points are.
            break;
        }
        (best, least) = (finer, fewer);
    }
    shop.realiser.passes(&best, obstructed)
}

/// How much of the line lies across the course on each triangle, where the line follows from the beam.
fn line_share(shop: &Workshop<'_>, chart: &Chart, field: &HeightField) -> Vec<f64> {
    let driver = &shop.realiser.driver;
    if driver.free_line() {
        return vec![1.0; chart.faces.len()];
    }
    // Neighbours in the list are neighbours on the part; beyond some thousand a few stand for all.
    let stride = (chart.faces.len() / 3000).max(1);
    let mut share = 1.0;
    chart
        .faces
        .iter()
        .enumerate()
        .map(|(k, &f)| {
            if k % stride == 0 {
                let slope = field.slope[k].try_normalize(1e-12);
                let lines = driver.lines_for(&shop.part.normal(f as usize));
                // Where the beam cannot point at all, the line is no reason for denser courses.
                share = slope.filter(|_| !lines.is_empty()).map_or(1.0, |s| {
                    let across = lines.iter().map(|l| l.dot(&s).abs());
                    across.fold(0.05, f64::max)
                });
            }
            share
        })
        .collect()
}

/// Length of a level line on the surface.
fn level_length(shop: &Workshop<'_>, chart: &Chart, field: &HeightField, level: f64) -> f64 {
    let mut sum = 0.0;
    for (f, &face) in chart.map.faces.iter().zip(&chart.faces) {
        let h = f.map(|k| field.height[k as usize]);
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
    sum
}
