//! A ball of 25.4 mm: its diameter.

use nalgebra::Vector3;
use umi_core::fit::{SphereFit, sphere};
use umi_core::units::Point;
use umi_kinematics::AxisChain;
use umi_scan::ScanError;
use umi_virtual::scene::Scene;

use super::mount::MountError;
use super::station::{Recording, Stop, TableMachine, place};

/// Its diameter.
pub const DIAMETER_MM: f64 = 25.4;
/// What the thesis was off in its figure 6.6.
pub const THESIS_OFF_MM: f64 = 0.0684;
/// At a steeper incidence the noise is more than that of a flat place: such samples are left
/// out. Height over the centre, of the radius.
const CAP: f64 = 0.3;

fn scene() -> Result<Scene, MountError> {
    let radius = DIAMETER_MM / 2.0;
    Ok(Scene::parse(&format!(
        "[[body]]\nname = \"BALL\"\nshape = {{ sphere = {{ radius_mm = {radius:?} }} }}\n\
         position_mm = [0.0, 0.0, {radius:?}]\n"
    ))?)
}

/// A pass over the ball along X.
fn pass(station: &TableMachine, speed_mm_per_s: f64, step_mm: f64) -> Vec<Stop> {
    let half = DIAMETER_MM / 2.0 + 1.0;
    let count = (2.0 * half / step_mm).floor() as u32;
    let seen = Vector3::zeros();
    (0..=count)
        .map(|number| {
            let along = -half + step_mm * f64::from(number);
            let x = along * speed_mm_per_s.signum();
            let mut speed = [0.0; 5];
            speed[0] = speed_mm_per_s;
            Stop {
                q: station.aim(&Vector3::new(x, 0.0, DIAMETER_MM * 0.75), &seen, 0.0, 0.0),
                speed,
                at_us: 1e6 + f64::from(number) * step_mm / speed_mm_per_s.abs() * 1e6,
            }
        })
        .collect()
}

fn fitted(recording: &Recording, machine: &AxisChain) -> Result<SphereFit, ScanError> {
    let radius = DIAMETER_MM / 2.0;
    let points: Vec<Point> = place(recording, machine)?
        .iter()
        .flat_map(|profile| profile.points.iter().step_by(5))
        .filter(|p| p.z - radius > CAP * radius)
        .map(|p| Point { mm: *p })
        .collect();
    sphere::fit(&points)
        .map_err(|error| ScanError::refused("no_ball", format_args!("no ball: {error}")))
}

/// The diameter of the ball in a scan of 0.25 mm a step.
///
/// # Errors
/// The scan cannot be paired, or holds no ball.
pub fn diameter(station: &mut TableMachine, machine: &AxisChain) -> Result<f64, MountError> {
    let stops = pass(station, 25.0, 0.25);
    let recording = station.record(&scene()?, &stops);
    Ok(2.0 * fitted(&recording, machine)?.radius.0)
}
