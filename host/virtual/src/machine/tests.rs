//! What the control stores and what is latched, on surfaces whose place is known.

use super::*;
use crate::nc::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip};
use umi_core::units::Rad;

/// Keeps what went over the wires.
#[derive(Debug, Default)]
struct Log {
    skips: Vec<(Micros, [i64; 3])>,
    falls: Vec<(Micros, [i64; 3])>,
    text: Vec<u8>,
    now: Micros,
    /// Counts while the axes move, each 10 ms.
    moved: Vec<(Micros, [i64; 3])>,
}

impl Wires for Log {
    fn serial(&mut self, at: Micros, bytes: &[u8]) {
        self.time(at);
        self.text.extend_from_slice(bytes);
    }
    fn skip(&mut self, at: Micros, counts: [i64; 3]) {
        self.time(at);
        self.skips.push((at, counts));
    }
    fn skip_falls(&mut self, at: Micros, counts: [i64; 3]) {
        self.time(at);
        self.falls.push((at, counts));
    }
    fn time(&mut self, now: Micros) {
        assert!(now >= self.now, "time went back");
        self.now = now;
    }
    fn sampling_s(&self) -> Option<f64> {
        Some(0.01)
    }
    fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        self.time(at);
        self.moved.push((at, counts));
    }
}

/// A wall at X 20 and a floor at Z 0, the probe at X 0 Z 50.
fn machine(more: &str, seed: u64) -> VirtualMachine<Log> {
    let text = format!(
        "{more}\n\
         [[body]]\nname = \"WALL\"\nshape = {{ block = {{ size_mm = [10.0, 100.0, 100.0] }} }}\nposition_mm = [25.0, 0.0, 80.0]\n\
         [[body]]\nname = \"FLOOR\"\nshape = \"half_space\"\n"
    );
    let mut scene = Scene::parse(&text).unwrap();
    scene.machine.start_mm = [0.0, 0.0, 50.0];
    VirtualMachine::new(scene, seed, Log::default())
}

fn line(to: [f64; 3], rate: MotionRate) -> AxisMotion {
    AxisMotion {
        to: Point::from_array_mm(to),
        path: MotionPath::Line,
        rate,
    }
}

fn skip(machine: &mut VirtualMachine<Log>, to: [f64; 3], feed: f64) -> Skip {
    machine
        .skip(&line(to, MotionRate::Feed(feed)), false)
        .unwrap()
}

/// The ideal machine stores the contact, and so does the latch.
#[test]
fn ideal_machine_stores_the_contact() {
    let mut machine = machine("", 1);
    let found = skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    assert!(found.touched);
    assert!((found.stored.mm.x - 17.5).abs() < 1e-9);
    assert_eq!(machine.wires.skips.len(), 1);
    let [x, y, z] = machine.wires.skips[0].1;
    assert!((174_999..=175_000).contains(&x), "{x}");
    assert_eq!((y, z), (0, 500_000));
    // Back, and down onto the floor.
    machine
        .travel(&line([0.0, 0.0, 50.0], MotionRate::Rapid))
        .unwrap();
    let found = skip(&mut machine, [0.0, 0.0, -10.0], 100.0);
    assert!((found.stored.mm.z - 2.5).abs() < 1e-9);
    let [wall, floor] = machine.hits() else {
        panic!("two hits");
    };
    assert_eq!((wall.body.as_str(), floor.body.as_str()), ("WALL", "FLOOR"));
}

/// One surface at four feeds, fifty touches each, with a control that answers after 0
/// to 4 ms: its answers wander with the feed (a range of nearly feed times 4 ms), the
/// latched ones stay within one count of 0.1 µm of one another and of the others'.
#[test]
fn control_wanders_latch_stays() {
    let errors = "[control]\nskip_delay_ms = [0.0, 4.0]\n\
                  [machine]\nposition_gain_per_s = 30.0\n\
                  [probe]\npretravel_mm = 0.062\novertravel_mm = 8.0";
    let mut machine = machine(errors, 3);
    let mut latched = Vec::new();
    for feed in [50.0, 300.0, 1000.0, 3000.0] {
        let mut stored = Vec::new();
        for _ in 0..50 {
            machine
                .travel(&line([5.0, 0.0, 50.0], MotionRate::Rapid))
                .unwrap();
            stored.push(skip(&mut machine, [30.0, 0.0, 50.0], feed).stored.mm.x);
            latched.push(machine.wires.skips.last().unwrap().1[0]);
        }
        let least = stored.iter().copied().fold(f64::INFINITY, f64::min);
        let most = stored.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let full = feed / 60.0 * 4e-3;
        let range = most - least;
        assert!(
            range > 0.8 * full && range <= full + 1e-9,
            "{feed}: {range} of {full}"
        );
        // Contact at 17.5, pretravel 0.062; then the control is late.
        assert!(least >= 17.562 - 1e-9);
    }
    let (least, most) = (latched.iter().min().unwrap(), latched.iter().max().unwrap());
    assert!(most - least <= 1, "{least} to {most}");
    assert!((least - 175_620).abs() <= 1, "{least}");
}

/// What the encoders cannot see, no witness sees: homing and scale shift both alike.
#[test]
fn homing_and_scale_are_seen_by_nobody() {
    let mut machine = machine(
        "[machine]\nhoming_error_mm = [0.18, 0.0, 0.0]\nscale_error_ppm = [100.0, 0.0, 0.0]",
        1,
    );
    let found = skip(&mut machine, [30.0, 0.0, 50.0], 60.0);
    // true = x (1 + 1e-4) + 0.18 = 17.5
    let expected = (17.5 - 0.18) / 1.0001;
    assert!((found.stored.mm.x - expected).abs() < 1e-8);
    assert_eq!(
        machine.wires.skips[0].1[0],
        (expected * 10_000.0).floor() as i64
    );
    assert!((machine.hits()[0].contact.mm.x - 17.5).abs() < 1e-8);
}

/// The machine warms up and the truth moves away with it.
#[test]
fn drift_moves_the_truth() {
    let mut machine = machine(
        "[machine]\ndrift_mm = [0.01, 0.0, 0.0]\ndrift_time_s = 100.0",
        1,
    );
    let cold = skip(&mut machine, [30.0, 0.0, 50.0], 600.0).stored.mm.x;
    machine
        .travel(&line([0.0, 0.0, 50.0], MotionRate::Rapid))
        .unwrap();
    machine.dwell(1000.0);
    let warm = skip(&mut machine, [30.0, 0.0, 50.0], 600.0).stored.mm.x;
    assert!((cold - warm - 0.01).abs() < 0.0005, "{cold} {warm}");
}

/// A motion that meets nothing ends where it was to, without a touch.
#[test]
fn miss_is_told() {
    let mut machine = machine("", 1);
    let found = skip(&mut machine, [0.0, 40.0, 50.0], 100.0);
    assert!(!found.touched);
    assert_eq!(found.stored.to_array_mm(), [0.0, 40.0, 50.0]);
    assert!(machine.wires.skips.is_empty());
}

/// Touching, moving on without skip is a collision; moving away is not; a skip ends at once.
#[test]
fn bent_stylus_must_move_away() {
    let mut machine = machine("[probe]\npretravel_mm = 0.06", 1);
    skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    let again = skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    assert!(again.touched);
    assert_eq!(machine.hits().len(), 1);
    let on = machine.travel(&line([18.0, 0.0, 50.0], MotionRate::Feed(100.0)));
    assert!(on.unwrap_err().message.contains("bends it further"));
    machine
        .travel(&line([10.0, 0.0, 50.0], MotionRate::Feed(100.0)))
        .unwrap();
    assert!(skip(&mut machine, [30.0, 0.0, 50.0], 100.0).touched);
    assert_eq!(machine.hits().len(), 2);
}

/// The line falls where the stylus is free again on its way back, not where that ends; a probe that is taken out of the
/// spindle while it touches lets it fall as well, and one that stays in contact does not.
#[test]
fn the_skip_line_falls_where_the_stylus_is_free() {
    let mut machine = machine(
        "[probe]\npretravel_mm = 0.06\n[control]\nskip_delay_ms = [2.0, 2.0]\n\
         [machine]\ncounts_per_mm = [1000.0, 1000.0, 1000.0]",
        1,
    );
    skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    let (rose, [touch, ..]) = machine.wires.skips[0];
    assert!(machine.wires.falls.is_empty(), "it is still bent");
    machine.dwell(0.3);
    let back = line([10.0, 0.0, 50.0], MotionRate::Feed(100.0));
    machine.travel(&back).unwrap();
    let (fell, [x, ..]) = machine.wires.falls[0];
    assert!((x - touch).abs() <= 2, "{x} {touch}");
    assert!(fell.0 - rose.0 > 300_000, "{fell:?} {rose:?}");
    assert!(machine.now().0 - fell.0 > 1_000_000, "the motion goes on");
    machine
        .travel(&line([5.0, 0.0, 50.0], MotionRate::Rapid))
        .unwrap();
    assert_eq!(machine.wires.falls.len(), 1, "once");

    skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    machine.leave(&back).unwrap();
    assert_eq!(
        (machine.wires.skips.len(), machine.wires.falls.len()),
        (2, 2)
    );
    skip(&mut machine, [30.0, 0.0, 50.0], 100.0);
    machine.change_tool(0).unwrap();
    assert_eq!(
        (machine.wires.skips.len(), machine.wires.falls.len()),
        (3, 3)
    );
}

/// Collisions, over-travel, a broken stylus and a turning probe stop the machine, each
/// with its reason.
#[test]
fn machine_stops_with_a_reason() {
    let tools = "[tools.1]\nlength_mm = 20.0\nradius_mm = 4.0";
    let at_rest = |motion: AxisMotion, says: &str| {
        let message = machine(tools, 1).travel(&motion).unwrap_err().message;
        assert!(message.contains(says), "{message}");
    };
    at_rest(
        line([30.0, 0.0, 50.0], MotionRate::Feed(100.0)),
        "ran into WALL at X17.500",
    );
    at_rest(line([0.0, 0.0, -10.0], MotionRate::Rapid), "ran into FLOOR");
    at_rest(
        line([0.0, 0.0, 501.0], MotionRate::Rapid),
        "over-travel: Z 501.000",
    );
    // Half a turn about Y: out of the free room, through the wall.
    at_rest(
        AxisMotion {
            to: Point::from_mm(36.0, 0.0, 50.0),
            path: MotionPath::Arc {
                center: Point::from_mm(18.0, 0.0, 50.0),
                axis: Vector3::y(),
                sweep: Rad(std::f64::consts::PI),
            },
            rate: MotionRate::Feed(500.0),
        },
        "ran into WALL",
    );
    let mut fast = machine("[machine]\nposition_gain_per_s = 30.0", 1);
    let broken = fast.skip(&line([30.0, 0.0, 50.0], MotionRate::Feed(15_000.0)), false);
    assert!(broken.unwrap_err().message.contains("the stylus broke"));
    let mut machine = machine(tools, 1);
    assert!(machine.auxiliary(3, 1000.0).is_err());
    assert!(machine.auxiliary(4, 0.0).is_err());
    machine.auxiliary(19, 0.0).unwrap();
    assert!(
        machine
            .change_tool(7)
            .unwrap_err()
            .message
            .contains("tool 7")
    );
    machine.change_tool(1).unwrap();
    machine.auxiliary(3, 1000.0).unwrap();
    let no_probe = machine.skip(&line([1.0, 0.0, 50.0], MotionRate::Feed(1.0)), false);
    assert!(no_probe.unwrap_err().message.contains("needs the probe"));
    // The tool's tip is 20 mm below the gauge line.
    let deep = machine.travel(&line([0.0, 0.0, 19.9], MotionRate::Feed(100.0)));
    assert!(
        deep.unwrap_err()
            .message
            .contains("the tool ran into FLOOR")
    );
}

/// A tool passes through a cuttable body while its spindle turns, at feed and at rapid,
/// and collides with it when the spindle stands still, whatever has stopped it.
#[test]
fn only_a_turning_tool_cuts() {
    let text = "[tools.1]\nlength_mm = 20.0\nradius_mm = 4.0\n\
        [[body]]\nname = \"PART\"\nshape = { block = { size_mm = [20.0, 20.0, 10.0] } }\n\
        cuttable = true\n\
        [[body]]\nname = \"VICE\"\nshape = { block = { size_mm = [20.0, 20.0, 10.0] } }\n\
        position_mm = [50.0, 0.0, 0.0]";
    let rates = [MotionRate::Feed(500.0), MotionRate::Rapid];
    let machine = || {
        let mut scene = Scene::parse(text).unwrap();
        scene.machine.start_mm = [0.0, 0.0, 100.0];
        let mut machine = VirtualMachine::new(scene, 1, Log::default());
        machine.change_tool(1).unwrap();
        machine
    };
    for rate in rates {
        let into_part = line([0.0, 0.0, 15.0], rate);
        let refused = |machine: &mut VirtualMachine<Log>| {
            let message = machine.travel(&into_part).unwrap_err().message;
            assert!(message.contains("ran into PART"), "{message}");
            assert!(message.contains("the spindle stands still"), "{message}");
        };
        refused(&mut machine());
        let mut slow = machine();
        slow.auxiliary(3, 0.0).unwrap();
        refused(&mut slow);
        for stop in [2, 5, 19, 30] {
            let mut stopped = machine();
            stopped.auxiliary(4, 5000.0).unwrap();
            stopped.auxiliary(stop, 5000.0).unwrap();
            refused(&mut stopped);
        }
        let mut changed = machine();
        changed.auxiliary(3, 5000.0).unwrap();
        changed.change_tool(1).unwrap();
        refused(&mut changed);

        let mut turning = machine();
        turning.auxiliary(3, 5000.0).unwrap();
        turning.auxiliary(8, 5000.0).unwrap();
        turning.travel(&into_part).unwrap();
        // It cuts nothing else.
        let mut beside = machine();
        beside.auxiliary(3, 5000.0).unwrap();
        beside.travel(&line([50.0, 0.0, 100.0], rate)).unwrap();
        let message = beside
            .travel(&line([50.0, 0.0, 15.0], rate))
            .unwrap_err()
            .message;
        assert!(message.contains("ran into VICE"), "{message}");
        assert!(!message.contains("stands still"), "{message}");
    }
}

/// The end of a program stops the spindle: the next one has to start it again.
#[test]
fn end_of_program_stops_the_spindle() {
    use crate::nc::{Control, ControlSettings};
    for end in ["M2", "M30"] {
        let mut machine = machine("[tools.1]\nlength_mm = 20.0\nradius_mm = 4.0", 1);
        machine.change_tool(1).unwrap();
        let mut control = Control::new(ControlSettings::default());
        control
            .load(&format!("%\nO1\nM3 S5000\nG4 P1\n{end}\n%\n"))
            .unwrap();
        control.select(1).unwrap();
        control.step(&mut machine).unwrap();
        while !machine.turns {
            control.step(&mut machine).unwrap();
        }
        control.run(&mut machine).unwrap();
        assert!(!machine.turns, "{end}");
    }
}

/// Counting the edges of each axis from the start to the skip edge gives the counts that
/// went out, also on axes that count down; the live view shows the waves at rest.
#[test]
fn edges_up_to_the_skip_are_its_counts() {
    let mut machine = machine(
        "[machine]\nposition_gain_per_s = 30.0\ncounts_per_mm = [1000.0, -2000.0, -1000.0]\n\
         origin_counts = [-7, 11, 500000]\nindex_counts = 4000",
        1,
    );
    let start = machine.status();
    skip(&mut machine, [30.0, -3.0, 40.0], 300.0);
    let (from, to) = (start.position, machine.hits()[0].latched);
    for (axis, encoder) in machine.encoders().into_iter().enumerate() {
        let edges = encoder.edges(from.mm[axis], to.mm[axis]);
        let (last, moved) = edges.fold((start.counts[axis], 0), |(count, moved), edge| {
            assert_eq!((edge.count - count).abs(), 1);
            (edge.count, moved + 1)
        });
        assert!(moved > 1000, "axis {axis}: {moved}");
        assert_eq!(last, machine.wires.skips[0].1[axis]);
        let shown = machine.status();
        assert_eq!(shown.signals[axis], encoder.signals(shown.counts[axis]));
    }
}

/// Axes in motion are told as they move: at the feed, up to the skip edge and to rest,
/// and along an arc on its circle.
#[test]
fn motion_is_told_as_it_happens() {
    let mut machine = machine("[machine]\ncounts_per_mm = [1000.0, 1000.0, 1000.0]", 1);
    skip(&mut machine, [30.0, 0.0, 50.0], 600.0);
    let samples = std::mem::take(&mut machine.wires.moved);
    let edge = machine.wires.skips[0];
    assert!(samples.contains(&edge), "the skip edge itself");
    assert!(samples.len() > 150, "{}", samples.len());
    let level = samples.windows(2).filter(|pair| {
        let [(from, [x, ..]), (to, [after, ..])] = pair else {
            return false;
        };
        // 10 mm/s: 100 counts in 10 ms.
        to.0 - from.0 == 10_000 && (after - x - 100).abs() <= 1
    });
    assert!(level.count() > 140);
    assert_eq!(samples.last().unwrap().1, machine.status().counts);

    machine.position = nalgebra::Vector3::new(-10.0, 0.0, 50.0);
    machine.signal = false;
    let arc = AxisMotion {
        to: Point::from_mm(-20.0, 10.0, 50.0),
        path: MotionPath::Arc {
            center: Point::from_mm(-20.0, 0.0, 50.0),
            axis: nalgebra::Vector3::z(),
            sweep: Rad(std::f64::consts::FRAC_PI_2),
        },
        rate: MotionRate::Feed(600.0),
    };
    machine.travel(&arc).unwrap();
    assert!(machine.wires.moved.len() > 100);
    for (_, [x, y, _]) in &machine.wires.moved {
        let radius = libm::hypot((x + 20_000) as f64, *y as f64);
        assert!((radius - 10_000.0).abs() < 8.0, "{radius}");
    }
}

/// Printing takes its time on the line.
#[test]
fn printing_takes_time() {
    let mut machine = machine("[control]\nbaud = 1200\nbits = 10", 1);
    machine.print(b"POINT:\n").unwrap();
    assert_eq!(machine.wires.text, b"POINT:\n");
    assert_eq!(machine.wires.now, Micros(58_333));
}

/// The same seed gives the same noise, another one another.
#[test]
fn noise_follows_the_seed() {
    let noisy = "[probe]\nrepeatability_um = 1.0\n[control]\nskip_delay_ms = [0.0, 4.0]";
    let stored = |seed| skip(&mut machine(noisy, seed), [30.0, 0.0, 50.0], 100.0).stored;
    assert_eq!(stored(1), stored(1));
    assert_ne!(stored(1), stored(2));
}

/// The trigger's repeatability is that of its setting: 1 µm is two sigma.
#[test]
fn repeatability_is_as_set() {
    let mut machine = machine("[probe]\npretravel_mm = 0.06\nrepeatability_um = 1.0", 5);
    let mut found = Vec::new();
    for _ in 0..2000 {
        machine
            .travel(&line([15.0, 0.0, 50.0], MotionRate::Rapid))
            .unwrap();
        found.push(skip(&mut machine, [30.0, 0.0, 50.0], 100.0).stored.mm.x);
    }
    let n = found.len() as f64;
    let mean = found.iter().sum::<f64>() / n;
    let sigma = (found.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    assert!((mean - 17.56).abs() < 5e-5, "{mean}");
    assert!((sigma - 5e-4).abs() < 3e-5, "{sigma}");
}

mod touching;
