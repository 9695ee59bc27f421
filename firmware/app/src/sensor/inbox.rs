//! What the tasks leave for the station, and the station for them.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use heapless::Deque;
use umi_core::point::station::{
    CommandAnswer, CommandFault, CommandLine, SensorCommand, StationCounters, StationRecord,
};
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_protocol::point_sensor::{
    CapturedAt, SensorLoss, SensorOnBoard, SensorRefusal, SensorStatus, StationAnswer,
};

use crate::board::SensorLines;

/// Captures that wait for the station: 3.5 ms at 9000 a second.
const LATCHES: usize = 32;

/// Lines that wait: a control sends the next one when it has its answer.
const LINES: usize = 4;

/// Records that wait for the journal.
const RECORDS: usize = 8;

/// A command as it was read.
pub(super) type ReadLine = Result<(u16, SensorCommand), CommandFault>;

/// A capture of the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Capture {
    pub counts: [i64; 3],
    pub t_ns: u64,
    /// Edges before it that were not captured.
    pub missed: u32,
}

/// The next thing for the station to do, in its order.
#[derive(Debug)]
pub(super) enum Task {
    /// Another sensor, or none.
    Begin(Option<SensorOnBoard>),
    Capture(Capture),
    Line(ReadLine),
}

/// Where a board's second port meets the rest of it: for a static of the board's, given to
/// [`crate::App::senses`].
pub struct PointStation {
    state: Mutex<CriticalSectionRawMutex, RefCell<Inbox>>,
    /// There is something for the station.
    came: Signal<CriticalSectionRawMutex, ()>,
    /// There is something for the journal or for the control.
    told: Signal<CriticalSectionRawMutex, ()>,
}

struct Inbox {
    sensor: ZeroOption<SensorOnBoard>,
    /// Why the one that was set up is not in force.
    setup_lost: ZeroOption<SensorLoss>,
    /// The station has not begun with it yet.
    is_new: bool,
    line: CommandLine,
    lines: Deque<ReadLine, LINES>,
    latches: Deque<Capture, LATCHES>,
    /// Captures that found no room.
    missed: u32,
    /// The number of the line that waits for its answer, and whether a control is to be served it.
    waits_for: ZeroOption<u16>,
    is_served: bool,
    answer: ZeroOption<CommandAnswer>,
    /// The answer has not been told yet.
    is_answered: bool,
    records: Deque<(Micros, StationRecord), RECORDS>,
    /// Records that found no room.
    dropped: u32,
    /// Characters of the sensor that were lost and are not told yet.
    lost_characters: u32,
    counters: StationCounters,
    lines_shown: SensorLines,
    is_triggering: bool,
}

/// What there is to journal.
#[derive(Debug)]
pub(crate) enum Told {
    Record(Micros, StationRecord),
    /// So many records found no room.
    Dropped(u32),
    /// So many characters of the sensor were lost.
    Characters(u32),
}

impl PointStation {
    /// No sensor: all zeros but a few bytes.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: Mutex::new(RefCell::new(Inbox {
                sensor: ZeroOption::empty(),
                setup_lost: ZeroOption::empty(),
                is_new: false,
                line: CommandLine::new(),
                lines: Deque::new(),
                latches: Deque::new(),
                missed: 0,
                waits_for: ZeroOption::empty(),
                is_served: false,
                answer: ZeroOption::empty(),
                is_answered: false,
                records: Deque::new(),
                dropped: 0,
                lost_characters: 0,
                counters: StationCounters {
                    paired: 0,
                    lost: 0,
                    unpaired: 0,
                    unreadable: 0,
                },
                lines_shown: SensorLines::REST,
                is_triggering: false,
            })),
            came: Signal::new(),
            told: Signal::new(),
        }
    }

    fn with<T>(&self, work: impl FnOnce(&mut Inbox) -> T) -> T {
        self.state.lock(|state| work(&mut state.borrow_mut()))
    }

    // --- From who sets it up

    /// The sensor in force.
    pub(crate) fn sensor(&self) -> Option<SensorOnBoard> {
        self.with(|of| of.sensor.get().copied())
    }

    /// Puts a sensor in force, or none. What was under way is given up.
    pub(crate) fn set(&self, sensor: Option<SensorOnBoard>) {
        self.with(|of| {
            match sensor {
                Some(sensor) => of.sensor.put(sensor),
                None => of.sensor.clear(),
            }
            of.setup_lost.clear();
            of.is_new = true;
            of.lines.clear();
            of.latches.clear();
            of.missed = 0;
            of.waits_for.clear();
            of.is_served = false;
            of.answer.clear();
            of.is_answered = false;
            of.line = CommandLine::new();
        });
        self.came.signal(());
    }

    /// The sensor that was set up cannot be restored.
    pub(crate) fn lost(&self, why: SensorLoss) {
        self.with(|of| of.setup_lost.put(why));
    }

    /// What it does.
    pub(crate) fn status(&self) -> SensorStatus {
        self.with(|of| SensorStatus {
            sensor: of.sensor.get().copied(),
            setup_lost: of.setup_lost.get().copied(),
            waits: of.waits_for.is_some(),
            answer: of.answer.get().map(|answer| StationAnswer {
                sequence: answer.sequence,
                state: answer.state,
                gamma_mm: answer.gamma.0,
            }),
            skip: of.lines_shown.skip,
            paired: of.counters.paired,
            lost: of.counters.lost,
            unpaired: of.counters.unpaired,
            unreadable: of.counters.unreadable,
        })
    }

    // --- From the control and the host

    /// Bytes that the control has sent. True: a line has come whose answer it is to be served.
    pub(crate) fn control_bytes(&self, bytes: &[u8]) -> bool {
        let (is_served, came) = self.with(|of| {
            if !of.sensor.is_some() {
                return (false, false);
            }
            let (mut is_served, mut came) = (false, false);
            for byte in bytes {
                let is_ours = of.line.is_of_a_sensor();
                if let Some(line) = of.line.byte(*byte)
                    && is_ours
                {
                    is_served = of.take_line(line, true);
                    came = true;
                }
            }
            (is_served, came)
        });
        if came {
            self.came.signal(());
        }
        is_served
    }

    /// A line that the host passes on.
    ///
    /// # Errors
    /// Why the station does not take it.
    pub(crate) fn host_line(&self, line: &[u8]) -> Result<(), SensorRefusal> {
        self.with(|of| {
            if !of.sensor.is_some() {
                return Err(SensorRefusal::NoSensor);
            }
            if of.waits_for.is_some() || of.lines.is_full() {
                return Err(SensorRefusal::UnderWay);
            }
            let mut reader = CommandLine::new();
            let whole = line.iter().chain(b"\n");
            let read = whole.filter_map(|byte| reader.byte(*byte)).last();
            of.take_line(read.unwrap_or(Err(CommandFault::Unreadable)), false);
            Ok(())
        })?;
        self.came.signal(());
        Ok(())
    }

    /// The control is to be served an answer that is not there yet.
    pub(crate) fn owes(&self) -> bool {
        self.with(|of| of.is_served && of.waits_for.is_some())
    }

    /// The answer that the control is to be served.
    pub(crate) fn served(&self) -> Option<CommandAnswer> {
        self.with(|of| of.answer.get().copied().filter(|_| of.is_served))
    }

    /// It has been served: an answer is never given twice.
    pub(crate) fn has_served(&self) {
        self.with(|of| of.is_served = false);
    }

    // --- From the captures

    /// Whether captures of this cause are the sensor's.
    pub(crate) fn takes(&self, cause: LatchCause) -> bool {
        self.with(|of| {
            of.sensor
                .get()
                .is_some_and(|sensor| match sensor.captured_at {
                    CapturedAt::Pulse => cause == LatchCause::Output,
                    CapturedAt::Sync => cause == LatchCause::Trigger,
                })
        })
    }

    /// The sensor was triggered.
    pub(crate) fn latched(&self, latch: &LatchReport) {
        self.with(|of| {
            of.missed = of.missed.saturating_add(latch.missed);
            let mut counts = latch.counts.iter();
            let mut next = || counts.next().copied();
            let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                return;
            };
            let capture = Capture {
                counts: [x, y, z],
                t_ns: latch.t_ns,
                missed: of.missed,
            };
            match of.latches.push_back(capture) {
                Ok(()) => of.missed = 0,
                Err(_) => of.missed = of.missed.saturating_add(1),
            }
        });
        self.came.signal(());
    }

    /// The board sends pulses to the sensor: the host has no say in them.
    pub(crate) fn has_the_pulses(&self) -> bool {
        self.with(|of| of.sensor.is_some() || of.is_triggering)
    }

    // --- For the station

    /// Waits until there is something to do.
    pub(super) async fn came(&self) {
        self.came.wait().await;
    }

    /// What is to be done next: captures before the lines that ask for others.
    pub(super) fn next(&self) -> Option<Task> {
        self.with(|of| {
            if core::mem::take(&mut of.is_new) {
                return Some(Task::Begin(of.sensor.get().copied()));
            }
            let capture = of.latches.pop_front().map(Task::Capture);
            capture.or_else(|| of.lines.pop_front().map(Task::Line))
        })
    }

    /// Captures come as long as there are some, without what else waits.
    pub(super) fn next_capture(&self) -> Option<Capture> {
        self.with(|of| of.latches.pop_front())
    }

    /// Keeps a record for the journal.
    pub(super) fn tell(&self, now: Micros, record: StationRecord) {
        self.with(|of| {
            if of.dropped > 0 || of.records.push_back((now, record)).is_err() {
                of.dropped = of.dropped.saturating_add(1);
            }
        });
        self.told.signal(());
    }

    /// The station itself had no room for so many records.
    pub(super) fn tell_dropped(&self, count: u32) {
        if count > 0 {
            self.with(|of| of.dropped = of.dropped.saturating_add(count));
            self.told.signal(());
        }
    }

    /// Characters of the sensor are lost.
    pub(super) fn lost_characters(&self, count: u32) {
        self.with(|of| of.lost_characters = of.lost_characters.saturating_add(count));
        self.told.signal(());
    }

    /// The line that came last is answered.
    pub(super) fn answer(&self, answer: CommandAnswer) {
        self.with(|of| {
            // One that was overtaken by another line is not asked for any more.
            if of.waits_for.get() == Some(&answer.sequence) {
                of.waits_for.clear();
                of.answer.put(answer);
                of.is_answered = true;
            }
        });
        self.told.signal(());
    }

    /// How it stands.
    pub(super) fn note(&self, counters: StationCounters, lines: SensorLines, is_triggering: bool) {
        self.with(|of| {
            of.counters = counters;
            of.lines_shown = lines;
            of.is_triggering = is_triggering;
        });
    }

    // --- For the journal and the control

    /// Waits until there is something to tell.
    pub(crate) async fn told(&self) {
        self.told.wait().await;
    }

    /// The next thing to journal.
    pub(crate) fn take_told(&self) -> Option<Told> {
        self.with(|of| {
            if let Some((at, record)) = of.records.pop_front() {
                return Some(Told::Record(at, record));
            }
            let characters = core::mem::take(&mut of.lost_characters);
            if characters > 0 {
                return Some(Told::Characters(characters));
            }
            let dropped = core::mem::take(&mut of.dropped);
            (dropped > 0).then_some(Told::Dropped(dropped))
        })
    }

    /// Whether an answer has come since this was asked last.
    pub(crate) fn take_answered(&self) -> bool {
        self.with(|of| core::mem::take(&mut of.is_answered))
    }
}

impl Default for PointStation {
    fn default() -> Self {
        Self::new()
    }
}

impl Inbox {
    /// Takes a line; whether a control is to be served its answer.
    fn take_line(&mut self, line: ReadLine, by_control: bool) -> bool {
        // An answer to an earlier line is not asked for any more.
        self.answer.clear();
        self.is_answered = false;
        self.is_served = false;
        self.waits_for.clear();
        if let Ok((sequence, command)) = &line {
            self.waits_for.put(*sequence);
            self.is_served = by_control && command.is_served();
        }
        if self.lines.push_back(line).is_err() {
            self.waits_for.clear();
            self.is_served = false;
            self.dropped = self.dropped.saturating_add(1);
        }
        self.is_served
    }
}
