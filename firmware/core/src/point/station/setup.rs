//! A sensor as it is set up on a board.

use nalgebra::Vector3;
use umi_protocol::point_sensor::{
    LEAST_SENSOR_BAUD, MOST_SENSOR_BAUD, SensorOnBoard, SensorRefusal,
};

use super::StationSetup;
use super::wire::text::COLUMNS;
use crate::point::PointSensor;
use crate::units::Point;

/// Checks a sensor.
///
/// # Errors
/// The first fault found, in the order of the fields.
pub fn check_sensor(sensor: &SensorOnBoard) -> Result<(), SensorRefusal> {
    let numbers = sensor.offset_mm.iter().chain(&sensor.direction);
    let numbers = numbers.chain(&sensor.counts_per_mm);
    let others = [sensor.gain, sensor.max_rate_hz, sensor.power_max];
    if !numbers.chain(&others).all(|value| value.is_finite()) {
        return Err(SensorRefusal::NotFinite);
    }
    let length = crate::fit::solve::linalg::norm(&Vector3::from(sensor.direction));
    if !(length - 1.0).abs().le(&1e-6) {
        return Err(SensorRefusal::Direction);
    }
    if !(0.5..=2.0).contains(&sensor.gain) {
        return Err(SensorRefusal::Gain);
    }
    let is_count = |per_mm: &f64| (1.0..=1e7).contains(&per_mm.abs());
    if !sensor.counts_per_mm.iter().all(is_count) {
        return Err(SensorRefusal::CountsPerMm);
    }
    if !(1.0..=1e5).contains(&sensor.max_rate_hz) {
        return Err(SensorRefusal::Rate);
    }
    if sensor.power_max <= 0.0 {
        return Err(SensorRefusal::Power);
    }
    if !(LEAST_SENSOR_BAUD..=MOST_SENSOR_BAUD).contains(&sensor.baud) {
        return Err(SensorRefusal::Baud);
    }
    let text = &sensor.text;
    let columns = [text.number, text.gamma, text.snr, text.total];
    let is_free = |(at, column): (usize, &u8)| {
        usize::from(*column) < COLUMNS && columns.iter().skip(at + 1).all(|other| other != column)
    };
    if !columns.iter().enumerate().all(is_free) {
        return Err(SensorRefusal::Columns);
    }
    Ok(())
}

impl From<&SensorOnBoard> for StationSetup {
    fn from(sensor: &SensorOnBoard) -> Self {
        let [x, y, z] = sensor.offset_mm;
        Self {
            sensor: PointSensor {
                offset: Point::from_mm(x, y, z),
                direction: Vector3::from(sensor.direction),
                gain: sensor.gain,
            },
            counts_per_mm: sensor.counts_per_mm,
            origin_counts: sensor.origin_counts,
            max_rate_hz: sensor.max_rate_hz,
            power_max: sensor.power_max,
            text: sensor.text.into(),
        }
    }
}
