//! Calls to a board.

use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use umi_protocol::decoder::{Counters, Decoder};
use umi_protocol::feature::FeatureResult;
use umi_protocol::frame::{Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, OpenError, encode};
use umi_protocol::hello::Hello;
use umi_protocol::job::Job;
use umi_protocol::latch::{Positions, TriggerOut};
use umi_protocol::message::{Event, Identity, JournalInfo, Request, Response, Status};
use umi_protocol::program::{Piece, ProgramInfo, ProgramRefusal, ProgramRoom};
use umi_protocol::refusal::JobError;
use umi_protocol::verdict::Verdict;

use super::{LinkError, Transport, open};

/// Events kept while nobody asks for them: some 5 MB.
const MAX_EVENTS: usize = 1000;

/// How long to wait for a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For one answer, counted from when the request was sent.
    pub answer: Duration,
    /// How often a request is sent before giving up. A new job is sent only
    /// once and waited for as long as all tries together.
    pub tries: u32,
}

impl Default for Patience {
    /// Three times a second: a board answers within milliseconds, but for
    /// the erasure of a flash sector in between.
    fn default() -> Self {
        Self {
            answer: Duration::from_secs(1),
            tries: 3,
        }
    }
}

/// The job that a board works on.
#[derive(Clone, Debug, PartialEq)]
pub struct JobInForce {
    /// None: no job has been set.
    pub job: Option<Job>,
    /// The taught reference positions in the order of the job's datum features, if a
    /// plate has been taught.
    pub taught_mm: Option<Vec<[f64; 3]>>,
}

/// What a journal holds under a sequence number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JournalEntry {
    /// The entry as stored, with its check and chain values.
    Stored(Vec<u8>),
    /// It is not there any more, or not yet.
    None(JournalInfo),
}

/// What is known of the chain before an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JournalChain {
    /// The value.
    Before([u8; 32]),
    /// Damage before the entry hides it.
    Hidden,
    /// The entry is not there any more, or not yet.
    None(JournalInfo),
}

/// A board at the other end of a byte pipe.
pub struct Client {
    transport: Box<dyn Transport>,
    decoder: Box<Decoder<MAX_BOARD_FRAME>>,
    /// Received and not yet decoded: from `next` on.
    input: Vec<u8>,
    next: usize,
    /// Who the board is, once it has been greeted.
    board: Option<String>,
    patience: Patience,
    sequence: u16,
    events: VecDeque<Event>,
    /// Sequence number of the latest event.
    last_event: Option<u16>,
}

/// How much room there is for programs and some of them; or why there are none.
pub type Programs = Result<(ProgramRoom, Vec<ProgramInfo>), ProgramRefusal>;

/// One message from the board.
enum Incoming {
    Hello(Hello),
    Response(Box<Response>),
}

impl Client {
    /// Connects to the board at an address, see [`open`].
    ///
    /// # Errors
    /// As [`open`] and [`Client::new`].
    pub fn open(address: &str) -> Result<Self, LinkError> {
        Self::new(open(address)?)
    }

    /// Greets the board at the other end of a pipe.
    ///
    /// # Errors
    /// [`LinkError::NobodyAnswers`], [`LinkError::Mismatch`], [`LinkError::Closed`].
    pub fn new(transport: Box<dyn Transport>) -> Result<Self, LinkError> {
        Self::with_patience(transport, Patience::default())
    }

    /// As [`Client::new`], with other waiting times.
    ///
    /// # Errors
    /// As [`Client::new`].
    pub fn with_patience(
        transport: Box<dyn Transport>,
        patience: Patience,
    ) -> Result<Self, LinkError> {
        let mut client = Self {
            transport,
            decoder: Box::default(),
            input: Vec::new(),
            next: 0,
            board: None,
            patience,
            sequence: 0,
            events: VecDeque::new(),
            last_event: None,
        };
        client.greet()?;
        Ok(client)
    }

    /// Who the board said that it is, for people.
    #[must_use]
    pub fn board(&self) -> &str {
        self.board.as_deref().unwrap_or_default()
    }

    /// What came from the board, intact and damaged.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// Who the board is.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn identity(&mut self) -> Result<Identity, LinkError> {
        match self.call(&Request::IdentityGet)? {
            Response::Identity(identity) => Ok(identity),
            _ => Err(wrong_answer(&Request::IdentityGet)),
        }
    }

    /// What the board does and what it has counted.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn status(&mut self) -> Result<Status, LinkError> {
        match self.call(&Request::StatusGet)? {
            Response::Status(status) => Ok(status),
            _ => Err(wrong_answer(&Request::StatusGet)),
        }
    }

    /// The job in force and the taught reference.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn job(&mut self) -> Result<JobInForce, LinkError> {
        match self.call(&Request::JobGet)? {
            Response::Job { job, taught_mm } => Ok(JobInForce {
                job,
                taught_mm: taught_mm.map(|positions| positions.to_vec()),
            }),
            _ => Err(wrong_answer(&Request::JobGet)),
        }
    }

    /// Whether the board would take a job; changes nothing. The inner error is
    /// the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn check_job(&mut self, job: &Job) -> Result<Result<(), JobError>, LinkError> {
        self.job_call(&Request::JobCheck(job.clone()))
    }

    /// Gives the board a job; it forgets the taught reference. The inner error
    /// is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls; [`LinkError::JobOutcomeUnknown`] if no answer came. The
    /// request is not repeated: a plate may be taught in between.
    pub fn set_job(&mut self, job: &Job) -> Result<Result<(), JobError>, LinkError> {
        self.job_call(&Request::JobSet(job.clone()))
    }

    /// Switches the unasked reports on or off.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn live(&mut self, on: bool) -> Result<(), LinkError> {
        let request = Request::LiveSet { on };
        match self.call(&request)? {
            Response::Done => {
                if !on {
                    // What is not reported from now on is no loss.
                    self.last_event = None;
                }
                Ok(())
            }
            _ => Err(wrong_answer(&request)),
        }
    }

    /// Where the axes are now, and what they counted wrong.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn positions(&mut self) -> Result<Positions, LinkError> {
        match self.call(&Request::PositionsGet)? {
            Response::Positions(positions) => Ok(positions),
            _ => Err(wrong_answer(&Request::PositionsGet)),
        }
    }

    /// Trigger pulses for a scanner from now on, or none. False: the board has no such
    /// output or axis, or cannot keep that interval, and nothing has changed.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn trigger_out(&mut self, when: TriggerOut) -> Result<bool, LinkError> {
        self.station_call(&Request::TriggerOutSet(when))
    }

    /// Enables a scanner's laser, or not. False: the board has no such output.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn laser(&mut self, on: bool) -> Result<bool, LinkError> {
        self.station_call(&Request::LaserSet { on })
    }

    fn station_call(&mut self, request: &Request) -> Result<bool, LinkError> {
        match self.call(request)? {
            Response::Done => Ok(true),
            Response::NotOnThisBoard => Ok(false),
            _ => Err(wrong_answer(request)),
        }
    }

    /// The latest result of a feature by its place in the job, from 0.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn feature(&mut self, feature: u8) -> Result<Option<FeatureResult>, LinkError> {
        let request = Request::FeatureGet { feature };
        match self.call(&request)? {
            Response::Feature(result) => Ok(result),
            _ => Err(wrong_answer(&request)),
        }
    }

    /// The latest verdict.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn verdict(&mut self) -> Result<Option<Verdict>, LinkError> {
        match self.call(&Request::VerdictGet)? {
            Response::Verdict(verdict) => Ok(verdict),
            _ => Err(wrong_answer(&Request::VerdictGet)),
        }
    }

    /// What the journal holds.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn journal_info(&mut self) -> Result<JournalInfo, LinkError> {
        match self.call(&Request::JournalInfo)? {
            Response::JournalInfo(info) => Ok(info),
            _ => Err(wrong_answer(&Request::JournalInfo)),
        }
    }

    /// One entry of the journal by its sequence number.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn journal_read(&mut self, seq: u64) -> Result<JournalEntry, LinkError> {
        let request = Request::JournalRead { seq };
        match self.call(&request)? {
            Response::JournalEntry { seq: of, raw } if of == seq => {
                Ok(JournalEntry::Stored(raw.to_vec()))
            }
            Response::JournalNoEntry(info) => Ok(JournalEntry::None(info)),
            _ => Err(wrong_answer(&request)),
        }
    }

    /// The chain value before an entry; before the next one to come: that of the
    /// whole journal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn journal_chain(&mut self, seq: u64) -> Result<JournalChain, LinkError> {
        let request = Request::JournalChain { seq };
        match self.call(&request)? {
            Response::JournalChain { seq: of, before } if of == seq => {
                Ok(before.map_or(JournalChain::Hidden, JournalChain::Before))
            }
            Response::JournalNoEntry(info) => Ok(JournalChain::None(info)),
            _ => Err(wrong_answer(&request)),
        }
    }

    /// How much room there is for programs, and the programs behind the first `skip`: as
    /// many as an answer holds, none at the end.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn programs(&mut self, skip: u16) -> Result<Programs, LinkError> {
        let request = Request::ProgramList { skip };
        match self.call(&request)? {
            Response::Programs { room, programs } => Ok(Ok((room, programs.to_vec()))),
            Response::ProgramRefused(refusal) => Ok(Err(refusal)),
            _ => Err(wrong_answer(&request)),
        }
    }

    /// Begins an upload, or goes on with one that broke off: where the byte stands that is
    /// wanted next. The inner error is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_begin(
        &mut self,
        program: &ProgramInfo,
    ) -> Result<Result<u32, ProgramRefusal>, LinkError> {
        self.upload_call(&Request::ProgramBegin(program.clone()))
    }

    /// Sends bytes of an upload: where the byte stands that is wanted next. The inner error
    /// is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_piece(
        &mut self,
        offset: u32,
        bytes: Piece,
    ) -> Result<Result<u32, ProgramRefusal>, LinkError> {
        self.upload_call(&Request::ProgramPiece { offset, bytes })
    }

    /// Ends an upload: after this the program is on the board, whole. The inner error is the
    /// board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_end(
        &mut self,
        number: u32,
        crc32: u32,
    ) -> Result<Result<(), ProgramRefusal>, LinkError> {
        self.program_call(&Request::ProgramEnd { number, crc32 })
    }

    /// Bytes of a program; none behind its end. The inner error is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_read(
        &mut self,
        number: u32,
        offset: u32,
    ) -> Result<Result<Vec<u8>, ProgramRefusal>, LinkError> {
        let request = Request::ProgramRead { number, offset };
        match self.call(&request)? {
            Response::ProgramBytes { offset: at, bytes } if at == offset => Ok(Ok(bytes.to_vec())),
            Response::ProgramRefused(refusal) => Ok(Err(refusal)),
            _ => Err(wrong_answer(&request)),
        }
    }

    /// Deletes a program. The inner error is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_delete(&mut self, number: u32) -> Result<Result<(), ProgramRefusal>, LinkError> {
        self.program_call(&Request::ProgramDelete { number })
    }

    /// Makes a program what the control's next READ gets. The inner error is the board's
    /// refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_offer(&mut self, number: u32) -> Result<Result<(), ProgramRefusal>, LinkError> {
        self.program_call(&Request::ProgramOffer { number })
    }

    /// Lets the board ask the control for a program by XMODEM. The inner error is the board's
    /// refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_receive(&mut self) -> Result<Result<(), ProgramRefusal>, LinkError> {
        self.program_call(&Request::ProgramReceive)
    }

    /// Makes what will be passed through what the control's next READ gets. The inner error
    /// is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_pass(
        &mut self,
        program: &ProgramInfo,
    ) -> Result<Result<u32, ProgramRefusal>, LinkError> {
        self.upload_call(&Request::ProgramPass(program.clone()))
    }

    /// Passes bytes through: where the byte stands that is wanted next; none when all has
    /// gone out. The inner error is the board's refusal.
    ///
    /// # Errors
    /// [`LinkError`], as all calls.
    pub fn program_passed(
        &mut self,
        offset: u32,
        bytes: Piece,
    ) -> Result<Result<Option<u32>, ProgramRefusal>, LinkError> {
        let request = Request::ProgramPassed { offset, bytes };
        match self.call(&request)? {
            Response::ProgramAt { offset } => Ok(Ok(Some(offset))),
            Response::Done => Ok(Ok(None)),
            Response::ProgramRefused(refusal) => Ok(Err(refusal)),
            _ => Err(wrong_answer(&request)),
        }
    }

    fn upload_call(&mut self, request: &Request) -> Result<Result<u32, ProgramRefusal>, LinkError> {
        match self.call(request)? {
            Response::ProgramAt { offset } => Ok(Ok(offset)),
            Response::ProgramRefused(refusal) => Ok(Err(refusal)),
            _ => Err(wrong_answer(request)),
        }
    }

    fn program_call(&mut self, request: &Request) -> Result<Result<(), ProgramRefusal>, LinkError> {
        match self.call(request)? {
            Response::Done => Ok(Ok(())),
            Response::ProgramRefused(refusal) => Ok(Err(refusal)),
            _ => Err(wrong_answer(request)),
        }
    }

    /// The next event that the board reports, in their order; none if `timeout`
    /// passes without one. Those that came during a call are kept. What was
    /// lost, by the board, on the line or here, stands in its place as
    /// [`Event::Dropped`]. (A board that starts again counts from 0, which shows as a loss.)
    ///
    /// # Errors
    /// [`LinkError::Closed`], [`LinkError::BoardChanged`].
    pub fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, LinkError> {
        let deadline = Instant::now() + timeout;
        loop {
            // Answers that nobody waits for any more are passed over.
            while self.decode("events")?.is_some() {}
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            // Without patience, too, what has already come is looked at.
            if !self.receive(deadline)? {
                return Ok(None);
            }
        }
    }

    fn job_call(&mut self, request: &Request) -> Result<Result<(), JobError>, LinkError> {
        match self.call(request)? {
            Response::Done => Ok(Ok(())),
            Response::JobRefused(error) => Ok(Err(error)),
            _ => Err(wrong_answer(request)),
        }
    }

    fn greet(&mut self) -> Result<(), LinkError> {
        let before = self.counters();
        let hello = Hello::new(concat!("umi ", env!("CARGO_PKG_VERSION")));
        let Patience { answer, tries } = self.patience;
        let mut echo = false;
        for _ in 0..tries {
            self.send(&hello)?;
            let deadline = Instant::now() + answer;
            while let Some((sequence, incoming)) = self.wait(deadline, "hello")? {
                match incoming {
                    // A line that echoes, or a loop, is no board. One may still follow.
                    Incoming::Hello(theirs) if theirs == hello => echo = true,
                    Incoming::Hello(theirs) if sequence == self.sequence => {
                        return self.accept(&theirs);
                    }
                    _ => {}
                }
            }
        }
        Err(LinkError::NobodyAnswers {
            waited: answer * tries,
            seen: self.counters().since(&before),
            echo,
        })
    }

    fn accept(&mut self, hello: &Hello) -> Result<(), LinkError> {
        hello.check().map_err(|mismatch| LinkError::Mismatch {
            board: hello.sender.as_str().into(),
            mismatch,
        })?;
        self.board = Some(hello.sender.as_str().into());
        Ok(())
    }

    /// Sends a request until its answer comes.
    fn call(&mut self, request: &Request) -> Result<Response, LinkError> {
        let Patience { answer, tries } = self.patience;
        let waited = answer * tries;
        // Setting a job twice is not the same as once: see `set_job`.
        let (answer, tries) = if matches!(request, Request::JobSet(_)) {
            (waited, 1)
        } else {
            (answer, tries)
        };
        let name = name(request);
        let before = self.counters();
        self.sequence = self.sequence.wrapping_add(1);
        for _ in 0..tries {
            self.send(request)?;
            let deadline = Instant::now() + answer;
            while let Some((sequence, incoming)) = self.wait(deadline, name)? {
                if sequence != self.sequence {
                    continue; // of an earlier request that was given up
                }
                return match incoming {
                    Incoming::Response(response) => match *response {
                        Response::StorageFailed => Err(LinkError::StorageFailed),
                        response => Ok(response),
                    },
                    // So a board answers what it cannot open.
                    Incoming::Hello(hello) => {
                        self.accept(&hello)?;
                        Err(LinkError::NotUnderstood { request: name })
                    }
                };
            }
        }
        let seen = self.counters().since(&before);
        Err(if matches!(request, Request::JobSet(_)) {
            LinkError::JobOutcomeUnknown { waited }
        } else if seen.damaged() > 0 {
            LinkError::Damaged {
                request: name,
                tries,
                seen,
            }
        } else {
            LinkError::NoAnswer {
                request: name,
                tries,
                waited,
            }
        })
    }

    fn send<M: Message>(&mut self, message: &M) -> Result<(), LinkError> {
        let mut buffer = [0; MAX_HOST_FRAME];
        // The buffer holds the longest message; see the tests of the protocol.
        let frame = encode(self.sequence, message, &mut buffer)
            .map_err(|error| LinkError::Closed(io::Error::other(error)))?;
        self.transport.write(frame).map_err(LinkError::Closed)
    }

    /// The next Hello or answer; none if it does not come until `deadline`.
    fn wait(
        &mut self,
        deadline: Instant,
        request: &'static str,
    ) -> Result<Option<(u16, Incoming)>, LinkError> {
        loop {
            if let Some(incoming) = self.decode(request)? {
                return Ok(Some(incoming));
            }
            // A board that talks without end must not make us wait without end.
            if Instant::now() >= deadline || !self.receive(deadline)? {
                return Ok(None);
            }
        }
    }

    /// Receives bytes; false if none come until `deadline`.
    fn receive(&mut self, deadline: Instant) -> Result<bool, LinkError> {
        let left = deadline.saturating_duration_since(Instant::now());
        let mut buffer = [0; 4096];
        match self.transport.read(&mut buffer, left) {
            Ok(len) => {
                self.input.clear();
                self.input.extend(buffer.iter().take(len));
                self.next = 0;
                Ok(len > 0)
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => Ok(true),
            Err(error) => Err(LinkError::Closed(error)),
        }
    }

    /// The next Hello or answer in what was received; events are put aside.
    fn decode(&mut self, request: &'static str) -> Result<Option<(u16, Incoming)>, LinkError> {
        loop {
            let mut rest = self.input.get(self.next..).unwrap_or_default();
            let frame = self.decoder.next_frame(&mut rest);
            self.next = self.input.len() - rest.len();
            let Some(frame) = frame else { return Ok(None) };
            let sequence = frame.sequence;
            let opened = match frame.kind {
                Kind::Hello => frame.open().map(Incoming::Hello),
                Kind::Response => frame.open().map(|m| Incoming::Response(Box::new(m))),
                Kind::Event => match frame.open() {
                    Ok(event) => {
                        self.keep(sequence, event);
                        continue;
                    }
                    Err(error) => Err(error),
                },
                // Nothing that this version asked for.
                Kind::Request | Kind::Other(_) => continue,
            };
            match opened {
                Ok(incoming) => return Ok(Some((sequence, incoming))),
                // Before the Hello, what an earlier session left behind.
                Err(_) if self.board.is_none() => {}
                Err(OpenError::OtherSchema) => return Err(LinkError::BoardChanged),
                Err(_) => return Err(LinkError::WrongAnswer { request }),
            }
        }
    }

    fn keep(&mut self, sequence: u16, event: Event) {
        if matches!(event, Event::Latches(_)) {
            // Numbered themselves, beside the other events.
            return self.push(event);
        }
        let expected = self.last_event.map(|last| last.wrapping_add(1));
        self.last_event = Some(sequence);
        let gap = expected.map_or(0, |expected| sequence.wrapping_sub(expected).into());
        match event {
            // What the board dropped has left a gap, too: the same loss, told once.
            Event::Dropped { count } => self.push(Event::Dropped {
                count: count.max(gap),
            }),
            event => {
                if gap > 0 {
                    self.push(Event::Dropped { count: gap });
                }
                self.push(event);
            }
        }
    }

    fn push(&mut self, event: Event) {
        if self.events.len() < MAX_EVENTS {
            self.events.push_back(event);
            return;
        }
        // The last place tells of the loss: of what stood there and of what follows.
        let events = |event: &Event| match event {
            Event::Dropped { count } => *count,
            _ => 1,
        };
        if let Some(last) = self.events.back_mut() {
            let count = events(last).saturating_add(events(&event));
            *last = Event::Dropped { count };
        }
    }
}

fn wrong_answer(request: &Request) -> LinkError {
    LinkError::WrongAnswer {
        request: name(request),
    }
}

/// The name of a request in messages.
const fn name(request: &Request) -> &'static str {
    match request {
        Request::IdentityGet => "identity",
        Request::StatusGet => "status",
        Request::JobGet => "job",
        Request::JobCheck(_) => "check job",
        Request::JobSet(_) => "set job",
        Request::LiveSet { .. } => "live",
        Request::FeatureGet { .. } => "feature",
        Request::VerdictGet => "verdict",
        Request::JournalInfo => "journal info",
        Request::JournalRead { .. } => "journal read",
        Request::JournalChain { .. } => "journal chain",
        Request::PositionsGet => "positions",
        Request::TriggerOutSet(_) => "trigger out",
        Request::LaserSet { .. } => "laser",
        Request::ProgramList { .. } => "program list",
        Request::ProgramBegin(_) => "program upload",
        Request::ProgramPiece { .. } => "program piece",
        Request::ProgramEnd { .. } => "program end",
        Request::ProgramRead { .. } => "program read",
        Request::ProgramDelete { .. } => "program delete",
        Request::ProgramOffer { .. } => "program offer",
        Request::ProgramReceive => "program receive",
        Request::ProgramPass(_) => "program pass",
        Request::ProgramPassed { .. } => "passed bytes",
    }
}

#[cfg(test)]
mod tests;
