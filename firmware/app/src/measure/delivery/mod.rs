//! What the control gets when it reads, and how that comes out, byte by byte.
//!
//! ```text
//! READ ─► begin ─► Correction, alarm ───────────────────────────────┐
//!                ─► stored program ─► looked through ─► (rewritten) ─► queue ─► next_byte ─► line
//!                ─► passed through by the host ───────► (rewritten) ─┘
//! ```
//!
//! # Design
//!
//! **Who may have it.** A correction goes out once, after a verdict OK that is in the journal.
//! A program goes out as its [`Release`] says; after a verdict, too, each goes out once, and
//! begins within the job's setup time-out. Whatever is measured again takes both back, also
//! in the middle. Who asks for what it may not have gets an alarm under the number that
//! it asked for.
//!
//! **Asked for once.** A new request takes back what is on its way: the control has begun
//! something else, and never gets the tail of an old program. One that was held for longer
//! than it may be gets an alarm until it is asked for anew: nobody knows where the machine
//! stands in it. What it already has is ended by the `%` with which everything begins here.
//!
//! **How it comes out** is the business of [`stream`].
//!
//! **In the journal first.** That a program or a correction begins is in the journal before its
//! first byte goes out, and what became of it when it has ended: a power cut in between leaves
//! the first alone. What the journal does not take does not go out.
//!
//! # Tradeoffs
//!
//! A program that the control broke off (NAK) stays asked for and begins anew at the next
//! READ. What a control
//! has of it has no end (`%`), so one that stores it has no program. One that carries it out
//! as it comes stands still where it broke off, at the latest behind the last whole line; who
//! begins it anew has to be where a machine can begin.
//!
//! # Limitations
//!
//! A control that calls the same program twice after one verdict gets an alarm the second
//! time, unless the program's release is [`Release::Always`].
//!
//! What a program prints while it is carried out as it comes is a measurement like any other:
//! one that needs a verdict breaks off there.

mod answer;
mod stream;

use core::fmt::Write as _;

use umi_core::control::{Exchange, XOFF_PATIENCE_US};
use umi_core::correction::{RunCheck, alarm_compares, withheld};
use umi_core::journal::Flash;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{
    AllowedCalls, Integers, MeasuredIn, ProgramIdentity, RewriteDialect, RewriteSettings, Source,
    StartModes, Unit,
};
use umi_core::units::{Micros, Mm};
use umi_protocol::job::SendWhen;
use umi_protocol::message::Record;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{
    IntegerRule, MAX_NUMBER, ProgramInfo, ProgramRefusal, Release, RewriteSpec, StatedDialect,
    UnitRule, Withheld,
};

use crate::measure::Instrument;
use crate::measure::release::{Passed, Released};
use stream::{Part, Stage, What};

pub(crate) use stream::{Delivery, Next};

impl<F: Flash> Instrument<F> {
    /// Decides what the control gets; how long it may hold the line meanwhile. None: it gets
    /// nothing.
    #[inline(never)]
    pub(crate) fn begin(&mut self, now: Micros, asked: Exchange) -> Option<u64> {
        let has_begun = match asked {
            // What goes out by itself may also be asked for; not the reverse.
            Exchange::Verdict if self.waiting() != Some(SendWhen::OnVerdict) => false,
            Exchange::Verdict => self.correction(now),
            // It may be a "go on" of what has ended: nothing begins anew by it.
            Exchange::ReadOrResume if self.ledger.wanted.has_ended() => self.correction(now),
            Exchange::ReadOrResume => self.program(now) || self.correction(now),
            // It is what a control says in many other states: no alarm for it.
            Exchange::Xmodem if self.ledger.wanted.is_plain => self.correction(now),
            Exchange::Xmodem => self.program(now) || self.correction(now),
            // Nothing goes out.
            Exchange::Receive => false,
            Exchange::Read => self.program(now) || self.correction(now) || self.alarm(now),
        };
        self.ledger.wanted.is_plain |= has_begun && asked != Exchange::Xmodem;
        let delivery = self.delivery.get_mut().filter(|_| has_begun)?;
        if asked == Exchange::Xmodem {
            // Blocks have eight bits, and the control's parity is for lines.
            delivery.coding = Coding::Ascii;
        }
        Some(match &delivery.what {
            What::Program(part) => part.hold_us,
            What::Correction { .. } | What::Alarm { .. } | What::Answer => XOFF_PATIENCE_US,
        })
    }

    /// Something new to send, all of it there.
    #[inline(never)]
    fn open(&mut self, what: What, arming: u32, text: &str) {
        let (coding, request) = (self.coding(), self.ledger.wanted.count);
        self.delivery
            .put(Delivery::new(what, coding, arming, request));
        if let Some(delivery) = self.delivery.get_mut() {
            delivery.set(text);
        }
    }

    /// Does a part of the work on what is being sent; whether there may be more at once.
    pub(crate) fn fill(&mut self, now: Micros) -> bool {
        let delivery = self.delivery.get_mut();
        let more = delivery.is_some_and(|delivery| delivery.fill(self.programs.get_mut()));
        self.note_beginning(now);
        more
    }

    /// Where a program is about to go out: it is in the journal before its first byte, or an
    /// alarm goes out in its place.
    fn note_beginning(&mut self, now: Micros) {
        let Some(delivery) = self.delivery.get_mut() else {
            return;
        };
        if delivery.begins()
            && let What::Program(part) = &delivery.what
        {
            let (number, crc32) = (part.number, part.crc32);
            let rewritten_for = part.rewritten_for();
            if !self.program_begins(now, number, crc32, rewritten_for)
                && let Some(delivery) = self.delivery.get_mut()
            {
                delivery.withhold(Withheld::NotJournaled);
            }
        }
    }

    /// In a function of its own, as a record is large on the stack.
    #[inline(never)]
    fn program_begins(
        &mut self,
        now: Micros,
        number: u32,
        crc32: u32,
        rewritten_for: Option<u32>,
    ) -> bool {
        let record = Record::ProgramBegun {
            number,
            crc32,
            rewritten_for,
        };
        self.ledger.record(now, record)
    }

    /// As [`Self::program_begins`].
    #[inline(never)]
    fn correction_begins(&mut self, now: Micros, setup: u32) -> bool {
        self.ledger.record(now, Record::CorrectionBegun { setup })
    }

    /// Whether [`Self::fill`] has room to work.
    pub(crate) fn is_hungry(&self) -> bool {
        self.delivery.get().is_some_and(Delivery::is_hungry)
    }

    /// The next byte of what is being sent. A new measurement, job or verdict takes it back,
    /// even now, and so does another request.
    pub(crate) fn next_byte(&mut self) -> Next {
        let holds = self.holds();
        match self.delivery.get_mut() {
            Some(delivery) if holds => delivery.next_byte(),
            _ => Next::End { whole: false },
        }
    }

    /// Whether the control has all of what is being sent, but for the ends of lines behind
    /// the last `%`.
    pub(crate) fn is_all_out(&self) -> bool {
        let delivery = self.delivery.get().filter(|_| self.holds());
        delivery.is_some_and(Delivery::is_all_out)
    }

    /// Whether what is being sent may go on.
    fn holds(&self) -> bool {
        self.delivery.get().is_some_and(|of| match &of.what {
            _ if of.request != self.ledger.wanted.count => false,
            What::Correction { .. } => self.ledger.armed_as(of.arming),
            What::Program(_) if of.arming > 0 => self.ledger.released_as(of.arming),
            What::Program(_) | What::Alarm { .. } | What::Answer => true,
        })
    }

    /// Whether something is on its way that has been taken back: the next READ is for
    /// something else.
    pub(crate) fn is_taken_back(&self) -> bool {
        let delivery = self.delivery.get();
        delivery.is_some_and(|of| of.request != self.ledger.wanted.count)
    }

    /// It went out, or broke off.
    #[inline(never)]
    pub(crate) fn sent(&mut self, now: Micros, sent: &Sent) {
        let Some(delivery) = self.delivery.take() else {
            return self.received(now, sent.whole > 0);
        };
        let (bytes, complete) = (sent.bytes, sent.whole > 0);
        let record = match delivery.what {
            What::Correction { setup } => Record::CorrectionSent {
                setup,
                bytes,
                complete,
            },
            What::Alarm { number, why, run } => Record::AlarmSent {
                number,
                why,
                bytes,
                complete,
                run,
            },
            What::Answer => {
                if complete {
                    self.answer_is_out(delivery.request);
                }
                // What it says is in the journal with its place; that it went out would be an
                // entry for each line.
                return;
            }
            What::Program(part) => {
                let end = match delivery.refused {
                    Some(why) => Some(Err(why)),
                    None => complete.then_some(Ok(())),
                };
                if let Some(passed) = self.ledger.passed.get_mut()
                    && part.stored.is_none()
                    && end.is_some()
                {
                    passed.end = end;
                }
                let wanted = &mut self.ledger.wanted;
                if delivery.request == wanted.count {
                    wanted.is_stale = sent.is_held > 0;
                    if end.is_some() {
                        wanted.set(0, false);
                    }
                }
                if let Some(released) = self.ledger.released.get_mut()
                    && released.arming == delivery.arming
                    && complete
                {
                    // There is room for as many as there are programs; what is passed
                    // through has a number as well, and waits for the next verdict.
                    let _ = released.gone.push(part.number);
                }
                Record::ProgramSent {
                    number: part.number,
                    crc32: part.crc32,
                    rewritten_for: part.rewritten_for(),
                    bytes,
                    complete,
                }
            }
        };
        if complete {
            match &record {
                Record::CorrectionSent { .. } if self.ledger.armed_as(delivery.arming) => {
                    self.ledger.disarm();
                    if let Some(released) = self.ledger.released.get_mut() {
                        released.is_gone = true;
                    }
                }
                Record::AlarmSent { number, why, .. } if *number == self.ledger.wanted.number => {
                    if let Some(passed) = self.ledger.passed.get_mut()
                        && passed.info.number == *number
                        && passed.end.is_none()
                    {
                        passed.end = Some(Err(*why));
                    }
                    self.ledger.wanted.set(0, false);
                }
                _ => {}
            }
        }
        let compares = match record {
            Record::AlarmSent {
                complete: true,
                run,
                ..
            } => run,
            _ => None,
        };
        self.ledger.record(now, record);
        if let Some(run) = compares {
            let Self { brain, ledger, .. } = self;
            brain.compares(run, &mut ledger.listen(now));
            self.keep_taught(now);
        }
    }

    /// Whether a correction waits for the control, and whether it goes out by
    /// itself.
    #[must_use]
    pub fn waiting(&self) -> Option<SendWhen> {
        self.arming()?;
        let spec = self.brain().job()?.correction?;
        (spec.send != SendWhen::Never).then_some(spec.send)
    }

    /// Begins with the correction that the control may have now; false if there is none.
    #[inline(never)]
    fn correction(&mut self, now: Micros) -> bool {
        if self.waiting().is_none() {
            return false;
        }
        let Some(Released { setup, arming, .. }) = self.ledger.armed() else {
            return false;
        };
        let (setup, arming) = (*setup, *arming);
        // What the journal refuses disarms it.
        if !self.correction_begins(now, setup) {
            return false;
        }
        let text = match self.ledger.armed() {
            Some(released) => released.correction.clone(),
            None => return false,
        };
        self.open(What::Correction { setup }, arming, &text);
        true
    }

    /// Begins with the program that raises an alarm, in the place of a correction; false if
    /// the job sends none to the control.
    #[inline(never)]
    fn alarm(&mut self, now: Micros) -> bool {
        let job = self.brain().job();
        let spec = job.and_then(|job| job.correction);
        let variable = job.and_then(|job| job.guards.run_variable);
        let Some(spec) = spec.filter(|spec| spec.send != SendWhen::Never) else {
            return false;
        };
        let why = self.ledger.no_verdict(now);
        let run = self.ledger.released.get().and_then(|of| of.run);
        let check = variable.zip(run);
        let check = check.and_then(|(at, run)| RunCheck::of_correction(spec.dialect, at, run));
        let Some(text) = umi_core::correction::alarm(&spec, &why, check, self.coding()) else {
            return false;
        };
        let number = spec.program_number.into();
        let is_taught = why == Withheld::OnlyTaught && check.is_some();
        let compares = is_taught && alarm_compares(spec.dialect, self.coding());
        let run = run.filter(|_| compares);
        self.open(What::Alarm { number, why, run }, 0, &text);
        true
    }

    /// Begins with the program that the control has asked for, or with what it gets instead;
    /// false if it has asked for none.
    #[inline(never)]
    fn program(&mut self, now: Micros) -> bool {
        let number = self.ledger.wanted.number;
        if number == 0 {
            return false;
        }
        self.ledger.wanted.has_begun = true;
        if self.answer(number) {
            return true;
        }
        match self.part(now, number) {
            Ok(part) => self.open_program(now, part),
            Err(why) => {
                let text = withheld(number, &why, self.coding());
                self.open(
                    What::Alarm {
                        number,
                        why,
                        run: None,
                    },
                    0,
                    &text,
                );
            }
        }
        true
    }

    #[inline(never)]
    fn open_program(&mut self, now: Micros, part: Part) {
        let released = self.ledger.released.get().filter(|_| part.setup.is_some());
        let arming = released.map_or(0, |of| of.arming);
        let stage = match part.stored {
            Some(_) => Stage::Looking,
            None => Stage::Sending,
        };
        let (coding, request) = (self.coding(), self.ledger.wanted.count);
        let delivery = Delivery::new(What::Program(part), coding, arming, request);
        self.delivery.put(delivery);
        if let Some(delivery) = self.delivery.get_mut() {
            delivery.rewind(stage);
        }
        self.note_beginning(now);
    }

    /// What is to be sent of a program, if it may be.
    #[inline(never)]
    fn part(&mut self, now: Micros, number: u32) -> Result<Part, Withheld> {
        if self.ledger.wanted.is_stale {
            return Err(Withheld::HeldTooLong);
        }
        let (info, stored) = match self.ledger.passed(number) {
            Some(info) => (info.clone(), None),
            None => {
                let store = self.programs.get_mut().ok_or(Withheld::NotThere)?;
                let program = store.find(number).ok_or(Withheld::NotThere)?;
                let info = store.info(&program).map_err(|_| Withheld::Damaged)?;
                (info, Some(program))
            }
        };
        let mut part = Part {
            number,
            bytes: info.bytes,
            crc32: info.crc32,
            stored,
            how: None,
            setup: None,
            hold_us: u64::from(info.hold_s.max(1)) * 1_000_000,
        };
        let spec = match info.release {
            Release::Always if self.ledger.in_custody().config.ceilings.always => return Ok(part),
            Release::Always => return Err(Withheld::AlwaysForbidden),
            Release::Never => return Err(Withheld::NotReleased),
            Release::AfterVerdict if self.waiting().is_some() => {
                return Err(Withheld::NotCorrected);
            }
            Release::AfterVerdict => None,
            Release::Rewritten(spec) => Some(spec),
        };
        let released = self.ledger.released.get().filter(|of| now < of.until);
        let released = released.ok_or(self.ledger.no_verdict(now))?;
        if released.gone.contains(&number) || released.gone.is_full() {
            return Err(Withheld::GoneOut);
        }
        part.setup = Some(released.setup);
        let Some(spec) = spec else { return Ok(part) };
        let job = self.brain().job().ok_or(Withheld::NoVerdict)?;
        if job.correction.is_some_and(|of| of.send != SendWhen::Never) {
            return Err(Withheld::CorrectedTwice);
        }
        let transform = released.transform.ok_or(Withheld::NoRegistration)?;
        let mut source = Source::new();
        // The name of a job is short.
        let _ = write!(
            source,
            "VERDICT OK - {} - SETUP {}",
            job.name, released.setup
        );
        if let Some(run) = released.run {
            let _ = write!(source, " - RUN {run}");
        }
        let measured_in = MeasuredIn::of(job.correction.as_ref());
        let mut how = settings(&spec, transform, &info, source).measured_at(measured_in);
        if let Some(variable) = job.guards.run_variable {
            // A job that has the one has the other, and a verdict without a run is not OK.
            let (dialect, run) = job
                .correction
                .map(|of| of.dialect)
                .zip(released.run)
                .ok_or(Withheld::NoVerdict)?;
            let check = RunCheck::of(dialect, variable, run).ok_or(Withheld::NoVerdict)?;
            if !how.takes(check) {
                return Err(Withheld::BadSettings);
            }
            how.run = Some(check);
        }
        part.how = Some(how);
        Ok(part)
    }

    /// The control's next READ gets what the host will pass through.
    pub(crate) fn pass(&mut self, info: &ProgramInfo) -> Result<(), ProgramRefusal> {
        if !(1..=MAX_NUMBER).contains(&info.number) {
            return Err(ProgramRefusal::BadNumber);
        }
        if info.bytes == 0 {
            return Err(ProgramRefusal::Empty);
        }
        self.offer(info.number)?;
        self.ledger.passed.put(Passed {
            info: info.clone(),
            end: None,
        });
        Ok(())
    }

    /// The control's next READ gets this one, unless it has asked for one itself.
    pub(crate) fn offer(&mut self, number: u32) -> Result<(), ProgramRefusal> {
        let asks = self.ledger.wanted.number > 0 && self.ledger.wanted.by_control;
        if self.delivery.is_some() || asks {
            return Err(ProgramRefusal::Busy);
        }
        self.ledger.wanted.set(number, false);
        Ok(())
    }

    /// Bytes that the host passes through; the offset of the byte that is wanted next. What
    /// finds no room, or stands elsewhere, is not taken. None: all of it has gone out.
    pub(crate) fn passed(
        &mut self,
        offset: u32,
        bytes: &[u8],
    ) -> Result<Option<u32>, ProgramRefusal> {
        let passed = self.ledger.passed.get().ok_or(ProgramRefusal::NotBegun)?;
        match passed.end {
            Some(Ok(())) => return Ok(None),
            Some(Err(why)) => return Err(ProgramRefusal::Withheld(why)),
            None => {}
        }
        let Some(delivery) = self.delivery.get_mut().filter(|of| of.is_passed()) else {
            // The control has not read yet, or what it had broke off.
            return Ok(Some(0));
        };
        delivery.pass(offset, bytes);
        Ok(Some(delivery.offset()))
    }

    /// The host is gone: what it passed through has no end.
    pub(crate) fn host_gone(&mut self) {
        if let Some(delivery) = self.delivery.get_mut()
            && delivery.is_passed()
            && !delivery.has_ended()
        {
            delivery.break_off();
        }
        if let Some(passed) = self.ledger.passed.take()
            && passed.end.is_none()
            && passed.info.number == self.ledger.wanted.number
        {
            self.ledger.wanted.number = 0;
        }
    }
}

/// What becomes of a program, said by who sends it. Plain numbers: a value of zeros is valid.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    /// Bytes that went out.
    pub bytes: u32,
    /// 1 if that is all of it.
    pub whole: u32,
    /// 1 if the control held the line for too long.
    pub is_held: u32,
}

/// How a program is rewritten.
fn settings(
    spec: &RewriteSpec,
    transform: RigidTransform,
    info: &ProgramInfo,
    source: Source,
) -> RewriteSettings {
    let micrometres = |um: u16| Mm(f64::from(um) / 1000.0);
    let mut allowed_calls = AllowedCalls::new();
    if info.stated.allow_call > 0 {
        // Five digits find room.
        let _ = write!(allowed_calls, "{}", info.stated.allow_call);
    }
    RewriteSettings {
        decimals_mm: spec.decimals_mm,
        chord: micrometres(spec.chord_um),
        clearance: micrometres(spec.clearance_um),
        integers: match spec.integers {
            IntegerRule::Refused => None,
            IntegerRule::Units => Some(Integers::Units),
            IntegerRule::Increments => Some(Integers::Steps),
        },
        unit: match spec.unit {
            UnitRule::Said => None,
            UnitRule::Mm => Some(Unit::Millimetre),
            UnitRule::Inch => Some(Unit::Inch),
        },
        original: Some(ProgramIdentity {
            crc32: info.crc32,
            bytes: info.bytes.into(),
        }),
        source,
        // What is no mode is not taken; with nothing stated the program is refused by name.
        start: StartModes::unpacked(info.stated.start_packed).unwrap_or_default(),
        dialect: match info.stated.dialect {
            StatedDialect::NotSaid => None,
            StatedDialect::Fanuc => Some(RewriteDialect::Fanuc),
            StatedDialect::LinuxCnc => Some(RewriteDialect::LinuxCnc),
        },
        allowed_calls,
        // Who put the program here was asked.
        loose_rapids: true,
        ..RewriteSettings::new(transform)
    }
}
