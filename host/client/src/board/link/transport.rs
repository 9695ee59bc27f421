//! Byte pipes to a board.

mod pipe;
mod serial;
mod tcp;

use std::io;
use std::time::Duration;

use super::LinkError;

pub use pipe::{Pipe, pipe};

/// A byte pipe to a board.
pub trait Transport: Send {
    /// Waits for bytes, writes those that came into `buffer` and returns their
    /// number. Returns 0 only after `timeout` has passed without any.
    ///
    /// # Errors
    /// The pipe's own; [`io::ErrorKind::UnexpectedEof`] once the other side has closed it;
    /// [`io::ErrorKind::Interrupted`] if it is to be called again.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Sends all bytes.
    ///
    /// # Errors
    /// The pipe's own, also when the other side takes no bytes.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// Longest wait for the other side to take bytes or a connection.
const PATIENCE: Duration = Duration::from_secs(5);

/// Opens the pipe of an address: `tcp://host:port`, or else a serial port, USB
/// device or pseudo-terminal by its path (`/dev/ttyACM0`, `COM3`).
///
/// # Errors
/// [`LinkError::BadAddress`], [`LinkError::NoSuchPort`], [`LinkError::CannotOpen`].
pub fn open(address: &str) -> Result<Box<dyn Transport>, LinkError> {
    match address.split_once("://") {
        Some(("tcp", host_and_port)) => tcp::open(address, host_and_port),
        Some(_) => Err(LinkError::BadAddress {
            address: address.into(),
        }),
        // No port is called so: two strokes are missing.
        None if address.is_empty() || address.starts_with("tcp:") => Err(LinkError::BadAddress {
            address: address.into(),
        }),
        None => serial::open(address),
    }
}

/// The pipe contract for what a blocking `read` returned.
fn came(result: io::Result<usize>) -> io::Result<usize> {
    use io::ErrorKind::{TimedOut, UnexpectedEof, WouldBlock};
    match result {
        Ok(0) => Err(UnexpectedEof.into()),
        Err(error) if matches!(error.kind(), TimedOut | WouldBlock) => Ok(0),
        other => other,
    }
}

#[cfg(test)]
mod tests;
