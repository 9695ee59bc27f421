//! The virtual machine's wires and where they lead: a virtual board, a board's serial
//! port, or nowhere.

use std::io::{ErrorKind, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serialport::SerialPort;
use umi_core::units::Micros;
use umi_virtual::machine::Wires;

use crate::capture::{self, Bench, Decision};
use crate::failure::Failure;
use crate::live::{self, Live};

/// The control's READ: it asks with DC1.
const DC1: u8 = 0x11;

/// How long a board may think before it sends a program.
const PATIENCE: Duration = Duration::from_secs(5);

/// Where the wires lead.
pub enum Lead {
    /// Nowhere: text is shown and that is all.
    Nowhere,
    /// To a virtual board: serial line, skip line and encoders.
    Board(Box<Bench>),
    /// To a virtual board that others watch, as fast as a machine is.
    Live(Box<Live>),
    /// To a serial port: the serial line alone.
    Line(Box<dyn Line>),
}

/// A serial line of this computer.
pub trait Line: std::io::Read + std::io::Write {}

impl Line for Box<dyn SerialPort> {}
impl Line for TcpStream {}

/// The machine's end of the wires.
pub struct Wiring {
    lead: Lead,
    events: Vec<Event>,
    /// The first trouble: a machine's wire cannot report one.
    failure: Option<Failure>,
}

/// What happened on the wires, in its order.
#[derive(Clone, Debug)]
pub enum Event {
    /// The control sent bytes; when the last of them had gone.
    Serial(Micros, Vec<u8>),
    /// The skip line rose, with the encoders' counts.
    Skip(Micros, [i64; 3]),
    /// The board decided.
    Decision(Box<Decision>),
}

impl Wiring {
    /// Wires that lead there.
    #[must_use]
    pub fn new(lead: Lead) -> Self {
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
    pub fn to_port(address: &str, baud: u32) -> Result<Self, Failure> {
        let trouble = |error: &dyn std::fmt::Display| {
            Failure::trouble("port", format_args!("{address}: {error}"))
        };
        let line: Box<dyn Line> = match address.strip_prefix("tcp://") {
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
        Ok(Self::new(Lead::Line(line)))
    }

    /// What has happened since the last call.
    ///
    /// # Errors
    /// The first trouble on the wires.
    pub fn take(&mut self) -> Result<Vec<Event>, Failure> {
        match self.failure.take() {
            Some(failure) => Err(failure),
            None => Ok(std::mem::take(&mut self.events)),
        }
    }

    /// The virtual board, if the wires lead to one.
    pub fn bench(&mut self) -> Option<&mut Bench> {
        match &mut self.lead {
            Lead::Board(bench) => Some(bench),
            Lead::Nowhere | Lead::Live(_) | Lead::Line(_) => None,
        }
    }

    /// The virtual board alone, if the wires lead to one.
    #[must_use]
    pub fn into_bench(self) -> Option<Bench> {
        match self.lead {
            Lead::Board(bench) => Some(*bench),
            Lead::Nowhere | Lead::Live(_) | Lead::Line(_) => None,
        }
    }

    /// The control's READ: the program that the board sends, up to its closing `%`.
    /// None if none comes.
    ///
    /// # Errors
    /// The line's.
    pub fn read_program(&mut self) -> Result<Option<String>, Failure> {
        match &mut self.lead {
            Lead::Nowhere => Ok(None),
            Lead::Board(bench) => bench.read_program(),
            Lead::Live(live) => Ok(capture::read_program(live.board(), PATIENCE)),
            Lead::Line(line) => read_program(line.as_mut()),
        }
    }

    fn try_to(
        &mut self,
        what: impl FnOnce(&mut Lead, &mut dyn FnMut(Event)) -> Result<(), Failure>,
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
            keep(Event::Serial(at, bytes.to_vec()));
            match lead {
                Lead::Nowhere => Ok(()),
                Lead::Board(bench) => {
                    bench.advance(at);
                    bench.play(bytes, |decision| {
                        keep(Event::Decision(Box::new(decision)));
                        Ok(())
                    })
                }
                Lead::Live(live) => {
                    live.serial(at, bytes);
                    Ok(())
                }
                Lead::Line(line) => line
                    .write_all(bytes)
                    .and_then(|()| line.flush())
                    .map_err(|error| Failure::trouble("port", error)),
            }
        });
    }

    fn skip(&mut self, at: Micros, counts: [i64; 3]) {
        self.try_to(|lead, keep| {
            keep(Event::Skip(at, counts));
            match lead {
                Lead::Board(bench) => bench.latch(at, counts),
                Lead::Live(live) => {
                    live.skip(at, counts);
                    Ok(())
                }
                Lead::Nowhere | Lead::Line(_) => Ok(()),
            }
        });
    }

    fn time(&mut self, now: Micros) {
        match &mut self.lead {
            Lead::Board(bench) => bench.advance(now),
            Lead::Live(live) => {
                live.wait_until(now);
            }
            Lead::Nowhere | Lead::Line(_) => {}
        }
    }

    fn sampling_s(&self) -> Option<f64> {
        match &self.lead {
            // Nobody watches it.
            Lead::Board(_) => Some(0.1),
            Lead::Live(_) => Some(live::SAMPLING.as_secs_f64()),
            Lead::Nowhere | Lead::Line(_) => None,
        }
    }

    fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        match &mut self.lead {
            Lead::Board(bench) => bench.move_to(at, counts),
            Lead::Live(live) => live.moved(at, counts),
            Lead::Nowhere | Lead::Line(_) => {}
        }
    }
}

fn read_program(line: &mut dyn Line) -> Result<Option<String>, Failure> {
    let trouble = |error: std::io::Error| Failure::trouble("port", error);
    line.write_all(&[DC1]).map_err(trouble)?;
    line.flush().map_err(trouble)?;
    let mut program = String::new();
    let deadline = Instant::now() + PATIENCE;
    let mut byte = [0];
    while Instant::now() < deadline {
        match line.read(&mut byte) {
            Ok(0) => break,
            Ok(_) => program.push(char::from(byte[0] & 0x7F)),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {
                break;
            }
            Err(error) => return Err(trouble(error)),
        }
        if program.len() > 2 && program.trim_end().ends_with("\n%") {
            return Ok(Some(program));
        }
    }
    if program.is_empty() {
        Ok(None)
    } else {
        // Half a program is none.
        Err(Failure::trouble(
            "incomplete_program",
            format_args!(
                "the board's program broke off after {} bytes; READ again",
                program.len()
            ),
        ))
    }
}
