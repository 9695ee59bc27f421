//! A board's state as it was read.

use std::collections::VecDeque;
use std::time::Duration;

use serde_json::{Value, json};
use umi_protocol::hello::VERSION;
use umi_protocol::latch::{LatchReport, Positions};
use umi_protocol::line::HitReport;
use umi_protocol::message::{Identity, Status};
use umi_protocol::verdict::Verdict;

use super::skip_line::SkipShown;
use crate::show::json;
use umi_client::axes::Scale;

/// Hits that are kept.
const HITS: usize = 20;

/// What is known of a board.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct View {
    /// Who it is.
    pub identity: Identity,
    /// The connection.
    pub link: Link,
    /// What the board has counted.
    pub status: Status,
    /// Where the axes are.
    pub positions: Positions,
    /// Speed along the path of the first three axes, from two positions; none where the
    /// scale is not known.
    pub feed_mm_per_min: Option<f64>,
    /// How counts become millimetres.
    pub scale: Scale,
    /// The latest hits, the newest first.
    pub hits: VecDeque<HitReport>,
    /// The latest latch of the probe.
    pub latch: Option<LatchReport>,
    /// The probe's line.
    pub skip: SkipShown,
    /// The latest verdict.
    pub verdict: Option<Verdict>,
    /// The setup whose correction went out, since this began.
    pub sent: Option<u32>,
    /// The job's corrections go to the control.
    pub sends: bool,
}

/// What has become of the correction of the latest verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Correction {
    /// It waits for the control.
    Waits,
    /// It went out.
    WentOut,
    /// It waits no more: it went out before this began, or what came since took it back.
    Gone,
}

impl Correction {
    const fn code(self) -> &'static str {
        match self {
            Self::Waits => "waits",
            Self::WentOut => "went_out",
            Self::Gone => "gone",
        }
    }
}

/// The connection.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Link {
    /// Why there is none at present, and since when.
    pub gone: Option<(String, Duration)>,
    /// Time from request to answer, the latest.
    pub answer: Duration,
    /// Frames from the board that were damaged.
    pub damaged: u64,
    /// Events that did not arrive here.
    pub events_lost: u64,
    /// Times at which the board was connected again.
    pub reconnected: u32,
}

impl View {
    /// A hit has come.
    pub fn hit(&mut self, hit: HitReport) {
        self.hits.push_front(hit);
        self.hits.truncate(HITS);
    }

    /// An edge was latched: the latest of the probe is one that begins a touch.
    pub fn latched(&mut self, latch: LatchReport) {
        if self.skip.edge(&latch) {
            self.latch = Some(latch);
        }
    }

    /// What has become of the latest verdict's correction; none where there is none to send.
    #[must_use]
    pub fn correction(&self) -> Option<Correction> {
        let verdict = self.verdict.as_ref()?;
        verdict.correction.as_ref().filter(|_| self.sends)?;
        Some(match self.status.correction_waiting {
            true => Correction::Waits,
            false if self.sent == Some(verdict.setup) => Correction::WentOut,
            false => Correction::Gone,
        })
    }

    /// The latest verdict is OK, and the reference on which it rests has been forgotten since.
    #[must_use]
    pub fn reference_is_forgotten(&self) -> bool {
        let rests = |verdict: &Verdict| verdict.ok && !verdict.distances.is_empty();
        !self.status.has_reference && self.verdict.as_ref().is_some_and(rests)
    }

    /// The axes are there now.
    pub fn moved(&mut self, positions: Positions) {
        self.feed_mm_per_min = self.feed(&positions);
        self.positions = positions;
    }

    fn feed(&self, to: &Positions) -> Option<f64> {
        let from = &self.positions;
        let elapsed_ns = to.t_ns.checked_sub(from.t_ns).filter(|ns| *ns > 0)?;
        let mut square = 0.0;
        for axis in 0..3 {
            let moved = to.counts.get(axis)?.wrapping_sub(*from.counts.get(axis)?);
            square += (moved as f64 / self.scale.counts_per_mm(axis)?).powi(2);
        }
        Some(square.sqrt() / (elapsed_ns as f64 * 1e-9) * 60.0)
    }

    /// For machines, one line.
    #[must_use]
    pub fn json(&self) -> Value {
        let link = &self.link;
        json!({
            "type": "watch",
            "board": json::identity(&self.identity),
            "connected": link.gone.is_none(),
            "link": {
                "why": link.gone.as_ref().map(|(why, _)| why),
                "answer_ms": link.answer.as_secs_f64() * 1e3,
                "damaged_frames": link.damaged,
                "events_lost": link.events_lost,
                "reconnected": link.reconnected,
                "protocol": VERSION.to_string(),
            },
            "positions": json::positions(&self.positions, &self.scale),
            "feed_mm_per_min": self.feed_mm_per_min,
            "status": json::status(&self.status),
            "hits": self.hits.iter().map(json::hit).collect::<Vec<_>>(),
            "latch": self.latch.as_ref().map(|latch| json::latch(latch, &self.scale)),
            "skip": self.skip.json(),
            "verdict": self.verdict.as_ref().map(|of| {
                let mut verdict = json::verdict(of);
                verdict["access"] = json!(self.status.access);
                verdict["correction_is"] = json!(self.correction().map(Correction::code));
                verdict["reference_forgotten"] = json!(self.reference_is_forgotten());
                verdict
            }),
        })
    }
}
