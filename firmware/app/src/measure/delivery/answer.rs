//! Answers of a distance sensor's station: a program under a number of their own.

use umi_core::journal::Flash;
use umi_core::point::station::ANSWER_PROGRAM;

use super::stream::What;
use crate::measure::Instrument;

impl<F: Flash> Instrument<F> {
    /// The control has printed a line to the station: what it reads next is the answer.
    pub(crate) fn serves(&mut self) {
        self.ledger.wanted.set(ANSWER_PROGRAM, true);
    }

    /// Begins with the answer to the latest line; false if this is not its number, or there is
    /// none: it is given once.
    #[inline(never)]
    pub(super) fn answer(&mut self, number: u32) -> bool {
        if number != ANSWER_PROGRAM {
            return false;
        }
        let point = self.ledger.point;
        let Some(answer) = point.and_then(|point| point.served()) else {
            return false;
        };
        self.open(What::Answer, 0, &answer.program());
        true
    }

    /// All of the answer has gone out.
    pub(super) fn answer_is_out(&mut self, request: u32) {
        if let Some(point) = self.ledger.point {
            point.has_served();
        }
        if self.ledger.wanted.count == request {
            self.ledger.wanted.set(0, false);
        }
    }
}
