//! Pulled journals, by whoever made them. The first byte chooses the view:
//!
//! * any bytes as a file: no panic, and without a signature nothing is signed;
//! * any records in entries whose check values and chain are right, as any program can make them:
//!   they are read, and nothing is signed;
//! * an honest, signed file with a change, made right again but for what takes the board's key: with
//!   the key that the reader has fetched, it is refused, or it is the honest file, or this cut off
//!   behind a head.

use std::sync::OnceLock;

use ed25519_dalek::{Signer as _, SigningKey};
use umi_client::journal::verify::verify;
use umi_client::journal::{self, FileItem};
use umi_client::problem::Problem;
use umi_core::journal::{Chain, Entry, FileHeader, Gap, OVERHEAD, encode_entry};
use umi_core::units::Micros;
use umi_protocol::head::Head;
use umi_protocol::job::name;
use umi_protocol::message::{MAX_RECORD, Record};

/// One input.
pub fn one(data: &[u8]) {
    match data.split_first() {
        Some((view, data)) if view % 3 == 0 => as_file(data),
        Some((view, data)) if view % 3 == 1 => as_file(&forged(data)),
        Some((_, data)) => as_change(data),
        None => {}
    }
}

/// Kind number of a head.
const HEAD: u8 = 24;

fn secret() -> SigningKey {
    SigningKey::from_bytes(&[0xB0; 32])
}

fn as_file(file: &[u8]) {
    let key = secret().verifying_key().to_bytes();
    let mut entries = 0;
    let read = journal::read::<Problem>(file, |item| {
        if let FileItem::Entry(entry) = item {
            entries += 1;
            let _ = journal::record(&entry);
        }
        Ok(())
    });
    let known = verify(file, Some(key), None);
    let Err(refused) = known else {
        panic!("a file without a signature of this key is taken for signed");
    };
    assert!(!refused.code.is_empty() && !refused.message.is_empty());
    // Without a key: what cannot be read is no file that holds.
    match (read, verify(file, None, None)) {
        (Err(_), Ok(_)) => panic!("what cannot be read holds"),
        (_, Ok(held)) => assert!(held.stretch.next - held.stretch.first >= entries),
        (_, Err(_)) => {}
    }
}

/// What an entry is made of.
type Piece = (u8, Vec<u8>);

/// Entries with right check values and a right chain around any payloads: kind, length, payload.
fn forged(mut data: &[u8]) -> Vec<u8> {
    let mut pieces = Vec::new();
    while let [kind, length, rest @ ..] = data {
        let (payload, rest) = rest.split_at(rest.len().min(usize::from(*length)));
        pieces.push((*kind, payload.to_vec()));
        data = rest;
    }
    written(5, &pieces)
}

/// A file of these entries. A gap has the kind 255, and says how many entries are missing.
fn written(first_seq: u64, pieces: &[Piece]) -> Vec<u8> {
    let mut chain = Chain([7; 32]);
    let header = FileHeader {
        first_seq,
        chain_before: chain,
        nonce: None,
    };
    let mut file = header.encode().to_vec();
    let mut seq = first_seq;
    for (kind, payload) in pieces {
        if *kind == u8::MAX {
            let next = seq + 1 + u64::from(payload.first().copied().unwrap_or(0));
            let gap = Gap {
                first: seq,
                next,
                chain_before: chain,
            };
            file.extend(gap.encode());
            seq = next;
            continue;
        }
        let mut room = vec![0; payload.len() + OVERHEAD];
        let entry = Entry {
            seq,
            t: Micros(10 * seq),
            kind: *kind,
            payload,
        };
        let length = encode_entry(&entry, &mut chain, &mut room).expect("short payloads");
        file.extend(&room[..length]);
        seq += 1;
    }
    file
}

/// A signed journal: its entries, and where those of them that are heads end in the file.
struct Honest {
    pieces: Vec<Piece>,
    file: Vec<u8>,
    ends: Vec<usize>,
}

fn honest() -> &'static Honest {
    static HONEST: OnceLock<Honest> = OnceLock::new();
    HONEST.get_or_init(|| {
        let (mut pieces, mut ends) = (Vec::new(), Vec::new());
        for n in 0..40_u64 {
            let record = match n % 8 {
                7 => signed_head(5 + n, &written(5, &pieces)),
                3 => Record::CorrectionBegun { setup: n as u32 },
                _ => Record::BytesLost { count: n as u32 },
            };
            let mut room = [0; MAX_RECORD];
            let payload = postcard::to_slice(&record, &mut room).expect("short records");
            pieces.push((record.kind(), payload.to_vec()));
            if record.kind() == HEAD {
                ends.push(written(5, &pieces).len());
            }
        }
        let file = written(5, &pieces);
        let key = Some(secret().verifying_key().to_bytes());
        assert!(verify(&file, key, None).is_ok_and(|held| held.signed));
        Honest { pieces, file, ends }
    })
}

/// A head over what stands before it.
fn signed_head(seq: u64, before: &[u8]) -> Record {
    let (_, mut entries) = umi_core::journal::decode_file(before).expect("a file");
    entries.by_ref().for_each(drop);
    let mut head = Head {
        seq,
        t_us: 10 * seq,
        first_seq: 5,
        chain: entries.chain_head().0,
        boot: 1,
        key: secret().verifying_key().to_bytes(),
        image: [0; 32],
        serial: name("0042"),
        firmware: name("0.1.0"),
        nonce: None,
        signature: [[0; 32]; 2],
        evidence: None,
    };
    let signature = secret().sign(&head.signed());
    head.signature = [*signature.r_bytes(), *signature.s_bytes()];
    Record::Head(head)
}

/// The honest file with changes: entries taken out, doubled, exchanged, edited, put in, a gap in
/// their place, the numbers shifted.
fn as_change(data: &[u8]) {
    let honest = honest();
    let mut pieces = honest.pieces.clone();
    let (shift, changes) = data.split_first().unwrap_or((&0, data));
    for change in changes.chunks_exact(3).take(6) {
        let place = usize::from(change[1]) % pieces.len();
        match change[0] % 7 {
            0 if pieces.len() > 1 => drop(pieces.remove(place)),
            1 => pieces.insert(place, pieces[place].clone()),
            2 => {
                let other = usize::from(change[2]) % pieces.len();
                pieces.swap(place, other);
            }
            3 => {
                let payload = &mut pieces[place].1;
                let bit = usize::from(change[2]) % (payload.len().max(1) * 8);
                if let Some(byte) = payload.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            4 => pieces.insert(place, (change[2], change.to_vec())),
            5 => pieces[place] = (u8::MAX, vec![change[2] % 4]),
            _ => pieces.truncate(place + 1),
        }
    }
    let first_seq = match shift % 8 {
        7 => 5 + u64::from(shift / 8),
        _ => 5,
    };
    let file = written(first_seq, &pieces);
    let key = secret().verifying_key().to_bytes();
    let is_honest = file == honest.file
        || (honest.file.starts_with(&file) && honest.ends.contains(&file.len()));
    match verify(&file, Some(key), None) {
        Ok(held) => assert!(
            held.signed && is_honest,
            "a forged file is taken for signed"
        ),
        Err(_) => assert!(!is_honest, "an honest file is refused"),
    }
    // Without a key, another one may have signed; this one has not.
    if let Ok(held) = verify(&file, None, None) {
        assert!(!held.signed || is_honest || held.key != Some(key));
    }
}
