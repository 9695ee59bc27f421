//! The openumi application: what runs on every board, and in the virtual one.
//!
//! ```text
//! CncRx ─► receive ─► queue ─► measure ─► Ledger: journal, events, armed correction, delivery
//!             │ XON/XOFF/READ │   │ Brain       │                  │
//!             └────────► Line ┼───┼─────► transmit ─► CncTx        └─► serve ◄─► LinkRx/LinkTx
//! LatchSource ─► latch ───────┘   └─► Outputs                          │ │
//!                  ├─► Scans: triggers ────────────────────────────────┘ └─► Axes, Scanner
//! SensorPort ◄─► sense ─► measure: places of a distance sensor
//! serve ◄─► prove: what takes long about a session
//! ```
//!
//! Every arrow is one function or one channel. A board gives its drivers
//! ([`board`]) to [`App::run`], or runs the parts at priorities of its own, the
//! highest first: the drivers' interrupts, then [`App::receive`], [`App::transmit`]
//! and [`App::latch`], then [`App::serve`], then [`App::measure`], whose fits and
//! storage take long, with [`App::supervise`], then [`App::prove`], for which nothing waits but a host.
//!
//! | file | idea |
//! | --- | --- |
//! | [`board`] | what a board provides |
//! | `control` | the control's port: receive, send, the conversation, XOFF, XMODEM |
//! | `host` | the host's port: frames, requests, answers |
//! | `capture` | captures: of touches into the queue, of scans to the host |
//! | [`intake`] | what came in and waits to be measured |
//! | [`measure`] | what the board knows and decides, keeps, tells, delivers; no waiting |
//! | [`sensor`] | a distance sensor: its line, its captures and commands, joined |
//! | `shared` | a lock that tasks of all priorities may wait for |
//! | [`access`] | who may do what: keys, sessions, wiping |
//! | [`replay`] | a journal's inputs through a new brain: the same decisions, bit for bit |
#![no_std]
#![cfg_attr(
    not(test),
    warn(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]
#![allow(
    async_fn_in_trait,
    reason = "boards are used by generic functions only, never as trait objects"
)]

pub mod access;
pub mod board;
mod capture;
mod control;
mod host;
pub mod intake;
pub mod measure;
pub mod replay;
pub mod sensor;
mod shared;
#[cfg(test)]
mod test_board;

use core::cell::Cell;
use core::future::pending;

use embassy_futures::join::{join3, join5};
use embassy_futures::select::{Either, Either6, select, select6};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use umi_core::button::HeldButton;
use umi_core::control::{Conversation, Exchange};
use umi_core::journal::Flash;
use umi_core::trust::access::update::slots::Slots;
use umi_core::units::Micros;
use umi_protocol::job::SendWhen;
use umi_protocol::message::Record;
use umi_protocol::serial::LineSettings;
use umi_protocol::update::{ImageVersion, UpdateState};

use board::{
    Axes, Button, Clock, CncRx, CncTx, LatchSource, LinkRx, LinkTx, Outputs, Scanner, SensorPort,
    Watchdog,
};
use intake::Input;
use measure::{Boot, Instrument, Opened, StorageAreas};
use sensor::PointStation;

pub use host::link::SILENCE_US;
pub use umi_core::control::XOFF_PATIENCE_US;

/// How often the watchdog is fed while measuring answers.
pub const FEED_INTERVAL_US: u64 = 250_000;

/// The application's state, shared by its tasks.
pub struct App<F: Flash> {
    measure: shared::Shared<Instrument<F>>,
    intake: intake::Intake,
    line: control::line::Line,
    scans: capture::scan::Scans,
    /// Who may do what; the host's task has it.
    guarded: shared::Shared<access::Guarded<F>>,
    prover: access::proof::Prover,
    /// The station of a distance sensor, where there is one.
    point: Mutex<CriticalSectionRawMutex, Cell<Option<&'static PointStation>>>,
    /// The board is to start anew.
    restart: Signal<CriticalSectionRawMutex, ()>,
    /// The host has changed something that the outputs and the clock must know.
    config_changed: Signal<CriticalSectionRawMutex, ()>,
    /// There may be something to tell the host.
    events_pending: Signal<CriticalSectionRawMutex, ()>,
}

/// A board's drivers.
pub struct Drivers<Rx, Tx, HostRx, HostTx, Latches, Station, Out, Dog> {
    /// From the control.
    pub cnc_rx: Rx,
    /// To the control.
    pub cnc_tx: Tx,
    /// From the host.
    pub link_rx: HostRx,
    /// To the host.
    pub link_tx: HostTx,
    /// Captures of the axes.
    pub latches: Latches,
    /// The axes now, and the outputs to a scanner.
    pub station: Station,
    /// Outputs to the machine.
    pub outputs: Out,
    /// Resets the board if it hangs.
    pub watchdog: Dog,
}

impl<F: Flash> App<F> {
    /// The application before its start, for a static: all zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            measure: shared::Shared::new(Instrument::new()),
            intake: intake::Intake::new(),
            line: control::line::Line::new(),
            scans: capture::scan::Scans::new(),
            guarded: shared::Shared::new(access::Guarded::new()),
            prover: access::proof::Prover::new(),
            point: Mutex::new(Cell::new(None)),
            restart: Signal::new(),
            config_changed: Signal::new(),
            events_pending: Signal::new(),
        }
    }

    /// Opens the storage and takes up what was in force; before any task runs. What of
    /// the storage could not be opened is returned for a log: the board runs all the
    /// same, see [`Instrument::start`].
    ///
    /// # Errors
    /// [`Running`]: a task has begun already.
    pub fn start(
        &self,
        boot: Boot,
        storage: StorageAreas<F>,
        now: Micros,
    ) -> Result<Opened<F::Error>, Running> {
        let mut measure = self.measure.try_lock().map_err(|_| Running)?;
        let mut guarded = self.guarded.try_lock().map_err(|_| Running)?;
        let mut storage = storage;
        measure.open_custody(storage.custody.take());
        let wipes = guarded.wipes(&measure);
        if wipes {
            storage.erase();
            measure.erase_custody();
        }
        let opened = measure.start(boot, storage, now);
        if wipes {
            guarded.end_wipe(now, &mut measure);
        }
        guarded.compare(now, &mut measure);
        guarded.follow(&measure.ledger.in_custody().config.access);
        measure.take_up(now);
        self.line.note_settings(measure.line());
        Ok(opened)
    }

    /// Guards the board by this, from before [`Self::start`] on. A board that is not guarded is open
    /// for ever.
    ///
    /// # Errors
    /// [`Running`]: a task has begun already.
    pub fn guard(&self, keeper: access::Keeper<F>) -> Result<(), Running> {
        let mut guarded = self.guarded.try_lock().map_err(|_| Running)?;
        guarded.put(keeper);
        Ok(())
    }

    /// Lets the board take images, from before any task runs, where this application can (feature `update`).
    ///
    /// # Errors
    /// [`Running`]: a task has begun already.
    pub fn takes_images(&self, images: Slots<F>) -> Result<(), Running> {
        let mut measure = self.measure.try_lock().map_err(|_| Running)?;
        // There is room for one, or for none.
        let _ = measure.images.push(images);
        Ok(())
    }

    /// Gives the board a station for a distance sensor, from before [`Self::start`] on.
    ///
    /// # Errors
    /// [`Running`]: a task has begun already.
    pub fn senses(&self, station: &'static PointStation) -> Result<(), Running> {
        let mut measure = self.measure.try_lock().map_err(|_| Running)?;
        measure.ledger.point = Some(station);
        self.point.lock(|point| point.set(Some(station)));
        Ok(())
    }

    /// The station of a distance sensor.
    fn point(&self) -> Option<&'static PointStation> {
        self.point.lock(Cell::get)
    }

    /// Joins the captures and readings of a distance sensor, for ever: at a priority above measuring.
    pub async fn sense(&self, port: &mut impl SensorPort, clock: &impl Clock) {
        match self.point() {
            Some(station) => sensor::sense(station, port, clock).await,
            None => pending().await,
        }
    }

    /// Journals that an image of this version was given up, on trial or because it was changed, behind [`Self::start`].
    ///
    /// # Errors
    /// [`Running`]: a task has begun already.
    pub fn tell_reverted(&self, now: Micros, to: ImageVersion) -> Result<(), Running> {
        let mut measure = self.measure.try_lock().map_err(|_| Running)?;
        let Instrument { images, ledger, .. } = &mut *measure;
        let from = images.first_mut().map(|images| images.info().version);
        let (what, from) = (UpdateState::Reverted, from.unwrap_or_default());
        // What is not kept is counted.
        let _ = ledger.record(now, Record::Update { what, from, to });
        Ok(())
    }

    /// Ends the trial of the image that runs if the board works: measuring answers, and the journal keeps
    /// entries. False: it goes on.
    pub async fn confirm(&self, clock: &impl Clock) -> bool {
        let mut measure = self.measure.lock().await;
        let Instrument { images, ledger, .. } = &mut *measure;
        let Some(images) = images.first_mut() else {
            return true;
        };
        let Some((from, to)) = images.trial() else {
            return true;
        };
        let what = UpdateState::Confirmed;
        let record = Record::Update { what, from, to };
        ledger.record(clock.now(), record) && images.confirm().is_ok()
    }

    /// Waits until the board is to start anew: its host has asked for it and has its answer.
    pub async fn restarts(&self) {
        self.restart.wait().await;
    }

    /// How the line to the control is to be set: by the job, once it has been started.
    #[must_use]
    pub fn line(&self) -> LineSettings {
        self.line.settings()
    }

    /// Runs everything, for ever, on one executor.
    pub async fn run(
        &self,
        drivers: Drivers<
            impl CncRx,
            impl CncTx,
            impl LinkRx,
            impl LinkTx,
            impl LatchSource,
            impl Axes + Scanner,
            impl Outputs,
            impl Watchdog,
        >,
        clock: &impl Clock,
    ) {
        let Drivers {
            mut cnc_rx,
            mut cnc_tx,
            mut link_rx,
            mut link_tx,
            mut latches,
            mut station,
            mut outputs,
            mut watchdog,
        } = drivers;
        join5(
            self.receive(&mut cnc_rx, clock),
            self.measure(&mut outputs, clock),
            self.transmit(&mut cnc_tx, clock),
            self.serve(&mut link_rx, &mut link_tx, &mut station, clock),
            join3(
                self.latch(&mut latches, clock),
                self.supervise(&mut watchdog, clock),
                self.prove(),
            ),
        )
        .await;
    }

    /// Receives from the control, for ever.
    pub async fn receive(&self, rx: &mut impl CncRx, clock: &impl Clock) {
        control::receive(self, rx, clock).await;
    }

    /// Sends corrections to the control, for ever.
    pub async fn transmit(&self, tx: &mut impl CncTx, clock: &impl Clock) {
        control::transmit(self, tx, clock).await;
    }

    /// Serves the host, for ever.
    pub async fn serve(
        &self,
        rx: &mut impl LinkRx,
        tx: &mut impl LinkTx,
        station: &mut (impl Axes + Scanner),
        clock: &impl Clock,
    ) {
        host::link::serve(self, rx, tx, station, clock).await;
    }

    /// Does what takes long about sessions, for ever: at a priority below measuring, which must not
    /// wait for it. Only a board with an owner has sessions.
    pub async fn prove(&self) {
        self.prover.run().await;
    }

    /// Measures, for ever.
    pub async fn measure(&self, outputs: &mut impl Outputs, clock: &impl Clock) {
        // The job that was in force before a reset says it, too.
        let measure = self.measure.lock().await;
        self.note(&measure);
        drop(measure);
        let point = self.point();
        // What asks for an answer of the sensor's station that is not there yet.
        let mut asks: Option<Exchange> = None;
        loop {
            let deadline = {
                let measure = self.measure.lock().await;
                // Nothing is signed while something goes out.
                let head = measure.head_deadline().filter(|_| self.line.is_free());
                measure.deadline().into_iter().chain(head).min()
            };
            // Without a deadline the clock's future never comes.
            let due = clock.wait_until(deadline.unwrap_or(Micros(u64::MAX)));
            let sensed = async {
                match point {
                    Some(point) => point.told().await,
                    None => pending().await,
                }
            };
            let others = select6(
                self.line.send_done.wait(),
                self.intake.next(),
                due,
                self.config_changed.wait(),
                self.line.refill_needed.wait(),
                self.line.next(),
            );
            let came = match select(sensed, others).await {
                Either::Second(came) => came,
                Either::First(()) => {
                    if let Some(point) = point {
                        let mut measure = self.measure.lock().await;
                        measure.sensed(clock.now(), point);
                        drop(measure);
                        self.events_pending.signal(());
                        if point.take_answered()
                            && let Some(asked) = asks.take()
                        {
                            self.line.requested.signal(asked);
                        }
                    }
                    continue;
                }
            };
            let mut measure = self.measure.lock().await;
            measure.tell_what_waits(clock.now());
            let before = measure.arming();
            match came {
                Either6::First(sent) => {
                    measure.sent(clock.now(), &sent);
                    self.line.with(|talk| talk.end(clock.now(), sent.whole > 0));
                }
                Either6::Second((time, input)) => {
                    measure.input(time, &input);
                    if measure.is_taken_back() {
                        self.line.with(Conversation::take_back);
                    }
                    if let Input::Bytes(bytes) = &input {
                        if let Some(point) = point
                            && point.control_bytes(bytes)
                        {
                            measure.serves();
                            asks = None;
                        }
                        self.line.on_measured(time, bytes);
                    }
                }
                Either6::Third(()) => measure.on_time(clock.now()),
                // The host has set a job, wants a program, or has passed on more of one.
                Either6::Fourth(())
                    if self.line.is_free()
                        && !measure.brain().run().is_under_way()
                        && measure.ledger.upload.asked() =>
                {
                    self.line.begin(0, Exchange::Receive);
                }
                Either6::Fourth(()) if measure.is_hungry() => self.line.refill_needed.signal(()),
                Either6::Fourth(()) => {}
                // The control waits at the line until the captures are over.
                Either6::Sixth(asked)
                    if asked != Exchange::Verdict && point.is_some_and(PointStation::owes) =>
                {
                    asks = Some(asked);
                }
                Either6::Sixth(asked) => {
                    if let Some(hold_us) = measure.begin(clock.now(), asked) {
                        self.line.begin(hold_us, asked);
                    }
                }
                Either6::Fifth(()) => {
                    if measure.ledger.upload.has_block() {
                        measure.keep_block(clock.now());
                    }
                    let more = measure.fill(clock.now());
                    drop(measure);
                    self.line.refilled.signal(());
                    if more {
                        self.line.refill_needed.signal(());
                        // It may go on for long: others are of this priority, too.
                        yield_now().await;
                    }
                    continue;
                }
            }
            self.note(&measure);
            outputs.show(measure.lights());
            let armed = measure.arming();
            if armed.is_some() && armed != before && measure.waiting() == Some(SendWhen::OnVerdict)
            {
                self.line.requested.signal(Exchange::Verdict);
            }
            self.events_pending.signal(());
            // Behind all that others wait for; and not only when it is due, because a line that
            // is never quiet comes before any time.
            if self.line.is_free() {
                measure.sign_head(clock.now());
            }
        }
    }

    /// Looks at the board's button, for ever: held for a second it asks to teach, as a host may.
    /// At a priority above measuring, whose fits take longer than a press.
    pub async fn button(&self, button: &mut impl Button, clock: &impl Clock) {
        let mut held = HeldButton::new();
        let mut is_due = false;
        loop {
            let now = clock.now();
            is_due |= held.look(now, button.is_pressed());
            // Without room in the queue it waits for the next look.
            is_due = is_due && self.intake.put(now, Input::Held).is_err();
            let next = Micros(now.0.saturating_add(umi_core::button::LOOK_US));
            clock.wait_until(next).await;
        }
    }

    /// Notes what receiving and sending must know of the control.
    fn note(&self, measure: &Instrument<F>) {
        self.line.note_settings(measure.line());
        let is_new = self.line.with(|talk| {
            talk.note_coding(measure.coding());
            talk.throttle.note_handshake(measure.handshake())
        });
        if is_new {
            self.intake.recheck_pressure();
        }
    }

    /// Takes in captures of the axes, for ever. Waits for nothing else.
    pub async fn latch(&self, latches: &mut impl LatchSource, clock: &impl Clock) {
        capture::latch::take(self, latches, clock).await;
    }

    /// Feeds the watchdog as long as measuring answers, for ever. It belongs to the
    /// lowest priority: it is not reached if anything above it spins.
    pub async fn supervise(&self, watchdog: &mut impl Watchdog, clock: &impl Clock) {
        loop {
            drop(self.measure.lock().await);
            watchdog.feed();
            let next = clock.now().0.saturating_add(FEED_INTERVAL_US);
            clock.wait_until(Micros(next)).await;
        }
    }
}

impl<F: Flash> Default for App<F> {
    fn default() -> Self {
        Self::new()
    }
}

/// The application runs already and cannot be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Running;

#[cfg(test)]
mod tests {
    use core::pin::pin;
    use embassy_futures::{block_on, poll_once};

    use super::*;
    use crate::test_board::{Hand, NoFlash};

    /// Counts how often it was fed.
    struct Dog(u32);

    impl Watchdog for &mut Dog {
        fn feed(&mut self) {
            self.0 += 1;
        }
    }

    /// The watchdog is fed as often as promised while measuring answers, not at all while
    /// it does not, and again when it does.
    #[test]
    fn the_watchdog_starves_while_measuring_hangs() {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let mut dog = Dog(0);
        let fed = {
            let mut feeder = &mut dog;
            let mut run = pin!(app.supervise(&mut feeder, &clock));
            for turn in 0..10 {
                clock.set(turn * FEED_INTERVAL_US);
                assert!(poll_once(run.as_mut()).is_pending());
            }
            let hangs = block_on(app.measure.lock());
            for turn in 10..20 {
                clock.set(turn * FEED_INTERVAL_US);
                assert!(poll_once(run.as_mut()).is_pending());
            }
            drop(hangs);
            assert!(poll_once(run.as_mut()).is_pending());
            10 + 1
        };
        assert_eq!(dog.0, fed);
    }
}
