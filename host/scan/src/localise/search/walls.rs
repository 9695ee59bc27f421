//! Walls and steps that are thinner than a search sees.
//!
//! A search works with cells, and a fit ends at the next place where the points lie on the surface: the outer side of a thin
//! wall on its inner one, or a step on the one below it. From there the right place is one thickness away.

use crate::rigid::Vec3;
use crate::surface::Mesh;

/// What is thicker than this over the part's diagonal, the search tells apart by itself.
const THIN: f64 = 0.05;
/// And what is thinner is the same side ([`super::pairs::Prepared::sides`]).
const SAME: f64 = 2e-3;
/// A side of a smaller share of the surface carries no fit.
const LEAST: f64 = 0.01;
/// Sides that are looked at, the largest, and thicknesses that are kept, those of most surface.
const SIDES: usize = 80;
const KEPT: usize = 6;
/// Sides are parallel if their normals have this cosine.
const PARALLEL: f64 = 0.9998;

/// A flat side: its normal, its height along that, its area.
#[derive(Clone, Copy)]
struct Side {
    normal: Vec3,
    height_mm: f64,
    area_mm2: f64,
}

/// Shifts of a part, in its own frame, that put flat sides of it where parallel ones were: by each thickness of a wall or
/// step, and by two and three of different directions at once. `sides`: of each triangle its side.
pub(in crate::localise) fn shifts(mesh: &Mesh, sides: &[u32], diagonal_mm: f64) -> Vec<Vec3> {
    let count = sides.iter().max().map_or(0, |last| *last as usize + 1);
    let mut all = vec![None::<Side>; count];
    for (t, side) in mesh.triangles().iter().zip(sides) {
        let side = all[*side as usize].get_or_insert(Side {
            normal: t.normal,
            height_mm: t.normal.dot(&t.corners[0]),
            area_mm2: 0.0,
        });
        side.area_mm2 += t.area_mm2;
    }
    let least = LEAST * mesh.area_mm2();
    let mut large: Vec<Side> = all
        .into_iter()
        .flatten()
        .filter(|s| s.area_mm2 > least)
        .collect();
    large.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    large.truncate(SIDES);
    // Each thickness once, with the surface that speaks for it.
    let mut thin: Vec<(Vec3, f64)> = Vec::new();
    for (k, a) in large.iter().enumerate() {
        for b in &large[k + 1..] {
            let along = a.normal.dot(&b.normal);
            let by_mm = along.signum() * b.height_mm - a.height_mm;
            if along.abs() < PARALLEL || !(SAME..THIN).contains(&(by_mm.abs() / diagonal_mm)) {
                continue;
            }
            let shift = a.normal * by_mm;
            let area = a.area_mm2.min(b.area_mm2);
            let is_same = |known: &Vec3| {
                let apart = (known - shift).norm().min((known + shift).norm());
                apart < SAME * diagonal_mm
            };
            match thin.iter_mut().find(|(known, _)| is_same(known)) {
                Some((_, sum)) => *sum += area,
                None => thin.push((shift, area)),
            }
        }
    }
    thin.sort_by(|a, b| b.1.total_cmp(&a.1));
    thin.truncate(KEPT);
    let single: Vec<Vec3> = thin.iter().flat_map(|(by, _)| [*by, -by]).collect();
    let across = |a: &Vec3, b: &Vec3| a.normalize().dot(&b.normalize()).abs() < 0.9;
    let mut shifts = single.clone();
    for (i, a) in single.iter().enumerate() {
        for (j, b) in single.iter().enumerate().skip(i + 1) {
            if !across(a, b) {
                continue;
            }
            shifts.push(a + b);
            let third = single[j + 1..]
                .iter()
                .filter(|c| across(a, c) && across(b, c));
            shifts.extend(third.map(|c| a + b + c));
        }
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::search::pairs::Prepared;
    use crate::localise::tests::prism;
    use crate::parallel::Threads;

    #[test]
    fn a_bent_sheet_is_shifted_by_its_thickness_along_either_leg_and_both() {
        let outline = [
            [0.0, 0.0],
            [60.0, 0.0],
            [60.0, 1.5],
            [1.5, 1.5],
            [1.5, 40.0],
            [0.0, 40.0],
        ];
        let sheet = prism(&outline, &[[0, 1, 2, 3], [0, 3, 4, 5]], 30.0, [0.0, 0.0]);
        let prepared = Prepared::new(&sheet, Threads::new(1));
        let shifts = shifts(&sheet, &prepared.sides, prepared.diagonal);
        let has = |x: f64, y: f64| {
            let by = Vec3::new(x, y, 0.0);
            shifts.iter().any(|shift| (shift - by).norm() < 1e-9)
        };
        for by in [-1.5, 1.5] {
            assert!(has(by, 0.0) && has(0.0, by) && has(by, by) && has(by, -by));
        }
        assert_eq!(shifts.len(), 8);
    }
}
