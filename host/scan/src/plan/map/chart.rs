//! Charts: pieces of the surface that a row of passes can cover.
//!
//! A sensor cannot turn about a sharp edge within a step, so charts end there. A piece that closes upon itself or folds
//! over in its map is parted by the direction of its normals, which costs the fewest cuts across gentle curvature; one whose
//! map lies over itself, as that of a ramp that winds up, is halved.

use nalgebra::Vector3;

use super::super::mesh::{PartMesh, weld::BORDER};
use super::flatten::FlatMap;
use crate::ScanError;

/// Triangles that are planned together, with their map.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Numbers of the triangles.
    pub faces: Vec<u32>,
    /// The same triangles in the plane.
    pub map: FlatMap,
    /// Unit normal of each of the map's vertices: the mean of this chart's triangles by their angles there. Beyond a sharp
    /// edge the part looks elsewhere; that says nothing here.
    pub normals: Vec<Vector3<f64>>,
}

impl Chart {
    /// A chart of these triangles.
    fn new(part: &PartMesh, faces: Vec<u32>, map: FlatMap) -> Self {
        let mut normals = vec![Vector3::zeros(); map.vertices.len()];
        for (&face, corners) in faces.iter().zip(&map.faces) {
            let t = part.corners(face as usize);
            for k in 0..3 {
                let (u, v) = (t[(k + 1) % 3] - t[k], t[(k + 2) % 3] - t[k]);
                let angle = u.cross(&v).norm().atan2(u.dot(&v));
                normals[corners[k] as usize] += part.normal(face as usize) * angle;
            }
        }
        for n in &mut normals {
            *n = n.try_normalize(1e-12).unwrap_or_else(Vector3::z);
        }
        Self {
            faces,
            map,
            normals,
        }
    }
}

/// How unlike the least and largest scale of a map may be before its piece is parted.
const SCALE_RATIO: f64 = 6.0;

/// Normals within this of a cap's direction belong to it.
const CAP_DEG: f64 = 50.0;

/// Parts the surface. Edges sharper than `sharp_deg` end a chart. `go_on` is asked before each piece and can refuse.
///
/// # Errors
/// What `go_on` says.
pub fn charts(
    part: &PartMesh,
    sharp_deg: f64,
    go_on: impl Fn() -> Result<(), ScanError>,
) -> Result<Vec<Chart>, ScanError> {
    let sharp = sharp_deg.to_radians().cos();
    let mut taken = vec![false; part.faces.len()];
    // True but while a piece is parted: one for all, as a part can have very many pieces.
    let mut parted = vec![true; part.faces.len()];
    let mut charts = Vec::new();
    for start in 0..part.faces.len() {
        if taken[start] {
            continue;
        }
        let piece = grow(part, &mut taken, start, |f, g| {
            part.normal(f).dot(&part.normal(g)) >= sharp
        });
        go_on()?;
        charts.extend(part_piece(part, piece, &mut parted));
    }
    Ok(charts)
}

/// All faces that hang together with `start` by edges that `passes` lets through.
fn grow(
    part: &PartMesh,
    taken: &mut [bool],
    start: usize,
    passes: impl Fn(usize, usize) -> bool,
) -> Vec<u32> {
    let mut piece = vec![start as u32];
    taken[start] = true;
    let mut next = 0;
    while next < piece.len() {
        let f = piece[next] as usize;
        next += 1;
        for &g in &part.neighbours[f] {
            if g != BORDER && !taken[g as usize] && passes(f, g as usize) {
                taken[g as usize] = true;
                piece.push(g);
            }
        }
    }
    piece
}

fn part_piece(part: &PartMesh, piece: Vec<u32>, parted: &mut [bool]) -> Vec<Chart> {
    let inside: std::collections::HashSet<u32> = piece.iter().copied().collect();
    let open = piece.iter().any(|&f| {
        part.neighbours[f as usize]
            .iter()
            .any(|g| *g == BORDER || !inside.contains(g))
    });
    if open {
        let map = FlatMap::new(part, &piece);
        let q = map.quality;
        if q.flips == 0 && q.scale_max < SCALE_RATIO * q.scale_min && !wraps(part, &piece) {
            if !map.lies_over_itself() {
                return vec![Chart::new(part, piece, map)];
            }
            if let Some(halves) = halves(part, &piece, parted) {
                let parts = halves
                    .into_iter()
                    .map(|half| part_piece(part, half, parted));
                return parts.flatten().collect();
            }
        }
    }
    caps(part, piece, parted)
        .into_iter()
        .map(|faces| {
            let map = FlatMap::new(part, &faces);
            Chart::new(part, faces, map)
        })
        .collect()
}

/// A piece parted across its longest way, by the number of edges from one of its ends; none where it is hardly larger than
/// what is left of it, or cannot be parted so. `taken`: all true, before and after.
fn halves(part: &PartMesh, piece: &[u32], taken: &mut [bool]) -> Option<Vec<Vec<u32>>> {
    if piece.len() < LEAST_HALVED {
        return None;
    }
    let mut from = |start: u32| {
        for &f in piece {
            taken[f as usize] = false;
        }
        // In the order of the edges between.
        grow(part, taken, start as usize, |_, _| true)
    };
    let middle = from(*piece.first()?);
    let order = from(*middle.last()?);
    let whole = order.len() == piece.len();
    for &f in piece {
        taken[f as usize] = !whole;
    }
    if !whole {
        return None;
    }
    let near: std::collections::HashSet<u32> = order[..order.len() / 2].iter().copied().collect();
    let mut halves = Vec::new();
    for &start in &order {
        if !taken[start as usize] {
            let first = near.contains(&start);
            let same = |_: usize, g: usize| near.contains(&(g as u32)) == first;
            halves.push(grow(part, taken, start as usize, same));
        }
    }
    Some(halves)
}

/// A piece of fewer triangles is not halved.
const LEAST_HALVED: usize = 8;

/// Do the normals point all around, so that a map without flips may still lie over itself?
fn wraps(part: &PartMesh, piece: &[u32]) -> bool {
    let mean: Vector3<f64> = piece
        .iter()
        .map(|&f| part.normal(f as usize) * part.area_mm2(f as usize))
        .sum();
    let Some(mean) = mean.try_normalize(1e-9) else {
        return true;
    };
    piece
        .iter()
        .any(|&f| part.normal(f as usize).dot(&mean) < -0.3)
}

/// Parts a piece by the directions of its normals, the largest cap first. `taken`: all true, before and after.
fn caps(part: &PartMesh, piece: Vec<u32>, taken: &mut [bool]) -> Vec<Vec<u32>> {
    let cap = CAP_DEG.to_radians().cos();
    for &f in &piece {
        taken[f as usize] = false;
    }
    let mut order = piece;
    order.sort_by(|a, b| {
        part.area_mm2(*b as usize)
            .total_cmp(&part.area_mm2(*a as usize))
            .then(a.cmp(b))
    });
    let mut pieces = Vec::new();
    for &start in &order {
        if taken[start as usize] {
            continue;
        }
        let axis = part.normal(start as usize);
        pieces.push(grow(part, taken, start as usize, |_, g| {
            part.normal(g).dot(&axis) >= cap
        }));
    }
    pieces
}
