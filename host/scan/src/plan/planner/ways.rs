//! Other axis values for the same poses: the machine's other branches, and the line the other way round.
//!
//! What a pass sees is its poses; how far the axes must turn to it and from it is theirs. So the order of the passes chooses
//! among all ways to drive each.

use nalgebra::Vector3;

use super::super::drive::axes::rounded;
use super::super::drive::realise::{Pass, Realiser};
use super::super::machine::{PlanMachine, SensorPose};
use super::super::proof::see::Eye;
use super::super::spec::ScanSpec;
use umi_kinematics::branches::nearest_turn;

/// Two poses are one by this: mm at the origin, and of a unit vector.
const SAME: f64 = 1e-6;

/// All ways to drive a pass, itself first. A line that lies the other way round must see no less.
pub fn ways(realiser: &Realiser<'_>, eye: &Eye<'_>, pass: Pass) -> Vec<Pass> {
    let (spec, machine) = (realiser.spec, &realiser.spec.machine);
    let mut found = vec![pass];
    let seen = eye.seen_by(&found[0]);
    for turned in [false, true] {
        for start in starts(machine, &found[0].poses[0], turned) {
            let Some(other) = followed(spec, &found[0], start, turned) else {
                continue;
            };
            let known = found.iter().any(|known| {
                let pairs = known.axes[0].iter().zip(&other.axes[0]).skip(3);
                pairs.map(|(a, b)| off_whole_turns(a - b)).all(|d| d < 1e-3)
            });
            if known || !realiser.drivable(&other) {
                continue;
            }
            if turned {
                let sees = eye.seen_by(&other);
                if !seen.iter().all(|k| sees.binary_search(k).is_ok()) {
                    continue;
                }
            }
            found.push(other);
        }
    }
    found
}

fn off_whole_turns(degrees: f64) -> f64 {
    (degrees - 360.0 * (degrees / 360.0).round()).abs()
}

/// Axis values for a pose, or for the same with the line the other way round.
fn starts(machine: &PlanMachine, pose: &SensorPose, turned: bool) -> Vec<Vec<f64>> {
    let line: Vector3<f64> = if turned { -pose.line } else { pose.line };
    machine
        .inverse(&pose.origin_mm, &pose.beam, Some(&line))
        .map(|reached| reached.solutions)
        .unwrap_or_default()
}

/// The pass from other axis values on, each pose by the nearest ones; none where the axes would jump.
fn followed(spec: &ScanSpec, pass: &Pass, start: Vec<f64>, turned: bool) -> Option<Pass> {
    let machine = &spec.machine;
    let limits = machine.limits();
    let mut axes: Vec<Vec<f64>> = Vec::with_capacity(pass.poses.len());
    let mut poses = Vec::with_capacity(pass.poses.len());
    for pose in &pass.poses {
        let here = match axes.last() {
            None => start.clone(),
            Some(before) => {
                let mut best: Option<(f64, Vec<f64>)> = None;
                for mut set in starts(machine, pose, turned) {
                    let mut most: f64 = 0.0;
                    for k in 3..set.len() {
                        set[k] = nearest_turn(set[k], limits[k], before[k])?;
                        most = most.max((set[k] - before[k]).abs());
                    }
                    if best.as_ref().is_none_or(|(least, _)| most < *least) {
                        best = Some((most, set));
                    }
                }
                let (most, set) = best?;
                if most > spec.plan.max_turn_deg * 0.999 {
                    return None;
                }
                set
            }
        };
        let here: Vec<f64> = here.into_iter().map(rounded).collect();
        let there = machine.forward(&here);
        let line = if turned { -pose.line } else { pose.line };
        let off = (there.origin_mm - pose.origin_mm)
            .amax()
            .max((there.beam - pose.beam).amax())
            .max((there.line - line).amax());
        if off > SAME {
            return None;
        }
        axes.push(here);
        poses.push(there);
    }
    Some(Pass { axes, poses })
}
