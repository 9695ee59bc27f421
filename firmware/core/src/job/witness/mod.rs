//! The second witness: what the control printed against what the encoders counted
//! at the probe's skip edge.
//!
//! # Model
//!
//! Of a hit with approach `s e` (`s` its sign, `e` its axis) at feed `v`, the control
//! stored `p` and the board latched `q` (counts over counts per millimetre):
//!
//! ```text
//! p - q = o + s v τ e,    0 <= τ <= delay
//! ```
//!
//! `o` is the encoders' origin in the control's coordinates, and τ the time that the
//! control took after the edge. Across its approach a hit shows `o` itself, along it
//! the delay. `o` is given, or learned from the first setup that is OK: from hits across
//! an axis; where there are none, as Z of a plane probed from above, from those along it
//! with half of the longest delay, and then known no better than that half.
//!
//! What contradicts this is named by its pattern: all differences of an axis moved
//! (work offset, datum), in proportion to the position (scale), one jump (lost
//! counts), or none of these.
//!
//! # Tradeoffs
//!
//! Nothing but sums and extremes is kept of a setup, so its size does not depend on
//! its hits. A latch belongs to the line that follows it: lines that are printed
//! later, as blocks are, cannot have a second witness.

pub mod skip;

use umi_protocol::job::{Approach, SkipSpec, WitnessSpec};
use umi_protocol::latch::LatchReport;
use umi_protocol::reason::Reason;

use super::exceeds;
use super::feature::{Hit, Seen};
use crate::dprnt::ReportedHit;
use skip::Touch;

/// Both witnesses of a setup's hits.
#[derive(Debug)]
pub struct Witness {
    spec: WitnessSpec,
    /// From the touch to the board's input, microseconds.
    skip_delay_us: f64,
    /// Origin of the encoders in the control's coordinates, as far as it is known.
    origins: [Option<Origin>; 3],
    /// Which of them this setup has taught.
    learned: [bool; 3],
    setup: Setup,
    /// As it was before the setup's last feature, which may come again.
    before_last: Setup,
}

/// The encoders' origin of an axis.
#[derive(Clone, Copy, Debug)]
struct Origin {
    mm: f64,
    /// How far it may be off, because only hits along the axis told it.
    slack_mm: f64,
}

/// What is kept of a setup's hits.
#[derive(Clone, Copy, Debug, Default)]
struct Setup {
    axes: [Axis; 3],
    feed: Feed,
}

/// All gauging hits of a setup go at one feed.
#[derive(Clone, Copy, Debug, Default)]
struct Feed {
    mm_per_min: Option<f64>,
    /// The first hit at another one: its number and feed.
    changed: Option<(u16, f64)>,
    hits: u16,
}

impl Witness {
    /// Nothing has been seen yet.
    pub fn new(spec: WitnessSpec, skip: &SkipSpec) -> Self {
        let mut origins = [None; 3];
        if let Some(counts) = spec.origin_counts {
            for ((origin, count), scale) in origins.iter_mut().zip(counts).zip(spec.counts_per_mm) {
                *origin = Some(Origin {
                    mm: -count / scale,
                    slack_mm: 0.0,
                });
            }
        }
        Self {
            spec,
            skip_delay_us: skip.delay_us,
            origins,
            learned: [false; 3],
            setup: Setup::default(),
            before_last: Setup::default(),
        }
    }

    /// Where the axes were, if all were captured.
    pub fn mm(&self, latch: &LatchReport) -> Option<[f64; 3]> {
        let mut mm = [0.0; 3];
        let scales = self.spec.counts_per_mm;
        for ((value, counts), scale) in mm.iter_mut().zip(&latch.counts).zip(scales) {
            #[allow(
                clippy::cast_precision_loss,
                reason = "2^53 counts are 900 km at 0.1 nm"
            )]
            let counts = *counts as f64;
            *value = counts / scale;
        }
        (latch.counts.len() >= mm.len()).then_some(mm)
    }

    /// What a touch says of its line; none if it was not captured, or if the line's feed is
    /// none at which a probe can touch: then nothing could be said about the delay.
    pub fn pair(&self, touch: Option<Touch>, hit: &ReportedHit) -> Option<Seen> {
        let latched = touch?.mm?;
        let feed_mm_per_min = hit.feed_mm_per_min.or(self.spec.feed_mm_per_min)?;
        if !(feed_mm_per_min.is_finite() && feed_mm_per_min > 0.0) {
            return None;
        }
        let mut difference_mm = hit.position.to_array_mm();
        for (difference, latched) in difference_mm.iter_mut().zip(latched) {
            *difference -= latched;
        }
        Some(Seen {
            difference_mm,
            feed_mm_per_min,
        })
    }

    /// Takes in a feature of this setup, or once more its last one instead of itself.
    pub fn take(&mut self, hits: &[Hit], replaces_last: bool) {
        if replaces_last {
            self.setup = self.before_last;
        }
        self.before_last = self.setup;
        for hit in hits {
            self.take_hit(hit);
        }
    }

    fn take_hit(&mut self, hit: &Hit) {
        let (Some(seen), Some(approach)) = (hit.seen, hit.approach) else {
            return;
        };
        self.setup.feed.take(seen.feed_mm_per_min);
        // The axes were there before the signal came: by the way in its delay.
        let late_mm = seen.feed_mm_per_min / 60e6 * self.skip_delay_us;
        let position = hit.position.to_array_mm();
        for (number, axis) in self.setup.axes.iter_mut().enumerate() {
            let (along, sign) = approach.axis_and_sign();
            let late_mm = if along == number { sign * late_mm } else { 0.0 };
            let difference = at(&seen.difference_mm, number) + late_mm;
            axis.take(
                number,
                approach,
                at(&position, number),
                difference,
                &self.spec,
            );
        }
    }

    /// Says what contradicts.
    pub fn judge(&self, against: &mut impl FnMut(Reason)) {
        let Setup { axes, feed } = &self.setup;
        if let (Some((hit, feed_mm_per_min)), Some(expected_mm_per_min)) =
            (feed.changed, feed.mm_per_min)
        {
            against(Reason::FeedChanged {
                hit,
                feed_mm_per_min,
                expected_mm_per_min,
            });
            return;
        }
        for ((number, axis), origin) in (0u8..).zip(axes).zip(self.origins) {
            if let Some(reason) = axis.across.contradiction(number, origin, &self.spec) {
                against(reason);
            } else if let Some((delays, slack_ms)) = self.delays(axis, origin) {
                let slack_ms = slack_ms + self.resolution_ms().unwrap_or(0.0);
                let plausible = -slack_ms..=self.spec.delay_ms + slack_ms;
                // Each end on its own: late is the control's fault, early is too.
                for delay_ms in [delays.least_ms, delays.most_ms] {
                    if !plausible.contains(&delay_ms) {
                        against(Reason::ControlDelay {
                            axis: number,
                            delay_ms,
                            limit_ms: self.spec.delay_ms,
                        });
                    }
                }
            }
        }
    }

    /// The setup is OK: what is to be remarked, and the origin if it was unknown.
    pub fn conclude(&mut self) -> [Option<Reason>; 2] {
        let mut all: Option<Delays> = None;
        for (axis, origin) in self.setup.axes.iter().zip(self.origins) {
            // An origin that rests on delays says nothing about them.
            if let Some((delays, 0.0)) = self.delays(axis, origin) {
                all = Some(all.map_or(delays, |all| all.joined(delays)));
            }
        }
        let witnessed = all.map(|all| Reason::Witnessed {
            hits: all.hits,
            least_ms: all.least_ms,
            mean_ms: all.sum_ms / f64::from(all.hits),
            most_ms: all.most_ms,
            resolution_ms: self.resolution_ms().unwrap_or(f64::NAN),
        });
        let half_mm = self.setup.feed.mm_per_ms().unwrap_or(0.0) * self.spec.delay_ms / 2.0;
        let axes = self.setup.axes.iter();
        for ((origin, learned), axis) in self.origins.iter_mut().zip(&mut self.learned).zip(axes) {
            if origin.is_none() {
                *origin = axis.origin(half_mm);
                *learned = origin.is_some();
            }
        }
        let learned = self.learned.contains(&true);
        [witnessed, learned.then_some(Reason::WitnessLearned)]
    }

    /// The setup was OK and is not any more: what it taught is forgotten.
    pub fn unlearn(&mut self) {
        for (origin, learned) in self.origins.iter_mut().zip(&mut self.learned) {
            if core::mem::take(learned) {
                *origin = None;
            }
        }
    }

    /// Another setup begins.
    pub fn next_setup(&mut self) {
        self.setup = Setup::default();
        self.before_last = Setup::default();
        self.learned = [false; 3];
    }

    /// The control's delays along an axis, and how far the origin may shift them; none
    /// without a hit along it or without anything that says where the origin is.
    fn delays(&self, axis: &Axis, origin: Option<Origin>) -> Option<(Delays, f64)> {
        let across = || axis.across.mean().map(|mm| Origin { mm, slack_mm: 0.0 });
        let origin = origin.or_else(across)?;
        let mm_per_ms = self.setup.feed.mm_per_ms()?;
        let mut all: Option<Delays> = None;
        for (side, sign) in axis.along.iter().zip(SIGNS) {
            let Some(side) = side else { continue };
            let ms = |mm: f64| (mm - sign * origin.mm) / mm_per_ms;
            let delays = Delays {
                hits: side.hits,
                least_ms: ms(side.least_mm),
                most_ms: ms(side.most_mm),
                sum_ms: f64::from(side.hits) * ms(side.sum_mm / f64::from(side.hits)),
            };
            all = Some(all.map_or(delays, |all| all.joined(delays)));
        }
        Some((all?, origin.slack_mm / mm_per_ms))
    }

    /// What the tolerance is worth at the setup's feed.
    fn resolution_ms(&self) -> Option<f64> {
        Some(self.spec.tolerance_mm / self.setup.feed.mm_per_ms()?)
    }
}

/// Of the hits along an axis: towards plus, towards minus.
const SIGNS: [f64; 2] = [1.0, -1.0];

impl Feed {
    fn mm_per_ms(&self) -> Option<f64> {
        Some(self.mm_per_min? / 60_000.0)
    }

    fn take(&mut self, mm_per_min: f64) {
        self.hits = self.hits.saturating_add(1);
        match self.mm_per_min {
            None => self.mm_per_min = Some(mm_per_min),
            #[allow(clippy::float_cmp, reason = "the same printed number")]
            Some(first) if first != mm_per_min && self.changed.is_none() => {
                self.changed = Some((self.hits, mm_per_min));
            }
            Some(_) => {}
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Delays {
    hits: u16,
    least_ms: f64,
    most_ms: f64,
    sum_ms: f64,
}

impl Delays {
    fn joined(self, other: Self) -> Self {
        Self {
            hits: self.hits.saturating_add(other.hits),
            least_ms: self.least_ms.min(other.least_ms),
            most_ms: self.most_ms.max(other.most_ms),
            sum_ms: self.sum_ms + other.sum_ms,
        }
    }
}

/// The differences of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    /// Of hits across it.
    across: Across,
    /// Of hits towards plus and minus.
    along: [Option<Along>; 2],
}

impl Axis {
    /// Where the setup puts the encoders' origin; `half_mm` is the way of half of the
    /// control's longest delay.
    fn origin(&self, half_mm: f64) -> Option<Origin> {
        if let Some(mm) = self.across.mean() {
            return Some(Origin { mm, slack_mm: 0.0 });
        }
        let sides = self.along.iter().zip(SIGNS);
        sides
            .filter_map(|(side, sign)| {
                let side = (*side)?;
                let mean = side.sum_mm / f64::from(side.hits);
                Some(Origin {
                    mm: sign * (mean - half_mm),
                    slack_mm: half_mm,
                })
            })
            .next()
    }

    fn take(
        &mut self,
        number: usize,
        approach: Approach,
        position_mm: f64,
        difference_mm: f64,
        spec: &WitnessSpec,
    ) {
        let (along, sign) = approach.axis_and_sign();
        if along != number {
            self.across.take(position_mm, difference_mm, spec);
            return;
        }
        let side = usize::from(sign < 0.0);
        if let Some(side) = self.along.get_mut(side) {
            let mm = sign * difference_mm;
            *side = Some(side.map_or(Along::new(mm), |side| side.with(mm)));
        }
    }
}

/// `s (p - q)` of the hits towards one side.
#[derive(Clone, Copy, Debug)]
struct Along {
    hits: u16,
    least_mm: f64,
    most_mm: f64,
    sum_mm: f64,
}

impl Along {
    fn new(mm: f64) -> Self {
        Self {
            hits: 1,
            least_mm: mm,
            most_mm: mm,
            sum_mm: mm,
        }
    }

    fn with(self, mm: f64) -> Self {
        Self {
            hits: self.hits.saturating_add(1),
            least_mm: self.least_mm.min(mm),
            most_mm: self.most_mm.max(mm),
            sum_mm: self.sum_mm + mm,
        }
    }
}

/// `p - q` of the hits across an axis, in the order in which they came.
#[derive(Clone, Copy, Debug, Default)]
struct Across {
    /// The first hit's position and difference: sums count from there, so that
    /// large coordinates cost no digits.
    first: Option<(f64, f64)>,
    last_mm: f64,
    least_mm: f64,
    most_mm: f64,
    all: Sums,
    /// Since the first jump.
    behind: Sums,
    jumps: u16,
}

/// Sums for a line through (x, y).
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Across {
    fn take(&mut self, position_mm: f64, difference_mm: f64, spec: &WitnessSpec) {
        let (x0, y0) = *self.first.get_or_insert((position_mm, difference_mm));
        let (x, y) = (position_mm - x0, difference_mm - y0);
        if (y - self.last_mm).abs() > spec.tolerance_mm {
            self.jumps = self.jumps.saturating_add(1);
        }
        self.last_mm = y;
        self.least_mm = self.least_mm.min(y);
        self.most_mm = self.most_mm.max(y);
        self.all.add(x, y);
        if self.jumps > 0 {
            self.behind.add(x, y);
        }
    }

    fn mean(&self) -> Option<f64> {
        let (_, y0) = self.first?;
        Some(y0 + self.all.y / self.all.n)
    }

    /// What is wrong with this axis; the simplest explanation that leaves no more
    /// than the tolerance, else that there is none.
    fn contradiction(
        &self,
        axis: u8,
        origin: Option<Origin>,
        spec: &WitnessSpec,
    ) -> Option<Reason> {
        let limit_mm = spec.tolerance_mm + origin.map_or(0.0, |origin| origin.slack_mm);
        let mean = self.mean()?;
        let range = self.most_mm - self.least_mm;
        if range <= limit_mm {
            let shift_mm = mean - origin.map_or(mean, |origin| origin.mm);
            return exceeds(shift_mm.abs(), limit_mm).then_some(Reason::WitnessShift {
                axis,
                shift_mm,
                limit_mm,
            });
        }
        let before = self.all.without(&self.behind);
        let stepped = (self.jumps == 1).then(|| before.scatter() + self.behind.scatter());
        let sloped = self.all.line();
        let explains = |squares: f64| squares <= limit_mm * limit_mm * self.all.n;
        let step = stepped.filter(|squares| explains(*squares));
        let slope = sloped.filter(|(_, squares)| explains(*squares));
        Some(match (step, slope) {
            (Some(step), slope) if slope.is_none_or(|(_, squares)| step <= squares) => {
                let jump_mm = self.behind.y / self.behind.n - before.y / before.n;
                // The control is right, so the counter is wrong by as much.
                let scale = at(&spec.counts_per_mm, usize::from(axis));
                Reason::LostCounts {
                    axis,
                    counts: libm::round(-jump_mm * scale),
                }
            }
            (_, Some((slope, _))) => Reason::WitnessScale {
                axis,
                // p - q = slope p: q = (1 - slope) p.
                ppm: 1e6 * slope / (1.0 - slope),
            },
            _ => Reason::WitnessDisagrees {
                axis,
                off_mm: range,
                limit_mm,
            },
        })
    }
}

impl Sums {
    fn add(&mut self, x: f64, y: f64) {
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
    }

    fn without(&self, other: &Self) -> Self {
        Self {
            n: self.n - other.n,
            x: self.x - other.x,
            y: self.y - other.y,
            xx: self.xx - other.xx,
            xy: self.xy - other.xy,
            yy: self.yy - other.yy,
        }
    }

    /// Sum of squares of y about its mean.
    fn scatter(&self) -> f64 {
        (self.yy - self.y * self.y / self.n).max(0.0)
    }

    /// Slope of the least-squares line and the sum of squares that it leaves; none
    /// if all x are one.
    fn line(&self) -> Option<(f64, f64)> {
        let xx = self.xx - self.x * self.x / self.n;
        let xy = self.xy - self.x * self.y / self.n;
        (xx > 0.0).then(|| (xy / xx, (self.scatter() - xy * xy / xx).max(0.0)))
    }
}

/// A value of a triple; axes are 0 to 2.
fn at(values: &[f64; 3], axis: usize) -> f64 {
    values.get(axis).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests;
