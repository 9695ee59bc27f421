//! A block of words: the order in which they act.
//!
//! F, S, T, H, D; then the modes; M codes that act before motion; work coordinate
//! system, length, rotation; motion; M0, M1, M2, M5, M9, M30, M98, M99.

use super::codes;
use super::control::{Control, Go};
use super::words::Words;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::modal::{Plane, g_text};
use crate::nc::memory::motion::{AxisDrives, AxisMotion, MotionPath, MotionRate};
use crate::nc::memory::offsets::MAX_TOOL;
use crate::nc::memory::settings::ControlFamily;
use crate::nc::text::block::Word;
use crate::nc::text::evaluate::{evaluate, whole};
use nalgebra::Vector3;
use umi_core::units::Point;

impl Control {
    /// Carries out a block of words.
    pub(crate) fn words(&mut self, words: &[Word], axes: &mut dyn AxisDrives) -> Checked<Go> {
        if self.settings.dialect.is_macro_b()
            && let Some(index) = self.macro_call_at(words, axes)?
        {
            if index > 0 {
                return Err(Fault::new("G65 and G66 stand at the beginning of a block"));
            }
            return self.macro_call(words, axes);
        }
        let words = self.given(words, axes)?;
        codes::check(
            &words,
            &self.motions_in_force(),
            self.settings.dialect,
            &self.settings.rotary_words,
        )?;
        if self.modal.carries_tip() {
            self.may_carry(&words)?;
        }
        self.modes(&words)?;
        self.letters(&words)?;
        for (code, _) in &words.m {
            if !is_after_motion(*code) {
                self.auxiliary(*code, axes)?;
            }
        }
        self.coordinates(&words, axes)?;
        let has_moved = self.motion(&words, axes)?;
        let mut go = Go::Next;
        for (code, at) in &words.m {
            self.modal.m = *code;
            if is_after_motion(*code) {
                let next = self
                    .after_motion(*code, &words, axes)
                    .map_err(|f| f.at(*at))?;
                if next != Go::Next {
                    if go != Go::Next {
                        return Err(Fault::new(
                            "two M codes that end the block: write two blocks",
                        ));
                    }
                    go = next;
                }
            }
        }
        if go == Go::Next && has_moved && self.modal_call.is_some() {
            return self.call_after_motion();
        }
        Ok(go)
    }

    /// Where a `G65` or `G66` stands among the words.
    fn macro_call_at(&self, words: &[Word], axes: &dyn AxisDrives) -> Checked<Option<usize>> {
        for (index, word) in words.iter().enumerate() {
            if word.letter == b'G' {
                let value = evaluate(&word.value, &self.view(axes))?;
                if matches!(value.and_then(|v| whole(v, 999)), Some(65 | 66)) {
                    return Ok(Some(index));
                }
            }
        }
        Ok(None)
    }

    /// The codes to which axis words belong if a block names none.
    fn motions_in_force(&self) -> Vec<u16> {
        match self.modal.cycle {
            Some((code, _)) => vec![code],
            None => vec![self.modal.motion],
        }
    }

    fn modes(&mut self, words: &Words) -> Checked<()> {
        for (code, at) in &words.g {
            let modal = &mut self.modal;
            match code {
                170 | 180 | 190 => {
                    let plane = match code {
                        170 => Plane::Xy,
                        180 => Plane::Zx,
                        _ => Plane::Yz,
                    };
                    if plane != modal.plane && !modal.rotations.is_empty() {
                        return Err(
                            Fault::new("no change of plane while G68 is on: G69 first").at(*at)
                        );
                    }
                    modal.plane = plane;
                }
                200 => modal.is_inch = true,
                210 => modal.is_inch = false,
                900 => modal.is_incremental = false,
                901 => modal.has_absolute_centres = true,
                911 => modal.has_absolute_centres = false,
                // Neither feed is one in the other mode.
                930 | 940 if modal.is_inverse_time != (*code == 930) => {
                    modal.is_inverse_time = *code == 930;
                    modal.feed = None;
                }
                910 => modal.is_incremental = true,
                980 => modal.returns_to_r = false,
                990 => modal.returns_to_r = true,
                610 => modal.is_exact_stop = true,
                640 => modal.is_exact_stop = false,
                500 | 510 => modal.is_scaled = *code == 510,
                501 | 511 => modal.is_mirrored = *code == 511,
                670 => self.modal_call = None,
                410 | 420 => {
                    return Err(Fault::new(
                        "cutter compensation (G41, G42) is not interpreted: program the centre",
                    )
                    .at(*at));
                }
                950 => {
                    return Err(
                        Fault::new("feed per revolution (G95) is not interpreted: G94").at(*at),
                    );
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// F, S, T, H, D.
    fn letters(&mut self, words: &Words) -> Checked<()> {
        if let Some(f) = words.number(b'F') {
            if f < 0.0 {
                return Err(Fault::new(format!("F{f}: a feed is above zero")));
            }
            // In inverse time it is the block's alone.
            if !self.modal.is_inverse_time {
                self.modal.feed = Some(f * self.modal.unit_mm()).filter(|f| *f > 0.0);
            }
        }
        if let Some(s) = words.number(b'S') {
            if s < 0.0 {
                return Err(Fault::new(format!("S{s}: a speed is not negative")));
            }
            self.modal.s = s;
        }
        if let Some(t) = words.whole(b'T', 99_999_999)? {
            self.modal.t = t;
        }
        if let Some(d) = words.whole(b'D', MAX_TOOL)? {
            self.modal.d = d;
        }
        if let Some(h) = words.whole(b'H', MAX_TOOL)? {
            self.modal.h = h;
        }
        Ok(())
    }

    /// An M code that acts before the motion.
    fn auxiliary(&mut self, code: u32, axes: &mut dyn AxisDrives) -> Checked<()> {
        match code {
            6 => {
                axes.change_tool(self.modal.t)?;
                self.modal.tool = self.modal.t;
            }
            _ => axes.auxiliary(code, self.modal.s)?,
        }
        Ok(())
    }

    fn after_motion(&mut self, code: u32, words: &Words, axes: &mut dyn AxisDrives) -> Checked<Go> {
        match code {
            0 => Ok(Go::Stop(None)),
            1 if self.settings.optional_stop => Ok(Go::Stop(None)),
            1 => Ok(Go::Next),
            2 | 30 => {
                // The machine stops its spindle.
                axes.auxiliary(code, self.modal.s)?;
                self.end_of_program();
                Ok(Go::End)
            }
            97 | 98 => self.sub_call(code, words),
            198 => self.external_call(words, axes),
            50 if self.settings.dialect == ControlFamily::LinuxCnc => {
                self.modal.has_no_override = words.number(b'P') == Some(0.0);
                Ok(Go::Next)
            }
            66 if self.settings.dialect == ControlFamily::LinuxCnc => {
                self.wait_for_input(words, axes)?;
                Ok(Go::Next)
            }
            99 => self.return_from(words),
            _ => {
                axes.auxiliary(code, self.modal.s)?;
                Ok(Go::Next)
            }
        }
    }

    /// LinuxCNC's `M66 P L Q`: a digital input into `#5399`, -1 if it did not become what is
    /// waited for (L3 on, L4 off) within Q seconds.
    fn wait_for_input(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        let Some(number) = words.whole(b'P', 63)? else {
            return Err(Fault::new(
                "M66 needs P, a digital input; analog ones (E) are not interpreted",
            ));
        };
        let wanted = match words.whole(b'L', 4)?.unwrap_or(0) {
            0 => None,
            3 => Some(true),
            4 => Some(false),
            mode => {
                return Err(Fault::new(format!(
                    "M66 L{mode}: L0, L3 and L4 are interpreted"
                )));
            }
        };
        let timeout_s = words.number(b'Q').unwrap_or(0.0);
        if wanted.is_some() && (timeout_s.is_nan() || timeout_s <= 0.0) {
            return Err(Fault::new("M66 that waits needs Q, seconds above 0"));
        }
        let number = u16::try_from(number).map_err(|_| Fault::new("M66 P is too large"))?;
        let found = axes.await_input(number, wanted, timeout_s)?;
        self.input_read = found.map_or(-1.0, |on| f64::from(u8::from(on)));
        Ok(())
    }

    /// What M2 and M30 reset: the variables of the programs that were called; in
    /// LinuxCNC and GRBL also modes.
    fn end_of_program(&mut self) {
        self.modal.cycle = None;
        self.modal.has_no_override = false;
        self.stored.remove(&3004);
        if !self.settings.dialect.is_macro_b() {
            self.modal.plane = Plane::Xy;
            self.modal.is_incremental = false;
            if self.modal.is_inverse_time {
                self.modal.is_inverse_time = false;
                self.modal.feed = None;
            }
            self.modal.motion = 10;
            self.modal.work = crate::nc::memory::offsets::OffsetSystem::Standard(1);
        }
    }

    /// Where the tool's tip is, in the coordinates of the program, mm.
    pub(crate) fn here(&self, axes: &dyn AxisDrives) -> Vector3<f64> {
        self.frame().undo(self.carried(axes))
    }

    /// What the operator's override makes of a feed now.
    fn overridden(&self) -> f64 {
        let bits = self.stored.get(&3004).copied().unwrap_or(0.0);
        let is_held_off = self.modal.has_no_override || (bits as u32) & 2 == 2;
        match is_held_off {
            true => 1.0,
            false => self.settings.feed_override_percent / 100.0,
        }
    }

    /// The feed in force.
    pub(crate) fn feed(&self) -> Checked<MotionRate> {
        let feed = self.modal.feed.map(|feed| feed * self.overridden());
        feed.map(MotionRate::Feed).ok_or_else(|| {
            let what = if self.modal.is_inverse_time {
                "G93 goes with G1, G2 and G3: G94 before this"
            } else {
                "no feed: give F in this block or before it"
            };
            Fault::ps(11, what)
        })
    }

    /// The feed of a block whose path has this length.
    pub(crate) fn feed_along(&self, words: &Words, length_mm: f64) -> Checked<MotionRate> {
        if !self.modal.is_inverse_time {
            return self.feed();
        }
        let f = words.number(b'F').filter(|f| *f > 0.0);
        let f = f.ok_or_else(|| Fault::ps(11, "G93 needs F in every block that cuts"))?;
        // A way of no length is not rapid.
        Ok(MotionRate::Feed(
            f * length_mm.max(1e-9) * self.overridden(),
        ))
    }

    /// Moves straight to a point of the program.
    pub(crate) fn line(
        &mut self,
        to: Vector3<f64>,
        rate: MotionRate,
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        let to = self.frame().apply(to);
        self.straight(to, rate, axes)
    }

    /// Moves straight to a point of the machine.
    pub(crate) fn straight(
        &mut self,
        to: Vector3<f64>,
        rate: MotionRate,
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        axes.travel(&AxisMotion {
            to: finite(to)?,
            path: MotionPath::Line,
            rate,
        })?;
        self.look(axes);
        Ok(())
    }

    /// Scaling and mirror are modes that a macro can read; where they would lead is not
    /// interpreted.
    fn is_plain(&self, words: &Words) -> Checked<()> {
        let sets =
            |code: u16| codes::takes_axes(code) && !matches!(code, 280 | 300 | 310 | 382..=385);
        let moves = words.has_axes() && !words.g.iter().any(|(code, _)| sets(*code));
        if moves && (self.modal.is_scaled || self.modal.is_mirrored) {
            return Err(Fault::new(
                "motion in G51 or G51.1 is not interpreted: G50, G50.1 first",
            ));
        }
        Ok(())
    }

    /// Carries out the motion of a block; whether there was one.
    fn motion(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<bool> {
        self.is_plain(words)?;
        for (code, at) in &words.g {
            match code {
                0 | 10 | 20 | 30 => {
                    self.modal.motion = *code;
                    self.modal.cycle = None;
                }
                800 => {
                    self.modal.cycle = None;
                    if !self.settings.dialect.is_macro_b() {
                        self.modal.motion = 800;
                    }
                }
                310 => {
                    self.skip(words, axes).map_err(|f| f.at(*at))?;
                    return Ok(true);
                }
                382..=385 => {
                    self.modal.motion = 800;
                    self.probe(*code, words, axes).map_err(|f| f.at(*at))?;
                    return Ok(true);
                }
                _ => {}
            }
        }
        if words.g.iter().any(|(code, _)| codes::takes_axes(*code)) {
            return Ok(false);
        }
        if words.has_g(530) {
            return self.machine_motion(words, axes);
        }
        if let Some(code) = words
            .g
            .iter()
            .map(|(code, _)| *code)
            .find(|code| matches!(code, 730 | 810 | 820 | 830 | 840 | 850 | 860 | 890))
        {
            return self.cycle(Some(code), words, axes);
        }
        if let Some((code, _)) = self.modal.cycle {
            return if words.has_axes() || words.has(b'R') {
                self.cycle(Some(code), words, axes)
            } else {
                Ok(false)
            };
        }
        let is_arc = matches!(self.modal.motion, 20 | 30);
        let has_center = [b'I', b'J', b'K'].iter().any(|letter| words.has(*letter));
        let turns = self.turns(words, axes)?;
        if !(words.has_axes() || turns.is_some() || is_arc && has_center) {
            return Ok(false);
        }
        let from = self.here(axes);
        let to = self.target(words, from);
        if self.modal.carries_tip() {
            let to_deg = turns.unwrap_or_else(|| axes.turned_deg());
            self.carry(words, (from, to), &to_deg, axes)?;
            return Ok(true);
        }
        if let Some(to_deg) = turns {
            self.turn(words, (from, to), &to_deg, axes)?;
            return Ok(true);
        }
        match self.modal.motion {
            0 => self.line(to, MotionRate::Rapid, axes)?,
            10 => {
                let rate = self.feed_along(words, (to - from).norm())?;
                self.line(to, rate, axes)?;
            }
            20 | 30 => self.arc(words, from, to, axes)?,
            _ => {
                return Err(Fault::new(
                    "axis words, but no motion is in force: give G0, G1, G2 or G3",
                ));
            }
        }
        Ok(true)
    }

    /// Where the rotary words lead, degrees; none where the block has none.
    fn turns(&self, words: &Words, axes: &dyn AxisDrives) -> Checked<Option<Vec<f64>>> {
        let letters = self.settings.rotary_words.as_bytes();
        if !letters.iter().any(|letter| words.has(*letter)) {
            return Ok(None);
        }
        let mut to = axes.turned_deg();
        if to.len() != letters.len() {
            return Err(Fault::new(format!(
                "this machine has no axes {}: remove their words",
                self.settings.rotary_words
            )));
        }
        for (slot, letter) in to.iter_mut().zip(letters) {
            if let Some(value) = self.angle_word(words, *letter) {
                *slot = if self.modal.is_incremental {
                    *slot + value
                } else {
                    value
                };
            }
        }
        Ok(Some(to))
    }

    /// Moves straight while rotary axes turn.
    fn turn(
        &mut self,
        words: &Words,
        (from, to): (Vector3<f64>, Vector3<f64>),
        to_deg: &[f64],
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        let (rate, block_s) = self.turning_rate(words, (to - from).norm())?;
        let to = finite(self.frame().apply(to))?;
        let motion = AxisMotion {
            to,
            path: MotionPath::Line,
            rate,
        };
        axes.turn(&motion, to_deg, block_s)?;
        self.look(axes);
        Ok(())
    }

    /// Refuses what has no meaning while the tip is carried through the rotary axes.
    fn may_carry(&self, words: &Words) -> Checked<()> {
        let codes = words.g.iter().find(|(code, _)| !codes::may_carry(*code));
        if let Some((code, at)) = codes {
            let code = g_text(*code);
            return Err(Fault::new(format!("{code} while G43.4 is on: G49 first")).at(*at));
        }
        if words.m.iter().any(|(code, _)| *code == 6) {
            return Err(Fault::new("M6 while G43.4 is on: G49 first"));
        }
        Ok(())
    }

    /// Moves the tool's tip straight on the table while rotary axes turn.
    fn carry(
        &mut self,
        words: &Words,
        (from, to): (Vector3<f64>, Vector3<f64>),
        to_deg: &[f64],
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        let (rate, block_s) = self.turning_rate(words, (to - from).norm())?;
        let motion = AxisMotion {
            to: finite(self.frame().apply(to))?,
            path: MotionPath::Line,
            rate,
        };
        axes.carry(&motion, to_deg, self.modal.length_mm, block_s)?;
        self.look(axes);
        Ok(())
    }

    /// The rate of a straight motion in which rotary axes turn, and its time with `G93`.
    fn turning_rate(&self, words: &Words, length_mm: f64) -> Checked<(MotionRate, Option<f64>)> {
        let rate = match self.modal.motion {
            0 => MotionRate::Rapid,
            10 => self.feed_along(words, length_mm)?,
            _ => return Err(Fault::new("rotary axes move with G0 and G1 only")),
        };
        let inverse = self.modal.is_inverse_time && self.modal.motion == 10;
        let block_s = words.number(b'F').filter(|_| inverse);
        Ok((rate, block_s.map(|per_min| 60.0 / per_min)))
    }

    /// `G53`: to machine coordinates.
    fn machine_motion(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<bool> {
        if self.modal.is_incremental {
            return Err(Fault::new("G53 goes to machine coordinates: it needs G90"));
        }
        let mut to = axes.position().mm;
        for (axis, letter) in crate::nc::run::words::AXES.iter().enumerate() {
            if let (Some(value), Some(slot)) = (self.length_word(words, *letter), to.get_mut(axis))
            {
                *slot = value;
            }
        }
        let rate = match (self.settings.dialect, self.modal.motion) {
            // Fanuc: always at rapid.
            (ControlFamily::Fanuc | ControlFamily::Mitsubishi, _) | (_, 0) => MotionRate::Rapid,
            (_, 10) => self.feed()?,
            _ => return Err(Fault::new("G53 needs G0 or G1")),
        };
        self.straight(to, rate, axes)?;
        Ok(true)
    }
}

/// A point to which axes can go.
pub(crate) fn finite(mm: Vector3<f64>) -> Checked<Point> {
    let point = Point { mm };
    if point.is_finite() && mm.amax() < 1e7 {
        Ok(point)
    } else {
        Err(Fault::ps(
            111,
            "the end of this motion, or the centre of its arc, is too far away",
        ))
    }
}

const fn is_after_motion(m: u32) -> bool {
    matches!(m, 0 | 1 | 2 | 5 | 9 | 30 | 50 | 66 | 97 | 98 | 99 | 198)
}
