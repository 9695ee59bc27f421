//! A height over a chart, its slope, and where its level lines go so that strips overlap as wanted.
//!
//! The lines of a height `h` lie `dh / |grad h|` apart on the surface, which changes along them: the local scale. So
//! levels are placed by the least slope along each line: nowhere is the overlap less than wanted, and the direction is
//! chosen for which it is hardly more.

use nalgebra::{Vector2, Vector3};

use super::super::map::{Chart, flatten::across};
use super::super::mesh::PartMesh;

/// Directions tried on the map, and again as planes through the part.
const DIRECTIONS: usize = 18;

/// Steps of the height in which slopes are collected.
const BINS: usize = 256;

/// How far from the end of the reach the last course lies, of the strip's width.
const CUT_INSET: f64 = 0.15;

/// A height over the vertices of a chart.
#[derive(Debug, Clone)]
pub struct HeightField {
    /// By the chart's own vertices.
    pub height: Vec<f64>,
    /// Slope on each triangle of the chart: a tangent vector on the surface.
    pub slope: Vec<Vector3<f64>>,
    /// What it is, for reports.
    pub name: String,
}

/// What the strip needs.
#[derive(Debug, Clone, Copy)]
pub struct Spacing {
    /// Width of a strip that counts on.
    pub width_mm: f64,
    /// Way between neighbouring courses at most.
    pub pitch_mm: f64,
}

/// Two directions across a chart's mean normal, along the sides of the box of least area around it: they go with the part,
/// however it lies in its file.
pub fn chart_axes(part: &PartMesh, chart: &Chart) -> (Vector3<f64>, Vector3<f64>) {
    let mean: Vector3<f64> = chart
        .faces
        .iter()
        .map(|&f| part.normal(f as usize) * part.area_mm2(f as usize))
        .sum();
    let (x, y) = across(&mean);
    let places = chart.map.vertices.iter().map(|&v| {
        let p = &part.vertices[v as usize];
        Vector2::new(p.dot(&x), p.dot(&y))
    });
    let (s, c) = box_angle(places.collect()).sin_cos();
    (x * c + y * s, y * c - x * s)
}

/// All heights that are tried on a chart: lines of the map and planes through the part.
pub fn fields(part: &PartMesh, chart: &Chart) -> Vec<HeightField> {
    // Angles are counted from the box of least area, so that a part that lies otherwise is planned alike.
    let on_map = box_angle(chart.map.places.clone());
    let (x, y) = chart_axes(part, chart);
    let mut fields = Vec::new();
    for k in 0..DIRECTIONS {
        let angle = std::f64::consts::PI * k as f64 / DIRECTIONS as f64;
        let degrees = angle.to_degrees().round();
        let (s, c) = (on_map + angle).sin_cos();
        let map: Vec<f64> = chart.map.places.iter().map(|p| c * p.x + s * p.y).collect();
        fields.push(HeightField::new(part, chart, map, format!("map {degrees}")));
        let (s, c) = angle.sin_cos();
        let along = x * c + y * s;
        let plane: Vec<f64> = chart
            .map
            .vertices
            .iter()
            .map(|&v| part.vertices[v as usize].dot(&along))
            .collect();
        fields.push(HeightField::new(
            part,
            chart,
            plane,
            format!("planes {degrees}"),
        ));
    }
    fields
}

/// Edges of a hull that are looked at, at most: more stand for a curve.
const HULL_EDGES: usize = 256;

/// Boxes whose area is larger by this share are nearly as good.
const AS_GOOD: f64 = 1e-3;

/// The direction of a side of the box of least area around points, in radians, up to quarter turns. One side of it lies on
/// an edge of their convex hull; of boxes that are nearly as good the mean, so that a part that is the same in a mirror has
/// the direction of its mirror.
fn box_angle(mut points: Vec<Vector2<f64>>) -> f64 {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull: Vec<Vector2<f64>> = Vec::new();
    // The lower side forwards, then the upper one back (Andrew's monotone chain).
    for back in [false, true] {
        let start = hull.len();
        for k in 0..points.len() {
            let p = points[if back { points.len() - 1 - k } else { k }];
            while hull.len() >= start + 2
                && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp(&(p - hull[hull.len() - 2]))
                    <= 0.0
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    }
    // Of each edge: the area of its box, its own length, and its angle.
    let mut boxes: Vec<(f64, f64, f64)> = Vec::new();
    for k in (0..hull.len()).step_by((hull.len() / HULL_EDGES).max(1)) {
        let edge = hull[(k + 1) % hull.len()] - hull[k];
        let Some(along) = edge.try_normalize(1e-12) else {
            continue;
        };
        let across = Vector2::new(-along.y, along.x);
        let extent = |d: &Vector2<f64>| {
            let (low, high) = hull
                .iter()
                .map(|p| p.dot(d))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                    (l.min(v), h.max(v))
                });
            high - low
        };
        let area = extent(&along) * extent(&across);
        boxes.push((area, edge.norm(), along.y.atan2(along.x)));
    }
    let least = boxes.iter().map(|b| b.0).fold(f64::INFINITY, f64::min);
    let mean: Vector2<f64> = boxes
        .iter()
        .map(|(area, length, angle)| {
            // As good as the best but for rounding or the mesh: each has its say, so that neither chooses.
            let weight = length * (-(area / least - 1.0) / AS_GOOD).exp();
            let (s, c) = (4.0 * angle).sin_cos();
            Vector2::new(c, s) * weight
        })
        .sum();
    mean.y.atan2(mean.x) / 4.0
}

impl HeightField {
    /// A height with its slopes.
    pub fn new(part: &PartMesh, chart: &Chart, height: Vec<f64>, name: String) -> Self {
        let slope = chart
            .faces
            .iter()
            .zip(&chart.map.faces)
            .map(|(&face, f)| {
                let t = part.corners(face as usize);
                let h = f.map(|k| height[k as usize]);
                let n = part.normal(face as usize);
                let twice = 2.0 * part.area_mm2(face as usize);
                (0..3)
                    .map(|k| n.cross(&(t[(k + 2) % 3] - t[(k + 1) % 3])) * (h[k] / twice))
                    .sum()
            })
            .collect();
        HeightField {
            height,
            slope,
            name,
        }
    }

    /// Levels of the courses. `share` tells for each triangle of the chart how wide a strip is there, as a share of the
    /// line's length (1 where the beam follows the surface and the line can be turned freely); 0 where it is not reached.
    /// Where the reach ends before the height does, the last course lies near that end: half its line sees beyond.
    pub fn levels(
        &self,
        part: &PartMesh,
        chart: &Chart,
        spacing: Spacing,
        share: &[f64],
    ) -> Vec<f64> {
        let span = |heights: &mut dyn Iterator<Item = f64>| {
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            })
        };
        let whole = span(&mut self.height.iter().copied());
        let reached = chart.map.faces.iter().zip(share).filter(|(_, s)| **s > 0.0);
        let (low, high) = span(&mut reached.flat_map(|(f, _)| f.map(|v| self.height[v as usize])));
        if low > high {
            return Vec::new();
        }
        let bin = (high - low) / BINS as f64;
        if bin.is_nan() || bin <= 1e-9 {
            return vec![(low + high) / 2.0];
        }
        // Slopes in each bin of height, with the area that has them.
        let mut slopes: Vec<Vec<(f64, f64)>> = vec![Vec::new(); BINS];
        for (k, f) in chart.map.faces.iter().enumerate() {
            let h = f.map(|v| self.height[v as usize]);
            let place = |h: f64| (((h - low) / bin) as usize).min(BINS - 1);
            let (from, to) = (
                place(h[0].min(h[1]).min(h[2])),
                place(h[0].max(h[1]).max(h[2])),
            );
            if share[k] <= 0.0 {
                continue;
            }
            let area = part.area_mm2(chart.faces[k] as usize) / (to - from + 1) as f64;
            let slope = self.slope[k].norm() * share[k];
            for here in &mut slopes[from..=to] {
                here.push((slope, area));
            }
        }
        // Way on the surface from the lowest point to the end of each bin, where the slope is least.
        let mut way = Vec::with_capacity(BINS + 1);
        way.push(0.0);
        let mut last = 0.0;
        let mut least_before = 1.0;
        for here in &mut slopes {
            here.sort_by(|a, b| a.0.total_cmp(&b.0));
            let all: f64 = here.iter().map(|s| s.1).sum();
            let mut sum = 0.0;
            // A few slivers may lie flat without making all lines denser.
            let least = here
                .iter()
                .find(|s| {
                    sum += s.1;
                    sum >= 0.03 * all
                })
                .map_or(least_before, |s| s.0.max(1e-6));
            least_before = least;
            last += bin / least;
            way.push(last);
        }
        let at = |s: f64| {
            let k = way.partition_point(|w| *w < s).clamp(1, BINS);
            let share = (s - way[k - 1]) / (way[k] - way[k - 1]).max(1e-300);
            low + bin * (k as f64 - 1.0 + share.clamp(0.0, 1.0))
        };
        let inset = |cut: bool| spacing.width_mm * if cut { CUT_INSET } else { 0.5 };
        let little = 0.01 * (whole.1 - whole.0);
        let (first, end) = (
            inset(low - whole.0 > little),
            last - inset(whole.1 - high > little),
        );
        let inner = end - first;
        if inner <= 0.0 {
            return vec![at(last / 2.0)];
        }
        let gaps = (inner / spacing.pitch_mm).ceil().clamp(1.0, 20_000.0);
        (0..=gaps as usize)
            .map(|k| at(first + inner * k as f64 / gaps))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::box_angle;

    #[test]
    fn the_box_of_least_area_turns_with_its_points() {
        for degrees in [0.0_f64, 17.0, 45.0, 80.0, 133.0] {
            let (s, c) = degrees.to_radians().sin_cos();
            let points = [(0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (0.0, 4.0), (5.0, 2.0)]
                .map(|(x, y)| Vector2::new(c * x - s * y, s * x + c * y));
            let found = box_angle(points.to_vec()).to_degrees() - degrees;
            let off = (found / 90.0).round() * 90.0 - found;
            assert!(off.abs() < 1e-9, "{degrees}: {found}");
        }
        assert_eq!(box_angle(Vec::new()), 0.0);
        // Four boxes are as good: two lean to either side.
        let roofs = [
            (0.0, 1.0),
            (5.0, 0.0),
            (10.0, 1.0),
            (10.0, 6.0),
            (5.0, 7.0),
            (0.0, 6.0),
        ];
        for turn in [0, 2, 5] {
            let mut points = roofs.map(|(x, y)| Vector2::new(x, y)).to_vec();
            points.rotate_left(turn);
            assert!(box_angle(points).abs() < 1e-9);
        }
    }
}
