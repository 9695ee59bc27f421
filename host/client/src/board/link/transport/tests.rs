//! The real pipes: each carries a greeting and a call, tells of silence and of
//! its end, and says what is wrong when it cannot be opened.

use std::net::TcpListener;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;

use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, encode};
use umi_protocol::hello::Hello;
use umi_protocol::message::{JournalInfo, Response};

use super::*;
use crate::board::link::Client;

const INFO: JournalInfo = JournalInfo {
    first_seq: 1,
    next_seq: 2,
    acked_seq: 0,
    lost: 0,
};

/// A board at the end of a pipe, until it is switched off.
fn serve(mut pipe: impl Transport, off: &Receiver<()>) {
    let mut decoder = Decoder::<MAX_HOST_FRAME>::new();
    while off.try_recv() == Err(TryRecvError::Empty) {
        let mut buffer = [0; 64];
        let len = pipe.read(&mut buffer, Duration::from_millis(10)).unwrap();
        let mut bytes = &buffer[..len];
        while let Some(frame) = decoder.next_frame(&mut bytes) {
            match frame.kind {
                Kind::Hello => send(&mut pipe, frame.sequence, &Hello::new("board")),
                _ => send(&mut pipe, frame.sequence, &Response::JournalInfo(INFO)),
            }
        }
    }
}

fn send<M: Message>(pipe: &mut impl Transport, sequence: u16, message: &M) {
    let mut buffer = [0; MAX_BOARD_FRAME];
    pipe.write(encode(sequence, message, &mut buffer).unwrap())
        .unwrap();
}

/// Greets, calls, waits in vain for an event, switches the board off and sees the end.
fn hold(client: Result<Client, LinkError>, off: &Sender<()>) {
    let mut client = client.unwrap();
    assert_eq!(client.board(), "board");
    assert_eq!(client.journal_info().unwrap(), INFO);
    let silence = client.next_event(Duration::from_millis(20)).unwrap();
    assert!(silence.is_none());
    assert_eq!(client.journal_info().unwrap(), INFO);
    off.send(()).unwrap();
    let error = client.next_event(Duration::from_secs(20)).unwrap_err();
    assert!(matches!(error, LinkError::Closed(_)), "{error:?}");
}

#[test]
fn a_pipe_in_this_process_carries_calls() {
    let (ours, theirs) = pipe();
    let (off, is_off) = channel();
    let board = thread::spawn(move || serve(theirs, &is_off));
    hold(Client::new(Box::new(ours)), &off);
    board.join().unwrap();
}

#[test]
fn tcp_carries_calls() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let (off, is_off) = channel();
    let board = thread::spawn(move || serve(tcp::from(listener.accept().unwrap().0), &is_off));
    hold(Client::open(&address), &off);
    board.join().unwrap();
}

/// A pseudo-terminal is opened by its path as a serial port is.
#[cfg(unix)]
#[test]
fn a_pseudo_terminal_carries_calls() {
    let (master, slave) = serialport::TTYPort::pair().unwrap();
    let path = serialport::SerialPort::name(&slave).unwrap();
    let (off, is_off) = channel();
    let board = thread::spawn(move || serve(serial::from(Box::new(master)), &is_off));
    hold(Client::open(&path), &off);
    board.join().unwrap();
    drop(slave);
}

/// An address that cannot be meant, a port that is not there, a port that is no
/// board's, a board that does not listen: each says what it is.
#[test]
fn what_cannot_be_opened_is_named() {
    let message = |address: &str| match open(address) {
        Ok(_) => panic!("{address} was opened"),
        Err(error) => (format!("{error:?}"), error.to_string()),
    };
    for address in [
        "",
        "udp://here:1",
        "tcp:7001",
        "tcp://here",
        "tcp://here:port",
    ] {
        let (kind, says) = message(address);
        assert!(kind.starts_with("BadAddress"), "{address}: {kind}");
        assert!(says.contains("tcp://host:port"), "{says}");
    }
    let (kind, says) = message("/dev/ttyNoSuchBoard");
    assert!(kind.starts_with("NoSuchPort"), "{kind}");
    assert!(
        says.contains("there is no port /dev/ttyNoSuchBoard"),
        "{says}"
    );
    if cfg!(unix) {
        let (kind, says) = message("/dev/null");
        assert!(kind.starts_with("CannotOpen"), "{kind}");
        assert!(says.starts_with("cannot open /dev/null"), "{says}");
    }
    // A port that was free a moment ago.
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let (kind, says) = message(&format!("tcp://{free}"));
    assert!(kind.starts_with("CannotOpen"), "{kind}");
    assert!(says.contains("is the virtual board running?"), "{says}");
}
