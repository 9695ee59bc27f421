//! The board at the other end: one request at a time, and what it reports unasked.

use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use umi_core::trust::access::session::HostSession;
use umi_protocol::access::AccessRefusal;
use umi_protocol::config::WhenFull;
use umi_protocol::decoder::{Decoder, FrameCounters};
use umi_protocol::frame::{
    Authenticated, Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, OpenError, encode, encode_sealed,
};
use umi_protocol::hello::Hello;
use umi_protocol::message::{Event, Request, Response};

use super::{LinkError, Transport, open};
use crate::problem::one_line;

/// Events kept while nobody asks for them: some 5 MB.
const MAX_EVENTS: usize = 1000;

/// How long to wait for a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For one answer, counted from when the request was sent.
    pub answer: Duration,
    /// How often a request is sent before giving up. A new job, and what proves a key, is sent
    /// only once and waited for as long as all tries together.
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
    /// The session in which requests are sealed.
    pub(super) session: Option<HostSession>,
}

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
            session: None,
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
    pub fn counters(&self) -> FrameCounters {
        self.decoder.counters()
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
            board: one_line(&hello.sender),
            mismatch,
        })?;
        self.board = Some(one_line(&hello.sender));
        Ok(())
    }

    /// Sends a request until its answer comes; `name` is what messages call it.
    pub(super) fn call(
        &mut self,
        request: &Request,
        name: &'static str,
    ) -> Result<Response, LinkError> {
        let Patience { answer, tries } = self.patience;
        let waited = answer * tries;
        // Setting a job twice is not the same as once: see `set_job`. Nor is proving a key: a
        // challenge is used up, and a second proof is a wrong one.
        let is_once = matches!(
            request,
            Request::JobSet(_) | Request::SessionBegin(_) | Request::SessionProve { .. }
        );
        let (answer, tries) = if is_once {
            (waited, 1)
        } else {
            (answer, tries)
        };
        let before = self.counters();
        self.sequence = self.sequence.wrapping_add(1);
        let mut no_session = false;
        let mut greeted = None;
        for _ in 0..tries {
            self.ask(request)?;
            let deadline = Instant::now() + answer;
            while let Some((sequence, incoming)) = self.wait(deadline, name)? {
                if sequence != self.sequence {
                    continue; // of an earlier request that was given up
                }
                return match incoming {
                    Incoming::Response(response) => match *response {
                        Response::StorageFailed => Err(self.not_kept(request)),
                        Response::AccessRefused(AccessRefusal::NoSession)
                            if self.session.is_some() =>
                        {
                            // It has no seal: somebody may have put in what it answers. The answer
                            // to ours may still come.
                            no_session = true;
                            continue;
                        }
                        Response::AccessRefused(refusal) => Err(LinkError::Refused(refusal)),
                        response => {
                            if matches!(request, Request::LiveSet { on: false }) {
                                // What is not reported from now on is no loss.
                                self.last_event = None;
                            }
                            Ok(response)
                        }
                    },
                    // So a board answers what it cannot open. In a session anybody may have put it in:
                    // the sealed answer may still come.
                    Incoming::Hello(hello) if self.session.is_some() => {
                        greeted = Some(hello);
                        continue;
                    }
                    Incoming::Hello(hello) => self.not_understood(&hello, name),
                };
            }
            if no_session {
                self.session = None;
                return Err(LinkError::Refused(AccessRefusal::NoSession));
            }
        }
        if let Some(hello) = greeted {
            return self.not_understood(&hello, name);
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

    /// The board has greeted instead of an answer.
    fn not_understood(&mut self, hello: &Hello, name: &'static str) -> Result<Response, LinkError> {
        self.accept(hello)?;
        Err(LinkError::NotUnderstood { request: name })
    }

    /// Why the board has not kept what it was asked to.
    fn not_kept(&mut self, request: &Request) -> LinkError {
        // What is asked here is not asked about.
        let is_asked = matches!(request, Request::ConfigGet | Request::JournalInfo);
        match !is_asked && self.holds_evidence() {
            true => LinkError::JournalFull,
            false => LinkError::StorageFailed,
        }
    }

    /// Whether the board overwrites no evidence that nobody has acknowledged, and has some: its journal
    /// may be full.
    pub fn holds_evidence(&mut self) -> bool {
        let config = self.config().ok().flatten();
        config.is_some_and(|(config, _)| config.journal.full == WhenFull::Refuse)
            && (self.journal_info()).is_ok_and(|info| info.acked_seq < info.next_seq)
    }

    /// Sends a request, with a seal in a session.
    fn ask(&mut self, request: &Request) -> Result<(), LinkError> {
        let Some(session) = &mut self.session else {
            return self.send(request);
        };
        let mut buffer = [0; MAX_HOST_FRAME];
        let counter = session.count();
        let code = |of: &Authenticated<'_>| session.code(of);
        let frame = encode_sealed(self.sequence, request, counter, &code, &mut buffer)
            .map_err(|error| LinkError::Closed(io::Error::other(error)))?;
        self.transport.write(frame).map_err(LinkError::Closed)
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
            Err(error) if error.kind() == io::ErrorKind::ResourceBusy => {
                Err(LinkError::Busy(error.to_string()))
            }
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
            let mut is_sealed = false;
            let opened = match frame.kind {
                Kind::Hello => frame.open().map(Incoming::Hello),
                Kind::Response => frame.open().map(|m| Incoming::Response(Box::new(m))),
                Kind::SealedResponse => {
                    let Some((inner, authenticated, code)) = frame.unsealed() else {
                        continue;
                    };
                    let session = self.session.as_ref();
                    if session.is_none_or(|session| !session.is_answer(&authenticated, code)) {
                        // Somebody else's, or of a session that was.
                        continue;
                    }
                    is_sealed = true;
                    inner.open().map(|m| Incoming::Response(Box::new(m)))
                }
                Kind::Event => match frame.open() {
                    Ok(event) => {
                        self.keep(sequence, event);
                        continue;
                    }
                    Err(error) => Err(error),
                },
                // Nothing that this version asked for.
                Kind::Request | Kind::SealedRequest | Kind::Other(_) => continue,
            };
            match opened {
                // In a session an answer without a seal says one thing only: that there is none.
                Ok(Incoming::Response(response))
                    if self.session.is_some()
                        && !is_sealed
                        && *response != Response::AccessRefused(AccessRefusal::NoSession) => {}
                Ok(incoming) => return Ok(Some((sequence, incoming))),
                // Before the Hello, what an earlier session left behind. In a session, what has no seal: nobody's.
                Err(_) if self.board.is_none() || (self.session.is_some() && !is_sealed) => {}
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

#[cfg(test)]
mod tests;
