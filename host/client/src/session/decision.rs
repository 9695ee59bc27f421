//! The records that are decisions: what a session shows.

use umi_protocol::fault::Fault;
use umi_protocol::feature::FeatureResult;
use umi_protocol::message::Record;
use umi_protocol::verdict::Verdict;

/// What the board decides, in its order.
#[derive(Clone, Debug)]
pub enum DecisionRecord {
    /// A feature was fitted or refused.
    Feature(Box<FeatureResult>),
    /// A setup was judged.
    Verdict(Box<Verdict>),
    /// Something was lost, damaged, doubtful or not understood.
    Fault(Box<Fault>),
}

impl DecisionRecord {
    /// The decision in a record, if it is one that is shown.
    #[must_use]
    pub fn of(record: Record) -> Option<Self> {
        match record {
            Record::Feature(feature) => Some(Self::Feature(Box::new(feature))),
            Record::Verdict(verdict) => Some(Self::Verdict(Box::new(verdict))),
            // As many as it counts: the latest of them stands for all.
            Record::Fault(fault) | Record::FaultsAgain { latest: fault, .. } => {
                Some(Self::Fault(Box::new(fault)))
            }
            _ => None,
        }
    }
}
