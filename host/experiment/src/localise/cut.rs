//! A raw part is scanned, the finished one put where the stock is best, its path rewritten to there and cut.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Vector3;
use umi_client::problem::Problem;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RewriteSettings, Rewriter};
use umi_scan::localise::scans::{ScanQuestion, TakenScan};
use umi_scan::parallel::Threads;
use umi_scan::rigid::Pose;
use umi_scan::stock::{Objective, Rule, StockFound, StockTask};
use umi_scan::surface::Mesh;
use umi_virtual::cutting::{BallNose, Cutter, Workpiece};
use umi_virtual::machine::{Unwired, VirtualMachine};
use umi_virtual::nc::{Control, ControlSettings};
use umi_virtual::random::Random;
use umi_virtual::scene::{AreaScannerSpec, Scene};
use umi_virtual::sensor::area;

use super::cell::{self, ScannerKind};
use super::raw::{self, Printed};

/// Ball of the tool; between two passes and between two places of a pass, mm.
const BALL_MM: f64 = 4.0;
const STEP_MM: f64 = 0.4;
/// The path ends where the flank has run out.
const PATH_MM: f64 = 19.0;
/// Far above the part.
const SAFE_MM: f64 = 60.0;
/// Of the grid that is cut, mm.
const PITCH_MM: f64 = 0.5;

/// Where the finished part was put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placing {
    /// Where the raw part should have been clamped: no scan.
    AsDrawn,
    /// By least squares of its stock.
    LeastSquares,
    /// Where the least margin is largest.
    Optimum,
}

impl Placing {
    /// All, the worst first.
    pub const ALL: [Self; 3] = [Self::AsDrawn, Self::LeastSquares, Self::Optimum];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AsDrawn => "as drawn",
            Self::LeastSquares => "least squares",
            Self::Optimum => "optimum",
        }
    }
}

/// One raw part, cut by each placing.
#[derive(Clone, Debug)]
pub struct RawCut {
    /// What the scan shows of it, without spikes, machine coordinates, mm.
    pub points: Vec<Vector3<f64>>,
    /// The best place.
    pub optimum: StockFound,
    /// What was cut, in the order of [`Placing::ALL`].
    pub cuts: Vec<CutFound>,
}

/// What was cut by one placing.
#[derive(Clone, Debug)]
pub struct CutFound {
    /// Where it was put.
    pub placing: Placing,
    /// Whether its verdict was OK; none but for the optimum, which alone asks whether each face has what it demands.
    pub ok: Option<bool>,
    /// The least stock on the boss that the scan tells, mm.
    pub least_mm: Option<f64>,
    /// The least stock that the boss has there in truth, mm.
    pub true_least_mm: f64,
    /// What of the boss the tool did not touch, mm² in plan.
    pub bare_mm2: f64,
    /// What of the boss lies below its finished surface by more than a hundredth, mm² in plan: nothing can mend it.
    pub lacking_mm2: f64,
    /// Highest and lowest deviation of what was cut, along the normal, mm.
    pub cut_mm: [f64; 2],
}

/// What lies lower than the finished surface by more than this lacks material, mm: three times a cusp.
const LACKING_MM: f64 = 0.015;

fn trouble(error: &dyn std::fmt::Display) -> Problem {
    Problem::trouble("experiment", error)
}

/// One raw part, cut three times. The scanner's pose comes from the two fiducials; the part's files go into `folder`.
///
/// # Errors
/// What stops it, a refusal of the scan too.
pub fn run(
    printed: &Printed,
    scanner: &ScannerKind,
    seed: u64,
    threads: Threads,
    folder: &Path,
) -> Result<RawCut, Problem> {
    let mut random = Random::new(seed);
    let mut off = |by: f64| random.between(-by, by);
    let turn = Vector3::new(off(0.5), off(0.5), off(0.8)).map(f64::to_radians);
    let middle = Vector3::new(-40.0, 0.0, 0.0);
    let shift = Vector3::new(off(1.0), off(1.0), off(0.3));
    let rotation = umi_scan::rigid::rotation(&turn);
    let clamped = RigidTransform {
        translation_mm: middle + shift - rotation * middle,
        rotation,
    };
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.join(name), bytes)
            .map_err(|error| trouble(&format_args!("{}: {error}", folder.join(name).display())))
    };
    write("raw.stl", &raw::stl(&printed.triangles()))?;
    let points = scanned(scanner, &clamped, &mut random, threads, folder)?;
    let (model, demands) = raw::model().map_err(|error| trouble(&error))?;
    let path = path();
    write("nominal.nc", path.as_bytes())?;
    write("nominal.stl", &raw::stl(&corners(&model)))?;
    let mut faces = String::new();
    for demand in &demands {
        let file = format!("{}.stl", demand.name);
        write(&file, &raw::stl(&corners(&demand.mesh)))?;
        let rule = match demand.rule {
            Rule::Stock(mm) => format!("stock_mm = {mm:?}"),
            Rule::Profile(mm) => format!("profile_mm = {mm:?}"),
        };
        let _ = writeln!(
            faces,
            "[[face]]\nname = \"{}\"\nmesh = \"{file}\"\n{rule}\n",
            demand.name
        );
    }
    write("faces.toml", faces.as_bytes())?;
    let mut cloud = String::from("x,y,z\n");
    for p in &points {
        let _ = writeln!(cloud, "{:.6},{:.6},{:.6}", p.x, p.y, p.z);
    }
    write("scan.csv", cloud.as_bytes())?;
    let mut cuts = Vec::new();
    let mut optimum = None;
    for placing in Placing::ALL {
        let task = |objective| StockTask {
            model: &model,
            points: &points,
            objective,
            locked: [false; 6],
            pivot: Vector3::zeros(),
            start: Pose::identity(),
            require_mm: None,
            apart_is_raw: false,
            demands: &demands,
            threads,
        };
        let found = match placing {
            Placing::AsDrawn => None,
            Placing::LeastSquares => Some(task(Objective::LeastSquares)),
            Placing::Optimum => Some(task(Objective::Min)),
        }
        .map(|task| task.find())
        .transpose()
        .map_err(|error| trouble(&error))?;
        let motion = found.as_ref().map_or_else(Pose::identity, |f| f.motion);
        let program = rewritten(&path, &motion)?;
        let mut cut = measured(printed, &clamped, &motion, &program)?;
        cut.placing = placing;
        cut.least_mm = found.as_ref().and_then(|f| {
            let boss = f.faces.iter().find(|face| face.name == "boss");
            boss.and_then(|face| face.min_mm)
        });
        write(
            &format!("{}.nc", placing.name().replace(' ', "-")),
            program.as_bytes(),
        )?;
        if let (Placing::Optimum, Some(found)) = (placing, found) {
            cut.ok = Some(found.reasons.is_empty());
            optimum = Some(found);
        }
        cuts.push(cut);
    }
    let optimum = optimum.ok_or_else(|| trouble(&"no placing is the optimum"))?;
    let used = (0..points.len()).filter(|i| optimum.spikes.binary_search(i).is_err());
    Ok(RawCut {
        points: used.map(|i| points[i]).collect(),
        optimum,
        cuts,
    })
}

fn corners(mesh: &Mesh) -> Vec<[Vector3<f64>; 3]> {
    mesh.triangles().iter().map(|t| t.corners).collect()
}

/// The raw part's points in machine coordinates.
fn scanned(
    kind: &ScannerKind,
    clamped: &RigidTransform,
    random: &mut Random,
    threads: Threads,
    folder: &Path,
) -> Result<Vec<Vector3<f64>>, Problem> {
    let scene = cell::raw_scene(clamped, folder).map_err(|error| trouble(&error))?;
    // Steeper than for the bar: the flanks lean to all sides, and the corners' faces must be seen too.
    let target = Vector3::new(-45.0, 0.0, 0.0);
    let direction = Vector3::new(-0.36, -0.36, 1.0).normalize();
    let spec = AreaScannerSpec {
        look_at_mm: Some(target.into()),
        position_mm: (target + direction * random.between(430.0, 470.0)).into(),
        ..cell::scanner(kind, random)
    };
    let scans = [TakenScan {
        name: "raw".to_owned(),
        points: area::scan(&scene, &spec, 7, threads).points,
        moved: Pose::identity(),
        carried: false,
    }];
    let fiducials = cell::fiducials(0.0).map_err(|error| trouble(&error))?;
    let question = ScanQuestion {
        scans: &scans,
        fiducials: &fiducials,
        part: None,
        start: None,
        kernel: None,
        accept_symmetry: false,
        limit_mm: None,
        scale_limit_ppm: 1e4,
        seed: 0,
        threads,
    };
    let found = question.answer().map_err(|error| trouble(&error))?;
    let scanner = found.located.motion;
    // What stands where the part does; of its sides, which are not to be cut, the scan keeps what leans up.
    let is_part = |p: &Vector3<f64>| {
        (-74.5..=-5.5).contains(&p.x) && (-22.5..=22.5).contains(&p.y) && p.z > -5.0
    };
    let placed = scans[0].points.iter().map(|q| scanner.point(q));
    Ok(placed.filter(is_part).collect())
}

/// The finishing path of the part where it is drawn: places of the ball's middle, for a tool that is measured to there.
fn path() -> String {
    let mut text = String::from(
        "%\nO2300(BOSS - FINISH)\n(THE TOOL'S LENGTH GOES TO THE MIDDLE OF ITS BALL)\nG21 G90 G40 G49 G69 G17 G94\n\
         G28 G91 Z0.\nG90\nT02 M06 (8.0 MM DIA BALL NOSE MILL)\nG54\nS5000 M3\n",
    );
    let slope = |x: f64, y: f64| {
        let h = 1e-4;
        let along = |dx: f64, dy: f64| {
            (raw::finished_mm(x + dx, y + dy) - raw::finished_mm(x - dx, y - dy)) / (2.0 * h)
        };
        Vector3::new(-along(h, 0.0), -along(0.0, h), 1.0).normalize()
    };
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = text.write_fmt(words);
        text.push('\n');
    };
    let rows = (48.0 / STEP_MM) as u32;
    let columns = (72.0 / STEP_MM) as u32;
    let mut first = true;
    for row in 0..=rows {
        let y = -24.0 + STEP_MM * f64::from(row);
        let place = |column: u32| {
            // There and back.
            let column = if row % 2 == 0 {
                column
            } else {
                columns - column
            };
            let x = -76.0 + STEP_MM * f64::from(column);
            let on = raw::from_top_mm(x, y) <= PATH_MM;
            let p = Vector3::new(x, y, raw::finished_mm(x, y)) + slope(x, y) * BALL_MM;
            on.then_some(p)
        };
        let places: Vec<_> = (0..=columns).filter_map(place).collect();
        let [Some(start), Some(end)] = [places.first(), places.last()] else {
            continue;
        };
        line(format_args!(
            "G0 X{:.3} Y{:.3} Z{SAFE_MM:.1}",
            start.x, start.y
        ));
        line(format_args!("Z{:.3}", start.z + 8.0));
        for (k, p) in places.iter().enumerate() {
            let feed = if first { " F1000." } else { "" };
            let g1 = if k == 0 { "G1 " } else { "" };
            line(format_args!(
                "{g1}X{:.3} Y{:.3} Z{:.3}{feed}",
                p.x, p.y, p.z
            ));
            first = false;
        }
        line(format_args!("G0 X{:.3} Y{:.3} Z{SAFE_MM:.1}", end.x, end.y));
    }
    text + "M5\nG28 G91 Z0.\nG90\nM30\n%\n"
}

fn rewritten(path: &str, motion: &Pose) -> Result<String, Problem> {
    let settings = RewriteSettings::new(RigidTransform {
        rotation: motion.rotation,
        translation_mm: motion.translation_mm,
    });
    let refused = |refusal| Problem::refused("cannot_rewrite", refusal);
    let mut text = Vec::new();
    let mut sink = |bytes: &[u8]| text.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(&settings).map_err(|bad| trouble(&bad))?;
    rewriter.push(path.as_bytes(), &mut sink).map_err(refused)?;
    rewriter.finish(&mut sink).map_err(refused)?;
    String::from_utf8(text).map_err(|error| trouble(&error))
}

/// Cuts the clamped part, and looks at the boss where `motion` puts the finished part.
fn measured(
    printed: &Printed,
    clamped: &RigidTransform,
    motion: &Pose,
    program: &str,
) -> Result<CutFound, Problem> {
    let grid = raw::grid(PITCH_MM).map_err(|error| trouble(&error))?;
    let mut workpiece = Workpiece::new(grid, |x, y| printed.height_mm(x, y));
    workpiece.clamp(*clamped);
    let before = workpiece.heights_mm().to_vec();
    let scene = Scene::parse(super::cell::MACHINE).map_err(|error| trouble(&error))?;
    let tool = BallNose {
        length_mm: BALL_MM,
        radius_mm: BALL_MM,
    };
    let mut cutter =
        Cutter::new(VirtualMachine::new(scene, 1, Unwired), workpiece).with_tool(2, tool);
    let mut control = Control::new(ControlSettings::default());
    let alarm = |alarm| Problem::refused("alarm", alarm);
    let loaded = control.load(program).map_err(alarm)?;
    control
        .select(loaded.first().copied().unwrap_or_default())
        .map_err(alarm)?;
    control.run(&mut cutter).map_err(alarm)?;
    if let Some(crash) = cutter.crashes().first() {
        return Err(trouble(&format_args!(
            "the tool ran into the part {:.3} mm deep at rapid",
            crash.removed.deepest_mm
        )));
    }
    let (_, workpiece, _) = cutter.into_parts();
    let (model, _) = raw::model().map_err(|error| trouble(&error))?;
    let mut found = CutFound {
        placing: Placing::AsDrawn,
        ok: None,
        least_mm: None,
        true_least_mm: f64::INFINITY,
        bare_mm2: 0.0,
        lacking_mm2: 0.0,
        cut_mm: [f64::NEG_INFINITY, f64::INFINITY],
    };
    let grid = workpiece.grid();
    for (node, (z, touched)) in workpiece
        .heights_mm()
        .iter()
        .zip(workpiece.cut())
        .enumerate()
    {
        let (x, y) = (
            grid.column_mm(node % grid.columns()),
            grid.row_mm(node / grid.columns()),
        );
        let drawn = |z: f64| {
            let p = clamped.rotation * Vector3::new(x, y, z) + clamped.translation_mm;
            motion.undo(&p)
        };
        let raw_at = drawn(before[node]);
        let near = model.near(&raw_at);
        // What belongs to the boss by its nearest place, as the stock is counted.
        let foot = raw_at - near.direction * near.distance_mm;
        if raw::from_top_mm(foot.x, foot.y) >= raw::BOSS_MM {
            continue;
        }
        found.true_least_mm = found.true_least_mm.min(near.distance_mm);
        let left = model.near(&drawn(*z)).distance_mm;
        if *touched {
            found.cut_mm = [found.cut_mm[0].max(left), found.cut_mm[1].min(left)];
        } else {
            found.bare_mm2 += PITCH_MM * PITCH_MM;
        }
        if left < -LACKING_MM {
            found.lacking_mm2 += PITCH_MM * PITCH_MM;
        }
    }
    Ok(found)
}
