//! Ports of this machine for a virtual board: any terminal program can be the
//! control, and `umi --port` the host. Whoever has a board of another kind serves
//! its wires with [`Port::serve`].

use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, SystemTime};

use crate::{HostEnd, VirtualBoard};

/// How long a port is read before it is looked whether there is something to write.
const TURN: Duration = Duration::from_millis(2);

/// What a port says that already has a client: this, since when and by whom, and a zero byte.
/// A zero byte before it ends whatever was there.
pub const BUSY: &str = "\0busy";

/// Where a port is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortPlace {
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
    pub fn open(place: &PortPlace) -> io::Result<Self> {
        match place {
            #[cfg(unix)]
            PortPlace::Pty => {
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
            PortPlace::Pty => Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "this system has no pseudo-terminals: use tcp",
            )),
            PortPlace::Tcp(port) => {
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
                let mut next = None;
                loop {
                    let waiting = next.take();
                    let Some(stream) = waiting.or_else(|| wait_for(&listener)) else {
                        // The system has no connection to give now.
                        thread::sleep(TURN);
                        continue;
                    };
                    // A client that is gone makes room for the next.
                    next = tcp(stream, &listener, &mut connect()).unwrap_or_default();
                }
            }
        });
    }

    /// This port is the control's.
    pub fn serve_control(self, board: &Arc<VirtualBoard>) {
        let board = Arc::clone(board);
        self.serve(move || Control(Arc::clone(&board)));
    }

    /// This port is the teaching button: pressed as long as somebody is connected.
    pub fn serve_button(self, board: &Arc<VirtualBoard>) {
        let board = Arc::clone(board);
        self.serve(move || Finger::on(&board));
    }

    /// This port is the host's.
    pub fn serve_host(self, board: &Arc<VirtualBoard>) {
        let board = Arc::clone(board);
        self.serve(move || board.connect());
    }
}

/// The next client.
fn wait_for(listener: &TcpListener) -> Option<TcpStream> {
    listener.set_nonblocking(false).ok()?;
    listener.accept().ok().map(|(stream, _)| stream)
}

/// Serves a client until it is gone. Who comes meanwhile is told that the port is busy; who
/// came just after the client had gone is the next.
fn tcp(
    mut stream: TcpStream,
    listener: &TcpListener,
    side: &mut impl Side,
) -> io::Result<Option<TcpStream>> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TURN))?;
    listener.set_nonblocking(true)?;
    let busy = busy(SystemTime::now(), stream.peer_addr()?);
    while pump(&mut stream, side).is_ok() {
        if let Ok((other, _)) = listener.accept() {
            if pump(&mut stream, side).is_err() {
                return Ok(Some(other));
            }
            let busy = busy.clone();
            thread::spawn(move || refuse(other, &busy));
        }
    }
    Ok(None)
}

/// What a second client is told: since when the port is taken, in UTC, and by whom.
fn busy(since: SystemTime, by: SocketAddr) -> String {
    let since = since.duration_since(SystemTime::UNIX_EPOCH);
    let seconds = since.map_or(0, |since| since.as_secs()) % 86_400;
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    let seconds = seconds % 60;
    format!("{BUSY}, connected since {hours:02}:{minutes:02}:{seconds:02} UTC by {by}\0")
}

/// Tells a client, and waits until it has gone: bytes of its that nobody has read would
/// make the system throw away what it was told.
fn refuse(mut other: TcpStream, busy: &str) {
    const LONGEST: Duration = Duration::from_secs(1);
    let told = other
        .set_nonblocking(false)
        .and_then(|()| other.set_read_timeout(Some(LONGEST)))
        .and_then(|()| other.write_all(busy.as_bytes()))
        .and_then(|()| other.shutdown(Shutdown::Write));
    let mut buffer = [0; 256];
    // A few frames are what a host sends before it reads.
    let mut left = 100;
    while told.is_ok() && left > 0 && other.read(&mut buffer).is_ok_and(|count| count > 0) {
        left -= 1;
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

/// Presses the button as long as it is there.
struct Finger(Arc<VirtualBoard>);

impl Finger {
    fn on(board: &Arc<VirtualBoard>) -> Self {
        board.press(true);
        Self(Arc::clone(board))
    }
}

impl Drop for Finger {
    fn drop(&mut self) {
        self.0.press(false);
    }
}

impl Side for Finger {
    fn put(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn take(&mut self) -> io::Result<Vec<u8>> {
        Ok(Vec::new())
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
