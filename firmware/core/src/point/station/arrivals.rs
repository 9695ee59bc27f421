//! Readings and latches that come, are late, or never come.

use super::captures::pairing::Latched;
use super::{CaptureStation, Doing, EARLY, NumberedReading, PlacePoint, PlaceState, StationRecord};
use crate::units::{Micros, Mm};

impl CaptureStation {
    /// A reading has come. The board may tell its latch a moment later.
    pub(super) fn came(&mut self, reading: NumberedReading, now: Micros) {
        let is_joined = self.doing != Doing::Joining || self.pairing.is_empty();
        // Before it is configured a sensor that runs by itself says nothing.
        if self.configuration.is_none() {
            return;
        }
        let is_early = is_joined
            && self
                .pairing
                .is_ahead(reading.number)
                .is_some_and(|ahead| (ahead as usize) < EARLY);
        let joins = self.doing == Doing::Joining && self.pairing.is_empty();
        if (is_early || joins) && self.early.push_back((reading, now)).is_ok() {
            return;
        }
        self.read(reading);
    }

    /// Readings that came before their latches were told, up to one that was captured at this
    /// time: what came before the edge does not belong to it.
    pub(super) fn take_early(&mut self, at: Micros) {
        while let Some((reading, came)) = self.early.front().copied() {
            let joins = self.doing == Doing::Joining;
            if !joins && self.pairing.is_ahead(reading.number).is_some() {
                return;
            }
            self.early.pop_front();
            if came < at {
                self.unpaired(reading.number);
            } else {
                self.read(reading);
            }
        }
    }

    pub(super) fn read(&mut self, reading: NumberedReading) {
        if self.doing == Doing::Joining {
            // One pulse, one reading: their numbers belong together from here on.
            self.pairing.join(reading.number);
        }
        while let Some(lost) = self.pairing.before(reading.number) {
            self.lost(lost);
        }
        let Some(latch) = self.pairing.take(reading.number) else {
            self.unpaired(reading.number);
            return;
        };
        if latch.is_surplus {
            return;
        }
        self.counters.paired = self.counters.paired.wrapping_add(1);
        let axes = self.axes(latch.counts);
        match self.doing {
            Doing::Joining => {
                self.doing = Doing::Idle;
                self.reply(Mm(0.0), PlaceState::Ok);
            }
            Doing::Collecting { .. } => {
                self.collected.add(axes, &reading);
                self.close();
            }
            Doing::Watching => {
                self.watch.look(reading.signal.ok().map(|s| s.gamma.0));
                if core::mem::take(&mut self.is_arming) {
                    self.reply(Mm(0.0), PlaceState::Ok);
                }
            }
            Doing::Pulsing { .. } | Doing::Resting => {
                self.on_the_way(axes, Some(&reading));
                self.settle();
            }
            Doing::Idle => {}
        }
    }

    /// A latch whose reading never came.
    pub(super) fn lost(&mut self, latch: Latched) {
        if latch.is_surplus {
            return;
        }
        self.counters.lost = self.counters.lost.saturating_add(1);
        self.record(StationRecord::Lost {
            latch: latch.number,
        });
        match self.doing {
            Doing::Joining => {
                self.doing = Doing::Idle;
                self.reply(Mm(0.0), PlaceState::LostCapture);
            }
            Doing::Collecting { .. } => {
                self.collected.lost();
                self.close();
            }
            Doing::Pulsing { .. } | Doing::Resting => {
                self.on_the_way(self.axes(latch.counts), None);
                self.settle();
            }
            Doing::Idle | Doing::Watching => {}
        }
    }

    pub(super) fn unreadable(&mut self) {
        self.counters.unreadable = self.counters.unreadable.saturating_add(1);
        self.record(StationRecord::Unreadable);
    }

    pub(super) fn unpaired(&mut self, reading: u32) {
        self.counters.unpaired = self.counters.unpaired.saturating_add(1);
        self.record(StationRecord::Unpaired { reading });
    }

    /// Nothing is captured although the sensor is triggered: it, or a wire of it, is off.
    pub(super) fn stalled(&mut self) {
        match self.doing {
            Doing::Collecting { place, .. } => {
                self.collected.lost();
                let found = PlacePoint {
                    state: PlaceState::LostCapture,
                    ..self.collected.place()
                };
                self.proof.leave();
                self.reply(Mm(0.0), PlaceState::LostCapture);
                if place {
                    self.place(found);
                }
                self.doing = Doing::Idle;
            }
            Doing::Joining => {
                self.doing = Doing::Idle;
                self.reply(Mm(0.0), PlaceState::LostCapture);
            }
            // The axes are not to go on: the line rises.
            Doing::Watching => {
                self.watch.gone();
                if core::mem::take(&mut self.is_arming) {
                    self.reply(Mm(0.0), PlaceState::LostCapture);
                }
            }
            Doing::Idle | Doing::Pulsing { .. } | Doing::Resting => {}
        }
    }
}
