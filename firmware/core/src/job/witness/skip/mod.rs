//! Conditioning of the probe's skip line: which of its edges is the touch.
//!
//! # Model
//!
//! A contact that closes bounces; a relay bounces for milliseconds; an optocoupler's slow edge
//! crosses the threshold several times; a spark makes a pulse of its own. The touch is the
//! **first edge** of all that belongs to it:
//!
//! ```text
//!        spark      touch, bounces              release, bounces          next touch
//! ______|_________┌┐_┌──┐__┌───────────────────┐_┌┐_┌┐_________________┌┐┌─────
//!       narrow    first    within the hold-off    within the hold-off   after a rest
//! ```
//!
//! A pulse that is narrower than the minimum width is a spark: counted, and as if it had not been.
//! Any other begins a touch if the line has rested for the hold-off before it; else it is a bounce
//! of the touch before it. So the hold-off counts from the line's last activity: a train of bounces
//! of any length is one touch, and what bounces at the release is none.
//!
//! # Design
//!
//! Edges may come a little out of their order (two state machines stamp them): they are kept until
//! the line is printed, sorted by their instants, and judged then. When the room for them is full
//! the oldest are judged at once.
//!
//! An edge that a board could not capture has no position. If it may have been the first of a
//! touch, that touch has none: it is refused rather than placed a bounce too late. The same holds
//! for a pulse whose end was not captured: it may have been a spark.
//!
//! # Limitations
//!
//! A spark as wide as a contact's first closure, within the hold-off before the touch, takes its
//! place. On a board that tells no ends of pulses every edge counts as wide, and bounces at a
//! release later than the hold-off after the touch count as a touch.

mod rest;

use heapless::Vec;
use umi_protocol::job::SkipSpec;
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel};

use rest::Levels;
pub use rest::Rests;

/// Edges that wait to be judged.
const ROOM: usize = 16;

/// An edge of the line, or one that was lost.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    t_ns: u64,
    what: What,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// The line became active, with the axes here.
    Begin([f64; 3]),
    /// It rests again, with the axes here.
    End([f64; 3]),
    /// It became active so often by now, at least, and nobody knows where the axes were.
    Lost(u32),
    /// It came to rest by now, at least once, and nobody knows when.
    EndLost,
}

/// A touch of the probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The axes at its first edge; none: that edge was not captured.
    pub mm: Option<[f64; 3]>,
    /// From its first edge to the last that belongs to it so far, ns.
    pub width_ns: u64,
}

/// What was no touch of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Chatter {
    /// Pulses that belong to the touch before them.
    pub bounces: u32,
    /// Pulses below the minimum width.
    pub sparks: u32,
}

/// Conditions the skip line.
#[derive(Clone, Debug)]
pub struct SkipLine {
    active: SignalLevel,
    min_width_ns: u64,
    hold_off_ns: u64,
    waiting: Vec<Edge, ROOM>,
    /// The board has told an end: then a pulse without one has lost it.
    tells_ends: bool,
    /// The pulse that has begun and not ended.
    open: Option<(u64, [f64; 3])>,
    /// The line's last activity; nothing narrower than the minimum width counts.
    latest_ns: Option<u64>,
    /// When the latest touch began.
    began_ns: u64,
    touch: Option<Touch>,
    /// Touches that nobody has counted.
    uncounted: u16,
    chatter: Chatter,
    levels: Levels,
}

impl SkipLine {
    /// At rest.
    pub fn new(spec: &SkipSpec) -> Self {
        Self {
            active: spec.active,
            min_width_ns: u64::from(spec.min_width_us()) * 1_000,
            hold_off_ns: u64::from(spec.hold_off_ms()) * 1_000_000,
            waiting: Vec::new(),
            tells_ends: false,
            open: None,
            latest_ns: None,
            began_ns: 0,
            touch: None,
            uncounted: 0,
            chatter: Chatter::default(),
            levels: Levels::default(),
        }
    }

    /// A capture of the skip line, with its position in millimetres, if it has one.
    pub fn latched(&mut self, latch: &LatchReport, mm: Option<[f64; 3]>) {
        let rises = match latch.cause {
            LatchCause::Skip => true,
            LatchCause::SkipEnd => false,
            _ => return,
        };
        let t_ns = latch.t_ns;
        let begins = rises == (self.active == SignalLevel::High);
        self.tells_ends |= !begins;
        if latch.missed > 0 {
            let what = match begins {
                true => What::Lost(latch.missed),
                false => What::EndLost,
            };
            self.put(Edge { t_ns, what });
        }
        if latch.counts.is_empty() {
            return;
        }
        let what = match (begins, mm) {
            // Where none has a begin, no end is held against one.
            (false, mm) => What::End(mm.unwrap_or_default()),
            (true, Some(mm)) => What::Begin(mm),
            // A board without three axes: nothing to place a touch by.
            (true, None) => What::Lost(1),
        };
        self.put(Edge { t_ns, what });
    }

    fn put(&mut self, edge: Edge) {
        if self.waiting.is_full() {
            let oldest = self.waiting.remove(0);
            self.judge(oldest);
        }
        // Behind all that came before it or with it.
        let later = self.waiting.iter().rev();
        let later = later.take_while(|of| of.t_ns > edge.t_ns).count();
        let place = self.waiting.len().saturating_sub(later);
        // There is room.
        let _ = self.waiting.insert(place, edge);
    }

    /// Touches since they were last counted. Where [`Self::take`] is not asked, of a block that
    /// begins.
    pub fn count(&mut self) -> u16 {
        self.take();
        core::mem::take(&mut self.uncounted)
    }

    /// The control has printed its line: the touch that it is about, once.
    pub fn take(&mut self) -> Option<Touch> {
        let waiting = core::mem::take(&mut self.waiting);
        for edge in waiting {
            self.judge(edge);
        }
        // The probe may still be pressed: that is wide enough.
        if let Some((begin_ns, mm)) = self.open.take() {
            self.pulse(begin_ns, begin_ns, Some(mm));
        }
        self.touch.take()
    }

    /// What was no touch, since this was last asked.
    pub fn chatter(&mut self) -> Chatter {
        core::mem::take(&mut self.chatter)
    }

    /// A setup begins with the line that was printed last: what the line shows of its rest from here on is of it.
    pub fn begin(&mut self) {
        self.levels.begin();
    }

    /// Where the line rests, by what it has shown since a setup began.
    pub fn rests(&self) -> Rests {
        self.levels.rests()
    }

    /// The level that the job takes for a touch.
    pub fn active(&self) -> SignalLevel {
        self.active
    }

    fn judge(&mut self, edge: Edge) {
        match &edge.what {
            What::Begin(mm) => self.levels.edge(true, edge.t_ns, mm),
            What::End(mm) => self.levels.edge(false, edge.t_ns, mm),
            What::Lost(_) | What::EndLost => self.levels.lost(),
        }
        match edge.what {
            What::Begin(mm) => {
                let before = self.open.replace((edge.t_ns, mm));
                self.without_end(before, !self.tells_ends);
            }
            What::End(_) => match self.open.take() {
                Some((begin_ns, mm)) => {
                    if edge.t_ns.saturating_sub(begin_ns) < self.min_width_ns {
                        self.chatter.sparks = self.chatter.sparks.saturating_add(1);
                    } else {
                        self.pulse(begin_ns, edge.t_ns, Some(mm));
                    }
                }
                // Its beginning was taken already, or lost and counted.
                None => self.goes_on(edge.t_ns),
            },
            What::Lost(count) => {
                let before = self.open.take();
                self.without_end(before, !self.tells_ends);
                self.pulse(edge.t_ns, edge.t_ns, None);
                let more = count.saturating_sub(1);
                self.chatter.bounces = self.chatter.bounces.saturating_add(more);
            }
            What::EndLost => {
                let open = self.open.take();
                self.without_end(open, false);
            }
        }
    }

    /// A pulse of which all that is known is that it was: it counts as wide if the board tells no
    /// ends. Else it may have been a spark, and where a touch begins by it, that has no position.
    fn without_end(&mut self, pulse: Option<(u64, [f64; 3])>, is_wide: bool) {
        if let Some((begin_ns, mm)) = pulse {
            self.pulse(begin_ns, begin_ns, Some(mm).filter(|_| is_wide));
        }
    }

    /// A pulse that counts, from its first edge to its last.
    fn pulse(&mut self, begin_ns: u64, end_ns: u64, mm: Option<[f64; 3]>) {
        let rested = |latest_ns| begin_ns.saturating_sub(latest_ns) >= self.hold_off_ns;
        if self.latest_ns.is_none_or(rested) {
            self.began_ns = begin_ns;
            let width_ns = end_ns.saturating_sub(begin_ns);
            self.touch = Some(Touch { mm, width_ns });
            self.uncounted = self.uncounted.saturating_add(1);
        } else {
            self.chatter.bounces = self.chatter.bounces.saturating_add(1);
        }
        self.goes_on(end_ns);
    }

    /// The line was active until then.
    fn goes_on(&mut self, end_ns: u64) {
        self.latest_ns = Some(self.latest_ns.map_or(end_ns, |latest| latest.max(end_ns)));
        if let Some(touch) = &mut self.touch {
            touch.width_ns = touch.width_ns.max(end_ns.saturating_sub(self.began_ns));
        }
    }
}

#[cfg(test)]
mod tests;
