//! The host's end of a virtual board's link.

use std::io;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::{self, Receiver, UnboundedSender};

use super::ports::FromHost;

/// Pieces that wait for a host that does not read: about what a USB stack and an
/// operating system hold.
const WAITING: usize = 64;

/// The host's end of the link: a byte pipe. Dropping it disconnects.
#[derive(Debug)]
pub struct HostEnd {
    to_board: UnboundedSender<FromHost>,
    from_board: Waiter<Vec<u8>>,
    /// Came and was not read yet.
    rest: Vec<u8>,
}

impl HostEnd {
    pub(crate) fn new(to_board: UnboundedSender<FromHost>) -> Self {
        let (host, from_board) = mpsc::channel(WAITING);
        let _ = to_board.send(FromHost::Connected(host));
        Self {
            to_board,
            // A runtime without I/O needs nothing that could be missing.
            from_board: Waiter::new(from_board).unwrap_or_else(|error| panic!("{error}")),
            rest: Vec::new(),
        }
    }

    /// Waits for bytes; none if there are none in this time.
    ///
    /// # Errors
    /// The board is off.
    pub fn read(&mut self, patience: Duration) -> io::Result<Option<Vec<u8>>> {
        if !self.rest.is_empty() {
            return Ok(Some(std::mem::take(&mut self.rest)));
        }
        self.from_board.next(patience)
    }

    /// Waits for bytes, puts them into `buffer` and returns their number; 0 if there
    /// are none in this time.
    ///
    /// # Errors
    /// The board is off.
    pub fn read_into(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
        if self.rest.is_empty() {
            match self.from_board.next(patience)? {
                Some(bytes) => self.rest = bytes,
                None => return Ok(0),
            }
        }
        let count = self.rest.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.rest.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    /// Sends bytes.
    ///
    /// # Errors
    /// The board is off.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.to_board
            .send(FromHost::Bytes(bytes.to_vec()))
            .map_err(|_| io::ErrorKind::BrokenPipe.into())
    }
}

impl Drop for HostEnd {
    fn drop(&mut self) {
        let _ = self.to_board.send(FromHost::Gone);
    }
}

/// Waits for a channel's next value with a time limit, outside of any runtime.
#[derive(Debug)]
pub(crate) struct Waiter<T> {
    receiver: Receiver<T>,
    runtime: Runtime,
}

impl<T> Waiter<T> {
    pub fn new(receiver: Receiver<T>) -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_time().build()?;
        Ok(Self { receiver, runtime })
    }

    /// The next value; none if there is none in this time.
    pub fn next(&mut self, patience: Duration) -> io::Result<Option<T>> {
        let Self { receiver, runtime } = self;
        let waited =
            runtime.block_on(async { tokio::time::timeout(patience, receiver.recv()).await });
        match waited {
            Ok(Some(value)) => Ok(Some(value)),
            Ok(None) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(_) => Ok(None),
        }
    }
}
