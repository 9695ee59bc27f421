//! The probe's skip line, by the edges that the board tells: how wide its latest touch was, and whether it
//! rests where the job says.
//!
//! # Model
//!
//! A probe touches for a moment and rests for longer. A line that has been at the level of a touch for more than twice
//! as long as at the other one rests there: then each end of a touch is taken for a touch. Only what has ended within
//! ten seconds counts: many probes show a touch as long as they are off.
//!
//! # Limitations
//!
//! A board tells both edges where the job judges touches (`[witness]`, `[skip]` `each_hit`) or the line falls
//! (`active = "low"`). Without, no width and no rest is known. A stylus that is held down by hand, again and again and for
//! longer than it is left alone, looks like a line that rests there.

use serde_json::{Value, json};
use umi_protocol::job::SkipSpec;
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel};

/// What is seen for less than this says nothing of where the line rests.
const LEAST_NS: u64 = 3_000_000_000;
/// What lasts longer is no touch, and no rest between two.
const LONGEST_NS: u64 = 10_000_000_000;
/// So many times as long at one level as at the other.
const RATIO: u64 = 2;

/// What the line has shown since this began.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SkipShown {
    spec: SkipSpec,
    /// The latest edge: to which level, and when.
    latest: Option<(SignalLevel, u64)>,
    /// The width of the latest touch that has ended.
    width_ns: Option<u64>,
    /// How long it was high and low, between edges of which none was lost.
    high_ns: u64,
    low_ns: u64,
}

impl SkipShown {
    /// By this job, or none.
    #[must_use]
    pub fn of(spec: Option<SkipSpec>) -> Self {
        Self {
            spec: spec.unwrap_or_default(),
            ..Self::default()
        }
    }

    /// An edge; whether it begins a touch. Nothing, if it is none of this line.
    pub fn edge(&mut self, latch: &LatchReport) -> bool {
        let level = match latch.cause {
            LatchCause::Skip => SignalLevel::High,
            LatchCause::SkipEnd => SignalLevel::Low,
            _ => return false,
        };
        let whole = |(before, _): &(SignalLevel, u64)| *before != level && latch.missed == 0;
        let before = self.latest.filter(whole);
        self.latest = Some((level, latch.t_ns));
        let begins = level == self.spec.active;
        if let Some((before, from_ns)) = before {
            let lasted = latch.t_ns.saturating_sub(from_ns);
            let sum = match before {
                SignalLevel::High => &mut self.high_ns,
                SignalLevel::Low => &mut self.low_ns,
            };
            if lasted <= LONGEST_NS {
                *sum = sum.saturating_add(lasted);
            }
            if !begins {
                self.width_ns = Some(lasted);
            }
        }
        begins
    }

    /// The width of the latest touch, milliseconds; none before one has ended.
    #[must_use]
    pub fn width_ms(&self) -> Option<f64> {
        self.width_ns.map(|ns| ns as f64 * 1e-6)
    }

    /// What to do, where the line rests at the level that the job takes for a touch.
    #[must_use]
    pub fn wrong_level(&self) -> Option<String> {
        let (high, low) = (self.high_ns, self.low_ns);
        let (touch, rest, rests, set) = match self.spec.active {
            SignalLevel::High => (high, low, "high", "low"),
            SignalLevel::Low => (low, high, "low", "high"),
        };
        let is_seen = rest > 0 && touch.saturating_add(rest) >= LEAST_NS;
        (is_seen && touch > rest.saturating_mul(RATIO)).then(|| {
            format!(
                "the skip line rests at {rests}, by what it has shown; set `[skip]` `active = \"{set}\"` in the job"
            )
        })
    }

    /// For machines.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "level": self.latest.map(|(level, _)| name(level)),
            "width_ms": self.width_ms(),
            "wrong_level": self.wrong_level(),
        })
    }
}

const fn name(level: SignalLevel) -> &'static str {
    match level {
        SignalLevel::High => "high",
        SignalLevel::Low => "low",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn edge(shown: &mut SkipShown, cause: LatchCause, t_ms: u64) -> bool {
        shown.edge(&latch(cause, t_ms, 0))
    }

    fn latch(cause: LatchCause, t_ms: u64, missed: u32) -> LatchReport {
        LatchReport {
            number: 0,
            cause,
            counts: [0; 3].into_iter().collect(),
            t_ns: t_ms * MS,
            missed,
        }
    }

    fn spec(active: SignalLevel) -> Option<SkipSpec> {
        Some(SkipSpec {
            active,
            ..SkipSpec::default()
        })
    }

    use LatchCause::{Skip, SkipEnd};

    /// Four touches of 30 ms, a second and a half apart: at the right level they have that width, and nothing
    /// is said. At a job that has the other level each gap is a touch, which is named, with what to set.
    #[test]
    fn a_line_that_rests_at_the_level_of_a_touch_is_named() {
        for (begin, end, rests, other) in [
            (Skip, SkipEnd, "low", "high"),
            (SkipEnd, Skip, "high", "low"),
        ] {
            for active in [SignalLevel::Low, SignalLevel::High] {
                let is_right = name(active) == other;
                let mut shown = SkipShown::of(spec(active));
                for touch in 0..4 {
                    assert_eq!(edge(&mut shown, begin, 1000 + 1500 * touch), is_right);
                    assert_eq!(edge(&mut shown, end, 1030 + 1500 * touch), !is_right);
                }
                let said = shown.wrong_level();
                if is_right {
                    assert_eq!((said, shown.width_ms()), (None, Some(30.0)));
                } else {
                    let said = said.unwrap();
                    assert!(
                        said.starts_with(&format!("the skip line rests at {rests},")),
                        "{said}"
                    );
                    assert!(said.contains(&format!("`active = \"{other}\"`")), "{said}");
                }
            }
        }
    }

    /// Nothing is said of a board that tells no ends, over edges that were lost, in the first seconds, and of
    /// a probe that is off for minutes.
    #[test]
    fn what_was_hardly_seen_says_nothing() {
        let mut shown = SkipShown::of(None);
        edge(&mut shown, Skip, 1000);
        edge(&mut shown, Skip, 9000);
        assert_eq!((shown.wrong_level(), shown.width_ms()), (None, None));
        shown.edge(&latch(SkipEnd, 9500, 2));
        assert_eq!(shown.width_ms(), None);
        // Held by hand for two seconds.
        edge(&mut shown, Skip, 9600);
        edge(&mut shown, SkipEnd, 11_600);
        assert_eq!(
            (shown.wrong_level(), shown.width_ms()),
            (None, Some(2000.0))
        );
        edge(&mut shown, Skip, 13_000);
        edge(&mut shown, SkipEnd, 313_000);
        assert_eq!(shown.wrong_level(), None);
    }
}
