//! Teaching: who asked for it, what a setup teaches, and what was taught.

use heapless::Vec;
use umi_protocol::job::{Doubt, Learned, Lessons, MAX_FEATURES, Reference, Teach};
use umi_protocol::message::{TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::{Decision, Progress, Run, Teaching};
use crate::job::check::place_count;
use crate::job::feature;
use crate::job::setup;
use crate::units::{Micros, Point};

/// Whether somebody asked to teach, and what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TeachingAct {
    /// No.
    None,
    /// The setup that comes next.
    Next(Lesson),
    /// The setup under way.
    This(Lesson),
}

/// Who asked to teach, and when.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) by: TeachBy,
    pub(super) at: Micros,
    /// Also in place of what there is.
    pub(super) again: bool,
}

impl Asked {
    pub(super) const NOBODY: Self = Self {
        by: TeachBy::Host,
        at: Micros(0),
        again: false,
    };

    /// Who that is, for the setup that it teaches.
    pub(super) fn doubt(self) -> Doubt {
        match (self.by, self.again) {
            (TeachBy::Line, true) => Doubt::Again,
            (TeachBy::Line, false) => Doubt::First,
            _ => Doubt::Unread,
        }
    }
}

/// What a setup is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lesson {
    /// The reference, and how its features are.
    Reference,
    /// How features may be, besides.
    More,
}

impl Run {
    pub(super) fn reference_is_taught(&self) -> bool {
        let job = self.job.get();
        job.is_some_and(|job| job.reference == Reference::Taught)
    }

    /// Nominal positions of the datum features: given, or taught.
    #[must_use]
    pub fn reference(&self) -> Option<&[Point]> {
        self.reference.as_deref()
    }

    /// The taught reference; none where the job gives its positions.
    #[must_use]
    pub fn taught(&self) -> Option<Teaching<'_>> {
        let places = self.reference().filter(|_| self.reference_is_taught())?;
        let learned = &self.learned;
        Some(Teaching { places, learned })
    }

    /// The setup that comes next is to teach. With [`TeachWhat::Again`] the reference that there
    /// is, is none any more, whatever becomes of the new one.
    ///
    /// # Errors
    /// Why there is nothing to teach: nothing has changed.
    pub fn teach(
        &mut self,
        now: Micros,
        by: TeachBy,
        what: TeachWhat,
        out: &mut impl FnMut(Decision<'_>),
    ) -> Result<(), TeachRefusal> {
        self.may_teach(what)?;
        if what == TeachWhat::Keep {
            if self.doubt == Doubt::Unread {
                self.no_doubt(out);
            }
            return Ok(());
        }
        let again = what == TeachWhat::Again;
        self.asked = Asked { by, at: now, again };
        if by != TeachBy::Line && what != TeachWhat::More {
            // Whoever asks there knows of what lines have taught.
            self.doubt = Doubt::None;
            self.asked_elsewhere = true;
        }
        if self.progress == Progress::UnderWay {
            // Judged when another one begins: a host that asks has not the room in which a setup is judged.
            self.hold_against(Reason::GivenUp);
        } else {
            self.collecting.clear();
            self.next_setup();
        }
        self.began_with = None;
        if what == TeachWhat::More {
            self.teaching = TeachingAct::Next(Lesson::More);
            return Ok(());
        }
        self.teaching = TeachingAct::Next(Lesson::Reference);
        self.forget(out);
        Ok(())
    }

    /// Whether a line leaves it in doubt which setup is meant, this one or the one before: that was
    /// taught by a line, too, and may be an old text that came late. `T2.` behind `T1.` says it: this
    /// one. A job that is taught by its first setup has no more protection than that `T2.` does not
    /// teach each.
    pub(super) fn doubts(&self, line: Doubt) -> bool {
        match self.doubt {
            Doubt::None | Doubt::Unread => false,
            Doubt::First => line == Doubt::First && self.is_taught_by_asking(),
            Doubt::Again => line == Doubt::Again || self.is_taught_by_asking(),
        }
    }

    /// Whether a host or the button has asked for the setup that comes next: a line in it asks for the same,
    /// and whichever setup comes first stays theirs.
    pub(super) fn is_asked_elsewhere(&self) -> bool {
        self.teaching == TeachingAct::Next(Lesson::Reference) && self.asked.by != TeachBy::Line
    }

    /// The control has got the program that compares this run, which taught, with its own: it goes on in that run, and stops
    /// in another one. Not where another run has taught meanwhile.
    pub fn compares(&mut self, run: u32, out: &mut impl FnMut(Decision<'_>)) {
        let is_here = self.progress == Progress::Judged && self.taught_here;
        if self.doubt == Doubt::Unread && is_here && self.learned.run == run {
            self.no_doubt(out);
        }
    }

    /// Which setup was meant is in doubt no more.
    pub(super) fn no_doubt(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        self.doubt = Doubt::None;
        if core::mem::take(&mut self.learned.doubt) != Doubt::None
            && let Some(taught) = self.taught()
        {
            out(Decision::Taught(taught));
        }
    }

    /// What is held against a setup that is measured by a reference that may be another's.
    pub(super) fn against_unread(&self, verdict: &mut Verdict) {
        let run = self.learned.run;
        let is_taught = self.doubt == Doubt::Unread && self.reference.is_some();
        if is_taught && self.run != Some(run) {
            setup::add(verdict, Reason::TaughtUnread { run });
        }
    }

    /// The run in which the control was last asked to teach, as the run under way says; 0: it does not.
    pub(super) fn asked_in(&self) -> u32 {
        self.frame.as_ref().map_or(0, |frame| frame.asked_in)
    }

    /// A setup whose line asked to teach was judged: what is taught stays, and its verdict has said so. Whether it has changed
    /// what is kept.
    pub(super) fn has_told_refusal(&mut self) -> bool {
        // The line itself says its run: the first one, which has it too, may have come damaged.
        let run = self.run.filter(|_| self.is_refused_teaching());
        match run.filter(|_| self.taught().is_some()) {
            Some(run) => core::mem::replace(&mut self.learned.asked_in, run) != run,
            None => false,
        }
    }

    /// Whether this setup's line asked to teach, and was refused.
    fn is_refused_teaching(&self) -> bool {
        let is_one = |reason| matches!(reason, &Reason::AlreadyTaught | &Reason::TaughtTwice);
        self.against.iter().any(is_one)
    }

    /// What is held against a setup whose run says that the control was asked to teach since the reference was taught, in a run
    /// of which nothing was judged: the line that asked was lost, or all else.
    pub(super) fn against_lost_asking(&self, verdict: &mut Verdict) {
        let asked_in = self.asked_in();
        // What an old run says was so before; and of a refused request its own verdict says all.
        let is_known = asked_in == 0
            || asked_in == self.learned.asked_in
            || self.older_than.is_some()
            || self.is_refused_teaching();
        if !is_known && self.taught().is_some() {
            setup::add(verdict, Reason::AskedInRun { asked_in });
        }
    }

    pub(super) fn is_taught_by_asking(&self) -> bool {
        self.job.get().is_some_and(|job| job.teach == Teach::Asked)
    }

    /// What was taught is the reference no more.
    pub(super) fn forget(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if self.reference.take().is_some() {
            self.learned = Lessons::NONE;
            self.feed_mm_per_min = 0.0;
            out(Decision::Taught(Teaching::NONE));
        }
    }

    /// Whether [`Self::teach`] would be taken.
    ///
    /// # Errors
    /// As there.
    pub fn may_teach(&self, what: TeachWhat) -> Result<(), TeachRefusal> {
        let job = self.job.get().ok_or(TeachRefusal::NoJob)?;
        let is_taught = self.reference.is_some();
        match what {
            _ if !self.reference_is_taught() => Err(TeachRefusal::Given),
            // Whoever asks anew gives up what is under way: a probing that was aborted does not end by itself for long.
            _ if self.is_under_way() && what != TeachWhat::Again => Err(TeachRefusal::UnderWay),
            TeachWhat::Reference if is_taught => Err(TeachRefusal::AlreadyTaught),
            TeachWhat::More if job.guards.learned.is_none() => Err(TeachRefusal::NoLearned),
            TeachWhat::More | TeachWhat::Keep if !is_taught => Err(TeachRefusal::NotTaught),
            _ => Ok(()),
        }
    }

    /// A teaching that was asked for and has not happened yet.
    #[must_use]
    pub fn teach_pending(&self) -> Option<TeachPending> {
        let setup = self.setup;
        let (lesson, setup) = match self.teaching {
            TeachingAct::None => return None,
            TeachingAct::Next(lesson) => (lesson, TeachSetup::Next),
            TeachingAct::This(lesson) => match (self.progress, self.verdict.get()) {
                (Progress::Judged, Some(verdict)) if verdict.ok => return None,
                (Progress::Judged, _) => (lesson, TeachSetup::Refused { setup }),
                _ => (lesson, TeachSetup::UnderWay { setup }),
            },
        };
        Some(TeachPending {
            by: self.asked.by,
            what: match lesson {
                Lesson::Reference => TeachWhat::Reference,
                Lesson::More => TeachWhat::More,
            },
            t_us: self.asked.at.0,
            setup,
        })
    }

    /// Puts back a reference that was taught before a restart. Ignored where
    /// the job gives its positions or the count does not fit.
    pub fn restore_reference(&mut self, taught: Teaching<'_>) {
        let due = self.job.get().map(place_count);
        if self.reference_is_taught() && due == Some(taught.places.len()) {
            self.reference = Vec::from_slice(taught.places).ok();
            self.learned = taught.learned.clone();
            self.doubt = self.learned.doubt;
            self.feed_mm_per_min = self.learned.feed_mm_per_min;
        }
    }

    /// How each feature of this setup is.
    pub(super) fn shown(&self) -> Vec<Learned, MAX_FEATURES> {
        let mut shown = Vec::new();
        for slot in &self.slots {
            let fit = slot.result.as_ref().and_then(|result| result.fit.as_ref());
            let learned = fit.map(|fit| feature::learned(fit, slot.centring_mm));
            // There are no more slots than that.
            let _ = shown.push(learned.unwrap_or_default());
        }
        shown
    }

    /// Widens what was learned by this setup, if it is to and is OK; whether what was learned
    /// has changed: also where a setup that has widened it is NG after all.
    #[inline(never)]
    pub(super) fn widens(&mut self, verdict: &Verdict) -> bool {
        let before = self.unwidened.take();
        let was_wider = before.is_some();
        if let Some(before) = before {
            self.learned = before;
        }
        if self.teaching != TeachingAct::This(Lesson::More) || !verdict.ok {
            return was_wider;
        }
        self.unwidened.put(self.learned.clone());
        let shown = self.shown();
        self.learned.widen(&shown);
        let further = self.learned.further;
        self.remark(Reason::TaughtMore { further });
        true
    }
}
