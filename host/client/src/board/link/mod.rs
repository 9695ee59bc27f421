//! The link to a board: real, virtual or in the same process.
//!
//! ```no_run
//! use std::time::Duration;
//! use umi_client::board::link::{Client, LinkError};
//!
//! # fn main() -> Result<(), LinkError> {
//! let mut board = Client::open("/dev/ttyACM0")?; // or "tcp://localhost:7001"
//! println!("{}", board.identity()?.firmware);
//! board.live(true)?;
//! while let Some(event) = board.next_event(Duration::from_secs(10))? {
//!     println!("{event:?}");
//! }
//! # Ok(())
//! # }
//! ```
//!
//! [`Transport`] moves bytes, [`umi_protocol::frame`] makes frames of them, and [`Client`]
//! makes calls of frames: one request at a time, asked again when the answer does
//! not come, while what the board reports unasked is kept for [`Client::next_event`].

mod calls;
mod client;
mod error;
mod session;
mod transport;

pub use calls::{
    Acknowledged, ConfigRefusal, JobInForce, JournalChain, JournalEntry, SensorTaken,
    SessionAnswer, StoredPrograms,
};
pub use client::{Client, Patience};
pub use error::LinkError;
pub use transport::{Pipe, Transport, open, pipe};
