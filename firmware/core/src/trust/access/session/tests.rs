use super::*;
use umi_protocol::frame::{SEAL, encode_sealed};
use umi_protocol::message::Request;

fn key(of: u8) -> SigningKey {
    SigningKey::from_bytes(&[of; 32])
}

fn board(ask: &SessionAsk, drawn: u8) -> BoardHandshake {
    let board_key = key(0xB0).verifying_key().to_bytes();
    let drawn = BoardShare::new([drawn; 32], [drawn ^ 0x55; 32]);
    BoardHandshake::new(ask, board_key, drawn)
}

fn parts(signature: &Signature) -> SignatureParts {
    [*signature.r_bytes(), *signature.s_bytes()]
}

/// A session as both ends have it.
fn session(host_draws: u8, board_draws: u8) -> (HostSession, BoardSession) {
    let host = HostHandshake::new(&key(1), [host_draws; 32]);
    let board = board(&host.ask(), board_draws);
    let (signature, proof) = host.prove(&key(1), board.challenge()).unwrap();
    let (session, to_sign) = board.prove(signature).unwrap();
    let host = proof.open(parts(&key(0xB0).sign(&to_sign))).unwrap();
    (host, session)
}

fn sealed<'a>(counter: u64, message: &'a [u8]) -> Authenticated<'a> {
    Authenticated {
        header: [5, 1, 0, 9, 9, 9, 9],
        counter,
        message,
    }
}

/// Both ends have the same keys; a frame counts once, and only as it was sent.
#[test]
fn a_frame_counts_once_and_unchanged() {
    let (mut host, mut board) = session(7, 8);
    let counter = host.count();
    let frame = sealed(counter, b"do it");
    let code = host.code(&frame);
    for change in 0..16 {
        let mut wrong = code;
        wrong[change] ^= 1;
        assert!(!board.takes(&frame, &wrong));
    }
    assert!(!board.takes(&sealed(counter, b"do is"), &code));
    assert!(!board.takes(&sealed(counter + 1, b"do it"), &code));
    let mut header = frame;
    header.header[1] ^= 1;
    assert!(!board.takes(&header, &code));
    assert!(board.takes(&frame, &code));
    assert!(!board.takes(&frame, &code), "it counts once");

    // What the host sends is no answer of the board's, and the reverse.
    assert!(!host.is_answer(&frame, &code));
    let answer = board.code(&frame);
    assert!(host.is_answer(&frame, &answer));
    assert_ne!(answer, code);
    assert!(!host.is_answer(&sealed(counter + 1, b"do it"), &answer));
    // Late by one less than the sequence numbers there are; then its number comes again.
    while host.count() < counter + u64::from(u16::MAX) {}
    assert!(host.is_answer(&frame, &answer));
    host.count();
    assert!(!host.is_answer(&frame, &answer));
}

/// Frames of one session are none of another, whatever of it is the same.
#[test]
fn sessions_have_keys_of_their_own() {
    let (mut host, _) = session(7, 8);
    let frame = sealed(host.count(), b"do it");
    let code = host.code(&frame);
    for (host_draws, board_draws) in [(7, 9), (9, 8)] {
        let (_, mut other) = session(host_draws, board_draws);
        assert!(!other.takes(&frame, &code));
    }
}

/// A proof is for one challenge, one board, one host and one pair of shares.
#[test]
fn a_proof_is_good_for_one_session() {
    let host = HostHandshake::new(&key(1), [7; 32]);
    let ask = host.ask();
    let right = board(&ask, 8);
    let (signature, _) = host.prove(&key(1), right.challenge()).unwrap();
    let drawn = || BoardShare::new([8; 32], [8 ^ 0x55; 32]);
    let other_board = |board_key| BoardHandshake::new(&ask, board_key, drawn());
    assert!(board(&ask, 9).prove(signature).is_none(), "challenge");
    let other = key(0xB1).verifying_key().to_bytes();
    assert!(other_board(other).prove(signature).is_none(), "board");
    for (of, share) in [(2, ask.share), (1, [9; 32])] {
        let other = SessionAsk {
            key: key(of).verifying_key().to_bytes(),
            share,
        };
        assert!(board(&other, 8).prove(signature).is_none());
    }
    assert!(right.prove(signature).is_some());
}

/// Somebody else's signature opens nothing, on either side.
#[test]
fn both_ends_prove_their_keys() {
    let host = HostHandshake::new(&key(1), [7; 32]);
    let board = board(&host.ask(), 8);
    let transcript = transcript(&host.ask(), board.challenge());
    let (signature, proof) = host.prove(&key(1), board.challenge()).unwrap();
    let (_, to_sign) = board.prove(signature).unwrap();
    assert_eq!(to_sign, signed(Side::Board, &transcript));
    // What the host has signed is not what the board has.
    assert!(proof.open(signature).is_none());
}

/// A share that gives no secret is refused (RFC 7748, section 6.1).
#[test]
fn a_share_of_zero_opens_nothing() {
    let secret = StaticSecret::from([3; 32]);
    for share in [[0; 32], {
        let mut one = [0; 32];
        one[0] = 1;
        one
    }] {
        assert!(SessionKeys::new(&secret, &share, &[0; 32]).is_none());
    }
}

/// A sealed frame is taken apart into what was sealed.
#[test]
fn a_sealed_frame_comes_apart() {
    let (mut host, mut board) = session(7, 8);
    let mut out = [0; umi_protocol::frame::MAX_HOST_FRAME];
    let counter = host.count();
    let bytes = encode_sealed(9, &Request::Wipe, counter, &|of| host.code(of), &mut out).unwrap();
    let mut decoder =
        umi_protocol::decoder::Decoder::<{ umi_protocol::frame::MAX_HOST_FRAME }>::new();
    let mut rest = bytes;
    let frame = decoder.next_frame(&mut rest).unwrap();
    assert!(frame.open::<Request>().is_err(), "not without its seal");
    assert_eq!(frame.payload.len(), 1 + SEAL);
    let (inner, authenticated, code) = frame.unsealed().unwrap();
    assert_eq!(authenticated.counter, counter);
    assert!(board.takes(&authenticated, code));
    assert_eq!(inner.sequence, 9);
    assert_eq!(inner.open::<Request>(), Ok(Request::Wipe));
}
