//! The size from which on an error is refused, whatever its direction.

use nalgebra::Vector3;

use super::seen::{SeenFrom, worse};
use super::setup::Setup;

/// Sizes that are tried.
const STEPS: u32 = 35;

/// What a hit scatters where the job does not say it, µm.
const ASSUMED_SIGMA_UM: f64 = 1.0;

/// Along an edge, a face's diagonal and a space's: of each two that are opposite, one.
pub(super) const DIRECTIONS: [[i8; 3]; 13] = {
    let mut all = [[0; 3]; 13];
    let mut code = 0;
    while code < 13 {
        let place = code as i8 + 14;
        all[code] = [place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1];
        code += 1;
    }
    all
};

pub(super) fn unit(direction: &[i8; 3]) -> Vector3<f64> {
    Vector3::from(direction.map(f64::from)).normalize()
}

impl Setup {
    /// The size from which on an error is refused, with what hits scatter: `balls` positions of
    /// balls, taught and measured, stand against each other in it.
    pub(super) fn from(&self, balls: usize, off: &dyn Fn(usize, f64) -> Vector3<f64>) -> SeenFrom {
        let refuses = |um: f64| self.refuses(&|index| off(index, um * 1e-3));
        // From 0.1 µm to 1 m, five to a decade.
        let size = |step: u32| 10_f64.powf(f64::from(step) / 5.0 - 1.0);
        let Some(last) = (0..=STEPS).rev().find(|step| !refuses(size(*step))) else {
            return self.scattered(balls, size(0));
        };
        if last == STEPS {
            return SeenFrom::Never;
        }
        let (mut low, mut high) = (size(last), size(last + 1));
        for _ in 0..16 {
            let middle = f64::midpoint(low, high);
            if refuses(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        self.scattered(balls, high)
    }

    /// The size, and three standard deviations of what it is measured with.
    pub(super) fn scattered(&self, balls: usize, um: f64) -> SeenFrom {
        SeenFrom::Size(um + self.scatter_um(balls))
    }

    pub(super) fn scatter_um(&self, balls: usize) -> f64 {
        let probing = self.job.guards.probing;
        let hit_um = probing.map_or(ASSUMED_SIGMA_UM, |probing| probing.worst_mm() * 1e3);
        // A ball's centre scatters as one hit does, at most: the lone hit of its top.
        3.0 * (2.0 * balls as f64).sqrt() * hit_um
    }

    /// The worst of [`DIRECTIONS`], and from there on as long as a step aside is worse.
    pub(super) fn worst_direction(
        &self,
        balls: usize,
        off: &dyn Fn(Vector3<f64>, usize, f64) -> Vector3<f64>,
    ) -> SeenFrom {
        let is_worse = |along: Vector3<f64>, than: SeenFrom| {
            self.is_later(than, balls, &|index, mm| off(along, index, mm))
        };
        let from = |along: Vector3<f64>| self.from(balls, &|index, mm| off(along, index, mm));
        let mut most = (unit(&DIRECTIONS[0]), from(unit(&DIRECTIONS[0])));
        for along in DIRECTIONS.iter().map(unit) {
            if is_worse(along, most.1) {
                most = worse(most, (along, from(along)));
            }
        }
        for halvings in 0..5 {
            let step = 0.4 * 0.5_f64.powi(halvings);
            let along = most.0;
            let side = along.cross(&Vector3::new(along.y, along.z, -along.x));
            let side = side.try_normalize(1e-9).unwrap_or_else(Vector3::x);
            let other = along.cross(&side);
            for aside in [side, -side, other, -other] {
                let tried = (along + aside * step).normalize();
                if is_worse(tried, most.1) {
                    most = worse(most, (tried, from(tried)));
                }
            }
        }
        most.1
    }

    /// Whether an error is seen later than from this size on: tried there, before its own size is
    /// looked for.
    pub(super) fn is_later(
        &self,
        than: SeenFrom,
        balls: usize,
        off: &dyn Fn(usize, f64) -> Vector3<f64>,
    ) -> bool {
        let SeenFrom::Size(um) = than else {
            return false;
        };
        [1.0, 1.6, 4.0].iter().any(|times| {
            let mm = (um - self.scatter_um(balls)).max(0.1) * times * 1e-3;
            !self.refuses(&|index| off(index, mm))
        })
    }
}
