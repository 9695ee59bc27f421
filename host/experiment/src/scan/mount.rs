//! The sensor's place, calibrated on one ball with the table tilted and turned.

use nalgebra::Vector3;
use umi_kinematics::{AxisChain, Pose};
use umi_scan::ScanError;
use umi_scan::calibrate::observations::{Observation, Observations};
use umi_scan::calibrate::sensor::{Artefact, SensorAnswer, SensorOptions, sensor};
use umi_virtual::scene::{Scene, SceneError};

use super::station::{Stop, TableMachine, place};

/// The ball.
const RADIUS_MM: f64 = 12.7;
/// Its place on the table.
const CENTRE_MM: [f64; 3] = [25.0, -18.0, 20.0];
/// How many profiles are taken of it.
const PROFILES: u32 = 30;
/// Each so many samples count.
const EACH: usize = 8;

/// The machine with the mount that was found.
#[derive(Clone, Debug)]
pub struct Mounted {
    /// The machine file with it.
    pub machine: AxisChain,
    /// The answer with its uncertainty.
    pub answer: SensorAnswer,
    /// How far the mount is off from the truth: mm, and mrad.
    pub off: (f64, f64),
}

/// Why there is none.
#[derive(Debug)]
pub enum MountError {
    /// The scene cannot be.
    Scene(SceneError),
    /// The scan has no answer.
    Scan(ScanError),
}

impl From<SceneError> for MountError {
    fn from(error: SceneError) -> Self {
        Self::Scene(error)
    }
}

impl From<ScanError> for MountError {
    fn from(error: ScanError) -> Self {
        Self::Scan(error)
    }
}

impl std::fmt::Display for MountError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Scene(error) => error.fmt(f),
            Self::Scan(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for MountError {}

/// Looks at a ball from several poses and finds the mount.
///
/// # Errors
/// The scan or the calibration has no answer.
pub fn calibrate(station: &mut TableMachine) -> Result<Mounted, MountError> {
    let centre = Vector3::from(CENTRE_MM);
    let [x, y, z] = CENTRE_MM;
    let scene = Scene::parse(&format!(
        "[[body]]\nname = \"BALL\"\nshape = {{ sphere = {{ radius_mm = {RADIUS_MM} }} }}\n\
         position_mm = [{x:?}, {y:?}, {z:?}]\n"
    ))?;
    let stops: Vec<Stop> = (0..PROFILES)
        .map(|number| {
            // Poses that go round: tilts to both sides, turns, heights and sides of the ball.
            let turn = f64::from(number);
            let wave = |period: f64| (std::f64::consts::TAU * turn / period).sin();
            let seen = Vector3::new(9.0 * wave(7.3), 7.0 * wave(4.1), 12.0 * wave(5.7));
            Stop {
                q: station.aim(
                    &centre,
                    &seen,
                    25.0 * wave(3.6),
                    41.0 * turn % 360.0 - 180.0,
                ),
                speed: [0.0; 5],
                at_us: 1e6 + 1e5 * turn + 3e3 * wave(2.9),
            }
        })
        .collect();
    let recording = station.record(&scene, &stops);
    let placed = place(&recording, &station.drawn)?;
    let mut all = Observations {
        features: vec!["ball".into()],
        ..Observations::default()
    };
    for (stop, profile) in stops.iter().zip(&placed) {
        all.flanges.push(station.drawn.flange_in_workpiece(&stop.q));
        let flange = all.flanges.len() - 1;
        all.points.extend(
            profile
                .samples
                .iter()
                .step_by(EACH)
                .map(|sample| Observation {
                    flange,
                    feature: 0,
                    seen_mm: Vector3::new(sample.x_mm, 0.0, sample.z_mm),
                }),
        );
    }
    let options = SensorOptions {
        on: Artefact::Sphere,
        radius_mm: Some(RADIUS_MM),
        centres: None,
        hold: [false; 3],
        bars: Vec::new(),
        allow_misfit: false,
        drop_outliers: false,
    };
    let answer = sensor(&all, &station.drawn.sensor, &options)?;
    let found = Pose::from_rows(&answer.rotation, &answer.translation_mm)
        .map_err(|what| ScanError::refused("machine", what))?;
    let truth = &station.truth.sensor;
    let turn = found.rotation * truth.rotation.transpose();
    let skew = Vector3::new(
        turn[(2, 1)] - turn[(1, 2)],
        turn[(0, 2)] - turn[(2, 0)],
        turn[(1, 0)] - turn[(0, 1)],
    );
    let off = (
        (found.translation_mm - truth.translation_mm).norm(),
        skew.norm() / 2.0 * 1e3,
    );
    let machine = AxisChain {
        sensor: found,
        sensor_covariance: answer.best_covariance().copied(),
        ..station.drawn.clone()
    };
    Ok(Mounted {
        machine,
        answer,
        off,
    })
}
