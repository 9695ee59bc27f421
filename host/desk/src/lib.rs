//! A virtual board wired to a virtual machine, on a desk.
//!
//! | room | idea |
//! | --- | --- |
//! | [`capture`] | a board as fast as it computes, one event after the other |
//! | [`digitize`] | a part digitized with a distance sensor |
//! | [`line_scan`] | a laser line scanner beside a live board |
//! | [`live`] | a board whose time is that of the wall, for others to be its host |
//! | [`pulsed`] | a board that pulses a line scanner, as fast as it computes |
//! | [`shot`] | a pulse at a scanner's trigger input, and where the axes are then |
//! | [`wiring`] | where the machine's wires lead |
//! | [`tap`] | a tap on the wires: what the control prints for a listener |
//! | [`tool_path`] | the motions of a program, as the virtual control drives them |

pub mod capture;
pub mod digitize;
pub mod line_scan;
pub mod live;
pub mod pulsed;
pub mod shot;
pub mod tap;
pub mod tool_path;
pub mod wiring;

use umi_client::board::link::{Client, LinkError, Transport};
use umi_client::files::job_file;
use umi_client::problem::Problem;
use umi_protocol::job::Job;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_virtual::{Config, HostEnd, VirtualBoard};

/// The host's end of a virtual board, as a link.
struct BoardLink(HostEnd);

impl Transport for BoardLink {
    fn read(&mut self, buffer: &mut [u8], timeout: std::time::Duration) -> std::io::Result<usize> {
        self.0.read_into(buffer, timeout)
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.0.write(bytes)
    }
}

/// A link to a virtual board.
#[must_use]
pub fn link(board: &VirtualBoard) -> Box<dyn Transport> {
    Box::new(BoardLink(board.connect()))
}

/// A virtual board's host.
///
/// # Errors
/// The link's.
pub fn client(board: &VirtualBoard) -> Result<Client, LinkError> {
    Client::new(link(board))
}

/// A new virtual board with a job, and its host.
fn start(config: Config, job: &Job) -> Result<(VirtualBoard, Client), Problem> {
    let board =
        VirtualBoard::start(config).map_err(|error| Problem::trouble("virtual_board", error))?;
    let mut host = client(&board)?;
    host.set_job(job)?
        .map_err(|error| job_file::refusal(&error))?;
    Ok((board, host))
}

/// Counts of all axes of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AxisCounts {
    /// X, Y, Z, then the rotary axes; the rest is 0.
    pub all: [i64; ENCODERS],
    /// How many axes the machine has.
    pub axes: usize,
}

/// Encoder inputs of a board.
pub(crate) const ENCODERS: usize = 6;

impl AxisCounts {
    /// X, Y, Z with the rotary axes' counts.
    pub fn new(linear: [i64; 3], turned: &[i64]) -> Self {
        let mut all = [0; ENCODERS];
        let counts = linear.iter().chain(turned);
        let mut axes = 0;
        for (slot, count) in all.iter_mut().zip(counts) {
            *slot = *count;
            axes += 1;
        }
        Self { all, axes }
    }

    /// Those that the machine has.
    pub fn each(&self) -> impl Iterator<Item = i64> {
        self.all.into_iter().take(self.axes)
    }
}

/// The machine's axes there at this time of the board's clock; its encoders lose nothing.
fn axes(at_us: u64, counts: AxisCounts) -> Positions {
    Positions {
        counts: counts.each().collect(),
        t_ns: at_us.saturating_mul(1000),
        illegal: counts.each().map(|_| 0).collect(),
        lost_samples: 0,
    }
}

/// The skip line's next edge, at this time of the board's clock; `edges` counts those of its kind.
fn skip_edge(edges: &mut u32, cause: LatchCause, at_us: u64, counts: AxisCounts) -> LatchReport {
    let number = *edges;
    *edges = number.wrapping_add(1);
    LatchReport {
        number,
        cause,
        counts: counts.each().collect(),
        t_ns: at_us.saturating_mul(1000),
        missed: 0,
    }
}
