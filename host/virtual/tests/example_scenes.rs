//! The example scenes give what the thesis' tables say of its probe and balls.

use umi_core::units::Point;
use umi_virtual::machine::{Unwired, VirtualMachine};
use umi_virtual::nc::{AxisDrives, AxisMotion, MotionPath, MotionRate};
use umi_virtual::scene::{Scene, pose};

const THREE_SPHERES: &str = include_str!("../../../examples/scenes/three-spheres.toml");
const RING_GAUGE: &str = include_str!("../../../examples/scenes/ring-gauge.toml");
/// What the thesis' routine adds to a hit: tip radius less 0.062 mm.
const COMPENSATION_MM: f64 = 2.5 - 0.062;

fn to(at: [f64; 3], feed: f64) -> AxisMotion {
    AxisMotion {
        to: Point::from_array_mm(at),
        path: MotionPath::Line,
        rate: MotionRate::Feed(feed),
    }
}

fn skip(machine: &mut VirtualMachine<Unwired>, at: [f64; 3], feed: f64) -> Option<[f64; 3]> {
    let skip = machine.skip(&to(at, feed), false).expect("no trip");
    skip.touched.then(|| skip.stored.to_array_mm())
}

/// Opposite hits along an axis, fast and slow, by the moves of the thesis' appendix D:
/// half the distance of the compensated points.
fn radius(machine: &mut VirtualMachine<Unwired>, center: [f64; 3], axis: usize) -> f64 {
    let mut sides = Vec::new();
    for sign in [1.0, -1.0] {
        let beside = |off: f64, z: f64| {
            let mut at = center;
            at[axis] += sign * off;
            at[2] = z;
            at
        };
        let (above, side) = (center[2] + 27.7, center[2]);
        for at in [beside(30.4, above), beside(30.4, side)] {
            assert_eq!(skip(machine, at, 4000.0), None, "nothing is in the way");
        }
        let fast = skip(machine, beside(0.0, side), 100.0).expect("a hit");
        let mut off = center;
        off[axis] = fast[axis] + sign * COMPENSATION_MM;
        machine.travel(&to(off, 4000.0)).expect("backs off");
        let slow = skip(machine, beside(0.0, side), 20.0).expect("a hit");
        sides.push(slow[axis] - sign * COMPENSATION_MM);
        machine
            .travel(&to(beside(30.4, side), 4000.0))
            .expect("backs off");
        assert_eq!(skip(machine, beside(30.4, above), 4000.0), None);
    }
    (sides[0] - sides[1]) / 2.0
}

/// The routine's moves on each ball, in the reference clamping and with the plate moved
/// as in case 2: nothing but the balls is touched, and their radii are those of table
/// 5.2 (12.7069 mm in X, 12.7203 mm in Y) within 2.5 µm of delay, noise and rounding.
/// The seek from above to 150 mm below a ball's top is within the travel.
#[test]
fn balls_of_the_plate() {
    for (shift, turn) in [(0.0, 0.0), (16.0, -1.0)] {
        let mut scene = Scene::parse(THREE_SPHERES).expect("a valid scene");
        let plate = pose([shift, 0.0, 0.0], [0.0, 0.0, turn], [0.0; 3]);
        assert!(scene.place("PLATE", plate));
        let mut machine = VirtualMachine::new(scene, 1, Unwired);
        for center in [
            [-135.018, -136.624, 135.910],
            [137.989, -134.678, 110.253],
            [-136.7105, 136.4120, 136.1212],
        ] {
            let center = plate.apply(Point::from_array_mm(center)).to_array_mm();
            let [x, y, z] = center;
            machine.travel(&to([x, y, 300.0], 20_000.0)).expect("above");
            let top = skip(&mut machine, [x, y, z + 12.7 - 150.0], 100.0).expect("a hit");
            assert!((top[2] - (z + 15.2)).abs() < 0.009, "{top:?}");
            machine.travel(&to([x, y, z + 27.7], 4000.0)).expect("up");
            let in_x = radius(&mut machine, center, 0);
            let in_y = radius(&mut machine, center, 1);
            assert!((in_x - 12.7069).abs() < 0.0025, "{in_x}");
            assert!((in_y - 12.7203).abs() < 0.0025, "{in_y}");
            let [x, y, _] = machine.position().to_array_mm();
            machine.travel(&to([x, y, 300.0], 4000.0)).expect("up");
        }
        assert!(
            machine
                .hits()
                .iter()
                .all(|hit| hit.body.starts_with("SPHERE"))
        );
    }
}

/// The ring from its centre in 36 directions: a mean pretravel of 0.062 mm, as the
/// thesis has it, plus half of the longest delay at 25 mm/min (0.8 µm); the lobes show.
#[test]
fn ring_gauge() {
    let scene = Scene::parse(RING_GAUGE).expect("a valid scene");
    let [x, y, z] = scene.machine.start_mm;
    let mut machine = VirtualMachine::new(scene, 1, Unwired);
    let mut pretravel = Vec::new();
    for step in 0..36 {
        let angle = (10.0 * f64::from(step)).to_radians();
        let target = [x + 250.0 * angle.cos(), y + 250.0 * angle.sin(), z];
        let stored = skip(&mut machine, target, 25.0).expect("a hit");
        let radius = (stored[0] - x).hypot(stored[1] - y);
        pretravel.push(radius + 2.5 - 71.1327 / 2.0);
        machine.travel(&to([x, y, z], 1000.0)).expect("back");
    }
    let mean = pretravel.iter().sum::<f64>() / 36.0;
    assert!((mean - 0.0628).abs() < 0.0005, "{mean}");
    let most = pretravel.iter().copied().fold(f64::MIN, f64::max);
    let least = pretravel.iter().copied().fold(f64::MAX, f64::min);
    assert!(
        (0.008..0.014).contains(&(most - least)),
        "{least} to {most}"
    );
}
