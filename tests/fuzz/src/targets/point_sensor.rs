//! What comes of a distance sensor and what is said of it: the text of its readings, the control's lines, files of
//! readings, balls and calibrations. The first byte says which. Held against what a caller may rely on:
//!
//! * no panic, no overflow;
//! * a place that says OK has a point of numbers, captures, and none of them lost; no other has a point;
//! * no more readings are paired than there were captures;
//! * a calibration has numbers, and a unit vector on the side that was asked for.

use std::io::Cursor;

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::{
    CaptureStation, PlaceState, ReadingText, StationRecord, StationSetup, check_value,
};
use umi_core::point::{PointQuestion, ResidualNoise};
use umi_core::units::{Micros, Point};
use umi_scan::format::table::TableReader;
use umi_scan::point_sensor::calibration::{self, CalibrationQuestion};
use umi_scan::point_sensor::{cloud, readings, spheres};

/// One input.
pub fn one(data: &[u8]) {
    let Some((kind, rest)) = data.split_first() else {
        return;
    };
    match kind % 3 {
        0 => station(rest),
        1 => calibrated(rest),
        _ => drop(calibration::parse(rest)),
    }
}

/// A station between a sensor and a control, both of which say anything: each step is a byte that says what comes
/// and one that says how much of it.
fn station(steps: &[u8]) {
    let mut station = CaptureStation::new(StationSetup {
        sensor: PointSensor {
            offset: Point::from_mm(1.0, -1.0, -100.0),
            direction: Vector3::new(0.0, 0.0, -1.0),
            gain: 1.0,
        },
        counts_per_mm: [1000.0; 3],
        origin_counts: [0; 3],
        max_rate_hz: 9000.0,
        power_max: 4095.0,
        text: ReadingText::default(),
    });
    let (mut now, mut counts) = (0_u64, [0_i64, 0, 144_000]);
    let (mut number, mut sequence, mut latches) = (500_u32, 0_i64, 0_u32);
    let mut steps = steps.iter().copied();
    while let (Some(kind), Some(value)) = (steps.next(), steps.next()) {
        let signed = i64::from(value) - 128;
        match kind % 10 {
            // Captures with their readings, as they should come; the surface is at 0.
            0 | 1 => {
                for _ in 0..=value % 32 {
                    station.latched(counts, Micros(now));
                    latches += 1;
                    let gamma = counts[2] as f64 / 1000.0 - 100.0 + f64::from(number % 3) * 1e-4;
                    let text = format!("{number:05} {gamma:.6} 90.0 3000\r\n");
                    text.bytes()
                        .for_each(|byte| station.sensor_byte(byte, Micros(now)));
                    number = number.wrapping_add(1);
                }
            }
            // One without the other.
            2 => {
                station.latched(counts, Micros(now));
                latches += 1;
            }
            3 => number = number.wrapping_add(signed as u32),
            // Anything.
            4 => {
                let piece: Vec<u8> = steps.by_ref().take(value.into()).collect();
                for byte in piece {
                    station.sensor_byte(byte, Micros(now));
                }
            }
            5 => {
                let piece: Vec<u8> = steps.by_ref().take(value.into()).collect();
                for byte in piece {
                    station.command_byte(byte, counts);
                }
            }
            6 => {
                counts[usize::from(value % 3)] += signed * 25;
                station.missed(u32::from(value == 7));
            }
            7 => {
                now += 1 << (value % 24);
                station.tick(Micros(now));
            }
            // A line as a macro says it.
            _ => {
                sequence += 1;
                let command = i64::from(value % 8) + 1;
                let mut values = vec![sequence, command];
                if command == 1 {
                    let captures = i64::from(value / 8) + 1;
                    values.extend([2000, 2000, captures, 44, i64::from(value & 1), 1]);
                }
                let thousandths: Vec<i64> = values.iter().map(|value| value * 1000).collect();
                let check = check_value(&thousandths);
                let mut line = "UMIP ".to_owned();
                for (letter, value) in "SKABDEFH".chars().zip(values) {
                    line.push_str(&format!("{letter}{value} "));
                }
                line.push_str(&format!("C{check}\r\n"));
                line.bytes()
                    .for_each(|byte| station.command_byte(byte, counts));
            }
        }
        while let Some(record) = station.take_record() {
            let StationRecord::Place(place) = record else {
                continue;
            };
            assert_eq!(place.state == PlaceState::Ok, place.point.is_some());
            if let Some(point) = place.point {
                assert!(point.is_finite() && place.gamma.0.is_finite());
                assert!(place.captures > 0 && place.lost == 0, "{place:?}");
            }
        }
        let _ = station.take_answer();
        assert!(station.counters().paired <= latches);
    }
}

/// Readings and balls from a file, with `====` between the two; the first byte says what is asked.
fn calibrated(file: &[u8]) {
    let Some((asked, file)) = file.split_first() else {
        return;
    };
    let Ok(text) = std::str::from_utf8(file) else {
        return;
    };
    let (table, balls) = text.split_once("====\n").unwrap_or((text, ""));
    let balls = spheres::parse(balls);
    let Ok(table) = TableReader::new(Cursor::new(table.as_bytes()), "fuzz".into()) else {
        return;
    };
    let (Ok(readings), Ok(balls)) = (readings::from_table(table, None), balls) else {
        return;
    };
    let rough = Vector3::new(0.0, 0.0, if asked & 1 == 0 { -1.0 } else { 1.0 });
    let question = CalibrationQuestion {
        wanted: PointQuestion {
            direction: rough,
            free_radius: asked & 2 != 0,
            free_gain: asked & 4 != 0,
            noise: if asked & 8 == 0 {
                ResidualNoise::Everywhere
            } else {
                ResidualNoise::AlongBeam
            },
        },
        max_rms_mm: None,
    };
    let Ok(found) = calibration::find(&readings, &balls, &question) else {
        return;
    };
    let direction = Vector3::from(found.direction);
    assert!((direction.norm() - 1.0).abs() < 1e-12 && direction.dot(&rough) > 0.0);
    let covariance = found.covariance.iter().flatten().flatten();
    let numbers = found.offset_mm.iter().chain(&found.residuals_mm);
    assert!(numbers.chain(covariance).all(|number| number.is_finite()));
    // What it says, it reads; and the points lie where the residuals say.
    let known = calibration::parse(&serde_json::to_vec(&found).unwrap()).expect("its own file");
    let points = cloud::points(&readings, &known, None).points;
    assert_eq!(points.len(), found.residuals_mm.len());
}
