//! The virtual board's drivers: channels between the application in its thread
//! and whoever plays the control and the host.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc::{Receiver, Sender, UnboundedReceiver};
use umi_app::board::{
    Axes, Broken, Button, Clock as _, CncInput, CncRx, CncTx, LatchSource, Lights, LinkRx, LinkTx,
    Outputs, Scanner, SensorLines, SensorPort, SensorTrigger, Unsupported, Watchdog,
};
use umi_app::intake::PIECE;
use umi_protocol::latch::{LatchReport, Positions, TriggerOut, TriggerPulse, TriggerRefusal};
use umi_protocol::serial::LineSettings;

use super::clock::VirtualClock;
use super::pulses::{Pulses, SentPulses};
use super::wire::{Heard, heard};

/// What the control sends.
#[derive(Debug)]
pub(crate) enum FromControl {
    Bytes(Vec<u8>),
    End,
}

/// Bytes from the control, handed over in the pieces in which they were written
/// (as far as the application's buffer takes them): the same capture written in
/// the same pieces always gives the same journal.
pub(crate) struct ControlRx {
    pub incoming: UnboundedReceiver<FromControl>,
    pub rest: Vec<Heard>,
    pub line: Wire,
}

/// The line between control and board, and how the board has set it.
#[derive(Clone)]
pub(crate) struct Wire {
    /// Time that a character takes; zero: none.
    pub character: Duration,
    /// As the board's settings have it instead.
    pub paced_by_job: bool,
    /// How the control's port is set; none: as the board's, always.
    pub control: Arc<Mutex<Option<LineSettings>>>,
    pub board: Rc<Cell<LineSettings>>,
}

impl Wire {
    fn control(&self) -> Option<LineSettings> {
        *self.control.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Time that a character of a port takes.
    fn time_of(&self, port: &LineSettings) -> Duration {
        match self.control() {
            None if !self.paced_by_job => self.character,
            _ => Duration::from_secs(port.bits().into()) / port.baud.max(1),
        }
    }
}

impl CncRx for ControlRx {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        // A line gives the board time between its bytes; so does this one.
        tokio::task::yield_now().await;
        if self.rest.is_empty() {
            match self.incoming.recv().await {
                Some(FromControl::Bytes(bytes)) => {
                    let set = self.line.board.get();
                    let sent = self.line.control().unwrap_or(set);
                    self.rest = heard(&bytes, &sent, &set);
                }
                Some(FromControl::End) => return CncInput::End,
                // Whoever played the control is gone, the port is not.
                None => std::future::pending().await,
            }
        }
        let is_broken = |heard: &&Heard| **heard == Heard::Broken;
        let broken = self.rest.iter().take_while(is_broken).count();
        let most = buffer.len().min(PIECE);
        let whole = self.rest.iter().take(most).take_while(|of| !is_broken(of));
        let count = match broken {
            0 => whole.count(),
            broken => broken,
        };
        let control = self.line.control().unwrap_or(self.line.board.get());
        let character = self.line.time_of(&control);
        if !character.is_zero() {
            tokio::time::sleep(character * u32::try_from(count).unwrap_or(u32::MAX)).await;
        }
        let mut places = buffer.iter_mut();
        for heard in self.rest.drain(..count) {
            if let Heard::Byte(byte) = heard
                && let Some(place) = places.next()
            {
                *place = byte;
            }
        }
        match broken {
            0 => CncInput::Bytes(count),
            _ => CncInput::Lost(u32::try_from(broken).unwrap_or(u32::MAX)),
        }
    }
}

/// Bytes to the control: one on the line and one behind it, as with a UART
/// without FIFO.
pub(crate) struct ControlTx {
    pub outgoing: Sender<u8>,
    pub line: Wire,
}

impl CncTx for ControlTx {
    async fn write(&mut self, byte: u8) -> Result<(), Broken> {
        let set = self.line.board.get();
        let character = self.line.time_of(&set);
        if !character.is_zero() {
            tokio::time::sleep(character).await;
        }
        let control = self.line.control().unwrap_or(set);
        for heard in heard(&[byte], &set, &control) {
            if let Heard::Byte(byte) = heard {
                self.outgoing.send(byte).await.map_err(|_| Broken)?;
            }
        }
        Ok(())
    }

    async fn set_line(&mut self, line: LineSettings) {
        self.line.board.set(line);
    }
}

/// What happens at the host's port.
#[derive(Debug)]
pub(crate) enum FromHost {
    /// A host connects; what is for it goes there.
    Connected(Sender<Vec<u8>>),
    Bytes(Vec<u8>),
    Gone,
}

/// Where bytes for the host go, if there is one.
pub(crate) type ToHost = Rc<RefCell<Option<Sender<Vec<u8>>>>>;

/// Bytes from the host.
pub(crate) struct HostRx {
    pub incoming: UnboundedReceiver<FromHost>,
    pub to_host: ToHost,
    pub rest: Vec<u8>,
}

impl LinkRx for HostRx {
    async fn connected(&mut self) {
        self.rest.clear();
        while self.to_host.borrow().is_none() {
            match self.incoming.recv().await {
                Some(FromHost::Connected(host)) => *self.to_host.borrow_mut() = Some(host),
                // Of a host that is gone already.
                Some(FromHost::Bytes(_) | FromHost::Gone) => {}
                None => std::future::pending().await,
            }
        }
    }

    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
        while self.rest.is_empty() {
            self.more().await?;
        }
        let count = self.rest.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.rest.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    async fn gone(&mut self) {
        while self.more().await.is_ok() {}
    }
}

impl HostRx {
    /// The board starts anew: the connection ends, what was on its way is lost.
    pub fn unplug(&mut self) {
        self.rest.clear();
        *self.to_host.borrow_mut() = None;
    }

    /// Waits for bytes from the host of this connection.
    async fn more(&mut self) -> Result<(), Broken> {
        match self.incoming.recv().await {
            Some(FromHost::Bytes(bytes)) => {
                self.rest.extend(bytes);
                Ok(())
            }
            Some(FromHost::Connected(host)) => {
                *self.to_host.borrow_mut() = Some(host);
                Err(Broken)
            }
            Some(FromHost::Gone) => {
                *self.to_host.borrow_mut() = None;
                Err(Broken)
            }
            None => std::future::pending().await,
        }
    }
}

/// Bytes to the host. Waits while a connected host does not read.
pub(crate) struct HostTx {
    pub to_host: ToHost,
}

impl LinkTx for HostTx {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        let host = self.to_host.borrow().clone().ok_or(Broken)?;
        host.send(bytes.to_vec()).await.map_err(|_| {
            *self.to_host.borrow_mut() = None;
            Broken
        })
    }
}

/// A latch, and whoever waits until it has been taken in: dropping the sender tells.
pub(crate) type Latched = (LatchReport, std::sync::mpsc::Sender<()>);

/// Latches as they are given.
pub(crate) struct Latches {
    pub incoming: Receiver<Latched>,
    /// Waits for the latch before.
    pub waiting: Option<std::sync::mpsc::Sender<()>>,
}

impl LatchSource for Latches {
    async fn next(&mut self) -> LatchReport {
        // Who asks for the next one has taken in the one before.
        self.waiting = None;
        match self.incoming.recv().await {
            Some((latch, waiting)) => {
                self.waiting = Some(waiting);
                latch
            }
            None => std::future::pending().await,
        }
    }
}

/// Outputs that can be looked at.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lamps(Arc<Mutex<Lights>>);

impl Lamps {
    pub fn look(&self) -> Lights {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Outputs for Lamps {
    fn show(&mut self, lights: Lights) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = lights;
    }
}

/// A button that somebody else presses.
#[derive(Clone, Debug, Default)]
pub(crate) struct TeachButton(Arc<AtomicBool>);

impl TeachButton {
    pub fn press(&self, is_pressed: bool) {
        self.0.store(is_pressed, Ordering::Relaxed);
    }
}

impl Button for TeachButton {
    fn is_pressed(&mut self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// What a scanner sees of the board, and where the board sees its axes.
#[derive(Clone, Debug)]
pub(crate) struct Station {
    state: Arc<Mutex<StationState>>,
    clock: VirtualClock,
}

#[derive(Debug, Default)]
struct StationState {
    positions: Positions,
    /// The axes were only seen at the positions, on their way.
    passing: bool,
    pulses: Pulses,
    laser: bool,
}

impl Station {
    pub fn new(clock: VirtualClock) -> Self {
        let state = Arc::default();
        Self { state, clock }
    }

    fn with<T>(&self, work: impl FnOnce(&mut StationState) -> T) -> T {
        work(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The axes are here: from now on, or only at this instant of their way. The trigger
    /// pulses on the way to here.
    pub fn move_to(&self, positions: Positions, passing: bool) -> SentPulses {
        self.with(|state| {
            let latches = state.pulses.between(&state.positions, &positions);
            state.positions = positions;
            state.passing = passing;
            SentPulses {
                latches,
                pulse: state.pulses.pulse(),
            }
        })
    }

    pub fn laser_is_on(&self) -> bool {
        self.with(|state| state.laser)
    }
}

impl Axes for Station {
    fn positions(&mut self) -> Positions {
        let (mut positions, passing) = self.with(|s| (s.positions.clone(), s.passing));
        if passing {
            // Counts belong to their own instant: at any other, a feed would be wrong.
            return positions;
        }
        let now_ns = self.clock.now().0.saturating_mul(1000);
        positions.t_ns = positions.t_ns.max(now_ns);
        positions
    }
}

impl Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal> {
        self.with(|state| state.pulses.ask(when, &state.positions))
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        self.with(|state| state.laser = on);
        Ok(())
    }
}

/// What happens at the sensor's port.
pub(crate) struct SensorEnd {
    pub incoming: UnboundedReceiver<Vec<u8>>,
    pub rest: Vec<u8>,
    pub station: Station,
    pub shown: SensorLamps,
}

/// What a station of a distance sensor shows, and that it triggers.
#[derive(Clone, Debug, Default)]
pub(crate) struct SensorLamps(Arc<Mutex<(SensorLines, bool)>>);

impl SensorLamps {
    fn with<T>(&self, work: impl FnOnce(&mut (SensorLines, bool)) -> T) -> T {
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub fn look(&self) -> (SensorLines, bool) {
        self.with(|of| *of)
    }
}

impl Axes for SensorEnd {
    fn positions(&mut self) -> Positions {
        self.station.positions()
    }
}

impl SensorPort for SensorEnd {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        // A line gives the board time between its bytes; so does this one.
        tokio::task::yield_now().await;
        while self.rest.is_empty() {
            match self.incoming.recv().await {
                Some(bytes) => self.rest = bytes,
                None => std::future::pending().await,
            }
        }
        let count = self.rest.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.rest.drain(..count)) {
            *place = byte;
        }
        CncInput::Bytes(count)
    }

    fn set_baud(&mut self, _: u32) {}

    fn trigger(&mut self, when: SensorTrigger, pulse: TriggerPulse) -> Result<(), TriggerRefusal> {
        let asked = self.station.with(|state| match when {
            SensorTrigger::Off => state.pulses.ask(TriggerOut::Off, &state.positions),
            SensorTrigger::Every { interval_us } => {
                let when = TriggerOut::Time { interval_us, pulse };
                state.pulses.ask(when, &state.positions)
            }
            SensorTrigger::Lines {
                axis,
                origin_counts,
                interval_counts,
            } => {
                let when = TriggerOut::Distance {
                    axis,
                    interval_counts,
                    pulse,
                };
                state.pulses.ask_from(when, origin_counts, &state.positions)
            }
        });
        if asked.is_err() {
            // None from now on.
            let off =
                |state: &mut StationState| state.pulses.ask(TriggerOut::Off, &state.positions);
            self.station.with(off)?;
        }
        self.shown
            .with(|of| of.1 = asked.is_ok() && when != SensorTrigger::Off);
        asked
    }

    fn show(&mut self, lines: SensorLines) {
        self.shown.with(|of| of.0 = lines);
    }
}

/// A thread that hangs is seen by whoever waits for it.
pub(crate) struct NoWatchdog;

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}
