//! What spoils a setup, or takes its verdict back.

use umi_protocol::fault::FaultKind;
use umi_protocol::reason::Reason;

use super::{Decision, Progress, Run, spec_of};
use crate::job::reasons::add;

impl Run {
    /// The receiver found a fault that concerns more than a line of a block.
    pub fn fault(&mut self, kind: &FaultKind, out: &mut impl FnMut(Decision<'_>)) {
        match kind {
            FaultKind::Gap { .. } => self.hold_against(Reason::SequenceGap),
            FaultKind::ConflictingRepeat { run, .. } => self.contradicted(*run, out),
            FaultKind::BufferOverrun { lost } => {
                self.hold_against(Reason::BytesLost { count: *lost });
            }
            FaultKind::NotTouched => match self.collecting.get_mut() {
                Some(collecting) => {
                    let hit = collecting.next_number();
                    add(&mut collecting.reasons, Reason::NotTouched { hit });
                }
                None => self.hold_against(Reason::NotTouched { hit: 1 }),
            },
            FaultKind::BlockCountMismatch { expected, got } => {
                let (got, expected) = (*got, *expected);
                self.revoke(Reason::WrongCount { got, expected }, out);
            }
            FaultKind::BadParity { .. }
            | FaultKind::UnknownCharacter { .. }
            | FaultKind::LineTooLong { .. }
            | FaultKind::LineUnterminated
            | FaultKind::NumberFormat { .. }
            | FaultKind::BadCheckValue { .. }
            | FaultKind::NotUnderstood => self.damaged_line(),
            // The others have done their harm to a block, which says so, or to a
            // hit, which carries the doubt; or they did none.
            _ => {}
        }
    }

    /// A line could not be used. In a block the block says so; elsewhere a hit may
    /// be missing, and the next one must not take its place.
    fn damaged_line(&mut self) {
        if let Some(collecting) = self.collecting.get_mut()
            && !collecting.in_block
            && let Some(spec) = spec_of(&self.job, collecting.feature)
        {
            let got = u16::try_from(collecting.hits.len()).unwrap_or(u16::MAX);
            let expected = spec.hits;
            add(
                &mut collecting.reasons,
                Reason::DamagedLine { got, expected },
            );
        }
    }

    /// Something contradicts a setup that may have been judged: then its verdict
    /// is NG, under the same number.
    fn revoke(&mut self, reason: Reason, out: &mut impl FnMut(Decision<'_>)) {
        if self.progress == Progress::Judged && !self.collecting.is_some() {
            self.progress = Progress::UnderWay;
            self.hold_against(reason);
            self.close(None, out);
        } else {
            self.hold_against(reason);
        }
    }

    /// The control reads (DC1): what it has printed so far is of clampings before this moment.
    ///
    /// The one character passes by whatever text the control still holds back. A text that is
    /// late by whole setups is cut between two of them all the same; one that is cut within
    /// a feature is late by less, and then this says nothing.
    pub fn control_reads(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if let Some(began_with) = self.began_with_name()
            && !self.collecting.is_some()
        {
            self.give_up(Reason::OrderUnknown { began_with }, out);
            self.began_with = None;
        }
    }

    /// The control asks for a program on a line of its own, which comes in its turn: what it
    /// has printed so far is of clampings before this moment.
    pub fn control_asks(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if let Some(began_with) = self.began_with_name() {
            self.give_up(Reason::OrderUnknown { began_with }, out);
            self.began_with = None;
        } else if self.run.is_some() && self.is_under_way() {
            // Its features come in any order: without this, nothing says that some are lost.
            self.finish_unfinished(out);
            self.close(None, out);
        }
    }

    /// A line of this run came again with other content, and was dropped.
    ///
    /// Behind the run's verdict its number was used again: nothing of what is probed there is
    /// read, and a verdict says so, once.
    #[inline(never)]
    fn contradicted(&mut self, run: u32, out: &mut impl FnMut(Decision<'_>)) {
        if self.is_under_way() || self.progress != Progress::Judged || self.run != Some(run) {
            return self.hold_against(Reason::ConflictingRepeat);
        }
        let first = self
            .verdict
            .get()
            .and_then(|verdict| verdict.reasons.first());
        if first.is_some_and(|first| first.reason == Reason::ConflictingRepeat) {
            return;
        }
        self.next_setup();
        self.progress = Progress::UnderWay;
        self.close(Some(Reason::ConflictingRepeat), out);
    }

    /// Judges what is there; without anything there is nothing to judge.
    pub(super) fn give_up(&mut self, reason: Reason, out: &mut impl FnMut(Decision<'_>)) {
        let at_stake = self.is_under_way();
        self.finish_unfinished(out);
        if at_stake {
            // Finishing may have judged the setup already.
            let open = self.progress == Progress::UnderWay;
            self.close(open.then_some(reason), out);
            self.next_setup();
        }
    }
}
