//! Where the skip line rests, by what it has shown in a setup: at the level of a touch, or at the other one.
//!
//! # Model
//!
//! With the levels exchanged, by a wrong `skip.active` or a broken wire, each release of the probe is taken for a touch:
//!
//! ```text
//!            touch            release                    touch
//! axes       ──┤ stand         ├───────── move ────────────┤
//! right      __┌───────────────┐___________________________┌───   active: they stand
//! exchanged  ──┐_______________┌───────────────────────────┐___   active: they move
//! ```
//!
//! So the axes say it: a probe that touches keeps them from moving, however long it does. Where they went farther between
//! begin and end of the "touches" than between these, by [`RATIO`], the line rests at the level of a touch: that is
//! [`Rests::AtTouch`]. Each way counts up to [`FAR_UM`], so that a probe that is switched off on its way to the tool changer
//! counts no more than one way from hit to hit; and there must be [`LEAST_UM`] of them, three such ways.
//!
//! A small bore, or few hits, has less. Then it counts that the axes stood each time that the line was not active, within
//! [`STOOD_UM`]: at the right level they go from hit to hit there, whatever the probe does besides. So [`LEAST_STOOD_UM`] in
//! [`LEAST_STOOD`] touches are enough then.
//!
//! Without encoders only durations are known. A probe rests for longer than it touches, but not always: a control may print
//! a line before it moves on. So they are a hint, [`Rests::LongerAtTouch`]: the line was active for [`RATIO`] times as long
//! as it was not, and no rest was as long as the touches are in the mean; and no axes say otherwise. Nothing is refused by that.
//!
//! # Limitations
//!
//! Known from the first line of a setup on: a block's first feature has been touched before. A board that tells no ends of
//! touches, edges that were lost, and fewer than [`LEAST`] touches say nothing; a line that never moves shows no touch at
//! all, which is told elsewhere. Touches a millimetre apart, or a probe that tells a release when the axes are as far away as
//! the next hit, or farther than [`STOOD_UM`] where there are few ways, are not enough for the axes.

/// So many times as much at the level of a touch as at the other one.
const RATIO: u32 = 4;
/// A way that is longer counts as this.
const FAR_UM: u32 = 10_000;
/// The least sum of ways while the line was active.
const LEAST_UM: u32 = 3 * FAR_UM;
/// So many whole touches.
const LEAST: u16 = 3;
/// A line that rests while the axes go no farther has not rested on a way from hit to hit.
const STOOD_UM: u32 = 1_000;
/// The least sum of ways while the line was active, where the axes always stood else.
const LEAST_STOOD_UM: u32 = 8_000;
/// So many whole touches then.
const LEAST_STOOD: u16 = 2;

/// What the line shows of its rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rests {
    /// As the job says, or too little was seen.
    Unknown,
    /// Most of the time at the level of a touch; a probe may do so that is kept pressed.
    LongerAtTouch,
    /// The axes moved while it was at the level of a touch, and stood while it was not.
    AtTouch,
}

/// One of the line's levels, and since when and where.
#[derive(Clone, Copy, Debug)]
struct Since {
    is_active: bool,
    t_ns: u64,
    /// Whole micrometres: a contact does not move the axes by more.
    um: [i32; 3],
}

/// What was seen of the line at its two levels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Levels {
    since: Option<Since>,
    shown: Shown,
}

#[derive(Clone, Copy, Debug, Default)]
struct Shown {
    active_ms: u32,
    rest_ms: u32,
    longest_rest_ms: u32,
    active_um: u32,
    rest_um: u32,
    longest_rest_um: u32,
    /// Times that it was active.
    touches: u16,
}

impl Levels {
    /// The line came to a level at this instant, with the axes there.
    pub fn edge(&mut self, is_active: bool, t_ns: u64, mm: &[f64; 3]) {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "saturates: two kilometres from zero"
        )]
        let um = mm.map(|mm| (mm * 1000.0) as i32);
        let now = Since {
            is_active,
            t_ns,
            um,
        };
        let before = self.since.replace(now);
        // Twice the same: one between was lost.
        let Some(before) = before.filter(|before| before.is_active != is_active) else {
            return;
        };
        let ns = t_ns.saturating_sub(before.t_ns);
        let ms = u32::try_from(ns / 1_000_000).unwrap_or(u32::MAX);
        let ways = um.iter().zip(before.um);
        let way = ways.map(|(to, from)| to.abs_diff(from)).max();
        let um = way.unwrap_or(0).min(FAR_UM);
        let shown = &mut self.shown;
        if before.is_active {
            shown.active_ms = shown.active_ms.saturating_add(ms);
            shown.active_um = shown.active_um.saturating_add(um);
            shown.touches = shown.touches.saturating_add(1);
        } else {
            shown.rest_ms = shown.rest_ms.saturating_add(ms);
            shown.rest_um = shown.rest_um.saturating_add(um);
            shown.longest_rest_um = shown.longest_rest_um.max(um);
            shown.longest_rest_ms = shown.longest_rest_ms.max(ms);
        }
    }

    /// An edge was lost: what comes next belongs to nothing before.
    pub fn lost(&mut self) {
        self.since = None;
    }

    /// A setup begins: what was before it says nothing of it.
    pub fn begin(&mut self) {
        self.shown = Shown::default();
    }

    /// What was shown since.
    pub fn rests(&self) -> Rests {
        let shown = &self.shown;
        let exceeds = |active: u32, rest: u32| active > rest.saturating_mul(RATIO);
        let (least_um, least) = match shown.longest_rest_um <= STOOD_UM {
            true => (LEAST_STOOD_UM, LEAST_STOOD),
            false => (LEAST_UM, LEAST),
        };
        if shown.touches >= least
            && shown.active_um >= least_um
            && exceeds(shown.active_um, shown.rest_um)
        {
            return Rests::AtTouch;
        }
        if shown.touches < LEAST {
            return Rests::Unknown;
        }
        if shown.rest_um > shown.active_um {
            // A probe that is kept pressed.
            return Rests::Unknown;
        }
        let mean_ms = shown.active_ms / u32::from(shown.touches);
        let no_rest_is_long = shown.longest_rest_ms < mean_ms;
        if no_rest_is_long && exceeds(shown.active_ms, shown.rest_ms) {
            return Rests::LongerAtTouch;
        }
        Rests::Unknown
    }
}

#[cfg(test)]
mod tests;
