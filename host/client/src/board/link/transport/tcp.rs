//! A TCP connection, as the virtual board offers it.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use super::{LinkError, PATIENCE, Transport, came};

/// What a port says that has a client already (`umi_virtual::serve::BUSY`).
const BUSY: &[u8] = b"\0busy";

struct Tcp {
    stream: TcpStream,
    /// Nothing has come yet.
    is_new: bool,
}

impl Tcp {
    const fn new(stream: TcpStream) -> Self {
        Self {
            stream,
            is_new: true,
        }
    }
}

/// The pipe over a connection that someone else made.
#[cfg(test)]
pub(super) const fn from(stream: TcpStream) -> impl Transport {
    Tcp::new(stream)
}

pub(super) fn open(address: &str, host_and_port: &str) -> Result<Box<dyn Transport>, LinkError> {
    let cannot = |cause| LinkError::CannotOpen {
        address: address.into(),
        cause,
    };
    let (_, port) = host_and_port.rsplit_once(':').unwrap_or_default();
    if port.parse::<u16>().is_err() {
        return Err(LinkError::BadAddress {
            address: address.into(),
        });
    }
    let mut last = io::Error::from(io::ErrorKind::NotFound);
    // A name may have several addresses (IPv6 and IPv4); the first that answers serves.
    for socket in host_and_port.to_socket_addrs().map_err(cannot)? {
        match TcpStream::connect_timeout(&socket, PATIENCE) {
            Ok(stream) => {
                // Requests are small and each waits for its answer.
                stream.set_nodelay(true).map_err(cannot)?;
                stream.set_write_timeout(Some(PATIENCE)).map_err(cannot)?;
                return Ok(Box::new(Tcp::new(stream)));
            }
            Err(error) => last = error,
        }
    }
    Err(cannot(last))
}

impl Transport for Tcp {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        // Zero would mean for ever.
        let timeout = timeout.max(Duration::from_millis(1));
        self.stream.set_read_timeout(Some(timeout))?;
        let count = came(self.stream.read(buffer))?;
        if count > 0 && std::mem::take(&mut self.is_new) {
            let first = buffer.get(..count).unwrap_or_default();
            if first.starts_with(BUSY) {
                let why = String::from_utf8_lossy(first).replace('\0', "");
                return Err(io::Error::new(io::ErrorKind::ResourceBusy, why));
            }
        }
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }
}
