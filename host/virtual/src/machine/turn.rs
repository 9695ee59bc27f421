//! Rotary axes in motion.
//!
//! Where axes that carry the workpiece are away from 0, the scene's bodies are not where the
//! collision and the probe look for them: collisions are not looked for then, and a probe is
//! refused. The line scanner follows all axes.

use nalgebra::Vector3;

use super::motion::Profile;
use super::{VirtualMachine, Wires, micros};
use crate::nc::{AxisMotion, MotionRate, Trip};
use crate::scene::AxisLoad;

impl<W: Wires> VirtualMachine<W> {
    /// Whether the bodies of the scene are turned with the table.
    pub(super) fn is_table_turned(&self) -> bool {
        let axes = self.scene.machine.rotary.iter().zip(&self.turned);
        axes.into_iter()
            .any(|(axis, deg)| axis.carries == AxisLoad::Workpiece && *deg != 0.0)
    }

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

    /// All axes go together, each in proportion.
    pub(super) fn turn_to(
        &mut self,
        motion: &AxisMotion,
        to_deg: &[f64],
        block_s: Option<f64>,
    ) -> Result<(), Trip> {
        let (from, to) = (self.position, motion.to.mm);
        self.within_travel(&to)?;
        let from_deg = self.turned.clone();
        let sweeps: Vec<f64> = from_deg.iter().zip(to_deg).map(|(a, b)| b - a).collect();
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
        if sweeps.iter().all(|sweep| *sweep == 0.0) && block_s.is_none() {
            return crate::nc::AxisDrives::travel(self, motion);
        }
        let length = (to - from).norm();
        let largest = sweeps
            .iter()
            .fold(0.0_f64, |most, sweep| most.max(sweep.abs()));
        let way = if length > 1e-9 { length } else { largest };
        if way == 0.0 {
            self.pass(block_s.unwrap_or(0.0));
            return Ok(());
        }
        // As fast as the slowest axis can.
        let axes = self.scene.machine.rotary.iter().zip(&sweeps);
        let fastest = axes
            .filter(|(_, sweep)| sweep.abs() > 0.0)
            .map(|(axis, sweep)| axis.deg_per_min * way / sweep.abs())
            .fold(self.scene.machine.rapid_mm_per_min, f64::min);
        let wanted = match (block_s, motion.rate) {
            (Some(seconds), _) => way / seconds.max(1e-6) * 60.0,
            (None, MotionRate::Rapid) => fastest,
            (None, MotionRate::Feed(feed)) => feed,
        };
        let profile = self.profile(way, MotionRate::Feed(wanted.min(fastest)))?;
        self.go_turning(&from, &to, (&from_deg, &sweeps), &profile, way);
        self.turned = to_deg.to_vec();
        self.tell_turned();
        self.arrive(to);
        Ok(())
    }

    fn go_turning(
        &mut self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        (from_deg, sweeps): (&[f64], &[f64]),
        profile: &Profile,
        way: f64,
    ) {
        if let Some(step_s) = self.wires.sampling_s().filter(|step_s| *step_s > 0.0) {
            let mut time_s = step_s;
            while time_s < profile.duration_s {
                let share = profile.travelled_mm(time_s) / way;
                for ((deg, from), sweep) in self.turned.iter_mut().zip(from_deg).zip(sweeps) {
                    *deg = from + sweep * share;
                }
                self.tell_turned();
                let counts = self.counts(&(from + (to - from) * share));
                self.wires.moved(micros(self.seconds + time_s), counts);
                time_s += step_s;
            }
        }
        self.wait(profile.duration_s);
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
