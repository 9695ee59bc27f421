//! The edge of a block, and where it is when it is scanned at several speeds: what time does to a scan shows in full
//! where the surface ends across the motion.

use nalgebra::Vector3;
use umi_kinematics::AxisChain;
use umi_scan::ScanError;
use umi_virtual::scene::Scene;

use super::mount::MountError;
use super::station::{Placed, Stop, TableMachine, place};

/// So far before and behind the edge a scan goes: more than the mount as drawn is off.
const REACH_MM: f64 = 8.0;
/// The laser's line ends by its own field beyond this, and not by the edge.
const FIELD_MM: f64 = 25.0;

/// A block whose top is at Z = 0, and ends at X = 0.
fn scene() -> Result<Scene, MountError> {
    Ok(Scene::parse(
        "[[body]]\nname = \"BLOCK\"\nshape = { block = { size_mm = [80.0, 120.0, 20.0] } }\n\
         position_mm = [-40.0, 0.0, 0.0]\n",
    )?)
}

/// A pass over the edge along X.
fn pass(station: &TableMachine, speed_mm_per_s: f64, step_mm: f64) -> Vec<Stop> {
    let count = (2.0 * REACH_MM / step_mm).floor() as u32;
    (0..=count)
        .map(|number| {
            let x = (step_mm * f64::from(number) - REACH_MM) * speed_mm_per_s.signum();
            let mut speed = [0.0; 5];
            speed[0] = speed_mm_per_s;
            Stop {
                q: station.aim(&Vector3::new(x, 0.0, 0.0), &Vector3::zeros(), 0.0, 0.0),
                speed,
                at_us: 1e6 + f64::from(number) * step_mm / speed_mm_per_s.abs() * 1e6,
            }
        })
        .collect()
}

/// Where the line of a profile runs over the edge: half a sample behind the last one that it has on the block. None
/// where it lies on one side of it altogether.
fn crossing(profile: &Placed) -> Option<Vector3<f64>> {
    let (n, samples) = (profile.samples.len(), &profile.samples);
    let at = |k: usize| profile.points.get(k).copied();
    let within = |k: usize| samples.get(k).is_some_and(|s| s.x_mm.abs() < FIELD_MM);
    let (last, before) = match (within(0), within(n.checked_sub(2)? + 1)) {
        (true, false) => (0, 1),
        (false, true) => (n - 1, n - 2),
        _ => return None,
    };
    Some(at(last)? + (at(last)? - at(before)?) / 2.0)
}

/// Where the edge is along X, when it is scanned at a speed (negative: backwards) with positions that are `late_us`
/// older than their profiles; 0 with the board, which takes them at the trigger.
///
/// # Errors
/// The scan cannot be paired; `no_edge` where no profile runs over it.
pub fn place_along_x(
    station: &mut TableMachine,
    machine: &AxisChain,
    speed_mm_per_s: f64,
    late_us: f64,
) -> Result<f64, MountError> {
    let step_mm = (speed_mm_per_s.abs() * 1e-3).max(0.1);
    let stops = pass(station, speed_mm_per_s, step_mm);
    let mut recording = station.record(&scene()?, &stops);
    let shift = (speed_mm_per_s * late_us * 1e-6 * 1e3).round() as i64;
    for latch in &mut recording.triggers.latches {
        if let Some(x) = latch.counts.first_mut().and_then(Option::as_mut) {
            *x -= shift;
        }
    }
    let profiles = place(&recording, machine)?;
    let found: Vec<f64> = profiles.iter().filter_map(crossing).map(|p| p.x).collect();
    if found.is_empty() {
        return Err(ScanError::refused("no_edge", "no profile runs over the edge").into());
    }
    Ok(found.iter().sum::<f64>() / found.len() as f64)
}
