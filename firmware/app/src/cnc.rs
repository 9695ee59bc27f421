//! The control's port: receiving, and sending the correction, or what stands for it.
//!
//! # Design
//!
//! Receiving waits for nothing: bytes are stamped and put into a bounded queue;
//! what finds no room is counted, and the count takes the lost bytes' place in
//! the queue. A control that obeys XON and XOFF is held before that (`hold`); no other is.
//!
//! Sending goes byte by byte, and before each byte looks whether the control
//! said XOFF. A control takes ten characters after its XOFF at most; here at most
//! the byte at the driver and the one behind it still go out.
//!
//! DC1 (XON) means two things: "go on" while a program is being sent, and
//! "send me the program" (READ) otherwise. "Go on" is obeyed at once; a READ takes
//! its turn in the queue, behind what the control said before it.
//!
//! A READ always gets a program, if the job sends any and its control knows macros (see
//! [`umi_core::nc::alarm`]): the correction of the latest OK
//! verdict, or one under the same number that raises an alarm. So an old correction that
//! stands in the control's memory is replaced before it can run for another clamping. An
//! XON soon after an XOFF may be a "go on" that came when all was sent: that gets the
//! correction if there is one, and no alarm.
//!
//! A NAK where nothing is being sent asks for the program by XMODEM (`xmodem`): it gets the
//! program that was asked for by its number, or the correction, and nothing if there is
//! neither. Noise and alarms of other controls are NAKs, too: until the first block has been
//! acknowledged, what comes is text as ever, and whatever else it says ends the blocks.
//!
//! # Limitations
//!
//! In EIA 0x13 is the digit 3, and only 0x93 is XOFF. Until EIA has been detected,
//! 0x13 counts as XOFF: it stops nothing but a correction that is being sent.
//!
//! A READ that comes before its verdict gets the alarm; the control reads again.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use umi_core::journal::Flash;
use umi_core::units::Micros;
use umi_core::xmodem::{ACK, CAN, NAK};
use umi_protocol::message::MAX_BYTES;
use umi_protocol::pattern::Coding;

use crate::App;
use crate::board::{Clock, CncInput, CncRx, CncTx};
use crate::delivery::{Next, Sent};
use crate::hold::{Hold, meanwhile, say};
use crate::measure::Input;
use crate::xmodem;

pub(crate) const XON: u8 = 0x11;
pub(crate) const XOFF: u8 = 0x13;
/// Set by parity in DC codes: in XOFF by even, in XON by odd parity.
pub(crate) const PARITY: u8 = 0x80;
/// What a Fanuc remote buffer says behind XOFF when it is reset, as it says NAK when it has an
/// alarm: it will not go on. In EIA both are digits.
const SYN: u8 = 0x16;
/// Bytes of XMODEM that wait, at most: a block, while the one before is written.
const ANSWERS: usize = 160;

/// A control that does not say XON again for this long has given up: a program of
/// a few hundred bytes fits its buffer. The next DC1 is then a new READ and gets the
/// program from its beginning, never the rest of an old one. A stored program says for
/// itself how much longer it may be held.
pub const XOFF_PATIENCE_US: u64 = 5_000_000;

/// Why a program is to go out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ask {
    /// A verdict has armed a correction that goes out by itself.
    Verdict,
    /// The control reads.
    Read,
    /// The control reads, or goes on with what was sent already.
    Again,
    /// The control reads by XMODEM.
    Xmodem,
    /// The host wants what the control sends by XMODEM.
    Receive,
}

/// The state of the line between receiving and sending.
pub(crate) struct Flow {
    /// The control said XOFF.
    stopped: AtomicBool,
    /// Something is being sent, or received by XMODEM.
    sending: AtomicBool,
    /// The control writes EIA, where 0x13 is a digit.
    eia: AtomicBool,
    /// What holds the control.
    pub hold: Hold,
    /// The control said XON while it was stopped.
    resumed: Signal<CriticalSectionRawMutex, ()>,
    /// When the control said XOFF and not XON since, as it comes out of the queue. Zero:
    /// it did not.
    held: Mutex<CriticalSectionRawMutex, Cell<u64>>,
    /// The control said while it was stopped that it will not go on.
    is_given_up: AtomicBool,
    /// What is on its way was taken back.
    is_taken_back: AtomicBool,
    /// When the last program ended.
    ended: Mutex<CriticalSectionRawMutex, Cell<u64>>,
    /// How long a control may hold the line of what was sent last.
    hold_us: Mutex<CriticalSectionRawMutex, Cell<u64>>,
    /// There is room for more of what is being sent.
    pub hungry: Signal<CriticalSectionRawMutex, ()>,
    /// There is more of it, or it was worked on.
    pub filled: Signal<CriticalSectionRawMutex, ()>,
    /// A program is to go out now.
    pub go: Signal<CriticalSectionRawMutex, Ask>,
    /// What became of it, for the journal.
    pub sent: Signal<CriticalSectionRawMutex, Sent>,
    /// A program begins; how long the control may hold the line of it.
    begun: Signal<CriticalSectionRawMutex, u64>,
    /// What comes from the control answers blocks of XMODEM: it is neither text nor flow
    /// control.
    is_xmodem: AtomicBool,
    is_receiving: AtomicBool,
    /// The control has acknowledged a block: it does know them.
    is_acknowledged: AtomicBool,
    /// Bytes that came meanwhile and may have been something else.
    pub diverted: AtomicU32,
    pub answers: Channel<CriticalSectionRawMutex, u8, ANSWERS>,
}

impl Flow {
    pub const fn new() -> Self {
        Self {
            stopped: AtomicBool::new(false),
            sending: AtomicBool::new(false),
            eia: AtomicBool::new(false),
            hold: Hold::new(),
            resumed: Signal::new(),
            held: Mutex::new(Cell::new(0)),
            is_given_up: AtomicBool::new(false),
            is_taken_back: AtomicBool::new(false),
            ended: Mutex::new(Cell::new(0)),
            hold_us: Mutex::new(Cell::new(0)),
            hungry: Signal::new(),
            filled: Signal::new(),
            go: Signal::new(),
            sent: Signal::new(),
            begun: Signal::new(),
            is_xmodem: AtomicBool::new(false),
            is_receiving: AtomicBool::new(false),
            is_acknowledged: AtomicBool::new(false),
            diverted: AtomicU32::new(0),
            answers: Channel::new(),
        }
    }

    /// Notes the code in which the control writes.
    pub fn note_coding(&self, coding: Coding) {
        self.eia.store(coding == Coding::Eia, Ordering::Relaxed);
        self.hold.note_coding(coding);
    }

    fn is_xoff(&self, byte: u8) -> bool {
        let digit = byte == XOFF && self.eia.load(Ordering::Relaxed);
        byte & !PARITY == XOFF && !digit
    }

    /// A program is to go out now, and none is on its way.
    pub async fn next(&self) -> Ask {
        if self.sending.load(Ordering::Relaxed) {
            // Woken by the end of that one.
            core::future::pending::<()>().await;
        }
        self.go.wait().await
    }

    /// A program begins to go out. Who asks for it can take it; an XOFF from before was
    /// for nobody.
    pub fn begin(&self, hold_us: u64, asked: Ask) {
        self.answers.clear();
        self.diverted.store(0, Ordering::Relaxed);
        let is_receiving = asked == Ask::Receive;
        self.is_receiving.store(is_receiving, Ordering::Relaxed);
        self.is_acknowledged.store(false, Ordering::Relaxed);
        self.is_xmodem
            .store(is_receiving || asked == Ask::Xmodem, Ordering::Relaxed);
        self.hold_us.lock(|hold| hold.set(hold_us));
        self.is_given_up.store(false, Ordering::Relaxed);
        self.sending.store(true, Ordering::Relaxed);
        if asked != Ask::Verdict {
            self.stopped.store(false, Ordering::Relaxed);
        }
        self.resumed.reset();
        self.filled.reset();
        self.begun.signal(hold_us);
    }

    /// It is in the journal: the next may begin.
    pub fn end(&self, now: Micros, whole: bool) {
        if whole {
            // What was held to its end is not held any more.
            self.hold_us.lock(|hold| hold.set(0));
        }
        self.is_taken_back.store(false, Ordering::Relaxed);
        self.ended.lock(|ended| ended.set(now.0));
        self.is_xmodem.store(false, Ordering::Relaxed);
        self.sending.store(false, Ordering::Relaxed);
    }

    /// Looks at a byte from the control.
    fn see(&self, byte: u8) {
        let is_stopped = self.stopped.load(Ordering::Relaxed);
        let is_eia = self.eia.load(Ordering::Relaxed);
        if is_stopped && !is_eia && matches!(byte & !PARITY, NAK | SYN) {
            self.is_given_up.store(true, Ordering::Relaxed);
            self.stopped.store(false, Ordering::Relaxed);
            self.resumed.signal(());
        } else if self.is_xoff(byte) {
            self.stopped.store(true, Ordering::Relaxed);
        } else if byte & !PARITY == XON {
            self.stopped.store(false, Ordering::Relaxed);
            self.resumed.signal(());
        }
    }

    /// Looks at a byte while blocks go out or come in. Whether it is also what it would be
    /// otherwise.
    fn divert(&self, byte: u8) -> bool {
        let is_receiving = self.is_receiving.load(Ordering::Relaxed);
        let is_answer = matches!(byte, ACK | NAK | CAN);
        if !is_receiving && byte == ACK {
            self.is_acknowledged.store(true, Ordering::Relaxed);
        }
        let is_known = is_receiving || self.is_acknowledged.load(Ordering::Relaxed);
        if is_known && (is_receiving || !is_answer) {
            let diverted = self.diverted.load(Ordering::Relaxed);
            self.diverted
                .store(diverted.saturating_add(1), Ordering::Relaxed);
        }
        if is_known || is_answer {
            // More than there is room for is more than was asked.
            let _ = self.answers.try_send(byte);
        } else {
            // No control that waits for blocks says this.
            self.is_xmodem.store(false, Ordering::Relaxed);
            self.is_given_up.store(true, Ordering::Relaxed);
            self.cancel();
        }
        // CAN is a character in no code.
        !is_known && byte != CAN
    }

    /// Ends the blocks, as if the control had.
    pub fn cancel(&self) {
        for _ in 0..2 {
            let _ = self.answers.try_send(CAN);
        }
    }

    /// What is on its way was taken back by a line: a DC1 behind that is a READ.
    pub fn take_back(&self) {
        self.is_taken_back.store(true, Ordering::Relaxed);
        self.held.lock(|held| held.set(0));
    }

    /// Whether nothing is on its way, and nothing has asked.
    pub fn is_free(&self) -> bool {
        !self.sending.load(Ordering::Relaxed) && !self.go.signaled()
    }

    /// Whether what comes is for something that is on its way.
    fn is_busy(&self) -> bool {
        let is_over =
            self.is_taken_back.load(Ordering::Relaxed) || self.is_given_up.load(Ordering::Relaxed);
        self.sending.load(Ordering::Relaxed) && !is_over
    }

    /// Looks for a READ in bytes that have been measured: what they say comes
    /// before it. The last of them came at this time.
    pub fn look_for_read(&self, time: Micros, bytes: &[u8]) {
        for byte in bytes {
            let is_eia = self.eia.load(Ordering::Relaxed);
            if matches!(*byte & !PARITY, NAK | SYN) && !is_eia {
                // Behind XOFF, and until what it was said of has ended, it gives up.
                let gives_up = self.held.lock(|held| held.replace(0)) > 0
                    || self.ended.lock(Cell::get) >= time.0;
                if *byte == NAK && !gives_up && !self.is_busy() {
                    self.go.signal(Ask::Xmodem);
                }
            } else if self.is_xoff(*byte) {
                self.held.lock(|held| held.set(time.0.max(1)));
            } else if byte & !PARITY == XON {
                let since = self.held.lock(|held| held.replace(0));
                let hold_us = self.hold_us.lock(Cell::get).max(XOFF_PATIENCE_US);
                let soon = since > 0 && time.0.saturating_sub(since) < hold_us;
                if !self.is_busy() {
                    self.go.signal(if soon { Ask::Again } else { Ask::Read });
                }
            }
        }
    }
}

/// Receives for ever.
pub(crate) async fn receive<F: Flash>(app: &App<F>, rx: &mut impl CncRx, clock: &impl Clock) -> ! {
    loop {
        let mut buffer = [0; MAX_BYTES];
        match rx.read(&mut buffer).await {
            CncInput::Bytes(count) => {
                let bytes = buffer.get(..count).unwrap_or_default();
                if app.flow.is_xmodem.load(Ordering::Relaxed) {
                    for byte in bytes {
                        let is_xmodem = app.flow.is_xmodem.load(Ordering::Relaxed);
                        if !is_xmodem || app.flow.divert(*byte) {
                            app.flow.see(*byte);
                            app.intake.bytes(clock.now(), &[*byte]);
                        }
                    }
                    continue;
                }
                bytes.iter().for_each(|byte| app.flow.see(*byte));
                app.intake.bytes(clock.now(), bytes);
            }
            CncInput::Lost(count) => app.intake.lost(clock.now(), count),
            // Only a captured file ends, and it can wait.
            CncInput::End => {
                let end = app.intake.put_when_there_is_room(clock.now(), Input::End);
                end.await;
            }
        }
    }
}

/// Sends what the control may have, for ever.
pub(crate) async fn transmit<F: Flash>(app: &App<F>, tx: &mut impl CncTx, clock: &impl Clock) -> ! {
    loop {
        let hold_us = meanwhile(app, tx, app.flow.begun.wait()).await;
        let sent = if app.flow.is_receiving.load(Ordering::Relaxed) {
            xmodem::receive(app, tx, clock).await
        } else if app.flow.is_xmodem.load(Ordering::Relaxed) {
            xmodem::send(app, tx, clock).await
        } else {
            send(app, tx, clock, hold_us).await
        };
        if app.flow.is_xmodem.load(Ordering::Relaxed) && sent.whole == 0 {
            // They may have been lines: what was measured before does not hold any more.
            let diverted = app.flow.diverted.load(Ordering::Relaxed);
            if diverted > 0 {
                app.intake.lost(clock.now(), diverted);
            }
        }
        // The journal is written where it takes least from others. A READ that comes
        // meanwhile waits: the correction may be gone.
        app.flow.sent.signal(sent);
    }
}

/// Sends what has begun, to its end or as far as it may and can.
async fn send<F: Flash>(
    app: &App<F>,
    tx: &mut impl CncTx,
    clock: &impl Clock,
    hold_us: u64,
) -> Sent {
    let mut sent = Sent {
        bytes: 0,
        whole: 0,
        is_held: 0,
    };
    let mut give_up = after(clock, hold_us);
    loop {
        if app.flow.stopped.load(Ordering::Relaxed) {
            let resumed = select(app.flow.resumed.wait(), patience(clock, hold_us));
            // Controls say XOFF behind the last %.
            let is_over = meanwhile(app, tx, app.measure.lock()).await.is_all_out()
                || matches!(meanwhile(app, tx, resumed).await, Either::Second(()));
            if is_over {
                let is_all_out = meanwhile(app, tx, app.measure.lock()).await.is_all_out();
                sent.whole = is_all_out.into();
                sent.is_held = (!is_all_out).into();
                break;
            }
            continue;
        }
        if app.flow.is_given_up.load(Ordering::Relaxed) {
            break;
        }
        let (next, is_hungry) = {
            let mut measure = meanwhile(app, tx, app.measure.lock()).await;
            if app.flow.stopped.load(Ordering::Relaxed) {
                continue;
            }
            (measure.next_byte(), measure.is_hungry())
        };
        if is_hungry {
            app.flow.hungry.signal(());
        }
        match next {
            Next::End { whole } => {
                sent.whole = whole.into();
                break;
            }
            Next::Wait | Next::WaitForHost => {
                if next == Next::Wait {
                    // The board is at work itself.
                    give_up = after(clock, hold_us);
                }
                let filled = select(app.flow.filled.wait(), clock.wait_until(give_up));
                let waited = meanwhile(app, tx, filled).await;
                if matches!(waited, Either::Second(())) {
                    // The host hangs; the machine stands somewhere in what it has got.
                    sent.is_held = 1;
                    break;
                }
            }
            Next::Byte(byte) => {
                // CTS may hold the driver as XOFF holds us.
                let write = async {
                    say(app, tx).await;
                    tx.write(byte).await
                };
                let written = select(write, patience(clock, hold_us)).await;
                if !matches!(written, Either::First(Ok(()))) {
                    sent.is_held = 1;
                    break;
                }
                sent.bytes += 1;
                give_up = after(clock, hold_us);
            }
        }
    }
    sent
}

fn after(clock: &impl Clock, us: u64) -> Micros {
    Micros(clock.now().0.saturating_add(us))
}

/// Waits as long as a control may hold the line.
pub(crate) async fn patience(clock: &impl Clock, hold_us: u64) {
    clock.wait_until(after(clock, hold_us)).await;
}
