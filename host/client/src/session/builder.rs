//! Decisions of a board gathered into what a report is made from.

use umi_protocol::feature::FeatureResult;
use umi_protocol::job::Job;
use umi_protocol::message::Identity;

use super::{DecisionRecord, Session, Setup};

/// A session that grows.
#[derive(Clone, Debug)]
pub struct SessionBuilder {
    /// What has been gathered.
    pub session: Session,
    /// Features of a setup that is not judged.
    pending: Vec<FeatureResult>,
}

impl SessionBuilder {
    /// A session without setups.
    #[must_use]
    pub fn new(title: &str, about: &str, job: &Job, identity: Option<&Identity>) -> Self {
        Self {
            session: Session {
                title: title.into(),
                about: about.into(),
                job: job.clone(),
                identity: identity.cloned(),
                facts: Vec::new(),
                taught_mm: None,
                path_points_mm: Vec::new(),
                setups: Vec::new(),
                faults: Vec::new(),
            },
            pending: Vec::new(),
        }
    }

    /// Takes a decision in; the place of the setup that it judges, if it does.
    pub fn take(&mut self, decision: DecisionRecord) -> Option<usize> {
        match decision {
            DecisionRecord::Fault(fault) => self.session.faults.push(*fault),
            DecisionRecord::Feature(feature) => self.pending.push(*feature),
            DecisionRecord::Verdict(verdict) => {
                let setup = verdict.setup;
                let mut features = std::mem::take(&mut self.pending);
                features.retain(|feature| feature.setup == setup);
                let setups = &mut self.session.setups;
                // A setup that is judged again keeps its place.
                if let Some(place) = setups.iter().position(|p| p.verdict.setup == verdict.setup) {
                    setups[place].features.extend(features);
                    setups[place].verdict = *verdict;
                    return Some(place);
                }
                setups.push(Setup {
                    title: String::new(),
                    about: String::new(),
                    features,
                    verdict: *verdict,
                    truth: None,
                });
                return Some(setups.len() - 1);
            }
        }
        None
    }
}
