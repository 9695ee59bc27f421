//! Decisions of a board gathered into what a report is made from.

use umi_protocol::feature::FeatureResult;
use umi_protocol::job::Job;
use umi_protocol::message::Identity;

use crate::capture::Decision;
use crate::report::{Plate, Session};

/// A session that grows.
#[derive(Clone, Debug)]
pub struct Gather {
    /// What has been gathered.
    pub session: Session,
    /// Features of a plate that is not judged.
    pending: Vec<FeatureResult>,
}

impl Gather {
    /// A session without plates.
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
                plates: Vec::new(),
                faults: Vec::new(),
            },
            pending: Vec::new(),
        }
    }

    /// Takes a decision in; the place of the plate that it judges, if it does.
    pub fn take(&mut self, decision: Decision) -> Option<usize> {
        match decision {
            Decision::Fault(fault) => self.session.faults.push(*fault),
            Decision::Feature(feature) => self.pending.push(*feature),
            Decision::Verdict(verdict) => {
                let plate = verdict.plate;
                let mut features = std::mem::take(&mut self.pending);
                features.retain(|feature| feature.plate == plate);
                let plates = &mut self.session.plates;
                // A plate that is judged again keeps its place.
                if let Some(place) = plates.iter().position(|p| p.verdict.plate == verdict.plate) {
                    plates[place].features.extend(features);
                    plates[place].verdict = *verdict;
                    return Some(place);
                }
                plates.push(Plate {
                    title: String::new(),
                    about: String::new(),
                    features,
                    verdict: *verdict,
                    truth: None,
                });
                return Some(plates.len() - 1);
            }
        }
        None
    }
}
