//! A TCP connection, as the virtual board offers it.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use super::{LinkError, PATIENCE, Transport, came};

struct Tcp(TcpStream);

/// The pipe over a connection that someone else made.
#[cfg(test)]
pub(super) const fn from(stream: TcpStream) -> impl Transport {
    Tcp(stream)
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
                return Ok(Box::new(Tcp(stream)));
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
        self.0.set_read_timeout(Some(timeout))?;
        came(self.0.read(buffer))
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }
}
