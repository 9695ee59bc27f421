//! The line to the control: the conversation, and what its tasks wait for.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use umi_core::control::xmodem::CAN;
use umi_core::control::{BlockAnswer, Conversation, Exchange};
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::serial::LineSettings;

use crate::board::Clock;
use crate::measure::delivery::Sent;

/// Bytes of XMODEM that wait, at most: a block, while the one before is written.
const ANSWERS: usize = 160;

/// The conversation, shared by receiving, sending and measuring.
pub(crate) struct Line {
    talk: Mutex<CriticalSectionRawMutex, RefCell<Conversation>>,
    /// The control said XOFF: what sending looks at before each byte.
    stopped: AtomicBool,
    /// The control said XON while it was stopped.
    pub resumed: Signal<CriticalSectionRawMutex, ()>,
    /// There is room for more of what is being sent.
    pub refill_needed: Signal<CriticalSectionRawMutex, ()>,
    /// There is more of it, or it was worked on.
    pub refilled: Signal<CriticalSectionRawMutex, ()>,
    /// A transmission is to begin.
    pub requested: Signal<CriticalSectionRawMutex, Exchange>,
    /// What became of it, for the journal.
    pub send_done: Signal<CriticalSectionRawMutex, Sent>,
    /// A transmission begins; how long the control may hold the line of it.
    pub send_started: Signal<CriticalSectionRawMutex, u64>,
    /// What the control says to blocks.
    pub answers: Channel<CriticalSectionRawMutex, u8, ANSWERS>,
    /// How the line is to be set.
    settings: Mutex<CriticalSectionRawMutex, RefCell<ZeroOption<LineSettings>>>,
    /// It is to be set otherwise than it is.
    pub changed: Signal<CriticalSectionRawMutex, ()>,
}

impl Line {
    pub const fn new() -> Self {
        Self {
            talk: Mutex::new(RefCell::new(Conversation::new())),
            stopped: AtomicBool::new(false),
            resumed: Signal::new(),
            refill_needed: Signal::new(),
            refilled: Signal::new(),
            requested: Signal::new(),
            send_done: Signal::new(),
            send_started: Signal::new(),
            answers: Channel::new(),
            settings: Mutex::new(RefCell::new(ZeroOption::empty())),
            changed: Signal::new(),
        }
    }

    /// Uses the conversation, for a moment.
    pub fn with<T>(&self, work: impl FnOnce(&mut Conversation) -> T) -> T {
        self.talk.lock(|talk| {
            let talk = &mut *talk.borrow_mut();
            let done = work(talk);
            self.stopped.store(talk.is_stopped(), Ordering::Relaxed);
            done
        })
    }

    /// How the line is set, or is to be as soon as nothing is on its way.
    pub fn settings(&self) -> LineSettings {
        self.settings
            .lock(|of| of.borrow().get().copied())
            .unwrap_or_default()
    }

    /// The line is to be set like this.
    pub fn note_settings(&self, line: LineSettings) {
        if self.settings() != line {
            self.settings.lock(|of| of.borrow_mut().put(line));
            self.changed.signal(());
        }
    }

    /// Whether the control said XOFF.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Handles a byte of the control. Returns whether it is text.
    pub fn on_byte(&self, byte: u8) -> bool {
        let reaction = self.with(|talk| talk.on_byte(byte));
        match reaction.answer {
            BlockAnswer::None => {}
            BlockAnswer::Byte => {
                // More than there is room for is more than was asked.
                let _ = self.answers.try_send(byte);
            }
            BlockAnswer::Cancel => self.cancel(),
        }
        if reaction.resumes {
            self.resumed.signal(());
        }
        reaction.is_text
    }

    /// Looks for a request in what has been measured.
    pub fn on_measured(&self, time: Micros, bytes: &[u8]) {
        if let Some(asked) = self.with(|talk| talk.on_measured(time, bytes)) {
            self.requested.signal(asked);
        }
    }

    /// Waits for a request while nothing is on its way.
    pub async fn next(&self) -> Exchange {
        if !self.with(|talk| talk.is_idle()) {
            // Woken by the end of that one.
            core::future::pending::<()>().await;
        }
        self.requested.wait().await
    }

    /// Begins a transmission.
    pub fn begin(&self, hold_us: u64, exchange: Exchange) {
        self.answers.clear();
        self.with(|talk| talk.begin(hold_us, exchange));
        self.resumed.reset();
        self.refilled.reset();
        self.send_started.signal(hold_us);
    }

    /// Ends the blocks, as if the control had.
    pub fn cancel(&self) {
        for _ in 0..2 {
            let _ = self.answers.try_send(CAN);
        }
    }

    /// Whether nothing is on its way, and nothing has asked.
    pub fn is_free(&self) -> bool {
        self.with(|talk| talk.is_idle()) && !self.requested.signaled()
    }
}

pub(crate) fn after(clock: &impl Clock, us: u64) -> Micros {
    Micros(clock.now().0.saturating_add(us))
}

/// Waits as long as a control may hold the line.
pub(crate) async fn patience(clock: &impl Clock, hold_us: u64) {
    clock.wait_until(after(clock, hold_us)).await;
}
