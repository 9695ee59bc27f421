//! The audit: the inputs that a journal holds, through a new brain. The
//! decisions must be those of the journal, bit for bit.

use umi_core::brain::{Brain, Output};
use umi_core::job::{Teaching, begins_anew};
use umi_core::units::Micros;
use umi_protocol::fault::{Fault, FaultCode};
use umi_protocol::message::{MAX_RECORD, Record, TeachBy, TeachWhat};
use umi_protocol::schema::max_len;

use crate::measure::patience_us;
use crate::measure::settings::{kept, points};

/// Replays a journal, record by record in its order.
pub struct Replay {
    brain: Option<Brain>,
    /// Decisions of the replay that the journal must hold next, encoded, each
    /// behind its length.
    expected: heapless::Deque<u8, EXPECTED>,
    decisions: u64,
    interruptions: u64,
    /// The name of the fault that was compared last: more of it may be told later, by their count.
    fault: Option<FaultCode>,
    /// So many were, as far as they came with earlier inputs, and the latest of them.
    counted: u32,
    latest: Option<Fault>,
    /// What came behind the latest verdict takes it back.
    taken_back: bool,
    /// When it is too old for what it released, if it is OK.
    until: Option<Micros>,
}

/// Room for the decisions that one input can lead to: a chunk of 256 bytes ends at
/// most a few lines, and a feature, a verdict and a reference go with the last.
const EXPECTED: usize = 4 * MAX_RECORD;

/// Bytes of a fault's record, at most.
const MAX_FAULT: usize = max_len::<Fault>() + 1;

/// The journal does not hold what its inputs lead to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difference {
    /// The journal holds a decision that the replay does not come to.
    NotReached,
    /// The journal holds another decision than the replay comes to.
    Other,
    /// The replay comes to a decision that the journal does not hold.
    Missing,
    /// A job that cannot be used stands in the journal.
    BadJob,
    /// The replay came to more decisions at once than can be compared.
    TooMany,
}

impl core::fmt::Display for Difference {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotReached => "the journal holds a decision to which its inputs do not lead",
            Self::Other => "the journal holds another decision than its inputs lead to",
            Self::Missing => "the inputs lead to a decision that the journal does not hold",
            Self::BadJob => "the journal holds a job that this version would not take",
            Self::TooMany => "the inputs lead to more decisions at once than can be compared",
        })
    }
}

impl core::error::Error for Difference {}

impl Default for Replay {
    fn default() -> Self {
        Self::new()
    }
}

impl Replay {
    /// Before the first record.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            brain: None,
            expected: heapless::Deque::new(),
            decisions: 0,
            interruptions: 0,
            fault: None,
            counted: 0,
            latest: None,
            taken_back: false,
            until: None,
        }
    }

    /// What came behind the latest verdict takes it back, as
    /// [`crate::measure::Instrument::input`] does: a line that says something, a touch, bytes that
    /// were lost, teaching; or it is older than the job allows (`plate_timeout_s`).
    #[must_use]
    pub const fn taken_back(&self) -> bool {
        self.taken_back
    }

    /// Decisions compared so far.
    #[must_use]
    pub const fn decisions(&self) -> u64 {
        self.decisions
    }

    /// Takes the next record: inputs go into the brain, decisions are compared.
    /// After a difference the replay goes on behind it.
    ///
    /// # Errors
    /// What differs.
    pub fn next(
        &mut self,
        now: Micros,
        record: &Record,
        scratch: &mut [u8; MAX_RECORD],
    ) -> Result<(), Difference> {
        if self.until.is_some_and(|until| now >= until) {
            self.until = None;
            self.taken_back = true;
        }
        match record {
            Record::Fault(_) | Record::Feature(_) | Record::Verdict(_) | Record::Taught { .. } => {
                if self.counted > 0 {
                    // They are told before anything else.
                    self.counted = 0;
                    return Err(Difference::Missing);
                }
                if let Record::Fault(fault) = record {
                    self.fault = Some(fault.code());
                }
                let compared = self.compare(record, scratch);
                if let Record::Verdict(verdict) = record {
                    if compared == Err(Difference::NotReached) {
                        self.taken_back = false;
                    }
                    let job = self.brain.as_ref().and_then(Brain::job);
                    let patience = job.filter(|_| verdict.ok).map(patience_us);
                    self.until = patience.map(|us| Micros(now.0.saturating_add(us)));
                }
                compared
            }
            Record::FaultsAgain { latest, count } => self.again(latest, *count),
            Record::LastRun { run } => {
                if let Some(brain) = &mut self.brain {
                    brain.restore_last_run(*run);
                }
                self.nothing_expected()
            }
            Record::Acknowledged { .. }
            | Record::ConfigSet(_)
            | Record::Recovered { .. }
            | Record::CorrectionSent { .. }
            | Record::ProgramKept { .. }
            | Record::Access { .. }
            | Record::AccessRefused { .. }
            | Record::Wiped { .. }
            | Record::Update { .. }
            | Record::HostTime { .. }
            | Record::SensorSet { .. }
            | Record::Place(_)
            | Record::CaptureLost(_)
            | Record::ProgramDeleted { .. }
            | Record::ProgramSent { .. }
            | Record::ProgramNotKept { .. }
            | Record::CorrectionBegun { .. }
            | Record::ProgramBegun { .. }
            | Record::JobLost { .. }
            | Record::Head(_) => Ok(()),
            Record::AlarmSent {
                complete: false, ..
            }
            | Record::AlarmSent { run: None, .. } => Ok(()),
            Record::Scan(_) => self.nothing_expected(),
            Record::Latch(latch) => {
                if let Some(brain) = &mut self.brain {
                    brain.latched(latch);
                    self.taken_back |= brain.job().is_some_and(|job| begins_anew(job, latch));
                }
                self.nothing_expected()
            }
            Record::Boot { .. } => {
                // The power may have gone between an input and its decisions.
                self.interrupted();
                self.brain = None;
                // The clock begins anew, and what was released is none any more.
                self.taken_back |= self.until.take().is_some();
                Ok(())
            }
            Record::JobSet { job, .. } => {
                let complete = self.nothing_expected();
                self.brain = Some(Brain::new(job.clone()).map_err(|_| Difference::BadJob)?);
                complete
            }
            Record::ReferenceRestored {
                positions_mm,
                learned,
            } => {
                if let Some(brain) = &mut self.brain {
                    brain.restore_reference(Teaching {
                        places: &points(positions_mm),
                        learned,
                    });
                }
                self.nothing_expected()
            }
            Record::Bytes { .. }
            | Record::BytesLost { .. }
            | Record::Time
            | Record::InputEnd
            | Record::AlarmSent { .. }
            | Record::TeachAsked { .. }
            | Record::ButtonHeld { .. } => {
                let complete = self.nothing_expected();
                self.input(now, record, scratch)?;
                complete
            }
        }
    }

    /// Ends of power cycles at which the last input's decisions are not in the
    /// journal any more, because the power went between the two.
    #[must_use]
    pub const fn interruptions(&self) -> u64 {
        self.interruptions
    }

    /// So many faults of the name of the one before have come since.
    fn again(&mut self, latest: &Fault, count: u32) -> Result<(), Difference> {
        while self.counted < count && self.count_one() {}
        let counted = core::mem::take(&mut self.counted);
        let is_same = counted == count && self.latest.take().as_ref() == Some(latest);
        self.decisions += u64::from(count);
        is_same.then_some(()).ok_or(Difference::Other)
    }

    /// Counts the decision that is expected next, if it is one more of the fault before.
    fn count_one(&mut self) -> bool {
        let Some((length, fault)) = self.next_fault() else {
            return false;
        };
        if self.fault != Some(fault.code()) {
            return false;
        }
        for _ in 0..length + 2 {
            self.expected.pop_front();
        }
        self.counted += 1;
        self.latest = Some(fault);
        true
    }

    /// The decision that is expected next, if it is a fault, and its length.
    fn next_fault(&self) -> Option<(usize, Fault)> {
        let byte = |at: usize| self.expected.iter().nth(at).copied();
        let length = usize::from(u16::from_le_bytes([byte(0)?, byte(1)?]));
        let mut room = [0; MAX_FAULT];
        let bytes = room.get_mut(..length)?;
        for (place, byte) in bytes.iter_mut().zip(self.expected.iter().skip(2)) {
            *place = *byte;
        }
        match postcard::from_bytes(bytes) {
            Ok(Record::Fault(fault)) => Some((length, fault)),
            _ => None,
        }
    }

    fn interrupted(&mut self) {
        (self.fault, self.latest) = (None, None);
        if !self.expected.is_empty() || core::mem::take(&mut self.counted) > 0 {
            self.expected.clear();
            self.interruptions += 1;
        }
    }

    /// The journal ends here.
    ///
    /// # Errors
    /// [`Difference::Missing`].
    pub fn finish(&mut self) -> Result<(), Difference> {
        self.nothing_expected()
    }

    fn input(
        &mut self,
        now: Micros,
        record: &Record,
        scratch: &mut [u8; MAX_RECORD],
    ) -> Result<(), Difference> {
        let Self {
            brain: Some(brain),
            expected,
            taken_back,
            ..
        } = self
        else {
            return Ok(());
        };
        *taken_back |= matches!(
            record,
            Record::BytesLost { .. }
                | Record::TeachAsked { keep: false, .. }
                | Record::ButtonHeld { refused: None }
        );
        let mut fits = true;
        let out = &mut |output: Output<'_>| {
            match &output {
                Output::Line(line) => *taken_back |= !line.status.is_silent(),
                Output::Verdict(_) => *taken_back = false,
                _ => {}
            }
            if let Some(decision) = decision(output) {
                fits &= keep(expected, &decision, scratch);
            }
        };
        match record {
            Record::Bytes { raw } => brain.bytes(now, raw, out),
            Record::BytesLost { count } => brain.bytes_lost(now, *count, out),
            Record::Time => brain.on_time(now, out),
            // It was taken then, so it is now, or the decisions differ.
            Record::TeachAsked { more, keep } => {
                let what = match (more, keep) {
                    (_, true) => TeachWhat::Keep,
                    (true, _) => TeachWhat::More,
                    _ => TeachWhat::Again,
                };
                let _ = brain.teach(now, TeachBy::Host, what, out);
            }
            Record::AlarmSent { run, .. } => {
                if let Some(run) = run {
                    brain.compares(*run, out);
                }
            }
            Record::ButtonHeld { refused: None } => {
                let _ = brain.teach(now, TeachBy::Button, TeachWhat::Reference, out);
            }
            Record::ButtonHeld { refused: Some(_) } => {}
            _ => brain.input_ended(now, out),
        }
        if fits {
            Ok(())
        } else {
            Err(Difference::TooMany)
        }
    }

    fn compare(
        &mut self,
        record: &Record,
        scratch: &mut [u8; MAX_RECORD],
    ) -> Result<(), Difference> {
        self.decisions += 1;
        let (Some(low), Some(high)) = (self.expected.pop_front(), self.expected.pop_front()) else {
            return Err(Difference::NotReached);
        };
        let length = usize::from(u16::from_le_bytes([low, high]));
        let held = postcard::to_slice(record, scratch).map_err(|_| Difference::Other)?;
        let mut same = held.len() == length;
        for at in 0..length {
            let byte = self.expected.pop_front();
            same &= byte.is_some() && byte.as_ref() == held.get(at);
        }
        if same { Ok(()) } else { Err(Difference::Other) }
    }

    fn nothing_expected(&mut self) -> Result<(), Difference> {
        while self.count_one() {}
        if self.expected.is_empty() {
            return Ok(());
        }
        self.expected.clear();
        Err(Difference::Missing)
    }
}

/// What of the brain's output is journaled.
fn decision(output: Output<'_>) -> Option<Record> {
    Some(match output {
        Output::Line(_) | Output::Request(_) | Output::Hit(_) => return None,
        Output::Fault(fault) => Record::Fault(fault.clone()),
        Output::Feature(feature) => Record::Feature(feature.clone()),
        Output::Verdict(verdict) => Record::Verdict(verdict.clone()),
        Output::Taught(taught) => {
            let (positions_mm, learned) = kept(&taught);
            Record::Taught {
                positions_mm,
                learned,
            }
        }
    })
}

fn keep(
    expected: &mut heapless::Deque<u8, EXPECTED>,
    record: &Record,
    scratch: &mut [u8; MAX_RECORD],
) -> bool {
    let Ok(bytes) = postcard::to_slice(record, scratch) else {
        return false;
    };
    let Ok(length) = u16::try_from(bytes.len()) else {
        return false;
    };
    let room = EXPECTED - expected.len();
    if room < bytes.len() + 2 {
        return false;
    }
    for byte in length.to_le_bytes().iter().chain(&*bytes) {
        // There is room: just looked.
        let _ = expected.push_back(*byte);
    }
    true
}
