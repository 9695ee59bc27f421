//! Rotary axes in motion.
//!
//! Collisions are looked for on the way of the tool's balls through the table's frame. A probe
//! does not know turned bodies: a motion with skip is refused while an axis is away from 0. The
//! line scanner follows all axes.

use nalgebra::{Matrix3, Vector3};
use umi_core::units::Point;
use umi_kinematics::{AxisChain, Pose};

use super::motion::Profile;
use super::{VirtualMachine, Wires, micros};
use crate::nc::{AxisMotion, MotionRate, Trip};

impl<W: Wires> VirtualMachine<W> {
    /// Whether any rotary axis is away from 0.
    pub(super) fn is_turned(&self) -> bool {
        self.turned.iter().any(|deg| *deg != 0.0)
    }

    /// Tells the wires where the rotary axes are.
    pub(super) fn tell_turned(&mut self) {
        let axes = self.scene.machine.rotary.iter().zip(&self.turned);
        let counts: Vec<i64> = axes.map(|(axis, deg)| axis.counts(*deg)).collect();
        if !counts.is_empty() {
            self.wires.turned(&counts);
        }
    }

    /// The way of a tool's tip through the rotary axes.
    pub(super) fn carriage(&self, length_mm: f64) -> TipCarriage {
        self.carriage_of(Vector3::new(0.0, 0.0, -length_mm))
    }

    /// The same of any place in the spindle's frame.
    pub(super) fn carriage_of(&self, tool: Vector3<f64>) -> TipCarriage {
        TipCarriage {
            chain: self.scene.machine.chain(Pose::identity()),
            tool,
        }
    }

    /// All axes go together: each in proportion, or X, Y, Z so that the tip of a tool of this
    /// length goes straight on the table.
    pub(super) fn turn_to(
        &mut self,
        motion: &AxisMotion,
        to_deg: &[f64],
        tip: Option<f64>,
        block_s: Option<f64>,
    ) -> Result<(), Trip> {
        let way = Way {
            tip: tip.map(|length_mm| self.carriage(length_mm)),
            from: match tip {
                Some(_) => crate::nc::AxisDrives::unturned(self, tip.unwrap_or(0.0)),
                None => self.position,
            },
            to: motion.to.mm,
            from_deg: self.turned.clone(),
            sweeps: self.turned.iter().zip(to_deg).map(|(a, b)| b - a).collect(),
        };
        for (axis, deg) in self.scene.machine.rotary.iter().zip(to_deg) {
            let [least, most] = axis.limits_deg;
            if !(least..=most).contains(deg) {
                return Err(Trip {
                    message: format!(
                        "over-travel: {} {deg:.3} is outside {least} to {most} (degrees)",
                        axis.word
                    ),
                });
            }
        }
        let end = way.at(1.0);
        self.within_travel(&end)?;
        let is_still = way.sweeps.iter().all(|sweep| *sweep == 0.0);
        if is_still && block_s.is_none() {
            let to = Point { mm: end };
            return crate::nc::AxisDrives::travel(self, &AxisMotion { to, ..*motion });
        }
        let length = (way.to - way.from).norm();
        let largest = way
            .sweeps
            .iter()
            .fold(0.0_f64, |most, sweep| most.max(sweep.abs()));
        let unit = if length > 1e-9 { length } else { largest };
        if unit == 0.0 {
            self.pass(block_s.unwrap_or(0.0));
            return Ok(());
        }
        // As fast as the slowest axis can.
        let axes = self.scene.machine.rotary.iter().zip(&way.sweeps);
        let rapid = self.scene.machine.rapid_mm_per_min;
        let mut fastest = axes
            .filter(|(_, sweep)| sweep.abs() > 0.0)
            .map(|(axis, sweep)| axis.deg_per_min * unit / sweep.abs())
            .fold(rapid, f64::min);
        if way.tip.is_some() {
            let mut at = self.position;
            for step in 1..=LOOKS {
                let next = way.at(f64::from(step) / f64::from(LOOKS));
                self.within_travel(&next)?;
                let axes_mm = (next - at).norm();
                fastest = fastest.min(rapid * unit / (axes_mm * f64::from(LOOKS)).max(1e-9));
                at = next;
            }
        }
        let wanted = match (block_s, motion.rate) {
            (Some(seconds), _) => unit / seconds.max(1e-6) * 60.0,
            (None, MotionRate::Rapid) => fastest,
            (None, MotionRate::Feed(feed)) => feed,
        };
        let profile = self.profile(unit, MotionRate::Feed(wanted.min(fastest)))?;
        let stop = self.turning_collision(&way);
        let share = stop.as_ref().map_or(1.0, |(share, _)| *share);
        let until_s = match stop {
            Some(_) => profile.time_at_s(unit * share),
            None => profile.duration_s,
        };
        self.go_turning(&way, &profile, unit, until_s);
        if let Some((_, trip)) = stop {
            self.turned = way.turned(share);
            self.tell_turned();
            self.arrive(way.at(share));
            return Err(trip);
        }
        self.turned = to_deg.to_vec();
        self.tell_turned();
        self.arrive(end);
        Ok(())
    }

    /// Where on a way with turns something is touched: share of it.
    fn turning_collision(&self, way: &Way) -> Option<(f64, Trip)> {
        if self.ball().is_none() && self.stem().is_empty() {
            return None;
        }
        let largest = way
            .sweeps
            .iter()
            .fold(0.0_f64, |most, sweep| most.max(sweep.abs()));
        let steps = (largest / CHORD_DEG).ceil().clamp(1.0, MOST_CHORDS);
        let shares: Vec<f64> = (0..=steps as u32)
            .map(|step| f64::from(step) / steps)
            .collect();
        let chain: Vec<Vector3<f64>> = shares.iter().map(|share| way.at(*share)).collect();
        let turned: Vec<Vec<f64>> = shares.iter().map(|share| way.turned(*share)).collect();
        let stop = self.collision(&chain, &turned)?;
        Some(((stop.line as f64 + stop.share) / steps, stop.trip))
    }

    fn go_turning(&mut self, way: &Way, profile: &Profile, unit: f64, until_s: f64) {
        if let Some(step_s) = self.wires.sampling_s().filter(|step_s| *step_s > 0.0) {
            let mut time_s = step_s;
            while time_s < until_s {
                let share = profile.travelled_mm(time_s) / unit;
                self.turned = way.turned(share);
                self.tell_turned();
                let counts = self.counts(&way.at(share));
                self.wires.moved(micros(self.seconds + time_s), counts);
                time_s += step_s;
            }
        }
        self.wait(until_s);
    }
}

/// Collisions are looked for along chords of this turn: half a metre from an axis their middle lies
/// 0.005 mm beside the arc.
const CHORD_DEG: f64 = 0.5;
/// Chords of a way, at most.
const MOST_CHORDS: f64 = 4000.0;

/// At so many places of a way on which the tip is carried, travel and speed are looked at.
const LOOKS: u32 = 32;

/// A tool's tip and the axes that carry it.
pub(super) struct TipCarriage {
    chain: AxisChain,
    /// The tip, in the spindle's frame.
    tool: Vector3<f64>,
}

impl TipCarriage {
    /// The tip on the table with the axes there.
    pub fn on_table(&self, position: &Vector3<f64>, deg: &[f64]) -> Vector3<f64> {
        let q: Vec<f64> = position.iter().chain(deg).copied().collect();
        self.chain.sensor_in_workpiece(&q).point(&self.tool)
    }

    /// Where X, Y, Z would be with the rotary axes at 0 and the tip at the same place.
    pub fn unturned(&self, position: &Vector3<f64>, deg: &[f64]) -> Vector3<f64> {
        self.on_table(position, deg) - self.on_table(&Vector3::zeros(), &[])
    }

    /// And back: X, Y, Z with the rotary axes there. The tip on the table is linear in them, and
    /// the matrix a rotation.
    fn turned(&self, unturned: &Vector3<f64>, deg: &[f64]) -> Vector3<f64> {
        let wanted = unturned + self.on_table(&Vector3::zeros(), &[]);
        let begin = self.on_table(&Vector3::zeros(), deg);
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis| self.on_table(&axis, deg) - begin);
        Matrix3::from_columns(&columns).transpose() * (wanted - begin)
    }
}

/// A way with turns.
struct Way {
    /// None: each axis in proportion.
    tip: Option<TipCarriage>,
    /// Of the machine, or as if the rotary axes were at 0.
    from: Vector3<f64>,
    to: Vector3<f64>,
    from_deg: Vec<f64>,
    sweeps: Vec<f64>,
}

impl Way {
    fn turned(&self, share: f64) -> Vec<f64> {
        let axes = self.from_deg.iter().zip(&self.sweeps);
        axes.map(|(from, sweep)| from + sweep * share).collect()
    }

    /// X, Y, Z.
    fn at(&self, share: f64) -> Vector3<f64> {
        let at = self.from + (self.to - self.from) * share;
        match &self.tip {
            Some(tip) => tip.turned(&at, &self.turned(share)),
            None => at,
        }
    }
}

#[cfg(test)]
mod tests {
    use umi_core::units::Micros;

    use super::*;
    use crate::cell::Cell;
    use crate::nc::{Alarm, AxisDrives as _};
    use crate::scene::Scene;

    const SCENE: &str = r#"
[machine]
start_mm = [0, 0, 100]
reference_mm = [0, 0, 500]
[[machine.rotary]]
word = "A"
carries = "workpiece"
axis = [2, 0, 0]
point_mm = [0, 0, -60]
limits_deg = [-90, 90]
counts_per_deg = 1000
[[machine.rotary]]
word = "C"
carries = "spindle"
axis = [0, 0, 1]
counts_per_deg = -500
origin_counts = 7
[control.nc]
dialect = "linuxcnc"
"#;

    /// Keeps what the encoders show, every 10 ms.
    #[derive(Default)]
    struct Log {
        turned: Vec<i64>,
        all: Vec<(Micros, [i64; 3], Vec<i64>)>,
    }

    impl Wires for Log {
        fn serial(&mut self, _: Micros, _: &[u8]) {}
        fn skip(&mut self, _: Micros, _: [i64; 3]) {}
        fn time(&mut self, _: Micros) {}
        fn sampling_s(&self) -> Option<f64> {
            Some(0.01)
        }
        fn moved(&mut self, at: Micros, counts: [i64; 3]) {
            self.all.push((at, counts, self.turned.clone()));
        }
        fn turned(&mut self, counts: &[i64]) {
            self.turned = counts.to_vec();
        }
    }

    fn run(program: &str) -> Result<Cell<VirtualMachine<Log>>, Alarm> {
        let mut cell = Cell::new(Scene::parse(SCENE).unwrap(), 1, Log::default());
        cell.run(program, |_, _| Ok::<(), Alarm>(()))?;
        Ok(cell)
    }

    #[test]
    fn all_axes_go_together_and_the_encoders_show_it() {
        let cell = run("G21 G90 G0 X10 A-20\nG93 G1 X40 Z80 A40 C-90 F20\nG94\nM2\n").unwrap();
        let machine = &cell.machine;
        assert_eq!(machine.turned_deg(), [40.0, -90.0]);
        assert_eq!(machine.position().to_array_mm(), [40.0, 0.0, 80.0]);
        let log = &machine.wires().all;
        let (at, counts, turned) = log.last().unwrap();
        assert_eq!((counts[0], counts[2]), (400_000, 800_000));
        assert_eq!(*turned, [40_000, 45_007]);
        // The block takes 3 s, and what the axes need to come up to speed.
        let begin = log
            .iter()
            .find(|(_, counts, _)| counts[0] == 100_000)
            .unwrap();
        let took = (at.0 - begin.0.0) as f64 * 1e-6;
        assert!((3.0..3.2).contains(&took), "{took}");
        // Between the ends X and A keep in step: 2 degrees a millimetre.
        let between = log
            .iter()
            .filter(|(_, counts, _)| (110_000..390_000).contains(&counts[0]));
        let mut n = 0;
        for (_, counts, turned) in between {
            let (x, a) = (counts[0] as f64 * 1e-4, turned[0] as f64 * 1e-3);
            assert!((a - (-20.0 + (x - 10.0) * 2.0)).abs() < 2e-3, "{x} {a}");
            n += 1;
        }
        assert!(n > 200, "{n}");
    }

    /// The tip stays where it is on the table while table and spindle turn, and goes straight on it.
    #[test]
    fn the_tip_is_carried_through_the_rotary_axes() {
        let scene = SCENE
            .replace(
                "carries = \"spindle\"\naxis = [0, 0, 1]",
                "carries = \"spindle\"\naxis = [0, 1, 0]",
            )
            .replace("dialect = \"linuxcnc\"", "dialect = \"fanuc\"")
            + "[offsets_mm]\nG54 = [5, -7, 20]\n[tools.1]\nlength_mm = 80\nradius_mm = 3\n";
        let run = |program: &str| {
            let mut cell = Cell::new(Scene::parse(&scene).unwrap(), 1, Log::default());
            cell.run(&format!("%\nO1\n{program}\nM30\n%\n"), |_, _| {
                Ok::<(), Alarm>(())
            })
            .map(|()| cell)
        };
        // With the rotary axes at 0 it is G43.
        let plain = run("G90 G54 G43 H1\nG0 X10. Y20. Z30.").unwrap();
        let tip = run("G90 G54 G43.4 H1\nG0 X10. Y20. Z30.").unwrap();
        assert_eq!(plain.machine.position().to_array_mm(), [15.0, 13.0, 130.0]);
        assert_eq!(tip.machine.position(), plain.machine.position());

        let go = "G90 G54 G43.4 H1\nG0 X10. Y20. Z30.\n";
        let feed = format!("{go}G93 G1 X30. Y20. Z35. A40. C-25. F60.\n#1=#5001\n#2=#5003");
        let cell = run(&feed).unwrap();
        assert_eq!(cell.machine.turned_deg(), [40.0, -25.0]);
        let at = |position: Vector3<f64>, a: f64, b: f64| {
            // The tip in the machine, and back through the table's turn about y 0, z -60.
            let turn =
                |axis: Vector3<f64>, deg: f64| nalgebra::Rotation3::new(axis * deg.to_radians());
            let tool = turn(Vector3::y(), b) * Vector3::new(0.0, 0.0, -80.0);
            let axis = Vector3::new(0.0, 0.0, -60.0);
            turn(Vector3::x(), -a) * (position + tool - axis) + axis
        };
        let origin = Vector3::new(5.0, -7.0, 20.0);
        let end = at(cell.machine.position().mm, 40.0, -25.0) - origin;
        assert!(
            (end - Vector3::new(30.0, 20.0, 35.0)).norm() < 1e-9,
            "{end}"
        );
        for (number, wanted) in [(1, 30.0), (2, 35.0)] {
            let read = cell.control.variable(number).unwrap();
            assert!((read - wanted).abs() < 1e-9, "#{number} {read}");
        }
        // Between the ends, to the encoders' steps.
        let mut n = 0;
        for (_, counts, turned) in &cell.machine.wires().all {
            let (a, b) = (turned[0] as f64 * 1e-3, (turned[1] - 7) as f64 * -2e-3);
            if !(0.5..39.5).contains(&a) {
                continue;
            }
            let position = Vector3::from(counts.map(|count| count as f64 * 1e-4));
            let tip = at(position, a, b) - origin;
            let wanted = Vector3::new(10.0 + a / 2.0, 20.0, 30.0 + a / 8.0);
            assert!((tip - wanted).norm() < 8e-3, "{a} {b}: {tip}");
            n += 1;
        }
        assert!(n > 50, "{n}");

        for (program, what) in [
            ("G43.4 H1\nG2 X10. I5. F100.", "G2 while G43.4"),
            ("G43.4 H1\nG28 Z0", "G28 while G43.4"),
            ("G43.4 H1\nG55", "G55 while G43.4"),
            ("G43.4 H1\nH2", "another H"),
            ("G43.4 H1\nM6 T2", "M6 while G43.4"),
            ("G43.4 H1\nG0 Z5000.", "over-travel"),
            ("G43.4 H1\nG0 A95.", "over-travel: A"),
        ] {
            let error = run(&format!("G90 G54 {program}")).err().unwrap();
            assert!(error.message.contains(what), "{program}: {error}");
        }
        // Off, the axes are as before.
        let off = run(&format!("{go}G0 A30.\nG49\nG91 G28 Z0.\nG90 G0 X1.")).unwrap();
        let [x, _, z] = off.machine.position().to_array_mm();
        assert_eq!((x, z), (6.0, 500.0));
    }

    /// A block on the table is where the table has turned it: it comes to the tool, or the tool to it.
    #[test]
    fn turned_bodies_are_run_into() {
        let scene = SCENE.to_owned()
            + "[tools.1]\nlength_mm = 80\nradius_mm = 3\n[[body]]\nname = \"STOP\"\n\
               shape = { block = { size_mm = [20, 20, 10] } }\nposition_mm = [0, 60, 0]\n";
        let run = |program: &str| {
            let mut cell = Cell::new(Scene::parse(&scene).unwrap(), 1, Log::default());
            let text = format!("T1 M6\nG21 G90 {program}\nM2\n");
            let ran = cell.run(&text, |_, _| Ok::<(), Alarm>(()));
            (ran.err().map(|alarm| alarm.message), cell)
        };
        // The tip is at Z 20; the block's corner passes there at 45 degrees.
        let (message, cell) = run("G0 A90");
        let message = message.unwrap();
        assert!(message.contains("the tool ran into STOP"), "{message}");
        let a = cell.machine.turned_deg()[0];
        assert!((20.0..45.0).contains(&a), "{a}");
        // From above there is nothing where the block was; where it is now, its side is at Z 10.
        let (message, _) = run("G0 Z300\nA90\nY60\nZ90");
        assert_eq!(message, None);
        let (message, cell) = run("G0 Z300\nA90\nY-55\nG1 Z50 F1000");
        let message = message.unwrap();
        assert!(message.contains("ran into STOP"), "{message}");
        let z = cell.machine.position().to_array_mm()[2];
        assert!((z - 90.0).abs() < 0.01, "{z}");
    }

    #[test]
    fn rotary_axes_have_limits_words_and_speeds() {
        let message = |program: &str| match run(program) {
            Err(alarm) => alarm.message,
            Ok(_) => panic!("{program} ran"),
        };
        assert!(message("G90 G0 A91\nM2\n").contains("A 91.000 is outside -90 to 90"));
        assert!(message("G90 G0 B10\nM2\n").contains('B'));
        assert!(message("G90 G93 G1 A10\nM2\n").contains("G93 needs F"));
        assert!(message("G90 F100 G2 X10 I5 A10\nM2\n").contains('A'));
        // Alone, the feed is in degrees a minute; incremental words are angles on top.
        let cell = run("G91 G94 G1 A10 F600\nA10\nM2\n").unwrap();
        assert_eq!(cell.machine.turned_deg(), [20.0, 0.0]);
        let took = cell.machine.status().seconds;
        assert!((2.0..2.1).contains(&took), "{took}");
        // Rapid is no faster than the axis: 3600 degrees a minute.
        let took = run("G90 G0 X1 C180\nM2\n")
            .unwrap()
            .machine
            .status()
            .seconds;
        assert!((3.0..3.2).contains(&took), "{took}");
        // A probe does not know where a turned body is.
        let fanuc = message("G90 G0 A10\nG38.2 Z-10 F50\nM2\n");
        assert!(fanuc.contains("rotary axes to 0"), "{fanuc}");
    }

    #[test]
    fn a_scene_refuses_axes_that_cannot_be() {
        for (from, to) in [
            ("word = \"C\"", "word = \"A\""),
            ("word = \"C\"", "word = \"X\""),
            ("axis = [2, 0, 0]", "axis = [0, 0, 0]"),
            ("counts_per_deg = 1000", "counts_per_deg = 0"),
            ("limits_deg = [-90, 90]", "limits_deg = [90, -90]"),
            ("limits_deg = [-90, 90]", "limits_deg = [10, 90]"),
            ("limits_deg = [-90, 90]", "limits_deg = [nan, 90]"),
        ] {
            let text = SCENE.replace(from, to);
            assert!(Scene::parse(&text).is_err(), "{to}");
        }
    }
}
