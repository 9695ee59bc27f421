//! The hits of one feature while they come in, with every doubt about them.

use heapless::Vec;
use umi_protocol::job::{FeatureSpec, MAX_HITS};
use umi_protocol::reason::Reason;

use super::feature::{Hit, Seen};
use super::reasons::{Reasons, add};
use crate::dprnt::{BlockEnd, Doubts, ReportedHit};

/// The hits of the feature that is being probed.
#[derive(Debug)]
pub struct Collecting {
    /// Its place in the job.
    pub feature: usize,
    pub hits: Vec<Hit, MAX_HITS>,
    pub reasons: Reasons,
    /// A block says itself where it ends; other lines end with their count.
    pub in_block: bool,
    /// Hits beyond those that found room.
    pub excess: u16,
    /// Hits that had a touch of the skip line; of a block, touches before it. None where nobody
    /// looks at them.
    pub touches: u16,
}

impl Collecting {
    /// The feature at this place of the job begins.
    pub fn new(feature: usize, in_block: bool) -> Self {
        Self {
            feature,
            hits: Vec::new(),
            reasons: Reasons::new(),
            in_block,
            excess: 0,
            touches: 0,
        }
    }

    /// The number of the next hit, from 1.
    pub fn next_number(&self) -> u16 {
        u16::try_from(self.hits.len() + 1).unwrap_or(u16::MAX)
    }

    /// Takes a hit in, and every doubt about it.
    /// `seen`: what its latch says, where the job asks for one.
    pub fn take(&mut self, spec: &FeatureSpec, hit: &ReportedHit, seen: Option<Option<Seen>>) {
        let number = self.next_number();
        let due = spec.approach.get(self.hits.len()).copied();
        let reasons = &mut self.reasons;
        for (doubt, reason) in [
            (Doubts::NULL_POINT, Reason::NullPoint { hit: number }),
            (
                Doubts::OVERFLOW_SUSPECT,
                Reason::OverflowSuspect { hit: number },
            ),
            (
                Doubts::OUTSIDE_TRAVEL,
                Reason::OutsideTravel { hit: number },
            ),
        ] {
            if hit.doubts.contains(doubt) {
                add(reasons, reason);
            }
        }
        if due.is_some() && hit.approach.is_some() && due != hit.approach {
            add(reasons, Reason::ApproachMismatch { hit: number });
        }
        if seen == Some(None) {
            add(reasons, Reason::NotLatched { hit: number });
        }
        let taken = Hit {
            position: hit.position,
            approach: hit.approach.or(due),
            seen: seen.flatten(),
        };
        if self.hits.push(taken).is_err() {
            self.excess = self.excess.saturating_add(1);
        }
    }

    /// What a block's end says against it.
    pub fn block_reason(&self, spec: &FeatureSpec, end: &BlockEnd) -> Option<Reason> {
        let got = u16::try_from(self.hits.len()).unwrap_or(u16::MAX);
        let expected = spec.hits;
        // Without an intact count line nobody knows how many were to come.
        let no_count = end.expected.is_none() && got >= expected;
        if end.damaged > 0 || no_count {
            Some(Reason::DamagedLine { got, expected })
        } else if let Some(announced) = end.expected.filter(|announced| *announced != expected) {
            let got = announced.max(got);
            Some(Reason::WrongCount { got, expected })
        } else if !end.complete {
            Some(Reason::MissingPoints { got, expected })
        } else {
            None
        }
    }
}
