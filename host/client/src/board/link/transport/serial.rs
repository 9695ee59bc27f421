//! A serial port, a USB device that looks like one, or a pseudo-terminal.

use std::io;
use std::path::Path;
use std::time::Duration;

use serialport::SerialPort;

use super::{LinkError, PATIENCE, Transport, came};

/// For a UART; USB and pseudo-terminals ignore it.
const BAUD: u32 = 115_200;

struct Serial(Box<dyn SerialPort>);

/// The pipe over a port that someone else opened.
#[cfg(test)]
pub(super) const fn from(port: Box<dyn SerialPort>) -> impl Transport {
    Serial(port)
}

pub(super) fn open(path: &str) -> Result<Box<dyn Transport>, LinkError> {
    let mut port = serialport::new(path, BAUD)
        .open()
        .map_err(|cause| explain(path, cause))?;
    // Some boards send only when the host says that it listens. A pseudo-terminal
    // has no such line; nothing is lost there.
    let _ = port.write_data_terminal_ready(true);
    Ok(Box::new(Serial(port)))
}

fn explain(path: &str, cause: serialport::Error) -> LinkError {
    // On Windows ports are no files, and `NoDevice` also means "in use".
    let missing = if cfg!(unix) {
        !Path::new(path).exists()
    } else {
        cause.kind() == serialport::ErrorKind::NoDevice
    };
    let is_taken = cause.to_string().to_lowercase().contains("busy");
    if is_taken {
        LinkError::Busy(format!(
            "busy, {path} is open in another program (a serial port does not say in which, nor since when)"
        ))
    } else if missing {
        LinkError::NoSuchPort {
            address: path.into(),
            ports: ports(),
        }
    } else {
        LinkError::CannotOpen {
            address: path.into(),
            cause: cause.into(),
        }
    }
}

/// The serial ports that there are.
fn ports() -> Vec<String> {
    // Only for a better message: without a list it still says what is wrong.
    let mut names: Vec<String> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| port.port_name)
        .collect();
    names.sort();
    names
}

impl Transport for Serial {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.0.set_timeout(timeout)?;
        came(self.0.read(buffer))
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.set_timeout(PATIENCE)?;
        self.0.write_all(bytes)
    }
}
