//! What is simulated.

use umi_protocol::job::Job;

/// What is measured: a job and the places of its features in the taught clamping.
#[derive(Clone, Debug)]
pub struct SimulatedPlan {
    /// The job.
    pub job: Job,
    /// Places of the features, in the job's order, mm.
    pub places: Vec<[f64; 3]>,
    /// How many of them move with the part; those behind stay on the table.
    pub moving: usize,
    /// Datum features, the first of `places`.
    pub datums: usize,
    /// From and to which size a damage that has one is, mm, in place of its own sizes; of Z's
    /// scale, at the lowest feature.
    pub sizes_mm: Option<[f64; 2]>,
}
