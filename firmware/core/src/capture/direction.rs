//! Which way a line went, where the capture of an edge does not say it.
//!
//! # Design
//!
//! Edges of a line alternate: after a rise comes a fall. So the direction of an edge follows from
//! that of the one before, as long as none was lost in between. Where some were, or where nobody
//! can know, the level of the line decides, read while nothing more has been captured: it is what
//! the latest edge has left. An edge of which neither says anything is told as lost: a direction
//! that is guessed puts the end of a touch in the place of its beginning.

/// Edges that were lost, by their direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LostByDirection {
    /// Rises.
    pub rises: u32,
    /// Falls.
    pub falls: u32,
}

impl LostByDirection {
    /// So many, of which nothing else is known: each of the two may have been the more frequent.
    const fn unknown(count: u32) -> Self {
        let most = count.div_ceil(2);
        Self {
            rises: most,
            falls: most,
        }
    }

    /// So many, of which the first is a rise or not.
    const fn alternating(count: u32, first_rises: bool) -> Self {
        let (like_first, others) = (count.div_ceil(2), count / 2);
        match first_rises {
            true => Self {
                rises: like_first,
                falls: others,
            },
            false => Self {
                rises: others,
                falls: like_first,
            },
        }
    }
}

/// An edge that was captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectedEdge {
    /// It is known which way it went.
    Known {
        /// Whether the line rose.
        rises: bool,
        /// Edges before it that are lost, at least.
        lost: LostByDirection,
    },
    /// It is not: the edge itself is among the lost ones.
    Unknown {
        /// Lost edges, of each direction as many as there may have been at most.
        lost: LostByDirection,
    },
}

/// The directions of a line's edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Directions {
    /// The line's level after the latest edge; none: it is not known.
    level: Option<bool>,
}

impl Directions {
    /// Nothing is known of the line.
    #[must_use]
    pub const fn new() -> Self {
        Self { level: None }
    }

    /// An edge was captured, and at least `missed` before it were lost. `steady` is the line's level
    /// (high: true) if nothing has been captured since, and none if that is not sure.
    pub const fn edge(&mut self, missed: u32, steady: Option<bool>) -> DirectedEdge {
        let before = self.level;
        self.level = match (steady, before) {
            (Some(level), _) => Some(level),
            (None, Some(before)) if missed == 0 => Some(!before),
            (None, _) => None,
        };
        let Some(rises) = self.level else {
            return DirectedEdge::Unknown {
                lost: LostByDirection::unknown(missed.saturating_add(1)),
            };
        };
        let lost = match before {
            // An odd number lies between two edges of the same direction, an even one else.
            Some(before) => {
                let is_odd = before == rises;
                let more = (missed % 2 == 1) != is_odd;
                LostByDirection::alternating(missed.saturating_add(more as u32), !before)
            }
            None => match missed {
                0 => LostByDirection { rises: 0, falls: 0 },
                _ => LostByDirection::unknown(missed),
            },
        };
        DirectedEdge::Known { rises, lost }
    }

    /// Edges were lost, at least so many, and none of those that came was captured.
    pub const fn lost(&mut self, missed: u32) -> LostByDirection {
        self.level = None;
        LostByDirection::unknown(missed)
    }

    /// All edges so far are told, and the line is at this level.
    pub const fn rests(&mut self, high: bool) {
        if self.level.is_none() {
            self.level = Some(high);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn known(rises: bool, lost: (u32, u32)) -> DirectedEdge {
        let (rises_lost, falls_lost) = lost;
        DirectedEdge::Known {
            rises,
            lost: LostByDirection {
                rises: rises_lost,
                falls: falls_lost,
            },
        }
    }

    /// From a known level they alternate, whether or not the level can be read.
    #[test]
    fn edges_alternate() {
        let mut line = Directions::new();
        line.rests(false);
        assert_eq!(line.edge(0, None), known(true, (0, 0)));
        assert_eq!(line.edge(0, None), known(false, (0, 0)));
        assert_eq!(line.edge(0, Some(true)), known(true, (0, 0)));
        // The level wins, and one was lost in between: its fall.
        assert_eq!(line.edge(0, Some(true)), known(true, (0, 1)));
        // It is at rest only where nothing is known.
        line.rests(false);
        assert_eq!(line.edge(0, None), known(false, (0, 0)));
    }

    /// Behind a loss only the level tells; without it the edge is lost too.
    #[test]
    fn a_loss_ends_what_is_known() {
        let mut line = Directions::new();
        line.rests(false);
        let unknown = DirectedEdge::Unknown {
            lost: LostByDirection { rises: 1, falls: 1 },
        };
        assert_eq!(line.edge(1, None), unknown);
        assert_eq!(line.edge(0, None), unknown);
        assert_eq!(line.edge(0, Some(false)), known(false, (0, 0)));
        // One is told, and two it must have been, or none.
        assert_eq!(line.edge(1, Some(true)), known(true, (1, 1)));
        assert_eq!(line.edge(3, Some(true)), known(true, (1, 2)));
        assert_eq!(line.lost(3), LostByDirection { rises: 2, falls: 2 });
        assert_eq!(line.edge(2, Some(true)), known(true, (1, 1)));
    }

    proptest! {
        /// A line whose edges are lost at random, told exactly or at least one: no direction is
        /// ever wrong, no loss is silent, and where the number is exact, so are both parts.
        #[test]
        fn no_direction_is_wrong(
            edges in prop::collection::vec((0_u8..10, any::<bool>()), 1..200),
            begins_high in any::<bool>(),
            exact in any::<bool>(),
        ) {
            let mut line = Directions::new();
            line.rests(begins_high);
            let mut high = begins_high;
            let mut pending = Vec::new();
            let mut all_known = true;
            for (kind, steady) in edges {
                high = !high;
                if kind < 3 {
                    pending.push(high);
                    continue;
                }
                let lost = pending.len() as u32;
                let missed = if exact { lost } else { lost.min(1) };
                match line.edge(missed, steady.then_some(high)) {
                    DirectedEdge::Known { rises, lost: told } => {
                        prop_assert_eq!(rises, high);
                        prop_assert_eq!(told == LostByDirection::default(), lost == 0);
                        if exact && all_known {
                            let rises = pending.iter().filter(|rises| **rises).count() as u32;
                            prop_assert_eq!(told, LostByDirection { rises, falls: lost - rises });
                        }
                        all_known = true;
                    }
                    DirectedEdge::Unknown { lost: told } => {
                        prop_assert!(told.rises > 0 && told.falls > 0);
                        prop_assert!(lost > 0 || !all_known);
                        all_known = false;
                    }
                }
                pending.clear();
            }
        }
    }
}
