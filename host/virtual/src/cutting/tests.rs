use std::f64::consts::PI;

use nalgebra::{Rotation3, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::units::{Point, Rad};

use super::*;
use crate::nc::{AxisDrives as _, AxisMotion, MotionPath, MotionRate, Recorder};

mod truth;

const RADIUS: f64 = 4.0;
const LENGTH: f64 = 120.0;
const TOOL: u32 = 7;

fn machine(workpiece: Workpiece) -> Cutter<Recorder> {
    let at = Point::from_mm(0.0, 0.0, 400.0);
    let mut cutter = Cutter::new(Recorder::new(at, at), workpiece).with_tool(
        TOOL,
        BallNose {
            length_mm: LENGTH,
            radius_mm: RADIUS,
        },
    );
    cutter.change_tool(TOOL).unwrap();
    cutter.auxiliary(3, 5000.0).unwrap();
    cutter
}

/// The tool's tip goes there.
fn go(cutter: &mut Cutter<Recorder>, tip: Vector3<f64>, rate: MotionRate) {
    let to = Point {
        mm: tip + Vector3::new(0.0, 0.0, LENGTH),
    };
    let path = MotionPath::Line;
    cutter.travel(&AxisMotion { to, path, rate }).unwrap();
}

fn lace(cutter: &mut Cutter<Recorder>, from: Vector3<f64>, to: Vector3<f64>) {
    let safe = |p: Vector3<f64>| Vector3::new(p.x, p.y, 200.0);
    go(cutter, safe(from), MotionRate::Rapid);
    go(cutter, from, MotionRate::Feed(1000.0));
    go(cutter, to, MotionRate::Feed(1000.0));
    go(cutter, safe(to), MotionRate::Rapid);
}

fn block(pitch: f64) -> Workpiece {
    let grid = Grid::new([-20.0, 20.0], [-10.0, 10.0], [pitch, pitch]).unwrap();
    Workpiece::new(grid, |_, _| 0.0)
}

/// Pseudo-random numbers in [-1, 1): a linear congruence, the same on every run.
fn noise(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    #[allow(clippy::cast_precision_loss)]
    let unit = (*state >> 11) as f64 / (1u64 << 53) as f64;
    2.0 * unit - 1.0
}

/// The closed form is below every ball on the way, and some ball reaches it: for
/// level, rising and plunging ways.
#[test]
fn a_capsule_is_the_lower_side_of_all_its_balls() {
    let mut seed = 1;
    let mut met = 0;
    for case in 0..400 {
        let mut vector = |scale: f64| {
            Vector3::new(
                scale * noise(&mut seed),
                scale * noise(&mut seed),
                scale * noise(&mut seed),
            )
        };
        let from = vector(5.0);
        let mut way = vector(5.0);
        if case % 4 == 0 {
            (way.x, way.y) = (0.0, 0.0);
        } else if case % 4 == 1 {
            way.z = 0.0;
        }
        let point = vector(6.0);
        let steps = 20_000;
        let sampled = (0..=steps)
            .filter_map(|step| {
                let ball = from + way * (f64::from(step) / f64::from(steps));
                let beside = (ball.x - point.x).powi(2) + (ball.y - point.y).powi(2);
                let under = RADIUS * RADIUS - beside;
                (under >= 0.0).then(|| ball.z - under.sqrt())
            })
            .fold(f64::INFINITY, f64::min);
        let capsule = Capsule::new(from, from + way, RADIUS);
        match capsule.lowest_above(point.x, point.y) {
            Some(lowest) => {
                met += 1;
                assert!(lowest <= sampled + 1e-12, "case {case}: {lowest} {sampled}");
                // Near the rim a ball's side is steep, and samples miss its end.
                assert!(sampled - lowest < 1e-2, "case {case}: {lowest} {sampled}");
            }
            None => assert!(sampled.is_infinite(), "case {case}: {sampled}"),
        }
    }
    assert!((100..350).contains(&met), "{met}");
}

/// One level pass leaves a round groove, exactly.
#[test]
fn one_pass_leaves_a_cylinder() {
    let mut cutter = machine(block(0.5));
    lace(
        &mut cutter,
        Vector3::new(-30.0, 1.3, -1.5),
        Vector3::new(30.0, 1.3, -1.5),
    );
    let grid = *cutter.workpiece().grid();
    let half_width = (RADIUS * RADIUS - 2.5_f64 * 2.5).sqrt();
    for row in 0..grid.rows() {
        let beside = grid.row_mm(row) - 1.3;
        let expected = if beside.abs() < half_width {
            2.5 - (RADIUS * RADIUS - beside * beside).sqrt()
        } else {
            0.0
        };
        for column in 0..grid.columns() {
            let node = row * grid.columns() + column;
            assert!((cutter.workpiece().heights_mm()[node] - expected).abs() < 1e-12);
            assert_eq!(cutter.workpiece().cut()[node], expected < 0.0);
        }
    }
    assert_eq!(cutter.crashes(), []);
}

/// Between parallel passes on a flat, cusps of r - sqrt(r² - s²/4).
#[test]
fn parallel_passes_leave_cusps() {
    let stepover = 0.8;
    let mut cutter = machine(block(0.1));
    for pass in -15..=15 {
        let y = f64::from(pass) * stepover;
        lace(
            &mut cutter,
            Vector3::new(-30.0, y, -1.0),
            Vector3::new(30.0, y, -1.0),
        );
    }
    let cusp = RADIUS - (RADIUS * RADIUS - stepover * stepover / 4.0_f64).sqrt();
    let heights = cutter.workpiece().heights_mm();
    let highest = heights.iter().copied().fold(f64::MIN, f64::max);
    let lowest = heights.iter().copied().fold(f64::MAX, f64::min);
    assert!((lowest + 1.0).abs() < 1e-12, "{lowest}");
    assert!((highest - (cusp - 1.0)).abs() < 1e-12, "{highest} {cusp}");
}

const ARC: CylinderArc = CylinderArc {
    axis_y_mm: 0.003,
    axis_z_mm: -63.53,
    radius_mm: 88.87,
};

/// Laces over the arc, the ball's centre on the circle around its axis.
fn arc_passes(step: Rad) -> Vec<[Vector3<f64>; 2]> {
    let ball = ARC.radius_mm + RADIUS;
    (-30..=30)
        .map(|pass| {
            let angle = f64::from(pass) * step.0;
            let y = ARC.axis_y_mm + ball * angle.sin();
            let z = ARC.axis_z_mm + ball * angle.cos() - RADIUS;
            [Vector3::new(-25.0, y, z), Vector3::new(25.0, y, z)]
        })
        .collect()
}

fn arc_blank() -> Workpiece {
    let grid = Grid::new([-25.0, 25.0], [-8.0, 8.0], [5.0, 0.02]).unwrap();
    Workpiece::new(grid, |_, y| ARC.height_mm(y).unwrap() + 1.0)
}

fn arc_statistics(workpiece: &Workpiece) -> DeviationStatistics {
    SurfaceDeviations::of(workpiece, &ARC)
        .statistics(|_, _| true)
        .unwrap()
}

/// On a convex arc the cusp is that of two circles, near s²/8 (1/r + 1/R) for a
/// stepover s on the surface; its mean is a third of that.
#[test]
fn cusps_on_an_arc_are_those_of_two_circles() {
    let step = Rad(0.53 / ARC.radius_mm);
    let mut cutter = machine(arc_blank());
    for [from, to] in arc_passes(step) {
        lace(&mut cutter, from, to);
    }
    let ball = ARC.radius_mm + RADIUS;
    let (sin, cos) = (step.0 / 2.0).sin_cos();
    let cusp = ball * cos - (RADIUS * RADIUS - (ball * sin).powi(2)).sqrt() - ARC.radius_mm;
    let near = 0.53_f64.powi(2) / 8.0 * (1.0 / RADIUS + 1.0 / ARC.radius_mm);
    assert!((cusp / near - 1.0).abs() < 0.01, "{cusp} {near}");

    let figures = arc_statistics(cutter.workpiece());
    assert_eq!(figures.uncut, 0);
    assert!(figures.min_mm > -1e-12, "{figures:?}");
    // A node stands up to half a pitch beside a cusp, whose sides have s/2 (1/r + 1/R).
    let beside = 0.01 * 0.53 / 2.0 * (1.0 / RADIUS + 1.0 / ARC.radius_mm);
    assert!(figures.max_mm < cusp + 1e-12, "{figures:?} {cusp}");
    assert!(figures.max_mm > cusp - 1.01 * beside, "{figures:?} {cusp}");
    assert!(
        (figures.mean_mm / (cusp / 3.0) - 1.0).abs() < 0.02,
        "{figures:?}"
    );
    let std = cusp * (4.0_f64 / 45.0).sqrt();
    assert!((figures.std_mm / std - 1.0).abs() < 0.02, "{figures:?}");
}

/// A part that stands turned, tilted and elsewhere, cut with the path moved alike,
/// is the same part; with the path left where it was it is another.
#[test]
fn a_moved_part_cut_along_a_moved_path_is_the_same() {
    let step = Rad(0.6 / ARC.radius_mm);
    let mut straight = machine(arc_blank());
    let mut moved = machine(arc_blank());
    let mut astray = machine(arc_blank());
    let turn = Rotation3::from_euler_angles(0.02, -0.015, -0.6);
    let pose = RigidTransform {
        rotation: *turn.matrix(),
        translation_mm: Vector3::new(-35.0, 12.0, -40.0),
    };
    moved.workpiece_mut().clamp(pose);
    astray.workpiece_mut().clamp(pose);
    let to_ball = Vector3::new(0.0, 0.0, RADIUS);
    // What moves with the part is the ball, not the tip: the tool stays upright.
    let image = |tip: Vector3<f64>| {
        let center = Point { mm: tip + to_ball };
        pose.apply(center).mm - to_ball
    };
    for [from, to] in arc_passes(step) {
        lace(&mut straight, from, to);
        lace(&mut moved, image(from), image(to));
        lace(&mut astray, from, to);
    }
    for (a, b) in straight
        .workpiece()
        .heights_mm()
        .iter()
        .zip(moved.workpiece().heights_mm())
    {
        assert!((a - b).abs() < 1e-10, "{a} {b}");
    }
    assert!(arc_statistics(moved.workpiece()).max_mm < 0.02);
    // The part is 40 mm below the path that did not move with it.
    assert!(arc_statistics(astray.workpiece()).share_uncut() > 0.9);
}

/// A ball on a circle leaves a ring whose section is the ball's; a helix ends
/// where it should.
#[test]
fn an_arc_leaves_a_ring() {
    let mut cutter = machine(block(0.25));
    go(
        &mut cutter,
        Vector3::new(5.0, 0.0, -1.0),
        MotionRate::Feed(100.0),
    );
    let motion = AxisMotion {
        to: Point::from_mm(5.0, 0.0, LENGTH - 1.0),
        path: MotionPath::Arc {
            center: Point::from_mm(0.0, 0.0, LENGTH - 1.0),
            axis: Vector3::new(0.0, 0.0, 1.0),
            sweep: Rad(2.0 * PI),
        },
        rate: MotionRate::Feed(1000.0),
    };
    cutter.travel(&motion).unwrap();
    let grid = *cutter.workpiece().grid();
    let mut ring = 0;
    for row in 0..grid.rows() {
        for column in 0..grid.columns() {
            let (x, y) = (grid.column_mm(column), grid.row_mm(row));
            let beside = (x * x + y * y).sqrt() - 5.0;
            let bottom = 3.0 - (RADIUS * RADIUS - beside * beside).max(0.0).sqrt();
            let height = cutter.workpiece().heights_mm()[row * grid.columns() + column];
            // A chord leaves the circle by so much, more where the ball is steep.
            let tolerance = 3.0 * CHORD_ERROR_MM;
            assert!(
                (height - bottom.min(0.0)).abs() < tolerance,
                "{x} {y} {height}"
            );
            ring += usize::from(height < 0.0);
        }
    }
    assert!(ring > 1000);

    let from = Vector3::new(5.0, 0.0, 0.0);
    let corners: Vec<_> = sweep::corners(
        from,
        Vector3::new(-5.0, 0.0, 6.0),
        &MotionPath::Arc {
            center: Point::from_mm(0.0, 0.0, 0.0),
            axis: Vector3::new(0.0, 0.0, 1.0),
            sweep: Rad(PI),
        },
    )
    .map(|(_, corner)| corner)
    .collect();
    let middle = corners[corners.len() / 2 - 1];
    assert!(
        (middle - Vector3::new(0.0, 5.0, 3.0)).norm() < 0.02,
        "{middle}"
    );
    assert_eq!(corners.last(), Some(&Vector3::new(-5.0, 0.0, 6.0)));
}

/// Material in the way of a rapid motion, or of a spindle that stands still, is told.
#[test]
fn contacts_that_are_no_cuts_are_told() {
    let mut cutter = machine(block(0.5));
    go(
        &mut cutter,
        Vector3::new(-30.0, 0.0, -1.0),
        MotionRate::Rapid,
    );
    assert_eq!(cutter.crashes(), []);
    go(
        &mut cutter,
        Vector3::new(30.0, 0.0, -1.0),
        MotionRate::Rapid,
    );
    let [crash] = cutter.crashes() else {
        panic!("{:?}", cutter.crashes());
    };
    assert_eq!(crash.cause, CrashCause::Rapid);
    assert!((crash.removed.deepest_mm - 1.0).abs() < 1e-12);

    cutter.auxiliary(5, 0.0).unwrap();
    go(
        &mut cutter,
        Vector3::new(30.0, 8.0, -1.0),
        MotionRate::Feed(500.0),
    );
    go(
        &mut cutter,
        Vector3::new(-30.0, 8.0, -1.0),
        MotionRate::Feed(500.0),
    );
    let causes: Vec<_> = cutter.crashes().iter().map(|crash| crash.cause).collect();
    assert_eq!(causes, [CrashCause::Rapid, CrashCause::SpindleStill]);

    // Another tool is none of the cutter's.
    cutter.change_tool(1).unwrap();
    go(
        &mut cutter,
        Vector3::new(30.0, -8.0, -1.0),
        MotionRate::Rapid,
    );
    assert_eq!(cutter.crashes().len(), 2);
}

/// The machine's scatter shows on the surface with its own size.
#[test]
fn scatter_of_the_axes_is_seen_on_the_surface() {
    let figures = |sigma_mm: f64| {
        let mut cutter = machine(block(0.5)).with_wander(Wander::new(sigma_mm, 5));
        for pass in -40..=40 {
            let y = f64::from(pass) * 0.25;
            lace(
                &mut cutter,
                Vector3::new(-30.0, y, -1.0),
                Vector3::new(30.0, y, -1.0),
            );
        }
        let heights = cutter.workpiece().heights_mm();
        let n = heights.len() as f64;
        let mean = heights.iter().sum::<f64>() / n;
        let squares: f64 = heights.iter().map(|z| (z - mean).powi(2)).sum();
        (mean, (squares / n).sqrt())
    };
    let ((exact, quiet), (mean, std)) = (figures(0.0), figures(0.002));
    assert!(quiet < 1e-6, "{quiet}");
    // Every node lies under a pass of its own, between the errors of its two ends.
    assert!((mean - exact).abs() < 0.0006, "{mean} {exact}");
    assert!((0.001..0.002).contains(&std), "{std}");
}

/// The figures of a known field: half of the nodes 0.2 high, half 0.1 deep.
#[test]
fn figures_of_a_known_surface() {
    let grid = Grid::new([0.0, 1.0], [-1.0, 2.0], [1.0, 1.0]).unwrap();
    let mut workpiece = Workpiece::new(grid, |_, y| ARC.height_mm(y).unwrap() + 3.0);
    let untouched = SurfaceDeviations::of(&workpiece, &ARC);
    let none = untouched.statistics(|_, _| true).unwrap();
    assert_eq!((none.nodes, none.uncut, none.cut()), (8, 8, 0));
    assert_eq!((none.mean_mm, none.max_mm), (0.0, 0.0));
    assert!(untouched.laid_on(&ARC, |_, _| true).is_none());

    press(&mut workpiece, |x, y| {
        (y < 1.5).then_some(if x < 0.5 { 0.2 } else { -0.1 })
    });
    let deviations = SurfaceDeviations::of(&workpiece, &ARC);
    let all = deviations.statistics(|_, _| true).unwrap();
    // Raw surface counts as such and with nothing else.
    assert_eq!((all.nodes, all.uncut, all.cut()), (8, 2, 6));
    assert!((all.share_uncut() - 0.25).abs() < 1e-15);
    assert!((all.mean_mm - 0.05).abs() < 1e-12);
    assert!((all.std_mm - 0.15 * (6.0_f64 / 5.0).sqrt()).abs() < 1e-12);
    assert!((all.max_mm - 0.2).abs() < 1e-12 && (all.min_mm + 0.1).abs() < 1e-12);
    assert!((all.mean_above_mm - 0.2).abs() < 1e-12);
    assert!((all.mean_below_mm + 0.1).abs() < 1e-12);
    let left = deviations.statistics(|x, _| x < 0.5).unwrap();
    assert!(left.nodes == 4 && left.std_mm < 1e-12);
    assert_eq!(deviations.statistics(|x, _| x > 5.0), None);
    assert!((deviations.at(1, 2).unwrap().0 + 0.1).abs() < 1e-12);
    assert!(!deviations.at(1, 3).unwrap().1);
    assert_eq!(deviations.at(2, 0), None);
}

/// Leaves these deviations along the normal at the nodes, by a fine point at each.
fn press(workpiece: &mut Workpiece, deviation: impl Fn(f64, f64) -> Option<f64>) {
    const FINE: f64 = 1e-3;
    let grid = *workpiece.grid();
    for row in 0..grid.rows() {
        for column in 0..grid.columns() {
            let (x, y) = (grid.column_mm(column), grid.row_mm(row));
            let Some(deviation) = deviation(x, y) else {
                continue;
            };
            let radius = ARC.radius_mm + deviation;
            let beside = y - ARC.axis_y_mm;
            let z = ARC.axis_z_mm + (radius * radius - beside * beside).sqrt();
            let center = Vector3::new(x, y, z + FINE);
            workpiece.sweep(center, center, FINE);
        }
    }
}

/// An arc that was cut elsewhere than meant, but rightly in itself, has no deviations once
/// the nominal one is laid on a strip of it, far from the strip too; a step beside the
/// strip is seen whole, and its shape is not smoothed away.
#[test]
fn laid_on_a_strip_a_moved_arc_has_no_deviations() {
    let grid = Grid::new([-20.0, 20.0], [-10.0, 20.0], [2.0, 0.5]).unwrap();
    let strip = |_: f64, y: f64| y < -4.0;
    for step in [0.0, 0.003] {
        let mut workpiece = Workpiece::new(grid, |_, y| ARC.height_mm(y).unwrap() + 3.0);
        press(&mut workpiece, |x, y| {
            let sin = (y - ARC.axis_y_mm) / ARC.radius_mm;
            let cos = (1.0 - sin * sin).sqrt();
            let moved = 0.02 * cos - 0.03 * sin + 1e-4 * x * cos + 2e-4 * x * sin;
            Some(moved + if strip(x, y) { 0.0 } else { step })
        });
        let absolute = SurfaceDeviations::of(&workpiece, &ARC);
        assert!(absolute.statistics(|_, _| true).unwrap().max_mm > 0.02);
        let laid = absolute.laid_on(&ARC, strip).unwrap();
        let beside = laid.statistics(|x, y| !strip(x, y)).unwrap();
        assert!((beside.max_mm - step).abs() < 1e-9, "{beside:?}");
        assert!((beside.min_mm - step).abs() < 1e-9, "{beside:?}");
    }
}

#[test]
fn a_grid_that_cannot_be_is_refused() {
    let grid = |x, pitch| Grid::new(x, [0.0, 10.0], pitch);
    assert_eq!(grid([1.0, 0.0], [0.1, 0.1]), Err(GridFault::Borders));
    assert_eq!(grid([0.0, f64::NAN], [0.1, 0.1]), Err(GridFault::Borders));
    assert_eq!(grid([0.0, 1.0], [0.0, 0.1]), Err(GridFault::Pitch));
    assert_eq!(grid([0.0, 1.0], [0.1, 20.0]), Err(GridFault::Pitch));
    assert_eq!(grid([0.0, 1e9], [1e-3, 1e-3]), Err(GridFault::TooFine));
    let fine = grid([-1.0, 1.0], [0.3, 1.0]).unwrap();
    assert_eq!((fine.columns(), fine.rows()), (8, 11));
    assert!((fine.column_mm(7) - 1.0).abs() < 1e-15);
}
