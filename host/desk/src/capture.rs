//! A desk as fast as it computes: a virtual board with its host, for `umi replay` and
//! `umi demo`. Captured bytes go into the board's CNC port, and its decisions come back over
//! its link. Nothing is computed here.

use std::time::{Duration, Instant};

use crate::AxisCounts;
use umi_core::job::looks_at_falls;
use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_protocol::latch::LatchCause;
use umi_protocol::message::{Event, Identity, Record};
use umi_virtual::{Config, VirtualBoard};

use umi_client::board::link::Client;
use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;

/// Bytes handed to the board at once, about what an interrupt finds in a UART.
const CHUNK: usize = 64;

/// A character at 115200 baud, 8N1.
const CHARACTER_US: u64 = 87;

/// How long the board may take for what it has to compute.
const PATIENCE: Duration = Duration::from_secs(60);

/// A virtual board with a job, and its host.
pub struct Desk {
    board: VirtualBoard,
    client: Client,
    identity: Identity,
    now_us: u64,
    /// The journal entry of which the next event tells.
    next_seq: u64,
    /// Rises of the skip line so far, and falls.
    latches: u32,
    ends: u32,
    /// The board keeps falls, too.
    keeps_ends: bool,
    /// Counts of the rotary axes.
    turned: Vec<i64>,
}

impl Desk {
    /// Switches a new virtual board on and sets a job.
    ///
    /// # Errors
    /// The board cannot be started, or refuses the job.
    pub fn new(job: &Job) -> Result<Self, Problem> {
        Self::with(Config::default(), job)
    }

    /// As [`Self::new`], with this hardware.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with(config: Config, job: &Job) -> Result<Self, Problem> {
        let (board, mut client) = crate::start(config, job)?;
        let identity = client.identity()?;
        let next_seq = client.journal_info()?.next_seq;
        client.live(true)?;
        Ok(Self {
            board,
            client,
            identity,
            now_us: 0,
            next_seq,
            latches: 0,
            ends: 0,
            keeps_ends: looks_at_falls(job),
            turned: Vec::new(),
        })
    }

    /// Who the board is.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The board itself: its control's port and its outputs.
    #[must_use]
    pub fn board(&self) -> &VirtualBoard {
        &self.board
    }

    /// The board's host.
    pub fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// The control sends bytes; the board's decisions go to `seen` as they come.
    ///
    /// # Errors
    /// The link's, and what `seen` returns.
    pub fn play<E: From<Problem>>(
        &mut self,
        bytes: &[u8],
        mut seen: impl FnMut(DecisionRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        for chunk in bytes.chunks(CHUNK) {
            self.now_us += CHARACTER_US * chunk.len() as u64;
            self.board.advance(Micros(self.now_us));
            self.board.control_sends(chunk);
            // One piece at a time: so stamps and pieces, and with them the whole
            // journal, are the same on every run, and no event is dropped.
            self.follow(|record| matches!(record, Record::Bytes { .. }), &mut seen)?;
        }
        self.settle_with(&mut seen)
    }

    /// Time passes on the board's clock; it never goes back.
    pub fn advance(&mut self, to: Micros) {
        self.now_us = self.now_us.max(to.0);
        self.board.advance(Micros(self.now_us));
    }

    /// The axes are there.
    pub fn move_to(&self, at: Micros, counts: [i64; 3]) {
        let counts = AxisCounts::new(counts, &self.turned);
        self.board.move_to(crate::axes(at.0, counts));
    }

    /// The rotary axes show these counts from now on.
    pub fn turned(&mut self, counts: &[i64]) {
        self.turned = counts.to_vec();
    }

    /// The probe's skip line rises, or falls, and latches the axes.
    ///
    /// # Errors
    /// The link's.
    pub fn latch(
        &mut self,
        at: Micros,
        cause: LatchCause,
        counts: [i64; 3],
    ) -> Result<(), Problem> {
        self.advance(at);
        let counts = AxisCounts::new(counts, &self.turned);
        let edges = match cause {
            LatchCause::SkipEnd => &mut self.ends,
            _ => &mut self.latches,
        };
        let edge = crate::skip_edge(edges, cause, at.0, counts);
        self.board.latch(edge);
        if cause == LatchCause::SkipEnd && !self.keeps_ends {
            return Ok(());
        }
        self.follow(|record| matches!(record, Record::Latch(_)), &mut nobody)
    }

    /// The input ends.
    ///
    /// # Errors
    /// As [`Self::play`].
    pub fn end<E: From<Problem>>(
        &mut self,
        mut seen: impl FnMut(DecisionRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        self.board.input_ends();
        self.follow(|record| matches!(record, Record::InputEnd), &mut seen)?;
        self.settle_with(&mut seen)
    }

    /// The control's READ: asks with DC1 and takes the program up to its closing
    /// `%`: the correction, or what raises an alarm. None if the job sends nothing.
    ///
    /// # Errors
    /// The link's.
    pub fn read_program(&mut self) -> Result<Option<String>, Problem> {
        let waiting = self.client.status()?.correction_waiting;
        // Where nothing is announced, it is still looked whether something comes.
        let patience = Duration::from_millis(if waiting { 5_000 } else { 100 });
        let program = read_program(&self.board, patience);
        let is_last: fn(&Record) -> bool = if program.is_none() {
            |record| matches!(record, Record::Bytes { .. })
        } else {
            |record| {
                matches!(
                    record,
                    Record::CorrectionSent { .. } | Record::AlarmSent { .. }
                )
            }
        };
        self.follow(is_last, &mut nobody)?;
        Ok(program)
    }

    /// Takes events up to a record.
    fn follow<E: From<Problem>>(
        &mut self,
        is_last: impl Fn(&Record) -> bool,
        seen: &mut impl FnMut(DecisionRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        loop {
            let record = self.next_record()?;
            let last = is_last(&record);
            if let Some(decision) = DecisionRecord::of(record) {
                seen(decision)?;
            }
            if last {
                return Ok(());
            }
        }
    }

    /// Takes the events up to the newest entry of the journal, and shows them to
    /// nobody: after something else was done with [`Self::board`].
    ///
    /// # Errors
    /// The link's.
    pub fn settle(&mut self) -> Result<(), Problem> {
        self.settle_with(&mut nobody)
    }

    /// Takes the events up to the newest entry of the journal.
    fn settle_with<E: From<Problem>>(
        &mut self,
        seen: &mut impl FnMut(DecisionRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        let newest = self.client.journal_info().map_err(Problem::from)?.next_seq;
        while self.next_seq < newest {
            if let Some(decision) = DecisionRecord::of(self.next_record()?) {
                seen(decision)?;
            }
        }
        Ok(())
    }

    /// The next entry of the journal, as the board tells of it.
    fn next_record(&mut self) -> Result<Record, Problem> {
        let stuck = |what: &str| Problem::trouble("virtual_board", what);
        let deadline = Instant::now() + PATIENCE;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.client.next_event(left)? {
                Some(Event::Record { seq, record, .. }) if seq == self.next_seq => {
                    self.next_seq += 1;
                    return Ok(record);
                }
                Some(Event::Line(_) | Event::Hit(_) | Event::Latches(_)) => {}
                Some(Event::Record { .. } | Event::Dropped { .. }) => {
                    return Err(stuck("the virtual board has skipped an event"));
                }
                None => return Err(stuck("the virtual board does not go on")),
            }
        }
    }
}

/// Shows a decision to nobody.
///
/// # Errors
/// None.
pub fn nobody(_: DecisionRecord) -> Result<(), Problem> {
    Ok(())
}

/// The control's READ at a board: asks with DC1 and takes the program up to its closing
/// `%`. None if no byte comes in this time.
pub fn read_program(board: &VirtualBoard, patience: Duration) -> Option<String> {
    const DC1: u8 = 0x11;
    board.control_sends(&[DC1]);
    let mut program = String::new();
    while let Some(byte) = board.control_receives(patience) {
        program.push(char::from(byte & 0x7F));
        if program.len() > 2 && program.ends_with("%\n") {
            break;
        }
    }
    (!program.is_empty()).then_some(program)
}
