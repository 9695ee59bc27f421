//! Polls a board, and connects again to one that went away.

use std::time::{Duration, Instant};

use umi_client::files::key_file::SigningKey;
use umi_protocol::job::{Job, SendWhen};
use umi_protocol::message::{Event, Record};

use super::skip_line::SkipShown;
use super::view::{Link, View};
use crate::failure::Failure;
use umi_client::axes::Scale;
use umi_client::board::link::Client;
use umi_client::board::port;

/// How often the board's counters are read.
const STATUS: Duration = Duration::from_millis(500);

/// How long is waited before a board that went away is looked for again.
const AGAIN: Duration = Duration::from_millis(500);

/// Whether a job's corrections go to the control.
fn sends(job: Option<&Job>) -> bool {
    let spec = job.and_then(|job| job.correction.as_ref());
    spec.is_some_and(|spec| spec.send != SendWhen::Never)
}

/// A board that is watched.
pub(crate) struct Session {
    address: Option<String>,
    key: Option<SigningKey>,
    board: Option<Client>,
    view: View,
    /// When the board was lost, or is looked for again.
    gone: Option<Instant>,
    next_try: Instant,
    next_status: Instant,
    /// Of the connections before.
    damaged: u64,
}

impl Session {
    /// Connects.
    ///
    /// # Errors
    /// No board is there, or it does not answer.
    pub fn open(address: Option<&str>, key: Option<SigningKey>) -> Result<Self, Failure> {
        let mut board = port::connect_with(address, key.as_ref())?;
        let asked = Instant::now();
        let identity = board.identity()?;
        let link = Link {
            gone: None,
            answer: asked.elapsed(),
            damaged: 0,
            events_lost: 0,
            reconnected: 0,
        };
        let job = board.job()?.job;
        let view = View {
            identity,
            link,
            status: board.status()?,
            positions: board.positions()?,
            feed_mm_per_min: None,
            scale: Scale::of(job.as_ref()),
            sends: sends(job.as_ref()),
            sent: None,
            hits: [].into(),
            latch: None,
            skip: SkipShown::of(job.as_ref().map(|job| job.skip)),
            verdict: board.verdict()?,
        };
        board.live(true)?;
        let now = Instant::now();
        Ok(Self {
            address: address.map(str::to_owned),
            key,
            board: Some(board),
            view,
            gone: None,
            next_try: now,
            next_status: now,
            damaged: 0,
        })
    }

    /// What is known.
    #[must_use]
    pub const fn view(&self) -> &View {
        &self.view
    }

    /// Asks the board; one that is gone is looked for again. A board that does not
    /// answer takes as long as that takes.
    pub fn turn(&mut self) {
        if self.board.is_none() && Instant::now() >= self.next_try {
            match self.connect() {
                Ok(board) => {
                    self.board = Some(board);
                    self.gone = None;
                    self.view.link.reconnected += 1;
                }
                Err(failure) => self.lost(&failure),
            }
        }
        if let Some(mut board) = self.board.take() {
            match self.ask(&mut board) {
                Ok(()) => self.board = Some(board),
                Err(failure) => {
                    self.damaged += u64::from(board.counters().damaged());
                    self.lost(&failure);
                }
            }
        }
        if let (Some((_, since)), Some(gone)) = (&mut self.view.link.gone, self.gone) {
            *since = gone.elapsed();
        }
    }

    fn lost(&mut self, failure: &Failure) {
        let why = failure.problem().map(|problem| problem.message.as_str());
        let why = why.and_then(|why| why.lines().next()).unwrap_or_default();
        let since = self.gone.get_or_insert_with(Instant::now).elapsed();
        self.view.link.gone = Some((why.to_owned(), since));
        self.view.feed_mm_per_min = None;
        self.next_try = Instant::now() + AGAIN;
    }

    fn connect(&mut self) -> Result<Client, Failure> {
        let mut board = port::connect_with(self.address.as_deref(), self.key.as_ref())?;
        self.view.identity = board.identity()?;
        let job = board.job()?.job;
        self.view.scale = Scale::of(job.as_ref());
        self.view.skip = SkipShown::of(job.as_ref().map(|job| job.skip));
        (self.view.sends, self.view.sent) = (sends(job.as_ref()), None);
        self.view.verdict = board.verdict()?;
        // Another start, another zero.
        self.view.positions = board.positions()?;
        board.live(true)?;
        self.next_status = Instant::now();
        Ok(board)
    }

    fn ask(&mut self, board: &mut Client) -> Result<(), Failure> {
        let asked = Instant::now();
        let positions = board.positions()?;
        let view = &mut self.view;
        view.link.answer = asked.elapsed();
        view.link.gone = None;
        view.moved(positions);
        if asked >= self.next_status {
            self.next_status = asked + STATUS;
            view.status = board.status()?;
        }
        let (mut new_job, mut new_state) = (false, false);
        // What comes meanwhile is for the next turn.
        for _ in 0..1000 {
            match board.next_event(Duration::ZERO)? {
                None => break,
                Some(Event::Hit(hit)) => view.hit(hit),
                Some(Event::Dropped { count }) => view.link.events_lost += u64::from(count),
                Some(Event::Record { record, .. }) => match record {
                    Record::Verdict(verdict) => {
                        view.verdict = Some(verdict);
                        new_state = true;
                    }
                    Record::Taught { .. } => new_state = true,
                    Record::CorrectionSent {
                        setup,
                        complete: true,
                        ..
                    } => {
                        view.sent = Some(setup);
                        new_state = true;
                    }
                    Record::Latch(latch) => view.latched(latch),
                    Record::JobSet { .. } => new_job = true,
                    _ => {}
                },
                Some(Event::Line(_) | Event::Latches(_)) => {}
            }
        }
        if new_job {
            let job = board.job()?.job;
            view.scale = Scale::of(job.as_ref());
            view.skip = SkipShown::of(job.as_ref().map(|job| job.skip));
            (view.sends, view.sent, view.verdict) = (sends(job.as_ref()), None, board.verdict()?);
        }
        if new_job || new_state {
            // What is said of a verdict is not older than the verdict.
            view.status = board.status()?;
        }
        view.link.damaged = self.damaged + u64::from(board.counters().damaged());
        Ok(())
    }
}
