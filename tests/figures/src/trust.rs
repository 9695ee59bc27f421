//! What signatures, sessions and the start of a signed image cost.

use core::hint::black_box;

use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha512};
use umi_core::trust::access::session::{BoardHandshake, BoardShare, HostHandshake};
use umi_core::trust::access::update::image::ImageHeader;
use umi_core::trust::board_key::{BoardKey, key_id};
use umi_protocol::frame::Authenticated;
use umi_protocol::job::name;

use crate::meter::{Failed, Meter, Ram, names, repeated};

/// How often a signature is made: it takes long enough.
const FEW: u32 = 3;
/// Bytes that are hashed in one go: a page of flash.
const PAGE: usize = 4096;
/// Bytes of a message of usual length.
const MESSAGE: usize = 100;

/// Does all of this work.
pub fn all(meter: &mut impl Meter) -> Result<(), Failed> {
    let draw = |seed: &mut [u8; 32]| {
        for (place, byte) in seed.iter_mut().zip(1..) {
            *place = byte;
        }
        Ok(())
    };
    let board = BoardKey::open(Ram::new(), draw).map_err(|_| Failed(names::SIGN))?;
    let public = board.public();
    let header = ImageHeader {
        board: name("figures"),
        version: [1, 2, 3],
        counter: 4,
        length: 500_000,
        sha512: [9; 64],
        key_id: key_id(&public),
    };
    repeated(meter, names::SIGN, FEW, || {
        black_box(board.sign(black_box(&header.signed()))) != [[0; 32]; 2]
    })?;
    let signature = board.sign(&header.signed());
    repeated(meter, names::VERIFY, FEW, || {
        black_box(&header).is_signed(black_box(signature), &public)
    })?;
    session(meter, public)?;
    let page = [0x5A; PAGE];
    let mut last = 0;
    meter.measure(names::DIGEST, PAGE as u32, &mut || {
        last = Sha512::digest(black_box(&page))
            .last()
            .copied()
            .unwrap_or(0);
    });
    black_box(last);
    Ok(())
}

/// The board's part of a session.
fn session(meter: &mut impl Meter, board_key: [u8; 32]) -> Result<(), Failed> {
    let failed = Failed(names::SESSION);
    let key = SigningKey::from_bytes(&[7; 32]);
    let host = HostHandshake::new(&key, [3; 32]);
    let ask = host.ask();
    let begin = || {
        let drawn = BoardShare::new([4; 32], [5; 32]);
        BoardHandshake::new(black_box(&ask), board_key, drawn)
    };
    let asked = begin();
    let (signature, _) = host.prove(&key, asked.challenge()).ok_or(failed)?;
    let mut opened = None;
    repeated(meter, names::SESSION, 1, || {
        opened = begin().prove(black_box(signature));
        opened.is_some()
    })?;
    let (session, _) = opened.ok_or(failed)?;
    let message = [0x33; MESSAGE];
    let frame = Authenticated {
        header: [6, 1, 0, 9, 9, 9, 9],
        counter: 1,
        message: &message,
    };
    repeated(meter, names::SEAL, FEW, || {
        black_box(session.code(black_box(&frame))) != [0; 16]
    })
}
