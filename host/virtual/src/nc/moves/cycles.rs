//! Canned cycles: G73, G81 to G86, G89. What their spindle does is not the axes'.

use nalgebra::Vector3;

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::modal::Cycle;
use crate::nc::memory::motion::{AxisDrives, MotionRate};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::run::control::Control;
use crate::nc::run::words::Words;

/// How far a peck retracts (G73), and stops short of the last depth (G83), mm: a
/// parameter on a control (Fanuc 5114, 5115), a constant of 0.01 inch in LinuxCNC.
const fn clearance_mm(dialect: ControlFamily) -> f64 {
    match dialect {
        ControlFamily::LinuxCnc => 0.254,
        _ => 1.0,
    }
}
/// Pecks in one hole.
const MAX_PECKS: f64 = 1000.0;
/// Holes in one block.
const MAX_HOLES: u32 = 1000;

impl Control {
    /// Begins or repeats a cycle. Returns whether it moved.
    pub(crate) fn cycle(
        &mut self,
        code: Option<u16>,
        words: &Words,
        axes: &mut dyn AxisDrives,
    ) -> Checked<bool> {
        let code = code.unwrap_or(810);
        let [_, _, normal] = self.modal.plane.axes();
        let letter = [b'X', b'Y', b'Z'].get(normal).copied().unwrap_or(b'Z');
        let here = self.here(axes);
        let height = here.get(normal).copied().unwrap_or(0.0);
        let old = self.modal.cycle.map(|(_, cycle)| cycle);
        let initial = old.map_or(height, |cycle| cycle.initial);
        let incremental = self.modal.is_incremental;
        let r = match (self.length_word(words, b'R'), old) {
            (Some(r), _) if incremental => initial + r,
            (Some(r), _) => r,
            (None, Some(cycle)) => cycle.r,
            (None, None) => return Err(Fault::new("a cycle needs R, the height of approach")),
        };
        if incremental && old.is_some() && words.has(b'R') && !words.has(letter) {
            return Err(Fault::new(format!(
                "R in G91 without {}: whether the bottom goes with it, controls see differently: \
                 say both",
                letter as char
            )));
        }
        let bottom = match (self.length_word(words, letter), old) {
            (Some(z), _) if incremental => r + z,
            (Some(z), _) => z,
            (None, Some(cycle)) => cycle.bottom,
            (None, None) => {
                return Err(Fault::new(format!(
                    "a cycle needs {}, the height of the bottom",
                    letter as char
                )));
            }
        };
        let is_macro_b = self.settings.dialect.is_macro_b();
        let cycle = Cycle {
            initial,
            r,
            bottom,
            peck: self
                .length_word(words, b'Q')
                .or(old.map(|cycle| cycle.peck))
                .unwrap_or(0.0),
            dwell: words
                .number(b'P')
                .map(|p| if is_macro_b { p / 1000.0 } else { p })
                .or(old.map(|cycle| cycle.dwell))
                .unwrap_or(0.0),
        };
        if matches!(code, 730 | 830) {
            if cycle.peck <= 0.0 {
                return Err(Fault::ps(45, "G73 and G83 need Q, the depth of a peck"));
            }
            if (cycle.r - cycle.bottom).abs() / cycle.peck > MAX_PECKS {
                return Err(Fault::new("Q is too small for this depth"));
            }
        }
        if cycle.bottom > cycle.r {
            return Err(Fault::new("the bottom lies above R"));
        }
        if !(0.0..=1000.0).contains(&cycle.dwell) {
            return Err(Fault::new("P: the dwell is too long, or negative"));
        }
        self.modal.cycle = Some((code, cycle));
        let holes = match words.whole(b'K', MAX_HOLES)? {
            Some(k) => k,
            None => words.whole(b'L', MAX_HOLES)?.unwrap_or(1),
        };
        for _ in 0..holes {
            let here = self.here(axes);
            let mut to = self.target(words, here);
            // The normal axis is the cycle's.
            let stays = here.get(normal).copied().unwrap_or(0.0);
            put(&mut to, normal, stays);
            self.hole(code, cycle, normal, to, axes)?;
        }
        Ok(holes > 0)
    }

    fn hole(
        &mut self,
        code: u16,
        cycle: Cycle,
        normal: usize,
        over: Vector3<f64>,
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        let feed = self.feed()?;
        let clearance = clearance_mm(self.settings.dialect);
        let at = |height: f64| {
            let mut point = over;
            put(&mut point, normal, height);
            point
        };
        let is_linuxcnc = self.settings.dialect == ControlFamily::LinuxCnc;
        let mut over = over;
        let height = over.get(normal).copied().unwrap_or(0.0);
        let rises = cycle.initial < cycle.r;
        if is_linuxcnc && rises && (height - cycle.r).abs() > 1e-9 {
            // From below R it goes to R before it moves over the hole. Other controls move over the
            // hole at the height where they are.
            let mut above = self.here(axes);
            put(&mut above, normal, cycle.r);
            self.line(above, MotionRate::Rapid, axes)?;
            put(&mut over, normal, cycle.r);
        } else if is_linuxcnc && !rises {
            // Up on the way across: to a higher R, or to where it began, where G98 comes again.
            let back = if self.modal.returns_to_r {
                cycle.r
            } else {
                cycle.initial
            };
            put(&mut over, normal, height.max(back));
        }
        self.line(over, MotionRate::Rapid, axes)?;
        self.line(at(cycle.r), MotionRate::Rapid, axes)?;
        match code {
            730 | 830 => {
                let pecks = pecks(cycle);
                for peck in 1..=pecks {
                    let depth = cycle.r - cycle.peck * f64::from(peck - 1);
                    if code == 830 && peck > 1 {
                        let short = (depth + clearance).min(cycle.r);
                        self.line(at(short), MotionRate::Rapid, axes)?;
                    }
                    if peck == pecks {
                        self.line(at(cycle.bottom), feed, axes)?;
                        break;
                    }
                    let depth = depth - cycle.peck;
                    self.line(at(depth), feed, axes)?;
                    let back = match code {
                        830 => cycle.r,
                        _ => (depth + clearance).min(cycle.r),
                    };
                    self.line(at(back), MotionRate::Rapid, axes)?;
                }
            }
            _ => {
                self.line(at(cycle.bottom), feed, axes)?;
                if matches!(code, 820 | 860 | 890) {
                    axes.dwell(cycle.dwell);
                }
            }
        }
        let top = if self.modal.returns_to_r {
            cycle.r
        } else if is_linuxcnc {
            cycle.initial.max(cycle.r)
        } else {
            cycle.initial
        };
        match code {
            // LinuxCNC feeds all the way.
            890 if is_linuxcnc => self.line(at(top), feed, axes)?,
            840 | 850 | 890 => self.line(at(cycle.r), feed, axes)?,
            _ => {}
        }
        self.line(at(top), MotionRate::Rapid, axes)
    }
}

/// How many pecks reach the bottom; a rest below a nanometre is none.
fn pecks(cycle: Cycle) -> u32 {
    let depth = cycle.r - cycle.bottom;
    // At most MAX_PECKS: the caller has compared.
    ((depth - 1e-6) / cycle.peck)
        .ceil()
        .clamp(1.0, MAX_PECKS + 1.0) as u32
}

fn put(point: &mut Vector3<f64>, axis: usize, value: f64) {
    if let Some(slot) = point.get_mut(axis) {
        *slot = value;
    }
}
