//! Readings of a point sensor, as they come at a board's second port.

use core::fmt::Write as _;

use heapless::String;
use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::{
    CapturePulses, CaptureStation, ReadingText, StationRecord, StationSetup, check_value,
};
use umi_core::units::{Micros, Point};

/// Captures of a place.
pub const CAPTURES: u32 = 400;

/// Counts of the axes.
const COUNTS: [i64; 3] = [10_000, -20_000, 30_000];

/// Digits of a reading's number.
const NUMBER: usize = 5;

/// Where a distance's last figures stand in a reading's text.
const LAST_FIGURES: core::ops::Range<usize> = 12..15;

/// A station that measures at rest.
pub struct Capturing {
    station: CaptureStation,
    /// The next reading, as the sensor says it.
    text: [u8; 27],
    sequence: i64,
}

impl Capturing {
    /// Configured, its numbers joined.
    #[must_use]
    pub fn begun() -> Option<Self> {
        let mut capturing = Self {
            station: CaptureStation::new(StationSetup {
                sensor: PointSensor {
                    offset: Point::from_mm(1.0, -1.0, -100.0),
                    direction: Vector3::new(0.0, 0.0, -1.0),
                    gain: 1.0,
                },
                counts_per_mm: [10_000.0; 3],
                origin_counts: [0; 3],
                max_rate_hz: 9000.0,
                power_max: 4095.0,
                text: ReadingText::default(),
            }),
            text: *b"00100 44.000000 87.5 3391\r\n",
            sequence: 0,
        };
        let captures = i64::from(CAPTURES);
        capturing.line(&[1, 2000, 2000, captures, 44, 0, 1])?;
        capturing.reading();
        capturing.station.take_answer()?;
        Some(capturing)
    }

    /// A line of the control's.
    fn line(&mut self, values: &[i64]) -> Option<()> {
        self.sequence += 1;
        let mut all = heapless::Vec::<i64, 8>::new();
        all.push(self.sequence * 1000).ok()?;
        let mut text = String::<200>::new();
        write!(text, "UMIP S{} ", self.sequence).ok()?;
        for (letter, value) in ["K", "A", "B", "D", "E", "F", "H"].into_iter().zip(values) {
            all.push(value * 1000).ok()?;
            write!(text, "{letter}{value} ").ok()?;
        }
        writeln!(text, "C{}", check_value(&all)).ok()?;
        for byte in text.bytes() {
            self.station.command_byte(byte, COUNTS);
        }
        Some(())
    }

    /// A capture, and its reading's text.
    fn reading(&mut self) {
        self.station.latched(COUNTS, Micros(0));
        for byte in self.text {
            self.station.sensor_byte(byte, Micros(0));
        }
        // The next number, and a distance whose last figures change with it.
        for digit in self.text.iter_mut().take(NUMBER).rev() {
            if *digit < b'9' {
                *digit += 1;
                break;
            }
            *digit = b'0';
        }
        let [_, _, a, b, c, ..] = self.text;
        if let Some(last) = self.text.get_mut(LAST_FIGURES) {
            last.copy_from_slice(&[a, b, c]);
        }
    }

    /// A place of [`CAPTURES`] captures; None unless it becomes a record, with none lost.
    pub fn place(&mut self) -> Option<()> {
        self.line(&[3])?;
        let mut readings = 0;
        while self.station.order() == CapturePulses::Time {
            self.reading();
            readings += 1;
        }
        self.station.take_answer()?;
        let mut is_placed = false;
        while let Some(record) = self.station.take_record() {
            is_placed = matches!(record, StationRecord::Place(_));
        }
        let counters = self.station.counters();
        let is_whole = counters.lost == 0 && counters.unpaired == 0 && counters.unreadable == 0;
        (is_placed && readings == CAPTURES && is_whole).then_some(())
    }
}
