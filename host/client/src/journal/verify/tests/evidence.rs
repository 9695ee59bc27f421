//! Evidence between gaps: what the board's second chain proves, and what nothing proves.

use super::*;

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
        let mark = umi_protocol::head::EvidenceMark {
            first: number,
            first_seq: first,
            first_chain: chain.0,
            next: self.number,
            chain: self.evidence.0,
        };
        self.sign(first_seq, Some(mark), nonce);
    }

    /// Signs a head that says this of the evidence.
    fn sign(
        &mut self,
        first_seq: u64,
        evidence: Option<umi_protocol::head::EvidenceMark>,
        nonce: Option<[u8; 32]>,
    ) {
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
            evidence,
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

/// A head that says nothing of the evidence vouches for no gap of a board of which another head says that it keeps
/// evidence apart, in the file or kept elsewhere: whoever takes verdicts out behind the last that does, or before the
/// first, has no signed file. Without a gap it is as good as any, and boards that keep none apart sign over gaps.
#[test]
fn a_head_without_a_mark_vouches_for_no_gap() {
    let mut random = Random(81);
    let nonce = Some([9; 32]);
    let (mut board, mut plain) = (
        EvidenceBoard::new(board_key(1)),
        EvidenceBoard::new(board_key(1)),
    );
    let key = Some(board.key.public());
    let is_unsigned = |entries: &[Placed], nonce, after: Option<&Head>| {
        let file = file_of(entries, nonce);
        assert!(!verify(&file, None, after).unwrap().signed);
        assert_eq!(verify(&file, key, after).unwrap_err().code, "head_missing");
    };
    board.noise(&mut random, 30);
    board.head(0, None);
    let marked = board.all.len();
    board.noise(&mut random, 30);
    let behind = board.all.len();
    board.noise(&mut random, 5);
    board.sign(behind as u64, None, nonce);
    assert!(
        verify(&file_of(&board.all, nonce), key, None)
            .unwrap()
            .signed
    );
    // Taken out behind the last head with a mark.
    let (early, late) = (&board.all[..marked], &board.all[behind..]);
    assert!(
        board.all[marked..behind]
            .iter()
            .any(|of| of.piece.is_some())
    );
    is_unsigned(&[early, late].concat(), nonce, None);
    // With that head taken out as well: who has kept it knows what the board keeps.
    let first = &board.all[marked - 1];
    let found = umi_core::journal::EntryIter::new(&first.raw, first.seq, first.before);
    let Ok(Record::Head(kept)) = record(&{ found }.next().unwrap().unwrap()) else {
        panic!("a head stands there")
    };
    let mut forged = file_of(late, nonce);
    let start = FileHeader {
        first_seq: kept.seq,
        chain_before: Chain(kept.chain),
        nonce,
    };
    let gap = Gap {
        first: kept.seq,
        next: late[0].seq,
        chain_before: late[0].before,
    };
    let header = start.encode();
    forged.splice(..header.len(), header.into_iter().chain(gap.encode()));
    assert!(!verify(&forged, None, Some(&kept)).unwrap().signed);
    let refused = verify(&forged, key, Some(&kept)).unwrap_err();
    assert_eq!(refused.code, "head_missing");
    // Taken out before the first head with a mark, where the file does not begin with the oldest piece.
    let bare = board.all.len() - 1;
    board.noise(&mut random, 30);
    let behind = board.all.len();
    board.noise(&mut random, 5);
    board.head(behind as u64, nonce);
    let whole = verify(&file_of(&board.all[bare..], nonce), key, None);
    assert!(whole.unwrap().signed);
    let (early, late) = (&board.all[bare..=bare], &board.all[behind..]);
    is_unsigned(&[early, late].concat(), nonce, None);

    // A board that keeps none apart.
    plain.noise(&mut random, 30);
    plain.sign(0, None, None);
    let early = plain.all.clone();
    plain.noise(&mut random, 30);
    let behind = plain.all.len();
    plain.noise(&mut random, 5);
    plain.sign(behind as u64, None, nonce);
    let file = file_of(&[&early[..], &plain.all[behind..]].concat(), nonce);
    assert!(verify(&file, key, None).unwrap().signed);
}

impl EvidenceBoard {
    /// A board that has been pulled now and then while noise overwrote what it held, and what was pulled.
    fn pulled(random: &mut Random) -> (Self, Vec<Placed>) {
        let mut board = Self::new(board_key(1));
        let (mut first, mut oldest) = (0, 0);
        let mut kept: Vec<Placed> = Vec::new();
        let pulls = 1 + random.below(3);
        for pull in 0..pulls {
            for _ in 0..random.below(3) {
                let count = random.below(25);
                board.noise(random, count);
                board.head_with(first, oldest, None);
            }
            let count = 1 + random.below(25);
            board.noise(random, count);
            // Overwritten up to somewhere; what is no evidence goes before evidence does.
            first += random.below((board.seq - first) as usize) as u64;
            if random.below(2) == 0 {
                oldest += random.below((first - oldest) as usize + 1) as u64;
            }
            let nonce = (pull + 1 == pulls).then_some([9; 32]);
            board.head_with(first, oldest, nonce);
            let next = kept.last().map_or(0, |last| last.seq + 1);
            let held = |of: &&Placed| {
                let is_held = of.seq >= first || of.seq >= oldest && of.piece.is_some();
                of.seq >= next && is_held
            };
            kept.extend(board.all.iter().filter(held).cloned());
        }
        (board, kept)
    }

    /// The number of the oldest piece that the last head says the board still has.
    fn still_has(&self) -> u64 {
        let last = self.all.last().unwrap();
        let found = umi_core::journal::EntryIter::new(&last.raw, last.seq, last.before)
            .next()
            .unwrap()
            .unwrap();
        let Ok(Record::Head(head)) = record(&found) else {
            panic!("a board ends with a head")
        };
        head.evidence.unwrap().first
    }
}

/// Whatever a forger without the key does, with all check values and chains right: a file that passes as signed holds
/// entries that the board has written and no others, and lacks no evidence that its last head says the board has.
#[test]
fn what_passes_as_signed_was_written_by_the_board() {
    let mut random = Random(80);
    let (mut passed, mut refused) = (0, 0);
    for turn in 0..4000 {
        let (board, kept) = EvidenceBoard::pulled(&mut random);
        let key = Some(board.key.public());
        let honest = verify(&file_of(&kept, Some([9; 32])), key, None);
        assert!(honest.is_ok_and(|of| of.signed), "{turn}");

        let mut forged = kept.clone();
        for _ in 0..1 + random.below(3) {
            if forged.len() < 3 {
                break;
            }
            let at = random.below(forged.len() - 1);
            match random.below(5) {
                // Taken out, one or a few.
                0 => drop(forged.drain(at..(at + 1 + random.below(6)).min(forged.len() - 1))),
                // Changed, and cut out of the chain of entries by a gap.
                1 if at + 2 < forged.len() => {
                    forged[at] = changed(&forged[at], random.below(100));
                    forged.remove(at + 1);
                }
                // Changed where a gap stands already, or where the chain finds it.
                2 => forged[at] = changed(&forged[at], random.below(100)),
                // Put in where something is missing.
                3 => {
                    let seq = forged[at].seq + 1;
                    if forged[at + 1].seq > seq {
                        let before = board.all[usize::try_from(seq).unwrap()].before;
                        let like = &board.all[random.below(board.all.len())];
                        let made = changed_at(like, (seq, before), random.below(100));
                        forged.insert(at + 1, made);
                    }
                }
                // All between two heads.
                _ => {
                    let is_head = |of: &Placed| of.kind == HEAD;
                    let from = forged[..at].iter().rposition(is_head).map_or(0, |k| k + 1);
                    let to = at + forged[at..].iter().position(is_head).unwrap();
                    if from > 0 {
                        drop(forged.drain(from..to));
                    }
                }
            }
        }
        let Ok(of) = verify(&file_of(&forged, Some([9; 32])), key, None) else {
            refused += 1;
            continue;
        };
        assert!(of.signed, "{turn}");
        passed += 1;
        for entry in &forged {
            let written = &board.all[usize::try_from(entry.seq).unwrap()];
            assert!(entry.raw == written.raw, "{turn}: entry {}", entry.seq);
        }
        let still = board.still_has();
        for lost in board.all.iter().filter(|of| of.seq > forged[0].seq) {
            let is_there = forged.iter().any(|of| of.seq == lost.seq);
            let is_held = lost.piece.is_some_and(|(number, _)| number >= still);
            assert!(is_there || !is_held, "{turn}: evidence {}", lost.seq);
        }
    }
    assert!(passed > 300 && refused > 1500, "{passed}, {refused}");
}
