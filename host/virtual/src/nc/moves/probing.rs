//! Motions with skip: `G31`, `G38.2` to `G38.5`.

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::run::control::Control;
use crate::nc::run::execute::finite;
use crate::nc::run::words::Words;

impl Control {
    /// `G31`. The stored position is #5061.. as [`crate::nc::run::system`] says. Without a touch
    /// the program goes on, and it is the end of the motion: a macro must compare.
    pub(crate) fn skip(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        if !words.has_axes() {
            return Err(Fault::new("G31 needs X, Y or Z"));
        }
        // P names the skip input; there is one probe here.
        if let Some(p) = words.whole(b'P', 255)?
            && p == 0
        {
            return Err(Fault::new("G31 P: the skip input is 1 or more"));
        }
        let skip = self.run_to_skip(words, false, axes)?;
        self.skip_mm = self.work_frame().undo(skip.stored.mm);
        self.has_touched = skip.touched;
        Ok(())
    }

    /// `G38.2` (toward, alarm without contact), `.3` (toward), `.4` (away, alarm), `.5`.
    pub(crate) fn probe(
        &mut self,
        code: u16,
        words: &Words,
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        if !words.has_axes() {
            return Err(Fault::new("G38 needs X, Y or Z"));
        }
        let leaving = matches!(code, 384 | 385);
        if !leaving && axes.skip_is_on() {
            let number = code % 10;
            let message =
                format!("the probe is on already where G38.{number} begins: move away first");
            return Err(match self.settings.dialect {
                ControlFamily::Grbl => Fault::own(4, message),
                _ => Fault::new(message),
            });
        }
        let here = self.here(axes);
        if self.settings.dialect == ControlFamily::LinuxCnc && self.target(words, here) == here {
            return Err(Fault::new("G38 to where the axes stand: leave it out"));
        }
        let skip = self.run_to_skip(words, leaving, axes)?;
        self.skip_mm = self.frame().undo(skip.stored.mm);
        self.has_touched = skip.touched;
        match self.settings.dialect {
            ControlFamily::Grbl => self.report_to_grbl(&skip, axes)?,
            _ => self.log_probe(axes)?,
        }
        if !skip.touched && matches!(code, 382 | 384) {
            let message = if leaving {
                "contact was not lost: G38.5 goes on without an alarm"
            } else {
                "nothing was touched: begin nearer, or G38.3 goes on without an alarm"
            };
            return Err(match self.settings.dialect {
                ControlFamily::Grbl => Fault::own(5, message),
                _ => Fault::new(message),
            });
        }
        Ok(())
    }

    fn run_to_skip(
        &mut self,
        words: &Words,
        leaving: bool,
        axes: &mut dyn AxisDrives,
    ) -> Checked<Skip> {
        let MotionRate::Feed(feed) = self.feed()? else {
            return Err(Fault::ps(11, "no feed: give F"));
        };
        let to = self.target(words, self.here(axes));
        let motion = AxisMotion {
            to: finite(self.frame().apply(to))?,
            path: MotionPath::Line,
            rate: MotionRate::Feed(feed),
        };
        let skip = axes.skip(&motion, leaving)?;
        self.look(axes);
        Ok(skip)
    }

    /// `[PRB:x,y,z:s]` with machine coordinates, three decimals (four in inches).
    fn report_to_grbl(&self, skip: &Skip, axes: &mut dyn AxisDrives) -> Checked<()> {
        let [x, y, z] = skip
            .stored
            .to_array_mm()
            .map(|mm| mm / self.modal.unit_mm());
        let decimals = if self.modal.is_inch { 4 } else { 3 };
        let touched = u8::from(skip.touched);
        let line = format!("[PRB:{x:.decimals$},{y:.decimals$},{z:.decimals$}:{touched}]\r\n");
        axes.print(line.as_bytes())?;
        Ok(())
    }

    /// `(PROBEOPEN file)`: nine numbers in program units; a repetition is not written.
    fn log_probe(&mut self, axes: &mut dyn AxisDrives) -> Checked<()> {
        let unit = self.modal.unit_mm();
        let position: [f64; 3] = (self.skip_mm / unit).into();
        if !self.logs_probes || self.logged == Some(position) {
            return Ok(());
        }
        self.logged = Some(position);
        let [x, y, z] = position;
        let zero = 0.0;
        let rest = format!("{zero:.6} ").repeat(5);
        let line = format!("{x:.6} {y:.6} {z:.6} {rest}{zero:.6}\n");
        axes.print(line.as_bytes())?;
        Ok(())
    }
}
