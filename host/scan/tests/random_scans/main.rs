//! Random scans of eight parts: no wrong pose with verdict OK, neither of the part that was scanned nor of another one.
//!
//! The long form, with its figures in `tests/bench/LOCALISE.md`: `cargo test --release -p umi-scan --test random_scans --
//! --ignored --nocapture`. The scans are numbered from 0; `UMI_RANDOM_SCANS` says how many, a thousand without it, and
//! `UMI_RANDOM_SCANS_FROM` from which one on: a run that is cut into pieces adds up. What is wrong is told as it comes.

mod parts;
mod scans;

use std::collections::BTreeMap;

use umi_scan::ScanError;
use umi_scan::localise::Located;
use umi_scan::localise::scans::{ScanQuestion, TakenScan};
use umi_scan::parallel::Threads;
use umi_scan::rigid::{Pose, Vec3};
use umi_scan::surface::Mesh;

use parts::{Part, are_variants, parts, tower};
use scans::{RandomScan, random_scan};

/// A pose is right if no corner of the part is farther off than this, in mm: a lattice, or few points of a small side, are
/// no better.
const RIGHT_MM: f64 = 1.0;

fn located(model: &Mesh, points: &[Vec3]) -> Result<Located, ScanError> {
    let scans = [TakenScan {
        name: String::new(),
        points: points.to_vec(),
        moved: Pose::identity(),
        carried: false,
    }];
    let question = ScanQuestion {
        scans: &scans,
        fiducials: &[],
        part: Some(model),
        start: None,
        kernel: None,
        accept_symmetry: false,
        limit_mm: None,
        scale_limit_ppm: 1000.0,
        seed: 0,
        threads: Threads::all(),
    };
    question.answer().map(|answer| answer.located)
}

/// How the scans of a campaign ended.
#[derive(Default)]
struct Tally {
    /// By what was said, and how often.
    said: BTreeMap<String, usize>,
    wrong: Vec<String>,
}

impl Tally {
    fn count(&mut self, what: impl Into<String>) {
        *self.said.entry(what.into()).or_default() += 1;
    }

    /// What is said of a scan of the part itself.
    fn own(&mut self, part: &Part, number: u64, scan: &RandomScan) {
        let found = match located(&part.mesh, &scan.points) {
            Err(refused) => {
                println!(
                    "  scan {number}, {}: {} ({}); {}",
                    part.name, refused.code, refused.message, scan.faults
                );
                return self.count(refused.code);
            }
            Ok(found) => found,
        };
        let off_mm = scan.pose.map_or(f64::INFINITY, |pose| {
            found.motion.apart_mm(&pose, &part.mesh.corners())
        });
        let ok = found.reasons.is_empty();
        if !ok {
            let codes: Vec<&str> = found.reasons.iter().map(|r| r.code).collect();
            println!(
                "  scan {number}, {}: {off_mm:.3} mm off, NG {codes:?}; {}",
                part.name, scan.faults
            );
        }
        if off_mm < RIGHT_MM {
            self.count(if ok { "right" } else { "right, NG" });
        } else if !ok {
            self.count("wrong, NG");
        } else {
            let corners = part.mesh.corners();
            let doubt = |p| found.certainty.at(&found.motion, p).trace().sqrt();
            let u_mm = corners.iter().map(doubt).fold(0.0, f64::max);
            self.wrong(format!(
                "scan {number}, {}: {off_mm:.2} mm off, stated {u_mm:.3} mm; noise {:.3} mm, {} points, {:.0} % shown, scale \
                 {:.5} ± {:.5}; {}",
                part.name,
                found.sigma_mm,
                found.n_used,
                100.0 * found.overlap,
                found.certainty.scale,
                found.certainty.u_scale,
                scan.faults
            ));
        }
    }

    fn wrong(&mut self, what: String) {
        println!("WRONG: {what}");
        self.count("WRONG");
        self.wrong.push(what);
    }

    /// What is said of a scan of one part where another one is sought.
    fn foreign(&mut self, model: &Part, part: &Part, number: u64, scan: &RandomScan) {
        match located(&model.mesh, &scan.points) {
            Err(refused) => self.count(refused.code),
            Ok(found) if !found.reasons.is_empty() => self.count("NG"),
            Ok(found) => self.wrong(format!(
                "scan {number}: the {} in a scan of the {}, {} points; {}",
                model.name, part.name, found.n_used, scan.faults
            )),
        }
    }

    /// Prints what was said, and fails if anything was wrong.
    fn end(&self, what: &str) {
        println!("{what}: {:?}", self.said);
        for wrong in &self.wrong {
            println!("  {wrong}");
        }
        assert!(self.wrong.is_empty(), "{what}: {:#?}", self.wrong);
    }
}

/// The numbers of the long form: so many without being told.
fn numbers(otherwise: u64) -> std::ops::Range<u64> {
    let told = |name, otherwise| std::env::var(name).map_or(otherwise, |n| n.parse().unwrap());
    let from = told("UMI_RANDOM_SCANS_FROM", 0);
    from..from + told("UMI_RANDOM_SCANS", otherwise)
}

fn campaign(parts: &[Part], numbers: std::ops::Range<u64>) -> Tally {
    let mut tally = Tally::default();
    for number in numbers {
        let part = &parts[number as usize % parts.len()];
        tally.own(part, number, &random_scan(part, number));
    }
    tally
}

/// Each scan with one foreign part, another one from scan to scan.
fn foreign(parts: &[Part], numbers: std::ops::Range<u64>, each: usize) -> Tally {
    let mut tally = Tally::default();
    for number in numbers {
        let at = number as usize % parts.len();
        let scan = random_scan(&parts[at], number);
        let others = (1..parts.len()).map(|k| &parts[(at + k) % parts.len()]);
        let others: Vec<&Part> = others
            .filter(|o| !are_variants(o.name, parts[at].name))
            .collect();
        for k in 0..each.min(others.len()) {
            let other = others[(number as usize / parts.len() + k) % others.len()];
            tally.foreign(other, &parts[at], number, &scan);
        }
    }
    tally
}

#[test]
fn a_part_is_found_or_refused_and_never_put_in_a_wrong_place() {
    let tally = campaign(&parts(), 0..12);
    tally.end("12 scans");
    assert!(
        tally.said.get("right").is_some_and(|n| *n >= 3),
        "{:?}",
        tally.said
    );
}

/// One view and 43 % of stray points: a pose 2.5 mm off lay on few of the part's points and took the rest for strays. That
/// more lie on it elsewhere had widened its doubt only.
#[test]
fn a_pose_on_few_of_the_points_is_left_for_the_one_that_explains_more() {
    let tally = campaign(&parts(), 320..321);
    tally.end("scan 320");
    assert_eq!(tally.said.get("right"), Some(&1), "{:?}", tally.said);
}

/// One slot of four, askew by 16 degrees, tells the flange from its own mirror image: less than 1 % of the points.
#[test]
fn a_mirrored_part_is_told_by_one_slot() {
    let tally = campaign(&parts(), 1270..1271);
    tally.end("scan 1270");
    assert_eq!(tally.said.get("mirrored"), Some(&1), "{:?}", tally.said);
}

#[test]
fn a_part_that_was_not_scanned_is_refused() {
    foreign(&parts(), 0..8, 1).end("8 scans, another part sought");
}

/// Half of either part is the base of both, on which the one lies well in a scan of the other. Three of the twelve had
/// verdict OK before what a fit leaves unexplained was asked for.
#[test]
fn a_part_on_the_same_base_is_refused() {
    let [bracket, tower] = [parts().swap_remove(0), tower()];
    let mut tally = Tally::default();
    for (model, part) in [(&bracket, &tower), (&tower, &bracket)] {
        for number in [3, 4, 7, 10, 11, 12] {
            tally.foreign(model, part, number, &random_scan(part, number));
        }
    }
    tally.end("12 scans, another part on the same base sought");
    assert_eq!(tally.said.get("NG"), None, "{:?}", tally.said);
}

#[test]
#[ignore = "an hour of one core"]
fn a_thousand_random_scans() {
    let numbers = numbers(1000);
    campaign(&parts(), numbers.clone()).end(&format!("scans {numbers:?}"));
}

#[test]
#[ignore = "an hour of one core"]
fn scans_with_every_foreign_part() {
    let numbers = numbers(160);
    let what = format!("scans {numbers:?}, every other part sought");
    foreign(&parts(), numbers, 8).end(&what);
}
