//! What an OK verdict releases, what the host passes through, and what the control is to get.

use heapless::{String, Vec};
use umi_core::programs::MAX_PROGRAMS;
use umi_core::registration::RigidTransform;
use umi_core::units::Micros;
use umi_protocol::program::{ProgramInfo, Withheld};
use umi_protocol::verdict::{MAX_CORRECTION, RegistrationReport};

/// What an OK verdict releases besides its correction.
#[derive(Clone, Debug)]
pub(crate) struct Released {
    pub setup: u32,
    pub arming: u32,
    /// No program begins later.
    pub until: Micros,
    /// The run that was measured, where the control has said it.
    pub run: Option<u32>,
    /// Nominal to measured.
    pub transform: Option<RigidTransform>,
    /// Programs that have gone out.
    pub gone: Vec<u32, MAX_PROGRAMS>,
    /// The correction, as long as it is armed. It is empty after that, and where there is none.
    pub correction: String<MAX_CORRECTION>,
    /// The correction has gone out.
    pub is_gone: bool,
    /// The setup was taught.
    pub is_taught: bool,
}

/// A program that the host passes through.
#[derive(Clone, Debug)]
pub(crate) struct Passed {
    pub info: ProgramInfo,
    /// All of it has gone out, or will not.
    pub end: Option<Result<(), Withheld>>,
}

/// The program that the control is to get.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    /// Its number, or 0: none.
    pub number: u32,
    /// The control has asked, not the host.
    pub by_control: bool,
    /// It began to go out since.
    pub has_begun: bool,
    /// It was held for too long.
    pub is_stale: bool,
    /// It began on a plain line: a NAK there is an alarm.
    pub is_plain: bool,
    /// Counts what was asked for.
    pub count: u32,
}

impl Wanted {
    /// Nothing.
    pub const NONE: Self = Self {
        number: 0,
        by_control: false,
        has_begun: false,
        is_stale: false,
        is_plain: false,
        count: 0,
    };

    /// It went out, as far as it did; one that was held for too long gets an alarm.
    pub const fn has_ended(&self) -> bool {
        self.has_begun && !self.is_stale
    }

    /// This one from now on; 0: none.
    pub fn set(&mut self, number: u32, by_control: bool) {
        let count = self.count.wrapping_add(1);
        *self = Self {
            number,
            by_control,
            count,
            ..Self::NONE
        };
    }
}

/// A verdict's registration.
pub(crate) fn transform(report: &RegistrationReport) -> RigidTransform {
    RigidTransform::from_rows(report.rotation, report.translation_mm)
}
