//! Whether a scan that does not fit is of the part, larger or smaller than it should be.
//!
//! Castings shrink by a few percent, sintered parts by a fifth. At the wrong size the search finds about the right place
//! still, if the size is not too far off; so it is tried at a few, and the size is fitted from there.

use super::{Judge, Worth};
use crate::ScanError;
use crate::localise::search::pairs::spread;
use crate::localise::search::scene::Scene;
use crate::localise::verdict::count;
use crate::localise::verdict::rivals::explained;
use crate::rigid::Vec3;

/// Sizes that are searched at: each fits what is off it by some 2 %.
const TRIED: [f64; 9] = [1.0, 0.96, 1.04, 0.92, 1.09, 0.875, 1.14, 0.835, 1.2];
/// Poses of each from which the size is fitted, and points that it is fitted to.
const POSES: usize = 4;
const POINTS: usize = 3000;
/// A scan that is so many times as large as the part shows other things, among which each search would take its time.
const LARGER: f64 = 1.35;
/// It must explain so many times as many points as anything else does, and this share of all: a foreign part has a size, too,
/// by which some of its faces lie on the part's.
const MORE: f64 = 1.2;
const MOST: f64 = 0.7;

impl Judge<'_> {
    /// Refuses if the scan fits at another size, and there by far more points than the `known` ones.
    pub(super) fn other_size(&self, known: usize) -> Result<(), ScanError> {
        let threads = self.task.threads;
        let (low, high) = crate::surface::bounds(self.task.points.iter());
        if (high - low).norm() > LARGER * self.prepared.diagonal {
            return Ok(());
        }
        let about = (low + high) / 2.0;
        for tried in TRIED {
            let sized = |factor: f64| -> Vec<Vec3> {
                let points = self.task.points.iter();
                points.map(|q| about + (q - about) * factor).collect()
            };
            let points = sized(tried);
            let scene = Scene::new(self.task.model, &points, threads);
            let few: Vec<Vec3> = spread(scene.fine.len(), POINTS)
                .into_iter()
                .map(|i| scene.fine[i])
                .collect();
            for fit in self.fits(&scene, None).iter().take(POSES) {
                let found = self.task.size_near(self.surface, &few, &about, fit);
                let Some((scale, motion)) = found else {
                    continue;
                };
                let factor = tried / scale;
                let scene = Scene::new(self.task.model, &sized(factor), threads);
                let Some(fit) = self.refine(&scene, &motion) else {
                    continue;
                };
                let sigma = fit.sigma_mm.max(scene.noise_mm);
                let on = explained(self.part(), &scene.fine, &fit.motion, sigma, threads);
                if count(&on) as f64 > (MORE * known as f64).max(MOST * on.len() as f64)
                    && matches!(self.worth(&scene, &fit), Worth::Good)
                    && self.holds_size(&scene, &fit)
                    && self.stands(&scene, &fit).is_ok()
                {
                    return Err(ScanError::refused(
                        "wrong_scale",
                        format_args!(
                            "the scan fits if it is made {factor:.4} times as large: {:.1} % {}; correct the scan's size, or take the model \
                             as the part is",
                            100.0 * (1.0 / factor - 1.0).abs(),
                            if factor > 1.0 {
                                "are missing, by shrinkage or the scanner's calibration"
                            } else {
                                "are too many, by an allowance for shrinkage or the scanner's calibration"
                            }
                        ),
                    )
                    .with("factor", factor));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::localise::tests::{Random, bracket, scan, task};
    use crate::rigid::Vec3;

    /// Sintered, cast, with an allowance, from two views: never OK, never by another name, and the factor is right.
    #[test]
    fn what_is_shrunk_by_a_fifth_is_named_so_with_its_factor() {
        let model = bracket();
        let mut random = Random(41);
        let mut told = 0;
        for size in [0.83, 0.97, 1.04] {
            let pose = random.pose();
            let points = scan(&model, 3000, 0.02, &pose, &mut random, |n| n.y < 0.5);
            let points: Vec<Vec3> = points.iter().map(|q| q * size).collect();
            match task(&model, &points).find() {
                // Faces that meet in a corner are on the part at any size.
                Ok(found) => assert_eq!(found.reasons[0].code, "scale", "{size}"),
                Err(error) => {
                    assert_eq!(error.code, "wrong_scale", "{size}: {}", error.message);
                    let factor = error.details["factor"].as_f64().unwrap();
                    assert!((factor * size - 1.0).abs() < 0.002, "{size}: {factor}");
                    told += 1;
                }
            }
        }
        assert!(told >= 2, "{told}");
    }
}
