//! Rays from the sensor to the surface, and back to its camera.

use nalgebra::Vector3;
use umi_kinematics::Pose;

use super::{LaserTarget, LineProfile, LineSample};
use crate::scene::LineScannerSpec;

/// So far above a surface a look to the camera begins: it does not meet the place itself.
const OFF_MM: f64 = 1e-4;
/// Moments of an exposure at which the surface is looked at: the middles of equal parts.
const MOMENTS: u32 = 3;

/// The geometry of a sensor.
#[derive(Clone, Debug)]
pub struct Optics {
    spec: LineScannerSpec,
    /// Begin and direction of each column's line, in the sensor's frame.
    columns: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// From a line's begin to the far end of the range, along z.
    depth_mm: f64,
    camera: Vector3<f64>,
    least_cosine: f64,
}

impl Optics {
    /// The geometry of a sensor.
    #[must_use]
    pub fn new(spec: LineScannerSpec) -> Self {
        let [near, far] = spec.pitch_um.map(|um| um * 1e-3);
        // Where the columns' lines meet; never, where the pitch is the same everywhere.
        let apex = (far > near).then(|| spec.range_mm / 2.0 + near * spec.range_mm / (far - near));
        let top = apex.map_or(spec.housing_mm(), |apex| apex.min(spec.housing_mm()));
        let pitch_at = |z: f64| LineScannerSpec::between([near, far], spec.depth(z));
        let columns = (0..spec.samples)
            .map(|column| {
                let aside = f64::from(column) - f64::from(spec.samples - 1) / 2.0;
                let at = |z: f64| Vector3::new(aside * pitch_at(z), 0.0, z);
                let from = at(top);
                (from, (at(top - 1.0) - from).normalize())
            })
            .collect();
        Self {
            columns,
            depth_mm: top + spec.range_mm / 2.0,
            camera: spec.camera_mm(),
            least_cosine: libm::cos(spec.steepest_deg.to_radians()).max(1e-6),
            spec,
        }
    }

    /// What the sensor is.
    #[must_use]
    pub const fn spec(&self) -> &LineScannerSpec {
        &self.spec
    }

    /// What the camera sees without noise. `pose` is the sensor's frame in that of the surface,
    /// so many microseconds after the middle of the exposure.
    pub fn profile(&self, surface: &dyn LaserTarget, pose: impl Fn(f64) -> Pose) -> LineProfile {
        if self.spec.exposure_us == 0.0 {
            return self.look(surface, &pose(0.0));
        }
        let mut sums = vec![(0_u32, 0.0, 0.0, 0.0, false); self.columns.len()];
        for moment in 0..MOMENTS {
            let share = (f64::from(moment) + 0.5) / f64::from(MOMENTS) - 0.5;
            let seen = self.look(surface, &pose(share * self.spec.exposure_us));
            for (sum, sample) in sums.iter_mut().zip(seen) {
                if let Some(sample) = sample {
                    sum.0 += 1;
                    sum.1 += sample.x_mm;
                    sum.2 += sample.z_mm;
                    sum.3 += sample.cosine;
                    sum.4 |= sample.is_false;
                }
            }
        }
        sums.into_iter()
            .map(|(n, x, z, cosine, is_false)| {
                // Light of less than half an exposure is too little.
                (2 * n > MOMENTS).then(|| LineSample {
                    x_mm: x / f64::from(n),
                    z_mm: z / f64::from(n),
                    cosine: cosine / f64::from(n),
                    is_false,
                })
            })
            .collect()
    }

    /// Where a column's line is at a height.
    #[must_use]
    pub fn place(&self, column: usize, z_mm: f64) -> f64 {
        let pitch = LineScannerSpec::between(self.spec.pitch_um, self.spec.depth(z_mm)) * 1e-3;
        (column as f64 - f64::from(self.spec.samples - 1) / 2.0) * pitch
    }

    /// One moment.
    fn look(&self, surface: &dyn LaserTarget, pose: &Pose) -> LineProfile {
        let mut reflexes = Vec::new();
        let mut profile: LineProfile = self
            .columns
            .iter()
            .map(|column| self.column(surface, pose, column, &mut reflexes))
            .collect();
        for (column, sample) in reflexes {
            // The line itself outshines a reflex.
            if let Some(place) = profile.get_mut(column)
                && place.is_none()
            {
                *place = Some(sample);
            }
        }
        profile
    }

    fn column(
        &self,
        surface: &dyn LaserTarget,
        pose: &Pose,
        (from, direction): &(Vector3<f64>, Vector3<f64>),
        reflexes: &mut Vec<(usize, LineSample)>,
    ) -> Option<LineSample> {
        let way = self.depth_mm / -direction.z;
        let beam = pose.rotation * direction;
        let end = surface.beam(&pose.point(from), &beam, way)?;
        let at = from + direction * end.way_mm;
        let normal = pose.rotation.transpose() * end.normal;
        let cosine = -direction.dot(&normal);
        let to_camera = self.camera - at;
        let gloss = self.spec.gloss_deg.to_radians();
        let mirrored = direction + normal * (2.0 * cosine);
        if gloss > 0.0 && cosine > 0.0 && cosine < self.least_cosine {
            reflexes.extend(self.reflex(surface, pose, &at, &mirrored));
        }
        let width = LineScannerSpec::between(self.spec.field_mm, self.spec.depth(at.z));
        let saturated =
            gloss > 0.0 && mirrored.dot(&to_camera) > to_camera.norm() * libm::cos(gloss);
        let fits = at.z <= self.spec.range_mm / 2.0
            && at.x.abs() <= width / 2.0
            && cosine >= self.least_cosine
            && !saturated
            && self.sees(surface, pose, &at, &normal);
        fits.then_some(LineSample {
            x_mm: at.x,
            z_mm: at.z,
            cosine,
            is_false: false,
        })
    }

    /// Whether nothing stands between a place and the camera.
    fn sees(
        &self,
        surface: &dyn LaserTarget,
        pose: &Pose,
        at: &Vector3<f64>,
        normal: &Vector3<f64>,
    ) -> bool {
        let way = self.camera - at;
        if way.dot(normal) <= 0.0 {
            return false;
        }
        let from = pose.point(&(at + normal * OFF_MM));
        let direction = pose.point(&self.camera) - from;
        let far = direction.norm();
        surface.beam(&from, &(direction / far), far).is_none()
    }

    /// Where the camera takes a place for, that a mirror lights: the place of the laser's plane
    /// on the line of sight.
    fn reflex(
        &self,
        surface: &dyn LaserTarget,
        pose: &Pose,
        at: &Vector3<f64>,
        mirrored: &Vector3<f64>,
    ) -> Option<(usize, LineSample)> {
        let from = at + mirrored * OFF_MM;
        let end = surface.beam(
            &pose.point(&from),
            &(pose.rotation * mirrored),
            2.0 * self.spec.range_mm,
        )?;
        let lit = from + mirrored * end.way_mm;
        let normal = pose.rotation.transpose() * end.normal;
        if !self.sees(surface, pose, &lit, &normal) {
            return None;
        }
        let slope = self.camera.y - lit.y;
        if slope <= 0.0 {
            return None;
        }
        let image = self.camera + (lit - self.camera) * (self.camera.y / slope);
        let depth = self.spec.depth(image.z);
        let width = LineScannerSpec::between(self.spec.field_mm, depth);
        if !(0.0..=1.0).contains(&depth) || image.x.abs() > width / 2.0 {
            return None;
        }
        let pitch = LineScannerSpec::between(self.spec.pitch_um, depth) * 1e-3;
        let column = (image.x / pitch + f64::from(self.spec.samples - 1) / 2.0).round();
        (0.0..f64::from(self.spec.samples))
            .contains(&column)
            .then_some((
                column as usize,
                LineSample {
                    x_mm: image.x,
                    z_mm: image.z,
                    cosine: -mirrored.dot(&normal),
                    is_false: true,
                },
            ))
    }
}
