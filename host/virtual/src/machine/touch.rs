//! A touch in a motion with skip: contact, trigger, stop.

use nalgebra::Vector3;
use umi_core::units::Point;

use super::motion::Profile;
use super::probe::pretravel_mm;
use super::{VirtualMachine, Wires};
use crate::nc::{AxisMotion, Skip, Trip};
use crate::scene::Stores;

/// A touch on a path.
pub(super) struct Touch {
    pub body: String,
    /// Way of the axes up to the contact.
    pub way_mm: f64,
    pub center_mm: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// Way of the axes from contact to trigger.
    pub pretravel_mm: f64,
}

impl<W: Wires> VirtualMachine<W> {
    /// The true ends of the tip's way.
    fn tip(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        down: &Vector3<f64>,
    ) -> [Vector3<f64>; 2] {
        [from, to].map(|end| end + self.truth(end) + down)
    }

    /// What triggers the probe first on the way, if anything does.
    ///
    /// A body pushes the tip along its normal; the probe triggers when it has pushed
    /// by the pretravel of that direction. A body that is only grazed may not push that
    /// far, and stays unseen.
    pub(super) fn touch(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Touch> {
        let (down, radius) = self.ball()?;
        let [start, end] = self.tip(from, to, &down);
        let direction = (end - start).try_normalize(0.0)?;
        // The truth's scale against the encoders' along this way.
        let scale = (to - from).norm() / (end - start).norm();
        let mut first: Option<Touch> = None;
        for body in self.scene.bodies() {
            let Some(contact) = body.first_within(&start, &end, radius) else {
                continue;
            };
            let center_mm = start + direction * contact;
            let normal = body.normal(&center_mm);
            let pushed_mm = pretravel_mm(&self.scene.probe, &-normal);
            let Some(on) = body.first_within(&center_mm, &end, radius - pushed_mm) else {
                continue;
            };
            let touch = Touch {
                body: body.name.clone(),
                way_mm: contact * scale,
                center_mm,
                normal,
                pretravel_mm: on * scale,
            };
            let sooner = |f: &Touch| touch.way_mm + touch.pretravel_mm < f.way_mm + f.pretravel_mm;
            if first.as_ref().is_none_or(sooner) {
                first = Some(touch);
            }
        }
        first
    }

    /// Whether a body touches the tip with the axes here.
    pub(super) fn in_contact(&self, at: &Vector3<f64>) -> bool {
        const FREE_MM: f64 = 1e-6;
        self.ball().is_some_and(|(down, radius)| {
            let center = at + self.truth(at) + down;
            self.scene.clearance(&center, radius, |_| true) < FREE_MM
        })
    }

    /// A motion that ends when the probe seats again: every body has let the tip back to
    /// less than its pretravel.
    pub(super) fn leave(&mut self, motion: &AxisMotion) -> Result<Skip, Trip> {
        let (from, to) = (self.position, motion.to.mm);
        if !self.signal || self.ball().is_none() {
            return Ok(Skip {
                touched: true,
                stored: Point { mm: self.position },
            });
        }
        let way = to - from;
        let length = way.norm();
        let way_mm = self.seats_mm(&from, &to).ok_or_else(|| Trip {
            message: "the probe touches and the motion does not free it; move away from the body"
                .into(),
        })?;
        let profile = self.profile(length, motion.rate)?;
        let falls_s = profile.time_at_s(way_mm);
        let read_s = self.notices_s(falls_s);
        let stored = from + way / length * self.stored_mm(&profile, read_s);
        let (sent_mm, speed) = profile.sent(read_s);
        let braking_mm = speed * speed / (2.0 * profile.acceleration_mm_per_s2);
        let until_s = read_s + speed / profile.acceleration_mm_per_s2;
        let rest = from + way / length * (sent_mm + braking_mm).min(length);
        self.go_falling(&[from, to], &profile, until_s, rest, Some(falls_s));
        self.signal = false;
        Ok(Skip {
            touched: true,
            stored: Point { mm: stored },
        })
    }

    /// Way of the axes to where every body has let the tip back to less than its pretravel; none: they do not on this one.
    pub(super) fn seats_mm(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<f64> {
        let (down, radius) = self.ball()?;
        let length = (to - from).norm();
        if length == 0.0 {
            return None;
        }
        let [start, end] = self.tip(from, to, &down);
        let mut seats_mm = 0.0_f64;
        for body in self.scene.bodies() {
            let pushed_mm = pretravel_mm(&self.scene.probe, &-body.normal(&start));
            seats_mm = seats_mm.max(body.first_beyond(&start, &end, radius - pushed_mm)?);
        }
        Some(seats_mm * length / (end - start).norm())
    }

    /// When the signal goes off on a motion through these points that begins at a body and ends free; none: it stays.
    pub(super) fn falls_s(&self, chain: &[Vector3<f64>], profile: &Profile) -> Option<f64> {
        let end = chain.last()?;
        if !self.signal || self.in_contact(end) {
            return None;
        }
        let mut before_mm = 0.0;
        for (from, to) in chain.iter().zip(chain.iter().skip(1)) {
            if let Some(way_mm) = self.seats_mm(from, to) {
                return Some(profile.time_at_s(before_mm + way_mm));
            }
            before_mm += (to - from).norm();
        }
        Some(profile.duration_s)
    }

    /// When the control stores a position after an edge, from the start of the motion.
    pub(super) fn notices_s(&mut self, edge_s: f64) -> f64 {
        let control = &self.scene.control;
        let poll_s = control.skip_poll_ms * 1e-3;
        let waits_s = if poll_s > 0.0 {
            let polls = (self.seconds + edge_s) / poll_s - self.poll_phase;
            (libm::ceil(polls) - polls) * poll_s
        } else {
            0.0
        };
        let [shortest, longest] = control.skip_delay_ms;
        edge_s + waits_s + self.random.between(shortest, longest) * 1e-3
    }

    /// Way that the control stores when it looks at this time.
    pub(super) fn stored_mm(&self, profile: &Profile, read_s: f64) -> f64 {
        match self.scene.control.skip_stores {
            Stores::Actual => profile.travelled_mm(read_s),
            Stores::Sent => profile.sent(read_s).0,
        }
    }
}
