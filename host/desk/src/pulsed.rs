//! A board that pulses a scanner while the machine moves, as fast as both compute.
//!
//! The board's time is the machine's, and a little more: the signature of the pulses comes
//! before the machine begins. Its host asks for its status as a real one does, because a board
//! whose host is silent for five seconds of its time switches the pulses off.

use std::time::Duration;

use umi_client::board::link::{Client, Patience};
use umi_client::problem::Problem;
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, Positions, TriggerOut, TriggerPulse};
use umi_protocol::message::{Event, Status};
use umi_virtual::machine::Wires;
use umi_virtual::{Config, VirtualBoard};

use crate::AxisCounts;
use crate::shot::{Shot, rise, speed};

/// Pulses in time begin with stretches of these intervals, in tenths of the wanted one: a lost
/// first frame cannot shift an uneven train.
pub const SIGNATURE_TENTHS: [u32; 7] = [17, 11, 23, 13, 19, 14, 26];
/// Pulses of a stretch, about.
pub const STRETCH_PULSES: u32 = 4;

/// How often the board is told of axes in motion.
const SAMPLING: Duration = Duration::from_millis(2);
/// The host asks at least so often, on the board's clock.
const BEAT_US: u64 = 200_000;
/// And after so many pulses: what waits for a host that does not read is bounded.
const BEAT_PULSES: usize = 16;
/// Beats behind the last pulse after which nothing more comes.
const LAST_BEATS: u32 = 5;
/// Beats that are given to pulses that the host has not heard of yet.
const MOST_BEATS: u32 = 500;
/// The board is a thread of this process: it answers when it is given time, and its end closes the
/// link. A question is asked once, so that nothing here depends on how busy the computer is.
const PATIENCE: Patience = Patience {
    answer: Duration::from_secs(120),
    tries: 1,
};

/// The board, its host, and what came of the pulses.
pub struct PulsedDesk {
    board: VirtualBoard,
    client: Client,
    /// The board's clock when the machine's shows 0.
    offset_us: u64,
    /// Counts of the rotary axes.
    turned: Vec<i64>,
    told: Option<(u64, AxisCounts)>,
    shots: Vec<Shot>,
    ways: Vec<Shot>,
    events: Vec<Event>,
    beat_us: u64,
    unread: usize,
    /// Pulses in all.
    sent: usize,
    /// The board when its pulses began.
    begun: Option<(Status, Positions)>,
    /// The first trouble: a machine's wire cannot report one.
    failure: Option<Problem>,
}

/// What the board's host has heard.
#[derive(Debug)]
pub struct PulsedRecord {
    /// What the board told, in its order.
    pub events: Vec<Event>,
    /// The board before and after.
    pub status: [Status; 2],
    /// Its axes before and after.
    pub positions: [Positions; 2],
}

impl PulsedDesk {
    /// Switches a new board on.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn new() -> Result<Self, Problem> {
        let board = VirtualBoard::start(Config::default())
            .map_err(|error| Problem::trouble("virtual_board", error))?;
        let client = Client::with_patience(crate::link(&board), PATIENCE)?;
        Ok(Self {
            board,
            client,
            offset_us: 0,
            turned: Vec::new(),
            told: None,
            shots: Vec::new(),
            ways: Vec::new(),
            events: Vec::new(),
            beat_us: 0,
            unread: 0,
            sent: 0,
            begun: None,
            failure: None,
        })
    }

    /// The board pulses at this interval from now on, after a signature; the machine stands still
    /// meanwhile.
    ///
    /// # Errors
    /// The link's; the board cannot do it.
    pub fn begin(&mut self, interval_us: u32) -> Result<(), Problem> {
        let pulse = TriggerPulse::default();
        let here = self
            .told
            .map_or_else(|| AxisCounts::new([0; 3], &self.turned), |(_, at)| at);
        self.begun = Some((self.client.status()?, self.client.positions()?));
        self.client.live(true)?;
        let stretches = SIGNATURE_TENTHS.into_iter().map(|tenths| {
            let interval = u64::from(interval_us) * u64::from(tenths) / 10;
            u32::try_from(interval).unwrap_or(u32::MAX)
        });
        for interval_us in stretches.chain([interval_us]) {
            let asked = self
                .client
                .trigger_out(TriggerOut::Time { interval_us, pulse })?;
            asked.map_err(|why| Problem::refused(why.into(), why))?;
            for _ in 0..STRETCH_PULSES {
                self.offset_us += u64::from(interval_us);
                self.tell(0, here)?;
            }
        }
        Ok(())
    }

    /// The pulses since the last call, and where the machine went: a place for each step of the
    /// sampling, with the pulses' own clock.
    pub fn take(&mut self) -> (Vec<Shot>, Vec<Shot>) {
        (
            std::mem::take(&mut self.shots),
            std::mem::take(&mut self.ways),
        )
    }

    /// Ends the pulses.
    ///
    /// # Errors
    /// The first trouble on the wires; the link's.
    pub fn finish(mut self) -> Result<PulsedRecord, Problem> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        let ended = self.client.trigger_out(TriggerOut::Off)?;
        ended.map_err(|why| Problem::refused(why.into(), why))?;
        // What the board keeps back for a while comes, on its own clock.
        for beat in 0..MOST_BEATS {
            if beat >= LAST_BEATS && self.heard() >= self.sent {
                break;
            }
            let Some((at_us, at)) = self.told else { break };
            self.tell((at_us + BEAT_US).saturating_sub(self.offset_us), at)?;
        }
        // The answers stand behind all that was told before.
        let (after, to) = (self.client.status()?, self.client.positions()?);
        self.listen()?;
        let (before, from) = self
            .begun
            .ok_or_else(|| Problem::trouble("virtual_board", "the pulses never began"))?;
        Ok(PulsedRecord {
            events: self.events,
            status: [before, after],
            positions: [from, to],
        })
    }

    /// Takes what the board has told.
    fn listen(&mut self) -> Result<(), Problem> {
        while let Some(event) = self.client.next_event(Duration::ZERO)? {
            self.events.push(event);
        }
        Ok(())
    }

    /// Pulses that the host has heard of.
    fn heard(&self) -> usize {
        let batches = self.events.iter().filter_map(|event| match event {
            Event::Latches(batch) => Some(batch),
            _ => None,
        });
        batches
            .flat_map(|batch| batch.reports())
            .filter(|latch| latch.cause == LatchCause::Output && !latch.counts.is_empty())
            .count()
    }

    /// The axes are there at this time of the machine.
    fn tell(&mut self, machine_us: u64, counts: AxisCounts) -> Result<(), Problem> {
        let before = self.told.map_or(0, |(at_us, _)| at_us);
        let at_us = (machine_us + self.offset_us).max(before);
        self.board.advance(Micros(at_us));
        let sent = self.board.passes(crate::axes(at_us, counts));
        let from = self
            .told
            .replace((at_us, counts))
            .unwrap_or((at_us, counts));
        let speed = speed(from, (at_us, counts));
        self.ways.push(Shot {
            at_us: at_us as f64,
            counts,
            speed,
            high_us: 0.0,
        });
        // Without counts there was no pulse: it tells of others that could not be sent.
        let pulses = sent.latches.iter().filter(|latch| !latch.counts.is_empty());
        let known = self.shots.len();
        self.shots
            .extend(pulses.map(|latch| rise(latch, sent.pulse, counts.axes, speed)));
        self.unread += self.shots.len() - known;
        self.sent += self.shots.len() - known;
        if at_us - self.beat_us >= BEAT_US || self.unread >= BEAT_PULSES {
            self.client.status()?;
            self.listen()?;
            (self.beat_us, self.unread) = (at_us, 0);
        }
        Ok(())
    }
}

impl Wires for PulsedDesk {
    fn serial(&mut self, _: Micros, bytes: &[u8]) {
        self.board.control_sends(bytes);
    }

    fn skip(&mut self, _: Micros, _: [i64; 3]) {}

    fn time(&mut self, now: Micros) {
        // At rest: the encoders are read all the same.
        let Some((_, counts)) = self.told else { return };
        let step_us = BEAT_US / 4;
        loop {
            let at = self.told.map_or(0, |(at_us, _)| at_us);
            let left = (now.0 + self.offset_us).saturating_sub(at);
            if left == 0 || self.failure.is_some() {
                return;
            }
            let machine_us = (at + left.min(step_us)).saturating_sub(self.offset_us);
            if let Err(failure) = self.tell(machine_us, counts) {
                self.failure = Some(failure);
            }
        }
    }

    fn sampling_s(&self) -> Option<f64> {
        Some(SAMPLING.as_secs_f64())
    }

    fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        let counts = AxisCounts::new(counts, &self.turned);
        if self.failure.is_none()
            && let Err(failure) = self.tell(at.0, counts)
        {
            self.failure = Some(failure);
        }
    }

    fn turned(&mut self, counts: &[i64]) {
        self.turned = counts.to_vec();
    }
}
