//! What of a chart the axes can point the beam at, and how wide a strip of it the line covers there.

use std::collections::HashSet;

use nalgebra::Vector3;

use super::super::course::field::HeightField;
use super::super::map::Chart;
use super::super::spec::SensorSpec;
use super::Workshop;
use crate::parallel::Threads;

/// The least share of the line across the course that is driven; the driver asks for as much.
const LEAST_SHARE: f64 = 0.5;

/// Triangles that are looked at, about; beyond, one stands for its neighbours in the list, which lie beside it.
const LOOKED_AT: usize = 3000;

/// The ways of the line on a few triangles of a chart.
pub struct ChartReach {
    stride: usize,
    /// The beam's direction, where no axis turns it.
    fixed: Option<Vector3<f64>>,
    /// The line can be turned freely about the beam.
    free: bool,
    /// By triangle looked at; none where no angles point the beam at it.
    ways: Vec<Option<Vec<Vector3<f64>>>>,
}

impl ChartReach {
    /// Looks a chart through once.
    pub fn new(shop: &Workshop<'_>, chart: &Chart) -> Self {
        let driver = &shop.realiser.driver;
        let free = driver.free_line();
        let stride = (chart.faces.len() / LOOKED_AT).max(1);
        let few: Vec<u32> = chart.faces.iter().step_by(stride).copied().collect();
        let ways = Threads::all().each(few.len(), |k| {
            let normal = shop.part.normal(few[k] as usize);
            driver.reaches(&normal).then(|| {
                if free {
                    Vec::new()
                } else {
                    driver.lines_within_tilt(&normal)
                }
            })
        });
        ChartReach {
            stride,
            fixed: driver.fixed_beam(),
            free,
            ways,
        }
    }

    /// The triangles that are not reached.
    pub fn beyond(&self, chart: &Chart) -> HashSet<u32> {
        let faces = chart.faces.iter().enumerate();
        faces
            .filter(|(k, _)| self.ways[k / self.stride].is_none())
            .map(|(_, &f)| f)
            .collect()
    }

    /// On each triangle, how wide a strip the line covers across the courses of a height, as a share of its length: 0
    /// where the triangle is not reached. And the area on which the line lies along the course: it is not driven.
    pub fn share(
        &self,
        shop: &Workshop<'_>,
        chart: &Chart,
        field: &HeightField,
    ) -> (Vec<f64>, f64) {
        let mut lost = 0.0;
        let (mut best, mut driven) = (1.0, true);
        let share = chart.faces.iter().enumerate().map(|(k, &f)| {
            if k % self.stride == 0 {
                let normal = shop.part.normal(f as usize);
                let slope = field.slope[k].try_normalize(1e-12);
                (best, driven) = match (&self.ways[k / self.stride], slope) {
                    (None, _) => (0.0, true),
                    (Some(_), None) => (1.0, true),
                    (Some(lines), Some(across)) => self.width(shop, lines, &normal, &across),
                };
            }
            if !driven {
                lost += shop.part.area_mm2(f as usize);
            }
            best
        });
        (share.collect(), lost)
    }

    /// The widest strip, and whether it is driven.
    fn width(
        &self,
        shop: &Workshop<'_>,
        lines: &[Vector3<f64>],
        normal: &Vector3<f64>,
        across: &Vector3<f64>,
    ) -> (f64, bool) {
        let sensor = &shop.spec.sensor;
        match &self.fixed {
            None if self.free => (1.0, true),
            // A beam that follows the surface sees it straight on.
            None => {
                let best = lines.iter().map(|l| l.dot(across).abs());
                let best = best.fold(0.0, f64::max);
                (best.max(LEAST_SHARE), best >= LEAST_SHARE)
            }
            Some(beam) => {
                let along = normal.cross(across);
                let Some(square) = along.cross(beam).try_normalize(1e-9) else {
                    return (1.0, true);
                };
                if self.free {
                    return (strip(sensor, beam, &square, normal, across), true);
                }
                let best = lines
                    .iter()
                    .filter(|l| l.dot(&square).abs() >= LEAST_SHARE)
                    .map(|l| strip(sensor, beam, l, normal, across))
                    .fold(0.0, f64::max);
                // A course that no line lies across is not driven: nothing is gained by more of them.
                if best > 0.0 {
                    (best, true)
                } else {
                    (1.0, false)
                }
            }
        }
    }
}

/// How wide a strip of a plane the line's rays measure, as a share of the line's length. The middle ray meets the plane at
/// the reference distance. A line that leans over a slope is longer there, and is cut by the range and by the incidence.
fn strip(
    sensor: &SensorSpec,
    beam: &Vector3<f64>,
    line: &Vector3<f64>,
    normal: &Vector3<f64>,
    across: &Vector3<f64>,
) -> f64 {
    const STEPS: usize = 24;
    let least = sensor.max_incidence_deg.to_radians().cos();
    // Where a ray at this place along the line meets the plane, across the course; none where it is not measured.
    let place = |lateral: f64| {
        let ray = beam * sensor.reference_mm + line * lateral;
        let against = ray.dot(normal);
        let share = beam.dot(normal) * sensor.reference_mm / against;
        let depth = share * sensor.reference_mm;
        let measured = against < 0.0
            && -against >= least * ray.norm()
            && (sensor.range_mm[0]..=sensor.range_mm[1]).contains(&depth);
        measured.then(|| (ray * share - beam * sensor.reference_mm).dot(across))
    };
    let Some(middle) = place(0.0) else {
        return LEAST_SHARE;
    };
    let reach = |side: f64| {
        let steps = (1..=STEPS).map(|k| side * sensor.line_mm / 2.0 * k as f64 / STEPS as f64);
        steps
            .map_while(place)
            .last()
            .map_or(0.0, |p| (p - middle).abs())
    };
    ((reach(-1.0) + reach(1.0)) / sensor.line_mm).clamp(0.1, 2.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Vector3;

    use super::strip;
    use crate::plan::spec::ScanSpec;

    /// A line of 16 mm from 60 mm, measured from 52 to 68 mm and up to 60 degrees.
    #[test]
    fn a_line_over_a_slope_covers_more_of_it_until_range_and_incidence_cut_it() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
        let sensor = ScanSpec::open(&folder.join("three_axes.toml"))
            .unwrap()
            .sensor;
        assert_eq!(sensor.line_mm, 16.0);
        let beam = -Vector3::z();
        let on = |degrees: f64, along_slope: bool| {
            let (s, c) = f64::to_radians(degrees).sin_cos();
            let (normal, down) = (Vector3::new(s, 0.0, c), Vector3::new(c, 0.0, -s));
            if along_slope {
                strip(&sensor, &beam, &Vector3::x(), &normal, &down)
            } else {
                strip(&sensor, &beam, &Vector3::y(), &normal, &Vector3::y())
            }
        };
        // Straight on, and level on a slope: the line as it is.
        assert!((on(0.0, true) - 1.0).abs() < 1e-12);
        assert!((on(40.0, false) - 1.0).abs() < 1e-12);
        // Down a slope of 30 degrees: 1 / cos 30 but for the fan, about.
        assert!((on(30.0, true) - 1.162).abs() < 0.02, "{}", on(30.0, true));
        // At 58 degrees the lower rays are too flat: less than at 50.
        assert!(on(58.0, true) < 0.85 * on(50.0, true));
    }
}
