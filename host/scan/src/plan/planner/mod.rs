//! From a mesh and a specification to a proved path.
//!
//! * [`chart_passes`]: the passes of one chart, the best of several directions.
//! * [`fill`]: short passes for what is left.
//! * `join`: links between passes, and ways from safety and back.
//! * `limits`: steps and turns, within those allowed, with which it is planned.
//! * [`reach`]: what the axes can point the beam at.
//! * [`result`]: the path's rows and figures.
//! * `spindle`: a spindle with little room, turning and standing.
//! * [`thin`]: passes that others make needless.
//! * [`unseen`]: why what is not seen is not.
//! * `ways`: other axis values for the same poses.

pub mod chart_passes;
pub mod fill;
mod join;
mod limits;
pub mod reach;
pub mod result;
mod spindle;
pub mod thin;
pub mod unseen;
mod ways;

use std::cell::Cell;
use std::time::{Duration, Instant};

use super::drive::axes::Driver;
use super::drive::deadline::Deadline;
use super::drive::order::order;
use super::drive::realise::{Obstructed, Pass, Realiser, shortest_mm};
use super::drive::touch::Scenery;
use super::map::{Chart, chart::charts};
use super::mesh::PartMesh;
use super::proof::figures::OverlapPoints;
use super::proof::on_machine::OnMachine;
use super::proof::samples::{SamplePoint, sample_count, samples};
use super::proof::see::Eye;
use super::spec::ScanSpec;
use crate::ScanError;
use crate::parallel::Threads;
use crate::surface::Mesh;
use join::join;
use limits::Tries;
use result::ScanPlan;
use ways::ways;

/// What the caller may say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanOptions {
    /// A plan that sees less than `min_coverage` is a plan.
    pub allow_partial: bool,
    /// After this no further way is sought; what is not done then is refused as `time_limit`.
    pub time_limit: Duration,
    /// Feed with the laser on that times are reckoned with, mm/min.
    pub feed_mm_per_min: f64,
}

/// Everything that the steps of a plan share.
pub struct Workshop<'a> {
    /// The part.
    pub part: &'a PartMesh,
    /// The specification that it is planned by: its spindle may stand, its steps may be shorter than what is allowed.
    pub spec: &'a ScanSpec,
    /// The specification as it is given.
    pub given: &'a ScanSpec,
    /// How far it reaches.
    pub across_mm: f64,
    /// Points that stand for the surface.
    pub samples: Vec<SamplePoint>,
    /// Axes and box.
    pub realiser: Realiser<'a>,
    /// When to end.
    pub deadline: Deadline,
    /// Where a plan of least way overlaps too little: every step of the next is judged by these.
    pub overlap_points: Option<OverlapPoints>,
    /// Passes lie closer than the overlap needs by this share of the line.
    pub overlap_spare: f64,
}

impl Workshop<'_> {
    /// The points of each chart.
    fn by_chart(&self, charts: &[Chart]) -> Vec<Vec<SamplePoint>> {
        let mut home = vec![usize::MAX; self.part.faces.len()];
        for (number, chart) in charts.iter().enumerate() {
            for &f in &chart.faces {
                home[f as usize] = number;
            }
        }
        let mut points = vec![Vec::new(); charts.len()];
        for s in &self.samples {
            if let Some(mine) = points.get_mut(home[s.face as usize]) {
                mine.push(*s);
            }
        }
        points
    }
}

/// Edges sharper than this part the surface into charts.
fn sharp_deg(spec: &ScanSpec) -> f64 {
    (2.0 * spec.plan.max_tilt_deg).clamp(25.0, 60.0)
}

/// More than this share is all of a part, nearly.
const ALL: f64 = 0.999;

/// What is said where the time did not suffice for all tries.
const SKIPPED: &str =
    "Not all was tried within --time-limit: with more time there may be a better plan.";

/// What is said of a mesh whose triangles hardly hang together: every piece is planned by itself.
fn crumbs(part: &PartMesh) -> String {
    if part.components as usize * 10 > part.faces.len() {
        result::pieces(part.components)
    } else {
        String::new()
    }
}

/// A part is no wider than so many lines: what is wider is a slip of units.
const MOST_LINES_ACROSS: f64 = 5000.0;

/// Less than this share of the line that is measured is said where the time does not suffice.
const SHORT_LINE: f64 = 0.5;

/// What is said of a line of which `max_incidence_deg` leaves little on a surface that is seen straight on.
fn short_line(spec: &ScanSpec) -> String {
    let sensor = &spec.sensor;
    let left_mm = 2.0 * sensor.reference_mm * sensor.max_incidence_deg.to_radians().tan();
    if left_mm >= SHORT_LINE * sensor.line_mm {
        return String::new();
    }
    format!(
        " Of the line's {} mm, max_incidence_deg of {} leaves {left_mm:.1} mm on a surface that is seen straight on: passes lie that close.",
        sensor.line_mm, sensor.max_incidence_deg
    )
}

/// Plans a path and proves it.
///
/// # Errors
/// `coverage_unreachable` or `axis_limit` where too little can be seen, `overlap_unreachable` where neighbouring strips
/// overlap too little, `time_limit`, `plan_unproved` where the finished
/// path does not keep what it should.
pub fn plan(
    part: &PartMesh,
    obstacles: &[Mesh],
    spec: &ScanSpec,
    options: PlanOptions,
) -> Result<ScanPlan, ScanError> {
    let started = Instant::now();
    let deadline = Deadline::after(started, options.time_limit);
    let Some(placed) = OnMachine::new(part, obstacles, spec) else {
        return plan_there(part, obstacles, spec, options, deadline);
    };
    let mut plan = plan_there(
        &placed.part,
        &placed.obstacles,
        &placed.spec,
        options,
        deadline,
    )?;
    for row in &mut plan.rows {
        row.pose = spec.machine.forward(&row.axes);
    }
    for (point, _) in &mut plan.seen {
        *point = placed.back(point);
    }
    Ok(plan)
}

/// The plan of a part whose frame is the machine's.
fn plan_there(
    part: &PartMesh,
    obstacles: &[Mesh],
    spec: &ScanSpec,
    options: PlanOptions,
    deadline: Deadline,
) -> Result<ScanPlan, ScanError> {
    let late = |mut error: ScanError| {
        error.message += &crumbs(part);
        error.message += &short_line(spec);
        error
    };
    let all: Vec<u32> = (0..part.faces.len() as u32).collect();
    let across_mm = part.across_mm(&all);
    if across_mm > MOST_LINES_ACROSS * spec.sensor.line_mm {
        return Err(ScanError::refused(
            "sensor_spec",
            format_args!(
                "[sensor] line_mm is {}, and the part is {across_mm:.1} mm across: more than {MOST_LINES_ACROSS} passes would lie side by side. Are both in millimetres?",
                spec.sensor.line_mm
            ),
        ));
    }
    let charts = charts(part, sharp_deg(spec), || deadline.check()).map_err(late)?;
    deadline.check().map_err(late)?;
    // Where hardly anything may go unseen, small gaps count.
    let closer = if spec.plan.min_coverage > ALL { 4 } else { 1 };
    let points = closer * sample_count(part.surface.area_mm2(), spec.sensor.line_mm);
    let size = limits::PartSize {
        triangles: part.faces.len(),
        across_mm,
    };
    let one = |inner: &ScanSpec, care: Option<f64>| {
        let mut meshes = vec![&part.surface];
        meshes.extend(obstacles);
        let shop = Workshop {
            part,
            across_mm,
            spec: inner,
            given: spec,
            samples: samples(part, points),
            realiser: Realiser {
                spec: inner,
                driver: Driver::new(inner).until(deadline),
                scenery: Scenery::new(inner, meshes),
                shortest_mm: shortest_mm(&part.surface),
            },
            deadline,
            overlap_points: care.map(|_| OverlapPoints::new(part)),
            overlap_spare: care.unwrap_or(0.0),
        };
        planned(&shop, &charts, options)
    };
    let skipped = Cell::new(false);
    let tries = Tries {
        deadline,
        skipped: &skipped,
        partial: options.allow_partial,
    };
    let found = limits::best(spec, size, tries, |inner, care, again| {
        spindle::best(inner, tries, again, |spec| one(spec, care))
    });
    let mut found = match found {
        Ok(plan) if options.allow_partial => Ok(plan),
        Ok(ScanPlan {
            refusal: Some(refusal),
            ..
        }) => Err(refusal),
        found => found,
    };
    match &mut found {
        Ok(plan) if skipped.get() => plan.figures.warnings.push(SKIPPED.into()),
        Err(error) if error.code == "time_limit" => {
            error.message += &crumbs(part);
            error.message += &short_line(spec);
        }
        Err(error) if skipped.get() => error.message = format!("{} {SKIPPED}", error.message),
        _ => {}
    }
    found
}

/// A path within the steps and turns of the workshop's specification.
fn planned(
    shop: &Workshop<'_>,
    charts: &[Chart],
    options: PlanOptions,
) -> Result<ScanPlan, ScanError> {
    let deadline = shop.deadline;
    let mut obstructed = Obstructed::default();
    let mut passes: Vec<Pass> = Vec::new();
    let mut quality: Option<super::map::flatten::MapQuality> = None;
    let by_chart = shop.by_chart(charts);
    for (chart, points) in charts.iter().zip(&by_chart) {
        deadline.check()?;
        quality = Some(quality.map_or(chart.map.quality, |q| q.worst(chart.map.quality)));
        passes.extend(chart_passes::chart_passes(
            shop,
            chart,
            points,
            &mut obstructed,
        )?);
    }
    if charts.len() > 1 {
        thin::thin(shop, &mut passes);
    }
    let before = passes.len();
    fill::fill(shop, charts, &mut passes)?;
    if passes.len() > before {
        thin::thin(shop, &mut passes);
    }
    let tour = order(shop.spec, all_ways(shop, passes), deadline);
    let joined = join(shop, &tour, &mut obstructed)?;
    let passes = &joined.passes;
    let mut plan = result::proved(shop, joined.rows, passes, quality, &obstructed, options)?;
    plan.figures
        .warnings
        .extend(joined.warning.map(String::from));
    plan.flat = charts
        .iter()
        .map(|chart| chart.map.scales(shop.part, &chart.faces))
        .collect();
    Ok(plan)
}

/// Passes of which other ways are looked for, at most: of very many, each has its link near.
const MOST_WITH_WAYS: usize = 300;

/// Each pass with the other ways to drive it.
fn all_ways(shop: &Workshop<'_>, passes: Vec<Pass>) -> Vec<Vec<Pass>> {
    if passes.len() < 2 || passes.len() > MOST_WITH_WAYS || shop.spec.machine.limits().len() == 3 {
        return passes.into_iter().map(|pass| vec![pass]).collect();
    }
    let eye = Eye::new(&shop.spec.sensor, &shop.realiser.scenery, &shop.samples);
    Threads::all().chunks(passes.len(), 1, |range| {
        let pass = passes[range.start].clone();
        if shop.deadline.more() {
            ways(&shop.realiser, &eye, pass)
        } else {
            vec![pass]
        }
    })
}
