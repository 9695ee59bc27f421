//! The data channel over TCP: everybody who is connected gets every message.

use std::io::{self, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// A client that takes nothing for so long is let go.
const PATIENCE: Duration = Duration::from_secs(2);

/// The open channel.
#[derive(Clone, Debug)]
pub struct DataChannel {
    /// Where it is, as `host:port`.
    pub address: String,
    clients: Arc<Mutex<Vec<TcpStream>>>,
}

impl DataChannel {
    /// Opens it on a port of this machine; 0: any free one. It lives as long as the process.
    ///
    /// # Errors
    /// The port is taken.
    pub fn open(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", port))?;
        let address = listener.local_addr()?.to_string();
        let clients: Arc<Mutex<Vec<TcpStream>>> = Arc::default();
        let own = Arc::clone(&clients);
        thread::Builder::new()
            .name("virtual scanner".into())
            .spawn(move || {
                for client in listener.incoming() {
                    let Ok(client) = client else {
                        // The system has no connection to give now.
                        thread::sleep(Duration::from_millis(20));
                        continue;
                    };
                    let set = client
                        .set_nodelay(true)
                        .and_then(|()| client.set_write_timeout(Some(PATIENCE)));
                    if set.is_ok() {
                        own.lock()
                            .unwrap_or_else(PoisonError::into_inner)
                            .push(client);
                    }
                }
            })?;
        Ok(Self { address, clients })
    }

    /// How many are connected.
    #[must_use]
    pub fn clients(&self) -> usize {
        self.clients
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .len()
    }

    /// Sends messages to everybody. Who is gone, or takes nothing, is let go: half a message is
    /// the last that it gets.
    pub fn send(&self, bytes: &[u8]) {
        self.clients
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .retain_mut(|client| client.write_all(bytes).is_ok());
    }
}
