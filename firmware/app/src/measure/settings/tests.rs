extern crate std;
use std::vec::Vec as List;

use umi_core::journal::Geometry;
use umi_protocol::job::{
    Compensation, FeatureKind, FeatureSpec, Guards, Limits, ProbingSpec, Reference, SkipSpec,
    Teach, name,
};
use umi_protocol::pattern::ReceiverConfig;
use umi_protocol::serial::LineSpec;

use super::*;

const SECTOR: usize = 16_384;
const SECTORS: usize = 4;

/// A flash in memory.
struct Cells(List<u8>);

impl Flash for Cells {
    type Error = ();

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: SECTORS as u16,
            sector_size: SECTOR as u32,
            write_size: 1,
            page_size: 256,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ()> {
        into.copy_from_slice(&self.0[addr as usize..][..into.len()]);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ()> {
        let cells = &mut self.0[addr as usize..][..bytes.len()];
        cells
            .iter_mut()
            .zip(bytes)
            .for_each(|(cell, byte)| *cell &= byte);
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), ()> {
        self.0[sector as usize * SECTOR..][..SECTOR].fill(0xFF);
        Ok(())
    }
}

fn job(called: &str) -> Job {
    let plane = FeatureSpec {
        name: name("PLANE"),
        id: None,
        kind: FeatureKind::Plane,
        hits: 9,
        position_mm: None,
        radius_mm: None,
        approach: [].into_iter().collect(),
        datum: true,
    };
    Job {
        name: name(called),
        reference: Reference::Taught,
        teach: Teach::Asked,
        plate_timeout_s: 1800,
        receiver: ReceiverConfig::default(),
        // As long as a job of some balls is.
        features: core::iter::repeat_n(plane, 8).collect(),
        compensation: Compensation::InMacro,
        limits: Limits {
            radius_error_mm: 0.03,
            rms_mm: 0.015,
            approach_deg: None,
            lone_hit_mm: None,
            distance_error_mm: 0.01,
            registration_rms_mm: 0.005,
            rotation_deg: 3.0,
            tilt_deg: 0.01,
            shift_mm: [60.0; 3],
            expected_error_mm: None,
        },
        correction: None,
        witness: None,
        guards: Guards::default(),
        line: LineSpec::default(),
        skip: SkipSpec::default(),
        again: None,
    }
}

/// The layouts of what is kept. One that changes here is read wrong, or not at all, where it was kept
/// before: give the new one another kind number, and the old one a reader of its own.
#[test]
fn the_layouts_are_those_that_are_kept() {
    assert_eq!(JOB, (5, 0x6a01_15ab_eb39_a6ee));
    assert_eq!(SENSOR, (4, 0xeb45_5e42_163d_2c24));
}

/// What a firmware before has kept is read: job, reference, what was learned, sensor. It is so behind
/// every entry of today, too, and an entry of before behind one of today is not the older one.
#[test]
fn what_was_kept_before_is_read() {
    const BEFORE: &[u8] = include_bytes!(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/reference/kept/settings.flash"
    ));
    let mut scratch = [0; 8192];
    let mut cells = std::vec![0xFF; SECTORS * SECTOR];
    cells[..BEFORE.len()].copy_from_slice(BEFORE);
    let mut store = JobStore::open(Cells(cells)).unwrap();
    let (old, taught) = store.load(&mut scratch).unwrap();
    assert_eq!(old.name.as_str(), "THREE BY RUN");
    let (places, lessons) = taught.clone().unwrap();
    assert_eq!((places.len(), lessons.run), (3, 41));
    let sensor = store.load_sensor(&mut scratch).unwrap().unwrap();
    assert_eq!(sensor.baud, 921_600);

    store
        .save(Micros(1), &old, taught.as_ref(), &mut scratch)
        .unwrap();
    assert_eq!(store.load(&mut scratch), Ok((old.clone(), taught)));
    assert_eq!(store.load_sensor(&mut scratch), Ok(Some(sensor)));
    store.save_sensor(Micros(2), None, &mut scratch).unwrap();
    store
        .save(Micros(3), &job("B"), None, &mut scratch)
        .unwrap();
    assert_eq!(store.load(&mut scratch), Ok((job("B"), None)));
    assert_eq!(store.load_sensor(&mut scratch), Ok(None));
    // As a firmware that was put back keeps it.
    let without = job("A");
    for (at, (kind, layout)) in (4..).zip(JOBS_BEFORE) {
        let payload = postcard::to_slice(&(layout, &without, None::<()>), &mut scratch).unwrap();
        store.append(kind, Micros(at), payload).unwrap();
        assert_eq!(store.load(&mut scratch), Ok((without.clone(), None)));
    }
}

/// What protocol 2.24 has kept is read, too: its one sigma is that of each axis, and what stands behind
/// it is as it was.
#[test]
fn one_sigma_that_was_kept_is_that_of_each_axis() {
    for (kept, called, probing, kelvin) in [
        (
            &include_bytes!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../../tests/reference/kept/settings.flash"
            ))[..],
            "THREE BY RUN",
            ProbingSpec::alike(0.001, 19),
            6.0,
        ),
        (
            &include_bytes!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../../tests/reference/kept-2.24/settings.flash"
            ))[..],
            "THREE OF 2-24",
            ProbingSpec::alike(0.0012, 24),
            1.0,
        ),
    ] {
        let mut cells = std::vec![0xFF; SECTORS * SECTOR];
        cells[..kept.len()].copy_from_slice(kept);
        let mut store = JobStore::open(Cells(cells)).unwrap();
        let mut scratch = [0; 8192];
        let (job, taught) = store.load(&mut scratch).unwrap();
        assert_eq!(job.name.as_str(), called);
        assert_eq!(job.guards.probing, Some(probing));
        assert_eq!(job.guards.warmth.unwrap().at_most_k, kelvin);
        assert_eq!(job.correction.as_ref().unwrap().program_number, 9010);
        let (places, _) = taught.unwrap();
        let place = places[0].map(|mm| (mm * 1e4).round());
        assert_eq!(place, [-1_350_200.0, -1_366_200.0, 1_358_960.0]);
        // The room that boards have is enough for it, and for the longest: ten bytes are its key, and
        // one says whether something is taught.
        let longest = umi_protocol::schema::max_len::<(Job, PlacesMm, Lessons)>() + 10 + 1;
        assert!(longest <= umi_core::journal::archive::ROOM, "{longest}");
        let mut room = [0; umi_core::journal::archive::ROOM];
        assert_eq!(store.load(&mut room).unwrap().0, job);
    }
}

/// A layout that nobody here knows is told, and nothing before it counts.
#[test]
fn another_layout_is_told() {
    let mut scratch = [0; 8192];
    for (kind, layout) in [
        (JOB.0, JOB.1 ^ 1),
        (JOB.0, MESSAGES_BEFORE),
        (JOBS_BEFORE[0].0, MESSAGES_BEFORE ^ 1),
        (JOBS_BEFORE[0].0, JOB.1),
        (JOBS_BEFORE[1].0, JOB.1),
        (JOBS_BEFORE[1].0, JOBS_BEFORE[0].1),
        (9, JOB.1),
    ] {
        let mut store = JobStore::open(Cells(std::vec![0xFF; SECTORS * SECTOR])).unwrap();
        store
            .save(Micros(0), &job("A"), None, &mut scratch)
            .unwrap();
        let payload = postcard::to_slice(&(layout, job("A"), None::<()>), &mut scratch).unwrap();
        store.append(kind, Micros(1), payload).unwrap();
        assert_eq!(store.load(&mut scratch), Err(JobLoss::OtherSchema));
    }
}

/// Whichever bit of what was kept last is wrong, what counts is that, or nothing: never a reference that was forgotten, nor
/// the job before.
#[test]
fn one_wrong_bit_brings_nothing_back() {
    let mut scratch = [0; 8192];
    for fillers in [0, 9] {
        let mut store = JobStore::open(Cells(std::vec![0xFF; SECTORS * SECTOR])).unwrap();
        for _ in 0..fillers {
            store
                .save(Micros(0), &job("A"), None, &mut scratch)
                .unwrap();
        }
        let mut places = PlacesMm::new();
        places.push([1.0, 2.0, 3.0]).unwrap();
        let taught = (places, Lessons::NONE);
        store
            .save(Micros(1), &job("B"), Some(&taught), &mut scratch)
            .unwrap();
        let before = store.journal.into_flash().0;
        let mut store = JobStore::open(Cells(before.clone())).unwrap();
        store
            .save(Micros(2), &job("B"), None, &mut scratch)
            .unwrap();
        let after = store.journal.into_flash().0;
        let mut tried = 0;
        for at in 0..after.len() {
            let is_header = at % SECTOR < 64 && after[at] != 0xFF;
            if after[at] == before[at] && !is_header {
                continue;
            }
            for bit in 0..8 {
                let mut damaged = after.clone();
                damaged[at] ^= 1 << bit;
                tried += 1;
                let found = JobStore::open(Cells(damaged));
                match found.map(|mut store| store.load(&mut scratch)) {
                    Ok(Ok((job, reference))) => {
                        assert_eq!(
                            (job.name.as_str(), reference),
                            ("B", None),
                            "byte {at}, bit {bit}"
                        );
                    }
                    // Of a sector whose header is damaged nothing can be proven.
                    Ok(Err(_)) | Err(_) => assert!(is_header, "byte {at}, bit {bit}"),
                }
            }
        }
        assert!(tried > 4000, "{tried}");
    }
}
