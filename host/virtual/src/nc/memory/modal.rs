//! Modal state: it stays in force from block to block.

use nalgebra::Vector3;

use super::offsets::OffsetSystem;
use super::settings::ControlSettings;
use super::transform::Frame;

/// The plane of arcs, rotations and cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Plane {
    /// `G17`.
    #[default]
    Xy,
    /// `G18`.
    Zx,
    /// `G19`.
    Yz,
}

impl Plane {
    /// Indices of the first, the second and the normal axis.
    pub const fn axes(self) -> [usize; 3] {
        match self {
            Self::Xy => [0, 1, 2],
            Self::Zx => [2, 0, 1],
            Self::Yz => [1, 2, 0],
        }
    }

    const fn code(self) -> u16 {
        match self {
            Self::Xy => 170,
            Self::Zx => 180,
            Self::Yz => 190,
        }
    }
}

/// What a canned cycle keeps between its blocks, program coordinates and mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cycle {
    /// Height from which the cycle began.
    pub initial: f64,
    /// R: absolute height of the approach.
    pub r: f64,
    /// Absolute height of the bottom.
    pub bottom: f64,
    /// Q: depth of a peck.
    pub peck: f64,
    /// P: dwell at the bottom, seconds.
    pub dwell: f64,
}

/// `G43.4`, in tenths.
pub(crate) const TIP: u16 = 434;

/// The modal state.
#[derive(Clone, Debug)]
pub(crate) struct Modal {
    /// Group 1 in tenths: 0, 10, 20, 30; 800 none (LinuxCNC, GRBL).
    pub motion: u16,
    pub plane: Plane,
    pub is_incremental: bool,
    /// I, J and K are coordinates (`G90.1`), not ways from the start.
    pub has_absolute_centres: bool,
    /// F is one over the time of its block in minutes (`G93`).
    pub is_inverse_time: bool,
    pub is_inch: bool,
    /// Return of cycles to R (`G99`), not to the initial height.
    pub returns_to_r: bool,
    pub is_exact_stop: bool,
    pub work: OffsetSystem,
    /// `G52`, mm.
    pub local: Vector3<f64>,
    /// `G92`, mm.
    pub shift: Vector3<f64>,
    /// Rotations of `G68`, the outer one first.
    pub rotations: Vec<Frame>,
    /// `G51`: a mode, and no more; nothing moves in it.
    pub is_scaled: bool,
    /// `G51.1`, likewise.
    pub is_mirrored: bool,
    /// Set of `G54.4` in force.
    pub setting_error: Option<u8>,
    /// `G43` (430), `G44` (440), `G43.4` (434) or `G49` (490).
    pub length: u16,
    pub h: u32,
    pub d: u32,
    /// The length in force along Z, signed, mm.
    pub length_mm: f64,
    /// mm/min.
    pub feed: Option<f64>,
    /// The operator's override does not act on feeds (LinuxCNC's `M50 P0`).
    pub has_no_override: bool,
    pub s: f64,
    pub t: u32,
    pub tool: u32,
    pub m: u32,
    pub n: u32,
    /// The canned cycle in force, in tenths, and what it keeps.
    pub cycle: Option<(u16, Cycle)>,
}

impl Modal {
    /// As the control is switched on.
    pub fn new(settings: &ControlSettings) -> Self {
        Self {
            motion: 0,
            plane: Plane::Xy,
            is_incremental: false,
            has_absolute_centres: false,
            is_inverse_time: false,
            is_inch: false,
            returns_to_r: false,
            is_exact_stop: false,
            work: OffsetSystem::Standard(1),
            local: Vector3::zeros(),
            shift: Vector3::zeros(),
            rotations: Vec::new(),
            is_scaled: false,
            is_mirrored: false,
            setting_error: None,
            length: 490,
            h: 0,
            d: 0,
            length_mm: 0.0,
            feed: settings
                .feed_mm_min
                .filter(|feed| *feed > 0.0 && feed.is_finite()),
            has_no_override: false,
            s: 0.0,
            t: 0,
            tool: 0,
            m: 0,
            n: 0,
            cycle: None,
        }
    }

    /// The control carries the tool's tip through the rotary axes (`G43.4`).
    pub const fn carries_tip(&self) -> bool {
        self.length == TIP
    }

    /// Millimetres in a unit of the program.
    pub const fn unit_mm(&self) -> f64 {
        if self.is_inch { 25.4 } else { 1.0 }
    }

    /// The code of the work coordinate system in tenths, and its P.
    pub const fn work_code(&self) -> (u16, u16) {
        match self.work {
            OffsetSystem::External => (540, 0),
            OffsetSystem::Standard(n @ 1..=6) => (530 + n as u16 * 10, 0),
            OffsetSystem::Standard(n) => (590 + n as u16 - 6, 0),
            OffsetSystem::Extended(p) => (541, p),
        }
    }

    /// The codes in force, in tenths, in the order of their groups.
    pub fn codes(&self) -> Vec<u16> {
        vec![
            self.motion,
            self.plane.code(),
            if self.is_incremental { 910 } else { 900 },
            if self.is_inverse_time { 930 } else { 940 },
            if self.is_inch { 200 } else { 210 },
            400,
            self.length,
            if self.returns_to_r { 990 } else { 980 },
            self.work_code().0,
            if self.is_exact_stop { 610 } else { 640 },
            if self.rotations.is_empty() { 690 } else { 680 },
            self.cycle.map_or(800, |(code, _)| code),
        ]
    }
}

/// A G code as it is written.
pub(crate) fn g_text(tenths: u16) -> String {
    match tenths % 10 {
        0 => format!("G{}", tenths / 10),
        tenth => format!("G{}.{tenth}", tenths / 10),
    }
}
