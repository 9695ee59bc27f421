//! A tap on the machine's wires. They lead to the board while the experiment probes the
//! spheres, and to a listener while it probes the plate's surface.

use umi_core::dprnt::{Item, LineSplitter};
use umi_core::units::{Micros, Point};
use umi_protocol::pattern::{LinePattern, PointLinePattern, ReceiverConfig, RingCsvPattern};
use umi_virtual::machine::Wires;

use crate::wiring::Wiring;
use umi_client::problem::Problem;

/// Wires with a tap.
pub struct Tap {
    /// To the board.
    pub board: Wiring,
    /// Bytes that went to the board.
    pub printed_bytes: usize,
    listener: Option<Vec<u8>>,
}

impl Tap {
    /// Wires to a board.
    #[must_use]
    pub fn new(board: Wiring) -> Self {
        Self {
            board,
            printed_bytes: 0,
            listener: None,
        }
    }

    /// From now on the listener gets what the control prints; the board's job knows
    /// nothing of it.
    pub fn listen(&mut self) {
        self.listener = Some(Vec::new());
    }

    /// Leads to the board again, and gives the points that the listener has heard:
    /// lines `POINT: x y z` (thesis, section 3.4.2), read as the board reads them.
    ///
    /// # Errors
    /// A line is not such a one.
    pub fn heard(&mut self) -> Result<Vec<Point>, Problem> {
        let bytes = self.listener.take().unwrap_or_default();
        let mut config = ReceiverConfig::default();
        // Both fit into the list.
        let _ = config
            .patterns
            .push(LinePattern::PointLine(PointLinePattern::default()));
        let _ = config
            .patterns
            .push(LinePattern::RingCsv(RingCsvPattern::default()));
        let mut receiver = LineSplitter::new(&config);
        let mut points = Vec::new();
        let mut fault = None;
        let mut sink = |item: Item<'_>| match item {
            Item::Hit(hit) => points.push(hit.position),
            Item::Fault(found) => {
                fault.get_or_insert(found);
            }
            Item::Line(_)
            | Item::BlockStart(_)
            | Item::BlockEnd(_)
            | Item::Announced(_)
            | Item::Request(_)
            | Item::Reads => {}
        };
        receiver.receive(&bytes, Micros(0), &mut sink);
        receiver.finish(Micros(0), &mut sink);
        match fault {
            Some(fault) => Err(Problem::trouble(
                "listener",
                format_args!("line {}: {}", fault.line, fault.kind),
            )),
            None => Ok(points),
        }
    }
}

impl Wires for Tap {
    fn serial(&mut self, at: Micros, bytes: &[u8]) {
        if let Some(listener) = &mut self.listener {
            listener.extend_from_slice(bytes);
        } else {
            self.printed_bytes += bytes.len();
            self.board.serial(at, bytes);
        }
    }

    fn skip(&mut self, at: Micros, counts: [i64; 3]) {
        if self.listener.is_none() {
            self.board.skip(at, counts);
        }
    }

    fn skip_falls(&mut self, at: Micros, counts: [i64; 3]) {
        if self.listener.is_none() {
            self.board.skip_falls(at, counts);
        }
    }

    fn time(&mut self, now: Micros) {
        self.board.time(now);
    }

    fn sampling_s(&self) -> Option<f64> {
        self.board.sampling_s()
    }

    fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        self.board.moved(at, counts);
    }

    fn turned(&mut self, counts: &[i64]) {
        self.board.turned(counts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wiring::Peer;

    /// What is printed while listening is heard, with signs as controls print them,
    /// and does not go to the board; what is no point is an error.
    #[test]
    fn the_listener_hears_points() {
        let mut tap = Tap::new(Wiring::new(Peer::Nowhere));
        tap.serial(Micros(1), b"to the board\n");
        tap.listen();
        tap.serial(
            Micros(2),
            b"\x12POINT: - 110.0000   70.0000   64.0010\n\x14",
        );
        tap.serial(Micros(3), b"POINT:    1.0000 -   2.5000   63.9990\n");
        let points = tap.heard().unwrap();
        assert_eq!(
            points.iter().map(|p| p.to_array_mm()).collect::<Vec<_>>(),
            [[-110.0, 70.0, 64.001], [1.0, -2.5, 63.999]]
        );
        assert_eq!(tap.printed_bytes, 13);
        tap.listen();
        tap.serial(Micros(4), b"POINT: 1.0 2.0\n");
        assert!(tap.heard().is_err());
        assert!(tap.heard().unwrap().is_empty());
    }
}
