//! The table of transitions, row by row.

use super::*;

const TEXT: Reaction = Reaction {
    is_text: true,
    answer: BlockAnswer::None,
    resumes: false,
};

fn begun(exchange: Exchange) -> Conversation {
    let mut talk = Conversation::new();
    talk.begin(XOFF_PATIENCE_US, exchange);
    talk
}

/// XOFF stops, in ISO with either parity, until XON; in EIA 0x13 is a digit.
#[test]
fn xoff_stops_at_once() {
    let mut talk = begun(Exchange::Read);
    for (xoff, xon) in [(0x13, 0x11), (0x93, 0x91)] {
        assert_eq!(talk.on_byte(xoff), TEXT);
        assert!(talk.is_stopped());
        assert!(talk.on_byte(xon).resumes);
        assert!(!talk.is_stopped());
    }
    talk.note_coding(Coding::Eia);
    talk.on_byte(0x13);
    assert!(!talk.is_stopped());
    talk.on_byte(0x93);
    assert!(talk.is_stopped());
}

/// Who asks is ready: an XOFF from before is void. A verdict asks nobody.
#[test]
fn an_earlier_xoff_holds_for_a_verdict_only() {
    for (exchange, stays) in [(Exchange::Read, false), (Exchange::Verdict, true)] {
        let mut talk = Conversation::new();
        talk.on_byte(XOFF);
        talk.begin(0, exchange);
        assert_eq!(talk.is_stopped(), stays, "{exchange:?}");
    }
}

/// A NAK behind XOFF gives up what is being sent, and asks for nothing before that has ended.
#[test]
fn nak_behind_xoff_gives_up() {
    let mut talk = begun(Exchange::Read);
    talk.on_byte(XOFF);
    assert!(talk.on_byte(NAK).resumes);
    assert!(talk.is_given_up() && !talk.is_stopped());
    assert_eq!(talk.on_measured(Micros(7), &[XOFF, NAK]), None);
    talk.end(Micros(9), false);
    assert_eq!(talk.on_measured(Micros(9), &[NAK]), None);
    assert_eq!(talk.on_measured(Micros(10), &[NAK]), Some(Exchange::Xmodem));
}

/// XON asks for a program; soon after an XOFF it may be a "go on"; while something is sent it
/// is one; behind a line that takes that back it asks again.
#[test]
fn xon_reads_or_resumes() {
    let mut talk = Conversation::new();
    let asks = |talk: &mut Conversation, us| talk.on_measured(Micros(us), &[XON]);
    assert_eq!(asks(&mut talk, 1), Some(Exchange::Read));
    talk.on_measured(Micros(2), &[XOFF]);
    assert_eq!(asks(&mut talk, 3), Some(Exchange::ReadOrResume));
    talk.on_measured(Micros(4), &[XOFF]);
    let late_us = 4 + XOFF_PATIENCE_US;
    assert_eq!(asks(&mut talk, late_us), Some(Exchange::Read));
    talk.begin(0, Exchange::Read);
    assert_eq!(asks(&mut talk, late_us + 1), None);
    talk.take_back();
    assert_eq!(asks(&mut talk, late_us + 2), Some(Exchange::Read));
}

/// Until a block is acknowledged what comes is text, and anything but an answer ends the
/// blocks; from then on nothing is text, and what answers no block is counted.
#[test]
fn blocks_are_text_until_acknowledged() {
    let mut talk = begun(Exchange::Xmodem);
    let answer = |is_text| Reaction {
        is_text,
        answer: BlockAnswer::Byte,
        resumes: false,
    };
    assert_eq!(talk.on_byte(NAK), answer(true));
    assert_eq!(talk.on_byte(CAN), answer(false));
    let mut foreign = talk.clone();
    let cancelled = Reaction {
        answer: BlockAnswer::Cancel,
        ..TEXT
    };
    assert_eq!(foreign.on_byte(b'X'), cancelled);
    assert!(foreign.is_given_up() && !foreign.is_in_blocks());
    assert_eq!(talk.on_byte(ACK), answer(false));
    assert_eq!(talk.on_byte(XOFF), answer(false));
    assert!(!talk.is_stopped());
    assert_eq!(talk.unread(), 1);
    talk.end(Micros(1), false);
    assert!(talk.is_idle());
    assert_eq!((talk.unread(), talk.on_byte(b'X')), (0, TEXT));
}

/// While a program comes in no byte is text; one that was a program had no lines.
#[test]
fn receiving_reads_no_text() {
    let mut talk = begun(Exchange::Receive);
    assert!(!talk.on_byte(XON).is_text && talk.is_receiving());
    assert_eq!(talk.on_measured(Micros(5), &[XON]), None);
    assert_eq!(talk.unread(), 1);
    talk.was_a_program();
    assert_eq!(talk.unread(), 0);
}
