//! The data channel, byte for byte as a Gocator's: little endian, a stamp, its profile and, where they are switched
//! on, its intensities.

use super::LineProfile;
use crate::scene::LineScannerSpec;

/// The sensor's clock counts 1.024 times as fast as microseconds pass.
const TICKS_PER_US: f64 = 1.024;
/// A sample without a range.
const NO_RANGE: i16 = i16::MIN;
/// The last message of its group.
const LAST: u16 = 0x8000;
const STAMP: u16 = 1;
const PAIRS: u16 = 5;
const EVENLY_SPACED: u16 = 6;
const INTENSITIES: u16 = 7;
/// Bytes of a stamp, as the sensors of today send it.
const STAMP_BYTES: u16 = 56;
/// Bytes of a profile's attributes, from their own size on.
const ATTRIBUTE_BYTES: u16 = 40;
/// Bytes of the attributes of intensities.
const INTENSITY_ATTRIBUTE_BYTES: u16 = 32;
/// Steps of a range and of a field: not all that an `i16` has.
const STEPS: f64 = 65_000.0;

/// Who a profile is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameStamp {
    /// The sensor's counter.
    pub frame: u64,
    /// The sensor's clock, true microseconds.
    pub t_us: f64,
    /// Its encoder input.
    pub encoder: i64,
}

/// The messages of a profile: its stamp, its samples, and how bright they were where that is switched on.
#[must_use]
pub fn encode(stamp: &FrameStamp, profile: &LineProfile, spec: &LineScannerSpec) -> Vec<u8> {
    let mut bytes = message(STAMP, &stamp_body(stamp));
    let (kind, body, bright) = if spec.evenly_spaced {
        let (body, bright) = spaced_body(profile, spec);
        (EVENLY_SPACED, body, bright)
    } else {
        let (body, bright) = pairs_body(profile, spec);
        (PAIRS, body, bright)
    };
    if spec.intensities {
        bytes.extend(message(kind, &body));
        let body = intensity_body(&body, &bright, spec);
        bytes.extend(message(INTENSITIES | LAST, &body));
    } else {
        bytes.extend(message(kind | LAST, &body));
    }
    bytes
}

fn message(control: u16, body: &[u8]) -> Vec<u8> {
    let size = u32::try_from(6 + body.len()).unwrap_or(u32::MAX);
    [&size.to_le_bytes()[..], &control.to_le_bytes(), body].concat()
}

fn stamp_body(stamp: &FrameStamp) -> Vec<u8> {
    let mut body = 1_u32.to_le_bytes().to_vec();
    body.extend(STAMP_BYTES.to_le_bytes());
    // Source and a reserved byte.
    body.extend([0, 0]);
    let begin = body.len();
    // A clock before 0 is none: the counter has no sign.
    let ticks = (stamp.t_us * TICKS_PER_US).round().max(0.0) as u64;
    body.extend(stamp.frame.to_le_bytes());
    body.extend(ticks.to_le_bytes());
    body.extend(stamp.encoder.to_le_bytes());
    // Encoder at the index mark, status, serial number and what is reserved.
    body.resize(begin + usize::from(STAMP_BYTES), 0);
    body
}

fn attributes(
    width: u32,
    [x_scale_nm, z_scale_nm]: [u32; 2],
    x_offset_um: i32,
    spec: &LineScannerSpec,
) -> Vec<u8> {
    let mut body = ATTRIBUTE_BYTES.to_le_bytes().to_vec();
    for value in [1, width, x_scale_nm, z_scale_nm] {
        body.extend(value.to_le_bytes());
    }
    for offset in [x_offset_um, 0] {
        body.extend(offset.to_le_bytes());
    }
    // Source, then the exposure in nanoseconds.
    body.push(0);
    body.extend(((spec.exposure_us * 1e3) as u32).to_le_bytes());
    body.resize(2 + usize::from(ATTRIBUTE_BYTES), 0);
    body
}

/// What a profile's message says of its width, scale and offset along x, and a byte a sample.
fn intensity_body(profile: &[u8], bright: &[u8], spec: &LineScannerSpec) -> Vec<u8> {
    let mut body = INTENSITY_ATTRIBUTE_BYTES.to_le_bytes().to_vec();
    // Count, width and scale of x; then its offset, behind the scale of z.
    body.extend_from_slice(profile.get(2..14).unwrap_or(&[0; 12]));
    body.extend_from_slice(profile.get(18..22).unwrap_or(&[0; 4]));
    body.push(0);
    body.extend(((spec.exposure_us * 1e3) as u32).to_le_bytes());
    // Camera, reserved bytes, step of the stream and its number.
    body.resize(2 + usize::from(INTENSITY_ATTRIBUTE_BYTES), 0);
    body.extend_from_slice(bright);
    body
}

/// Nanometres of a step that reaches over a length.
fn scale_nm(length_mm: f64) -> u32 {
    (length_mm * 1e6 / STEPS).ceil().max(1.0) as u32
}

/// A length in steps; the nearest that is no mark.
fn steps(length_mm: f64, scale_nm: u32) -> i16 {
    let steps = (length_mm * 1e6 / f64::from(scale_nm)).round();
    steps.clamp(f64::from(i16::MIN) + 1.0, f64::from(i16::MAX)) as i16
}

/// The samples, and how bright each was.
fn pairs_body(profile: &LineProfile, spec: &LineScannerSpec) -> (Vec<u8>, Vec<u8>) {
    let [near, far] = spec.field_mm;
    // A reading may lie somewhat outside by its noise.
    let scales = [scale_nm(1.1 * near.max(far)), scale_nm(1.1 * spec.range_mm)];
    let mut body = attributes(spec.samples, scales, 0, spec);
    let [x_scale, z_scale] = scales;
    for sample in profile {
        let (x, z) = sample.map_or((NO_RANGE, NO_RANGE), |sample| {
            (steps(sample.x_mm, x_scale), steps(sample.z_mm, z_scale))
        });
        body.extend(x.to_le_bytes());
        body.extend(z.to_le_bytes());
    }
    let bright = (profile.iter()).map(|sample| sample.map_or(0, |s| s.brightness().round() as u8));
    (body, bright.collect())
}

/// Evenly spaced along x: on the line between two neighbours that are not far apart, and so bright.
fn spaced_body(profile: &LineProfile, spec: &LineScannerSpec) -> (Vec<u8>, Vec<u8>) {
    let [near, far] = spec.field_mm;
    let [near_um, far_um] = spec.pitch_um;
    let pitch_mm = near_um.max(far_um) * 1e-3;
    let width = (near.max(far) / pitch_mm).floor().max(1.0);
    let x_scale = (pitch_mm * 1e6).round().max(1.0) as u32;
    let step_mm = f64::from(x_scale) * 1e-6;
    let first_um = (-step_mm * (width - 1.0) / 2.0 * 1e3).round();
    let z_scale = scale_nm(1.1 * spec.range_mm);
    let mut body = attributes(width as u32, [x_scale, z_scale], first_um as i32, spec);
    let mut samples: Vec<_> = profile.iter().flatten().collect();
    samples.sort_by(|a, b| a.x_mm.total_cmp(&b.x_mm));
    let mut bright = Vec::new();
    for index in 0..width as u32 {
        let x = first_um * 1e-3 + step_mm * f64::from(index);
        let behind = samples.partition_point(|sample| sample.x_mm < x);
        let pair = behind
            .checked_sub(1)
            .and_then(|before| Some((samples.get(before)?, samples.get(behind)?)));
        let z = pair.filter(|(a, b)| b.x_mm - a.x_mm <= 2.5 * pitch_mm);
        let (z, light) = z.map_or((NO_RANGE, 0), |(a, b)| {
            let share = (x - a.x_mm) / (b.x_mm - a.x_mm).max(f64::MIN_POSITIVE);
            let light = a.brightness() + share * (b.brightness() - a.brightness());
            let z_mm = a.z_mm + share * (b.z_mm - a.z_mm);
            (steps(z_mm, z_scale), light.round() as u8)
        });
        body.extend(z.to_le_bytes());
        bright.push(light);
    }
    (body, bright)
}
