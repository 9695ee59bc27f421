//! A session as a report needs it: its records as they came over the board's link, and
//! the true answer where one is known.

mod builder;
mod decision;

pub use builder::SessionBuilder;
pub use decision::DecisionRecord;

use umi_protocol::fault::Fault;
use umi_protocol::feature::{FeatureResult, Matrix3};
use umi_protocol::job::{FeatureSpec, Job, Reference};
use umi_protocol::message::Identity;
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

/// One session: a job and the setups that were measured with it.
#[derive(Clone, Debug)]
pub struct Session {
    /// The heading.
    pub title: String,
    /// One or two sentences below it: what was done, with what.
    pub about: String,
    /// The job in force.
    pub job: Job,
    /// The board that measured.
    pub identity: Option<Identity>,
    /// Further lines for the head: input, journal, date.
    pub facts: Vec<Fact>,
    /// Reference positions that were taught before the session, in the order of
    /// the job's datum features. Not needed where the job gives the positions
    /// or a setup of the session was taught.
    pub taught_mm: Option<Vec<[f64; 3]>>,
    /// Points of the tool path, CAD frame. Errors are stated there.
    pub path_points_mm: Vec<[f64; 3]>,
    /// The setups, in the order in which they were judged.
    pub setups: Vec<Setup>,
    /// What was lost, damaged or not understood on the way from the control.
    pub faults: Vec<Fault>,
}

/// A line of the report's head.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    /// What it is, as "Input".
    pub label: String,
    /// What it says.
    pub value: String,
}

/// One clamping.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Its name, as "Case 1".
    pub title: String,
    /// How it was clamped; may be empty.
    pub about: String,
    /// Every feature that arrived, refused ones too, in the order of arrival.
    pub features: Vec<FeatureResult>,
    /// The verdict.
    pub verdict: Verdict,
    /// The true pose, where the data were made from one.
    pub truth: Option<Truth>,
}

/// A known true pose: `q = R p + t`, p in the reference clamping, q in this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// R by rows.
    pub rotation: Matrix3,
    /// t.
    pub translation_mm: [f64; 3],
}

/// The features whose positions are registered, in the job's order.
pub fn datums(job: &Job) -> impl Iterator<Item = &FeatureSpec> {
    job.features
        .iter()
        .filter(|f| f.datum && f.kind.has_position())
}

impl Session {
    /// Reference positions for a setup (by its place in `setups`), in the
    /// order of the job's datum features. None while nothing has been taught.
    #[must_use]
    pub fn reference_mm(&self, place: usize) -> Option<Vec<[f64; 3]>> {
        if self.job.reference == Reference::Given {
            return datums(&self.job).map(|f| f.position_mm).collect();
        }
        match self.setups.iter().position(Setup::is_taught) {
            Some(taught) if place >= taught => self.setups[taught].positions_mm(&self.job),
            _ => self.taught_mm.clone(),
        }
    }

    /// What the job says about a feature.
    #[must_use]
    pub fn spec(&self, name: &str) -> Option<&FeatureSpec> {
        self.job.features.iter().find(|f| f.name == name)
    }
}

impl Setup {
    /// Whether this setup became the reference.
    #[must_use]
    pub fn is_taught(&self) -> bool {
        self.verdict
            .remarks
            .iter()
            .any(|r| r.reason == Reason::Taught)
    }

    /// The latest result of a feature on this setup.
    #[must_use]
    pub fn feature(&self, name: &str) -> Option<&FeatureResult> {
        self.features.iter().rfind(|f| f.name == name)
    }

    /// Measured position of a feature that may take part in a registration.
    #[must_use]
    pub fn position_mm(&self, name: &str) -> Option<[f64; 3]> {
        self.feature(name)
            .filter(|f| f.is_ok())
            .and_then(|f| f.fit.as_ref()?.shape.position_mm())
            .filter(|p| p.iter().all(|c| c.is_finite()))
    }

    /// Measured positions of all datum features; none if one is missing.
    #[must_use]
    pub fn positions_mm(&self, job: &Job) -> Option<Vec<[f64; 3]>> {
        datums(job).map(|f| self.position_mm(&f.name)).collect()
    }

    /// The heading, also where the caller gave none.
    #[must_use]
    pub fn heading(&self) -> String {
        if self.title.is_empty() {
            format!("Clamping {}", self.verdict.setup)
        } else {
            self.title.clone()
        }
    }
}
