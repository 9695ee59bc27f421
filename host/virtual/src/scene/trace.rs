//! First contact of a ball on a straight line with a body, or the end of it.
//!
//! Sphere tracing (J. Hart, The Visual Computer 12, 1996): the distance says how far a
//! ball can go without touching. The steps have a floor, so that a walk ends in a change
//! of sign and not in ever smaller steps; halving then finds the place to the last bits.

use nalgebra::Vector3;

use super::Body;

/// Least step, mm. A touch along less than that, whose depth is below 1e-11 mm on a
/// radius of 1 mm, may be passed over.
const STEP_MM: f64 = 1e-5;
/// After so many steps the rest of the way goes in as many: a path close along a face.
const STEPS: u32 = 20_000;
/// A gap below this is none, mm.
const TOUCH_MM: f64 = 1e-6;
/// A bent stylus may be bent this much further while it leaves, mm.
const FURTHER_MM: f64 = 1e-3;

/// Way from `from` to where a gap that changes by no more than the way first is closed.
pub(super) fn first_closed(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    gap: impl Fn(&Vector3<f64>) -> f64,
) -> Option<f64> {
    let way = to - from;
    let length = way.norm();
    let direction = if length > 0.0 { way / length } else { way };
    let gap = |at: f64| gap(&(from + direction * at));
    let mut open = 0.0;
    let mut here = gap(open);
    if here <= 0.0 {
        return Some(0.0);
    }
    let mut least = STEP_MM;
    let mut steps = 0;
    while open < length {
        let ahead = (open + here.max(least)).min(length);
        here = gap(ahead);
        if here <= 0.0 {
            return Some(halved(open, ahead, gap));
        }
        open = ahead;
        steps += 1;
        if steps == STEPS {
            least = least.max((length - open) / f64::from(STEPS));
        }
    }
    None
}

/// The first closed place between an open and a closed one.
fn halved(mut open: f64, mut closed: f64, gap: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..100 {
        let middle = 0.5 * (open + closed);
        if middle <= open || middle >= closed {
            break;
        }
        if gap(middle) <= 0.0 {
            closed = middle;
        } else {
            open = middle;
        }
    }
    closed
}

/// Where on a chain of lines a ball runs into a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Collision {
    /// Number of the line.
    pub line: usize,
    /// Way along this line, mm.
    pub way_mm: f64,
    /// The ball was in contact from the start and is pressed on further.
    pub further: bool,
}

impl Body {
    /// Way up to where this body's distance from a moving point first is `level_mm` or
    /// less: the contact of a ball of this radius, or with less than its radius the
    /// place where it is pushed by the rest.
    #[must_use]
    pub fn first_within(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        level_mm: f64,
    ) -> Option<f64> {
        first_closed(from, to, |p| self.distance_mm(p) - level_mm)
    }

    /// Way up to where the distance first is `level_mm` or more.
    #[must_use]
    pub fn first_beyond(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        level_mm: f64,
    ) -> Option<f64> {
        first_closed(from, to, |p| level_mm - self.distance_mm(p))
    }

    /// Where a ball on a chain of points runs into this body. A ball in contact at the
    /// start, as a stylus is after a skip, may leave; it must not be pressed on further,
    /// nor touch again once it was free.
    #[must_use]
    pub fn first_collision(&self, chain: &[Vector3<f64>], radius_mm: f64) -> Option<Collision> {
        let start = self.distance_mm(chain.first()?);
        let mut allowed =
            (start < radius_mm + TOUCH_MM).then_some(start.min(radius_mm) - FURTHER_MM);
        for (line, (from, to)) in chain.iter().zip(chain.iter().skip(1)).enumerate() {
            let (mut from, mut before) = (*from, 0.0);
            if let Some(level) = allowed {
                let exit = self.first_beyond(&from, to, radius_mm + 2.0 * TOUCH_MM);
                let further = self.first_within(&from, to, level);
                if let Some(way_mm) = further.filter(|way| exit.is_none_or(|exit| *way < exit)) {
                    return Some(Collision {
                        line,
                        way_mm,
                        further: true,
                    });
                }
                let Some(exit) = exit else { continue };
                allowed = None;
                if let Some(direction) = (to - from).try_normalize(0.0) {
                    from += direction * exit;
                }
                before = exit;
            }
            if let Some(way) = self.first_within(&from, to, radius_mm) {
                return Some(Collision {
                    line,
                    way_mm: before + way,
                    further: false,
                });
            }
        }
        None
    }
}
