//! A pipe within this process, for a virtual board and for tests.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use super::Transport;

/// One end of a pipe within this process.
#[derive(Debug)]
pub struct Pipe {
    incoming: Receiver<Vec<u8>>,
    outgoing: Sender<Vec<u8>>,
    /// What came and was not read yet.
    rest: Vec<u8>,
}

/// Both ends of a pipe. Dropping one closes it for the other.
#[must_use]
pub fn pipe() -> (Pipe, Pipe) {
    let (to_right, from_left) = channel();
    let (to_left, from_right) = channel();
    let end = |incoming, outgoing| Pipe {
        incoming,
        outgoing,
        rest: Vec::new(),
    };
    (end(from_right, to_right), end(from_left, to_left))
}

impl Transport for Pipe {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if self.rest.is_empty() {
            match self.incoming.recv_timeout(timeout) {
                Ok(bytes) => self.rest = bytes,
                Err(RecvTimeoutError::Timeout) => return Ok(0),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
        let len = self.rest.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.rest.drain(..len)) {
            *place = byte;
        }
        Ok(len)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if bytes.is_empty() {
            return Ok(());
        }
        self.outgoing
            .send(bytes.to_vec())
            .map_err(|_| io::ErrorKind::BrokenPipe.into())
    }
}
