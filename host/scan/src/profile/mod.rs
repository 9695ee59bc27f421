//! What a laser line sensor tells: profiles, each with its stamp.
//!
//! * [`Stamp`]: who a profile is: its place in the stream, frame counter, clock, encoder.
//! * [`ProfilePoint`]: one point of the laser line in the sensor's frame, `(x, 0, z)`.
//! * [`frames`]: duplicates and losses by the frame counter.

pub mod frames;

/// Who a profile is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamp {
    /// Its place in the stream as it came, from 0.
    pub profile: u64,
    /// The sensor's frame counter, as the file has it.
    pub frame: u64,
    /// The sensor's clock in true microseconds.
    pub t_us: f64,
    /// The sensor's own encoder counter, if it has one.
    pub encoder: Option<i64>,
}

/// A point of the laser line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// Its place in the sensor's array.
    pub index: u32,
    /// Along the laser line.
    pub x_mm: f64,
    /// Towards the sensor.
    pub z_mm: f64,
}

/// A profile as a reader hands it out.
#[derive(Debug, Clone, Copy)]
pub struct Profile<'a> {
    /// Who it is.
    pub stamp: Stamp,
    /// Its samples with a range.
    pub samples: &'a [ProfilePoint],
    /// How bright each of these samples was, in the sensor's own measure, as many as there are samples; none where the
    /// stream does not say, or nobody asked.
    pub intensities: Option<&'a [f64]>,
    /// How many samples of the file have no range.
    pub invalid: u64,
}
