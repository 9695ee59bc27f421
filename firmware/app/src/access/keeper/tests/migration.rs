//! What a firmware before this one has kept is in force: `tests/reference/kept`.

use umi_core::units::Micros;
use umi_protocol::config::{AccessConfig, LockedReading};
use umi_protocol::job::{Job, name};

use super::*;
use crate::App;
use crate::measure::trust::custody::Kept;

/// The areas of a board of protocol 2.23, as it left them; its journal is a new one.
pub(super) fn before() -> Areas {
    let cells = |kept: &[u8], sector: usize| {
        let mut bytes = std::vec![0xFF; SECTORS * sector];
        bytes[..kept.len()].copy_from_slice(kept);
        Arc::new(Mutex::new(bytes))
    };
    macro_rules! kept {
        ($name:literal) => {
            include_bytes!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../../tests/reference/kept/",
                $name
            ))
        };
    }
    Areas {
        access: cells(kept!("access.flash"), SECTOR),
        custody: cells(kept!("custody.flash"), SECTOR),
        journal: cells(&[], 16_384),
        settings: cells(kept!("settings.flash"), 16_384),
        programs: cells(&[], SECTOR),
    }
}

/// What is in force, and nothing of it by a fallback.
#[derive(Clone, Debug, PartialEq)]
struct InForce {
    kept: Kept,
    job: Job,
    /// Of the reference, in mm; none: nothing is taught.
    places: Option<Vec<[f64; 3]>>,
}

fn in_force(app: &App<Cut>) -> InForce {
    let mode = app.guarded.try_lock().unwrap().mode();
    assert_eq!(mode, AccessMode::Claimed);
    let measure = app.measure.try_lock().unwrap();
    assert_eq!(measure.ledger.job_lost.get(), None);
    let custody = measure.ledger.custody.get().expect("a ring");
    assert_eq!(custody.fallbacks().len(), 0);
    let run = measure.brain().run();
    InForce {
        kept: *custody.kept(),
        job: run.job().expect("a job").clone(),
        places: run.taught().map(|taught| {
            let places = taught.places.iter();
            places.map(|place| place.to_array_mm()).collect()
        }),
    }
}

/// Everything that was kept holds: keys, ceilings, what was acknowledged, the greatest run, job and
/// reference; what was not there yet is as on a new board. Nothing of it is written anew by the start
/// alone: the firmware before finds it as it was.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn what_a_firmware_before_has_kept_holds() {
    let areas = before();
    let old = areas.copied();
    let app = areas.started(&Cut::whole(&areas.access));
    let found = in_force(&app);
    assert_eq!(found.job.name, name("THREE BY RUN"));
    assert_eq!((found.kept.acked, found.kept.last_run), (7, Some(42)));
    let ceilings = found.kept.config.ceilings;
    assert_eq!(
        (ceilings.rms_mm, ceilings.shift_mm),
        (Some(0.5), Some(75.0))
    );
    assert!(!ceilings.always && !ceilings.require_witness);
    assert_eq!(found.kept.config.access, AccessConfig::NEW);
    let places = found.places.expect("a reference");
    assert_eq!(
        places[0].map(|mm| (mm * 1e4).round()),
        [-1_350_200.0, -1_366_200.0, 1_358_960.0]
    );
    let register = app.guarded.try_lock().unwrap();
    let keeper = register.look().expect("keys");
    let known = keeper.register().keys().iter();
    let known: Vec<_> = known.map(|key| (key.name.as_str(), key.role)).collect();
    assert_eq!(known, [("anna", Role::Owner), ("line 4", Role::Operator)]);
    for (area, before) in [
        (&areas.custody, &old.custody),
        (&areas.settings, &old.settings),
    ] {
        assert!(*area.lock().unwrap() == *before.lock().unwrap());
    }
}

/// The power goes at every operation while what was kept before is written anew: what is found is
/// what was in force before or what was being set, whole, and nothing as a fallback. A board that
/// was claimed stays so.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_power_cut_while_settings_migrate_leaves_them_whole() {
    let old = before();
    let first = in_force(&old.copied().started(&Cut::whole(&old.access)));
    let mut configured = first.clone();
    configured.kept.config.access = AccessConfig {
        locked_reading: LockedReading::Nobody,
        session_idle_s: Some(600),
        button_off: true,
    };
    let mut acknowledged = configured.clone();
    acknowledged.kept.acked = 1_000;
    let mut with_job = acknowledged.clone();
    with_job.job.name = name("OTHER");
    with_job.places = None;
    // The run that was judged before is old with the next job, too.
    let states = [first, configured, acknowledged, with_job];

    let mut found_at = [0; 4];
    let mut cuts = 0;
    'cuts: for cut_at in 1.. {
        for quarters in 0..4 {
            let board = old.copied();
            let power = Cut::at(&board.access, cut_at, quarters);
            let app = board.started(&power);
            let mut measure = app.measure.try_lock().unwrap();
            let (mut done, mut is_whole) = (0, false);
            if measure
                .set_config(Micros(1), &states[1].kept.config)
                .is_ok()
            {
                done = 1;
                let kept = states[2].kept;
                let custody = measure.ledger.custody.get_mut().unwrap();
                if custody.save(Micros(1), kept).is_ok() {
                    done = 2;
                    is_whole = measure.set_job(Micros(1), &states[3].job).is_ok();
                }
            }
            let is_cut = power.left.load(Ordering::Relaxed) == 0;
            drop(measure);
            let found = in_force(&board.started(&Cut::whole(&board.access)));
            let at = states.iter().position(|state| *state == found);
            let at = at.unwrap_or_else(|| panic!("cut {cut_at}, {quarters} quarters: {found:?}"));
            // What was said to be kept is; of what was not, a part that is whole.
            let most = done + 1;
            assert!(
                (done..=most).contains(&at),
                "cut {cut_at}, {quarters} quarters, {done} done: {at}"
            );
            found_at[at] += 1;
            if !is_cut {
                assert!(is_whole && at == 3);
                break 'cuts;
            }
            cuts += 1;
        }
    }
    assert!(cuts > 100, "{cuts}");
    assert!(found_at.iter().all(|times| *times > 0), "{found_at:?}");
}

/// The control counts its runs on, whatever the job: a run that was judged is old with another job and
/// with the same one set again, under another name, and behind a restart. A board that has lost its job forgets no run.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_run_stays_old_whatever_the_job() {
    let areas = before();
    let app = areas.started(&Cut::whole(&areas.access));
    let first = in_force(&app).job;
    let mut other = first.clone();
    other.name = name("OTHER");
    let mut measure = app.measure.try_lock().unwrap();
    assert_eq!(measure.brain().run().last_run(), Some(42));
    let first_seq = measure.ledger.journal.get().unwrap().next_seq();
    for job in [&other, &first, &other] {
        measure.set_job(Micros(1), job).unwrap();
        assert_eq!(measure.brain().run().last_run(), Some(42), "{}", job.name);
    }
    // Who replays the journal knows it, too.
    let journal = measure.ledger.journal.get_mut().unwrap();
    let mut room = std::vec![0; umi_protocol::message::MAX_RECORD];
    let kinds: Vec<u8> = (first_seq..journal.next_seq())
        .map(|seq| journal.read(seq, &mut room).unwrap().kind)
        .collect();
    assert_eq!(kinds, [2, 29, 2, 29, 2, 29]);
    drop(measure);
    let again = areas.started(&Cut::whole(&areas.access));
    assert_eq!(in_force(&again).kept.last_run, Some(42));
    assert_eq!(
        again.measure.try_lock().unwrap().brain().run().last_run(),
        Some(42)
    );

    areas.settings.lock().unwrap().fill(0xFF);
    let without = areas.started(&Cut::whole(&areas.access));
    let mut measure = without.measure.try_lock().unwrap();
    assert_eq!(measure.brain().job(), None);
    measure.on_time(Micros(2));
    measure.set_job(Micros(3), &first).unwrap();
    assert_eq!(measure.brain().run().last_run(), Some(42));
}
