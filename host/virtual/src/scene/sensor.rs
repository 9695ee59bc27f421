//! The distance sensor of a scene.

use serde::Deserialize;

use super::SceneError;

/// A sensor that measures along one beam, in the spindle like a tool.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointSensorSpec {
    /// The tool number that it answers to.
    pub tool: u32,
    /// From the position of the axes to the zero of the readings.
    pub offset_mm: [f64; 3],
    /// Direction of the beam, of any length.
    pub direction: [f64; 3],
    /// Way to the middle of the depth of field.
    pub stand_off_mm: f64,
    /// Depth of field.
    pub range_mm: f64,
    /// Full width of the beam at half its maximum.
    pub spot_um: f64,
    /// Standard deviation of one capture at the stand-off.
    pub noise_um: f64,
    /// Largest error of linearity, of the depth of field.
    pub linearity_percent: f64,
    /// Half the angular coverage: steepest incidence.
    pub angle_deg: f64,
    /// Most captures a second.
    pub max_rate_hz: f64,
    /// A true length is a reading times one and this.
    #[serde(default)]
    pub gain_error_ppm: f64,
    /// Largest value of the laser's power.
    #[serde(default = "power_max")]
    pub power_max: f64,
}

fn power_max() -> f64 {
    4095.0
}

impl PointSensorSpec {
    /// What no single number tells.
    pub(super) fn check(&self, probe_tool: u32) -> Result<(), SceneError> {
        let refuse = |message: &str| {
            Err(SceneError {
                message: message.to_owned(),
            })
        };
        if self.tool == probe_tool {
            return refuse("`point_sensor.tool` is the probe's number");
        }
        let [x, y, z] = self.direction;
        if x * x + y * y + z * z < 1e-12 {
            return refuse("`point_sensor.direction` has no length");
        }
        if self.range_mm >= 2.0 * self.stand_off_mm {
            return refuse(
                "`point_sensor.range_mm` must be less than twice `point_sensor.stand_off_mm`: it \
                 lies about it",
            );
        }
        Ok(())
    }
}
