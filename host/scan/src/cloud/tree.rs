//! Who is near whom: a tree of points, split at medians. Points that share coordinates (lattices) are no special case.

use crate::rigid::Vec3;

const LEAF: usize = 12;

/// Points in a tree.
#[derive(Clone, Debug)]
pub struct PointTree {
    points: Vec<Vec3>,
    order: Vec<u32>,
    nodes: Vec<Split>,
}

#[derive(Clone, Copy, Debug)]
struct Split {
    from: u32,
    to: u32,
    /// The second child; the first follows its parent. 0: a leaf.
    second: u32,
    axis: u8,
    at: f64,
}

impl PointTree {
    /// A tree of these points.
    #[must_use]
    pub fn new(points: &[Vec3]) -> Self {
        let mut tree = Self {
            points: points.to_vec(),
            order: (0..u32::try_from(points.len()).unwrap_or(u32::MAX)).collect(),
            nodes: Vec::new(),
        };
        let all = tree.order.len();
        tree.split(0, all);
        tree.points = tree.order.iter().map(|&i| points[i as usize]).collect();
        tree
    }

    fn split(&mut self, from: usize, to: usize) {
        let at = self.nodes.len();
        self.nodes.push(Split {
            from: from as u32,
            to: to as u32,
            second: 0,
            axis: 0,
            at: 0.0,
        });
        if to - from <= LEAF {
            return;
        }
        let points = &self.points;
        let (low, high) =
            crate::surface::bounds(self.order[from..to].iter().map(|&i| &points[i as usize]));
        let axis = (high - low).imax();
        let middle = from + (to - from) / 2;
        self.order[from..to].select_nth_unstable_by(middle - from, |&a, &b| {
            points[a as usize][axis]
                .total_cmp(&points[b as usize][axis])
                .then(a.cmp(&b))
        });
        self.nodes[at].axis = axis as u8;
        self.nodes[at].at = points[self.order[middle] as usize][axis];
        self.split(from, middle);
        self.nodes[at].second = self.nodes.len() as u32;
        self.split(middle, to);
    }

    /// The `count` nearest points to `q`: squared distances in mm² with numbers, nearest first; of equal ones the lower number.
    pub fn nearest(&self, q: &Vec3, count: usize, found: &mut Vec<(f64, u32)>) {
        found.clear();
        if count > 0 && !self.order.is_empty() {
            self.search(0, q, Vec3::zeros(), count, f64::INFINITY, found);
        }
    }

    /// Those of the `count` nearest points that lie within `radius` mm.
    pub fn within(&self, q: &Vec3, radius: f64, count: usize, found: &mut Vec<(f64, u32)>) {
        found.clear();
        if count > 0 && !self.order.is_empty() {
            self.search(0, q, Vec3::zeros(), count, radius * radius, found);
        }
    }

    fn search(
        &self,
        node: usize,
        q: &Vec3,
        off: Vec3,
        count: usize,
        limit: f64,
        found: &mut Vec<(f64, u32)>,
    ) {
        let worst = |found: &[(f64, u32)]| {
            if found.len() < count {
                limit
            } else {
                found[found.len() - 1].0
            }
        };
        let split = self.nodes[node];
        if split.second == 0 {
            for k in split.from as usize..split.to as usize {
                let squared = (self.points[k] - q).norm_squared();
                if squared > worst(found) {
                    continue;
                }
                let entry = (squared, self.order[k]);
                let place = found.partition_point(|f| (f.0, f.1) < entry);
                if place < count {
                    if found.len() == count {
                        found.pop();
                    }
                    found.insert(place, entry);
                }
            }
            return;
        }
        let axis = usize::from(split.axis);
        let side = q[axis] - split.at;
        let (near, far) = if side < 0.0 {
            (node + 1, split.second as usize)
        } else {
            (split.second as usize, node + 1)
        };
        self.search(near, q, off, count, limit, found);
        let mut beyond = off;
        beyond[axis] = side;
        if beyond.norm_squared() <= worst(found) {
            self.search(far, q, beyond, count, limit, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_those_that_a_full_search_finds_also_in_a_lattice() {
        let lattice: Vec<Vec3> = (0..1000)
            .map(|i| {
                Vec3::new(
                    f64::from(i % 10),
                    f64::from(i / 10 % 10),
                    f64::from(i / 100) * 0.0,
                )
            })
            .collect();
        let tree = PointTree::new(&lattice);
        let mut found = Vec::new();
        for q in [
            Vec3::new(3.2, 4.9, 0.1),
            Vec3::new(-5.0, 20.0, 3.0),
            lattice[17],
        ] {
            let mut all: Vec<(f64, u32)> = lattice
                .iter()
                .enumerate()
                .map(|(i, p)| ((p - q).norm_squared(), i as u32))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            tree.nearest(&q, 25, &mut found);
            assert_eq!(found, all[..25]);
            tree.within(&q, 1.5, 1000, &mut found);
            assert_eq!(found.len(), all.iter().filter(|f| f.0 <= 2.25).count());
        }
    }
}
