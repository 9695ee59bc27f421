//! From a mesh and a specification to a proved path.
//!
//! * [`chart_passes`]: the passes of one chart, the best of several directions.
//! * [`fill`]: short passes for what is left.
//! * [`result`]: the path's rows and figures.
//! * [`unseen`]: why what is not seen is not.

pub mod chart_passes;
pub mod fill;
pub mod result;
pub mod unseen;

use std::time::{Duration, Instant};

use super::drive::axes::Driver;
use super::drive::links::link;
use super::drive::order::order;
use super::drive::realise::{Obstructed, Pass, Realiser};
use super::drive::touch::Scenery;
use super::map::{Chart, chart::charts};
use super::mesh::PartMesh;
use super::proof::samples::{SamplePoint, sample_count, samples};
use super::proof::see::{Eye, SightDepth};
use super::spec::ScanSpec;
use crate::ScanError;
use crate::parallel::Threads;
use crate::surface::Mesh;
use result::{PathRow, ScanPlan};

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

/// A search that may last no longer than it was told.
#[derive(Debug, Clone, Copy)]
pub struct Deadline(Instant);

impl Deadline {
    /// Refuses once the time is up.
    ///
    /// # Errors
    /// `time_limit`.
    pub fn check(self) -> Result<(), ScanError> {
        if self.more() {
            return Ok(());
        }
        Err(ScanError::refused(
            "time_limit",
            "Planning was not done within --time-limit. Thin the mesh, plan a part of it, or allow more time.",
        ))
    }

    /// Is there time for something that could be left out?
    pub fn more(self) -> bool {
        Instant::now() < self.0
    }
}

/// Everything that the steps of a plan share.
pub struct Workshop<'a> {
    /// The part.
    pub part: &'a PartMesh,
    /// The specification.
    pub spec: &'a ScanSpec,
    /// Points that stand for the surface.
    pub samples: Vec<SamplePoint>,
    /// Axes and box.
    pub realiser: Realiser<'a>,
    /// When to end.
    pub deadline: Deadline,
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

/// Plans a path and proves it.
///
/// # Errors
/// `coverage_unreachable` or `axis_limit` where too little can be seen, `time_limit`, `plan_unproved` where the finished
/// path does not keep what it should.
pub fn plan(
    part: &PartMesh,
    obstacles: &[Mesh],
    spec: &ScanSpec,
    options: PlanOptions,
) -> Result<ScanPlan, ScanError> {
    let started = Instant::now();
    let deadline = Deadline(started.checked_add(options.time_limit).unwrap_or(started));
    let mut meshes = vec![&part.surface];
    meshes.extend(obstacles);
    let shop = Workshop {
        part,
        spec,
        samples: samples(
            part,
            sample_count(part.surface.area_mm2(), spec.sensor.line_mm),
        ),
        realiser: Realiser {
            spec,
            driver: Driver::new(spec),
            scenery: Scenery::new(spec, meshes),
        },
        deadline,
    };
    let charts = charts(part, sharp_deg(spec));
    deadline.check()?;
    let mut obstructed = Obstructed::default();
    let mut passes: Vec<Pass> = Vec::new();
    let mut quality: Option<super::map::flatten::MapQuality> = None;
    let by_chart = shop.by_chart(&charts);
    for (chart, points) in charts.iter().zip(&by_chart) {
        deadline.check()?;
        quality = Some(quality.map_or(chart.map.quality, |q| q.worst(chart.map.quality)));
        passes.extend(chart_passes::chart_passes(
            &shop,
            chart,
            points,
            &mut obstructed,
        )?);
    }
    if charts.len() > 1 {
        prune(&shop, &mut passes);
    }
    fill::fill(&shop, &charts, &mut passes, options.allow_partial)?;
    let mut passes = order(spec, passes);
    let rows = join(&shop, &mut passes, &mut obstructed)?;
    let mut plan = result::proved(&shop, rows, &passes, quality, &obstructed, options)?;
    plan.flat = charts
        .iter()
        .map(|chart| chart.map.scales(part, &chart.faces))
        .collect();
    Ok(plan)
}

/// Passes that see nothing which others do not are left out, the shortest first.
fn prune(shop: &Workshop<'_>, passes: &mut Vec<Pass>) {
    let all: Vec<&Pass> = passes.iter().collect();
    let eye = Eye::new(&shop.spec.sensor, &shop.realiser.scenery, &shop.samples);
    let seen = eye.see(&all, SightDepth::Range, Threads::all());
    let mut by: Vec<Vec<u32>> = seen
        .sights
        .iter()
        .map(|s| s.iter().map(|x| x.pass).collect())
        .collect();
    let lengths: Vec<f64> = passes.iter().map(|p| p.length_mm(shop.spec)).collect();
    let mut order: Vec<usize> = (0..passes.len()).collect();
    order.sort_by(|a, b| lengths[*a].total_cmp(&lengths[*b]));
    let mut keep = vec![true; passes.len()];
    for p in order {
        let mine = p as u32;
        if by.iter().all(|b| b.as_slice() != [mine]) {
            keep[p] = false;
            for b in &mut by {
                b.retain(|x| *x != mine);
            }
        }
    }
    let mut kept = keep.into_iter();
    passes.retain(|_| kept.next().unwrap_or(true));
}

/// Rows of passes with the links between them. A pass that no safe way leads to is left out; the proof tells what that
/// costs.
fn join(
    shop: &Workshop<'_>,
    passes: &mut Vec<Pass>,
    obstructed: &mut Obstructed,
) -> Result<Vec<PathRow>, ScanError> {
    let mut rows: Vec<PathRow> = Vec::new();
    let mut joined: Vec<Pass> = Vec::with_capacity(passes.len());
    for pass in std::mem::take(passes) {
        shop.deadline.check()?;
        if let (Some(before), Some(first)) = (rows.last(), pass.axes.first()) {
            let Some(way) = link(shop.spec, &shop.realiser.scenery, &before.axes, first) else {
                let tips = pass
                    .poses
                    .iter()
                    .map(|p| p.origin_mm + p.beam * shop.spec.sensor.reference_mm);
                obstructed.collision.extend(tips);
                continue;
            };
            for axes in way {
                rows.push(PathRow {
                    pass: -1,
                    laser: false,
                    pose: shop.spec.machine.forward(&axes),
                    axes,
                });
            }
        }
        for (axes, pose) in pass.axes.iter().zip(&pass.poses) {
            rows.push(PathRow {
                pass: joined.len() as i32,
                laser: true,
                axes: axes.clone(),
                pose: *pose,
            });
        }
        joined.push(pass);
    }
    *passes = joined;
    Ok(rows)
}
