//! A hit has two witnesses: what the control prints and what the board latched, here
//! both from a virtual machine tool that probes a plate of three spheres by the macros
//! of `hw/control`, wired to a virtual board.

use std::fs;
use std::path::PathBuf;

use umi_client::files::job_file;
use umi_client::session::DecisionRecord;
use umi_desk::capture::Desk;
use umi_desk::wiring::{Peer, WireEvent, Wiring};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;
use umi_virtual::cell::Cell;
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::{Alarm, OffsetSystem};
use umi_virtual::scene::Scene;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(file: &str) -> String {
    fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The plate at its reference place, a control that answers 0 to 4 ms late, a probe
/// with lobes, axes that lag, encoders of 0.1 µm.
const SCENE: &str = r#"
[machine]
start_mm = [-100.0, -100.0, 300.0]
position_gain_per_s = 30.0
counts_per_mm = [10000.0, 10000.0, 10000.0]
origin_counts = [1234567, -89, 4000]
[control]
skip_delay_ms = [0.0, 4.0]
[probe]
pretravel_mm = 0.062
lobing_mm = 0.003
repeatability_um = 1.0
[[body]]
name = "SPHERE1"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [-135.018, -136.624, 135.910]
[[body]]
name = "SPHERE2"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [137.989, -134.678, 110.253]
[[body]]
name = "SPHERE3"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [-136.711, 136.412, 136.121]
[[body]]
name = "PLATE"
shape = "half_space"
position_mm = [0.0, 0.0, 64.0]
"#;

struct Shop {
    cell: Cell<VirtualMachine<Wiring>>,
    program: String,
}

impl Shop {
    fn new() -> Self {
        let job = job_file::parse(&read("examples/three-spheres-witnessed.toml")).unwrap();
        let bench = Desk::new(&job).unwrap();
        let wiring = Wiring::new(Peer::Board(Box::new(bench)));
        let mut cell = Cell::new(Scene::parse(SCENE).unwrap(), 11, wiring);
        for entry in fs::read_dir(root().join("hw/control/fanuc")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|end| end == "nc") {
                cell.control
                    .load(&fs::read_to_string(path).unwrap())
                    .unwrap();
            }
        }
        let program = read("examples/probe-plate.nc");
        Self { cell, program }
    }

    /// Probes the setup; before each hit `upset` may change the machine.
    fn probe_with(&mut self, mut upset: impl FnMut(&mut VirtualMachine<Wiring>)) -> Verdict {
        let done = self.cell.run::<Alarm>(&self.program, |cell, _| {
            upset(&mut cell.machine);
            Ok(())
        });
        done.unwrap();
        let verdicts: Vec<Verdict> = self
            .cell
            .machine
            .wires_mut()
            .take()
            .unwrap()
            .into_iter()
            .filter_map(|event| match event {
                WireEvent::Decision(decision) => match *decision {
                    DecisionRecord::Verdict(verdict) => Some(*verdict),
                    DecisionRecord::Fault(fault) => panic!("{fault}"),
                    DecisionRecord::Feature(_) => None,
                },
                WireEvent::Serial(..) | WireEvent::Skip(..) => None,
            })
            .collect();
        let [verdict] = verdicts.as_slice() else {
            panic!("one verdict, not {verdicts:?}");
        };
        verdict.clone()
    }

    fn probe(&mut self) -> Verdict {
        self.probe_with(|_| {})
    }
}

fn codes(verdict: &Verdict) -> Vec<&str> {
    verdict.reasons.iter().map(|r| r.reason.code()).collect()
}

/// Both witnesses agree setup after setup, and what the board says of the control's
/// delay is what the machine's control did, to the 1.2 ms that 1 µm is at 50 mm/min.
#[test]
fn delay_of_the_control_is_measured() {
    let mut shop = Shop::new();
    let first = shop.probe();
    assert!(first.ok, "{:?}", codes(&first));
    assert!(
        first
            .remarks
            .iter()
            .any(|r| r.reason == Reason::WitnessLearned)
    );
    let before = shop.cell.machine.hits().len();
    let second = shop.probe();
    assert!(
        second.ok && second.correction.is_some(),
        "{:?}",
        codes(&second)
    );
    let Some(Reason::Witnessed {
        hits,
        least_ms,
        mean_ms,
        most_ms,
        ..
    }) = second
        .remarks
        .iter()
        .map(|r| &r.reason)
        .find(|reason| matches!(reason, Reason::Witnessed { .. }))
    else {
        panic!("{:?}", second.remarks);
    };
    assert_eq!(*hits, 15);
    // Of the slow touches, which are the printed ones.
    let delays: Vec<f64> = shop.cell.machine.hits()[before..]
        .iter()
        .filter(|hit| (hit.feed_mm_per_min - 50.0).abs() < 1e-6)
        .map(|hit| hit.delay_ms)
        .collect();
    assert_eq!(delays.len(), 15);
    let mean = delays.iter().sum::<f64>() / 15.0;
    let least = delays.iter().copied().fold(f64::INFINITY, f64::min);
    let most = delays.iter().copied().fold(0.0, f64::max);
    assert!((mean_ms - mean).abs() < 0.4, "{mean_ms} for {mean}");
    assert!((least_ms - least).abs() < 1.3, "{least_ms} for {least}");
    assert!((most_ms - most).abs() < 1.3, "{most_ms} for {most}");
}

/// A work offset that moved between two setups is named, with its axis and size, and
/// nothing is corrected.
#[test]
fn wrong_work_offset_is_named() {
    let mut shop = Shop::new();
    assert!(shop.probe().ok);
    shop.cell
        .control
        .set_offset(OffsetSystem::Standard(1), [0.0, 0.05, 0.0]);
    let verdict = shop.probe();
    let found = verdict.reasons.iter().find_map(|r| match r.reason {
        Reason::WitnessShift {
            axis: 1, shift_mm, ..
        } => Some(shift_mm),
        _ => None,
    });
    assert!(
        (found.unwrap() + 0.05).abs() < 0.001,
        "{:?}",
        verdict.reasons
    );
    assert_eq!(codes(&verdict), ["offset_changed", "witness_shift"]);
    assert_eq!(verdict.correction, None);
}

/// Encoders with another scale than the job says are named on the first setup.
#[test]
fn wrong_scale_is_named() {
    let mut shop = Shop::new();
    shop.cell.machine.scene_mut().machine.counts_per_mm[0] = 10_000.0 * (1.0 - 100e-6);
    let verdict = shop.probe();
    let [Reason::WitnessScale { axis: 0, ppm }, Reason::NoReference] = verdict
        .reasons
        .iter()
        .map(|r| r.reason.clone())
        .collect::<Vec<_>>()[..]
    else {
        panic!("{:?}", verdict.reasons);
    };
    assert!((ppm - 100.0).abs() < 5.0, "{ppm}");
}

/// Counts that X loses while sphere 2 is probed are named with their number.
#[test]
fn lost_counts_are_named() {
    let mut shop = Shop::new();
    assert!(shop.probe().ok);
    let (before, mut lost) = (shop.cell.machine.hits().len(), false);
    let verdict = shop.probe_with(|machine| {
        let on_second = |hit: &umi_virtual::machine::SkippedTouch| hit.body == "SPHERE2";
        if !lost
            && machine.hits()[before..]
                .iter()
                .filter(|hit| on_second(hit))
                .count()
                == 9
        {
            machine.scene_mut().machine.origin_counts[0] -= 400;
            lost = true;
        }
    });
    assert!(lost);
    let [Reason::LostCounts { axis: 0, counts }] = verdict
        .reasons
        .iter()
        .map(|r| r.reason.clone())
        .collect::<Vec<_>>()[..]
    else {
        panic!("{:?}", verdict.reasons);
    };
    assert!((counts - -400.0).abs() <= 10.0, "{counts}");
}
