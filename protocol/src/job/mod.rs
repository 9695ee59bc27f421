//! The job: which features a part program probes, what they should be, the
//! limits that decide the verdict, and the correction that is wanted.
//!
//! A job is data. It is written as TOML, checked by `umi job check`, sent over
//! the link and kept in the journal; [`pattern::ReceiverConfig`] says
//! how the control's lines look.

pub mod job_error;
pub mod pattern;
pub mod serial;

use core::fmt;

use heapless::{String, Vec};
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::latch::{LatchCause, SignalLevel};
use pattern::ReceiverConfig;
use serial::LineSpec;

/// Features in a job, at most.
pub const MAX_FEATURES: usize = 12;
/// Features whose position takes part in the registration, at most.
pub const MAX_DATUMS: usize = 8;
/// Hits on one feature, at most.
pub const MAX_HITS: usize = 64;
/// Characters in a feature's or job's name, at most.
pub const MAX_NAME: usize = 16;

/// The name of a job or of a feature, as the control prints it.
pub type Name = String<MAX_NAME, u8>;

/// A name from a text, cut where it is too long.
#[must_use]
pub fn name(text: &str) -> Name {
    let mut name = Name::new();
    for c in text.chars() {
        if name.push(c).is_err() {
            break;
        }
    }
    name
}

/// What is probed, how it is judged and what is sent back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// Stands in every verdict and in the correction program's comments.
    pub name: Name,
    /// Where the nominal positions come from.
    pub reference: Reference,
    /// An unfinished setup is given up (NG) after this long without a hit, seconds.
    pub plate_timeout_s: u32,
    /// How the control's bytes become hits.
    pub receiver: ReceiverConfig,
    /// The features in the order in which the program probes them.
    pub features: Vec<FeatureSpec, MAX_FEATURES, u8>,
    /// Tip radius and pretravel: done by the macro, or here.
    pub compensation: Compensation,
    /// What an OK verdict must keep.
    pub limits: Limits,
    /// The correction wanted; without it the job only measures.
    pub correction: Option<CorrectionSpec>,
    /// The board's own encoder counts as second witness of every hit; without it
    /// the control's word is taken.
    #[serde(default)]
    pub witness: Option<WitnessSpec>,
    /// What makes a setup the reference.
    #[serde(default)]
    pub teach: Teach,
    /// What guards against errors that one setup alone cannot show.
    #[serde(default)]
    pub guards: Guards,
    /// The serial line to the control.
    #[serde(default)]
    pub line: LineSpec,
    /// Which edge of the probe's skip line is the touch.
    #[serde(default)]
    pub skip: SkipSpec,
    /// A ball's first touch is held against its last one, where the two are at one place.
    #[serde(default)]
    pub again: Option<AgainSpec>,
}

// What a job has beyond its first version stands behind all else and is zero where it is
// absent, so that a record of an earlier firmware, which ends before it, is read as a job
// without it.

/// Where the nominal positions come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// From the job: every datum feature has a `position_mm`.
    Given,
    /// The first setup that keeps all limits becomes the reference for those
    /// that follow, as case 0 of the thesis (Sawula 2013, section 4.3).
    Taught,
}

/// What makes a setup the reference, where it is taught.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Teach {
    /// The first setup that keeps all limits, as in the thesis (Sawula 2013, section 4.3).
    /// An older setup that stood in a buffer, or a later one after the first was refused,
    /// then becomes the reference without a word.
    #[default]
    FirstOk,
    /// The setup that comes next after somebody asked for it: the host, or a checked line.
    /// If that one is refused, nothing is taught until it is asked for again.
    Asked,
}

/// Features that repeat another one, at most.
pub const MAX_CLOSING: usize = 3;
/// Features that stay on the table, at most.
pub const MAX_FIXED: usize = 2;

/// Guards against errors that leave no trace in one setup. Each is off where it is absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct Guards {
    /// Features that are another feature, probed once more: what moved between the two shows, and
    /// the feature's place is the mean of both.
    pub closing: Vec<Closing, MAX_CLOSING, u8>,
    /// Features that stay on the table while parts change: a longer probe, a bent stylus or
    /// a machine that drifts shows. Their places are learned with the reference.
    pub fixed: Vec<Name, MAX_FIXED, u8>,
    /// How far a feature on the table may be from where it was when the reference was taught.
    pub fixed_mm: Option<f64>,
    /// How far distances between datum features may be from those of their `position_mm`,
    /// in every setup, also in the one that is taught.
    pub nominal_distance_mm: Option<f64>,
    /// How far a feature may be from how it was in the taught setup.
    pub learned: Option<LearnedLimits>,
    /// What one hit scatters: then the expected error rests on it and on all residuals, and
    /// is honest with few hits.
    pub probing: Option<ProbingSpec>,
    /// Warmer or colder than taught: told, and up to a limit no reason against a setup.
    pub warmth: Option<WarmthSpec>,
    /// The control's variable that counts the runs: the correction compares it with the run
    /// that was measured and raises an alarm where they differ.
    pub run_variable: Option<u32>,
    /// Every run must say in which work offset, with which values, it is probed, that no
    /// rotation is active, what else moves its coordinates, and that nothing shifts them besides
    /// (G52, G92).
    pub frame: bool,
    /// The external offset (`#5201`; G52 on a Haas, G52 and G92 on LinuxCNC) that a run must have.
    pub external_mm: [f64; 3],
    /// The tool length in force that a run must have; absent: that of the taught run.
    pub tool_length_mm: Option<f64>,
}

/// A feature that is another one, probed once more. The mean of all its times counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Closing {
    /// The feature that repeats.
    pub feature: Name,
    /// The feature that it repeats.
    pub repeats: Name,
    /// How far apart the two may be.
    pub within_mm: f64,
}

/// How far a feature may be from how it was in the taught setup; where several taught, below
/// the smallest of them and above the largest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct LearnedLimits {
    /// Its radius, to either side.
    pub radius_mm: f64,
    /// The rms of its residuals, upwards.
    pub rms_mm: f64,
    /// How far beside the centre the hits were approached, upwards.
    pub centring_mm: f64,
}

/// What one hit scatters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct ProbingSpec {
    /// Standard deviation of one hit along its approach, from a calibration. What the control's
    /// step adds to it comes on top.
    pub sigma_mm: f64,
    /// Degrees of freedom of that calibration: repeated hits less one.
    pub dof: u16,
}

/// The expansion of plate and part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct WarmthSpec {
    /// Expansion of the plate, millionths per kelvin: steel 11.5, aluminium 23.
    pub expansion_ppm_per_k: f64,
    /// How much warmer or colder than taught it may be.
    pub at_most_k: f64,
}

/// How a feature was in the taught setup.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Learned {
    /// Fitted radius; 0 where it has none.
    pub radius_mm: f64,
    /// Rms of the residuals.
    pub rms_mm: f64,
    /// How far beside the centre the hits were approached, at most; 0 where not known.
    pub centring_mm: f64,
}

impl Learned {
    fn of_each(&self, other: &Self, of: fn(f64, f64) -> f64) -> Self {
        Self {
            radius_mm: of(self.radius_mm, other.radius_mm),
            rms_mm: of(self.rms_mm, other.rms_mm),
            centring_mm: of(self.centring_mm, other.centring_mm),
        }
    }
}

/// What the taught setups have shown of each feature of the job, in its order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Lessons {
    /// The smallest of all setups that taught.
    pub smallest: Vec<Learned, MAX_FEATURES>,
    /// The largest; empty where one setup taught: then they are the same. Older records end
    /// before.
    pub largest: Vec<Learned, MAX_FEATURES>,
    /// Setups that have taught after the first.
    pub further: u16,
    /// The tool length in force in the first one, where its run said it.
    pub tool_length_mm: Option<f64>,
    /// The feed of its hits; 0 where their lines do not say it.
    pub feed_mm_per_min: f64,
    /// Who taught the first one, as long as that leaves it in doubt which setup was meant.
    pub line: TeachLine,
    /// Its run.
    pub line_run: u32,
}

/// Who has taught a setup that may not be the one that was meant: an old text that came late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum TeachLine {
    /// There is no doubt: the control or a host has said so, a setup was measured by it, or nobody asked.
    #[default]
    None,
    /// `T1.`
    First,
    /// `T2.`: also in place of the reference that there is.
    Again,
    /// A host or the button, and neither the control nor a host has said that its run is the one that was meant.
    Unread,
}

impl Lessons {
    /// Nothing was taught.
    pub const NONE: Self = Self {
        smallest: Vec::new(),
        largest: Vec::new(),
        further: 0,
        tool_length_mm: None,
        feed_mm_per_min: 0.0,
        line: TeachLine::None,
        line_run: 0,
    };

    /// The smallest and the largest of a feature, by its place in the job.
    #[must_use]
    pub fn of(&self, place: usize) -> Option<(&Learned, &Learned)> {
        let smallest = self.smallest.get(place)?;
        Some((smallest, self.largest.get(place).unwrap_or(smallest)))
    }

    /// One more setup has taught. It has the same features.
    pub fn widen(&mut self, by: &[Learned]) {
        if self.largest.is_empty() {
            self.largest = self.smallest.clone();
        }
        let ends = self.smallest.iter_mut().zip(&mut self.largest);
        for ((smallest, largest), now) in ends.zip(by) {
            *smallest = smallest.of_each(now, f64::min);
            *largest = largest.of_each(now, f64::max);
        }
        self.further = self.further.saturating_add(1);
    }
}

/// One feature of the part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct FeatureSpec {
    /// The name that the control prints, or any name where it prints none.
    pub name: Name,
    /// The number that a checked line carries as feature id.
    #[serde(default)]
    pub id: Option<u16>,
    /// The geometry fitted to the hits.
    pub kind: FeatureKind,
    /// Hits that make the feature complete; fewer or more are refused.
    pub hits: u16,
    /// Nominal position: centre (sphere, circle) or apex (cone), CAD frame.
    #[serde(default)]
    pub position_mm: Option<[f64; 3]>,
    /// Nominal radius of a sphere, circle or cylinder.
    #[serde(default)]
    pub radius_mm: Option<f64>,
    /// Direction of motion at each hit, in the order of the hits. Needed for
    /// compensation on the board where the lines do not carry it, and for the
    /// approach check. Empty: not known.
    #[serde(default)]
    pub approach: Vec<Approach, MAX_HITS, u8>,
    /// Whether its position takes part in the registration (spheres, circles
    /// and cones; other kinds have no position).
    #[serde(default = "yes")]
    pub datum: bool,
}

const fn yes() -> bool {
    true
}

/// The geometry fitted to a feature's hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum FeatureKind {
    /// Centre and radius.
    Sphere,
    /// Point, normal.
    Plane,
    /// Point, direction.
    Line,
    /// Circle in space: plane first, then the circle in it.
    Circle,
    /// Axis and radius.
    Cylinder,
    /// Apex, axis and half angle.
    Cone,
}

impl FeatureKind {
    /// Whether the fit gives one point that can serve as a datum position.
    #[must_use]
    pub const fn has_position(self) -> bool {
        matches!(self, Self::Sphere | Self::Circle | Self::Cone)
    }

    /// Whether the fit gives a radius.
    #[must_use]
    pub const fn has_radius(self) -> bool {
        matches!(self, Self::Sphere | Self::Circle | Self::Cylinder)
    }

    /// Hits that the fit needs at least.
    #[must_use]
    pub const fn min_hits(self) -> u16 {
        match self {
            Self::Line => 2,
            Self::Plane | Self::Circle => 3,
            Self::Sphere => 4,
            Self::Cylinder => 5,
            Self::Cone => 6,
        }
    }
}

/// Direction of motion when the probe touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Approach {
    /// Moving towards larger X.
    #[serde(rename = "+x")]
    PlusX,
    /// Moving towards smaller X.
    #[serde(rename = "-x")]
    MinusX,
    /// Moving towards larger Y.
    #[serde(rename = "+y")]
    PlusY,
    /// Moving towards smaller Y.
    #[serde(rename = "-y")]
    MinusY,
    /// Moving towards larger Z.
    #[serde(rename = "+z")]
    PlusZ,
    /// Moving towards smaller Z.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Approach {
    /// The axis (0 X, 1 Y, 2 Z) and the sign of the motion.
    #[must_use]
    pub const fn axis_and_sign(self) -> (usize, f64) {
        match self {
            Self::PlusX => (0, 1.0),
            Self::MinusX => (0, -1.0),
            Self::PlusY => (1, 1.0),
            Self::MinusY => (1, -1.0),
            Self::PlusZ => (2, 1.0),
            Self::MinusZ => (2, -1.0),
        }
    }
}

/// Who turns a skip position into a contact point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Compensation {
    /// The macro has added tip radius and pretravel: the lines hold contact points.
    InMacro,
    /// The lines hold skip positions of the tip centre; the board adds
    /// `tip radius - pretravel` along the approach.
    OnBoard {
        /// Radius of the stylus tip.
        tip_radius_mm: f64,
        /// Pretravel along X, Y and Z (ISO 230-10: the travel between contact
        /// and the trigger), not negative.
        pretravel_mm: [f64; 3],
    },
}

/// The second witness: the axes latched by the probe's skip line, held against what
/// the control prints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct WitnessSpec {
    /// Encoder counts per millimetre of X, Y and Z; negative where they count down
    /// when the control's coordinate grows.
    pub counts_per_mm: [f64; 3],
    /// Counts at the origin of the coordinates that the control prints. Absent: the
    /// first setup that is OK after a start or a new job says where it is, and every
    /// later setup must agree.
    #[serde(default)]
    pub origin_counts: Option<[f64; 3]>,
    /// Gauging feed, where the lines do not carry it.
    #[serde(default)]
    pub feed_mm_per_min: Option<f64>,
    /// The control's longest delay between the skip signal and the position that it
    /// stores.
    pub delay_ms: f64,
    /// What the two witnesses may differ by beyond that delay: rounding, jitter.
    pub tolerance_mm: f64,
}

/// How the probe's skip line is conditioned: which of its edges is the touch. How, is with the
/// board's brain (`umi_core::job::skip`).
///
/// ```toml
/// [skip]
/// active = "low"         # the line rests high and falls when the probe touches
/// min_width_us = 5       # what is narrower is a spark
/// hold_off_ms = 20       # the line rests so long before a touch
/// delay_us = 12.5        # from the probe to the board's input: isolator, interface
/// each_hit = true        # a hit that is printed without a touch is refused
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct SkipSpec {
    /// The level at the board's input while the probe touches.
    pub active: SignalLevel,
    /// A pulse that is narrower is a spark, microseconds: 5 where absent.
    pub min_width_us: Option<u16>,
    /// The line rests for so long before a touch, milliseconds: 20 where absent.
    pub hold_off_ms: Option<u16>,
    /// The constant delay of the signal until the board's input, microseconds: the way at the
    /// gauging feed in it is taken off each touch.
    pub delay_us: f64,
    /// Each hit needs its touch on this line: before its own line, or, of a block, before the
    /// block's first line. It needs no encoders.
    pub each_hit: bool,
}

impl SkipSpec {
    /// The narrowest pulse that counts, microseconds.
    #[must_use]
    pub const fn min_width_us(&self) -> u16 {
        match self.min_width_us {
            Some(us) => us,
            None => 5,
        }
    }

    /// The edge by which a touch begins.
    #[must_use]
    pub const fn touches_by(&self) -> LatchCause {
        match self.active {
            SignalLevel::High => LatchCause::Skip,
            SignalLevel::Low => LatchCause::SkipEnd,
        }
    }

    /// How long the line rests before a touch, milliseconds.
    #[must_use]
    pub const fn hold_off_ms(&self) -> u16 {
        match self.hold_off_ms {
            Some(ms) => ms,
            None => 20,
        }
    }
}

/// Spheres whose last hit touches once more where the first one did (`approach` begins and
/// ends alike): a first touch that came early shows, although the hits between follow it.
///
/// ```toml
/// [again]
/// within_mm = 0.008
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct AgainSpec {
    /// How far the two may be apart along their approach.
    pub within_mm: f64,
}

/// What an OK verdict must keep. All limits apply to absolute values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Fitted against nominal radius, where the job gives one.
    pub radius_error_mm: f64,
    /// Rms of a feature's residuals.
    pub rms_mm: f64,
    /// Largest angle between a hit's surface normal and its approach. Shows
    /// what residuals cannot: a wrong single Z hit of a five-point block moves
    /// the centre and leaves no residual. Not checked where absent.
    #[serde(default)]
    pub approach_deg: Option<f64>,
    /// Where a sphere has only one hit along an axis: its height above the others
    /// against the nominal radius, by which the routine drives below the top. It
    /// holds whatever the pretravel. Not checked where absent.
    #[serde(default)]
    pub lone_hit_mm: Option<f64>,
    /// Distance between two datum positions against the reference.
    pub distance_error_mm: f64,
    /// Rms of the registration's residuals.
    pub registration_rms_mm: f64,
    /// Rotation about Z.
    pub rotation_deg: f64,
    /// Tilt of the Z axis.
    pub tilt_deg: f64,
    /// Displacement of the datum features' centroid, per axis.
    pub shift_mm: [f64; 3],
    /// Expected error (one standard deviation, from the registration's
    /// covariance) at the worst corner of the part. Not checked where absent.
    #[serde(default)]
    pub expected_error_mm: Option<f64>,
}

/// The correction wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct CorrectionSpec {
    /// The words that the control understands.
    pub dialect: Dialect,
    /// The work offset that was active while probing.
    pub probed_in: WorkOffset,
    /// That offset's values, machine coordinates.
    pub probed_origin_mm: [f64; 3],
    /// The work offset that the correction writes.
    pub write_to: WorkOffset,
    /// What else it writes: the set of `G54.4`, the row of the preset table.
    /// Absent: 1. Other dialects take none.
    #[serde(default)]
    pub set: Option<u16>,
    /// O-number of the correction program, 1 to 9999 without 8811 to 8849, which are the shipped
    /// macros'; part of its name where programs have one.
    pub program_number: u16,
    /// How the correction program ends.
    pub ends_with: ProgramEnd,
    /// Corner of the part with the smallest coordinates, CAD frame.
    pub part_min_mm: [f64; 3],
    /// Corner of the part with the largest coordinates, CAD frame.
    pub part_max_mm: [f64; 3],
    /// What the correction may leave at the part's corners: the tilt that the
    /// dialect cannot express, and its rounding.
    pub leftover_mm: f64,
    /// When the program goes out to the control.
    pub send: SendWhen,
}

/// The words that a control understands. What each can express, its number format and
/// where that is from, is in `umi_core::correction::dialect` and in `umi dialects`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Dialect {
    /// `G10 L2 P` (`L20 P`) for the offset and `G68 X Y R` for the rotation in the plane.
    #[serde(rename = "g10-g68")]
    G10G68,
    /// `G10` for the offset and the three-dimensional conversion `G68 X Y Z I J K R`.
    #[serde(rename = "g68-3d")]
    G68ThreeD,
    /// Fanuc's workpiece setting error `G54.4 P`, written through its variables.
    #[serde(rename = "fanuc-g54.4")]
    FanucSettingError,
    /// Mazak's workpiece setup error `G54.4 P`, keyed in by the operator.
    #[serde(rename = "mazak-g54.4")]
    MazakSettingError,
    /// Mitsubishi's workpiece installation error `G54.4 P`, keyed in by the operator.
    #[serde(rename = "mitsubishi-g54.4")]
    MitsubishiSettingError,
    /// `#5221` and its like for the offset, a local variable for the rotation, read back.
    #[serde(rename = "variables")]
    Variables,
    /// Haas: the same, with `G154 P` beyond G59.
    #[serde(rename = "haas")]
    Haas,
    /// Haas: macro variables by `E` commands, for the macro O8830 to check and to apply.
    #[serde(rename = "haas-e")]
    HaasVariables,
    /// Siemens: a settable frame, `$P_UIFR`.
    #[serde(rename = "siemens")]
    Siemens,
    /// Heidenhain: a row of the preset table.
    #[serde(rename = "heidenhain")]
    Heidenhain,
    /// LinuxCNC: `G10 L2 P R`.
    #[serde(rename = "linuxcnc")]
    LinuxCnc,
    /// GRBL: `G10 L2 P`.
    #[serde(rename = "grbl")]
    Grbl,
}

impl Dialect {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::G10G68,
        Self::G68ThreeD,
        Self::FanucSettingError,
        Self::MazakSettingError,
        Self::MitsubishiSettingError,
        Self::Variables,
        Self::Haas,
        Self::HaasVariables,
        Self::Siemens,
        Self::Heidenhain,
        Self::LinuxCnc,
        Self::Grbl,
    ];

    /// The name used in files and on screens.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::G10G68 => "g10-g68",
            Self::G68ThreeD => "g68-3d",
            Self::FanucSettingError => "fanuc-g54.4",
            Self::MazakSettingError => "mazak-g54.4",
            Self::MitsubishiSettingError => "mitsubishi-g54.4",
            Self::Variables => "variables",
            Self::Haas => "haas",
            Self::HaasVariables => "haas-e",
            Self::Siemens => "siemens",
            Self::Heidenhain => "heidenhain",
            Self::LinuxCnc => "linuxcnc",
            Self::Grbl => "grbl",
        }
    }
}

/// A work offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum WorkOffset {
    /// `G10 L2 P1`
    G54,
    /// `G10 L2 P2`
    G55,
    /// `G10 L2 P3`
    G56,
    /// `G10 L2 P4`
    G57,
    /// `G10 L2 P5`
    G58,
    /// `G10 L2 P6`
    G59,
    /// One of the further ones by its number, in a file `{ extended = 7 }`: G54.1 P7,
    /// G154 P7 (Haas), G507 (Siemens).
    #[serde(rename = "extended")]
    Extended(u16),
}

impl WorkOffset {
    /// The P number of `G10 L2`, 1 for G54; of `G10 L20` for a further one.
    #[must_use]
    pub const fn p_number(self) -> u16 {
        match self {
            Self::G54 => 1,
            Self::G55 => 2,
            Self::G56 => 3,
            Self::G57 => 4,
            Self::G58 => 5,
            Self::G59 => 6,
            Self::Extended(number) => number,
        }
    }
}

impl fmt::Display for WorkOffset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Extended(number) => write!(f, "G54.1 P{number}"),
            _ => write!(f, "G{}", 53 + self.p_number()),
        }
    }
}

/// How the correction program ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum ProgramEnd {
    /// As a subprogram: back to the caller.
    M99,
    /// As a main program.
    M30,
}

/// When the correction program goes out to the control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum SendWhen {
    /// When the control asks: READ sends DC1 (XON).
    OnRequest,
    /// As soon as the verdict is OK.
    OnVerdict,
    /// Never over the serial line; only shown on the link.
    Never,
}
