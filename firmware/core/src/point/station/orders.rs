//! What a command sets going.

use super::beam::BeamProof;
use super::captures::collect::Collected;
use super::captures::pairing::Pairing;
use super::captures::sweep::{self, Sweep};
use super::watch::{Trip, Watch};
use super::{
    CaptureStation, CommandFault, Doing, PlaceState, SensorCommand, SensorConfiguration,
    StationRecord,
};
use crate::units::{Mm, Point};

/// Readings that a board takes to bring a sensor to its place.
pub(super) const ADAPT_CAPTURES: u32 = 16;

impl CaptureStation {
    pub(super) fn carry_out(&mut self, sequence: u16, command: SensorCommand, counts: [i64; 3]) {
        // What has not come for the command before is not what this one asks for.
        match (self.doing, command) {
            (Doing::Pulsing { .. }, SensorCommand::Rest) => {}
            (Doing::Watching | Doing::Idle, _) => self.pairing.give_up(),
            _ => {
                while let Some(lost) = self.pairing.oldest() {
                    self.lost(lost);
                }
            }
        }
        self.stalled_since = None;
        self.answer = None;
        self.is_arming = false;
        self.sequence = sequence;
        match (command, self.configuration) {
            (SensorCommand::Configure(wanted), _) => self.configure(wanted),
            (SensorCommand::Finish, _) => {
                self.doing = Doing::Idle;
                self.configuration = None;
                self.reply(Mm(0.0), PlaceState::Ok);
            }
            (_, None) => self.refuse(),
            (SensorCommand::Adapt, Some(_)) => self.collect(ADAPT_CAPTURES, false),
            (SensorCommand::Measure, Some(with)) => self.collect(with.captures, true),
            (SensorCommand::TripNear, Some(with)) => self.trip(Trip::AtMost(with.target.0)),
            (SensorCommand::TripFar, Some(with)) => {
                self.trip(Trip::AtLeast(with.target.0 + with.overshoot.0));
            }
            (SensorCommand::Pulses, Some(with)) => self.pulse(with, counts),
            (SensorCommand::Rest, Some(_)) => {
                if matches!(self.doing, Doing::Pulsing { .. }) {
                    self.doing = Doing::Resting;
                } else {
                    self.doing = Doing::Idle;
                    self.reply(Mm(0.0), PlaceState::Ok);
                }
                self.settle();
            }
        }
    }

    pub(super) fn configure(&mut self, wanted: SensorConfiguration) {
        let is_possible = wanted.rate_hz > 0.0
            && wanted.rate_hz <= self.setup.max_rate_hz
            && (0.0..=self.setup.power_max).contains(&wanted.power)
            && wanted.captures > 0;
        if !is_possible {
            self.refuse();
            return;
        }
        self.configuration = Some(wanted);
        self.pairing = Pairing::default();
        self.early.clear();
        self.places = 0;
        self.proof = BeamProof::default();
        self.doing = Doing::Joining;
    }

    pub(super) fn refuse(&mut self) {
        self.doing = Doing::Idle;
        self.record(StationRecord::Refused(CommandFault::Value));
        self.reply(Mm(0.0), PlaceState::Refused);
    }

    pub(super) fn collect(&mut self, captures: u32, place: bool) {
        self.collected = Collected::of(captures);
        self.doing = Doing::Collecting {
            left: captures,
            place,
        };
    }

    /// Watches for the target; answered once the first reading shows on which side of it the
    /// sensor is.
    pub(super) fn trip(&mut self, trip: Trip) {
        // One reading on the way is too noisy to hold the beam against.
        self.proof.leave();
        self.is_arming = true;
        self.watch(Watch::trip(trip));
    }

    pub(super) fn watch(&mut self, watch: Watch) {
        self.watch = watch;
        self.doing = Doing::Watching;
    }

    pub(super) fn pulse(&mut self, with: SensorConfiguration, counts: [i64; 3]) {
        let [per_mm, _, _] = self.setup.counts_per_mm;
        let step = libm::fabs(with.interval.0 * per_mm);
        // Not more often than was asked for. Fewer than an edge shows in are one.
        let captures = if with.captures < sweep::LEAST {
            1
        } else {
            with.captures
        };
        let interval = libm::ceil(step / f64::from(captures) - 1e-6) as i64;
        let [at, _, _] = counts;
        if interval < 2 {
            self.refuse();
            return;
        }
        let Point { mm } = self.axes(counts);
        // A capture in the middle of a cell where there is one only.
        self.sweep = Sweep::new(mm.x, with.interval, self.proof.sigma_mm());
        self.doing = Doing::Pulsing {
            origin_counts: at.saturating_add(interval / 2),
            interval_counts: interval,
        };
        self.reply(Mm(0.0), PlaceState::Ok);
    }
}
