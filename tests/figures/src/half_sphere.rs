//! Half a sphere, densely probed or scanned.

use umi_core::units::Point;

const CENTER_MM: [f64; 3] = [-136.7105, 136.412, 136.1212];
const RADIUS_MM: f64 = 12.7118;
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// `n` points evenly over the upper half of a sphere (a Fibonacci lattice) with a micrometre
/// of pseudo-random error, which `seed` chooses.
pub fn half_sphere(n: u32, seed: u64) -> impl Iterator<Item = Point> {
    let mut state = seed;
    let mut noise = move || {
        // Knuth's MMIX generator; its highest 53 bits, from -1 to 1.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..n).map(move |index| {
        let z = (f64::from(index) + 0.5) / f64::from(n);
        let (sin, cos) = libm::sincos(f64::from(index) * GOLDEN_ANGLE);
        let r = RADIUS_MM + 0.001 * noise();
        let rho = r * libm::sqrt(1.0 - z * z);
        let [x, y, z0] = CENTER_MM;
        Point::from_mm(x + rho * cos, y + rho * sin, z0 + r * z)
    })
}
