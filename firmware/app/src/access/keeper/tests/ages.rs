//! Keys, what is kept for the owner, and the journal, of which one is damaged, erased or older than the others.

use umi_protocol::config::LockedReading;

use super::*;

mod lives;

/// What an owner does in a start of its own.
fn does(areas: &Areas, request: Request) {
    let app = areas.started(&Cut::whole(&areas.access));
    let mut measure = app.measure.try_lock().unwrap();
    let mut guarded = app.guarded.try_lock().unwrap();
    let keeper = guarded.keeper().unwrap();
    let caller = Caller::NOBODY;
    let done = super::super::super::change(&mut measure, keeper, Micros(0), &caller, &request);
    assert_eq!(done, Ok(true));
}

/// The owner sets a ceiling in a start of its own.
fn sets(areas: &Areas, rms_mm: f64) {
    let app = areas.started(&Cut::whole(&areas.access));
    let mut measure = app.measure.try_lock().unwrap();
    let mut guarded = app.guarded.try_lock().unwrap();
    let mut config = BoardConfig::NEW;
    config.ceilings.rms_mm = Some(rms_mm);
    measure.set_config(Micros(0), &config).unwrap();
    guarded.note_config(Micros(0), &mut measure);
}

/// The life of a board: new, with an engineer, without, with another ceiling, locked.
fn life() -> [Areas; 5] {
    let areas = new_areas();
    areas.start(&Cut::whole(&areas.access));
    let new = areas.copied();
    does(&areas, Request::KeyEnrol(key(1, Role::Owner)));
    sets(&areas, 0.01);
    does(&areas, Request::KeyEnrol(key(2, Role::Engineer)));
    let engineer = areas.copied();
    let key_id = key_id(&key(2, Role::Engineer).public);
    does(&areas, Request::KeyRevoke { key_id });
    let revoked = areas.copied();
    sets(&areas, 0.02);
    let tight = areas.copied();
    does(&areas, Request::LockSet { locked: true });
    [new, engineer, revoked, tight, areas]
}

fn start(areas: &Areas) -> (AccessMode, Option<f64>) {
    let (mode, config, _) = areas.start(&Cut::whole(&areas.access));
    (mode, config.ceilings.rms_mm)
}

fn has(areas: &Areas, of: u8) -> bool {
    let app = areas.started(&Cut::whole(&areas.access));
    let mut guarded = app.guarded.try_lock().unwrap();
    let register = guarded.keeper().unwrap().register();
    register.role_of(&key(of, Role::Owner).public).is_some()
}

fn put(from: &Cells, into: &Cells) {
    let bytes = from.lock().unwrap().clone();
    *into.lock().unwrap() = bytes;
}

/// The ceiling of the strictest configuration.
const STRICT: Option<f64> = Some(0.0);

/// What may become of a memory: `[damaged]`.
fn damages(whole: &Cells) -> Vec<Vec<u8>> {
    let whole = whole.lock().unwrap().clone();
    let mut all = std::vec![whole.clone(), std::vec![0; whole.len()]];
    let mut next = 1_u8;
    let noise = whole.iter().map(|_| {
        next = next.wrapping_mul(73).wrapping_add(41);
        next
    });
    all.push(noise.collect());
    for offset in [0, 8, 20, 44, 61] {
        let mut headers = whole.clone();
        for sector in 0..SECTORS {
            headers[sector * SECTOR + offset] ^= 4;
        }
        all.push(headers);
    }
    all
}

/// One bit of a header, a whole sector: as long as custody knows that what is left is the newest, nothing is lost and nothing
/// is told, and the next damage finds two copies again. A key that was revoked is not back.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn damage_of_one_copy_loses_nothing() {
    let [new, _, _, tight, _] = life();
    let mut damaged = 0;
    let whole = [
        (&new, (AccessMode::Open, None)),
        (&tight, (AccessMode::Claimed, Some(0.02))),
    ];
    for (whole, as_it_was) in whole {
        let kept = whole.access.lock().unwrap().clone();
        for sector in 0..SECTORS {
            let cells = &kept[sector * SECTOR..][..SECTOR];
            if cells.iter().all(|of| *of == 0xFF) {
                continue;
            }
            let bits = (0..64).map(|offset| (offset, 1));
            for (offset, length) in bits.chain([(0, SECTOR)]) {
                let areas = whole.copied();
                let mut cells = areas.access.lock().unwrap();
                match &mut cells[sector * SECTOR + offset..][..length] {
                    [cell] => *cell ^= 4,
                    cells => cells.fill(0),
                }
                drop(cells);
                for _ in 0..4 {
                    assert_eq!(start(&areas), as_it_was, "sector {sector}, byte {offset}");
                }
                assert_eq!(has(&areas, 1), as_it_was.0 == AccessMode::Claimed);
                assert!(!has(&areas, 2));
                assert!(!tells_of_lost_keys(&areas));
                damaged += 1;
            }
        }
    }
    assert!(damaged > 200, "{damaged}");
}

/// Whatever is damaged, alone and together: the board is not open, and the jumper held over two starts has it wiped, to a board
/// that is open and tells of it.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn the_jumper_wipes_whatever_is_damaged() {
    let [.., locked] = life();
    for (a, access) in damages(&locked.access).into_iter().enumerate() {
        for (c, custody) in damages(&locked.custody).into_iter().enumerate() {
            let areas = locked.copied();
            *areas.access.lock().unwrap() = access.clone();
            *areas.custody.lock().unwrap() = custody;
            assert_eq!(start(&areas).0, AccessMode::Locked, "{a} {c}");
            let app = areas.started(&Cut::whole(&areas.access));
            let measure = app.measure.try_lock().unwrap();
            let mut guarded = app.guarded.try_lock().unwrap();
            let caller = Caller::NOBODY;
            let admitted = guarded.admits(&caller, &Request::Wipe, LockedReading::Nobody);
            assert_eq!(admitted, Ok(()), "{a} {c}");
            let keeper = guarded.keeper().unwrap();
            assert!(super::super::super::begin_wipe(
                &measure,
                keeper,
                Micros(0),
                &caller
            ));
            drop(measure);
            for _ in 0..2 {
                let wiped = areas.start(&Cut::whole(&areas.access));
                assert_eq!(wiped, (AccessMode::Open, BoardConfig::NEW, true), "{a} {c}");
            }
        }
    }
}

/// Keys that are older than custody knows are nobody's; so are those that custody knows nothing of, or not the last two
/// changes; a configuration that is older than the keys' memory knows is the strictest. All are told, and stay so.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn an_older_copy_does_not_count() {
    let life = life();
    let [new, engineer, revoked, tight, locked] = &life;
    for (older, now) in [
        (new, revoked),
        (engineer, revoked),
        (engineer, tight),
        (engineer, locked),
        (tight, locked),
    ] {
        let areas = now.copied();
        put(&older.access, &areas.access);
        for _ in 0..3 {
            assert_eq!(start(&areas).0, AccessMode::Locked);
            assert!(!has(&areas, 1) && !has(&areas, 2));
            assert!(tells_of_lost_keys(&areas));
        }
    }
    for (older, now) in [(new, revoked), (new, locked), (engineer, locked)] {
        let areas = now.copied();
        put(&older.custody, &areas.custody);
        for _ in 0..3 {
            assert_eq!(start(&areas), (AccessMode::Locked, STRICT));
            assert!(!has(&areas, 1) && !has(&areas, 2));
            assert!(tells_of_lost_keys(&areas));
        }
    }
    for (older, now) in [(engineer, tight), (revoked, tight)] {
        let areas = now.copied();
        let mode = start(now).0;
        put(&older.custody, &areas.custody);
        for _ in 0..3 {
            assert_eq!(start(&areas), (mode, STRICT));
        }
        let app = areas.started(&Cut::whole(&areas.access));
        let measure = app.measure.try_lock().unwrap();
        let custody = measure.ledger.custody.get().unwrap();
        assert!(!custody.fallbacks().is_empty());
        drop(measure);
        // The owner's next ends it.
        sets(&areas, 0.03);
        assert_eq!(start(&areas), (mode, Some(0.03)));
    }
}

/// Whatever becomes of keys and custody, together: as long as the journal tells of an owner the board is not open, and custody
/// knows it again.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn evidence_of_an_owner_keeps_a_board_closed() {
    let life = life();
    let [new, .., locked] = &life;
    let erased = std::vec![0xFF; SECTORS * SECTOR];
    let of_new = |cells: &Cells| cells.lock().unwrap().clone();
    let others = |whole: &Cells, new: &Cells| {
        let mut all = damages(whole);
        all.extend([erased.clone(), of_new(new)]);
        all
    };
    let mut looked = 0;
    for access in others(&locked.access, &new.access) {
        for custody in others(&locked.custody, &new.custody) {
            let areas = locked.copied();
            *areas.access.lock().unwrap() = access.clone();
            *areas.custody.lock().unwrap() = custody;
            assert_eq!(start(&areas).0, AccessMode::Locked);
            // The journal may go now.
            areas.journal.lock().unwrap().fill(0xFF);
            put(&new.access, &areas.access);
            assert_eq!(start(&areas).0, AccessMode::Locked);
            looked += 1;
        }
    }
    assert!(looked > 80, "{looked}");
    // Where nobody knows whether there was an owner there is none: custody says of a new board that there was not.
    for (custody, mode) in [
        (of_new(&new.custody), AccessMode::Open),
        (erased.clone(), AccessMode::Locked),
        (std::vec![0; SECTORS * SECTOR], AccessMode::Locked),
    ] {
        let areas = new.copied();
        areas.access.lock().unwrap().fill(0);
        *areas.custody.lock().unwrap() = custody;
        assert_eq!(start(&areas).0, mode);
        assert_eq!(start(&areas).0, mode);
    }
    // A board without an owner looks at what it has not looked at, and stays open.
    let areas = new.copied();
    for _ in 0..300 {
        assert_eq!(start(&areas).0, AccessMode::Open);
    }
    let looked_to = |areas: &Areas| {
        let app = areas.started(&Cut::whole(&areas.access));
        let measure = app.measure.try_lock().unwrap();
        measure.ledger.custody.get().unwrap().marks().looked_to
    };
    assert!(looked_to(&areas) >= 300);
    put(&locked.journal, &areas.journal);
    // Another one, which has not come so far, is looked at from its start.
    assert_eq!(start(&areas).0, AccessMode::Locked);
}

/// The power goes at every operation of the first owner's claim, at four places of each: the board is as it was, or claimed,
/// also where the journal tells of it; behind it erased keys do not open it.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_power_cut_leaves_a_board_claimed_or_not() {
    let new = new_areas();
    new.start(&Cut::whole(&new.access));
    let mut ends = [0, 0];
    'cuts: for cut_at in 1.. {
        for quarters in 0..4 {
            let areas = new.copied();
            let power = Cut::at(&areas.access, cut_at, quarters);
            let app = areas.started(&power);
            let mut measure = app.measure.try_lock().unwrap();
            let mut guarded = app.guarded.try_lock().unwrap();
            let keeper = guarded.keeper().unwrap();
            let request = Request::KeyEnrol(key(1, Role::Owner));
            let caller = Caller::NOBODY;
            let done =
                super::super::super::change(&mut measure, keeper, Micros(0), &caller, &request);
            drop((measure, guarded));
            let is_cut = power.left.load(Ordering::Relaxed) == 0;
            let found = start(&areas).0;
            assert_eq!(start(&areas).0, found);
            let is_claimed = found == AccessMode::Claimed;
            assert!(
                is_claimed || found == AccessMode::Open,
                "cut {cut_at}, {quarters} quarters: {found:?}"
            );
            assert!(is_claimed || done != Ok(true));
            if is_claimed {
                areas.access.lock().unwrap().fill(0xFF);
                areas.journal.lock().unwrap().fill(0xFF);
                assert_eq!(start(&areas).0, AccessMode::Locked);
            } else {
                does(&areas, request);
                assert_eq!(start(&areas).0, AccessMode::Claimed);
            }
            ends[usize::from(is_claimed)] += 1;
            if !is_cut {
                break 'cuts;
            }
        }
    }
    assert!(ends[0] > 20 && ends[1] > 10, "{ends:?}");
}

/// A flash that does not answer at one start is whole at the next: nothing is kept of that.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_flash_that_does_not_answer_costs_nothing() {
    let [_, _, _, tight, _] = life();
    let mute = |cells: &Cells| Cut {
        is_mute: true,
        ..Cut::whole(cells)
    };
    let keeper = Keeper::open(mute(&tight.access), || true, signer(), draw, Micros(0));
    assert_eq!(keeper.register().mode(), AccessMode::Locked);
    let mut custody = Custody::open(mute(&tight.custody));
    assert_eq!(custody.kept().config, BoardConfig::strictest());
    assert!(custody.save(Micros(0), NOTHING_KEPT).is_err());
    let app = Box::new(crate::App::new());
    app.guard(keeper).unwrap();
    let mut measure = app.measure.try_lock().unwrap();
    measure
        .ledger
        .custody
        .put(Custody::open(Cut::whole(&tight.custody)));
    let mut guarded = app.guarded.try_lock().unwrap();
    guarded.compare(Micros(0), &mut measure);
    assert_eq!(guarded.mode(), AccessMode::Locked);
    assert_eq!(start(&tight), (AccessMode::Claimed, Some(0.02)));
}
