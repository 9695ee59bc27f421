//! The conversation with a control under bytes, requests and times of all kinds, held against
//! what a control may rely on:
//!
//! * an XOFF that is read as text stops the board at once, and nothing but XON, NAK, SYN or a
//!   new request lets it go on;
//! * no byte is text while a program comes in, and every byte is while nothing is on its way;
//! * while something is on its way that nobody has taken back or given up, no code asks for
//!   anything;
//! * a request does not depend on how what was measured is cut.

use umi_core::control::codes::{PARITY, SYN, XOFF, XON};
use umi_core::control::xmodem::{ACK, CAN, NAK};
use umi_core::control::{BlockAnswer, Conversation, Exchange};
use umi_core::units::Micros;
use umi_protocol::pattern::Coding;

/// Codes that mean something, and two that do not.
const CODES: [u8; 12] = [
    XON,
    XOFF,
    XON | PARITY,
    XOFF | PARITY,
    NAK,
    SYN,
    ACK,
    CAN,
    NAK | PARITY,
    0x04,
    b'%',
    b'\n',
];

/// One input.
pub fn one(data: &[u8]) {
    let mut talk = Conversation::new();
    let mut is_eia = false;
    let mut now = 1_u64;
    for step in data.chunks_exact(2) {
        let (kind, value) = (step[0] % 8, step[1]);
        let code = match value {
            0..192 => CODES[usize::from(value) % CODES.len()],
            other => other,
        };
        now += 1 << (step[0] >> 3).min(23);
        match kind {
            0..=2 => came(&mut talk, is_eia, code),
            3..=4 => measured(&mut talk, now, value, code),
            5 if talk.is_idle() => begin(&mut talk, value),
            5 => {
                talk.end(Micros(now), value % 2 == 0);
                assert!(talk.is_idle() && talk.unread() == 0);
            }
            6 if !talk.is_idle() && !talk.is_receiving() => talk.take_back(),
            _ => {
                is_eia = value % 2 == 0;
                talk.note_coding(if is_eia { Coding::Eia } else { Coding::Ascii });
            }
        }
    }
}

fn came(talk: &mut Conversation, is_eia: bool, byte: u8) {
    let before = talk.clone();
    let reaction = talk.on_byte(byte);
    if before.is_receiving() {
        assert!(!reaction.is_text && reaction.answer == BlockAnswer::Byte);
        assert_eq!(talk.unread(), before.unread().saturating_add(1));
    }
    if !before.is_in_blocks() {
        assert!(reaction.is_text && reaction.answer == BlockAnswer::None);
    }
    let plain = byte & !PARITY;
    let stops = plain == XOFF && !(is_eia && byte == XOFF);
    if reaction.is_text && stops {
        assert!(talk.is_stopped());
    }
    if before.is_stopped() && !talk.is_stopped() {
        assert!(plain == XON || (!is_eia && matches!(plain, NAK | SYN)));
        assert!(reaction.resumes);
    }
    if !reaction.is_text {
        assert_eq!(talk.is_stopped(), before.is_stopped());
    }
}

fn measured(talk: &mut Conversation, now: u64, count: u8, code: u8) {
    let bytes: Vec<u8> = (0..=count % 4)
        .map(|n| CODES[usize::from(code.wrapping_add(n)) % CODES.len()])
        .collect();
    let mut pieces = talk.clone();
    let is_busy = !talk.is_idle();
    let asked = talk.on_measured(Micros(now), &bytes);
    let cut = bytes
        .iter()
        .filter_map(|byte| pieces.on_measured(Micros(now), &[*byte]))
        .last();
    assert_eq!(asked, cut);
    if is_busy && talk.is_receiving() {
        assert_eq!(asked, None);
    }
    assert!(!matches!(
        asked,
        Some(Exchange::Verdict | Exchange::Receive)
    ));
}

fn begin(talk: &mut Conversation, value: u8) {
    let exchange = match value % 5 {
        0 => Exchange::Verdict,
        1 => Exchange::Read,
        2 => Exchange::ReadOrResume,
        3 => Exchange::Xmodem,
        _ => Exchange::Receive,
    };
    let was_stopped = talk.is_stopped();
    talk.begin(u64::from(value) << 18, exchange);
    assert_eq!(
        talk.is_stopped(),
        was_stopped && exchange == Exchange::Verdict
    );
    assert!(!talk.is_idle() && !talk.is_given_up() && talk.unread() == 0);
    // Nothing has taken it back: no code asks for anything.
    let mut probe = talk.clone();
    assert_eq!(probe.on_measured(Micros(u64::MAX), &CODES), None);
}
