//! What one setup alone cannot show, and the guards against it.

mod again;
mod asking;
mod coordinates;
mod runs;
mod teaching;

use umi_protocol::job::{AgainSpec, Doubt, Lessons, ProbingSpec};
use umi_protocol::message::{TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat};

use super::*;
use crate::dprnt::{Announced, Moved, Said};

/// As `job`, with room for all of a session's clampings against any of them.
fn job() -> Job {
    let mut job = super::job();
    job.limits.rotation_deg = 6.0;
    job.limits.shift_mm = [120.0, 120.0, 0.2];
    job.limits.expected_error_mm = Some(0.02);
    job
}

/// Features 1, 2 and 3 of a session's clamping, in another order.
fn clamping(number: usize, order: [usize; 3]) -> Vec<Block> {
    let blocks = session_a();
    order
        .map(|sphere| blocks[3 * number + sphere - 1].clone())
        .to_vec()
}

fn whole_session(order: [usize; 3]) -> Vec<Block> {
    (0..5).flat_map(|number| clamping(number, order)).collect()
}

/// The control says that this run teaches.
fn says(run: &mut Run, outcome: &mut Outcome, of_run: u32, again: bool) {
    let said = Said::Teach { again };
    let announced = Announced { run: of_run, said };
    run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
}

/// Lines with a run number: hits of features by their id.
fn send(run: &mut Run, outcome: &mut Outcome, blocks: &[Block], of_run: u32) {
    for (name, points) in blocks {
        let id: usize = name.strip_prefix("SPHERE").unwrap().parse().unwrap();
        probe(run, outcome, id, points, of_run as usize);
    }
}

/// The hits of one feature, by its id, in a run.
fn probe(run: &mut Run, outcome: &mut Outcome, id: usize, points: &[[f64; 3]], of_run: usize) {
    for point in points {
        let mut hit = hit(*point);
        hit.feature_id = Some(u16::try_from(id).unwrap());
        hit.run = Some(u32::try_from(of_run).unwrap());
        run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
    }
}
