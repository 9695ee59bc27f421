//! Captures against the edges that were driven: how many came, and how far the worst is off.

use umi_app::board::{Broken, LinkTx};
use umi_protocol::latch::{LatchCause, LatchReport};

use super::table::Table;

/// An edge that was driven.
#[derive(Clone, Copy, Debug)]
pub struct DrivenEdge<'a> {
    /// What its capture is told as.
    pub cause: LatchCause,
    /// It was not before this, microseconds of the captures' clock.
    pub from_us: u64,
    /// Nor behind this.
    pub to_us: u64,
    /// Where the axes were, from the first one on. Axes behind them are not looked at.
    pub counts: &'a [i64],
}

/// What became of all edges of a kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FoundEdges {
    /// Captures of such an edge, with positions, and nothing missed before them.
    pub captured: i64,
    /// How far the worst position is off.
    pub worst_counts: i64,
    /// How far the worst instant is outside of the time at which the edge was driven.
    pub worst_ns: i64,
}

impl FoundEdges {
    /// Takes the capture that came behind an edge, if one did.
    pub fn take(&mut self, driven: DrivenEdge<'_>, latch: Option<&LatchReport>) {
        let Some(latch) = latch else { return };
        let is_whole = latch.counts.len() >= driven.counts.len();
        if latch.cause != driven.cause || latch.missed > 0 || !is_whole {
            return;
        }
        self.captured = self.captured.saturating_add(1);
        for (is, was) in latch.counts.iter().zip(driven.counts) {
            let off = i64::try_from(is.abs_diff(*was)).unwrap_or(i64::MAX);
            self.worst_counts = self.worst_counts.max(off);
        }
        let early = driven
            .from_us
            .saturating_mul(1000)
            .saturating_sub(latch.t_ns);
        let late = latch.t_ns.saturating_sub(driven.to_us.saturating_mul(1000));
        let off = i64::try_from(early.max(late)).unwrap_or(i64::MAX);
        self.worst_ns = self.worst_ns.max(off);
    }

    /// Tells how many of `all` were captured, and how far positions and, where they are held to a
    /// limit, instants are off.
    ///
    /// # Errors
    /// The link is broken.
    pub async fn tell<L: LinkTx>(
        &self,
        name: &str,
        all: i64,
        instant_ns: Option<i64>,
        table: &mut Table<'_, L>,
    ) -> Result<(), Broken> {
        table.exactly(name, all, self.captured, "").await?;
        table
            .exactly("their positions", 0, self.worst_counts, "counts off")
            .await?;
        let Some(most_ns) = instant_ns else {
            return Ok(());
        };
        table
            .at_most("their instants", most_ns, self.worst_ns, "ns off")
            .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRIVEN: DrivenEdge<'_> = DrivenEdge {
        cause: LatchCause::Skip,
        from_us: 10,
        to_us: 12,
        counts: &[5, -7],
    };

    fn latch(t_ns: u64, counts: &[i64]) -> LatchReport {
        LatchReport {
            number: 0,
            cause: LatchCause::Skip,
            t_ns,
            counts: counts.iter().copied().collect(),
            missed: 0,
        }
    }

    fn found(latch: Option<&LatchReport>) -> FoundEdges {
        let mut found = FoundEdges::default();
        found.take(DRIVEN, latch);
        found
    }

    #[test]
    fn a_capture_within_its_time_at_its_place_is_exact() {
        let right = FoundEdges {
            captured: 1,
            ..FoundEdges::default()
        };
        assert_eq!(found(Some(&latch(10_000, &[5, -7]))), right);
        // An axis that was not driven may be anywhere.
        assert_eq!(found(Some(&latch(12_000, &[5, -7, 99]))), right);
    }

    #[test]
    fn what_is_off_is_told_by_how_much() {
        let early = found(Some(&latch(9_400, &[5, -9])));
        assert_eq!((early.worst_counts, early.worst_ns), (2, 600));
        let late = found(Some(&latch(12_001, &[8, -7])));
        assert_eq!((late.worst_counts, late.worst_ns), (3, 1));
    }

    #[test]
    fn another_edge_or_half_a_capture_is_none() {
        let other = LatchReport {
            cause: LatchCause::Trigger,
            ..latch(11_000, &[5, -7])
        };
        let behind_a_loss = LatchReport {
            missed: 1,
            ..latch(11_000, &[5, -7])
        };
        let without_positions = latch(11_000, &[]);
        for latch in [
            None,
            Some(&other),
            Some(&behind_a_loss),
            Some(&without_positions),
        ] {
            assert_eq!(found(latch), FoundEdges::default());
        }
    }
}
