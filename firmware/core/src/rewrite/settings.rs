//! What to do with a program, and by what.

use heapless::{String, Vec};
use nalgebra::Matrix3;
use umi_protocol::job::{CorrectionSpec, WorkOffset};

use super::block::{Code, code};
use super::state::{Feed, Motion};
use super::text::length::Unit;
use crate::correction::RunCheck;
use crate::registration::RigidTransform;
use crate::registration::transform::Quaternion;
use crate::units::Mm;

/// What a length without a decimal point means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integers {
    /// `X100` is 100 mm or inches (Fanuc 3401#0 DPI = 1, LinuxCNC, GRBL).
    Units,
    /// `X100` is 100 steps (Fanuc DPI = 0).
    Steps,
}

/// Whose meaning counts where controls differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RewriteDialect {
    /// Fanuc, Haas, Mitsubishi: a canned cycle whose R lies above the tool moves across first
    /// and then to R.
    Fanuc,
    /// LinuxCNC: such a cycle rises to R first and never comes back below it; P on an arc
    /// counts its turns.
    LinuxCnc,
}

/// Modes that a program takes for granted: what is in force when it starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StartModes {
    pub(super) incremental: Option<bool>,
    pub(super) unit: Option<Unit>,
    /// The plane's normal axis.
    pub(super) normal: Option<usize>,
    pub(super) absolute_centres: Option<bool>,
    pub(super) feed: Option<Feed>,
    pub(super) returns_to_r: Option<bool>,
    pub(super) work: Option<u16>,
    pub(super) motion: Option<Motion>,
}

impl StartModes {
    /// With the mode of one more G code, in tenths (`G90` is 900). None if it is no mode of a
    /// path, or contradicts one that was stated.
    #[must_use]
    pub fn with(mut self, tenths: u16) -> Option<Self> {
        /// States a mode once.
        fn set<T: PartialEq>(slot: &mut Option<T>, mode: T) -> bool {
            let fits = slot.as_ref().is_none_or(|stated| *stated == mode);
            *slot = Some(mode);
            fits
        }
        let fits = match code(tenths) {
            Code::Absolute => set(&mut self.incremental, false),
            Code::Incremental => set(&mut self.incremental, true),
            Code::Inch => set(&mut self.unit, Unit::Inch),
            Code::Millimetre => set(&mut self.unit, Unit::Millimetre),
            Code::Plane(normal) => set(&mut self.normal, normal),
            Code::AbsoluteCentres => set(&mut self.absolute_centres, true),
            Code::IncrementalCentres => set(&mut self.absolute_centres, false),
            Code::InverseTime => set(&mut self.feed, Feed::InverseTime),
            Code::PerMinute => set(&mut self.feed, Feed::PerMinute),
            Code::PerRevolution => set(&mut self.feed, Feed::PerRevolution),
            Code::ToR => set(&mut self.returns_to_r, true),
            Code::ToInitial => set(&mut self.returns_to_r, false),
            Code::Work(work) => set(&mut self.work, work),
            Code::Motion(motion) => set(&mut self.motion, motion),
            // So everything begins.
            Code::NotCompensated | Code::NoLength | Code::EndOfCycle => true,
            _ => false,
        };
        fits.then_some(self)
    }
}

impl StartModes {
    /// The unit that is stated.
    #[must_use]
    pub const fn unit(&self) -> Option<Unit> {
        self.unit
    }
}

/// G codes of which one of a row can be kept with a program, in tenths.
const KEPT: [&[u16]; 8] = [
    &[900, 910],
    &[200, 210],
    &[170, 180, 190],
    &[901, 911],
    &[930, 940, 950],
    &[980, 990],
    &[540, 550, 560, 570, 580, 590],
    &[0, 10, 20, 30],
];

impl StartModes {
    /// The G codes, in tenths: one of each group that is stated, work offsets to G59.
    #[must_use]
    pub fn tenths(&self) -> Vec<u16, 8> {
        let codes = KEPT.iter().copied().flatten().copied();
        // Said once more, a mode that is stated changes nothing.
        codes
            .filter(|tenths| self.with(*tenths) == Some(*self))
            .collect()
    }

    /// All of it in a number that is kept with a program; 0 where nothing is stated. None
    /// where there is no room for a mode: a work offset beyond G59.
    #[must_use]
    pub fn packed(&self) -> Option<u16> {
        let stated = self.tenths();
        let packed = KEPT.iter().fold(0, |packed: u16, group| {
            let place = group.iter().position(|tenths| stated.contains(tenths));
            let digit = place.map_or(0, |place| place as u16 + 1);
            packed * (group.len() as u16 + 1) + digit
        });
        (Self::unpacked(packed) == Some(*self)).then_some(packed)
    }

    /// What [`Self::packed`] has packed. None: that is no such number.
    #[must_use]
    pub fn unpacked(mut packed: u16) -> Option<Self> {
        let mut modes = Self::default();
        for group in KEPT.iter().rev() {
            let base = group.len() as u16 + 1;
            if let Some(place) = (packed % base).checked_sub(1) {
                modes = modes.with(*group.get(usize::from(place))?)?;
            }
            packed /= base;
        }
        (packed == 0).then_some(modes)
    }
}

/// By what a program is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramIdentity {
    /// CRC-32 (ISO-HDLC) of all bytes.
    pub crc32: u32,
    /// How many there are.
    pub bytes: u64,
}

/// Where a transform comes from, for people.
pub type Source = String<96>;

/// Programs that may be called although their text is not there, as `9010,<finish>`.
pub type AllowedCalls = String<96>;

/// Where a transform holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredIn {
    /// In the coordinates of this work offset.
    pub offset: WorkOffset,
    /// Where that one's origin was, machine coordinates; none where nobody has said it.
    pub origin_mm: Option<[f64; 3]>,
}

impl MeasuredIn {
    /// Of what was measured with a job: in its `probed_in`, whose origin it gives. A job without a
    /// correction says neither: its parts are probed in G54.
    #[must_use]
    pub fn of(correction: Option<&CorrectionSpec>) -> Self {
        Self {
            offset: correction.map_or(WorkOffset::G54, |spec| spec.probed_in),
            origin_mm: correction.map(|spec| spec.probed_origin_mm),
        }
    }

    /// Its place among G54 to G59, from 0, and its origin in mm; none where its origin is not
    /// known, or it is a further offset.
    #[must_use]
    pub fn known_origin(&self) -> Option<(usize, [f64; 3])> {
        let is_further = matches!(self.offset, WorkOffset::Extended(_));
        let index = usize::from(self.offset.p_number()).checked_sub(1)?;
        let origin_mm = self.origin_mm.filter(|_| !is_further)?;
        Some((index, origin_mm))
    }
}

/// What to do with a program.
#[derive(Clone, Debug)]
pub struct RewriteSettings {
    /// Nominal to measured, in the coordinates of the work offset.
    pub transform: RigidTransform,
    /// The work offset in whose coordinates the transform holds, as it was while the part was
    /// probed. None: the one in force at the program's first motion.
    pub measured_in: Option<WorkOffset>,
    /// Decimals of a length in mm that the control takes, 1 to 6: 3 is 0.001 mm, IS-B.
    /// Inches have one more.
    pub decimals_mm: u8,
    /// How far an arc may come to lie from its image, rounding included.
    pub chord: Mm,
    /// What a length without a decimal point means; none refuses it.
    pub integers: Option<Integers>,
    /// The unit before the program says G20 or G21; none refuses motions.
    pub unit: Option<Unit>,
    /// Origins of G54 to G59 in machine coordinates, where they are known, mm.
    pub origins_mm: [Option<[f64; 3]>; 6],
    /// How far pecks retract where a cycle is written out (Fanuc 5114, 5115).
    pub clearance: Mm,
    /// Modes that the program takes for granted.
    pub start: StartModes,
    /// Whose meaning counts where controls differ; none refuses what they do differently.
    pub dialect: Option<RewriteDialect>,
    /// Programs that may be called although their text is not there. Each must leave the modes
    /// as it finds them, and its motions are not carried.
    pub allowed_calls: AllowedCalls,
    /// Whether a rapid may go over an axis whose place the program has not said, where that one
    /// leans a little: it ends beside its image by the lean times the height, until the program
    /// names the axis.
    pub loose_rapids: bool,
    /// Whether a program may be rewritten that was rewritten before.
    pub again: bool,
    /// Check value of the original, for the header.
    pub original: Option<ProgramIdentity>,
    /// Where the transform comes from, for the header: a verdict's job and setup.
    pub source: Source,
    /// The run that was measured: the program begins with an alarm in any other.
    pub run: Option<RunCheck>,
}

impl RewriteSettings {
    /// A control of 0.001 mm, arcs within 0.01 mm, nothing known beyond the transform.
    #[must_use]
    pub const fn new(transform: RigidTransform) -> Self {
        Self {
            transform,
            measured_in: None,
            decimals_mm: 3,
            chord: Mm(0.01),
            integers: None,
            unit: None,
            origins_mm: [None; 6],
            clearance: Mm(1.0),
            start: StartModes {
                incremental: None,
                unit: None,
                normal: None,
                absolute_centres: None,
                feed: None,
                returns_to_r: None,
                work: None,
                motion: None,
            },
            dialect: None,
            allowed_calls: AllowedCalls::new(),
            loose_rapids: false,
            again: false,
            original: None,
            source: Source::new(),
            run: None,
        }
    }

    /// Whether a program that is said to be one control's may begin with this comparison of the
    /// run: in LinuxCNC's words no other control knows it, and LinuxCNC knows no other's.
    #[must_use]
    pub fn takes(&self, run: RunCheck) -> bool {
        self.dialect
            .is_none_or(|dialect| run.is_linuxcnc() == (dialect == RewriteDialect::LinuxCnc))
    }

    /// The same for a transform that holds in a work offset, whose origin may be known.
    #[must_use]
    pub fn measured_at(mut self, place: MeasuredIn) -> Self {
        if let Some((index, origin_mm)) = place.known_origin()
            && let Some(slot) = self.origins_mm.get_mut(index)
        {
            *slot = Some(origin_mm);
        }
        self.measured_in = Some(place.offset);
        self
    }

    /// Whether a program may be called by this name although its text is not there.
    pub(super) fn allows_call(&self, name: &str) -> bool {
        self.allowed_calls
            .split(',')
            .any(|allowed| allowed.eq_ignore_ascii_case(name))
    }

    /// The same of a number.
    pub(super) fn allows_number(&self, number: u32) -> bool {
        self.allowed_calls
            .split(',')
            .any(|allowed| allowed.parse() == Ok(number))
    }
}

/// Settings that cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BadSettings {
    /// R is not a rotation to 1e-6, or a number is not finite or beyond 10 m.
    Transform,
    /// Decimals are 1 to 6.
    Decimals,
    /// A chord's tolerance from 3 steps to 10 mm.
    Chord,
    /// A clearance from 0 to 100 mm.
    Clearance,
    /// An origin beyond 10 m.
    Origin,
}

impl core::fmt::Display for BadSettings {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Transform => {
                "this is no rotation and translation: rows of R must be orthogonal unit vectors to \
                 1e-6 (write nine decimals), the determinant +1, lengths below 10 m"
            }
            Self::Decimals => "the increment is 0.1 to 0.000001 mm, a power of ten",
            Self::Chord => "the tolerance of arcs is at least 3 increments, at most 10 mm",
            Self::Clearance => "the clearance of pecks is 0 to 100 mm",
            Self::Origin => "an origin is a place within 10 m",
        })
    }
}

impl core::error::Error for BadSettings {}

/// A transform that is one: rotation to 1e-6, made exact.
pub(super) fn checked(transform: &RigidTransform) -> Option<RigidTransform> {
    let r = &transform.rotation;
    let error = (r.transpose() * r - Matrix3::identity()).abs().max();
    let far = transform.translation_mm.abs().max();
    let finite = r
        .iter()
        .chain(transform.translation_mm.iter())
        .all(|x| x.is_finite());
    let fits = finite && error <= 2e-6 && far <= 10_000.0 && r.determinant() > 0.0;
    if !fits {
        return None;
    }
    // A rotation of ones and zeros, or about an axis of the machine, stays what it is.
    let exact = error <= 4.0 * f64::EPSILON;
    Some(if exact {
        *transform
    } else {
        RigidTransform {
            rotation: Quaternion::from_rotation(r).to_rotation(),
            ..*transform
        }
    })
}
