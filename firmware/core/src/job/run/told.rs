//! What lines say beside hits: the run, its work offset, and what else moves its coordinates.

use umi_protocol::job::{Doubt, Name};
use umi_protocol::message::{TeachBy, TeachRefusal, TeachWhat};
use umi_protocol::reason::Reason;

use super::teach::TeachingAct;
use super::{Decision, Progress, Run, spec_of};
use crate::dprnt::{Announced, Said};
use crate::units::{Micros, Point};

/// A work offset as a run states it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) offset: u16,
    pub(super) origin: Point,
    /// The run in which the control was last asked to teach, as this run says; 0: it does not.
    pub(super) asked_in: u32,
}

/// Whether a run comes after another one. Macros count from 1 to [`MOST_RUN`] and go on with 1:
/// of the two ways around, the shorter one counts (as RFC 1982 compares serial numbers), so that
/// what is up to 49 999 runs old is old, also across the end of the count.
pub(super) const fn is_after(run: u32, last: u32) -> bool {
    let further = (run % MOST_RUN + MOST_RUN - last % MOST_RUN) % MOST_RUN;
    further != 0 && further < MOST_RUN / 2 + 1
}

/// The last number before a macro's count goes on with 1.
pub(super) const MOST_RUN: u32 = 99_999;

impl Run {
    /// The greatest run that was judged.
    #[must_use]
    pub fn last_run(&self) -> Option<u32> {
        self.last_run
    }

    /// Puts back what it was before the job began, or the board restarted.
    pub fn restore_last_run(&mut self, run: u32) {
        self.last_run = Some(run);
    }

    /// The control says something about the run that it begins.
    #[inline(never)]
    pub fn announced(
        &mut self,
        announced: &Announced,
        now: Micros,
        out: &mut impl FnMut(Decision<'_>),
    ) {
        self.last_hit = now;
        self.enter_run(announced.run, out);
        match announced.said {
            Said::Frame {
                offset,
                origin,
                asked_in,
            } => {
                self.give_up(Reason::RunChanged, out);
                self.frame = Some(Frame {
                    offset,
                    origin,
                    asked_in,
                });
                self.moved.clear();
                self.shifted = None;
            }
            Said::Moved(moved) => self.moved.put(moved),
            Said::Shifted { offset, by } => self.looked_at(offset, by),
            // A line that comes late must not forget what is taught: its run is refused anyway.
            Said::Teach { .. } if self.older_than.is_some() => {
                self.give_up(Reason::RunChanged, out);
            }
            Said::Teach { again } => {
                self.give_up(Reason::RunChanged, out);
                if self.is_asked_elsewhere() {
                    return;
                }
                let line = if again { Doubt::Again } else { Doubt::First };
                if self.doubts(line) {
                    if self.is_taught_by_asking() {
                        self.forget(out);
                    }
                    self.next_setup();
                    self.hold_against(Reason::TaughtTwice);
                    return;
                }
                let what = if again {
                    TeachWhat::Again
                } else {
                    TeachWhat::Reference
                };
                let taken = self.teach(now, TeachBy::Line, what, out);
                if let Err(TeachRefusal::AlreadyTaught) = taken {
                    self.next_setup();
                    self.hold_against(Reason::AlreadyTaught);
                }
            }
        }
    }

    /// The control has looked where its coordinates lie. It may look again: a shift that went
    /// away is none the less one, and so is another offset.
    fn looked_at(&mut self, offset: u16, by: Point) {
        if let Some(frame) = &self.frame
            && frame.offset != offset
        {
            let (got, expected) = (offset, frame.offset);
            self.hold_against(Reason::OtherOffset { got, expected });
        }
        let before = self.shifted.unwrap_or(by).mm;
        let most = before.zip_map(&by.mm, |a, b| if b.abs() > a.abs() { b } else { a });
        self.shifted = Some(Point { mm: most });
    }

    /// The lines are of this run. Another one ends the setup before.
    pub(super) fn enter_run(&mut self, run: u32, out: &mut impl FnMut(Decision<'_>)) {
        if self.run == Some(run) {
            return;
        }
        // Also where what came before was of no run.
        if self.run.is_some() || self.progress != Progress::Empty || self.collecting.is_some() {
            self.give_up(Reason::RunChanged, out);
            self.next_setup();
        }
        if self.asked.by == TeachBy::Line && matches!(self.teaching, TeachingAct::Next(_)) {
            // It was said of a run of which nothing else has come: this one is another.
            self.teaching = TeachingAct::None;
        }
        self.hold_no_teaching_against();
        self.run = Some(run);
        self.older_than = self.last_run.filter(|last| !is_after(run, *last));
        self.frame = None;
        self.moved.clear();
        self.shifted = None;
        self.began_with = None;
    }

    /// What a line that asked to teach is refused for concerns its own run alone.
    ///
    /// Not inlined: what it needs of the stack is free again when a setup is judged.
    #[inline(never)]
    fn hold_no_teaching_against(&mut self) {
        for reason in core::mem::take(&mut self.pending) {
            if !matches!(reason, Reason::AlreadyTaught | Reason::TaughtTwice) {
                let _ = self.pending.push(reason);
            }
        }
    }

    pub(super) fn began_with_name(&self) -> Option<Name> {
        let spec = spec_of(&self.job, self.began_with?)?;
        Some(spec.name.clone())
    }
}
