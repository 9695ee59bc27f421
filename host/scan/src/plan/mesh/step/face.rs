//! A face becomes triangles: its borders are laid into the surface's parameters, points are put between them, and a
//! constrained Delaunay triangulation joins all of them.

use nalgebra::{Vector2, Vector3};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use super::super::RawMesh;
use super::super::unreadable::unreadable;
use super::surface::Surface;
use crate::ScanError;

/// Points between the borders of one face at most.
pub(super) const MOST_INNER: usize = 200_000;

/// Triangles of less height than this have none.
const FLAT_MM: f64 = 1e-6;

/// A border: corners in space, in order.
pub(super) type Border = Vec<Vector3<f64>>;

/// A corner of a border in the surface's parameters.
type Corner = (Vector2<f64>, Vector3<f64>);

/// Adds the triangles of a face, their outer side where the surface's normal points, or against it where `turned`.
pub(super) fn triangles(
    surface: &Surface,
    borders: &[Border],
    turned: bool,
    longest_mm: f64,
    into: &mut RawMesh,
) -> Result<(), ScanError> {
    let turned_ball;
    let (surface, rings) = match rings_of(surface, borders) {
        Ok(rings) => (surface, rings),
        Err(refusal) => {
            // The corner of fillets on three edges: a piece of a ball with its pole at a corner. Another pole serves as well.
            turned_ball = surface.turned_towards(borders).ok_or(refusal)?;
            let rings = rings_of(&turned_ball, borders)?;
            if (doubled_area(&rings[0]) > 0.0) == turned {
                return Err(super::not_read("a ball with a piece cut out of it"));
            }
            (&turned_ball, rings)
        }
    };
    let all = || rings.iter().flatten().map(|(q, _)| *q);
    let (low, high) = all().fold(
        (
            Vector2::repeat(f64::INFINITY),
            Vector2::repeat(f64::NEG_INFINITY),
        ),
        |(l, h), q| (l.inf(&q), h.sup(&q)),
    );
    if (high - low).min() <= 0.0 || (high - low).min().is_nan() {
        return Err(unreadable("a face has no width"));
    }
    let [us, vs] = surface.grid(low, high, longest_mm);
    if us.len().saturating_mul(vs.len()) > MOST_INNER {
        return Err(too_bent());
    }
    // Triangles are judged in millimetres, not in parameters.
    let mut scale = Vector2::zeros();
    for u in &us {
        for v in &vs {
            let (_, by_u, by_v) = surface.at(*u, *v);
            scale += Vector2::new(by_u.norm(), by_v.norm());
        }
    }
    let scale = scale / (us.len() * vs.len()) as f64;
    if scale.min() <= 0.0 || !scale.iter().all(|s| s.is_finite()) {
        return Err(unreadable("a surface has no width"));
    }
    let place = |q: &Vector2<f64>| {
        let x = (q - low).component_mul(&scale);
        Point2::new(x.x, x.y)
    };
    let mut net = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut corners: Vec<Vector3<f64>> = Vec::new();
    let wrong = || unreadable("a border crosses itself");
    for ring in &rings {
        let mut numbers = Vec::with_capacity(ring.len());
        for (q, at) in ring {
            let handle = net.insert(place(q)).map_err(|_| wrong())?;
            if handle.index() == corners.len() {
                corners.push(*at);
            }
            numbers.push(handle);
        }
        for (k, from) in numbers.iter().enumerate() {
            let to = numbers[(k + 1) % numbers.len()];
            if *from == to {
                continue;
            }
            if !net.can_add_constraint(*from, to) {
                return Err(wrong());
            }
            net.add_constraint(*from, to);
        }
    }
    let ends: Vec<[Point2<f64>; 2]> = rings
        .iter()
        .flat_map(|r| (0..r.len()).map(move |k| [place(&r[k].0), place(&r[(k + 1) % r.len()].0)]))
        .collect();
    let outline = Outline::new(&ends);
    for (i, u) in us.iter().enumerate() {
        // A little less than half a step from the border: nearer ones would make slivers.
        let step = |all: &[f64], k: usize, s: f64| {
            let before = if k > 0 {
                all[k] - all[k - 1]
            } else {
                f64::INFINITY
            };
            let after = all.get(k + 1).map_or(f64::INFINITY, |n| n - all[k]);
            before.min(after) * s
        };
        let most = 0.4 * step(&us, i, scale.x);
        let x = (u - low.x) * scale.x;
        let near: Vec<[Point2<f64>; 2]> = ends
            .iter()
            .filter(|[a, b]| a.x.min(b.x) - most <= x && x <= a.x.max(b.x) + most)
            .copied()
            .collect();
        for (j, v) in vs.iter().enumerate() {
            let q = Vector2::new(*u, *v);
            let here = place(&q);
            let room = most.min(0.4 * step(&vs, j, scale.y));
            if near.iter().all(|e| distance(&here, e) > room) && outline.has(&here) {
                let handle = net.insert(here).map_err(|_| wrong())?;
                if handle.index() == corners.len() {
                    corners.push(surface.at(*u, *v).0);
                }
            }
        }
    }
    let first = into.vertices.len();
    let mut any = false;
    for face in net.inner_faces() {
        let [a, b, c] = face.vertices();
        // Corners of a straight border lie on a line but for rounding: what is between them is no face.
        let longest = face
            .adjacent_edges()
            .map(|e| e.length_2())
            .into_iter()
            .fold(0.0, f64::max);
        if 2.0 * face.area() < FLAT_MM * longest.sqrt() || !outline.has(&face.center()) {
            continue;
        }
        let [a, b, c] = [a, b, c].map(|v| first + v.fix().index());
        into.faces.push(if turned { [a, c, b] } else { [a, b, c] });
        any = true;
    }
    into.vertices.extend(corners);
    if any {
        Ok(())
    } else {
        Err(unreadable("a face has nothing between its borders"))
    }
}

/// The refusal of a face that too many points would stand for.
pub(super) fn too_bent() -> ScanError {
    ScanError::refused(
        "mesh_scale",
        "A face bends so much that more than 200 000 points would stand for it: is the file in millimetres?",
    )
}

/// All borders in the parameters.
fn rings_of(surface: &Surface, borders: &[Border]) -> Result<Vec<Vec<Corner>>, ScanError> {
    let mut rings: Vec<Vec<Corner>> = Vec::with_capacity(borders.len());
    for border in borders {
        let ring = ring(surface, border, rings.first().map(|r| r[0].0))?;
        rings.push(ring);
    }
    Ok(rings)
}

/// Twice the area within a ring, positive if it is gone round counter-clockwise.
pub(super) fn doubled_area(ring: &[Corner]) -> f64 {
    (0..ring.len())
        .map(|k| ring[k].0.perp(&ring[(k + 1) % ring.len()].0))
        .sum()
}

/// A border in the parameters, gone along without a jump.
fn ring(
    surface: &Surface,
    border: &Border,
    beside: Option<Vector2<f64>>,
) -> Result<Vec<Corner>, ScanError> {
    let mut ring: Vec<Corner> = Vec::with_capacity(border.len());
    for at in border {
        let before = ring.last().map(|(q, _)| *q).or(beside);
        ring.push((surface.parameters(at, before)?, *at));
    }
    let (Some(first), Some((last, _))) = (border.first(), ring.last()) else {
        return Err(unreadable("a border has no corners"));
    };
    let first = surface.parameters(first, Some(*last))?;
    // Gone round the surface, the first corner comes again a whole turn further.
    for (k, round) in surface.round().into_iter().enumerate() {
        if let Some(way) = round
            && (first[k] - ring[0].0[k]).abs() > 0.5 * way
        {
            return Err(super::not_read(
                "a face that goes round its surface without a seam",
            ));
        }
    }
    if ring.len() < 3 {
        return Err(unreadable("a border has fewer than three corners"));
    }
    Ok(ring)
}

/// The borders' pieces, by the bands of y that they reach into.
pub(super) struct Outline {
    low: f64,
    per_mm: f64,
    bands: Vec<Vec<[Point2<f64>; 2]>>,
}

impl Outline {
    pub(super) fn new(ends: &[[Point2<f64>; 2]]) -> Self {
        let (low, high) = ends
            .iter()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| {
                (l.min(p.y), h.max(p.y))
            });
        let count = ends.len().clamp(1, 1000);
        let mut outline = Outline {
            low,
            per_mm: count as f64 / (high - low).max(1e-300),
            bands: vec![Vec::new(); count],
        };
        for end in ends {
            let (a, b) = (outline.band(end[0].y), outline.band(end[1].y));
            for band in &mut outline.bands[a.min(b)..=a.max(b)] {
                band.push(*end);
            }
        }
        outline
    }

    /// Never falls while y rises, so that a piece that passes a height is in that height's band.
    fn band(&self, y: f64) -> usize {
        (((y - self.low) * self.per_mm) as usize).min(self.bands.len() - 1)
    }

    /// Is a point between the borders? A ray to the right crosses them an odd number of times.
    pub(super) fn has(&self, p: &Point2<f64>) -> bool {
        self.bands[self.band(p.y)]
            .iter()
            .filter(|[a, b]| {
                (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
            })
            .count()
            % 2
            == 1
    }
}

fn distance(p: &Point2<f64>, [a, b]: &[Point2<f64>; 2]) -> f64 {
    let (p, a, b) = (
        Vector2::new(p.x, p.y),
        Vector2::new(a.x, a.y),
        Vector2::new(b.x, b.y),
    );
    let way = b - a;
    let share = if way.norm_squared() > 0.0 {
        ((p - a).dot(&way) / way.norm_squared()).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p - a - way * share).norm()
}
