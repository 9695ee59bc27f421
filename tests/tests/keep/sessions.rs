//! Who may do what, over the wire: every request of the protocol by every role in every mode, and
//! what was recorded of a session played again.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use umi_client::board::link::{Client, LinkError, Transport};
use umi_client::files::key_file::SigningKey;
use umi_core::trust::access::permit::permit;
use umi_core::trust::access::session::{HostHandshake, HostSession};
use umi_core::units::Micros;
use umi_protocol::access::{AccessMode, AccessRefusal, KeyInfo, KeyName, Role};
use umi_protocol::config::{BoardConfig, LockedReading};
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{
    Authenticated, Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, encode, encode_sealed,
};
use umi_protocol::hello::KEY as SCHEMA;
use umi_protocol::message::{Record, Request, Response};
use umi_tests::cases::job;
use umi_virtual::board::KEY;
use umi_virtual::{Config, HostEnd, VirtualBoard, VirtualFlash};

const OWNER: u8 = 1;
const ENGINEER: u8 = 2;
const OPERATOR: u8 = 3;

fn config() -> Config {
    Config {
        key: Some(VirtualFlash::in_memory(KEY)),
        jumper: true,
        ..Config::default()
    }
}

fn secret(of: u8) -> SigningKey {
    SigningKey::from_bytes(&[of; 32])
}

fn key(of: u8, role: Role) -> KeyInfo {
    KeyInfo {
        public: secret(of).verifying_key().to_bytes(),
        role,
        name: KeyName::new(),
    }
}

/// A session of this key.
fn authenticated(board: &VirtualBoard, of: u8) -> Client {
    let mut client = umi_desk::client(board).unwrap();
    client.authenticate(&secret(of)).unwrap();
    client
}

/// The board gets an owner, an engineer and an operator.
fn claim(board: &VirtualBoard) {
    let mut client = umi_desk::client(board).unwrap();
    assert!(client.key_enrol(&key(OWNER, Role::Owner)).unwrap());
    let mut client = authenticated(board, OWNER);
    for (of, role) in [(ENGINEER, Role::Engineer), (OPERATOR, Role::Operator)] {
        assert!(client.key_enrol(&key(of, role)).unwrap());
    }
}

/// A host that says any request, in a session or not.
struct Raw {
    end: HostEnd,
    decoder: Decoder<MAX_BOARD_FRAME>,
    session: Option<HostSession>,
    sequence: u16,
}

impl Raw {
    fn new(board: &VirtualBoard, of: Option<u8>) -> Self {
        let mut raw = Self {
            end: board.connect(),
            decoder: Decoder::new(),
            session: None,
            sequence: 0,
        };
        if let Some(of) = of {
            let handshake = HostHandshake::new(&secret(of), [of; 32]);
            let Response::SessionChallenge(challenge) =
                raw.ask(&Request::SessionBegin(handshake.ask()))
            else {
                panic!("no challenge");
            };
            let (signature, proof) = handshake.prove(&secret(of), &challenge).unwrap();
            let Response::SessionOpen { signature, .. } =
                raw.ask(&Request::SessionProve { signature })
            else {
                panic!("no session");
            };
            raw.session = Some(proof.open(signature).unwrap());
        }
        raw
    }

    fn ask(&mut self, request: &Request) -> Response {
        self.asked(request, true)
    }

    /// As [`Self::ask`], where the board is to answer without a seal.
    fn ask_unsealed(&mut self, request: &Request) -> Response {
        self.asked(request, false)
    }

    fn asked(&mut self, request: &Request, is_sealed: bool) -> Response {
        self.sequence += 1;
        let mut out = [0; MAX_HOST_FRAME];
        let frame = match &mut self.session {
            None => encode(self.sequence, request, &mut out).unwrap(),
            Some(session) => {
                let counter = session.count();
                let code = |of: &Authenticated<'_>| session.code(of);
                encode_sealed(self.sequence, request, counter, &code, &mut out).unwrap()
            }
        };
        self.end.write(frame).unwrap();
        loop {
            let bytes = self
                .end
                .read(Duration::from_secs(5))
                .unwrap()
                .expect("an answer");
            let mut bytes = &bytes[..];
            while let Some(frame) = self.decoder.next_frame(&mut bytes) {
                if frame.sequence != self.sequence {
                    continue;
                }
                let Some(session) = self.session.as_ref().filter(|_| is_sealed) else {
                    return frame.open().unwrap();
                };
                let (inner, authenticated, code) = frame.unsealed().expect("a seal");
                assert!(session.is_answer(&authenticated, code));
                return inner.open().unwrap();
            }
        }
    }
}

/// Every request there is: all can be read from zeros behind their number.
fn requests() -> Vec<Request> {
    let read = |tag: u8| {
        let mut bytes = [0; 512];
        bytes[0] = tag;
        let read = postcard::take_from_bytes::<Request>(&bytes);
        read.ok().map(|(request, _)| request)
    };
    let requests: Vec<_> = (0..0x80).filter_map(read).collect();
    assert!(requests.len() >= 38);
    requests
}

/// For every request of the protocol, every role, and a board that is open, claimed and locked: it
/// is refused as the table says, with the table's reason, and not otherwise.
#[test]
fn a_board_asks_for_the_key_that_the_table_names() {
    let mut tried = 0;
    let readings = [LockedReading::Operators, LockedReading::Nobody];
    let modes = AccessMode::ALL.map(|mode| readings.map(|reading| (mode, reading)));
    for (mode, reading) in modes.into_iter().flatten() {
        let board = VirtualBoard::start(config()).unwrap();
        let mut configured = BoardConfig::NEW;
        configured.access.locked_reading = reading;
        let mut host = umi_desk::client(&board).unwrap();
        host.set_config(&configured).unwrap().unwrap();
        drop(host);
        if mode != AccessMode::Open {
            claim(&board);
        }
        if mode == AccessMode::Locked {
            assert!(authenticated(&board, OWNER).lock(true).unwrap());
        }
        for role in Role::ALL {
            let of = match role {
                Role::None => None,
                Role::Operator => Some(OPERATOR),
                Role::Engineer => Some(ENGINEER),
                Role::Owner => Some(OWNER),
            };
            if mode == AccessMode::Open && of.is_some() {
                // It knows no key, and needs none.
                continue;
            }
            let mut raw = Raw::new(&board, of);
            for request in requests() {
                // These would end what is tried: they are tried below.
                let ends = matches!(
                    request,
                    Request::Wipe | Request::SessionProve { .. } | Request::SessionBegin(_)
                );
                if ends && permit(mode, role, &request, reading).is_ok() {
                    continue;
                }
                let expected = permit(mode, role, &request, reading);
                let answer = raw.ask(&request);
                assert!(request.is_answered_by(&answer), "{request:?}: {answer:?}");
                match (expected, &answer) {
                    (Err(why), answer) => assert_eq!(
                        *answer,
                        Response::AccessRefused(why),
                        "{request:?} by {role:?}, {mode:?}"
                    ),
                    // A key of zeros is none, and nobody knows one of that name.
                    (
                        Ok(()),
                        Response::AccessRefused(
                            AccessRefusal::NotAKey
                            | AccessRefusal::KeyUnknown
                            | AccessRefusal::KeyNeeded { needs: Role::Owner },
                        ),
                    ) => assert!(matches!(
                        request,
                        Request::KeyEnrol(_) | Request::KeyRevoke { .. } | Request::LockSet { .. }
                    )),
                    (Ok(()), Response::AccessRefused(why)) => {
                        panic!("{request:?} by {role:?}, {mode:?}: {why:?}")
                    }
                    (Ok(()), _) => {}
                }
                // An owner that was let unlock the board locks it again.
                if mode == AccessMode::Locked && matches!(request, Request::LockSet { .. }) {
                    let again = raw.ask(&Request::LockSet { locked: true });
                    assert_eq!(again == Response::Done, role == Role::Owner);
                }
                tried += 1;
            }
        }
    }
    assert!(tried > 640, "{tried}");
}

/// Everything a host writes, in the pieces in which it writes it.
struct Recording {
    end: HostEnd,
    written: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl Transport for Recording {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.end.read_into(buffer, timeout)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written.lock().unwrap().push(bytes.to_vec());
        self.end.write(bytes)
    }
}

/// Whatever can be changed by a request.
fn state(board: &VirtualBoard) -> String {
    let mut owner = authenticated(board, OWNER);
    let records = owner.journal_info().unwrap().next_seq;
    let mut changes = Vec::new();
    let wanted = umi_client::journal::PullRequest::default();
    umi_client::journal::pull(&mut owner, wanted, |step| {
        if let umi_client::journal::PullStep::Entry(entry, _) = step {
            let record = umi_client::journal::record(&entry).unwrap();
            let is_noise = matches!(
                record,
                Record::AccessRefused { .. } | Record::Head(_) | Record::Boot { .. }
            );
            if !is_noise && !matches!(record, Record::JobLost { .. }) {
                changes.push(format!("{record:?}"));
            }
        }
        Ok::<_, umi_client::problem::Problem>(())
    })
    .unwrap();
    assert!(records > 0);
    format!(
        "{:?} {:?} {:?} {:?} {:?} {changes:?}",
        owner.job().unwrap(),
        owner.config().unwrap(),
        owner.keys().unwrap(),
        owner.access().unwrap().mode,
        owner.programs(0).unwrap(),
    )
}

/// A session whose host has asked nothing for longer than the owner allows is over: whatever it seals
/// then is refused, the laser too, and nothing changes; one that asks in time goes on. A right key opens
/// the next at once. It holds behind a restart.
#[test]
fn an_idle_session_is_proven_again() {
    let config = config();
    let board = VirtualBoard::start(config.clone()).unwrap();
    claim(&board);
    let mut configured = BoardConfig::NEW;
    configured.access.session_idle_s = Some(60);
    let mut owner = authenticated(&board, OWNER);
    owner.set_config(&configured).unwrap().unwrap();
    drop((owner, board));

    let board = VirtualBoard::start(config).unwrap();
    let minute = 60_000_000;
    let mut now = 0;
    let mut later = |us: u64| {
        now += us;
        board.advance(Micros(now));
    };
    for last in [
        Request::LaserSet { on: true },
        Request::JobSet(job()),
        Request::LockSet { locked: true },
        Request::JobGet,
        Request::PositionsGet,
    ] {
        let mut raw = Raw::new(&board, Some(OWNER));
        for _ in 0..3 {
            later(minute - 1);
            assert!(matches!(raw.ask(&Request::JobGet), Response::Job { .. }));
        }
        later(minute + 1);
        // The answer has no seal: there is no session that could have one.
        assert_eq!(
            raw.ask_unsealed(&last),
            Response::AccessRefused(AccessRefusal::NoSession)
        );
        let again = raw.ask_unsealed(&Request::JobGet);
        assert_eq!(again, Response::AccessRefused(AccessRefusal::NoSession));
        let mut raw = Raw::new(&board, Some(OWNER));
        assert!(matches!(
            raw.ask(&Request::JobGet),
            Response::Job { job: None, .. }
        ));
        let Response::Access(access) = raw.ask(&Request::AccessGet) else {
            panic!("no access");
        };
        assert_eq!(access.mode, AccessMode::Claimed);
    }
}

/// What was recorded of a session of an owner that changes all there is: played again whole, frame
/// by frame, backwards, doubled, shuffled, on another board of the same owner, and after a restart,
/// it changes nothing, and the next honest session works at once.
#[test]
fn a_session_that_is_played_again_changes_nothing() {
    let config = config();
    let board = VirtualBoard::start(config.clone()).unwrap();
    claim(&board);
    let written = Arc::new(Mutex::new(Vec::new()));
    let recording = Recording {
        end: board.connect(),
        written: Arc::clone(&written),
    };
    let mut owner = Client::new(Box::new(recording)).unwrap();
    assert_eq!(owner.authenticate(&secret(OWNER)).unwrap(), Role::Owner);
    owner.set_job(&job()).unwrap().unwrap();
    assert!(owner.key_enrol(&key(9, Role::Owner)).unwrap());
    let mut ceilings = BoardConfig::default();
    ceilings.journal.full = umi_protocol::config::WhenFull::Refuse;
    owner.set_config(&ceilings).unwrap().unwrap();
    assert!(owner.laser(true).unwrap());
    assert!(owner.lock(true).unwrap());
    assert!(owner.lock(false).unwrap());
    assert!(
        owner
            .key_revoke(umi_core::trust::board_key::key_id(
                &key(9, Role::Owner).public
            ))
            .unwrap()
    );
    owner.set_config(&Default::default()).unwrap().unwrap();
    drop(owner);
    let recorded = written.lock().unwrap().clone();
    assert!(recorded.len() > 10);

    let other = VirtualBoard::start(self::config()).unwrap();
    claim(&other);
    let whole = recorded.concat();
    let mut seed = 7_u64;
    let mut orders: Vec<Vec<Vec<u8>>> = vec![
        vec![whole.clone()],
        recorded.clone(),
        recorded.iter().rev().cloned().collect(),
        recorded
            .iter()
            .flat_map(|frame| [frame.clone(), frame.clone()])
            .collect(),
        whole.chunks(7).map(<[u8]>::to_vec).collect(),
    ];
    for from in 1..recorded.len() {
        orders.push(recorded[from..].to_vec());
    }
    for _ in 0..10 {
        let mut frames = recorded.clone();
        for at in (1..frames.len()).rev() {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            frames.swap(at, (seed >> 33) as usize % (at + 1));
        }
        orders.push(frames);
    }
    let mut board = Some(board);
    for round in 0..3 {
        let at_work = match round {
            0 => board.as_ref().unwrap(),
            1 => &other,
            _ => {
                // The power goes and comes back.
                drop(board.take());
                board = Some(VirtualBoard::start(config.clone()).unwrap());
                board.as_ref().unwrap()
            }
        };
        let before = state(at_work);
        for (number, order) in orders.iter().enumerate() {
            let mut end = at_work.connect();
            for piece in order {
                end.write(piece).unwrap();
                while end.read(Duration::ZERO).unwrap().is_some() {}
            }
            // Until all of it was answered.
            while end.read(Duration::from_millis(2)).unwrap().is_some() {}
            assert!(!at_work.laser_is_on(), "round {round}, order {number}");
            if number % 8 == 0 {
                assert_eq!(state(at_work), before, "round {round}, order {number}");
            }
        }
        assert_eq!(state(at_work), before, "round {round}");
    }
}

/// On a line where a session is, frames of others change nothing and do not end it.
#[test]
fn what_is_put_between_changes_nothing() {
    let board = VirtualBoard::start(config()).unwrap();
    claim(&board);
    let mut raw = Raw::new(&board, Some(OWNER));
    assert_eq!(raw.ask(&Request::LockSet { locked: false }), Response::Done);
    // Without a seal, and with a foreign one.
    let session = raw.session.take();
    let plain = raw.ask(&Request::JobSet(job()));
    let needs = Role::Engineer;
    assert_eq!(
        plain,
        Response::AccessRefused(AccessRefusal::KeyNeeded { needs })
    );
    raw.session = session;
    let mut out = [0; MAX_HOST_FRAME];
    let forged = |out: &mut [u8; MAX_HOST_FRAME]| {
        let lock = Request::LockSet { locked: true };
        encode_sealed(77, &lock, 1000, &|_| [0x5A; 16], out)
            .unwrap()
            .to_vec()
    };
    raw.end.write(&forged(&mut out)).unwrap();
    assert_eq!(raw.ask(&Request::LockSet { locked: false }), Response::Done);
    let Response::Access(info) = raw.ask(&Request::AccessGet) else {
        panic!("no access");
    };
    assert_eq!(info.mode, AccessMode::Claimed);
}

/// A host whose every frame comes twice at the board, its sealed ones behind a forged one of the same number. In front of the
/// board's answers to those stands what has no seal, cannot be read or is of another protocol.
struct Meddled {
    host: HostEnd,
    put_in: Vec<u8>,
    /// From the first sealed frame on the board is another one, of a newer protocol.
    is_exchanged: bool,
}

/// A frame of any content.
fn frame(kind: u8, sequence: u16, schema: u32, message: &[u8]) -> Vec<u8> {
    let mut content = vec![kind];
    content.extend(sequence.to_le_bytes());
    content.extend(schema.to_le_bytes());
    content.extend(message);
    let mut crc = u32::MAX;
    for byte in &content {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 * (crc & 1));
        }
    }
    content.extend((!crc).to_le_bytes());
    let blocks = content.split(|byte| *byte == 0);
    let coded = blocks.flat_map(|block| [&[block.len() as u8 + 1], block].concat());
    [0].into_iter().chain(coded).chain([0]).collect()
}

impl Transport for Meddled {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if self.put_in.is_empty() {
            return self.host.read_into(buffer, timeout);
        }
        let length = self.put_in.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.put_in.drain(..length)) {
            *place = byte;
        }
        Ok(length)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut decoder = Decoder::<MAX_HOST_FRAME>::new();
        let sent = decoder.next_frame(&mut &bytes[..]).expect("a frame");
        let sequence = sent.sequence;
        if sent.kind == Kind::SealedRequest {
            let mut other = b"oUMI\x09\x01".to_vec();
            other.extend([0; 9]);
            let (hello, response, event) = (1, 3, 4);
            let ours = SCHEMA as u32;
            if self.is_exchanged {
                self.put_in.extend(frame(hello, sequence, ours, &other));
                return Ok(());
            }
            let lock = Request::LockSet { locked: true };
            let mut out = [0; MAX_HOST_FRAME];
            let forged = encode_sealed(sequence, &lock, 1 << 40, &|_| [0x5A; 16], &mut out);
            self.host.write(forged.unwrap())?;
            for (kind, schema, message) in [
                (hello, ours, &other[..]),
                (response, ours, &[0xFF, 0xFF, 0xFF][..]),
                (response, ours ^ 1, &[0]),
                (response, ours, &[0]),
                (event, ours, &[0xFF, 0xFF]),
                (event, ours ^ 1, &[0]),
            ] {
                self.put_in.extend(frame(kind, sequence, schema, message));
            }
        }
        self.host.write(bytes)?;
        self.host.write(bytes)
    }
}

/// What somebody puts between and doubles does not end an honest session: neither while it is proven nor by an
/// answer that says, without a seal, that there is none, nor by a greeting of another version, or that is no answer at all.
#[test]
fn what_is_put_between_ends_no_session() {
    let board = VirtualBoard::start(config()).unwrap();
    claim(&board);
    let meddled = Meddled {
        host: board.connect(),
        put_in: Vec::new(),
        is_exchanged: false,
    };
    let mut client = Client::new(Box::new(meddled)).unwrap();
    assert_eq!(client.authenticate(&secret(OWNER)).unwrap(), Role::Owner);
    for locked in [true, false] {
        assert!(client.lock(locked).unwrap());
    }
    client.set_job(&job()).unwrap().unwrap();
    assert!(client.has_session());
    assert_eq!(client.access().unwrap().mode, AccessMode::Claimed);
    drop(client);
    // Where there is none any more, its host is told so all the same.
    let mut configured = BoardConfig::NEW;
    configured.access.session_idle_s = Some(60);
    let mut client = authenticated(&board, OWNER);
    client.set_config(&configured).unwrap().unwrap();
    board.advance(Micros(board.now().0 + 61_000_000));
    let refused = client.keys().unwrap_err();
    assert!(
        matches!(refused, LinkError::Refused(AccessRefusal::NoSession)),
        "{refused:?}"
    );
    assert!(!client.has_session());
    drop(client);
    // Nor does a greeting go unheard where nothing else comes: it is another board.
    let exchanged = Meddled {
        host: board.connect(),
        put_in: Vec::new(),
        is_exchanged: true,
    };
    let mut client = Client::new(Box::new(exchanged)).unwrap();
    client.authenticate(&secret(OWNER)).unwrap();
    let other = client.access().unwrap_err();
    assert!(matches!(other, LinkError::Mismatch { .. }), "{other:?}");
}

/// A key that was revoked opens no session any more.
#[test]
fn a_revoked_key_is_a_strangers() {
    let board = VirtualBoard::start(config()).unwrap();
    claim(&board);
    let id = umi_core::trust::board_key::key_id(&key(ENGINEER, Role::Engineer).public);
    // The owner revokes the engineer; his next try is a stranger's.
    assert!(authenticated(&board, OWNER).key_revoke(id).unwrap());
    let mut client = umi_desk::client(&board).unwrap();
    let refused = client.authenticate(&secret(ENGINEER)).unwrap_err();
    assert!(matches!(
        refused,
        LinkError::Refused(AccessRefusal::KeyUnknown)
    ));
}
