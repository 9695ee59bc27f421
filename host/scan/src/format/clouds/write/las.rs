//! LAS 1.2 and LAZ by the crate `las`: coordinates as whole steps of 0.1 µm about the first point, intensity, and
//! times in seconds, where the format has those of GPS. A point that was placed between latches is a synthetic one, as the
//! standard calls what no sensor placed.

use std::io::BufWriter;

use las::point::Format;
use las::{Builder, Point, Transform, Vector, Writer};

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::format::clouds::LAS_SOFTWARE;
use crate::format::partial::Partial;

/// A step in mm. The farthest point is 2^31 steps away: 214 m.
const STEP_MM: f64 = 1e-4;
const S_PER_US: f64 = 1e-6;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
    compressed: bool,
) -> Result<(), ScanError> {
    let refused = |error: las::Error| partial.refused(error);
    let first = points.next_point()?;
    let about = first.map_or([0.0; 3], |p| p.at);
    let transform = |k: usize| Transform {
        scale: STEP_MM,
        // Whole millimetres, so that steps of different clouds meet.
        offset: about[k].round(),
    };
    let mut builder = Builder::from((1, 2));
    builder.generating_software = LAS_SOFTWARE.into();
    builder.point_format = Format::new(u8::from(style.columns.time)).map_err(refused)?;
    builder.point_format.is_compressed = compressed;
    builder.transforms = Vector {
        x: transform(0),
        y: transform(1),
        z: transform(2),
    };
    let header = builder.into_header().map_err(refused)?;
    let file = partial.begin()?;
    let mut writer =
        Writer::new(BufWriter::with_capacity(1 << 20, file), header).map_err(refused)?;
    let mut next = first;
    while let Some(p) = next {
        let far = (0..3).find(|&k| (p.at[k] - about[k].round()).abs() > STEP_MM * 2e9);
        if far.is_some() || !(0.0..=65535.0).contains(&p.intensity) {
            let what = if far.is_some() {
                "a point lies more than 200 m from the first one"
            } else {
                "an intensity is not within 0 to 65535"
            };
            // The writer closes its file when it is dropped; nothing of it is kept.
            let _ = writer.close();
            return Err(partial.refused(format_args!(
                "{what}: LAS cannot hold it; write .ply instead"
            )));
        }
        writer
            .write_point(Point {
                x: p.at[0],
                y: p.at[1],
                z: p.at[2],
                intensity: p.intensity.round() as u16,
                gps_time: style.columns.time.then_some(p.t_us * S_PER_US),
                return_number: 1,
                number_of_returns: 1,
                is_synthetic: style.columns.interpolated && p.interpolated,
                ..Point::default()
            })
            .map_err(refused)?;
        next = points.next_point()?;
    }
    writer.close().map_err(refused)
}
