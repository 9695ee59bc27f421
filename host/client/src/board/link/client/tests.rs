//! The client against a scripted board that never sleeps: silence is a chunk of
//! the script, so slow boards cost no time and the tests do not depend on the machine.

use std::sync::{Arc, Mutex};

use umi_protocol::hello::{KEY, Mismatch, VERSION, Version};
use umi_protocol::job::Job;
use umi_protocol::job_error::JobError;
use umi_protocol::message::{JournalInfo, Record};

use super::*;
use crate::board::link::JournalEntry;

const PATIENCE: Patience = Patience {
    answer: Duration::from_millis(500),
    tries: 3,
};

/// What the board does with one frame from the host.
enum Step {
    /// Answers as a board does.
    Answer,
    /// Nothing.
    Ignore,
    /// Answers after this time.
    Late(Duration),
    /// Answers with one bit flipped.
    Flip,
    /// Answers and a byte is lost on the line.
    LoseByte,
    /// Sends this first, then answers.
    First(Vec<u8>),
    /// Sends these bytes instead.
    Instead(Vec<u8>),
    /// Answers with the sequence of an earlier request, then rightly.
    StaleFirst,
    /// Answers with this Hello.
    Hello(Hello),
    /// Closes the connection.
    Close,
}

enum Chunk {
    Bytes(Vec<u8>),
    Silence(Duration),
    Closed,
}

/// What the board received, for the test to look at.
type Log = Arc<Mutex<Vec<(Kind, u16)>>>;

struct Board {
    script: VecDeque<Step>,
    output: VecDeque<Chunk>,
    decoder: Decoder<MAX_HOST_FRAME>,
    log: Log,
}

fn bytes<M: Message>(sequence: u16, message: &M) -> Vec<u8> {
    let mut buffer = [0; MAX_BOARD_FRAME];
    encode(sequence, message, &mut buffer).unwrap().to_vec()
}

fn event(sequence: u16) -> Vec<u8> {
    bytes(
        sequence,
        &Event::Record {
            seq: sequence.into(),
            t_us: 0,
            record: Record::Time,
        },
    )
}

fn seqs(events: &[Event]) -> Vec<i64> {
    events
        .iter()
        .map(|event| match event {
            Event::Record { seq, .. } => *seq as i64,
            Event::Dropped { count } => -i64::from(*count),
            other => panic!("{other:?}"),
        })
        .collect()
}

/// All events that are there, lost ones as negative numbers.
fn events(client: &mut Client) -> Vec<i64> {
    let mut all = Vec::new();
    while let Some(event) = client.next_event(Duration::ZERO).unwrap() {
        all.push(event);
    }
    seqs(&all)
}

impl Board {
    fn new(script: Vec<Step>) -> (Box<Self>, Log) {
        let log = Log::default();
        let board = Self {
            script: script.into(),
            output: VecDeque::new(),
            decoder: Decoder::new(),
            log: log.clone(),
        };
        (Box::new(board), log)
    }

    fn send(&mut self, bytes: Vec<u8>) {
        self.output.push_back(Chunk::Bytes(bytes));
    }

    fn do_step(&mut self, step: Step, sequence: u16, answer: Vec<u8>) {
        match step {
            Step::Answer => self.send(answer),
            Step::Ignore => {}
            Step::Late(time) => {
                self.output.push_back(Chunk::Silence(time));
                self.send(answer);
            }
            Step::Flip => {
                let mut answer = answer;
                let at = answer.len() / 2;
                answer[at] ^= 0x04;
                self.send(answer);
            }
            Step::LoseByte => {
                let mut answer = answer;
                answer.remove(answer.len() / 2);
                self.send(answer);
            }
            Step::First(bytes) => {
                self.send(bytes);
                self.send(answer);
            }
            Step::Instead(bytes) => self.send(bytes),
            Step::StaleFirst => {
                self.send(bytes(sequence.wrapping_sub(1), &Response::Done));
                self.send(answer);
            }
            Step::Hello(hello) => self.send(bytes(sequence, &hello)),
            Step::Close => self.output.push_back(Chunk::Closed),
        }
    }
}

impl Transport for Board {
    fn write(&mut self, sent: &[u8]) -> io::Result<()> {
        let mut rest = sent;
        let Some(frame) = self.decoder.next_frame(&mut rest) else {
            panic!("the client sent no frame");
        };
        assert!(rest.is_empty());
        let sequence = frame.sequence;
        self.log.lock().unwrap().push((frame.kind, sequence));
        let answer = match frame.kind {
            Kind::Hello => bytes(sequence, &Hello::new("virtual 0001 0.1.0")),
            _ => bytes(
                sequence,
                &match frame.open::<Request>().unwrap() {
                    Request::JournalInfo => Response::JournalInfo(INFO),
                    Request::JournalRead { seq } => Response::JournalEntry {
                        seq,
                        raw: heapless::Vec::from_slice(&[1, 2, 3]).unwrap(),
                    },
                    Request::VerdictGet => Response::Verdict(None),
                    Request::FeatureGet { .. } => Response::Feature(None),
                    Request::JobCheck(_) => Response::JobRefused(JobError::NoFeatures),
                    Request::JobGet => Response::Job {
                        job: None,
                        taught_mm: Some(heapless::Vec::from_slice(&[[1.0, 2.0, 3.0]]).unwrap()),
                        learned: Default::default(),
                    },
                    Request::IdentityGet => Response::StorageFailed,
                    _ => Response::Done,
                },
            ),
        };
        let step = self.script.pop_front().unwrap_or(Step::Answer);
        self.do_step(step, sequence, answer);
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        loop {
            match self.output.pop_front() {
                None => return Ok(0),
                Some(Chunk::Closed) => return Err(ErrorKind::UnexpectedEof.into()),
                // A little more than the rest of the time is the rest of the time:
                // the client's clock runs while we do not sleep.
                Some(Chunk::Silence(left)) if left + Duration::from_millis(100) > timeout => {
                    if let Some(left) = left.checked_sub(timeout) {
                        self.output.push_front(Chunk::Silence(left));
                    }
                    return Ok(0);
                }
                Some(Chunk::Silence(_)) => {}
                Some(Chunk::Bytes(bytes)) => {
                    // Pieces of seven bytes, as a slow line gives them.
                    let (now, later) = bytes.split_at(bytes.len().min(7));
                    if !later.is_empty() {
                        self.output.push_front(Chunk::Bytes(later.to_vec()));
                    }
                    buffer[..now.len()].copy_from_slice(now);
                    return Ok(now.len());
                }
            }
        }
    }
}

const INFO: JournalInfo = JournalInfo {
    first_seq: 3,
    next_seq: 300,
    acked_seq: 0,
    lost: 0,
};

/// A greeted client whose board then follows the script.
fn client(mut script: Vec<Step>) -> (Client, Log) {
    script.insert(0, Step::Answer);
    let (board, log) = Board::new(script);
    let client = Client::with_patience(board, PATIENCE).unwrap();
    log.lock().unwrap().clear();
    (client, log)
}

/// The greeting fails as the script says.
fn refused(script: Vec<Step>) -> LinkError {
    match Client::with_patience(Board::new(script).0, PATIENCE) {
        Ok(_) => panic!("the greeting succeeded"),
        Err(error) => error,
    }
}

fn job() -> Job {
    toml::from_str(
        r#"
        name = "BALL"
        reference = "taught"
        plate_timeout_s = 600
        compensation = "in_macro"
        receiver = { patterns = ["grbl_probe"] }
        features = [{ name = "SPHERE1", kind = "sphere", hits = 5 }]
        [limits]
        radius_error_mm = 0.05
        rms_mm = 0.02
        distance_error_mm = 0.03
        registration_rms_mm = 0.04
        rotation_deg = 5.0
        tilt_deg = 0.1
        shift_mm = [1.0, 1.0, 1.0]
        "#,
    )
    .unwrap()
}

/// Each call brings its own answer, and a refusal is not an error of the link.
#[test]
fn calls_bring_their_answers() {
    let (mut board, log) = client(vec![]);
    assert_eq!(board.board(), "virtual 0001 0.1.0");
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(
        board.journal_read(7).unwrap(),
        JournalEntry::Stored(vec![1, 2, 3])
    );
    assert_eq!(board.verdict().unwrap(), None);
    assert_eq!(board.feature(2).unwrap(), None);
    board.live(true).unwrap();
    assert_eq!(board.check_job(&job()).unwrap(), Err(JobError::NoFeatures));
    assert_eq!(board.set_job(&job()).unwrap(), Ok(()));
    let in_force = board.job().unwrap();
    assert_eq!(in_force.job, None);
    assert_eq!(in_force.taught_mm, Some(vec![[1.0, 2.0, 3.0]]));
    assert!(matches!(board.identity(), Err(LinkError::StorageFailed)));
    // Every request had a number of its own; the last one asks why nothing was kept.
    let numbers: Vec<u16> = log.lock().unwrap().iter().map(|entry| entry.1).collect();
    assert_eq!(numbers, (1..=10).collect::<Vec<u16>>());
}

/// An answer of another kind is a named fault, not a panic or a wrong value.
#[test]
fn an_answer_to_something_else_is_named() {
    let (mut board, _) = client(vec![]);
    let error = board.status().unwrap_err(); // the scripted board says Done
    assert!(matches!(
        error,
        LinkError::WrongAnswer { request: "status" }
    ));
}

/// A lost byte, a flipped bit, a lost answer: asked again under the same number.
#[test]
fn damage_on_the_line_is_asked_again() {
    for step in [Step::LoseByte, Step::Flip, Step::Ignore] {
        let (mut board, log) = client(vec![step]);
        assert_eq!(board.journal_info().unwrap(), INFO);
        assert_eq!(
            *log.lock().unwrap(),
            [(Kind::Request, 1), (Kind::Request, 1)]
        );
    }
}

/// Noise before an answer costs nothing, not even a second try.
#[test]
fn garbage_before_an_answer_costs_nothing() {
    let noise = b"\xFF\x00login: \x01\x02\x00\x00garbage without end".to_vec();
    let (mut board, log) = client(vec![Step::First(noise)]);
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(log.lock().unwrap().len(), 1);
    assert_eq!(board.counters().garbage, 3);
}

/// A line on which nothing arrives intact: the checksum errors are told.
#[test]
fn lasting_damage_is_named() {
    let (mut board, _) = client(vec![Step::Flip, Step::Flip, Step::Flip]);
    let error = board.journal_info().unwrap_err();
    assert!(matches!(error, LinkError::Damaged { tries: 3, .. }));
    assert!(error.to_string().contains("3 checksum errors"), "{error}");
    // And the next call works.
    assert_eq!(board.journal_info().unwrap(), INFO);
}

/// Silence ends after the tries, and says so.
#[test]
fn silence_is_named() {
    let (mut board, log) = client(vec![Step::Ignore, Step::Ignore, Step::Ignore]);
    let error = board.journal_info().unwrap_err();
    assert!(matches!(error, LinkError::NoAnswer { tries: 3, .. }));
    assert_eq!(log.lock().unwrap().len(), 3);
}

/// An answer slower than one wait serves the second try, and its double is not
/// taken for the answer of the next request.
#[test]
fn a_slow_answer_is_taken_and_its_double_passed_over() {
    let late = Step::Late(Duration::from_millis(700));
    let (mut board, log) = client(vec![late, Step::Answer]);
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(log.lock().unwrap().len(), 2);
    assert_eq!(board.verdict().unwrap(), None);
    assert_eq!(board.feature(0).unwrap(), None);
}

/// The late answer of a request that was given up is not mistaken for this one's.
#[test]
fn a_stale_answer_is_passed_over() {
    let (mut board, _) = client(vec![Step::StaleFirst]);
    assert_eq!(board.journal_info().unwrap(), INFO);
}

/// A new job is sent once only, and its lost answer leaves the outcome open.
#[test]
fn a_new_job_is_never_sent_twice() {
    let (mut board, log) = client(vec![Step::Ignore]);
    let error = board.set_job(&job()).unwrap_err();
    assert!(matches!(error, LinkError::JobOutcomeUnknown { .. }));
    assert_eq!(log.lock().unwrap().len(), 1);
    // It is waited for as long as all tries of another request.
    let (mut board, _) = client(vec![Step::Late(Duration::from_millis(1300))]);
    assert_eq!(board.set_job(&job()).unwrap(), Ok(()));
}

/// Events between request and answer keep their order, and wait for their reader.
#[test]
fn events_during_a_call_are_kept() {
    let first = [event(10), event(11), event(12)].concat();
    let (mut board, _) = client(vec![Step::First(first), Step::First(event(13))]);
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(events(&mut board), [10, 11, 12, 13]);
}

/// An event that is damaged on the line leaves a record of its loss, over the end
/// of the numbers too.
#[test]
fn a_lost_event_is_told() {
    let mut damaged = event(u16::MAX);
    damaged[6] ^= 1;
    let stream = [event(65533), event(65534), damaged, event(0), event(3)].concat();
    let (mut board, _) = client(vec![Step::First(stream)]);
    board.live(true).unwrap();
    assert_eq!(events(&mut board), [65533, 65534, -1, 0, -2, 3]);
}

/// What the board dropped itself leaves a gap and is told by it: one loss, not two.
#[test]
fn a_dropped_event_is_told_once() {
    let told = |sequence, count| bytes(sequence, &Event::Dropped { count });
    // Three dropped and told; then two dropped, told, and one more lost on the line.
    let stream = [event(1), told(5, 3), event(6), told(10, 2), event(11)].concat();
    let (mut board, _) = client(vec![Step::First(stream)]);
    board.live(true).unwrap();
    assert_eq!(events(&mut board), [1, -3, 6, -3, 11]);
}

/// What happens while nothing is to be reported is no loss.
#[test]
fn silence_on_request_is_no_loss() {
    let (mut board, _) = client(vec![
        Step::First(event(1)),
        Step::Answer,
        Step::Answer,
        Step::First(event(9)),
    ]);
    board.live(true).unwrap();
    board.live(false).unwrap();
    board.live(true).unwrap();
    assert_eq!(board.journal_info().unwrap(), INFO);
    assert_eq!(events(&mut board), [1, 9]);
}

/// More events than are kept: the oldest are kept, the rest is counted.
#[test]
fn events_that_nobody_reads_are_counted() {
    let more = 20;
    let total = MAX_EVENTS + more;
    let stream: Vec<u8> = (0..total).flat_map(|number| event(number as u16)).collect();
    let (mut board, _) = client(vec![Step::First(stream)]);
    board.live(true).unwrap();
    let told = events(&mut board);
    assert_eq!(told.len(), MAX_EVENTS);
    assert_eq!(told[MAX_EVENTS - 2], MAX_EVENTS as i64 - 2);
    assert_eq!(told[MAX_EVENTS - 1], -(more as i64 + 1));
}

/// A board of another version or schema is named with what to do, and never asked anything.
#[test]
fn a_mismatch_is_named_at_the_greeting() {
    let newer = Version {
        major: VERSION.major + 1,
        minor: 0,
    };
    let older = Version {
        major: VERSION.major - 1,
        minor: 0,
    };
    for (version, key, says) in [
        (newer, KEY, "board speaks a newer protocol"),
        (older, KEY, "update the board's firmware"),
        (VERSION, KEY + 1, "from the same release"),
    ] {
        let error = refused(vec![Step::Hello(Hello::of(version, key, "pico 7 0.9.0"))]);
        assert!(matches!(error, LinkError::Mismatch { .. }), "{error:?}");
        assert!(error.to_string().contains(says), "{error}");
        assert!(error.to_string().contains("pico 7 0.9.0"), "{error}");
    }
}

/// A board that answers a request with its Hello could not open it: another schema
/// is named as such, the same one as a fault.
#[test]
fn a_hello_instead_of_an_answer_is_understood() {
    let (mut board, _) = client(vec![
        Step::Hello(Hello::of(VERSION, KEY + 1, "virtual")),
        Step::Hello(Hello::new("virtual")),
    ]);
    assert!(matches!(
        board.journal_info(),
        Err(LinkError::Mismatch {
            mismatch: Mismatch::OtherSchema { .. },
            ..
        })
    ));
    assert!(matches!(
        board.journal_info(),
        Err(LinkError::NotUnderstood { .. })
    ));
}

/// An intact frame of another schema after the greeting is never opened.
#[test]
fn a_board_that_changes_is_named() {
    let mut content = vec![4, 0, 0];
    content.extend(((KEY as u32) ^ 0x0100_0000).to_le_bytes());
    content.extend([3, 1]);
    content.extend(crc32(&content).to_le_bytes());
    let mut stream = vec![0];
    stream.extend(cobs(&content));
    stream.push(0);
    let (mut board, _) = client(vec![Step::First(stream)]);
    assert!(matches!(board.journal_info(), Err(LinkError::BoardChanged)));
}

/// CRC-32 bit by bit, as a second opinion on the protocol's.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 * (crc & 1));
        }
    }
    !crc
}

/// COBS of fewer than 254 bytes, as a second opinion on the protocol's.
fn cobs(bytes: &[u8]) -> Vec<u8> {
    bytes
        .split(|byte| *byte == 0)
        .flat_map(|block| [&[block.len() as u8 + 1], block].concat())
        .collect()
}

/// Nobody, something else, and noise are three different pieces of advice.
#[test]
fn a_failed_greeting_says_what_was_there() {
    let silent = refused(vec![Step::Ignore, Step::Ignore, Step::Ignore]);
    assert_eq!(
        silent.to_string(),
        "nobody answers (1.5s): is it an openumi board? is another program using the port?"
    );
    let sent = bytes(0, &Hello::new(concat!("umi ", env!("CARGO_PKG_VERSION"))));
    let echo = || Step::Instead(sent.clone());
    let looped = refused(vec![echo(), echo(), echo()]);
    assert!(looped.to_string().contains("looped"), "{looped}");
    let prompt = || Step::Instead(b"login: \0".to_vec());
    let other = refused(vec![prompt(), prompt(), prompt()]);
    assert!(
        other
            .to_string()
            .contains("21 bytes came that are no frame"),
        "{other}"
    );
    let noisy = refused(vec![Step::Flip, Step::Flip, Step::Flip]);
    assert!(noisy.to_string().contains("3 checksum errors"), "{noisy}");
}

/// One lost Hello does not matter, nor what an earlier session left in the pipe.
#[test]
fn the_greeting_is_repeated() {
    let leftover = [
        bytes(0, &Response::Done),
        event(5),
        bytes(9, &Hello::of(VERSION, KEY + 1, "before")),
    ]
    .concat();
    let (board, log) = Board::new(vec![Step::Ignore, Step::First(leftover)]);
    let client = Client::with_patience(board, PATIENCE).unwrap();
    assert_eq!(client.board(), "virtual 0001 0.1.0");
    assert_eq!(log.lock().unwrap().len(), 2);
}

/// A board on a line that echoes is found behind the echo.
#[test]
fn an_echo_is_not_taken_for_a_board() {
    let echo = bytes(0, &Hello::new(concat!("umi ", env!("CARGO_PKG_VERSION"))));
    let (board, _) = Board::new(vec![Step::First(echo)]);
    let client = Client::with_patience(board, PATIENCE).unwrap();
    assert_eq!(client.board(), "virtual 0001 0.1.0");
}

/// A pulled cable is told at once, not after the waiting time.
#[test]
fn a_closed_connection_is_named() {
    let (mut board, log) = client(vec![Step::Close]);
    let error = board.journal_info().unwrap_err();
    assert!(matches!(error, LinkError::Closed(_)));
    assert!(error.to_string().contains("unplugged"), "{error}");
    assert_eq!(log.lock().unwrap().len(), 1);
}
