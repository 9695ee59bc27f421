//! Ways round part and obstacles at their sides, where none leads over them.
//!
//! A way draws the sensor back, goes along X or Y until its box stands beside what is in the way, along it, and back; or
//! round one of its corners. What is in the way are boxes in the machine's axes: of the part, of each obstacle, of all.
//! Nothing is taken for granted of them: every stretch of a way is looked at, and a way counts that touches nothing.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::super::spec::ScanSpec;
use super::deadline::Deadline;
use super::links::raised;
use super::price::{RAPID_MM_PER_S, seconds};
use super::touch::Scenery;

/// How far the sensor is drawn back before it goes to a side.
const LIFTS_MM: [f64; 5] = [0.0, 5.0, 15.0, 80.0, 250.0];

/// After so many pairs of poses without a way, one after the other, no more is looked for: that takes its time.
const MOST_FAILED: usize = 24;

/// The sensor's box stands beside an obstacle with so much more than the clearance.
const BESIDE_MM: f64 = 0.5;

/// A place beside something: an axis (X or Y) and which side of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Side {
    axis: usize,
    high: bool,
}

const SIDES: [Side; 4] = [
    Side {
        axis: 0,
        high: false,
    },
    Side {
        axis: 0,
        high: true,
    },
    Side {
        axis: 1,
        high: false,
    },
    Side {
        axis: 1,
        high: true,
    },
];

/// Ways beside what stands around, with what is known of their stretches.
pub struct Beside<'a> {
    spec: &'a ScanSpec,
    scenery: &'a Scenery<'a>,
    deadline: Deadline,
    known: HashMap<Vec<u64>, bool>,
    /// Pairs of poses that no way was found between, since one was.
    failed: usize,
    /// Boxes of the meshes in the machine's axes, by the table's angles.
    boxes: HashMap<Vec<u64>, Vec<[Vector3<f64>; 2]>>,
}

fn bits(axes: &[f64]) -> impl Iterator<Item = u64> + '_ {
    axes.iter().map(|v| v.to_bits())
}

impl<'a> Beside<'a> {
    /// Among these meshes; once the time is up, no way is found any more.
    pub fn new(spec: &'a ScanSpec, scenery: &'a Scenery<'a>, deadline: Deadline) -> Self {
        Beside {
            spec,
            scenery,
            deadline,
            known: HashMap::new(),
            failed: 0,
            boxes: HashMap::new(),
        }
    }

    /// Axis values between two poses, both left out: the fastest way round a side or a corner; none where all touch.
    pub fn between(&mut self, from: &[f64], to: &[f64]) -> Option<Vec<Vec<f64>>> {
        if self.failed >= MOST_FAILED {
            return None;
        }
        let mut ways: Vec<(f64, Vec<Vec<f64>>)> = Vec::new();
        for [up, over] in self.drawn_back(from, to) {
            for bounds in self.bounds(from, to) {
                for side in SIDES {
                    let at = self.beside(bounds, side, from, to);
                    let [a, b] = [&up, &over].map(|axes| moved(axes, side, at));
                    self.add(&mut ways, [from, &up, &a], [&b, &over, to]);
                    for next in SIDES.into_iter().filter(|s| s.axis != side.axis) {
                        let corner = moved(&a, next, self.beside(bounds, next, from, to));
                        let b = moved(&over, next, corner[next.axis]);
                        let first = [from, &up, &a, &corner];
                        self.add(&mut ways, first, [&b, &over, to]);
                    }
                }
            }
        }
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let found = ways.into_iter().find(|(_, way)| self.free(way));
        self.failed = if found.is_some() { 0 } else { self.failed + 1 };
        found.map(|(_, mut way)| {
            way.pop();
            way.remove(0);
            way
        })
    }

    /// Axis values that lead from a pose to a place from which the way straight up to the top of Z is free: the pose
    /// itself left out, so that none are needed where it is such a place. None where no way leads to one.
    pub fn out(&mut self, from: &[f64]) -> Option<Vec<Vec<f64>>> {
        let highest = self.spec.machine.travel_mm[2][1];
        let top = |axes: &[f64]| {
            let mut top = axes.to_vec();
            top[2] = highest.max(axes[2]);
            top
        };
        let mut ways: Vec<(f64, Vec<Vec<f64>>)> = Vec::new();
        let mut add = |way: &[&[f64]]| {
            let mut way: Vec<Vec<f64>> = way.iter().map(|axes| axes.to_vec()).collect();
            way.dedup();
            let up = way.last().map_or(0.0, |axes| highest - axes[2]);
            ways.push((time(&way) + up / RAPID_MM_PER_S, way));
        };
        for [up, _] in self.drawn_back(from, from) {
            add(&[from, &up]);
            for bounds in self.bounds(from, from) {
                for side in SIDES {
                    let a = moved(&up, side, self.beside(bounds, side, from, from));
                    add(&[from, &up, &a]);
                }
            }
        }
        // Up from where it stands is best, whatever the time.
        ways.sort_by(|a, b| {
            (a.1.len() > 1)
                .cmp(&(b.1.len() > 1))
                .then(a.0.total_cmp(&b.0))
        });
        let found = ways.into_iter().find(|(_, way)| {
            let end = &way[way.len() - 1];
            self.free(way) && self.free(&[end.clone(), top(end)])
        });
        found.map(|(_, mut way)| {
            way.remove(0);
            way
        })
    }

    /// Both ends drawn back along their beams or up the machine's Z, by the same amount.
    fn drawn_back(&self, from: &[f64], to: &[f64]) -> Vec<[Vec<f64>; 2]> {
        let lifts = LIFTS_MM
            .into_iter()
            .flat_map(|lift| [(lift, false), (lift, true)]);
        let mut all: Vec<[Vec<f64>; 2]> = lifts
            .map(|(lift, up)| [from, to].map(|axes| raised(&self.spec.machine, axes, lift, up)))
            .collect();
        all.dedup();
        all
    }

    /// The boxes that the table's angles of two poses give, one beside the other.
    fn bounds(&mut self, from: &[f64], to: &[f64]) -> Vec<[Vector3<f64>; 2]> {
        let (a, b) = (self.at_table(from), self.at_table(to));
        let both = a.iter().zip(&b);
        both.map(|([l, h], [low, high])| [l.inf(low), h.sup(high)])
            .collect()
    }

    /// Each mesh's box in the machine's axes; that of all of them, where there are several.
    fn at_table(&mut self, axes: &[f64]) -> Vec<[Vector3<f64>; 2]> {
        let machine = &self.spec.machine;
        let key: Vec<u64> = bits(&axes[3..3 + machine.table.len()]).collect();
        let meshes = &self.scenery.meshes;
        let made = self.boxes.entry(key).or_insert_with(|| {
            let table = machine.part_in_machine(&axes[3..]);
            let none = [
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ];
            let grown =
                |[low, high]: [Vector3<f64>; 2], p: Vector3<f64>| [low.inf(&p), high.sup(&p)];
            let mut boxes: Vec<[Vector3<f64>; 2]> = meshes
                .iter()
                .map(|mesh| {
                    let corners = mesh.triangles().iter().flat_map(|t| t.corners);
                    corners.fold(none, |b, p| grown(b, table.point(&p)))
                })
                .collect();
            if boxes.len() > 1 {
                let all = boxes.iter().flatten().fold(none, |b, p| grown(b, *p));
                boxes.push(all);
            }
            boxes
        });
        made.clone()
    }

    /// Where X or Y stands when the sensor's box is beside another box, at the angles of both poses.
    fn beside(&self, [low, high]: [Vector3<f64>; 2], side: Side, from: &[f64], to: &[f64]) -> f64 {
        let off = self.spec.plan.clearance_mm + BESIDE_MM;
        let each = [from, to].map(|axes| {
            let [body_low, body_high] = self.body(axes);
            match side.high {
                true => high[side.axis] + off - body_low[side.axis],
                false => low[side.axis] - off - body_high[side.axis],
            }
        });
        let at = match side.high {
            true => each[0].max(each[1]),
            false => each[0].min(each[1]),
        };
        super::axes::rounded(at)
    }

    /// The sensor's box in the machine's directions, from X Y Z.
    fn body(&self, axes: &[f64]) -> [Vector3<f64>; 2] {
        let sensor = self.spec.machine.sensor_on_carriage(&axes[3..]);
        let [low, high] = self.spec.sensor.body_mm;
        let corners = (0..8_usize).map(|corner| {
            let of = |k: usize| [low[k], high[k]][corner >> k & 1];
            // The sensor's frame has line, -feed, -beam for x, y, z.
            sensor.point(&Vector3::new(of(0), -of(1), -of(2)))
        });
        corners.fold(
            [
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ],
            |[l, h], p| [l.inf(&p), h.sup(&p)],
        )
    }

    /// The way through these places, turned on the spot before it goes along the side, behind that, or on the way.
    fn add<const N: usize>(
        &self,
        ways: &mut Vec<(f64, Vec<Vec<f64>>)>,
        first: [&[f64]; N],
        last: [&[f64]; 3],
    ) {
        let (before, behind) = (first[N - 1], last[0]);
        let turned = |axes: &[f64], as_in: &[f64]| {
            let mut turned = axes.to_vec();
            turned[3..].copy_from_slice(&as_in[3..]);
            turned
        };
        let turns = before[3..] != behind[3..];
        let between = [
            None,
            turns.then(|| turned(before, behind)),
            turns.then(|| turned(behind, before)),
        ];
        for (k, between) in between.into_iter().enumerate() {
            if k > 0 && between.is_none() {
                continue;
            }
            let places = first.iter().map(|axes| axes.to_vec());
            let places = places.chain(between).chain(last.map(<[f64]>::to_vec));
            let mut way: Vec<Vec<f64>> = places.collect();
            way.dedup();
            if way.iter().all(|axes| self.spec.machine.within_limits(axes)) {
                ways.push((time(&way), way));
            }
        }
    }

    /// Does a way touch nothing? Stretches that several ways share are looked at once.
    fn free(&mut self, way: &[Vec<f64>]) -> bool {
        let machine = &self.spec.machine;
        way.iter().all(|axes| machine.within_limits(axes))
            && way.windows(2).all(|w| {
                let key = bits(&w[0]).chain(bits(&w[1])).collect();
                let deadline = self.deadline;
                let look =
                    || deadline.more() && !self.scenery.touches_between(machine, &w[0], &w[1]);
                *self.known.entry(key).or_insert_with(look)
            })
    }
}

/// Axis values with one of X and Y at another place.
fn moved(axes: &[f64], side: Side, at: f64) -> Vec<f64> {
    let mut moved = axes.to_vec();
    moved[side.axis] = at;
    moved
}

fn time(way: &[Vec<f64>]) -> f64 {
    let stretches = way.windows(2);
    stretches
        .map(|w| seconds(&w[0], &w[1], RAPID_MM_PER_S))
        .sum()
}
