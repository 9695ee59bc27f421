//! The laser line scanner of a scene.

use nalgebra::Vector3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use umi_kinematics::Pose;

use super::SceneError;

/// A laser plane and a camera beside it, carried by the machine's axes.
///
/// In the sensor's frame x goes along the laser line and z towards the sensor; z is 0 in the
/// middle of the measuring range. Where two figures are given, the first is at the near end of
/// the range and the second at the far end. What is 0 is switched off.
#[derive(Clone, Debug, PartialEq)]
pub struct LineScannerSpec {
    /// The sensor's axes in those of the machine, as rows.
    pub rotation: [[f64; 3]; 3],
    /// Its origin, with the axes of the machine at 0.
    pub translation_mm: [f64; 3],
    /// From the housing to the near end of the range.
    pub clearance_mm: f64,
    /// Measuring range along z.
    pub range_mm: f64,
    /// Width of the field.
    pub field_mm: [f64; 2],
    /// Columns of the camera: the width of a profile's array.
    pub samples: u32,
    /// From column to column along the line.
    pub pitch_um: [f64; 2],
    /// From the laser to the camera, along y.
    pub baseline_mm: f64,
    /// Where the camera is instead, in the sensor's frame.
    pub camera_mm: Option<[f64; 3]>,
    /// Standard deviation of a sample at normal incidence; it grows with 1/cos of the incidence.
    pub noise_um: [f64; 2],
    /// Standard deviation of the speckle, which neighbouring samples share.
    pub speckle_um: f64,
    /// Over so many samples it falls to 1/e.
    pub speckle_samples: f64,
    /// Beyond this angle of the laser to the surface's normal nothing comes back.
    pub steepest_deg: f64,
    /// A surface that mirrors: within this angle of the mirror's direction the camera is
    /// saturated, and the reflex of a flank that is too steep gives false points.
    pub gloss_deg: f64,
    /// Share of the samples at an edge that lie somewhere between both sides of it.
    pub edge_share: f64,
    /// A profile is the mean over its motion in this time.
    pub exposure_us: f64,
    /// From one trigger to the next that is taken; what comes earlier is dropped and counted.
    pub busy_us: f64,
    /// A shorter pulse at the trigger input is none.
    pub least_pulse_us: f64,
    /// The sensor's own rhythm, with a pulse to the board at each exposure; 0: the board
    /// triggers.
    pub every_us: f64,
    /// The same by its encoder input: an exposure each time that it has counted so many, either way; 0: not so.
    pub every_counts: u32,
    /// What the sensor's clock shows when the board's shows 0.
    pub clock_offset_us: f64,
    /// How much faster the sensor's clock runs.
    pub clock_drift_ppm: f64,
    /// The axis that its encoder input counts: 0 to 2 for X to Z; 255 is none.
    pub encoder_axis: u8,
    /// Profiles of evenly spaced z instead of pairs of x and z.
    pub evenly_spaced: bool,
    /// A message of intensities behind each profile's, a byte a sample.
    pub intensities: bool,
    /// Share of the profiles whose messages are lost on the way.
    pub lost_share: f64,
    /// Share of the profiles whose messages come twice.
    pub repeated_share: f64,
}

/// The presets, by name.
pub const SCANNER_PRESETS: [&str; 3] = ["gocator", "s2", "roland"];

impl LineScannerSpec {
    /// A known sensor.
    ///
    /// * `gocator`: clearance, range, field, points and resolutions of A. Sawula's thesis
    ///   (2013), table 6.1; its resolution along z is taken for the noise.
    /// * `s2`: 60 x 50 mm at 205 mm (Paludo and others).
    /// * `roland`: a scanner of a millimetre's pitch, right within 0.05 mm (two standard
    ///   deviations).
    #[must_use]
    pub fn preset(name: &str) -> Option<Self> {
        let gocator = Self {
            // Looks down: z up, x along the machine's X.
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation_mm: [0.0; 3],
            clearance_mm: 90.0,
            range_mm: 80.0,
            field_mm: [47.0, 85.0],
            samples: 1280,
            pitch_um: [44.0, 75.0],
            baseline_mm: 60.0,
            camera_mm: None,
            noise_um: [6.0, 14.0],
            speckle_um: 0.0,
            speckle_samples: 4.0,
            steepest_deg: 80.0,
            gloss_deg: 0.0,
            edge_share: 0.0,
            exposure_us: 0.0,
            busy_us: 1000.0,
            least_pulse_us: 20.0,
            every_us: 0.0,
            every_counts: 0,
            clock_offset_us: 0.0,
            clock_drift_ppm: 0.0,
            encoder_axis: 255,
            evenly_spaced: false,
            intensities: false,
            lost_share: 0.0,
            repeated_share: 0.0,
        };
        Some(match name {
            "gocator" => gocator,
            "s2" => Self {
                clearance_mm: 180.0,
                range_mm: 50.0,
                field_mm: [60.0; 2],
                samples: 640,
                pitch_um: [94.0; 2],
                baseline_mm: 100.0,
                noise_um: [10.0; 2],
                ..gocator
            },
            "roland" => Self {
                clearance_mm: 100.0,
                range_mm: 60.0,
                field_mm: [60.0; 2],
                samples: 60,
                pitch_um: [1000.0; 2],
                baseline_mm: 80.0,
                noise_um: [25.0; 2],
                ..gocator
            },
            _ => return None,
        })
    }

    /// The mount: the sensor's frame in that of the machine, its axes at 0.
    ///
    /// # Errors
    /// The rotation is none.
    pub fn mount(&self) -> Result<Pose, String> {
        Pose::from_rows(&self.rotation, &self.translation_mm)
    }

    /// What a place of z shares of its far end: 0 at the near end of the range, 1 at the far one.
    #[must_use]
    pub fn depth(&self, z_mm: f64) -> f64 {
        0.5 - z_mm / self.range_mm
    }

    /// A figure between that of the near end and that of the far end.
    #[must_use]
    pub fn between([near, far]: [f64; 2], depth: f64) -> f64 {
        near + (far - near) * depth
    }

    /// Where the camera is, in the sensor's frame.
    #[must_use]
    pub fn camera_mm(&self) -> Vector3<f64> {
        self.camera_mm.map_or_else(
            || Vector3::new(0.0, self.baseline_mm, self.housing_mm()),
            Vector3::from,
        )
    }

    /// The height of the housing over the middle of the range.
    #[must_use]
    pub fn housing_mm(&self) -> f64 {
        self.range_mm / 2.0 + self.clearance_mm
    }

    /// What no single number tells.
    pub(super) fn check(&self) -> Result<(), SceneError> {
        let refuse = |message: String| Err(SceneError { message });
        if let Err(what) = self.mount() {
            return refuse(format!("`line_scanner.rotation`: {what}"));
        }
        let [near, far] = self.pitch_um;
        if far < near {
            return refuse("`line_scanner.pitch_um` needs the near end first: it grows".into());
        }
        if self.encoder_axis > 2 && self.encoder_axis != 255 {
            return refuse(
                "`line_scanner.encoder_axis` is 0 to 2 for X to Z; leave it out for none".into(),
            );
        }
        if self.every_us > 0.0 && self.every_us < 20.0 {
            return refuse("`line_scanner.every_us` is 20 or more; 0: the board triggers".into());
        }
        if self.every_counts > 0 && (self.every_us > 0.0 || self.encoder_axis == 255) {
            return refuse(
                "`line_scanner.every_counts` needs an `encoder_axis`, and no `every_us` beside it"
                    .into(),
            );
        }
        Ok(())
    }
}

/// What a file may say; what it does not say is the preset's.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    preset: Option<String>,
    rotation: Option<[[f64; 3]; 3]>,
    translation_mm: Option<[f64; 3]>,
    clearance_mm: Option<f64>,
    range_mm: Option<f64>,
    field_mm: Option<[f64; 2]>,
    samples: Option<u32>,
    pitch_um: Option<[f64; 2]>,
    baseline_mm: Option<f64>,
    camera_mm: Option<[f64; 3]>,
    noise_um: Option<[f64; 2]>,
    speckle_um: Option<f64>,
    speckle_samples: Option<f64>,
    steepest_deg: Option<f64>,
    gloss_deg: Option<f64>,
    edge_share: Option<f64>,
    exposure_us: Option<f64>,
    busy_us: Option<f64>,
    least_pulse_us: Option<f64>,
    every_us: Option<f64>,
    every_counts: Option<u32>,
    clock_offset_us: Option<f64>,
    clock_drift_ppm: Option<f64>,
    encoder_axis: Option<u8>,
    evenly_spaced: Option<bool>,
    intensities: Option<bool>,
    lost_share: Option<f64>,
    repeated_share: Option<f64>,
}

impl<'de> Deserialize<'de> for LineScannerSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = Text::deserialize(deserializer)?;
        let name = text.preset.as_deref().unwrap_or("gocator");
        let Some(of) = Self::preset(name) else {
            return Err(D::Error::custom(format!(
                "there is no scanner {name:?}: presets are {}",
                SCANNER_PRESETS.join(", ")
            )));
        };
        Ok(Self {
            rotation: text.rotation.unwrap_or(of.rotation),
            translation_mm: text.translation_mm.unwrap_or(of.translation_mm),
            clearance_mm: text.clearance_mm.unwrap_or(of.clearance_mm),
            range_mm: text.range_mm.unwrap_or(of.range_mm),
            field_mm: text.field_mm.unwrap_or(of.field_mm),
            samples: text.samples.unwrap_or(of.samples),
            pitch_um: text.pitch_um.unwrap_or(of.pitch_um),
            baseline_mm: text.baseline_mm.unwrap_or(of.baseline_mm),
            camera_mm: text.camera_mm.or(of.camera_mm),
            noise_um: text.noise_um.unwrap_or(of.noise_um),
            speckle_um: text.speckle_um.unwrap_or(of.speckle_um),
            speckle_samples: text.speckle_samples.unwrap_or(of.speckle_samples),
            steepest_deg: text.steepest_deg.unwrap_or(of.steepest_deg),
            gloss_deg: text.gloss_deg.unwrap_or(of.gloss_deg),
            edge_share: text.edge_share.unwrap_or(of.edge_share),
            exposure_us: text.exposure_us.unwrap_or(of.exposure_us),
            busy_us: text.busy_us.unwrap_or(of.busy_us),
            least_pulse_us: text.least_pulse_us.unwrap_or(of.least_pulse_us),
            every_us: text.every_us.unwrap_or(of.every_us),
            every_counts: text.every_counts.unwrap_or(of.every_counts),
            clock_offset_us: text.clock_offset_us.unwrap_or(of.clock_offset_us),
            clock_drift_ppm: text.clock_drift_ppm.unwrap_or(of.clock_drift_ppm),
            encoder_axis: text.encoder_axis.unwrap_or(of.encoder_axis),
            evenly_spaced: text.evenly_spaced.unwrap_or(of.evenly_spaced),
            intensities: text.intensities.unwrap_or(of.intensities),
            lost_share: text.lost_share.unwrap_or(of.lost_share),
            repeated_share: text.repeated_share.unwrap_or(of.repeated_share),
        })
    }
}
