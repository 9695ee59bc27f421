//! Evidence stays when noise has lapped the journal, over restarts and power cuts.

use std::vec::Vec;

use umi_protocol::message::MAX_RECORD;

use super::*;
use crate::journal::mock::{Cut, ERASE_CUTS, MockFlash, Op, Random};
use crate::journal::{EntryIter, Geometry};

const STREAM: Geometry = Geometry {
    sectors: 3,
    sector_size: 8192,
    write_size: 1,
    page_size: 256,
};
const EVIDENCE: Geometry = Geometry {
    sectors: 4,
    ..STREAM
};

/// A verdict's kind, and one that is noise.
const VERDICT: u8 = 10;
const NOISE: u8 = 4;

type Mock = Archive<MockFlash>;

fn open(stream: MockFlash, evidence: MockFlash) -> Mock {
    let (mut archive, _) = Archive::open(stream).unwrap();
    archive.keep_evidence(evidence, &mut [0; ROOM]).unwrap();
    archive
}

fn new() -> Mock {
    open(MockFlash::new(STREAM), MockFlash::new(EVIDENCE))
}

fn flashes(archive: Mock) -> (MockFlash, MockFlash) {
    let Archive {
        journal,
        mut evidence,
        ..
    } = archive;
    let evidence = evidence.take().unwrap().ring.into_flash();
    (journal.into_flash(), evidence)
}

fn put(archive: &mut Mock, kind: u8, payload: &[u8]) -> Result<u64, ()> {
    let mut room = [0; ROOM];
    room[FIELDS..FIELDS + payload.len()].copy_from_slice(payload);
    archive
        .append(kind, Micros(payload.len() as u64), &mut room, payload.len())
        .map_err(|_| ())
}

/// Everything that is there, as a reader gets it: each entry proven by the chain before it.
fn all(archive: &mut Mock) -> Vec<(u64, u8, Vec<u8>)> {
    let mut found = Vec::new();
    let mut seq = archive.next_there(0).unwrap();
    while seq < archive.next_seq() {
        let mut raw = [0; MAX_RECORD + 64];
        let len = archive.read_encoded(seq, &mut raw).unwrap();
        let before = archive.chain_before(seq).unwrap();
        let mut entries = EntryIter::new(&raw[..len], seq, before);
        let entry = entries.next().unwrap().unwrap();
        found.push((seq, entry.kind, entry.payload.to_vec()));
        assert_eq!(entries.offset(), len);
        let next = archive.next_there(seq + 1).unwrap();
        assert!(next > seq);
        seq = next;
    }
    found
}

/// The chain of evidence by somebody who has only what was read.
fn chain_of(found: &[(u64, u8, Vec<u8>)], archive: &mut Mock) -> Chain {
    let mark = archive.mark().unwrap().unwrap();
    let mut chain = Chain(mark.first_chain);
    let mut number = mark.first;
    for (seq, kind, payload) in found {
        if *seq < mark.first_seq || !Record::is_evidence(*kind) {
            continue;
        }
        let before = archive.chain_before(*seq).unwrap();
        let payload = [&seq.to_le_bytes()[..], &before.0, payload].concat();
        let entry = Entry {
            seq: number,
            t: Micros(payload.len() as u64 - FIELDS as u64),
            kind: *kind,
            payload: &payload,
        };
        let mut out = [0; ROOM + 64];
        crate::journal::encode_entry(&entry, &mut chain, &mut out).unwrap();
        number += 1;
    }
    assert_eq!(number, mark.next);
    chain
}

/// Ten laps of noise: every piece of evidence is there, byte by byte, and its chain is that of
/// the mark, also after a restart.
#[test]
fn ten_laps_of_noise_cost_no_evidence() {
    let mut archive = new();
    let mut random = Random(1);
    let mut expected = Vec::new();
    let mut noise = 0_u64;
    let size = u64::from(STREAM.sector_size) * u64::from(STREAM.sectors);
    while noise < 10 * size {
        if random.below(60) == 0 {
            let payload: Vec<u8> = (0..random.below(90)).map(|_| random.byte()).collect();
            let seq = put(&mut archive, VERDICT, &payload).unwrap();
            expected.push((seq, VERDICT, payload));
        }
        let payload = [7; 40];
        put(&mut archive, NOISE, &payload).unwrap();
        noise += 40 + 32;
        if random.below(500) == 0 {
            let (stream, evidence) = flashes(archive);
            archive = open(stream, evidence);
        }
    }
    assert!(archive.first_seq() > 2000);
    let found = all(&mut archive);
    let evidence: Vec<_> = found.iter().filter(|of| of.1 == VERDICT).cloned().collect();
    assert_eq!(evidence.len(), expected.len());
    assert!(evidence == expected && expected.len() > 40);
    assert_eq!(
        chain_of(&found, &mut archive),
        Chain(archive.mark().unwrap().unwrap().chain)
    );
    let lost = archive.lost_of(0..u64::MAX);
    assert_eq!(lost + found.len() as u64, archive.next_seq());
    assert_eq!(archive.lost_of(archive.first_seq()..u64::MAX), 0);
}

/// A board that gets the ring later copies what its journal holds; a ring of another journal is
/// refused.
#[test]
fn a_new_ring_takes_up_what_is_there() {
    let (mut archive, _) = Archive::open(MockFlash::new(STREAM)).unwrap();
    for n in 0..50 {
        let kind = if n % 5 == 0 { VERDICT } else { NOISE };
        put(&mut archive, kind, &[n]).unwrap();
    }
    let mut archive = open(archive.journal.into_flash(), MockFlash::new(EVIDENCE));
    let mark = archive.mark().unwrap().unwrap();
    assert_eq!((mark.first, mark.first_seq, mark.next), (0, 0, 10));
    let (_, evidence) = flashes(archive);
    let (mut other, _) = Archive::open(MockFlash::new(STREAM)).unwrap();
    put(&mut other, VERDICT, b"x").unwrap();
    let refused = other.keep_evidence(evidence, &mut [0; ROOM]);
    assert_eq!(refused, Err(ArchiveFault::OtherJournal));
}

/// A bit of the ring that has changed, where the journal still has everything: at the next start the ring is what it was,
/// so that what the board signs is true of what a reader gets.
#[test]
fn a_damaged_ring_is_made_anew_from_a_whole_journal() {
    let mut archive = new();
    for n in 0..40 {
        let kind = if n % 3 == 0 { VERDICT } else { NOISE };
        put(&mut archive, kind, &[n; 60]).unwrap();
    }
    let mark = archive.mark().unwrap();
    let (stream, evidence) = flashes(archive);
    let used = evidence
        .data
        .iter()
        .rposition(|byte| *byte != 0xFF)
        .unwrap();
    let mut random = Random(1);
    for _ in 0..200 {
        let mut damaged = evidence.clone();
        let at = usize::try_from(random.below(used as u64)).unwrap();
        damaged.data[at] ^= 1 << random.below(8);
        let (mut archive, _) = Archive::open(stream.clone()).unwrap();
        if archive.keep_evidence(damaged, &mut [0; ROOM]).is_err() {
            // Its first header: that it is none is told.
            continue;
        }
        assert_eq!(archive.mark().unwrap(), mark, "byte {at}");
        put(&mut archive, VERDICT, b"more").unwrap();
        let found = all(&mut archive);
        let chain = chain_of(&found, &mut archive);
        assert_eq!(archive.mark().unwrap().unwrap().chain, chain.0, "byte {at}");
    }
}

/// One bit of the ring has changed while the board runs, and noise has lapped the journal: every other piece is found, from
/// whichever entry on a reader asks, and what a head says of the ring shows that one is missing.
#[test]
fn a_damaged_piece_hides_no_other() {
    let mut archive = new();
    for n in 0..150 {
        put(&mut archive, VERDICT, &[n; 60]).unwrap();
        put(&mut archive, NOISE, &[n; 20]).unwrap();
    }
    while archive.first_seq() < 300 {
        put(&mut archive, NOISE, &[7; 900]).unwrap();
    }
    let whole = all(&mut archive);
    let ring = |archive: &mut Mock| archive.evidence.get_mut().unwrap().ring.extent;
    let extent = ring(&mut archive);
    let oldest = (extent.oldest * EVIDENCE.sector_size) as usize;
    let mut random = Random(5);
    let mut missing = 0;
    for n in 0..300 {
        let mut archive = archive.clone();
        let flash = &mut archive.evidence.get_mut().unwrap().ring.flash;
        let at = match n {
            // Headers, and the oldest piece.
            0..200 => oldest + n,
            _ => oldest + usize::try_from(random.below(u64::from(extent.tail) - 1)).unwrap(),
        };
        flash.data[at] ^= 1 << random.below(8);
        let found = all(&mut archive);
        let lacks = whole.iter().filter(|of| !found.contains(of)).count();
        assert!(
            lacks <= 1 && found.len() + lacks == whole.len(),
            "byte {at}"
        );
        missing += lacks;
        for _ in 0..20 {
            let seq = random.below(archive.first_seq());
            let next = found.iter().find(|of| of.0 >= seq).unwrap().0;
            assert_eq!(
                archive.next_there(seq).unwrap(),
                next,
                "byte {at}, from {seq}"
            );
        }
        let mark = archive.mark().unwrap().unwrap();
        let is_of = |of: &&(u64, u8, Vec<u8>)| of.0 >= mark.first_seq && of.1 == VERDICT;
        let there = found.iter().filter(is_of).count() as u64;
        assert_eq!(there + lacks as u64, mark.next - mark.first, "byte {at}");
    }
    assert!(missing > 200, "{missing}");
}

/// A ring of another history is refused also where the journal has an entry of that number: by what
/// stands before it, and by what it is itself.
#[test]
fn a_ring_of_another_history_is_refused() {
    let written = |kinds: &[u8], first: u8| {
        let mut archive = new();
        for (n, kind) in kinds.iter().enumerate() {
            put(&mut archive, *kind, &[if n == 0 { first } else { 1 }; 9]).unwrap();
        }
        flashes(archive)
    };
    let taken = |stream: MockFlash, evidence: MockFlash| {
        let (mut archive, _) = Archive::open(stream).unwrap();
        archive.keep_evidence(evidence, &mut [0; ROOM]).map(|_| ())
    };
    let kinds = [VERDICT, NOISE, VERDICT, NOISE, NOISE];
    let (stream, ring) = written(&kinds, 1);
    assert_eq!(taken(stream.clone(), ring), Ok(()));
    let (_, other_before) = written(&kinds, 2);
    let (_, other_itself) = written(&[VERDICT], 2);
    for other in [other_before, other_itself] {
        let refused = taken(stream.clone(), other);
        assert_eq!(refused, Err(ArchiveFault::OtherJournal));
    }
}

/// Evidence that has lapped itself: the oldest is gone and counted, and it was said before.
#[test]
fn evidence_that_never_ends_is_told_before() {
    let mut archive = new();
    let mut was_full = None;
    for n in 0..4000_u64 {
        if was_full.is_none() && archive.is_full(0, 1000) {
            was_full = Some(n);
            assert_eq!(
                archive.lost_of(0..u64::MAX),
                0,
                "told before anything is lost"
            );
            assert!(!archive.is_full(n, 1000), "all of it was kept elsewhere");
        }
        put(&mut archive, VERDICT, &n.to_le_bytes()).unwrap();
    }
    assert!(was_full.is_some_and(|n| n > 100));
    let found = all(&mut archive);
    assert_eq!(
        chain_of(&found, &mut archive),
        Chain(archive.mark().unwrap().unwrap().chain)
    );
    assert!(archive.lost_of(0..u64::MAX) > 3000);
}

/// Every way to cut one operation.
fn cuts(op: &Op) -> Vec<Cut> {
    match op {
        Op::Erase { .. } => ERASE_CUTS.to_vec(),
        Op::Program { len, .. } => (0..=*len)
            .step_by(61)
            .chain([*len])
            .map(Cut::AtByte)
            .chain([Cut::Page(0)])
            .collect(),
    }
}

/// Power is cut at every operation of either flash: what was acknowledged is there in both, the
/// chain of evidence holds, and it goes on.
#[test]
fn power_cuts_lose_no_acknowledged_evidence() {
    let mut archive = new();
    let mut kept = Vec::new();
    let mut tried = 0;
    for n in 0..200_u32 {
        let kind = if n % 3 == 0 { VERDICT } else { NOISE };
        let payload = [n as u8; 120];
        // Which of the two is cut, and where.
        let before = flashes(archive.clone());
        let seq = put(&mut archive, kind, &payload).unwrap();
        for which in 0..2 {
            let of = |pair: &(MockFlash, MockFlash)| match which {
                0 => pair.0.clone(),
                _ => pair.1.clone(),
            };
            let whole = flashes(archive.clone());
            let skip = of(&before).take_ops().len();
            let ops = of(&whole).take_ops();
            // The busy places: the ends of sectors, and some others.
            let erases = ops
                .iter()
                .skip(skip)
                .any(|op| matches!(op, Op::Erase { .. }));
            if !erases && n % 15 != 0 {
                continue;
            }
            for (at, op) in ops.iter().enumerate().skip(skip) {
                for cut in cuts(op) {
                    tried += 1;
                    let (mut stream, mut evidence) = before.clone();
                    let flash = if which == 0 {
                        &mut stream
                    } else {
                        &mut evidence
                    };
                    flash.cut_power_at(at, cut, u64::from(n) + tried);
                    let mut after = open_as_is(stream, evidence);
                    let done = put(&mut after, kind, &payload).is_ok();
                    let (mut stream, mut evidence) = flashes(after);
                    stream.power_up();
                    evidence.power_up();
                    let mut again = open(stream, evidence);
                    put(&mut again, VERDICT, b"goes on").unwrap();
                    let found = all(&mut again);
                    let chain = chain_of(&found, &mut again);
                    assert_eq!(chain, Chain(again.mark().unwrap().unwrap().chain));
                    let oldest = again.mark().unwrap().unwrap().first_seq;
                    for (seq, payload) in &kept {
                        let there = found.iter().any(|of| of.0 == *seq && of.2 == *payload);
                        assert!(there || *seq < oldest, "{n} {op:?} {cut:?}: {seq}");
                    }
                    if done && kind == VERDICT {
                        assert!(found.iter().any(|of| of.0 == seq && of.2 == payload));
                    }
                }
            }
        }
        if kind == VERDICT {
            kept.push((seq, payload.to_vec()));
        }
    }
    assert!(tried > 180, "{tried}");
}

/// As [`open`], where the next operation may be the one that is cut.
fn open_as_is(stream: MockFlash, evidence: MockFlash) -> Mock {
    open(stream, evidence)
}

/// A ring in which [`RESERVE`] finds room.
const HELD: Geometry = Geometry {
    sector_size: 32_768,
    ..EVIDENCE
};

/// A start's kind: it may take the reserve.
const BOOT: u8 = 0;

/// Pieces of evidence from entry `from` on.
fn evidence_from(archive: &mut Mock, from: u64) -> Vec<(u64, u8, Vec<u8>)> {
    let found = all(archive).into_iter();
    found
        .filter(|(seq, kind, _)| *seq >= from && Record::is_evidence(*kind))
        .collect()
}

/// As [`open`], with evidence held from this entry on.
fn open_held(stream: MockFlash, evidence: MockFlash, from: u64) -> Mock {
    let mut archive = open(stream, evidence);
    archive.hold(Some(from));
    archive
}

/// Puts pieces of this kind until one finds no room; those that are there.
fn fill(archive: &mut Mock, kind: u8) -> Vec<(u64, u8, Vec<u8>)> {
    let mut there = Vec::new();
    let payload = std::vec![kind; 300];
    while let Ok(seq) = put(archive, kind, &payload) {
        there.push((seq, kind, payload.clone()));
        archive.prepare(2000).unwrap();
        assert!(there.len() < 2000, "never full");
    }
    there
}

/// Evidence that is held is never overwritten: not by more of it, nor ahead, nor behind restarts, nor by
/// what may take the reserve. What is no evidence is written as ever. What somebody keeps elsewhere makes
/// room again, for as much as that was.
#[test]
fn held_evidence_is_not_overwritten() {
    let mut archive = open(MockFlash::new(STREAM), MockFlash::new(HELD));
    // Once round, so that the ring has nothing erased left.
    for n in 0..500_u64 {
        put(&mut archive, VERDICT, &[n as u8; 300]).unwrap();
    }
    let from = archive.next_seq();
    archive.hold(Some(from));
    let mut expected = fill(&mut archive, VERDICT);
    assert!(expected.len() > 100);
    assert!(archive.is_full(from, RESERVE + 400) && !archive.takes(300, false));
    for turn in 0..40 {
        assert_eq!(put(&mut archive, VERDICT, b"no room"), Err(()));
        put(&mut archive, NOISE, &[9; 900]).unwrap();
        archive.prepare(30_000).unwrap();
        if turn % 4 == 0 {
            let (stream, evidence) = flashes(archive);
            archive = open_held(stream, evidence, from);
            expected
                .extend(put(&mut archive, BOOT, &[1; 90]).map(|seq| (seq, BOOT, [1; 90].to_vec())));
        }
    }
    expected.extend(fill(&mut archive, BOOT));
    assert!(!archive.takes(300, true));
    assert_eq!(evidence_from(&mut archive, from), expected);
    let found = all(&mut archive);
    let chain = Chain(archive.mark().unwrap().unwrap().chain);
    assert_eq!(chain_of(&found, &mut archive), chain);
    // One sector's worth is kept elsewhere.
    let next = expected[expected.len() / 2].0;
    archive.hold(Some(next));
    let more = fill(&mut archive, VERDICT);
    assert!(more.len() > 10);
    expected.extend(more);
    expected.retain(|(seq, ..)| *seq >= next);
    assert_eq!(evidence_from(&mut archive, next), expected);
    archive.hold(None);
    for _ in 0..500 {
        put(&mut archive, VERDICT, &[1; 300]).unwrap();
    }
}

/// Power is cut at every operation of either flash while a ring that is held fills up to its end: nothing that
/// is held is lost, whatever the cut has left.
#[test]
fn power_cuts_lose_nothing_that_is_held() {
    let mut archive = open(MockFlash::new(STREAM), MockFlash::new(HELD));
    for n in 0..500_u64 {
        put(&mut archive, VERDICT, &[n as u8; 300]).unwrap();
    }
    let from = archive.next_seq();
    archive.hold(Some(from));
    let mut expected = fill(&mut archive, VERDICT);
    let mut tried = 0;
    let payload = [1; 300];
    while archive.takes(payload.len(), true) {
        let before = flashes(archive.clone());
        let seq = put(&mut archive, BOOT, &payload).unwrap();
        let whole = flashes(archive.clone());
        for which in 0..2 {
            let of = |pair: &(MockFlash, MockFlash)| match which {
                0 => pair.0.clone(),
                _ => pair.1.clone(),
            };
            let skip = of(&before).take_ops().len();
            for (at, op) in of(&whole).take_ops().iter().enumerate().skip(skip) {
                for cut in cuts(op) {
                    tried += 1;
                    let (mut stream, mut evidence) = before.clone();
                    let flash = if which == 0 {
                        &mut stream
                    } else {
                        &mut evidence
                    };
                    flash.cut_power_at(at, cut, tried);
                    let mut after = open_held(stream, evidence, from);
                    let done = put(&mut after, BOOT, &payload).is_ok();
                    let (mut stream, mut evidence) = flashes(after);
                    stream.power_up();
                    evidence.power_up();
                    let mut again = open_held(stream, evidence, from);
                    fill(&mut again, BOOT);
                    let found = evidence_from(&mut again, from);
                    assert_eq!(found[..expected.len()], expected, "{op:?} {cut:?}");
                    assert!(!done || found[expected.len()].0 == seq);
                }
            }
        }
        expected.push((seq, BOOT, payload.to_vec()));
    }
    assert!(tried > 100, "{tried}");
}

/// Damage of the ring at rest, in each of its sectors and in all of them: not less is told as lost than has been
/// overwritten, and who acknowledges everything finds room, again and again, until the damage is overwritten, too.
#[test]
fn damage_blocks_no_acknowledgement() {
    let mut archive = open(MockFlash::new(STREAM), MockFlash::new(HELD));
    for n in 0..700_u64 {
        put(&mut archive, VERDICT, &[n as u8; 300]).unwrap();
        put(&mut archive, NOISE, &[n as u8; 100]).unwrap();
    }
    let oldest = archive.mark().unwrap().unwrap().first_seq;
    let from = oldest - 100;
    archive.hold(Some(from));
    fill(&mut archive, VERDICT);
    for _ in 0..100 {
        put(&mut archive, NOISE, &[9; 900]).unwrap();
    }
    let gone = archive.lost_of(from..u64::MAX);
    assert!(gone > 200 && gone < archive.first_seq() - from);
    // One bit of each piece, in what follows its number and its chain value.
    let evidence = archive.evidence.get_mut().unwrap();
    let numbers = evidence.ring.first_seq()..evidence.ring.next_seq();
    let pieces = numbers.map(|number| {
        let mut raw = [0; ROOM + 64];
        let len = evidence.ring.read_encoded(number, &mut raw).unwrap().len();
        raw[..len].to_vec()
    });
    let pieces: Vec<_> = pieces.collect();
    let (stream, whole) = flashes(archive);
    let size = HELD.sector_size as usize;
    let mut flipped = whole.clone();
    for piece in &pieces {
        let mut places = flipped.data.windows(piece.len());
        let at = places.position(|place| place == piece).unwrap();
        flipped.data[at + 70] ^= 1;
    }
    let mut all_but_counted = 0;
    for sectors in [0..1, 1..2, 2..3, 3..4, 0..4] {
        let bytes = sectors.start * size..sectors.end * size;
        for how in 0..3 {
            let mut evidence = whole.clone();
            match how {
                0 => evidence.data[bytes.clone()].fill(0),
                1 => evidence.data[bytes.clone()].fill(0xFF),
                _ => evidence.data[bytes.clone()].copy_from_slice(&flipped.data[bytes.clone()]),
            }
            let (mut archive, _) = Archive::open(stream.clone()).unwrap();
            if archive.keep_evidence(evidence, &mut [0; ROOM]).is_err() {
                assert_eq!((sectors.len(), how), (4, 0), "no header is left");
                continue;
            }
            archive.hold(Some(from));
            let lost = archive.lost_of(from..u64::MAX);
            let now_gone = archive.first_seq() - from;
            assert!(lost >= gone && lost <= now_gone, "{sectors:?} {how}");
            all_but_counted += u32::from(lost == now_gone);
            let middle = from + 150;
            let parts = archive.lost_of(from..middle) + archive.lost_of(middle..u64::MAX);
            assert!(parts >= gone, "{sectors:?} {how}: {parts}");
            for turn in 0..1000 {
                if archive.is_full(archive.held.get().copied().unwrap(), RESERVE + 400) {
                    archive.hold(Some(archive.next_seq()));
                }
                let done = put(&mut archive, VERDICT, &[1; 300]);
                assert!(done.is_ok(), "{sectors:?} {how} {turn}");
            }
        }
    }
    assert!(all_but_counted > 0, "no damage was met");
}

/// A ring that has gone round, with a journal that noise has lapped: what it holds stands only there.
fn lapped() -> Mock {
    let mut archive = new();
    for n in 0..600_u32 {
        put(&mut archive, VERDICT, &[n as u8; 60]).unwrap();
    }
    for _ in 0..40 {
        put(&mut archive, NOISE, &[7; 900]).unwrap();
    }
    assert!(archive.evidence.get().unwrap().ring.first_seq() > 0 && archive.first_seq() > 600);
    archive
}

/// Byte `at` of the header of the ring's oldest sector.
fn in_oldest_header(archive: &Mock, at: u32) -> usize {
    let extent = archive.evidence.get().unwrap().ring.extent;
    (extent.oldest * EVIDENCE.sector_size + at) as usize
}

/// A bit of the header of the oldest sector changes in a ring that has gone round, while the board runs: heads say all the
/// same where evidence begins that can be proven, each time, and every piece is still there.
#[test]
fn a_damaged_header_leaves_heads_their_mark() {
    let mut archive = lapped();
    let (whole, before) = (all(&mut archive), archive.mark().unwrap().unwrap());
    let at = in_oldest_header(&archive, 9);
    archive.evidence.get_mut().unwrap().ring.flash.data[at] ^= 1;
    for _ in 0..3 {
        let mark = archive.mark().unwrap().unwrap();
        assert!(mark.first > before.first && mark.first < mark.next);
        assert_eq!((mark.next, mark.chain), (before.next, before.chain));
        let found = all(&mut archive);
        assert_eq!(found, whole);
        assert_eq!(chain_of(&found, &mut archive), Chain(mark.chain));
    }
}

/// The same at rest: at the next start the pieces of that sector are there, the damage is told, and where nobody has
/// acknowledged them they are not overwritten.
#[test]
fn a_sector_without_its_header_is_held() {
    let mut archive = open(MockFlash::new(STREAM), MockFlash::new(HELD));
    for n in 0..500_u64 {
        put(&mut archive, VERDICT, &[n as u8; 300]).unwrap();
    }
    let from = archive.mark().unwrap().unwrap().first_seq;
    archive.hold(Some(from));
    fill(&mut archive, VERDICT);
    for _ in 0..40 {
        put(&mut archive, NOISE, &[7; 900]).unwrap();
    }
    let whole = evidence_from(&mut archive, from);
    let ring = &archive.evidence.get().unwrap().ring;
    let (first, oldest) = (ring.first_seq(), ring.extent.oldest * HELD.sector_size);
    assert!(first > 0);
    let (stream, evidence) = flashes(archive);
    // The header alone, and the first piece behind it, too.
    for places in [&[9][..], &[9, 150]] {
        let mut damaged = evidence.clone();
        for at in places {
            damaged.data[oldest as usize + at] ^= 1;
        }
        let (mut archive, _) = Archive::open(stream.clone()).unwrap();
        let found = archive.keep_evidence(damaged, &mut [0; ROOM]).unwrap();
        assert_eq!(found.damaged_headers, 1);
        archive.hold(Some(from));
        assert_eq!(put(&mut archive, VERDICT, &[1; 300]), Err(()), "{places:?}");
        archive.prepare(30_000).unwrap();
        assert!(!archive.takes(300, false));
        let there = evidence_from(&mut archive, from);
        if places.len() == 1 {
            assert_eq!(there, whole);
            assert_eq!(
                archive.lost_of(from..u64::MAX),
                archive.first_seq() - whole.last().unwrap().0 - 1
            );
        }
        let mark = archive.mark().unwrap().unwrap();
        assert!(mark.first_seq > from);
        assert_eq!(chain_of(&there, &mut archive), Chain(mark.chain));
        archive.hold(Some(archive.next_seq()));
        for _ in 0..500 {
            archive.hold(Some(archive.next_seq()));
            put(&mut archive, VERDICT, &[1; 300]).unwrap();
        }
    }
}

/// The newest entries of the journal are damaged at rest. Those that are evidence are put back from the ring, each as it
/// was; behind others the journal goes on with the next number that nobody has had. The ring stays in any case, and
/// another start finds both as they are.
#[test]
fn what_the_journal_has_lost_at_its_end_costs_no_ring() {
    // What stands at the end, how many of the newest are damaged, and how many of them are gone.
    let cases: [(&[u8], usize, u64); 5] = [
        (&[NOISE, VERDICT], 1, 0),
        (&[VERDICT, VERDICT], 2, 0),
        (&[VERDICT, NOISE], 2, 0),
        (&[NOISE, VERDICT], 2, 2),
        (&[VERDICT, NOISE, VERDICT], 3, 2),
    ];
    for (kinds, damaged, gone) in cases {
        let mut archive = new();
        for n in 0..30 {
            put(
                &mut archive,
                if n % 3 == 0 { VERDICT } else { NOISE },
                &[n; 20],
            )
            .unwrap();
        }
        for (n, kind) in (30..).zip(kinds) {
            put(&mut archive, *kind, &[n; 20]).unwrap();
        }
        let next = archive.next_seq();
        let (before, chain, mark) = (
            all(&mut archive),
            archive.chain_head(),
            archive.mark().unwrap(),
        );
        let end = archive.journal.extent.tail as usize;
        let (mut stream, evidence) = flashes(archive);
        // Each entry takes 52 bytes.
        for n in 0..damaged {
            stream.data[end - 52 * n - 20] ^= 1;
        }
        let (mut archive, _) = Archive::open(stream).unwrap();
        assert_eq!(archive.next_seq(), next - damaged as u64);
        let found = archive.keep_evidence(evidence, &mut [0; ROOM]).unwrap();
        assert_eq!(found.damaged_entries, gone, "{kinds:?} {damaged}");
        assert_eq!(archive.mark().unwrap(), mark);
        let is_noise_last = kinds.last() == Some(&NOISE);
        assert_eq!(archive.next_seq(), next - u64::from(is_noise_last));
        if gone == 0 && !is_noise_last {
            assert_eq!(
                (all(&mut archive), archive.chain_head()),
                (before.clone(), chain)
            );
        }
        let (stream, evidence) = flashes(archive);
        let mut archive = open(stream, evidence);
        put(&mut archive, VERDICT, b"goes on").unwrap();
        let (next, mark) = (archive.next_seq(), archive.mark().unwrap());
        let (stream, evidence) = flashes(archive);
        let mut archive = open(stream, evidence);
        assert_eq!((archive.next_seq(), archive.mark().unwrap()), (next, mark));
        // When noise has lapped the journal, every piece of evidence is there, once.
        while archive.first_seq() < next {
            put(&mut archive, NOISE, &[7; 900]).unwrap();
        }
        let found = evidence_from(&mut archive, 0);
        let mut expected: Vec<_> = before.into_iter().filter(|of| of.1 == VERDICT).collect();
        expected.push((next - 1, VERDICT, b"goes on".to_vec()));
        assert_eq!(found, expected, "{kinds:?} {damaged}");
        let chain = Chain(archive.mark().unwrap().unwrap().chain);
        assert_eq!(chain_of(&found, &mut archive), chain);
    }
}

/// An empty journal, and one of another history that is shorter, get nothing from a ring: it is told that it is not theirs.
#[test]
fn a_ring_that_is_ahead_of_another_journal_is_refused() {
    let mut archive = new();
    for n in 0..9 {
        put(&mut archive, VERDICT, &[n; 20]).unwrap();
    }
    let (_, ring) = flashes(archive);
    for entries in 0..3 {
        let (mut other, _) = Archive::open(MockFlash::new(STREAM)).unwrap();
        for n in 0..entries {
            put(&mut other, VERDICT, &[n + 100; 20]).unwrap();
        }
        let refused = other.keep_evidence(ring.clone(), &mut [0; ROOM]);
        assert_eq!(refused, Err(ArchiveFault::OtherJournal), "{entries}");
        assert_eq!(other.next_seq(), u64::from(entries));
    }
}
