//! Faces on a ball whatever they reach: the whole ball, and pieces with poles, seams and holes.
//!
//! Longitude and latitude tear at the poles and at the seam. Here a face is laid into the plane from a point of the ball
//! outside of it (stereographically): the map has no tear, keeps angles, and circles stay circles, so that a Delaunay
//! triangulation in the plane is one on the ball.

use std::collections::HashMap;

use nalgebra::{Vector2, Vector3};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use super::super::RawMesh;
use super::super::unreadable::unreadable;
use super::CHORD_MM;
use super::face::{Border, MOST_INNER, Outline, doubled_area, too_bent};
use super::frame::Frame;
use crate::ScanError;

/// Points looked at for one outside of the face, over the whole ball.
const LOOKED_AT: u32 = 12;

/// Nearer to a border than this (radians) no point is looked from: the map would crowd.
const ASIDE_RAD: f64 = 0.02;

/// Points nearer to a border than this share of their distance from each other are left out: they would make slivers.
const SLIVER: f64 = 0.45;

/// Nearer to the point that the ball is looked from (one less a cosine), a place is beyond all others.
const AT_POLE: f64 = 1e-9;

/// Points are added so often where a triangle still leaves the ball by more than the chord.
const ROUNDS: usize = 6;

/// An edge that is gone along: its number, its sense, its points in that sense.
pub(super) type GoneEdge = (u64, bool, Border);

/// The borders of a face without its seams: edges that it goes along both ways.
pub(super) fn without_seams(bounds: &[Vec<GoneEdge>]) -> Option<Vec<Border>> {
    let gone = || bounds.iter().flatten();
    let both = |edge: &GoneEdge| gone().any(|(n, along, _)| *n == edge.0 && *along != edge.1);
    let mut left: Vec<&Border> = gone().filter(|e| !both(e)).map(|(_, _, way)| way).collect();
    let near = |a: Option<&Vector3<f64>>, b: Option<&Vector3<f64>>| {
        a.zip(b)
            .is_some_and(|(a, b)| (a - b).norm() <= super::GAP_MM)
    };
    let mut borders = Vec::new();
    while let Some(first) = left.pop() {
        let mut border = first.clone();
        while !near(border.first(), border.last()) || border.len() < 3 {
            let next = left
                .iter()
                .position(|way| near(border.last(), way.first()))?;
            border.pop();
            border.extend(left.swap_remove(next));
        }
        border.pop();
        borders.push(border);
    }
    Some(borders)
}

/// Adds the triangles of a face. Its borders have the face on their left, seen from outside of it; `turned`: the outer
/// side looks to the ball's middle.
pub(super) fn triangles(
    frame: &Frame,
    radius: f64,
    borders: &[Border],
    turned: bool,
    longest_mm: f64,
    into: &mut RawMesh,
) -> Result<(), ScanError> {
    let (points, whole) = spread(radius, longest_mm)?;
    let on_ball = |d: &Vector3<f64>| frame.at + d * radius;
    let first = into.vertices.len();
    let mut add = |vertices: &[Vector3<f64>], faces: &[[usize; 3]]| {
        into.vertices.extend(vertices);
        let of = |[a, b, c]: &[usize; 3]| match turned {
            true => [first + a, first + c, first + b],
            false => [first + a, first + b, first + c],
        };
        into.faces.extend(faces.iter().map(of));
    };
    if borders.is_empty() {
        let vertices: Vec<Vector3<f64>> = points.iter().map(on_ball).collect();
        add(&vertices, &whole);
        return Ok(());
    }
    // As seen from outside of the ball.
    let mut rings: Vec<Border> = borders.to_vec();
    if turned {
        rings.iter_mut().for_each(|ring| ring.reverse());
    }
    let directions: Vec<Vec<Vector3<f64>>> = rings
        .iter()
        .map(|ring| ring.iter().map(|p| (p - frame.at).normalize()).collect())
        .collect();
    for (d, p) in directions.iter().flatten().zip(rings.iter().flatten()) {
        let off = (on_ball(d) - p).norm();
        if off > super::GAP_MM || off.is_nan() {
            return Err(unreadable(format_args!(
                "a border lies {off:.3} mm off its surface"
            )));
        }
    }
    let plane = outside(&directions)
        .ok_or_else(|| super::not_read("a ball with too little cut out of it"))?;
    let spacing = spacing(&points, &whole) * radius;
    let mut inner: Vec<Vector3<f64>> = points;
    let near = SLIVER * spacing / radius;
    let border_points = along(&directions, 0.5 * near);
    let clear = Grid::new(&border_points, near);
    inner.retain(|p| !clear.any_near(p));
    for round in 0..=ROUNDS {
        let net = Net::new(&plane, &directions, &rings, &inner, on_ball)?;
        let sag = |[a, b, c]: &[usize; 3]| {
            let middle = (net.vertices[*a] + net.vertices[*b] + net.vertices[*c]) / 3.0 - frame.at;
            (radius - middle.norm(), middle)
        };
        let bent = net.faces.iter().map(sag).filter(|(off, _)| *off > CHORD_MM);
        let more: Vec<Vector3<f64>> = bent.filter_map(|(_, m)| m.try_normalize(1e-9)).collect();
        if more.is_empty() || round == ROUNDS {
            if net.faces.is_empty() {
                return Err(unreadable("a face has nothing between its borders"));
            }
            let looks_out = |[a, b, c]: &[usize; 3]| {
                let [a, b, c] = [a, b, c].map(|k| net.vertices[*k] - frame.at);
                (b - a).cross(&(c - a)).dot(&(a + b + c)) > 0.0
            };
            if !net.faces.iter().all(looks_out) {
                return Err(super::not_read("a ball with such a border"));
            }
            add(&net.vertices, &net.faces);
            return Ok(());
        }
        if inner.len() + more.len() > MOST_INNER {
            return Err(too_bent());
        }
        inner.extend(more);
    }
    Ok(())
}

/// An edge of the largest triangle, of a part of a quarter turn: 1.56, and a little.
const LARGER: f64 = 1.6;

/// Directions, and triangles of them.
type Spread = (Vec<Vector3<f64>>, Vec<[usize; 3]>);

/// Points all over the unit ball with their triangles: an octahedron's sides parted, until they leave a ball of this
/// radius by no more than the chord and are no longer than `longest_mm`.
fn spread(radius: f64, longest_mm: f64) -> Result<Spread, ScanError> {
    // A triangle leaves the ball by the square of its circle's radius over twice the ball's. Those in the middle of an
    // octahedron's side are larger than a part of its edge, by the root of 6 over a quarter turn.
    let side = (6.0 * radius * CHORD_MM).sqrt().min(longest_mm) / LARGER;
    let parts = (std::f64::consts::FRAC_PI_2 * radius / side)
        .ceil()
        .max(2.0);
    if 4.0 * parts * parts > MOST_INNER as f64 || parts.is_nan() {
        return Err(too_bent());
    }
    let n = parts as i32;
    let mut known: HashMap<[i32; 3], usize> = HashMap::new();
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|k| if octant >> k & 1 == 1 { -1 } else { 1 });
        let mut number = |i: i32, j: i32| {
            let key = [sign[0] * i, sign[1] * j, sign[2] * (n - i - j)];
            *known.entry(key).or_insert_with(|| {
                points.push(Vector3::from(key.map(f64::from)).normalize());
                points.len() - 1
            })
        };
        let mirrored = sign.iter().product::<i32>() < 0;
        let mut add = |[a, b, c]: [usize; 3]| {
            faces.push(if mirrored { [a, c, b] } else { [a, b, c] });
        };
        for i in 0..n {
            for j in 0..n - i {
                let (a, b, c) = (number(i, j), number(i + 1, j), number(i, j + 1));
                add([a, b, c]);
                if i + j + 2 <= n {
                    let d = number(i + 1, j + 1);
                    add([b, d, c]);
                }
            }
        }
    }
    Ok((points, faces))
}

/// Points along borders, no farther apart than this.
fn along(rings: &[Vec<Vector3<f64>>], apart: f64) -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for ring in rings {
        for (k, from) in ring.iter().enumerate() {
            let way = ring[(k + 1) % ring.len()] - from;
            let parts = (way.norm() / apart).ceil().clamp(1.0, 1e3) as usize;
            points.extend((0..parts).map(|j| from + way * (j as f64 / parts as f64)));
        }
    }
    points
}

/// The mean length of an edge.
fn spacing(points: &[Vector3<f64>], faces: &[[usize; 3]]) -> f64 {
    let all = faces
        .iter()
        .map(|[a, b, _]| (points[*a] - points[*b]).norm());
    all.sum::<f64>() / faces.len().max(1) as f64
}

/// A plane that the ball is laid into from a point of it.
struct Plane {
    from: Vector3<f64>,
    x: Vector3<f64>,
    y: Vector3<f64>,
}

impl Plane {
    fn new(from: Vector3<f64>) -> Self {
        let aside = if from.z.abs() < 0.7 {
            Vector3::z()
        } else {
            Vector3::x()
        };
        // Seen from outside, what goes round counter-clockwise does so in the plane.
        let x = from.cross(&aside).normalize();
        let y = x.cross(&from);
        Plane { from, x, y }
    }

    fn place(&self, p: &Vector3<f64>) -> Vector2<f64> {
        let near = (1.0 - self.from.dot(p)).max(1e-12);
        Vector2::new(self.x.dot(p), self.y.dot(p)) / near
    }
}

/// A plane from a point outside of the face, as far from its borders as can be; none where no such point was found.
fn outside(rings: &[Vec<Vector3<f64>>]) -> Option<Plane> {
    let n = LOOKED_AT as i32;
    let mut places: Vec<Vector3<f64>> = Vec::new();
    for i in -n..=n {
        for j in -n..=n {
            for k in -n..=n {
                if i.abs() + j.abs() + k.abs() == n {
                    places.push(Vector3::new(i.into(), j.into(), k.into()).normalize());
                }
            }
        }
    }
    // The middle of a small hole.
    for ring in rings {
        let middle = ring.iter().sum::<Vector3<f64>>().try_normalize(1e-6);
        places.extend(middle.into_iter().flat_map(|m| [m, -m]));
    }
    let aside = |p: &Vector3<f64>| {
        let off = rings.iter().flatten().map(|q| (p - q).norm());
        off.fold(f64::INFINITY, f64::min)
    };
    let mut places: Vec<(f64, Vector3<f64>)> = places.into_iter().map(|p| (aside(&p), p)).collect();
    places.retain(|(aside, _)| *aside > ASIDE_RAD);
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut planes = places.into_iter().map(|(_, p)| Plane::new(p));
    planes.find(|plane| {
        // The outermost border is gone round counter-clockwise: what lies beyond it is not the face.
        let laid = rings.iter().map(|ring| {
            let laid: Vec<_> = ring.iter().map(|p| (plane.place(p), *p)).collect();
            let farthest = laid
                .iter()
                .map(|(q, _)| q.x)
                .fold(f64::NEG_INFINITY, f64::max);
            (farthest, doubled_area(&laid))
        });
        let outermost = laid.max_by(|a, b| a.0.total_cmp(&b.0));
        outermost.is_some_and(|(_, area)| area > 0.0)
    })
}

/// Which places have one of some points near.
struct Grid<'a> {
    points: &'a [Vector3<f64>],
    near: f64,
    cells: HashMap<[i64; 3], Vec<usize>>,
}

impl<'a> Grid<'a> {
    fn new(points: &'a [Vector3<f64>], near: f64) -> Self {
        let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (k, p) in points.iter().enumerate() {
            cells.entry(Self::cell(p, near)).or_default().push(k);
        }
        Grid {
            points,
            near,
            cells,
        }
    }

    fn cell(p: &Vector3<f64>, near: f64) -> [i64; 3] {
        [p.x, p.y, p.z].map(|v| (v / near).floor() as i64)
    }

    fn any_near(&self, p: &Vector3<f64>) -> bool {
        let at = Self::cell(p, self.near);
        let beside = (0..27).map(|k| {
            let by = |d: i64| k / d % 3 - 1;
            [at[0] + by(1), at[1] + by(3), at[2] + by(9)]
        });
        let all = beside.filter_map(|cell| self.cells.get(&cell)).flatten();
        all.into_iter()
            .any(|k| (self.points[*k] - p).norm() < self.near)
    }
}

/// A face's triangles.
struct Net {
    vertices: Vec<Vector3<f64>>,
    faces: Vec<[usize; 3]>,
}

impl Net {
    fn new(
        plane: &Plane,
        directions: &[Vec<Vector3<f64>>],
        rings: &[Border],
        inner: &[Vector3<f64>],
        on_ball: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Result<Self, ScanError> {
        let wrong = || unreadable("a border crosses itself");
        let place = |p: &Vector3<f64>| {
            let q = plane.place(p);
            Point2::new(q.x, q.y)
        };
        let mut net = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
        let mut vertices: Vec<Vector3<f64>> = Vec::new();
        let mut ends: Vec<[Point2<f64>; 2]> = Vec::new();
        for (ring, corners) in directions.iter().zip(rings) {
            let mut numbers = Vec::with_capacity(ring.len());
            for (d, at) in ring.iter().zip(corners) {
                let handle = net.insert(place(d)).map_err(|_| wrong())?;
                if handle.index() == vertices.len() {
                    vertices.push(*at);
                }
                numbers.push(handle);
            }
            for k in 0..ring.len() {
                let next = (k + 1) % ring.len();
                ends.push([place(&ring[k]), place(&ring[next])]);
                if numbers[k] == numbers[next] {
                    continue;
                }
                if !net.can_add_constraint(numbers[k], numbers[next]) {
                    return Err(wrong());
                }
                net.add_constraint(numbers[k], numbers[next]);
            }
        }
        let outline = Outline::new(&ends);
        for p in inner {
            let here = place(p);
            // The point that it is looked from has no place.
            if plane.from.dot(p) < 1.0 - AT_POLE && outline.has(&here) {
                let handle = net.insert(here).map_err(|_| wrong())?;
                if handle.index() == vertices.len() {
                    vertices.push(on_ball(p));
                }
            }
        }
        let within = net
            .inner_faces()
            .filter(|face| outline.has(&face.center()))
            .map(|face| face.vertices().map(|v| v.fix().index()));
        let faces = within.collect();
        Ok(Net { vertices, faces })
    }
}
