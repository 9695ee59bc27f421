//! A pseudo-terminal for the emulated board's USB port, so that a program that knows
//! serial devices only, such as `umi --port`, can use it.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use umi_virtual::serve::{Port, PortPlace, Side};

use super::{Emulator, is_patience};

/// How long it is waited for bytes of the board at a time.
const TURN: Duration = Duration::from_millis(1);

/// The pseudo-terminal's path. It lives as long as the process.
///
/// # Errors
/// The system's.
pub fn pty(emulator: &Emulator) -> io::Result<String> {
    let port = Port::open(&PortPlace::Pty)?;
    let path = port.address.clone();
    let mut stream = Some(emulator.host()?);
    // A pseudo-terminal has one client for ever: what it connects to does not change.
    port.serve(move || Wire(stream.take()));
    Ok(path)
}

struct Wire(Option<TcpStream>);

impl Wire {
    fn stream(&mut self) -> io::Result<&mut TcpStream> {
        self.0
            .as_mut()
            .ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Side for Wire {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream()?.write_all(bytes)
    }

    fn take(&mut self) -> io::Result<Vec<u8>> {
        let stream = self.stream()?;
        stream.set_read_timeout(Some(TURN))?;
        let mut buffer = [0; 4096];
        match stream.read(&mut buffer) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => Ok(buffer.get(..count).unwrap_or_default().to_vec()),
            Err(error) if is_patience(&error) => Ok(Vec::new()),
            Err(error) => Err(error),
        }
    }
}
