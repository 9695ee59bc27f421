//! G codes that set coordinates, or that move in them in one go: G4, G10, G28, G30,
//! G43, G44, G49, G52, G54 to G59, G54.1, G54.4, G68, G69, G92.

use nalgebra::{Unit, Vector3};

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::modal::{TIP, g_text};
use crate::nc::memory::motion::{AxisDrives, MotionRate};
use crate::nc::memory::offsets::{MAX_EXTENDED, MAX_TOOL, OffsetSystem};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::memory::transform::{Frame, rotation};
use crate::nc::run::codes;
use crate::nc::run::control::Control;
use crate::nc::run::words::{AXES, Words};
use crate::nc::text::evaluate::whole;

impl Control {
    /// Carries out the codes that set coordinates, before the motion of the block.
    pub(crate) fn coordinates(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        // A rotation ends before a work coordinate system is chosen in the same block.
        if words.has_g(690) || words.has_g(691) {
            self.modal.rotations.clear();
        }
        for (code, at) in &words.g {
            self.coordinate(*code, words, axes).map_err(|f| f.at(*at))?;
        }
        let has_length = words
            .g
            .iter()
            .any(|(code, _)| matches!(code, 430 | 440 | 431 | 490 | &TIP));
        if words.has(b'H') && !has_length && self.modal.carries_tip() {
            return Err(Fault::new("another H while G43.4 is on: G49 first"));
        }
        if words.has(b'H') && !has_length && matches!(self.modal.length, 430 | 440) {
            self.take_length();
        }
        Ok(())
    }

    fn coordinate(&mut self, code: u16, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        let is_fanuc = matches!(
            self.settings.dialect,
            ControlFamily::Fanuc | ControlFamily::Mitsubishi
        );
        if is_fanuc
            && !self.modal.rotations.is_empty()
            && matches!(
                code,
                280 | 300 | 520 | 530 | 540..=541 | 544 | 550 | 560 | 570 | 580 | 590 | 920
            )
        {
            return Err(Fault::new(format!(
                "{} must not stand between G68 and G69",
                g_text(code)
            )));
        }
        match code {
            40 => self.dwell(words, axes),
            100 => self.set_data(words, axes),
            280 | 300 => self.reference(code, words, axes),
            // The length itself, in no table.
            431 => {
                let z = self.length_word(words, b'Z');
                self.modal.length_mm = z.ok_or_else(|| Fault::new("G43.1 needs Z, the length"))?;
                self.modal.length = 430;
                Ok(())
            }
            430 | 440 => {
                if matches!(self.settings.dialect, ControlFamily::LinuxCnc) && !words.has(b'H') {
                    self.modal.h = self.modal.tool;
                }
                self.modal.length = if code == 440 { 440 } else { 430 };
                self.take_length();
                Ok(())
            }
            TIP => self.carry_tip(),
            490 => {
                self.modal.length = 490;
                self.modal.length_mm = 0.0;
                Ok(())
            }
            520 => {
                self.set_local(words);
                Ok(())
            }
            540 | 541 | 1540 => {
                let dialect = self.settings.dialect;
                let (g, m) = (words.g.iter().map(|g| g.0), words.m.iter().map(|m| m.0));
                let is_taken = codes::others_take_p(g, m, dialect);
                let has = codes::addresses(code, dialect).is_some_and(|takes| takes == "P");
                let may_be_offset = |p| whole(p, u32::from(MAX_EXTENDED)).is_some_and(|p| p > 0);
                let p = match words.get(b'P') {
                    Some(p) if has && is_taken && (code != 540 || may_be_offset(p.value)) => {
                        return Err(Fault::new(
                            "P may say which additional work offset this is, or belong to the \
                             word beside it: write them in two blocks",
                        )
                        .at(p.at));
                    }
                    _ if is_taken => None,
                    _ => words.whole(b'P', u32::from(MAX_EXTENDED))?,
                };
                self.modal.work = match p {
                    None if code == 540 => OffsetSystem::Standard(1),
                    Some(p @ 1..) => OffsetSystem::Extended(u16::try_from(p).unwrap_or(1)),
                    _ => {
                        return Err(Fault::new(format!(
                            "{} needs P1 to P{MAX_EXTENDED}",
                            g_text(code)
                        )));
                    }
                };
                Ok(())
            }
            550 | 560 | 570 | 580 | 590 => {
                let number = u8::try_from((code - 530) / 10).unwrap_or(1);
                self.modal.work = OffsetSystem::Standard(number);
                Ok(())
            }
            591..=593 => {
                let number = u8::try_from(code - 584).unwrap_or(1);
                self.modal.work = OffsetSystem::Standard(number);
                Ok(())
            }
            544 => {
                // Mazak: alarm 1815 unless it stands alone.
                if words.g.len() + words.m.len() > 1 || words.others.len() > 1 {
                    return Err(Fault::new("G54.4 P stands alone in its block"));
                }
                let p = words
                    .whole(b'P', 7)?
                    .ok_or_else(|| Fault::new("G54.4 needs P1 to P7, or P0 to cancel"))?;
                let set = u8::try_from(p).ok().filter(|p| *p > 0);
                if set.is_some_and(|p| !self.offsets.has_setting_error(p)) {
                    return Err(Fault::new(format!(
                        "G54.4 P{p}: this setting error was never set, P{p} in the scene's \
                         [setting_errors]"
                    )));
                }
                self.modal.setting_error = set;
                Ok(())
            }
            680 | 681 => self.rotate(words, axes),
            920 => {
                if !words.has_axes() {
                    return Err(Fault::new("G92 needs X, Y or Z"));
                }
                if !self.modal.rotations.is_empty() || self.modal.setting_error.is_some() {
                    return Err(Fault::new("G92 needs G69 and G54.4 P0 first"));
                }
                let here = self.here(axes);
                for (axis, letter) in AXES.iter().enumerate() {
                    if let (Some(value), Some(now), Some(slot)) = (
                        self.length_word(words, *letter),
                        here.get(axis),
                        self.modal.shift.get_mut(axis),
                    ) {
                        *slot += now - value;
                        // Fanuc: the local coordinates of this axis end, and their shift is in it.
                        if let Some(local) = self.modal.local.get_mut(axis) {
                            *slot += core::mem::take(local);
                        }
                    }
                }
                Ok(())
            }
            921 => {
                self.modal.shift = Vector3::zeros();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// `G52`: a shift of its own, that no variable holds. A Haas keeps it in #5201, which its
    /// `G10 L2 P0` sets too; LinuxCNC keeps it where `G92` has its own (#5211).
    fn set_local(&mut self, words: &Words) {
        let mut table = self.offsets.work(OffsetSystem::External);
        for (axis, letter) in AXES.iter().enumerate() {
            let value = self.length_word(words, *letter);
            let place = match self.settings.dialect {
                ControlFamily::Haas => table.get_mut(axis),
                ControlFamily::LinuxCnc => self.modal.shift.get_mut(axis),
                _ => self.modal.local.get_mut(axis),
            };
            if let (Some(value), Some(slot)) = (value, place) {
                *slot = value;
            }
        }
        if self.settings.dialect == ControlFamily::Haas {
            self.offsets.set_work(OffsetSystem::External, table);
        }
    }

    /// `G43.4`: from now on X, Y, Z are places of the table, which turn with it, and the control
    /// moves the axes so that the tool's tip goes there. The work offset is that of the table with
    /// its axes at 0 (Fanuc's tool center point control, type 1, with the table's coordinate
    /// system as the program's). A control whose parameters glue that system to the table as it
    /// stands here goes elsewhere, unless it stands at 0.
    fn carry_tip(&mut self) -> Checked<()> {
        if self.settings.rotary_words.is_empty() {
            return Err(Fault::new("G43.4 needs a machine with rotary axes"));
        }
        if !self.modal.rotations.is_empty() || self.modal.cycle.is_some() {
            return Err(Fault::new("G43.4 needs G69 and G80 first"));
        }
        self.modal.length = TIP;
        self.modal.length_mm = self.offsets.length(self.modal.h);
        Ok(())
    }

    fn take_length(&mut self) {
        let length = self.offsets.length(self.modal.h);
        self.modal.length_mm = if self.modal.length == 440 {
            -length
        } else {
            length
        };
    }

    /// `G4`: P in milliseconds (LinuxCNC, GRBL: seconds), X in seconds.
    fn dwell(&mut self, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        let is_macro_b = self.settings.dialect.is_macro_b();
        let seconds = match (words.get(b'P'), words.get(b'X')) {
            (Some(p), None) if !is_macro_b => p.value,
            (Some(p), None)
                if self.settings.dialect == ControlFamily::Haas && !p.is_without_point =>
            {
                p.value
            }
            (Some(p), None) => p.value / 1000.0,
            (None, Some(x)) if x.is_without_point => x.value / 1000.0,
            (None, Some(x)) => x.value,
            // A block of G4 alone waits for the axes (exact stop).
            (None, None) if is_macro_b => 0.0,
            _ => return Err(Fault::new("G4 needs one of P and X")),
        };
        if !(0.0..=100_000.0).contains(&seconds) {
            return Err(Fault::new(format!("G4 of {seconds} seconds")));
        }
        axes.dwell(seconds);
        Ok(())
    }

    /// `G28`, `G30`: to a reference point over an intermediate one.
    fn reference(&mut self, code: u16, words: &Words, axes: &mut dyn AxisDrives) -> Checked<()> {
        let reference = if code == 280 {
            axes.reference_point().mm
        } else {
            match words.whole(b'P', 4)? {
                None | Some(2) => {}
                Some(p) => return Err(Fault::new(format!("there is no reference point P{p}"))),
            }
            let point = self.settings.second_reference_mm.ok_or_else(|| {
                Fault::new("there is no second reference point: set second_reference_mm")
            })?;
            Vector3::from(point)
        };
        if !words.has_axes() && self.settings.dialect.is_macro_b() {
            return Err(Fault::new(format!(
                "{} needs the axes to move: X, Y, Z",
                g_text(code)
            )));
        }
        let all = !words.has_axes();
        let over = self.target(words, self.here(axes));
        if !all {
            self.line(over, MotionRate::Rapid, axes)?;
        }
        let mut to = axes.position().mm;
        for (axis, letter) in AXES.iter().enumerate() {
            if (all || words.has(*letter))
                && let (Some(slot), Some(value)) = (to.get_mut(axis), reference.get(axis))
            {
                *slot = *value;
            }
        }
        self.straight(to, MotionRate::Rapid, axes)
    }

    /// `G68`: about a point in the plane (X Y R), or about any axis (X Y Z I J K R).
    ///
    /// In the plane the coordinates turn about the point. The three-dimensional form
    /// also moves the origin there: program (0, 0, 0) is the point itself (Fanuc A-62223E,
    /// 2.3, and Mitsubishi M700V, 13.23: work = M program + (x, y, z)), and a second one
    /// is in the coordinates of the first. Both are right-handed. Tool length comes after
    /// the rotation (Fanuc 15i, B-63324EN).
    fn rotate(&mut self, words: &Words, axes: &dyn AxisDrives) -> Checked<()> {
        let here = self.here(axes);
        // The point is absolute, in G91 too.
        let mut center = here;
        for (axis, letter) in AXES.iter().enumerate() {
            if let (Some(value), Some(slot)) =
                (self.length_word(words, *letter), center.get_mut(axis))
            {
                *slot = value;
            }
        }
        let degrees = self.angle_word(words, b'R');
        let ijk = [b'I', b'J', b'K'].map(|letter| words.number(letter));
        let frame = match ijk {
            [None, None, None] => {
                let degrees = degrees.ok_or_else(|| Fault::new("G68 needs the angle R"))?;
                if !self.modal.rotations.is_empty() {
                    return Err(Fault::new("G68 is already on: G69 first"));
                }
                let [_, _, normal] = self.modal.plane.axes();
                let mut axis = Vector3::zeros();
                if let (Some(slot), Some(at)) = (axis.get_mut(normal), center.get_mut(normal)) {
                    *slot = 1.0;
                    *at = 0.0;
                }
                Frame::about(center, Unit::new_unchecked(axis), degrees)
            }
            [Some(i), Some(j), Some(k)] => {
                let axis = Unit::try_new(Vector3::new(i, j, k), 1e-12).ok_or_else(|| {
                    Fault::ps(5044, "I, J and K are all zero: they give the axis of G68")
                })?;
                let degrees =
                    degrees.ok_or_else(|| Fault::ps(5044, "G68 with I, J, K needs the angle R"))?;
                if self.modal.rotations.len() >= 2 {
                    return Err(Fault::ps(5044, "G68 is on twice: G69 first"));
                }
                Frame {
                    turn: rotation(axis, degrees),
                    shift: center,
                }
            }
            _ => {
                return Err(Fault::ps(5044, "G68 about an axis needs all of I, J and K"));
            }
        };
        self.modal.rotations.push(frame);
        Ok(())
    }

    /// `G10`.
    fn set_data(&mut self, words: &Words, axes: &dyn AxisDrives) -> Checked<()> {
        let p = words.whole(b'P', 9999)?;
        match words.whole(b'L', 99)? {
            Some(2) => {
                let offset = match (p, self.settings.dialect) {
                    (Some(0), ControlFamily::LinuxCnc | ControlFamily::Grbl)
                    | (None, ControlFamily::Grbl) => self.modal.work,
                    (Some(0), _) => OffsetSystem::External,
                    (Some(p @ 1..=6), _) | (Some(p @ 7..=9), ControlFamily::LinuxCnc) => {
                        OffsetSystem::Standard(u8::try_from(p).unwrap_or(1))
                    }
                    _ => return Err(Fault::ps(31, "G10 L2 needs P0 to P6")),
                };
                self.set_origin(offset, words)
            }
            Some(20) if self.settings.dialect.is_macro_b() => match p {
                Some(p) if (1..=u32::from(MAX_EXTENDED)).contains(&p) => {
                    self.set_origin(OffsetSystem::Extended(u16::try_from(p).unwrap_or(1)), words)
                }
                _ => Err(Fault::ps(
                    31,
                    format!("G10 L20 needs P1 to P{MAX_EXTENDED}"),
                )),
            },
            Some(20) => self.set_origin_here(p, words, axes),
            None | Some(1 | 10 | 11 | 12 | 13) if self.settings.dialect != ControlFamily::Grbl => {
                self.set_tool(p, words)
            }
            _ => Err(Fault::new("G10 knows L1, L2, L10 to L13 and L20")),
        }
    }

    /// `G10 L2`, `L20`: G90 replaces, G91 adds.
    fn set_origin(&mut self, offset: OffsetSystem, words: &Words) -> Checked<()> {
        let mut origin = self.offsets.work(offset);
        let adds = self.modal.is_incremental && self.settings.dialect.is_macro_b();
        for (slot, letter) in origin.iter_mut().zip(AXES) {
            if let Some(value) = self.length_word(words, letter) {
                *slot = if adds { *slot + value } else { value };
            }
        }
        if origin.iter().any(|mm| !(-1e6..=1e6).contains(mm)) {
            return Err(Fault::ps(32, "the offset is too large"));
        }
        match (words.number(b'R'), self.settings.dialect) {
            (None, _) => {}
            (Some(degrees), ControlFamily::LinuxCnc) if degrees.abs() < 1e6 => {
                self.offsets.set_turn(offset, degrees);
            }
            _ => return Err(Fault::new("G10 L2 takes no R on this control")),
        }
        self.offsets.set_work(offset, origin);
        Ok(())
    }

    /// `G10 L20` of LinuxCNC and GRBL: the present position gets these coordinates.
    fn set_origin_here(
        &mut self,
        p: Option<u32>,
        words: &Words,
        axes: &dyn AxisDrives,
    ) -> Checked<()> {
        let offset = match p {
            None | Some(0) => self.modal.work,
            Some(p @ 1..=9) => OffsetSystem::Standard(u8::try_from(p).unwrap_or(1)),
            _ => return Err(Fault::new("G10 L20 needs P1 to P9")),
        };
        if words.has(b'R') {
            return Err(Fault::new("G10 L20 takes no R"));
        }
        let turn = rotation(Vector3::z_axis(), self.offsets.turn(offset));
        let tip = axes.position().mm - self.length();
        let origin = Vector3::from(self.offsets.work(offset));
        let mut here = turn.transpose() * (tip - origin) - self.modal.shift;
        for (slot, letter) in here.iter_mut().zip(AXES) {
            if let Some(value) = self.length_word(words, letter) {
                *slot = value;
            }
        }
        let origin = tip - turn * (here + self.modal.shift);
        self.offsets.set_work(offset, origin.into());
        Ok(())
    }

    /// Tool offsets: `L10`, `L11` the length (R), `L12`, `L13` the radius (R); without L
    /// or with `L1` Z is the length and R the radius, R alone both (one table, memory A).
    fn set_tool(&mut self, p: Option<u32>, words: &Words) -> Checked<()> {
        let number = p
            .filter(|p| (1..=MAX_TOOL).contains(p))
            .ok_or_else(|| Fault::ps(30, format!("G10 needs P1 to P{MAX_TOOL}")))?;
        if words.has(b'X') || words.has(b'Y') {
            return Err(Fault::new("a tool has no offset in X and Y here"));
        }
        let adds = self.modal.is_incremental && self.settings.dialect.is_macro_b();
        let base = |old: f64| if adds { old } else { 0.0 };
        let length = base(self.offsets.length(number));
        let radius = base(self.offsets.radius(number));
        let r = self.length_word(words, b'R');
        let z = self.length_word(words, b'Z');
        match (words.whole(b'L', 99)?, z, r) {
            (Some(10 | 11), None, Some(r)) => self.offsets.set_length(number, length + r),
            (Some(12 | 13), None, Some(r)) => self.offsets.set_radius(number, radius + r),
            (None | Some(1), Some(z), r) => {
                self.offsets.set_length(number, length + z);
                if let Some(r) = r {
                    self.offsets.set_radius(number, radius + r);
                }
            }
            (None | Some(1), None, Some(r)) => {
                self.offsets.set_length(number, length + r);
                self.offsets.set_radius(number, radius + r);
            }
            _ => return Err(Fault::new("G10 for a tool needs R (L1 or none: Z, R)")),
        }
        Ok(())
    }
}
