//! Closed surfaces whose triangles do not all look outwards, as many programs export them.

use std::collections::HashMap;

use super::mesh::Mesh;
use crate::ScanError;
use crate::rigid::Vec3;

/// The two triangles of an edge, each with whether it runs along it from the lesser end to the greater one.
type Sides = Vec<(usize, bool)>;

/// The mesh with all triangles of a closed surface looking outwards; one without an inside stays as it is.
///
/// # Errors
/// As [`Mesh::new`].
pub(crate) fn outward(mesh: Mesh) -> Result<Mesh, ScanError> {
    match turned(&mesh) {
        None => Ok(mesh),
        Some(corners) => {
            let pairs = mesh.triangles().iter().zip(&corners);
            let turned = pairs.filter(|(was, is)| was.corners != **is).count();
            Ok(Mesh {
                dropped: mesh.dropped,
                turned,
                ..Mesh::new(&corners)?
            })
        }
    }
}

/// The corners of a surface's triangles with all of them looking outwards, if some do not. None if all do, and for a
/// surface that has no inside: where an edge has not two triangles.
///
/// Each triangle is turned the way of its neighbours, whichever way most of a body's area looks; then all, if the volume
/// is negative.
fn turned(mesh: &Mesh) -> Option<Vec<[Vec3; 3]>> {
    let mut all: Vec<[Vec3; 3]> = mesh.triangles().iter().map(|t| t.corners).collect();
    let edges = edges(&all)?;
    let mut of: Vec<[usize; 3]> = vec![[0; 3]; all.len()];
    let mut count = vec![0; all.len()];
    for (edge, sides) in edges.iter().enumerate() {
        for (t, _) in sides {
            of[*t][count[*t]] = edge;
            count[*t] += 1;
        }
    }
    let mut turned: Vec<Option<bool>> = vec![None; all.len()];
    for first in 0..all.len() {
        if turned[first].is_some() {
            continue;
        }
        turned[first] = Some(false);
        let mut body = vec![first];
        let mut next = 0;
        while let Some(&t) = body.get(next) {
            next += 1;
            for edge in of[t] {
                let [(a, way_a), (b, way_b)] = edges[edge][..] else {
                    return None;
                };
                let other = if a == t { b } else { a };
                // Neighbours run along their edge in opposite ways.
                let same = turned[t].unwrap_or(false) ^ (way_a == way_b);
                match turned[other] {
                    None => {
                        turned[other] = Some(same);
                        body.push(other);
                    }
                    // One side only, as a Moebius strip has.
                    Some(known) if known != same => return None,
                    Some(_) => {}
                }
            }
        }
        let area = |way: bool| -> f64 {
            let of = body.iter().filter(|t| turned[**t] == Some(way));
            of.map(|t| mesh.triangles()[*t].area_mm2).sum()
        };
        if area(true) > area(false) {
            for t in body {
                turned[t] = turned[t].map(|way| !way);
            }
        }
    }
    let origin = all.first()?[0];
    let volume: f64 = all
        .iter()
        .zip(&turned)
        .map(|(c, turned)| {
            let [a, b, c] = c.map(|c| c - origin);
            let six = a.dot(&b.cross(&c));
            if *turned == Some(true) { -six } else { six }
        })
        .sum();
    let inwards = volume < 0.0;
    let mut any = false;
    for (corners, turned) in all.iter_mut().zip(turned) {
        if (turned == Some(true)) ^ inwards {
            corners.swap(1, 2);
            any = true;
        }
    }
    any.then_some(all)
}

/// The edges with their triangles; none if one has not two.
fn edges(all: &[[Vec3; 3]]) -> Option<Vec<Sides>> {
    let key = |c: &Vec3| [c.x, c.y, c.z].map(|x| (x + 0.0).to_bits());
    let mut number = HashMap::new();
    let mut edges: Vec<Sides> = Vec::new();
    for (t, corners) in all.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (key(&corners[k]), key(&corners[(k + 1) % 3]));
            let (ends, way) = if a < b {
                ((a, b), true)
            } else {
                ((b, a), false)
            };
            let edge = *number.entry(ends).or_insert(edges.len());
            if edge == edges.len() {
                edges.push(Vec::with_capacity(2));
            }
            if edges[edge].len() == 2 {
                return None;
            }
            edges[edge].push((t, way));
        }
    }
    edges.iter().all(|sides| sides.len() == 2).then_some(edges)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of 2 by 3 by 4 with its corner here, outwards.
    fn block(at: f64) -> Vec<[Vec3; 3]> {
        let p = |i: usize| {
            let pick = |bit: usize, size: f64| if i & bit == 0 { at } else { at + size };
            Vec3::new(pick(1, 2.0), pick(2, 3.0), pick(4, 4.0))
        };
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let quads = quads.map(|q| q.map(p));
        let halves = quads.map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        halves.concat()
    }

    fn turn(all: &mut [[Vec3; 3]], which: impl Fn(usize) -> bool) {
        for (t, corners) in all.iter_mut().enumerate() {
            if which(t) {
                corners.swap(1, 2);
            }
        }
    }

    fn mended(all: &[[Vec3; 3]]) -> Option<Vec<[Vec3; 3]>> {
        turned(&Mesh::new(all).unwrap())
    }

    #[test]
    fn triangles_that_look_inwards_are_turned_whichever_they_are() {
        let two = [block(0.0), block(10.0)].concat();
        assert_eq!(mended(&two), None);
        // Each set of a block's triangles but the whole: a volume of zero tells nothing of one block.
        for which in 1..1_u32 << 12 {
            let mut bad = block(0.0);
            turn(&mut bad, |t| which >> t & 1 == 1);
            let good = mended(&bad).unwrap();
            let mesh = Mesh::new(&good).unwrap();
            assert!(mesh.is_closed());
            assert_eq!(mended(&good), None);
            let near = mesh.near_from(&Vec3::new(1.0, 1.0, 1.0), 0);
            assert!(near.distance_mm < 0.0, "{which:b}");
        }
    }

    #[test]
    fn a_cavity_stays_one_and_a_surface_without_an_inside_stays_as_it_is() {
        let mut shell: Vec<[Vec3; 3]> = block(-5.0)
            .iter()
            .map(|t| t.map(|c| (c + Vec3::repeat(5.0)) * 9.0 - Vec3::repeat(5.0)))
            .collect();
        let outer = shell.len();
        shell.extend(block(0.0));
        turn(&mut shell, |t| t >= outer);
        assert_eq!(mended(&shell), None);
        let mut open = block(0.0);
        open.pop();
        turn(&mut open, |t| t == 3);
        assert_eq!(mended(&open), None);
    }
}
