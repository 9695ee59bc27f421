//! A job's features at their places, judged as on the board wherever the part stands.

use nalgebra::{Rotation3, Vector3};
use umi_core::job::{against_places, closing, datums, fixed};
use umi_core::registration::register;
use umi_core::units::Point;
use umi_protocol::job::Job;

use super::ASSUMED_RADIUS_MM;

/// Of each limit the part's own pose takes so much: the rest is rounding.
const WITHIN: f64 = 0.999;

/// A job's features at their places.
pub(super) struct Setup {
    pub(super) job: Job,
    pub(super) places: Vec<Vector3<f64>>,
    pub(super) has_places: bool,
}

impl Setup {
    pub(super) fn new(job: &Job) -> Self {
        let due: Vec<usize> = datums(job).map(|(index, _)| index).collect();
        let has_places = datums(job).all(|(_, feature)| feature.position_mm.is_some());
        let assumed = |number: usize| {
            let angle = std::f64::consts::TAU * number as f64 / due.len() as f64;
            Vector3::new(angle.cos(), angle.sin(), 0.0) * ASSUMED_RADIUS_MM
        };
        let mut places: Vec<Vector3<f64>> = job
            .features
            .iter()
            .enumerate()
            .map(|(index, feature)| match feature.position_mm {
                Some(mm) if has_places => Vector3::from(mm),
                _ => assumed(due.iter().position(|of| *of == index).unwrap_or_default()),
            })
            .collect();
        for (again, closing) in closing(job) {
            let first = job.features.iter().position(|f| f.name == closing.repeats);
            if let Some(place) = first.and_then(|first| places.get(first).copied()) {
                places[again] = place;
            }
        }
        Self {
            // What it writes plays no part.
            job: Job {
                correction: None,
                ..job.clone()
            },
            places,
            has_places,
        }
    }

    /// Whether the job refuses a setup whose features are off by these, wherever the part stands
    /// within its limits.
    pub(super) fn refuses(&self, off: &dyn Fn(usize) -> Vector3<f64>) -> bool {
        let job = &self.job;
        let is_open = closing(job).any(|(again, closing)| {
            let first = job.features.iter().position(|f| f.name == closing.repeats);
            first.is_some_and(|first| (off(again) - off(first)).norm() > closing.within_mm)
        });
        let limit_mm = job.guards.fixed_mm.unwrap_or(f64::INFINITY);
        let mut on_table = fixed(job).flat_map(|(index, _)| self.times(index));
        is_open || on_table.any(|time| off(time).norm() > limit_mm) || {
            let reference: Vec<Vector3<f64>> = self.due().map(|index| self.at(index)).collect();
            let errors: Vec<Vector3<f64>> = self.due().map(|index| self.mean(index, off)).collect();
            self.is_against(&reference, &errors, None)
                && self.is_against(&reference, &errors, self.hides(&reference, &errors))
        }
    }

    /// A feature, and those that are this one, probed once more.
    fn times(&self, index: usize) -> impl Iterator<Item = usize> {
        let name = &self.job.features[index].name;
        let again = closing(&self.job).filter(move |(_, closing)| closing.repeats == *name);
        std::iter::once(index).chain(again.map(|(again, _)| again))
    }

    /// By how much a feature is off where all times that it is probed count alike, as on the
    /// board.
    fn mean(&self, index: usize, off: &dyn Fn(usize) -> Vector3<f64>) -> Vector3<f64> {
        middle(&self.times(index).map(off).collect::<Vec<_>>())
    }

    /// The features that are registered.
    fn due(&self) -> impl Iterator<Item = usize> {
        datums(&self.job).map(|(index, _)| index)
    }

    pub(super) fn at(&self, index: usize) -> Vector3<f64> {
        self.places.get(index).copied().unwrap_or_default()
    }

    fn is_against(
        &self,
        reference: &[Vector3<f64>],
        errors: &[Vector3<f64>],
        stands: Option<Stands>,
    ) -> bool {
        let middle = middle(reference);
        let measured: Vec<Point> = (reference.iter().zip(errors))
            .map(|(place, error)| {
                let at = stands.map_or(*place, |stands| stands.carries(*place, middle));
                Point { mm: at + error }
            })
            .collect();
        let reference: Vec<Point> = reference.iter().map(|mm| Point { mm: *mm }).collect();
        against_places(&self.job, &reference, &measured)
    }

    /// Where the part must stand within the job's limits so that as little as possible is seen
    /// of these errors.
    fn hides(&self, reference: &[Vector3<f64>], errors: &[Vector3<f64>]) -> Option<Stands> {
        let job = &self.job;
        let to: Vec<Point> = (reference.iter().zip(errors))
            .map(|(place, error)| Point { mm: place + error })
            .collect();
        let from: Vec<Point> = reference.iter().map(|mm| Point { mm: *mm }).collect();
        let seen = register(&from, &to).ok()?.transform.rotation;
        let turned = Rotation3::from_matrix_unchecked(seen).scaled_axis();
        let within = |length: f64, limit: f64| (limit * WITHIN / length).min(1.0);
        let tilt = Vector3::new(turned.x, turned.y, 0.0);
        let tilt = tilt * within(tilt.norm(), job.limits.tilt_deg.to_radians());
        let turn = turned.z * within(turned.z.abs(), job.limits.rotation_deg.to_radians());
        let shift = middle(errors).zip_map(&job.limits.shift_mm.into(), |off: f64, limit: f64| {
            off.clamp(-limit * WITHIN, limit * WITHIN)
        });
        let scale = job.guards.warmth.map_or(0.0, |warmth| {
            let at = middle(reference);
            let (mut along, mut square) = (0.0, 0.0);
            for (place, error) in reference.iter().zip(errors) {
                along += (place - at).dot(error);
                square += (place - at).norm_squared();
            }
            let most = warmth.at_most_k * warmth.expansion_ppm_per_k * 1e-6 * WITHIN;
            (along / square).clamp(-most, most)
        });
        Some(Stands {
            turned: Rotation3::new(-tilt - Vector3::z() * turn),
            shift: -shift,
            scale: 1.0 - scale,
        })
    }
}

/// Where a part stands, against where it was taught.
#[derive(Clone, Copy)]
struct Stands {
    turned: Rotation3<f64>,
    shift: Vector3<f64>,
    scale: f64,
}

impl Stands {
    fn carries(&self, place: Vector3<f64>, middle: Vector3<f64>) -> Vector3<f64> {
        self.turned * ((place - middle) * self.scale) + middle + self.shift
    }
}

fn middle(of: &[Vector3<f64>]) -> Vector3<f64> {
    of.iter().sum::<Vector3<f64>>() / of.len().max(1) as f64
}
