//! A captured byte stream through a virtual board, as `umi replay` and `umi demo`
//! do it: the bytes go into the board's CNC port, everything that the board says
//! comes back over its link. Nothing is computed here.

use std::io;
use std::time::{Duration, Instant};

use umi_core::units::Micros;
use umi_protocol::fault::Fault;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::Job;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_protocol::message::{Event, Identity, Record};
use umi_protocol::verdict::Verdict;
use umi_virtual::{Config, HostEnd, VirtualBoard};

use crate::failure::Failure;
use crate::jobfile;
use crate::link::{Client, Transport};

/// Bytes handed to the board at once, about what an interrupt finds in a UART.
const CHUNK: usize = 64;

/// A character at 115200 baud, 8N1.
const CHARACTER_US: u64 = 87;

/// How long the board may take for what it has to compute.
const PATIENCE: Duration = Duration::from_secs(60);

impl Transport for HostEnd {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.read_into(buffer, timeout)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        Self::write(self, bytes)
    }
}

/// A virtual board with a job, and its host.
pub struct Bench {
    board: VirtualBoard,
    client: Client,
    identity: Identity,
    now_us: u64,
    /// The journal entry of which the next event tells.
    next_seq: u64,
    /// Skip edges so far.
    latches: u32,
}

/// What the board decides, in its order.
#[derive(Clone, Debug)]
pub enum Decision {
    /// A feature was fitted or refused.
    Feature(Box<FeatureResult>),
    /// A plate was judged.
    Verdict(Box<Verdict>),
    /// Something was lost, damaged, doubtful or not understood.
    Fault(Box<Fault>),
}

impl Decision {
    /// The decision in a record, if it is one that is shown.
    #[must_use]
    pub fn of(record: Record) -> Option<Self> {
        match record {
            Record::Feature(feature) => Some(Self::Feature(Box::new(feature))),
            Record::Verdict(verdict) => Some(Self::Verdict(Box::new(verdict))),
            Record::Fault(fault) => Some(Self::Fault(Box::new(fault))),
            _ => None,
        }
    }
}

impl Bench {
    /// Switches a new virtual board on and sets a job.
    ///
    /// # Errors
    /// The board cannot be started, or refuses the job.
    pub fn new(job: &Job) -> Result<Self, Failure> {
        Self::with(Config::default(), job)
    }

    /// As [`Self::new`], with this hardware.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with(config: Config, job: &Job) -> Result<Self, Failure> {
        let board = VirtualBoard::start(config)
            .map_err(|error| Failure::trouble("virtual_board", error))?;
        let mut client = Client::new(Box::new(board.connect()))?;
        let identity = client.identity()?;
        client
            .set_job(job)?
            .map_err(|error| jobfile::refusal(&error))?;
        let next_seq = client.journal_info()?.next_seq;
        client.live(true)?;
        Ok(Self {
            board,
            client,
            identity,
            now_us: 0,
            next_seq,
            latches: 0,
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
    pub fn play(
        &mut self,
        bytes: &[u8],
        mut seen: impl FnMut(Decision) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
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
        self.board.move_to(Positions {
            counts: counts.into_iter().collect(),
            t_ns: at.0.saturating_mul(1000),
            illegal: counts.iter().map(|_| 0).collect(),
            lost_samples: 0,
        });
    }

    /// The probe's skip line rises and latches the axes.
    ///
    /// # Errors
    /// The link's.
    pub fn latch(&mut self, at: Micros, counts: [i64; 3]) -> Result<(), Failure> {
        self.advance(at);
        let number = self.latches;
        self.latches = number.wrapping_add(1);
        self.board.latch(LatchReport {
            number,
            cause: LatchCause::Skip,
            counts: counts.into_iter().collect(),
            t_ns: at.0.saturating_mul(1000),
            missed: 0,
        });
        self.follow(|record| matches!(record, Record::Latch(_)), &mut |_| Ok(()))
    }

    /// The input ends.
    ///
    /// # Errors
    /// As [`Self::play`].
    pub fn end(
        &mut self,
        mut seen: impl FnMut(Decision) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.board.input_ends();
        self.follow(|record| matches!(record, Record::InputEnd), &mut seen)?;
        self.settle_with(&mut seen)
    }

    /// The control's READ: asks with DC1 and takes the program up to its closing
    /// `%`: the correction, or what raises an alarm. None if the job sends nothing.
    ///
    /// # Errors
    /// The link's.
    pub fn read_program(&mut self) -> Result<Option<String>, Failure> {
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
        self.follow(is_last, &mut |_| Ok(()))?;
        Ok(program)
    }

    /// Takes events up to a record.
    fn follow(
        &mut self,
        is_last: impl Fn(&Record) -> bool,
        seen: &mut impl FnMut(Decision) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        loop {
            let record = self.next_record()?;
            let last = is_last(&record);
            if let Some(decision) = Decision::of(record) {
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
    pub fn settle(&mut self) -> Result<(), Failure> {
        self.settle_with(&mut |_| Ok(()))
    }

    /// Takes the events up to the newest entry of the journal.
    fn settle_with(
        &mut self,
        seen: &mut impl FnMut(Decision) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let newest = self.client.journal_info()?.next_seq;
        while self.next_seq < newest {
            if let Some(decision) = Decision::of(self.next_record()?) {
                seen(decision)?;
            }
        }
        Ok(())
    }

    /// The next entry of the journal, as the board tells of it.
    fn next_record(&mut self) -> Result<Record, Failure> {
        let stuck = |what: &str| Failure::trouble("virtual_board", what);
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
