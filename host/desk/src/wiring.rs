//! The virtual machine's wires, and their peer: a virtual board, a board's serial port, or
//! nobody.

use std::io::{ErrorKind, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serialport::SerialPort;
use umi_core::units::Micros;
use umi_protocol::latch::LatchCause;
use umi_virtual::machine::Wires;

use crate::capture::{self, Desk};
use crate::live::{self, Live};
use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;

/// The control's READ: it asks with DC1.
const DC1: u8 = 0x11;

/// How long a board may think before it sends a program, and between two of its characters.
const PATIENCE: Duration = Duration::from_secs(5);

/// So long nothing comes any more of a program that somebody has broken off.
const SILENCE: Duration = Duration::from_millis(100);

/// No board sends longer programs.
const LONGEST: usize = 1 << 20;

/// Where the wires lead.
pub enum Peer {
    /// Nowhere: text is shown and that is all.
    Nowhere,
    /// To a virtual board: serial line, skip line and encoders.
    Board(Box<Desk>),
    /// To a virtual board that others watch, as fast as a machine is.
    Live(Box<Live>),
    /// To a serial port: the serial line alone.
    Line(Box<dyn ControlLine>),
}

/// A serial line of this computer.
pub trait ControlLine: std::io::Read + std::io::Write {
    /// How long a read waits for the next byte.
    ///
    /// # Errors
    /// The line's.
    fn wait(&mut self, patience: Duration) -> std::io::Result<()>;
}

impl ControlLine for Box<dyn SerialPort> {
    fn wait(&mut self, patience: Duration) -> std::io::Result<()> {
        Ok(self.set_timeout(patience)?)
    }
}

impl ControlLine for TcpStream {
    fn wait(&mut self, patience: Duration) -> std::io::Result<()> {
        self.set_read_timeout(Some(patience))
    }
}

/// The machine's end of the wires.
pub struct Wiring {
    lead: Peer,
    events: Vec<WireEvent>,
    /// The first trouble: a machine's wire cannot report one.
    failure: Option<Problem>,
}

/// What happened on the wires, in its order.
#[derive(Clone, Debug)]
pub enum WireEvent {
    /// The control sent bytes; when the last of them had gone.
    Serial(Micros, Vec<u8>),
    /// The skip line rose, with the encoders' counts.
    Skip(Micros, [i64; 3]),
    /// The board decided.
    Decision(Box<DecisionRecord>),
}

impl Wiring {
    /// Wires that lead there.
    #[must_use]
    pub fn new(lead: Peer) -> Self {
        Self {
            lead,
            events: Vec::new(),
            failure: None,
        }
    }

    /// Wires to a serial port (`/dev/ttyUSB0`, `COM3`) or `tcp://host:port`.
    ///
    /// # Errors
    /// The port cannot be opened.
    pub fn to_port(address: &str, baud: u32) -> Result<Self, Problem> {
        let trouble = |error: &dyn std::fmt::Display| {
            Problem::trouble("port", format_args!("{address}: {error}"))
        };
        let line: Box<dyn ControlLine> = match address.strip_prefix("tcp://") {
            Some(host) => {
                let stream = TcpStream::connect(host).map_err(|error| trouble(&error))?;
                stream
                    .set_read_timeout(Some(PATIENCE))
                    .map_err(|error| trouble(&error))?;
                Box::new(stream)
            }
            None => Box::new(
                serialport::new(address, baud)
                    .timeout(PATIENCE)
                    .open()
                    .map_err(|error| trouble(&error))?,
            ),
        };
        Ok(Self::new(Peer::Line(line)))
    }

    /// What has happened since the last call.
    ///
    /// # Errors
    /// The first trouble on the wires.
    pub fn take(&mut self) -> Result<Vec<WireEvent>, Problem> {
        match self.failure.take() {
            Some(failure) => Err(failure),
            None => Ok(std::mem::take(&mut self.events)),
        }
    }

    /// The virtual board, if the wires lead to one.
    pub fn bench(&mut self) -> Option<&mut Desk> {
        match &mut self.lead {
            Peer::Board(bench) => Some(bench),
            Peer::Nowhere | Peer::Live(_) | Peer::Line(_) => None,
        }
    }

    /// The virtual board alone, if the wires lead to one.
    #[must_use]
    pub fn into_bench(self) -> Option<Desk> {
        match self.lead {
            Peer::Board(bench) => Some(*bench),
            Peer::Nowhere | Peer::Live(_) | Peer::Line(_) => None,
        }
    }

    /// The control's READ: the program that the board sends, up to its closing `%`.
    /// None if none comes.
    ///
    /// # Errors
    /// The line's.
    pub fn read_program(&mut self) -> Result<Option<String>, Problem> {
        match &mut self.lead {
            Peer::Nowhere => Ok(None),
            Peer::Board(bench) => bench.read_program(),
            Peer::Live(live) => Ok(capture::read_program(live.board(), PATIENCE)),
            Peer::Line(line) => read_program(line.as_mut()),
        }
    }

    fn try_to(
        &mut self,
        what: impl FnOnce(&mut Peer, &mut dyn FnMut(WireEvent)) -> Result<(), Problem>,
    ) {
        if self.failure.is_some() {
            return;
        }
        let events = &mut self.events;
        if let Err(failure) = what(&mut self.lead, &mut |event| events.push(event)) {
            self.failure = Some(failure);
        }
    }
}

impl Wires for Wiring {
    fn serial(&mut self, at: Micros, bytes: &[u8]) {
        self.try_to(|lead, keep| {
            keep(WireEvent::Serial(at, bytes.to_vec()));
            match lead {
                Peer::Nowhere => Ok(()),
                Peer::Board(bench) => {
                    bench.advance(at);
                    bench.play(bytes, |decision| {
                        keep(WireEvent::Decision(Box::new(decision)));
                        Ok(())
                    })
                }
                Peer::Live(live) => {
                    live.serial(at, bytes);
                    Ok(())
                }
                Peer::Line(line) => line
                    .write_all(bytes)
                    .and_then(|()| line.flush())
                    .map_err(|error| Problem::trouble("port", error)),
            }
        });
    }

    fn skip(&mut self, at: Micros, counts: [i64; 3]) {
        self.try_to(|lead, keep| {
            keep(WireEvent::Skip(at, counts));
            match lead {
                Peer::Board(bench) => bench.latch(at, LatchCause::Skip, counts),
                Peer::Live(live) => {
                    live.skip(at, LatchCause::Skip, counts);
                    Ok(())
                }
                Peer::Nowhere | Peer::Line(_) => Ok(()),
            }
        });
    }

    fn skip_falls(&mut self, at: Micros, counts: [i64; 3]) {
        self.try_to(|lead, _| match lead {
            Peer::Board(bench) => bench.latch(at, LatchCause::SkipEnd, counts),
            Peer::Live(live) => {
                live.skip(at, LatchCause::SkipEnd, counts);
                Ok(())
            }
            Peer::Nowhere | Peer::Line(_) => Ok(()),
        });
    }

    fn time(&mut self, now: Micros) {
        match &mut self.lead {
            Peer::Board(bench) => bench.advance(now),
            Peer::Live(live) => {
                live.wait_until(now);
            }
            Peer::Nowhere | Peer::Line(_) => {}
        }
    }

    fn sampling_s(&self) -> Option<f64> {
        match &self.lead {
            // Nobody watches it.
            Peer::Board(_) => Some(0.1),
            Peer::Live(_) => Some(live::SAMPLING.as_secs_f64()),
            Peer::Nowhere | Peer::Line(_) => None,
        }
    }

    fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        match &mut self.lead {
            Peer::Board(bench) => bench.move_to(at, counts),
            Peer::Live(live) => live.moved(at, counts),
            Peer::Nowhere | Peer::Line(_) => {}
        }
    }

    fn turned(&mut self, counts: &[i64]) {
        match &mut self.lead {
            Peer::Board(bench) => bench.turned(counts),
            Peer::Live(live) => live.turned(counts),
            Peer::Nowhere | Peer::Line(_) => {}
        }
    }
}

/// The program in what has come, if all of it has: from the % in front of its first line to the end of the line with the
/// last one. What a program that was broken off has left in the line stands before; it may end with a % itself.
fn whole(come: &str) -> Option<&str> {
    let mut at = 0;
    let mut before = "";
    let mut begin = None;
    for line in come.split_inclusive('\n') {
        let said = line.trim();
        match begin {
            None if before.ends_with('%') && !matches!(said, "" | "%") => begin = Some(at - 1),
            Some(_) if said == "%" && line.ends_with('\n') => {
                let begin = come[..begin?].rfind('%')?;
                return Some(&come[begin..at + line.len()]);
            }
            _ => {}
        }
        if !said.is_empty() {
            before = said;
        }
        at += line.len();
    }
    None
}

fn read_program(line: &mut dyn ControlLine) -> Result<Option<String>, Problem> {
    let trouble = |error: std::io::Error| Problem::trouble("port", error);
    let next = |line: &mut dyn ControlLine| {
        let mut byte = [0];
        match line.read(&mut byte) {
            Ok(0) => Ok(None),
            Ok(_) => Ok(Some(char::from(byte[0] & 0x7F))),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {
                Ok(None)
            }
            Err(error) => Err(trouble(error)),
        }
    };
    // What still comes is no answer to this READ.
    line.wait(SILENCE).map_err(trouble)?;
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE && next(line)?.is_some() {}
    line.wait(PATIENCE).map_err(trouble)?;
    line.write_all(&[DC1]).map_err(trouble)?;
    line.flush().map_err(trouble)?;
    let mut program = String::new();
    while program.len() < LONGEST
        && let Some(character) = next(line)?
    {
        program.push(character);
        // Looked through where it may have ended, not at each of its lines.
        if character == '\n'
            && program.trim_end().ends_with('%')
            && let Some(whole) = whole(&program)
        {
            return Ok(Some(whole.to_owned()));
        }
    }
    if program.is_empty() {
        Ok(None)
    } else {
        // Half a program is none.
        Err(Problem::trouble(
            "incomplete_program",
            format_args!(
                "the board's program broke off after {} bytes; READ again",
                program.len()
            ),
        ))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::io::{Read, Result, Write};
    use std::time::Duration;

    use super::{ControlLine, DC1, read_program, whole};

    /// A board that sends its program at each DC1.
    struct Board(VecDeque<u8>);

    const PROGRAM: &str = "%\r\nO9010\r\nG10 L2 P2 X1.\r\nM99\r\n%\r\n";

    impl Read for Board {
        fn read(&mut self, into: &mut [u8]) -> Result<usize> {
            self.0.read(into)
        }
    }

    impl Write for Board {
        fn write(&mut self, bytes: &[u8]) -> Result<usize> {
            assert_eq!(bytes, [DC1]);
            self.0.extend(PROGRAM.bytes());
            Ok(1)
        }
        fn flush(&mut self) -> Result<()> {
            Ok(())
        }
    }

    impl ControlLine for Board {
        fn wait(&mut self, _patience: Duration) -> Result<()> {
            Ok(())
        }
    }

    /// A line end that was left in front of the next program's % would make one of it without a word.
    #[test]
    fn each_program_is_read_to_the_end_of_its_last_line() {
        let mut board = Board(VecDeque::new());
        for _ in 0..3 {
            assert_eq!(read_program(&mut board).unwrap().as_deref(), Some(PROGRAM));
            assert!(board.0.is_empty());
        }
        // What waits in the line is of another READ.
        board.0.extend(PROGRAM.replace("O9010", "O9009").bytes());
        assert_eq!(read_program(&mut board).unwrap().as_deref(), Some(PROGRAM));
    }

    /// What comes of a program that was broken off is not taken for the answer: the next READ would get this one's.
    #[test]
    fn what_another_program_has_left_is_no_part_of_the_answer() {
        for rest in [
            "",
            "\r\n",
            "X9.\r\nM99\r\n%\r\n",
            "%\r\n",
            "ECTION)\nM99\n%\n\n",
            "X9.",
        ] {
            let come = format!("{rest}{PROGRAM}");
            assert_eq!(whole(&come), Some(PROGRAM), "{rest:?}");
            for end in 0..come.len() {
                assert_eq!(whole(&come[..end]), None, "{rest:?} {end}");
            }
        }
    }
}
