//! The brain: receiver and job joined. Bytes and time in, records out.
//!
//! ```text
//! bytes ─► dprnt::LineSplitter ─► lines, hits, blocks, faults ─► job::Run ─► features, verdicts
//! ```
//!
//! Everything that the brain decides follows from the sequence of calls and
//! their times alone. A journal that holds the calls can be replayed to the
//! same decisions, bit for bit.

use umi_protocol::fault::{Counters, Fault};
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::Job;
use umi_protocol::job_error::JobError;
use umi_protocol::latch::LatchReport;
use umi_protocol::line::{HitReport, LineReport};
use umi_protocol::message::{TeachBy, TeachRefusal, TeachWhat};
use umi_protocol::pattern::Coding;
use umi_protocol::verdict::Verdict;

use crate::dprnt::{Item, Line, LineSplitter, ReportedHit};
use crate::job::{self, Decision, Run, Teaching};
use crate::units::Micros;
use crate::zero_option::ZeroOption;

/// What comes out, in the order in which it happened.
#[derive(Clone, Copy, Debug)]
pub enum Output<'a> {
    /// A line from the control.
    Line(&'a LineReport),
    /// That line asks for the program of this number.
    Request(u32),
    /// A hit as the control reported it.
    Hit(&'a HitReport),
    /// Something was lost, damaged, doubtful or not understood.
    Fault(&'a Fault),
    /// A feature was fitted or refused.
    Feature(&'a FeatureResult),
    /// A setup was judged.
    Verdict(&'a Verdict),
    /// A setup became the reference; without places: there is none any more.
    Taught(Teaching<'a>),
}

/// Receiver and job joined, or neither.
#[derive(Debug)]
pub struct Brain {
    receiver: ZeroOption<LineSplitter>,
    run: Run,
}

impl Brain {
    /// No job: bytes are not read.
    #[must_use]
    pub const fn idle() -> Self {
        Self {
            receiver: ZeroOption::empty(),
            run: Run::idle(),
        }
    }

    /// Begins a job.
    ///
    /// # Errors
    /// Why the job cannot be used.
    pub fn new(job: Job) -> Result<Self, JobError> {
        let mut brain = Self::idle();
        brain.begin(&job)?;
        Ok(brain)
    }

    /// Begins a job in place of what was.
    ///
    /// # Errors
    /// Why the job cannot be used: then nothing has changed.
    pub fn begin(&mut self, job: &Job) -> Result<(), JobError> {
        job::check(job)?;
        self.put(job);
        Ok(())
    }

    /// A job has kilobytes: its copy is on the stack only here.
    #[inline(never)]
    fn put(&mut self, job: &Job) {
        self.receiver.put(LineSplitter::new(&job.receiver));
        self.run.begin(job.clone());
    }

    /// The job, if there is one.
    #[must_use]
    pub fn job(&self) -> Option<&Job> {
        self.run.job()
    }

    /// The job under way.
    #[must_use]
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// Puts back a reference that was taught before a restart.
    pub fn restore_reference(&mut self, taught: Teaching<'_>) {
        self.run.restore_reference(taught);
    }

    /// Puts back the greatest run that was judged before a restart.
    pub fn restore_last_run(&mut self, run: u32) {
        self.run.restore_last_run(run);
    }

    /// The code in which the control writes: the job's, or as detected.
    #[must_use]
    pub fn coding(&self) -> Coding {
        self.receiver
            .get()
            .map_or(Coding::Auto, LineSplitter::coding)
    }

    /// Lines of a program that seems to be punched, where its end does not come.
    #[must_use]
    pub fn punched_lines(&self, now: Micros) -> Option<u32> {
        self.receiver.get()?.punched_lines(now)
    }

    /// What the receiver has counted.
    #[must_use]
    pub fn counters(&self) -> Counters {
        let receiver = self.receiver.get();
        receiver.map(|r| *r.counters()).unwrap_or_default()
    }

    /// Bytes came from the control; `now` is when the last of them came.
    pub fn bytes(&mut self, now: Micros, bytes: &[u8], out: &mut impl FnMut(Output<'_>)) {
        let Self { receiver, run } = self;
        let Some(receiver) = receiver.get_mut() else {
            return;
        };
        receiver.receive(bytes, now, &mut items(run, now, out));
    }

    /// Bytes from the control were lost before they could be given to [`Self::bytes`].
    pub fn bytes_lost(&mut self, now: Micros, count: u32, out: &mut impl FnMut(Output<'_>)) {
        let Self { receiver, run } = self;
        let Some(receiver) = receiver.get_mut() else {
            return;
        };
        receiver.lost(count, now, &mut items(run, now, out));
    }

    /// The probe's skip line rose and the axes were latched.
    pub fn latched(&mut self, latch: &LatchReport) {
        self.run.latched(latch);
    }

    /// The setup that comes next is to teach.
    ///
    /// # Errors
    /// Why there is nothing to teach: nothing has changed.
    pub fn teach(
        &mut self,
        now: Micros,
        by: TeachBy,
        what: TeachWhat,
        out: &mut impl FnMut(Output<'_>),
    ) -> Result<(), TeachRefusal> {
        self.run.teach(now, by, what, &mut decisions(out))
    }

    /// The control has got the program that compares this run, which taught, with its own.
    pub fn compares(&mut self, run: u32, out: &mut impl FnMut(Output<'_>)) {
        self.run.compares(run, &mut decisions(out));
    }

    /// When [`Self::on_time`] is due.
    #[must_use]
    pub fn deadline(&self) -> Option<Micros> {
        let receiver = self.receiver.get().and_then(LineSplitter::deadline);
        match (receiver, self.run.deadline()) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// Time passed: gives up what has waited too long.
    pub fn on_time(&mut self, now: Micros, out: &mut impl FnMut(Output<'_>)) {
        let Self { receiver, run } = self;
        if let Some(receiver) = receiver.get_mut() {
            receiver.on_time(now, &mut items(run, now, out));
        }
        run.on_time(now, &mut decisions(out));
    }

    /// The input ended (a captured file; never on a machine).
    pub fn input_ended(&mut self, now: Micros, out: &mut impl FnMut(Output<'_>)) {
        let Self { receiver, run } = self;
        if let Some(receiver) = receiver.get_mut() {
            receiver.finish(now, &mut items(run, now, out));
        }
        run.input_ended(&mut decisions(out));
    }
}

// One function makes each kind of closure, so that it is one type, and receiver and job are
// compiled once for it. No calls through pointers: so the worst stack can be told.

fn items(run: &mut Run, now: Micros, out: &mut impl FnMut(Output<'_>)) -> impl FnMut(Item<'_>) {
    move |item| pass(run, &item, now, out)
}

fn decisions(out: &mut impl FnMut(Output<'_>)) -> impl FnMut(Decision<'_>) {
    |decision| out(decision.into())
}

/// One item of the receiver: shown, and given to the job.
fn pass(run: &mut Run, item: &Item<'_>, now: Micros, out: &mut impl FnMut(Output<'_>)) {
    match item {
        Item::Line(line) => show_line(line, out),
        Item::Request(number) => {
            out(Output::Request(*number));
            run.control_asks(&mut decisions(out));
        }
        Item::Reads => run.control_reads(&mut decisions(out)),
        Item::Announced(announced) => run.announced(announced, now, &mut decisions(out)),
        Item::Hit(hit) => {
            show_hit(hit, out);
            run.hit(hit, now, &mut decisions(out));
        }
        Item::BlockStart(start) => {
            run.block_start(&start.name, now, &mut decisions(out));
        }
        Item::BlockEnd(end) => run.block_end(end, now, &mut decisions(out)),
        Item::Fault(fault) => {
            out(Output::Fault(fault));
            run.fault(&fault.kind, &mut decisions(out));
        }
    }
}

// Reports are on the stack while they are shown, and not under what the job then does.

#[inline(never)]
fn show_line(line: &Line<'_>, out: &mut impl FnMut(Output<'_>)) {
    out(Output::Line(&line_report(line)));
}

#[inline(never)]
fn show_hit(hit: &ReportedHit, out: &mut impl FnMut(Output<'_>)) {
    out(Output::Hit(&hit_report(hit)));
}

impl<'a> From<Decision<'a>> for Output<'a> {
    fn from(decision: Decision<'a>) -> Self {
        match decision {
            Decision::Feature(feature) => Self::Feature(feature),
            Decision::Verdict(verdict) => Self::Verdict(verdict),
            Decision::Taught(taught) => Self::Taught(taught),
        }
    }
}

fn line_report(line: &Line<'_>) -> LineReport {
    LineReport {
        number: line.number,
        byte_offset: line.byte_offset,
        t_us: line.last.0,
        status: line.status,
        text: line
            .text
            .chars()
            .take(umi_protocol::line::MAX_LINE_TEXT)
            .collect(),
    }
}

fn hit_report(hit: &ReportedHit) -> HitReport {
    HitReport {
        line: hit.line,
        t_us: hit.last.0,
        feature: hit.feature.clone(),
        position_mm: hit.position.to_array_mm(),
        approach: hit.approach,
        feed_mm_per_min: hit.feed_mm_per_min,
    }
}
