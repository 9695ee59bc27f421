//! The tables of offsets: work coordinate systems, tools, workpiece setting errors.

use std::collections::BTreeMap;

use nalgebra::Vector3;

/// A work coordinate system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum OffsetSystem {
    /// The external offset, added to all (EXT, `G10 L2 P0`).
    External,
    /// `G54` (1) to `G59` (6); LinuxCNC to `G59.3` (9).
    Standard(u8),
    /// `G54.1 P` (Haas `G154 P`), 1 to 300.
    Extended(u16),
}

impl OffsetSystem {
    /// By the name that a program calls it: `G54` to `G59`, `G54.1P7`, `EXT`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        if name == "EXT" {
            return Some(Self::External);
        }
        if let Some(number) = name.strip_prefix("G54.1P") {
            let number = number.parse().ok()?;
            return (1..=MAX_EXTENDED)
                .contains(&number)
                .then_some(Self::Extended(number));
        }
        let number: u8 = name.strip_prefix('G')?.parse().ok()?;
        (54..=59)
            .contains(&number)
            .then(|| Self::Standard(number - 53))
    }
}

/// The offsets in a control's memory, mm and degrees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Offsets {
    work_mm: BTreeMap<OffsetSystem, [f64; 3]>,
    work_turn_deg: BTreeMap<OffsetSystem, f64>,
    length_mm: BTreeMap<u32, f64>,
    radius_mm: BTreeMap<u32, f64>,
    setting_errors: BTreeMap<u8, [f64; 6]>,
}

/// The largest number of a tool offset.
pub(crate) const MAX_TOOL: u32 = 999;
/// The largest P of `G54.1`.
pub(crate) const MAX_EXTENDED: u16 = 300;

impl Offsets {
    /// The origin of a work coordinate system, mm.
    #[must_use]
    pub fn work(&self, offset: OffsetSystem) -> [f64; 3] {
        self.work_mm.get(&offset).copied().unwrap_or_default()
    }

    /// Sets the origin of a work coordinate system, mm.
    pub fn set_work(&mut self, offset: OffsetSystem, origin_mm: [f64; 3]) {
        self.work_mm.insert(offset, origin_mm);
    }

    /// Rotation of a work coordinate system about Z, degrees (LinuxCNC `G10 L2 R`).
    #[must_use]
    pub fn turn(&self, offset: OffsetSystem) -> f64 {
        self.work_turn_deg.get(&offset).copied().unwrap_or_default()
    }

    /// Sets the rotation of a work coordinate system about Z, degrees.
    pub fn set_turn(&mut self, offset: OffsetSystem, degrees: f64) {
        self.work_turn_deg.insert(offset, degrees);
    }

    /// Tool length offset H, mm.
    #[must_use]
    pub fn length(&self, h: u32) -> f64 {
        self.length_mm.get(&h).copied().unwrap_or_default()
    }

    /// Sets tool length offset H, mm; H0 stays zero.
    pub fn set_length(&mut self, h: u32, mm: f64) {
        if (1..=MAX_TOOL).contains(&h) {
            self.length_mm.insert(h, mm);
        }
    }

    /// Tool radius offset D, mm.
    #[must_use]
    pub fn radius(&self, d: u32) -> f64 {
        self.radius_mm.get(&d).copied().unwrap_or_default()
    }

    /// Sets tool radius offset D, mm; D0 stays zero.
    pub fn set_radius(&mut self, d: u32, mm: f64) {
        if (1..=MAX_TOOL).contains(&d) {
            self.radius_mm.insert(d, mm);
        }
    }

    /// Workpiece setting error P of `G54.4`: dx, dy, dz (mm), da, db, dc (degrees).
    #[must_use]
    pub fn setting_error(&self, p: u8) -> [f64; 6] {
        self.setting_errors.get(&p).copied().unwrap_or_default()
    }

    /// Whether workpiece setting error P was set.
    #[must_use]
    pub fn has_setting_error(&self, p: u8) -> bool {
        self.setting_errors.contains_key(&p)
    }

    /// Sets workpiece setting error P (1 to 7) of `G54.4`.
    pub fn set_setting_error(&mut self, p: u8, error: [f64; 6]) {
        if (1..=7).contains(&p) {
            self.setting_errors.insert(p, error);
        }
    }

    /// The external offset and that of a work coordinate system together.
    pub(crate) fn origin(&self, offset: OffsetSystem) -> Vector3<f64> {
        Vector3::from(self.work(OffsetSystem::External)) + Vector3::from(self.work(offset))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Offsets are called as programs call them, and nothing else is taken.
    #[test]
    fn offsets_by_name() {
        assert_eq!(OffsetSystem::named("G54"), Some(OffsetSystem::Standard(1)));
        assert_eq!(OffsetSystem::named("G59"), Some(OffsetSystem::Standard(6)));
        assert_eq!(
            OffsetSystem::named("G54.1P48"),
            Some(OffsetSystem::Extended(48))
        );
        assert_eq!(OffsetSystem::named("EXT"), Some(OffsetSystem::External));
        for wrong in [
            "G53",
            "G60",
            "54",
            "G54.1",
            "G54.1P0",
            "G54.1P301",
            "",
            "g54",
        ] {
            assert_eq!(OffsetSystem::named(wrong), None, "{wrong}");
        }
    }
}
