//! What the courses left unseen is scanned by short passes, as long as that gains something.

use nalgebra::Vector3;

use super::super::course::field::{HeightField, chart_axes};
use super::super::course::level::{LinePoint, lines};
use super::super::drive::realise::{Obstructed, Pass};
use super::super::map::Chart;
use super::super::proof::cells::Cells;
use super::super::proof::samples::SamplePoint;
use super::super::proof::see::{Eye, SightDepth};
use super::Workshop;
use super::chart_passes::line_passes;
use crate::ScanError;
use crate::parallel::Threads;

/// Passes added at most.
const MOST: usize = 80;

/// More than the wanted coverage is not sought: it would cost way.
pub const SPARE: f64 = 0.008;

/// Directions in which lines are tried over a chart, as parts of half a turn: along its sides first.
const DIRECTIONS: [f64; 4] = [0.0, 0.5, 0.25, 0.75];

/// Lines tried lie this share of the laser line apart.
const LINE_SHARE: f64 = 0.3;

/// The same where the beam cannot follow the surface, and only narrow stretches may be driven.
const FIXED_SHARE: f64 = 0.1;

/// Lines tried at most, over all charts.
const MOST_LINES: usize = 240;

/// The same where the beam cannot follow the surface: each is quickly looked at.
const MOST_FIXED_LINES: usize = 480;

/// A line lies across its course. Where no axis turns the beam, one that lies askew reaches into the corners of slopes that are
/// too steep for the middle ray.
const ASKEW_DEG: [f64; 3] = [0.0, 45.0, -45.0];

/// The outermost lines lie this share of the laser line before the border: beyond it may be what no other sees.
const BORDER_SHARE: f64 = 0.002;

/// Share of its strip that a pass must see anew.
const WORTH: f64 = 0.3;

/// The same while less than the wanted share of the part is seen.
const NEED: f64 = 0.01;

/// A pass that could be added, and which open samples it sees.
struct Offer {
    pass: Pass,
    length_mm: f64,
    sees: Vec<u32>,
}

/// Adds passes until the wanted share is seen or nothing is gained.
///
/// Lines are laid over every chart with open samples, closely and in several directions; of what can be driven of them,
/// the pass that sees the most for its way is taken, again and again.
pub fn fill(
    shop: &Workshop<'_>,
    charts: &[Chart],
    passes: &mut Vec<Pass>,
) -> Result<(), ScanError> {
    let sensor = &shop.spec.sensor;
    let scenery = &shop.realiser.scenery;
    let seen = Eye::new(sensor, scenery, &shop.samples).see(
        &passes.iter().collect::<Vec<_>>(),
        SightDepth::Range,
        Threads::all(),
    );
    let open: Vec<usize> = (0..shop.samples.len())
        .filter(|i| seen.sights[*i].is_empty())
        .collect();
    let total = shop.samples.len() as f64;
    let goal = (shop.spec.plan.min_coverage + SPARE).min(1.0 - 1e-9);
    let enough = |open: usize| 1.0 - open as f64 / total >= goal;
    if enough(open.len()) {
        return Ok(());
    }
    let per_sample = shop.part.surface.area_mm2() / total;
    let points: Vec<SamplePoint> = open.iter().map(|&i| shop.samples[i]).collect();
    let lines = offered_lines(shop, charts, &points, per_sample);
    let mut offers = offers(shop, &lines, &points);
    shop.deadline.check()?;
    let mut unseen = vec![true; points.len()];
    let mut left = open.len();
    for _ in 0..MOST {
        if enough(left) {
            break;
        }
        let best = |least: f64| {
            let worth = |o: &Offer| {
                let open = o.sees.iter().filter(|i| unseen[**i as usize]).count();
                open as f64 * per_sample - least * (o.length_mm + 2.0) * sensor.line_mm
            };
            (0..offers.len())
                .map(|k| (worth(&offers[k]) / (offers[k].length_mm + 4.0), k))
                .filter(|(w, _)| *w > 0.0)
                .max_by(|a, b| a.0.total_cmp(&b.0))
        };
        // A pass costs its way and a link; what sees less than that share of its strip anew is not worth it, unless too
        // little would be seen without.
        let found = best(WORTH).or_else(|| (!enough(left)).then(|| best(NEED)).flatten());
        let Some((_, k)) = found else { break };
        let offer = offers.swap_remove(k);
        for &i in &offer.sees {
            unseen[i as usize] = false;
        }
        passes.push(offer.pass);
        left = unseen.iter().filter(|u| **u).count();
    }
    Ok(())
}

/// What can be driven of lines, and what that sees.
fn offers(shop: &Workshop<'_>, lines: &[Vec<LinePoint>], points: &[SamplePoint]) -> Vec<Offer> {
    let eye = Eye::new(&shop.spec.sensor, &shop.realiser.scenery, points);
    let driver = &shop.realiser.driver;
    let askew = match driver.free_line() && driver.fixed_beam().is_some() {
        true => &ASKEW_DEG[..],
        false => &ASKEW_DEG[..1],
    };
    let of_line = |k: usize| -> Vec<Offer> {
        if !shop.deadline.more() {
            return Vec::new();
        }
        let offer = |pass: Pass| Offer {
            length_mm: pass.length_mm(shop.spec),
            sees: eye.seen_by(&pass),
            pass,
        };
        let passes = askew.iter().flat_map(|by| {
            let hindered = &mut Obstructed::default();
            line_passes(shop, &lines[k], *by, hindered)
        });
        let mut offers: Vec<Offer> = passes.map(offer).collect();
        offers.retain(|o| o.sees.len() > 2);
        offers
    };
    let found = Threads::all().chunks(lines.len(), 1, |range| of_line(range.start));
    found.into_iter().flatten().collect()
}

/// Lines over the charts that have open samples: planes in several directions, close together.
fn offered_lines(
    shop: &Workshop<'_>,
    charts: &[Chart],
    open: &[SamplePoint],
    per_sample: f64,
) -> Vec<Vec<LinePoint>> {
    let mut chart_of = vec![u32::MAX; shop.part.faces.len()];
    for (number, chart) in charts.iter().enumerate() {
        for &f in &chart.faces {
            chart_of[f as usize] = number as u32;
        }
    }
    let mut counts = vec![0_usize; charts.len()];
    for p in open {
        if let Some(n) = counts.get_mut(chart_of[p.face as usize] as usize) {
            *n += 1;
        }
    }
    let line = shop.spec.sensor.line_mm;
    let fixed = shop.spec.machine.turns() == 0;
    let (spacing, most) = if fixed {
        (FIXED_SHARE, MOST_FIXED_LINES)
    } else {
        (LINE_SHARE, MOST_LINES)
    };
    let beam = shop.realiser.driver.fixed_beam();
    let mut found = Vec::new();
    // A beam that stands sees a slope from the flat beside it: lines over all charts that its middle ray may meet.
    let met = |chart: &Chart| {
        let faces = || chart.faces.iter().map(|&f| f as usize);
        let meets = |b| faces().any(|f| shop.realiser.driver.within_tilt(b, &shop.part.normal(f)));
        let area: f64 = faces().map(|f| shop.part.area_mm2(f)).sum();
        beam.as_ref().filter(|b| meets(b)).map(|_| area)
    };
    let worth = |k: usize| match beam {
        Some(_) => met(&charts[k]),
        None => Some(counts[k] as f64 * per_sample),
    };
    let mut order: Vec<(usize, f64)> = (0..charts.len())
        .filter_map(|k| worth(k).map(|area| (k, area)))
        .filter(|(_, area)| *area > 0.1 * line)
        .collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (number, _) in order {
        let chart = &charts[number];
        let (x, y) = chart_axes(shop.part, chart);
        let of_chart: Vec<&SamplePoint> = open
            .iter()
            .filter(|p| beam.is_some() || chart_of[p.face as usize] as usize == number)
            .collect();
        let places: Vec<Vector3<f64>> = of_chart.iter().map(|p| p.at).collect();
        let cells = Cells::new(&places, line / 2.0);
        for part_of_half in DIRECTIONS {
            let (s, c) = (std::f64::consts::PI * part_of_half).sin_cos();
            let direction = x * c + y * s;
            let mut heights: Vec<f64> = places.iter().map(|p| p.dot(&direction)).collect();
            heights.sort_by(f64::total_cmp);
            let height: Vec<f64> = chart
                .map
                .vertices
                .iter()
                .map(|&v| shop.part.vertices[v as usize].dot(&direction))
                .collect();
            let (low, high) = height
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                    (l.min(*v), h.max(*v))
                });
            let field = HeightField::new(shop.part, chart, height, String::new());
            let step = (spacing * line).max((high - low) / 200.0);
            let count = ((high - low) / step).floor() as usize;
            let first = low + (high - low - step * count as f64) / 2.0;
            let border = BORDER_SHARE * line;
            let borders = [low + border, high - border].into_iter();
            for level in borders.chain((0..=count).map(|j| first + step * j as f64)) {
                // Only where something is open within the line's reach.
                let next = heights.partition_point(|h| *h <= level - 0.6 * line);
                if heights.get(next).is_none_or(|h| *h >= level + 0.6 * line) {
                    continue;
                }
                for whole in lines(shop.part, chart, &field, level) {
                    let near = |p: &LinePoint| {
                        beam.is_none_or(|b| shop.realiser.driver.within_tilt(&b, &p.normal))
                            && cells.any_near(&p.at, 0.8 * line, |k| {
                                (places[k] - p.at).norm_squared() < 0.64 * line * line
                            })
                    };
                    // Stretches of the line with something open beside them.
                    let mut stretch: Vec<LinePoint> = Vec::new();
                    for p in &whole {
                        if near(p) {
                            stretch.push(*p);
                        } else if stretch.len() > 1 {
                            found.push(std::mem::take(&mut stretch));
                        } else {
                            stretch.clear();
                        }
                    }
                    if stretch.len() > 1 {
                        found.push(stretch);
                    }
                    if found.len() >= most || !shop.deadline.more() {
                        return found;
                    }
                }
            }
        }
    }
    found
}
