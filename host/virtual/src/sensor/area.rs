//! What an area scanner sees of a scene.
//!
//! Every ray starts at the scanner and ends on the first surface. What the model adds to the truth:
//!
//! * **Own noise** along the ray, independent from point to point.
//! * **Shared noise** along the ray: a smooth random field over the image, the sum of plane waves whose wave vectors are
//!   normally distributed (spectral method; M. Shinozuka, C.-M. Jan, Journal of Sound and Vibration 25, 1972). Its
//!   correlation falls as exp(−r²/2L²).
//! * **Grazing incidence**: no point where the ray is steeper than the limit.
//! * **Drop-outs**: points lost at random.
//! * **Mixed points**: four more rays at the rim of the spot. Where they do not end on the plane of the middle one, the
//!   point lies at the mean of all five.
//! * **Shadow**: a second camera must see the point too.

use nalgebra::Vector3;
use umi_scan::parallel::Threads;

#[cfg(test)]
#[path = "area_tests.rs"]
mod tests;

use crate::random::Random;
use crate::scene::{AreaScannerSpec, BeamEnd, Scene};

/// Plane waves of the shared noise.
const WAVES: usize = 64;
/// What a second camera may see before a point and still see the point, mm: the point itself.
const SAME_MM: f64 = 1e-6;

/// What a scanner saw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AreaScan {
    /// The points in the scanner's frame, row by row.
    pub points: Vec<Vector3<f64>>,
    /// Rays in all.
    pub rays: usize,
    /// Rays that met nothing within the range.
    pub empty: usize,
    /// Points lost for their incidence.
    pub grazing: usize,
    /// Points that the second camera does not see.
    pub shadowed: usize,
    /// Points lost at random.
    pub dropped: usize,
    /// Points between the sides of an edge.
    pub mixed: usize,
}

/// How a ray ended.
enum Seen {
    Point { at: Vector3<f64>, mixed: bool },
    Empty,
    Grazing,
    Shadowed,
    Dropped,
}

/// The shared noise: amplitude, and wave vectors with phases.
struct Shared {
    amplitude: f64,
    waves: Vec<[f64; 3]>,
}

impl Shared {
    fn new(spec: &AreaScannerSpec, seed: u64) -> Self {
        let mut random = Random::new(seed ^ 0x5eed_0ffe_e150_0015);
        let turn = 2.0 * std::f64::consts::PI;
        let waves = (0..WAVES).map(|_| {
            let [x, y] = [(); 2].map(|()| random.normal(1.0 / spec.shared_length_mm));
            [x, y, random.between(0.0, turn)]
        });
        Self {
            waves: waves.collect(),
            amplitude: spec.shared_noise_mm * (2.0 / WAVES as f64).sqrt(),
        }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        if self.amplitude == 0.0 {
            return 0.0;
        }
        let wave = |[kx, ky, phase]: &[f64; 3]| libm::cos(kx * x + ky * y + phase);
        self.amplitude * self.waves.iter().map(wave).sum::<f64>()
    }
}

/// The scan of a scene by a scanner. The same seed gives the same bits, for any number of threads.
#[must_use]
pub fn scan(scene: &Scene, spec: &AreaScannerSpec, seed: u64, threads: Threads) -> AreaScan {
    let [columns, rows] = spec.rays();
    let shared = Shared::new(spec, seed);
    let lines = threads.each(rows, |row| {
        let mut line = AreaScan::default();
        // A ray's noise is its own: its row and column make the seed.
        let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (row as u64 + 1));
        for column in 0..columns {
            line.take(look(scene, spec, &shared, &mut random, column, row));
        }
        line
    });
    let mut whole = AreaScan::default();
    for line in lines {
        whole.append(line);
    }
    whole
}

fn look(
    scene: &Scene,
    spec: &AreaScannerSpec,
    shared: &Shared,
    random: &mut Random,
    column: usize,
    row: usize,
) -> Seen {
    // Drawn for every ray, so that what one ray meets changes no other.
    let own = random.normal(spec.noise_mm);
    let lost = random.between(0.0, 1.0) < spec.drop_out;
    let ray = spec.ray(column, row);
    let own_frame = spec.placed();
    let from = own_frame.translation_mm;
    let unit = ray.normalize();
    let [near, far] = spec.range_mm;
    let along = |z: f64| z * ray.norm();
    let cast = |unit: &Vector3<f64>, far: f64| -> Option<BeamEnd> {
        let direction = own_frame.rotation * unit;
        scene
            .beam(&from, &direction, far, |_| true)
            .map(|(_, end)| end)
    };
    let Some(end) = cast(&unit, along(far)).filter(|end| end.way_mm >= along(near)) else {
        return Seen::Empty;
    };
    let direction = own_frame.rotation * unit;
    let cosine = -direction.dot(&end.normal);
    if cosine < libm::cos(spec.grazing_deg.to_radians()) {
        return Seen::Grazing;
    }
    let place = from + direction * end.way_mm;
    if spec.baseline_mm != 0.0 {
        let camera = from + own_frame.rotation * Vector3::new(spec.baseline_mm, 0.0, 0.0);
        let way = place - camera;
        let length = way.norm();
        let free = length - SAME_MM * (1.0 + length);
        let hidden = way.dot(&end.normal) >= 0.0
            || scene
                .beam(&camera, &(way / length), free, |_| true)
                .is_some();
        if hidden {
            return Seen::Shadowed;
        }
    }
    if lost {
        return Seen::Dropped;
    }
    let (way_mm, mixed) = over_spot(spec, &unit, &end, cosine, |unit| cast(unit, along(far)));
    let scale = spec.distance_mm;
    let error = own + shared.at(ray.x * scale, ray.y * scale);
    Seen::Point {
        at: unit * (way_mm + error),
        mixed,
    }
}

/// The mean way over the spot, and whether it lies across an edge.
fn over_spot(
    spec: &AreaScannerSpec,
    unit: &Vector3<f64>,
    end: &BeamEnd,
    cosine: f64,
    cast: impl Fn(&Vector3<f64>) -> Option<BeamEnd>,
) -> (f64, bool) {
    if spec.spot_mm == 0.0 {
        return (end.way_mm, false);
    }
    let radius = spec.spot_mm / 2.0 / end.way_mm;
    let across = unit.cross(&Vector3::y()).normalize();
    let other = unit.cross(&across);
    // On a plane no way at the rim of the spot differs by more than its radius over the tangent of the incidence.
    let slope = (1.0 - cosine * cosine).max(0.0).sqrt() / cosine;
    let flat = spec.spot_mm / 2.0 * (1.5 * slope + 0.5) + 1e-3;
    let mut ways = [end.way_mm; 5];
    let mut mixed = false;
    let rim = [across, -across, other, -other];
    for (way, side) in ways.iter_mut().skip(1).zip(rim) {
        // Light that meets nothing in range does not come back.
        if let Some(end_there) = cast(&(unit + side * radius).normalize()) {
            *way = end_there.way_mm;
            mixed |= (end_there.way_mm - end.way_mm).abs() > flat;
        }
    }
    if mixed {
        (ways.iter().sum::<f64>() / 5.0, true)
    } else {
        (end.way_mm, false)
    }
}

impl AreaScan {
    fn take(&mut self, seen: Seen) {
        self.rays += 1;
        match seen {
            Seen::Point { at, mixed } => {
                self.points.push(at);
                self.mixed += usize::from(mixed);
            }
            Seen::Empty => self.empty += 1,
            Seen::Grazing => self.grazing += 1,
            Seen::Shadowed => self.shadowed += 1,
            Seen::Dropped => self.dropped += 1,
        }
    }

    fn append(&mut self, mut other: Self) {
        self.points.append(&mut other.points);
        self.rays += other.rays;
        self.empty += other.empty;
        self.grazing += other.grazing;
        self.shadowed += other.shadowed;
        self.dropped += other.dropped;
        self.mixed += other.mixed;
    }
}
