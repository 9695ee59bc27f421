//! How much material a raw part has on every face of the finished one, and where the finished part lies best in it.
//!
//! Stock is the signed distance from the nominal surface to a scanned point: positive is material.

mod borders;
mod clutter;
mod demand;
mod highest;
mod patches;
mod place;
#[cfg(test)]
mod scanned;
mod shows;
mod spikes;
#[cfg(test)]
mod tests;
mod windows;

use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::{FARTHEST_MM, Pose, Vec3, is_in_reach};
use crate::solve::{Kernel, Measured, Offset, Task, measure, median};
use crate::surface::{CompositeSurface, Mesh};

pub use demand::{Demand, Rule};

/// What the best place is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// The least margin is the largest.
    Min,
    /// The stock is the most even: least squares about its mean.
    Balanced,
    /// The stock is the least: least squares of itself.
    LeastSquares,
}

/// What is asked.
#[derive(Clone, Debug)]
pub struct StockTask<'a> {
    /// The finished part.
    pub model: &'a Mesh,
    /// The scanned points in mm.
    pub points: &'a [Vec3],
    /// What is best.
    pub objective: Objective,
    /// Locked components x, y, z, a, b, c.
    pub locked: [bool; 6],
    /// The pivot in part coordinates, in mm.
    pub pivot: Vec3,
    /// Where the search begins: scan from part.
    pub start: Pose,
    /// The least stock that is demanded, in mm.
    pub require_mm: Option<f64>,
    /// What is apart from the rest of the scan and stands further off the part than it is the raw part's, too.
    pub apart_is_raw: bool,
    /// Faces with demands of their own.
    pub demands: &'a [Demand],
    /// Threads.
    pub threads: Threads,
}

/// The stock on one face.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceStock {
    /// Its name.
    pub name: String,
    /// The points that belong to it, by their number among those that were used.
    pub points: Vec<usize>,
    /// The least stock in mm; none without points.
    pub min_mm: Option<f64>,
    /// The mean stock in mm.
    pub mean_mm: Option<f64>,
    /// The largest stock in mm.
    pub max_mm: Option<f64>,
    /// The least margin in mm.
    pub margin_mm: Option<f64>,
}

/// A stock that was found, and what is wrong with it.
#[derive(Clone, Debug)]
pub struct StockFound {
    /// Scan from part.
    pub motion: Pose,
    /// The least stock in mm.
    pub min_mm: f64,
    /// The mean stock in mm.
    pub mean_mm: f64,
    /// The largest stock in mm.
    pub max_mm: f64,
    /// The least margin in mm: stock less what is demanded.
    pub margin_mm: f64,
    /// The points that were used.
    pub n_used: usize,
    /// The points that were left out because none near them is like them, by number.
    pub spikes: Vec<usize>,
    /// The points that were left out because they are of other things: they stand off the part by far more than the rest,
    /// and apart from it. By number.
    pub clutter: Vec<usize>,
    /// Those of the spikes where material is missing, in the frame of the scan (mm), with their stock in mm.
    pub below: Vec<(Vec3, f64)>,
    /// Faces that have demands.
    pub faces: Vec<FaceStock>,
    /// The share of the model's area in patches that the scan does not show.
    pub unmeasured: f64,
    /// The middle of each such patch in part coordinates (mm), with its share.
    pub bare: Vec<(Vec3, f64)>,
    /// The point with the least stock, in the frame of the scan.
    pub least_at_mm: Vec3,
    /// Every point against the model.
    pub measured: Vec<Measured>,
    /// Why the verdict is NG. None: OK, material is left everywhere, whatever the objective.
    pub reasons: Vec<ScanError>,
}

/// Rounds in which margins are made even.
const EVENINGS: usize = 6;

/// A place that is further than this share of the part's size from where its stock is least is none in that raw part.
const FAR: f64 = 0.5;

/// The share of the model's area that need not be scanned.
const UNMEASURED: f64 = 0.01;

impl StockTask<'_> {
    /// The best place by the objective, with its verdict.
    ///
    /// # Errors
    /// `too_few_points` for fewer than six; `not_finite` for what lies too far out; `bad_file` for a face that is not on the model; `unbounded` where no scanned
    /// face holds the part.
    pub fn find(&self) -> Result<StockFound, ScanError> {
        if self.points.len() < 6 {
            return Err(too_few(self.points.len()));
        }
        let far = |what: &str| {
            ScanError::refused(
                "not_finite",
                format_args!(
                    "{what} more than {FARTHEST_MM:e} mm away, which nothing is: is it in mm?"
                ),
            )
        };
        if !is_in_reach(&self.start.translation_mm) {
            return Err(far("the start lies"));
        }
        if !is_in_reach(&self.pivot) {
            return Err(far("the pivot lies"));
        }
        if !self.model.corners().iter().all(is_in_reach) {
            return Err(far("the model reaches"));
        }
        if self.apart_is_raw && !self.points.iter().all(is_in_reach) {
            return Err(far(
                "a point of the scan, all of which are the raw part's by --apart, lies",
            ));
        }
        demand::check(self.model, self.demands)?;
        let surface = CompositeSurface::from(self.model.clone());
        let there = measure(&surface, self.points, &self.start, &[], self.threads);
        let diagonal_mm = self.model.diagonal_mm();
        let clutter = match self.apart_is_raw {
            true => Vec::new(),
            false => clutter::find(self.points, &there, diagonal_mm, self.threads),
        };
        if clutter.is_empty() {
            return self.of_one_body(&surface);
        }
        let own: Vec<usize> = (0..self.points.len())
            .filter(|i| clutter.binary_search(i).is_err())
            .collect();
        let points: Vec<Vec3> = own.iter().map(|&i| self.points[i]).collect();
        let task = StockTask {
            points: &points,
            ..self.clone()
        };
        let found = task.of_one_body(&surface)?;
        Ok(StockFound {
            spikes: found.spikes.iter().map(|&i| own[i]).collect(),
            clutter,
            ..found
        })
    }

    /// The best place in a scan without other things.
    fn of_one_body(&self, surface: &CompositeSurface) -> Result<StockFound, ScanError> {
        if self.points.len() < 6 {
            return Err(too_few(self.points.len()));
        }
        // Turns first in the solvers, shifts first for people.
        let locked: [bool; 6] = std::array::from_fn(|i| self.locked[(i + 3) % 6]);
        let pivot = if locked.contains(&true) {
            self.start.point(&self.pivot)
        } else {
            middle(self.points)
        };
        let fit = |points, offset| self.least(surface, points, locked, pivot, offset);
        // Far away all stock is even; the least stock is always near the scan.
        let near = fit(self.points, Offset::Zero).motion;
        let far_mm = FAR * self.model.diagonal_mm();
        let corners = self.model.corners();
        let even = |points| {
            let even = fit(points, Offset::Free);
            if even.motion.apart_mm(&near, &corners) <= far_mm {
                Ok(even)
            } else if self.objective == Objective::Balanced {
                let away = even.motion.translation_mm - near.translation_mm;
                Err(unbounded(&away))
            } else {
                Ok(fit(points, Offset::Zero))
            }
        };
        let all = even(self.points)?;
        let is_inside = self.insides(&all.motion);
        let (spikes, kept) = spikes::part(self.points, &all.measured, is_inside, self.threads);
        let even = if spikes.is_empty() { all } else { even(&kept)? };
        let rules = demand::rules(self.model, self.demands, self.require_mm);
        let motion = match self.objective {
            Objective::Balanced => even.motion,
            Objective::LeastSquares => {
                self.least(surface, &kept, locked, pivot, Offset::Zero)
                    .motion
            }
            Objective::Min => place::Search {
                surface,
                points: &kept,
                rules: &rules,
                locked,
                pivot,
                start: self.start,
                corners,
                far_mm,
                threads: self.threads,
            }
            .best(
                &even.motion,
                &self.by_demands(surface, &kept, (locked, pivot), &rules, &even.motion),
            ),
        };
        let found = self.judge(surface, &motion, spikes, &kept, &rules);
        let is_min = self.objective == Objective::Min;
        match place::free_motion(&found.measured, &rules, &locked) {
            Some(away) if is_min => Err(unbounded(&away)),
            _ => Ok(found),
        }
    }

    /// Where the margins are most even, by least squares: as-built faces on the model, and faces with stock above what
    /// they demand by one and the same amount. Once with the as-built faces alone at first. None where all demand alike.
    fn by_demands(
        &self,
        surface: &CompositeSurface,
        points: &[Vec3],
        (locked, pivot): ([bool; 6], Vec3),
        rules: &[Rule],
        even: &Pose,
    ) -> Vec<Pose> {
        if rules.windows(2).all(|pair| pair[0] == pair[1]) {
            return Vec::new();
        }
        let solve = |points: &[Vec3], from: &Pose| {
            let task = Task {
                surface,
                points,
                weights: &[],
                kernel: Kernel::None,
                offset: Offset::Zero,
                pivot,
                locked,
                steps: 100,
                within_mm: f64::INFINITY,
                enough_mm: 0.0,
                threads: self.threads,
            };
            task.solve(from).motion
        };
        let at_even = measure(surface, points, even, &[], self.threads);
        let built: Vec<Vec3> = points
            .iter()
            .zip(&at_even)
            .filter(|(_, m)| matches!(rules[m.face], Rule::Profile(_)))
            .map(|(q, _)| *q)
            .collect();
        let mut starts = vec![*even];
        if built.len() >= 6 {
            starts.push(solve(&built, even));
        }
        starts
            .into_iter()
            .map(|start| {
                let mut motion = start;
                for _ in 0..EVENINGS {
                    let measured = measure(surface, points, &motion, &[], self.threads);
                    let mut over: Vec<f64> = measured
                        .iter()
                        .filter_map(|m| match rules[m.face] {
                            Rule::Stock(least) => Some(m.distance_mm - least),
                            Rule::Profile(_) => None,
                        })
                        .collect();
                    let over = median(&mut over);
                    let lowered: Vec<Vec3> = points
                        .iter()
                        .zip(&measured)
                        .map(|(q, m)| match rules[m.face] {
                            Rule::Stock(least) => q - m.direction * (least + over),
                            Rule::Profile(_) => *q,
                        })
                        .collect();
                    motion = solve(&lowered, &motion);
                }
                motion
            })
            .collect()
    }

    fn least(
        &self,
        surface: &CompositeSurface,
        points: &[Vec3],
        locked: [bool; 6],
        pivot: Vec3,
        offset: Offset,
    ) -> crate::solve::Settled {
        Task {
            surface,
            points,
            weights: &[],
            kernel: Kernel::None,
            offset,
            pivot,
            locked,
            steps: 300,
            within_mm: f64::INFINITY,
            enough_mm: 0.0,
            threads: self.threads,
        }
        .solve(&self.start)
    }

    /// Whether a point of the scan is inside the part at this place. The nearest face can be a needle that looks the wrong
    /// way: inside a closed model is what all of it goes around; of another the nearest face has to do.
    fn insides(&self, motion: &Pose) -> impl Fn(&Vec3) -> bool + Sync {
        let is_closed = self.model.is_closed();
        move |q| !is_closed || self.model.winding(&motion.undo(q)) > 0.5
    }

    fn judge(
        &self,
        surface: &CompositeSurface,
        motion: &Pose,
        spikes: Vec<usize>,
        kept: &[Vec3],
        rules: &[Rule],
    ) -> StockFound {
        let measured = measure(surface, kept, motion, &[], self.threads);
        let (min_mm, max_mm, sum, least) = span(&measured, 0..measured.len());
        let margin_mm = measured
            .iter()
            .map(|m| rules[m.face].margin(m.distance_mm))
            .fold(f64::INFINITY, f64::min);
        let left_out: Vec<Vec3> = spikes.iter().map(|&i| self.points[i]).collect();
        let is_inside = self.insides(motion);
        let below = measure(surface, &left_out, motion, &[], self.threads)
            .iter()
            .zip(left_out)
            .map(|(m, q)| {
                let mm = m.distance_mm;
                let outside = mm < 0.0 && !is_inside(&q);
                (m.face, q, if outside { -mm } else { mm })
            })
            .filter(|(face, _, mm)| rules[*face].lacks(*mm))
            .map(|(_, q, mm)| (q, mm))
            .collect();
        let faces = demand::by_face(self.model, self.demands, rules, &measured);
        let (unmeasured, bare) = patches::bare(self.model, motion, kept, &measured, self.threads);
        let mut found = StockFound {
            motion: *motion,
            min_mm,
            mean_mm: sum / measured.len() as f64,
            max_mm,
            margin_mm,
            n_used: kept.len(),
            spikes,
            clutter: Vec::new(),
            below,
            faces,
            unmeasured,
            bare,
            least_at_mm: kept[least],
            measured,
            reasons: Vec::new(),
        };
        found.reasons = self.reasons(&found);
        found
    }

    fn reasons(&self, found: &StockFound) -> Vec<ScanError> {
        let mut reasons = Vec::new();
        let p = found.least_at_mm;
        let at = format!("at {:.3}, {:.3}, {:.3} mm of the scan", p.x, p.y, p.z);
        let least = found.min_mm;
        // Where faces have demands, below nominal can be within a profile's tolerance.
        if self.demands.is_empty() && least < 0.0 {
            let what = if self.objective == Objective::Min {
                "no place leaves material everywhere"
            } else {
                "the place with the largest least stock is that of --objective min"
            };
            reasons.push(ScanError::refused(
                "no_stock",
                format_args!(
                    "the raw part lies {:.4} mm inside the finished one {at}: {what}",
                    -least
                ),
            ));
        }
        if let Some(require) = self.require_mm.filter(|require| least < *require) {
            reasons.push(ScanError::refused(
                "too_little_stock",
                format_args!("the least stock is {least:.4} mm {at}; {require} mm are required"),
            ));
        }
        if !self.demands.is_empty() {
            if let Some(face) = found
                .faces
                .iter()
                .filter(|face| face.margin_mm.is_some_and(|margin| margin < 0.0))
                .min_by(|a, b| {
                    a.margin_mm
                        .unwrap_or(0.0)
                        .total_cmp(&b.margin_mm.unwrap_or(0.0))
                })
            {
                reasons.push(ScanError::refused(
                    "too_little_stock",
                    format_args!(
                        "the face `{}` misses what it demands by {:.4} mm",
                        face.name,
                        -face.margin_mm.unwrap_or(0.0)
                    ),
                ));
            } else if found.margin_mm < 0.0 {
                reasons.push(ScanError::refused(
                    "no_stock",
                    format_args!("on a face without demands the raw part lies {:.4} mm inside the finished one", -found.margin_mm),
                ));
            }
        }
        if !found.below.is_empty() {
            let places = found.below.iter().take(5);
            let places: Vec<String> = places
                .map(|(q, mm)| format!("{mm:.4} mm at {:.3}, {:.3}, {:.3}", q.x, q.y, q.z))
                .collect();
            reasons.push(ScanError::refused(
                "spike_below",
                format_args!(
                    "single points with too little stock, {} of them, were left out as spikes ({} of the scan): look \
                     whether the raw part has a pit there; where it has none, delete the point from the scan",
                    found.below.len(),
                    places.join("; ")
                ),
            ));
        }
        for face in found.faces.iter().filter(|face| face.points.is_empty()) {
            reasons.push(ScanError::refused(
                "unmeasured",
                format_args!(
                    "no point of the scan belongs to the face `{}`, so nothing says what it has: scan it too",
                    face.name
                ),
            ));
        }
        if found.unmeasured > UNMEASURED {
            let places: Vec<String> = found
                .bare
                .iter()
                .take(5)
                .map(|(c, share)| {
                    format!(
                        "{:.1} % about {:.1}, {:.1}, {:.1} mm",
                        share * 100.0,
                        c.x,
                        c.y,
                        c.z
                    )
                })
                .collect();
            reasons.push(ScanError::refused(
                "unmeasured",
                format_args!(
                    "{:.1} % of the part's surface is not scanned, or by less than a point to {:.1} mm square ({}; part \
                     coordinates): scan it from there too",
                    found.unmeasured * 100.0,
                    patches::SQUARE * self.model.diagonal_mm(),
                    places.join("; ")
                ),
            ));
        }
        reasons
    }
}

/// The refusal of so many points.
fn too_few(count: usize) -> ScanError {
    ScanError::refused(
        "too_few_points",
        format_args!(
            "{count} points do not determine where the part is: it takes at least 6, spread over its faces"
        ),
    )
}

/// Nothing holds the part against a motion along `away`, in the frame of the scan.
fn unbounded(away: &Vec3) -> ScanError {
    let away = away.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    // Rounded, so that no minus zero is printed.
    let away = away.map(|x| (x * 1e3).round() / 1e3 + 0.0);
    ScanError::refused(
        "unbounded",
        format_args!(
            "the part can move away along {:.3}, {:.3}, {:.3} of the scan, and no scanned face holds it: its stock \
             there means nothing. Scan a face that looks the other way, name one that is as built (profile_mm in \
             --faces), lock that direction (--lock), or begin where the part lies about (--start)",
            away.x, away.y, away.z
        ),
    )
}

/// The mean of the points.
fn middle(points: &[Vec3]) -> Vec3 {
    let first = points.first().copied().unwrap_or_else(Vec3::zeros);
    let sum: Vec3 = points.iter().map(|p| p - first).sum();
    first + sum / points.len().max(1) as f64
}

/// Least, largest, sum of the stock of these points, and the number of the least.
fn span(measured: &[Measured], which: impl IntoIterator<Item = usize>) -> (f64, f64, f64, usize) {
    let mut span = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0);
    for i in which {
        let d = measured[i].distance_mm;
        if d < span.0 {
            (span.0, span.3) = (d, i);
        }
        span.1 = span.1.max(d);
        span.2 += d;
    }
    span
}
