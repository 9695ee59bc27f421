//! The simulated machine: a plate of balls, where it stands, and the hits of a probe.

use nalgebra::{Rotation3, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::units::Point;

/// Radius of the balls, mm.
pub const RADIUS_MM: f64 = 12.7;
/// What a hit scatters, mm.
const SIGMA_MM: f64 = 0.001;

/// Random numbers from a seed (`SplitMix64`: G. Steele and others, OOPSLA 2014).
#[derive(Clone, Debug)]
pub struct Dice(pub u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// From 0 to below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        let end = end.max(1) as u64;
        usize::try_from(self.next() % end).unwrap_or(0)
    }

    /// Evenly from `low` to `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "53 bits are all that is wanted")]
        let unit = (self.next() >> 11) as f64 / (1u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// Evenly from the one to the other.
    pub fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        self.between(low, high)
    }

    /// With mean 0 and standard deviation 1 (G. Marsaglia's polar method).
    pub fn normal(&mut self) -> f64 {
        loop {
            let (u, v) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                return u * (-2.0 * s.ln() / s).sqrt();
            }
        }
    }

    /// In any direction.
    pub fn direction(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal()).normalize()
    }

    /// Evenly from `low` to `high`, with either sign.
    pub fn either(&mut self, low: f64, high: f64) -> f64 {
        let value = self.between(low, high);
        if self.below(2) == 0 { value } else { -value }
    }
}

/// Where a plate stands: `p` of the taught clamping is carried to `turn (p - middle) + middle +
/// shift`.
#[derive(Clone, Copy, Debug)]
pub struct TruePose {
    pub turn: Rotation3<f64>,
    pub shift: Vector3<f64>,
    /// Warmer by this factor.
    pub scale: f64,
}

impl TruePose {
    pub fn taught() -> Self {
        Self {
            turn: Rotation3::identity(),
            shift: Vector3::zeros(),
            scale: 1.0,
        }
    }

    /// Anywhere on the table: up to 2 degrees and 48 mm.
    pub fn anywhere(dice: &mut Dice) -> Self {
        let tilt = Vector3::new(dice.normal(), dice.normal(), 0.0) * 2e-5;
        let turn = Rotation3::new(Vector3::z() * dice.between(-2.0, 2.0).to_radians());
        Self {
            turn: Rotation3::new(tilt) * turn,
            shift: Vector3::new(
                dice.between(-48.0, 48.0),
                dice.between(-48.0, 48.0),
                dice.between(-0.02, 0.02),
            ),
            scale: 1.0,
        }
    }

    /// The same, moved by a little.
    pub fn nudged(&self, by: Vector3<f64>) -> Self {
        Self {
            shift: self.shift + by,
            ..*self
        }
    }

    /// The same, turned about a place.
    pub fn turned(&self, about: Vector3<f64>, by: Rotation3<f64>, middle: Vector3<f64>) -> Self {
        Self {
            turn: by * self.turn,
            shift: by * (middle + self.shift - about) + about - middle,
            ..*self
        }
    }

    pub fn carries(&self, p: Vector3<f64>, middle: Vector3<f64>) -> Vector3<f64> {
        self.turn * ((p - middle) * self.scale) + middle + self.shift
    }
}

/// Largest distance at the corners between where a correction puts the part and where it is.
pub fn error_mm(
    said: &RigidTransform,
    pose: &TruePose,
    middle: Vector3<f64>,
    corners: &[Point],
) -> f64 {
    corners.iter().fold(0.0, |most: f64, corner| {
        let is = pose.carries(corner.mm, middle);
        most.max((said.apply(*corner).mm - is).norm())
    })
}

/// What the probe and the machine do wrong.
#[derive(Clone, Copy, Debug, Default)]
pub struct Probing {
    /// Added to the scatter of each hit.
    pub scatter_mm: f64,
    /// All hits are off.
    pub bent_mm: [f64; 3],
    /// Z is so much too long.
    pub z_scale: f64,
    /// The first touch of the top is so early.
    pub early_top_mm: f64,
    /// Each touch of the top is so early.
    pub chip_mm: f64,
    /// Each touch is so late, along its way.
    pub late_mm: f64,
    /// The control rounds to whole steps of this; 0 where to its increment.
    pub step_mm: f64,
    /// Added to the scatter of the fast touches.
    pub fast_mm: f64,
}

/// Contact points of a ball as the routine takes them (Sawula 2013, appendix D): the top,
/// then +X, -X, +Y and -Y, driven exactly one radius below the top hit; with six hits the top
/// once more.
///
/// `centers`: where the ball is at each hit.
pub fn hits(centers: &[Vector3<f64>], probing: &Probing, dice: &mut Dice) -> Vec<[f64; 3]> {
    let sigma = (SIGMA_MM * SIGMA_MM + probing.scatter_mm * probing.scatter_mm).sqrt();
    let bent = Vector3::from(probing.bent_mm);
    let seen = |hit: usize| {
        let mut seen = centers[hit] + bent;
        seen.z *= 1.0 + probing.z_scale;
        seen
    };
    let touch = |dice: &mut Dice| sigma * dice.normal();
    // Against the surface all around.
    let radius = RADIUS_MM - probing.late_mm;
    let is = |hit: usize| seen(hit).z + radius + probing.chip_mm;
    let top = is(0) + probing.early_top_mm + touch(dice);
    let side = top - RADIUS_MM;
    // The routine centres itself before it goes down, to the scatter of its first touches.
    let (mut beside_x, mut beside_y) = (seen(0).x + touch(dice), seen(0).y + touch(dice));
    if probing.fast_mm > 0.0 {
        // The middle of two of them.
        let fast = probing.fast_mm / std::f64::consts::SQRT_2;
        beside_x += fast * dice.normal();
        beside_y += fast * dice.normal();
    }
    let mut points = vec![
        [beside_x, beside_y, top],
        [seen(1).x + radius + touch(dice), beside_y, side],
        [seen(2).x - radius + touch(dice), beside_y, side],
        [beside_x, seen(3).y + radius + touch(dice), side],
        [beside_x, seen(4).y - radius + touch(dice), side],
    ];
    if centers.len() == 6 {
        // Over the centre that the sides have shown.
        let (beside_x, beside_y) = (seen(4).x + touch(dice), seen(4).y + touch(dice));
        points.push([beside_x, beside_y, is(5) + touch(dice)]);
    }
    let rounded = |mm: f64| {
        let mm = match probing.step_mm {
            0.0 => mm,
            step_mm => (mm / step_mm).round() * step_mm,
        };
        // A machine's increment.
        (mm * 1000.0).round() / 1000.0
    };
    points.into_iter().map(|point| point.map(rounded)).collect()
}
