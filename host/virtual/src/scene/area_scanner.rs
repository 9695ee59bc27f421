//! The area scanner of a scene.

use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use umi_core::registration::RigidTransform;

use super::{SceneError, pose};

/// A scanner that sees a field at once from a fixed place: fringe projection, a scanner on an arm or a tripod.
///
/// Its own frame has its origin where the rays start, Z along the middle ray away from it, and X towards the second
/// camera. Its points are in that frame.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AreaScannerSpec {
    /// Where the rays start, in the machine.
    pub position_mm: [f64; 3],
    /// What its middle ray meets; then X lies level, in the machine's XY plane.
    pub look_at_mm: Option<[f64; 3]>,
    /// Its turn about X, then Y, then Z of the machine, where `look_at_mm` is not said.
    pub rotation_deg: Option<[f64; 3]>,
    /// The whole angles of the field along X and Y.
    pub field_deg: [f64; 2],
    /// The distance at which `spacing_mm` and `shared_length_mm` are meant.
    pub distance_mm: f64,
    /// Between neighbouring rays at that distance, on a plane across the middle ray.
    pub spacing_mm: f64,
    /// The nearest and the furthest that it measures, along Z.
    #[serde(default = "everything")]
    pub range_mm: [f64; 2],
    /// Standard deviation along the ray of one point, of its own.
    #[serde(default)]
    pub noise_mm: f64,
    /// Standard deviation along the ray of the error that neighbours share.
    #[serde(default)]
    pub shared_noise_mm: f64,
    /// How far apart rays still share it: the correlation of two falls as exp(−r²/2L²).
    #[serde(default = "shared_length")]
    pub shared_length_mm: f64,
    /// Steepest incidence of a ray against the normal.
    #[serde(default = "grazing")]
    pub grazing_deg: f64,
    /// The share of the points that is lost for no reason.
    #[serde(default)]
    pub drop_out: f64,
    /// The diameter of what a ray averages over, at its surface: across an edge a point lies between both sides. 0: none.
    #[serde(default)]
    pub spot_mm: f64,
    /// How far along X the second camera stands, which must see a point too. 0: there is none.
    #[serde(default)]
    pub baseline_mm: f64,
}

const fn everything() -> [f64; 2] {
    [0.0, 1e5]
}

const fn shared_length() -> f64 {
    15.0
}

const fn grazing() -> f64 {
    80.0
}

/// Rays of a scan at most.
const MOST_RAYS: f64 = 4e8;

impl AreaScannerSpec {
    /// Machine from scanner.
    #[must_use]
    pub fn placed(&self) -> RigidTransform {
        let at = Vector3::from(self.position_mm);
        let Some(to) = self.look_at_mm else {
            return pose(
                self.position_mm,
                self.rotation_deg.unwrap_or_default(),
                [0.0; 3],
            );
        };
        let z = (Vector3::from(to) - at)
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::z);
        // Straight up or down there is no level direction of its own: the machine's X.
        let level = z
            .cross(&Vector3::z())
            .try_normalize(1e-9)
            .unwrap_or_else(Vector3::x);
        let y = z.cross(&level);
        RigidTransform {
            rotation: Matrix3::from_columns(&[level, y, z]),
            translation_mm: at,
        }
    }

    /// Rays along X and Y.
    #[must_use]
    pub fn rays(&self) -> [usize; 2] {
        self.count().map(|count| count as usize)
    }

    /// The direction of the ray in this column and row, in the scanner's frame, scaled to 1 along Z.
    #[must_use]
    pub fn ray(&self, column: usize, row: usize) -> Vector3<f64> {
        let step = self.spacing_mm / self.distance_mm;
        let off = |at: usize, count: f64| (at as f64 - (count - 1.0) / 2.0) * step;
        let [columns, rows] = self.count();
        Vector3::new(off(column, columns), off(row, rows), 1.0)
    }

    fn count(&self) -> [f64; 2] {
        self.field_deg.map(|whole| {
            let width = 2.0 * self.distance_mm * libm::tan(whole.to_radians() / 2.0);
            libm::floor(width / self.spacing_mm) + 1.0
        })
    }

    /// What no single number tells.
    pub(super) fn check(&self) -> Result<(), SceneError> {
        let refuse = |message: &str| {
            Err(SceneError {
                message: message.to_owned(),
            })
        };
        if self.look_at_mm.is_some() == self.rotation_deg.is_some() {
            return refuse("`scanner` needs either `look_at_mm` or `rotation_deg`");
        }
        if self.look_at_mm == Some(self.position_mm) {
            return refuse("`scanner.look_at_mm` is where the scanner stands");
        }
        let [near, far] = self.range_mm;
        if near >= far {
            return refuse("`scanner.range_mm` needs the nearest first, then the furthest");
        }
        let [columns, rows] = self.count();
        if columns * rows > MOST_RAYS {
            return refuse(
                "`scanner.spacing_mm` is too fine for `scanner.field_deg`: more than 400 million rays",
            );
        }
        Ok(())
    }
}
