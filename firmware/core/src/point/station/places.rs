//! From captures to places: at rest and on the way.

use super::watch::Watch;
use super::{CaptureStation, Doing, NumberedReading, PlacePoint, PlaceState, StationRecord};
use crate::units::{Mm, Point};

impl CaptureStation {
    /// The way is over: once all its readings have come, so is the line of places.
    pub(super) fn settle(&mut self) {
        if self.doing == Doing::Resting && self.pairing.is_empty() {
            self.rest();
            self.reply(Mm(0.0), PlaceState::Ok);
        }
    }

    /// Ends the captures on the way.
    pub(super) fn rest(&mut self) {
        if matches!(self.doing, Doing::Pulsing { .. } | Doing::Resting)
            && let Some(place) = self.sweep.end()
        {
            self.place(place);
        }
        self.doing = Doing::Idle;
    }

    /// Takes a capture on the way, with its reading if that came.
    pub(super) fn on_the_way(&mut self, axes: Point, reading: Option<&NumberedReading>) {
        // Three cells at most.
        while let Some(done) = self.sweep.go_on(axes) {
            if let Some(place) = done {
                self.place(place);
            }
        }
        match reading {
            Some(reading) => self.sweep.add(axes, reading),
            None => self.sweep.lost(),
        }
    }

    /// Ends the captures at rest once each has its reading or is lost.
    pub(super) fn close(&mut self) {
        let Doing::Collecting { left: 0, place } = self.doing else {
            return;
        };
        if !self.collected.is_complete() {
            return;
        }
        let mut found = self.collected.place();
        if found.state == PlaceState::Ok {
            self.proof.check(&self.setup.sensor, &mut found, place);
        } else {
            self.proof.leave();
        }
        self.reply(found.gamma, found.state);
        if place {
            self.place(found);
            self.proof.leave();
        }
        let guards = self.configuration.is_some_and(|with| with.guards);
        if guards {
            self.watch(Watch::guard());
        } else {
            self.doing = Doing::Idle;
        }
    }

    pub(super) fn place(&mut self, mut found: PlacePoint) {
        if found.state == PlaceState::Ok {
            found.state = self.proof.state();
        }
        found.number = self.places;
        self.places = self.places.saturating_add(1);
        if found.state == PlaceState::Ok {
            found.point = Some(self.setup.sensor.place(found.axes, found.gamma));
        }
        self.record(StationRecord::Place(found));
    }
}
