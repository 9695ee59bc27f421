//! Copies from another life of the board: from before a wipe, from within one, and from within a claim.

use super::super::migration;
use super::*;

fn begins_wipe(areas: &Areas) {
    let app = areas.started(&Cut::whole(&areas.access));
    let measure = app.measure.try_lock().unwrap();
    let mut guarded = app.guarded.try_lock().unwrap();
    let keeper = guarded.keeper().unwrap();
    let begin = crate::access::begin_wipe;
    assert!(begin(&measure, keeper, Micros(0), &Caller::NOBODY));
}

/// As on a new board, behind the wipe.
fn wipes(areas: &Areas) {
    begins_wipe(areas);
    for _ in 0..2 {
        let wiped = areas.start(&Cut::whole(&areas.access));
        assert_eq!(wiped, (AccessMode::Open, BoardConfig::NEW, true));
    }
}

/// The next life of a board that was wiped: without an owner, claimed by another, changed more often than the life before.
fn next_life(areas: &Areas) -> [Areas; 3] {
    let areas = areas.copied();
    wipes(&areas);
    let wiped = areas.copied();
    does(&areas, Request::KeyEnrol(key(7, Role::Owner)));
    sets(&areas, 0.03);
    let claimed = areas.copied();
    for of in [3, 4, 5, 6] {
        does(&areas, Request::KeyEnrol(key(of, Role::Engineer)));
        sets(&areas, 0.04);
    }
    does(&areas, Request::LockSet { locked: true });
    [wiped, claimed, areas]
}

/// Nobody has a key, it is told, and it stays so; the jumper gets out of it.
fn is_locked_until_wiped(areas: &Areas, what: &str) {
    for _ in 0..3 {
        assert_eq!(start(areas), (AccessMode::Locked, STRICT), "{what}");
        assert!((1..8).all(|of| !has(areas, of)), "{what}");
        assert!(tells_of_lost_keys(areas), "{what}");
    }
    let areas = areas.copied();
    wipes(&areas);
    does(&areas, Request::KeyEnrol(key(7, Role::Owner)));
    assert_eq!(start(&areas).0, AccessMode::Claimed, "{what}");
}

/// Keys from before a wipe let nobody in, however often they were changed, on a board without an owner, too; nor does the
/// configuration from before it count.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn copies_from_before_a_wipe_do_not_count() {
    let life = life();
    let [new, old @ ..] = &life;
    let [.., last] = old;
    let next = next_life(last);
    for (n, now) in next.iter().enumerate() {
        for (o, older) in old.iter().enumerate() {
            let areas = now.copied();
            put(&older.access, &areas.access);
            is_locked_until_wiped(&areas, &std::format!("keys {o} on {n}"));
            // Another one, behind the first.
            put(&last.access, &areas.access);
            is_locked_until_wiped(&areas, &std::format!("keys {o} and the last on {n}"));
        }
    }
    let [wiped, owned @ ..] = &next;
    for (n, now) in owned.iter().enumerate() {
        let copies = old.iter().chain([new, wiped]);
        for (o, older) in copies.enumerate() {
            let areas = now.copied();
            put(&older.custody, &areas.custody);
            is_locked_until_wiped(&areas, &std::format!("custody {o} on {n}"));
        }
        assert!(has(now, 7), "as it was");
    }
}

/// A wipe that was begun goes on in its own life, and where nothing is known any more; a copy of one on a later life does
/// not: the board is locked, and everything else is there.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_wipe_of_another_life_does_not_go_on() {
    let [.., last] = life();
    let wiping = last.copied();
    begins_wipe(&wiping);
    let size = SECTORS * SECTOR;
    for custody in [None, Some(std::vec![0xFF; size]), Some(std::vec![0; size])] {
        let areas = wiping.copied();
        if let Some(custody) = custody {
            *areas.custody.lock().unwrap() = custody;
        }
        let found = areas.start(&Cut::whole(&areas.access));
        assert_eq!(found, (AccessMode::Open, BoardConfig::NEW, true));
    }
    let [_, owned @ ..] = next_life(&last);
    for (n, now) in owned.iter().enumerate() {
        let areas = now.copied();
        put(&wiping.access, &areas.access);
        let entries = |areas: &Areas| {
            let app = areas.started(&Cut::whole(&areas.access));
            let mut measure = app.measure.try_lock().unwrap();
            let journal = measure.ledger.journal.get_mut().unwrap();
            assert_eq!(journal.first_seq(), 0);
            journal.next_seq()
        };
        let before = entries(&now.copied());
        assert!(entries(&areas) >= before, "{n}");
        is_locked_until_wiped(&areas, &std::format!("a wipe on {n}"));
    }
}

/// The power goes at every operation of a wipe's second start, wherever in its ring custody stands: the next start ends it.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_wipe_that_was_cut_goes_on() {
    let [.., locked] = life();
    let mut cuts = 0;
    for turns in 0..SECTORS {
        for _ in 0..turns {
            sets(&locked, 0.1 + cuts as f64);
        }
        begins_wipe(&locked);
        'cuts: for cut_at in 1.. {
            for quarters in [0, 2, 3] {
                let areas = locked.copied();
                let power = Cut::at(&areas.access, cut_at, quarters);
                areas.start(&power);
                let is_cut = power.left.load(Ordering::Relaxed) == 0;
                let found = areas.start(&Cut::whole(&areas.access));
                let what = std::format!("{turns} turns, cut {cut_at}, {quarters} quarters");
                assert_eq!(found.0, AccessMode::Open, "{what}");
                assert_eq!((found.1, found.2), (BoardConfig::NEW, true), "{what}");
                cuts += 1;
                if !is_cut {
                    break 'cuts;
                }
            }
        }
        wipes(&locked);
        does(&locked, Request::KeyEnrol(key(1, Role::Owner)));
    }
    assert!(cuts > 300, "{cuts}");
}

/// The power goes at every operation of an owner's next change of the keys, on a board of this firmware, of one that knew no
/// lives and of one that did not count: the owner is never out, and behind it the copy from before does not count.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_power_cut_while_keys_change_locks_nobody_out() {
    let [_, engineer, ..] = life();
    // As a firmware that knew no lives has left it.
    let counted = new_areas();
    let whole = Cut::whole(&counted.access);
    let mut keeper = open(whole.beside(&counted.access), true);
    let owner = keeper.register().enrolled(&key(1, Role::Owner)).unwrap();
    keeper.save(Micros(0), owner.unwrap()).unwrap();
    let mut custody = Custody::open(whole.beside(&counted.custody));
    let mut marks = custody.marks();
    (marks.age.keys, marks.is_owned) = (1, true);
    custody.keep_marks(Micros(0), marks).unwrap();
    let mut cuts = 0;
    for (b, board) in [engineer, counted, migration::before()].iter().enumerate() {
        'cuts: for cut_at in 1.. {
            for quarters in 0..4 {
                let areas = board.copied();
                let power = Cut::at(&areas.access, cut_at, quarters);
                let app = areas.started(&power);
                let mut measure = app.measure.try_lock().unwrap();
                let mut guarded = app.guarded.try_lock().unwrap();
                let keeper = guarded.keeper().unwrap();
                let request = Request::KeyEnrol(key(9, Role::Owner));
                let caller = Caller::NOBODY;
                let change = crate::access::change;
                let _ = change(&mut measure, keeper, Micros(0), &caller, &request);
                drop((measure, guarded));
                let is_cut = power.left.load(Ordering::Relaxed) == 0;
                let found = start(&areas);
                let what = std::format!("board {b}, cut {cut_at}, {quarters} quarters");
                assert_eq!(found.0, AccessMode::Claimed, "{what}");
                assert_ne!(found.1, STRICT, "{what}");
                does(&areas, request);
                does(&areas, Request::KeyEnrol(key(8, Role::Engineer)));
                assert_eq!(start(&areas).0, AccessMode::Claimed, "{what}");
                assert!(has(&areas, 8) && has(&areas, 9), "{what}");
                cuts += 1;
                if !is_cut {
                    put(&board.access, &areas.access);
                    assert_eq!(start(&areas).0, AccessMode::Locked, "{what}");
                    break 'cuts;
                }
            }
        }
    }
    assert!(cuts > 100, "{cuts}");
}

/// Keys as of the middle of the first claim, put back where the evidence tells of an owner and custody knows nothing, or as
/// little as on a new board: the board is not open.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_copy_from_within_the_claim_opens_no_board() {
    let [new, _, _, tight, locked] = life();
    let mut claiming = 0;
    for cut_at in 1.. {
        let areas = new.copied();
        let power = Cut::at(&areas.access, cut_at, 2);
        let app = areas.started(&power);
        let mut measure = app.measure.try_lock().unwrap();
        let mut guarded = app.guarded.try_lock().unwrap();
        let keeper = guarded.keeper().unwrap();
        let request = Request::KeyEnrol(key(1, Role::Owner));
        let change = crate::access::change;
        let _ = change(&mut measure, keeper, Micros(0), &Caller::NOBODY, &request);
        drop((measure, guarded));
        if power.left.load(Ordering::Relaxed) > 0 {
            break;
        }
        if !open(Cut::whole(&areas.access), false)
            .register()
            .is_claiming()
        {
            continue;
        }
        claiming += 1;
        let size = SECTORS * SECTOR;
        let unclaimed = new.custody.lock().unwrap().clone();
        for custody in [std::vec![0xFF; size], std::vec![0; size], unclaimed] {
            for now in [&tight, &locked] {
                let board = now.copied();
                put(&areas.access, &board.access);
                *board.custody.lock().unwrap() = custody.clone();
                for _ in 0..2 {
                    assert_eq!(start(&board).0, AccessMode::Locked, "cut {cut_at}");
                }
            }
        }
    }
    assert!(claiming > 3, "{claiming}");
}
