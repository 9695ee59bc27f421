//! A board of a few answers on a TCP port: as a good board gives them, and as a
//! bad one does, which no real board can be made to do.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};

use umi_core::journal::{Chain, Entry, OVERHEAD, encode_entry};
use umi_core::units::Micros;
use umi_protocol::decoder::Decoder;
use umi_protocol::fault::{Counters, FaultCode};
use umi_protocol::frame::{Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, encode};
use umi_protocol::head::HeadAnswer;
use umi_protocol::hello::Hello;
use umi_protocol::job::Job;
use umi_protocol::latch::{LatchCounters, Positions, TriggerRefusal};
use umi_protocol::message::{
    AccessMode, Event, Identity, JournalInfo, Record, Request, ResetReason, Response, Status,
};
use umi_protocol::verdict::Verdict;

/// What the board answers.
pub struct Board {
    pub hello: Hello,
    pub job: Option<Job>,
    /// Whether it takes a new job and then has another one.
    pub forgetful: bool,
    pub first_seq: u64,
    /// Chain value before the first entry.
    pub chain_before: Chain,
    /// Entries as stored.
    pub entries: Vec<Vec<u8>>,
    /// Chain values after each entry.
    pub chains: Vec<Chain>,
    /// What it reports when reports are switched on.
    pub events: Vec<Event>,
    pub positions: Positions,
    pub latches: LatchCounters,
    pub reset: ResetReason,
    /// Whether it has outputs for a scanner.
    pub scanner: bool,
    /// It closes a connection after so many requests.
    pub hangs_up_after: Option<u32>,
    /// The latest verdict.
    pub verdict: Option<Verdict>,
}

fn name(text: &str) -> umi_protocol::job::Name {
    text.try_into().unwrap()
}

pub fn identity() -> Identity {
    Identity {
        board: name("test"),
        serial: name("0042"),
        firmware: name("0.1.0"),
    }
}

impl Board {
    /// A board with some records, the first of which has this number.
    pub fn new(first_seq: u64) -> Self {
        let mut board = Self {
            hello: Hello::new("test 0042 0.1.0"),
            job: None,
            forgetful: false,
            first_seq,
            chain_before: if first_seq == 0 {
                Chain::GENESIS
            } else {
                Chain([7; 32])
            },
            entries: Vec::new(),
            chains: Vec::new(),
            events: Vec::new(),
            positions: Positions::default(),
            latches: LatchCounters::default(),
            reset: ResetReason::PowerOn,
            scanner: true,
            hangs_up_after: None,
            verdict: None,
        };
        let raw = |text: &[u8]| heapless::Vec::from_slice(text).unwrap();
        for record in [
            Record::Boot {
                identity: identity(),
                reset: ResetReason::PowerOn,
            },
            Record::Bytes {
                raw: raw(b"SPHERE1\r\n-135.0190"),
            },
            Record::BytesLost { count: 3 },
            Record::Time,
            Record::InputEnd,
        ] {
            board.push(&record);
        }
        board
    }

    /// Appends an entry.
    pub fn push(&mut self, record: &Record) {
        let mut payload = [0; 4096];
        let payload = postcard::to_slice(record, &mut payload).unwrap();
        let seq = self.next_seq();
        let entry = Entry {
            seq,
            t: Micros(seq * 1_000_000),
            kind: record.kind(),
            payload,
        };
        let mut chain = self.chains.last().copied().unwrap_or(self.chain_before);
        let mut out = vec![0; payload.len() + OVERHEAD];
        let len = encode_entry(&entry, &mut chain, &mut out).unwrap();
        out.truncate(len);
        self.entries.push(out);
        self.chains.push(chain);
    }

    fn next_seq(&self) -> u64 {
        self.first_seq + self.entries.len() as u64
    }

    fn info(&self) -> JournalInfo {
        JournalInfo {
            first_seq: self.first_seq,
            next_seq: self.next_seq(),
            acked_seq: 0,
            lost: 0,
        }
    }

    /// Serves on a port of this machine until the test ends; returns its address.
    pub fn serve(mut self) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp://{}", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                self.talk(stream.unwrap());
            }
        });
        address
    }

    fn talk(&mut self, mut stream: TcpStream) {
        let mut decoder = Box::new(Decoder::<MAX_HOST_FRAME>::new());
        let mut buffer = [0; 4096];
        let mut requests = 0;
        while let Ok(len @ 1..) = stream.read(&mut buffer) {
            let mut rest = &buffer[..len];
            while let Some(frame) = decoder.next_frame(&mut rest) {
                let sequence = frame.sequence;
                let answer = match (frame.kind, frame.open::<Request>()) {
                    (Kind::Request, Ok(request)) => {
                        requests += 1;
                        if self.hangs_up_after == Some(requests) {
                            return;
                        }
                        let tell = matches!(request, Request::LiveSet { on: true });
                        let mut answer = bytes(sequence, &self.answer(request));
                        for (number, event) in (0..).zip(&self.events).filter(|_| tell) {
                            answer.extend(bytes(number, event));
                        }
                        answer
                    }
                    _ => bytes(sequence, &self.hello),
                };
                if stream.write_all(&answer).is_err() {
                    return;
                }
            }
        }
    }

    fn answer(&mut self, request: Request) -> Response {
        let place = |seq: u64, count: usize| -> Option<usize> {
            let place = usize::try_from(seq.checked_sub(self.first_seq)?).ok()?;
            (place < count).then_some(place)
        };
        match request {
            Request::IdentityGet => Response::Identity(identity()),
            Request::AccessGet => Response::Access(Default::default()),
            Request::ImageGet => Response::NotOnThisBoard,
            Request::HostTime { .. } => Response::Done,
            Request::KeyList => Response::Keys(Default::default()),
            Request::StatusGet => Response::Status(self.status()),
            Request::JobGet => Response::Job {
                job: self.job.clone(),
                taught_mm: None,
                learned: Default::default(),
            },
            Request::JobSet(job) => {
                self.job = if self.forgetful { None } else { Some(job) };
                Response::Done
            }
            Request::JournalInfo => Response::JournalInfo(self.info()),
            Request::JournalRead { seq } => match place(seq, self.entries.len()) {
                Some(place) => Response::JournalEntry {
                    seq,
                    raw: heapless::Vec::from_slice(&self.entries[place]).unwrap(),
                },
                None => Response::JournalNoEntry(self.info()),
            },
            Request::JournalChain { seq } => match place(seq, self.entries.len() + 1) {
                Some(0) => Response::JournalChain {
                    seq,
                    before: Some(self.chain_before.0),
                },
                Some(place) => Response::JournalChain {
                    seq,
                    before: Some(self.chains[place - 1].0),
                },
                None => Response::JournalNoEntry(self.info()),
            },
            Request::PositionsGet => Response::Positions(self.positions.clone()),
            Request::HeadGet { .. } => Response::Head(HeadAnswer::NoKey),
            Request::VerdictGet => Response::Verdict(self.verdict.clone()),
            Request::TriggerOutSet(_) if !self.scanner => {
                Response::TriggerRefused(TriggerRefusal::NoOutput)
            }
            Request::LaserSet { .. } if !self.scanner => Response::NotOnThisBoard,
            _ => Response::Done,
        }
    }

    fn status(&self) -> Status {
        let mut counters = Counters {
            bytes: 1234,
            ..Counters::default()
        };
        counters.count(FaultCode::BadParity);
        Status {
            uptime_us: 3_725_000_000,
            job: self.job.as_ref().map(|job| job.name.clone()),
            job_lost: None,
            has_reference: false,
            teaching: None,
            verdicts: 3,
            verdicts_ok: 2,
            last_verdict_ok: Some(self.verdict.as_ref().is_some_and(|verdict| verdict.ok)),
            correction_waiting: false,
            punched_lines: None,
            counters,
            events_dropped: 0,
            journal_failures: 0,
            reset: self.reset,
            link_damaged: 0,
            latches: self.latches,
            access: AccessMode::Open,
        }
    }
}

fn bytes(sequence: u16, message: &impl Message) -> Vec<u8> {
    let mut buffer = vec![0; MAX_BOARD_FRAME];
    encode(sequence, message, &mut buffer).unwrap().to_vec()
}
