//! Whether a flat map lies over itself: exact tests of its triangles against each other.
//!
//! A map without flips may still come round and lie over itself, as that of a ramp that winds up does, whose normals all
//! look up. Neither flips nor normals tell that; the triangles do.

use nalgebra::Vector2;

use super::flatten::FlatMap;

/// Two triangles that go into each other by less than this share of the smaller one's size only touch.
const TOUCH: f64 = 1e-6;

/// Pairs looked at for each triangle, at most: of slivers in a heap nothing is known.
const MOST_PAIRS: usize = 400;

type FlatCorners = [Vector2<f64>; 3];

impl FlatMap {
    /// Do two of its triangles lie over each other? Also true where there are too many beside each other to tell.
    pub fn lies_over_itself(&self) -> bool {
        let flat: Vec<FlatCorners> = self
            .faces
            .iter()
            .map(|f| f.map(|k| self.places[k as usize]))
            .collect();
        let bounds: Vec<[Vector2<f64>; 2]> = flat
            .iter()
            .map(|[a, b, c]| [a.inf(b).inf(c), a.sup(b).sup(c)])
            .collect();
        let Some([low, high]) =
            (bounds.iter().copied()).reduce(|[l, h], [a, b]| [l.inf(&a), h.sup(&b)])
        else {
            return false;
        };
        let size = high - low;
        if size.min() <= 0.0 || size.iter().any(|s| !s.is_finite()) {
            return false;
        }
        // As many cells as triangles, about.
        let cell = (size.x * size.y / flat.len() as f64)
            .sqrt()
            .max(size.max() / 4000.0);
        let at = |p: &Vector2<f64>| {
            let q = (p - low) / cell;
            [q.x.max(0.0) as usize, q.y.max(0.0) as usize]
        };
        let [last_x, last_y] = at(&high);
        let mut cells: Vec<Vec<u32>> = vec![Vec::new(); (last_x + 1) * (last_y + 1)];
        let most = MOST_PAIRS * flat.len();
        let mut looked = 0;
        for (k, [l, h]) in bounds.iter().enumerate() {
            let ([x0, y0], [x1, y1]) = (at(l), at(h));
            for y in y0..=y1 {
                for x in x0..=x1 {
                    let here = &mut cells[y * (last_x + 1) + x];
                    for other in here.iter() {
                        let o = *other as usize;
                        looked += 1;
                        let apart = |k: usize| bounds[o][0][k] > h[k] || bounds[o][1][k] < l[k];
                        if !apart(0) && !apart(1) && overlap(&flat[k], &flat[o]) {
                            return true;
                        }
                    }
                    here.push(k as u32);
                }
            }
            if looked > most {
                return true;
            }
        }
        false
    }
}

/// Do two triangles have an inner point in common? Not where a side of one keeps them apart.
fn overlap(a: &FlatCorners, b: &FlatCorners) -> bool {
    let size = |t: &FlatCorners| {
        let [u, v] = [t[1] - t[0], t[2] - t[0]];
        u.perp(&v).abs().sqrt()
    };
    let touch = TOUCH * size(a).min(size(b));
    let keeps_apart = |t: &FlatCorners, other: &FlatCorners| {
        (0..3).any(|k| {
            let (from, to, inner) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
            let Some(along) = (to - from).try_normalize(0.0) else {
                return false;
            };
            let side = along.perp(&(inner - from)).signum();
            let off = |p: &Vector2<f64>| side * along.perp(&(p - from));
            other.iter().all(|p| off(p) <= touch)
        })
    };
    !keeps_apart(a, b) && !keeps_apart(b, a)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector2, Vector3};

    use super::super::super::mesh::{PartMesh, RawMesh};
    use super::super::chart::charts;
    use super::super::flatten::FlatMap;
    use super::overlap;

    /// A ramp that winds up, so many turns: all normals look up.
    fn ramp(turns: f64) -> PartMesh {
        let steps = (turns * 60.0) as usize;
        let mut raw = RawMesh::default();
        for i in 0..=steps {
            let angle = std::f64::consts::TAU * i as f64 / 60.0;
            for r in [20.0, 25.0, 30.0, 35.0] {
                let z = 0.8 * angle;
                raw.vertices
                    .push(Vector3::new(r * angle.cos(), r * angle.sin(), z));
            }
        }
        for i in 0..steps {
            for j in 0..3 {
                let a = 4 * i + j;
                raw.faces.push([a, a + 1, a + 5]);
                raw.faces.push([a, a + 5, a + 4]);
            }
        }
        PartMesh::weld(raw, true).unwrap()
    }

    #[test]
    fn a_ramp_that_winds_up_is_parted_where_its_map_lies_over_itself() {
        for (turns, over) in [(0.9, false), (2.5, true)] {
            let part = ramp(turns);
            assert!((0..part.faces.len()).all(|f| part.normal(f).z > 0.9));
            let all: Vec<u32> = (0..part.faces.len() as u32).collect();
            let map = FlatMap::new(&part, &all);
            // Neither flips nor normals tell.
            assert_eq!(map.quality.flips, 0, "{turns}");
            assert_eq!(map.lies_over_itself(), over, "{turns}");
            let found = charts(&part, 25.0, || Ok(())).unwrap();
            assert_eq!(found.len() > 1, over, "{turns}: {}", found.len());
            assert!(found.iter().all(|chart| !chart.map.lies_over_itself()));
            let faces: usize = found.iter().map(|chart| chart.faces.len()).sum();
            assert_eq!(faces, part.faces.len());
        }
    }

    #[test]
    fn neighbours_touch_and_do_not_overlap() {
        let at = |x: f64, y: f64| Vector2::new(x, y);
        let one = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)];
        let beside = [at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        let across = [at(0.4, -1.0), at(0.6, -1.0), at(0.5, 2.0)];
        let corner = [at(-1.0, 0.0), at(0.0, 0.0), at(-1.0, -1.0)];
        assert!(!overlap(&one, &beside) && !overlap(&one, &corner));
        assert!(overlap(&one, &across) && overlap(&across, &one) && overlap(&one, &one));
        let turned_over = [one[0], one[2], one[1]];
        assert!(overlap(&turned_over, &across) && !overlap(&turned_over, &beside));
    }
}
