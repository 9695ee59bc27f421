//! Ports of this machine for a virtual board: any terminal program can be the
//! control, and `umi --port` the host. Whoever has a board of another kind serves
//! its wires with [`Port::serve`].

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use crate::{HostEnd, VirtualBoard};

/// How long a port is read before it is looked whether there is something to write.
const TURN: Duration = Duration::from_millis(2);

/// Where a port is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A pseudo-terminal, as a serial device.
    Pty,
    /// A TCP port of this machine (loopback only); 0: any.
    Tcp(u16),
}

/// A port that is open.
pub struct Port {
    /// What to give to a terminal program or to `umi --port`.
    pub address: String,
    listener: Listener,
}

enum Listener {
    #[cfg(unix)]
    Pty {
        master: serialport::TTYPort,
        /// Held, so that the pseudo-terminal and its raw mode stay when a program
        /// closes it. A plain file: a `TTYPort` would lock others out.
        held: std::fs::File,
    },
    Tcp(TcpListener),
}

impl Port {
    /// Opens a port.
    ///
    /// # Errors
    /// The system's.
    pub fn open(place: &Place) -> io::Result<Self> {
        match place {
            #[cfg(unix)]
            Place::Pty => {
                use serialport::SerialPort as _;
                use std::os::unix::fs::OpenOptionsExt as _;
                let (mut master, mut slave) = serialport::TTYPort::pair()?;
                slave.set_exclusive(false)?;
                master.set_timeout(TURN)?;
                let address = slave.name().unwrap_or_default();
                let held = std::fs::OpenOptions::new()
                    .read(true)
                    .write(true)
                    .custom_flags(libc::O_NOCTTY)
                    .open(&address)?;
                let listener = Listener::Pty { master, held };
                Ok(Self { address, listener })
            }
            #[cfg(not(unix))]
            Place::Pty => Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "this system has no pseudo-terminals: use tcp",
            )),
            Place::Tcp(port) => {
                let listener = TcpListener::bind(("127.0.0.1", *port))?;
                Ok(Self {
                    address: format!("tcp://{}", listener.local_addr()?),
                    listener: Listener::Tcp(listener),
                })
            }
        }
    }

    /// Connects whoever comes with what `connect` gives, one after the other, in a
    /// thread of its own, as long as the process lives.
    pub fn serve<S: Side>(self, mut connect: impl FnMut() -> S + Send + 'static) {
        thread::spawn(move || match self.listener {
            #[cfg(unix)]
            Listener::Pty { mut master, held } => {
                let mut side = connect();
                while pump(&mut master, &mut side).is_ok() {}
                drop(held);
            }
            Listener::Tcp(listener) => {
                for stream in listener.incoming().flatten() {
                    let mut side = connect();
                    // A client that is gone makes room for the next.
                    let _ = tcp(stream, &mut side);
                }
            }
        });
    }

    /// This port is the control's.
    pub fn serve_control(self, board: &Arc<VirtualBoard>) {
        let board = Arc::clone(board);
        self.serve(move || Control(Arc::clone(&board)));
    }

    /// This port is the host's.
    pub fn serve_host(self, board: &Arc<VirtualBoard>) {
        let board = Arc::clone(board);
        self.serve(move || board.connect());
    }
}

fn tcp(mut stream: TcpStream, side: &mut impl Side) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TURN))?;
    loop {
        pump(&mut stream, side)?;
    }
}

/// The board's side of a port.
pub trait Side {
    /// Bytes for the board.
    ///
    /// # Errors
    /// The board is gone.
    fn put(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// What the board has now; empty: nothing.
    ///
    /// # Errors
    /// The board is gone.
    fn take(&mut self) -> io::Result<Vec<u8>>;
}

struct Control(Arc<VirtualBoard>);

impl Side for Control {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.control_sends(bytes);
        Ok(())
    }

    fn take(&mut self) -> io::Result<Vec<u8>> {
        // One at a time, so that an XOFF is seen between two.
        Ok(self
            .0
            .control_receives(Duration::ZERO)
            .into_iter()
            .collect())
    }
}

impl Side for HostEnd {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write(bytes)
    }

    fn take(&mut self) -> io::Result<Vec<u8>> {
        Ok(self.read(Duration::ZERO)?.unwrap_or_default())
    }
}

/// One turn: what came in goes to the board, what the board has goes out.
fn pump(port: &mut (impl Read + Write), side: &mut impl Side) -> io::Result<()> {
    let mut buffer = [0; 256];
    match port.read(&mut buffer) {
        Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(count) => side.put(buffer.get(..count).unwrap_or_default())?,
        Err(error) if is_patience(&error) => {}
        Err(error) => return Err(error),
    }
    loop {
        let bytes = side.take()?;
        if bytes.is_empty() {
            return Ok(());
        }
        write_all(port, &bytes)?;
    }
}

/// As `write_all`, but a port that does not take bytes now is asked again: nobody
/// may be reading a pseudo-terminal.
fn write_all(port: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match port.write(bytes) {
            Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
            Err(error) if is_patience(&error) => thread::sleep(TURN),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn is_patience(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
    )
}
