//! Honest files pass, and whatever is done to one is found, and where.

use umi_core::journal::{ERASED, Flash, Gap, Geometry, OVERHEAD, encode_entry};
use umi_core::trust::board_key::{BoardKey, NoEntropy};
use umi_core::units::Micros;
use umi_protocol::job::name;
use umi_protocol::message::MAX_RECORD;

use super::*;

mod evidence;

/// Flash in memory, for keys.
struct Ram(Vec<u8>);

impl Flash for Ram {
    type Error = ();

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: 2,
            sector_size: 4096,
            write_size: 1,
            page_size: 256,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ()> {
        into.copy_from_slice(&self.0[addr as usize..][..into.len()]);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ()> {
        self.0[addr as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), ()> {
        self.0[sector as usize * 4096..][..4096].fill(ERASED);
        Ok(())
    }
}

fn board_key(which: u8) -> BoardKey {
    let draw = |seed: &mut [u8; 32]| {
        for (place, n) in seed.iter_mut().zip(0..) {
            *place = which.wrapping_mul(31) ^ n;
        }
        Ok::<(), NoEntropy>(())
    };
    BoardKey::open(Ram(vec![ERASED; 8192]), draw).unwrap()
}

/// Numbers that look random, the same in each run (Marsaglia, xorshift64*).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) % end as u64) as usize
    }
}

/// What an entry is made of: it is chained and, if it is a head, signed when it is encoded.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a test has few of them")]
enum Made {
    Plain {
        t_us: u64,
        record: Record,
    },
    Head {
        t_us: u64,
        boot: u32,
    },
    /// An entry as it was, number and chain value aside.
    Copied {
        kind: u8,
        t_us: u64,
        payload: Vec<u8>,
    },
    /// The board has overwritten the entries before this one since they were written.
    Overwritten {
        entries: Vec<Made>,
    },
}

/// A file and where its entries stand.
#[derive(Clone)]
struct Journal {
    file: Vec<u8>,
    /// Offset, number, and chain value before each entry.
    places: Vec<(usize, u64, Chain)>,
    heads: Vec<Head>,
}

struct Writer<'a> {
    key: &'a BoardKey,
    journal: Journal,
    seq: u64,
    chain: Chain,
    first_seq: u64,
    nonce: Option<[u8; 32]>,
}

impl Writer<'_> {
    fn entry(&mut self, kind: u8, t_us: u64, payload: &[u8], is_kept: bool) {
        let entry = Entry {
            seq: self.seq,
            t: Micros(t_us),
            kind,
            payload,
        };
        let mut room = vec![0; payload.len() + OVERHEAD];
        let before = self.chain;
        encode_entry(&entry, &mut self.chain, &mut room).unwrap();
        if is_kept {
            let at = self.journal.file.len();
            self.journal.places.push((at, self.seq, before));
            self.journal.file.extend(room);
        }
        self.seq = self.seq.wrapping_add(1);
    }

    fn made(&mut self, made: &Made, is_kept: bool) {
        let mut room = [0; MAX_RECORD];
        match made {
            Made::Plain { t_us, record } => {
                let payload = postcard::to_slice(record, &mut room).unwrap();
                self.entry(record.kind(), *t_us, payload, is_kept);
            }
            Made::Copied {
                kind,
                t_us,
                payload,
            } => self.entry(*kind, *t_us, payload, is_kept),
            Made::Head { t_us, boot } => {
                let mut head = Head {
                    seq: self.seq,
                    t_us: *t_us,
                    first_seq: self.first_seq,
                    chain: self.chain.0,
                    boot: *boot,
                    key: self.key.public(),
                    image: [0; 32],
                    serial: name("0042"),
                    firmware: name("0.1.0"),
                    nonce: self.nonce,
                    signature: [[0; 32]; 2],
                    evidence: None,
                };
                head.signature = self.key.sign(&head.signed());
                self.journal.heads.push(head.clone());
                let record = Record::Head(head);
                let payload = postcard::to_slice(&record, &mut room).unwrap();
                self.entry(record.kind(), *t_us, payload, is_kept);
            }
            Made::Overwritten { entries } => {
                let first = self.seq;
                for made in entries {
                    self.made(made, false);
                }
                self.first_seq = self.seq;
                let gap = Gap {
                    first,
                    next: self.seq,
                    chain_before: self.chain,
                };
                self.journal.file.extend(gap.encode());
            }
        }
    }
}

/// The file of these entries, as a board with this key would have written them.
fn written(key: &BoardKey, made: &[Made], nonce: Option<[u8; 32]>) -> Journal {
    written_from(17, key, made, nonce)
}

/// A file whose heads are another board's is known as that also where its signatures are wrong.
#[test]
fn the_key_of_a_broken_file_is_known() {
    let (ours, other) = (board_key(1), board_key(2));
    let journal = written(&ours, &entries(&mut Random(9), 60, 20), None);
    let broken = forged(&journal, |made| {
        made.remove(3);
    });
    for file in [&journal.file, &broken] {
        assert_eq!(other_key(file, &ours.public()), None);
        assert_eq!(other_key(file, &other.public()), Some(ours.public()));
    }
    assert_eq!(
        verify(&broken, None, None).unwrap_err().code,
        "head_signature"
    );
}

/// The same, whose entries begin with this one.
fn written_from(first_seq: u64, key: &BoardKey, made: &[Made], nonce: Option<[u8; 32]>) -> Journal {
    let header = FileHeader {
        first_seq,
        chain_before: Chain([7; 32]),
        nonce,
    };
    let mut writer = Writer {
        key,
        journal: Journal {
            file: header.encode().to_vec(),
            places: Vec::new(),
            heads: Vec::new(),
        },
        seq: header.first_seq,
        chain: header.chain_before,
        first_seq: 3,
        nonce,
    };
    for made in made {
        writer.made(made, true);
    }
    writer.journal
}

/// As many entries, with a head behind each so many, and one at the end. No two are the same.
fn entries(random: &mut Random, count: usize, every: usize) -> Vec<Made> {
    entries_of(3, random, count, every)
}

/// The same, of this start of the board.
fn entries_of(boot: u32, random: &mut Random, count: usize, every: usize) -> Vec<Made> {
    let mut made: Vec<_> = (0..count - 1)
        .map(|n| {
            let t_us = 1000 * n as u64 + random.below(1000) as u64;
            if n % every == every - 1 {
                return Made::Head { t_us, boot };
            }
            let record = match random.below(4) {
                0 => Record::Time,
                1 => Record::BytesLost {
                    count: random.below(1000) as u32,
                },
                _ => Record::Bytes {
                    raw: (0..random.below(60))
                        .map(|_| random.below(256) as u8)
                        .collect(),
                },
            };
            Made::Plain { t_us, record }
        })
        .collect();
    made.push(Made::Head {
        t_us: 1000 * count as u64,
        boot,
    });
    made
}

/// The code, and the first wrong entry.
fn refused(file: &[u8], key: &BoardKey, after: Option<&Head>) -> (&'static str, Option<u64>) {
    let problem = verify(file, Some(key.public()), after).expect_err("a forged file is good");
    let seq = problem
        .details
        .get("seq")
        .and_then(serde_json::Value::as_u64);
    (problem.code, seq)
}

/// An honest file is signed to its end, also by a key that the reader does not know, and behind
/// any head of it that was kept.
#[test]
fn an_honest_file_is_signed() {
    let key = board_key(1);
    let made = entries(&mut Random(5), 300, 40);
    let journal = written(&key, &made, Some([9; 32]));
    for known in [None, Some(key.public())] {
        for after in [None].into_iter().chain(journal.heads.iter().map(Some)) {
            let verified = verify(&journal.file, known, after).unwrap();
            assert!(verified.signed);
            assert_eq!(verified.signed_to, Some(316));
            assert_eq!((verified.stretch.first, verified.stretch.next), (17, 317));
            assert_eq!(verified.key, Some(key.public()));
        }
    }
}

/// Every bit of a file, and where it stands. An entry is looked at with what stands before it,
/// which is as it was.
fn every_bit(count: usize) -> u64 {
    let key = board_key(1);
    let made = entries(&mut Random(6), count, 97);
    let Journal {
        mut file, places, ..
    } = written(&key, &made, Some([9; 32]));
    let end = file.len();
    let ends = places.iter().skip(1).map(|(at, ..)| *at).chain([end]);
    let mut flips = 0;
    for ((at, seq, before), end) in places.iter().zip(ends) {
        for bit in at * 8..end * 8 {
            file[bit / 8] ^= 1 << (bit % 8);
            let mut rest = umi_core::journal::EntryIter::new(&file[*at..], *seq, *before);
            let fault = rest.next().unwrap().expect_err("a flipped bit");
            assert_eq!(fault.seq(), *seq, "bit {bit}");
            file[bit / 8] ^= 1 << (bit % 8);
            flips += 1;
        }
    }
    for bit in 0..places[0].0 * 8 {
        file[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(refused(&file, &key, None), ("journal_header_damaged", None));
        file[bit / 8] ^= 1 << (bit % 8);
        flips += 1;
    }
    flips
}

#[test]
fn every_flipped_bit_is_found_at_its_entry() {
    assert!(every_bit(120) > 30_000);
}

/// The whole way through the file, for some bits of it.
#[test]
fn flipped_bits_are_told_by_code_and_entry() {
    let (key, mut random) = (board_key(1), Random(8));
    let made = entries(&mut random, 200, 50);
    let journal = written(&key, &made, None);
    for _ in 0..100 {
        let mut file = journal.file.clone();
        let first = journal.places[0].0;
        let at = first + random.below(file.len() - first);
        file[at] ^= 1 << random.below(8);
        let place = journal.places.iter().rfind(|(place, ..)| *place <= at);
        let (code, seq) = refused(&file, &key, None);
        assert_eq!(seq, place.map(|place| place.1), "{code}");
        let codes = [
            "entry_damaged",
            "entry_cut_short",
            "entries_missing",
            "chain_broken",
        ];
        assert!(codes.contains(&code), "{code}");
    }
}

/// A forger who makes check values and chain anew, but has no key: entries of one file, changed.
fn forged(journal: &Journal, change: impl FnOnce(&mut Vec<Made>)) -> Vec<u8> {
    let (header, mut entries) = decode_file(&journal.file).unwrap();
    let mut made: Vec<_> = entries
        .by_ref()
        .map(Result::unwrap)
        .map(|entry| Made::Copied {
            kind: entry.kind,
            t_us: entry.t.0,
            payload: entry.payload.to_vec(),
        })
        .collect();
    change(&mut made);
    let mut forged = written(&board_key(0), &made, header.nonce);
    forged.file[..umi_core::journal::FILE_HEADER_SIZE].copy_from_slice(&header.encode());
    forged.file
}

/// How often each was tried.
fn forgeries(count: usize, every: usize, times: usize) {
    let (key, mut random) = (board_key(1), Random(11));
    let made = entries(&mut random, count, every);
    let journal = written(&key, &made, None);
    let is_head = |place: usize| matches!(made[place], Made::Head { .. });
    // The first head at or behind a place: where the forgery must show at the latest.
    let head_seq = |place: usize| {
        (place..count)
            .find(|place| is_head(*place))
            .map(|place| place as u64 + 17)
    };
    for turn in 0..times * 6 {
        if turn > 0 && turn % 6000 == 0 {
            println!("{turn} forgeries found");
        }
        let place = random.below(count - 1);
        let other = random.below(count - 1);
        if place == other {
            continue;
        }
        let byte = random.below(1000);
        let mut shift = 0;
        let file = forged(&journal, |made| match turn % 6 {
            0 => {
                made.remove(place);
                shift = 1;
            }
            1 => made.swap(place, other),
            2 => {
                let copy = made[place].clone();
                made.insert(place, copy);
            }
            3 => {
                let copy = made[other].clone();
                made.insert(place, copy);
            }
            4 => {
                if let Made::Copied { payload, t_us, .. } = &mut made[place] {
                    match payload.len() {
                        0 => *t_us ^= 1,
                        len => payload[byte % len] ^= 1 << (byte % 8),
                    }
                }
            }
            _ => {
                if let Made::Copied { t_us, .. } = &mut made[place] {
                    *t_us ^= 1 << (byte % 40);
                }
            }
        });
        let (code, seq) = refused(&file, &key, None);
        assert_eq!(code, "head_signature", "{turn}: {place}, {other}");
        let first = if turn % 6 == 1 {
            place.min(other)
        } else {
            place
        };
        // A head that was taken away or moved is missed by the next one at the latest.
        let latest = (first..count).filter(|place| is_head(*place)).nth(1);
        let latest = latest.map_or(head_seq(first).unwrap(), |place| place as u64 + 17) + 1;
        let seq = seq.unwrap();
        assert!(
            (first as u64 + 17 - shift..=latest).contains(&seq),
            "{turn}: {place}, {other}: {seq} not to {latest}"
        );
    }
}

#[test]
fn forgeries_with_a_right_chain_are_found_by_the_signature() {
    forgeries(400, 40, 40);
}

/// Entries removed, swapped, put in and doubled as they stand, without a chain made anew: each is
/// found where it is.
fn clumsy(count: usize, times: usize) {
    let (key, mut random) = (board_key(1), Random(12));
    let made = entries(&mut random, count, 97);
    let journal = written(&key, &made, None);
    let end = journal.file.len();
    let starts = journal.places.iter().map(|(at, ..)| *at);
    let pieces: Vec<&[u8]> = starts
        .clone()
        .zip(starts.skip(1).chain([end]))
        .map(|(from, to)| &journal.file[from..to])
        .collect();
    let header = &journal.file[..journal.places[0].0];
    for turn in 0..times {
        // The last entry is not taken away: that is a file that was cut.
        let (place, other) = (random.below(count - 1), random.below(count - 1));
        if place == other {
            continue;
        }
        let mut changed = pieces.clone();
        let first = match turn % 4 {
            0 => {
                changed.remove(place);
                place
            }
            1 => {
                changed.swap(place, other);
                place.min(other)
            }
            2 => {
                changed.insert(place, pieces[place]);
                place + 1
            }
            _ => {
                changed.insert(place, pieces[other]);
                place
            }
        };
        let file = [header, &changed.concat()].concat();
        let (code, seq) = refused(&file, &key, None);
        let codes = ["entry_damaged", "entries_missing", "chain_broken"];
        assert!(codes.contains(&code), "{turn}: {code}");
        // What is missing is named by the entry that is missing, or by the one in its place.
        let seq = seq.unwrap();
        let at = first as u64 + 17;
        assert!(
            (at - 1..=at + 1).contains(&seq),
            "{turn}: {code} {seq}, {at}"
        );
    }
}

#[test]
fn clumsy_changes_are_found_where_they_are() {
    clumsy(400, 200);
}

/// As the three above, of a journal of 10 000 records: every bit; 10^4 removals, swaps, insertions
/// and doublings as they stand; and 10^4 with the chain made anew, with 5000 edits besides.
/// `cargo test --release -p umi-client long_every -- --ignored --nocapture`.
#[test]
#[ignore = "twenty minutes"]
fn long_every_bit_of_ten_thousand_records() {
    let flips = every_bit(10_000);
    println!("{flips} flipped bits found");
}

#[test]
#[ignore = "twenty minutes"]
fn long_every_forgery_of_ten_thousand_records() {
    clumsy(10_000, 10_000);
    println!("10000 clumsy changes found");
    forgeries(10_000, 97, 2_500);
}

/// What is cut off behind, a file of another board, an older one: each by its name.
#[test]
fn what_is_cut_or_of_another_board_is_named() {
    let (key, other) = (board_key(1), board_key(2));
    let made = entries(&mut Random(5), 300, 40);
    let journal = written(&key, &made, None);
    let cut = |entries: usize| &journal.file[..journal.places[entries].0];
    // Behind the last head: told without a key, refused with one.
    let verified = verify(cut(250), None, None).unwrap();
    assert!(!verified.signed);
    assert_eq!(verified.signed_to, Some(239 + 17));
    assert_eq!(
        refused(cut(250), &key, None),
        ("head_missing", Some(240 + 17))
    );
    // Right behind a head it is a shorter, honest file: a head that was kept tells.
    let kept = journal.heads.last().unwrap();
    assert!(verify(cut(240), Some(key.public()), None).unwrap().signed);
    assert_eq!(
        refused(cut(240), &key, Some(kept)),
        ("head_older", Some(257))
    );
    // The nonce of the pull tells, too.
    let asked = written(&key, &made, Some([9; 32]));
    let mut short = asked.file[..asked.places[240].0].to_vec();
    let header = FileHeader {
        nonce: Some([8; 32]),
        ..FileHeader::decode(&short).unwrap().0
    };
    short[..84].copy_from_slice(&header.encode());
    assert_eq!(refused(&short, &key, None).0, "head_missing");

    assert_eq!(
        refused(&journal.file, &other, None),
        ("head_other_board", Some(39 + 17))
    );
    let foreign = written(&other, &made, None);
    let kept = &journal.heads[2];
    let told = verify(&foreign.file, None, Some(kept)).unwrap_err();
    assert_eq!(told.code, "head_other_board");
    // The board went back to an older memory and went on from there.
    let mut again = made[..140].to_vec();
    again.extend(entries(&mut Random(99), 200, 30));
    let again = written(&key, &again, None);
    let kept = &journal.heads[5];
    assert_eq!(
        refused(&again.file, &key, Some(kept)),
        ("head_older", Some(kept.seq))
    );
    // A kept head that somebody has changed is no head.
    let changed = Head {
        seq: 1,
        ..kept.clone()
    };
    assert_eq!(
        refused(&journal.file, &key, Some(&changed)).0,
        "head_signature"
    );
}

/// Entries at the end of all numbers: nobody's board writes so many, and nothing breaks.
#[test]
fn the_last_number_of_all_breaks_nothing() {
    let (key, made) = (board_key(1), entries(&mut Random(9), 6, 2));
    for first in (0..8).map(|back| u64::MAX - back) {
        let journal = written_from(first, &key, &made, None);
        for bytes in (0..journal.file.len())
            .step_by(7)
            .chain([journal.file.len()])
        {
            if let Ok(verified) = verify(&journal.file[..bytes], None, None) {
                assert!(verified.stretch.held() <= 8);
            }
        }
    }
}

/// A file that begins behind the place of a kept head does not show that it goes on from there: a board whose older
/// memory was put back signs with later starts, too.
#[test]
fn a_file_behind_a_kept_head_shows_nothing_of_it() {
    let key = board_key(1);
    let kept = written(&key, &entries(&mut Random(5), 60, 10), None);
    let later = written_from(90, &key, &entries_of(7, &mut Random(6), 60, 10), None);
    let after = kept.heads.last();
    assert!(
        verify(&later.file, Some(key.public()), None)
            .unwrap()
            .signed
    );
    assert_eq!(
        refused(&later.file, &key, after),
        ("head_not_shown", Some(90))
    );
}

/// A journal without heads says so, and a key demands them.
#[test]
fn an_unsigned_file_says_so() {
    let made: Vec<_> = (0..20)
        .map(|n| Made::Plain {
            t_us: n,
            record: Record::Time,
        })
        .collect();
    let journal = written(&board_key(1), &made, None);
    let verified = verify(&journal.file, None, None).unwrap();
    assert_eq!(
        (verified.signed, verified.signed_to, verified.key),
        (false, None, None)
    );
    assert_eq!(
        refused(&journal.file, &board_key(1), None),
        ("head_missing", Some(17))
    );
}

/// Entries that the board had overwritten are named; entries that it still held when it signed
/// were left out by somebody else.
#[test]
fn a_gap_is_the_boards_or_a_forgery() {
    let (key, mut random) = (board_key(1), Random(21));
    let mut made = entries(&mut random, 100, 30);
    made.push(Made::Overwritten {
        entries: entries(&mut random, 50, 30),
    });
    made.extend(entries(&mut random, 100, 30));
    let journal = written(&key, &made, None);
    let verified = verify(&journal.file, Some(key.public()), None).unwrap();
    assert!(verified.signed);
    assert_eq!(verified.stretch.overwritten, [(117, 167)]);

    let honest = written(&key, &entries(&mut random, 100, 30), None);
    let gap = Gap {
        first: 17 + 50,
        next: 17 + 60,
        chain_before: honest.places[60].2,
    };
    let (from, to) = (honest.places[50].0, honest.places[60].0);
    let left_out = [&honest.file[..from], &gap.encode(), &honest.file[to..]].concat();
    assert_eq!(
        refused(&left_out, &key, None),
        ("entries_missing", Some(67))
    );
    // A pull that ended without a head may have been overtaken: nobody vouches for that file.
    assert!(!verify(&left_out, None, None).unwrap().signed);
    let asked = written(&key, &entries(&mut random, 100, 30), Some([7; 32]));
    let gap = Gap {
        chain_before: asked.places[60].2,
        ..gap
    };
    let (from, to) = (asked.places[50].0, asked.places[60].0);
    let left_out = [&asked.file[..from], &gap.encode(), &asked.file[to..]].concat();
    let told = verify(&left_out, None, None).unwrap_err();
    assert_eq!(told.code, "entries_missing");
}

/// Entries before a gap with no head between: who edits a file can put them there. They are not
/// vouched for, whatever heads stand behind the gap.
#[test]
fn what_stands_before_a_gap_without_a_head_is_not_signed() {
    let (key, mut random) = (board_key(1), Random(22));
    let mut made = entries(&mut random, 100, 30);
    made.push(Made::Overwritten {
        entries: entries(&mut random, 50, 30),
    });
    made.extend(entries(&mut random, 100, 30));
    let journal = written(&key, &made, None);
    let behind = journal.places.iter().find(|place| place.1 == 167).unwrap();
    for (kept, since) in [(30, None), (31, Some(47)), (50, Some(47))] {
        let gap = Gap {
            first: 17 + kept as u64,
            next: 167,
            chain_before: behind.2,
        };
        let before = &journal.file[..journal.places[kept].0];
        let file = [before, &gap.encode(), &journal.file[behind.0..]].concat();
        assert_eq!(verify(&file, None, None).unwrap().signed, since.is_none());
        let told = verify(&file, Some(key.public()), None);
        match since {
            None => assert!(told.unwrap().signed),
            Some(_) => assert_eq!(refused(&file, &key, None), ("head_missing", since)),
        }
    }
}

/// 1000 honest files with restarts and overwriting: none is refused.
#[test]
fn no_honest_file_is_refused() {
    let key = board_key(1);
    let mut random = Random(31);
    let mut gaps = 0;
    for _ in 0..1000 {
        let mut made = Vec::new();
        for boot in 3..4 + random.below(3) as u32 {
            if random.below(4) == 0 {
                let count = 1 + random.below(20);
                let entries = entries_of(boot, &mut random, count.max(2), 5);
                made.push(Made::Overwritten { entries });
                gaps += 1;
            }
            let count = 2 + random.below(20);
            let every = 1 + random.below(9);
            made.extend(entries_of(boot, &mut random, count, every));
        }
        let journal = written(&key, &made, None);
        let after = journal.heads.get(random.below(journal.heads.len()));
        let after = after.filter(|head| {
            head.first_seq <= 17 && journal.places.iter().any(|place| place.1 == head.seq)
        });
        let verified = verify(&journal.file, Some(key.public()), after).unwrap();
        assert!(verified.signed);
    }
    assert!(gaps > 100);
}
