//! Honest files pass, and whatever is done to one is found, and where.

use umi_core::board_key::{BoardKey, NoEntropy};
use umi_core::journal::{ERASED, Flash, Gap, Geometry, OVERHEAD, encode_entry};
use umi_core::units::Micros;
use umi_protocol::job::name;
use umi_protocol::message::MAX_RECORD;

use super::*;

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
        self.seq += 1;
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
    let header = FileHeader {
        first_seq: 17,
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

/// A board that keeps evidence apart: what noise has overwritten is gaps, and its heads say so.
struct EvidenceBoard {
    key: BoardKey,
    seq: u64,
    chain: Chain,
    number: u64,
    evidence: Chain,
    all: Vec<Placed>,
}

/// An entry as it was written.
#[derive(Clone)]
struct Placed {
    seq: u64,
    before: Chain,
    kind: u8,
    raw: Vec<u8>,
    /// Its number among the evidence, and the chain of that before it.
    piece: Option<(u64, Chain)>,
}

impl EvidenceBoard {
    fn new(key: BoardKey) -> Self {
        let (chain, evidence) = (Chain::GENESIS, Chain::GENESIS);
        let all = Vec::new();
        Self {
            key,
            seq: 0,
            chain,
            number: 0,
            evidence,
            all,
        }
    }

    fn put(&mut self, record: &Record) {
        let (seq, before) = (self.seq, self.chain);
        let mut room = [0; MAX_RECORD];
        let payload = postcard::to_slice(record, &mut room).unwrap();
        let t = Micros(10 * seq);
        let kind = record.kind();
        let entry = Entry {
            seq,
            t,
            kind,
            payload,
        };
        let mut raw = vec![0; payload.len() + OVERHEAD];
        encode_entry(&entry, &mut self.chain, &mut raw).unwrap();
        let piece_before = (self.number, self.evidence);
        if Record::is_evidence(kind) {
            let payload = [&seq.to_le_bytes()[..], &before.0, payload].concat();
            let piece = Entry {
                seq: self.number,
                t,
                kind,
                payload: &payload,
            };
            let mut room = vec![0; payload.len() + OVERHEAD];
            encode_entry(&piece, &mut self.evidence, &mut room).unwrap();
            self.number += 1;
        }
        self.all.push(Placed {
            seq,
            before,
            kind,
            raw,
            piece: Record::is_evidence(kind).then_some(piece_before),
        });
        self.seq += 1;
    }

    /// Signs, when the journal holds entries from `first_seq` on and all evidence.
    fn head(&mut self, first_seq: u64, nonce: Option<[u8; 32]>) {
        self.head_with(first_seq, 0, nonce);
    }

    /// As [`Self::head`], when the board has overwritten the evidence before entry `oldest`, too.
    fn head_with(&mut self, first_seq: u64, oldest: u64, nonce: Option<[u8; 32]>) {
        let oldest = self.all.iter().find_map(|of| {
            let (number, chain) = of.piece.filter(|_| of.seq >= oldest)?;
            Some((of.seq, number, chain))
        });
        let (first, number, chain) = oldest.unwrap_or((self.seq, self.number, self.evidence));
        let mut head = Head {
            seq: self.seq,
            t_us: 10 * self.seq,
            first_seq,
            chain: self.chain.0,
            boot: 1,
            key: self.key.public(),
            image: [0; 32],
            serial: name("0042"),
            firmware: name("0.1.0"),
            nonce,
            signature: [[0; 32]; 2],
            evidence: Some(umi_protocol::head::EvidenceMark {
                first: number,
                first_seq: first,
                first_chain: chain.0,
                next: self.number,
                chain: self.evidence.0,
            }),
        };
        head.signature = self.key.sign(&head.signed());
        self.put(&Record::Head(head));
    }

    /// Some noise with evidence in it.
    fn noise(&mut self, random: &mut Random, count: usize) {
        for _ in 0..count {
            let record = match random.below(7) {
                0 => Record::CorrectionBegun {
                    setup: random.below(1000) as u32,
                },
                1 => Record::Acknowledged {
                    seq: random.below(1000) as u64,
                    lost: 0,
                },
                _ => Record::BytesLost {
                    count: random.below(1000) as u32,
                },
            };
            self.put(&record);
        }
    }
}

/// The file of these entries, with gaps where some are missing.
fn file_of(entries: &[Placed], nonce: Option<[u8; 32]>) -> Vec<u8> {
    let first = &entries[0];
    let header = FileHeader {
        first_seq: first.seq,
        chain_before: first.before,
        nonce,
    };
    let mut file = header.encode().to_vec();
    let mut seq = first.seq;
    for entry in entries {
        if entry.seq > seq {
            let gap = Gap {
                first: seq,
                next: entry.seq,
                chain_before: entry.before,
            };
            file.extend(gap.encode());
        }
        file.extend(&entry.raw);
        seq = entry.seq + 1;
    }
    file
}

/// An entry with another payload, chained to what stands before it.
fn changed(entry: &Placed, byte: usize) -> Placed {
    changed_at(entry, (entry.seq, entry.before), byte)
}

/// An entry with another payload as entry `seq` behind the chain value `before`.
fn changed_at(entry: &Placed, (seq, before): (u64, Chain), byte: usize) -> Placed {
    let found = umi_core::journal::EntryIter::new(&entry.raw, entry.seq, entry.before)
        .next()
        .unwrap()
        .unwrap();
    let mut payload = found.payload.to_vec();
    let at = 1 + byte % (payload.len() - 1);
    payload[at] ^= 1;
    let mut chain = before;
    let mut raw = vec![0; payload.len() + OVERHEAD];
    let again = Entry {
        seq,
        payload: &payload,
        ..found
    };
    encode_entry(&again, &mut chain, &mut raw).unwrap();
    Placed {
        seq,
        before,
        kind: entry.kind,
        raw,
        piece: None,
    }
}

/// Of what noise has overwritten, the evidence is proven: honest files with gaps hold, and a piece
/// that is taken out, changed, doubled or put in is found. What is no evidence and stands before a
/// gap without a head is not vouched for.
#[test]
fn evidence_between_gaps_is_proven() {
    let mut random = Random(77);
    let mut found = 0;
    for turn in 0..120 {
        let mut board = EvidenceBoard::new(board_key(1));
        let key = Some(board.key.public());
        for _ in 0..1 + random.below(3) {
            let count = 5 + random.below(60);
            board.noise(&mut random, count);
            board.head(0, None);
        }
        let count = 5 + random.below(60);
        board.noise(&mut random, count);
        // Overwritten up to somewhere; then the host asks.
        let oldest = random.below(board.all.len()) as u64;
        board.head(oldest, Some([9; 32]));
        let kept: Vec<_> = board
            .all
            .iter()
            .filter(|of| of.seq >= oldest || Record::is_evidence(of.kind))
            .cloned()
            .collect();
        let honest = file_of(&kept, Some([9; 32]));
        let verified = verify(&honest, key, None).unwrap();
        assert!(verified.signed, "{turn}");
        let lost: u64 = verified
            .stretch
            .overwritten
            .iter()
            .map(|(a, b)| b - a)
            .sum();
        assert_eq!(lost + kept.len() as u64, board.seq - kept[0].seq);

        // Pieces that only the chain of evidence proves: no head in the same stretch behind them.
        let lonely: Vec<_> = (1..kept.len())
            .filter(|at| {
                let of = &kept[*at];
                let next = kept.get(at + 1);
                of.seq < oldest && of.kind != HEAD && next.is_some_and(|next| next.seq > of.seq + 1)
            })
            .collect();
        for at in lonely {
            let mut less = kept.clone();
            less.remove(at);
            let mut other = kept.clone();
            other[at] = changed(&kept[at], random.below(100));
            let mut forgeries = vec![less, other];
            let seq = kept[at].seq + 1;
            if kept[at + 1].seq > seq + 1 {
                // Chained to what it is put behind, with room for a gap behind it.
                let before = board.all[usize::try_from(seq).unwrap()].before;
                let mut more = kept.clone();
                more.insert(at + 1, changed_at(&kept[at], (seq, before), 0));
                forgeries.push(more);
            }
            for forged in forgeries {
                let file = file_of(&forged, Some([9; 32]));
                for known in [None, key] {
                    let refused = verify(&file, known, None).unwrap_err();
                    assert_eq!(refused.code, "head_signature", "{turn}, {at}");
                    found += 1;
                }
            }
        }
        // Bytes that nobody vouches for, put before a gap.
        if let Some(at) = (1..kept.len()).find(|at| kept[*at].seq > kept[at - 1].seq + 1) {
            let mut forged = kept.clone();
            let before = &kept[at - 1];
            let made = &board.all[usize::try_from(before.seq).unwrap() + 1];
            forged.insert(at, made.clone());
            if forged[at].seq + 1 < forged[at + 1].seq {
                let file = file_of(&forged, Some([9; 32]));
                assert!(!verify(&file, None, None).unwrap().signed);
                assert_eq!(verify(&file, key, None).unwrap_err().code, "head_missing");
            }
        }
    }
    assert!(found > 500, "{found}");
}

/// A file that is pulled in two goes, with evidence overwritten between them: the heads that were
/// signed while the board still had it name it, and the last one that it is gone. It holds, and says
/// what is missing. Where the last head says that the board has it, somebody took it out.
#[test]
fn evidence_that_was_overwritten_between_two_pulls_is_no_forgery() {
    let mut random = Random(78);
    let (mut doubts, mut forgeries) = (0, 0);
    for turn in 0..200 {
        let mut board = EvidenceBoard::new(board_key(1));
        let key = Some(board.key.public());
        let count = 5 + random.below(40);
        board.noise(&mut random, count);
        board.head(0, None);
        let pulled = board.seq;
        for _ in 0..2 + random.below(3) {
            let count = 5 + random.below(40);
            board.noise(&mut random, count);
            board.head(0, None);
        }
        // Overwritten up to somewhere behind the first pull; then the host asks again.
        let oldest = pulled + 1 + random.below((board.seq - pulled) as usize - 1) as u64;
        let mut other = EvidenceBoard {
            key: board_key(1),
            all: board.all.clone(),
            ..board
        };
        board.head_with(oldest, oldest, Some([9; 32]));
        let held = |of: &&Placed| of.seq < pulled || of.seq >= oldest;
        let kept: Vec<_> = board.all.iter().filter(held).cloned().collect();
        let verified = verify(&file_of(&kept, Some([9; 32])), key, None);
        let verified = verified.unwrap_or_else(|refused| panic!("{turn}: {refused:?}"));
        assert!(verified.signed);
        assert_eq!(verified.stretch.overwritten, [(pulled, oldest)]);
        let is_lost = |of: &&Placed| of.piece.is_some() && !held(of);
        let lost = board.all.iter().filter(is_lost).count();
        doubts += lost;

        // The same file, from a board whose last head says that it still has all evidence.
        other.head(oldest, Some([9; 32]));
        let kept: Vec<_> = other.all.iter().filter(held).cloned().collect();
        let forged = verify(&file_of(&kept, Some([9; 32])), key, None);
        match forged {
            Err(refused) => assert_eq!(refused.code, "head_signature", "{turn}"),
            Ok(_) => assert_eq!(lost, 0, "{turn}"),
        }
        forgeries += usize::from(lost > 0);

        // And what is left of the evidence behind the gap is proven all the same.
        let pieces: Vec<_> = (1..kept.len())
            .filter(|at| kept[*at].seq >= oldest && kept[*at].kind != HEAD)
            .filter(|at| kept[*at].piece.is_some())
            .collect();
        if let Some(at) = pieces.first() {
            let mut less: Vec<_> = board.all.iter().filter(held).cloned().collect();
            less.remove(*at);
            assert!(verify(&file_of(&less, Some([9; 32])), key, None).is_err());
        }
    }
    assert!(doubts > 200 && forgeries > 100, "{doubts}, {forgeries}");
}

/// What stands before a gap is proven by no chain any more where the board says later that it has
/// overwritten it: changed or put in there, it is not vouched for, also with good heads between.
#[test]
fn a_piece_that_later_heads_say_is_gone_is_not_vouched_for() {
    let mut random = Random(79);
    let mut tried = 0;
    for turn in 0..200 {
        let mut board = EvidenceBoard::new(board_key(1));
        let key = Some(board.key.public());
        board.noise(&mut random, 5);
        board.head(0, None);
        let from = board.seq;
        let count = 5 + random.below(20);
        board.noise(&mut random, count);
        board.head(0, None);
        let gone = board.seq;
        for _ in 0..random.below(3) {
            board.noise(&mut random, 5);
            board.head(0, None);
        }
        board.noise(&mut random, 5);
        // It holds nothing any more of what stands before the second head.
        board.head_with(gone, gone, Some([9; 32]));
        let Some(at) = (0..board.all.len()).find(|at| {
            let of = &board.all[*at];
            of.piece.is_some() && of.seq >= from && of.seq + 2 < gone
        }) else {
            continue;
        };
        // A gap behind it takes it out of the chain of entries.
        let mut forged = board.all.clone();
        forged[at] = changed(&board.all[at], random.below(100));
        forged.remove(at + 1);
        let file = file_of(&forged, Some([9; 32]));
        let refused = verify(&file, key, None).expect_err(&format!("{turn}"));
        assert!(
            ["head_missing", "head_signature"].contains(&refused.code),
            "{refused:?}"
        );
        assert!(
            verify(&file, None, None).is_ok_and(|of| !of.signed)
                || refused.code == "head_signature"
        );
        tried += 1;
    }
    assert!(tried > 100, "{tried}");
}
